"""The sample driver: it gives clips that were never baked the weights that baking gives them."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from runpy import run_path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import binary_erosion, gaussian_filter

from kit.asset import Asset
from kit.bakes import COARSE, bake_config, bake_fold, bake_once, baked, folding_limb, place, report_of
from kit.browser import browsing, serving
from kit.clients import clip_tracks, drive, driver_warnings, gltfpack, optimize
from kit.fields import bake_field
from kit.folds import FOLDS
from kit.limb import limb_asset, nose, waving_limb
from kit.limb import tool as crease
from kit.places import ROOT
from kit.player import Gltf, Json
from kit.samples import BENT, BROW, Editor, config, edited, sample
from kit.touch import plate, touch
from wrinklecli import maps
from wrinklecli.baking.baked_body import read_bodies
from wrinklecli.baking.track import track
from wrinklecli.character.clip import KEY_GAP, read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.drive.table import TABLE_ERROR, Table
from wrinklecli.effects.sampling import KEYS_SHARE
from wrinklecli.gltf.document import read_document

# The table's own straight lines, those of keys that a track leaves out, and what eight digits and float32 add where a
# height starts.
TABLE = TABLE_ERROR + KEYS_SHARE * 0.01 + 1e-3


def test_the_sample_is_small() -> None:
    """What every player needs, and each file of what lag and contact need besides."""
    lines = {path.name: len(path.read_text().splitlines()) for path in (ROOT / "samples" / "driver").glob("*.[jh]*")}
    assert lines["driver.js"] + lines["index.html"] < 200
    small = ("anchor", "fold", "joints", "muscle", "path", "polyline", "spring", "swing")
    assert max(lines[f"{name}.js"] for name in small) < 60


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("name", "config", "clip"),
    [
        ("wrist", "wrist", "flex"),
        ("wrist", "wrist", "extend"),
        ("trousers", "trousers", "squat"),
        ("trousers", "trousers", "walk"),
        ("head", "head", "raise_brows"),
    ],
)
def test_a_driven_clip_looks_as_if_it_were_baked(name: str, config: str, clip: str) -> None:
    bare, whole = bake_config(name, config, tracks="none"), bake_config(name, config)
    assert_driven(bare, whole, name, clip)


@pytest.mark.slow
def test_a_path_is_driven_as_it_was_baked() -> None:
    bare, whole = (bake_once("wrist", BENT, tracks=tracks) for tracks in ("none", "all"))
    (tool,) = whole.json["nodes"][whole.node("wrist")]["extras"]["wrinkle"]["tools"]
    assert (len(tool["anchors"]), tool.get("origin"), tool.get("target")) == (4, None, None)
    assert_driven(bare, whole, "wrist", "flex")


@pytest.mark.slow
def test_a_tool_of_one_clip_is_driven_in_that_clip_alone() -> None:
    for clip in ("raise_brows", "think"):
        tool = {**BROW, "strength": 0, "clips": {clip: 0.5}}
        bare, whole = (bake_once("head", tool, tracks=tracks) for tracks in ("none", "all"))
        assert_driven(bare, whole, "head", "raise_brows")


def assert_driven(bare: Gltf, whole: Gltf, node: str, clip: str, tolerance: float = TABLE) -> None:
    """The driver's weights on one file are the tracks of another, at their keys, in shares of each tool's tallest."""
    times, values = whole.keys(clip, node)
    names = whole.mesh(node)["extras"]["targetNames"]
    driven = drive(bare.path, node=node, clip=clip, times=times.tolist(), driver=True)
    assert set(driven) == set(names)
    heights = np.sqrt(np.sum(whole.deltas(node) ** 2, axis=2)).max(axis=1)
    tools = whole.json["nodes"][whole.node(node)]["extras"]["wrinkle"]["tools"]
    assert tools
    for tool in tools:
        columns = [names.index(name) for name in tool["targets"]]
        for k, share in zip(columns, heights[columns] / heights[columns].max(), strict=True):
            error = share * np.abs(driven[names[k]] - values[:, [k]])
            assert error.max() < tolerance, (names[k], times[error.max(axis=1).argmax()], error.max())


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize(("name", "clip"), [("wrist", "extend"), ("trousers", "squat"), ("head", "raise_brows")])
def test_tissue_lags_at_any_frame_rate_as_if_it_were_baked(name: str, clip: str) -> None:
    """Within 2 %, but where keys are so close that no track has more between them, from a loop's first frame on."""
    tools = config(name)
    tools["defaults"]["lag"] = {"frequency": 6, "damping": 0.5}
    whole = bake_once(name, top=tools, **COARSE)
    keys, _ = whole.keys(clip, name)
    names = whole.mesh(name)["extras"]["targetNames"]
    heights = np.sqrt(np.sum(whole.deltas(name) ** 2, axis=2)).max(axis=1)
    for fps in (30, 60, 144):
        times = np.arange(int(keys[-1] * fps + 1e-6) + 1) / fps
        driven = drive(whole.path, node=name, clip=clip, times=times.tolist(), driver=True, loops=True)
        wanted = whole.weights(name, clip, times)
        after = np.searchsorted(keys, times, side="right").clip(1, len(keys) - 1)
        told = (keys[after] - keys[after - 1] > 2 * KEY_GAP) | np.isin(
            times.astype(np.float32), keys.astype(np.float32)
        )
        for tool in whole.json["nodes"][whole.node(name)]["extras"]["wrinkle"]["tools"]:
            columns = [names.index(each) for each in tool["targets"]]
            for column in columns:
                share = heights[column] / heights[columns].max()
                error = share * np.abs(driven[names[column]][:, 0] - wanted[:, column])
                assert error[told].max() < 0.02, (fps, names[column], times[told][error[told].argmax()])


