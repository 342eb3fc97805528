"""A mesh in parts: each part plays the same as in the whole, to the bit, and engines need far less memory."""

from pathlib import Path

import numpy as np
import pytest

import wrinklecli
from kit.bakes import bake_config
from kit.clients import assert_valid, drive, pose_each, target_bytes
from kit.golden import Golden
from kit.limb import limb_asset, tool, write_tools
from kit.player import Gltf, Json
from kit.samples import sample
from wrinklecli.baking import parts, split
from wrinklecli.baking.track import track
from wrinklecli.errors import BakeError
from wrinklecli.gltf.document import read_document
from wrinklecli.review.diff.diff import diff
from wrinklecli.review.preview.peaks import baked_peaks
from wrinklecli.review.preview.shown import read_shown
from wrinklecli.tools.records import Length

# Two folds apart, so that there are parts.
TOOLS = [tool(width=0.2), {**tool(), "name": "other", "origin": [-0.3, 0.0, 0.25], "target": [0.3, 0.0, 0.25]}]
FORMS: dict[str, Json] = {
    "skinned": {
        "morphs": 2,
        "morph_clip": "CUBICSPLINE",
        "morph_normals": True,
        "primitives": 2,
        "tangents": True,
        "rings": 16,
    },
    "rigid": {
        "skinned": False,
        "morphs": 2,
        "morph_clip": "LINEAR",
        "clip": "grow",
        "rings": 16,
    },
}


@pytest.fixture(scope="module", params=list(FORMS))
def pair(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[Gltf, Gltf]:
    """A limb baked as a whole and split; so few vertices are not split otherwise."""
    folder = tmp_path_factory.mktemp("split")
    asset = limb_asset(**FORMS[request.param]).write(folder / "limb.glb")
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


def test_parts_move_as_the_whole_did_to_the_bit(pair: tuple[Gltf, Gltf], golden: Golden) -> None:
    whole, parted = pair
    parts_of_mesh = [[node, len(parted.triangles(node)), targets_of(parted, node)] for node in nodes_of(parted)]
    golden(parts_of_mesh, f"split_{'skinned' if 'skins' in parted.json else 'rigid'}.json")
    assert nodes_of(parted)[:2] == ["limb", "limb_part2"]
    assert ways(whole) == ways(parted)
    assert_valid(parted.path)
    # The asset's own targets keep their numbers on its own node.
    assert targets_of(parted, "limb")[:2] == targets_of(whole, "limb")[:2]
    assert target_bytes(parted.path) < target_bytes(whole.path)


def test_the_original_comes_back_from_parts(pair: tuple[Gltf, Gltf], tmp_path: Path) -> None:
    whole, parted = pair
    tools = parted.path.parent / "tools.yaml"
    wrinklecli.bake(parted.path, tools, tmp_path / "again.glb", replace=True)
    assert (tmp_path / "again.glb").read_bytes() == whole.path.read_bytes()
    with pytest.raises(BakeError, match="#/nodes/0/extras/wrinkle: already carries wrinkles of an earlier bake"):
        wrinklecli.bake(parted.path, tools, tmp_path / "out.glb")


def test_pictures_find_the_peaks_of_tools_whose_mesh_is_in_parts(pair: tuple[Gltf, Gltf]) -> None:
    peaks = []
    for file in pair:
        asset, _ = read_shown(read_document(file.path), "", [])
        peaks.append(baked_peaks(asset, asset.clips))
    assert len(peaks[0]) == 2
    assert peaks[0] == peaks[1]


def test_diff_sees_no_difference_in_what_moves(pair: tuple[Gltf, Gltf]) -> None:
    assert diff(pair[0].path, pair[1].path, posed=True, tolerance=Length(1e-12)).same


@pytest.mark.slow
def test_a_forehead_takes_a_quarter_of_the_memory_in_three_js() -> None:
    whole, parted = (bake_config("head", "head", **each) for each in ({}, {"split": True}))
    assert target_bytes(parted.path) < target_bytes(whole.path) / 4
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


def test_what_has_no_morph_targets_is_not_split(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml")
    with pytest.raises(BakeError, match="split"):
        wrinklecli.bake(sample("wrist"), tools, tmp_path / "out.glb", mode="frames", split=True)
