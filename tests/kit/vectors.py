"""Vectors for drivers in any language: poses over time, and the weights due, of `samples/driver/vectors.json`.

    PYTHONPATH=tests python -m kit.vectors samples/driver/vectors.json

The poses are those of small bakes without tracks, and of a field whose rows are made by hand. The weights are those
that `track` gives the same clips.
"""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from kit.asset import Array, Json
from kit.bakes import bake_config, bake_once, place
from kit.fields import bake_field, sleeve_with_turns
from kit.flesh import body, region
from kit.folds import FOLDS
from kit.limb import RADIUS, limb_asset, nose, tool
from kit.muscles import arm, muscle
from kit.places import FOLDER
from kit.player import Gltf
from kit.samples import BENT, BROW, Editor
from kit.touch import SECONDS, plate, stroked, touch
from wrinklecli.baking.baked_body import BakedBody, read_bodies
from wrinklecli.baking.driven_body import DrivenBody, joints_of, present_drives, with_own_weights
from wrinklecli.character.clip import read_clips
from wrinklecli.character.pose import morph_weights, node_matrices
from wrinklecli.drive.drive import StoredDrive
from wrinklecli.drive.touch import TouchDrive
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.arrays import significant

# Differences of a weight that the file's nine digits add, some 1e-8, grow where a wrinkle starts like a square root.
EXACT = 1e-6
# A player knows a motion at its frames alone, a bake between them too. Found: 0.001 for tissue that lags and for tips,
# 0.011 for flesh.
BETWEEN_FRAMES, SWINGING = 0.003, 0.02


@dataclass(frozen=True, slots=True)
class Case:
    """A bake, and the frames of its clips at which drivers are held to it.

    Attributes:
        shows: What it covers, in words.
        make: Bakes it.
        frames: By clip, the frames of a second, and True for a loop: the rounds before the last are not compared, as
            springs of a loop are swinging already where its bake begins.
        tolerance: Of a weight.
        hand: (frames, 3) slides forward and sideways and depths of the player's own tip on the one touch, scene units,
            from (frames,) seconds; not a number while it does not touch.
        change: Applied to what the file will have: what no bake of so small an asset has.
    """

    shows: str
    make: Callable[[], Gltf]
    frames: dict[str, tuple[float, bool]]
    tolerance: float = EXACT
    hand: Callable[[Array], Array] | None = None
    change: Callable[[Json], None] | None = None


def _sample(name: str) -> Gltf:
    return bake_config(name, name, tracks="none")


def _brow(**keys: Any) -> Gltf:
    return bake_once("head", {**BROW, **keys}, tracks="none")


def _swinging() -> Gltf:
    return bake_once(place(body(keys=60)), top={"flesh": [region(limit=0.026)]}, tracks="none")


def _fold_by_two_turns() -> Gltf:
    """The rows of its clip are by a second turn, too: that of the same joint, now in the world, and not quite met."""
    made = FOLDS["one_sided"]()
    tools = [{"node": "limb", **each, "contact": "resolve"} for each in made.tools]
    editor = Editor(bake_once(place(made.asset), *tools, max_levels=1, tracks="none"))
    (entry,) = (node["extras"]["wrinkle"] for node in editor.json["nodes"] if "extras" in node)
    (fold,) = entry["folds"]
    fold["other"] = {"joint": fold["joint"], "rest": fold["rest"]}
    fold["paths_with_other"] = fold.pop("paths")
    for path in fold["paths_with_other"]:
        path["turns"] = [[*turn, *(0.92 * x for x in turn)] for turn in path["turns"]]
    return Gltf(editor.save(FOLDER / "fold_by_two_turns.glb"))


def _nose() -> Gltf:
    bridge = {"name": "bridge", "node": "skin", "origin": [-0.5, 0, 0], "target": [0.5, 0, 0], "width": 0.8, "bumps": 4}
    return bake_once(place(nose()), {**bridge, "contact": "resolve"}, max_levels=0, tracks="none")


def _travelling() -> Gltf:
    ends = {
        key: {"joint": joint, "offset": [0.15, -0.1, 0.0]}
        for key, joint in (("origin", "joint_0"), ("insertion", "joint_1"))
    }
    activation = {"keys": {"fold": [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]}}
    behind = muscle(name="triceps", **ends, travel=True, activation=activation)
    crease = tool(origin=[-0.3, RADIUS, 0.0], target=[0.3, RADIUS, 0.0], bumps=2)
    muscles = {"muscles": [behind, muscle(travel=True, activation=activation)]}
    return bake_once(arm(rings=21, sides=12), crease, top=muscles, engine="unity", tracks="none")