@pytest.mark.quick(1)
@pytest.mark.parametrize("clip", ["fold", "wave"])
def test_a_field_is_driven_as_it_was_baked(clip: str) -> None:
    bare, whole = (bake_field({"clips": {"fold": 0.5}}, tracks=tracks) for tracks in ("none", "all"))
    times, values = whole.keys(clip, "limb")
    names = whole.mesh("limb")["extras"]["targetNames"]
    driven = drive(bare.path, node="limb", clip=clip, times=times.tolist(), driver=True)
    shown = np.concatenate([driven[name] for name in names], axis=1)
    assert np.count_nonzero(values.max(axis=0) > 0.1) > 1
    assert np.abs(shown - values).max() < TABLE
    assert driver_warnings(bare.path) == []


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("leaning", [False, True])
def test_a_fold_that_touches_is_driven_as_it_is_tracked(leaning: bool, tmp_path: Path) -> None:
    """Nothing crosses in the joint's own motion, nor in clips of another file about axes that lean by up to 20°."""
    body, anim, clip = bake_fold(), folding_limb(), "fold"
    if leaning:
        anim, clip = waving_limb(6, aside=20.0, rings=3, sides=3).write(tmp_path / "anim.glb"), "wave_5"
    (made,) = track(body.path, [anim], tmp_path / "tracks")
    tracked = Gltf(Path(made.path))
    times, values = tracked.keys(clip, "limb")
    names = tracked.mesh("limb")["extras"]["targetNames"]
    driven = drive(body.path, node="limb", clip=clip, times=times.tolist(), driver=True, anim=anim if leaning else None)
    (fold,) = body.json["nodes"][body.node("limb")]["extras"]["wrinkle"]["folds"]
    columns = [names.index(name) for name in fold["targets"]]
    # A shape of which this clip needs less than the error allowed has no weight.
    assert np.count_nonzero(values[:, columns].any(axis=0)) >= len(columns) - 1 > 0
    for name, column in zip(fold["targets"], columns, strict=True):
        wanted = values[:, [column]]
        assert np.abs(driven[name] - wanted).max() < TABLE


