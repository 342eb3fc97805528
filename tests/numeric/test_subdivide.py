"""Subdivision: conforming in any mesh, where it should be, and the modified butterfly where it is full."""

import math
import subprocess
import sys
from collections import Counter, defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.numeric.red_green import Level
from wrinklecli.numeric.subdivide import subdivide


def everything(level):
    return np.ones(len(level.edges), dtype=bool)


def nothing(level):
    return np.zeros(len(level.edges), dtype=bool)


def up_to(number):
    return lambda level: np.full(len(level.edges), level.number < number)


def chance(seed, probability, vertex_count, levels=math.inf):
    """A random choice of edges that depends on where the edge lies alone."""
    places = np.random.default_rng(seed).random((vertex_count, 1))

    def choose(level: Level):
        middles = (level.linear @ places)[level.edges, 0].mean(axis=1)
        return ((middles * 1e5) % 1.0 < probability) & (level.number < levels)

    return choose


# Meshes: (vertices, 3) positions and (faces, 3) triangles.


def tetrahedron():
    return np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / math.sqrt(3), np.array(
        [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
    )


def bipyramid(sides):
    angles = np.arange(sides) * 2 * np.pi / sides
    rim = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    ring = np.arange(sides)
    following = (ring + 1) % sides
    return np.concatenate([rim, [[0, 0, 1], [0, 0, -1]]]), np.concatenate(
        [
            np.stack([ring, following, np.full(sides, sides)], axis=1),
            np.stack([following, ring, np.full(sides, sides + 1)], axis=1),
        ]
    )


def icosahedron():
    g = (1 + math.sqrt(5)) / 2
    a = np.array([[0, s, t * g] for s in (1, -1) for t in (1, -1)])
    points = np.concatenate([a, np.roll(a, 1, axis=1), np.roll(a, 2, axis=1)])
    triples = [(i, j, k) for i in range(12) for j in range(i + 1, 12) for k in range(j + 1, 12)]
    triangles = []
    for i, j, k in triples:
        p, q, r = points[[i, j, k]]
        if max(np.linalg.norm(p - q), np.linalg.norm(q - r), np.linalg.norm(r - p)) < 2.1:
            triangles.append((i, j, k) if np.linalg.det(np.stack([p, q, r])) > 0 else (i, k, j))
    return points / math.hypot(1, g), np.array(triangles)


def icosphere(times):
    points, triangles = icosahedron()
    for _ in range(times):
        fine = subdivide(triangles, len(points), wants=up_to(1), max_levels=1, scheme="midpoint")
        points = fine.positions(points)
        points /= np.linalg.norm(points, axis=1)[:, None]
        triangles = fine.triangles
    return points, triangles


def grid(width, height, wrapped=False):
    i, j = np.meshgrid(np.arange(width), np.arange(height), indexing="ij")

    def corner(a, b):
        return a % width * height + b % height if wrapped else a * (height + 1) + b

    quads = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)]
    triangles = np.stack([np.stack(quads[:3], -1), np.stack([quads[0], *quads[2:]], -1)], -2)
    count = (width, height) if wrapped else (width + 1, height + 1)
    points = np.stack([*np.indices(count), np.zeros(count)], axis=-1).astype(np.float64)
    return points.reshape(-1, 3), triangles.reshape(-1, 3)


def torus():
    points, triangles = grid(6, 7, wrapped=True)
    u, v = points[:, 0] * np.pi / 3, points[:, 1] * 2 * np.pi / 7
    return np.stack([(3 + np.cos(v)) * np.cos(u), (3 + np.cos(v)) * np.sin(u), np.sin(v)], axis=1), triangles


def with_holes():
    points, triangles = grid(7, 7)
    return points, np.delete(triangles, [30, 31, 50, 51, 52, 64, 66], axis=0)


def t_joint():
    """Three sheets on one line: its edges have three faces."""
    points, triangles = grid(4, 4)
    up = points[:, [2, 1, 0]] + [2, 0, 0]
    joined = np.arange(25) + 25
    joined[:5] = np.arange(10, 15)
    return np.concatenate([points, up]), np.concatenate([triangles, joined[triangles]])


def bow_tie():
    points, triangles = tetrahedron()
    other = triangles + 3
    return np.concatenate([points, points[1:] + points[3] - points[0]]), np.concatenate([triangles, other])


