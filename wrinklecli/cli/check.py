"""`wrinkle check`."""

from typing import Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, emit, emit_json, warn
from wrinklecli.cli.streams import command_outputs
from wrinklecli.errors import aligned, counted, refuse_warnings

_MOST_PLACES = 8  # of a clip, with the most crossings; the others are summed


@click.command(
    short_help="Say what each tool would do; bake nothing.",
    epilog="Example: wrinkle check samples/trousers.glb configs/trousers.yaml --clip squat --plot knees.svg",
)
@click.argument("asset", type=opt.FILE)
@click.argument("tools", type=opt.FILE, required=False)
@opt.anim()
@opt.range_of_motion("Check these motions too.")
@opt.pose
@opt.morph
@opt.clip("Look at this clip only; may be repeated.")
@opt.tool("Look at this tool only; may be repeated.")
@opt.fps("Frames per second; overrides sampling.fps (30).")
@opt.max_levels
@opt.max_vertices
@opt.allow_external()
@opt.max_memory
@opt.file("--plot", metavar="FILE.png|svg", text="Draw control curves, and heights over each clip.")
@opt.flag(
    "--crossings",
    text="Count the edges that pass through triangles instead, in 13 moments of each clip or --fps of them a second.",
)
@opt.json("Print JSON instead of tables.")
@opt.progress
@opt.verbose("Print a table for each tool.")
@opt.strict
def check(
    asset: str,
    tools: str | None,
    plot: str | None,
    crossings: bool,
    as_json: bool,
    progress: bool,
    verbose: bool,
    strict: bool,
    **options: Any,
) -> None:
    """Say what the tools of TOOLS (YAML) would do to ASSET (glTF), and what is wrong with them, without a bake.

    Each tool has a row: it is good, or what to look at. With -v, each has a table in place of that. The table has the
    anchors and their distance from the points asked for, its lengths, the triangles under it, the edges that a bake
    would split, and the vertices that it would move. For each clip it has the range of shortening (negative where the
    tool is stretched), the time of the greatest, and the height reached.

    An asset without clips is checked in its range of motion: each joint bent about its axes, each morph target raised.
    The table of a tool then has the motions that shorten it most.

    --crossings needs no TOOLS. It says where and when surfaces of the scene go through themselves or each other,
    without wrinkles, and with those of TOOLS or those that ASSET has. Skinning alone makes some crossings. Edges that
    refinement has split, and that no wrinkle moves, count as before. Where wrinkles move them, refinement alone makes
    more of each crossing, so a clip has the number on the refined surface without wrinkles, too. A baked file that
    `wrinkle track` or other software has rewritten is only counted as it is.

    Exit codes: 0 done; 1 the input is at fault; 2 wrong usage; 3 refused (--strict with warnings), no picture
    written; 70 a bug.
    """
    if options["clips"] and (options["pose"] or options["morphs"]):
        raise click.UsageError("'--pose' and '--morph' are one pose: they go without '--clip'.")
    if plot is not None and not plot.lower().endswith((".png", ".svg")):
        raise click.BadParameter(f"{plot!r} ends neither in .png nor .svg", param_hint="--plot")
    if crossings:
        if plot is not None:
            raise click.UsageError("'--plot' draws tools: it goes without '--crossings'.")
        from wrinklecli.review.crossings import crossings as count_crossings

        with Progress(lines=progress) as shown:
            found = count_crossings(asset, tools, progress=shown.show, **options)
        if as_json:
            emit_json(found.data)
        else:
            _emit_counts(found.data)
            for warning in found.warnings:
                warn(warning)
        if strict:
            refuse_warnings(found.warnings, where=tools or asset, shown=True)
        return
    if tools is None:
        raise click.UsageError("Missing argument 'TOOLS'; '--crossings' alone goes without.")

    with command_outputs() as outputs:
        from wrinklecli.gltf.files import files_named
        from wrinklecli.review.check import check as run
        from wrinklecli.review.plot import draw_check, refuse_without_matplotlib
        from wrinklecli.tools.files_beside import with_files_beside

        if plot is not None:
            refuse_without_matplotlib()
            outputs.claim(plot)
        outputs.protect([*with_files_beside([tools]), *files_named([asset, *options["anims"]])])
        with Progress(lines=progress) as shown:
            made = run(asset, tools, progress=shown.show, **options)
        if as_json:
            emit_json(made.data)
        else:
            _emit_tables(made.data, verbose=verbose)
        if strict:
            refuse_warnings(made.warnings, where=tools, shown=True)
        if plot is not None:
            outputs.add_bytes(plot, draw_check(made, plot.lower().rpartition(".")[2]))


def _emit_tables(data: dict[str, Any], *, verbose: bool) -> None:
    for note in data["notes"]:
        emit(f"note: {note}")
        emit("")
    from wrinklecli.choices import EFFECTS
    from wrinklecli.effects.plan import kind_of

    effects = [(kind_of(section), effect) for section in EFFECTS for effect in data.get(section, ())]
    rows = [
        [effect["name"], effect["node"], line.removeprefix(f"{effect['name']}: ")]
        for _, effect in effects
        for line in effect["warnings"] or ["good"]
    ]
    for (*_, found), line in zip(rows, aligned(rows, texts=3) if rows else (), strict=True) if not verbose else ():
        emit(line, style={} if found == "good" else {"fg": "yellow"})
    for kind, effect in effects if verbose else ():
        emit(f"{effect['name']} on {effect['node']}", style={"bold": True})
        for line in kind.lines(effect):
            emit(f"  {line}")
        for warning in effect["warnings"]:
            _emit_warning(warning)
        emit("")
    for mesh in data["meshes"]:
        emit(
            f"{mesh['node']}: {mesh['vertices']} vertices + {mesh['new_vertices']}, {mesh['triangles']} triangles"
            f" + {mesh['new_triangles']}, {counted(mesh['levels'], 'level')} of refinement"
        )
    for warning in data["warnings"]:
        if not any(warning in effect["warnings"] for _, effect in effects):
            _emit_warning(warning)


def _emit_warning(warning: str) -> None:
    emit(f"warning: {warning}", style={"fg": "yellow"})


def _emit_counts(data: dict[str, Any]) -> None:
    emit(f"stored pose: {_changed(data['stored_pose'])}")
    for clip in data["clips"]:
        level = "" if clip["level"] is None else f" ({sum(clip['level']):,} on the refined surface without wrinkles)"
        moments = counted(len(clip["times"]), "moment")
        emit(f"{clip['name']}: {_changed(clip['totals'])}{level} in {moments}{_most(clip)}")
        shown, others = clip["places"][:_MOST_PLACES], clip["places"][_MOST_PLACES:]
        for place in shown:
            at = ", ".join(f"{x:.3g}" for x in place["at"])
            emit(f"  {_changed(place['counts'])} between {place['between']}, about [{at}] in the stored pose")
        if others:
            rest = [total - sum(place["counts"][k] for place in shown) for k, total in enumerate(clip["totals"])]
            emit(f"  {_changed(rest)} elsewhere")


def _changed(counts: list[int]) -> str:
    return " -> ".join(f"{count:,}" for count in counts)


def _most(clip: dict[str, Any]) -> str:
    """The moment in which the last state has the most crossings."""
    counts = clip["counts"][-1]
    if not any(counts):
        return ""
    most = max(range(len(counts)), key=counts.__getitem__)
    return f", most at {clip['times'][most]:.3g} s ({_changed([each[most] for each in clip['counts']])})"
