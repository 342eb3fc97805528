"""Contacts: vertices with unwelded twins or on another mesh are found, and refinement keeps the edges between them."""

from typing import Any

import numpy as np
import pytest

from kit.asset import Asset
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import prepare
from wrinklecli.character.contacts import Neighbours, contacts_of
from wrinklecli.surface.refine import Refinement


def with_neighbour(places: Any, *, translation: Any = (0, 0, 0), **options: Any) -> Asset:
    """The limb and a static mesh beside it."""
    asset = limb_asset(rings=9, sides=8, **options)
    corners = np.asarray(places, np.float32)
    primitive = {"attributes": {"POSITION": asset.accessor(corners - np.float32(translation), bounds=True)}}
    mesh = asset.append("meshes", {"primitives": [primitive]})
    node = asset.append("nodes", {"name": "neighbour", "mesh": mesh, "translation": list(translation)})
    asset.gltf["scenes"][0]["nodes"].append(node)
    return asset


@pytest.mark.parametrize("translation", [(0, 0, 0), (4, -2, 1)])
def test_vertices_that_touch_another_mesh_are_found_and_their_edges_kept(translation: Any) -> None:
    # Rings of 9 at multiples of 1/4; the top edge of the limb is y = 1/4. Two vertices touch, one is 0.001 off.
    touching = [[0.0, 0.25, 0.0], [0.25, 0.25, 0.0], [-0.25, 0.251, 0.0]]
    prepared = prepare(with_neighbour(touching, translation=translation), refinement={"max_levels": 5})
    contacts = contacts_of(Neighbours(prepared.document), prepared.rig, prepared.surface, prepared.rest.positions)
    assert sorted(prepared.surface.positions[contacts].tolist()) == touching[:2]
    ends = set(np.flatnonzero(contacts).tolist())

    def is_whole(fine: Refinement) -> bool:
        return any(ends <= set(triangle) for triangle in fine.triangles.tolist())

    assert not is_whole(prepared.refined())
    assert is_whole(prepared.refined(contacts=contacts))


def test_vertices_that_no_triangle_uses_touch_nothing() -> None:
    """Meshes may share the vertices of a whole character, and each use its own of them; points use all."""
    asset = with_neighbour([[0.0, 0.25, 0.0], [0.25, 0.25, 0.0], [-0.25, 0.25, 0.0], [0.5, 0.25, 0.0]])
    (primitive,) = asset.gltf["meshes"][-1]["primitives"]
    found = []
    for indices, mode in (([0, 1, 2], 4), ([0, 2, 2], 4), ([3, 0], 0)):
        primitive.update(indices=asset.accessor(np.array(indices), "u2"), mode=mode)
        prepared = prepare(asset)
        contacts = contacts_of(Neighbours(prepared.document), prepared.rig, prepared.surface, prepared.rest.positions)
        found.append(sorted(prepared.surface.positions[contacts][:, 0].tolist()))
    assert found == [[-0.25, 0.0, 0.25], [-0.25, 0.0], [-0.25, 0.0, 0.25, 0.5]]


def test_twins_of_the_own_mesh_are_contacts() -> None:
    asset = limb_asset(rings=9, sides=8, joints=3, primitives=2)
    # The second half's first ring hangs on another joint: not welded, but touching.
    second = asset.gltf["meshes"][0]["primitives"][1]["attributes"]
    joints = np.zeros((45, 4), np.uint8)
    joints[:, 0] = 2
    second["JOINTS_0"] = asset.accessor(joints, "u1")
    second["WEIGHTS_0"] = asset.accessor(np.tile([1.0, 0, 0, 0], (45, 1)))
    prepared = prepare(asset, tool(target=[0.45, RADIUS, 0]))
    contacts = contacts_of(Neighbours(prepared.document), prepared.rig, prepared.surface, prepared.rest.positions)
    assert contacts.sum() == 2 * 8
    assert (prepared.surface.positions[contacts][:, 0] == 0).all()


def test_seam_is_no_contact() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8))
    contacts = contacts_of(Neighbours(prepared.document), prepared.rig, prepared.surface, prepared.rest.positions)
    assert not contacts.any()
