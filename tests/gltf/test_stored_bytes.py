"""Bytes of accessors: each place once, sparse ones by what they hold, compressed ones by their share."""

import numpy as np
import pytest

from kit.asset import Asset
from wrinklecli.gltf.document import read_document, stored_bytes


def test_elements_are_padded_and_shared_places_counted_once() -> None:
    asset = Asset()
    floats, bytes_ = asset.accessor(np.ones((5, 3))), asset.accessor(np.ones((5, 3)), "i1")
    twin = len(asset.gltf["accessors"])
    asset.gltf["accessors"].append(dict(asset.gltf["accessors"][floats]))
    assert stored_bytes(asset.gltf, [floats]) == 60
    assert stored_bytes(asset.gltf, [bytes_]) == 20
    assert stored_bytes(asset.gltf, [floats, floats, twin, bytes_]) == 80


@pytest.mark.parametrize(("base", "stored"), [(False, 2 * 14), (True, 2 * 14 + 60)])
def test_sparse_accessors_are_their_base_and_what_takes_its_place(base: bool, stored: int) -> None:
    asset = Asset()
    values = np.zeros((5, 3))
    values[[1, 3]] = 1.0
    index = asset.sparse(values, base=base)
    sparse = asset.gltf["accessors"][index]["sparse"]
    assert sparse["count"] in (2, 5)
    assert stored_bytes(asset.gltf, [index]) == stored + (sparse["count"] - 2) * 14


def test_compressed_views_are_shared_out() -> None:
    from kit.places import ROOT

    gltf = read_document(ROOT / "tests" / "data" / "gltfpack_c.glb").gltf
    (primitive,) = gltf["meshes"][0]["primitives"]
    position = primitive["attributes"]["POSITION"]
    packed = gltf["bufferViews"][gltf["accessors"][position]["bufferView"]]["extensions"]["EXT_meshopt_compression"]
    assert 0 < stored_bytes(gltf, [position]) <= packed["byteLength"]
