"""Distances along rays."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.numeric.rays import distances_along, ray_hits


@given(seed=st.integers(0, 999), count=st.sampled_from([0, 1, 40, 1000]), away=st.sampled_from([0.0, 1e3]))
def test_all_rays_at_once_meet_what_each_meets_alone(seed: int, count: int, away: float) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(count, 1, 3)) + 10.0 ** rng.uniform(-3, 0, (count, 1, 1)) * rng.normal(
        size=(count, 3, 3)
    )
    corners[: count // 10, 2] = corners[: count // 10, 0]  # without area
    corners = corners + away
    starts, rays = rng.normal(size=(30, 3)) + away, rng.normal(size=(30, 3))
    rays[:10] = corners.reshape(-1, 3).mean(axis=0) - starts[:10] if count else rays[:10]
    numbers, triangles, distances = ray_hits(starts, rays, corners)
    found = np.full((30, count), np.inf)
    found[numbers, triangles] = distances
    alone = np.array([distances_along(start, ray, corners) for start, ray in zip(starts, rays, strict=True)])
    assert np.array_equal(np.isfinite(found), np.isfinite(alone))
    met = np.isfinite(alone)
    assert found[met] == pytest.approx(alone[met], rel=1e-9 if away else 1e-11, abs=1e-9 if away else 1e-11)
