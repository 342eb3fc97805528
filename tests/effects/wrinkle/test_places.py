"""Bent crests: the place on the control curve rises along every line, and keeps the patch's borders."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.carried import carry_patch
from kit.limb import limb_asset, tool
from kit.prepared import prepare
from wrinklecli.effects.wrinkle.places import bowed


@given(st.floats(-1, 1), st.integers(1, 64), st.floats(-1.5, 1.5))
def test_it_rises_strictly_and_keeps_both_borders(bow: float, bumps: int, v: float) -> None:
    u = np.linspace(-0.5, 1.5, 2001)
    found = bowed(u, np.full(len(u), v), bow, bumps)
    assert np.diff(found).min() > 0.24 * np.diff(u).min()
    outside = (u <= 0) | (u >= 1)
    assert (found[outside] == u[outside]).all()
    assert np.abs(found - u).max() <= 0.5 / bumps * (1 + 1e-12)


def test_crests_are_arcs() -> None:
    ruled, bent = (prepare(limb_asset(rings=31, sides=24), tool(bow=bow, bumps=5, variation=0)) for bow in (0, 1))
    (plain, _), (carried, fine) = carry_patch(ruled), carry_patch(bent)
    u, v = bent.patch.coordinates(fine.rest_positions[carried.vertices])
    inner = (u > 0.25) & (u < 0.75)
    assert carried.us[inner] == pytest.approx(u[inner] - v[inner] ** 2 / 10, abs=1e-12)
    assert (plain.us == ruled.patch.coordinates(ruled.refined().rest_positions[plain.vertices])[0]).all()
