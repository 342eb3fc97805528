"""Tools fitted to folds, best first: attached and measured over all clips as a bake does, in the numbers written.

A tool that lies on a better one, does not attach or hardly shortens is left out, and one whose mirror image across
x = 0 shortens too becomes a pair.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import node_matrices
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.errors import WrinkleError
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.review.suggest.draft import newly_named, pair_of, stem_and_side, tool_of, width_of, written_length
from wrinklecli.review.suggest.folds import Fold
from wrinklecli.review.suggest.measure import MeasuredMesh, pose_unscaled
from wrinklecli.review.suggest.moments import Moment, deepest_moments, rising_tools
from wrinklecli.review.suggest.room import highest
from wrinklecli.surface.path import Curve
from wrinklecli.surface.segments import lay_segment
from wrinklecli.surface.sites import at_sites
from wrinklecli.surface.strain import principal
from wrinklecli.surface.trace import CLEAR_LOSS, trace
from wrinklecli.tools.mirror import split_side
from wrinklecli.tools.records import Length, RestLengthMorph, WrinkleTool

# Part of the best suggestion's score below which a fold is not worth a tool.
_LEAST_SCORE = 0.02
# Part of its length that a segment must lose: where a joint bends less, skin bulges and does not fold, and cloth
# only slackens. What a morph target moves is a face, where lines are made by less.
_LEAST_SHORTENING = {"skin": 0.3, "cloth": 0.2, "leather": 0.2, None: 0.15}
_LEAST_BY_MORPH = 0.04
# Degrees between a straight tool and the strongest compression, in the median, from which a path is tried. It has less,
# or this part of them at most.
_ASKEW, _BETTER = 10.0, 0.7
# Part of the straight tool's shortening, measured along the skin as a path measures it, that a path has at least: of
# less, it runs beside the crease, as in a knee's hollow, and its bumps would be small.
_AS_SHORT = 0.75
# Half the width of a path over its sharpest bend's radius, and what must be left of the straight tool's width.
_OF_RADIUS, _LEAST_WIDTH = 0.9, 0.6
# Length of a region about a finger's joint, as a part of its shorter bone's: a segment then ends halfway along that.
_OF_BONE = 0.6
# Part of its twin's shortening below which the left one of a pair all but rests.
_RESTS = 0.7
# Per cent of its rest distance that a segment across the middle of a face has at weight 1 of its morph target, the
# first that shortens it. Between two brows skin hardly shortens, and yet its lines go across: the weight makes them.
_FULL = (105.0, 110.0, 115.0, 120.0, 130.0)
# Part of its height that a tool has at least at a place whose direction counts.
_PRESENT = 0.25


@dataclass(frozen=True, slots=True)
class Suggestion:
    """A tool across a compressed region.

    Attributes:
        tool: Its definition, numbers as they are written.
        mirrored: Whether its twin on the other side of x = 0 is meant too.
        mesh: Name of the node.
        driver: The joint or morph target that compresses the region, as the asset names it.
        by_morph: Whether that is a morph target.
        clip: The clip that shortens the segment most.
        time: Seconds at which it does.
        span: Distance of the anchors at rest, scene units.
        clips: Of each clip, the least distance of the anchors with animated scale taken out, scene units; infinite
            where the character is hidden in all of it.
        shortening: The greatest, as a part of the span, or of the rest length where a morph target makes that longer.
        straight: The same with a straight tool, where this one has a path.
        score: What the region loses: 1 − σ summed over its area, scene units squared.
    """

    tool: WrinkleTool
    mirrored: bool
    mesh: str
    driver: str
    by_morph: bool
    clip: str
    time: float
    span: float
    clips: dict[str, float]
    shortening: float
    score: float
    straight: "Suggestion | None" = None

    @property
    def rest_length(self) -> str:
        """The tool's, as it is written."""
        return written_length(self.tool.rest_length)


def fit_tools(folds: Sequence[Fold], count: int, further: Sequence[Clip] = ()) -> list[Suggestion]:
    """The best folds as tools, best first; lop-sided ones, and mild ones, only where there is no other.

    Args:
        folds: Of all meshes.
        count: At most.
        further: Clips that `check` looks at too: no bump is full before their end.
    """
    return (
        _ranked(folds, count, further)
        or _ranked(folds, count, further, lopsided=True)
        or _ranked(folds, count, further, lopsided=True, mild=True)
    )


