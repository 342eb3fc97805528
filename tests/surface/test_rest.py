"""The rest pose is the one that the tools file names, and normals and markers are where the surface then is."""

from typing import Any

import numpy as np
import pytest

from kit.garments import ground_of, job_of
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import posed_surface, prepare, unattached
from wrinklecli.errors import BakeError, ConfigError
from wrinklecli.numeric.arrays import face_normals, inverses, singular
from wrinklecli.surface.rest import carried_normals


@pytest.mark.parametrize("rest", ["stored", {"clip": "fold", "time": 1.0}])
def test_marker_is_where_its_node_is_at_rest(rest: Any) -> None:
    asset = limb_asset(rings=9, sides=8)
    place = [0.4, RADIUS + 0.01, 0.0]
    # A child of the joint at the limb's middle: it moves with the fold.
    asset.gltf["nodes"][2]["children"] = [asset.append("nodes", {"name": "here", "translation": place})]
    asset.gltf["nodes"].append({"name": "twice"})
    asset.gltf["nodes"].append({"name": "twice"})
    prepared = prepare(asset, tool(target={"marker": "here"}, width=0.1), rest=rest)
    moved = posed_surface(prepared, None if rest == "stored" else prepared.clip, np.array([1.0]))[0]
    carried = prepared.patch.target.barycentrics @ moved[prepared.patch.target.vertices]
    assert prepared.patch.target.position == pytest.approx(carried, abs=1e-9)
    assert prepared.patch.target.distance == pytest.approx(0.01, abs=1e-6)
    with pytest.raises(BakeError, match=r"target\.marker: 2 nodes are named 'twice'"):
        prepare(asset, tool(target={"marker": "twice"}))


def test_rest_clip_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"rest\.clip: the asset has no clip 'walk'; there are 'fold'"):
        prepare(limb_asset(rings=5, sides=4), rest={"clip": "walk"})


def test_rest_of_a_clip_is_its_pose_then() -> None:
    asset = limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR")
    ends = {"origin": [-0.8, RADIUS, 0], "target": [-0.55, RADIUS, 0], "width": 0.1}
    prepared = prepare(asset, tool(**ends), rest={"clip": "fold", "time": 0.3})
    assert np.array_equal(prepared.rest.positions, posed_surface(prepared, prepared.clip, np.array([0.3]))[0])
    assert prepared.rest.morph_weights == pytest.approx([1.0], abs=1e-7)


def test_bind_rest_is_the_bind_pose_moved_by_the_first_anchor_s_joint() -> None:
    asset = limb_asset(rings=13, sides=8)
    # The stored pose is folded; at bind the limb is straight.
    turn = [0, 0, np.sin(1.0), np.cos(1.0)]
    asset.gltf["nodes"][2]["rotation"] = turn
    prepared = prepare(asset, tool(), rest="bind")
    assert prepared.rest.positions == pytest.approx(prepared.surface.positions, abs=1e-12)
    with pytest.raises(BakeError, match=r"target: is .* from the mesh"):
        prepare(asset, tool(), rest="stored")


KEYS: dict[str, dict[str, str]] = {"fields": {}, "flesh": {"joint": "joint_1"}}


@pytest.mark.parametrize("section", KEYS)
def test_bind_rest_is_that_of_the_main_joint_where_nothing_has_a_place(section: str) -> None:
    """A field lies all over its mesh, and flesh may be what follows a joint."""
    asset = limb_asset(rings=13, sides=8)
    asset.gltf["nodes"][2]["rotation"] = [0, 0, np.sin(1.0), np.cos(1.0)]
    job = job_of(asset, **{section: [{"name": "all", **KEYS[section]}]}, rest="bind")
    ground = ground_of(job)
    assert ground.rest.positions == pytest.approx(ground.surface.positions, abs=1e-12)


@pytest.mark.parametrize("scale", [[1, 1, 1], [-1, 1, 1], [2, 2, 2], [1, 3, 0.5], [-1, -2, -3]])
def test_rest_normals_are_those_of_the_posed_surface(scale: list[float]) -> None:
    """By the inverse transpose a bind normal stays across the surface; where scale mirrors, it still points out."""
    still, moved = (
        unattached(limb_asset(rings=9, sides=12, clip=None, root=each))
        for each in ({}, {"scale": scale, "rotation": [0.1, 0.2, 0.3, 0.9]})
    )
    turn = moved.rest.matrices[0, :3, :3]
    cotangent = still.rest.normals @ np.linalg.inv(turn)
    cotangent /= np.linalg.norm(cotangent, axis=1, keepdims=True)
    assert moved.rest.normals == pytest.approx(cotangent, abs=1e-12)
    # Each triangle's plane turns with it: posed_surface faces, wound as they are, agree up to the mirror's sign.
    surface = moved.surface
    faces = face_normals(moved.rest.positions, surface.triangles) * np.sign(np.linalg.det(turn))
    assert (np.sum(faces[:, None] * moved.rest.normals[surface.triangles], axis=2) > 0).all()


def test_singular_matrices_have_no_inverse_and_carry_no_normal() -> None:
    linear = np.stack([np.diag(d) for d in ([1, 1, 1], [1, 1, 2e-3], [1, 1, 5e-4], [1, 0, 0], [0, 0, 0])])
    blended = np.concatenate([linear, np.zeros((5, 3, 1))], axis=2).astype(float)
    assert singular(blended).tolist() == [False, False, True, True, True]
    assert inverses(blended)[1] == pytest.approx(np.diag([1, 1, 500.0]))
    assert not inverses(blended)[2:].any()
    normals = carried_normals(blended, np.tile([0.0, 0.0, 1.0], (5, 1)))
    assert normals[:2].tolist() == [[0, 0, 1], [0, 0, 1]]
    assert not normals[2:].any()
