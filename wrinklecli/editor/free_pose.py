"""A free pose: joints and morph targets set by hand, played as a clip of one moment."""

from dataclasses import replace

from wrinklecli.character.clip import Clip
from wrinklecli.character.posing import JointTurn, pose_clip
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document

POSE = "free pose"
"""Name of the free pose among the clips."""


@dataclass(frozen=True, slots=True)
class FreePose:
    """A pose that differs from the stored one by some turns and weights.

    Attributes:
        turns: Degrees (not 0) by joint and by its own axis x, y or z.
        weights: Weights of morph targets by name; the others keep their stored weights.
    """

    turns: tuple[tuple[tuple[str, str], float], ...] = ()
    weights: tuple[tuple[str, float], ...] = ()

    def with_turn(self, joint: str, axis: str, degrees: float) -> "FreePose":
        """Turn a joint about an axis, from its stored pose."""
        turns = {**dict(self.turns), (joint, axis): degrees}
        # The order is part of the pose: a joint turns about x, then y, then z.
        return replace(self, turns=tuple(sorted((key, angle) for key, angle in turns.items() if angle)))

    def with_weight(self, target: str, weight: float) -> "FreePose":
        """Set the weight of a morph target."""
        return replace(self, weights=tuple({**dict(self.weights), target: weight}.items()))

    @property
    def joint_turns(self) -> list[JointTurn]:
        """The turns: joint, axis and degrees of each."""
        return [(joint, axis, degrees) for (joint, axis), degrees in self.turns]

    @property
    def options(self) -> str:
        """The pose as options of `wrinkle check` and `wrinkle preview`; empty for the stored pose."""
        words = [f"--pose {joint}={axis}:{degrees:g}" for (joint, axis), degrees in self.turns]
        return " ".join([*words, *(f"--morph {name}={weight:g}" for name, weight in self.weights)])

    def clip(self, document: Document) -> Clip | None:
        """Make a clip of one key; None for the stored pose.

        Raises:
            AssetError: A joint or morph target does not exist, or a joint is stored as a matrix.
        """
        if not self.turns and not self.weights:
            return None
        return pose_clip(document, self.joint_turns, self.weights)