@pytest.mark.slow
@pytest.mark.long
def test_the_driver_and_track_look_up_alike() -> None:
    """To the digits of what they read, along the turns of a clip as between them."""
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    body = FOLDS["one_sided"]().baked()
    document = read_document(body.path)
    rig, times = read_rig(document, body.node("limb")), np.linspace(0.0, 2.0, 41)
    (clip,), (entry,) = read_clips(document), read_bodies(document)
    (stored,) = (each for each in entry.drives if not each.measures_segment)
    fold = stored.on({name: rig.names.index(name) for name in stored.joints}, rig.morph_names)
    assert isinstance(fold.response, Table)
    assert fold.response.paths
    driven = drive(body.path, node="limb", clip=clip.name, times=times.tolist(), driver=True)
    shown = np.concatenate([driven[name] for name in fold.targets], axis=1)
    assert shown.max() > 0.1
    assert np.abs(shown - fold.weights_in(rig, clip)(times)).max() < 1e-7


@pytest.mark.slow
def test_a_fold_has_the_strength_of_its_clip(tmp_path: Path) -> None:
    """0 in a clip that the bake has left without contact: a player must not play there what the bake gave up."""
    body = bake_fold()

    def driven(**strengths: Any) -> np.ndarray:
        editor = Editor(Gltf(body.path))
        (fold,) = editor.json["nodes"][body.node("limb")]["extras"]["wrinkle"]["folds"]
        fold |= strengths
        played = drive(editor.save(tmp_path / "body.glb"), node="limb", clip="fold", times=[1.0], driver=True)
        return np.array([played[name][0, 0] for name in fold["targets"]])

    whole = driven()
    assert whole.any()
    assert not driven(strengths={"fold": 0.0}).any()
    assert driven(strengths={"fold": 0.5}) == pytest.approx(0.5 * whole)
    assert driven(strengths={"other": 0.0}) == pytest.approx(whole)
    assert driven(strength=0.25) == pytest.approx(0.25 * whole)


def limb_with(*names: str | None) -> Asset:
    """A limb whose nodes have other names, or none: the mesh, the two joints, and the root above these."""
    asset = limb_asset(rings=12, sides=8, root={"scale": [2.0, 2.0, 2.0]})
    for node, name in zip(asset.gltf["nodes"], names, strict=True):
        del node["name"]
        node |= {} if name is None else {"name": name}
    return asset


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "names",
    [
        ("limb", None, None, None),
        ("limb", "", "", ""),
        ("limb", "node_2", None, "root"),
        ("limb", "arm.L", "arm/L", "[arm]:L"),
        ("limb", "arm L", "arm_L", "root"),
        ("limb", "ärm", "手", "root"),
        ("limb", "limb", "joint", "root"),
        ("limb", "joint", "root", "root"),
    ],
    ids=str,
)
def test_joints_are_found_whatever_their_names_are(names: tuple[str | None, ...]) -> None:
    tools = crease(origin=[-0.8, 0.5, 0.0], target=[0.8, 0.5, 0.0])
    bare, whole = (
        bake_once(place(limb_with(*names)), tools, tracks=tracks, max_levels=0) for tracks in ("none", "all")
    )
    assert_driven(bare, whole, "limb", "fold")
    assert driver_warnings(bare.path) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "names", [("limb", "upper", "tip", "tip", None), ("limb", "tip", "tip", "x/tip", "root")], ids=str
)
def test_joints_of_one_name_are_told_apart_by_their_paths(names: tuple[str | None, ...], tmp_path: Path) -> None:
    """In the bake's extras, in the player, and where `track` finds the clips in another file."""
    asset = limb_asset(rings=16, sides=8, joints=3, root={"scale": [1.0, 1.0, 1.0]})
    for node, name in zip(asset.gltf["nodes"], names, strict=True):
        del node["name"]
        node |= {} if name is None else {"name": name}
    first = crease(name="first", origin=[-0.6, 0.25, 0.0], target=[-0.1, 0.25, 0.0])
    second = crease(name="second", origin=[0.1, 0.25, 0.0], target=[0.6, 0.25, 0.0])
    path = place(asset)
    bare, whole = (bake_once(path, first, second, tracks=tracks, max_levels=0) for tracks in ("none", "all"))
    tools = bare.json["nodes"][0]["extras"]["wrinkle"]["tools"]
    assert {"tip/tip"} < {joint for tool in tools for end in ("origin", "target") for joint in tool[end]["joints"]}
    assert not [line for line in report_of(bare).data["warnings"] if "several nodes are named" in line]
    assert driver_warnings(bare.path) == []
    assert_driven(bare, whole, "limb", "fold")
    (made,) = track(bare.path, [path], tmp_path)
    assert made.warnings == ()
    times, values = whole.keys("fold", "limb")
    assert values.max() > 0.3
    assert np.abs(Gltf(Path(made.path)).weights("limb", "fold", times) - values).max() < 0.02


