"""Tools attached at rest: anchors that the skin carries, members of the near side only, lengths without scale."""

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kit.asset import Asset
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import Prepared, as_document, prepare
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.pose import blend, joint_matrices, morph_weights, node_matrices, transform
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.errors import BakeError, ConfigError, WrinkleError
from wrinklecli.method.activity import lengths_over_time
from wrinklecli.method.rest import carried_normals, rest_pose
from wrinklecli.numeric.arrays import face_normals, inverses, singular, vertex_normals
from wrinklecli.tools.records import Length, ToolsFile

Floats = NDArray[np.float64]

EPSILON = 1e-12  # rounding of a few dozen products of numbers near 1


def posed(prepared: Prepared, clip: Clip | None, times: Floats) -> Floats:
    """(frames, vertices, 3) of the coarse surface, morph targets first."""
    surface, rig = prepared.surface, prepared.rig
    weights = surface.dense_weights(np.arange(len(surface.positions)), len(rig.joints))
    morphed = surface.positions + np.tensordot(morph_weights(rig, clip, times), surface.morph_deltas, axes=1)
    return transform(blend(weights, joint_matrices(rig, clip, times)), morphed)


def unattached(asset: Asset) -> Prepared:
    """An asset at rest, without tools."""
    document = as_document(asset)
    rig, clips = read_rig(document, 0), read_clips(document)
    surface, settings = read_surface(document, rig), ToolsFile(path="tools.yaml", tools=())
    return Prepared(document, rig, surface, clips, settings, rest_pose(surface, rig, settings, clips, []), [])


def plate(positions: Any, faces: Any) -> Asset:
    """An unskinned mesh with one morph target that does nothing."""
    asset = Asset()
    asset.append(
        "meshes",
        {
            "primitives": [
                {
                    "attributes": {"POSITION": asset.accessor(positions)},
                    "indices": asset.accessor(np.ravel(faces), "u2"),
                    "targets": [{"POSITION": asset.accessor(np.zeros_like(positions, dtype=float))}],
                }
            ]
        },
    )
    asset.append("nodes", {"mesh": 0})
    return asset


# --- Anchors ---


@pytest.mark.parametrize("snap", ["surface", "vertex"])
@pytest.mark.parametrize("joints", [1, 2, 5])
@pytest.mark.parametrize(
    "root", [None, {"scale": [2, 2, 2], "rotation": [0, 0, 0.6, 0.8]}, {"scale": [-1, 3, 1], "translation": [1, 2, 3]}]
)
@pytest.mark.parametrize("morphs", [0, 2])
def test_anchors_go_where_the_skin_carries_them(snap: str, joints: int, root: Any, morphs: int) -> None:
    asset = limb_asset(
        rings=9, sides=7, joints=joints, root=root, morphs=morphs, morph_clip="CUBICSPLINE", weights_at="node"
    )
    if joints == 1 and not morphs:
        asset.gltf["animations"] = []
    still = prepare(limb_asset(rings=9, sides=7), tool())
    # Ask for the same place of the skin, wherever the root has put it.
    every = posed(unattached(asset), None, np.zeros(1))[0]
    ends = {
        key: (anchor.barycentrics @ every[anchor.vertices]).tolist()
        for key, anchor in (("origin", still.patch.origin), ("target", still.patch.target))
    }
    prepared = prepare(asset, tool(**ends, snap=snap))
    times = np.linspace(-0.2, 2.2, 13)
    clip = prepared.clips[0] if prepared.clips else None
    moved = posed(prepared, clip, times)
    weights = np.concatenate([np.ones((13, 1)), morph_weights(prepared.rig, clip, times)], axis=1)
    for anchor in (prepared.patch.origin, prepared.patch.target):
        nodes = [int(prepared.rig.joints[joint]) for joint in anchor.joints]
        matrices = node_matrices(prepared.rig, clip, times, nodes)
        points = np.tensordot(weights, anchor.points, axes=1)
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


