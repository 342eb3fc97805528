"""Tools attached to a surface at rest: anchors, patch coordinates and member triangles.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, Computer Graphics International 2004, on the
influence region. Differs: anchors lie anywhere on the surface, not only on vertices; members face the patch
and are connected to an anchor, where the paper takes every vertex that projects onto the patch (the back of a
thin limb with them); displacement fades where the surface turns away; and (u, v) are those at rest.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import (
    LEAST_SCALE,
    blend,
    joint_matrices,
    morph_weights,
    node_matrices,
    node_rows,
    transform,
)
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.errors import BakeError, ConfigError, WrinkleError, listed, nearest
from wrinklecli.method.curve import ControlCurve, plan_curve
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    determinants,
    distinct_values,
    face_normals,
    inverses,
    normals_at,
    singular,
    unit,
    vertex_normals,
)
from wrinklecli.numeric.nearest import closest_point, meets_box
from wrinklecli.tools.records import Marker, RestLengthKeys, RestLengthMorph, ToolsFile, WrinkleTool

# An anchor further from the mesh than this part of its segment was meant for somewhere else.
_ANCHOR_REACH = 0.25
# Facing factor: displacement fades in between these cosines of vertex and patch normal.
_FACING = (0.2, 0.6)


@dataclass(frozen=True)
class Rest:
    """A surface in its rest pose.

    Attributes:
        matrices: (joints, 4, 4) bind to world space.
        morph_weights: (morph targets,).
        bind_positions: (vertices, 3) stored positions plus weighted morph deltas, bind space.
        blended: (vertices, 3, 4) bind to world space.
        positions: (vertices, 3) world space.
        triangles: (triangles, 3) of the surface.
    """

    matrices: Floats
    morph_weights: Floats
    bind_positions: Floats
    blended: Floats
    positions: Floats
    triangles: Ints

    @cached_property
    def normals(self) -> Floats:
        """(vertices, 3) world space, as `normals_at` of every vertex."""
        return carried_normals(self.blended, vertex_normals(self.bind_positions, self.triangles))

    def normals_at(self, vertices: Ints) -> Floats:
        """(chosen, 3) area-weighted bind normals of some vertices, carried to world space by the inverse transpose."""
        return carried_normals(self.blended[vertices], normals_at(self.bind_positions, self.triangles, vertices))


@dataclass(frozen=True, slots=True)
class Anchor:
    """A point that the skin carries, as weighted points of joints, which carry them as rigid.

    Its world position is the sum over k of world(joints[k]) @ (points[0] + sum over m of w_m points[m])[k].

    Attributes:
        joints: (influences,) into the rig's joints.
        weights: (influences,) of its joints, summing to 1.
        points: (1 + morph targets, influences, 4) homogeneous points times their weights, in the joints' own
            spaces; the fourth number is the weight itself, 0 in morph deltas.
        vertices: (corners,) the welded vertices around it: three, two on an edge, one at a vertex.
        barycentrics: (corners,) their shares, summing to 1.
        triangles: The coarse triangles that the anchor lies on.
        position: (3,) at rest, world space.
        normal: (3,) of the surface there.
        distance: From the point asked for, scene units.
    """

    joints: Ints
    weights: Floats
    points: Floats
    vertices: Ints
    barycentrics: Floats
    triangles: Ints
    position: Floats
    normal: Floats
    distance: float


@dataclass(frozen=True, slots=True)
class Patch:
    """A tool attached to a surface at rest.

    Attributes:
        tool: Its definition.
        curve: Its control curve.
        origin: Anchor at u = 0.
        target: Anchor at u = 1.
        span: Distance of the anchors at rest, scene units.
        rest_length: Nominal length of the control curve, scene units.
        half_width: |v| = 1 at this distance from the segment, scene units.
        along: (3,) unit vector from origin to target, world space at rest.
        normal: (3,) unit normal of the patch.
        members: (triangles,) which coarse triangles belong to it.
    """

    tool: WrinkleTool
    curve: ControlCurve
    origin: Anchor
    target: Anchor
    span: float
    rest_length: float
    half_width: float
    along: Floats
    normal: Floats
    members: Bools

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) u along the segment and v across it, of (…, 3) world positions at rest."""
        relative = positions - self.origin.position
        across = np.cross(self.along, self.normal)
        return relative @ self.along / self.span, relative @ across / self.half_width

    def magnitudes(self, u: Floats, v: Floats, normals: Floats) -> Floats:
        """(…,) factor on the curve's height: strength, attenuation, facing; 0 outside the patch."""
        return self.factors(u, v, normals @ self.normal)

    def factors(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) as `magnitudes`, from the cosines of (…,) vertex normals and the patch's."""
        spread = np.minimum(np.abs(v), 1.0)
        if self.tool.attenuation == "linear":
            attenuation = 1.0 - spread
        else:
            squared = spread**2
            attenuation = 1.0 + squared * (-22.0 + squared * (17.0 - 4.0 * squared)) / 9.0
        low, high = _FACING
        t = np.clip((cosines - low) / (high - low), 0.0, 1.0)
        inside = (u >= 0.0) & (u <= 1.0) & (np.abs(v) <= 1.0)
        return np.where(inside, self.shape_strength * attenuation * t * t * (3.0 - 2.0 * t), 0.0)

    @property
    def shape_strength(self) -> float:
        """The strength built into the shapes: the tool's own, or that of its strongest clip where it is 0."""
        return self.tool.strength or max(self.tool.clips.values(), key=abs, default=0.0)

    @property
    def keyed_clips(self) -> frozenset[str]:
        """Names of the clips that key the rest length."""
        wanted = self.tool.rest_length
        return frozenset(wanted.keys if isinstance(wanted, RestLengthKeys) else ())

    def clip_strength(self, clip: Clip | None) -> float:
        """Factor on the shapes in a clip."""
        wanted = self.tool.strength if clip is None else self.tool.clips.get(clip.name, self.tool.strength)
        return wanted / self.shape_strength if self.shape_strength else 0.0