def test_characters_of_one_file_may_have_joints_of_the_same_names() -> None:
    """The second stands beside the first and does not fold; its own joints drive it."""
    asset = limb_asset(rings=12, sides=8)
    gltf = asset.gltf
    gltf["nodes"] += [
        {"name": "still", "mesh": 0, "skin": 1},
        {"name": "joint_0", "translation": [-1.0, 0.0, 5.0], "children": [5]},
        {"name": "joint_1", "translation": [1.0, 0.0, 0.0]},
    ]
    gltf["skins"].append({**gltf["skins"][0], "joints": [4, 5], "skeleton": 4})
    gltf["scenes"][0]["nodes"] += [3, 4]
    still = crease(name="idle", node="still", origin=[-0.4, 0.25, 5.0], target=[0.4, 0.25, 5.0])
    bare = bake_once(place(asset), crease(node="limb"), still, tracks="none", max_levels=0)
    assert driver_warnings(bare.path) == []
    for node, highest in (("limb", 1.0), ("still", 0.0)):
        driven = drive(bare.path, node=node, clip="fold", times=[0.0, 1.0], driver=True)
        (name,) = (each for each in driven if each.startswith("wrinkle"))
        assert np.allclose(driven[name][:, 0], [0.0, highest], atol=1e-3)


def test_the_driver_says_what_it_does_not_find(tmp_path: Path) -> None:
    body = bake_once(place(limb_asset(rings=12, sides=8)), crease(), tracks="none", max_levels=0)

    def said(change: Callable[[Json], object]) -> list[str]:
        editor = Editor(Gltf(body.path))
        change(editor.json)
        return driver_warnings(editor.save(tmp_path / "changed.glb"))

    assert said(lambda gltf: gltf["nodes"][1].update(name="other")) == [
        'wrinkle: limb: crease is left out, as there is no joint "joint_0"'
    ]
    assert said(lambda gltf: gltf["nodes"][1].update(name="joint_1")) == [
        'wrinkle: limb: several joints are named "joint_1"; the first is taken',
        'wrinkle: limb: crease is left out, as there is no joint "joint_0"',
    ]
    assert said(lambda gltf: gltf["meshes"][0].pop("extras")) == [
        'wrinkle: limb: crease does not show, as there is no morph target "wrinkle_crease_1"'
    ]
    assert said(lambda gltf: gltf["nodes"][0]["extras"]["wrinkle"].update(parts=["limb_part2"])) == [
        'wrinkle: limb: there is no part "limb_part2"'
    ]
    assert said(lambda gltf: gltf["nodes"][0]["extras"]["wrinkle"].update(layout=4)) == [
        "wrinkle: limb: its extras have layout 4, and this driver reads 3: "
        "bake its source again, or take its version's driver"
    ]
    assert said(lambda gltf: gltf["nodes"][0].pop("extras")) == [
        "wrinkle: nothing to drive: no object has extras.wrinkle and morph targets"
    ]


def joint_of_the_bodys_name(editor: Editor) -> None:
    next(node for node in editor.json["nodes"] if node["name"] == "skull")["name"] = "head"