def test_patch_normal_is_the_anchors_mean_made_square_to_the_segment() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), tool(target=[0.4, 0.0, RADIUS], width=0.1))
    patch = prepared.patch
    mean = patch.origin.normal + patch.target.normal
    assert abs(mean @ patch.along) < 1e-3, "by symmetry"
    bent = prepare(limb_asset(rings=9, sides=8), tool(target=[1.0, 0.0, RADIUS], origin=[0.9, RADIUS, 0], width=0.1))
    cone = prepare(
        plate(
            np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1], [2, 1, 0], [2, 1, 1]], float),
            [[0, 2, 1], [1, 2, 3], [1, 3, 4], [4, 3, 5]],
        ),
        tool(origin=[0.1, 0, 0.5], target=[1.9, 0.9, 0.5], width=0.2),
    )
    for each in (bent.patch, cone.patch):
        mean = each.origin.normal + each.target.normal
        plane = np.cross(np.cross(each.along, mean), each.along)
        assert each.normal == pytest.approx(plane / np.linalg.norm(plane), abs=1e-12)
        assert each.normal @ each.along == pytest.approx(0, abs=1e-12)
    one = cone.patch.origin.normal + cone.patch.target.normal
    assert abs(one @ cone.patch.along) > 0.05, "the case is one"


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


def test_problems_of_all_tools_are_reported_at_once() -> None:
    tools = [
        tool(name="far", origin=[9, 9, 9]),
        tool(name="good"),
        tool(name="marker", target={"marker": "join_1"}),
        tool(name="morph", rest_length={"morph": "smile", "full": "120%"}),
        tool(name="point", origin=[0, 0.3, 0], target=[0, 0.3, 1e-12], width=0.1),
    ]
    with pytest.raises(BakeError) as caught:
        prepare(limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR"), *tools)
    lines = caught.value.lines
    assert len(lines) == 4
    assert "tools[0].origin: is" in lines[0]
    assert "marker 'join_1' is not a node of the asset; did you mean 'joint_1'?" in lines[1]
    assert "tools[3].rest_length.morph: 'smile' is not a morph target of the mesh; it has 'morph_0'" in lines[2]
    assert "tools[4]" in lines[3]


@pytest.mark.parametrize("rest", ["stored", {"clip": "fold", "time": 1.0}])
def test_marker_is_where_its_node_is_at_rest(rest: Any) -> None:
    asset = limb_asset(rings=9, sides=8)
    place = [0.4, RADIUS + 0.01, 0.0]
    # A child of the joint at the limb's middle: it moves with the fold.
    asset.gltf["nodes"][2]["children"] = [asset.append("nodes", {"name": "here", "translation": place})]
    asset.gltf["nodes"].append({"name": "twice"})
    asset.gltf["nodes"].append({"name": "twice"})
    prepared = prepare(asset, tool(target={"marker": "here"}, width=0.1), rest=rest)
    moved = posed(prepared, None if rest == "stored" else prepared.clip, np.array([1.0]))[0]
    carried = prepared.patch.target.barycentrics @ moved[prepared.patch.target.vertices]
    assert prepared.patch.target.position == pytest.approx(carried, abs=1e-9)
    assert prepared.patch.target.distance == pytest.approx(0.01, abs=1e-6)
    with pytest.raises(BakeError, match="marker 'twice' is the name of 2 nodes"):
        prepare(asset, tool(target={"marker": "twice"}))


def test_rest_clip_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"tools\.yaml: rest\.clip: 'walk' is not a clip of the asset; it has 'fold'"):
        prepare(limb_asset(rings=5, sides=4), rest={"clip": "walk"})


def test_rest_of_a_clip_is_its_pose_then() -> None:
    asset = limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR")
    ends = {"origin": [-0.8, RADIUS, 0], "target": [-0.55, RADIUS, 0], "width": 0.1}
    prepared = prepare(asset, tool(**ends), rest={"clip": "fold", "time": 0.3})
    assert np.array_equal(prepared.rest.positions, posed(prepared, prepared.clip, np.array([0.3]))[0])
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


