"""The segment across a region: as long as the surface is compressed there, along the way in which it loses most."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from kit.asset import plate
from kit.prepared import unattached
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.compression import CompressedRegion
from wrinklecli.surface.sites import Sites, spread_sites
from wrinklecli.surface.strain import read_gauge
from wrinklecli.surface.trace import _fits, _walk, find_segment

COUNT = 21


@cache
def sheet(turn: float, scale: float = 1.0) -> tuple[Sites, Floats]:
    """Sites of a flat square from -2 to 2, turned about z and scaled, and the (2, 3) axes of the square."""
    axes = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0]])
    x, y = (each.ravel() for each in np.meshgrid(*[np.linspace(-2.0, 2.0, COUNT)] * 2, indexing="ij"))
    first = (np.arange(COUNT - 1)[:, None] * COUNT + np.arange(COUNT - 1)).reshape(-1, 1)
    faces = np.concatenate([first + np.array(each) for each in ((0, COUNT, COUNT + 1), (0, COUNT + 1, 1))])
    made = unattached(plate(scale * np.stack([x, y], axis=1) @ axes, faces))
    return spread_sites(read_gauge(made.surface, made.rest, made.rig)), axes


def squeezed(turn: float, left: float, right: float) -> Floats:
    """(vertices, 3) a pose in which the square is half as wide between x = -left and x = right."""
    sites, axes = sheet(turn)
    positions = sites.gauge.rest.positions
    x = positions @ axes[0]
    return positions - 0.5 * (np.clip(x, -left, right))[:, None] * axes[0]


def region(turn: float, *, on_plane: bool = False, length: float = 2.0) -> CompressedRegion:
    sites, (along, _) = sheet(turn)
    members = np.flatnonzero(np.abs(sites.positions @ along) < length / 2.0)
    normal = np.array([0.0, 0.0, 1.0])
    return CompressedRegion(
        members, np.ones(len(members)), np.zeros(3), normal, along, length, 4.0, twin=on_plane, on_plane=on_plane
    )


@pytest.mark.parametrize("turn", [0.4, 2.0])
def test_a_segment_goes_as_far_as_the_surface_is_compressed(turn: float) -> None:
    sites, axes = sheet(turn)
    found = find_segment(sites, region(turn), [squeezed(turn, 0.9, 0.7)])
    assert found is not None
    ends = np.array(found) @ axes.T
    assert ends[:, 0] == pytest.approx([-0.9, 0.7], abs=0.15)
    assert ends[:, 1] == pytest.approx([0.0, 0.0], abs=0.05)


def test_a_segment_across_the_middle_is_its_own_mirror_image() -> None:
    sites, _ = sheet(0.0)
    found = find_segment(sites, region(0.0, on_plane=True), [squeezed(0.0, 0.3, 0.8)])
    assert found is not None
    (left, y, _), (right, other, _) = found
    assert left == pytest.approx(-right, abs=1e-9)
    assert (y, other) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert right == pytest.approx(0.8, abs=0.15)


@pytest.mark.parametrize("longest", [1.3, 1.6])
def test_a_segment_is_no_longer_than_asked_for(longest: float) -> None:
    sites, _ = sheet(0.0)
    found = find_segment(sites, region(0.0), [squeezed(0.0, 0.9, 0.9)], longest=longest)
    assert found is not None
    assert 0.7 * longest < np.linalg.norm(found[1] - found[0]) <= longest * (1.0 + 1e-9)


def test_a_pose_that_compresses_nothing_has_no_segment() -> None:
    sites, axes = sheet(0.0)
    rest = sites.gauge.rest.positions
    assert find_segment(sites, region(0.0), [rest]) is None
    stretched = rest + 0.5 * (rest @ axes[0])[:, None] * axes[0]
    assert find_segment(sites, region(0.0), [stretched]) is None


@pytest.mark.parametrize("scale", [0.01, 100.0])
def test_a_segment_does_not_depend_on_units(scale: float) -> None:
    sites, _ = sheet(0.4)
    found = np.array(find_segment(sites, region(0.4), [squeezed(0.4, 0.9, 0.7)]))
    scaled, _ = sheet(0.4, scale)
    wide = region(0.4)
    wide = replace(wide, centre=scale * wide.centre, length=scale * wide.length, width=scale * wide.width)
    again = np.array(find_segment(scaled, wide, [scale * squeezed(0.4, 0.9, 0.7)]))
    assert again == pytest.approx(scale * found, abs=1e-6 * scale)


def test_a_segment_lies_where_both_ends_face_as_it_does() -> None:
    """A line bent round an edge: its ends face alike up to the bend, and no longer where it lies round the corner."""
    steps = np.linspace(0.0, 2.0, 41)
    for turn, fits in ((10.0, True), (170.0, False)):
        angle = np.radians(turn) * (steps > 1.0)
        along = np.stack([np.cos(angle), -np.sin(angle), 0 * angle], axis=1)
        places = np.concatenate([[[0.0, 5.0, 0.0]], np.cumsum(along[1:], axis=0) * 0.05 + [0.0, 5.0, 0.0]])
        normals = np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
        line = np.stack([normals, places], axis=1)
        assert _fits(line, 0, 40, 2.0) == fits
        assert not _fits(line, 3, 3, 0.0)


def test_a_straight_walk_ends_at_the_border() -> None:
    sites, axes = sheet(0.4)
    triangles, positions = sites.gauge.triangles, sites.gauge.rest.positions
    step = 0.25
    lines = _walk(sites.gauge.rest, triangles, [2.0 * positions], np.zeros(3), np.stack([*axes, -axes[0]]), step)
    for line, way in zip(lines, [*axes, -axes[0]], strict=True):
        assert line[:, 0] == pytest.approx(np.tile([0.0, 0.0, 1.0], (9, 1)), abs=1e-9)
        assert line[:, 1] == pytest.approx(np.arange(9)[:, None] * step * way, abs=1e-6), "to the border, 2 away"
        assert line[:, 2] == pytest.approx(2.0 * line[:, 1])