def rest_pose(
    surface: Surface, rig: Rig, settings: ToolsFile, clips: tuple[Clip, ...], tools: list[WrinkleTool]
) -> Rest:
    """Pose a surface at rest, as the tools file says.

    Raises:
        ConfigError: The clip that `rest` names is not in the asset.
    """
    clip, time = None, np.zeros(1)
    if not isinstance(settings.rest, str):
        clip = next((each for each in clips if each.name == settings.rest.clip), None)
        if clip is None:
            raise ConfigError(
                f"{settings.rest.clip!r} is not a clip of the asset; it has {listed(c.name for c in clips)}",
                where=f"{settings.path}: rest.clip",
            )
        time = np.array([settings.rest.time])
    weights = morph_weights(rig, clip, time)[0]
    matrices = joint_matrices(rig, clip, time)[0]
    if settings.rest == "bind":
        matrices = _bind_matrices(surface, rig, matrices, weights, tools)
    bind = surface.positions + np.tensordot(weights, surface.morph_deltas, axes=1)
    every = np.arange(len(bind))
    blended = blend(surface.dense_weights(every, len(rig.joints)), matrices[None])[0]
    return Rest(matrices, weights, bind, blended, transform(blended[None], bind)[0], surface.triangles)


def _bind_matrices(surface: Surface, rig: Rig, stored: Floats, weights: Floats, tools: list[WrinkleTool]) -> Floats:
    """(joints, 4, 4) the stored matrix of the first anchor's main joint, for every joint."""
    bind = surface.positions + np.tensordot(weights, surface.morph_deltas, axes=1)
    point = tools[0].origin
    main = 0
    # The anchor's joint depends on where the mesh lies, which depends on the joint: once more settles it.
    for _ in range(2):
        posed = bind @ stored[main, :3, :3].T + stored[main, :3, 3]
        place = _marker_position(rig, None, np.zeros(1), point, tools[0]) if isinstance(point, Marker) else point
        vertex = int(np.argmin(np.sum((posed - np.asarray(place)) ** 2, axis=1)))
        main = int(surface.joints[vertex, np.argmax(surface.weights[vertex])])
    return np.tile(stored[main], (len(stored), 1, 1))


