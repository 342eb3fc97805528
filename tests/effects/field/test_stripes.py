"""One phase over a surface: as many crests as its length asks for, and no seam where lines have no signs."""

from functools import cache

import numpy as np
import pytest

from kit.garments import plane
from wrinklecli.effects.field.stripes import Sides, phases
from wrinklecli.numeric.arrays import Floats, Ints

LENGTH, WIDTH, CELLS = 1.0, 0.5, 40


def striped(
    positions: Floats, triangles: Ints, lines: Floats, wavelength: float, trust: Floats | None = None, seed: str = "a"
) -> tuple[Sides, Floats]:
    """The sides of a flat sheet and its ψ."""
    normals, count = np.tile([0.0, 0.0, 1.0], (len(positions), 1)), len(positions)
    sides = Sides.of(positions, triangles, normals, lines, np.full(count, wavelength))
    return sides, phases(sides, positions, triangles, np.ones(count) if trust is None else trust, wavelength, seed=seed)


@cache
def plain(wavelength: float, signs: bool = False) -> tuple[Floats, Sides, Floats]:
    """A sheet with lines along x, of either sign at random or of one."""
    positions, triangles = plane(LENGTH, WIDTH, CELLS)
    ways = np.where(np.random.default_rng(0).random(len(positions)) < 0.5, -1.0, 1.0) if signs else 1.0
    lines = np.tile([1.0, 0.0, 0.0], (len(positions), 1)) * np.reshape(ways, (-1, 1))
    return positions, *striped(positions, triangles, lines, wavelength)


def cosines(psi: Floats) -> Floats:
    return psi[:, 0] / np.linalg.norm(psi, axis=1)


@pytest.mark.parametrize("signs", [False, True])
@pytest.mark.parametrize("wavelength", [0.1, 0.22])
def test_a_sheet_has_as_many_crests_as_waves_fit(wavelength: float, signs: bool) -> None:
    positions, _, psi = plain(wavelength, signs)
    rows = cosines(psi).reshape(-1, round(WIDTH * CELLS) + 1)
    crossings = (np.diff(np.sign(rows), axis=0) != 0).sum(axis=0)
    assert np.median(crossings) == pytest.approx(2.0 * LENGTH / wavelength, abs=1.0)
    # Crests run straight across: hardly anything changes along them.
    assert np.abs(np.diff(rows, axis=1)).mean() < 0.1 * np.abs(np.diff(rows, axis=0)).mean()
    assert np.ptp(positions[:, 2]) == 0.0


def test_the_phase_turns_along_each_side_as_it_should() -> None:
    positions, sides, psi = plain(0.22)
    a, b = sides.ends.T
    assert sides.turns == pytest.approx(2.0 * np.pi / 0.22 * (positions[b, 0] - positions[a, 0]), abs=1e-9)
    angles = np.arctan2(psi[:, 1], psi[:, 0])
    off = np.angle(np.exp(1j * (angles[b] - angles[a] - sides.turns)))
    assert np.median(np.abs(off)) < 0.02


def test_middles_are_those_of_a_wave() -> None:
    positions, sides, _ = plain(0.22, signs=False)
    wave = 2.0 * np.pi / 0.22 * positions[:, 0]
    found = sides.middles(np.stack([np.cos(wave), np.sin(wave)], axis=1))
    halfway = wave[sides.ends].mean(axis=1)
    assert found == pytest.approx(np.stack([np.cos(halfway), np.sin(halfway)], axis=1), abs=1e-9)


