"""Few shapes and tables of weights for the heights of many poses."""

from functools import cache

import numpy as np
import pytest

from wrinklecli.drive.angle import JointAngle
from wrinklecli.effects.field.factors import Factors, factors_of, seen_of, weights_of
from wrinklecli.effects.field.turns import Sweeps, Turn
from wrinklecli.numeric.arrays import Floats

ANGLES = np.linspace(0.0, 1.6, 6)
AREAS = np.random.default_rng(5).uniform(0.5, 2.0, 60)
MOST = 24


def turn(node: int, angles: Floats) -> Turn:
    signal = JointAngle(node, -1, np.array([1.0, 0.0, 0.0]), np.array([0, 0, 0, 1.0]))
    return Turn(signal, angles, ((signal, 1.0),))


def sweeps(count: int, mixtures: int = 6) -> Sweeps:
    """Some joints swept one by one, then together; nothing needs their matrices."""
    turns = [turn(k, ANGLES) for k in range(count)]
    rows = [np.eye(count)[k] * angle for k in range(count) for angle in ANGLES[1:]]
    owners = np.repeat(np.arange(count), len(ANGLES) - 1).tolist() + [-1] * mixtures
    rows += list(np.random.default_rng(1).uniform(0.0, ANGLES[-1], (mixtures, count)))
    return Sweeps(tuple(turns), np.array(rows), np.array(owners), np.zeros((len(rows), 1, 4, 4)))


def bump(middle: float) -> Floats:
    return np.exp(-(((np.linspace(0.0, 1.0, 60) - middle) / 0.1) ** 2))


def early(angle: Floats) -> Floats:
    return np.sqrt(np.sin(0.6 * np.pi * angle / ANGLES[-1]))


def late(angle: Floats) -> Floats:
    return np.sqrt(angle / ANGLES[-1])


@cache
def of_two_turns() -> tuple[Sweeps, Floats, Factors]:
    """Two turns that raise a fold each, one most at five sixths of its bend, the other one at its end."""
    poses = sweeps(2)
    one, other = poses.angles.T
    heights = 0.03 * np.outer(early(one), bump(0.3)) + 0.02 * np.outer(late(other), bump(0.7))
    return poses, heights, factors_of(poses, heights, AREAS, MOST)


def fitted(poses: Sweeps, factors: Factors) -> Floats:
    return weights_of(poses, factors.tables) @ factors.shapes


def main_turns(factors: Factors) -> list[int]:
    """The turn that raises each shape most."""
    return np.argmax([table.max(axis=0) for table in factors.tables], axis=0).tolist()


def test_sweeps_of_a_shape_each_are_reproduced() -> None:
    poses, heights, factors = of_two_turns()
    assert {*main_turns(factors)} == {0, 1}
    # Where all turn together, tables are looked up between their steps.
    own = poses.owners >= 0
    assert np.abs(fitted(poses, factors) - heights)[own].max() < 0.04 * heights.max()
    assert factors.error < 0.05


def test_one_shape_is_the_nearest_to_what_changes_as_a_joint_bends() -> None:
    """It misses as much as the singular values that are left out."""
    poses = sweeps(1, mixtures=0)
    (angles,) = poses.angles.T
    heights = 0.02 * np.outer(np.minimum(angles, 0.5), bump(0.3)) + 0.03 * np.outer(angles**2, bump(0.5))
    factors = factors_of(poses, heights, AREAS, 1)
    assert main_turns(factors) == [0]
    values = np.linalg.svd(heights * np.sqrt(AREAS), compute_uv=False)
    assert factors.error == pytest.approx(np.linalg.norm(values[1:]) / np.linalg.norm(values), rel=0.1)


