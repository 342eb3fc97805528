"""`wrinkle check`."""

import math
from collections.abc import Sequence
from typing import Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, aligned, emit, emit_json, warn
from wrinklecli.cli.streams import command_outputs
from wrinklecli.errors import RefusedError, counted

_MOST_PLACES = 8  # of a clip, with the most crossings; the others are summed


@click.command(
    short_help="Say what each tool would do; bake nothing.",
    epilog="Example: wrinkle check samples/trousers.glb configs/trousers.yaml --clip squat --plot knees.svg",
)
@click.argument("asset", type=opt.FILE)
@click.argument("tools", type=opt.FILE, required=False)
@opt.anim()
@opt.range_of_motion("Look at that too.")
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
@opt.strict
def check(
    asset: str, tools: str | None, plot: str | None, crossings: bool, as_json: bool, strict: bool, **options: Any
) -> None:
    """Say what the tools of TOOLS (YAML) would do to ASSET (glTF), and what is wrong with them. Bakes nothing.

    The table of a tool has the anchors and their distance from the points asked for, its lengths, the triangles
    under it, the edges that a bake would split, and the vertices that it would move. For each clip it has the range of
    shortening (negative where the tool is stretched), the time of the greatest, and the height reached.

    An asset without clips is checked in its range of motion: each joint bent about its axes, each morph target raised.
    The table of a tool then has the motions that shorten it most.

    --crossings needs no TOOLS. It says where and when surfaces of the scene go through themselves or each other,
    without wrinkles, and with those of TOOLS or those that ASSET has. Skinning alone makes some crossings. Edges that
    refinement has split, and that no wrinkle moves, count as before. A baked file that `wrinkle track` or other
    software has rewritten is only counted as it is.

    --json prints {"check": 1, "asset", "tools_file", "meshes", "tools", "notes", "warnings"}, and "muscles", "flesh"
    and "touches" where there are any; within version 1, keys are only added. Lengths are scene units, positions have
    the tools file's axes, shortenings are shares of the rest length. With --crossings it prints {"crossings": 1,
    "asset", "tools_file", "states", "stored_pose", "clips", "warnings"}: counts are a number for each state, or a list
    of them for the times of a clip.

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
        _emit_crossings(asset, tools, as_json=as_json, strict=strict, **options)
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
        with Progress() as progress:
            made = run(asset, tools, progress=progress.show, **options)
        if as_json:
            emit_json(made.data)
        else:
            _emit_tables(made.data)
        if strict:
            _refuse(made.warnings, tools)
        if plot is not None:
            outputs.add_bytes(plot, draw_check(made, plot.lower().rpartition(".")[2]))


def _emit_tables(data: dict[str, Any]) -> None:
    for note in data["notes"]:
        emit(f"note: {note}")
        emit("")
    below = [
        *((each, _muscle_rows) for each in data.get("muscles", ())),
        *((each, _flesh_rows) for each in data.get("flesh", ())),
        *((each, _touch_rows) for each in data.get("touches", ())),
    ]
    for effect, rows in below:
        emit(f"{effect['name']} on {effect['node']}", style={"bold": True})
        for line in rows(effect):
            emit(f"  {line}")
        for warning in effect["warnings"]:
            _emit_warning(warning)
        emit("")
    for tool in data["tools"]:
        emit(f"{tool['name']} on {tool['node']}", style={"bold": True})
        for line in _rows(tool):
            emit(f"  {line}")
        for warning in tool["warnings"]:
            _emit_warning(warning)
        emit("")
    for mesh in data["meshes"]:
        emit(
            f"{mesh['node']}: {mesh['vertices']} vertices + {mesh['new_vertices']}, {mesh['triangles']} triangles"
            f" + {mesh['new_triangles']}, {counted(mesh['levels'], 'level')} of refinement"
        )
    for warning in data["warnings"]:
        if not any(warning in each["warnings"] for each in (*(effect for effect, _ in below), *data["tools"])):
            _emit_warning(warning)


def _emit_warning(warning: str) -> None:
    emit(f"warning: {warning}", style={"fg": "yellow"})


def _flesh_rows(region: dict[str, Any]) -> list[str]:
    """The lines of a region of flesh, and a table of its clips."""
    width = max((len(each["name"]) for each in region["clips"]), default=0)
    return [
        f"joint    {region['joint']}",
        f"springs  {', '.join(f'{each:.3g}' for each in region['frequencies'])} Hz, of {region['elements']:,} elements",
        f"mesh     {region['moved_vertices']} vertices move, by about {region['limit']:.3g} at most",
        *(
            f"{each['name']:{width}}  moves by up to {each['largest_move']:.3g}"
            + (f", {each['seconds_at_limit']:.2g} s at the limit" if each["seconds_at_limit"] else "")
            for each in region["clips"]
        ),
    ]


def _touch_rows(touch: dict[str, Any]) -> list[str]:
    """The lines of a touch, and a table of its clips."""
    from wrinklecli.effects.touch.attach import FOLDED

    width = max((len(each["name"]) for each in touch["clips"]), default=0)
    rings = [f"{each:.3g}" for each in touch.get("ring_heights", ())]
    return [
        f"joints   {', '.join(touch['joints'])}",
        f"slide    up to {touch['grip']:.3g}, with a strain of {touch['strain']:.2f}; below {FOLDED} it looks folded",
        *(
            [f"rings    {', '.join(rings)} high from the pad outwards, {counted(touch['directions'], 'direction')}"]
            if rings
            else []
        ),
        f"mesh     {touch['moved_vertices']} vertices move",
        *(
            f"{each['name']:{width}}  from {each['times'][0]:.4g} to {each['times'][1]:.4g} s: slides by up to"
            f" {each['largest_slide']:.3g}, strain {each['strain']:.2f}"
            + (f", rings {each['height']:.3g} high" if rings else "")
            + (f", dented by {each['depth']:.3g}" if each["depth"] else "")
            + (f"; slips, as {each['asked_slide']:.3g} is asked" if each["asked_slide"] > each["largest_slide"] else "")
            for each in touch["clips"]
        ),
    ]


def _muscle_rows(muscle: dict[str, Any]) -> list[str]:
    """The lines of a muscle, and a table of its clips."""
    table = [
        (
            each["name"],
            *(f"{100 * end:.3g}" for end in each["length"]),
            f"{each['bulge'][1]:.3g}",
            each["volume_gained"],
        )
        for each in muscle["clips"]
    ]
    width = max((len(name) for name, *_ in table), default=0)
    return [
        f"ends     {muscle['origin']} to {muscle['insertion']}, along {muscle['bone']}",
        f"length   {muscle['length']:.4g} at rest, of which tendons {muscle['tendons']:.4g}",
        f"belly    {muscle['thickness']:.4g} thick, {muscle['width']:.4g} wide,"
        f" {muscle['depth']:.4g} from the bone to the skin",
        f"mesh     {muscle['moved_vertices']} vertices move, by at most {muscle['height_limit']:.3g}",
        *(
            f"{name:{width}}  {low} to {high} % long, bulges by up to {bulge}, skin gains {volume:.3g} of volume"
            for name, low, high, bulge, volume in table
        ),
    ]


def _rows(tool: dict[str, Any]) -> list[str]:
    """The lines of a tool's table."""
    overlaps = ", ".join(f"{each['tool']} ({each['vertices']} vertices)" for each in tool["overlaps"])
    overlaps += ", and more" if tool.get("more_overlaps") else ""
    length = f"{tool['distance']:.4g} at rest"
    if tool["rest_length"] != tool["distance"]:
        length += f", shortening counts from {tool['rest_length']:.4g}"
    rows = [
        f"origin   {_anchor(tool['origin'])}",
        *(f"path[{k}]  {_anchor(each)}" for k, each in enumerate(tool.get("between", []), start=1)),
        f"target   {_anchor(tool['target'])}",
        f"length   {length}; width {tool['width']:.4g}",
        f"laid     {_pose(tool['laid'])}",
        f"bumps    {tool['bumps']}, {tool['strategy']}, at most {tool['height_limit']:.3g} tall",
        f"tissue   {_tissue(tool)}",
        f"mesh     {tool['triangles']} triangles, {tool['edges_split']} edges to split;"
        f" {tool['moved_vertices']} vertices move",
        *(
            [f"stops    at features, which leave {_percent(100 * tool['left_by_features'])} % of the wrinkles"]
            if "left_by_features" in tool
            else []
        ),
        *([f"mask     leaves {_percent(100 * tool['mask'])} % of the patch"] if "mask" in tool else []),
        f"at rest  {_rounding(tool)}",
        f"overlaps {overlaps or 'none'}",
    ]
    return [*rows, *(_clip_table(tool["clips"]) if tool["clips"] else ["clips    none that moves the mesh"])]


