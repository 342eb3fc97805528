"""A mesh in parts: each part plays the same as in the whole, to the bit, and engines need far less memory."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import wrinklecli
from kit.asset import ARRAY_BUFFER, Asset
from kit.bakes import bake_config
from kit.clients import assert_valid, drive, pose_each, target_bytes
from kit.engines import babylon_pose
from kit.fields import sleeve, sleeve_and_field
from kit.garments import thinner
from kit.golden import Golden
from kit.limb import limb_asset, tool, write_tools
from kit.player import Gltf, Json
from kit.samples import sample
from wrinklecli.baking import parts, split
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.baking.track import track
from wrinklecli.errors import BakeError
from wrinklecli.gltf.document import read_document
from wrinklecli.review.crossings import crossings
from wrinklecli.review.diff.diff import diff
from wrinklecli.review.preview.peaks import baked_peaks
from wrinklecli.review.preview.shown import read_shown
from wrinklecli.tools.records import Length

# Two folds apart, so that there are parts.
TOOLS = [
    tool(node="limb", width=0.2),
    {**tool(node="limb"), "name": "other", "origin": [-0.3, 0.0, 0.25], "target": [0.3, 0.0, 0.25]},
]


def prop() -> Asset:
    """A limb without skin in the midst of a scene, on a node that moves in each way that a node can move.

    The node is below another, and carries a camera, a light and a further mesh. So it is a group in three.js, which
    gives the weights of a group to all objects below it.
    """
    asset = limb_asset(skinned=False, morphs=2, morph_clip="CUBICSPLINE", rings=16, root=SHIFTED)
    gltf = asset.gltf
    corners = asset.accessor([[0, 0, 0], [1, 0, 0], [0, 1, 0]], bounds=True, target=ARRAY_BUFFER)
    asset.append("meshes", {"primitives": [{"attributes": {"POSITION": corners}}]})
    asset.append("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}})
    asset.append("nodes", {"name": "badge", "mesh": 1, "translation": [0.0, 0.5, 0.0]})
    gltf["nodes"][0] |= {"children": [2], "camera": 0, "rotation": [0.0, 1.0, 0.0, 0.0], "scale": [1.1, 1.0, 1.0]}
    gltf["nodes"][0]["extensions"] = {"KHR_lights_punctual": {"light": 0}}
    gltf["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    gltf["extensionsUsed"] = ["KHR_lights_punctual"]
    clip = gltf["animations"][0]
    asset.channel(clip, 0, "translation", [0.0, 1.0, 1.6], [[0, 0, 0], [0, 1, 0], [2, 0, 0]])
    asset.channel(clip, 0, "rotation", [0.2, 1.2], [[0, 0, 0, 1], [0.6, 0, 0, 0.8]], "STEP")
    tangents = np.ones((1, 3))
    scales = [[0 * tangents, tangents, tangents], [tangents, 2 * tangents, 0 * tangents]]
    asset.channel(clip, 0, "scale", [0.0, 1.5], np.reshape(scales, (2, 3, 3)), "CUBICSPLINE")
    asset.channel(clip, 1, "translation", [0.0, 1.0], [[0, 0, 0], [0, 0, 3]])
    return asset


# The tools lie on the tube all the same, as it is round.
SHIFTED: Json = {"translation": [0.1, 0.0, 0.0], "rotation": [0.0, 0.0, 1.0, 0.0]}
FORMS: dict[str, Callable[[], Asset]] = {
    "skinned": partial(
        limb_asset,
        morphs=2,
        morph_clip="CUBICSPLINE",
        morph_normals=True,
        primitives=2,
        tangents=True,
        rings=16,
    ),
    "rigid": partial(limb_asset, skinned=False, morphs=2, morph_clip="LINEAR", clip="grow", rings=16),
    "bands": partial(limb_asset, skinned=False, morphs=2, morph_clip="LINEAR", primitives=2, rings=16),
    "prop": prop,
}


@pytest.fixture(scope="module", params=list(FORMS))
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Gltf, Gltf]:
    """A limb baked as a whole and split; so few vertices are not split otherwise."""
    folder = tmp_path_factory.mktemp("split")
    asset = FORMS[request.param]().write(folder / "limb.glb")
    tools = write_tools(folder / "tools.yaml", *TOOLS)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parts, "_WORTH", 2000)
        patch.setattr(split, "_MATTERS", 0)
        wrinklecli.bake(asset, tools, folder / "split.glb", split=True)
        made = wrinklecli.bake(asset, tools, folder / "whole.glb")
    assert made.data["meshes"][0]["split_gpu_bytes"] == target_bytes(folder / "split.glb")
    return Gltf(folder / "whole.glb"), Gltf(folder / "split.glb")


def nodes_of(file: Gltf) -> list[str]:
    return [node["name"] for node in file.json["nodes"] if "mesh" in node]


def targets_of(file: Gltf, node: str) -> list[str]:
    names: list[str] = file.mesh(node).get("extras", {}).get("targetNames", [])
    return names


def ways(file: Gltf) -> set[bytes]:
    """Where three.js shows each vertex at keys and between, to the bit."""
    clip, times = file.json["animations"][0]["name"], [0.0, 0.37, 0.5, 1.0, 1.61]
    shown = np.float32(np.concatenate(pose_each(file.path, nodes_of(file), clip=clip, times=times), axis=1))
    return {way.tobytes() for way in shown.transpose(1, 0, 2)}


@pytest.mark.quick(1)
def test_parts_move_as_the_whole_did_to_the_bit(
    pair: tuple[Gltf, Gltf], golden: Golden, request: pytest.FixtureRequest
) -> None:
    whole, parted = pair
    form = request.node.callspec.params["pair"]
    parts_of_mesh = [
        [node, len(parted.triangles(node)), targets_of(parted, node)]
        for node in nodes_of(parted)
        if node.startswith("limb")
    ]
    golden(parts_of_mesh, f"split_{form}.json")
    assert ways(whole) == ways(parted)
    # Older releases of three.js give the weights of a node to all meshes below it.
    below = {child for node in parted.json["nodes"] for child in node.get("children", ()) if "mesh" in node}
    assert not below & {parted.node(node) for node in nodes_of(parted) if targets_of(parted, node)}
    assert_valid(parted.path)
    # The asset's own targets keep their numbers on its own node.
    assert targets_of(parted, "limb")[:2] == targets_of(whole, "limb")[:2]
    assert target_bytes(parted.path) < target_bytes(whole.path)


@pytest.mark.quick(1)
def test_each_target_of_a_part_moves_it(pair: tuple[Gltf, Gltf]) -> None:
    """Or turns normals where one would see it."""
    _, parted = pair
    document = read_document(parted.path)
    for node in nodes_of(parted):
        for number, name in enumerate(targets_of(parted, node)):
            if name.startswith("wrinkle_"):
                targets = [each["targets"][number] for each in parted.mesh(node)["primitives"]]
                moves = any(document.changes(each["POSITION"])[1].any() for each in targets)
                turns = [np.abs(document.changes(each["NORMAL"])[1]).max(initial=0) for each in targets]
                assert moves or max(turns) > parts._UNSEEN / 2, (node, name)


@pytest.mark.slow
def test_the_original_comes_back_from_parts(pair: tuple[Gltf, Gltf], tmp_path: Path) -> None:
    whole, parted = pair
    tools = parted.path.parent / "tools.yaml"
    wrinklecli.bake(parted.path, tools, tmp_path / "again.glb", replace=True)
    assert (tmp_path / "again.glb").read_bytes() == whole.path.read_bytes()
    with pytest.raises(BakeError, match="#/nodes/0/extras/wrinkle: already carries wrinkles of an earlier bake"):
        wrinklecli.bake(parted.path, tools, tmp_path / "out.glb")


@pytest.mark.quick(1)
def test_pictures_find_the_peaks_of_tools_whose_mesh_is_in_parts(pair: tuple[Gltf, Gltf]) -> None:
    peaks = []
    for file in pair:
        asset, _ = read_shown(read_document(file.path), "", [])
        peaks.append(baked_peaks(asset, asset.clips))
    assert len(peaks[0]) == 2
    assert peaks[0] == peaks[1]


@pytest.mark.quick(1)
def test_diff_sees_no_difference_in_what_moves(pair: tuple[Gltf, Gltf]) -> None:
    assert diff(pair[0].path, pair[1].path, posed=True, tolerance=Length(1e-12)).same


@pytest.mark.quick(1)
def test_nothing_crosses_where_parts_meet(pair: tuple[Gltf, Gltf]) -> None:
    whole, parted = (crossings(file.path).data for file in pair)
    assert parted["stored_pose"] == whole["stored_pose"]
    for one, other in zip(whole["clips"], parted["clips"], strict=True):
        assert one["counts"] == other["counts"]
        # The middle of a place is that of some vertices, which parts number otherwise.
        assert [{**each, "at": None} for each in one["places"]] == [{**each, "at": None} for each in other["places"]]


def test_babylon_plays_all_parts(pair: tuple[Gltf, Gltf]) -> None:
    _, parted = pair
    clip, times = parted.json["animations"][0]["name"], [0.0, 0.37, 1.0, 1.4]
    for node in nodes_of(parted):
        posed = parted.pose(node, clip, np.array(times))
        if targets_of(parted, node):
            assert np.abs(babylon_pose(parted.path, node, clip, times) - posed).max() < 2e-6 * np.abs(posed).max()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["tools", "field"])
def test_the_memory_of_parts_is_known_before_the_bake(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Normals that turn by less than anyone sees are counted too where two parts meet."""
    monkeypatch.setattr(parts, "_WORTH", 2000)
    if kind == "field":
        asset, tools = sleeve_and_field(tmp_path)
    else:
        asset = limb_asset(rings=16).write(tmp_path / "limb.glb")
        tools = write_tools(tmp_path / "tools.yaml", *TOOLS)
    (plan,) = plan_meshes(read_job(asset, tools, BakeOptions()))
    planned = split.planned_bytes(plan, [moved for part in plan.parts for moved in part.target_vertices])
    wrinklecli.bake(asset, tools, tmp_path / "split.glb", split=True)
    assert 0.95 < planned / target_bytes(tmp_path / "split.glb") < 1.2


