"""Holds fields against simulations, and these against one another: `python floor.py FOLDER OTHER…`, after simulate.py.

Each folder has a simulation of another chance. A bake does not know that chance, so no more can be asked of fields, of
as many seeds, than what simulations have between each other. Prints a table, and writes floor.csv beside this module.
"""

import csv
import sys
from collections.abc import Callable, Iterable
from functools import partial
from itertools import permutations, product
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
sys.path += [str(HERE), str(HERE.parent), str(HERE.parent.parent)]

from bake import bake, played  # noqa: E402
from compare import FIELDS, FRAMES, LOOKS, distance, field_of, folds, read  # noqa: E402
from measure import Folds  # noqa: E402
from relief import Relief  # noqa: E402
from scenes import SCENES, Array, Scene, share_of  # noqa: E402

Look = list[tuple[Relief, Folds]]  # of each frame

# What two looks have between each other in a frame.
BETWEEN: dict[str, Callable[[Relief, Folds, Relief, Folds], float]] = {
    "turned": lambda one, _, other, __: one.turned(other)[0],
    "turned_far": lambda one, _, other, __: one.turned(other)[1],
    "overlap": lambda one, _, other, __: one.overlap(other),
    "height": lambda one, _, other, __: other.rms / one.rms - 1.0,
    "height_on_lines": lambda _, one, __, other: other.rms / one.rms - 1.0,
}
# What one look has by itself: half heights, how far along the limb they reach, and which way crests lean.
BY_ITSELF: dict[str, Callable[[Relief], float]] = {
    "reach": lambda one: one.reach,
    "aslant": lambda one: one.aslant,
    "lean": lambda one: one.lean,
}
COLUMNS = ("scene", "cloth", "what", "measure", "mean", "least", "greatest")


def measured(scene: Scene, apart: float, all_positions: Iterable[Array]) -> list[Look]:
    """Measure (frames, vertices, 3) positions of several; `apart` is the simulated distance of crests."""
    rest = scene.cloth.positions
    return [
        [
            (
                Relief.of(scene, each, scene.posed(scene.cloth, share_of(frame)), apart),
                folds(scene, each, rest, frame),
            )
            for each, frame in zip(positions, FRAMES, strict=True)
        ]
        for positions in all_positions
    ]


def between(measure: str, pairs: Iterable[tuple[Look, Look]]) -> list[float]:
    """The median over frames of each pair."""
    found = BETWEEN[measure]
    return [float(np.median([found(*a, *b) for a, b in zip(*pair, strict=True)])) for pair in pairs]


def compared(scene: Scene, cloth: str, folders: list[Path]) -> list[tuple[object, ...]]:
    simulated = [read(folder, scene, cloth)[0] for folder in folders]
    apart = float(np.median([distance(scene, each) for each in simulated]))
    every = {"simulated": measured(scene, apart, [each[list(FRAMES)] for each in simulated])}
    for name, wavelength in zip(FIELDS, (None, apart), strict=True):
        baked = []
        for seed in range(len(folders)):
            listed = field_of(cloth, wavelength)
            listed["fields"][0]["seed"] = seed
            file, _ = bake(scene, listed, folders[0] / f"{scene.name}_{cloth}_{name}_{seed}")
            baked.append(played(file, np.array(FRAMES))[0][:, : len(scene.cloth.positions)])
        every[f"baked, {name}"] = measured(scene, apart, baked)
    rows: list[tuple[object, ...]] = []
    for what, looks in every.items():
        add = partial(_row, scene.name, cloth, what)
        pairs = list(product(every["simulated"], looks))
        if what == "simulated":
            pairs = list(permutations(looks, 2))
        for measure in BETWEEN:
            found = between(measure, pairs)
            # Of two simulations neither is the right one, so heights differ to either side.
            rows.append(add(measure, np.abs(found).tolist() if what == "simulated" else found))
        for measure, of_one in BY_ITSELF.items():
            rows.append(add(measure, [float(np.median([of_one(one) for one, _ in look])) for look in looks]))
    return rows


def _row(scene: str, cloth: str, what: str, measure: str, values: list[float]) -> tuple[object, ...]:
    return (scene, cloth, what, measure, *(f"{found(values):.3g}" for found in (np.mean, min, max)))


def main() -> None:
    folders = [Path(each) for each in sys.argv[1:]]
    scenes = [scene for scene in (make() for make in SCENES.values()) if scene.sides]
    rows = [row for scene in scenes for cloth in LOOKS for row in compared(scene, cloth, folders)]
    for row in [COLUMNS, *rows]:
        print(*(f"{each!s:>16}" for each in row))
    with (HERE / "floor.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([COLUMNS, *rows])


if __name__ == "__main__":
    main()
