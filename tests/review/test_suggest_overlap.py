"""Suggested tools lie apart, none with its middle well within another."""

import numpy as np
import pytest

from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import prepare
from wrinklecli.review.suggest.fitted_tools import _covers, _overlap


@pytest.mark.parametrize(
    ("along", "across", "above", "turned", "covered"),
    [
        (0.5, 0.0, 0.0, 0.0, True),
        (0.02, 0.0, 0.0, 0.0, True),
        (0.98, 0.0, 0.0, 0.0, True),
        (-0.02, 0.0, 0.0, 0.0, False),
        (1.02, 0.0, 0.0, 0.0, False),
        (0.5, 0.75, 0.0, 0.0, True),
        (0.5, -0.75, 0.0, 0.0, True),
        (0.5, 0.85, 0.0, 0.0, False),
        (0.5, 0.0, 0.45, 0.0, True),
        (0.5, 0.0, -0.45, 0.0, True),
        (0.5, 0.0, 0.55, 0.0, False),
        (0.5, 0.0, 0.0, 85.0, True),
        (0.5, 0.0, 0.0, 95.0, False),
    ],
)
def test_a_region_has_what_is_well_within_it(
    along: float, across: float, above: float, turned: float, covered: bool
) -> None:
    """Its ends are at 0 and 1, its sides at -1 and 1; `above` is relative to its span, `turned` the normal's angle."""
    start, end, width = -0.4, 0.4, 0.2
    flat = limb_asset(rings=25, sides=8)
    patch = prepare(flat, tool(origin=[start, RADIUS, 0], target=[end, RADIUS, 0], width=width)).patch
    (region,) = patch.regions
    place = np.array([start + along * (end - start), RADIUS + above * (end - start), across * width / 2])
    normal = np.array([0.0, np.cos(np.radians(turned)), np.sin(np.radians(turned))])
    assert _covers(region, place, normal) == covered


@pytest.mark.parametrize(("apart", "meet"), [(0.0, True), (0.3, True), (0.5, False)])
def test_regions_overlap_where_the_middle_of_one_is_in_the_other(apart: float, meet: bool) -> None:
    """A short one and a long one, the middle of the long one beyond the short one from 0.1 on."""
    short = tool(name="short", origin=[apart - 0.1, RADIUS, 0], target=[apart + 0.1, RADIUS, 0], width=0.1)
    long = tool(name="long", origin=[-0.4, RADIUS, 0], target=[0.4, RADIUS, 0], width=0.2)
    one, other = (patch.regions[0] for patch in prepare(limb_asset(rings=25, sides=8), short, long).patches)
    assert _overlap(one, other) == _overlap(other, one) == meet
