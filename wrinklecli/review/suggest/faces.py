"""Tools for the wrinkles of a face, placed where the morph targets of its expressions compress the skin.

For each region that an artist wrinkles, the targets of its motions rise together. A tool goes across the summit of the
compression in the region; the parts of the face only tell summits apart, such as a temple from a lid.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import motion_clip, raising
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.choices import FPS
from wrinklecli.effects.attached import Attached
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    significant,
    unit,
)
from wrinklecli.review.suggest.candidates import Candidate
from wrinklecli.review.suggest.draft import across_x, tool_of, width_of
from wrinklecli.review.suggest.face_parts import Face, read_face
from wrinklecli.review.suggest.face_targets import (
    COLUMNS,
    HEIGHTS,
    REGIONS,
    VOCABULARIES,
    FaceRegion,
    FaceTarget,
    Side,
    read_face_targets,
)
from wrinklecli.review.suggest.fitted_tools import LEAST_BY_MORPH, Suggestion, suggestion_of
from wrinklecli.review.suggest.measure import FEWEST_POSES, MOST_POSES
from wrinklecli.review.suggest.place_names import PlaceName
from wrinklecli.review.suggest.shortening import attached, attached_and_folded, shortenings_of, with_rising_bumps
from wrinklecli.review.suggest.stage import SHOWN
from wrinklecli.surface.compression import (
    FEWEST_SITES,
    REGION_FACING,
    REGION_LOSS,
    CompressedRegion,
    connected_sites,
    extent,
)
from wrinklecli.surface.sites import at_sites
from wrinklecli.surface.strain import along_directions, principal, unscaled_pose
from wrinklecli.surface.substance import Substance
from wrinklecli.surface.trace import find_segment
from wrinklecli.tools.materials import usual_bumps
from wrinklecli.tools.records import Length, WrinkleTool

# Highest point of a wrinkle of a face relative to its width: a young one's are low.
_BUMP_HEIGHT = 0.1
# Greatest length of a bump over the tool's width: lines are several times as long as they are wide.
_BUMP_OF_WIDTH = 0.3
# Factor on the width of a tool that reaches lids or lips, and the part of its least width to which it goes.
_NARROWER, _NARROWEST = 0.9, 0.7
# Way by which it is moved off if that does not do, in distances of the eyes, and the most places tried.
_MOVE, _MOVES = 0.08, 4
# Greatest length of a tool, in distances of the eyes: lines of a face lie close together.
_LONGEST = 0.5
# Way up over the way aside across a furrow beside the mouth, which runs from the nose down to the mouth's corner,
# however a mesh stretches there.
_FURROW = 0.4
# Least and greatest angle to either side by which crow's feet spread round an eye, radians.
_SPREAD = np.radians([22.0, 35.0])


@dataclass(frozen=True, slots=True)
class FaceTools:
    """The tools of a face.

    Attributes:
        tools: From the forehead down.
        motions: The clips, not of the asset, in which they shorten: targets that rise in a second.
        notes: A line for the regions without a tool, and each reason.
        reason: Why there are no tools; empty if there are some.
    """

    tools: tuple[Suggestion, ...]
    motions: tuple[Clip, ...]
    notes: tuple[str, ...]
    reason: str


def suggest_face(document: Document, nodes: Mapping[int, str | None], clips: Sequence[Clip]) -> FaceTools:
    """Fit the tools of a face.

    No bump reaches its full height before the greatest shortening in the asset's clips either, as `check` has them.
    `nodes` are as `find_mesh_nodes` finds them.
    """
    found = [(read_rig(document, node), name) for node, name in nodes.items()]
    named = [(rig, name, targets) for rig, name in found if (targets := read_face_targets(document, rig))]
    if not named:
        return FaceTools((), (), (), f"no mesh has morph targets of a face: {VOCABULARIES}")
    # Of several meshes with the same targets, such as teeth and lashes, the skin has the most to move.
    rig, name, targets = max(named, key=lambda each: _moved_count(document, each[0], each[2]))
    where = rig.node_name
    face = read_face(document, rig, targets, name)
    if face is None:
        return FaceTools((), (), (), f"{where}: its morph targets tell neither eyes nor brows, or move no skin")
    tools: list[Suggestion] = []
    motions: dict[str, Clip] = {}
    missing: list[str] = []
    notes: list[str] = []
    for region in REGIONS:
        if not face.of(region.targets):
            missing.append(f"{region.title} ({', '.join(region.targets)})")
            continue
        sides: tuple[Side, ...] = ("",) if region.middle else ("L",) if face.symmetric else ("L", "R")
        for side in sides:
            motion = _motion(face, region, side)
            fitted = None if motion is None else _fit(face, region, side, motion, clips)
            if isinstance(fitted, Suggestion):
                tools.append(fitted)
                motions |= {} if motion is None else {motion.name: motion}
            else:
                of_side = region.title + {"": "", "L": ", left", "R": ", right"}[side]
                notes.append(f"{where}: no tool for {of_side}: {fitted or 'no target on this side'}")
    if missing:
        notes.insert(0, f"{where}: no tool for {', '.join(missing)}: it has no such target")
    reason = "" if tools else f"{where}: no morph target compresses the skin where a face has lines"
    return FaceTools(tuple(tools), tuple(motions.values()), tuple(notes), reason)


def _moved_count(document: Document, rig: Rig, targets: Sequence[FaceTarget]) -> int:
    """The number of vertices that targets move."""
    numbers = sorted({number for each in targets for number in each.weights})
    return int(np.any(read_surface(document, rig).morph_deltas[numbers], axis=(0, 2)).sum())


def _motion(face: Face, region: FaceRegion, side: Side) -> Clip | None:
    """The targets of a region's motions raised together; None if there are none on a side."""
    targets = face.of(region.targets, side)
    weights: dict[int, float] = {}
    for each in targets:
        weights |= {number: max(weight, weights.get(number, 0.0)) for number, weight in each.weights.items()}
    return (
        motion_clip(" + ".join(each.name for each in targets), [raising(face.mesh.rig, weights)]) if targets else None
    )


