"""Tools suggested for an asset: segments across the folds of its clips, in a file that bakes as it is.

Folds are ranked by what they lose, area times loss. From the best on, tools are attached and measured over all clips as
a bake does, their numbers rounded as they are written; a tool that lies on a better one, does not attach or hardly
shortens is left out, and one whose mirror image across x = 0 shortens too becomes a pair.
"""

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.character.clip import Clip, chosen_clips, read_clips
from wrinklecli.character.rig import morph_target_names, moving_nodes, read_rig
from wrinklecli.character.scene import scene_nodes
from wrinklecli.character.surface import read_surface
from wrinklecli.errors import AssetError, BakeError, WrinkleError, listed, nearest
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.method.activity import lengths_over_time
from wrinklecli.method.patch import Patch, attach_tools
from wrinklecli.method.rest import rest_pose
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import Progress, guarded, no_progress
from wrinklecli.review.suggest.folds import LEAST_LOSS, Fold, MeasuredMesh, driver_of, find_folds, lay, pose_unscaled
from wrinklecli.review.suggest.strain import read_gauge, scan, spread_sites
from wrinklecli.tools.mirror import split_side
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import Length, ToolsFile, WrinkleTool
from wrinklecli.tools.yaml_tree import printable

# Poses of a clip, at most: what compresses does so for longer than the 200th part of a clip.
_MOST_POSES = 200
# Triangles times poses of all clips and meshes: about five seconds. Beyond it, poses lie further apart ...
_MOST_WORK = 6_000_000
# ... but a clip has this many at least.
_FEWEST_POSES = 9
# Triangles times poses that are refused: minutes.
_TOO_MUCH_WORK = 200_000_000
# Of the best suggestion's score: less is not worth a tool.
_LEAST_SCORE = 0.02


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
        time: When, seconds.
        span: Distance of the anchors at rest, scene units.
        clips: Of each clip, the least distance of the anchors with animated scale taken out, scene units; infinite
            where the character is hidden in all of it.
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
    score: float

    @property
    def shortening(self) -> float:
        """The greatest shortening, as a part of the span."""
        return 1.0 - self.clips[self.clip] / self.span

    @property
    def rest_length(self) -> str:
        """The tool's, as it is written."""
        return f"{100 - _SLACK}%"


@dataclass(frozen=True, slots=True)
class Suggestions:
    """What was found in an asset.

    Attributes:
        tools: Best first; may be none.
        text: A tools file of them; empty where there are none.
        reason: Why there are none; empty where there are some.
        notes: What was left out, a line each.
        inputs: Every file that was read.
    """

    tools: tuple[Suggestion, ...]
    text: str
    reason: str
    notes: tuple[str, ...]
    inputs: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Carrier:
    """A node whose mesh deforms; its name as a tools file must write it, if it must."""

    index: int
    node: str | None


def suggest(
    asset: str | os.PathLike[str],
    *,
    clips: Sequence[str] = (),
    count: int = 8,
    node: str | None = None,
    fps: float = 30.0,
    allow_external: bool = False,
    progress: Progress = no_progress,
) -> Suggestions:
    """Find where clips compress an asset's surfaces, and lay tools there.

    Args:
        asset: The .gltf or .glb to read.
        clips: Names of the clips to look at; all where left out.
        count: Suggestions at most; a pair counts as one.
        node: Name of the node whose mesh to look at; all that deform where left out.
        fps: Poses a second; of a clip at most 200, evenly spaced, and fewer where mesh and clips are large.
        allow_external: Read buffers outside the asset's folder too.
        progress: Called with a stage's name, steps done and steps in all.

    Raises:
        AssetError: The asset is at fault, or already carries wrinkles; it has no such clip or node.
        BakeError: Mesh and clips are too large to measure.
    """
    with guarded(os.fspath(asset)):
        document = read_document(asset, allow_external=allow_external)
        chosen = chosen_clips(read_clips(document), clips, where=document.path)
        notes: list[str] = []
        carriers = _carriers(document, node, notes)
        reason = ""
        folds: list[Fold] = []
        if not carriers:
            reason = "no mesh deforms: none has a skin or morph targets"
        elif not chosen:
            reason = "it has no clip, so nothing moves"
        else:
            meshes = _measured(document, carriers, chosen, fps, progress)
            if not meshes:
                reason = "no clip moves a mesh that deforms"
            for number, mesh in enumerate(meshes):

                def shown(share: float, number: int = number) -> None:
                    progress("laying", round(100 * (number + share)), 100 * len(meshes))

                folds += find_folds(mesh, shown)
        found = _chosen(folds, count)
        if not found and not reason:
            reason = f"no clip compresses the surface by more than {100 * LEAST_LOSS:g} % anywhere that a tool fits"
        text = ""
        if found:
            text = tools_text(found, os.path.basename(document.path), flat=all(fold.mesh.flat for fold in folds))
            _refuse_unwritable(text, document, found)
        return Suggestions(tuple(found), text, reason, tuple(notes), tuple(document.files))


