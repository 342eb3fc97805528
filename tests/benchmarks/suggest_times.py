"""Measures the time that `suggest` takes for large characters.

    python tests/benchmarks/suggest_times.py                    all cases that can be built, a line for each
    python tests/benchmarks/suggest_times.py --only joints      those whose names contain a word
    python tests/benchmarks/suggest_times.py --assets DIR       with cesium_man.glb and trousers.glb from there
    python tests/benchmarks/suggest_times.py --program DIR      of the program in another folder
    python tests/benchmarks/suggest_times.py --state "after 0.2.0"  also as rows of suggest.csv

Seconds are those of the processor, of one process and all that it starts, which other programs change by a third at
most; and those of the clock, which mean something on an idle machine only: the load stands beside them.
"""

import argparse
import csv
import os
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(HERE), str(ROOT / "tests")]

import numpy as np  # noqa: E402
from assets import finer, more_clips, more_joints  # noqa: E402
from contact_table import seconds_of  # noqa: E402

from kit.characters import CHARACTERS  # noqa: E402

RESULTS = HERE / "suggest.csv"
COLUMNS = ("state", "case", "processor", "clock", "load")
# A place that no triangle reaches, so that all are split.
NOWHERE = (np.full(3, 1e9), 0.0)

Build = Callable[[Path], Path]


def cases(assets: Path | None) -> dict[str, Build]:
    """Give the function that writes the asset of each case, by its name."""
    found: dict[str, Build] = {
        "avatar, 5 meshes, range of motion of 25 joints": lambda out: CHARACTERS["avatar"]().write(out),
        "avatar, 5 meshes, range of motion of 50 joints": lambda out: more_joints(
            CHARACTERS["avatar"]().write(out), out
        ),
    }
    if assets:
        figure, trousers = (partial(finer, assets / f"{name}.glb", keep=NOWHERE, rounds=1) for name in _REAL)
        found["figure, 18,688 triangles"] = figure
        found["figure, 18,688 triangles, 76 clips"] = lambda out: more_clips(figure(out), out, 76)
        found["trousers, 28,416 triangles"] = trousers
    return found


_REAL = ("cesium_man", "trousers")


def main() -> None:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", default=[], help="part of a case's name; may be repeated")
    parser.add_argument("--state", help="write rows of this name into suggest.csv")
    parser.add_argument("--program", type=Path, default=ROOT, help="a checkout of the program to measure")
    parser.add_argument("--assets", type=Path, help="a folder with assets that the project does not have")
    options = parser.parse_args()
    for name, build in cases(options.assets).items():
        if options.only and not any(word in name for word in options.only):
            continue
        with tempfile.TemporaryDirectory() as folder:
            asset = build(Path(folder) / "asset.glb")
            processor, clock = seconds_of(options.program, ["suggest", asset, "-o", asset.with_suffix(".yaml")])
        load = os.getloadavg()[0]
        print(f"{name:56}{processor:8.1f} s of the processor{clock:8.1f} s at a load of {load:.1f}", flush=True)
        if options.state:
            with RESULTS.open("a", newline="") as file:
                row = (options.state, name, f"{processor:.1f}", f"{clock:.1f}", f"{load:.1f}")
                csv.writer(file, lineterminator="\n").writerow(row)


if __name__ == "__main__":
    main()
