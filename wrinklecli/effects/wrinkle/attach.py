"""Tools attached to a surface at rest: their anchors, paths, control curves, member triangles and bounds.

Crests are laid straight across a tool at rest, or in the pose in which a morph target raises them: there they are seen,
and a brow that rises unevenly would pull straight ones into a V. Anchors, lengths and drive are those at rest all the
same, and so are the directions of displacements.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, Computer Graphics International 2004, on the
influence region. Differs: members face the patch and are connected to an anchor. The paper takes every vertex that
projects onto the patch, and with them the back of a thin limb.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.drive.segment import RestLength, Segment
from wrinklecli.effects.wrinkle.bending import raised_weights
from wrinklecli.effects.wrinkle.bumps import count_intervals
from wrinklecli.effects.wrinkle.curve import ControlCurve, plan_curve
from wrinklecli.effects.wrinkle.demand import demand_of
from wrinklecli.effects.wrinkle.patch import Patch, Reach
from wrinklecli.effects.wrinkle.variation import Variation, plan_variation
from wrinklecli.errors import BakeError, unknown
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values, face_normals, renumbered, unit
from wrinklecli.numeric.closest import ROUNDING, meets_box
from wrinklecli.numeric.edges import Edges
from wrinklecli.numeric.intersections import zero_lines
from wrinklecli.surface.anchor import LEAST_SPAN, anchor_at
from wrinklecli.surface.features import Nearest, cut_at_features, parts_of, surface_distances
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.mask import read_mask, spread
from wrinklecli.surface.path import Path, path_through
from wrinklecli.surface.rest import Rest, asked_positions, clip_pose, raised_pose
from wrinklecli.tools.records import RestFrame, RestLengthKeys, RestLengthMorph, WrinkleTool, drawn_from

# Distance of neighbouring anchors in the pose in which a tool is laid, over the tool's length at rest, below which u is
# not told from noise.
_LEAST_LAID = 1e-3
# Part of a bump's width over which heights fade at a feature: as wide as the bump's own flank.
_FADE = 0.5
# Ratio of the way over the surface, from the tool's line, to the straight distance, above which a place is another part
# of the body. Round a limb the ratio is π/2 at most, and ways along edges are up to 1.4 times too long.
_DETOUR = 2.5


def attach_tools(
    tools: Sequence[WrinkleTool], surface: Surface, rest: Rest, rig: Rig, *, up: str, clips: Sequence[Clip] = ()
) -> list[Patch]:
    """Attach every tool of a mesh.

    `up` is the axis of the tools file, for messages, and `clips` are those that tools may be laid in.

    Raises:
        WrinkleError: Tools do not fit, a line for each.
    """
    return BakeError.every(lambda tool: _laid(_attach(tool, surface, rest, rig, up), surface, rest, rig, clips), tools)


def _attach(tool: WrinkleTool, surface: Surface, rest: Rest, rig: Rig, up: str) -> Patch:
    if isinstance(tool.rest_length, RestLengthMorph):
        rig.morph_number(tool.rest_length.morph, where=tool.place("rest_length", "morph"))
    asked = asked_positions(rig, rest, tool)
    anchors = tuple(
        anchor_at(tool, number, asked, surface=surface, rest=rest, rig=rig, up=up, snap=tool.snap)
        for number in range(len(asked))
    )
    names = [tool.point_name(number) for number in range(len(anchors))]
    spans = [float(np.linalg.norm(b.position - a.position)) for a, b in pairwise(anchors)]
    for number, span in enumerate(spans):
        if span <= LEAST_SPAN * surface.size or (asked[number] == asked[number + 1]).all():
            raise BakeError(f"{names[number]} and {names[number + 1]} are one point of the mesh", where=tool.where)
    path = path_through(
        [each.position for each in anchors], [each.normal for each in anchors], rest.foot, names=names, where=tool.where
    )
    span = sum(spans)
    half_width = tool.width.resolve(span) / 2.0
    variation = _variation(tool, half_width / span)
    curve = _curve(tool, span, variation)
    rest_length = _rest_length(tool.rest_length, span, curve.rest_length, rig)
    patch = Patch(
        tool=tool,
        curve=curve,
        variation=variation,
        segment=Segment(tuple(each.carried for each in anchors), rest_length),
        anchors=anchors,
        path=path,
        pose=rest,
        laid=path,
        span=span,
        half_width=half_width,
        members=np.zeros(0, np.intp),
        under=np.zeros(0, np.intp),
    )
    return replace(patch, curve=replace(patch.curve, demand=demand_of(patch, surface, rest, rig)))


def _laid(patch: Patch, surface: Surface, rest: Rest, rig: Rig, clips: Sequence[Clip]) -> Patch:
    """Lay a tool out in the pose that it asks for: find the triangles of its patch there.

    Raises:
        BakeError: It cannot be laid there.
    """
    pose = _wanted_pose(patch, surface, rest, rig, clips)
    if pose is not rest:
        try:
            laid = replace(patch, pose=pose, laid=_path_in(patch, pose))
            members = _members(laid, surface)
            return replace(laid, members=members, under=members)
        except BakeError:
            # A tool that asks for no pose can be laid at rest as well.
            if patch.tool.laid != "auto":
                raise
    members = _members(patch, surface)
    return replace(patch, members=members, under=members)


def _wanted_pose(patch: Patch, surface: Surface, rest: Rest, rig: Rig, clips: Sequence[Clip]) -> Rest:
    """The pose in which a tool asks to be laid.

    Raises:
        BakeError: There is no such pose.
    """
    tool, where = patch.tool, patch.tool.place("laid")
    if tool.attachment == "patch":
        if tool.laid not in ("auto", "stored"):
            raise BakeError("attachment: patch is laid anew in each frame; laid can be auto or stored", where=where)
        return rest
    if isinstance(tool.laid, RestFrame):
        clip = next((each for each in clips if each.name == tool.laid.clip), None)
        if clip is not None:
            return clip_pose(rest, surface, rig, clip, tool.laid.time)
        if not tool.optional:
            message = unknown("the asset has no clip", tool.laid.clip, [each.name for each in clips])
            raise BakeError(message, where=tool.place("laid", "clip"))
    # Keys that raise a tool by hand say nothing of a morph target.
    elif tool.laid == "raised" or (tool.laid == "auto" and not isinstance(tool.rest_length, RestLengthKeys)):
        weights = raised_weights(patch, rig, rest, surface)
        if weights is not None:
            return raised_pose(rest, surface, weights)
        if tool.laid == "raised":
            raise BakeError("no morph target brings the ends together; laid can be stored or a clip's", where=where)
    return rest


def _path_in(patch: Patch, pose: Rest) -> Path:
    """The line through a tool's anchors in a pose.

    Raises:
        BakeError: There is no such line.
    """
    points = [each.barycentrics @ pose.positions[each.vertices] for each in patch.anchors]
    normals = [unit(each.barycentrics @ pose.normals_at(each.vertices)) for each in patch.anchors]
    names = [patch.tool.point_name(number) for number in range(len(points))]
    where = patch.tool.place("laid")
    for number, (one, other) in enumerate(pairwise(points)):
        if np.linalg.norm(other - one) <= _LEAST_LAID * patch.span:
            raise BakeError(f"{names[number]} and {names[number + 1]} are one point in the pose", where=where)
    return path_through(points, normals, pose.foot, names=names, where=where)


def _variation(tool: WrinkleTool, aspect: float) -> Variation | None:
    """Draw a tool's irregularity, from half its width over its length; None for ruled wrinkles."""
    if not tool.variation:
        return None
    return plan_variation(
        drawn_from(tool.name, tool.seed),
        tool.variation,
        tool.branch,
        tool.broken,
        bumps=tool.bumps,
        gap=tool.gap,
        aspect=aspect,
        kind=tool.attenuation,
        strategy=tool.strategy,
        mirrored=tool.mirrored,
    )


