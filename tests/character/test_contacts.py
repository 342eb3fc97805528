"""Contacts: vertices with unwelded twins or on another mesh are found, and refinement keeps the edges between them."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset, Json, attribute, stored
from kit.limb import RADIUS, limb_asset, limb_positions, tool
from kit.prepared import Prepared, prepare
from wrinklecli.character.contacts import Contacts, Neighbours, contacts_of
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
    contacts = contacts_in(prepared).held
    assert sorted(prepared.surface.positions[contacts].tolist()) == touching[:2]
    ends = set(np.flatnonzero(contacts).tolist())

    def is_whole(fine: Refinement) -> bool:
        return any(ends <= set(triangle) for triangle in fine.triangles.tolist())

    assert not is_whole(prepared.refined())
    assert is_whole(prepared.refined(contacts=contacts))


def contacts_in(prepared: Prepared) -> Contacts:
    return contacts_of(Neighbours(prepared.document), prepared.rig, prepared.surface, prepared.rest.positions)


def test_vertices_that_no_triangle_uses_touch_nothing() -> None:
    """Meshes may share the vertices of a whole character, and each use its own of them; points use all."""
    asset = with_neighbour([[0.0, 0.25, 0.0], [0.25, 0.25, 0.0], [-0.25, 0.25, 0.0], [0.5, 0.25, 0.0]])
    (primitive,) = asset.gltf["meshes"][-1]["primitives"]
    found = []
    for indices, mode in (([0, 1, 2], 4), ([0, 2, 2], 4), ([3, 0], 0)):
        primitive.update(indices=asset.accessor(np.array(indices), "u2"), mode=mode)
        prepared = prepare(asset)
        contacts = contacts_in(prepared).held
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
    contacts = contacts_in(prepared).held
    assert contacts.sum() == 2 * 8
    assert (prepared.surface.positions[contacts][:, 0] == 0).all()


def test_seam_is_no_contact() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8))
    contacts = contacts_in(prepared).held
    assert not contacts.any()


def coarser(asset: Asset) -> Asset:
    """The limb, and a level of detail of every second ring, `coarse`, that stands where the limb does."""
    positions = attribute(asset, 0, "POSITION").reshape(9, 9, 3)[::2]
    grid = np.arange(45).reshape(5, 9)
    a, b, c, d = (each.ravel() for each in (grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]))
    faces = asset.accessor(np.stack([a, b, c, b, d, c], axis=1).ravel(), "u2")
    primitive = {"attributes": {"POSITION": asset.accessor(positions.reshape(-1, 3), bounds=True)}, "indices": faces}
    mesh = asset.append("meshes", {"primitives": [primitive]})
    asset.append("nodes", {"name": "coarse", "mesh": mesh})
    return asset


def test_a_copy_and_a_coarser_level_hold_nothing_but_a_cap_does() -> None:
    """Copies meet the mesh within, neighbours at borders: a cap has all its vertices on the border of the limb."""
    coarse = coarser(limb_asset(rings=9, sides=8))
    twin = limb_asset(rings=9, sides=8)
    twin.append("nodes", {"name": "twin", "mesh": 0, "skin": 0})
    ring = limb_positions(np.full(8, 8), np.arange(8), 9, 8)[0]
    cap = with_neighbour(ring)
    cap.gltf["meshes"][-1]["primitives"][0]["indices"] = cap.accessor(
        np.stack([0 * np.arange(6), np.arange(1, 7), np.arange(2, 8)], axis=1).ravel(), "u2"
    )
    for asset, node, held in ((coarse, -1, 0), (twin, -1, 0), (cap, None, 8)):
        if node is not None:
            asset.gltf["scenes"][0]["nodes"].append(len(asset.gltf["nodes"]) - 1)
        found = contacts_in(prepare(asset, tool(node="limb")))
        assert found.held.sum() == held
        assert found.copies == (() if held else (len(asset.gltf["nodes"]) - 1,))


def test_only_meshes_that_are_drawn_together_hold_each_other() -> None:
    touching = [[0.0, 0.25, 0.0], [0.25, 0.25, 0.0], [-0.25, 0.25, 0.0]]

    def changed(change: Callable[[Json, int], object]) -> int:
        asset = with_neighbour(touching)
        change(asset.gltf, len(asset.gltf["nodes"]) - 1)
        return int(contacts_in(prepare(asset, tool(node="limb"))).held.sum())

    def elsewhere(gltf: Json, node: int) -> None:
        gltf["scenes"][0]["nodes"].remove(node)
        gltf["scenes"].append({"nodes": [node]})

    assert changed(lambda gltf, node: gltf["nodes"][node].update(scale=[1, 1, 1])) == 3
    assert changed(lambda gltf, node: gltf["scenes"][0]["nodes"].remove(node)) == 0
    assert changed(elsewhere) == 0
    assert changed(lambda gltf, node: gltf["nodes"][node].update(scale=[0, 0, 0])) == 0
    hidden = {"extensions": {"KHR_node_visibility": {"visible": False}}}
    assert changed(lambda gltf, node: gltf["nodes"][node].update(hidden)) == 0
    assert changed(lambda gltf, node: gltf["nodes"][0].update(extensions={"MSFT_lod": {"ids": [node]}})) == 0


def test_a_mesh_that_is_not_finite_holds_nothing_and_is_named() -> None:
    asset = with_neighbour([[0.0, 0.25, 0.0], [0.25, 0.25, 0.0], [-0.25, 0.25, 0.0]])
    accessor = asset.gltf["meshes"][1]["primitives"][0]["attributes"]["POSITION"]
    stored(asset, accessor)[2, 1] = np.nan
    prepared = prepare(asset)
    contacts = contacts_in(prepared)
    assert not contacts.held.any()
    assert list(contacts.unread) == [len(asset.gltf["nodes"]) - 1]
    (line,) = contacts.unread.values()
    assert "#/meshes/1/primitives/0: POSITION (accessor" in line
    assert "of vertex 2 is not a finite number" in line
