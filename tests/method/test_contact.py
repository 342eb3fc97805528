"""Contact by property: a tube that folds through itself touches and never crosses, and moves nowhere else."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wrinklecli.numeric.crossings import Crossings

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from wrinklecli.method.contact import FREE, SOFT, UNITS, Posed, Tissue, march

RINGS, SIDES = 16, 10


def tube(radius: float) -> tuple[np.ndarray, np.ndarray]:
    """A tube along x, open at its ends, of the solver's units."""
    x, turn = np.linspace(-3 * UNITS, 3 * UNITS, RINGS), 2 * np.pi * np.arange(SIDES) / SIDES
    places = np.stack(np.broadcast_arrays(x[:, None], radius * np.cos(turn), radius * np.sin(turn)), axis=2)
    a = np.arange((RINGS - 1) * SIDES)
    b = a - a % SIDES + (a + 1) % SIDES
    triangles = np.concatenate([np.stack([a, b, a + SIDES], 1), np.stack([b, b + SIDES, a + SIDES], 1)])
    return places.reshape(-1, 3), triangles


def folded(rest: np.ndarray, angle: float, width: float, bump: float) -> Posed:
    """Bent about z by linear blend skinning, towards +y, with a bump that rises on the inside of the bend."""
    share = np.clip(rest[:, 0] / width + 0.5, 0.0, 1.0)
    share = share * share * (3 - 2 * share)
    turned = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    matrices = (1 - share)[:, None, None] * np.eye(3) + share[:, None, None] * turned
    inside = np.clip(rest[:, 1] / np.abs(rest[:, 1]).max(), 0, 1)
    high = rest + bump * angle * inside[:, None] * np.exp(-((np.abs(rest[:, 0]) / 40 - 1) ** 2))[:, None] * [0, 1, 0]
    return Posed(np.einsum("vij,vj->vi", matrices, high), matrices)


@pytest.mark.quick(1)
@settings(max_examples=2)
@given(radius=st.floats(40, 80), width=st.floats(50, 150), bump=st.floats(0, 6))
def test_a_folded_tube_touches_and_never_crosses(radius: float, width: float, bump: float) -> None:
    rest, triangles = tube(radius)
    poses = [folded(rest, angle, width, bump) for angle in np.radians(np.arange(0.0, 91.0, 6.0))]
    crossings = Crossings.of(rest, triangles)
    marked = np.zeros(len(rest), bool)
    for posed in poses:
        _, through = crossings.at(posed.positions)
        marked[triangles[through]] = True
    near = np.abs(rest[:, 0]) < np.abs(rest[marked, 0]).max(initial=0.0) + FREE * SOFT
    free = near & (np.arange(len(rest)) >= SIDES) & (np.arange(len(rest)) < len(rest) - SIDES)
    tissue = Tissue(rest, triangles, np.ones(len(triangles), bool), free)
    first = None
    for number, (posed, state) in enumerate(zip(poses, march(tissue, poses), strict=True)):
        assert not len(crossings.at(state.positions)[0])
        assert not state.correction[~free].any()
        first = number if first is None and len(crossings.at(posed.positions)[0]) else first
        if state.converged and tissue.clear(posed.positions):
            # Where nothing touches, all is where the pose wants it.
            assert np.abs(state.correction).max() < 0.1
    assert marked.any() == (first is not None)
    # The same again, to the bit.
    again = list(march(Tissue(rest, triangles, np.ones(len(triangles), bool), free), poses[: (first or 0) + 2]))
    same = list(march(tissue, poses[: (first or 0) + 2]))
    assert np.array_equal(again[-1].positions, same[-1].positions)