def _curve(tool: WrinkleTool, span: float, variation: Variation | None) -> ControlCurve:
    """Plan a tool's control curve, from the distance of its anchors at rest, scene units."""
    rest_length, greatest = _rest_lengths(tool, span)
    varied = {} if variation is None else {"widths": variation.bumps.widths, "peaks": variation.peaks}
    return plan_curve(
        bumps=tool.bumps,
        gap=tool.gap,
        strategy=tool.strategy,
        details=tool.details,
        profile=tool.profile,
        max_height=_max_height(tool, span, rest_length, variation),
        compressible=tool.compressible,
        rest_length=rest_length,
        greatest_rest_length=greatest,
        **varied,
    )


def _rest_length(wanted: object, span: float, constant: float, rig: Rig) -> RestLength:
    """The rest length of a tools file, resolved on a segment of a span, scene units."""
    if isinstance(wanted, RestLengthMorph):
        return RestLength(constant, morph=(rig.morph_names.index(wanted.morph), wanted.full.resolve(span)))
    if isinstance(wanted, RestLengthKeys):
        resolved = {clip: [[time, length.resolve(span)] for time, length in keys] for clip, keys in wanted.keys.items()}
        return RestLength(constant, {clip: np.array(keys) for clip, keys in resolved.items()})
    return RestLength(constant)


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