def test_anchor_at_singular_joints_is_refused() -> None:
    asset = limb_asset(rings=9, sides=8, root={"scale": [1, 1, 1e-4]})
    with pytest.raises(BakeError, match=r"tools\[0\]\.origin: the joints here are singular at rest"):
        prepare(asset, tool())


def test_segment_without_length_is_refused() -> None:
    asset = limb_asset(rings=9, sides=8)
    # Only markers can coincide: positions that do are the tools file's fault.
    asset.gltf["nodes"] += [{"name": name, "translation": [0.25, RADIUS, 0]} for name in ("a", "b")]
    with pytest.raises(BakeError, match=r"tools\[0\]: origin and target are one point of the mesh"):
        prepare(asset, tool(origin={"marker": "a"}, target={"marker": "b"}))


def test_ends_that_face_opposite_ways_are_refused() -> None:
    with pytest.raises(BakeError, match="faces opposite ways"):
        prepare(limb_asset(rings=9, sides=8), tool(origin=[0, RADIUS, 0], target=[0, -RADIUS, 0]))


# --- Members ---


def test_members_face_the_patch_and_are_never_on_the_back_of_a_thin_limb() -> None:
    # Wider than the limb is thick: u and v of the back lie within the patch too.
    prepared = prepare(limb_asset(rings=17, sides=16), tool(width=1.0))
    members = prepared.surface.triangles[prepared.patch.members]
    assert prepared.patch.members.sum() > 16
    normals = face_normals(prepared.rest.positions, members)
    assert (normals @ prepared.patch.normal > 0).all()
    assert (prepared.rest.positions[members].mean(axis=1)[:, 1] > 0).all()


@pytest.mark.parametrize("width", [0.05, 0.2, 1.0])
@pytest.mark.parametrize("root", [None, {"scale": [1, -1, 1]}, {"scale": [2, 2, 2]}])
def test_members_are_the_connected_facing_triangles_that_the_patch_meets(width: float, root: Any) -> None:
    factor = np.array((root or {}).get("scale", [1, 1, 1]), float)
    ends = {key: (np.array(tool()[key]) * factor).tolist() for key in ("origin", "target")}
    prepared = prepare(limb_asset(rings=17, sides=12, root=root), tool(**ends, width=width))
    surface, patch = prepared.surface, prepared.patch
    u, v = patch.coordinates(prepared.rest.positions)
    # On a tube the facing triangles hang together: here flooding reaches all that meet the box.
    outward = vertex_normals(surface.positions, surface.triangles) * np.sign(factor)
    for face, corners in enumerate(surface.triangles):
        normal = np.cross(*(prepared.rest.positions[corners[1:]] - prepared.rest.positions[corners[0]]))
        normal *= np.sign(normal @ outward[corners].sum(axis=0))
        meets = u[corners].max() >= 0 and u[corners].min() <= 1 and v[corners].max() >= -1 and v[corners].min() <= 1
        assert patch.members[face] == (meets and normal @ patch.normal > 0)


def test_what_is_not_connected_to_an_anchor_is_no_member() -> None:
    # Two sheets over one another, both facing up; and a third beside the first, within the patch's width.
    square = np.array([[0, 0, 0], [4, 0, 0], [4, 1, 0], [0, 1, 0]], float)
    above, beside = np.array([0, 0, 0.2]), np.array([0, 1.5, 0])
    places = np.concatenate([square, square + above, square + beside])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(3)])
    prepared = prepare(plate(places, faces), tool(origin=[0.5, 0.5, 0], target=[3.5, 0.5, 0], width=9))
    assert prepared.patch.members.tolist() == [True, True, False, False, False, False]