@pytest.mark.slow
def test_a_forehead_takes_a_third_of_the_memory_in_three_js() -> None:
    whole, parted = (bake_config("head", "head", **each) for each in ({}, {"split": True}))
    assert target_bytes(parted.path) < target_bytes(whole.path) / 3
    # Of the faces that wrinkle alone, with all targets as one mesh would have them.
    wrinkling = [node for node in nodes_of(parted) if any(n.startswith("wrinkle_") for n in targets_of(parted, node))]
    region = sum(len(parted.attribute(node, "POSITION")) for node in wrinkling)
    assert target_bytes(parted.path) < 3 * 32 * region * len(targets_of(whole, "head"))


@pytest.mark.slow
def test_tracks_of_other_files_and_the_driver_move_all_parts(tmp_path: Path) -> None:
    parted, clip = bake_config("head", "head", split=True), "raise_brows"
    (made,) = track(parted.path, [sample("head")], tmp_path)
    tracked = Gltf(Path(made.path))
    for node in nodes_of(parted):
        names = targets_of(parted, node)
        if names:
            times = np.linspace(0.0, 2.0, 9)
            wanted = parted.weights(node, clip, times)
            driven = drive(parted.path, node=node, clip=clip, times=times.tolist(), driver=True)
            assert np.abs(np.stack([driven[name][:, 0] for name in names], axis=1) - wanted).max() < 0.02
            assert targets_of(tracked, node) == names
            assert np.abs(tracked.weights(node, clip, times) - wanted).max() < 0.03


