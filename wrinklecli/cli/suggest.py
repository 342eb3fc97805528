"""`wrinkle suggest`."""

import math
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from wrinklecli.choices import FPS, SUBSTANCES
from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, emit_json, say, say_findings, write_text
from wrinklecli.cli.streams import command_outputs
from wrinklecli.errors import aligned, megabytes, shortened
from wrinklecli.numeric.memory import GPU_BUDGET, parse_bytes

if TYPE_CHECKING:
    from wrinklecli.review.suggest.fitted_tools import Suggestion
    from wrinklecli.review.suggest.garments import SuggestedField
    from wrinklecli.review.suggest.score import Score
    from wrinklecli.review.suggest.suggest import Suggestions
    from wrinklecli.review.suggest.text import Entry


_WIDEST = 60  # characters of a column


_MATERIAL = re.compile(rf"(.+)=({'|'.join(SUBSTANCES)})", re.DOTALL)


def _materials(values: tuple[str, ...]) -> dict[str, str]:
    """Read names and what they are made of. Names may hold `=`."""
    expected = f"NAME=KIND, where KIND is {', '.join(SUBSTANCES)}"
    found = (opt.parsed(value, _MATERIAL, expected) for value in values)
    return {groups[0]: groups[1] for groups in found}


@click.command(
    short_help="Find where clips compress an asset, and write fields and tools for it.",
    epilog="Example: wrinkle suggest samples/trousers.glb -o tools.yaml",
)
@click.argument("asset", type=opt.FILE)
@opt.file("-o", "--output", metavar="OUT", text="The YAML file; left out, or '-': standard output.")
@opt.flag("--merge", text="Add to OUT what it does not have, and keep all lines that it has.")
@opt.flag("--force", text="Write over OUT, whatever it has.")
@opt.anim()
@opt.clip("Look at this clip only; may be repeated.")
@opt.whole(
    "--count",
    bounds=(1, 500),
    text="The greatest number of suggestions, best first; a pair that `mirror` makes counts as one.",
    default=8,
)
@opt.valued(
    "--budget",
    metavar="SIZE",
    read=lambda value: parse_bytes(value, least=1),
    text="The most memory on a GPU, such as 10MB, that the suggestions together take after bake --split.",
    default=f"{GPU_BUDGET // 10**6}MB",
)
@click.option("--node", metavar="NAME", help="Look at the mesh of this node only.")
@opt.valued(
    "--material",
    "materials",
    metavar="NAME=KIND",
    multiple=True,
    read=_materials,
    text=f"The substance of the node, mesh or material NAME: {', '.join(SUBSTANCES)}. May be repeated.",
)
@opt.presets("A tool gets the preset whose `parts` name its part of a body; OUT names the file.")
@opt.flag("--face", text="Suggest only wrinkles of a face, by its morph targets.")
@opt.flag("--all", "everything", text="Keep hard and hidden parts, and suggestions with a low score.")
@opt.flag("--muscles", text="Guess only muscles, low ones, by the names of bones.")
@opt.flag("--flesh", text="Guess only regions of firm flesh, by the names of bones.")
@opt.flag("--touch", text="Suggest only touches, where clips bring fingertips to skin.")
@opt.fps("Poses per second, at most 200 of a clip.", default=FPS)
@opt.range_of_motion("Look at these motions too.")
@opt.allow_external("Read buffers outside the asset's folder too.")
@opt.max_memory
@opt.whole(
    "-j",
    "--jobs",
    bounds=(1, 1024),
    text="Processes that measure poses and look at tools; as many as cores by default.",
)
@opt.json("Print JSON to standard output; YAML goes to -o alone.")
@opt.progress
@opt.verbose("Say why each suggestion is left out.")
@opt.quiet("Print no table and no notes.")
def suggest(
    asset: str,
    output: str | None,
    merge: bool,
    force: bool,
    as_json: bool,
    progress: bool,
    verbose: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Find where the clips of ASSET (glTF) compress its surface most, and write a tools file for `wrinkle bake`.

    Garments get wrinkle fields; skin, faces and leather get tools. Each is tried on the mesh, looked at and scored.
    What an artist would not keep is left out, and notes on standard error say why. An asset without clips is measured
    in the range of motion of its joints and morph targets.

    The file bakes as it is, and is made to be edited. So a file that exists is refused without --merge or --force.
    configs/suggest.md says how places are found and judged.

    Exit codes: 0 done; 1 the input is at fault, or nothing to suggest; 2 wrong usage; 70 a bug.
    """
    if as_json and output == "-":
        raise click.UsageError("'--json' and '-o -' both want standard output.")
    alone = [f"'--{name}'" for name in ("face", "muscles", "flesh", "touch") if options[name]]
    if len(alone) > 1:
        raise click.UsageError(f"{' and '.join(alone)} are one or the other.")
    if merge and force:
        raise click.UsageError("'--merge' and '--force' are one or the other.")
    if merge and output in (None, "-"):
        raise click.UsageError("'--merge' needs a file: -o FILE.")
    if options["face"] and options["presets"]:
        raise click.UsageError("'--face' takes no '--presets': those of faces are built in.")

    from wrinklecli.errors import AssetError, ConfigError, counted

    with command_outputs() as outputs:
        from wrinklecli.gltf.files import files_named
        from wrinklecli.numeric.processes import core_count
        from wrinklecli.review.suggest.suggest import suggest as run

        to_file = output is not None and output != "-"
        if output is not None and to_file:
            outputs.claim(output)
        outputs.protect([*files_named([asset, *options["anims"]]), *options["presets"]])
        if output is not None and to_file and outputs.would_replace(output) and not (merge or force):
            message = "is there already; --merge adds what it does not have, --force writes over it"
            raise ConfigError(message, where=output)
        before = None
        if merge and output is not None and outputs.would_replace(output):
            from wrinklecli.review.suggest.merged import merged
            from wrinklecli.tools.files_beside import load_text
            from wrinklecli.tools.schema import KINDS

            before = load_text(output)
            merged(output, before, "version: 1\n", external=options["allow_external"])  # refuses a wrong one now
        options["jobs"] = options["jobs"] or core_count()
        options["folder"] = os.path.dirname(output) if output is not None and to_file else ""
        with Progress(quiet=quiet, lines=progress) as shown:
            found = run(asset, progress=shown.show, **options)
        for_people = not (quiet or as_json)
        if for_people:
            say_findings([*found.notes, *(each.line for each in found.dropped if verbose)], ())
        if as_json:
            emit_json(_json(asset, found))
        if not found.text:
            raise AssetError(f"nothing to suggest: {found.reason}", where=asset)
        text = found.text
        if before is not None and output is not None:
            made = merged(output, before, text, external=options["allow_external"])
            text = made.text
            added = [counted(count, *KINDS[key].words) for key, count in made.added.items()]
            if for_people:
                say_findings([f"{output}: {f'{added[0]} added' if added else 'nothing is new'}"], ())
        if to_file or not as_json:
            write_text(output, text, outputs)
    if for_people:
        for table, numbers in _tables(found):
            _say_table(table, numbers)


def _json(asset: str, found: "Suggestions") -> dict[str, Any]:
    return {
        "suggest": 1,
        "asset": asset,
        "reason": found.reason or None,
        "notes": list(found.notes),
        "dropped": [{"name": each.name, "reason": each.reason, "value": _short(each.value)} for each in found.dropped],
        "tools": [_json_tool(each) for each in found.tools],
        "fields": [_json_field(each) for each in found.fields],
        **({found.guesses[0].effect.section: [_json_guess(each) for each in found.guesses]} if found.guesses else {}),
    }


def _json_guess(each: "Entry") -> dict[str, Any]:
    facts = {name: fact if isinstance(fact, str) else _short(fact) for name, fact in each.facts.items()}
    return {**each.values, **facts}


def _json_tool(each: "Suggestion") -> dict[str, Any]:
    from wrinklecli.tools.records import written_keys

    tool = each.tool
    written = written_keys(tool, shown=("max_height", "rest_length"))
    return {
        "name": tool.name,
        "node": tool.node,
        "origin": tool.origin,
        "between": tool.between,
        "target": tool.target,
        "mirror": "x" if each.mirrored else "none",
        "width": tool.width.value,
        "material": tool.material or "none",
        "strategy": tool.strategy,
        "bumps": tool.bumps,
        "max_height": written["max_height"],
        "compressible": f"{100 * tool.compressible:.0f}%",
        "rest_length": written["rest_length"],
        "contact": "resolve" if tool.contact else "off",
        "mesh": each.mesh,
        "place": each.words_of_both,
        "driver": each.driver,
        "driver_kind": "morph target" if each.by_morph else "joint",
        **_measured(each, "clip", "time", "span"),
        "shortest": _short(each.clips[each.clip]),
        "shortening": _short(each.shortening),
        "clips": {name: _short(length) if math.isfinite(length) else None for name, length in each.clips.items()},
        **_measured(each, "score", "height", "gpu_bytes"),
        **_json_score(each.judgement),
        "substance": None if each.substance is None else each.substance.kind,
        "why": None if each.substance is None else each.substance.why,
        "confidence": None if each.substance is None else round(each.substance.confidence, 2),
    }


def _json_score(judgement: "Score | None") -> dict[str, Any]:
    if judgement is None:
        return {"keep": None, "merits": None}
    known = {name: round(value, 3) for name, value in asdict(judgement.merits).items() if not math.isnan(value)}
    return {"keep": round(judgement.keep, 3), "merits": known}


def _json_field(each: "SuggestedField") -> dict[str, Any]:
    return {
        **_measured(each.field, "name", "node", "material", "substance", "joints"),
        "strength": each.field.strength,
        **_measured(each, "mesh", "why", "clip", "time", "height", "wavelength", "targets", "gpu_bytes"),
        **_json_score(each.judgement),
    }


def _measured(record: Any, *names: str) -> dict[str, Any]:
    """Some values of a record by their names."""
    found = {name: getattr(record, name) for name in names}
    return {name: _short(value) if isinstance(value, float) else value for name, value in found.items()}


def _short(value: float) -> float:
    """Round a measured number to the digits of float32."""
    from wrinklecli.numeric.arrays import significant

    return significant(value, 9)


def _tables(found: "Suggestions") -> Iterator[tuple[list[list[str]], int]]:
    """For each kind of suggestions a table with a heading, and the number of its last columns that have numbers."""
    if found.fields:
        yield _rows(_FIELDS, found.fields), 6
    if found.tools:
        several = len({each.mesh for each in found.tools}) > 1
        yield _rows({name: cell for name, cell in _TOOLS.items() if several or name != "mesh"}, found.tools), 5
    if found.guesses:
        # A muscle that no clip moves has fewer facts.
        names = dict.fromkeys(name for each in found.guesses for name in each.facts)
        rows = [
            [fact if isinstance(fact := each.facts.get(name, ""), str) else f"{fact:.3g}" for name in names]
            for each in found.guesses
        ]
        named = [_sided(each.effect.name, each.mirrored) for each in found.guesses]
        heading = [found.guesses[0].effect.words[0], *names]
        yield [heading, *([name, *row] for name, row in zip(named, rows, strict=True))], 1


def _percent(judgement: "Score | None") -> str:
    return "" if judgement is None else f"{100 * judgement.keep:.0f} %"


def _sided(name: str, mirrored: bool) -> str:
    return name + (" + mirror" if mirrored else "")


# By their headings, the columns of the tables of fields and tools: each gives the cell of one.
_PEAK: Mapping[str, Callable[[Any], str]] = {
    "clip": lambda each: each.clip,
    "at": lambda each: f"{each.time:.2f} s",
    "keep": lambda each: _percent(each.judgement),
}
_FIELDS: Mapping[str, Callable[[Any], str]] = {
    "field": lambda each: each.field.name,
    "mesh": lambda each: each.mesh,
    **_PEAK,
    "height": lambda each: f"{each.height:.3g}",
    "wavelength": lambda each: f"{each.wavelength:.3g}",
    "targets": lambda each: str(each.targets),
    "on a GPU": lambda each: megabytes(each.gpu_bytes),
}
_TOOLS: Mapping[str, Callable[[Any], str]] = {
    "tool": lambda each: _sided(each.tool.name, each.mirrored),
    "mesh": lambda each: each.mesh,
    "place": lambda each: each.words_of_both,
    "of": lambda each: "" if each.substance is None else each.substance.kind,
    **_PEAK,
    "shortens": lambda each: f"{100 * each.shortening:.0f} %",
    "height": lambda each: f"{each.height:.2g}",
    "on a GPU": lambda each: megabytes(each.gpu_bytes),
}


def _rows(columns: Mapping[str, Callable[[Any], str]], items: Iterable[Any]) -> list[list[str]]:
    return [[*columns], *([cell(each) for cell in columns.values()] for each in items)]


def _say_table(rows: list[list[str]], numbers: int) -> None:
    rows = [[shortened(cell, _WIDEST) for cell in row] for row in rows]
    heading, *lines = aligned(rows, texts=len(rows[0]) - numbers)
    say(heading, style={"bold": True})
    for line in lines:
        say(line)
