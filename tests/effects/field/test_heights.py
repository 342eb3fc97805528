"""Heights that keep the length of a surface, where it is compressed and nowhere else."""

from functools import cache

import numpy as np
import pytest

from kit.garments import across, bent_tube, plane, tallest
from kit.limb import RADIUS
from wrinklecli.character.pose import blend, transform
from wrinklecli.effects.field.compression import Gauges, along
from wrinklecli.effects.field.heights import (
    BEYOND,
    Heights,
    _room,
    _slipped,
    _stiffness_along,
    _Surface,
    averages_over,
    measure,
)
from wrinklecli.effects.field.irregular import Irregular
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.laplacian import Sheet
from wrinklecli.surface.rest import Rest

LENGTH, WIDTH, WAVE = 2.0, 1.0, 0.2
SLACK = 0.04
SQUEEZES = (0.25, 0.4, 0.6)


def at_rest(positions: Floats, triangles: Ints, joints: int) -> Rest:
    count = len(positions)
    return Rest(
        None,
        np.zeros(1),
        np.tile(np.eye(4), (joints, 1, 1)),
        np.zeros(0),
        positions,
        np.tile(np.eye(4)[:3], (count, 1, 1)),
        positions,
        triangles,
    )


def measured(
    positions: Floats, triangles: Ints, weights: Floats, matrices: Floats, *, radius: float = WAVE, slack: float = 0.0
) -> Heights:
    """Heights of a sheet that lies on limbs as thick as said, in poses of as many joints as it has weights."""
    sheet, joints = Sheet.of(positions, triangles), weights.shape[1]
    return measure(
        sheet,
        at_rest(positions, triangles, joints),
        np.tile(np.arange(joints), (len(positions), 1)),
        weights,
        matrices,
        averages_over(sheet, WAVE),
        wavelength=WAVE,
        wavelengths=np.full(len(positions), WAVE),
        radii=np.full(len(positions), radius),
        slack=slack,
        allowed=np.ones(len(positions)),
    )


@cache
def squeezed(one: float, other: float = 0.0, slack: float = 0.0) -> tuple[Floats, Heights]:
    """A sheet that is shortened by parts of its length and of its width, as four joints at its corners move."""
    positions, triangles = plane(LENGTH, WIDTH, 20)
    u, v = positions[:, 0] / LENGTH, positions[:, 1] / WIDTH
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=1)
    matrices = np.tile(np.eye(4), (4, 1, 1))
    matrices[[1, 3], 0, 3] = -one * LENGTH
    matrices[[2, 3], 1, 3] = -other * WIDTH
    moved = transform(blend(weights, matrices[None]), positions)[0]
    assert np.ptp(moved[:, 0]) == pytest.approx((1 - one) * LENGTH)
    found = measured(positions, triangles, weights, matrices[None], slack=slack)
    return positions, found


def length_of_wave(half_height: float, wavelength: float) -> float:
    phases = np.linspace(0.0, 2.0 * np.pi, 2000)
    x, y = wavelength * phases / (2.0 * np.pi), half_height * np.cos(phases)
    return float(np.hypot(np.diff(x), np.diff(y)).sum())


@pytest.mark.parametrize("lost", [0.05, 0.12, 0.25])
def test_a_strip_that_is_shortened_keeps_its_length_in_waves(lost: float) -> None:
    _, found = squeezed(lost)
    half_height = float(np.median(found.heights[0]))
    assert half_height == pytest.approx(WAVE / np.pi * np.sqrt(lost * (1.0 - lost)), rel=0.02)
    # The formula is right to second order.
    assert length_of_wave(half_height, (1.0 - lost) * WAVE) == pytest.approx(WAVE, rel=0.05)


@pytest.mark.slow
def test_slack_is_lost_before_a_fold_rises_and_taken_up_by_it() -> None:
    """Cloth that has buckled keeps its length, so beyond three slacks folds are as high as without any."""
    rising = [float(np.median(squeezed(lost, slack=SLACK)[1].heights)) for lost in (0.05, 0.07, 0.09, 0.11)]
    whole = [float(np.median(squeezed(lost)[1].heights)) for lost in (0.05, 0.07, 0.09, 0.11)]
    assert 0.0 < rising[0] < 0.25 * whole[0]
    assert np.all(np.diff(rising) > np.diff(whole))
    for lost in (0.125, 0.2, 0.3):
        assert squeezed(lost, slack=SLACK)[1].heights == pytest.approx(squeezed(lost)[1].heights, rel=1e-3)


