"""`wrinkle bake`, with the file of `--depfile`: what an output depends on, as rules for Make and Ninja."""

import os
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any, get_args

import click

from wrinklecli.choices import Engine, FrameFormat, Mode, Storage, Tracks
from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, emit_json, say, say_findings
from wrinklecli.cli.streams import command_outputs
from wrinklecli.errors import WrinkleError, listed
from wrinklecli.files.formats import MODEL_ENDINGS
from wrinklecli.files.outputs import Outputs

# Control characters, wildcards, and characters that end a list of files or have a meaning in Make or Ninja.
_NOT_CARRIED = re.compile(r"[\x00-\x1f\x7f*?\[;|<>^`]")
# A backslash before a character that is itself quoted; names that one of the two drops, looks up elsewhere or assigns.
_NOT_CARRIED_AT = re.compile(r"\\[#:$=]|[ :\\)]$|^(\./+)*(~|-l|\.[A-Z_]+$)|^[+!]?=|^$")
# A target that would be a pattern, a variable, a group of targets, or an option of Make.
_NO_TARGET = re.compile(r"[%=]|&$|^(\./+)*\.[^/]*$")
# These words make the word behind them a variable if it has a =.
_MODIFIERS = {"define", "export", "override", "private", "undefine", "unexport"}


@click.command(
    short_help="Make wrinkles: morph targets and their weights.",
    epilog="Example: wrinkle bake samples/trousers.glb configs/trousers.yaml -o out.glb",
)
@click.argument("asset", type=opt.FILE)
@click.argument("tools", type=opt.FILE)
@opt.file("-o", "--output", metavar="OUT", text="The .glb or .gltf to write.")
@opt.choice(
    "--mode",
    Mode,
    "morph: keep the skin, add morph targets and their weights. frames: a posed mesh for each frame. weights: morph"
    " targets that move nothing, with their weights, for maps (wrinkle maps).",
)
@opt.anim("OUT has these clips too.")
@opt.clip("Bake only this clip; may be repeated.")
@opt.tool("Bake only this tool; may be repeated.")
@opt.fps("Frames per second; overrides sampling.fps (30).")
@opt.length(
    "--max-error",
    default="1%",
    text="Refuse a file whose error is greater, in scene units or per cent of the tallest wrinkle.",
)
@opt.max_levels
@opt.whole(
    "--edges-per-interval", bounds=(1, 16), text="Overrides refinement.edges_per_interval, the edges on half a bump."
)
@opt.max_vertices
@opt.choice(
    "--accessors",
    Storage,
    "How morph targets are stored. dense: for readers without sparse accessors; based: sparse, with zeros below for"
    " Godot 3, Filament, VTK and f3d.",
)
@opt.choice("--tracks", Tracks, "none: write targets and extras, but no weight tracks.")
@opt.flag("--draft", text="Leave out the proof, contact and one level of refinement, for a quick look; OUT says so.")
@opt.flag(
    "--split",
    text="Divide meshes into parts, NAME_part2 and so on beside NAME, each with only the morph targets that move it:"
    " engines unpack targets over whole meshes.",
)
@opt.flag("--morph-tangents", text="Add TANGENT to targets where the mesh has tangents.")
@click.option(
    "--engine",
    type=click.Choice(get_args(Engine)),
    help="Hold targets to the limits of this engine, or refuse. three: 256 targets, 4 joints a vertex; unity, blender:"
    " weights from 0 to 1 (the asset's own are only reported); unreal: 4 joints a vertex; filament: as three, based;"
    " cesium: 5 targets, 6 without texture coordinates, dense; godot3: based; vtk (f3d too): 4 targets, based; spec8:"
    " 8 targets at a time.",
)
@opt.file("--frames-dir", metavar="DIR", text="Also write a file for each frame into DIR.")
@opt.choice("--frames-format", FrameFormat, "The format of the files in DIR.")
@opt.file("--maps-dir", metavar="DIR", text="Also write wrinkle maps into DIR, with the defaults of wrinkle maps.")
@opt.file("--report", metavar="FILE.json", text="Write what was made and how exact it is.")
@opt.file("--timings", metavar="FILE.json", text="Write seconds by stage, frames per second, and memory.")
@opt.file("--depfile", metavar="FILE.d", text="Write the files that OUT depends on, for Make and Ninja.")
@opt.file("--cache", metavar="DIR", text="Keep solved contact and flesh in DIR, and find there what did not change.")
@opt.whole("-j", "--jobs", bounds=(1, 1024), text="Processes that resolve contact; as many as cores by default.")
@opt.allow_external()
@opt.max_memory
@opt.flag("--replace", text="If ASSET is the output of a bake, bake its original, as if from another folder.")
@opt.strict
@opt.json("Print what --report writes, in place of lines.")
@opt.progress
@opt.quiet()
@opt.verbose()
def bake(
    asset: str,
    tools: str,
    output: str | None,
    report: str | None,
    timings: str | None,
    depfile: str | None,
    maps_dir: str | None,
    cache: str | None,
    as_json: bool,
    progress: bool,
    quiet: bool,
    verbose: bool,
    jobs: int | None,
    **options: Any,
) -> None:
    """Bake the wrinkling tools of TOOLS (YAML) into the animations of ASSET (glTF).

    All files are written, or none: OUT is replaced last, and only by a complete file.

    configs/bake.md explains the options.

    Exit codes: 0 done; 1 the input is at fault, nothing written; 2 wrong usage; 3 refused (--max-error,
    --engine, --strict), nothing written; 70 a bug.
    """
    if output is None and options["frames_dir"] is None:
        raise click.UsageError("Missing option '-o' (or '--frames-dir').")
    if maps_dir is not None and options["replace"]:
        raise click.UsageError("'--maps-dir' goes without '--replace': maps are made of an asset without wrinkles.")
    if output is None and depfile is not None:
        raise click.UsageError("'--depfile' needs '-o'.")
    if output is not None and not output.lower().endswith(MODEL_ENDINGS):
        raise click.BadParameter(f"{output!r} does not end in {listed(MODEL_ENDINGS)}", param_hint="-o")
    with command_outputs() as outputs:
        from wrinklecli.baking.job import BakeOptions
        from wrinklecli.baking.report import text_of
        from wrinklecli.numeric.processes import core_count
        from wrinklecli.texture.with_bake import bake_with_maps

        for path in filter(None, (report, timings, depfile)):
            outputs.claim(path)
        details = report is not None or as_json
        chosen = BakeOptions(details=details, jobs=jobs or core_count(), **options)
        with _kept_in(cache, outputs), Progress(quiet=quiet, lines=progress) as shown:
            made, mapped = bake_with_maps(asset, tools, output, maps_dir, chosen, outputs=outputs, progress=shown.show)
        if report is not None:
            outputs.add_bytes(report, text_of(made.data).encode())
        if timings is not None:
            outputs.add_bytes(timings, text_of(made.timings).encode())
        if depfile is not None and output is not None:
            outputs.add_bytes(depfile, dependencies(output, made.inputs))
        if as_json:
            emit_json(made.data)
    if quiet or as_json:
        return
    say_findings(made.notes, made.warnings)
    if mapped is not None:
        own = set(made.notes), set(made.warnings)
        say_findings([n for n in mapped.notes if n not in own[0]], [w for w in mapped.warnings if w not in own[1]])
    for tool in made.data["tools"] if verbose else ():
        moved, targets = tool["moved_vertices"], ", ".join(tool["targets"]) or "none"
        say(f"{tool['name']} on {tool['node']}: {moved} vertices, targets {targets}")
    say(f"{output or options['frames_dir']}: {made.summary}")
    if mapped is not None:
        say(f"{maps_dir}: {mapped.summary}")


