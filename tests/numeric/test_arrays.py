"""Searches by sorted values give what a look at all values gives, to the bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from wrinklecli.numeric import arrays
from wrinklecli.numeric.arrays import (
    KnownRows,
    ValueIndex,
    VertexFaces,
    any_of,
    children,
    components,
    flags_of,
    smoothstep,
    vertex_normals,
    weighted_quantiles,
)


@pytest.mark.parametrize("many", [0.0, 1.0])
@given(seed=st.integers(0, 999))
def test_what_is_around_some_vertices_is_found(many: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    places, triangles = rng.normal(size=(20, 3)), rng.integers(0, 20, (30, 3))
    vertices = rng.permutation(20)[: rng.integers(0, 20)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(arrays, "_MANY", many)
        found = VertexFaces.of(triangles, 20)
        assert np.array_equal(found.faces_of(vertices), np.flatnonzero(any_of(flags_of(vertices, 20), triangles)))
        assert np.array_equal(found.normals_at(places, vertices), vertex_normals(places, triangles)[vertices])


@given(seed=st.integers(0, 999), share=st.sampled_from([0.02, 0.5]))
def test_children_are_those_whose_parent_is_chosen(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    parents, flags = np.sort(rng.integers(0, 50, 80)), rng.random(50) < share
    assert np.array_equal(children(parents, np.flatnonzero(flags)), np.flatnonzero(flags[parents]))


@given(seed=st.integers(0, 999))
def test_places_of_values_are_found(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, wanted = rng.integers(0, 20, 60), rng.permutation(30)[: rng.integers(0, 30)]
    places, which = ValueIndex.of(values).holding(wanted)
    assert np.array_equal(places, np.flatnonzero(np.isin(values, wanted)))
    assert np.array_equal(wanted[which], values[places])


@given(seed=st.integers(0, 999))
def test_weighted_quantiles_are_those_of_repeated_values(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, counts, parts = rng.normal(size=9), rng.integers(1, 5, 9), rng.random(4)
    repeated = np.sort(np.repeat(values, counts))
    wanted = repeated[np.ceil(parts * len(repeated)).astype(int) - 1]
    assert np.array_equal(weighted_quantiles(values, counts.astype(float), parts), wanted)


@given(seed=st.integers(0, 999), count=st.integers(1, 60), links=st.integers(0, 60))
def test_components_are_those_of_scipy(seed: int, count: int, links: int) -> None:
    pairs = np.random.default_rng(seed).integers(0, count, (links, 2))
    graph = coo_array((np.ones(links), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    assert np.array_equal(components(pairs, count), connected_components(graph, directed=False)[1])


def test_components_of_a_long_path_take_few_rounds() -> None:
    order = np.random.default_rng(0).permutation(2**17)
    assert not components(np.stack([order[:-1], order[1:]], axis=1), 2**17).any()


@given(t=st.floats(0, 1), factor=st.floats(-9, 9))
def test_smoothstep_is_level_at_both_ends_and_symmetric(t: float, factor: float) -> None:
    assert smoothstep(np.array([0.0, 1.0]), factor).tolist() == [0.0, factor]
    assert smoothstep(np.array(t)) + smoothstep(np.array(1.0 - t)) == pytest.approx(1.0)
    assert smoothstep(np.array(t), factor) == pytest.approx(factor * (3.0 * t**2 - 2.0 * t**3))


def test_a_row_is_found_once_and_kept() -> None:
    asked: list[list[int]] = []
    known, rows = KnownRows.of(9), np.arange(27.0).reshape(9, 3)

    def find(numbers: NDArray[np.intp]) -> NDArray[np.float64]:
        asked.append(numbers.tolist())
        return rows[numbers]

    for wanted in ([4, 1, 4], [1], [8, 1, 0]):
        assert np.array_equal(known.at(np.array(wanted), find), rows[wanted])
    assert asked == [[1, 4], [0, 8]]