@pytest.mark.slow
def test_a_body_may_be_named_like_a_joint() -> None:
    asset = edited("head", joint_of_the_bodys_name)
    bare, whole = (bake_once(asset, top=config("head"), tracks=tracks, **COARSE) for tracks in ("none", "all"))
    assert_driven(bare, whole, "head", "raise_brows")


def other_bind_space(editor: Editor) -> None:
    """Inverse bind matrices as after quantisation, which takes positions to another space."""
    for skin in editor.json["skins"]:
        accessor = editor.json["accessors"][skin["inverseBindMatrices"]]
        start = editor.json["bufferViews"][accessor["bufferView"]]["byteOffset"] + accessor.get("byteOffset", 0)
        old = np.frombuffer(bytes(editor.data), "<f4", 16 * accessor["count"], start).reshape(-1, 4, 4)
        wider = np.diag(np.float32([3.0, 3.0, 3.0, 1.0]))
        wider[3, :3] = [0.1, -0.2, 0.3]
        editor.data[start : start + old.nbytes] = np.float32(wider @ old).tobytes()


@pytest.mark.slow
def test_quantised_positions_do_not_matter(tmp_path: Path) -> None:
    editor = Editor(Gltf(bake_config("trousers", "trousers", tracks="none").path))
    other_bind_space(editor)
    bare = Gltf(editor.save(tmp_path / "quantised.glb"))
    assert_driven(bare, bake_config("trousers", "trousers"), "trousers", "squat")


def with_clip(name: str, clip: str, source: Path) -> Path:
    """A sample whose clip is as another file has it."""
    paths = {"quaternion": "rotation", "position": "translation", "morphTargetInfluences": "weights"}

    def change(editor: Editor) -> None:
        gltf = editor.json
        channels, samplers = [], []
        for node, path, times, values in clip_tracks(source, clip):
            carriers = [k for k, each in enumerate(gltf["nodes"]) if each["name"] == node]
            if path == "morphTargetInfluences":
                values = values[:, : len(gltf["meshes"][0]["primitives"][0].get("targets", []))]
            if not carriers or not values.size:
                continue
            kind = {"quaternion": "VEC4", "morphTargetInfluences": "SCALAR"}.get(path, "VEC3")
            flat = values.reshape(-1, 1) if kind == "SCALAR" else values
            samplers.append({"input": editor.times(times.tolist()), "output": editor.accessor(flat.astype("<f4"))})
            target = {"node": carriers[0], "path": paths.get(path, path)}
            channels.append({"sampler": len(samplers) - 1, "target": target})
        assert channels
        gltf["animations"] = [{"name": clip, "channels": channels, "samplers": samplers}]

    return edited(name, change)


def optimised(kind: str, path: Path, out: Path) -> Path:
    if kind == "glTF-Transform":
        optimize(path, out)
    else:
        gltfpack(path, out, *kind.split())
    return out


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize(
    ("name", "clip", "kind"),
    [
        ("wrist", "flex", "glTF-Transform"),
        ("wrist", "flex", "-ke -kn -cc"),
        ("trousers", "squat", "-ke -kn"),
        ("head", "raise_brows", "glTF-Transform"),
        ("head", "raise_brows", "-ke -kn -cc"),
    ],
)
def test_an_optimiser_may_have_been_over_the_file(name: str, clip: str, kind: str, tmp_path: Path) -> None:
    """Positions are quantised, bind matrices others. The clip that the optimiser leaves gets what baking it gives.

    It is not the one that went in: resampled, its rotations in 12 to 16 bits, in gltfpack its morph weights in 8.
    """
    small = optimised(kind, bake_config(name, name, tracks="none").path, tmp_path / "small.glb")
    # The config names clips that are not taken along: of an optional tool they are no error.
    tools = config(name)
    tools["defaults"]["optional"] = True
    whole = bake_once(with_clip(name, clip, small), top=tools, **COARSE)
    assert_driven(Gltf(small), whole, name, clip)


