"""Anchors lie on the surface where they were asked for, and the skin carries them."""

import re
from typing import Any

import numpy as np
import pytest

from kit.asset import plate
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import posed_surface, prepare, unattached
from wrinklecli.character.pose import morph_weights, node_matrices
from wrinklecli.errors import BakeError, WrinkleError

EPSILON = 1e-12  # rounding of a few dozen products of numbers near 1


@pytest.mark.quick(1)
@pytest.mark.parametrize("joints", [1, 2, 5])
@pytest.mark.parametrize(
    ("root", "snap", "morphs"),
    [
        (None, "surface", 2),
        (None, "vertex", 0),
        ({"scale": [2, 2, 2], "rotation": [0, 0, 0.6, 0.8]}, "vertex", 2),
        ({"scale": [-1, 3, 1], "translation": [1, 2, 3]}, "surface", 0),
        ({"scale": [-1, 3, 1], "translation": [1, 2, 3]}, "vertex", 2),
    ],
)
def test_anchors_go_where_the_skin_carries_them(snap: str, joints: int, root: Any, morphs: int) -> None:
    asset = limb_asset(
        rings=9, sides=7, joints=joints, root=root, morphs=morphs, morph_clip="CUBICSPLINE", weights_at="node"
    )
    if joints == 1 and not morphs:
        asset.gltf["animations"] = []
    still = prepare(limb_asset(rings=9, sides=7), tool())
    # Ask for the same place of the skin, wherever the root has put it.
    every = posed_surface(unattached(asset), None, np.zeros(1))[0]
    ends = {
        key: (anchor.barycentrics @ every[anchor.vertices]).tolist()
        for key, anchor in (("origin", still.patch.origin), ("target", still.patch.target))
    }
    prepared = prepare(asset, tool(**ends, snap=snap))
    times = np.linspace(-0.2, 2.2, 13)
    clip = prepared.clips[0] if prepared.clips else None
    moved = posed_surface(prepared, clip, times)
    weights = np.concatenate([np.ones((13, 1)), morph_weights(prepared.rig, clip, times)], axis=1)
    for anchor in (prepared.patch.origin, prepared.patch.target):
        nodes = [int(prepared.rig.joints[joint]) for joint in anchor.joints]
        matrices = node_matrices(prepared.rig, clip, times, nodes)
        points = np.tensordot(weights, anchor.carried.points, axes=1)
        carried = np.einsum("fkab,fkb->fa", matrices, points)
        assert carried[:, :3] == pytest.approx(
            np.einsum("c,fcx->fx", anchor.barycentrics, moved[:, anchor.vertices]), abs=20 * EPSILON
        )
        assert carried[:, 3] == pytest.approx(1.0, abs=EPSILON)
        assert anchor.position == pytest.approx(
            anchor.barycentrics @ prepared.rest.positions[anchor.vertices], abs=10 * EPSILON
        )
        assert len(anchor.vertices) == 1 or snap == "surface"


def test_anchor_on_the_surface_is_where_it_was_asked_for() -> None:
    prepared = prepare(limb_asset(rings=8, sides=16), tool(origin=[-0.31, RADIUS, 0], target=[0.33, RADIUS, 0]))
    patch = prepared.patch
    # Ring 3 of 8 lies at -1/7, ring 4 at 1/7; the top edge runs along x, so both places are on it.
    assert patch.origin.position == pytest.approx([-0.31, RADIUS, 0], abs=1e-7)
    assert patch.target.position == pytest.approx([0.33, RADIUS, 0], abs=1e-7)
    assert patch.span == pytest.approx(0.64, abs=1e-7)
    assert patch.along == pytest.approx([1, 0, 0], abs=1e-7)
    assert patch.origin.normal == pytest.approx([0, 1, 0], abs=1e-6)
    assert len(patch.origin.vertices) == 2
    assert patch.origin.distance == pytest.approx(0, abs=1e-7)


def test_snap_vertex_takes_the_nearest_vertex_even_of_another_triangle() -> None:
    # The point is over the long triangle, but the nearest vertex belongs to the other one.
    places = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [5.3, 5.3, 0], [10, 10, 0], [6, 5, 0], [99, 99, 0]], float)
    faces = [[0, 1, 2], [3, 5, 4]]
    prepared = prepare(plate(places, faces), tool(origin=[4.9, 4.9, 0], target=[0.5, 0.5, 0], width=1, snap="vertex"))
    assert prepared.patch.origin.position.tolist() == pytest.approx([5.3, 5.3, 0], abs=1e-6)
    assert prepared.patch.target.position.tolist() == [0, 0, 0]
    assert prepared.patch.origin.distance == pytest.approx(0.4 * np.sqrt(2), abs=1e-6)