def _fit(face: Face, region: FaceRegion, side: Side, together: Clip, clips: Sequence[Clip]) -> Suggestion | str:
    """The tool of a region on a side, or of a pair; or why there is none."""
    mesh = replace(face.mesh, clips=(together,), times=(np.linspace(0.0, 1.0, FEWEST_POSES),))
    compressed = _compressed(face, region, side, together)
    if compressed is None:
        return f"{together.name} compresses the skin there by less than {100 * LEAST_BY_MORPH:g} %"
    pose = unscaled_pose(mesh.gauge, together, 1.0)
    ends = find_segment(mesh.sites, compressed, [pose], longest=_longest(face, region))
    if ends is None:
        return f"no segment fits where {together.name} compresses the skin"
    origin, target = ends
    candidate = Candidate(
        mesh=mesh,
        region=compressed,
        clip=together,
        time=1.0,
        origin=origin,
        target=target,
        driver=together.name,
        by_morph=True,
        place=PlaceName(region.title.removeprefix("the ")),
        substance=Substance("skin", "as all of a face"),
    )
    if region.round_eye:
        candidate = _round_eye(face, candidate, side)
    if region.furrow:
        candidate = _beside_mouth(face, candidate, max(width_of(candidate), _narrowest(region, candidate)))
    return _fit_tool(face, region, candidate, side, clips)


def _longest(face: Face, region: FaceRegion) -> float:
    """Greatest length of a tool, scene units; a furrow is a single line."""
    return _LONGEST * face.size * (0.5 if region.furrow else 1.0)


def _narrowest(region: FaceRegion, candidate: Candidate) -> float:
    """Least width of a tool, scene units: lines that are shorter for their width look like dents."""
    length = float(np.linalg.norm(candidate.target - candidate.origin))
    return length / (_BUMP_OF_WIDTH * (1 if region.furrow else usual_bumps("skin")))