@pytest.mark.slow
@pytest.mark.long
def test_gltfpack_stores_morph_weights_in_8_bits(tmp_path: Path) -> None:
    """What it adds to the table's error, by itself: brows lie up to 1/510 of their way elsewhere.

    That is little for the brows and more for a wrinkle that just starts there, like a square root.
    """
    source = bake_config("head", "head", tracks="none")
    for flags in (["-ke", "-kn"], ["-ke", "-kn", "-noq"], ["-ke", "-kn", "-af", "0"]):
        gltfpack(source.path, tmp_path / "small.glb", *flags)
        tracks = clip_tracks(tmp_path / "small.glb", "raise_brows")
        ((times, values),) = ((t, v) for _, path, t, v in tracks if path == "morphTargetInfluences")
        assert np.abs(255 * values - np.rint(255 * values)).max() < 1e-4
        assert np.abs(values[:, :2] - source.weights("head", "raise_brows", times)[:, :2]).max() <= 1 / 510 + 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("clip", ["raise_brows", "think"])
def test_keyed_rest_lengths_of_a_sample(clip: str) -> None:
    bare, whole = bake_config("head", "head_keyed", tracks="none"), bake_config("head", "head_keyed")
    assert_driven(bare, whole, "head", clip)


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(
    "look",
    [
        {"bumps": 5, "compressible": "40%", "strategy": "everywhere"},
        {"bumps": 3, "details": [0.3, 0.2], "profile": "polyline", "gap": 1, "strategy": "origin"},
        {"bumps": 4, "compressible": "20%", "gap": 1, "strategy": "both_ends"},
    ],
)
@pytest.mark.parametrize(
    "rest_length",
    [
        {"morph": "browsUp", "full": "115%"},
        {"keys": {"think": [[0.0, "100%"], [1.4, "118%"], [3.0, "100%"]], "raise_brows": [[0, "110%"]]}},
    ],
)
def test_rest_lengths_that_a_morph_target_or_keys_drive(rest_length: Json, look: Json) -> None:
    tool: Json = {**BROW, **look, "rest_length": rest_length, "clips": {"raise_brows": 0.5}}
    bare, whole = (bake_once("head", tool, tracks=tracks, max_levels=0) for tracks in ("none", "all"))
    for clip in ("raise_brows", "think"):
        assert_driven(bare, whole, "head", clip)


@pytest.mark.slow
@pytest.mark.long
def test_a_fold_that_no_joint_bends_is_driven_by_its_tool(tmp_path: Path) -> None:
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    bridge = {"name": "bridge", "node": "skin", "origin": [-0.5, 0, 0], "target": [0.5, 0, 0], "width": 0.8, "bumps": 4}
    asset = place(nose())
    body = bake_once(asset, {**bridge, "contact": "resolve"}, max_levels=0)
    (made,) = track(body.path, [asset], tmp_path)
    times, values = Gltf(Path(made.path)).keys("sneer", "skin")
    names = body.mesh("skin")["extras"]["targetNames"]
    driven = drive(body.path, node="skin", clip="sneer", times=times.tolist(), driver=True)
    (fold,) = body.json["nodes"][body.node("skin")]["extras"]["wrinkle"]["folds"]
    wanted = values[:, [names.index(name) for name in fold["targets"]]]
    assert wanted.any()
    assert np.abs(np.concatenate([driven[name] for name in fold["targets"]], axis=1) - wanted).max() < TABLE


