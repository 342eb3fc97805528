"""`wrinkle preview`."""

import math
import re
import time
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, emit_json, say, say_findings
from wrinklecli.cli.streams import command_outputs, job_outputs
from wrinklecli.errors import WrinkleError
from wrinklecli.files.inputs import Watched
from wrinklecli.files.outputs import Outputs
from wrinklecli.review.preview.preview_options import MOST_SIDE, PreviewOptions, Style

if TYPE_CHECKING:
    from wrinklecli.review.preview.preview import Preview

_LOOKS = 0.3  # seconds between two checks of the watched files
_LEAST_SIDE = 16  # pixels of a picture's width or height


def _numbers(value: str | None) -> tuple[float, ...]:
    """Numbers between commas."""
    try:
        found = tuple(float(part) for part in value.split(",")) if value is not None else ()
    except ValueError:
        found = (math.nan,)
    if not all(map(math.isfinite, found)):
        raise ValueError(f"{value!r} is not numbers between commas, such as 0,0.5")
    return found


def _point(value: str | None) -> tuple[float, ...] | None:
    found = _numbers(value)
    if value is not None and len(found) != 3:
        raise ValueError(f"{value!r} has {len(found)} numbers, not 3")
    return found or None


def _words(value: str | None) -> tuple[str, ...]:
    """Text between commas."""
    return tuple(value.split(",")) if value else ()


def _views(value: str | None) -> tuple[str, ...]:
    names = _words(value)
    if names:
        from wrinklecli.review.preview.camera import FACING, parse_view

        for name in names:
            if name != FACING:
                parse_view(name)
    return names


def _size(value: str | None) -> tuple[int, int] | None:
    if value is None:
        return None
    found = re.fullmatch(r"(\d{1,6})x(\d{1,6})", value)
    size = (int(found[1]), int(found[2])) if found else (0, 0)
    if not all(_LEAST_SIDE <= side <= MOST_SIDE for side in size):
        raise ValueError(f"{value!r} is not WIDTHxHEIGHT, such as 800x600, of {_LEAST_SIDE} to {MOST_SIDE} pixels")
    return size


def _above_0(value: float | None) -> float | None:
    if value is not None and not 0 < value < math.inf:
        raise ValueError(f"{value!r} is not a length above 0")
    return value


