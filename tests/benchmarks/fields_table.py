"""Measures what fields cost, and how often a garment passes through itself with them, and without.

    python tests/benchmarks/fields_table.py                      samples' garments, a line for each clip
    python tests/benchmarks/fields_table.py --assets DIR         with suit.glb, trousers.glb, others/… from there
    python tests/benchmarks/fields_table.py --only suit          those whose names contain a word; may be repeated
    python tests/benchmarks/fields_table.py --seed 1             folds that are irregular in another way
    python tests/benchmarks/fields_table.py --program DIR        of the program in another folder
    python tests/benchmarks/fields_table.py --state "after 0.2"  also as rows of fields.csv, and README's table
    python tests/benchmarks/fields_table.py --readme             README's table anew from fields.csv

Crossings are edges of the garment that pass through its own triangles, at 13 moments of a clip: of the refined mesh
without its morph targets, the skin, and with them. Seconds are those of the processor, of the whole command.
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import yaml
from contact_table import HERE, ROOT, compile_program, seconds_of
from rows import README, add_records, records, write_readme

from kit.asset import Json
from kit.player import Gltf, wrinkle_columns
from kit.torn import moments, own_crossings

RESULTS = HERE / "fields.csv"
_MARKERS = "<!-- From fields.csv, by `fields_table.py --readme`. -->", "<!-- The end of fields' table. -->"


@dataclass(frozen=True)
class Case:
    """A field on a garment.

    Attributes:
        file: The asset, in the project or in the folder of assets.
        node: The node of the garment.
        keys: Of the field: its name, which decides how its folds are irregular, and others.
        clips: Names or numbers of the clips to look at.
        anims: Files with the clips.
    """

    file: str
    node: str
    keys: Json
    clips: Sequence[str | int]
    anims: Sequence[str] = ()


@dataclass(frozen=True)
class Measured:
    """The figures of a garment in a clip; all but crossings are those of its whole bake.

    Attributes:
        state: The program's version.
        case: The garment's name,
        clip: and the clip's.
        skin: Crossings of the skin, summed over the moments,
        field: and with the field.
        most: Greatest number that the field adds at a moment.
        error: Root mean square of what the tables miss, over that of the heights,
        best: and with the best weights.
        megabytes: Added to the file.
        gpu: Megabytes of targets on a GPU, with parts.
        vertices: New ones.
        targets: Morph targets of the field.
        seconds: Of the processor.
    """

    state: str
    case: str
    clip: str
    skin: int
    field: int
    most: int
    error: float
    best: float
    megabytes: float
    gpu: float
    vertices: int
    targets: int
    seconds: float


_ANIMS = [f"others/an_f_{name}.glb" for name in ("crouch", "jog", "dance")]
_ANIMATED = ["F_Crouch_Walk_001", "F_Jog_001", "F_Dances_007"]
_CLOTHES = {"name": "clothes", "substance": ["cloth"]}
(_FIGURE,) = yaml.safe_load((ROOT / "wrinklecli/example/figure.yaml").read_text(encoding="utf-8"))["fields"]
CASES = {
    "samples' trousers": Case("samples/trousers.glb", "trousers", {"name": "trousers"}, ["squat", "walk"]),
    "figure": Case("wrinklecli/example/figure.glb", "figure", _FIGURE, ["squat", "walk"]),
    "trousers": Case("trousers.glb", "trousers", {"name": "trousers"}, ["squat", "walk"]),
    "suit": Case("suit.glb", "suit", {"name": "suit"}, ["squat", "curl", "jump", "run"]),
    "cesium_man": Case("cesium_man.glb", "Cesium_Man", _CLOTHES, [0]),
    "rpm_fem": Case("others/rpm_fem.glb", "Wolf3D_Avatar", _CLOTHES, _ANIMATED, _ANIMS),
    "ff_avatar": Case("others/ff_avatar.glb", "Wolf3D_Outfit_Bottom", {"name": "bottom"}, _ANIMATED, _ANIMS),
}


def measured(state: str, name: str, program: Path, assets: Path | None, seed: int | None) -> Iterator[Measured]:
    """Bake a field, and yield its figures clip by clip; none if the asset is not there."""
    case = CASES[name]
    folders = [each for each in (assets, ROOT) if each is not None and (each / case.file).exists()]
    if not folders:
        return
    asset = folders[0] / case.file
    with tempfile.TemporaryDirectory() as folder:
        tools, out, report = (Path(folder) / each for each in ("tools.yaml", "out.glb", "report.json"))
        field = {"node": case.node, **case.keys, **({} if seed is None else {"seed": seed})}
        tools.write_text(json.dumps({"version": 1, "fields": [field]}), encoding="utf-8")
        anims = [part for each in case.anims for part in ("--anim", folders[0] / each)]
        seconds = seconds_of(program, ["bake", asset, tools, "-o", out, "-q", "--report", report, *anims])[0]
        data, baked = json.loads(report.read_text(encoding="utf-8")), Gltf(out)
        (own,), (mesh,) = data["fields"], [each for each in data["meshes"] if each["node"] == case.node]
        for clip in case.clips:
            times = moments(baked, clip, 13)
            columns = wrinkle_columns(baked, case.node)
            level = own_crossings(baked, case.node, clip, times, without=columns)
            shown = own_crossings(baked, case.node, clip, times)
            yield Measured(
                state, name, str(clip), int(level.sum()), int(shown.sum()), int((shown - level).max()),
                error=own["error"], best=own["least_error"],
                megabytes=round((out.stat().st_size - asset.stat().st_size) / 1e6, 2),
                gpu=round(mesh["split_gpu_bytes"] / 1e6, 2),
                vertices=mesh["vertices"] - mesh["coarse_vertices"],
                targets=len(own["targets"]), seconds=round(seconds, 1),
            )  # fmt: skip


def readme_table(rows: Sequence[Measured]) -> str:
    """README's table: each garment in each clip, in the first state and in the last one, where they differ."""
    states = list(dict.fromkeys(row.state for row in rows))
    of_state = [{(row.case, row.clip): row for row in rows if row.state == state} for state in states]
    lines = [
        f"State {' → '.join(dict.fromkeys([states[0], states[-1]]))}:",
        "",
        "| | clip | skin | added | at one moment | error / best | MB | on a GPU | vertices | targets | seconds |",
        f"|{11 * '---|'}",
    ]
    for case, clip in of_state[-1]:
        both = [each[case, clip] for each in (of_state[0], of_state[-1]) if (case, clip) in each]
        cells = [
            [f"{row.skin:,}", _marked(row.field - row.skin), f"{row.most:+}",
             f"{100 * row.error:.1f} / {100 * row.best:.1f} %", f"{row.megabytes:.2f}", f"{row.gpu:.2f}",
             f"{row.vertices:,}", f"{row.targets}", f"{row.seconds:.1f}"]
            for row in both
        ]  # fmt: skip
        shown = [" → ".join(dict.fromkeys(each)) for each in zip(*cells, strict=True)]
        lines.append(f"| {' | '.join([case, clip, *shown])} |")
    return "\n".join(lines)