def _compressed(face: Face, region: FaceRegion, side: Side, clip: Clip) -> CompressedRegion | None:
    """The region that a motion compresses on a side; None if it compresses less than a line of a face."""
    sites = face.mesh.sites
    tensors = at_sites(sites, clip, np.array([1.0]))[0]
    sign = -1.0 if side == "R" else 1.0
    aside = sign * face.left
    direction = unit(aside + _FURROW * face.up) if region.furrow else aside if region.upright else face.up
    fixed = region.middle or region.furrow
    lost = along_directions(tensors, sites.normals, direction) if fixed else principal(tensors, sites.normals)[0]
    lost = np.where(_window(face, region, sign), lost, -np.inf)
    seed = int(lost.argmax())
    if not lost[seed] > LEAST_BY_MORPH:
        return None
    inside = (lost >= REGION_LOSS * lost[seed]) & (sites.normals @ sites.normals[seed] > REGION_FACING)
    members = connected_sites(sites, inside, seed)
    if len(members) < FEWEST_SITES:
        return None
    weights = sites.areas[members] * lost[members]
    normal = unit(weights @ sites.normals[members])
    if not fixed:
        _, (direction,) = principal((weights @ tensors[members] / weights.sum())[None], normal[None])
    places, counted = sites.positions[members], weights
    if region.middle:
        # The side that is not grown is as large.
        normal = unit(normal - (normal @ face.left) * face.left)
        beside = ((places - face.middle) @ face.left)[:, None] * face.left
        places, counted = np.concatenate([places, places - 2.0 * beside]), np.tile(weights, 2)
    along = unit(direction - (direction @ normal) * normal)
    sideways = np.cross(normal, along)
    centre = counted @ places / counted.sum()
    (low, high), (left, right) = (extent((places - centre) @ axis, counted) for axis in (along, sideways))
    return CompressedRegion(
        members=members,
        weights=weights,
        centre=centre + (low + high) / 2.0 * along + (left + right) / 2.0 * sideways,
        normal=normal,
        along=along,
        length=min(high - low + sites.spacing, _longest(face, region)),
        width=right - left + sites.spacing,
        twin=face.symmetric,
        on_plane=region.middle,
    )


def _window(face: Face, region: FaceRegion, sign: float) -> Bools:
    """(sites,) True where a region may lie, apart from lids and lips."""
    places = face.mesh.sites.positions
    aside, height = sign * face.asides(places), face.heights(places)
    aside = np.abs(aside) if region.middle else aside
    (near, far), (low, high) = COLUMNS[region.column], (HEIGHTS[each] for each in region.between)
    return np.asarray(face.free & (aside >= near) & (aside <= far) & (height >= low) & (height <= high))


def _round_eye(face: Face, candidate: Candidate, side: Side) -> Candidate:
    """A candidate with a path around an eye, so that its wrinkles spread from there."""
    sign = -1.0 if side == "R" else 1.0
    eye = face.middle + 0.5 * sign * face.size * face.left
    aside = (candidate.region.centre - eye) @ (sign * face.left)
    above = float((candidate.region.centre - eye) @ face.up)
    radius, middle = float(np.hypot(aside, above)), float(np.arctan2(above, aside))
    half = float(np.clip(candidate.region.length / 2.0 / radius, *_SPREAD))
    depth = (candidate.region.centre - eye) @ face.ahead
    points = []
    for angle in middle + half * np.array([-1.0, 0.0, 1.0]):
        out = np.cos(angle) * sign * face.left + np.sin(angle) * face.up
        points.append(face.mesh.rest.foot(eye + radius * out + depth * face.ahead)[0])
    return replace(candidate, origin=points[0], between=np.array([points[1]]), target=points[2])


def _beside_mouth(face: Face, candidate: Candidate, width: float) -> Candidate:
    """A furrow moved up along itself until it ends beside the mouth, and so begins beside the nose.

    A smile compresses the cheek most beside the corner of the mouth, the lower end of the line that a face has there.
    """
    crest = unit(np.cross(candidate.region.normal, candidate.target - candidate.origin))
    crest = crest * np.sign(crest @ face.up or 1.0)
    low = (candidate.origin + candidate.target) / 2.0 - width / 2.0 * crest
    below = face.mouth * face.size - (low - face.middle) @ face.up
    return _moved(face, candidate, float(np.clip(below, 0.0, width / 2.0)) * crest)