def _ranked(
    folds: Sequence[Fold], count: int, further: Sequence[Clip], *, lopsided: bool = False, mild: bool = False
) -> list[Suggestion]:
    order = sorted(range(len(folds)), key=lambda index: -folds[index].score)
    found: list[Suggestion] = []
    laid: list[tuple[MeasuredMesh, Patch]] = []
    names: set[str] = set()
    sizes: dict[tuple[int, str], float] = {}
    for index in order:
        fold = folds[index]
        if len(found) == count or fold.score < _LEAST_SCORE * folds[order[0]].score:
            break
        others = [patch for mesh, patch in laid if mesh is fold.mesh]
        if any(_covers(patch, fold.region.centre, fold.region.normal) for patch in others):
            continue
        made = _made(fold, names, sizes, further, lopsided=lopsided, mild=mild)
        if made is None or any(_overlap(patch, other) for patch in made[1] for other in others):
            continue
        suggestion, patches = made
        # Folds about one joint are of one size, where they are about the same size.
        sizes.setdefault((fold.mesh.rig.node, suggestion.driver), suggestion.span / suggestion.tool.bumps)
        found.append(suggestion)
        names |= {patch.tool.identifier for patch in patches}
        laid += [(fold.mesh, patch) for patch in patches]
    return found


def _covers(patch: Patch, place: Floats, normal: Floats) -> bool:
    """Whether a place that looks along a normal lies well on a patch."""
    u, v = patch.coordinates(place)
    height = abs(float(patch.path.depths(place)))
    on = 0.0 <= u <= 1.0 and abs(v) <= 0.8 and height < 0.5 * max(patch.span, patch.half_width)
    return bool(on and patch.cosines(u, normal) > 0)


def _overlap(first: Patch, second: Patch) -> bool:
    """Whether the middle of one patch lies on the other."""
    middles = [each.path.middle for each in (first, second)]
    return _covers(second, middles[0], first.normal) or _covers(first, middles[1], second.normal)


def _made(
    fold: Fold,
    names: set[str],
    sizes: dict[tuple[int, str], float],
    further: Sequence[Clip],
    *,
    lopsided: bool,
    mild: bool,
) -> tuple[Suggestion, list[Patch]] | None:
    """A tool of a fold, with its twin if it has one; none where it does not attach or shorten.

    Args:
        fold: Where.
        names: Identifiers that are taken.
        sizes: By node and driver, the width of a bump, scene units.
        further: As of `fit_tools`.
        lopsided: Whether to take a fold alone that is one of a pair, but would lie on its twin.
        mild: Whether to take one that shortens less than what it is made of asks for.
    """
    region = fold.region
    apart = not region.on_plane and 2.0 * abs(float(region.centre[0])) > 0.5 * min(region.length, region.width)
    if region.twin and not (apart or region.on_plane or lopsided):
        return None
    fold = _within_bones(fold) if fold.part == "finger" else fold
    refined = _refined(fold)
    if refined is None:
        return None

    def fitted(each: Fold) -> tuple[Suggestion, list[Patch]] | None:
        return _fitted(each, names, sizes, further, apart=apart, lopsided=lopsided, mild=mild)

    curved = _curved(refined)
    made = fitted(curved)
    if curved is refined:
        return made
    straight = fitted(refined)
    return straight if made is None else (replace(made[0], straight=straight and straight[0]), made[1])


def _fitted(
    refined: Fold,
    names: set[str],
    sizes: dict[tuple[int, str], float],
    further: Sequence[Clip],
    *,
    apart: bool,
    lopsided: bool,
    mild: bool,
) -> tuple[Suggestion, list[Patch]] | None:
    """As `_made`, of a fold whose segment fits; `apart` says whether it is clear of its twin."""
    mesh, region, driver, by_morph = refined.mesh, refined.region, refined.driver, refined.by_morph
    stem, side = stem_and_side(driver, refined.part or "fold")
    size = sizes.get((mesh.rig.node, driver))
    if by_morph and region.on_plane:
        return _driven(refined, newly_named([tool_of(refined, stem, width_of(refined))], stem, names)[0], further)
    options = [[tool_of(refined, f"{stem}.{side}" if side else stem, width_of(refined), size)]]
    # `mirror` would exchange the side in the node's name too.
    if region.twin and apart and not (mesh.node is not None and split_side(mesh.node)[1]):
        options.insert(0, pair_of(refined, stem, side, size))
    for tools in options:
        named = newly_named(tools, stem, names)
        patches = _attached(mesh, named)
        if patches is None:
            continue
        if len(patches) == 2 and _overlap(*patches):
            if lopsided:
                continue
            return None
        lengths = [deepest_moments(mesh, patch) for patch in patches]
        shares = [max(moment.shortening for moment in each.values()) for each in lengths]
        if max(shares) < _least_shortening(refined, mild=mild):
            continue
        if shares[0] < _RESTS * shares[-1]:
            # The one that the clips fold is written, and `mirror` makes the other.
            named, patches, lengths = named[::-1], patches[::-1], lengths[::-1]
        return _suggested(refined, patches, lengths, further)
    return None