def test_cloth_slips_from_where_it_has_no_room_and_keeps_its_length() -> None:
    positions, triangles = plane(LENGTH, WIDTH, 20)
    sheet = Sheet.of(positions, triangles)
    crease = np.abs(positions[:, 0] - LENGTH / 2.0) < WAVE / 3.0
    beside = ~crease & (np.abs(positions[:, 0] - LENGTH / 2.0) < WAVE)
    lost = np.where(crease, 0.3, 0.0)[None]
    room = np.where(crease, 0.0, 1.0)[None]
    kept, loose = (_slipped(lost, each, sheet.averaging(BEYOND * WAVE), 0.0) for each in (room, np.ones_like(room)))
    assert not kept[0, crease].any()
    assert kept[0, beside].min() > 0.0
    assert np.sum(kept * sheet.areas) == pytest.approx(np.sum(lost * sheet.areas), rel=0.02)
    # Where it has room it slips, too, as it lies loose, but most of it stays.
    assert np.sum(loose * sheet.areas) == pytest.approx(np.sum(lost * sheet.areas), rel=0.02)
    assert loose[0, crease].min() > loose[0, ~crease].max()


def test_cloth_slips_along_its_compression_alone() -> None:
    """Beside the end of a crease nothing heaps up."""
    positions, triangles = plane(LENGTH, WIDTH, 20)
    sheet = Sheet.of(positions, triangles)
    along = sheet.averaging(BEYOND * WAVE, _stiffness_along(sheet, np.tile([1.0, 0.0, 0.0], (len(positions), 1))))
    u, v = positions[:, 0] - LENGTH / 2.0, positions[:, 1] - WIDTH / 2.0
    crease = (np.abs(u) < WAVE / 3.0) & (v < 0.0)
    kept = _slipped(np.where(crease, 0.3, 0.0)[None], np.where(crease, 0.0, 1.0)[None], along, SLACK)[0]
    beside = ~crease & (np.abs(u) < WAVE)
    assert kept[beside & (v < -0.1)].min() > 0.02
    assert kept[beside & (v > 0.1)].max() < 0.001


@pytest.mark.parametrize("radius", [0.1, 0.2])
def test_what_is_lost_fades_over_the_radius_of_the_limb(radius: float) -> None:
    """A sheet is shortened at its middle alone."""
    positions, triangles = plane(LENGTH, WIDTH, 40)
    u = positions[:, 0] - LENGTH / 2.0
    share = np.clip(u / WAVE + 0.5, 0.0, 1.0)
    matrices = np.tile(np.eye(4), (1, 2, 1, 1))
    matrices[:, 1, 0, 3] = -0.05
    found = measured(positions, triangles, np.stack([1.0 - share, share], axis=1), matrices, radius=radius)
    # The square of a height goes with what is lost.
    near, far = (found.heights[0, np.abs(u + at) < 0.02].mean() ** 2 for at in (0.4, 0.4 + radius))
    assert near / far == pytest.approx(np.e, rel=0.15)


def test_heights_go_on_along_crests_and_are_no_lower_for_it() -> None:
    """Half of a sheet is shortened, across crests that run on to the other half."""
    positions, triangles = plane(LENGTH, WIDTH, 20)
    u, v = positions[:, 0] / LENGTH, positions[:, 1] / WIDTH
    weights = np.stack([1 - u * (v < 0.5), u * (v < 0.5)], axis=1)
    matrices = np.tile(np.eye(4), (1, 2, 1, 1))
    matrices[:, 1, 0, 3] = -0.2 * LENGTH
    found = measured(positions, triangles, weights, matrices).heights[0]
    middle = np.abs(u - 0.5) < 0.1
    assert np.median(found[middle & (v < 0.2)]) == pytest.approx(WAVE / np.pi * np.sqrt(0.2 * 0.8), rel=0.05)
    assert found[middle & (np.abs(v - 0.7) < 0.03)].min() > 0.01 * WAVE


def test_nothing_is_drawn_out_to_where_the_surface_is_taut() -> None:
    """One half of a sheet is shortened across the crests that run on to the other, which is stretched."""
    positions, triangles = plane(LENGTH, WIDTH, 20)
    u, v = positions[:, 0] / LENGTH, positions[:, 1] / WIDTH
    right = np.clip((v - 0.45) / 0.1, 0.0, 1.0)
    weights = np.stack([1 - u, u * (1 - right), u * right], axis=1)
    matrices = np.tile(np.eye(4), (2, 3, 1, 1))
    matrices[:, 1, 0, 3] = -0.3 * LENGTH
    matrices[:, 2, 0, 3] = np.array([0.0, 0.2]) * LENGTH
    found = measured(positions, triangles, weights, matrices, slack=SLACK)
    level, taut = found.heights
    near = (v > 0.68) & (v < 0.8) & (u > 0.3) & (u < 0.7)
    assert level[near].max() > 0.01 * WAVE
    assert not taut[near].any()