def _max_height(tool: WrinkleTool, span: float, rest_length: float, variation: Variation | None) -> float:
    """Greatest height of all bumps, scene units; if it is `auto`, a part of their widths on the straight segment."""
    if tool.max_height is None:
        return np.inf
    if tool.max_height != "auto":
        return tool.max_height.resolve(span)
    width = 2.0 * rest_length / count_intervals(tool.bumps, tool.gap)
    # Each bump may be as high as that part of its own width.
    highest = 1.0
    if variation is not None:
        peaks = variation.peaks
        highest = float((variation.bumps.widths * peaks).max() / peaks.max())
    return tool.bump_height * width * highest


def _members(patch: Patch, surface: Surface) -> Ints:
    """(members,) sorted coarse triangles that face a patch, meet it and are connected with an anchor, in its pose."""
    pose = patch.pose
    origin, axes, low, high = patch.laid.box(patch.half_width)
    along = (pose.positions - origin) @ axes.T
    slack = ROUNDING * np.abs(along).max()
    near = np.flatnonzero(meets_box(along, low - slack, high + slack, surface.triangles))
    used, corners = renumbered(surface.triangles[near])
    places = np.stack(patch.coordinates(pose.positions[used]), axis=1)
    meeting = meets_box(places, np.array([0.0, -1.0]), np.array([1.0, 1.0]), corners)
    u = places[corners[meeting], 0].mean(axis=1)
    near = near[meeting]
    triangles = surface.triangles[near]
    vertices, corners = renumbered(triangles)
    # Winding may be mirrored in the pose; vertex normals are not.
    faces = face_normals(pose.positions, triangles)
    normals = pose.normals_at(vertices)[corners]
    outward = np.sign(np.sum(faces * normals.sum(axis=1), axis=1))
    chosen = near[outward * patch.cosines(u, faces) > 0]
    inside = np.isin(chosen, np.concatenate([anchor.triangles for anchor in patch.anchors]))
    if not inside.any():
        raise BakeError("no triangle at its ends faces the patch", where=patch.tool.where)
    piece = parts_of(surface.triangles[chosen], np.zeros((0, 2), np.intp))
    return np.asarray(chosen[np.isin(piece, piece[inside])])


def bounded(patches: Sequence[Patch], ground: Ground) -> list[Patch]:
    """Attached tools with the places where their wrinkles end: features of the surface, and where their mask is 0.

    Raises:
        WrinkleError: Masks do not fit, a line for each.
    """
    return BakeError.every(lambda patch: _masked(_stopped(patch, ground), ground), patches)