def _carriers(document: Document, asked: str | None, notes: list[str]) -> list[_Carrier]:
    """The nodes of the scene whose meshes deform, or the one asked for.

    Raises:
        AssetError: There is no such node, or a node carries wrinkles of an earlier bake.
    """
    nodes = document.items("nodes")
    deforming = []
    for index, carrier in enumerate(nodes):
        if "mesh" in carrier:
            mesh = document.item("meshes", carrier["mesh"], user=document.where("nodes", index))
            if "skin" in carrier or morph_target_names(mesh):
                deforming.append(index)
    names = [nodes[index].get("name") for index in deforming]
    if asked is not None and names.count(asked) != 1:
        known = [str(name) for name in names]
        fault = f"{asked!r} is no node with a mesh that deforms{nearest(asked, known)}; there are {listed(known)}"
        if asked in names:
            fault = f"{names.count(asked)} nodes with a mesh that deforms are named {asked!r}"
        raise AssetError(fault, where=document.path)
    shown = set(scene_nodes(document))
    found = []
    for index, name in zip(deforming, names, strict=True):
        if name != asked if asked is not None else index not in shown:
            continue
        extras = nodes[index].get("extras")
        if isinstance(extras, dict) and "wrinkle" in extras:
            raise AssetError(
                "already carries wrinkles of an earlier bake; ask for suggestions on the original asset",
                where=document.where("nodes", index, "extras", "wrinkle"),
            )
        if len(deforming) > 1 and (not isinstance(name, str) or not name or names.count(name) > 1):
            where = document.where("nodes", index)
            notes.append(f"{where}: left out, as it has no name of its own by which a tool could say where it is")
            continue
        found.append(_Carrier(index, name if len(deforming) > 1 else None))
    return found


def _measured(
    document: Document, carriers: list[_Carrier], clips: tuple[Clip, ...], fps: float, progress: Progress
) -> list[MeasuredMesh]:
    """The meshes that clips move, measured.

    Raises:
        BakeError: It would take minutes.
    """
    parts = []
    for carrier in carriers:
        rig = read_rig(document, carrier.index)
        moving = moving_nodes(rig)
        its_clips = tuple(clip for clip in clips if any(channel.node in moving for channel in clip.channels))
        if its_clips:
            parts.append((carrier, rig, read_surface(document, rig), its_clips))
    wanted = {clip.index: min(_MOST_POSES, (clip.end - clip.start) * fps + 1.0) for clip in clips}
    work = sum(len(surface.triangles) * wanted[clip.index] for _, _, surface, its in parts for clip in its)
    thinner = min(1.0, _MOST_WORK / max(work, 1.0))
    counts = {index: max(min(_FEWEST_POSES, round(n)), math.floor(thinner * n), 1) for index, n in wanted.items()}
    work = sum(len(surface.triangles) * counts[clip.index] for _, _, surface, its in parts for clip in its)
    if work > _TOO_MUCH_WORK:
        raise BakeError(
            f"has {work:.3g} triangles times poses to measure; at once {_TOO_MUCH_WORK:,} may be: use --clip or --node",
            where=document.path,
        )
    total = sum(counts[clip.index] for _, _, _, its in parts for clip in its)
    meshes: list[MeasuredMesh] = []
    before = 0
    for carrier, rig, surface, its in parts:
        rest = rest_pose(surface, rig, ToolsFile(path=document.path, tools=()), clips, [])
        gauge = read_gauge(surface, rest, rig)
        if not len(gauge.triangles):
            continue
        sites = spread_sites(gauge)
        times = tuple(np.linspace(clip.start, clip.end, counts[clip.index]) for clip in its)

        def shown(done: int, before: int = before) -> None:
            progress("posing", before + done, total)

        peaks = scan(gauge, sites, its, times, shown)
        before += len(peaks.times)
        primitives = document.items("meshes")[rig.mesh]["primitives"]
        flat = not any("NORMAL" in primitive["attributes"] for primitive in primitives)
        meshes.append(MeasuredMesh(rig, surface, rest, gauge, sites, its, times, peaks, carrier.node, flat))
    return meshes


