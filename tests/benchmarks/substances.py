"""Compares the substances of characters with those that people see, in substances.csv.

    python tests/benchmarks/substances.py DIR…       for each character that has a file in a folder

A row of substances.csv is a part of the body on a mesh of a character: its per cent of the character's area, and how
much of it is cloth, skin, leather and hard, in per cent, judged by eye on textured pictures. Hair and armour are hard,
though the program knows them by names alone. Printed are, in per cent of the area of the trunk and the limbs, which
garments fold on, the cloth that is missed and what is wrongly cloth.
"""

import csv
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1])]

from wrinklecli.character.bones import read_bones  # noqa: E402
from wrinklecli.choices import SUBSTANCES  # noqa: E402
from wrinklecli.gltf.document import read_document  # noqa: E402
from wrinklecli.surface.ground import read_ground  # noqa: E402
from wrinklecli.surface.strain import read_gauge  # noqa: E402
from wrinklecli.surface.substance import substances_at  # noqa: E402
from wrinklecli.tools.records import ToolsFile  # noqa: E402

TABLE = HERE / "substances.csv"
KINDS = ("cloth", "skin", "leather", "hard")
# Parts that no garment's joints fold.
APART = ("neck", "head", "jaw", "eye", "hand", "palm", "finger", "foot", "toes")

Floats = NDArray[np.float64]


def areas_of(path: Path) -> dict[tuple[str, str], Floats]:
    """(kinds,) areas of each kind on each part of the body of each mesh, as parts of the character's area."""
    document = read_document(path)
    parts, found = read_bones(document).parts, defaultdict[tuple[str, str], Floats](lambda: np.zeros(len(KINDS)))
    shown = {each["mesh"]: node for node, each in enumerate(document.items("nodes")) if {"mesh", "skin"} <= set(each)}
    for node in shown.values():
        ground = read_ground(document, node, [], ToolsFile(path=str(path)), ())
        gauge, kinds = read_gauge(ground.surface, ground.rest, ground.rig), substances_at(ground)
        joints = ground.rig.joints[ground.surface.heaviest][gauge.triangles[:, 0]]
        for joint, kind, area in zip(joints.tolist(), kinds[gauge.numbers].tolist(), gauge.areas.tolist(), strict=True):
            name = ground.rig.names[node], parts[joint] or ""
            found[name][KINDS.index(SUBSTANCES[kind])] += area
    total = sum(each.sum() for each in found.values())
    return {name: areas / total for name, areas in found.items()}


def main() -> None:
    """Command line: see the module's text."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for path in sorted(each for folder in sys.argv[1:] for each in Path(folder).glob("*.glb")):
        own = [row for row in rows if row["character"] == path.stem and row["part"] not in APART]
        if own:
            found = areas_of(path)
            area = np.array([float(row["area"]) for row in own]) / 100.0
            seen = area * [float(row["cloth"]) / 100.0 for row in own]
            cloth = np.array([found.get((row["mesh"], row["part"]), np.zeros(len(KINDS)))[0] for row in own])
            missed, wrong = np.maximum(seen - cloth, 0.0).sum(), np.maximum(cloth - seen, 0.0).sum()
            print(f"{path.stem:12} missed {100 * missed / area.sum():3.0f} %, wrong {100 * wrong / area.sum():3.0f} %")


if __name__ == "__main__":
    main()
