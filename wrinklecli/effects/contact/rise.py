"""Rises: what raises a tool's wrinkles where no joint bends: a morph target, or a rest length that is keyed by hand.

A fold of theirs has a rise in place of a hinge, from rest to the tallest wrinkles, as of a nose beneath glasses.
Weights of contact are then looked up by the tool's own shortening. Not in the paper.
"""

from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.clip import Clip, sample
from wrinklecli.character.motion import motion_clip
from wrinklecli.character.rig import Rig
from wrinklecli.effects.wrinkle.bending import own_motions
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import Floats

# The clip of no file in which a rest length grows that others key.
_GROWING = "\0"
# Shares of a rise between two poses, at most.
_STRIDE = 1.0 / 16
# Seconds of a rise. Heights start like a square root: what raises them goes as the square of the time.
_TIMES = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True, slots=True)
class Rise:
    """A tool's way from rest to its tallest wrinkles.

    Attributes:
        patch: The tool.
        motion: A clip of a second that raises it.
        rig: The joints and morph targets of its mesh.
    """

    patch: Patch
    motion: Clip
    rig: Rig

    @property
    def ends(self) -> tuple[float, ...]:
        """Shares of the rise that it goes to."""
        return (1.0,)

    @property
    def leanings(self) -> Floats:
        """(leanings, 2): it goes one way alone."""
        return np.zeros((1, 2))

    @property
    def stride(self) -> float:
        """Shares between two poses, at most."""
        return _STRIDE

    def turn(self, _shares: Floats, *, tilt: Floats | None = None) -> Clip:
        """The rise as a clip of a second, through (keys,) evenly spaced shares from 0 to 1."""
        assert tilt is None or not tilt.any()
        return self.motion

    def rows(self, shares: Floats) -> Floats:
        """(rows,) the shortenings by which weights at (rows,) shares are looked up."""
        return self.rows_in(self.rig, self.motion, shares)

    def strides(self, rig: Rig, clip: Clip, times: Floats) -> Floats:
        """(frames,) how far it is at (frames,) seconds of a clip, in strides."""
        least, most = self.rows(_TIMES[[0, -1]])
        return np.asarray(self.rows_in(rig, clip, times) / (_STRIDE * max(most - least, np.finfo(np.float64).tiny)))

    def rows_in(self, rig: Rig, clip: Clip, times: Floats) -> Floats:
        """(frames,) what weights are looked up by at (frames,) seconds of a clip: the tool's shortenings."""
        return self.patch.segment.lengths(rig, clip, times).rows


def rise_of(patch: Patch, rig: Rig) -> Rise | None:
    """How a tool rises that no joint bends, by what makes it tallest; None where nothing shortens it."""
    if patch.keyed_clips:
        patch = _growing(patch)
    found, tallest = None, 0.0
    for channels in ((), *(each.channels for each in own_motions(patch, rig))):
        evenly = [replace(each, times=_TIMES, values=sample(each, _TIMES**2)) for each in channels]
        motion = motion_clip(_GROWING, evenly)
        amplitudes, _ = patch.curve.follow(*patch.segment.lengths(rig, motion, _TIMES))
        height = float(patch.curve.heights(amplitudes).max())
        # The first of several that are alike.
        if height > tallest:
            found, tallest = motion, height
    return None if found is None else Rise(patch, found, rig)


def _growing(patch: Patch) -> Patch:
    """The tool with a clip in which its rest length grows too, from that at rest to the greatest of its keys."""
    keys = patch.segment.rest_length.keys
    longest = max(patch.rest_length, *(float(each[:, 1].max()) for each in keys.values()))
    lengths = patch.rest_length + _TIMES**2 * (longest - patch.rest_length)
    rest_length = replace(patch.segment.rest_length, keys={**keys, _GROWING: np.stack([_TIMES, lengths], axis=1)})
    return replace(patch, segment=replace(patch.segment, rest_length=rest_length))