def carried_normals(blended: Floats, normals: Floats) -> Floats:
    """(vertices, 3) unit normals moved by the inverse transpose of (vertices, 3, 4) matrices.

    Right for mirrored and scaled matrices too; 0 where the matrix is singular.
    """
    return unit(np.einsum("vji,vj->vi", inverses(blended), normals))


def attach_tools(
    tools: list[WrinkleTool],
    surface: Surface,
    rest: Rest,
    rig: Rig,
    settings: ToolsFile,
    clips: tuple[Clip, ...],
) -> list[Patch]:
    """Attach every tool of a mesh.

    Raises:
        WrinkleError: Of all tools that do not fit, a line each.
    """
    patches, problems = [], []
    for tool in tools:
        try:
            patches.append(_attach(tool, surface, rest, rig, settings, clips))
        except WrinkleError as error:
            problems.append(error)
    if problems:
        raise BakeError.of_all(problems)
    return patches


def _attach(
    tool: WrinkleTool, surface: Surface, rest: Rest, rig: Rig, settings: ToolsFile, clips: tuple[Clip, ...]
) -> Patch:
    if isinstance(tool.rest_length, RestLengthMorph) and tool.rest_length.morph not in rig.morph_names:
        raise BakeError(
            f"{tool.rest_length.morph!r} is not a morph target of the mesh; it has {listed(rig.morph_names)}",
            where=f"{tool.where}.rest_length.morph",
        )
    ends = []
    for key, point in (("origin", tool.origin), ("target", tool.target)):
        if isinstance(point, Marker):
            clip, time = None, 0.0
            if not isinstance(settings.rest, str):
                clip = next(each for each in clips if each.name == settings.rest.clip)
                time = settings.rest.time
            ends.append((key, _marker_position(rig, clip, np.array([time]), point, tool)))
        else:
            ends.append((key, np.array(point)))
    asked = float(np.linalg.norm(ends[1][1] - ends[0][1]))
    anchors = [_anchor(tool, key, point, asked, surface, rest, rig, settings) for key, point in ends]
    origin, target = anchors
    difference = target.position - origin.position
    span = float(np.linalg.norm(difference))
    if span <= 1e-9 * surface.size or not asked:
        raise BakeError("origin and target are one point of the mesh", where=tool.where)
    along = difference / span
    mean = origin.normal + target.normal
    mean = mean - (mean @ along) * along
    if np.linalg.norm(mean) < 1e-3:
        raise BakeError("the surface faces opposite ways at origin and target", where=tool.where)
    rest_length, greatest = _rest_lengths(tool, span)
    plan = plan_curve(
        bumps=tool.bumps,
        gap=tool.gap,
        strategy=tool.strategy,
        details=tool.details,
        profile=tool.profile,
        max_height=_max_height(tool, span, rest_length),
        rest_length=rest_length,
        greatest_rest_length=greatest,
    )
    patch = Patch(
        tool=tool,
        curve=plan,
        origin=origin,
        target=target,
        span=span,
        rest_length=rest_length,
        half_width=tool.width.resolve(span) / 2.0,
        along=along,
        normal=unit(mean),
        members=np.zeros(len(surface.triangles), bool),
    )
    return _with_members(patch, surface, rest)


