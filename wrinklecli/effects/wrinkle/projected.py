"""Tools with `attachment: patch` over clips: few shapes that give the displacements that are projected in each frame.

Their weights are no function of the segment's length, so each clip's own are kept as rows.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.drive.drive import Rows
from wrinklecli.drive.play import play_keys
from wrinklecli.effects.effect import MeshPlan, SamplingOptions
from wrinklecli.effects.sampling import (
    KEYS_SHARE,
    REDUCTION_SHARE,
    SAMPLING_SHARE,
    duplicates_of,
    most_overlaps,
    within,
)
from wrinklecli.effects.shapes import fit_bytes
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.reduction import compress

# Coordinates of displacements that are compressed at once, which bounds the memory.
_MOST_COORDINATES = 2**20
PER_COORDINATE = 3.0**0.5
"""Length of a vector whose coordinates are all 1: its error if each coordinate is off by 1."""


@dataclass(frozen=True, slots=True)
class Projection:
    """Displacements projected in all clips, as few shapes.

    Attributes:
        deltas: (shapes, vertices, 3) bind displacement at weight 1.
        rows: By the names of clips, (rows, shapes) weights over time.
        moments: (clip, seconds) of all rows, in the order of the clips with different motions.
        together: (moments, shapes) their weights.
        error: Greatest error of a vertex, scene units.
    """

    deltas: Floats
    rows: dict[str, Rows]
    moments: list[tuple[Clip, float]]
    together: Floats
    error: float


def project(plan: MeshPlan, carried: CarriedPatch, clips: Sequence[Clip], how: SamplingOptions) -> Projection:
    """Project a tool's vertices in all clips, at times between which straight lines are right.

    Raises:
        BakeError: There are too many shapes.
        TooMuchError: They would take more memory than is left.
    """
    firsts = duplicates_of(plan, clips)
    moments = [(clips[first], _times(plan, carried, clips[first], how)) for first in sorted(set(firsts))]
    if not moments:
        return Projection(np.zeros((0, len(carried.vertices), 3)), {}, [], np.zeros((0, 0)), 0.0)
    together, deltas = compress_displacements(plan, carried, moments, how.memory)
    if plan.has_normals:
        what = f"the normals of {len(deltas):,} shapes of {len(carried.vertices):,} vertices"
        how.memory.check(fit_bytes(len(deltas), len(carried.vertices)), what, where=carried.patch.tool.where)
    parts = np.split(together, np.cumsum([len(times) for _, times in moments])[:-1])
    own = {clip.name: Rows(times, weights) for (clip, times), weights in zip(moments, parts, strict=True)}
    rows = {clip.name: own[clips[first].name] for clip, first in zip(clips, firsts, strict=True)}
    every = [(clip, time) for clip, times in moments for time in times.tolist()]
    return Projection(deltas, rows, every, together, REDUCTION_SHARE * plan.max_error)


def _times(plan: MeshPlan, carried: CarriedPatch, clip: Clip, how: SamplingOptions) -> Floats:
    """(frames,) seconds of a clip at which vertices are projected."""
    if how.mode == "frames":
        return clip_grid(clip, None, fps=how.fps)
    scale, width = PER_COORDINATE * plan.scale, 3 * len(carried.vertices)

    def moves(times: Floats) -> Floats:
        return scale * displacements(carried, plan.fine, plan.rig, clip, times).reshape(len(times), -1)

    bound, signal = plan.max_error / most_overlaps(plan), within(how.memory, moves, width, where=clip.name)
    times, keys = play_keys(
        clip_grid(clip, plan.rig, fps=how.fps),
        lambda _stretch: signal,
        width=width,
        tolerance=SAMPLING_SHARE * bound,
        thinning=KEYS_SHARE * bound,
    )
    return np.asarray(times[keys])


def compress_displacements(
    plan: MeshPlan, carried: CarriedPatch, moments: Iterable[tuple[Clip, Floats]], memory: Memory
) -> tuple[Floats, Floats]:
    """`compress` the displacements of a tool with `attachment: patch` at (frames,) times of some clips."""
    chunk = max(_MOST_COORDINATES // (3 * len(carried.vertices)), 1)
    series = (
        displacements(carried, plan.fine, plan.rig, clip, times[k : k + chunk])
        for clip, times in moments
        for k in range(0, len(times), chunk)
    )
    tolerance = REDUCTION_SHARE * plan.max_error / plan.scale / PER_COORDINATE
    return compress(series, tolerance, memory=memory, where=carried.patch.tool.where)
