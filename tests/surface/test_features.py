"""Distances from features of a surface."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.surface.features import segment_distances


@given(st.integers(0, 99))
def test_no_place_of_a_segment_is_nearer_than_its_distance(seed: int) -> None:
    numbers = np.random.default_rng(seed)
    points, segments = numbers.normal(size=(9, 3)), numbers.normal(size=(9, 2, 3)) * numbers.choice([0.1, 1, 10])
    segments[0, 1] = segments[0, 0]  # a point
    found = segment_distances(points, segments)
    parts = np.linspace(0.0, 1.0, 401)[:, None, None]
    places = segments[:, 0] + parts * (segments[:, 1] - segments[:, 0])
    nearest = np.linalg.norm(points - places, axis=2).min(axis=0)
    assert (found <= nearest + 1e-12).all()
    np.testing.assert_allclose(found, nearest, rtol=1e-3, atol=1e-3)