def test_the_height_at_the_middle_of_a_side_does_not_depend_on_signs() -> None:
    """The height is an even function of the phase: where the lines point the other way, ψ is conjugated."""
    _, sides, _ = plain(0.22, signs=True)
    assert 0.3 < (sides.signs < 0).mean() < 0.7
    positions, triangles = plane(LENGTH, WIDTH, CELLS)
    ways = np.where(np.random.default_rng(0).random(len(positions)) < 0.5, -1.0, 1.0)
    wave = 2.0 * np.pi / 0.22 * positions[:, 0]
    found = sides.middles(np.stack([np.cos(wave), ways * np.sin(wave)], axis=1))
    assert found[:, 0] == pytest.approx(np.cos(wave[sides.ends].mean(axis=1)), abs=1e-9)
    assert len(triangles) > 0


def test_crests_fade_where_lines_meet_at_right_angles() -> None:
    """No direction is right there; two wavelengths away from there crests run on."""
    wavelength = 0.1
    positions, triangles = plane(LENGTH, WIDTH, CELLS)
    middle = positions[:, 0] - positions[:, 0].mean()
    straight = np.tile([1.0, 0.0, 0.0], (len(positions), 1))
    lengths = []
    for lines in (straight, np.where(middle[:, None] < 0, straight, [0.0, 1.0, 0.0])):
        lengths.append(np.linalg.norm(striped(positions, triangles, lines, wavelength)[1], axis=1))
    assert lengths[0].min() > 0.95
    assert np.median(lengths[1][np.abs(middle) < wavelength / 5.0]) < 0.6
    assert np.median(lengths[1][np.abs(middle) > 2.0 * wavelength]) > 0.85


def test_lines_that_come_back_turned_round_have_no_seam() -> None:
    """Round the middle of a ring lines turn by 180°, so that their signs must jump somewhere: crests do not show where.

    Along a crest the height stays as it is, at the jump as elsewhere.
    """
    radii, angles = np.linspace(0.5, 1.0, 16), np.linspace(0.0, 2.0 * np.pi, 120, endpoint=False)
    r, t = (each.ravel() for each in np.meshgrid(radii, angles, indexing="ij"))
    positions = np.stack([r * np.cos(t), r * np.sin(t), 0 * t], axis=1)
    a = np.arange(15 * 120)
    b = a - a % 120 + (a + 1) % 120
    triangles = np.concatenate([np.stack([a, a + 120, b], 1), np.stack([b, a + 120, b + 120], 1)])
    lines = np.stack([np.cos(t / 2.0), np.sin(t / 2.0), 0 * t], axis=1)
    sides, psi = striped(positions, triangles, lines, 0.25)
    heights = cosines(psi)
    one, other = sides.ends.T
    jumps = sides.signs < 0
    assert 10 < jumps.sum() < 60
    steps = np.abs(heights[one] - heights[other])
    expected = np.abs(sides.turns)
    calm = expected < 0.35
    assert steps[jumps & calm].mean() < 2.0 * steps[~jumps & calm].mean() + 0.02
    # Nor is there one along the waves: heights change no faster than a wave does.
    assert steps[jumps].mean() < 1.5 * steps[~jumps].mean()


@pytest.mark.parametrize("seed", ["a", "b"])
def test_the_same_seed_gives_the_same_phase(seed: str) -> None:
    positions, triangles = plane(0.5, 0.25, 20)
    lines = np.tile([1.0, 0.0, 0.0], (len(positions), 1))
    first, again = (striped(positions, triangles, lines, 0.12, seed=seed)[1] for _ in range(2))
    assert first.tobytes() == again.tobytes()
    other = striped(positions, triangles, lines, 0.12, seed="other")[1]
    assert np.abs(other - first).max() > 0.01


def test_a_phase_goes_on_where_nothing_asks_for_it() -> None:
    """Only one half counts; the other has numbers all the same."""
    positions, triangles = plane(LENGTH, WIDTH, 20)
    lines = np.tile([1.0, 0.0, 0.0], (len(positions), 1))
    _, psi = striped(positions, triangles, lines, 0.2, trust=(positions[:, 0] < 0.5).astype(float))
    assert np.isfinite(psi).all()
    assert (np.linalg.norm(psi, axis=1) > 0).all()
