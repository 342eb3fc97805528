"""Documents joined with clips: they play as the clips do, and what was there stays."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.asset import Array, Asset, Interpolation
from kit.limb import limb_asset
from kit.prepared import as_document, rotation_matrix
from wrinklecli.character.clip import read_clips
from wrinklecli.character.joined import with_clips, with_free_nodes
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import read_rig
from wrinklecli.gltf.document import Document


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_joined_clips_are_those_that_were_joined(interpolation: Interpolation) -> None:
    document = as_document(
        limb_asset(rings=3, sides=4, morphs=2, morph_clip=interpolation, interpolation=interpolation)
    )
    before = json.dumps(document.gltf)
    (clip,) = read_clips(document)
    joined = with_clips(document, [clip, clip])
    found = read_clips(joined)
    assert [(each.name, each.index) for each in found] == [("fold", 0), ("fold#1", 1), ("fold#2", 2)]
    assert all(each.moves_as(clip) for each in found)
    assert json.dumps(document.gltf) == before
    assert joined.gltf["accessors"][: len(document.gltf["accessors"])] == document.gltf["accessors"]
    # Channels of the same key times share them.
    inputs = {sampler["input"] for sampler in joined.gltf["animations"][1]["samplers"]}
    assert len(inputs) == len({each.times.tobytes() for each in clip.channels})


def stored_as(matrix: Array) -> Document:
    """A document of one node, which is stored as a matrix."""
    gltf = {"asset": {"version": "2.0"}, "nodes": [{"mesh": 0, "matrix": matrix.T.ravel().tolist()}]}
    return as_document(Asset(gltf | {"meshes": [{"primitives": [{"attributes": {}}]}]}))


@pytest.mark.parametrize("largest", range(4))
@given(seed=st.integers(0, 2**32 - 1), mirrored=st.booleans())
def test_a_matrix_is_taken_apart_into_what_gives_it_again(largest: int, seed: int, *, mirrored: bool) -> None:
    """Each component of the quaternion is the largest once, since each has its own formula."""
    random = np.random.default_rng(seed)
    matrix = np.eye(4)
    scale = 10.0 ** random.uniform(-3, 3, 3) * [-1.0 if mirrored else 1.0, 1.0, 1.0]
    quaternion = random.uniform(-0.5, 0.5, size=4)
    quaternion[largest] = random.choice([-1.0, 1.0])
    matrix[:3, :3] = rotation_matrix(quaternion) * scale
    matrix[:3, 3] = random.normal(size=3)
    document = stored_as(matrix)
    freed = with_free_nodes(document, [0])
    assert freed.gltf["nodes"][0].keys() == {"mesh", "translation", "rotation", "scale"}
    assert freed.gltf["nodes"][0]["scale"] == pytest.approx(scale, rel=1e-9)
    found = node_matrices(read_rig(freed, 0), None, np.zeros(1), [0])[0, 0]
    assert found == pytest.approx(matrix, abs=1e-9 * np.abs(matrix).max())
    assert "matrix" in document.gltf["nodes"][0]


def test_what_shears_or_is_flat_stays_a_matrix() -> None:
    sheared, flat = np.eye(4), np.diag([1.0, 0.0, 1.0, 1.0])
    sheared[0, 1] = 0.01
    for matrix in (sheared, flat):
        document = stored_as(matrix)
        assert with_free_nodes(document, [0]) is document
