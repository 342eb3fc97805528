"""The shape of a fold by its material, and smooth random numbers by which folds differ."""

import re

import numpy as np
import pytest

from kit.garments import plane
from kit.places import ROOT
from wrinklecli.effects.field.irregular import Irregular
from wrinklecli.effects.field.material import FABRICS, Fabric
from wrinklecli.numeric.arrays import Floats, smoothstep
from wrinklecli.tools.fields import OF_MATERIALS

EACH = pytest.mark.parametrize("fabric", FABRICS.values(), ids=list(FABRICS))
COSINES = np.cos(np.linspace(0.0, 2.0 * np.pi, 361))


@EACH
def test_a_wave_is_as_high_as_a_sine_and_sinks_less_than_it_rises(fabric: Fabric) -> None:
    waves = fabric.wave(COSINES)
    assert np.ptp(waves) == pytest.approx(2.0)
    assert (waves.max(), waves.min()) == pytest.approx((2.0 * (1.0 - fabric.inward), -2.0 * fabric.inward))
    assert 0.0 <= fabric.inward < 0.5


@EACH
def test_crests_of_cloth_are_narrower_than_its_valleys_and_others_wider(fabric: Fabric) -> None:
    waves = fabric.wave(COSINES)
    assert (np.diff(fabric.wave(np.linspace(-1.0, 1.0, 50))) > 0).all()
    assert ((waves > (waves.max() + waves.min()) / 2.0).mean() < 0.5) == (fabric is FABRICS["cloth"])


@EACH
def test_forks_are_as_high_as_the_mean_of_a_wave(fabric: Fabric) -> None:
    assert fabric.mean == pytest.approx(fabric.wave(COSINES[:-1]).mean())
    assert fabric.wave(COSINES).min() < fabric.mean < fabric.wave(COSINES).max()


def test_the_reference_has_the_values_of_materials() -> None:
    section = (ROOT / "configs" / "fields.md").read_text(encoding="utf-8")
    rows = {key: cells.split(" | ") for key, cells in re.findall(r"^\| (.+?) \| (\d.*) \|$", section, re.MULTILINE)}
    columns = re.search(r"^\| \| (.*) \|$", section, re.MULTILINE)
    assert columns is not None
    for column, material in enumerate(columns[1].replace("`", "").split(" | ")):
        found = [rows[key][column] for key in ("wavelength `auto`, of the girth", "`slack`", "`variation`")]
        assert found == [f"{each}" for each in OF_MATERIALS[material].values()]


def test_numbers_are_smooth_and_of_one_place_however_fine_the_mesh_is() -> None:
    coarse, fine = plane(1.0, 0.5, 40)[0], plane(1.0, 0.5, 80)[0]
    for k in range(2):
        numbers = _varied(fine, 0.1, "a")[k]
        rows = numbers.reshape(81, 41)
        assert rows[::2, ::2].ravel() == pytest.approx(_varied(coarse, 0.1, "a")[k])
        assert np.ptp(numbers) > 0.1
        assert np.abs(np.diff(rows, axis=0)).max() < 0.3 * np.ptp(rows)
        assert (numbers > 0).all()
        assert _varied(fine, 0.0, "a")[k] == pytest.approx(1.0)
        assert _varied(fine, 0.1, "b")[k] != pytest.approx(numbers)


def test_crests_differ_from_their_neighbours_more_than_along_them() -> None:
    """They differ along them, too: else the crests of one patch are bars of one length."""
    positions = plane(2.0, 2.0, 40)[0]
    for longer, higher in (_varied(positions, 0.15, each) for each in "abc"):
        assert np.mean(higher**2) == pytest.approx(1.0, abs=0.1)
        for numbers in (longer, higher):
            across, along = (np.abs(np.diff(numbers.reshape(81, 81), axis=axis)).mean() for axis in (0, 1))
            assert 0.9 * across > along > 0.3 * across