def flipped():
    points, triangles = torus()
    triangles = triangles.copy()
    triangles[::5] = triangles[::5, ::-1]
    return points, triangles


def double_sided():
    points, triangles = grid(4, 3)
    return points, np.concatenate([triangles, triangles[:, ::-1]])


def with_degenerates():
    points, triangles = grid(4, 4)
    return points, np.insert(triangles, 7, [[3, 3, 4], [6, 7, 6], [9, 9, 9]], axis=0)


def in_pieces():
    (a, s), (b, t), (c, u) = icosahedron(), with_holes(), bipyramid(7)
    return np.concatenate([a, b, c]), np.concatenate([s, t + len(a), u + len(a) + len(b)])


def moebius():
    i = np.arange(9)
    following, over = i + 1, i + 10
    triangles = np.concatenate([np.stack([i, following, over], axis=1), np.stack([following, over + 1, over], axis=1)])
    glue = np.arange(20)
    glue[[9, 19]] = [10, 0]
    keep = np.delete(np.arange(20), [9, 19])
    triangles = np.searchsorted(keep, glue[triangles])
    angles, sides = np.tile(np.arange(9) * 2 * np.pi / 9, 2), np.repeat([-0.5, 0.5], 9)
    radii = 2 + sides * np.cos(angles / 2)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), sides * np.sin(angles / 2)], 1), triangles


CLOSED = {
    "tetrahedron": tetrahedron,
    "octahedron": lambda: bipyramid(4),
    "icosahedron": icosahedron,
    "heptagons": lambda: bipyramid(7),
    "torus": torus,
    "icosphere": lambda: icosphere(1),
}
OPEN = {
    "triangle": lambda: (np.eye(3), np.array([[0, 1, 2]])),
    "grid": lambda: grid(5, 4),
    "holes": with_holes,
    "pieces": in_pieces,
}
ODD = {
    "t_joint": t_joint,
    "bow_tie": bow_tie,
    "flipped": flipped,
    "double_sided": double_sided,
    "degenerates": with_degenerates,
    "moebius": moebius,
    "fan_of_five": lambda: (np.eye(7)[:, :3], np.array([[0, 1, k] for k in range(2, 7)])),
    "pillow": lambda: (np.eye(3), np.array([[0, 1, 2], [0, 2, 1]])),
    "none": lambda: (np.eye(3), np.zeros((0, 3), dtype=int)),
}
ALL = CLOSED | OPEN | ODD


def proper(triangles):
    a, b, c = np.asarray(triangles).T
    return triangles[(a != b) & (b != c) & (c != a)]


def edge_faces(triangles):
    return Counter(tuple(sorted((t[c], t[c - 1]))) for t in proper(triangles).tolist() for c in range(3))


def border_loops(triangles):
    """Connected components of the border."""
    group = {}
    for (a, b), faces in edge_faces(triangles).items():
        if faces == 1:
            a, b = group.setdefault(a, a), group.setdefault(b, b)
            group = {v: a if g == b else g for v, g in group.items()}
    return len(set(group.values()))


def places(fine, coarse_count):
    """Where each fine vertex lies in the coarse mesh: its share of each coarse vertex, exact."""
    rows = fine.interpolate(np.eye(coarse_count))
    return [tuple((int(v), float(row[v])) for v in np.flatnonzero(row)) for row in rows]


