"""Rises: motions from rest to a tool's tallest wrinkles, by a morph target or keyed rest lengths, if no joint bends.

A fold of such tools has a rise in place of a hinge, as on a nose beneath glasses. The weights of contact are then
looked up by the tool's own shortening. Not in the paper.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip, sample
from wrinklecli.character.motion import motion_clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.segment import Lengths
from wrinklecli.effects.wrinkle.bending import own_motions
from wrinklecli.effects.wrinkle.lookup import looked_up
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats

# Name of a clip that no file has, in which a keyed rest length grows.
_GROWING = "\0"
# Seconds of a rise, a stride apart. Heights start like a square root, so the motion goes with the square of the time.
_TIMES = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True, slots=True)
class Rise:
    """The motion of a tool from rest to its tallest wrinkles.

    Attributes:
        patch: The tool.
        motion: A clip of a second that raises it.
        rig: The joints and morph targets of its mesh.
    """

    patch: Patch
    motion: Clip
    rig: Rig

    @property
    def sweeps(self) -> list[tuple[Clip, Floats]]:
        """The rise, as the sweep of a hinge."""
        return [(self.motion, _TIMES)]

    def strides(self, rig: Rig, clip: Clip, times: Floats) -> Floats:
        """(frames,) progress at (frames,) seconds of a clip, in strides."""
        least, most = self.reading(self.rig, self.motion, _TIMES[[0, -1]]).rows
        return np.asarray(self.reading(rig, clip, times).rows * (len(_TIMES) - 1) / max(most - least, TINY))

    def reading(self, rig: Rig, clip: Clip, times: Floats) -> Lengths:
        """The measurements at (frames,) seconds of a clip by which weights are looked up."""
        return self.patch.segment.lengths(rig, clip, times)


def rise_of(patch: Patch, rig: Rig) -> Rise | None:
    """The motion that makes a tool tallest if no joint bends it; None if nothing shortens the tool."""
    if patch.keyed_clips:
        # Add a clip in which the tool's rest length grows from that at rest to the greatest of its keys.
        keys = patch.segment.rest_length.keys
        longest = max(patch.rest_length, *(float(each[:, 1].max()) for each in keys.values()))
        lengths = patch.rest_length + _TIMES**2 * (longest - patch.rest_length)
        rest_length = replace(patch.segment.rest_length, keys={**keys, _GROWING: np.stack([_TIMES, lengths], axis=1)})
        patch = replace(patch, segment=replace(patch.segment, rest_length=rest_length))
    found, tallest = None, 0.0
    for channels in ((), *(each.channels for each in own_motions(patch, rig))):
        evenly = [replace(each, times=_TIMES, values=sample(each, _TIMES**2)) for each in channels]
        motion = motion_clip(_GROWING, evenly)
        amplitudes = looked_up(patch.curve, patch.segment.lengths(rig, motion, _TIMES))
        height = float(patch.curve.heights(amplitudes).max())
        # Of several equal motions the first counts.
        if height > tallest:
            found, tallest = motion, height
    return None if found is None else Rise(patch, found, rig)
