"""Warnings of a bake and a check about wrinkling tools whose place or activity is probably a mistake."""

import math
from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.choices import MAX_COMPRESSIBLE
from wrinklecli.effects.effect import VISIBLE, MeshPlan
from wrinklecli.effects.wrinkle.activity import ClipActivity
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.lookup import fitting_compressible
from wrinklecli.effects.wrinkle.patch import LOW, Patch
from wrinklecli.errors import counted
from wrinklecli.numeric.arrays import Bools, Floats, Ints, children, renumbered
from wrinklecli.numeric.closest import ROUNDING, meets_box
from wrinklecli.numeric.intersections import zero_lines
from wrinklecli.numeric.rays import first_hits
from wrinklecli.surface.path import Curve
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import in_words

# Distance over the segment by which an anchor may be moved onto the mesh without a warning.
_FAR = 0.05
# Width over the segment above which units are likely wrong: a forehead is four times as wide as a brow is high.
_WIDE = 10.0
# Distance of a path from the mesh, over that of its two points, above which it runs beside the mesh.
_BESIDE = 0.15
# Length of the surface under a segment over the segment, above which there is a fold: that of an arc of 145°.
_DETOUR = 1.3
# Fraction of a segment without surface under it that needs no warning.
_GAP = 0.05
# Fraction of a patch over two layers that needs no warning.
_DOUBLED = 0.02
# Distance of two tools' ends, over the shorter segment, below which they are at one place.
_TWIN = 0.1
# Pairs of such tools that are listed: all pairs of 20 tools.
_MOST_TWINS = 190
# v of the lines along a patch on which layers are counted.
_LINES = np.linspace(-0.75, 0.75, 7)
# Points on each line.
_POINTS = 64
# Least distance of two layers of a surface, over the segment.
_APART = 0.01
# Distance over the mesh's size below which a surface touches a vertex at rest, and is not opposite.
_TOUCHING = 1e-6
# Pairs of a wrinkle's vertex and a triangle near by that are checked in all, which takes some seconds.
_MOST_PAIRS = 2**25


def tool_warnings(plan: MeshPlan, carried: CarriedPatch, clips: Sequence[ClipActivity], *, up: str) -> list[str]:
    """Warnings about the place of one tool, and about its activity in the clips baked; `up` is the tools file's."""
    return placement_warnings(plan, carried) + _clip_warnings(carried, clips) + _room_warnings(plan, carried, clips, up)


def _clip_warnings(carried: CarriedPatch, clips: Sequence[ClipActivity]) -> list[str]:
    """Warnings about the activity of one tool over all clips baked."""
    patch = carried.patch
    where = patch.tool.name
    warnings = []
    if patch.clip_strength(None) * patch.shape_strength not in (1.0, -1.0):
        warnings.append(f"{where}: strength {patch.tool.strength:g} does not keep the length of the surface")
    if carried.stuck:
        warnings.append(f"{where}: {carried.stuck} vertices stay put: singular at rest")
    if not clips:
        return warnings
    still = max(float((each.seen.shortenings / each.seen.rest_lengths).max()) for each in clips) < VISIBLE
    # A mirrored tool may be there for clips of other files.
    if still and not patch.tool.mirrored:
        warnings.append(f"{where}: never shortens in {', '.join(each.clip.name for each in clips)}: no wrinkle")
    worst = max(clips, key=lambda each: float((each.seen.unabsorbed / each.seen.rest_lengths).max()))
    share = worst.seen.unabsorbed / worst.seen.rest_lengths
    if share.max() > VISIBLE:
        frame = int(share.argmax())
        fitting = fitting_compressible(patch.curve, ((each.seen.distances, each.seen.rest_lengths) for each in clips))
        percent = math.ceil(100.0 * fitting)
        fits = percent <= MAX_COMPRESSIBLE
        remedy = f"compressible: {percent}% has them reach it there" if fits else "it is too low for so few"
        warnings.append(
            f"{where}: {100 * share[frame]:.2g} % of its length is not absorbed in {worst.clip.name} at"
            f" {worst.times[frame]:.3g} s: the bumps are at max_height before that; {remedy}"
        )
    return warnings