def assert_conforming(triangles, vertex_count, fine):
    """No T-junction, no hole, nothing twice that was not, and barycentrics that say where things are."""
    weights = fine.interpolate(np.eye(vertex_count))
    place = places(fine, vertex_count)
    at = {p: v for v, p in enumerate(place)}
    assert len(at) == fine.vertex_count == len(weights)
    fine_faces = proper(fine.triangles)
    for a, b in edge_faces(fine_faces):
        middle = (weights[a] + weights[b]) / 2
        key = tuple((int(v), float(middle[v])) for v in np.flatnonzero(middle))
        assert key not in at, "a vertex lies on an edge"

    coarse_edges = edge_faces(triangles)
    coarse_faces = Counter(tuple(sorted(t)) for t in proper(triangles).tolist())
    for (a, b), faces in edge_faces(fine_faces).items():
        support = tuple(sorted({v for v, _ in place[a] + place[b]}))
        assert faces == (coarse_edges[support] if len(support) == 2 else 2 * coarse_faces[support])
    assert max(Counter(tuple(sorted(t)) for t in fine_faces.tolist()).values(), default=0) <= max(
        coarse_faces.values(), default=0
    )

    assert np.array_equal(weights[fine.triangles], fine.barycentrics @ np.eye(vertex_count)[triangles][fine.parents])
    assert np.all(np.diff(fine.parents) >= 0)
    assert np.array_equal(np.unique(fine.parents), np.arange(len(triangles)))
    # Children fill their parent, wound as it is: signed areas in its barycentrics sum to 1.
    solid = np.isin(fine.parents, np.flatnonzero([len(set(t)) == 3 for t in np.asarray(triangles).tolist()]))
    areas = np.linalg.det(fine.barycentrics)[solid]
    assert np.all(areas > 0)
    sums = np.bincount(fine.parents[solid], areas, minlength=len(triangles))
    np.testing.assert_allclose(sums[np.unique(fine.parents[solid])], 1, atol=1e-12)
    untouched = np.flatnonzero(np.bincount(fine.parents, minlength=len(triangles)) == 1)
    assert np.array_equal(fine.triangles[np.isin(fine.parents, untouched)], np.asarray(triangles)[untouched])


# The whole scheme, slowly and by the book.


def ring_of(vertex, first, faces):
    """Neighbours from `first` on, if one closed, consistently wound fan surrounds the vertex; else None."""
    links = [(t[(c + 1) % 3], t[(c + 2) % 3]) for t in faces for c in range(3) if t[c] == vertex]
    following = dict(links)
    if len(following) < len(links) or sorted(following) != sorted(following.values()):
        return None
    ring = [first]
    while following[ring[-1]] != first:
        ring.append(following[ring[-1]])
    return ring if len(ring) == len(links) else None


def outer_rule(ring, vertex, points):
    """The extraordinary stencil."""
    K = len(ring)
    if K == 3:
        s = [5 / 12, -1 / 12, -1 / 12]
    elif K == 4:
        s = [3 / 8, 0, -1 / 8, 0]
    else:
        s = [(0.25 + math.cos(2 * math.pi * j / K) + 0.5 * math.cos(4 * math.pi * j / K)) / K for j in range(K)]
    return 3 / 4 * points[vertex] + sum(w * points[r] for w, r in zip(s, ring, strict=True))


def butterfly_point(a, b, faces_at, around, points):
    p, q = points[a], points[b]
    with_both = around[a, b]
    border_neighbours = {
        v: [w for t in faces_at[v] for w in t if w != v and len(around[tuple(sorted((v, w)))]) == 1] for v in (a, b)
    }
    if len(with_both) == 1:
        if all(len(n) == 2 for n in border_neighbours.values()):
            (before,) = set(border_neighbours[a]) - {b}
            (after,) = set(border_neighbours[b]) - {a}
            return (9 * p + 9 * q - points[before] - points[after]) / 16
        return (p + q) / 2
    rings = [ring_of(a, b, faces_at[a]), ring_of(b, a, faces_at[b])]
    inner = [r is not None for r in rings]
    odd = [r is not None and len(r) != 6 for r in rings]
    if any(odd):
        rules = [outer_rule(r, v, points) for r, v, o in zip(rings, (a, b), odd, strict=True) if o]
        return sum(rules) / len(rules)
    if all(inner):
        left, right = rings[0][1], rings[0][-1]
        wings = [rings[0][2], rings[0][-2], rings[1][2], rings[1][-2]]
        return (p + q) / 2 + (points[left] + points[right]) / 8 - sum(points[w] for w in wings) / 16
    return (p + q) / 2


def subdivide_by_the_book(points, triangles):
    triangles = [tuple(t) for t in np.asarray(triangles).tolist()]
    around, faces_at = defaultdict(list), defaultdict(list)
    for t in triangles:
        for c in range(3):
            around[tuple(sorted((t[c], t[c - 1])))].append(t)
            faces_at[t[c]].append(t)
    new = {edge: len(points) + n for n, edge in enumerate(sorted(around))}
    fine = np.array([*points, *(butterfly_point(*e, faces_at, around, points) for e in new)])
    children = []
    for a, b, c in triangles:
        ab, bc, ca = (new[tuple(sorted(e))] for e in ((a, b), (b, c), (c, a)))
        children += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return fine, children