def test_heights_make_up_for_skinning_that_lowers_them() -> None:
    """A sheet whose joints turn apart is carried by their mean, which is shorter by the cosine of half the angle."""
    positions, triangles = plane(LENGTH, WIDTH, 20)
    weights = np.full((len(positions), 2), 0.5)
    angle = np.radians(50.0)
    turn = [[1, 0, 0, 0], [0, np.cos(angle), -np.sin(angle), 0], [0, np.sin(angle), np.cos(angle), 0], [0, 0, 0, 1]]
    matrices = np.array([[turn, np.transpose(turn)]])
    sheet, gauges = Sheet.of(positions, triangles), Gauges.of(positions, triangles)
    joints, along_x = np.tile(np.arange(2), (len(positions), 1)), np.tile([1.0, 0.0, 0.0], (len(positions), 1))
    surface = _Surface(sheet, at_rest(positions, triangles, 2), joints, weights, gauges)
    still, upwards = (np.zeros(len(positions)), np.ones(len(positions))), np.tile([0.0, 0.0, 1.0], (len(positions), 1))
    hollows, lower, strains = surface.shown(matrices[0], surface.bent(matrices[0]), upwards, still)
    fine = sheet.averaging(0.3 * WAVE)
    stretch = 1.0 + fine.of_integrals(along(strains, along_x, along_x))
    room = _room(stretch, fine.of_integrals(hollows), np.full(len(positions), WAVE))
    assert lower == pytest.approx(np.cos(angle))
    assert room.min() > 0.4


def test_what_moves_as_a_whole_is_not_looked_at() -> None:
    """A sheet of two halves on joints of their own, whose middle follows both, is bent in the middle alone."""
    positions, triangles = plane(LENGTH, WIDTH, 20)
    part = np.clip(4.0 * positions[:, 0] / LENGTH - 1.5, 0.0, 1.0)
    turn = np.eye(4)
    turn[:3, :3] = [[0.6, 0, 0.8], [0, 1, 0], [-0.8, 0, 0.6]]
    surface = _Surface(
        Sheet.of(positions, triangles),
        at_rest(positions, triangles, 2),
        np.tile(np.arange(2), (len(positions), 1)),
        np.stack([1.0 - part, part], axis=1),
        Gauges.of(positions, triangles),
    )
    corners = part[triangles]
    mixed = (corners.min(axis=1) < 1.0) & (corners.max(axis=1) > 0.0)
    assert 0 < mixed.sum() < len(triangles)
    assert surface.bent(np.stack([np.eye(4), turn])).tolist() == np.flatnonzero(mixed).tolist()
    assert not len(surface.bent(np.stack([turn, turn])))


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("one", "other"), [(0.0, 0.0), (0.03, 0.0), (0.0, 0.03), (-0.3, 0.0), (0.2, 0.2), (0.21, 0.2), (-0.3, -0.2)]
)
def test_nothing_rises_where_nothing_is_shortened_or_all_directions_alike(one: float, other: float) -> None:
    _, found = squeezed(one, other, slack=SLACK)
    assert not found.heights.any()
    assert not found.directions.any()


@pytest.mark.parametrize(("one", "other", "way"), [(0.2, 0.0, 0), (0.0, 0.2, 1), (0.3, 0.1, 0), (-0.1, 0.15, 1)])
def test_a_sheet_is_shortened_most_across_its_crests(one: float, other: float, way: int) -> None:
    _, found = squeezed(one, other)
    assert (found.heights > 0).any()
    # Of the strain's components xx and yy that one is the least.
    assert np.median(found.directions[:, way]) < np.median(found.directions[:, 1 - way])


def test_a_wave_is_no_steeper_than_it_can_be() -> None:
    """Beyond some compression, flanks would overhang: heights fall with the posed wavelength."""
    tall = [float(np.median(squeezed(lost)[1].heights)) for lost in SQUEEZES]
    for lost, half_height in zip(SQUEEZES, tall, strict=True):
        assert 2.0 * np.pi * half_height / ((1.0 - lost) * WAVE) < 1.5
    assert tall[2] < tall[1]