def test_a_crease_acts_from_half_of_the_bend_and_shapes_that_raise_most_have_one() -> None:
    poses, _, factors = of_two_turns()
    both = factors.creased(poses, MOST)
    assert both.creases.tolist() == [False, True] * 2
    assert not both.shapes[both.creases].any()
    for turn, table in zip(poses.turns, both.tables, strict=True):
        for whole, late in zip(table.T[::2], table.T[1::2], strict=True):
            assert (late[turn.angles <= turn.angles[-1] / 2.0] <= 0.0).all()
            assert (late <= whole).all()
            assert late[-1] == whole[-1]
    # So none takes back more than is there.
    weights = weights_of(poses, both.tables)
    assert (weights[:, 1::2] <= weights[:, ::2] + 1e-12).all()
    first = int(np.argmax(np.diag(factors.products)))
    assert factors.creased(poses, 3).creases.tolist() == [[False, True, False], [False, False, True]][first]
    assert factors.creased(poses, 2).creases.tolist() == [False, False]


def test_a_turn_has_other_shapes_one_way_than_the_other() -> None:
    angles = np.linspace(-1.6, 1.6, 11)
    at = angles[angles != 0.0]
    poses = Sweeps((turn(0, angles),), at[:, None], np.zeros(len(at), np.intp), np.zeros((len(at), 1, 4, 4)))
    down, up = np.sqrt(np.maximum(-at, 0.0)), np.sqrt(np.maximum(at, 0.0))
    heights = 0.02 * np.outer(down, bump(0.2)) + 0.02 * np.outer(up, bump(0.8))
    found = factors_of(poses, heights, AREAS, MOST)
    assert np.abs(fitted(poses, found) - heights).max() < 0.01 * heights.max()
    (table,) = found.tables
    assert (table[angles < 0.0].max(axis=0) * table[angles > 0.0].max(axis=0) < 0.01).all()


def test_weights_are_from_0_to_1_and_0_at_rest() -> None:
    poses, _, factors = of_two_turns()
    for table in factors.tables:
        assert table.shape == (len(ANGLES), len(factors.shapes))
        assert not table[0].any()
    weights = weights_of(poses, factors.tables)
    assert weights.min() >= 0.0
    assert weights.max(axis=0) == pytest.approx(1.0)


def test_shapes_are_not_negative() -> None:
    assert (of_two_turns()[2].shapes >= 0).all()


def saturated(count: int, **options: int) -> tuple[Sweeps, Floats]:
    """Joints that raise one fold between them: heights go with the root of what they compress together."""
    poses = sweeps(count, **options)
    return poses, 0.02 * np.outer(np.sqrt(poses.angles.sum(axis=1)), bump(0.5))


def test_no_weights_are_better_than_the_best() -> None:
    for poses, heights in (of_two_turns()[:2], saturated(3)):
        factors = factors_of(poses, heights, AREAS, MOST)
        assert 0.0 <= factors.best <= factors.error + 1e-9


def test_the_error_is_that_of_the_heights() -> None:
    poses, heights = saturated(2)
    factors = factors_of(poses, heights, AREAS, MOST)
    seen = weights_of(poses, factors.tables) @ seen_of(factors.shapes)
    gaps = (seen - heights) * np.sqrt(AREAS)
    assert factors.error == pytest.approx(np.linalg.norm(gaps) / np.linalg.norm(heights * np.sqrt(AREAS)), rel=1e-6)
    assert factors.error > 0.01


def test_lost_lengths_of_turns_add_up() -> None:
    """Heights go with the root of their sum."""
    poses, heights = saturated(3, mixtures=12)
    factors = factors_of(poses, heights, AREAS, MOST)
    assert factors.error < 0.05


def test_what_one_turn_stretches_another_one_folds_less() -> None:
    """The second turn folds by itself the other way, so it is known to act there."""
    angles = np.linspace(-1.6, 1.6, 9)
    mixed = np.random.default_rng(3).uniform(-1.6, 1.6, (24, 2))
    at = np.concatenate(
        [np.outer(angles[angles != 0.0], [1.0, 0.0]), np.outer(angles[angles != 0.0], [0.0, 1.0]), mixed]
    )
    owners = np.repeat([0, 1, -1], [8, 8, 24])
    poses = Sweeps((turn(0, angles), turn(1, angles)), at, owners, np.zeros((len(at), 1, 4, 4)))
    heights = 0.02 * np.outer(np.sqrt(np.maximum(at[:, 0] - at[:, 1], 0.0)), bump(0.5))
    factors = factors_of(poses, heights, AREAS, MOST)
    assert factors.error < 0.1
    first, second = (table[:, 0] for table in factors.tables)
    assert (first[angles > 0.0] > 0.0).all()
    assert (second[angles > 0.4] < 0.0).all()


