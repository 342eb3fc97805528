"""`wrinkle bake`."""

from typing import Any, get_args

import click

from wrinklecli.choices import Engine, FrameFormat, Mode, Storage, Tracks
from wrinklecli.cli.depfile import dependencies
from wrinklecli.cli.options import (
    FILE,
    allow_external_option,
    anim_option,
    clip_option,
    fps_option,
    length,
    max_levels_option,
    max_memory_option,
    max_vertices_option,
    quiet_option,
    strict_option,
    tool_option,
    verbose_option,
)
from wrinklecli.cli.output import Progress, say, warn
from wrinklecli.cli.streams import command_outputs


@click.command(
    short_help="Make wrinkles: morph targets and their weights.",
    epilog="Example: wrinkle bake samples/trousers.glb configs/trousers.yaml -o out.glb",
)
@click.argument("asset", type=FILE)
@click.argument("tools", type=FILE)
@click.option("-o", "--output", type=FILE, metavar="OUT", help="The .glb or .gltf to write.")
@click.option(
    "--mode",
    type=click.Choice(get_args(Mode)),
    default="morph",
    show_default=True,
    help="morph: keep the skin, add morph targets and their weights. frames: a posed mesh for each frame.",
)
@anim_option("They get into OUT.")
@clip_option("Bake only this clip; may be repeated.")
@tool_option("Bake only this tool; may be repeated.")
@fps_option("Frames per second; overrides sampling.fps (30).")
@click.option(
    "--max-error",
    metavar="LENGTH",
    default="1%",
    show_default=True,
    callback=length,
    help="Refuse a file that is off by more: scene units, or per cent of the tallest wrinkle.",
)
@max_levels_option()
@click.option(
    "--edges-per-interval", type=click.IntRange(1, 16), help="Overrides refinement.edges_per_interval: on half a bump."
)
@max_vertices_option()
@click.option(
    "--accessors",
    type=click.Choice(get_args(Storage)),
    default="sparse",
    show_default=True,
    help="Of morph targets. dense: for readers without sparse accessors; based: sparse, with zeros below for Godot 3,"
    " VTK and f3d.",
)
@click.option(
    "--tracks",
    type=click.Choice(get_args(Tracks)),
    default="all",
    show_default=True,
    help="none: write targets and extras, but no weight tracks.",
)
@click.option("--draft", is_flag=True, help="A quick look: no proof, one level of refinement less; OUT says so.")
@click.option(
    "--split",
    is_flag=True,
    help="Meshes in parts, NAME_part2 and so on beside NAME, each with the morph targets alone that move it: engines"
    " unpack targets over whole meshes.",
)
@click.option("--morph-tangents", is_flag=True, help="Add TANGENT to targets where the mesh has tangents.")
@click.option(
    "--engine",
    type=click.Choice(get_args(Engine)),
    help="Hold targets to what it plays, or refuse. three: 256 targets, 4 joints a vertex; unity: weights from 0 to 1"
    " (the asset's own are only reported); spec8: 8 targets at a time; vtk (f3d too): 4 targets, based; godot3: based.",
)
@click.option("--frames-dir", type=FILE, metavar="DIR", help="Also write a file for each frame into DIR.")
@click.option(
    "--frames-format",
    type=click.Choice(get_args(FrameFormat)),
    default="obj",
    show_default=True,
    help="Of the files in DIR.",
)
@click.option("--report", type=FILE, metavar="FILE.json", help="Write what was made and how exact it is.")
@click.option(
    "--timings", type=FILE, metavar="FILE.json", help="Write what it took: seconds by stage, frames per second, memory."
)
@click.option("--depfile", type=FILE, metavar="FILE.d", help="Write the files that OUT depends on, for Make and Ninja.")
@allow_external_option()
@max_memory_option()
@click.option(
    "--replace", is_flag=True, help="Where ASSET is the output of a bake: bake its original, as if from another folder."
)
@strict_option()
@quiet_option()
@verbose_option()
def bake(
    asset: str,
    tools: str,
    output: str | None,
    report: str | None,
    timings: str | None,
    depfile: str | None,
    quiet: bool,
    verbose: bool,
    **options: Any,
) -> None:
    """Bake the wrinkling tools of TOOLS (YAML) into the animations of ASSET (glTF).

    All files are written, or none: OUT is replaced last, and only by a complete file.

    \b
    --timings writes an object; within a version, keys are only added:
      timings            1, the version
      seconds            by stage: read, plan (attach and refine), sample,
                         budget (--engine), encode, prove, report,
                         export (--frames-dir), write
      total_seconds      their sum; starting Python comes on top
      clips, frames      that were baked, at sampling.fps
      frames_per_second  frames over total_seconds
      members            vertices that tools move
      targets            morph targets made
      bytes_added        OUT with its files over ASSET with its buffers,
                         or null
      peak_memory_bytes  of the process, or null where the system
                         does not say

    Exit codes: 0 done; 1 the input is at fault, nothing written; 2 wrong usage; 3 refused (--max-error,
    --engine, --strict), nothing written; 70 a bug.
    """  # noqa: D301
    if output is None and options["frames_dir"] is None:
        raise click.UsageError("Missing option '-o' (or '--frames-dir').")
    if output is None and depfile is not None:
        raise click.UsageError("'--depfile' needs '-o'.")
    if output is not None and not output.lower().endswith((".glb", ".gltf")):
        raise click.BadParameter(f"{output!r} ends neither in .glb nor .gltf", param_hint="-o")
    with command_outputs() as outputs, Progress(quiet=quiet) as progress:
        from wrinklecli import bake as run
        from wrinklecli.baking.job import BakeOptions
        from wrinklecli.baking.report import as_json

        for path in (report, timings, depfile):
            if path is not None:
                outputs.claim(path)
        chosen = BakeOptions(details=report is not None, **options)
        made = run(asset, tools, output, chosen, outputs=outputs, progress=progress.show)
        if report is not None:
            outputs.add_bytes(report, as_json(made.data).encode())
        if timings is not None:
            outputs.add_bytes(timings, as_json(made.timings).encode())
        if depfile is not None and output is not None:
            outputs.add_bytes(depfile, dependencies(output, made.inputs))
    if quiet:
        return
    for note in made.notes:
        say(f"note: {note}")
    for warning in made.warnings:
        warn(warning)
    if verbose:
        for tool in made.data["tools"]:
            say(
                f"{tool['name']} on {tool['node']}: {tool['moved_vertices']} vertices,"
                f" targets {', '.join(tool['targets']) or 'none'}"
            )
    say(f"{output or options['frames_dir']}: {made.summary}")