def _activated() -> Gltf:
    asset = arm(morphs=2, morph_clip="LINEAR", rings=21, sides=12)
    return bake_once(asset, top={"muscles": [muscle(activation={"morph": "morph_1"})]}, tracks="none")


def _unnamed() -> Gltf:
    asset = limb_asset(rings=12, sides=8, root={"scale": [2.0, 2.0, 2.0]})
    for node in asset.gltf["nodes"][1:]:
        del node["name"]
    crease = tool(origin=[-0.8, 0.5, 0.0], target=[0.8, 0.5, 0.0], clips={"fold": 0.5})
    return bake_once(place(asset), crease, tracks="none", max_levels=0)


def _sunken() -> Gltf:
    asset = limb_asset(rings=12, sides=8)
    return bake_once(place(asset), tool(bumps=1, clips={"fold": -0.5}), tracks="none", max_levels=0, engine="unity")


def _lagging() -> Gltf:
    swings = tool(bumps=3, lag={"frequency": 3, "damping": 0.3})
    stiff = tool(
        name="stiff", bumps=2, lag={"frequency": 4, "damping": 1.5}, origin=[-0.3, 0.2, 0.15], target=[0.3, 0.2, 0.15]
    )
    return bake_once(place(limb_asset(rings=12, sides=8)), swings, stiff, tracks="none", max_levels=0)


def _soft() -> Gltf:
    swings = tool(bumps=3, lag={"frequency": 1, "damping": 0.1})
    return bake_once(place(limb_asset(rings=12, sides=8)), swings, tracks="none", max_levels=0)


def _touched(tip: Array | None = None, plate_of: dict[str, Any] | None = None, **keys: Any) -> Gltf:
    return bake_once(
        place(plate(tip=tip, **(plate_of or {}))),
        top={"touches": [touch(**keys)], "refinement": {"max_levels": 0}},
        tracks="none",
    )


def _stroked() -> Gltf:
    spot = stroked(along=[[0.0, 0.0, 0.01], [0.04, 0.0, 0.0]], wrinkles={"bumps": 2, "variation": 1}, release=_CRITICAL)
    top = {"touches": [spot], "refinement": {"max_levels": 0}}
    return bake_once(place(plate(tip=_ALONG)), top=top, tracks="none")


def _touched_limb() -> Gltf:
    keys = {"fold": [[0.2, 0, 0], [0.8, 0.05, 0.02, 0.01], [1.4, -0.03, 0.04, 0.01]]}
    spots = [
        {"name": name, "at": [0.45, y, 0.0], "towards": [0.0, y, 0.0], "pad": 0.1, "reach": 0.2, "keys": keys}
        for name, y in (("inside", RADIUS), ("outside", -RADIUS))
    ]
    return bake_once(
        place(limb_asset(rings=24, sides=16)),
        top={"touches": spots, "refinement": {"max_levels": 0}},
        tracks="none",
    )


def _fold_of_one_clip() -> Gltf:
    """The bake has followed the joint's own motion; in the other clip it bends to other angles, and leans by 20°."""
    asset = limb_asset(angle=75.0, rings=16, sides=10)
    halves = np.radians([0.0, 74.0, 50.0, 90.0, 0.0]) / 2.0
    lean = np.radians(20.0)
    turns = np.stack([np.sin(halves) * np.sin(lean), 0 * halves, np.sin(halves) * np.cos(lean), np.cos(halves)], axis=1)
    other: Json = {"name": "lean"}
    asset.channel(other, 2, "rotation", np.linspace(0.0, 2.0, len(turns)), turns)
    asset.append("animations", other)
    crease = tool(bumps=2, max_height="10%", contact="resolve")
    return bake_once(place(asset), crease, max_levels=0, clips=["fold"], tracks="none")


