"""Drives in one clip: the weights of their targets over time, and the keys between which straight lines are right.

A bake plays the asset's own clips by this module, and `track` those of other files.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from wrinklecli.character.clip import KEY_GAP, KEY_STEP, Clip, clip_grid
from wrinklecli.character.pose import node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import AnyDrive
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.piecewise import Signal, key_times
from wrinklecli.numeric.portions import portions


class Playing:
    """Some drives on a rig in one clip; in the stored pose if `clip` is None.

    Args:
        drives: The drives.
        rig: The joints and morph targets that carry what they measure.
        clip: The clip.
    """

    def __init__(self, drives: Sequence[AnyDrive], rig: Rig, clip: Clip | None) -> None:
        self._drives, self._rig, self._clip = drives, rig, clip
        self._nodes = sorted(frozenset[int]().union(*(each.nodes for each in drives)))
        self._readers: list[Callable[[Floats, dict[int, Floats]], Any]] = [each.reader(rig, clip) for each in drives]

    def read(self, times: Floats) -> list[Any]:
        """The measurements of each drive at (frames,) seconds; joints are posed together, and once."""
        parts: list[tuple[Floats, dict[int, Floats]]] = [(times[part], {}) for part in portions(max(len(times), 1), 32)]
        for part, known in parts:
            node_rows(self._rig, self._clip, part, self._nodes, known)
        return [_joined([read(part, known) for part, known in parts]) for read in self._readers]

    def weights(self, readings: Sequence[Any]) -> list[Floats]:
        """(frames, targets) weights of each drive, from its measurements."""
        return [each.weights(self._clip, reading) for each, reading in zip(self._drives, readings, strict=True)]

    def at(self, times: Floats) -> Floats:
        """(frames, targets of all drives) weights at (frames,) seconds."""
        return np.concatenate([np.zeros((len(times), 0)), *self.weights(self.read(times))], axis=1)


def _joined(parts: Sequence[Any]) -> Any:
    """The measurements of one drive, from those of successive times."""
    if len(parts) == 1:
        return parts[0]
    if isinstance(parts[0], tuple):
        joined = tuple(_joined(each) for each in zip(*parts, strict=True))
        return joined if type(parts[0]) is tuple else type(parts[0])(*joined)
    return np.concatenate(parts) if isinstance(parts[0], np.ndarray) else parts[0]


def play_grid(drives: Sequence[AnyDrive], rig: Rig, clip: Clip, *, fps: float) -> Floats:
    """(frames,) seconds of a clip's grid, with its own keys, and with the corners of the weights of drives."""
    corners = np.concatenate([np.zeros(0), *(each.breaks(clip) for each in drives)])
    return clip_grid(clip, rig, fps=fps, corners=corners)


def play_keys(
    grid: Floats, signal_on: Callable[[Floats], Signal], *, width: int, tolerance: float, thinning: float
) -> tuple[Floats, Ints]:
    """Find times between which a signal is straight, and the keys among them, as `key_times`.

    No two keys are closer than `KEY_GAP`, as no player shows what lies between.
    """
    return key_times(grid, signal_on, width=width, tolerance=tolerance, thinning=thinning, gap=KEY_GAP, step=KEY_STEP)