@click.command(
    short_help="Draw an asset, baked or not.",
    epilog="Example: wrinkle preview samples/trousers.glb --tools configs/trousers.yaml --before -o sheet.png",
)
@click.argument("assets", type=opt.FILE, metavar="ASSET [ASSET2]", nargs=-1, required=True)
@opt.file("-o", "--output", metavar="OUT", required=True, text="A .png: a sheet. A .webp or .gif: an animation.")
@opt.file("--tools", metavar="TOOLS", text="Apply these tools (YAML) without a bake, and draw them.")
@opt.tool("Only this tool, of TOOLS or of a baked ASSET, at its own moments; may be repeated.")
@opt.flag(
    "--review",
    text="Show every tool close up, before and after, at its peak. A sheet does so by default if there are several"
    " tools or clips, unless other options name what to show: --clip, --rest, --times, --frames, --fps, --views,"
    " --focus, --follow, --labels, --grid.",
)
@opt.flag("--before", text="Show ASSET without the tools beside it.")
@opt.flag("--hide-tools", text="Apply the tools, but do not draw them.")
@opt.flag("--heat", text="Colour the surface by its compression against the stored pose.")
@opt.anim()
@opt.range_of_motion("Without clips this is the default, and six motions are shown.")
@opt.pose
@opt.morph
@opt.clip("Default: the first clip. May be repeated.")
@opt.flag("--rest", text="Show the pose as stored, and no clip.")
@opt.valued(
    "--times",
    metavar="S,S…",
    read=_numbers,
    text="Moments in seconds. Default: 5 of a clip; of an animation, all of it.",
)
@opt.whole("--frames", bounds=(1, 10_000), text="The number of moments of each clip, evenly spaced.")
@opt.fps("Moments per second; of an animation 15.")
@opt.valued(
    "--views",
    metavar="VIEW,VIEW…",
    read=_views,
    text="front, right, back, left, top, bottom, oblique, facing (the wrinkles' side; the default if there are"
    " any) or AZIMUTH:ELEVATION in degrees: 0:0 is the front, 90:0 the side of +x.",
)
@opt.valued("--focus", metavar="X,Y,Z", read=_point, text="Look at this point. Default: the wrinkles, or all.")
@opt.valued("--radius", type=float, read=_above_0, metavar="R", text="See this far around it, scene units.")
@opt.flag(
    "--follow",
    text="The camera moves with what it looks at, as it does with a body that goes further than its own size; a --focus"
    " is then a point of the stored pose.",
)
@opt.valued(
    "--size",
    metavar="WxH",
    read=_size,
    text="The size of each picture. Default: 800x600, or a size that fits a review.",
)
@opt.whole("--columns", bounds=(1, 1000), text="Moments in a row of a sheet.")
@opt.valued("--labels", metavar="A,B", read=_words, text="A label for each asset, or for before and after.")
@opt.flag(
    "--grid",
    text="Draw axes, a ruler in scene units and the names of joints, to read coordinates for a tools file off the"
    " picture. Default: the pose as stored, from front, right and top.",
)
@opt.flag("--wire", text="Draw the triangles' edges.")
@opt.flag("--clay", text="Draw in grey, whatever the materials say.")
@opt.flag("--backfaces", text="Paint triangles seen from behind red.")
@opt.flag("--watch", text="Draw again whenever ASSET or TOOLS has changed, until Ctrl-C.")
@opt.allow_external()
@opt.max_memory
@opt.max_vertices
@opt.json()
@opt.quiet()
def preview(
    assets: tuple[str, ...],
    output: str,
    wire: bool,
    clay: bool,
    backfaces: bool,
    watch: bool,
    as_json: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Draw ASSET (glTF), baked or not: its tools in review, a sheet over time, or an animation.

    Two assets are shown side by side, at the same moments and from the same places. The camera looks at the wrinkles,
    if there are any. Tools are drawn as their patch, the crests of their wrinkles, and their segment, from a dot at
    the origin to a ring at the target; muscles, flesh and touches as a line round the skin that they move. The command
    needs no display, but Pillow and embreex: pip install 'wrinklecli[preview]'.

    Exit codes: 0 done; 1 the input is at fault, nothing written; 2 wrong usage; 70 a bug.
    """
    _refuse_misuse(assets, output, options)
    if watch and as_json:
        raise click.UsageError("'--watch' draws again and again: it goes without '--json'.")
    style = Style(wire=wire, clay=clay, backfaces=backfaces)
    if not watch:
        with command_outputs() as outputs:
            made = _drawn(assets, output, style, options, outputs, quiet=quiet)
            if as_json:
                emit_json({"preview": 1, "assets": list(assets), **asdict(made)})
        if not (quiet or as_json):
            _say_drawn(made)
        return
    watched = Watched([*assets, *options["anims"], *([] if options["tools"] is None else [options["tools"]])])
    while True:
        try:
            with job_outputs() as outputs:
                made = _drawn(assets, output, style, options, outputs, quiet=quiet)
            if not quiet:
                _say_drawn(made)
        except WrinkleError as error:
            for line in error.lines:
                say(line)
        if not quiet:
            say("watches for changes; Ctrl-C ends it")
        while not watched.changed():
            time.sleep(_LOOKS)


def _drawn(
    assets: tuple[str, ...], output: str, style: Style, options: dict[str, Any], outputs: Outputs, *, quiet: bool
) -> "Preview":
    """Draw the picture."""
    with Progress(quiet=quiet) as progress:
        from wrinklecli.numeric.guard import guarded

        with guarded(assets[0]):  # the modules alone may take more memory than there is
            from wrinklecli.review.preview.preview import preview as run

        chosen = PreviewOptions(**options, style=style)
        return run(assets, output, chosen, outputs=outputs, progress=progress.show)


def _say_drawn(made: "Preview") -> None:
    """Say what is in the picture."""
    say_findings(made.notes, made.warnings)
    say(f"{made.path}: {made.summary}")


def _refuse_misuse(assets: tuple[str, ...], output: str, options: dict[str, Any]) -> None:
    """Refuse options that do not go together."""
    if not output.lower().endswith((".png", ".webp", ".gif")):
        raise click.BadParameter(f"{output!r} ends in none of .png, .webp, .gif", param_hint="-o")
    if len(assets) > 2:
        raise click.UsageError(f"{len(assets)} assets were given; at most two are shown side by side.")
    if options["tools"] is not None and len(assets) > 1:
        raise click.UsageError("'--tools' takes one ASSET; '--before' shows it without the tools too.")
    if options["tools"] is None:
        _refuse_any(options, ("before", "hide_tools"), "{} needs '--tools'.")
    if options["review"]:
        if len(assets) > 1 or not output.lower().endswith(".png"):
            raise click.UsageError("'--review' makes a sheet (.png) of one ASSET.")
        message = "'--review' finds each tool's moment and place: it goes without {}."
        _refuse_any(options, ("rest", "times", "frames", "fps", "focus", "radius", "follow"), message)
    if options["rest"] and (options["clips"] or options["times"] or options["frames"] or options["fps"]):
        raise click.UsageError("'--rest' is one moment: it goes without '--clip', '--times', '--frames' and '--fps'.")
    if options["pose"] or options["morphs"]:
        message = "'--pose' and '--morph' are one pose: they go without {}."
        _refuse_any(options, ("clips", "rest", "times", "frames", "fps"), message)
    if options["times"] and options["frames"]:
        raise click.UsageError("'--times' and '--frames' exclude each other.")
    if options["focus"] is not None and options["radius"] is None:
        raise click.UsageError("'--focus' needs '--radius'.")
    count = 2 if options["before"] or options["review"] else len(assets)
    if options["labels"] and len(options["labels"]) != count:
        raise click.UsageError(f"'--labels' has {len(options['labels'])}, not {count}.")


def _refuse_any(options: dict[str, Any], keys: Sequence[str], message: str) -> None:
    """Refuse the first of some options that is given; its name takes the place of `{}` in the message."""
    for key in keys:
        if options[key]:
            name = "clip" if key == "clips" else key.replace("_", "-")
            raise click.UsageError(message.format(f"'--{name}'"))
