"""The seconds of each stage of a bake, and its memory, apart from the report, which is the same every time."""

import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from wrinklecli.baking.job import Job
from wrinklecli.baking.report import BakedMesh
from wrinklecli.character.clip import clip_grid
from wrinklecli.effects.effect import targets_of
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import distinct_values

VERSION = 1
# In the order of the pipeline; `plan` attaches and refines, `export` writes the files of --frames-dir.
STAGES = ("read", "plan", "sample", "budget", "encode", "prove", "report", "export", "write")


class StageClock:
    """Adds up the `seconds` of each stage."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(STAGES, 0.0)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time spent within to a stage, which may run several times."""
        start = time.perf_counter()
        yield
        self.seconds[name] += time.perf_counter() - start


def make_timings(clock: StageClock, job: Job, baked: Sequence[BakedMesh], *, bytes_written: int | None) -> Json:
    """Gather the costs of a bake as JSON values, with the keys of `wrinkle bake --help`.

    `bytes_written` is the size of OUT with the files beside it; None without OUT.
    """
    clips = {motion.clip.index: motion.clip for each in baked for motion in each.motions}
    members = [
        distinct_values(np.concatenate([np.zeros(0, np.intp), *(part.vertices for part in each.plan.parts)]))
        for each in baked
    ]
    frames = sum(len(clip_grid(clip, None, fps=job.settings.sampling.fps)) for clip in clips.values())
    seconds = {stage: round(each, 6) for stage, each in clock.seconds.items()}
    total = round(sum(seconds.values()), 6)
    return {
        "timings": VERSION,
        "seconds": seconds,
        "total_seconds": total,
        "clips": len(clips),
        "frames": frames,
        "frames_per_second": round(frames / max(total, 1e-6), 3),
        "members": sum(len(each) for each in members),
        "targets": sum(len(targets_of(each.effects)) for each in baked),
        "bytes_added": _bytes_added(job.document, bytes_written),
        "peak_memory_bytes": peak_memory(),
    }


def _bytes_added(document: Document, bytes_written: int | None) -> int | None:
    """Bytes that OUT has more than the asset with its buffers; None without OUT, or if the asset is gone by now."""
    if bytes_written is None:
        return None
    try:
        return bytes_written - sum(os.path.getsize(path) for path in document.files)
    except OSError:  # no reason to fail: OUT is written
        return None


def peak_memory() -> int | None:
    """The greatest memory of this process so far, bytes; None on Windows."""
    if sys.platform == "win32":
        return None
    import resource

    # Kilobytes, but bytes on macOS.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
