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