def placement_warnings(plan: MeshPlan, carried: CarriedPatch) -> list[str]:
    """Warnings about the place of one tool: anchors far off, and a patch that reaches across a fold."""
    patch = carried.patch
    name = patch.tool.name
    warnings = [
        f"{name}: its {patch.tool.point_name(number)} is {anchor.distance:.3g} from the mesh,"
        f" {100 * anchor.distance / patch.span:.0f} % of its segment"
        for number, anchor in enumerate(patch.anchors)
        if anchor.distance > _FAR * patch.span
    ]
    width = 2.0 * patch.half_width
    if width > _WIDE * patch.span:
        warnings.append(
            f"{name}: its width of {width:.3g} is {width / patch.span:,.0f} times its segment of {patch.span:.3g}:"
            " it is in the asset's units, as positions are, or in per cent of the segment, as in 120%"
        )
    if isinstance(patch.path, Curve):
        warnings += [f"{name}: {line}" for line in _path_warnings(patch, patch.path, plan.rest)]
    gap, detour, doubled = _surface_below(plan, patch)
    if gap > _GAP:
        warnings.append(
            f"{name}: {100 * gap:.0f} % of its segment has no surface below that faces it:"
            " it reaches across a fold or a gap"
        )
    elif detour > _DETOUR:
        warnings.append(
            f"{name}: the surface below its segment is {detour:.2f} times as long: it reaches across a fold"
        )
    if doubled > _DOUBLED:
        warnings.append(
            f"{name}: {100 * doubled:.0f} % of its patch lies over two layers of the surface, which wrinkle"
            " alike: it reaches across a fold"
        )
    return warnings


def _path_warnings(patch: Patch, path: Curve, rest: Rest) -> list[str]:
    """Warnings about the curve of a tool: bends that are sharp for its width, and places beside the mesh."""
    names, warnings = [patch.tool.point_name(number) for number in range(len(patch.anchors))], []
    radius, number = path.sharpest
    if patch.half_width > radius:
        warnings.append(
            f"its path bends with a radius of {radius:.3g} near {names[number]}, less than half its width of"
            f" {2.0 * patch.half_width:.3g}: on the inside wrinkles end before they would meet"
        )
    offs = np.array([np.linalg.norm(rest.foot(point)[0] - point) for point in path.between]).reshape(-1, 2).max(axis=1)
    for number, off in enumerate(offs.tolist()):
        apart = float(np.linalg.norm(patch.anchors[number + 1].position - patch.anchors[number].position))
        if off > _BESIDE * apart:
            warnings.append(
                f"its path is {off:.3g} beside the mesh between {names[number]} and {names[number + 1]}, which are"
                f" {apart:.3g} apart: a point there keeps it on the surface"
            )
    return warnings


def _surface_below(plan: MeshPlan, patch: Patch) -> tuple[float, float, float]:
    """Cut the surface under a patch at rest by planes along the patch.

    Returns:
        The part of the segment without a member under it; the length of the surface under the rest of the segment, over
        that of the segment; the part of the patch over two or more layers that wrinkle.
    """
    fine = plan.fine
    vertices, members = renumbered(fine.triangles[children(fine.subdivision.parents, patch.under)])
    positions = fine.rest_positions[vertices]
    places, normals = fine.posed_at(patch.pose, vertices)
    u, v = patch.coordinates(places)
    least = LOW * abs(patch.shape_strength)
    moves = np.abs(patch.magnitudes(u, v, normals)) > least
    points = (np.arange(_POINTS) + 0.5) / _POINTS
    ends = _cut(members, np.column_stack([u, positions]), v, 0.0)
    middle, length = ends[..., 0], np.sqrt(np.sum((ends[:, 1, 1:] - ends[:, 0, 1:]) ** 2, axis=1))
    covered = _layers(middle, points).any(axis=1)
    inside = np.clip(middle, 0.0, 1.0)
    runs, inner = np.abs(np.diff(middle, axis=1))[:, 0], np.abs(np.diff(inside, axis=1))[:, 0]
    parts = np.divide(inner, runs, out=((middle[:, 0] >= 0) & (middle[:, 0] <= 1)).astype(np.float64), where=runs > 0)
    straight = patch.path.length * float(inner.sum())
    wrinkling = members[moves[members].any(axis=1)]
    depths = patch.path.depths(positions)
    doubled = 0
    for line in _LINES:
        ends, heights = np.moveaxis(_cut(wrinkling, np.column_stack([u, depths]), v, float(line)), 2, 0)
        at, which = np.nonzero(_layers(ends, points))
        t = (points[at] - ends[which, 0]) / (ends[which, 1] - ends[which, 0])
        depth = heights[which, 0] + t * (heights[which, 1] - heights[which, 0])
        low, high = np.full(_POINTS, np.inf), np.full(_POINTS, -np.inf)
        np.minimum.at(low, at, depth)
        np.maximum.at(high, at, depth)
        doubled += int((high > low + _APART * patch.span).sum())
    detour = float((parts * length).sum()) / straight if straight > 0 else 1.0
    return 1.0 - float(covered.mean()), detour, doubled / (len(_LINES) * _POINTS)