# --- Regions, and segments across them ---


# --- Tools of segments ---

_SETTINGS = ToolsFile(path="", tools=())
# A bump is this part of the patch's width: wrinkles are several times as long as they are wide.
_BUMP_OF_WIDTH = 0.18
_FEWEST_BUMPS, _MOST_BUMPS = 4, 6
# The profile across is at half its height at half the width, which is where the region ends.
_WIDTH_OF_REGION = 1.4
# A twin must shorten by this part of what its original does.
_TWIN_SHORTENING = 0.5
# Slack before the first wrinkle: clips rarely come back to the stored pose, and 1 % already shows.
_SLACK = 5


def _chosen(folds: list[Fold], count: int) -> list[Suggestion]:
    """The best folds as tools, best first; lop-sided ones only where there is no other."""
    return _ranked(folds, count, lopsided=False) or _ranked(folds, count, lopsided=True)


def _ranked(folds: list[Fold], count: int, *, lopsided: bool) -> list[Suggestion]:
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
        made = _made(fold, names, sizes, lopsided=lopsided)
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
    height = abs(float((place - patch.origin.position) @ patch.normal))
    on = 0.0 <= u <= 1.0 and abs(v) <= 0.8 and height < 0.5 * max(patch.span, patch.half_width)
    return bool(on and patch.normal @ normal > 0)


def _overlap(first: Patch, second: Patch) -> bool:
    """Whether the middle of one patch lies on the other."""
    middles = [(each.origin.position + each.target.position) / 2.0 for each in (first, second)]
    return _covers(second, middles[0], first.normal) or _covers(first, middles[1], second.normal)


def _made(
    fold: Fold, names: set[str], sizes: dict[tuple[int, str], float], *, lopsided: bool
) -> tuple[Suggestion, list[Patch]] | None:
    """A tool of a fold, with its twin if it has one; none where it does not attach or shorten.

    Args:
        fold: Where.
        names: Identifiers that are taken.
        sizes: By node and driver, the width of a bump, scene units.
        lopsided: Whether to take a fold alone that is one of a pair, but would lie on its twin.
    """
    mesh, region = fold.mesh, fold.region
    apart = 2.0 * abs(float(region.centre[0])) > 0.5 * min(region.length, region.width)
    if region.twin and not (apart or region.on_plane or lopsided):
        return None
    # Where the region loses most its segment need not be shortest: a fold closes further.
    for _ in range(2):
        first = _attached(mesh, [_tool(fold, "probe", _WIDTH_OF_REGION * region.width)])
        if first is None:
            return None
        clip, time = _deepest(mesh, first[0])
        if clip is fold.clip and time == fold.time:
            break
        ends = lay(mesh, region, [pose_unscaled(mesh, fold.clip, fold.time), pose_unscaled(mesh, clip, time)])
        if ends is None:
            return None
        fold = replace(fold, origin=ends[0], target=ends[1])
    driver, by_morph = driver_of(fold)
    base, side = split_side(driver.rsplit(":", 1)[-1])
    base = "_".join("".join(c if c.isascii() and c.isalnum() else " " for c in base).split()) or "fold"
    size = sizes.get((mesh.rig.node, driver))
    options = []
    # `mirror` would exchange the side in the node's name too.
    if region.twin and apart and not (mesh.node is not None and split_side(mesh.node)[1]):
        options.append(_pair(fold, base, side, size))
    options.append([_tool(fold, f"{base}.{side}" if side else base, _WIDTH_OF_REGION * region.width, size)])
    for tools in options:
        named, number = tools, 1
        while any(tool.identifier in names for tool in named):
            number += 1
            named = [replace(tool, name=f"{base}_{number}{tool.name[len(base) :]}") for tool in tools]
        patches = _attached(mesh, named)
        if patches is None:
            continue
        if len(patches) == 2 and _overlap(*patches):
            if lopsided:
                continue
            return None
        lengths = [_shortest(mesh, patch) for patch in patches]
        shares = [1.0 - min(each.values())[0] / patch.span for each, patch in zip(lengths, patches, strict=True)]
        if min(shares) < max(LEAST_LOSS, _TWIN_SHORTENING * max(shares)):
            continue
        best = min(lengths[0], key=lambda name: lengths[0][name])
        suggestion = Suggestion(
            tool=named[0],
            mirrored=len(named) == 2,
            mesh=mesh.rig.names[mesh.rig.node],
            driver=_left(mesh, driver) if len(named) == 2 else driver,
            by_morph=by_morph,
            clip=best,
            time=lengths[0][best][1],
            span=patches[0].span,
            clips={name: length for name, (length, _) in lengths[0].items()},
            score=fold.score,
        )
        return suggestion, patches
    return None