def test_patch_within_one_triangle_has_it_as_its_only_member() -> None:
    places = np.array([[0, 0, 0], [10, 0, 0], [0, 10, 0], [10, -10, 0]], float)
    prepared = prepare(plate(places, [[0, 1, 2], [0, 3, 1]]), tool(origin=[2, 2, 0], target=[3, 2, 0], width=0.5))
    assert prepared.patch.members.tolist() == [True, False]
    assert prepared.patch.normal.tolist() == [0, 0, 1]


# --- Coordinates and profiles ---


def test_coordinates_of_the_segment_and_the_edges() -> None:
    patch = prepare(limb_asset(rings=9, sides=16), tool(width="50%")).patch
    across = np.cross(patch.along, patch.normal)
    assert patch.half_width == pytest.approx(0.2, abs=1e-7)
    middle = (patch.origin.position + patch.target.position) / 2
    places = np.array(
        [patch.origin.position, patch.target.position, middle + 0.2 * across, middle - 0.1 * across + 3 * patch.normal]
    )
    u, v = patch.coordinates(places)
    assert u == pytest.approx([0, 1, 0.5, 0.5], abs=1e-6)
    assert v == pytest.approx([0, 0, 1, -0.5], abs=1e-6)


@pytest.mark.parametrize("strength", [1.0, -0.5])
def test_attenuation_profiles(strength: float) -> None:
    prepared = prepare(limb_asset(rings=9, sides=16), tool(strength=strength))
    bell = prepared.patch
    linear = replace(bell, tool=replace(bell.tool, attenuation="linear"))
    v = np.linspace(-1.2, 1.2, 49)
    normals = np.tile(bell.normal, (49, 1))
    half = np.full(49, 0.5)
    inside = np.abs(v) <= 1
    wanted_linear = np.where(inside, 1 - np.abs(v), 0)
    # The soft object of Wyvill, McPheeters and Wyvill: 1 - 4/9 v^6 + 17/9 v^4 - 22/9 v^2.
    wanted_bell = np.where(inside, 1 - 4 / 9 * v**6 + 17 / 9 * v**4 - 22 / 9 * v**2, 0)
    assert linear.magnitudes(half, v, normals) == pytest.approx(strength * wanted_linear, abs=1e-15)
    assert bell.magnitudes(half, v, normals) == pytest.approx(strength * wanted_bell, abs=1e-15)


def test_bell_is_1_in_the_middle_half_at_a_half_0_at_the_end_and_flat_there() -> None:
    patch = prepare(limb_asset(rings=9, sides=16)).patch
    step = 1e-6

    def bell(v: Any) -> Floats:
        v = np.atleast_1d(v)
        return patch.magnitudes(np.full(len(v), 0.5), v, np.tile(patch.normal, (len(v), 1)))

    assert bell([0.0, 0.5, -0.5, 1.0, -1.0]) == pytest.approx([1, 0.5, 0.5, 0, 0], abs=1e-15)
    # Second order: a step of 1e-6 changes a flat end by its square; curvatures are at most 9 here.
    assert bell([step, 1 - step, -1 + step]) == pytest.approx([1, 0, 0], abs=9 * step**2)
    assert (np.diff(bell(np.linspace(0, 1, 101))) < 0).all()


def test_displacement_fades_as_the_surface_turns_away() -> None:
    patch = prepare(limb_asset(rings=9, sides=16)).patch
    across = np.cross(patch.along, patch.normal)
    cosines = np.array([1.0, 0.6, 0.4, 0.2, 0.0, -1.0])
    normals = cosines[:, None] * patch.normal + np.sqrt(1 - cosines**2)[:, None] * across
    middle = np.full(6, 0.5), np.zeros(6)
    assert patch.magnitudes(*middle, normals) == pytest.approx([1, 1, 0.5, 0, 0, 0], abs=1e-14)


@pytest.mark.parametrize(("u", "v"), [(-1e-9, 0), (1 + 1e-9, 0), (0.5, 1 + 1e-9), (0.5, -1 - 1e-9)])
def test_outside_the_patch_the_magnitude_is_exactly_0(u: float, v: float) -> None:
    patch = prepare(limb_asset(rings=9, sides=16)).patch
    assert patch.magnitudes(np.array([u]), np.array([float(v)]), patch.normal[None])[0] == 0.0