def _cut(triangles: Ints, values: Floats, v: Floats, line: float) -> Floats:
    """(cuts, 2, columns) of (vertices, columns) values at both ends of each triangle's cut with the plane v = line."""
    found, shares = zero_lines(v - line, triangles)
    ends = np.einsum("ec,ecx->ex", shares, values[triangles[found]])
    return np.asarray(ends.reshape(-1, 2, values.shape[1]))


def _layers(ends: Floats, points: Floats) -> Bools:
    """(points, cuts) True if a cut lies over a u."""
    low, high = ends.min(axis=1), ends.max(axis=1)
    return np.asarray((low <= points[:, None]) & (points[:, None] < high))


def _room_warnings(plan: MeshPlan, carried: CarriedPatch, clips: Sequence[ClipActivity], up: str) -> list[str]:
    """A warning about wrinkles at rest that go through the opposite surface, along the normals.

    Any triangle of the same mesh may be opposite, except those of the vertex itself and those that touch it there.
    Without clips, the tallest wrinkles possible count.
    """
    fine = plan.fine
    count, beyond, worst = 0, 0.0, ""
    for way, peaks in zip((1.0, -1.0), _peaks(carried, clips), strict=True):
        tall = np.flatnonzero(peaks > LOW * peaks.max(initial=0.0))
        if not len(tall):
            continue
        vertices, heights = carried.vertices[tall], peaks[tall]
        rooms = _rooms(fine, vertices, heights, way)
        short = np.flatnonzero(rooms < heights)
        if len(short):
            count += len(short)
            most = short[np.argmax(heights[short] - rooms[short])]
            if heights[most] - rooms[most] > beyond:
                beyond = heights[most] - rooms[most]
                at = in_words(fine.rest_positions[vertices[most]].tolist(), up)
                worst = f"{heights[most]:.3g} where there is room for {rooms[most]:.3g} at rest, near {at};"
    return [
        f"{carried.patch.tool.name}: wrinkles are taller than the distance to the opposite surface: {worst}"
        f" {counted(count, 'vertex', 'vertices')} reach it"
    ][:count]


def _rooms(fine: Refinement, vertices: Ints, heights: Floats, way: float) -> Floats:
    """Distances from wrinkling vertices at rest to the opposite surface.

    Args:
        fine: The refined surface.
        vertices: (vertices,) vertices to check.
        heights: (vertices,) greatest distances to check, scene units.
        way: 1 outwards along the normals, -1 inwards.

    Returns:
        (vertices,) the room of each; infinite if nothing is within its height, and for some if there are very many.
    """
    size = fine.rest_size
    starts, rays = fine.rest_positions[vertices], way * fine.rest_normals_at(vertices)
    ends = np.concatenate([starts, starts + heights[:, None] * rays])
    low, high = ends.min(axis=0) - ROUNDING * size, ends.max(axis=0) + ROUNDING * size
    triangles = fine.triangles[meets_box(fine.rest_positions, low, high, fine.triangles)]

    def apart(facets: Ints, at: Ints) -> Bools:
        return np.asarray((triangles[facets] != vertices[at, None]).all(axis=1))

    corners = fine.rest_positions[triangles]
    return first_hits(starts, rays, heights, corners, least=_TOUCHING * size, apart=apart, most=_MOST_PAIRS)


