"""Paths: a smooth curve through anchors, u along it and v across it, fanning out where it bends; straight ones too."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.asset import plate
from kit.carried import carry_patch
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import prepare
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.surface.path import Curve, Foot, path_through

# On a cylinder of radius 1 along x: how far a path goes on along it and round it from point to point.
STEPS = st.lists(st.tuples(st.floats(0.2, 0.6), st.floats(-0.35, 0.35)), min_size=2, max_size=6)


def on_cylinder(steps: Any) -> tuple[Floats, Floats]:
    """(points, 3) on the cylinder, and its normals there."""
    x, angle = np.cumsum([(0.0, 0.0), *steps], axis=0).T
    normals = np.stack([0.0 * x, np.cos(angle), np.sin(angle)], axis=1)
    return normals + x[:, None] * [1.0, 0.0, 0.0], normals


def on_axis(point: Floats) -> tuple[Floats, Floats]:
    """The nearest point of the cylinder, and its normal."""
    normal = unit(point * [0.0, 1.0, 1.0])
    return normal + point * [1.0, 0.0, 0.0], normal


def on_plane(point: Floats) -> tuple[Floats, Floats]:
    return point, np.array([0.0, 0.0, 1.0])


def curve_through(points: Floats, normals: Floats, foot: Foot = on_axis) -> Curve:
    names = [f"path[{k}]" for k in range(len(points))]
    made = path_through(list(points), list(normals), foot, names=names, where="tools[0]")
    assert isinstance(made, Curve)
    return made


@given(STEPS)
def test_a_curve_goes_through_its_points_and_u_rises_along_it(steps: Any) -> None:
    points, normals = on_cylinder(steps)
    made = curve_through(points, normals)
    found = made.locate(points)
    assert np.abs(found.across).max() < 1e-9
    assert (np.diff(found.u) > 0).all()
    assert found.u[[0, -1]] == pytest.approx([0, 1], abs=1e-12)
    between = 0.3 * made.points[1:] + 0.7 * made.points[:-1]
    every = made.locate(between)
    assert (np.diff(every.u) > 0).all()
    assert np.abs(every.across).max() < 1e-5
    assert made.cosines(found.u, normals) == pytest.approx(np.ones(len(points)), abs=0.08)
    assert len(made.locate(np.zeros((0, 3))).u) == 0


@given(STEPS, st.floats(-0.2, 0.2), st.floats(0.0, 1.0))
def test_a_place_belongs_to_the_nearest_point_of_the_curve(steps: Any, across: float, share: float) -> None:
    made = curve_through(*on_cylinder(steps))
    number = int(share * (len(made.points) - 1))
    sideways = np.cross(made.tangents[number], made.normals[number])
    found = made.locate(made.points[number] + across * sideways)
    assert float(found.u) == pytest.approx(made.arc_lengths[number] / made.length, abs=1e-9)
    assert float(found.across) == pytest.approx(across, abs=1e-9)


@pytest.mark.quick(1)
@pytest.mark.parametrize("angles", [[0, 50, 80, 130], [0, 90, 180, 200, 180, 150]], ids=["arc", "hairpin"])
def test_the_map_is_continuous_wherever_a_wrinkle_shows(angles: list[float]) -> None:
    # Steps of one length in these directions.
    points = np.cumsum([0.25 * np.array([np.cos(turn), np.sin(turn), 0.0]) for turn in np.radians(angles)], axis=0)
    made = curve_through(points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), on_plane)
    low, high = points.min(axis=0) - 0.4, points.max(axis=0) + 0.4
    grid = np.stack(
        [*(each.ravel() for each in np.meshgrid(*np.linspace(low, high, 161).T[:2])), np.zeros(161**2)], axis=1
    )
    step = 1e-4
    for axis in np.eye(3)[:2]:
        here, there = made.locate(grid), made.locate(grid + step * axis)
        assert here.stretches is not None
        assert there.stretches is not None
        inside = np.any([(each.u > 0) & (each.u < 1) for each in (here, there)], axis=0)
        shown = inside & (np.minimum(here.stretches, there.stretches) > 0.2)
        assert shown.mean() > 0.1
        assert np.abs(there.u - here.u)[shown].max() * made.length < 5.5 * step


@given(STEPS, st.sampled_from([0, 1, 2]))
def test_a_mirrored_path_is_the_mirror_image(steps: Any, axis: int) -> None:
    points, normals = on_cylinder(steps)
    mirror = np.where(np.arange(3) == axis, -1.0, 1.0)
    places = np.random.default_rng(1).normal(0, 0.1, (20, 3)) + points[:1] + [0.5, 0, 0]
    here = curve_through(points, normals).locate(places)
    there = curve_through(points * mirror, normals * mirror).locate(places * mirror)
    assert there.u == pytest.approx(here.u, abs=1e-9)
    assert there.across == pytest.approx(-here.across, abs=1e-9)
    assert there.stretches == pytest.approx(here.stretches, abs=1e-9)


def test_points_on_a_circle_give_the_circle_and_wrinkles_fan_out_from_its_middle() -> None:
    angles = np.radians([0.0, 50.0, 80.0, 130.0])
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    made = curve_through(points, np.tile([0.0, 0.0, 1.0], (4, 1)), on_plane)
    assert np.linalg.norm(made.points, axis=1) == pytest.approx(np.ones(len(made.points)), abs=1e-12)
    spread = np.radians(np.linspace(1.0, 129.0, 33))
    for radius in (0.5, 0.9, 1.3):
        places = radius * np.stack([np.cos(spread), np.sin(spread), 0 * spread], axis=1)
        found = made.locate(places)
        assert found.u == pytest.approx(spread / angles[-1], abs=1e-3)
        assert found.across == pytest.approx(np.full(33, radius - 1.0), abs=1e-3)
        assert found.stretches == pytest.approx(np.full(33, radius), abs=1e-2)


def test_far_from_the_origin_a_path_is_the_same() -> None:
    points, normals = on_cylinder([(0.3, 0.2), (0.3, -0.2), (0.4, 0.1)])
    places = points[:1] + np.random.default_rng(2).normal(0.3, 0.1, (20, 3))
    here = curve_through(points, normals, lambda point: (point, normals[0])).locate(places)
    there = curve_through(points + 1e5, normals, lambda point: (point, normals[0])).locate(places + 1e5)
    assert there.u == pytest.approx(here.u, abs=1e-7)
    assert there.across == pytest.approx(here.across, abs=1e-7)
    assert there.stretches == pytest.approx(here.stretches, abs=1e-5)


def test_a_path_in_line_lies_as_its_segment_does() -> None:
    ends = {"origin": [-0.4, RADIUS, 0.0], "target": [0.4, RADIUS, 0.0]}
    asset = limb_asset(rings=21, sides=16)
    segment = prepare(asset, tool(**ends)).patch
    two = prepare(asset, across(ends["origin"], ends["target"]))
    line = prepare(asset, across(ends["origin"], [0.1, RADIUS, 0.0], ends["target"])).patch
    places = two.rest.positions
    for one, same, other in zip(*(each.coordinates(places) for each in (segment, two.patch, line)), strict=True):
        assert one.tobytes() == same.tobytes()
        assert other == pytest.approx(one, abs=1e-6)
    assert line.members.tolist() == two.patch.members.tolist() == segment.members.tolist()
    assert line.span == pytest.approx(segment.span)


def across(*points: list[float], **keys: Any) -> dict[str, Any]:
    """A tool of the limb with a path."""
    return {"name": "fold", "path": list(points), "width": 0.3, **keys}


def test_the_tool_of_the_other_side_has_the_mirrored_patch() -> None:
    points = [[-0.4, 0.2, 0.15], [-0.1, RADIUS, 0.05], [0.1, 0.24, 0.08], [0.4, 0.1, 0.22]]
    prepared = prepare(limb_asset(rings=41, sides=32), {**across(*points, mirror="z"), "name": "fold.L"})
    left, right = prepared.patches
    places = prepared.rest.positions
    here, there = left.coordinates(places), right.coordinates(places * [1.0, 1.0, -1.0])
    near = np.abs(here[1]) < 1.0
    assert near.sum() > 50
    assert there[0][near] == pytest.approx(here[0][near], abs=1e-3)
    assert there[1][near] == pytest.approx(-here[1][near], abs=1e-2)


def test_a_path_that_no_file_gives_is_refused_in_a_line() -> None:
    """As one that `suggest` tries."""
    made = prepare(limb_asset(rings=9, sides=8))
    drafted = replace(made.patch.tool, between=((0.0, 3.0, 0.0),), places={})
    with pytest.raises(BakeError, match="more than a quarter of its segment"):
        attach_tools([drafted], made.surface, made.rest, made.rig, up="y")


def test_shortening_is_of_the_summed_distances() -> None:
    points = [[-0.4, -RADIUS, 0.0], [0.0, -RADIUS, 0.0], [0.2, -RADIUS, 0.0], [0.4, -RADIUS, 0.0]]
    prepared = prepare(limb_asset(rings=21, sides=16), across(*points))
    times = np.linspace(0.0, 1.0, 5)

    def lengths(*ends: list[float]) -> Floats:
        made = prepare(limb_asset(rings=21, sides=16), across(*ends)).patch
        return made.segment.lengths(prepared.rig, prepared.clip, times).distances

    whole = prepared.patch.segment.lengths(prepared.rig, prepared.clip, times).distances
    assert whole == pytest.approx(sum(lengths(a, b) for a, b in pairwise(points)), abs=1e-9)
    assert (whole > lengths(points[0], points[-1]) - 1e-12).all()


def test_a_path_goes_round_a_joint_where_a_chord_finds_nothing_that_faces_it() -> None:
    # Half round the limb: its ends face opposite ways.
    angles = np.linspace(0.0, np.pi, 5)
    points = np.stack([0.2 * np.cos(angles), RADIUS * np.cos(angles), RADIUS * np.sin(angles)], axis=1).tolist()
    asset = limb_asset(rings=41, sides=24)
    with pytest.raises(BakeError, match=r"the surface faces opposite ways at origin and target"):
        prepare(asset, across(points[0], points[-1]))
    prepared = prepare(asset, across(*points))
    carried, fine = carry_patch(prepared)
    facing = np.sum(fine.rest_normals[carried.vertices] * unit(carried.directions), axis=1)
    assert facing.min() > 0.99
    # All the way from top to bottom.
    assert np.ptp(fine.rest_positions[carried.vertices, 1]) > 1.9 * RADIUS
    assert np.histogram(carried.us, 8, (0, 1))[0].min() > 10


def test_wrinkles_end_before_they_would_meet_on_the_inside_of_a_bend() -> None:
    angles = np.radians([0.0, 45.0, 90.0])
    x, z = 0.2 * np.cos(angles), 0.2 * np.sin(angles)
    grid = np.linspace(-0.5, 0.5, 21)
    places = np.array([(a, 0.0, b) for a in grid for b in grid])
    corners = (np.arange(20)[:, None] * 21 + np.arange(20)).reshape(-1, 1)
    faces = (corners + np.array([0, 1, 21, 1, 22, 21])).reshape(-1, 3)
    made = prepare(plate(places, faces), across(*np.stack([x, 0 * x, z], axis=1).tolist(), width=0.6))
    carried, fine = carry_patch(made)
    assert np.linalg.norm(fine.rest_positions[carried.vertices], axis=1).min() > 0.02
    u, v = made.patch.coordinates(np.array([[r, 0.0, r] for r in (0.15, 0.04, 0.01)]))
    assert u == pytest.approx([0.5, 0.5, 0.5], abs=0.02)
    assert np.abs(v[0]) == pytest.approx((0.15 * np.sqrt(2) - 0.2) / 0.3, abs=1e-3)
    assert 0.5 < np.abs(v[1]) < 1.0 < np.abs(v[2])


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (
            [[-0.4, RADIUS, 0], [0.4, RADIUS, 0], [-0.4, RADIUS, 0.05]],
            r"turns by 17\d° at path\[1\], but at most 120° is possible",
        ),
        (
            [[-0.4, RADIUS, 0], [0.0, 2.0, 0], [0.4, RADIUS, 0]],
            r"path\[1\]: is 1\.75 from the mesh, more than a quarter",
        ),
        ([[-0.4, RADIUS, 0], [0.0, RADIUS, 0], [0.0, -RADIUS, 0]], r"faces opposite ways at path\[1\] and path\[2\]"),
        (
            [[-0.4, RADIUS, 0], {"marker": "joint_9"}, [0.4, RADIUS, 0]],
            r"path\[1\]\.marker: no node is named 'joint_9'",
        ),
    ],
)
def test_faults_name_the_point(points: list[Any], message: str) -> None:
    with pytest.raises(BakeError, match=message):
        prepare(limb_asset(rings=9, sides=8), across(*points, width=0.1))