def _driven(fold: Fold, tool: WrinkleTool, further: Sequence[Clip]) -> tuple[Suggestion, list[Patch]] | None:
    """A tool across x = 0 that the weight of a morph target drives, the further where that stretches the middle."""
    for full in _FULL:
        length = RestLengthMorph(fold.driver, Length(full, percent=True))
        patches = _attached(fold.mesh, [replace(tool, rest_length=length)])
        if patches is None:
            return None
        moments = deepest_moments(fold.mesh, patches[0])
        if max(moment.shortening for moment in moments.values()) >= _LEAST_BY_MORPH:
            return _suggested(fold, patches, [moments], further)
    return None


def _suggested(
    fold: Fold, patches: list[Patch], lengths: list[dict[str, Moment]], further: Sequence[Clip]
) -> tuple[Suggestion, list[Patch]] | None:
    """A tool, or a pair whose first is written, that rises until the deepest pose; none where there is no room."""
    mesh, driver = fold.mesh, fold.driver
    best = max(lengths[0], key=lambda name: lengths[0][name].shortening)
    deepest = [moments | deepest_moments(mesh, each, further) for each, moments in zip(patches, lengths, strict=True)]
    rising = rising_tools(patches, deepest, min(highest(mesh, patch) for patch in patches))
    if rising is None:
        return None
    patches = [replace(each, tool=tool) for each, tool in zip(patches, rising, strict=True)]
    suggestion = Suggestion(
        tool=patches[0].tool,
        mirrored=len(patches) == 2,
        mesh=mesh.rig.names[mesh.rig.node],
        driver=_of_side(mesh, driver, patches[0].tool.name) if len(patches) == 2 else driver,
        by_morph=fold.by_morph,
        clip=best,
        time=lengths[0][best].time,
        span=patches[0].span,
        clips={name: moment.distance for name, moment in lengths[0].items()},
        shortening=lengths[0][best].shortening,
        score=fold.score,
    )
    return suggestion, patches


def _within_bones(fold: Fold) -> Fold:
    """A fold of a finger whose region ends within the bones to either side of its joint: beyond are other creases."""
    rig = fold.mesh.rig
    node = rig.names.index(fold.driver)
    others = [*np.flatnonzero(rig.parents == node).tolist(), *([int(rig.parents[node])] * bool(rig.parents[node] >= 0))]
    joint, *ends = node_matrices(rig, None, np.zeros(1), [node, *others])[0, :, :3, 3]
    lengths = [length for end in ends if (length := float(np.linalg.norm(end - joint))) > 0]
    region = replace(fold.region, length=min([fold.region.length, *(_OF_BONE * each for each in lengths)]))
    laid = lay_segment(fold.mesh.sites, region, [pose_unscaled(fold.mesh, fold.clip, fold.time)])
    return fold if laid is None else replace(fold, region=region, origin=laid[0], target=laid[1])


def _refined(fold: Fold) -> Fold | None:
    """A fold whose segment fits the pose that shortens it most too; none where no tool attaches.

    Where the region loses most its segment need not be shortest: a fold closes further.
    """
    mesh, region = fold.mesh, fold.region
    for _ in range(2):
        first = _attached(mesh, [tool_of(fold, "probe", width_of(fold))])
        if first is None:
            return None
        clip, time = _deepest(mesh, first[0])
        if clip is fold.clip and time == fold.time:
            break
        ends = lay_segment(
            mesh.sites, region, [pose_unscaled(mesh, fold.clip, fold.time), pose_unscaled(mesh, clip, time)]
        )
        if ends is None:
            return None
        fold = replace(fold, origin=ends[0], target=ends[1])
    return fold


def _curved(fold: Fold) -> Fold:
    """A fold with a path along the strongest compression, where a straight tool crosses that askew."""
    mesh = fold.mesh
    straight = _attached(mesh, [tool_of(fold, "probe", width_of(fold))])
    if straight is None or fold.region.on_plane:
        return fold
    moment = _deepest(mesh, straight[0])
    askew = _askew(mesh, straight[0], moment)
    if askew < _ASKEW:
        return fold
    best, least = fold, max(_BETTER * askew, min(_ASKEW, askew))
    for _ in range(2):
        traced = _traced(fold, *moment)
        if traced is None:
            break
        curved, found = traced
        # A path is shortest at another time than the chord from end to end.
        moment, before = _deepest(mesh, found), moment
        angle = _askew(mesh, found, moment)
        if angle < least:
            best, least = curved, angle
        if least < _ASKEW or moment == before:
            break
    return best


def _askew(mesh: MeasuredMesh, patch: Patch, moment: tuple[Clip, float]) -> float:
    """Median angle of a tool with the strongest compression at a time of a clip, degrees."""
    clip, time = moment
    return _misalignment(mesh, patch, at_sites(mesh.sites, clip, np.array([time]))[0])


