"""Rows of the benchmarks, the goal of each, their record in results.csv, and README's table, made from that.

A row is a ratio of two things that were measured in the same run. README shows some of those in the last row of
results.csv, and `tests/benchmarks/test_rows.py` makes that table again, so that no figure can be edited by hand.
"""

import csv
import math
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import date
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")
HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results.csv"
README = HERE / "README.md"
# README's table stands between these lines.
_MARKERS = "<!-- From results.csv, by `tests/benchmarks/run.py --readme`. -->", "<!-- The end of the table. -->"


@dataclass(frozen=True)
class Goal:
    """The ratio to reach: at most, or at least."""

    reach: float
    least: bool = False

    def held_by(self, ratio: float) -> bool:
        """True if the ratio reaches it."""
        return ratio >= self.reach if self.least else ratio <= self.reach

    def __str__(self) -> str:
        """The goal, for people."""
        return f"{'≥' if self.least else '≤'} {self.reach:g}"


# The goal of each column of results.csv, by the beginning of its name; the longest counts.
GOALS = {
    "frames_": Goal(100, least=True),
    "floor_": Goal(3),
    "bake_": Goal(500, least=True),
    "memory_morph": Goal(1.5),
    "memory_frames": Goal(2.5),
    "pace_": Goal(1),
    "bytes": Goal(1.001),
    "exponent_": Goal(1.1),
    "density": Goal(1.5),
    "proof_clips": Goal(3),
    "report_clips": Goal(3),
    "diff_bumps": Goal(3),
    "help": Goal(1),
    "simple_skin": Goal(3.2),
    "two_knees": Goal(3),
    "edit_": Goal(1),
    "batch_loop": Goal(3, least=True),
    "batch_workers": Goal(1.8, least=True),
    "batch_shared": Goal(1.1),
    "batch_again": Goal(0.02),
    "drawn_": Goal(1),
    "blender_hand_time": Goal(6, least=True),
    "blender_hand_bytes": Goal(100, least=True),
    "blender_character_time": Goal(30, least=True),
    "blender_character_bytes": Goal(500, least=True),
    "contact_left_": Goal(0.05),
    "contact_seconds_": Goal(1),
    "contact_targets_": Goal(1),
    "contact_volume_": Goal(1),
}


def goal_of(name: str) -> Goal:
    """The goal of a column of results.csv."""
    return GOALS[max((each for each in GOALS if name.startswith(each)), key=len)]


@dataclass(frozen=True)
class Row:
    """A ratio that was measured.

    Attributes:
        name: A word for it: a column of results.csv.
        what: The same for people.
        over: The thing that it is compared with.
        ratio: The one over the other.
        shown: The thing that was measured, with its unit.
    """

    name: str
    what: str
    over: str
    ratio: float
    shown: str

    @property
    def goal(self) -> Goal:
        """The ratio to reach."""
        return goal_of(self.name)

    @property
    def held(self) -> bool:
        """True if the goal was reached."""
        return self.goal.held_by(self.ratio)

    def __str__(self) -> str:
        """A line."""
        verdict = "ok " if self.held else "NOT"
        return f"{verdict} {self.what}, over {self.over}: {self.ratio:.3g} ({self.goal}), {self.shown}"


def markdown(rows: list[Row]) -> str:
    """Give a table of rows."""
    lines = ["| | over | ratio | to reach | measured |", "|---|---|---|---|---|"]
    for row in rows:
        ratio = f"{row.ratio:.3g}" if row.held else f"**{row.ratio:.3g}**, missed"
        lines.append(f"| {row.what} | {row.over} | {ratio} | {row.goal} | {row.shown} |")
    return "\n".join(lines)


def recorded() -> list[dict[str, str]]:
    """Read the rows of results.csv: ratios by column, and where and when they were measured."""
    if not RESULTS.exists():
        return []
    with RESULTS.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def record(release: str, rows: list[Row]) -> None:
    """Write a row of ratios into results.csv: behind the others, or over what the last one has, if it has this name.

    Columns are only added.
    """
    old = recorded()
    entry = {
        "release": release,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "machine": platform.machine(),
        "date": date.today().isoformat(),
        "cores": str(os.cpu_count() or 1),
        "processor": _processor(),
        "load": f"{os.getloadavg()[0]:.1f}",
    }
    entry |= {row.name: f"{row.ratio:.3g}" for row in rows if math.isfinite(row.ratio)}
    if old and old[-1]["release"] == release:
        entry = old.pop() | entry
    names = list(dict.fromkeys([*(old[0] if old else ()), *entry]))
    with RESULTS.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows([*old, entry])


