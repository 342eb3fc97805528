"""Triangles that a clip can strain, against the strain of all of them."""

import numpy as np
import pytest

from kit.limb import limb_asset
from kit.prepared import unattached
from wrinklecli.character.range_of_motion import range_of_motion
from wrinklecli.surface.sites import at_sites, spread_sites
from wrinklecli.surface.strain import read_gauge, strain
from wrinklecli.surface.strained import StrainedParts


def test_what_a_motion_strains_is_among_the_triangles_that_it_can() -> None:
    """The limb's second target bulges its middle; a joint bends what is near to it."""
    made = unattached(limb_asset(rings=40, sides=4, joints=6, morphs=2, clip=None))
    gauge = read_gauge(made.surface, made.rest, made.rig)
    sites = spread_sites(gauge)
    times = np.array([0.0, 0.4, 1.0])
    counts = {}
    for clip in range_of_motion(made.document, [0]).clips[::8]:
        whole, part = strain(gauge, clip, times), gauge.strained.of(clip)
        if part is None:
            continue
        counts[clip.name] = len(part.triangles)
        others = np.delete(whole, part.triangles, axis=1)
        assert np.abs(others).max(initial=0.0) < 1e-12
        assert strain(gauge, clip, times, part) == pytest.approx(whole[:, part.triangles], abs=1e-12)
        averaged = at_sites(sites, clip, times)
        rows = whole.transpose(1, 0, 2).reshape(len(gauge.triangles), -1)
        expected = (sites.smooth @ (sites.gather @ rows)).reshape(-1, 3, 6).transpose(1, 0, 2)
        assert averaged == pytest.approx(expected, abs=1e-9)
    assert len(counts) >= 3
    assert max(counts.values()) < 0.4 * len(gauge.triangles)


def test_a_clip_that_scales_or_bends_most_of_it_is_looked_at_as_a_whole() -> None:
    made = unattached(limb_asset(rings=8, sides=5, clip="grow"))
    assert StrainedParts(made.rig, made.surface, made.surface.triangles).of(made.clip) is None
    made = unattached(limb_asset(rings=8, sides=5, joints=6))
    assert StrainedParts(made.rig, made.surface, made.surface.triangles).of(made.clip) is None
