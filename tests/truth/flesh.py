"""Flesh by a few springs against the full solve of the same elements, for the record in `flesh.csv`.

    python -m tests.truth.flesh > tests/truth/flesh.csv

A ball of flesh on the front of a trunk follows a jump with its landing, and a sway. The full solve advances all nodes
by the trapezoidal rule in small steps, with damping in proportion to the stiffness, as the springs have it.
"""

import csv
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wrinklecli.effects.flesh.tissue import Body, Place, swings_of
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.elements import Tissue, factorised, ritz_modes

FREQUENCY, DAMPING = 3.0, 0.25
SECONDS, STEP = 2.0, 1.0 / 240.0

# Heights of hips in a jump, metres at seconds: crouch, flight, landing, and up again.
_JUMP = np.array(
    [
        [0.0, 0.0],
        [0.2, -0.06],
        [0.4, -0.2],
        [0.55, 0.0],
        [0.75, 0.2],
        [0.95, 0.0],
        [1.08, -0.15],
        [1.3, -0.08],
        [2.0, 0],
    ]
)


@dataclass(frozen=True)
class Difference:
    """Errors of the springs: the greatest over the greatest move, and the root mean square over that of the moves."""

    greatest: float
    rms: float


def jump(times: Floats) -> Floats:
    """(times, 3) accelerations of the hips in a jump."""
    from scipy.interpolate import CubicSpline

    return np.outer(CubicSpline(*_JUMP.T, bc_type="clamped")(times, 2), [0.0, 1.0, 0.0])


def sway(times: Floats) -> Floats:
    """(times, 3) accelerations of hips that begin to sway sideways, 6 cm far at 1.1 Hz."""
    from scipy.interpolate import CubicSpline

    ramp = np.clip(times / 0.8, 0.0, 1.0)
    moved = 0.06 * ramp**3 * (10.0 - 15.0 * ramp + 6.0 * ramp**2) * np.sin(2.0 * np.pi * 1.1 * times)
    return np.outer(CubicSpline(times, moved)(times, 2), [1.0, 0.0, 0.0])


MOTIONS: dict[str, Callable[[Floats], Floats]] = {"jump": jump, "sway": sway}


def trunk(rings: int = 48, sides: int = 48) -> tuple[Body, Place]:
    """A trunk with a belly, and the belly's region."""
    up, round_ = np.linspace(-1.0, 1.0, rings + 2)[1:-1], 2.0 * np.pi * np.arange(sides) / sides
    wide = np.sqrt(1.0 - up**2)[:, None]
    x, y, z = 0.17 * wide * np.cos(round_), np.tile(0.35 * up[:, None], sides), 0.12 * wide * np.sin(round_)
    z = z + 0.06 * np.exp(-(((y + 0.05) / 0.12) ** 2)) * np.maximum(z, 0.0) / 0.12
    skin = np.concatenate([np.stack([x, y, z], axis=2).reshape(-1, 3), [[0.0, -0.35, 0.0], [0.0, 0.35, 0.0]]])
    bones = np.array([[[0.0, -0.3, -0.04], [0.0, 0.0, -0.04]], [[0.0, 0.0, -0.04], [0.0, 0.3, -0.04]]])
    return Body(skin, _sphere(rings, sides), bones), Place(np.array([0.0, -0.05, float(skin[:, 2].max())]), 0.13)


