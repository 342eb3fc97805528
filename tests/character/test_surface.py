"""Welding, triangles and normals: what glTF splits is one surface again, and what lies together need not be."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.asset import MODES, Asset, stored
from kit.limb import RADIUS, limb_asset, limb_positions
from kit.prepared import as_document
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import Surface, influence_count, read_surface, read_triangles, read_vertices
from wrinklecli.character.weld import weld
from wrinklecli.errors import AssetError
from wrinklecli.numeric.arrays import distinct, distinct_values, face_normals, median, normals_at, unit, vertex_normals

Floats = NDArray[np.float64]


def surface_of(asset: Asset, node: int = 0) -> Surface:
    document = as_document(asset)
    return read_surface(document, read_rig(document, node))


def shape_of(surface: Surface) -> list[tuple[Any, ...]]:
    """The surface as a set of triangles of places, each turned to begin at its lowest: geometry without numbers."""
    found = []
    for corners in surface.positions[surface.triangles].tolist():
        first = min(range(3), key=lambda k: corners[k])
        found.append(tuple(tuple(corners[(first + k) % 3]) for k in range(3)))
    return sorted(found)


def points(
    positions: Any,
    *,
    joints: Any = None,
    joint_type: str = "u1",
    weights: Any = None,
    deltas: Any = None,
    faces: Any = None,
) -> Asset:
    """A mesh of some vertices, skinned where joints are given."""
    asset = Asset()
    attributes = {"POSITION": asset.accessor(positions)}
    node: dict[str, Any] = {"mesh": 0}
    if joints is not None:
        for k in range(np.shape(joints)[1] // 4):
            attributes[f"JOINTS_{k}"] = asset.accessor(np.asarray(joints)[:, 4 * k : 4 * k + 4], joint_type)
            attributes[f"WEIGHTS_{k}"] = asset.accessor(np.asarray(weights)[:, 4 * k : 4 * k + 4])
        node["skin"] = 0
        asset.append("skins", {"joints": [1, 2, 3]})
    primitive: dict[str, Any] = {"attributes": attributes}
    if faces is not None:
        primitive["indices"] = asset.accessor(np.ravel(faces), "u2")
    if deltas is not None:
        primitive["targets"] = [{"POSITION": asset.accessor(each)} for each in deltas]
    asset.append("meshes", {"primitives": [primitive]})
    asset.gltf["nodes"] = [node, {}, {}, {}]
    return asset


SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0], [1, 1, 0], [0, 1, 0]], float)
ONE = np.tile([1.0, 0.0, 0.0, 0.0], (6, 1))


@pytest.mark.parametrize(("seam", "primitives"), [(False, 1), (True, 1), (True, 3)])
@pytest.mark.parametrize(
    ("indices", "mode"), [("u1", "triangles"), ("u2", "strip"), ("u4", "triangles"), (None, "strip")]
)
def test_limb_is_one_closed_tube_however_it_is_stored(seam: bool, primitives: int, indices: Any, mode: Any) -> None:
    surface = surface_of(limb_asset(rings=7, sides=6, seam=seam, primitives=primitives, indices=indices, mode=mode))
    assert len(surface.positions) == 7 * 6
    assert len(surface.triangles) == 6 * 6 * 2
    edges, counts = np.unique(
        np.sort(surface.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_counts=True
    )
    # Euler: V - E + F = 0 for a tube; only the 6 edges of each end have one face.
    assert len(surface.positions) - len(edges) + len(surface.triangles) == 0
    assert (counts == 1).sum() == 2 * 6
    assert counts.max() == 2
    outward = face_normals(surface.positions, surface.triangles)
    centres = surface.positions[surface.triangles].mean(axis=1)
    assert (np.sum(outward[:, 1:] * centres[:, 1:], axis=1) > 0).all()
    assert not surface.twins.any()


def test_fans_are_wound_outward_too() -> None:
    surface = surface_of(limb_asset(rings=7, sides=6, mode="fan"))
    assert len(surface.positions) == 7 * 6
    assert len(surface.triangles) == 6 * 6 * 2
    outward = face_normals(surface.positions, surface.triangles)
    centres = surface.positions[surface.triangles].mean(axis=1)
    assert (np.sum(outward[:, 1:] * centres[:, 1:], axis=1) > 0).all()


@pytest.mark.parametrize(
    "options",
    [
        {"seam": False},
        {"primitives": 3},
        {"primitives": 2, "seam": False},
        {"mode": "strip"},
        {"indices": None},
        {"indices": "u1"},
        {"interleave": True},
        {"sparse": "base"},
        {"sparse": "zeros"},
        {"influences": 8},
    ],
)
def test_storage_changes_nothing_geometrically(options: dict[str, Any]) -> None:
    plain, other = (surface_of(limb_asset(rings=5, sides=4, **each)) for each in ({}, options))
    if "mode" in options:
        assert sorted(map(tuple, plain.positions)) == sorted(map(tuple, other.positions))
    else:
        assert shape_of(plain) == shape_of(other)


@given(seed=st.integers(0, 999))
def test_numbering_changes_nothing_geometrically(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid(range(4), range(3), indexing="ij"), axis=-1).reshape(-1, 2)
    places = np.column_stack([grid, np.sin(grid).sum(axis=1)]).astype(np.float32)
    quads = np.array([[k, k + 1, k + 4, k + 3] for k in range(9) if k % 3 < 2])
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    original = points(places[faces.ravel()], faces=np.arange(faces.size))
    order = rng.permutation(faces.size)
    numbers = np.argsort(order)[rng.permutation(np.arange(faces.size).reshape(-1, 3))]
    shuffled = points(places[faces.ravel()][order], faces=numbers)
    one, other = surface_of(original), surface_of(shuffled)
    assert shape_of(one) == shape_of(other)
    assert len(one.positions) == len(other.positions) == 12


def test_weld_names_the_place_of_every_gltf_vertex() -> None:
    asset = limb_asset(rings=5, sides=4, primitives=2)
    surface = surface_of(asset)
    document = as_document(asset)
    stored = np.concatenate(
        [document.accessor(each["attributes"]["POSITION"]) for each in asset.gltf["meshes"][0]["primitives"]]
    )
    assert np.array_equal(surface.positions[surface.weld], stored)
    assert np.array_equal(surface.weld[surface.corners], surface.triangles)
    assert surface.vertex_starts.tolist() == [0, 15, 30]
    for triangle, primitive in zip(surface.corners, surface.primitives, strict=True):
        assert (triangle // 15 == primitive).all()


def test_zero_and_minus_zero_are_one_place() -> None:
    places = SQUARE.copy()
    places[3] = [-0.0, 0.0, -0.0]
    surface = surface_of(points(places))
    assert len(surface.positions) == 4
    assert surface.weld[0] == surface.weld[3]


@pytest.mark.parametrize(("times", "places"), [(1 - 1e-6, 4), (1 + 1e-6, 5)])
def test_positions_within_a_millionth_of_the_box_are_one_place(times: float, places: int) -> None:
    moved = SQUARE.copy()
    moved[4, 0] += times * 1e-6 * np.sqrt(2.0)
    welded = weld(moved, np.zeros((0, 6, 3)), np.zeros((6, 1), np.intp), np.ones((6, 1)))
    assert len(welded.models) == places
    # Files store float32.
    bit = SQUARE.astype(np.float32)
    bit[4, 0] = np.nextafter(np.float32(1), np.float32(2))
    assert len(surface_of(points(bit)).positions) == 4


@given(seed=st.integers(0, 999))
def test_what_rounds_is_one_point_whatever_the_order(seed: int) -> None:
    """Copies differ by less than the limits, and those of another point by more: neither depends on the numbers."""
    rng = np.random.default_rng(seed)
    count, copies = 12, 4
    grid = np.repeat(rng.integers(0, 2, (count, 3)).astype(float), copies, axis=0)
    joints = np.tile([0, 1, 2], (count * copies, 1))
    shares = rng.integers(1, 4, (count, 3))
    weights = np.repeat(shares / shares.sum(axis=1, keepdims=True), copies, axis=0)
    deltas = np.repeat(rng.integers(0, 2, (1, count, 3)).astype(float), copies, axis=1)
    of_point = {tuple(row): k for k, row in enumerate(np.hstack([grid, weights, deltas[0]]).tolist())}
    wanted = [of_point[tuple(row)] for row in np.hstack([grid, weights, deltas[0]]).tolist()]
    size = np.linalg.norm(np.ptp(grid, axis=0))
    grid += 0.3e-6 * size * rng.uniform(-1, 1, grid.shape)
    weights += 0.3e-4 * rng.uniform(-1, 1, weights.shape)
    deltas += 0.3e-6 * size * rng.uniform(-1, 1, deltas.shape)
    one = weld(grid, deltas, joints, weights)
    assert len(set(wanted)) == len(one.models) == len(set(zip(wanted, one.points.tolist(), strict=True)))

    order = rng.permutation(count * copies)
    other = weld(grid[order], deltas[:, order], joints[order], weights[order])
    assert {*one.models[one.points][order].tolist()} == {*order[other.models].tolist()}
    assert (one.models[one.points][order] == order[other.models[other.points]]).all()
    assert (one.twins[one.points][order] == other.twins[other.points]).all()


def test_stray_vertices_that_nothing_draws_do_not_tell_the_size() -> None:
    asset = points([*SQUARE, [1e9, 0, 0]], faces=[[0, 1, 2], [3, 4, 5]])
    assert len(surface_of(asset).positions) == 5


@pytest.mark.parametrize(
    ("joints", "weights", "one"),
    [
        ([0, 1, 0, 0], [0.25, 0.75, 0, 0], True),
        ([1, 0, 0, 0], [0.75, 0.25, 0, 0], True),  # another order
        ([1, 1, 0, 2], [0.5, 0.25, 0.25, 0], True),  # a joint twice, one without weight
        ([0, 1, 0, 0], [0.5, 1.5, 0, 0], True),  # not normalised
        ([0, 1, 0, 0], [0.25 + 1e-4, 0.75, 0, 0], True),  # 2e-5 and 8e-5 off, normalised
        ([0, 1, 2, 0], [0.25, 0.74995, 5e-5, 0], True),  # a joint that hardly counts
        ([0, 1, 0, 0], [0.25 + 2e-4, 0.75, 0, 0], False),
        ([0, 2, 0, 0], [0.25, 0.75, 0, 0], False),
        ([0, 1, 2, 0], [0.25, 0.65, 0.1, 0], False),
    ],
)
def test_weld_needs_equal_influences(joints: list[int], weights: list[float], one: bool) -> None:
    every = np.tile([0, 1, 0, 0], (6, 1)), np.tile([0.25, 0.75, 0.0, 0.0], (6, 1))
    every[0][3], every[1][3] = joints, weights
    surface = surface_of(points(SQUARE, joints=every[0], weights=every[1]))
    assert len(surface.positions) == (4 if one else 5)
    # Touching lips: two points at one place that move differently are twins.
    assert surface.twins.sum() == (0 if one else 2)
    assert surface.twins[surface.weld[0]] == surface.twins[surface.weld[3]] == (not one)


@pytest.mark.parametrize(("difference", "one"), [(0.0, True), (1e-6, True), (1e-5, False)])
def test_weld_needs_equal_morph_deltas(difference: float, one: bool) -> None:
    deltas = np.zeros((2, 6, 3))
    deltas[1, 3, 2] = difference
    surface = surface_of(points(SQUARE, deltas=deltas))
    assert len(surface.positions) == (4 if one else 5)
    assert surface.morph_deltas.shape == (2, len(surface.positions), 3)


def test_three_ways_to_move_at_one_place() -> None:
    places = np.tile(SQUARE[:3], (4, 1))
    joints = np.repeat([[0, 0, 0, 0], [1, 0, 0, 0], [2, 0, 0, 0], [1, 0, 0, 0]], 3, axis=0)
    surface = surface_of(points(places, joints=joints, weights=np.tile(ONE[:1], (12, 1))))
    assert len(surface.positions) == 9
    assert surface.twins.all()
    assert np.array_equal(surface.weld[3:6], surface.weld[9:])


def test_influences_are_merged_sorted_and_normalised() -> None:
    joints = np.tile([2, 0, 2, 1, 1, 0, 0, 0], (6, 1))
    weights = np.tile([0.5, 0.0, 0.5, 0.25, 0.5, 0.25, 0.0, -3.0], (6, 1))
    surface = surface_of(points(SQUARE, joints=joints, weights=weights))
    dense = surface.dense_weights(np.arange(4), 3)
    assert dense == pytest.approx(np.tile([0.125, 0.375, 0.5], (4, 1)), abs=1e-15)
    used = surface.weights > 0
    assert (used.sum(axis=1) == 3).all()


@given(seed=st.integers(0, 999))
def test_weights_of_repeated_joints_add_up(seed: int) -> None:
    random = np.random.default_rng(seed)
    joints = random.integers(0, 3, (6, 8))
    weights = random.integers(0, 3, joints.shape) / 8.0
    surface = surface_of(points(SQUARE + np.arange(6)[:, None], joints=joints, weights=weights))
    wanted = np.stack([np.where(joints == joint, weights, 0.0).sum(axis=1) for joint in range(3)], axis=1)
    idle = ~weights.any(axis=1)
    wanted[idle, joints[idle, 0]] = 1.0
    assert np.array_equal(surface.dense_weights(np.arange(6), 3), wanted / wanted.sum(axis=1, keepdims=True))


def test_some_vertices_are_read_as_all_are() -> None:
    joints, weights = np.arange(24).reshape(6, 4) % 3, np.arange(24).reshape(6, 4) / 24.0
    document = as_document(points(SQUARE, joints=joints, weights=weights, deltas=[SQUARE, 2 * SQUARE]))
    rig, chosen = read_rig(document, 0), np.array([1, 4, 5])
    every, some = read_vertices(document, rig), read_vertices(document, rig, {0: chosen}, targets=1)
    assert np.array_equal(some.positions, every.positions[chosen])
    assert np.array_equal(some.morph_deltas, every.morph_deltas[:1, chosen])
    assert np.array_equal(some.joints, every.joints[chosen])
    assert np.array_equal(some.weights, every.weights[chosen])


def test_vertex_without_weight_follows_its_first_joint() -> None:
    surface = surface_of(points(SQUARE, joints=np.tile([2, 1, 0, 0], (6, 1)), weights=0 * ONE))
    assert np.array_equal(surface.dense_weights(np.arange(4), 3), np.tile([0.0, 0.0, 1.0], (4, 1)))


@pytest.mark.parametrize("dtype", ["u1", "u2"])
def test_normalised_integer_weights_sum_to_1(dtype: Any) -> None:
    surface = surface_of(limb_asset(rings=9, sides=4, weight_dtype=dtype))
    exact = surface_of(limb_asset(rings=9, sides=4))
    assert surface.weights.sum(axis=1) == pytest.approx(1.0, abs=1e-15)
    step = 1 / np.iinfo(dtype).max
    every = np.arange(len(surface.positions))
    assert np.abs(surface.dense_weights(every, 2) - exact.dense_weights(every, 2)).max() <= step


def test_unskinned_mesh_hangs_on_its_node() -> None:
    surface = surface_of(limb_asset(rings=5, sides=4, skinned=False, morphs=1))
    assert np.array_equal(surface.dense_weights(np.arange(20), 1), np.ones((20, 1)))


@pytest.mark.parametrize("joint", [9, -5])
def test_joint_that_the_skin_lacks_is_refused_unless_it_weighs_nothing(joint: int) -> None:
    joints = np.tile([0, joint, 0, 0], (6, 1))
    kept = surface_of(points(SQUARE, joints=joints, joint_type="i1", weights=ONE))
    assert np.array_equal(kept.dense_weights(np.arange(4), 3), ONE[:4, :3])
    with pytest.raises(AssetError, match=rf"#/meshes/0/primitives/0: JOINTS refer to joint {joint} of 3"):
        surface_of(points(SQUARE, joints=joints, joint_type="i1", weights=ONE[:, [1, 0, 2, 3]]))


@pytest.mark.parametrize(
    ("mode", "indices", "wanted"),
    [
        # glTF 2.0 §3.7.2.1
        ("triangles", [4, 3, 2, 0, 1, 2, 9], [[4, 3, 2], [0, 1, 2]]),
        ("strip", [0, 1, 2, 3, 4], [[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
        ("fan", [5, 1, 2, 3], [[1, 2, 5], [2, 3, 5]]),
        ("strip", [0, 1], []),
        ("fan", [0], []),
        ("triangles", [0, 1], []),
    ],
)
def test_modes(mode: str, indices: list[int], wanted: list[list[int]]) -> None:
    asset = Asset()
    primitive = {"mode": MODES[mode], "indices": asset.accessor(indices, "u1")}
    triangles = read_triangles(as_document(asset), primitive, 10, "x")
    assert triangles.tolist() == wanted
    assert triangles.shape == (len(wanted), 3)
    without = read_triangles(as_document(asset), {"mode": MODES[mode]}, len(indices), "x")
    numbered = np.array(sorted(set(range(len(indices)))))
    assert len(without) == len(wanted)
    assert np.isin(without, numbered).all()


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_have_no_triangles(mode: int) -> None:
    assert read_triangles(as_document(Asset()), {"mode": mode}, 9, "x").shape == (0, 3)
    asset = points(SQUARE)
    asset.gltf["meshes"][0]["primitives"][0]["mode"] = mode
    with pytest.raises(AssetError, match="#/meshes/0: has no triangles"):
        surface_of(asset)


def test_line_primitive_beside_triangles_is_no_fault() -> None:
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["meshes"][0]["primitives"].insert(0, {**asset.gltf["meshes"][0]["primitives"][0], "mode": 1})
    surface = surface_of(asset)
    assert set(surface.primitives) == {1}
    assert len(surface.positions) == 12


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a["attributes"].pop("POSITION"), "has no POSITION"),
        (lambda a: a["attributes"].pop("WEIGHTS_0"), "has no JOINTS_0 and WEIGHTS_0"),
        (
            lambda a: a["attributes"].__setitem__("NORMAL", a["attributes"]["TEXCOORD_0"]),
            "NORMAL .* must hold 3 numbers",
        ),
        (lambda a: a["attributes"].__setitem__("WEIGHTS_0", 99), "refers to accessors.99."),
        (lambda a: a.__setitem__("indices", a["attributes"]["POSITION"]), "indices must be whole numbers below 15"),
        (lambda a: a.__setitem__("targets", [{}]), "has 1 morph targets, others have 0"),
    ],
)
def test_malformed_primitive_is_refused(change: Any, message: str) -> None:
    asset = limb_asset(rings=5, sides=4, primitives=2)
    change(asset.gltf["meshes"][0]["primitives"][1])
    with pytest.raises(AssetError, match=rf"limb\.glb#/meshes/0/primitives/1(/attributes)?: .*{message}"):
        surface_of(asset)


@pytest.mark.parametrize("name", ["POSITION", "NORMAL", "WEIGHTS_0"])
def test_the_first_vertex_that_is_not_finite_is_named(name: str) -> None:
    asset = limb_asset(rings=5, sides=4, primitives=2)
    index = asset.gltf["meshes"][0]["primitives"][1]["attributes"][name]
    stored(asset, index)[3:, 1] = np.nan
    message = rf"/primitives/1: {name} \(accessor {index}\) of vertex 3 is not a finite number, or above 1e\+15"
    with pytest.raises(AssetError, match=message):
        surface_of(asset)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_positions_that_are_no_numbers_are_refused(value: float) -> None:
    places = SQUARE.copy()
    places[2, 1] = value
    with pytest.raises(AssetError, match=r"#/meshes/0/primitives/0: .*finite"):
        surface_of(points(places))


def test_index_beyond_the_vertices_is_refused() -> None:
    with pytest.raises(AssetError, match="indices must be whole numbers below 6"):
        surface_of(points(SQUARE, faces=[0, 1, 6]))


def test_face_normals_are_twice_the_area() -> None:
    rng = np.random.default_rng(1)
    corners = rng.normal(size=(7, 3, 3))
    normals = face_normals(corners.reshape(-1, 3), np.arange(21).reshape(7, 3))
    for (a, b, c), normal in zip(corners, normals, strict=True):
        # Heron's formula knows nothing of cross products.
        x, y, z = np.linalg.norm(b - a), np.linalg.norm(c - b), np.linalg.norm(a - c)
        s = (x + y + z) / 2
        assert np.linalg.norm(normal) / 2 == pytest.approx(np.sqrt(s * (s - x) * (s - y) * (s - z)), rel=1e-9)
        assert normal @ (b - a) == pytest.approx(0, abs=1e-12)
        assert np.linalg.det([b - a, c - a, normal]) > 0


@given(st.integers(0, 999))
def test_normals_of_some_vertices_are_those_of_all_to_the_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, triangles = rng.normal(size=(20, 3)), rng.integers(0, 20, (30, 3))
    vertices = rng.permutation(20)[: rng.integers(0, 20)]
    assert np.array_equal(normals_at(places, triangles, vertices), vertex_normals(places, triangles)[vertices])


@given(st.integers(0, 999))
def test_distinct_rows_are_numpy_s(seed: int) -> None:
    rows = np.random.default_rng(seed).integers(-1, 2, (seed % 30, 3)) * 0.5
    wanted, firsts, which = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    found, numbers = distinct(rows)
    assert np.array_equal(rows[found], wanted)
    assert np.array_equal(found, firsts)
    assert np.array_equal(numbers, which.reshape(-1))


@given(st.lists(st.integers(-3, 3)), st.sampled_from([np.intp, np.float64]))
def test_distinct_values_are_numpy_s(values: list[int], dtype: type) -> None:
    array = np.array(values, dtype)
    assert np.array_equal(distinct_values(array), np.unique(array))
    assert np.array_equal(distinct_values(np.stack([array, array])), np.unique(array))


@given(st.integers(1, 9), st.integers(1, 3), st.integers(0, 999))
def test_a_median_is_numpy_s(count: int, columns: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=(count, columns))
    assert np.array_equal(median(values), np.median(values, axis=0))
    assert np.array_equal(median(values[:, 0]), np.median(values[:, 0]))


def test_vertex_normals_of_a_tube_point_outward() -> None:
    surface = surface_of(limb_asset(rings=9, sides=16))
    normals = vertex_normals(surface.positions, surface.triangles)
    radial = surface.positions * [0, 1, 1] / RADIUS
    inner = np.abs(surface.positions[:, 0]) < 0.99
    # By symmetry around and along the tube only the diagonals' side tilts them, not at all away from the ends.
    assert normals[inner] == pytest.approx(radial[inner], abs=1e-6)
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0, abs=1e-14)


def test_normals_turn_with_the_surface() -> None:
    surface = surface_of(limb_asset(rings=4, sides=5))
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    turn *= np.linalg.det(turn)
    one, other = (
        vertex_normals(surface.positions @ turn.T, surface.triangles),
        vertex_normals(surface.positions, surface.triangles) @ turn.T,
    )
    assert one == pytest.approx(other, abs=1e-14)


def test_vertex_without_area_has_no_normal() -> None:
    places = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [5, 5, 5]], float)
    assert np.array_equal(vertex_normals(places, np.array([[0, 1, 2], [0, 0, 1]])), np.zeros((4, 3)))
    assert np.array_equal(unit(np.zeros((2, 3))), np.zeros((2, 3)))


def test_size_is_the_box_s_diagonal() -> None:
    assert surface_of(points(SQUARE * 3)).size == pytest.approx(3 * np.sqrt(2), rel=1e-15)
    position, _ = limb_positions(np.array([0]), np.array([0]), 5, 4)
    assert position.tolist() == [[-1.0, RADIUS, 0.0]]


@pytest.mark.parametrize(("options", "count"), [({}, 4), ({"influences": 8}, 8), ({"skinned": False}, 1)])
def test_influences_that_the_file_can_store(options: dict[str, Any], count: int) -> None:
    document = as_document(limb_asset(rings=3, sides=4, morphs=1, **options))
    assert influence_count(document, read_rig(document, 0)) == count


def test_influences_are_those_of_the_poorest_primitive() -> None:
    asset = limb_asset(rings=5, sides=4, influences=8, primitives=2)
    del asset.gltf["meshes"][0]["primitives"][1]["attributes"]["JOINTS_1"]
    document = as_document(asset)
    assert influence_count(document, read_rig(document, 0)) == 4