def test_a_turn_that_folds_nothing_has_no_shape() -> None:
    poses, heights = saturated(1)
    idle = sweeps(3)
    raised = 0.02 * np.outer(np.sqrt(idle.angles[:, 1]), bump(0.5))
    found = factors_of(idle, raised, AREAS, MOST)
    assert main_turns(found) == [1]
    assert not len(factors_of(poses, 0.0 * heights, AREAS, MOST).shapes)


@pytest.mark.parametrize("most", [1, 2, 3, 5])
def test_there_are_at_most_as_many_shapes_as_are_asked_for(most: int) -> None:
    """The turns that raise the most come first."""
    poses = sweeps(4)
    heights = sum(0.01 * (k + 1) * np.outer(early(poses.angles[:, k]), bump(0.2 * k + 0.1)) for k in range(4))
    factors = factors_of(poses, np.asarray(heights), AREAS, most)
    assert 1 <= len(factors.shapes) <= most
    assert set(main_turns(factors)) <= set(range(4)[-most:])


@pytest.mark.parametrize("most", [1, 2, 3, 5])
def test_fewer_shapes_are_those_of_the_turns_that_raise_most(most: int) -> None:
    poses = sweeps(4)
    heights = sum(0.01 * (k + 1) * np.outer(early(poses.angles[:, k]), bump(0.2 * k + 0.1)) for k in range(4))
    whole = factors_of(poses, np.asarray(heights), AREAS, MOST)
    assert sorted(main_turns(whole)) == [0, 1, 2, 3]
    fewer, kept = whole.fewer(poses, most)
    assert len(kept) == min(most, 4)
    assert sorted(main_turns(fewer)) == list(range(4)[-most:])
    assert (fewer.shapes == whole.shapes[kept]).all()
    # Its error is that of the heights, as far as those of fewer shapes are off those of all.
    seen = weights_of(poses, fewer.tables) @ seen_of(fewer.shapes)
    gaps = (seen - np.asarray(heights)) * np.sqrt(AREAS)
    assert fewer.error == pytest.approx(np.linalg.norm(gaps) / np.linalg.norm(heights * np.sqrt(AREAS)), rel=0.3)


def test_creases_are_left_out_before_any_shape_that_folds() -> None:
    poses = sweeps(3)
    heights = sum(0.01 * (k + 1) * np.outer(early(poses.angles[:, k]), bump(0.2 * k + 0.1)) for k in range(3))
    both = factors_of(poses, np.asarray(heights), AREAS, MOST).creased(poses, MOST)
    assert both.creases.tolist() == [False, True] * 3
    for most in (3, 4, 5):
        fewer, kept = both.fewer(poses, most)
        assert np.count_nonzero(fewer.creases) == most - 3
        assert (fewer.creases == both.creases[kept]).all()
        assert not fewer.left_out


def test_low_heights_are_not_seen_and_tall_ones_hardly_less() -> None:
    heights = np.linspace(0.0, 2.0, 201)
    seen = seen_of(heights)
    assert not seen[heights <= 0.1].any()
    assert (np.diff(seen) >= 0.0).all()
    # It ends without a step.
    assert np.diff(seen).max() < 2.1 * np.diff(heights).max()
    assert (seen >= 0.9 * heights)[heights > 0.33].all()


@pytest.mark.parametrize("unit", [1e-21, 1e-7, 1e9])
def test_units_do_not_matter(unit: float) -> None:
    poses, heights, factors = of_two_turns()
    other = factors_of(poses, unit * heights, AREAS, MOST)
    assert other.shapes / unit == pytest.approx(factors.shapes, rel=1e-3, abs=1e-6)
    assert np.stack(other.tables) == pytest.approx(np.stack(factors.tables), abs=1e-4)