def test_snap_ignores_vertices_without_triangles() -> None:
    places = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0.5, 0.5, 0]], float)
    ends = {"origin": [0.5, 0.5, 0], "target": [9.5, 0, 0]}
    patch = prepare(plate(places, [[0, 1, 2]]), tool(**ends, width=1, snap="vertex")).patch
    assert patch.origin.position.tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("up", "given", "hint"),
    [
        ("y", [-0.4, 0.0, RADIUS], ""),  # on the mesh
        ("y", [3.0, 3.0, 3.0], "far"),
        ("y", [0.0, -0.05, 1.4], "with `up: z` it would lie on it"),
        ("z", [0.0, 1.4, -0.05], "with `up: y` it would lie on it"),
        ("z", [0.0, 3.0, 3.0], "far"),
    ],
)
def test_far_anchor_says_how_far_and_whether_the_other_axis_was_meant(up: str, given: list[float], hint: str) -> None:
    """A limb that stands along y from 0.5 to 2.5: read with the other up axis it lies elsewhere."""
    root = {"rotation": [0, 0, np.sqrt(0.5), np.sqrt(0.5)], "translation": [0, 1.5, 0]} if hint else None
    asset = limb_asset(rings=9, sides=8, root=root)
    other = [0.4, RADIUS, 0] if not hint else [0.0, 0.6, RADIUS] if up == "y" else [0.0, -RADIUS, 0.6]
    if hint == "far":
        with pytest.raises(BakeError) as caught:
            prepare(asset, tool(origin=given, target=other), up=up)
        assert "with `up" not in str(caught.value)
        assert "more than a quarter of its segment" in str(caught.value)
    elif hint:
        with pytest.raises(BakeError, match=r"tools\.yaml:1: tools\[0\]\.origin: is .*" + hint):
            prepare(asset, tool(origin=given, target=other), up=up)
    else:
        assert prepare(asset, tool(origin=given, target=other, width=0.1), up=up).patch.origin.distance < 0.01


def test_far_anchor_distance_is_that_from_the_mesh() -> None:
    # A segment of 0.8 may be 0.2 off; the limb's top is flat along x.
    near, far = RADIUS + 0.1999, RADIUS + 0.2001
    asset = limb_asset(rings=9, sides=8)
    patch = prepare(asset, tool(origin=[-0.4, near, 0], target=[0.4, near, 0])).patch
    assert patch.origin.distance == pytest.approx(0.1999, abs=1e-6)
    with pytest.raises(WrinkleError) as caught:
        prepare(asset, tool(origin=[-0.4, far, 0], target=[0.4, far, 0]))
    message = "is 0.2001 from the mesh, more than a quarter of its segment of 0.8; the nearest point is [-0.4, 0.25, 0]"
    assert str(caught.value) == f"tools.yaml:1: tools[0].origin: {message}"


@pytest.mark.parametrize("up", ["y", "z"])
def test_nearest_point_of_a_far_anchor_is_said_in_the_file_s_axes(up: str) -> None:
    """What the message says can be pasted into the file."""
    asset = limb_asset(rings=9, sides=8)
    ends = {"origin": [-0.4, 0.5, 0.0], "target": [0.4, RADIUS, 0.0]}
    if up == "z":
        ends = {key: [x, -z, y] for key, (x, y, z) in ends.items()}
    with pytest.raises(BakeError) as caught:
        prepare(asset, tool(**ends), up=up)
    found = re.search(r"nearest point is \[(.*?)\]", str(caught.value))
    assert found is not None
    point = [float(number) for number in found[1].split(", ")]
    patch = prepare(asset, tool(**ends | {"origin": point}), up=up).patch
    assert patch.origin.position == pytest.approx([-0.4, RADIUS, 0], abs=1e-6)


def test_anchor_at_singular_joints_is_refused() -> None:
    asset = limb_asset(rings=9, sides=8, root={"scale": [1, 1, 1e-4]})
    with pytest.raises(BakeError, match=r"tools\[0\]\.origin: the joints here are singular at rest"):
        prepare(asset, tool())


@pytest.mark.parametrize(("at", "triangles"), [((0.7, 0.2), [0]), ((0.5, 0.5), [0, 1]), ((1.0, 1.0), [0, 1, 3])])
def test_an_anchor_is_on_all_triangles_that_have_its_place(at: tuple[float, float], triangles: list[int]) -> None:
    """Anchors lie in a triangle, on the edge of two, or at the corner of three; a fourth only touches their corners."""
    places = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0]], float)
    faces = [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]
    prepared = prepare(plate(places, faces), tool(origin=[*at, 0], target=[1.8, 0.1, 0], width=1))
    assert sorted(prepared.patch.origin.triangles.tolist()) == triangles
