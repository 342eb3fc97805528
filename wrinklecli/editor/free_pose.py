"""A free pose: joints turned and morph targets raised by hand, as a clip of one moment that no file has."""

from dataclasses import dataclass, replace

from wrinklecli.character.clip import Clip
from wrinklecli.character.posing import pose_clip
from wrinklecli.gltf.document import Document

POSE = "free pose"
"""What stands for it among the names of clips."""


@dataclass(frozen=True, slots=True)
class FreePose:
    """A pose; the stored one where nothing is named.

    Attributes:
        turns: Degrees by joint and its own axis x, y or z; none is 0.
        weights: Of morph targets, by name; those that are not named are as stored.
    """

    turns: tuple[tuple[tuple[str, str], float], ...] = ()
    weights: tuple[tuple[str, float], ...] = ()

    def turned(self, joint: str, axis: str, degrees: float) -> "FreePose":
        """It with a joint turned so far about an axis, from the stored pose."""
        kept = {**dict(self.turns), (joint, axis): degrees}
        # Those of one joint are turned about x, then y, then z, whichever was set first.
        return replace(self, turns=tuple(sorted((key, angle) for key, angle in kept.items() if angle)))

    def raised(self, target: str, weight: float) -> "FreePose":
        """It with a morph target raised so far."""
        return replace(self, weights=tuple({**dict(self.weights), target: weight}.items()))

    @property
    def options(self) -> str:
        """It as options of `wrinkle check` and `wrinkle preview`; nothing for the stored pose."""
        words = [f"--pose {joint}={axis}:{degrees:g}" for (joint, axis), degrees in self.turns]
        return " ".join([*words, *(f"--morph {name}={weight:g}" for name, weight in self.weights)])

    def clip(self, document: Document) -> Clip | None:
        """A clip of one key; None for the stored pose.

        Raises:
            AssetError: There is no joint or morph target of a name, or a joint is stored as a matrix.
        """
        if not self.turns and not self.weights:
            return None
        turns = [(joint, axis, degrees) for (joint, axis), degrees in self.turns]
        return pose_clip(document, turns, self.weights)