@pytest.mark.slow
def test_a_field_is_split_between_its_joints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its shapes end where nothing of them is seen, and so do their normals.

    They fade over the radius of the limb, so this one is thinner, in proportion to its bones, than others here.
    """
    worth = 2000
    monkeypatch.setattr(parts, "_WORTH", worth)
    monkeypatch.setattr(split, "_MATTERS", 0)
    _, tools = sleeve_and_field(tmp_path, wavelength="12%")
    asset = thinner(sleeve(rings=41, sides=12), 0.6).write(tmp_path / "sleeve.glb")
    made = wrinklecli.bake(asset, tools, tmp_path / "split.glb", split=True)
    parted = Gltf(tmp_path / "split.glb")
    assert_valid(parted.path)
    mesh, (told,) = made.data["meshes"][0], made.data["fields"]
    whole = mesh["vertices"] * len(told["targets"]) * 32
    assert target_bytes(parted.path) < 0.72 * whole
    assert whole - target_bytes(parted.path) > worth * (len(list(nodes_of(parted))) - 1), "each cut saves its worth"
    # Both joints reach most shapes, so each is that of the one which raises it most.
    tables = [
        (float(np.max(column)), turn["joint"], field["targets"][place])
        for node in parted.json["nodes"]
        for field in node.get("extras", {}).get("wrinkle", {}).get("fields", ())
        for turn in field["turns"]
        for place, column in zip(turn["raises"], np.transpose(turn["weights"]), strict=True)
    ]
    joints = {target: joint for _, joint, target in sorted(tables)}
    alone = [{joints[name] for name in targets_of(parted, node)} for node in nodes_of(parted)]
    assert {"joint_1"} in alone
    assert {"joint_2"} in alone


def test_what_has_no_morph_targets_is_not_split(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml")
    with pytest.raises(BakeError, match="split"):
        wrinklecli.bake(sample("wrist"), tools, tmp_path / "out.glb", mode="frames", split=True)
