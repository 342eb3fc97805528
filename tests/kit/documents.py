"""Documents written, read and compared, for tests of gltf."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from kit.asset import Asset, read_glb
from wrinklecli.gltf.document import Document, read_document


def written(asset: Asset, folder: Path, name: str = "in.glb", **options: Any) -> Document:
    return read_document(asset.write(folder / name, **options))


def same_bits(one: Any, other: Any) -> bool:
    """Equal JSON, with equal types and orders of keys: True is not 1, and 1 is not 1.0."""
    return json.dumps(one) == json.dumps(other)


def arrays(document: Document) -> list[Any]:
    return [document.accessor(k) for k in range(len(document.items("accessors")))]


def assert_tight(path: Path, *, replaced: int) -> None:
    """Check that a .glb's bytes belong to views, but for what alignment to 4 takes.

    That is up to 3 bytes in front of each view, and for each one taken out up to 3 in front and 3 of its own,
    as data behind it moves by multiples of 4 only.
    """
    gltf, data = read_glb(path.read_bytes())
    owned = np.zeros(len(data), bool)
    for view in gltf["bufferViews"]:
        start = view.get("byteOffset", 0)
        owned[start : start + view["byteLength"]] = True
    assert (~owned).sum() <= 3 * (len(gltf["bufferViews"]) + 2 * replaced)