def records(path: Path, kind: type[T]) -> list[T]:
    """The rows of a table of dataclasses of one kind; none if there is no file."""
    if not path.exists():
        return []
    with path.open(encoding="utf-8", newline="") as file:
        return [kind(**{each.name: each.type(row[each.name]) for each in fields(kind)}) for row in csv.DictReader(file)]  # type: ignore


def add_records(path: Path, rows: Sequence[Any], keys: Sequence[str]) -> None:
    """Write dataclasses of one kind into a table, over rows that have the same `keys`."""
    every = [*records(path, type(rows[0])), *rows]
    fresh = {tuple(getattr(row, key) for key in keys): row for row in every}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [each.name for each in fields(rows[0])], lineterminator="\n")
        writer.writeheader()
        writer.writerows(asdict(row) for row in fresh.values())


def _processor() -> str:
    """The name of the processor, as Linux says it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


# README's table: what, over, and the columns of results.csv, one for each part of the line.
_README_LINES: tuple[tuple[str, str, tuple[str, ...]], ...] = (
    (
        "finished frames a second: head, levels 2; wrist, 0; trousers, 1",
        "the paper's 3.6; 188; 17",
        ("frames_head_2", "frames_wrist_0", "frames_trousers_1"),
    ),
    (
        "time for positions and normals, wrinkled: the same",
        "skinning positions alone",
        ("floor_head_2", "floor_wrist_0", "floor_trousers_1"),
    ),
    (
        "frames of a longer clip that a bake takes a second: head, levels 1; wrist, 0; trousers, 1",
        "the paper's 13; 188; 17",
        ("bake_head_1", "bake_wrist_0", "bake_trousers_1"),
    ),
    ("peak memory at 10,000 frames: `morph`; `frames`", "at 100", ("memory_morph", "memory_frames")),
    ("bytes that ten times the frames add", "to the weight tracks", ("bytes",)),
    ("a mesh sixteen times as fine outside the patch", "reading and writing it", ("density",)),
    (
        "`wrinkle --help`; baking ten vertices; 26,762 triangles and two knees",
        "importing numpy",
        ("help", "simple_skin", "two_knees"),
    ),
    ("baking 24 clips: with its proof; with a report", "a draft; without a report", ("proof_clips", "report_clips")),
    (
        "1,000 small assets: one bake after another; nothing to do",
        "one `batch`; the first run",
        ("batch_loop", "batch_again"),
    ),
    (
        "Blender's tools, a shape key for each of 61 frames, the body subdivided: time; bytes",
        "baking hand.glb",
        ("blender_hand_time_operators", "blender_hand_bytes_operators"),
    ),
    (
        "the same, 26,762 triangles and two knees",
        "baking it",
        ("blender_character_time_operators", "blender_character_bytes_operators"),
    ),
)


def readme_table(row: Mapping[str, str]) -> str:
    """Give README's table, made from a row of results.csv; a ratio that misses its goal is bold."""
    processor = f" ({row['processor']})" if row["processor"] else ""
    load = f" Other programs were a load of {row['load']}." if row.get("load") else ""
    lines = [
        f"Version {row['release']}, measured on {row['date']} on {row['cores']} cores{processor}, with Python"
        f" {row['python']}.{load}",
        "",
        "| | over | ratio | goal |",
        "|---|---|---|---|",
    ]
    for what, over, names in _README_LINES:
        ratios, goals = "; ".join(_shown(row, name) for name in names), [str(goal_of(name)) for name in names]
        lines.append(f"| {what} | {over} | {ratios} | {'; '.join(dict.fromkeys(goals))} |")
    return "\n".join(lines)


def _shown(row: Mapping[str, str], name: str) -> str:
    if not row.get(name):
        return "not measured"
    ratio = float(row[name])
    shown = f"{ratio:,.0f}" if ratio >= 100.0 else f"{ratio:.3g}"
    return shown if goal_of(name).held_by(ratio) else f"**{shown}**"


def readme_with(page: str, table: str, markers: tuple[str, str] = _MARKERS) -> str:
    """Put a table into README's text, between its two markers."""
    begin, end = markers
    before, _, rest = page.partition(begin)
    _, found, after = rest.partition(end)
    if not found:
        raise ValueError(f"README.md lacks {begin} and {end}")
    return f"{before}{begin}\n{table}\n{end}{after}"


def write_readme(table: str, markers: tuple[str, str] = _MARKERS, to: Path = README) -> None:
    """Write README with a table that was made anew."""
    to.write_text(readme_with(README.read_text(encoding="utf-8"), table, markers), encoding="utf-8")