def test_crests_go_on_where_lines_turn_at_once() -> None:
    """A step of their numbers there would be seen as a dent."""
    positions = plane(1.0, 0.5, 80)[0]
    part = smoothstep(np.clip((positions[:, 0] - 0.4) / 0.2, 0.0, 1.0))[:, None]
    directions = -((1.0 - part) * [1.0, 0, 0, 0, 0, 0] + part * [0, 1.0, 0, 0, 0, 0])
    normals = np.tile([0.0, 0.0, 1.0], (len(positions), 1))
    ratios = []
    for seed in "abcdefgh":
        lines, *numbers, agreed = Irregular(0.1, 0.15, seed).crests(
            positions, normals, directions, np.full(len(part), 0.4)
        )
        assert agreed.reshape(81, 41)[[0, 40, 80], 0] == pytest.approx([1.0, 0.0, 1.0], abs=1e-6)
        assert np.abs(np.diff(lines[0].reshape(81, 41, 3)[[39, 41], 0], axis=0)).max() > 0.5
        for each in np.reshape(numbers, (-1, len(part))):
            steps = np.abs(np.diff(each.reshape(81, 41), axis=0)).max(axis=1)
            ratios.append(steps[38:42].max() / steps.max(initial=0.0, where=np.abs(np.arange(80) - 40) > 4))
    assert np.mean(ratios) < 1.0


def _varied(positions: Floats, variation: float, seed: str) -> tuple[Floats, Floats]:
    """Numbers of the first of two families whose crests run along y."""
    lines = np.tile([1.0, 0.0, 0.0], (len(positions), 1))
    longer, higher = Irregular(0.1, variation, seed).varied(positions, lines, np.stack([lines, lines]))
    return longer[0], higher[0]


def test_crests_run_aslant_to_either_side() -> None:
    positions = plane(1.0, 0.5, 20)[0]
    normals, directions = (np.tile(each, (len(positions), 1)) for each in ([0.0, 0, 1], [-1.0, 0, 0, 0, 0, 0]))
    slants = np.linspace(0.0, 0.7, len(positions))
    lines, longer, *_ = Irregular(0.1, 0.15, "a").crests(positions, normals, directions, slants)
    assert np.linalg.norm(lines, axis=2) == pytest.approx(1.0)
    assert np.abs(lines @ [0.0, 1.0, 0.0]) == pytest.approx(np.tile(slants, (2, 1)))
    assert np.abs(np.sum(lines[0] * lines[1], axis=1)) == pytest.approx(1.0 - 2.0 * slants**2)
    # Where nothing is aslant, both families are one; elsewhere each is wider in other places.
    assert longer[0, 0] == pytest.approx(longer[1, 0])
    assert np.abs(longer[0] - longer[1]).max() > 0.2


def test_one_family_leads_over_a_length() -> None:
    """One family is high where the other is low, and both change hands along a crest after several wavelengths."""
    positions = plane(2.0, 2.0, 40)[0]
    normals, directions = (np.tile(each, (len(positions), 1)) for each in ([0.0, 0, 1], [-1.0, 0, 0, 0, 0, 0]))
    lengths = []
    for seed in "abcdefgh":
        _, _, (one, other), _ = Irregular(0.1, 0.15, seed).crests(
            positions, normals, directions, np.full(len(positions), 0.5)
        )
        assert np.corrcoef(one, other)[0, 1] < -0.3
        assert (np.maximum(one, other) > 2.0 * np.minimum(one, other)).mean() > 0.5
        changes = (np.diff(np.sign((one - other).reshape(81, 81)), axis=1) != 0).mean()
        lengths.append(2.0 / 80.0 / 0.1 / changes)
    assert np.mean(lengths) > 3.0


def test_the_family_that_bends_less_along_its_crests_leads() -> None:
    positions = plane(2.0, 2.0, 40)[0]
    normals, directions = (np.tile(each, (len(positions), 1)) for each in ([0.0, 0, 1], [-1.0, 0, 0, 0, 0, 0]))
    slants = np.full(len(positions), 0.5)
    for sign in (1.0, -1.0):
        _, _, heights, _ = Irregular(0.1, 0.15, "a").crests(positions, normals, directions, slants, sign)
        assert (sign * (heights[0] - heights[1]) > 0).mean() > 0.95


@EACH
def test_of_two_waves_the_higher_one_is_seen(fabric: Fabric) -> None:
    one, other = fabric.wave(COSINES), fabric.wave(np.roll(COSINES[:-1], 90))
    assert fabric.higher(one, one) == pytest.approx(one)
    found, higher = fabric.higher(one[:-1], other), np.maximum(one[:-1], other)
    assert (found <= higher + 1e-9).all()
    assert (found >= higher - fabric.roundness - 1e-9).all()
    assert fabric.higher(other, one[:-1]) == pytest.approx(found)
