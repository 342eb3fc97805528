"""Trails: the weights that a fold has had so far in a clip, by the turn of its joint.

Skin that slides opens otherwise than it closes, so that the solutions of a pose differ by the way to it. Players know
the pose alone. So a clip that comes back to a turn takes the weights that it had there, where these leave no crossing.
"""

from dataclasses import field

import numpy as np

from wrinklecli.drive.angle import Angles
from wrinklecli.drive.segment import Lengths
from wrinklecli.drive.table import Path
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats

# Sine of half of 1°: turns that are nearer than this are the same, and the eye sees no jump of a joint by so little.
_SAME = 0.0087
# Such distances from which on a turn has nothing to do with another: weights change evenly on the way out.
_APART = 3.0


@dataclass(slots=True)
class Trail:
    """The turns of a joint in a clip where it has not been before, with the weights there.

    Attributes:
        turns: (frames, 3) turns of the whole clip, as `Angles` has them; None if no joint folds.
        frames: The frames so far in which the joint is where it has not been before.
        weights: The (shapes,) weights in these, or how far they are from known ones.
    """

    turns: Floats | None
    frames: list[int] = field(default_factory=list)
    weights: list[Floats] = field(default_factory=list)

    @classmethod
    def of(cls, reading: Angles | Lengths) -> "Trail":
        """The trail of a clip, from the measurements of its fold."""
        return cls(reading.turns if isinstance(reading, Angles) else None)

    def at(self, frame: int) -> tuple[Floats, float] | None:
        """The weights beside the turn of a frame, and how much they count, from 0 to 1; None where the joint is new.

        A turn that goes on from the last one is new, however near it is.
        """
        if self.turns is None or len(self.frames) < 2:
            return None
        path = Path(self.turns[self.frames], np.stack(self.weights))
        (along,), (squares,) = path.projected(self.turns[[frame]])
        nearest = int(squares.argmin())
        share = float(np.clip((_APART - np.sqrt(squares[nearest]) / _SAME) / (_APART - 1.0), 0.0, 1.0))
        if not share or (nearest == len(squares) - 1 and along[nearest] == 1.0):
            return None
        return path.between(nearest, along[nearest]), share

    def go_on(self, frame: int, weights: Floats) -> None:
        """Add a frame for which `at` gives None."""
        self.frames.append(frame)
        self.weights.append(weights.copy())


def fresh_frames(reading: Angles | Lengths, weights: Floats) -> list[int]:
    """The frames of a clip in which a joint has a turn that it did not have before; weights are (frames, shapes)."""
    trail = Trail.of(reading)
    for frame, row in enumerate(weights):
        if trail.at(frame) is None:
            trail.go_on(frame, row)
    return trail.frames
