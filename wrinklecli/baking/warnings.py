"""The warnings of a bake: tools that lie or act otherwise than their author means, and meshes too coarse for them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from wrinklecli.baking.job import Mode
from wrinklecli.baking.plan import MeshPlan
from wrinklecli.character.clip import Clip
from wrinklecli.method.activity import Activity
from wrinklecli.method.carry import CarriedPatch
from wrinklecli.method.patch import Patch
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.nearest import ray_distances
from wrinklecli.tools.records import ToolsFile

# A shortening below this part of the rest length is as good as none.
_VISIBLE = 1e-3
# An anchor that snaps by more than this part of its segment lies elsewhere than where it was put.
_FAR = 0.05
# The surface under a segment over the segment: a circle's arc of 145° is as long.
_DETOUR = 1.3
# Parts of a segment without surface under it, and of a patch with two layers, that are as good as none.
_GAP = 0.05
_DOUBLED = 0.02
# Layers of a surface are apart by more than this, over the segment.
_APART = 0.01
# Lines along a patch, v, on which layers are counted, and points on each.
_LINES = np.linspace(-0.75, 0.75, 7)
_POINTS = 64
# Ends of two tools nearer than this, over the shorter segment, are at one place.
_TWIN = 0.1
# Wrinkles lower than this part of the tallest are not looked at, nor are surfaces nearer than this part of the mesh.
_LOW = 0.05
_TOUCHING = 1e-6
# Pairs of a wrinkle's vertex and a triangle: looked at together, and in all, which takes some seconds.
_CHUNK = 2**18
_MOST_PAIRS = 2**23


def mesh_warnings(plan: MeshPlan, settings: ToolsFile, clips: Sequence[Clip], mode: Mode) -> list[str]:
    """What a user should know of a mesh with all its tools, over the clips baked."""
    rig = plan.rig
    where = rig.names[rig.node]
    warnings = twin_warnings(plan, clips)
    if plan.fine.subdivision.limited:
        warnings.append(
            f"{where}: {plan.fine.subdivision.limited} edges are still too long for the wrinkles at max_levels"
            f" {settings.refinement.max_levels}"
        )
    return warnings + [
        f"{where}: {clip.name} gets a weights channel, which will hold the morph targets that were free there;"
        " --tracks none avoids it"
        for clip in clips
        if rig.morph_names and clip.channel(rig.node, "weights") is None and mode == "morph"
    ]


def tool_warnings(plan: MeshPlan, carried: CarriedPatch, clips: Sequence[tuple[Clip, Floats, Activity]]) -> list[str]:
    """What a user should know of one tool: of its place, and of what it does.

    Args:
        plan: Of its mesh.
        carried: The tool.
        clips: For each clip baked its (frames,) times and what the tool does then.
    """
    return placement_warnings(plan, carried) + _clip_warnings(carried, clips)


def _clip_warnings(carried: CarriedPatch, clips: Sequence[tuple[Clip, Floats, Activity]]) -> list[str]:
    """What a user should know of how one tool acts, over all clips baked."""
    patch = carried.patch
    where = patch.tool.name
    warnings = []
    if patch.clip_strength(None) * patch.shape_strength not in (1.0, -1.0):
        warnings.append(f"{where}: strength {patch.tool.strength:g} does not keep the length of the surface")
    if carried.stuck:
        warnings.append(f"{where}: {carried.stuck} vertices stay put: singular at rest")
    if not clips:
        return warnings
    if max(float((seen.shortenings / seen.rest_lengths).max()) for _, _, seen in clips) < _VISIBLE:
        warnings.append(f"{where}: never shortens in {', '.join(clip.name for clip, _, _ in clips)}: no wrinkle")
    clip, times, seen = max(clips, key=lambda each: float((each[2].unabsorbed / each[2].rest_lengths).max()))
    share = seen.unabsorbed / seen.rest_lengths
    if share.max() > _VISIBLE:
        frame = int(share.argmax())
        warnings.append(
            f"{where}: {100 * share[frame]:.0f} % of its length is not absorbed in {clip.name} at"
            f" {times[frame]:.3g} s: the bumps reach max_height"
        )
    return warnings


def placement_warnings(plan: MeshPlan, carried: CarriedPatch) -> list[str]:
    """What is wrong with the place of one tool: anchors far off, and a patch that reaches across a fold."""
    patch = carried.patch
    name = patch.tool.name
    warnings = [
        f"{name}: its {key} is {anchor.distance:.3g} from the mesh, {100 * anchor.distance / patch.span:.0f} % of its"
        " segment"
        for key, anchor in (("origin", patch.origin), ("target", patch.target))
        if anchor.distance > _FAR * patch.span
    ]
    ground = ground_under(plan, patch)
    if ground.gap > _GAP:
        warnings.append(
            f"{name}: {100 * ground.gap:.0f} % of its segment has no surface below that faces it:"
            " it reaches across a fold or a gap"
        )
    elif ground.detour > _DETOUR:
        warnings.append(
            f"{name}: the surface below its segment is {ground.detour:.2f} times as long: it reaches across a fold"
        )
    if ground.doubled > _DOUBLED:
        warnings.append(
            f"{name}: {100 * ground.doubled:.0f} % of its patch lies over two layers of the surface, which wrinkle"
            " alike: it reaches across a fold"
        )
    return warnings


@dataclass(frozen=True, slots=True)
class Ground:
    """The surface under a patch, at rest.

    Attributes:
        gap: Share of the segment without a member under it.
        detour: Length of the surface under the rest of it, over the segment's.
        doubled: Share of the patch over two or more layers that wrinkle.
    """

    gap: float
    detour: float
    doubled: float


def ground_under(plan: MeshPlan, patch: Patch) -> Ground:
    """Cut the members of a patch by planes along it."""
    fine = plan.fine
    vertices, local = np.unique(fine.triangles[patch.members[fine.subdivision.parents]], return_inverse=True)
    members, positions = local.reshape(-1, 3), fine.rest_positions[vertices]
    u, v = patch.coordinates(positions)
    least = _LOW * abs(patch.shape_strength)
    moves = np.abs(patch.magnitudes(u, v, fine.rest_normals_at(vertices))) > least
    points = (np.arange(_POINTS) + 0.5) / _POINTS
    ends = _cut(members, np.column_stack([u, positions]), v, 0.0)
    middle, length = ends[..., 0], np.sqrt(np.sum((ends[:, 1, 1:] - ends[:, 0, 1:]) ** 2, axis=1))
    covered = _layers(middle, points).any(axis=1)
    inside = np.clip(middle, 0.0, 1.0)
    run, rise = np.abs(np.diff(middle, axis=1))[:, 0], np.abs(np.diff(inside, axis=1))[:, 0]
    share = np.divide(rise, run, out=((middle[:, 0] >= 0) & (middle[:, 0] <= 1)).astype(np.float64), where=run > 0)
    straight = patch.span * float(rise.sum())
    wrinkling = members[moves[members].any(axis=1)]
    depths = (positions - patch.origin.position) @ patch.normal
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
    return Ground(
        gap=1.0 - float(covered.mean()),
        detour=float((share * length).sum()) / straight if straight > 0 else 1.0,
        doubled=doubled / (len(_LINES) * _POINTS),
    )


def _cut(triangles: Ints, values: Floats, v: Floats, line: float) -> Floats:
    """(cuts, 2, columns) of (vertices, columns) values at both ends of each triangle's cut with the plane v = line."""
    above = v[triangles] >= line
    count = above.sum(axis=1)
    cut = (count == 1) | (count == 2)
    # One corner is alone on its side; the cut runs between the edges to the two others.
    alone = np.argmax(above[cut] == (count[cut] == 1)[:, None], axis=1)
    corners = np.take_along_axis(triangles[cut], (alone[:, None] + np.arange(3)) % 3, axis=1)
    first, others = corners[:, :1], corners[:, 1:]
    t = (line - v[first]) / (v[others] - v[first])
    found: Floats = values[first] + t[..., None] * (values[others] - values[first])
    return found


