"""Mirrored folds are mirrored: both sides are resolved or left alike, and look alike."""

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.bakes import report_of
from kit.folds import CLIP, twins
from wrinklecli.effects.contact.crease import SHAPE_ERROR
from wrinklecli.effects.contact.tissue import UNITS

TIMES = np.linspace(0.0, 1.0, 9)
# The gap that contact keeps, solver's units: within it, the solver may end a little sooner on one side.
GAP = 1.0
# What says how a side is left in a clip.
ALIKE = ("poses", "reason", "begin", "end", "faded", "height")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angle", "inwards", "near"),
    [
        pytest.param(110.0, 0.0, GAP, id="apart"),
        # The second of two folds that meet takes over the errors of the first, whose shapes may be so far off.
        pytest.param(110.0, 7.0, None, id="meeting"),
        pytest.param(150.0, 20.0, None, id="unsettled in deep bends"),
    ],
)
def test_mirrored_folds_are_mirrored(angle: float, inwards: float, near: float | None) -> None:
    fold = twins(angle=angle, inwards=inwards)
    resolved, off = fold.baked(), fold.baked("off")
    left, right = report_of(resolved).data["folds"]
    assert [[each[key] for key in ALIKE] for each in left["left"]] == [
        [each[key] for key in ALIKE] for each in right["left"]
    ]
    places = resolved.attribute("limb", "POSITION")
    mirror = np.array([1.0, 1.0, -1.0])
    partners = np.square(places[:, None] - places * mirror).sum(axis=2).argmin(axis=1)
    assert places[partners] * mirror == pytest.approx(places, abs=1e-6)
    moves = (resolved.pose("limb", CLIP, TIMES) - off.pose("limb", CLIP, TIMES)) * UNITS / fold.radius
    greatest = np.linalg.norm(moves, axis=2).max()
    apart = np.linalg.norm(moves - moves[:, partners] * mirror, axis=2).max()
    assert greatest > 10.0
    assert apart < (near or SHAPE_ERROR * greatest)