def _stopped(patch: Patch, ground: Ground) -> Patch:
    """A patch that ends at features of the surface, without the members behind them.

    A part of the surface between features belongs to the tool if the tool's line runs over it for a bump at least. So
    an anchor may lie on a waistband.
    """
    if patch.tool.stops == "none":
        return patch
    bump = 2.0 * patch.span / patch.curve.interval_count
    cut, covered = cut_at_features(ground, patch.members, bump), _covered(patch, ground)
    if len(cut.features):
        lengths = np.bincount(cut.parts, covered)
        belongs = lengths >= min(bump / patch.span, lengths.max())
        chosen = belongs[cut.parts]
        patch, covered = replace(patch, members=patch.members[chosen]), covered[chosen]
    detours = _detours(patch, ground, covered > 0.0, bump)
    if detours is not None:
        behind = (detours[ground.surface.triangles[patch.members]] >= 1.0).all(axis=1)
        patch = replace(patch, members=patch.members[~behind])
    fade = _FADE * min(bump, patch.half_width)
    nearest = Nearest.of(cut.features, patch.pose, patch.members, fade) if len(cut.features) else None
    return patch if nearest is None and detours is None else replace(patch, reach=Reach(nearest, fade, detours))


def _covered(patch: Patch, ground: Ground) -> Floats:
    """(members,) part of the tool's line, from 0 to 1, that lies on each member."""
    vertices, corners = renumbered(ground.surface.triangles[patch.members])
    u, v = patch.coordinates(patch.pose.positions[vertices])
    found, shares = zero_lines(v, corners)
    ends = np.sort(np.clip(np.einsum("ec,ec->e", shares, u[corners[found]]), 0.0, 1.0).reshape(-1, 2), axis=1)
    covered = np.zeros(len(corners))
    covered[found[::2]] = ends[:, 1] - ends[:, 0]
    return covered


def _detours(patch: Patch, ground: Ground, on_line: Bools, bump: float) -> Floats | None:
    """(coarse vertices,) 1 at parts of the body that are only near in space, fading over a bump; None if none are.

    The way over the surface from the tool's line, of which (members,) `on_line` have a part, is much longer there than
    the straight distance.
    """
    surface, pose = ground.surface, patch.pose
    members = surface.triangles[patch.members]
    used = distinct_values(members)
    vertices, corners = renumbered(surface.triangles[ground.rest.around.faces_of(used)])
    u, v = patch.coordinates(pose.positions[vertices])
    straight = np.hypot(np.maximum(np.abs(u - 0.5) - 0.5, 0.0) * patch.span, np.abs(v) * patch.half_width)
    starts = np.full(len(vertices), np.inf)
    begun = np.searchsorted(vertices, distinct_values(members[on_line]))
    starts[begun] = straight[begun]
    if not len(begun):
        return None
    ways = surface_distances(Edges.of(corners).vertices, pose.positions[vertices], starts)
    excess = np.clip((ways - _DETOUR * straight) / bump, 0.0, 1.0)
    if not excess[np.searchsorted(vertices, used)].any():
        return None
    detours = np.zeros(len(pose.positions))
    detours[vertices] = excess
    return detours


def _masked(patch: Patch, ground: Ground) -> Patch:
    """A patch with its mask, without the members where the mask is 0.

    Raises:
        WrinkleError: The mask cannot be read, or is 0 all over the patch.
    """
    mask = read_mask(patch.tool, ground, patch.members)
    if mask is None:
        return patch
    pose, triangles = patch.pose, ground.surface.triangles[patch.members]
    factors = mask.over(ground.surface.corners[patch.members])
    used, corners = renumbered(triangles)
    normals = pose.normals_at(used)[corners]
    u, v = patch.coordinates(spread(pose.positions[triangles]))
    heights = patch.share(u, v, patch.cosines(u, unit(spread(normals))))
    heights *= np.linalg.norm(face_normals(pose.positions, triangles), axis=1)[:, None]
    left = float((factors * heights).sum())
    if not left > 0:
        raise BakeError(f"the mask leaves nothing of {patch.tool.name}", where=patch.tool.place("mask"))
    chosen = patch.members[factors.any(axis=1)]
    return replace(patch, members=chosen, mask=mask, mask_share=left / float(heights.sum()))