def _fit_tool(
    face: Face, region: FaceRegion, candidate: Candidate, side: Side, clips: Sequence[Clip]
) -> Suggestion | str:
    """The tool of a candidate, or of a pair, as wide as lids and lips allow; or why there is none."""
    mesh, name = candidate.mesh, candidate.driver
    patches = _placed(face, region, candidate, side)
    if patches is None:
        return f"there is no room for it where {name} compresses the skin"
    by_weight = name if region.middle and name in mesh.rig.morph_names else ""
    folded = attached_and_folded(mesh, [each.tool for each in patches], LEAST_BY_MORPH, by_weight)
    if folded is None:
        return f"{name} hardly shortens the skin there"
    patches, shortenings = folded
    # A face moves in a tenth of a second.
    counts = (int(np.clip(FPS * (clip.end - clip.start), FEWEST_POSES, MOST_POSES)) for clip in clips)
    times = (np.linspace(clip.start, clip.end, count) for clip, count in zip(clips, counts, strict=True))
    every = replace(mesh, clips=tuple(clips), times=tuple(times))
    also = [found | shortenings_of(every, patch) for patch, found in zip(patches, shortenings, strict=True)]
    made = with_rising_bumps(patches, also, height=_BUMP_HEIGHT)
    return suggestion_of(candidate, patches, shortenings, made)


def _placed(face: Face, region: FaceRegion, candidate: Candidate, side: Side) -> list[Attached[WrinkleTool]] | None:
    """Attach the tool of a candidate, or a pair, clear of lids and lips: narrower, or moved off; None if none fits."""
    least = _narrowest(region, candidate)
    wide = max(width_of(candidate), least)
    for _ in range(_MOVES):
        width, found = wide, None
        while width > _NARROWEST * least:
            tool = _drawn(region, candidate, f"{region.name}.{side}" if side else region.name, width)
            tools = [tool, across_x(tool, f"{region.name}.R")] if side and face.symmetric else [tool]
            found = attached(candidate.mesh, tools)
            if found is None or _near_rims(face, found[0]) is None:
                return found
            width *= _NARROWER
        near = None if found is None else _near_rims(face, found[0])
        if near is None:
            break
        away = candidate.region.centre - near
        away = away - (away @ face.left) * face.left if region.middle else away
        candidate = _moved(face, candidate, _MOVE * face.size * unit(away))
    return None


def _moved(face: Face, candidate: Candidate, by: Floats) -> Candidate:
    """A candidate with its region and its ends moved over the surface by a (3,) way."""
    rest = face.mesh.rest
    origin, *between, target = (
        rest.foot(place + by)[0] for place in (candidate.origin, *candidate.between, candidate.target)
    )
    region = replace(candidate.region, centre=candidate.region.centre + by)
    points = np.array(between).reshape(-1, 3)
    return replace(candidate, region=region, origin=origin, between=points, target=target)


def _drawn(region: FaceRegion, candidate: Candidate, name: str, width: float) -> WrinkleTool:
    """The tool of a candidate; a furrow is one wrinkle into the skin."""
    tool = replace(tool_of(candidate, name, width), width=Length(significant(width, 2)))
    return replace(tool, bumps=1, strength=-1.0, profile="smooth") if region.furrow else tool


def _near_rims(face: Face, patch: Attached[WrinkleTool]) -> Floats | None:
    """(3,) the middle of the places on lids and lips where a tool has more than hardly any height; None if nowhere."""
    sites = face.mesh.sites
    region = patch.regions[0].at_rest
    u, v = region.coordinates(sites.positions)
    shares = region.share(u, v, region.cosines(u, sites.normals))
    # Teeth and the inside of lips lie under a patch and are none of its triangles.
    under = sites.gather[:, np.isin(sites.gauge.numbers, region.members)].sum(axis=1) > 0
    reached = ~face.free & (shares > SHOWN) & under
    return np.asarray(sites.positions[reached].mean(axis=0)) if reached.any() else None