def test_a_bent_tube_folds_on_its_inner_side_alone() -> None:
    """Folds outlast the compression by about a wavelength along their crests, and by a radius as cloth slips."""
    ground, field = bent_tube()
    places, heights = ground.rest.positions, tallest(field)
    assert np.abs(places[np.argmax(heights)] * [1.0, 0.0, 1.0]).max() < 0.3
    assert heights[places[:, 1] < -0.8 * RADIUS].max() < 0.1 * heights.max()
    assert heights[np.abs(places[:, 0]) > 0.9].max() < 0.02 * heights.max()


def test_crests_run_across_the_compression_of_a_bent_tube() -> None:
    """It is shortened along its length: crests run round it."""
    ground, field = bent_tube()
    heights = tallest(field)
    angles = np.degrees(np.arccos(np.clip(np.abs(across(ground, field)[:, 0]), 0.0, 1.0)))
    assert np.average(angles, weights=heights**2) < 10.0


@pytest.mark.slow
def test_more_slack_makes_lower_folds() -> None:
    """Folds are lower as a whole; where there is no room for more, they are as high with little slack as with none."""
    heights = [float(np.linalg.norm(tallest(bent_tube(slack=slack)[1]))) for slack in ("0%", "4%", "20%")]
    assert heights[0] > 1.01 * heights[1] > 1.02 * heights[2] > 0


def test_longer_waves_are_higher_in_proportion() -> None:
    """But for what averages over a wavelength take off, a fold twice as long along the compression is twice as high."""
    fields = [bent_tube(wavelength=wavelength)[1] for wavelength in (0.08, 0.16)]
    low, high = (field.greatest_height * np.sqrt(1.0 - np.median(field.region.slants) ** 2) for field in fields)
    assert 1.5 < high / low < 2.1


@pytest.mark.parametrize("one", SQUEEZES)
def test_crests_run_straight_across_on_what_is_flat(one: float) -> None:
    assert squeezed(one)[1].slants == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("angle", [-1.0, 1.0])
def test_of_a_twisted_limb_the_crests_along_it_lead(angle: float) -> None:
    """A twist shortens it aslant, so crests that lean to one side are nearer to rings than those of the other side."""
    rings, sides = 41, 24
    x, turn = np.linspace(0.0, LENGTH, rings), 2.0 * np.pi * np.arange(sides) / sides
    positions = np.stack(np.broadcast_arrays(x[:, None], np.cos(turn), np.sin(turn)), axis=2).reshape(-1, 3)
    positions[:, 1:] *= 0.3
    a = np.arange((rings - 1) * sides)
    b = a - a % sides + (a + 1) % sides
    triangles = np.concatenate([np.stack([a, a + sides, b], 1), np.stack([b, a + sides, b + sides], 1)])
    share = positions[:, 0] / LENGTH
    matrices = np.tile(np.eye(4), (2, 1, 1))
    matrices[1, 1:3, 1:3] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    found = measured(positions, triangles, np.stack([1.0 - share, share], axis=1), matrices[None], radius=0.3)
    inner = np.abs(share - 0.5) < 0.3
    normals = at_rest(positions, triangles, 2).normals
    lines, *_ = Irregular(WAVE, 0.0, "a").crests(positions, normals, found.directions, found.slants)
    one, other = np.abs(np.cross(normals, lines)[:, :, 0])
    assert np.sign(found.leads[inner]) == pytest.approx(np.sign(one - other)[inner])
    assert np.abs(found.leads[inner]).min() > 0.2


def test_no_side_leads_on_what_is_flat() -> None:
    assert squeezed(0.4)[1].leads == pytest.approx(0.0, abs=1e-6)


def test_crests_round_a_limb_are_those_between_flat_facets() -> None:
    """These sink as far as its folds are high: by the square of their length over eight radii."""
    ground, field = bent_tube(wavelength=0.08, slack="4%")
    straight = np.abs(ground.rest.positions[:, 0] - ground.rest.positions[:, 0].mean()) < 0.5
    slant = float(np.median(field.region.slants[straight]))
    long = 0.08 / slant
    assert 0.2 < slant < np.sqrt(0.5)
    assert 0.05 < long**2 / (8.0 * RADIUS) / 0.08 < 1.0 / np.pi
    thin, thick = (float(np.median(bent_tube(wavelength=each)[1].region.slants)) for each in (0.08, 0.16))
    assert thick / thin == pytest.approx(np.sqrt(2.0), rel=0.1)