def _tip_of_one_clip() -> Gltf:
    """The bake knows when the tip lets go in `drag`, and nothing of `other`."""
    asset = plate(tip=_WAYS)
    other: Json = {"name": "other"}
    asset.channel(other, 2, "translation", np.linspace(0.0, SECONDS, len(_PATS)), _PATS)
    asset.append("animations", other)
    top = {"touches": [touch(by="tip", keys={}, release=_CRITICAL)], "refinement": {"max_levels": 0}}
    return bake_once(place(asset), top=top, clips=["drag"], tracks="none")


def _stroke(times: Array) -> Array:
    """A finger that presses, slides beyond its grip and lets go twice."""
    turn = np.pi * times
    slides = np.stack([0.013 * np.sin(turn), 0.004 * (1.0 - np.cos(turn)), 0.004 * np.abs(np.cos(turn))], axis=1)
    return np.where(((times % 1.0 > 0.1) & (times % 1.0 < 0.6))[:, None], slides, np.nan)


def _scale(found: Json) -> None:
    """Frames in which scale hides the body."""
    (run,) = found["runs"]
    for frame in range(4, 7):
        for matrix in run["matrices"][frame]:
            matrix[:12] = [0] * 12
        assert any(run["weights"][frame])
        run["weights"][frame] = [0] * len(run["weights"][frame])


def _anew(found: Json) -> None:
    """The clip once more, in whose first frame the seconds since the last one are not known: all is at rest again."""
    (run,) = found["runs"]
    assert any(run["weights"][-1])
    run["rounds"] = 2
    run["elapsed"] = [*run["elapsed"], None, *run["elapsed"][1:]]


def _hide(found: Json) -> None:
    """Half the strength, frames in which scale hides the body, and others in which the clip has a target of its own."""
    (tool,), (run,) = found["wrinkle"]["tools"], found["runs"]
    del tool["strengths"]
    tool |= {"strength": 0.5, "own": ["own"]}
    found["morphs"] = ["own"]
    run["morphs"] = [[0.3 * (9 <= frame < 12)] for frame in range(len(run["times"]))]
    _scale(found)
    for frame in range(9, 12):
        assert run["weights"][frame][0] > 0
        run["weights"][frame] = [0]


_WAYS = np.array(
    [(-0.005, 0.03, 0), (-0.005, 0, 0), (0, -0.001, 0.003), (0.009, 0.0028, 0.005), (0.009, 0.03, 0), (0, 0.03, 0)]
)
_RUBS = np.array(
    [(-0.005, -0.001, 0), (0.009, -0.001, 0), (0, -0.001, 0.009), (-0.009, -0.001, 0), (-0.005, -0.001, 0)]
)
_STAYS = np.array([(-0.005, 0.03, 0), (-0.005, -0.001, 0), *2 * [(0.004, -0.001, 0.003)], (0.004, -0.001, -0.002)])
_PATS = np.array(
    [(0.002, 0.03, 0), (0.002, -0.002, 0), (0.002, -0.002, 0.008), (0.002, 0.03, 0.008), (-0.004, -0.001, 0.002)]
)
_ALONG = np.array(
    [(-0.045, 0.03, 0), (-0.04, 0, 0), (-0.01, -0.001, 0.01), (0.03, -0.001, 0.004), (0.05, -0.001, 0), (0.05, 0.03, 0)]
)
_CRITICAL = {"frequency": 4, "damping": 1}
_MORPH = {"morph": "browsUp", "full": "115%"}
_BUMPS = {
    "bumps": 3,
    "details": [0.3, 0.2],
    "profile": "polyline",
    "gap": 1,
    "strategy": "origin",
    "compressible": "20%",
}
_KEYED = {"keys": {"think": [[0.0, "100%"], [1.4, "118%"], [3.0, "100%"]], "raise_brows": [[0, "110%"]]}}

