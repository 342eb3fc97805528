"""The demand of the line under a path: the surface keeps its length where it bends, not only the curve."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from kit.carried import carry_patch, moved, scattered
from kit.limb import LENGTH, RADIUS, limb_asset, limb_weights
from kit.prepared import Prepared, prepare
from wrinklecli.character.pose import blend, joint_matrices, transform
from wrinklecli.drive.stored import TAUT
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.curve import ControlCurve
from wrinklecli.effects.wrinkle.demand import _Line, demanding
from wrinklecli.numeric.arrays import Floats

# From the joint that folds, whose skin folds over half a unit about x = 0.
PATH = [[x, RADIUS, 0.0] for x in (-0.4, -0.2, 0.0, 0.2, 0.4)]
# Round the limb, along it and as far back, so that no bend brings the ends nearer.
ACROSS = [(-0.2, -0.4), (-0.05, 0.0), (-0.2, 0.4)]
FOLD = {"name": "fold", "path": PATH, "width": 0.3, "bumps": 3, "max_height": "none", "variation": 0}


def folded(**keys: Any) -> Prepared:
    return prepare(limb_asset(rings=81, angle=55.0), {**FOLD, **keys})


def wrinkled_lengths(prepared: Prepared, curve: ControlCurve, times: Floats) -> Floats:
    """(times,) how long the limb's line from end to end of the path is over what it was, along its own skinning."""
    us = np.linspace(0.0, 1.0, 801)
    points = np.stack([-0.4 + 0.8 * us, np.full(801, RADIUS), np.zeros(801), np.ones(801)], axis=1)
    distances, rest_lengths, *_ = prepared.patch.segment.lengths(prepared.rig, prepared.clip, times)
    amplitudes, _ = curve.follow(distances, rest_lengths)
    raised = np.einsum("tgm,gmu->tu", amplitudes, curve.shapes(us))
    matrices = joint_matrices(prepared.rig, prepared.clip, times)
    blended = np.einsum("uj,tjab->tuab", limb_weights(points[:, 0], 2), matrices)[:, :, :3]
    points = points + raised[..., None] * [0.0, 1.0, 0.0, 0.0]
    posed = np.einsum("tuab,tub->tua", blended, points)
    lengths: Floats = np.linalg.norm(np.diff(posed, axis=1), axis=2).sum(axis=1) / 0.8
    return lengths


def test_a_path_on_the_inside_of_a_bend_keeps_its_length() -> None:
    prepared, times = folded(), np.linspace(0.1, 1.0, 10)
    curve = prepared.patch.curve
    assert wrinkled_lengths(prepared, curve, times) == pytest.approx(1.0, abs=0.01)
    # What a curve above a straight line asks for leaves it shorter.
    assert wrinkled_lengths(prepared, replace(curve, demand=None), times)[-1] < 0.95


@pytest.mark.quick(1)
@pytest.mark.parametrize("keys", [{}, {"profile": "polyline", "max_height": "none"}, {"strength": -0.5}])
def test_a_mesh_whose_edges_cut_corners_is_as_long(keys: dict[str, Any]) -> None:
    prepared, times = folded(**keys), np.linspace(0.2, 1.0, 5)
    smooth, fine = carry_patch(prepared)
    carried = demanding(smooth, fine, prepared.rig)

    def lengths(tool: CarriedPatch) -> Floats:
        """(times,) of the row of vertices below the path, over that at rest."""
        moves = scattered(tool, fine, moved(prepared, tool, fine, times)) / tool.patch.shape_strength
        rest = fine.rest_positions
        row = np.flatnonzero((np.abs(rest[:, 2]) < 1e-9) & (rest[:, 1] > 0.0) & (np.abs(rest[:, 0]) < 0.4 + 1e-6))
        row = row[np.argsort(rest[row, 0])]
        blended = blend(fine.dense_weights(row, 2), joint_matrices(prepared.rig, prepared.clip, times))
        posed = transform(blended, fine.positions[row] + moves[:, row])
        return np.linalg.norm(np.diff(posed, axis=1), axis=2).sum(axis=1) / np.ptp(rest[row, 0])

    assert lengths(carried) == pytest.approx(1.0, abs=0.001)
    assert lengths(smooth)[-1] < 0.996


def test_a_mesh_too_coarse_for_bumps_asks_for_what_smooth_ones_do() -> None:
    prepared = prepare(limb_asset(rings=9, angle=55.0), FOLD, refinement={"max_levels": 0})
    smooth, fine = carry_patch(prepared)
    assert demanding(smooth, fine, prepared.rig) is smooth


@pytest.mark.parametrize("keys", [{"strategy": "both_ends", "max_height": 0.08}, {"compressible": "60%"}])
def test_more_is_asked_for_the_further_a_joint_bends(keys: dict[str, Any]) -> None:
    demand = folded(**keys).patch.curve.demand
    assert demand is not None
    roots, asked = demand
    assert (np.diff(roots) > 0).all()
    assert (np.diff(asked) >= 0).all()
    assert roots[[0, -1]] == pytest.approx([0.0, np.sqrt(TAUT)])
    assert asked[[0, -1]] == pytest.approx([0.0, np.sqrt(TAUT)])
    # Little more at first, and much at last.
    assert asked[1] == pytest.approx(roots[1], rel=0.05)
    assert asked[-2] > 1.08 * roots[-2]


@pytest.mark.parametrize(
    "keys",
    [
        {"path": PATH[::4]},
        {"path": [[x - LENGTH / 4, y, z] for x, y, z in PATH]},
        {"path": [[x, RADIUS * np.cos(angle), RADIUS * np.sin(angle)] for x, angle in ACROSS]},
        {"rest_length": {"keys": {"fold": [[0, "100%"], [1, "110%"]]}}},
    ],
    ids=["straight", "no joint between", "no nearer", "keyed"],
)
def test_other_curves_are_as_they_were(keys: dict[str, Any]) -> None:
    assert folded(**keys).patch.curve.demand is None


def test_the_line_of_a_mesh_runs_where_v_is_0_from_end_to_end() -> None:
    """On a slanting path, whose line runs through no vertex: it cuts each edge in another ratio."""
    path = [[x, RADIUS, 0.13 * x] for x in (-0.4, -0.2, 0.0, 0.2, 0.4)]
    prepared = folded(path=path)
    carried, fine = carry_patch(prepared)
    line = _Line.of_mesh(carried, fine, prepared.rig)
    assert line is not None
    points = np.einsum("pk,pkx->px", line.shares, line.rest_points[line.corners])
    u, v = prepared.patch.coordinates(points)
    assert u[[0, -1]] == pytest.approx([0.0, 1.0], abs=1e-3)
    assert (np.diff(u) > -1e-9).all()
    assert np.abs(v).max() < 1e-3
    assert line.rest_length == pytest.approx(prepared.patch.span, rel=0.01)
