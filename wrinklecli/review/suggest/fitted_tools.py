"""Tools fitted to candidates, best first: attached and measured over all clips as a bake does, with written numbers.

A tool that lies on a better one, does not attach or hardly shortens is left out. A tool whose mirror image across x = 0
attaches too, to the same mesh or to one with the other side's name, becomes a pair.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import TypeAlias

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.choices import MAX_COMPRESSIBLE, Profile
from wrinklecli.choices import Part as PartOfBody
from wrinklecli.effects.attached import Attached
from wrinklecli.effects.effect import Part
from wrinklecli.effects.plan import kind_of
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.rays import distances_along, near_points
from wrinklecli.review.suggest.candidates import LEAST_LOSS, Candidate, Place
from wrinklecli.review.suggest.draft import across_x, decimals, pair_of, renamed, stem_and_side, tool_of, width_of
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.score import left_out_without_all
from wrinklecli.review.suggest.shortening import (
    Shortening,
    attached,
    attached_and_folded,
    greatest,
    shortenings_of,
    with_rising_bumps,
)
from wrinklecli.review.suggest.text import SLACK, Entry
from wrinklecli.review.suggest.trial import Suggested
from wrinklecli.surface.path import Curve
from wrinklecli.surface.region import Region
from wrinklecli.surface.sites import at_sites
from wrinklecli.surface.strain import unscaled_pose
from wrinklecli.surface.trace import find_segment, trace
from wrinklecli.tools.mirror import exchange_sides, split_side
from wrinklecli.tools.records import Contact, RestLengthMorph, WrinkleTool
from wrinklecli.tools.yaml_tree import printable

# Profile whose furrows are as wide as its bumps, so that they turn over last.
_WIDE_FURROWS: Profile = "smooth"
# Least shortening of a tool that a morph target drives, as a part of its length: lines of a face need less than folds.
LEAST_BY_MORPH = 0.04
# Limbs whose bare skin creases at the joint, over a length as great as the limb is thick. Cloth folds farther away.
_BARE_LIMBS: tuple[PartOfBody, ...] = ("lower arm", "hand", "lower leg", "finger", "toes")
# Greatest radius of a limb over the length or the width of its compressed region: else it is no limb.
_WIDEST = 1.5
# Greatest |v| of a place well within a patch.
_WITHIN = 0.8
# Greatest distance of such a place from the patch over the patch's length or half width.
_ABOVE = 0.5
# Parts of a tool's length at which its line may come into another tool: the fold is one then, on whatever layer. The
# outer quarters have the flanks of bumps.
_LINE = (0.25, 0.5, 0.75)
# Clips in which a tool is checked frame by frame: those that shorten it most, as measured in fewer poses.
_MOST_CLIPS = 6
# Shortening of the left tool of a pair over the right one's below which the right one is written.
_RESTS = 0.7


@dataclass(frozen=True, slots=True, kw_only=True)
class Suggestion(Suggested):
    """A tool across a compressed region; it is tallest where it is shortened most.

    Attributes:
        tool: Its definition, with numbers as they are written.
        mirrored: True if its mirror image across x = 0 is suggested too.
        span: Distance of the anchors at rest, scene units.
        clips: By the clip's name, the least distance of the anchors without animated scale, scene units; infinite if
            the character is hidden in all of the clip.
        shortening: The greatest, as a part of the span, or of the rest length if a morph target makes that longer.
        score: The region's loss 1 − σ summed over its area, scene units squared.
        others: Tools that fit the same place, tried in this order where `check` would warn of this one: straight in
            place of a path, and with wide furrows.
        twin_clip: The clip in which its mirror image shortens most; empty if that is not suggested.
        one_sided: True if no clip raises the wrinkles of its mirror image.
        crossings: Edges that pass through triangles at the place when it is folded, if `contact` may keep them apart.
    """

    tool: WrinkleTool
    mirrored: bool
    span: float
    clips: dict[str, float]
    shortening: float
    score: float
    others: "tuple[Suggestion, ...]" = ()
    twin_clip: str = ""
    one_sided: bool = False
    crossings: int = 0

    @property
    def effect(self) -> WrinkleTool:
        """The tool."""
        return self.tool

    @property
    def words(self) -> str:
        """The place in words, of the tool that is written, or the joint or the morph target that compresses it."""
        side, of_driver = split_side(self.tool.name)[1], split_side(self.driver)[1]
        # A tool of neither side lies across both, where a joint of one compresses it.
        return self._words(*(side or ("LR" if of_driver and not self.by_morph else "")))

    @property
    def words_of_both(self) -> str:
        """The place in words, of the tool and its mirror image."""
        return self._words("L", "R") if self.mirrored else self.words

    def _words(self, *sides: str) -> str:
        if self.place is not None:
            return self.place.words(*sides)
        names = sorted({self.driver, exchange_sides(self.driver)}) if len(sides) == 2 else [self.driver]
        what = f"{'morph target' if self.by_morph else 'joint'}{'s' * (len(names) == 2)}"
        return f"{what} {' and '.join(printable(name, 90) for name in names)}"

    @property
    def entry(self) -> Entry:
        """The tool as the file has it."""
        digits, words = decimals(self.span), self.words
        shortens = (
            f"shortens by {100 * self.shortening:.0f} %, from {self.span:.{digits}f} to"
            f" {self.clips[self.clip]:.{digits}f}, in clip {printable(self.clip, 90)} at {self.time:.2f} s"
        )
        if isinstance(self.tool.rest_length, RestLengthMorph):
            shortens = "its weight makes the wrinkles, as the skin in the middle hardly shortens"
        remarks = [f"{words[0].upper()}{words[1:]}: {shortens}"]
        if self.gpu_bytes:
            remarks.append(f"Up to {self.height:.2g} high, {self.gpu_bytes / 1e6:.1f} MB on a GPU after bake --split")
        if self.substance is not None:
            remarks.append(self.substance.words)
        remarks += left_out_without_all(self.judgement, self.fault)
        if self.crossings and self.tool.contact:
            remarks += ["Folded, it would pass through itself: contact keeps its sides apart, and baking takes longer"]
        elif self.crossings:
            remarks.append(
                "Folded, it passes through itself. `contact: resolve` mends that (pip install 'wrinklecli[contact]')"
            )
        if self.one_sided:
            twin = exchange_sides(self.tool.name)
            remarks.append(f"{twin}, which mirror makes, is there for other clips: none here raises it")
        return Entry(self.tool, self.mirrored, remarks, known=self.presets)

    def clips_among(self, clips: Sequence[Clip], _part: Part) -> list[Clip]:
        """The clips that shorten it most, and the one that shortens its mirror image most."""
        by_name = {clip.name: clip for clip in clips}
        names = sorted(by_name.keys() & self.clips.keys(), key=lambda name: (self.clips[name], name))
        wanted = dict.fromkeys((*names[:_MOST_CLIPS], self.twin_clip))
        return [by_name[name] for name in wanted if name in by_name]

    def crossing(self, edges: int) -> "Suggestion":
        """The same with `contact` if that is installed, as its fold passes through itself at so many edges."""
        tool = replace(self.tool, contact=Contact()) if kind_of("folds").is_installed else self.tool
        return replace(self, tool=tool, crossings=edges)

    def mended(self, compressible: float) -> "Suggestion | None":
        """The same with that `compressible`, or else the first of the others, beside which the rest may be tried."""
        if self.tool.compressible < compressible <= MAX_COMPRESSIBLE / 100.0:
            return replace(self, tool=replace(self.tool, compressible=compressible))
        if not self.others:
            return None
        first, *rest = self.others
        return replace(first, others=(*first.others, *rest))


def fit_tools(candidates: Sequence[Candidate]) -> Iterator[Suggestion]:
    """Fit tools to candidates, best first, each when it is asked for."""
    of_sides = (each.mesh for each in candidates if each.mesh.node is not None and split_side(each.mesh.node)[1])
    search = _Search({exchange_sides(mesh.node or ""): mesh for mesh in of_sides})
    placed = list[Region]()
    for candidate in sorted(candidates, key=lambda each: -each.score):
        if any(_covers(region, candidate.region.centre, candidate.region.normal) for region in placed):
            continue
        fitted = search.fitted(candidate)
        regions = [] if fitted is None else [patch.regions[0] for patch in fitted[1]]
        if fitted is None or any(_overlap(region, other, _LINE) for region in regions for other in placed):
            continue
        suggestion, patches = fitted
        placed += regions
        search = replace(search, names=search.names | {patch.tool.identifier for patch in patches})
        yield suggestion


# A suggestion for a place, with the patches of its tool and of the twin of that.
_Fitted: TypeAlias = tuple[Suggestion, list[Attached[WrinkleTool]]]


@dataclass(frozen=True, slots=True)
class _Search:
    """A search for tools among candidates.

    Attributes:
        twins: By the name of a mesh, the mesh of the other side.
        names: Identifiers that tools have already.
    """

    twins: Mapping[str, MeasuredMesh]
    names: frozenset[str] = frozenset()

    def fitted(self, candidate: Candidate) -> _Fitted | None:
        """The tool of a candidate, with its twin if it has one; None if it does not attach or shorten."""
        near = _near_joint(candidate)
        refined = None if near is None else _refined(near)
        if refined is None:
            return None
        curved = _curved(refined)
        fitted = self._fit_refined(curved)
        if curved is refined[0]:
            return fitted
        straight = self._fit_refined(refined[0])
        if fitted is None or straight is None:
            return fitted or straight
        others = (straight[0], *fitted[0].others)
        return replace(fitted[0], others=others), fitted[1]

    def _fit_refined(self, candidate: Candidate) -> _Fitted | None:
        """Fit a tool to a candidate with refined ends, as `fitted`."""
        mesh, region, driver = candidate.mesh, candidate.region, candidate.driver
        stem, side = stem_and_side(driver)
        stem = candidate.place.stem if candidate.place else stem
        # A name with a side would say that the tool is one of a pair.
        side = "" if region.on_plane else side
        choices = [[tool_of(candidate, f"{stem}.{side}" if side else stem, width_of(candidate))]]
        # `mirror` would exchange the side in the node's name too.
        if region.twin and not region.on_plane and not (mesh.node is not None and split_side(mesh.node)[1]):
            choices.insert(0, pair_of(candidate, stem, side))
        by_weight = driver if candidate.by_morph and region.on_plane else ""
        for tools in choices:
            named = renamed(tools, stem, self.names)
            found = attached_and_folded(mesh, named, _least_shortening(candidate), by_weight)
            if found is None:
                continue
            patches, shortenings = found
            if len(patches) == 2 and _overlap(patches[0].regions[0], patches[1].regions[0]):
                continue
            ratios = [greatest(each).ratio for each in shortenings]
            if ratios[0] < _RESTS * ratios[-1]:
                # The tool that the clips fold is written, and `mirror` makes the other.
                patches, shortenings = patches[::-1], shortenings[::-1]
            meshes = [mesh] * len(patches)
            other = self.twins.get(mesh.node or "") if side and len(patches) == 1 else None
            twin = other and attached(other, [across_x(patches[0].tool, exchange_sides(patches[0].tool.name))])
            if other and twin:
                meshes.append(other)
                patches, shortenings = [*patches, *twin], [*shortenings, shortenings_of(other, twin[0])]
            suggestion = suggestion_of(candidate, patches, shortenings, with_rising_bumps(patches, shortenings))
            if len(patches) == 2:
                after = greatest(shortenings[1])
                suggestion = replace(suggestion, twin_clip=after.clip.name, one_sided=100.0 * after.ratio < SLACK)
            if suggestion.tool.profile != _WIDE_FURROWS and not candidate.by_morph:
                tools = [replace(each.tool, profile=_WIDE_FURROWS) for each in patches]
                wide = [attached(each, [tool]) for each, tool in zip(meshes, tools, strict=True)]
                if all(wide):
                    tool, *_ = with_rising_bumps([patch for each in wide for patch in each or ()], shortenings)
                    suggestion = replace(suggestion, others=(replace(suggestion, tool=tool),))
            return suggestion, patches
        return None


def suggestion_of(
    candidate: Candidate,
    patches: Sequence[Attached[WrinkleTool]],
    shortenings: Sequence[dict[str, Shortening]],
    tools: Sequence[WrinkleTool],
) -> Suggestion:
    """The suggestion of a tool, or of a pair whose first one is written, with its patches and their shortenings."""
    mesh, best = candidate.mesh, greatest(shortenings[0])
    known = {each.name: getattr(candidate, each.name) for each in fields(Place)}
    if len(tools) == 2:
        other = exchange_sides(candidate.driver)
        on_other = split_side(candidate.driver)[1] != split_side(tools[0].name)[1]
        if on_other and other in (*mesh.rig.names, *mesh.rig.morph_names):
            known["driver"] = other
    return Suggestion(
        **known,
        tool=tools[0],
        mirrored=len(tools) == 2,
        mesh=mesh.rig.node_name,
        clip=best.clip.name,
        time=best.time,
        span=patches[0].span,
        clips={name: each.distance for name, each in shortenings[0].items()},
        shortening=best.ratio,
        score=candidate.score,
    )


def _covers(region: Region, place: Floats, normal: Floats) -> bool:
    """True if a place with this normal lies well within a region."""
    region = region.at_rest
    u, v = region.coordinates(place)
    height = abs(float(region.path.depths(place)))
    on = 0.0 <= u <= 1.0 and abs(v) <= _WITHIN and height < _ABOVE * max(region.span, region.half_width)
    return bool(on and region.cosines(u, normal) > 0)


def _overlap(first: Region, second: Region, parts: Sequence[float] = (0.5,)) -> bool:
    """True if the line of one region, at these parts of its length, comes well within the other."""

    def meets(one: Region, other: Region) -> bool:
        path = one.path
        along = path.length * path.directions(np.array(0.5))
        return any(_covers(other, path.middle + (part - 0.5) * along, path.normal) for part in parts)

    return meets(first, second) or meets(second, first)


def _near_joint(candidate: Candidate) -> Candidate | None:
    """A candidate that is shortened to end near its joint, as the creases of fingers, elbows and bare knees do.

    The candidate itself if there is nothing to shorten; None if no shorter one fits.
    """
    radius = _limb_radius(candidate) if candidate.part in _BARE_LIMBS and candidate.material == "skin" else None
    if radius is None:
        return candidate
    longest = 2.0 * radius
    pose = unscaled_pose(candidate.mesh.gauge, candidate.clip, candidate.time)
    region = replace(candidate.region, length=min(candidate.region.length, longest))
    found = find_segment(candidate.mesh.sites, region, [pose], longest=longest)
    return found and replace(candidate, region=region, longest=longest, origin=found[0], target=found[1])


def _limb_radius(candidate: Candidate) -> float | None:
    """Radius of the limb at the middle of a candidate, scene units; None where there is nothing opposite."""
    rest, region = candidate.mesh.rest, candidate.region
    extent = max(region.length, region.width)
    place, normal = rest.foot((candidate.origin + candidate.target) / 2.0)
    corners = rest.positions[rest.triangles]
    corners = corners[near_points(corners, place[None], 2.0 * _WIDEST * extent)]
    start = 1e-3 * extent  # beyond the triangle that the place lies on
    found = distances_along(place - start * normal, -normal, corners)
    # Clothes may have an inner side, so the opposite one is the farthest.
    found = found[np.isfinite(found) & (found < 2.0 * _WIDEST * extent)]
    return float(found.max()) / 2.0 if len(found) else None


# A candidate with refined ends; its straight tool, and that tool's greatest shortening, None if none attaches.
_Refined: TypeAlias = tuple[Candidate, Attached[WrinkleTool] | None, Shortening | None]


def _measured(candidate: Candidate) -> _Refined:
    """Attach and measure the straight tool of a candidate."""
    patch = _probe(candidate)
    return candidate, patch, None if patch is None else greatest(shortenings_of(candidate.mesh, patch))


def _refined(candidate: Candidate) -> _Refined | None:
    """A candidate whose segment fits the pose that shortens it most too; None if no tool attaches.

    The segment may be shortest in another pose than the one in which the region loses most, as a fold closes further.
    """
    mesh, refined = candidate.mesh, _measured(candidate)
    for _ in range(2):
        best = refined[2]
        if best is None:
            return None
        if best.clip is candidate.clip and best.time == candidate.time:
            break
        moments = ((candidate.clip, candidate.time), (best.clip, best.time))
        poses = [unscaled_pose(mesh.gauge, clip, time) for clip, time in moments]
        ends = find_segment(mesh.sites, candidate.region, poses, longest=candidate.longest)
        if ends is None:
            return None
        refined = _measured(replace(refined[0], origin=ends[0], target=ends[1]))
    return refined


def _curved(refined: _Refined) -> Candidate:
    """A candidate with a path along the strongest compression, if that turns on the way and a tool fits the path."""
    candidate, straight, moment = refined
    mesh, region = candidate.mesh, candidate.region
    if straight is None or moment is None or region.on_plane or candidate.part in _BARE_LIMBS:
        # A hinge bends about one axis, so its creases run straight across.
        return candidate
    tensors = at_sites(mesh.sites, moment.clip, np.array([moment.time]))[0]
    first, second = (float(np.linalg.norm(end - region.centre)) for end in (candidate.origin, candidate.target))
    points = trace(mesh.sites, region, tensors, (first, second))
    if points is None:
        return candidate
    curved = replace(candidate, origin=points[0], between=points[1:-1], target=points[-1])
    wide = _probe(curved, width_of(candidate))
    path = None if wide is None else wide.regions[0].path
    if not isinstance(path, Curve):
        return candidate
    # Beyond the radius of its sharpest bend, the flanks of a path lie on one another.
    curved = replace(curved, widest=2.0 * path.sharpest[0])
    _, patch, best = _measured(curved)
    return candidate if patch is None or best is None or best.ratio < _least_shortening(candidate) else curved


def _least_shortening(candidate: Candidate) -> float:
    """Least shortening of a candidate's tool, as a part of its length."""
    return LEAST_BY_MORPH if candidate.by_morph else LEAST_LOSS


def _probe(candidate: Candidate, width: float | None = None) -> Attached[WrinkleTool] | None:
    """The tool of a candidate, attached; None if a bake would refuse it."""
    patches = attached(candidate.mesh, [tool_of(candidate, "probe", width or width_of(candidate))])
    return patches[0] if patches else None