def _marker_position(rig: Rig, clip: Clip | None, time: Floats, marker: Marker, tool: WrinkleTool) -> Floats:
    found = [index for index, name in enumerate(rig.names) if name == marker.marker]
    if len(found) != 1:
        state = "is not a node of the asset" if not found else f"is the name of {len(found)} nodes"
        raise BakeError(f"marker {marker.marker!r} {state}{nearest(marker.marker, rig.names)}", where=tool.where)
    place: Floats = node_matrices(rig, clip, time, found)[0, 0, :3, 3]
    return place


def _anchor(
    tool: WrinkleTool,
    key: str,
    point: Floats,
    segment: float,
    surface: Surface,
    rest: Rest,
    rig: Rig,
    settings: ToolsFile,
) -> Anchor:
    """The point of the surface that is nearest to one asked for."""
    triangle, barycentrics, place = closest_point(rest.positions, surface.triangles, point)
    if tool.snap == "vertex":
        used = distinct_values(surface.triangles)
        vertex = int(used[np.argmin(np.sum((rest.positions[used] - point) ** 2, axis=1))])
        vertices, barycentrics, place = np.array([vertex]), np.ones(1), rest.positions[vertex]
    else:
        vertices = surface.triangles[triangle][barycentrics > 0]
        barycentrics = barycentrics[barycentrics > 0]
    distance = float(np.linalg.norm(place - point))
    if distance > _ANCHOR_REACH * segment:
        hint = ""
        x, y, z = point
        other, turned = ("y", (x, -z, y)) if settings.up == "z" else ("z", (x, z, -y))
        found = closest_point(rest.positions, surface.triangles, np.array(turned))[2]
        near = np.linalg.norm(found - np.array(turned)) <= _ANCHOR_REACH * segment
        if near and not isinstance(getattr(tool, key), Marker):
            hint = f"; with `up: {other}` it would lie on it"
        at = ", ".join(f"{x:.4g}" for x in (place if settings.up == "y" else (place[0], -place[2], place[1])))
        raise BakeError(
            f"is {distance:.4g} from the mesh, more than a quarter of its segment of {segment:.4g};"
            f" the nearest point is [{at}]{hint}",
            where=f"{tool.where}.{key}",
        )
    if singular(rest.blended[vertices]).any():
        raise BakeError("the joints here are singular at rest", where=f"{tool.where}.{key}")
    around = np.zeros(len(rest.positions), np.int8)
    around[vertices] = 1
    a, b, c = around[surface.triangles].T
    on_all = a + b + c >= around.sum()
    joints, inverse = np.unique(surface.joints[vertices], return_inverse=True)
    shares = barycentrics[:, None] * surface.weights[vertices]
    points = np.zeros((1 + len(surface.morph_deltas), len(joints), 4))
    each = np.broadcast_to(np.arange(len(vertices))[:, None], shares.shape)
    for m in range(len(points)):
        bind = surface.positions[vertices] if m == 0 else surface.morph_deltas[m - 1, vertices]
        homogeneous = np.concatenate([bind, np.full((len(vertices), 1), float(m == 0))], axis=1)
        np.add.at(points[m], inverse.reshape(shares.shape), shares[..., None] * homogeneous[each])
    weights = points[0, :, 3]
    keep = weights > 0
    normal = unit(barycentrics @ rest.normals_at(vertices))
    return Anchor(
        joints=joints[keep],
        weights=weights[keep],
        points=np.einsum("kab,mkb->mka", rig.inverse_binds[joints[keep]], points[:, keep]),
        vertices=vertices,
        barycentrics=barycentrics,
        triangles=np.flatnonzero(on_all),
        position=place,
        normal=normal,
        distance=distance,
    )


def _rest_lengths(tool: WrinkleTool, span: float) -> tuple[float, float]:
    """The curve's nominal length and the greatest that keys or a morph target give it, scene units."""
    wanted = tool.rest_length
    if wanted == "auto":
        return span, span
    if isinstance(wanted, RestLengthKeys):
        lengths = [length.resolve(span) for keys in wanted.keys.values() for _, length in keys]
        return span, max([span, *lengths])
    if isinstance(wanted, RestLengthMorph):
        return span, max(span, wanted.full.resolve(span))
    length = wanted.resolve(span)
    return length, length


