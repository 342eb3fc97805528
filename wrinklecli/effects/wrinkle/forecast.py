"""Estimates of what a tool with `attachment: patch` will ask for, from a few moments of its clips."""

import math
from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import KEY_GAP, Clip
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.sampling import SAMPLING_SHARE
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.projected import PER_COORDINATE, compress_displacements
from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.reduction import refuse_large_series

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