def served(folder: Path, **files: Path) -> None:
    """Link the driver's files, three.js and others, by name with _ for the dot, into a folder."""
    linked = {path.name: path for path in (ROOT / "samples" / "driver").glob("*.*")}
    linked |= {"node_modules": ROOT / "tests" / "clients" / "node_modules"}
    linked |= {name.replace("_", "."): path for name, path in files.items()}
    for name, path in linked.items():
        (folder / name).symlink_to(path.resolve())


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("unwrap", [False, True], ids=["", "unwrapped"])
def test_maps_look_as_the_bake_does(unwrap: bool, tmp_path: Path) -> None:
    """Side by side in three.js in raking light: what the maps change is what the bake changes."""
    config, plain = ROOT / "configs" / "wrist.yaml", tmp_path / "unwrapped.glb" if unwrap else sample("wrist")
    maps(sample("wrist"), config, tmp_path / "made", size=256, unwrap=plain if unwrap else None)
    served(tmp_path, baked_glb=bake_config("wrist", "wrist").path, plain_glb=plain, maps=tmp_path / "made")
    query = "baked=baked.glb&plain=plain.glb&maps=maps&clip=extend&from=50&far=0.8&turn=0"
    rest, bent, without = halves(tmp_path, *(f"{query}&{more}" for more in ("time=0", "time=0.7", "time=0.7&without")))
    # Of 255: refinement alone moves the outline by less than a pixel.
    assert np.percentile(np.abs(rest[0] - rest[1]), 99.5) <= 2.0
    (geometry, mapped), (_, flat) = bent, without
    # Raised crests stand a few pixels beside flat ones, and their outline, which maps leave, stands out.
    inner = binary_erosion(flat < flat[0, 0] - 3.0, iterations=15)
    bumps, shown = (gaussian_filter(each - flat, 3.0) for each in (geometry, mapped))
    raised = inner & (np.abs(bumps) > 8.0)
    assert raised.sum() > 3000
    assert np.corrcoef(bumps[raised], shown[raised])[0, 1] > 0.8


def halves(folder: Path, *queries: str) -> list[list[Any]]:
    """For each query, grey of the left and the right half of the page, below its words."""
    found = []
    with serving(folder) as address, browsing(folder, "about:blank") as page:
        for query in queries:
            page.call("Page.navigate", url=f"{address}/maps.html?{query}")
            page.wait(f"location.search === '?{query}' && window.frames_drawn > 2")
            page.screenshot(folder / "page.png")
            grey = np.asarray(Image.open(folder / "page.png").convert("L"), np.float64)
            found.append(np.split(grey[50:], 2, axis=1))
    return found


@pytest.mark.slow
@pytest.mark.long
def test_the_player_shows_before_and_after(tmp_path: Path) -> None:
    """The clip is chosen by name, and the slider stands between before, on its left, and after."""
    served(tmp_path, baked_glb=bake_config("trousers", "trousers").path)
    query, clip = "file=baked.glb&clip=squat&time=0.65&turn=140", "document.forms[0].elements.clip"
    with serving(tmp_path) as address, browsing(tmp_path, f"{address}/?{query}", (800, 480)) as page:
        page.wait("window.frames_drawn > 2")
        assert page.value(f"[...{clip}.options].map((each) => each.text)") == ["squat", "walk"]
        assert page.value(f"{clip}.selectedOptions[0].text") == "squat"
        high = page.value("document.querySelector('canvas').clientHeight") - 16  # above the slider
        shown = {}
        for split in (0.0, 1.0, 0.5):
            drawn = page.value(f"document.forms[0].elements.split.value = {split}, window.frames_drawn")
            page.wait(f"window.frames_drawn > {drawn} + 2")
            page.screenshot(tmp_path / "page.png")
            shown[split] = np.asarray(Image.open(tmp_path / "page.png").convert("L"), np.float64)[:high]
        wrinkled, plain, both = shown.values()
        body = plain != plain[0, 0]
        assert (np.abs(wrinkled - plain)[body] > 12).mean() > 0.02
        # Beside the middle, where pixels belong to both.
        np.testing.assert_array_equal(both[:, :399], plain[:, :399])
        np.testing.assert_array_equal(both[:, 401:], wrinkled[:, 401:])
        assert page.errors == []