@pytest.mark.quick(4)
@pytest.mark.parametrize("name", [n for n in ALL if n not in ("double_sided", "degenerates", "pillow", "none")])
def test_refining_everything_is_the_modified_butterfly(name):
    points, triangles = ALL[name]()
    points = points + np.random.default_rng(1).normal(size=points.shape) * 0.1
    for levels in (1, 2):
        fine = subdivide(triangles, len(points), wants=up_to(levels), max_levels=4)
        expected, children = points, triangles
        for _ in range(levels):
            expected, children = subdivide_by_the_book(expected, children)
        assert np.array_equal(fine.triangles, children)
        np.testing.assert_allclose(fine.positions(points), expected, atol=1e-13)
        assert (fine.levels, fine.limited, fine.blocked) == (levels, 0, 0)
        assert_conforming(triangles, len(points), fine)


@pytest.mark.parametrize("name", [n for n in ALL if n != "none"][::3])
@pytest.mark.parametrize("scheme", ["butterfly", "midpoint"])
def test_rows_sum_to_one(name, scheme):
    points, triangles = ALL[name]()
    fine = subdivide(triangles, len(points), wants=chance(3, 0.2, len(points)), max_levels=3, scheme=scheme)
    for matrix in (fine.matrix, fine.linear):
        assert matrix.shape == (fine.vertex_count, len(points))
        np.testing.assert_allclose(matrix @ np.ones(len(points)), 1, atol=1e-14)


