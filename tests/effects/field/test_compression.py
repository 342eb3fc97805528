"""A surface becomes shorter in a pose, by so much and in such a direction."""

import numpy as np
import pytest

from kit.bent_tube import tube
from kit.garments import plane
from wrinklecli.effects.field.compression import (
    Gauges,
    along,
    posed_rigidly,
    rigid_parts,
    shortest,
)
from wrinklecli.numeric.arrays import Floats, face_normals, unit
from wrinklecli.surface.strain import product, solid, tangents

NORMALS = np.array([[0.0, 0.0, 1.0]])


def turned(axis: list[float], degrees: float, around: list[float] | None = None) -> Floats:
    """(4, 4) a turn about an axis through a place."""
    x, y, z = unit(np.array(axis))
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    angle = np.radians(degrees)
    found = np.eye(4)
    found[:3, :3] += np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    middle = np.zeros(3) if around is None else np.array(around)
    found[:3, 3] = middle - found[:3, :3] @ middle
    return found


def strains_of(stretch: Floats) -> Floats:
    """The strain of a plane that (3, 3) `stretch` maps; it is the same for all triangles."""
    positions, triangles = plane(1.0, 0.5, 6)
    found = Gauges.of(positions, triangles).strains(positions @ stretch.T)
    assert np.ptp(found, axis=0).max() < 1e-12
    return found[0]


@pytest.mark.parametrize("degrees", [0.0, 20.0, 73.0, 145.0])
@pytest.mark.parametrize(("one", "other"), [(0.5, 1.0), (2.0, 1.0), (0.7, 1.3), (0.9, 0.6)])
def test_the_strain_of_a_known_stretch(degrees: float, one: float, other: float) -> None:
    """Along two axes at right angles in the plane, then turned anyhow in space."""
    frame = turned([0.0, 0.0, 1.0], degrees)[:3, :3]
    stretch = frame @ np.diag([one, other, 1.0]) @ frame.T
    expected = (one - 1.0) * product(frame[:, 0], frame[:, 0]) + (other - 1.0) * product(frame[:, 1], frame[:, 1])
    found = strains_of(turned([1.0, 2.0, 3.0], 50.0)[:3, :3] @ stretch)
    assert found == pytest.approx(expected, abs=1e-12)
    least, direction, most = shortest(found[None], tangents(NORMALS))
    assert (least[0], most[0]) == pytest.approx((min(one, other) - 1.0, max(one, other) - 1.0), abs=1e-12)
    assert abs(direction[0] @ frame[:, int(other < one)]) == pytest.approx(1.0, abs=1e-9)


def test_the_mean_strain_is_the_length_that_is_lost() -> None:
    """A row of triangles that are shortened unevenly, some beyond all of their length, loses what their strains say."""
    positions, triangles = plane(1.0, 0.5, 6)
    outward = np.tile([0.0, 0.0, 1.0], (len(positions), 1))
    places = np.unique(positions[:, 0])
    moved = positions.copy()
    moved[:, 0] = np.interp(positions[:, 0], places, np.array([0.0, 0.1, 0.15, 0.05, 0.1, 0.2, 0.4])[: len(places)])
    strains = Gauges.of(positions, triangles).strains(moved, outward)
    areas = np.linalg.norm(face_normals(positions, triangles), axis=1) / 2.0
    assert np.average(strains[:, 0], weights=areas) == pytest.approx(np.ptp(moved[:, 0][[0, -1]]) - 1.0)
    assert strains[:, 0].min() < -1.0


def test_a_rigid_motion_strains_nothing() -> None:
    positions, triangles = tube(0.3)
    motion = turned([1.0, -2.0, 0.5], 130.0, around=[3.0, 1.0, 2.0])
    moved = positions @ motion[:3, :3].T + motion[:3, 3]
    assert np.abs(Gauges.of(positions, triangles).strains(moved)).max() < 1e-9


def test_triangles_that_collapse_have_a_strain_that_is_bounded() -> None:
    positions, triangles = plane(1.0, 0.5, 4)
    found = Gauges.of(positions, triangles).strains(0.0 * positions)
    assert np.isfinite(found).all()
    assert np.abs(found).max() <= 1.0