def _pose(laid: Any) -> str:
    """The pose in which crests are straight."""
    if laid == "stored":
        return "at rest"
    if "clip" in laid:
        return f"{laid['clip']} at {laid['time']:.4g} s"
    return ", ".join(f"{name} at {weight:.3g}" for name, weight in laid["raised"].items())


def _rounding(tool: dict[str, Any]) -> str:
    """The change of the surface at rest that refinement makes."""
    departure, hard = _percent(100 * tool["departure"]), _percent(100 * tool["hard_edges"])
    rounded = f"rounded by up to {departure} % of the tallest wrinkle" if tool["departure"] else "as it was"
    return f"{rounded}; {hard} % of the edges are hard" if tool["hard_edges"] else rounded


def _tissue(tool: dict[str, Any]) -> str:
    """The share of each shortening that makes no wrinkles, and the share at which bumps are just full."""
    fitting = math.ceil(100 * tool["fitting_compressible"])
    if not tool["clips"]:
        would = ""
    elif fitting:
        would = f"; with compressible: {fitting}% all bumps are just full at the greatest"
    else:
        would = "; no clip has all bumps full"
    material = "" if tool["material"] == "none" else f"{tool['material']}, "
    lag = tool["lag"]
    late = f"; lags, {lag['frequency']:g} swings a second, damping {lag['damping']:g}" if lag else ""
    return f"{material}takes {100 * tool['compressible']:.3g} % of each shortening{would}{late}"