@pytest.mark.slow
@pytest.mark.long
def test_the_page_of_the_site_plays_each_clip_without_an_error(tmp_path: Path) -> None:
    """The files are those that the site copies, and no others."""
    for name, content in run_path(str(ROOT / ".github" / "site" / "hooks.py"))["player"](
        bake_config("wrist", "wrist").path
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    clip = "document.forms[0].elements.clip"
    with serving(tmp_path) as address, browsing(tmp_path, f"{address}/play/", (800, 480)) as page:
        page.wait("window.frames_drawn > 2")
        for number in range(page.value(f"{clip}.options.length")):
            drawn = page.value(f"{clip}.value = {number}, {clip}.onchange(), window.frames_drawn")
            shown = []
            for count in (2, 8):  # frames are a tenth of a second apart
                page.wait(f"window.frames_drawn > {drawn} + {count}")
                page.screenshot(tmp_path / "page.png")
                shown.append(np.asarray(Image.open(tmp_path / "page.png").convert("L"), np.float64))
            assert (np.abs(shown[1] - shown[0]) > 12).mean() > 0.002
        assert page.value("document.querySelector('output').value") == ""
        assert page.errors == []


@pytest.mark.slow
@pytest.mark.long
def test_the_lines_of_readme_play_a_bake(tmp_path: Path) -> None:
    folder = ROOT / "wrinklecli" / "example"  # with a figure of usual height, which the camera is set for
    served(
        tmp_path, wrinkled_glb=baked(folder / "figure.glb", (folder / "figure.yaml").read_text(), json.dumps(COARSE))
    )
    (lines,) = re.findall(r"```js\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    three = (
        '{"three": "./node_modules/three/build/three.module.js", "three/addons/": "./node_modules/three/examples/jsm/"}'
    )
    page = f'<link rel="icon" href="data:,"><script type="importmap">{{"imports": {three}}}</script>'
    seen = "window.seen = []; scene.traverse((node) => seen.push(node.morphTargetInfluences ?? []));"
    (tmp_path / "lines.html").write_text(f'{page}<script type="module">{lines}{seen}</script>')
    with serving(tmp_path) as address, browsing(tmp_path, f"{address}/lines.html") as page:
        page.wait("window.seen && Math.max(...seen.flat()) > 0.3")
        page.screenshot(tmp_path / "page.png")
        shown = np.asarray(Image.open(tmp_path / "page.png").convert("L"), np.float64)
        assert (shown != shown[0, 0]).mean() > 0.05
        assert page.errors == []


@pytest.mark.slow
@pytest.mark.long
def test_the_mouse_slides_the_skin_on_the_page(tmp_path: Path) -> None:
    baked = bake_once(place(plate(clips=False)), top={"touches": [touch(keys={})], "refinement": {"max_levels": 1}})
    served(tmp_path, touched_glb=baked.path)
    weights = "driver.bodies[0].meshes[0].morphTargetInfluences.reduce((sum, each) => sum + Math.abs(each), 0)"
    with serving(tmp_path) as address, browsing(tmp_path, f"{address}/touch.html?file=touched.glb") as page:
        page.wait("window.driver?.bodies.length && driver.time > 0")
        assert page.value(weights) == 0
        width, height = page.value("[innerWidth, innerHeight]")
        middle = (width / 2, height / 2)
        page.hold([middle, (middle[0] + 60, middle[1])])
        slid = page.value("driver.bodies[0].meshes[0].morphTargetInfluences")
        targets = page.value("driver.bodies[0].body.touches[0].targets.length")
        page.screenshot(tmp_path / "held.png")
        assert len(slid) == targets
        assert max(slid[:4]) > 0.3
        assert slid[4] == pytest.approx(1.0)
        assert max(slid[5:]) > 0.1
        before = page.value("camera.position.toArray()")
        page.release((middle[0] + 60, middle[1]))
        page.wait(f"{weights} < 0.02")
        # Beside the pad the mouse turns the view.
        page.drag([(middle[0] + 250, middle[1] + 100), (middle[0] + 300, middle[1])])
        assert page.value(weights) < 0.02
        assert page.value("camera.position.toArray()") != pytest.approx(before, abs=1e-3)