def test_a_tensor_along_vectors_is_a_product() -> None:
    rng = np.random.default_rng(0)
    vectors, one, other = rng.normal(size=(3, 7, 3))
    expected = np.sum(vectors * one, axis=1) * np.sum(vectors * other, axis=1)
    assert along(product(vectors, vectors), one, other) == pytest.approx(expected)


def skinned(positions: Floats, motion: Floats) -> tuple[Floats, Floats]:
    """A tube along x, whose one end stays and whose other is moved: by dual quaternions, and by linear blending."""
    share = np.clip((positions[:, 0] - positions[:, 0].min()) / np.ptp(positions[:, 0]), 0.0, 1.0)
    joints, weights = np.tile([0, 1], (len(positions), 1)), np.stack([1.0 - share, share], axis=1)
    matrices = np.stack([np.eye(4), motion])
    blended = np.einsum("vk,kij->vij", weights, matrices)[:, :3]
    linear = np.einsum("vij,vj->vi", blended[:, :, :3], positions) + blended[:, :, 3]
    return posed_rigidly(positions, joints, weights, rigid_parts(matrices, np.stack([np.eye(4)] * 2))), linear


@pytest.mark.parametrize("degrees", [90.0, -150.0])
def test_a_tube_that_is_twisted_keeps_its_girth(degrees: float) -> None:
    positions, _ = tube(0.3)
    rigid, linear = (np.hypot(each[:, 1], each[:, 2]) for each in skinned(positions, turned([1.0, 0.0, 0.0], degrees)))
    assert rigid == pytest.approx(0.3, abs=1e-12)
    assert linear.min() < 0.75 * 0.3


def test_a_blend_goes_the_short_way_round() -> None:
    """Halfway between turns by 170° and by 200° is 185°, though their quaternions point away from each other."""
    positions, _ = tube(0.3)
    matrices = np.stack([turned([1.0, 0.0, 0.0], degrees) for degrees in (170.0, 200.0)])
    joints, weights = np.tile([0, 1], (len(positions), 1)), np.full((len(positions), 2), 0.5)
    weights[:, 0] += 1e-3  # one of them is the heaviest
    found = posed_rigidly(positions, joints, weights, rigid_parts(matrices, np.stack([np.eye(4)] * 2)))
    assert found == pytest.approx(positions @ turned([1.0, 0.0, 0.0], 185.0)[:3, :3].T, abs=1e-3)


@pytest.mark.parametrize("degrees", [10.0, 110.0, 181.0, 350.0])
def test_one_joint_moves_as_it_is(degrees: float) -> None:
    positions, _ = tube(0.3)
    rest = turned([0.0, 1.0, 0.0], 40.0, around=[1.0, 0.0, 2.0])
    motion = turned([1.0, -2.0, 0.5], degrees, around=[3.0, 1.0, 2.0])
    parts = rigid_parts((motion @ rest)[None], np.linalg.inv(rest)[None])
    ones = np.ones((len(positions), 1))
    found = posed_rigidly(positions, np.zeros_like(ones, dtype=int), ones, parts)
    assert found == pytest.approx(positions @ motion[:3, :3].T + motion[:3, 3], abs=1e-9)


def test_scale_and_shear_of_a_joint_are_left_out() -> None:
    motion = turned([0.0, 1.0, 1.0], 70.0)
    scaled = motion @ np.diag([2.0, 2.0, 2.0, 1.0])
    rest = np.eye(4)[None]
    for one, other in zip(rigid_parts(motion[None], rest), rigid_parts(scaled[None], rest), strict=True):
        assert one == pytest.approx(other, abs=1e-9)


def test_a_joint_that_is_scaled_to_nothing_has_numbers() -> None:
    for found in rigid_parts(np.diag([0.0, 0.0, 0.0, 1.0])[None], np.eye(4)[None]):
        assert np.isfinite(found).all()


def test_triangles_without_area_are_not_solid() -> None:
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [1, 0, 0]])
    triangles = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 0, 1], [2, 2, 2]])
    assert solid(positions, triangles, face_normals(positions, triangles)).tolist() == [
        True,
        False,
        False,
        False,
        False,
    ]
    small = 1e-6 * positions
    assert solid(small, triangles, face_normals(small, triangles)).tolist() == [True, False, False, False, False]