@pytest.mark.parametrize(
    ("strength", "clips", "shape", "in_fold"),
    [(1.0, {}, 1.0, 1.0), (2.0, {"fold": 1.0}, 2.0, 0.5), (0.0, {"fold": -0.5, "a": 0.1}, -0.5, 1.0), (0, {}, 0, 0)],
)
def test_strength_in_shape_times_that_in_clip_is_what_was_asked(
    strength: float, clips: Any, shape: float, in_fold: float
) -> None:
    prepared = prepare(limb_asset(rings=9, sides=16), tool(strength=strength, clips=clips))
    assert prepared.patch.shape_strength == shape
    assert prepared.patch.clip_strength(prepared.clip) == in_fold
    assert prepared.patch.clip_strength(None) * shape == strength


# --- Rest ---


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
    # Each triangle's plane turns with it: posed faces, wound as they are, agree up to the mirror's sign.
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


# --- Lengths over time ---


def test_distance_is_that_of_the_posed_anchors() -> None:
    prepared = prepare(limb_asset(rings=17, sides=9, morphs=1, morph_clip="STEP"), tool())
    times = np.linspace(0, 2, 21)
    moved = posed(prepared, prepared.clip, times)
    ends = [
        np.einsum("c,fcx->fx", anchor.barycentrics, moved[:, anchor.vertices])
        for anchor in (prepared.patch.origin, prepared.patch.target)
    ]
    distances, lengths = lengths_over_time(prepared.patch, prepared.rig, prepared.rest, prepared.clip, times)
    assert distances == pytest.approx(np.linalg.norm(ends[1] - ends[0], axis=1), abs=EPSILON)
    assert distances.min() < 0.7 * prepared.patch.span
    assert lengths == pytest.approx(prepared.patch.span, abs=0)


def test_nothing_shortens_at_rest() -> None:
    for asset in (limb_asset(rings=9, sides=8), limb_asset(rings=9, sides=8, clip=None)):
        prepared = prepare(asset)
        clip = prepared.clips[0] if prepared.clips else None
        distances, lengths = lengths_over_time(prepared.patch, prepared.rig, prepared.rest, clip, np.zeros(1))
        assert distances == pytest.approx(prepared.patch.span, rel=EPSILON)
        assert prepared.patch.curve.shortening(distances, lengths).tolist() == [0.0]


@pytest.mark.parametrize("skinned", [True, False])
@pytest.mark.parametrize("factor", [0.01, 0.5, 3.0])
def test_animated_uniform_scale_is_no_shortening(skinned: bool, factor: float) -> None:
    asset = limb_asset(rings=9, sides=8, skinned=skinned, morphs=1, clip=None, root={"scale": [2, 2, 2]})
    animation: dict[str, Any] = {"name": "grow"}
    asset.channel(animation, len(asset.gltf["nodes"]) - 1, "scale", [0, 1], [[2.0] * 3, [2.0 * factor] * 3])
    asset.append("animations", animation)
    prepared = prepare(asset, tool(origin=[-0.8, 2 * RADIUS, 0], target=[0.8, 2 * RADIUS, 0]))
    distances, _ = lengths_over_time(prepared.patch, prepared.rig, prepared.rest, prepared.clip, np.linspace(0, 1, 9))
    assert distances == pytest.approx(prepared.patch.span, rel=1e-12)