CASES: dict[str, Case] = {
    "wrist": Case("wrinkles, two tools", lambda: _sample("wrist"), {"flex": (8, False), "extend": (4, False)}),
    "path": Case("a path", lambda: bake_once("wrist", BENT, tracks="none"), {"flex": (8, False)}),
    "unnamed": Case("joints without names, a scaled root, strengths", _unnamed, {"fold": (8, False)}),
    "below": Case(
        "weights below 0 for an engine without such, a hidden body", _sunken, {"fold": (8, False)}, change=_scale
    ),
    "hidden": Case("a hidden body, targets of one clip, strength", _unnamed, {"fold": (8, False)}, change=_hide),
    "lag": Case("lag, below and above critical damping", _lagging, {"fold": (24, True)}, BETWEEN_FRAMES),
    "loop": Case("a loop whose spring swings for several rounds", _soft, {"fold": (30, True)}, BETWEEN_FRAMES),
    "rest_length_morph": Case(
        "anchors that a morph target moves, and a rest length that it changes; the polyline; strengths",
        lambda: _brow(**_BUMPS, rest_length=_MORPH, clips={"raise_brows": 0.5}),
        {"raise_brows": (8, False), "think": (4, False)},
    ),
    "rest_length_keys": Case(
        "a rest length with keys",
        lambda: _brow(rest_length=_KEYED, strategy="both_ends", bumps=4),
        {"raise_brows": (8, False), "think": (4, False)},
    ),
    "fold": Case("contact with paths by two turns", _fold_by_two_turns, {"bend": (12, False)}),
    "fold_of_one_clip": Case(
        "contact with paths, in a clip that was never baked, about an axis that leans",
        _fold_of_one_clip,
        {"lean": (12, False)},
    ),
    "nose": Case("contact that no joint bends", _nose, {"sneer": (12, False)}),
    "field": Case(
        "a field: two joints, one of them about two axes; strengths",
        sleeve_with_turns,
        {"fold": (8, False), "wave": (8, False)},
    ),
    "field_of_one_clip": Case(
        "a field, in a clip that was never baked",
        lambda: bake_field(clips=["fold"], tracks="none"),
        {"wave": (8, False)},
    ),
    "muscles": Case(
        "bellies that travel, activated, with weights of one sign; a tool on them", _travelling, {"fold": (12, False)}
    ),
    "activation": Case("a muscle that a morph target activates", _activated, {"fold": (8, False)}),
    "flesh": Case("flesh, on a clip that goes ahead", _swinging, {"jump": (60, True)}, SWINGING),
    "touch": Case("a touch with keys", lambda: _touched(), {"drag": (12, False)}),
    "bent": Case("touches beside a joint that bends, inside and outside", _touched_limb, {"fold": (12, False)}),
    "tip": Case(
        "a touch by a node that comes near, and lets go between two frames, just after a key",
        lambda: _touched(_WAYS, by="tip", keys={}, release=_CRITICAL),
        {"drag": (32, False)},
        BETWEEN_FRAMES,
    ),
    "tip_of_one_clip": Case(
        "a touch by a node, in a clip that was never baked",
        _tip_of_one_clip,
        {"other": (32, False)},
        BETWEEN_FRAMES,
    ),
    "anew": Case(
        "a touch by a node on a body that scale hides, which still touches as the clip is played anew from rest",
        lambda: _touched(
            _STAYS,
            by="tip",
            keys={},
            plate_of={"sizes": {0: 1, 1.125: 0, 1.375: 1}},
            release={"frequency": 20, "damping": 1},
        ),
        {"drag": (8, False)},
        BETWEEN_FRAMES,
        change=_anew,
    ),
    "rub": Case(
        "a touch by a node that never lets go, in a loop: the skin begins where it ends",
        lambda: _touched(_RUBS, by="tip", keys={}, plate_of={"turns": False}),
        {"drag": (24, True)},
        BETWEEN_FRAMES,
    ),
    "stroke": Case(
        "a touch by a node that strokes the skin along a row of places, and lets go",
        _stroked,
        {"drag": (32, False)},
        BETWEEN_FRAMES,
    ),
    "hand": Case(
        "a touch by the player, whose ways are turned from forward to the skin's curvatures",
        lambda: _touched(keys={}, plate_of={"bend": 25.0}, towards=[0.05, 0.0, 0.03]),
        {"drag": (12, False)},
        hand=_stroke,
    ),
}


def unseen_rounds(entry: Json, seconds: float) -> int:
    """The number of times that a loop is played before it is shown, as the specification has it."""
    springs = [each["lag"] for each in entry["tools"] if "lag" in each]
    springs += [mode for each in entry.get("flesh", []) for mode in each["modes"]]
    springs += [each["release"] for each in entry.get("touches", []) if "by" in each]
    # The roots of z² + 2 ζ ω z + ω² are what swings fade by.
    rates = [
        -np.roots([1.0, 4.0 * np.pi * each["damping"] * each["frequency"], (2.0 * np.pi * each["frequency"]) ** 2]).real
        for each in springs
    ]
    return int(min(max((np.ceil(np.log(1000.0) / (rate.min() * seconds)) for rate in rates), default=0), 100))