def _left(mesh: MeasuredMesh, driver: str) -> str:
    """The joint of the left side where the right side's drives one half of a pair."""
    base, side = split_side(driver)
    named = (name for name in mesh.rig.names if side == "R" and split_side(name) == (base, "L"))
    return next(named, driver)


def _attached(mesh: MeasuredMesh, tools: list[WrinkleTool]) -> list[Patch] | None:
    """Tools attached as a bake does; none where it would refuse one."""
    try:
        return attach_tools(tools, mesh.surface, mesh.rest, mesh.rig, _SETTINGS, mesh.clips)
    except WrinkleError:
        return None


def _pair(fold: Fold, base: str, side: str, size: float | None) -> list[WrinkleTool]:
    """The tools of a fold on either side of x = 0, the left one first: on the side of x > 0, or as joints say."""
    region = fold.region
    width = _WIDTH_OF_REGION * region.width
    across = abs(float(np.cross(region.normal, region.along)[0]))
    if across > 0.5:
        # Two bells whose middles are half a width apart add up to an even height between them.
        width = min(width, 4.0 * abs(float(region.centre[0])) / across)
    here = _tool(fold, f"{base}.L", width, size)
    if (side or ("L" if region.centre[0] > 0 else "R")) == "R":
        here = _across(here, here.name)
    return [here, _across(here, f"{base}.R")]


def _deepest(mesh: MeasuredMesh, patch: Patch) -> tuple[Clip, float]:
    """When a tool's anchors are nearest to each other."""
    lengths = _shortest(mesh, patch)
    name = min(lengths, key=lambda each: lengths[each])
    return next(clip for clip in mesh.clips if clip.name == name), lengths[name][1]


def _across(tool: WrinkleTool, name: str) -> WrinkleTool:
    """A tool's mirror image across x = 0."""
    (a, b, c), (d, e, f) = _place(tool.origin), _place(tool.target)
    return replace(tool, name=name, origin=(0.0 - a, b, c), target=(0.0 - d, e, f))


def _place(anchor: object) -> tuple[float, float, float]:
    assert isinstance(anchor, tuple)
    return anchor


def _tool(fold: Fold, name: str, width: float, size: float | None = None) -> WrinkleTool:
    """A tool in the numbers that are written."""
    # Downwards, or along x or z, whichever way the direction was found.
    axis = int(np.argmax(np.abs(fold.target - fold.origin)))
    ends = sorted((fold.origin, fold.target), key=lambda end: float(end[axis]), reverse=axis == 1)
    span = float(np.linalg.norm(ends[1] - ends[0]))
    origin, target = ([round(float(x), _decimals(span)) + 0.0 for x in end] for end in ends)
    natural = _BUMP_OF_WIDTH * width
    bumps = round(span / (size if size is not None and natural / 1.5 < size < 1.5 * natural else natural))
    return WrinkleTool(
        name=name,
        node=fold.mesh.node,
        origin=(origin[0], origin[1], origin[2]),
        target=(target[0], target[1], target[2]),
        width=Length(round(width, 1 - math.floor(math.log10(width)))),
        strategy="both_ends",
        bumps=min(max(bumps, _FEWEST_BUMPS), _MOST_BUMPS),
        rest_length=Length(100.0 - _SLACK, percent=True),
    )


