"""Tools with `attachment: patch` over clips: few shapes that give the displacements that are projected in each frame.

Their weights are no function of the segment's length, so each clip's own are kept as rows.
"""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from wrinklecli.character.clip import KEY_GAP, Clip, clip_grid
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
from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.reduction import compress, refuse_large_series

# Coordinates of displacements that are compressed at once, which bounds the memory.
_MOST_COORDINATES = 2**20
PER_COORDINATE = 3.0**0.5
"""Length of a vector whose coordinates are all 1: its error if each coordinate is off by 1."""

# Moments of all clips from which shapes are estimated first,
_MOMENTS = 32
# and moments that crowd where shapes change, if more would need more shapes. They take a few seconds on a path.
_MORE_MOMENTS = 256
# Shapes for each moment up to which more moments are not expected to need many more shapes.
_SETTLED = 1 / 6
# Intervals between two frames that are looked into, to estimate the times of keys.
_LOOKED_INTO = 16
# Most shapes of one tool that may be expected: three.js, Filament and Bevy play 256 targets of a mesh. The time to fit
# their normals grows with the cube, and is half a minute for 300 shapes of 800 vertices.
_MOST_SHAPES = 256


def expected_shapes(
    plan: MeshPlan, carried: CarriedPatch, clips: Sequence[Clip], frames: int, bound: float, memory: Memory
) -> int:
    """Estimate the number of shapes that a tool needs over so many frames of clips.

    A few moments spread over the clips need about as many shapes as all frames do, unless wrinkles slide over so many
    vertices that most moments need a shape of their own. Then the number of shapes is taken to go on growing with the
    times of keys as it does up to 256 of them.

    Args:
        plan: The mesh.
        carried: The tool.
        clips: The clips.
        frames: Their frames in all.
        bound: Greatest error of the tool, scene units.
        memory: The limit of the command.

    Raises:
        BakeError: The tool needs too many shapes.
        TooMuchError: Its shapes would take more memory than is left.
    """
    spread = [(clip, np.ones(1)) for clip in clips[:: -(-len(clips) // _MOMENTS)]]
    count = _shapes_at(plan, carried, spread, _MOMENTS, memory)
    refuse_large_series(memory, frames, len(carried.vertices), count, where=carried.patch.tool.where)
    if count <= _SETTLED * _MOMENTS:
        return count
    crowding = _crowding(plan, carried, clips, frames, bound)
    times = round(frames * float(np.mean(np.concatenate([parts for _, parts in crowding]))))
    moments = min(times, _MORE_MOMENTS)
    fewer, count = (_shapes_at(plan, carried, crowding, each, memory) for each in (moments // 2, moments))
    growth = min(math.log2(count / max(fewer, 1)), 1.0)
    expected = round(count * math.pow(times / moments, growth))
    if expected > _MOST_SHAPES:
        tool = carried.patch.tool
        raise BakeError(
            f"would need about {expected:,} morph targets for about {times:,} moments of {len(carried.vertices):,}"
            f" vertices that are projected in each, and {_MOST_SHAPES} may be, as many as engines play: use attachment:"
            f" skin{', profile: smooth' if tool.profile == 'polyline' else ''} or a smaller rest_length",
            where=tool.where,
        )
    return expected


def _shapes_at(
    plan: MeshPlan, carried: CarriedPatch, crowding: Sequence[tuple[Clip, Floats]], moments: int, memory: Memory
) -> int:
    """The number of shapes that so many moments of clips ask for, which crowd as `_crowding` says."""
    whole = sum(float(parts.mean()) for _, parts in crowding)
    chosen = []
    for clip, parts in crowding:
        reached = np.append(0.0, np.cumsum(parts)) / parts.sum()
        even = np.linspace(0.0, 1.0, math.ceil(moments * float(parts.mean()) / whole))
        shares = np.interp(even, reached, np.linspace(0.0, 1.0, len(reached)))
        chosen.append((clip, clip.start + shares * (clip.end - clip.start)))
    _, shapes = compress_displacements(plan, carried, chosen, memory)
    return len(shapes)


def _crowding(
    plan: MeshPlan, carried: CarriedPatch, clips: Sequence[Clip], frames: int, bound: float
) -> list[tuple[Clip, Floats]]:
    """Estimate in how many parts lines must divide the interval between two frames, at even places of some clips.

    The error of a line halves with the interval where vertices come onto the patch, or pass a corner of the curve.
    """
    step = max(sum(clip.end - clip.start for clip in clips) / frames, KEY_GAP)
    chosen = clips[:: -(-len(clips) // _LOOKED_INTO)]
    places = np.linspace(0.0, 1.0, -(-_LOOKED_INTO // len(chosen)) + 2)[1:-1]
    found = []
    for clip in chosen:
        starts = clip.start + places * max(clip.end - clip.start - step, 0.0)
        errors = [_line_error(plan, carried, clip, np.linspace(start, start + step, 5)) for start in starts]
        # Halves of an interval are no shorter than the gap between keys.
        most = max(step / (2.0 * KEY_GAP), 1.0)
        found.append((clip, np.clip(np.array(errors) / (SAMPLING_SHARE * bound), 1.0, most)))
    return found


def _line_error(plan: MeshPlan, carried: CarriedPatch, clip: Clip, times: Floats) -> float:
    """Greatest error inside a line between the first and the last of (frames,) even times, scene units."""
    moved = displacements(carried, plan.fine, plan.rig, clip, times)
    shares = np.linspace(0.0, 1.0, len(times))[:, None, None]
    off = moved - ((1.0 - shares) * moved[:1] + shares * moved[-1:])
    return PER_COORDINATE * plan.scale * float(np.abs(off).max(initial=0.0))


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
