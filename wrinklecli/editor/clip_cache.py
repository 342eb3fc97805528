"""Poses of clips, and the numbers by which tools move, at the times at which the editor plays them.

A clip is sampled once for each mesh and each tool, as a bake samples it, and a frame that plays is one row of the
samples. Times between frames, as when someone scrubs, are computed on demand.
"""

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

import numpy as np

from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.choices import FPS
from wrinklecli.effects.effect import Part, Seen
from wrinklecli.effects.sampling import reader, seen_at
from wrinklecli.numeric.arrays import Floats, distinct_values
from wrinklecli.numeric.piecewise import Signal
from wrinklecli.surface.ground import Ground

_MAX_FRAMES = 10_000  # frames of one clip; a longer clip plays at fewer frames per second
_MAX_POSE_BYTES = 2**28  # bytes of one mesh's joint matrices over a clip; larger ones are computed frame by frame
_MATRIX_BYTES = 128  # bytes of a 4x4 matrix
_KEPT_TIMES = 64  # clips whose frame times are kept
_KEPT_POSES = 16  # pairs of mesh and clip whose poses are kept
_KEPT_NUMBERS = 256  # triples of tool, mesh and clip whose numbers are kept

Kept = TypeVar("Kept")


class RecentResults:
    """The most recent results by key, `count` of them. Several threads may use it, and `count` may change."""

    def __init__(self, count: int) -> None:
        self.count, self._lock = count, threading.Lock()
        self._values: OrderedDict[Hashable, Any] = OrderedDict()

    def get(self, key: Hashable) -> Any:
        """Look up a result; None if it is not kept."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
            return self._values.get(key)

    def get_or_make(self, key: Hashable, make: Callable[[], Kept]) -> Kept:
        """Look up a result, or make and keep it; two threads that ask at once may both make it."""
        kept: Kept | None = self.get(key)
        if kept is not None:
            return kept
        made = make()
        with self._lock:
            self._values[key] = made
            while len(self._values) > self.count:
                self._values.popitem(last=False)
        return made


def frame_times(clip: Clip) -> Floats:
    """(frames,) seconds at which a clip plays, with its end; a very long clip has fewer than 30 a second."""
    seconds = clip.end - clip.start
    return clip_grid(clip, None, fps=min(FPS, _MAX_FRAMES / seconds) if seconds > 0 else FPS)


class ClipCache:
    """Samples of clips, of which the recent ones are kept."""

    def __init__(self) -> None:
        self._times = RecentResults(_KEPT_TIMES)
        self._poses = RecentResults(_KEPT_POSES)
        self._weights = RecentResults(_KEPT_POSES)
        self._readers, self._seen, self._numbers = (RecentResults(_KEPT_NUMBERS) for _ in range(3))

    def times(self, clip: Clip) -> Floats:
        """(frames,) seconds, as `frame_times`."""
        return self._times.get_or_make(clip.name, lambda: frame_times(clip))

    def pose(self, ground: Ground, driven: Ground, clip: Clip | None, time: float) -> tuple[Floats, Floats]:
        """Pose a mesh.

        Args:
            ground: The mesh; its joints are sampled once.
            driven: The same mesh with other drives of its morph targets.
            clip: None for the stored pose.
            time: Seconds.

        Returns:
            (1, acting joints, 4, 4) matrices from bind to world space, and (1, morph targets) weights. The acting
            joints are those with influence on any vertex, sorted.
        """
        acting = distinct_values(ground.surface.joints)

        frame = None if clip is None else self._frame(clip, time)
        if clip is None or frame is None or _MATRIX_BYTES * len(acting) * len(self.times(clip)) > _MAX_POSE_BYTES:
            now = np.array([time])
            return joint_matrices(ground.rig, clip, now, acting), morph_weights(driven.rig, clip, now)
        matrices = self._poses.get_or_make(
            (ground, clip.name), lambda: joint_matrices(ground.rig, clip, self.times(clip), acting)
        )
        weights = self.weights(driven, clip)
        return matrices[frame : frame + 1], weights[frame : frame + 1]

    def weights(self, ground: Ground, clip: Clip) -> Floats:
        """(frames, morph targets) weights of a mesh over a clip, with those that drives set."""
        return self._weights.get_or_make((ground, clip.name), lambda: morph_weights(ground.rig, clip, self.times(clip)))

    def seen(self, ground: Ground, part: Part, clip: Clip) -> Seen:
        """A tool's measurements and weights over a clip, at its frame times."""
        key = (part.attached.tool, ground, clip.name)
        return self._seen.get_or_make(key, lambda: seen_at(part, ground.rig, clip, self.times(clip)))

    def numbers(self, ground: Ground, part: Part, clip: Clip) -> Floats:
        """(frames, numbers) by which a tool moves over a clip, at its frame times."""
        key = (part.attached.tool, ground, clip.name)
        return self._numbers.get_or_make(key, lambda: part.numbers(clip, self.seen(ground, part, clip).reading))

    def numbers_at(self, ground: Ground, part: Part, clip: Clip | None, time: float) -> Floats:
        """(1, numbers) by which a tool moves at a time; in the stored pose without a clip."""
        frame = None if clip is None else self._frame(clip, time)
        if clip is not None and frame is not None:
            return self.numbers(ground, part, clip)[frame : frame + 1]
        return self._reader(ground, part, clip)(np.array([time]))

    def _reader(self, ground: Ground, part: Part, clip: Clip | None) -> Signal:
        """The reader of a tool, whose spring follows a clip once."""
        key = (part.attached.tool, ground, None if clip is None else clip.name)
        return self._readers.get_or_make(key, lambda: reader(part, ground.rig, clip))

    def _frame(self, clip: Clip, time: float) -> int | None:
        """Number of the frame at exactly this time."""
        times = self.times(clip)
        frame = int(np.searchsorted(times, time))
        return frame if frame < len(times) and times[frame] == time else None