def test_character_hidden_by_scale_makes_no_wrinkles() -> None:
    asset = limb_asset(rings=9, sides=8, clip=None, root={})
    animation: dict[str, Any] = {"name": "hide"}
    asset.channel(animation, 3, "scale", [0, 1, 2], [[1.0] * 3, [0.0] * 3, [1e-7] * 3])
    asset.append("animations", animation)
    prepared = prepare(asset)
    distances, lengths = lengths_over_time(
        prepared.patch, prepared.rig, prepared.rest, prepared.clip, np.array([0.0, 1.0, 2.0])
    )
    assert np.isinf(distances).tolist() == [False, True, True]
    assert prepared.patch.curve.shortening(distances, lengths).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("wanted", "nominal", "greatest"),
    [
        ("auto", 0.8, 0.8),
        (0.9, 0.9, 0.9),
        ("110%", 0.88, 0.88),
        ("50%", 0.4, 0.4),
        ({"keys": {"fold": [[0, 0.8], [1, "150%"]]}}, 0.8, 1.2),
        ({"keys": {"fold": [[0, 0.1], [1, "50%"]]}}, 0.8, 0.8),
        ({"morph": "morph_0", "full": "125%"}, 0.8, 1.0),
        ({"morph": "morph_0", "full": 0.2}, 0.8, 0.8),
    ],
)
def test_rest_lengths(wanted: Any, nominal: float, greatest: float) -> None:
    asset = limb_asset(rings=9, sides=8, morphs=1, morph_clip="LINEAR")
    patch = prepare(asset, tool(rest_length=wanted)).patch
    assert patch.span == pytest.approx(0.8, abs=1e-7)
    assert patch.rest_length == pytest.approx(nominal, abs=2e-7)
    assert patch.curve.rest_length == patch.rest_length
    assert patch.curve.greatest_rest_length == pytest.approx(greatest, abs=2e-7)


def test_keyed_rest_length_runs_straight_between_keys_in_its_clip_alone() -> None:
    keys = {"fold": [[0.5, 0.6], [1.0, "100%"], [2.0, 1.0]]}
    prepared = prepare(limb_asset(rings=9, sides=8), tool(rest_length={"keys": keys}))
    assert prepared.patch.keyed_clips == {"fold"}
    times = np.array([0.0, 0.5, 0.75, 1.0, 1.5, 3.0])
    other = replace(prepared.clip, name="other")

    def lengths(clip: Clip | None) -> Floats:
        return lengths_over_time(prepared.patch, prepared.rig, prepared.rest, clip, times)[1]

    assert lengths(prepared.clip) == pytest.approx([0.6, 0.6, 0.7, 0.8, 0.9, 1.0], abs=1e-7)
    assert lengths(other) == pytest.approx([0.8] * 6, abs=1e-7)
    assert lengths(None) == pytest.approx([0.8] * 6, abs=1e-7)


def test_rest_length_follows_a_morph_target_from_0_to_1_and_no_further() -> None:
    asset = limb_asset(rings=9, sides=8, morphs=2, clip=None)
    animation: dict[str, Any] = {"name": "smile"}
    asset.channel(animation, 0, "weights", [0, 1, 2, 3], [[0.7, 0], [0.7, 0.5], [0.7, 2], [0.7, -1]])
    asset.append("animations", animation)
    prepared = prepare(asset, tool(rest_length={"morph": "morph_1", "full": "125%"}))
    _, lengths = lengths_over_time(
        prepared.patch, prepared.rig, prepared.rest, prepared.clip, np.array([0.0, 1.0, 2.0, 3.0])
    )
    assert lengths == pytest.approx([0.8, 0.9, 1.0, 0.8], abs=1e-7)


@pytest.mark.parametrize(
    ("wanted", "height"),
    [("auto", 0.8 / 8 * 2 * 0.25), (None, np.inf), ("none", np.inf), (0.03, 0.03), ("10%", 0.08)],
)
def test_max_height(wanted: Any, height: float) -> None:
    patch = prepare(limb_asset(rings=9, sides=8), tool(max_height=wanted, bumps=4)).patch
    assert patch.curve.max_height == pytest.approx(height, abs=1e-7)


def test_lengths_in_per_cent_are_of_the_tool_s_own_span() -> None:
    patch = prepare(limb_asset(rings=9, sides=8), tool(width="25%")).patch
    assert patch.half_width == pytest.approx(Length(12.5, percent=True).resolve(patch.span), abs=1e-15)
