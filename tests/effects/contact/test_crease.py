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
from wrinklecli.effects.contact import crease as creases
from wrinklecli.effects.contact.fitting import fit_poses
from wrinklecli.effects.contact.fold import RINGS
from wrinklecli.effects.contact.given_up import UnresolvedError
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.contact.solution import Solution, _error_weights, free_rows
from wrinklecli.effects.contact.tissue import FREE, SOFT, SkinnedPose, SolverState, Tissue
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
        rows = free_rows(tissue)
        state = SolverState(rest, SkinnedPose(rest, matrices))
        return Solution(tissue, moved[rows], shares[rows], 0.0 * moved[rows], rest, matrices[rows], state)

    solved = [found(8), found(11)]
    weights, shapes, crossing = fit_poses(solved, share=0.35, most=8)
    lost = [each.volume_loss(np.tensordot(row, shapes, axes=1)) for each, row in zip(solved, weights, strict=True)]
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
    free, near = found.tissue.free, found.tissue.apart == 0.0
    assert np.array_equal(free, found.tissue.apart < FREE * SOFT)
    # However long edges are: beside what crosses nothing stands still.
    for _ in range(RINGS):
        near = widened(found.tissue.edges, near)
    assert free[near].all()


FAR, BEGUN = SimpleNamespace(far=True), SimpleNamespace(far=False)


@pytest.mark.parametrize(("poses", "raises"), [((), True), ((BEGUN,), True), ((BEGUN, FAR), False)])
def test_a_straight_sweep_that_settles_nowhere_beyond_30_degrees_ends_the_search(
    poses: tuple[Any, ...], raises: bool
) -> None:
    reason: Any = SimpleNamespace(reason="it is torn")
    failed: Any = SimpleNamespace(failed=UnresolvedError(reason), poses=poses)
    sound: Any = SimpleNamespace(failed=None, poses=(BEGUN,))
    if raises:
        with pytest.raises(UnresolvedError, match="it is torn"):
            creases.poses_of_sweeps([failed, sound])
    else:
        assert creases.poses_of_sweeps([failed, sound]) == [*poses, BEGUN]
