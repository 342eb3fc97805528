"""Find the moment at which each tool's wrinkles are tallest, and the facts that an artist wants to know about it."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import field

import numpy as np

from wrinklecli.baking.baked_body import read_bodies
from wrinklecli.baking.estimate import refuse_many_frames
from wrinklecli.character.anims import NamedNodes
from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.choices import FPS
from wrinklecli.drive.drive import StoredDrive, wrinkle_entry
from wrinklecli.drive.play import Playing
from wrinklecli.drive.stored import read_number, read_numbers
from wrinklecli.drive.touch import TouchDrive, TouchPlace
from wrinklecli.effects.effect import VISIBLE, MeshPlan, Part
from wrinklecli.effects.sampling import moving_clips, seen_at
from wrinklecli.errors import AssetError, TooMuchError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, determinants, median
from wrinklecli.numeric.spring import Spring
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.shown import ShownAsset, ShownPrimitive
from wrinklecli.tools.records import identifier
from wrinklecli.tools.schema import KINDS

TOOLS = "tools"
"""The list of tools files and extras with the tools that make wrinkles."""
FIELDS = "fields"
"""The list with the fields, which fold whole garments."""

# What each of the other lists does to the skin, in words before a length and after "no clip", and then how it is shown.
_ACTS = {
    TOOLS: ("", "raises it: shown at its full height"),
    "muscles": ("bulges by ", "bulges it: shown at its full height"),
    "flesh": ("moves by ", "moves it: shown at its greatest move"),
    "touches": ("moves by ", "slides it: shown at its greatest slide"),
    FIELDS: ("folds by ", "folds it: shown with all its folds at full height"),
}
# Heights of at least this part of the greatest are equal to it: the bumps are at their limit, and the greatest
# shortening is the peak.
_EQUAL = 0.999
# Number of further clips that are named.
_OTHERS = 3


@dataclass(frozen=True, slots=True)
class Fact:
    """A few words below a picture; `alarming` if something is wrong."""

    text: str
    alarming: bool = False


@dataclass(frozen=True, slots=True)
class Peak:
    """A tool, on the mesh of a node, at the moment when its wrinkles are tallest, or that moves the skin most.

    `section` is its list in the tools file, which says what kind of effect it is. If no
    clip has raised them, the moment is the stored pose, and they are shown at their full height, a touch at its
    greatest slide forward: `forward` has the weights of its targets then, by name, and is empty for others. There is
    at least one row of facts.
    """

    name: str
    node: int
    moment: Moment
    raised: bool
    facts: tuple[tuple[Fact, ...], ...]
    section: str = TOOLS
    forward: Mapping[str, float] = field(default_factory=dict)

    @property
    def slides(self) -> bool:
        """True for a touch, which slides the skin."""
        return bool(self.forward)

    def owns(self, morph_target: str) -> bool:
        """True if a bake gives this name to a target of the tool."""
        return re.fullmatch(rf"wrinkle_{re.escape(identifier(self.name))}_\d+", morph_target) is not None


def planned_peaks(plans: Sequence[MeshPlan], clips: Sequence[Clip], *, fps: float) -> list[Peak]:
    """The peaks of attached tools, at the frames of a grid and at the clips' own key times.

    Raises:
        BakeError: Clips are too long.
    """
    peaks = []
    for plan in plans:
        moving = moving_clips(plan, clips)
        refuse_many_frames(plan, moving, fps=fps)
        played = [(clip, clip_grid(clip, plan.rig, fps=fps)) for clip in moving]
        # Wrinkles are shown before what moves the body below them.
        for layer in sorted(plan.layers, key=lambda each: each.section != TOOLS):
            for part in layer.parts:
                data = part.facts(plan, "y") | {"section": layer.section, "full": part.attached.full}
                if (drag := part.attached.drag) is not None:
                    data["forward"] = _forward(
                        drag.drive.targets, [each.windows for each in drag.drive.places], drag.drive.turn
                    )
                peaks.append(_peak(data, plan.rig.node, [_row(plan, part, *each) for each in played]))
    return peaks


def _row(plan: MeshPlan, part: Part, clip: Clip, times: Floats) -> Json:
    """The facts of an effect in a clip at (frames,) seconds, with the slide and the dent of skin that is dragged."""
    data = part.facts_in(plan, seen_at(part, plan.rig, clip, times))
    if (drag := part.attached.drag) is not None:
        (contact,) = drag.drive.contacts_in(plan.rig.own, clip)(np.array([data["time"]]))
        data |= {"slide": float(np.hypot(*contact[:2])), "depth": float(contact[2])}
    return data


def _forward(targets: Sequence[str], windows: Sequence[Floats], turn: float) -> dict[str, float]:
    """The weights of a touch's targets at its greatest slide forward, by name, from the windows of each place.

    That of a row is in its middle.
    """
    rises, middle = np.array([[0.0, 0.0], [1.0, 1.0]]), (len(windows) - 1) // 2
    places = tuple(TouchPlace((), np.zeros(3), each, rises) for each in windows)
    drive = TouchDrive("", places, 1.0, 1.0, 1.0, Spring(1.0, 1.0), (), turn=turn, spacing=1.0)
    (weights,) = drive.weights_of_contacts(np.array([[1.0, 0.0, 0.0, middle]]))
    # Those of a limb's bends are 0.
    return {name: float(weight) for name, weight in zip(targets, weights, strict=False)}


def _touches_on(asset: ShownAsset, node: int) -> dict[str, dict[str, float]]:
    """The weights that `_forward` gives for each touch that was baked into a node, by name; extras may be damaged."""
    found = {}
    for data in wrinkle_entry(asset.document.items("nodes")[node]).get("touches", ()):
        with suppress(KeyError, TypeError, ValueError):
            windows = [read_numbers(each["windows"], -1) for each in (data, *data.get("row", ()))]
            turn = read_number(data.get("turn", 0.0))
            found[str(data["name"])] = _forward(data["targets"], windows, turn)
    return found


def baked_peaks(asset: ShownAsset, clips: Sequence[Clip]) -> list[Peak]:
    """The peaks of the tools that were baked into an asset, by its weight tracks in these clips."""
    driven = _driven_tools(asset)
    peaks = []
    for node, shown in asset.wrinkled.items():
        rigs = {each.source.rig.node: each.source.rig for each in shown}
        rig = rigs.get(node, shown[0].source.rig)
        scale = float(median(np.cbrt(np.abs(determinants(joint_matrices(rig, None, np.zeros(1))[0, :, :3, :3])))))
        tracked = [clip for clip in clips if clip.channel(node, "weights") is not None]
        grids = [clip_grid(clip, rig, fps=FPS) for clip in tracked]
        played = list(zip(tracked, grids, strict=True))
        weights = [{part: _seen(morph_weights(each, *clip)) for part, each in rigs.items()} for clip in played]
        touches = _touches_on(asset, node)
        for section, name, targets in _tools_on(asset, node, rigs.values()):
            reaches = [(each, *_reaches(each, targets)) for each in shown]
            heights = [_heights(of, reaches, scale) for of in weights]
            found = []
            top = _EQUAL * max((float(each.max(initial=0.0)) for each in heights), default=0.0)
            for (clip, times), each in zip(played, heights, strict=True):
                data: Json = {"name": clip.name, "height": float(each.max()), "time": float(times[np.argmax(each)])}
                if (node, name) in driven and data["height"] >= top > 0:
                    data |= _shortening(driven[node, name], asset, rig, clip, times[each >= top])
                found.append(data)
            data = {"name": name, "section": section}
            if (node, name) in driven:
                data["rest_length"] = float(driven[node, name].data["rest_length"])
            if name in touches:
                data["forward"] = touches[name]
            peaks.append(_peak(data, node, found))
    return peaks


def baked_tool_count(document: Document) -> int:
    """The number of tools, muscles and regions that were baked into an asset, by its extras."""
    lists = [wrinkle_entry(node).get(section) for node in document.items("nodes") for section in KINDS]
    return sum(len(each) for each in lists if isinstance(each, list))


def baked_peaks_of(asset: ShownAsset, names: Sequence[str], clips: Sequence[Clip]) -> list[Peak]:
    """The `baked_peaks` of the named tools; of all without names.

    Raises:
        AssetError: There is no such tool, or no wrinkle at all.
    """
    peaks, where = baked_peaks(asset, clips), asset.document.path
    if not peaks:
        raise AssetError("has no wrinkles to show", where=where)
    known = [peak.name for peak in peaks]
    AssetError.unless_known("has no tool", names, known, where=where)
    return [peak for peak in peaks if not names or peak.name in names]


def _driven_tools(asset: ShownAsset) -> dict[tuple[int, str], StoredDrive]:
    """The tools whose anchors are in the extras, by node and name; none if a bake did not write the extras."""
    nodes = asset.document.items("nodes")
    try:
        bodies = read_bodies(asset.document)
    except (AssetError, TooMuchError):
        return {}
    names = [str(node.get("name", "")) for node in nodes]
    found: dict[tuple[int, str], StoredDrive] = {}
    for node in asset.wrinkled:
        for body in bodies:
            if body.node == names[node] and not body.ambiguous:
                there = (each for each in body.drives if each.measures_segment and set(each.joints) <= set(names))
                found |= {(node, each.name): each for each in there}
    return found


def _tools_on(asset: ShownAsset, node: int, rigs: Iterable[Rig]) -> Iterator[tuple[str, str, list[str]]]:
    """The list, the name, and the names of morph targets in these rigs, of each tool that was baked into a node."""
    there = {name for rig in rigs for name in rig.morph_names}
    entry = wrinkle_entry(asset.document.items("nodes")[node])
    for section, tool in ((key, each) for key in KINDS for each in entry.get(key, ())):
        targets = [name for name in tool["targets"] if name in there]
        if targets:
            yield section, str(tool.get("name")), targets
    undriven: dict[str, list[str]] = {}
    for name in entry.get("undriven", ()):
        found = re.fullmatch(r"wrinkle_(.*)_\d+", name) if name in there else None
        if found:
            undriven.setdefault(found[1], []).append(name)
    yield from ((TOOLS, name, targets) for name, targets in undriven.items())


def _seen(weights: Floats) -> Floats:
    """The weights, 0 in place of those that are rounding errors or too small to be seen."""
    return np.where(np.abs(weights) < VISIBLE, 0.0, weights)


def _heights(
    weights: Mapping[int, Floats], reaches: Sequence[tuple[ShownPrimitive, Ints, Floats]], scale: float
) -> Floats:
    """(frames,) greatest displacement by targets of a tool, scene units; weights are (frames, targets) by node."""
    of_primitives = [
        scale
        * np.linalg.norm(np.einsum("ft,tvx->fvx", weights[shown.source.rig.node][:, columns], moves), axis=2).max(
            axis=1, initial=0.0
        )
        for shown, columns, moves in reaches
    ]
    return np.asarray(np.max(of_primitives, axis=0))


def _reaches(shown: ShownPrimitive, targets: Sequence[str]) -> tuple[Ints, Floats]:
    """(found,) numbers of morph targets on a primitive, and (found, found, 3) moves at their crests, bind units.

    A crest is the vertex that a target moves furthest; others may move it, too.
    """
    names = shown.source.rig.morph_names
    rows = [row for row, number in enumerate(shown.shape_numbers.tolist()) if names[number] in targets]
    crests = np.sum(shown.shapes[rows] ** 2, axis=2).argmax(axis=1)
    return shown.shape_numbers[rows], shown.shapes[rows][:, crests]


def _shortening(drive: StoredDrive, asset: ShownAsset, rig: Rig, clip: Clip, times: Floats) -> Json:
    """The time, of (frames,) times of a clip, at which a tool is shortest, and its shortening over the rest length."""
    nodes = NamedNodes.of_body(asset.document.gltf, rig.node, skinned=rig.skinned)
    joints = {name: joint for name in drive.joints if (joint := nodes.joint(name)) is not None}
    found = drive.on(joints, rig.morph_names)
    (lengths,) = Playing([found], rig, clip).read(times)
    if not lengths.active.any():
        return {}
    most = int(np.argmax(np.where(lengths.active, lengths.rows, -np.inf)))
    return {"shortening": [float(lengths.rows.min()), float(lengths.rows[most])], "time": float(times[most])}


def _peak(data: Json, node: int, clips: Sequence[Json]) -> Peak:
    """The peak of a tool on a node; `data` and `clips` have the keys of `check`, as far as they are known."""
    best = tallest_clip(clips)
    moment = Moment(None, 0.0) if best is None else Moment(best["name"], best["time"])
    further = [row for row in (tuple(_patch_facts(data)), tuple(_clip_facts(best, clips))) if row]
    rows = (tuple(_peak_facts(data, best)), *further)
    return Peak(data["name"], node, moment, best is not None, rows, data["section"], data.get("forward", {}))


def tallest_clip(clips: Sequence[Json]) -> Json | None:
    """The clip, with the keys of `check`, in which a tool is tallest; of equal ones that with the greatest shortening.

    None if no clip raises the tool.
    """
    tallest = max((each["height"] for each in clips), default=0.0)
    return max((each for each in clips if each["height"] >= _EQUAL * tallest > 0), key=_shortest, default=None)


def _shortest(clip: Json) -> float:
    """The greatest shortening of a clip, over the rest length; -1 if unknown."""
    return float((clip.get("shortening") or (-1.0, -1.0))[1])


def _peak_facts(data: Json, best: Json | None) -> Iterator[Fact]:
    """The facts of a tool at its peak."""
    moves, not_moved = _ACTS[data["section"]]
    if best is None:
        yield Fact(f"no clip {not_moved}", alarming=True)
        return
    if _shortest(best) > 0:
        yield Fact(f"{_percent(_shortest(best))} shorter")
    if "slide" in best:
        yield Fact(f"slides by {best['slide']:.3g}")
        if best["depth"] > 0:
            yield Fact(f"dented by {best['depth']:.3g}")
        return
    limit = f" of {data['height_limit']:.3g}" if "height_limit" in data else ""
    yield Fact(f"{moves}{best['height']:.3g}" if moves else f"{best['height']:.3g}{limit} tall")
    if "full" in data and data["full"] < _EQUAL * _shortest(best):
        yield Fact(f"full from {_percent(data['full'])}")
    if best.get("unabsorbed", 0.0) > VISIBLE:
        yield Fact(f"{_percent(best['unabsorbed'])} not absorbed", alarming=True)


def _patch_facts(data: Json) -> Iterator[Fact]:
    """The facts of a tool on its mesh."""
    if "bumps" in data:
        yield Fact(f"{data['bumps']} bump{'s' * (data['bumps'] != 1)}, {data['strategy']}")
    if "width" in data:
        yield Fact(f"{data['distance']:.3g} long, {data['width']:.3g} wide")
    elif "rest_length" in data:
        yield Fact(f"rest length {data['rest_length']:.3g}")
    if "triangles" in data:
        yield Fact(f"{data['triangles']:,} triangles + {data['edges_split']:,} vertices")


def _clip_facts(best: Json | None, clips: Sequence[Json]) -> Iterator[Fact]:
    """The shortenings of a tool in other clips."""
    found = sorted((each for each in clips if each is not best and _shortest(each) > VISIBLE), key=_shortest)[::-1]
    if found:
        more = f" and {len(found) - _OTHERS} more" if len(found) > _OTHERS else ""
        yield Fact(
            "also " + ", ".join(f"{each['name']} {_percent(_shortest(each))}" for each in found[:_OTHERS]) + more
        )


def _percent(share: float) -> str:
    return f"{100 * share:.2g} %" if share < 0.1 else f"{100 * share:.0f} %"