def _marked(added: int) -> str:
    return f"**{added:+}**" if added > 0 else f"{added:+}"


def main() -> int:
    """Command line: see the module's text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", default=[], help="part of a garment's name; may be repeated")
    parser.add_argument("--state", help="write rows of this name into fields.csv, and README's table")
    parser.add_argument("--seed", type=int, help="the seed of each field; not with --state")
    parser.add_argument("--program", type=Path, default=ROOT, help="a checkout of the program to measure")
    parser.add_argument("--assets", type=Path, help="a folder with assets that the project does not have")
    parser.add_argument("--readme", action="store_true", help="write README's table from fields.csv, and end")
    parser.add_argument("--to", type=Path, default=README, help="where to write README with that table")
    options = parser.parse_args()
    if options.state and options.seed is not None:
        parser.error("fields.csv has fields without a seed")
    if options.readme:
        write_readme(readme_table(records(RESULTS, Measured)), _MARKERS, options.to)
        return 0
    compile_program(options.program)
    held = True
    for name in CASES:
        if options.only and not any(word in name for word in options.only):
            continue
        for row in measured(options.state or "", name, options.program, options.assets, options.seed):
            held &= row.field <= row.skin
            words = {key: value for key, value in asdict(row).items() if key not in ("state", "case", "clip")}
            print("ok " if row.field <= row.skin else "NOT", row.case, row.clip, words, flush=True)
            if options.state:
                add_records(RESULTS, [row], ("state", "case", "clip"))
    if options.state:
        write_readme(readme_table(records(RESULTS, Measured)), _MARKERS)
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