def _clip_table(clips: list[dict[str, Any]]) -> list[str]:
    """An aligned table with a heading and a line for each clip."""
    table = [["clip", "shortening", "at", "height", "unabsorbed"]]
    for clip in clips:
        if clip["shortening"] is None:
            table.append([clip["name"], "hidden", "", "", ""])
            continue
        low, high = (100 * each for each in clip["shortening"])
        table.append(
            [
                clip["name"],
                f"{_percent(low)} to {_percent(high)} %",
                f"{clip['time']:.3g} s",
                f"{clip['height']:.3g}" if clip["height"] else "-",
                f"{_percent(100 * clip['unabsorbed'])} %" if clip["unabsorbed"] else "-",
            ]
        )
    return aligned(table, texts=1)


def _percent(value: float) -> str:
    """Two digits at least, and no more than matter."""
    return "0" if abs(value) < 0.005 else f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"


def _anchor(anchor: dict[str, Any]) -> str:
    at = ", ".join(f"{x:.4g}" for x in anchor["position"])
    primitive = f" of primitive {anchor['primitive']}" if anchor["primitive"] else ""
    return f"[{at}], {anchor['off']:.2g} from the point asked for, by vertex {anchor['vertex']}{primitive}"


def _emit_crossings(asset: str, tools: str | None, *, as_json: bool, strict: bool, **options: Any) -> None:
    """Count what crosses, and print it."""
    from wrinklecli.review.crossings import crossings

    with Progress() as progress:
        found = crossings(asset, tools, progress=progress.show, **options)
    if as_json:
        emit_json(found.data)
    else:
        _emit_counts(found.data)
        for warning in found.warnings:
            warn(warning)
    if strict:
        _refuse(found.warnings, tools or asset)


def _emit_counts(data: dict[str, Any]) -> None:
    emit(f"stored pose: {_changed(data['stored_pose'])}")
    for clip in data["clips"]:
        emit(f"{clip['name']}: {_changed(clip['totals'])} in {counted(len(clip['times']), 'moment')}{_most(clip)}")
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


def _refuse(warnings: Sequence[str], where: str) -> None:
    """Refuse if there are warnings.

    Raises:
        RefusedError: There is one.
    """
    if warnings:
        raise RefusedError(f"refused by --strict: {counted(len(warnings), 'warning')}", where=where)
