"""Measures what `contact: resolve` leaves and costs, in folds of many kinds, each a bake with contact and one without.

    python tests/benchmarks/contact_table.py                        all cases, a line for each
    python tests/benchmarks/contact_table.py --only hip --only knees  those whose names contain a word
    python tests/benchmarks/contact_table.py --state "after 0.2.0"  also as rows of contact.csv, and README's table
    python tests/benchmarks/contact_table.py --program DIR          of the program in another folder
    python tests/benchmarks/contact_table.py --assets DIR           with hand.glb and trousers.glb from there
    python tests/benchmarks/contact_table.py --readme               README's table anew from contact.csv

Crossings are edges that pass through triangles, added up over 13 moments of a clip: of the asset, of the bake with
contact off, and with contact; in all meshes, and at vertices that the tools or contact move ("in the folds"), those
that cross at rest aside. Seconds are those of the processor, of the whole command and all that it starts; and those of
the clock, which mean something on an idle machine only: the load stands beside them. The program is compiled before, as
an installed one is.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from math import isnan
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(HERE), str(ROOT / "tests")]

import numpy as np  # noqa: E402
import yaml  # noqa: E402
from rows import README, add_records, records, write_readme  # noqa: E402

from kit.asset import Asset, Json  # noqa: E402
from kit.characters import CHARACTERS  # noqa: E402
from kit.folds import FOLDS  # noqa: E402
from kit.limb import limb_asset, nose, sleeved_limb, waving_limb  # noqa: E402
from kit.limb import tool as limb_tool  # noqa: E402
from kit.looked_up import lookup_gaps  # noqa: E402
from kit.player import Gltf  # noqa: E402
from kit.torn import LEAVES, LEFT_OUT, moments, treated_crossings  # noqa: E402
from wrinklecli.character.clip import read_clips  # noqa: E402
from wrinklecli.character.range_of_motion import range_of_motion  # noqa: E402
from wrinklecli.gltf.document import read_document  # noqa: E402
from wrinklecli.review.crossings import crossings  # noqa: E402

RESULTS = HERE / "contact.csv"
_MARKERS = "<!-- From contact.csv, by `contact_table.py --readme`. -->", "<!-- The end of contact's table. -->"


@dataclass(frozen=True)
class Case:
    """Some folds of an asset in one clip.

    Attributes:
        what: For people.
        asset: Gives the asset, or its file.
        tools: The tools over the folds.
        node: The node whose mesh they are on.
        clip: The clip to look at.
        top: Other keys of the tools file.
        alone: True to bake the clip alone.
    """

    what: str
    asset: Callable[[], Asset | Path]
    tools: Sequence[Json]
    node: str
    clip: str
    top: Mapping[str, Any]
    alone: bool = True


@dataclass(frozen=True)
class Measured:
    """The figures of a case: sums over the moments of its clip.

    Attributes:
        state: The program's version.
        case: The case's name.
        before: Crossings of the asset,
        wrinkled: of the bake without contact,
        contact: and with it.
        folds_before: Those in the folds; likewise
        folds_wrinkled: without contact,
        folds_contact: and with it.
        silent: Those with contact in folds of which no line says that contact is left out, or leaves crossings.
        targets: Morph targets of contact.
        volume_lost: Greatest volume that a fold's shapes take, relative to a limb as long as it is thick.
        seconds: Of the processor, of the bake with contact, and
        seconds_off: without.
        given_up: Lines that say that contact is left out.
        gap: Greatest difference between what players show of contact and what the bake shows, relative to contact's
            greatest move in the clip; nan if it was not measured.
        clock: Seconds of the clock, of the bake with contact; nan if they were not measured.
        load: Processes that ran or waited in the minute before it, in the mean; likewise.
    """

    state: str
    case: str
    before: int
    wrinkled: int
    contact: int
    folds_before: int
    folds_wrinkled: int
    folds_contact: int
    silent: int
    targets: int
    volume_lost: float
    seconds: float
    seconds_off: float
    given_up: int
    gap: float
    clock: float
    load: float

    @property
    def held(self) -> bool:
        """True if nothing crosses in the folds without a line that says so, and in all no more than without contact."""
        return self.silent == 0 and self.contact <= self.wrinkled


def cases(assets: Path | None) -> dict[str, Case]:
    """All cases by their names."""
    found = {
        name: Case(f"fold: {name.replace('_', ' ')}", build_asset(name), FOLDS[name]().tools, "limb", "bend", COARSE)
        for name in FOLDS
    }
    crease = limb_tool(bumps=3, max_height="8%", node="limb")
    for name, what, build in (
        ("tube", "hinged tube, 85°", partial(limb_asset, rings=30, sides=20, angle=85)),
        ("sleeve", "tube in a sleeve, 45°", partial(sleeved_limb, gap=0.05, rings=24, sides=16, angle=45)),
    ):
        found[name] = Case(what, build, [crease], "limb", "fold", COARSE)
    waving = partial(waving_limb, 20, rings=30, sides=20)
    top = {"sampling": {"fps": 15}}
    found["elbow_off_axis"] = Case(
        "tube, 20 clips about other axes", waving, [crease], "limb", "wave_5", top, alone=False
    )
    bridge = {"name": "bridge", "node": "skin", "origin": [-0.5, 0, 0], "target": [0.5, 0, 0], "width": 0.8, "bumps": 4}
    found["nose"] = Case("nose beneath glasses", nose, [bridge], "skin", "sneer", COARSE)
    for name, what, mesh, clip, tools in FIGURES:
        character = name.partition("-")[0]
        found[name] = Case(what, CHARACTERS[character], [{**SKIN, **each} for each in tools], mesh, clip, COARSE)
    found["dressed-elbow-range"] = Case(
        "dressed figure, an elbow by a range of motion", partial(in_range_of_motion, "dressed", "forearm.L"),
        [{**SKIN, **_ELBOWS[0]}], "Mesh_0", "range", COARSE,
    )  # fmt: skip
    samples = yaml.safe_load((ROOT / "configs" / "trousers.yaml").read_text(encoding="utf-8"))
    tools = samples.pop("tools")
    found["sample_knees"] = Case("samples/trousers, both knees", lambda: ROOT / "samples" / "trousers.glb", tools,
                                 "trousers", "squat", samples)  # fmt: skip
    for name, what, file, node, clip, tools in REAL if assets else ():
        found[name] = Case(what, partial(Path, assets or "", file), tools, node, clip, {})
    return found


def build_asset(name: str) -> Callable[[], Asset]:
    """The asset of a fold of the kit."""
    return lambda: FOLDS[name]().asset


def in_range_of_motion(character: str, joint: str) -> Asset:
    """A character with a clip `range`, in which a joint turns as `--range-of-motion` turns it, and back each time."""
    asset = CHARACTERS[character]()
    with tempfile.TemporaryDirectory() as folder:
        document = read_document(asset.write(Path(folder) / "asset.glb"))
    nodes = [number for number, node in enumerate(document.items("nodes")) if "skin" in node]
    motions = [
        clip
        for clip in range_of_motion(document, nodes, read_clips(document)).clips
        if clip.name.startswith(f"{joint} ")
    ]
    turns = np.concatenate([clip.channels[0].values for clip in motions] + [motions[0].channels[0].values[:1]])
    clip: Json = {"name": "range"}
    # Half a second there, and half a second back.
    asset.channel(clip, motions[0].channels[0].node, "rotation", 0.5 * np.arange(len(turns)), turns)
    asset.append("animations", clip)
    return asset


def both(name: str, origin: Sequence[float], target: Sequence[float]) -> list[Json]:
    """A tool on the left side, and one on the right."""
    return [
        {"name": f"{name}_{side}", **{key: [sign * at[0], *at[1:]] for key, at in ends.items()}}
        for ends in [{"origin": origin, "target": target}]
        for side, sign in (("L", 1.0), ("R", -1.0))
    ]


COARSE = {"refinement": {"max_levels": 1}}
SKIN: Json = {"width": 0.1, "bumps": 3, "max_height": "10%"}
_KNEES = both("knee", (0.1, 0.60, -0.05), (0.1, 0.38, -0.06))
_HIPS = both("hip", (0.09, 0.99, 0.1), (0.1, 0.78, 0.08))
_ELBOWS = both("elbow", (0.36, 1.39, 0.045), (0.54, 1.39, 0.042))
_ARMPIT = [{"name": "armpit", "origin": [-0.16, 1.28, 0.0], "target": [-0.28, 1.34, 0.0], "width": 0.08}]
_RAISED = [{"name": "elbow", "origin": [-0.36, 1.43, 0.0], "target": [-0.54, 1.43, 0.0], "width": 0.07}]
# Name, words, mesh, clip and tools; a name begins with that of the character.
FIGURES: Sequence[tuple[str, str, str, str, Sequence[Json]]] = [
    ("dressed-knees", "dressed figure, both knees", "Mesh_0", "squat", _KNEES),
    ("dressed-hips", "dressed figure, both hips", "Mesh_0", "squat", _HIPS),
    ("dressed-elbows", "dressed figure, both elbows", "Mesh_0", "squat", _ELBOWS),
    ("tubes-elbow", "grey figure, elbow of a waving arm", "Figure", "wave", _RAISED),
    ("cartoon-armpit", "cartoon figure, armpit", "Toon", "wave", _ARMPIT),
    ("low_poly_smooth", "low-poly figure, a knee, a hip and an elbow", "Character", "squat",
     [_KNEES[0], _HIPS[0], _ELBOWS[0]]),
]  # fmt: skip
# Assets that the project does not have: name, words, file, mesh, clip and tools.
REAL: Sequence[tuple[str, str, str, str, str, Sequence[Json]]] = [
    ("hand", "real hand, wrist", "hand.glb", "hand", "bend",
     [{"name": "wrist", "origin": [-0.4622, 0.2576, 0.1750], "target": [-0.4838, 0.2355, 0.2126], "width": 0.05,
       "bumps": 4}]),
    ("real_knees", "real trousers, both knees", "trousers.glb", "trousers", "squat",
     [{"name": f"knee_{side}", "origin": [sign * 0.095, -0.258, -0.026], "target": [sign * 0.101, -0.364, -0.020],
       "width": 0.1, "bumps": 4} for side, sign in (("L", 1.0), ("R", -1.0))]),
]  # fmt: skip


def measured(state: str, name: str, case: Case, program: Path, folder: Path) -> Measured:
    """Bake a case with contact and without, and count."""
    built = case.asset()
    asset = built if isinstance(built, Path) else built.write(folder / "asset.glb")
    times_taken, reports, files = [], [], []
    for contact in ("off", "resolve"):
        tools, out, report = (folder / f"{contact}.{ending}" for ending in ("yaml", "glb", "json"))
        settings = {
            "version": 1,
            **case.top,
            "tools": [{"node": case.node, **each, "contact": contact} for each in case.tools],
        }
        tools.write_text(json.dumps(settings), encoding="utf-8")
        command = ["bake", asset, tools, "-o", out, "-q", "--report", report]
        command += ["--clip", case.clip] if case.alone else []
        load = os.getloadavg()[0]
        times_taken.append(seconds_of(program, command))
        reports.append(json.loads(report.read_text(encoding="utf-8")))
        files.append(out)
    totals = [crossings(out, clips=[case.clip]).data["clips"][0]["totals"] for out in files]
    off, resolved = (Gltf(out) for out in files)
    times = moments(off, case.clip, 13)
    mesh = off.node(case.node)
    counts = [
        int(treated_crossings(file, mesh, case.clip, times, reports[1], resolved, said=said).sum())
        for file, said in ((Gltf(asset), ()), (off, ()), (resolved, ()), (resolved, (LEFT_OUT, LEAVES)))
    ]
    folds = reports[1]["folds"]
    return Measured(
        state, name, *totals[0], totals[1][1], *counts,
        targets=sum(len(fold["targets"]) for fold in folds),
        volume_lost=max((float(fold.get("volume_lost") or 0.0) for fold in folds), default=0.0),
        seconds=round(times_taken[1][0], 1), seconds_off=round(times_taken[0][0], 1),
        given_up=sum(LEFT_OUT in line for line in reports[1]["warnings"]),
        gap=round(max((each.share for each in lookup_gaps(resolved, case.clip).values()), default=0.0), 3),
        clock=round(times_taken[1][1], 1), load=round(load, 1),
    )  # fmt: skip


def seconds_of(program: Path, command: Iterable[str | Path]) -> tuple[float, float]:
    """Seconds of the processor and of the clock that a command of the program takes, with all that it starts."""
    code = "import sys; from wrinklecli.cli import main; sys.exit(main())"
    environment = {**os.environ, "PYTHONPATH": str(program)}
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-c", code, *map(str, command)], env=environment, cwd=program, check=True)
    clock, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, clock


def compile_program(program: Path) -> None:
    """Let no command compile the program anew, as an installed one does not: that takes half a second."""
    command = [sys.executable, "-m", "compileall", "-q", str(program / "wrinklecli")]
    subprocess.run(command, check=True)


def readme_table(rows: Sequence[Measured]) -> str:
    """README's table: each case in the last state, and what contact left and took in the first one."""
    words = {name: case.what for name, case in cases(HERE).items()}
    states = list(dict.fromkeys(row.state for row in rows))
    shown = list(dict.fromkeys([states[0], states[-1]]))
    of_state = [{row.case: row for row in rows if row.state == state} for state in shown]
    lines = [
        f"State {' → '.join(shown)}:",
        "",
        "| | before | wrinkled | with contact | targets | seconds | by the clock (load) | given up | player |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in of_state[-1].items():
        both = [each[name] for each in of_state if name in each]
        left = " → ".join(_marked(f"{each.contact:,} / {each.folds_contact:,}", each.held) for each in both)
        targets, seconds, up = (
            " → ".join(str(getattr(each, key)) for each in both) for key in ("targets", "seconds", "given_up")
        )
        apart = " → ".join("–" if isnan(each.gap) else f"{100 * each.gap:.0f} %" for each in both)
        clock = "–" if isnan(row.clock) else f"{row.clock:.1f} ({row.load:.1f})"
        before, wrinkled = f"{row.before:,} / {row.folds_before:,}", f"{row.wrinkled:,} / {row.folds_wrinkled:,}"
        cells = [words[name], before, wrinkled, left, targets, seconds, clock, up, apart]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _marked(text: str, held: bool) -> str:
    return text if held else f"**{text}**"


def main() -> int:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", default=[], help="part of a case's name; may be repeated")
    parser.add_argument("--state", help="write rows of this name into contact.csv, and README's table")
    parser.add_argument("--program", type=Path, default=ROOT, help="a checkout of the program to measure")
    parser.add_argument("--assets", type=Path, help="a folder with assets that the project does not have")
    parser.add_argument("--readme", action="store_true", help="write README's table from contact.csv, and end")
    parser.add_argument("--to", type=Path, default=README, help="where to write README with that table")
    options = parser.parse_args()
    if options.readme:
        write_readme(readme_table(records(RESULTS, Measured)), _MARKERS, options.to)
        return 0
    compile_program(options.program)
    rows = []
    for name, case in cases(options.assets).items():
        if options.only and not any(word in name for word in options.only):
            continue
        with tempfile.TemporaryDirectory() as folder:
            row = measured(options.state or "", name, case, options.program, Path(folder))
        rows.append(row)
        print(
            "ok " if row.held else "NOT",
            case.what,
            {k: v for k, v in asdict(row).items() if k not in ("state", "case")},
            flush=True,
        )
        if options.state:
            add_records(RESULTS, [row], ("state", "case"))
    if options.state:
        write_readme(readme_table(records(RESULTS, Measured)), _MARKERS)
    return 0 if all(row.held for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
