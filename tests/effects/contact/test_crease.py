"""Reduced shapes of contact: there are few, yet they keep the volume, and cover all vertices that may move."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import shortest_path

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.asset import attribute
from kit.bent_tube import SIDES, tube
from kit.creases import resolved
from kit.limb import limb_asset, tool, write_tools
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.crease import Crease, MarchedClip
from wrinklecli.effects.contact.fitting import combined, fit_poses
from wrinklecli.effects.contact.fold import RINGS
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.contact.solution import Solution, _error_weights
from wrinklecli.effects.contact.tissue import FREE, SOFT, Tissue
from wrinklecli.numeric.intersections import widened


def test_shapes_that_would_take_volume_away_are_more() -> None:
    rest, triangles = tube(60.0)
    ring = np.arange(len(rest)) // SIDES
    free = (ring > 0) & (ring < ring.max())
    tissue = Tissue(rest, triangles, np.ones(len(triangles), bool), free, np.ones(len(rest), bool), np.zeros(len(rest)))
    matrices = np.tile(np.eye(3), (len(rest), 1, 1))
    turning = np.cross([1.0, 0.0, 0.0], rest / 60.0)

    def found(shrunk: int) -> Solution:
        """Two rings that turn and swell, and two that shrink as much, which count little."""
        first, other = np.isin(ring, [4, 5]), np.isin(ring, [shrunk, shrunk + 1])
        moved = 1.5 * (first * 1.0 - other)[:, None] * rest / 60.0 + 8.0 * first[:, None] * turning
        moved[:, 0] = 0.0
        shares = np.where(other, 0.01, 1.0)
        rows = tissue.free_rows
        return Solution(tissue, moved[rows], shares[rows], 0.0 * moved[rows], rest, matrices[rows])

    solved = [found(8), found(11)]
    weights, shapes, crossing = fit_poses(solved, share=0.35, most=8)
    lost = [abs(each.volume_change(combined(row, shapes))) for each, row in zip(solved, weights, strict=True)]
    assert len(shapes) == 2
    assert crossing == 0
    assert max(lost) < 0.01


def test_errors_count_less_with_each_ring_around_what_touches() -> None:
    rest, triangles = tube(60.0)
    some = np.ones(len(rest), bool)
    tissue = Tissue(rest, triangles, np.ones(len(triangles), bool), some, some, np.zeros(len(rest)))
    first = 5 * SIDES
    steps = shortest_path(coo_array((np.ones(len(tissue.edges)), tissue.edges.T), (len(rest),) * 2), directed=False)
    weights = _error_weights(tissue, np.arange(len(rest)) == first)
    assert weights == pytest.approx(np.array([1.0, 0.4, 0.16, 0.064, 0.01])[np.minimum(steps[first], 4).astype(int)])


@pytest.mark.slow
@pytest.mark.long
def test_all_that_is_near_what_crosses_may_move(tmp_path: Path) -> None:
    """A limb that swells away from its joint touches far from it: where it is held there, it breaks at the border."""
    asset = limb_asset(rings=12, sides=6)
    positions = attribute(asset, 0, "POSITION")
    positions[:, 1:] *= 1.0 + 0.6 * np.abs(positions[:, :1])
    crease = tool(bumps=1, contact="resolve", origin=[-0.25, 0.25, 0.0], target=[0.25, 0.25, 0.0])
    tools = write_tools(tmp_path / "tools.yaml", crease, refinement={"max_levels": 0})
    (plan,) = plan_meshes(read_job(str(asset.write(tmp_path / "limb.glb")), str(tools), BakeOptions()))
    contact = plan.layer(ContactLayer)
    assert contact is not None
    found = resolved(contact.folds[0], most=4)
    tissue = found.fold.tissue
    free, near = tissue.free, tissue.apart == 0.0
    assert np.array_equal(free, tissue.apart < FREE * SOFT)
    # However long edges are: beside what crosses nothing stands still.
    for _ in range(RINGS):
        near = widened(tissue.edges, near)
    assert free[near].all()


@pytest.mark.parametrize("torn", [False, True])
def test_a_pose_that_shapes_tear_is_asked_for_in_the_next_round(*, torn: bool) -> None:
    nothing = np.zeros((4, 3))
    found: Any = SimpleNamespace(
        moved=nothing, error_weights=np.ones(4), held_volume=(nothing, 0.0), between=None,
        crossing=lambda moved: np.zeros(len(moved), bool), errors=lambda _: np.zeros(4),
        volume_change=lambda _: 0.0, tears=lambda _: torn,
    )  # fmt: skip
    fold: Any = SimpleNamespace(radius=1.0)
    crease, clip = Crease(fold, np.ones((1, 4, 3)), (), 1.0), Clip(-1, "", (), 0.0, 1.0)
    followed = crease.follow(MarchedClip(clip, np.array([0.0, 1.0]), {1: found}, {}))
    assert followed.unspanned == ((1,) if torn else ())
    assert followed.crossing == ()