def _sphere(rings: int, sides: int) -> Ints:
    """(triangles, 3) of rings of vertices, from the bottom up, and the two poles behind them."""
    row, column = (each.reshape(-1) for each in np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij"))
    a, b = row * sides + column, row * sides + (column + 1) % sides
    side, low, high = np.arange(sides), rings * sides, rings * sides + 1
    after, top = (side + 1) % sides, (rings - 1) * sides
    return np.concatenate(
        [
            np.stack([a, a + sides, b], axis=1),
            np.stack([b, a + sides, b + sides], axis=1),
            np.stack([side, after, np.full(sides, low)], axis=1),
            np.stack([top + after, top + side, np.full(sides, high)], axis=1),
        ]
    )


def full_solve(tissue: Tissue, stiffening: float, damping: float, accelerations: Floats) -> Floats:
    """(times, free nodes, 3) moves of all nodes under (times, 3) accelerations of their ground.

    Args:
        tissue: The elements.
        stiffening: Factor on the stiffness.
        damping: The damping matrix over this stiffness, seconds.
        accelerations: At times `STEP` apart.
    """
    from scipy.sparse import diags

    stiffness, masses = stiffening * tissue.stiffness(), np.repeat(tissue.masses, 3)
    solve = factorised((diags(4.0 / STEP**2 * masses) + (2.0 / STEP * damping + 1.0) * stiffness).tocsc()).solve
    place, speed = np.zeros(len(masses)), np.zeros(len(masses))
    forces = [-masses * np.tile(each, len(masses) // 3) for each in accelerations]
    pull, found = forces[0] / masses, [place]
    for force in forces[1:]:
        ahead = 4.0 / STEP**2 * place + 4.0 / STEP * speed + pull
        drag = stiffness @ (damping * (2.0 / STEP * place + speed))
        moved = solve(force + masses * ahead + drag)
        turned = 2.0 / STEP * (moved - place) - speed
        pull = 4.0 / STEP**2 * (moved - place) - 4.0 / STEP * speed - pull
        place, speed = moved, turned
        found.append(place)
    return np.stack(found).reshape(len(found), -1, 3)


def by_springs(tissue: Tissue, count: int, accelerations: Floats) -> Floats:
    """(times, free nodes, 3) moves of all nodes by a few springs, each advanced by the trapezoidal rule."""
    modes = ritz_modes(tissue, count)
    speeds = 2.0 * np.pi * FREQUENCY * modes.speeds / modes.speeds[0]
    forces = -accelerations @ modes.loads.T
    drags = 2.0 * DAMPING * speeds / speeds[0] * speeds
    place, speed, pull = np.zeros(len(speeds)), np.zeros(len(speeds)), forces[0]
    found = [place]
    for force in forces[1:]:
        ahead = 4.0 / STEP**2 * place + 4.0 / STEP * speed + pull
        moved = (force + ahead + drags * (2.0 / STEP * place + speed)) / (
            4.0 / STEP**2 + 2.0 / STEP * drags + speeds**2
        )
        pull = 4.0 / STEP**2 * (moved - place) - 4.0 / STEP * speed - pull
        place, speed = moved, 2.0 / STEP * (moved - place) - speed
        found.append(place)
    return np.einsum("fm,mnx->fnx", np.stack(found), modes.shapes[:, tissue.free])


def compare(tissue: Tissue, motion: str, counts: tuple[int, ...]) -> dict[int, Difference]:
    """The errors of so many springs in a motion."""
    accelerations = MOTIONS[motion](np.arange(0.0, SECONDS, STEP))
    slowest = float(ritz_modes(tissue, 9).speeds[0])
    speed = 2.0 * np.pi * FREQUENCY
    true = full_solve(tissue, (speed / slowest) ** 2, 2.0 * DAMPING / speed, accelerations)
    peak, mean = np.sqrt((true**2).sum(axis=2)).max(), np.sqrt((true**2).mean())
    found = {}
    for count in counts:
        error = by_springs(tissue, count, accelerations) - true
        found[count] = Difference(
            float(np.sqrt((error**2).sum(axis=2)).max() / peak), float(np.sqrt((error**2).mean()) / mean)
        )
    return found


def main() -> None:
    """Write the record."""
    body, place = trunk()
    tissue = swings_of(body, place, 3).tissue
    table = csv.writer(sys.stdout, lineterminator="\n")
    table.writerow(["motion", "nodes", "springs", "greatest_percent", "rms_percent"])
    for motion in MOTIONS:
        for count, each in compare(tissue, motion, (3, 6, 9)).items():
            table.writerow([motion, len(tissue.free), count, f"{100 * each.greatest:.1f}", f"{100 * each.rms:.1f}"])


if __name__ == "__main__":
    main()