def test_a_double_sided_sheet_is_refined_like_its_front():
    points, triangles = double_sided()
    points = points + np.random.default_rng(1).normal(size=points.shape)
    choose = chance(1, 0.3, len(points), levels=2)
    both = subdivide(triangles, len(points), wants=choose, max_levels=2)
    front = subdivide(triangles[: len(triangles) // 2], len(points), wants=choose, max_levels=2)
    assert np.array_equal(both.positions(points), front.positions(points))
    assert np.array_equal(both.triangles[: len(front.triangles)], front.triangles)


def test_linear_functions_are_reproduced_inside_a_regular_grid():
    points, triangles = grid(12, 12)

    def wants(level):
        middles = (level.linear @ points)[level.edges].mean(axis=1)
        return np.linalg.norm(middles - [6, 6, 0], axis=1) < 2

    fine = subdivide(triangles, len(points), wants=wants, max_levels=2)
    assert fine.levels == 2
    assert fine.limited > 0
    distances = np.linalg.norm(points[triangles].mean(axis=1) - [6, 6, 0], axis=1)
    assert set(np.flatnonzero(distances < 1.4)) <= set(fine.unmet) <= set(np.flatnonzero(distances < 3.0))
    np.testing.assert_allclose(fine.positions(points), fine.interpolate(points), atol=1e-14)


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("times", [1, 2])
def test_new_vertices_of_a_sphere_lie_near_it(whole, times):
    points, triangles = icosphere(times)

    def wants(level):
        middles = (level.linear @ points)[level.edges].mean(axis=1)
        return (level.number < 1) & (whole | (middles @ [1.0, 2.0, 3.0] > 1.5))

    fine = subdivide(triangles, len(points), wants=wants, max_levels=3)

    def off(positions):
        return np.abs(np.linalg.norm(positions[len(points) :], axis=1) - 1).max()

    assert 4 * off(fine.positions(points)) < off(fine.interpolate(points))
    assert whole == (len(fine.triangles) == 4 * len(triangles))


def test_nothing_to_split_is_the_identity_and_needs_no_scipy():
    script = """
import sys, numpy as np
from wrinklecli.numeric.subdivide import subdivide
triangles = np.array([[0, 1, 2], [2, 1, 3], [3, 3, 1]])
wants = lambda level: np.zeros(len(level.edges), dtype=bool)
fine = subdivide(triangles, 5, wants=wants, max_levels=4)
assert np.array_equal(fine.triangles, triangles) and fine.matrix is None and fine.linear is None
assert (fine.vertex_count, fine.levels) == (5, 0)
coarse = np.arange(30.0).reshape(2, 5, 3)
assert np.array_equal(fine.positions(coarse), coarse) and np.array_equal(fine.interpolate(coarse), coarse)
assert not any(name.startswith("scipy") for name in sys.modules)
"""
    subprocess.run([sys.executable, "-c", script], check=True)


@pytest.mark.parametrize("forbidden", [0.0, 0.02])
def test_criteria_judge_each_face_once_however_a_level_grows(forbidden):
    """Also where splits that prove impossible have asked for others, and levels are built again without these."""
    points, triangles = torus()
    choose, denied, judged = chance(1, 0.2, len(points)), chance(2, forbidden, len(points)), Counter()

    def wants(level):
        rows = level.linear @ np.eye(len(points))
        judged.update((level.number, rows[face].tobytes()) for face in level.triangles)
        return choose(level)

    fine = subdivide(triangles, len(points), wants=wants, forbids=denied, max_levels=3)
    assert fine.levels == 3
    assert bool(fine.blocked) == bool(forbidden)
    assert set(judged.values()) == {1}


def test_originals_keep_number_and_bits():
    points, triangles = torus()
    morphs = np.random.default_rng(0).normal(size=(2, 3, *points.shape))
    morphs[0, 0, :5] = -0.0
    fine = subdivide(triangles, len(points), wants=chance(1, 0.2, len(points)), max_levels=3)
    moved = fine.positions(morphs)
    assert moved.shape == (2, 3, fine.vertex_count, 3)
    assert moved[..., : len(points), :].tobytes() == morphs.tobytes()
    np.testing.assert_allclose(moved[1, 2], fine.matrix @ morphs[1, 2], atol=1e-14)


meshes = st.sampled_from(sorted(ALL))
seeds = st.integers(0, 10**6)


@given(meshes, seeds, st.sampled_from([0.02, 0.1, 0.3, 0.7]), st.integers(0, 3), st.sampled_from([0, 0.1, 0.5]))
def test_any_choice_of_edges_gives_a_conforming_mesh(name, seed, probability, max_levels, forbidden):
    points, triangles = ALL[name]()
    forbids = chance(seed + 1, forbidden, len(points))
    wanted = {}

    def wants(level):
        chosen = chance(seed, probability, len(points))(level)
        rows = (level.linear @ np.eye(len(points)))[level.edges].mean(axis=1)
        for row, want, never in zip(rows, chosen, forbids(level), strict=True):
            wanted[row.tobytes()] = (level.number, bool(want), bool(never))
        return chosen

    fine = subdivide(triangles, len(points), wants=wants, forbids=forbids, max_levels=max_levels)
    assert_conforming(triangles, len(points), fine)
    assert border_loops(fine.triangles) == border_loops(triangles)
    if name in CLOSED:
        assert set(edge_faces(fine.triangles).values()) == {2}

    present = {row.tobytes() for row in fine.interpolate(np.eye(len(points)))[len(points) :]}
    never = {place for place, (_, _, never) in wanted.items() if never}
    assert not present & never
    missing = {place for place, (n, want, _) in wanted.items() if want and n < max_levels} - present
    if not forbidden:
        assert not missing
        assert fine.blocked == 0
    if max_levels == 1:
        assert missing <= never
        assert fine.blocked >= len(missing)


@given(
    st.sampled_from(sorted({**CLOSED, **OPEN})),
    seeds,
    st.sampled_from([0.03, 0.2]),
    st.sampled_from([0, 0.2]),
)
def test_a_new_vertex_lies_where_refining_everything_puts_it(name, seed, probability, forbidden):
    points, triangles = ALL[name]()
    count = len(points)
    wants, forbids = chance(seed, probability, count), chance(seed + 1, forbidden, count)
    whole = subdivide(triangles, count, wants=everything, max_levels=2)
    there = dict(zip(places(whole, count), whole.positions(points), strict=True))
    fine = subdivide(triangles, count, wants=wants, forbids=forbids, max_levels=2)
    expected = np.array([there[place] for place in places(fine, count)])
    np.testing.assert_allclose(fine.positions(points), expected, atol=1e-14)


@given(meshes, seeds, st.sampled_from([0.1, 0.7]), st.integers(0, 3), st.sampled_from([0, 0.1, 0.5]))
def test_what_is_far_from_all_wishes_need_not_be_looked_at(name, seed, probability, max_levels, forbidden):
    points, triangles = ALL[name]()
    count = len(points)
    near = np.random.default_rng(seed).random(len(triangles)) < 1.5 / max(len(triangles), 1)
    chosen, forbids = chance(seed, probability, count), chance(seed + 1, forbidden, count)

    def wants(level):
        beside = np.zeros(len(level.edges), dtype=bool)
        beside[level.triangle_edges[near[level.parents]]] = True
        return chosen(level) & beside

    whole, part = (
        subdivide(triangles, count, wants=wants, forbids=forbids, max_levels=max_levels, near=each)
        for each in (None, near)
    )
    for field in ("triangles", "parents", "barycentrics"):
        assert np.array_equal(getattr(whole, field), getattr(part, field))
    for field in ("vertex_count", "limited", "blocked", "levels"):
        assert getattr(whole, field) == getattr(part, field)
    values = np.random.default_rng(seed).random((count, 3))
    assert np.array_equal(whole.positions(values), part.positions(values))
    assert np.array_equal(whole.interpolate(values), part.interpolate(values))


@given(meshes, seeds)
def test_it_ends_even_if_the_criteria_contradict_themselves(name, seed):
    points, triangles = ALL[name]()
    rng = np.random.default_rng(seed)
    fine = subdivide(
        triangles,
        len(points),
        wants=lambda level: rng.random(len(level.edges)) < 0.1,
        forbids=lambda level: rng.random(len(level.edges)) < 0.1,
        max_levels=3,
    )
    assert_conforming(triangles, len(points), fine)


@given(seeds, st.sampled_from(["grid", "holes"]))
def test_a_plane_keeps_its_area(seed, name):
    points, triangles = OPEN[name]()

    def areas(positions, faces):
        a, b, c = np.moveaxis(positions[faces], 1, 0)
        return np.cross(b - a, c - a)[:, 2] / 2

    fine = subdivide(triangles, len(points), wants=chance(seed, 0.1, len(points)), max_levels=3, scheme="midpoint")
    found = areas(fine.positions(points), fine.triangles)
    assert found.min() > 0
    np.testing.assert_allclose(found.sum(), areas(points, triangles).sum())
    assert fine.matrix is fine.linear


def test_barycentrics_carry_corner_attributes_and_seams_stay_seams():
    points, triangles = torus()
    # Texture coordinates: a chart of its own for each half of the torus.
    charts = np.arange(len(triangles)) % 2
    uvs = points[triangles][..., :2] + 10.0 * charts[:, None, None]
    fine = subdivide(triangles, len(points), wants=chance(1, 0.2, len(points)), max_levels=3)
    carried = fine.barycentrics @ uvs[fine.parents]
    expected = fine.interpolate(points)[fine.triangles][..., :2] + 10.0 * charts[fine.parents][:, None, None]
    np.testing.assert_allclose(carried, expected, atol=1e-14)
    assert np.all(fine.barycentrics * 2**fine.levels % 1 == 0)


def test_one_edge_bisects_its_faces():
    points, triangles = grid(3, 3)
    fine = subdivide(
        triangles,
        len(points),
        wants=lambda level: (level.number == 0) & (level.edges == [5, 10]).all(axis=1),
        max_levels=3,
    )
    assert (fine.vertex_count, len(fine.triangles), fine.levels) == (17, 20, 1)
    assert np.array_equal(places(fine, 16)[16], [(5, 0.5), (10, 0.5)])


@pytest.mark.parametrize("split", [[0, 1], [1, 2], [0, 2]])
def test_a_forbidden_third_edge_leaves_three_triangles(split):
    # Front and back of one sheet: their diagonals must meet.
    triangles = np.array([[0, 1, 2], [2, 1, 0]])

    def forbids(level):
        return (level.edges == split).all(axis=1)

    fine = subdivide(triangles, 3, wants=lambda level: ~forbids(level), forbids=forbids, max_levels=2)
    assert len(fine.triangles) == 6
    assert (fine.blocked, fine.limited, fine.levels) == (1, 0, 1)
    assert_conforming(triangles, 3, fine)
    front, back = np.sort(fine.triangles, axis=1).reshape(2, 3, 3).tolist()
    assert sorted(front) == sorted(back)


def test_blocked_edges_are_counted_with_those_that_they_hold_back():
    points, triangles = icosahedron()
    levels = {}

    def wants(level):
        levels[level.number] = level
        return everything(level)

    def forbids(level):
        return (level.number == 0) & (level.edges == level.edges[0]).all(axis=1)

    fine = subdivide(triangles, len(points), wants=wants, forbids=forbids, max_levels=2)
    # Beside the forbidden edge are two green faces: nothing splits again at their corners and midpoints.
    beside = levels[0].triangle_edges[(levels[0].triangle_edges == 0).any(axis=1)]
    held = np.union1d(levels[0].edges[0], len(points) + np.setdiff1d(beside, 0) - 1)
    corners = np.setdiff1d(levels[0].edges[beside], held)
    near = np.isin(levels[1].edges, np.union1d(held, corners)).any(axis=1)
    assert fine.levels == 2
    assert fine.blocked == 1 + near.sum()
    assert_conforming(triangles, len(points), fine)


def test_a_forbidden_edge_that_only_a_finer_one_needs_is_counted_too():
    triangles = np.array([[0, 1, 2], [2, 3, 4]])
    fine = subdivide(
        triangles,
        5,
        wants=lambda level: (level.edges == 2).any(axis=1) if level.number else (level.edges < 3).all(axis=1),
        forbids=lambda level: (level.edges == [3, 4]).all(axis=1),
        max_levels=2,
    )
    assert (fine.levels, len(fine.triangles), fine.blocked) == (1, 5, 3)


def test_each_level_is_built_a_few_times_only():
    points, triangles = grid(12, 12)
    calls = []

    def wants(level):
        calls.append(level.number)
        ends = (level.linear @ points)[level.edges]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        return np.linalg.norm(ends.mean(axis=1) - [5.31, 6.17, 0], axis=1) < 0.75 * lengths

    fine = subdivide(triangles, len(points), wants=wants, max_levels=9)
    assert fine.levels == 9
    assert len(calls) <= 3 * fine.levels


@given(meshes, seeds, st.sampled_from([0.02, 0.1, 0.3]), st.sampled_from([0.02, 0.1]))
def test_a_split_that_cannot_be_leaves_no_trace(name, seed, probability, forbidden):
    points, triangles = ALL[name]()
    count = len(points)
    wants, forbids = chance(seed, probability, count), chance(seed + 1, forbidden, count)
    fine = subdivide(triangles, count, wants=wants, forbids=forbids, max_levels=3)
    present = set(places(fine, count)[count:])

    def wants_what_can_be(level):
        middles = (level.linear @ np.eye(count))[level.edges].mean(axis=1)
        can_be = [tuple((int(v), float(row[v])) for v in np.flatnonzero(row)) in present for row in middles]
        return wants(level) & np.array(can_be, dtype=bool)

    again = subdivide(triangles, count, wants=wants_what_can_be, forbids=forbids, max_levels=3)
    assert np.array_equal(again.triangles, fine.triangles)


def test_limits_are_counted():
    points, triangles = icosahedron()
    fine = subdivide(triangles, len(points), wants=everything, max_levels=0)
    assert (fine.limited, fine.levels, len(fine.triangles)) == (30, 0, 20)
    fine = subdivide(triangles, len(points), wants=everything, max_levels=2)
    assert (fine.limited, fine.levels, len(fine.triangles)) == (480, 2, 320)
    assert fine.unmet.tolist() == list(range(20))
    fine = subdivide(triangles, len(points), wants=up_to(2), max_levels=2)
    assert (fine.limited, len(fine.unmet)) == (0, 0)


def test_a_line_of_non_manifold_edges_takes_midpoints():
    points, triangles = t_joint()
    points = points + np.random.default_rng(0).normal(size=points.shape)
    fine = subdivide(triangles, len(points), wants=up_to(1), max_levels=1)
    joint = {(v, v + 1) for v in range(10, 14)}
    middles = {p: v for v, p in enumerate(places(fine, len(points)))}
    for a, b in joint:
        middle = middles[(a, 0.5), (b, 0.5)]
        np.testing.assert_allclose(fine.positions(points)[middle], (points[a] + points[b]) / 2)


@pytest.mark.parametrize("wrapped", [False, True])
def test_stencils_do_not_read_across_hard_edges(wrapped):
    """One line, or two lines round a torus, at all levels."""
    points, triangles = grid(6, 6, wrapped)
    columns = points[:, 0]
    lines = [0, 3] if wrapped else [3]
    side, other = (columns > 0) & (columns < 3) if wrapped else columns < 3, columns > 3
    hard = np.array([(a, b) for a, b in edge_faces(triangles) if columns[a] == columns[b] and columns[a] in lines])
    fine, plain = (subdivide(triangles, len(points), wants=up_to(2), max_levels=2, hard=each) for each in (hard, None))
    assert np.array_equal(fine.triangles, plain.triangles)
    shares, flat = fine.matrix @ np.eye(len(points)), fine.linear @ np.eye(len(points))
    on_line = (flat[:, ~np.isin(columns, lines)] == 0).all(axis=1)
    assert on_line.sum() == len(lines) * (24 if wrapped else 25)
    assert np.array_equal(shares[on_line], flat[on_line])
    left, right = (flat[:, side] > 0).any(axis=1), (flat[:, other] > 0).any(axis=1)
    assert not (left & right).any()
    assert (shares[left][:, other] == 0).all()
    assert (shares[right][:, side] == 0).all()
    assert (plain.matrix @ np.eye(len(points)))[left][:, other].any(), "the case is one"
    # Away from the line all is as ever.
    assert not np.array_equal(shares, flat)
    np.testing.assert_allclose(shares.sum(axis=1), 1, atol=1e-14)


def test_the_same_bits_again():
    points, triangles = in_pieces()
    first, second = (
        subdivide(triangles, len(points), wants=chance(5, 0.2, len(points)), max_levels=3) for _ in range(2)
    )
    assert first.triangles.tobytes() == second.triangles.tobytes()
    assert first.barycentrics.tobytes() == second.barycentrics.tobytes()
    assert first.positions(points).tobytes() == second.positions(points).tobytes()


def test_mirrored_meshes_are_refined_as_mirror_images():
    points, triangles = icosphere(1)
    points = points + np.random.default_rng(0).normal(size=points.shape) * 0.1
    one = subdivide(triangles, len(points), wants=up_to(2), max_levels=2)
    other = subdivide(triangles[:, ::-1], len(points), wants=up_to(2), max_levels=2)
    mirrored = other.positions(points * [-1, 1, 1]) * [-1, 1, 1]
    assert np.array_equal(one.positions(points), mirrored)


def test_arguments_are_left_alone():
    points, triangles = torus()
    before = triangles.tobytes(), points.tobytes()
    fine = subdivide(triangles, len(points), wants=nothing, max_levels=2)
    fine.positions(points)[:] = 0.0
    fine.triangles[:] = 0
    assert (triangles.tobytes(), points.tobytes()) == before


@given(meshes, seeds, st.sampled_from([0.02, 0.1, 0.3]), st.sampled_from([0.1, 0.6]), st.integers(1, 3))
def test_only_splits_that_show_or_that_finer_ones_need_are_left(name, seed, probability, showing, max_levels):
    points, triangles = ALL[name]()
    count, wants, choice = len(points), chance(seed, probability, len(points)), chance(seed + 1, showing, len(points))
    shown = set()

    def shows(level):
        shares, flags = (level.linear @ np.eye(count)), choice(level)
        middles = shares[level.edges[flags]].mean(axis=1)
        shown.update(tuple((int(v), float(row[v])) for v in np.flatnonzero(row)) for row in middles)
        return flags

    whole = subdivide(triangles, count, wants=wants, max_levels=max_levels)
    fine = subdivide(triangles, count, wants=wants, shows=shows, max_levels=max_levels)
    assert_conforming(triangles, count, fine)
    at = {place: vertex for vertex, place in enumerate(places(whole, count))}
    left = places(fine, count)
    assert np.array_equal(fine.positions(points), whole.positions(points)[[at[place] for place in left]])
    assert shown.isdisjoint(set(at) - set(left))
    finest = [place for place in left if any(share * 2**fine.levels % 2 for _, share in place) and len(place) > 1]
    assert shown.issuperset(finest)
    assert bool(finest) == (fine.levels > 0) == (fine.matrix is not None) == (fine.vertex_count > count)