def _decimals(span: float) -> int:
    """Decimals of a position: a hundredth of the span, or less."""
    return max(2 - math.floor(math.log10(span)), 0)


def _shortest(mesh: MeasuredMesh, patch: Patch) -> dict[str, tuple[float, float]]:
    """Of each clip the least distance of a tool's anchors, scene units, and when, seconds."""
    found = {}
    for clip, times in zip(mesh.clips, mesh.times, strict=True):
        distances, _ = lengths_over_time(patch, mesh.rig, mesh.rest, clip, times)
        best = int(distances.argmin())
        found[clip.name] = float(distances[best]), float(times[best])
    return found


# --- What a region's bending is about ---

# --- The file ---


def tools_text(suggestions: Sequence[Suggestion], asset: str, *, flat: bool = False) -> str:
    """A commented tools file.

    Args:
        suggestions: At least one.
        asset: What the comments call the asset.
        flat: Whether meshes are shaded flat, so that refinement should keep their faces.
    """
    lines = [
        f"# Tools for {printable(asset, 90)}, as `wrinkle suggest` found them, best first.",
        "#",
        "# Each is a segment across the folds that a clip makes: its ends come closer, and the lost length comes back",
        "# as bumps. Positions are those of the stored pose, in scene units, Y up. The file is made to be edited: move",
        "# the ends, try other widths and numbers of bumps, delete what you do not want.",
        "version: 1",
        "",
        *(["refinement: {scheme: midpoint}   # keeps the flat faces of a mesh without normals", ""] if flat else []),
        "defaults:",
        f"  rest_length: {100 - _SLACK}%     # slack: the first {_SLACK} % of shortening make no wrinkles",
        "  max_height: auto     # a quarter of a bump's width; deep folds take more, in scene units or per cent",
        "",
        "tools:",
    ]
    for each in suggestions:
        tool = each.tool
        digits = _decimals(each.span)
        what = "Morph target" if each.by_morph else "Joint"
        lines += [
            f"  # {what} {printable(each.driver, 90)}: shortens by {100 * each.shortening:.0f} %,"
            f" from {each.span:.{digits}f} to {each.clips[each.clip]:.{digits}f},"
            f" in clip {printable(each.clip, 90)} at {each.time:.2f} s",
            f"  - name: {tool.name}",
            *([f"    node: {_quoted(tool.node)}"] if tool.node is not None else []),
            f"    origin: {_written(tool.origin, digits)}",
            f"    target: {_written(tool.target, digits)}",
            *(["    mirror: x"] if each.mirrored else []),
            f"    width: {tool.width.value:.12g}",
            f"    strategy: {tool.strategy}",
            f"    bumps: {tool.bumps}",
            "",
        ]
    return "\n".join(lines[:-1]) + "\n"


def _written(anchor: object, digits: int) -> str:
    return f"[{', '.join(f'{x:.{digits}f}' for x in _place(anchor))}]"


def _quoted(name: str) -> str:
    """A name as YAML text in double quotes, whatever it holds."""
    escaped = name.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'


def _refuse_unwritable(text: str, document: Document, suggestions: Sequence[Suggestion]) -> None:
    """Check that the file says what was measured.

    Raises:
        AssetError: The asset's lengths are beyond what a tools file takes.
    """
    try:
        read = parse_tools(text).tools
    except WrinkleError as error:
        raise AssetError(f"cannot be described by a tools file: {error.lines[0]}", where=document.path) from error
    kept = {tool.name: tool for tool in read}
    for each in suggestions:
        assert kept[each.tool.name] == replace(each.tool, where=kept[each.tool.name].where), each.tool.name