def _misalignment(mesh: MeasuredMesh, patch: Patch, tensors: Floats) -> float:
    """Median angle of a tool with the direction of the strongest compression, weighted by area, degrees.

    Args:
        mesh: The mesh.
        patch: The attached tool.
        tensors: (sites, 6) what a pose loses.
    """
    sites = mesh.sites
    members = np.isin(mesh.gauge.numbers, patch.members)
    under = np.flatnonzero(sites.gather[:, members].sum(axis=1))
    u, v = patch.coordinates(sites.positions[under])
    shares = np.abs(patch.magnitudes(u, v, sites.normals[under]) / patch.shape_strength)
    on, u = under[shares > _PRESENT], u[shares > _PRESENT]
    losses, directions = principal(tensors[on], sites.normals[on])
    strained = losses > CLEAR_LOSS * losses.max(initial=0.0)
    on, u, directions = on[strained], u[strained], directions[strained]
    if not len(on):
        return 0.0
    along = patch.path.directions(u)
    along = unit(along - np.sum(along * sites.normals[on], axis=1)[:, None] * sites.normals[on])
    angles = np.degrees(np.arccos(np.clip(np.abs(np.sum(along * directions, axis=1)), 0.0, 1.0)))
    order = np.argsort(angles, kind="stable")
    total = np.cumsum(sites.areas[on][order])
    return float(angles[order[np.searchsorted(total, 0.5 * total[-1])]])


def _traced(fold: Fold, clip: Clip, time: float) -> tuple[Fold, Patch] | None:
    """A fold with a path along the strongest compression at a time of a clip, attached; none where that is no tool."""
    mesh, region = fold.mesh, fold.region
    tensors = at_sites(mesh.sites, clip, np.array([time]))[0]
    first, second = (float(np.linalg.norm(end - region.centre)) for end in (fold.origin, fold.target))
    points = trace(mesh.sites, region, tensors, (first, second))
    if points is None:
        return None
    curved = replace(fold, origin=points[0], between=points[1:-1], target=points[-1])
    wide = _attached(mesh, [tool_of(curved, "probe", width_of(fold))])
    if wide is None or not isinstance(wide[0].path, Curve):
        return None
    curved = replace(curved, widest=2.0 * _OF_RADIUS * wide[0].path.sharpest[0])
    found = _attached(mesh, [tool_of(curved, "probe", width_of(curved))])
    if found is None or width_of(curved) < _LEAST_WIDTH * width_of(fold):
        return None
    # As a path measures it: from point to point over the skin, where the straight tool is.
    shares = np.linspace(0.0, 1.0, len(points))[1:-1, None]
    over = [mesh.rest.foot(place)[0] for place in fold.origin + shares * (fold.target - fold.origin)]
    straight = _attached(mesh, [tool_of(replace(fold, between=np.array(over)), "probe", width_of(fold))])
    least = _least_shortening(fold, mild=False)
    if straight is not None:
        least = max(least, _AS_SHORT * _most_shortening(mesh, straight[0]))
    return (curved, found[0]) if _most_shortening(mesh, found[0]) >= least else None


def _most_shortening(mesh: MeasuredMesh, patch: Patch) -> float:
    """The greatest of all clips."""
    return max(moment.shortening for moment in deepest_moments(mesh, patch).values())


def _least_shortening(fold: Fold, *, mild: bool) -> float:
    """What a segment must lose for a tool, as a part of its length."""
    if fold.by_morph:
        return _LEAST_BY_MORPH
    return _LEAST_SHORTENING[None if mild else fold.material]


def _of_side(mesh: MeasuredMesh, driver: str, tool: str) -> str:
    """The joint or morph target of a tool's side where that of the other drives one half of a pair."""
    base, side = split_side(driver)
    wanted = split_side(tool)[1]
    every = (*mesh.rig.names, *mesh.rig.morph_names)
    named = (name for name in every if side and side != wanted and split_side(name) == (base, wanted))
    return next(named, driver)


def _attached(mesh: MeasuredMesh, tools: list[WrinkleTool]) -> list[Patch] | None:
    """Tools attached as a bake does; none where it would refuse one."""
    try:
        return attach_tools(tools, mesh.surface, mesh.rest, mesh.rig, up="y")
    except WrinkleError:
        return None


def _deepest(mesh: MeasuredMesh, patch: Patch) -> tuple[Clip, float]:
    """When a tool's anchors are nearest to each other."""
    moments = deepest_moments(mesh, patch)
    name = max(moments, key=lambda each: moments[each].shortening)
    return next(clip for clip in mesh.clips if clip.name == name), moments[name].time