def _layers(ends: Floats, points: Floats) -> NDArray[np.bool_]:
    """(points, cuts) which cuts lie over each u."""
    low, high = ends.min(axis=1), ends.max(axis=1)
    layers: NDArray[np.bool_] = (low <= points[:, None]) & (points[:, None] < high)
    return layers


def twin_warnings(plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
    """Pairs of tools that make their wrinkles at one place, where their heights add up.

    Not those that never act in the same of (all) clips.
    """

    def together(first: Patch, second: Patch) -> bool:
        names = [clip.name for clip in clips]
        strengths = [(first.tool.strength_in(name), second.tool.strength_in(name)) for name in names]
        return any(a and b for a, b in strengths or [(first.tool.strength, second.tool.strength)])

    patches = [carried.patch for carried in plan.carried_patches]
    spans = np.array([patch.span for patch in patches])
    ends = np.array([[patch.origin.position, patch.target.position] for patch in patches])
    # Whichever way round the two segments are.
    ways = [np.linalg.norm(ends[:, None] - ends[None, :, order], axis=3).mean(axis=2) for order in ([0, 1], [1, 0])]
    near = np.minimum(*ways) < _TWIN * np.minimum(spans[:, None], spans)
    return [
        f"{patches[one].tool.name} and {patches[other].tool.name}: lie nearly on top of each other, and their heights"
        " add up"
        for one, other in np.argwhere(np.triu(near, 1))
        if together(patches[one], patches[other])
    ]


@dataclass(frozen=True, slots=True)
class Collision:
    """Wrinkles that are taller than the room that they have at rest.

    Attributes:
        count: How many vertices reach another part of the surface.
        height: Of the one that goes furthest beyond it, scene units.
        room: That it has.
        position: (3,) of it, world space at rest.
    """

    count: int
    height: float
    room: float
    position: Floats


def collision(plan: MeshPlan, carried: CarriedPatch, seen: Sequence[tuple[Clip, Floats, Activity]]) -> Collision | None:
    """Compare a tool's wrinkles at rest with the distance to what lies opposite, along the normals.

    Opposite lies any triangle of the same mesh, but for those of the vertex itself and what touches it there.

    Args:
        plan: Of the mesh.
        carried: The tool.
        seen: What clips make of it; where there is none, the tallest wrinkles possible count.
    """
    from scipy.spatial import cKDTree

    fine = plan.fine
    corners = fine.rest_positions[fine.triangles]
    middles = corners.mean(axis=1)
    radii = np.sqrt(((corners - middles[:, None]) ** 2).sum(axis=2).max(axis=1))
    size = float(np.linalg.norm(np.ptp(fine.rest_positions, axis=0)))
    count, worst = 0, None
    for way, peaks in zip((1.0, -1.0), _peaks(carried, seen), strict=True):
        tall = np.flatnonzero(peaks > _LOW * peaks.max(initial=0.0))
        if not len(tall):
            continue
        vertices, heights = carried.vertices[tall], peaks[tall]
        starts, rays = fine.rest_positions[vertices], way * fine.rest_normals[vertices]
        reach = radii + 0.5 * float(heights.max())
        tree = cKDTree(starts + 0.5 * heights[:, None] * rays)
        near = tree.query_ball_point(middles, reach, return_length=True)
        if near.sum() > _MOST_PAIRS:
            # Only every so many of them, the tallest first: where a wrinkle goes through, so do its neighbours.
            kept = np.argsort(-heights, kind="stable")[:: -(-int(near.sum()) // _MOST_PAIRS)]
            vertices, starts, rays, heights = vertices[kept], starts[kept], rays[kept], heights[kept]
            tree = cKDTree(starts + 0.5 * heights[:, None] * rays)
            near = tree.query_ball_point(middles, reach, return_length=True)
        rooms = np.full(len(vertices), np.inf)
        candidates = np.flatnonzero(near)
        for part in np.split(candidates, np.flatnonzero(np.diff(np.cumsum(near[candidates]) // _CHUNK)) + 1):
            lists = tree.query_ball_point(middles[part], reach[part])
            triangles = np.repeat(part, [len(each) for each in lists])
            at = np.fromiter(chain.from_iterable(lists), np.intp, len(triangles))
            others = (fine.triangles[triangles] != vertices[at, None]).all(axis=1)
            triangles, at = triangles[others], at[others]
            distances = ray_distances(starts[at], rays[at], corners[triangles])
            np.minimum.at(rooms, at, np.where(distances > _TOUCHING * size, distances, np.inf))
        short = np.flatnonzero(rooms < heights)
        if len(short):
            count += len(short)
            most = short[np.argmax(heights[short] - rooms[short])]
            if worst is None or heights[most] - rooms[most] > worst[0] - worst[1]:
                worst = float(heights[most]), float(rooms[most]), starts[most]
    return None if worst is None else Collision(count, *worst)


def _peaks(carried: CarriedPatch, seen: Sequence[tuple[Clip, Floats, Activity]]) -> tuple[Floats, Floats]:
    """(vertices,) how far each vertex of a tool is moved outwards, and inwards, at the most, scene units."""
    patch, curve = carried.patch, carried.patch.curve
    shapes = curve.shapes(carried.us)
    moved = [np.zeros(len(carried.us))]
    if not seen:
        moved.append(np.einsum("gm,gmv->v", curve.greatest_amplitudes, shapes) * carried.magnitudes)
    for clip, _, each in seen:
        tallest = curve.heights(each.amplitudes).argmax(axis=0)
        rows = np.stack([each.amplitudes[tallest[bumps[0]], k] for k, bumps in enumerate(curve.groups)])
        moved.append(patch.clip_strength(clip) * np.einsum("gm,gmv->v", rows, shapes) * carried.magnitudes)
    return np.max(moved, axis=0), -np.min(moved, axis=0)