def _max_height(tool: WrinkleTool, span: float, rest_length: float) -> float:
    if tool.max_height is None:
        return np.inf
    if tool.max_height == "auto":
        intervals = 2 * tool.bumps + tool.gap * (tool.bumps - 1)
        return 0.25 * 2.0 * rest_length / intervals
    return tool.max_height.resolve(span)


def _with_members(patch: Patch, surface: Surface, rest: Rest) -> Patch:
    """The patch with the coarse triangles that face it, meet it and hang together with an anchor."""
    u, v = patch.coordinates(rest.positions)
    meets = meets_box(np.stack([u, v], axis=1), np.array([0.0, -1.0]), np.array([1.0, 1.0]), surface.triangles)
    triangles = surface.triangles[meets]
    vertices, corners = np.unique(triangles, return_inverse=True)
    # Winding may be mirrored at rest; vertex normals are not.
    faces = face_normals(rest.positions, triangles)
    normals = rest.normals_at(vertices)[corners.reshape(-1, 3)]
    outward = np.sign(np.sum(faces * normals.sum(axis=1), axis=1))
    chosen = np.flatnonzero(meets)[outward * (faces @ patch.normal) > 0]
    seeds = np.concatenate([patch.origin.triangles, patch.target.triangles])
    facing, reached = np.zeros((2, len(surface.triangles)), bool)
    facing[chosen] = True
    reached[seeds] = facing[seeds]
    sides = np.sort(surface.triangles[chosen][:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    _, edge = np.unique(sides[:, 0] * len(rest.positions) + sides[:, 1], return_inverse=True)
    edge = edge.reshape(-1, 3)
    inside = reached[chosen]
    if inside.any():
        piece = _pieces(edge)
        reached[chosen[np.isin(piece, piece[inside])]] = True
    if not reached.any():
        raise BakeError("no triangle at its ends faces the patch", where=patch.tool.where)
    return replace(patch, members=reached)


def _pieces(triangle_edges: Ints) -> Ints:
    """(triangles,) the same number for triangles that hang together by edges, (triangles, 3)."""
    # In place of scipy's connected components, whose import takes longer than most bakes' flooding.
    pieces = np.arange(len(triangle_edges))
    least = np.zeros(int(triangle_edges.max(initial=0)) + 1, np.intp)
    while True:
        least[triangle_edges] = len(pieces)
        np.minimum.at(least, triangle_edges, pieces[:, None])
        lower = least[triangle_edges].min(axis=1, initial=len(pieces))
        # A triangle takes the number that the triangle of its number has got: rounds grow like a logarithm.
        lower = lower[lower]
        if np.array_equal(lower, pieces):
            return pieces
        pieces = lower


@dataclass(frozen=True, slots=True)
class AnchorPoses:
    """What moves the anchors of several tools, at a few times of a clip.

    Attributes:
        joints: (joints,) into the rig's, rising: those that move any of the anchors.
        rows: For each (3, 4, frames) of its world matrix; one frame where nothing moves it.
        scales: For each (frames,) the cube root of its determinant against rest; as many frames.
        weights: (frames, morph targets).
    """

    joints: Ints
    rows: Sequence[Floats]
    scales: Sequence[Floats]
    weights: Floats


def anchor_joints(patches: Sequence[Patch]) -> Ints:
    """(joints,) into the rig's, rising: those that move an anchor of any of the tools."""
    return distinct_values(np.concatenate([end.joints for each in patches for end in (each.origin, each.target)]))


def anchor_poses(joints: Ints, rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> AnchorPoses:
    """Pose (joints,) of a rig at (frames,) seconds; in the stored pose where there is no clip."""
    rows = node_rows(rig, clip, times, [int(rig.joints[joint]) for joint in joints])
    bound = np.abs(determinants(rig.inverse_binds[joints, :3, :3]))
    before = np.abs(determinants(rest.matrices[joints, :3, :3]))
    shares = bound / np.where(before > 0, before, 1.0)
    scales = [
        np.cbrt(share * np.abs(determinants(each[:, :3].transpose(2, 0, 1))))
        for each, share in zip(rows, shares, strict=True)
    ]
    return AnchorPoses(joints, rows, scales, morph_weights(rig, clip, times))


def lengths_over_time(
    patch: Patch, rig: Rig, rest: Rest, clip: Clip | None, times: Floats, poses: AnchorPoses | None = None
) -> tuple[Floats, Floats]:
    """What a clip does to a tool's segment.

    Args:
        patch: The attached tool.
        rig: Of its mesh.
        rest: The rest pose.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds.
        poses: At these times, where other tools need them too.

    Returns:
        (frames,) distance of the anchors with animated scale taken out, and (frames,) rest length, scene
        units. Where the anchors' scale is below 1e-6 the distance is infinite: the tool is inactive.
    """
    if poses is None:
        poses = anchor_poses(anchor_joints([patch]), rig, rest, clip, times)
    places = [_place(anchor, poses, len(times)) for anchor in (patch.origin, patch.target)]
    scales = [np.zeros(len(times)), np.zeros(len(times))]
    for scaled, anchor in zip(scales, (patch.origin, patch.target), strict=True):
        # Scale: cube roots of determinants against rest, by influence.
        for number, weight in zip(np.searchsorted(poses.joints, anchor.joints), anchor.weights, strict=True):
            scaled += weight * poses.scales[number]
    scale = (scales[0] + scales[1]) / 2.0
    hidden = scale < LEAST_SCALE
    apart = places[1] - places[0]
    distances = np.sqrt(np.einsum("xf,xf->f", apart, apart)) / np.where(hidden, 1.0, scale)
    return np.where(hidden, np.inf, distances), rest_lengths_over_time(patch, rig, clip, times)


def _place(anchor: Anchor, poses: AnchorPoses, count: int) -> Floats:
    """(3, frames) where `count` poses take an anchor, world space."""
    acting = np.flatnonzero(anchor.points[1:].any(axis=(1, 2)))
    weights, points = poses.weights[:, acting], anchor.points[np.append(0, 1 + acting)]
    place = np.zeros((3, count))
    # Of joints that nothing moves, together: a point and what each morph target adds.
    still = np.zeros((1 + len(acting), 3))
    for number, point in zip(np.searchsorted(poses.joints, anchor.joints), points.transpose(1, 0, 2), strict=True):
        rows = poses.rows[number]
        if rows.shape[2] == 1:
            still += np.einsum("mc,rc->mr", point, rows[:, :, 0])
            continue
        morphed = point[0, :, None]
        if len(acting):
            morphed = morphed + np.einsum("mc,fm->cf", point[1:], weights)
        for column in range(4):
            place += rows[:, column] * morphed[column]
    if len(acting):
        place += np.einsum("mr,fm->rf", still[1:], weights)
    place += still[0, :, None]
    return place


def rest_lengths_over_time(patch: Patch, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
    """(frames,) rest lengths of a tool at (frames,) seconds of a clip, scene units."""
    wanted = patch.tool.rest_length
    if isinstance(wanted, RestLengthKeys) and clip is not None and clip.name in wanted.keys:
        keys = wanted.keys[clip.name]
        return np.interp(times, [t for t, _ in keys], [each.resolve(patch.span) for _, each in keys])
    if isinstance(wanted, RestLengthMorph):
        weights = morph_weights(rig, clip, times)
        number = rig.morph_names.index(wanted.morph)
        full = wanted.full.resolve(patch.span)
        return patch.span + np.clip(weights[:, number], 0.0, 1.0) * (full - patch.span)
    return np.full(len(times), patch.rest_length)
