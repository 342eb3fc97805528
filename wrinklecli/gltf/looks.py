"""Tells materials apart by what is seen of them: their names do not count."""

import json
from typing import Any

import numpy as np

from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Ints


def looks_of(document: Document, mesh: int) -> Ints:
    """(primitives,) equal numbers for primitives of a mesh whose materials look the same."""
    known: dict[str, int] = {}
    found = []
    for primitive in document.items("meshes")[mesh]["primitives"]:
        number = primitive.get("material")
        materials = document.items("materials")
        material = materials[number] if isinstance(number, int) and 0 <= number < len(materials) else {}
        found.append(known.setdefault(json.dumps(_look(document, material), sort_keys=True), len(known)))
    return np.array(found, np.intp)


def _look(document: Document, value: Any) -> Any:
    """A material, or a part of one, without names; textures are their images."""
    if not isinstance(value, dict):
        return value
    look = {key: _look(document, each) for key, each in value.items() if key not in ("name", "extras")}
    number, textures = look.get("index"), document.items("textures")
    if isinstance(number, int) and 0 <= number < len(textures):
        look["index"] = _look(document, textures[number])
    return look
