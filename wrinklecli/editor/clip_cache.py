"""Poses of meshes and heights of tools over the clips, at the times at which an editor plays: looked up, not computed.

A clip is sampled once for each mesh and each tool, as a bake samples it; a frame that plays takes a row of that. Other
times, where somebody scrubs, are computed as they come.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from wrinklecli.baking.plan import Ground
from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.effects.wrinkle.activity import Activity, activities, tissues
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import Floats, distinct_values

# Frames per second of a clip that is played, and of one clip at most.
FPS, _MOST_FRAMES = 30.0, 10_000
# Bytes of one mesh's matrices over a clip beyond which they are computed frame by frame.
_MOST_BYTES = 2**28

Kept = TypeVar("Kept")


class RecentResults:
    """Results by what they were made from, the latest ones; several threads may ask.

    Args:
        count: How many are kept.

    Attributes:
        count: The same, which may change.
    """

    def __init__(self, count: int) -> None:
        self.count, self._lock = count, threading.Lock()
        self._values: OrderedDict[Hashable, Any] = OrderedDict()

    def get(self, key: Hashable) -> Any:
        """What was made from a key; None where it is not kept."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def of(self, key: Hashable, make: Callable[[], Kept]) -> Kept:
        """What was made from a key, be it now; two threads that ask at once may both make it."""
        found: Kept | None = self.get(key)
        if found is not None:
            return found
        made = make()
        with self._lock:
            self._values[key] = made
            while len(self._values) > self.count:
                self._values.popitem(last=False)
        return made


def frame_times(clip: Clip) -> Floats:
    """(frames,) seconds at which a clip is played: 30 a second, fewer of a very long one, its end among them."""
    seconds = clip.end - clip.start
    return clip_grid(clip, None, fps=min(FPS, _MOST_FRAMES / seconds) if seconds > 0 else FPS)


@dataclass(frozen=True, slots=True)
class _Poses:
    """What moves a mesh over a clip: (frames, joints, 4, 4) matrices and (frames, morph targets) weights."""

    matrices: Floats
    weights: Floats


class ClipCache:
    """Clips as they are played. What is asked for again is kept."""

    def __init__(self) -> None:
        self._times, self._poses, self._seen = RecentResults(64), RecentResults(16), RecentResults(256)

    def times(self, clip: Clip) -> Floats:
        """(frames,) seconds, as `frame_times`."""
        return self._times.of(clip.name, lambda: frame_times(clip))

    def pose(self, ground: Ground, clip: Clip | None, time: float) -> tuple[Floats, Floats]:
        """(1, acting joints, 4, 4) matrices from bind to world space, and (1, morph targets) weights.

        The acting joints are those that any vertex follows, rising.
        """
        acting = distinct_values(ground.surface.joints)
        frame = None if clip is None else self._frame(clip, time)
        times = np.array([time])
        if clip is None or frame is None or 128 * len(acting) * len(self.times(clip)) > _MOST_BYTES:
            return joint_matrices(ground.rig, clip, times, acting), morph_weights(ground.rig, clip, times)
        every = self.times(clip)
        found = self._poses.of(
            (ground, clip.name),
            lambda: _Poses(joint_matrices(ground.rig, clip, every, acting), morph_weights(ground.rig, clip, every)),
        )
        return found.matrices[frame : frame + 1], found.weights[frame : frame + 1]

    def activity(self, ground: Ground, patch: Patch, clip: Clip) -> Activity:
        """What a clip makes of a tool, at the times at which it is played."""
        return self._seen.of(
            (patch.tool, ground, clip.name),
            lambda: activities([patch], ground.rig, ground.rest, clip, self.times(clip))[0],
        )

    def at(self, ground: Ground, patch: Patch, clip: Clip | None, time: float) -> tuple[Floats, float]:
        """(1, groups, modes) amplitudes of a tool at a time, without strength, and its anchors' distance."""
        frame = None if clip is None else self._frame(clip, time)
        if clip is not None and (frame is not None or patch.tool.lag is not None):
            seen = self.activity(ground, patch, clip)
            if frame is not None:
                return seen.amplitudes[frame : frame + 1], float(seen.distances[frame])
            late = [seen.tissue]  # it has followed the clip up to here already
        else:
            late = tissues([patch], ground.rig, ground.rest, clip)
        (now,) = activities([patch], ground.rig, ground.rest, clip, np.array([time]), lagging=late)
        return now.amplitudes, float(now.distances[0])

    def _frame(self, clip: Clip, time: float) -> int | None:
        """The number of the frame that is shown at just this time."""
        times = self.times(clip)
        frame = int(np.searchsorted(times, time))
        return frame if frame < len(times) and times[frame] == time else None