def _peaks(carried: CarriedPatch, clips: Sequence[ClipActivity]) -> tuple[Floats, Floats]:
    """(vertices,) greatest moves of each vertex of a tool outwards, and inwards, scene units."""
    patch, curve = carried.patch, carried.patch.curve
    shapes = carried.shapes
    moved = [np.zeros(len(carried.us))]
    if not clips:
        moved.append(np.einsum("gm,gmv->v", curve.greatest_amplitudes, shapes) * carried.magnitudes)
    for each in clips:
        amplitudes = each.seen.amplitudes
        tallest = curve.heights(amplitudes).argmax(axis=0)
        rows = np.stack([amplitudes[tallest[bumps[0]], k] for k, bumps in enumerate(curve.groups)])
        moved.append(patch.clip_strength(each.clip) * np.einsum("gm,gmv->v", rows, shapes) * carried.magnitudes)
    return np.max(moved, axis=0), -np.min(moved, axis=0)


def twin_warnings(carried_patches: Sequence[CarriedPatch], clips: Sequence[Clip], *, where: str) -> list[str]:
    """Warnings about pairs of tools at one place whose heights add up, unless they never act in the same clip.

    If there are very many pairs, some are listed, and a last line that begins with `where` says so.
    """
    patches = [carried.patch for carried in carried_patches]
    names = [clip.name for clip in clips]
    acting = [[each.tool.strength_in(name) for name in names] or [each.tool.strength] for each in patches]
    found = _twins(patches, np.array(acting) != 0)
    warnings = [
        f"{patches[one].tool.name} and {patches[other].tool.name}: lie nearly on top of each other, and their heights"
        " add up"
        for one, other in found[:_MOST_TWINS]
    ]
    if len(found) > _MOST_TWINS:
        warnings.append(f"{where}: more than {_MOST_TWINS} pairs of tools lie nearly on top of each other")
    return warnings


def _twins(patches: Sequence[Patch], acting: Bools) -> list[tuple[int, int]]:
    """Sorted pairs of tools whose ends and middles are at one place, in either direction of the two paths.

    (tools, clips) `acting` is True for the clips in which a tool acts; tools of a pair act in the same clip. Of very
    many pairs only some are found, more than `_MOST_TWINS`: all pairs of n tools at one place would be n² / 2.
    """
    spans = np.array([patch.span for patch in patches])
    ends = np.array([[patch.origin.position, patch.target.position] for patch in patches])
    halfway = np.array([patch.path.middle for patch in patches])
    # Middles of twins are no further apart than their ends, so few of many tools side by side are compared.
    middles = ends.mean(axis=1)
    along = middles[:, np.argmax(np.ptp(middles, axis=0))]
    order = np.argsort(along, kind="stable")
    reach = (1.0 + 1e-9) * _TWIN * spans[order] + 1e-9 * np.abs(along).max()
    last = np.searchsorted(along[order], along[order] + reach, "right")
    found = []
    for number, one in enumerate(order.tolist()):
        others = order[number + 1 : last[number]]
        ways = [np.linalg.norm(ends[one] - ends[others][:, way], axis=2).mean(axis=1) for way in ([0, 1], [1, 0])]
        ways.append(np.linalg.norm(halfway[one] - halfway[others], axis=1))
        near = np.maximum(np.minimum(*ways[:2]), ways[2]) < _TWIN * np.minimum(spans[one], spans[others])
        near[near] = (acting[one] & acting[others[near]]).any(axis=1)
        found += [(min(one, other), max(one, other)) for other in others[near].tolist()]
        if len(found) > _MOST_TWINS:
            break
    return sorted(found)