def vectors(case: Case) -> Json:
    """A case as the file has it: names of joints, of the asset's own morph targets and of driven ones, then frames."""
    document = read_document(case.make().path)
    (body,) = (each for each in read_bodies(document) if each.drives)
    node = next(number for number, each in enumerate(document.items("nodes")) if each.get("name") == body.node)
    drives, warnings = present_drives(body, document.gltf)
    assert not warnings, warnings
    driven = DrivenBody.of(document, node, body, drives)
    joints = {
        joint: named for each in drives for joint, named in zip(each.joints, _nodes(document, body, each), strict=True)
    }
    entry = dict(document.items("nodes")[node]["extras"]["wrinkle"])
    entry.pop("original", None)
    found: Json = {
        "shows": case.shows,
        "tolerance": case.tolerance,
        "wrinkle": entry,
        "joints": list(joints),
        "morphs": list(body.kept),
        "targets": list(body.driven),
        "runs": [],
    }
    clips = {clip.name: clip for clip in read_clips(document)}
    for name, (fps, loops) in case.frames.items():
        clip = with_own_weights(clips[name], node, body, body.targets)
        rounds = 1 + unseen_rounds(entry, clip.end - clip.start) if loops else 1
        once = clip.start + np.arange(int(np.ceil((clip.end - clip.start) * fps - 1e-6)) + (rounds == 1)) / fps
        steps = np.full(len(once) * rounds, 1 / fps)
        steps[0] = 0.0
        steps[len(once) :: len(once)] = clip.end - once[-1]  # where it begins anew
        hands = None if case.hand is None else case.hand(once)
        (touch,) = driven.drives if hands is not None else (None,)
        weights = (
            driven.weights_in(clip)(once)
            if hands is None
            else touch.weights_of_contacts(_let_go(touch, once, hands), touch.bends_in(driven.rig, clip, once))
        )
        matrices = (
            node_matrices(driven.rig, clip, once, joints.values()).transpose(0, 1, 3, 2).reshape(len(once), -1, 16)
        )
        morphs = morph_weights(driven.rig.own, clip, once)
        run = {
            "clip": name,
            "rounds": rounds,
            "seconds": clip.end - clip.start,
            "times": once,
            "elapsed": steps,
            "matrices": matrices,
            "morphs": morphs if body.kept else [],
            **({} if hands is None else {"hands": [None if np.isnan(each[0]) else each for each in hands]}),
            "weights": weights,
        }
        found["runs"].append({key: _stored(value) for key, value in run.items()})
    if case.change is not None:
        case.change(found)
    return found


def _let_go(touch: TouchDrive, times: Array, hands: Array) -> Array:
    """(frames, 3) slides and depths where a tip is as `hands` says, and lets go at its last frame."""
    found = hands.copy()
    for frame in np.flatnonzero(np.isnan(hands[:, 0])):
        held = np.flatnonzero(~np.isnan(hands[:frame, 0]))
        slide = hands[held[-1], :2] if held.size else np.zeros(2)
        slide = slide * min(1.0, touch.grip / max(float(np.linalg.norm(slide)), 1e-30))
        since = times[frame] - times[held[-1]] if held.size else 0.0
        cosine, sine = touch.release.decay(np.array([touch.release.speed * since]))
        found[frame] = [*(cosine + touch.release.damping * sine) * slide, 0.0]
    return found


def _nodes(document: Document, body: BakedBody, drive: StoredDrive) -> list[int]:
    named = joints_of(body, document.gltf)
    return [joint for joint in map(named.joint, drive.joints) if joint is not None]


def _stored(value: Any) -> Any:
    if isinstance(value, np.ndarray | list):
        return [_stored(each) for each in value]
    if isinstance(value, float | np.floating):
        found = significant(value) if abs(value) > 1e-12 else 0
        return int(found) if found == int(found) else found
    return value


def written() -> str:
    """The file's text: a line for each case."""
    lines = [f"{json.dumps(name)}: {json.dumps(vectors(case), separators=(',', ':'))}" for name, case in CASES.items()]
    return "{\n" + ",\n".join(lines) + "\n}\n"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(written())
