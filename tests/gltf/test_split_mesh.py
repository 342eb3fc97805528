"""A mesh in parts, by the document alone: what else than animations sets its morph targets follows, or is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.documents import written
from kit.limb import limb_asset
from wrinklecli.errors import BakeError
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.split_mesh import Part, split_node


def halved(document: Document, second: tuple[int, ...]) -> EditedDocument:
    """The limb of two primitives, of which the second leaves with some morph targets."""
    edited = EditedDocument(document)
    faces = [
        document.accessor(primitive["indices"]).reshape(-1, 3).astype(np.intp)
        for primitive in document.items("meshes")[0]["primitives"]
    ]
    none = np.zeros((0, 3), np.intp)
    assert split_node(edited, 0, [Part((faces[0], none), (0, 1)), Part((none, faces[1]), second)])[0] == 0
    return edited


def test_expressions_of_a_vrm_set_all_parts(tmp_path: Path) -> None:
    asset = limb_asset(morphs=2, primitives=2, rings=5, sides=4)
    binds = [{"node": 0, "index": 1, "weight": 0.5}, {"node": 0, "index": 0, "weight": 1.0}]
    older = [{"mesh": 0, "index": 1, "weight": 50}]
    notes = [{"node": 0, "type": "both"}]
    asset.gltf["extensions"] = {
        "VRMC_vrm": {"expressions": {"custom": {"bulge": {"morphTargetBinds": binds}}}, "firstPerson": {"mesh": notes}},
        "VRM": {"blendShapeMaster": {"blendShapeGroups": [{"binds": older}]}},
    }
    gltf = halved(written(asset, tmp_path), (1,)).gltf
    new, mesh = len(gltf["nodes"]) - 1, len(gltf["meshes"]) - 1
    (new_bind,) = gltf["extensions"]["VRMC_vrm"]["expressions"]["custom"]["bulge"]["morphTargetBinds"][2:]
    assert new_bind == {"node": new, "index": 0, "weight": 0.5}
    assert gltf["extensions"]["VRMC_vrm"]["firstPerson"]["mesh"][1:] == [{"node": new, "type": "both"}]
    (group,) = gltf["extensions"]["VRM"]["blendShapeMaster"]["blendShapeGroups"]
    assert group["binds"][1:] == [{"mesh": mesh, "index": 0, "weight": 50}]


def test_names_on_primitives_go_with_their_targets(tmp_path: Path) -> None:
    asset = limb_asset(morphs=2, primitives=2, rings=5, sides=4)
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["extras"] = {"targetNames": ["bulge", "squash"]}
    gltf = halved(written(asset, tmp_path), (1,)).gltf
    first, second = ([each["extras"]["targetNames"] for each in mesh["primitives"]] for mesh in gltf["meshes"])
    assert (first, second) == ([["bulge", "squash"]], [["squash"]])


def test_what_names_a_mesh_in_a_text_cannot_be_split(tmp_path: Path) -> None:
    asset = limb_asset(morphs=2, primitives=2, rings=5, sides=4)
    target: dict[str, Any] = {
        "path": "pointer",
        "extensions": {"KHR_animation_pointer": {"pointer": "/nodes/0/weights/1"}},
    }
    animation = asset.gltf["animations"][0]
    animation["channels"].append({"sampler": 0, "target": target})
    with pytest.raises(BakeError, match="/nodes/0/weights/1"):
        halved(written(asset, tmp_path), (1,))


@pytest.mark.parametrize("holder", [0, 1])
def test_levels_of_detail_cannot_be_split(holder: int, tmp_path: Path) -> None:
    asset = limb_asset(morphs=2, primitives=2, rings=5, sides=4)
    asset.gltf["nodes"][holder]["extensions"] = {"MSFT_lod": {"ids": [1 - holder]}}
    with pytest.raises(BakeError, match=r"#/nodes/0: cannot be split: .* MSFT_lod"):
        halved(written(asset, tmp_path), (1,))


@pytest.mark.parametrize("skinned", [True, False])
def test_parts_stand_beside_their_node_with_its_transform_and_channels(skinned: bool, tmp_path: Path) -> None:
    asset = limb_asset(morphs=2, morph_clip="LINEAR", primitives=2, rings=5, sides=4, skinned=skinned, root={})
    carrier = asset.gltf["nodes"][0]
    carrier |= {"translation": [0.0, 1.0, 0.0], "children": [asset.append("nodes", {"name": "badge"})], "camera": 0}
    carrier["extensions"] = {"KHR_node_visibility": {"visible": True}, "KHR_lights_punctual": {"light": 0}}
    carrier["extensions"]["EXT_mesh_gpu_instancing"] = {"attributes": {}}
    clip = asset.gltf["animations"][0]
    for path, values in {"translation": [1.0, 2.0, 3.0], "rotation": [0.0, 0.0, 0.0, 1.0], "scale": [1.0] * 3}.items():
        asset.channel(clip, 0, path, [0.0], [values])
    asset.append("scenes", {"nodes": [0]})
    before = written(asset, tmp_path).gltf
    gltf = halved(written(asset, tmp_path), (1,)).gltf
    part = len(before["nodes"])
    assert len(gltf["nodes"]) == part + 1
    made = gltf["nodes"][part]
    assert (made["translation"], made["name"]) == ([0.0, 1.0, 0.0], "limb_part2")
    assert not {"children", "camera"} & made.keys()
    assert made["extensions"].keys() == {"KHR_node_visibility", "EXT_mesh_gpu_instancing"}
    assert gltf["nodes"][0] == before["nodes"][0]
    above = [each["children"] for each in gltf["nodes"] if 0 in each.get("children", ())] or [
        gltf["scenes"][0]["nodes"]
    ]
    assert above[0][:2] == [0, part]
    assert gltf["scenes"][1]["nodes"] == [0, part]
    moved = {
        node: {
            each["target"]["path"]: each["sampler"]
            for each in gltf["animations"][0]["channels"]
            if each["target"]["node"] == node
        }
        for node in (0, part)
    }
    assert moved[0].keys() == moved[part].keys() == {"weights", "translation", "rotation", "scale"}
    assert {path for path in moved[0] if moved[0][path] != moved[part][path]} == {"weights"}


def test_a_part_has_a_name_even_if_its_node_has_none(tmp_path: Path) -> None:
    asset = limb_asset(morphs=2, primitives=2, rings=5, sides=4)
    del asset.gltf["nodes"][0]["name"]
    asset.gltf["nodes"][1]["name"] = "node_0_part2"
    gltf = halved(written(asset, tmp_path), (1,)).gltf
    assert "name" not in gltf["nodes"][0]
    assert gltf["nodes"][-1]["name"] == "node_0_part2_2"