@contextmanager
def _kept_in(folder: str | None, outputs: Outputs) -> Iterator[None]:
    """Keep solutions in the folder of a cache, if there is one, and warn of what there is damaged.

    Raises:
        WrinkleError: The folder cannot be made.
    """
    if folder is None:
        yield
        return
    # Imported here, as other bakes need none of it.
    from wrinklecli.batching.cache import Cache, Solutions
    from wrinklecli.batching.stores import is_url
    from wrinklecli.effects.kept import solutions_in

    if not is_url(folder):
        outputs.make_folders(folder)
    cache = Cache(folder)
    with solutions_in(Solutions(cache)):
        yield
    say_findings([], cache.warnings)


def dependencies(target: str, inputs: Iterable[str]) -> bytes:
    """Write a Make rule that rebuilds the target when an input changes, and an empty rule for each input.

    The empty rules keep Make going when an input is renamed; a path that means something else there has none.

    Raises:
        WrinkleError: Make or Ninja would take a path for something else, however it is quoted.

    Source: GNU Make manual, §3.1.1 (splitting lines), §4.2 (rule syntax), §4.4 (wildcards); depfile_parser.in.cc of
    Ninja, which reads a part of Make's quoting (& ' " since Ninja 1.12). `tests/cli/test_depfile.py` runs both.
    """
    paths = list(dict.fromkeys(inputs))
    # `target: a=b` sets a variable, but `target: c a=b` does not.
    paths.sort(key=lambda path: "=" in path or path in _MODIFIERS)
    for path in (target, *paths):
        if _NOT_CARRIED.search(path) or _NOT_CARRIED_AT.search(path):
            raise _refusal(path)
    if _NO_TARGET.search(target):
        raise _refusal(target)
    if any("=" in path for path in paths) and ("=" in paths[0] or paths[0] in _MODIFIERS):
        raise _refusal(next(path for path in paths if "=" in path))
    rules = [f"{_escape(target)}: {' '.join(map(_escape, paths))}\n"]
    rules += [f"\n{_escape(path)}:\n" for path in paths if not _NO_TARGET.search(path)]
    return os.fsencode("".join(rules))


def _refusal(path: str) -> WrinkleError:
    return WrinkleError("is a name that Make or Ninja cannot read from --depfile; rename it", where=path)


def _escape(path: str) -> str:
    """Quote a path for a Make rule: spaces (with backslashes before them), # and : by backslashes, $ by another $."""
    return re.sub(r"(\\*) ", r"\1\1\\ ", path).replace("$", "$$").replace("#", r"\#").replace(":", r"\:")
