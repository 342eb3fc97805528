"""The options that several commands have, each declared once. Those whose help differs are functions of its text."""

import math
import re
from collections.abc import Callable
from typing import Any, get_args

import click

from wrinklecli.numeric.memory import MAX_VERTICES, held, parse_bytes

# Decorates a command's function, as `click.option(…)` does.
Option = Callable[[Callable[..., Any]], Callable[..., Any]]

# A file by name, which shells complete. The core says whether the file is there.
FILE = click.Path(readable=False)

_NUMBER = r"[+-]?(?:\d{1,9}(?:\.\d{0,9})?|\.\d{1,9})"
_TURN = re.compile(rf"(.+)=([xyz]):({_NUMBER})", re.IGNORECASE | re.DOTALL)
_WEIGHT = re.compile(rf"(.+)=({_NUMBER})", re.DOTALL)


def parsed(value: str, pattern: re.Pattern[str], parameter: click.Parameter, expected: str) -> tuple[str, ...]:
    """The groups of a pattern that the whole value must match.

    Raises:
        click.BadParameter: The value does not match.
    """
    found = pattern.fullmatch(value)
    if found is None:
        raise click.BadParameter(f"{value!r} is not {expected}", param=parameter)
    return found.groups()


def _turns(_context: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> tuple[Any, ...]:
    """Read names, axes and degrees. Names may hold `=` and `:`, as Mixamo's do."""
    found = [parsed(value, _TURN, parameter, "JOINT=AXIS:DEGREES, such as LeftLeg=x:90") for value in values]
    return tuple((name, axis.lower(), float(degrees)) for name, axis, degrees in found)


def _weights(_context: click.Context, parameter: click.Parameter, values: tuple[str, ...]) -> tuple[Any, ...]:
    """Read names and weights."""
    found = [parsed(value, _WEIGHT, parameter, "NAME=WEIGHT, such as browInnerUp=1") for value in values]
    return tuple((name, float(weight)) for name, weight in found)


def _memory(context: click.Context, parameter: click.Parameter, value: str) -> int:
    """Read a size in decimal units as bytes, and hold the process to it until the command ends."""
    try:
        size = parse_bytes(value)
    except ValueError as error:
        raise click.BadParameter(str(error), param=parameter) from error
    context.with_resource(held(size))
    return size


def _number(_context: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    """Refuse `nan`, which no range excludes."""
    if value is not None and math.isnan(value):
        raise click.BadParameter("'nan' is not a number", param=parameter)
    return value


def length(_context: click.Context, parameter: click.Parameter, value: str | None) -> Any:
    """Read a length in scene units, or per cent."""
    if value is None:
        return None
    from wrinklecli.tools.records import parse_length

    try:
        return parse_length(value)
    except ValueError as error:
        message = f"{value!r} is neither a length above 0 nor a percentage such as 1%"
        raise click.BadParameter(message, param=parameter) from error


def file(*names: str, text: str, metavar: str = "FILE", **more: Any) -> Option:
    """A file by name."""
    return click.option(*names, type=FILE, metavar=metavar, help=text, **more)


def choice(name: str, words: Any, text: str) -> Option:
    """One of the words of a Literal type; the first is the default."""
    values = get_args(words)
    return click.option(name, type=click.Choice(values), default=values[0], show_default=True, help=text)


def clip(text: str) -> Option:
    """`--clip`, names of clips: `clips`."""
    return click.option("--clip", "clips", metavar="NAME", multiple=True, help=text)


def tool(text: str) -> Option:
    """`--tool`, names of tools: `only`."""
    return click.option("--tool", "only", metavar="NAME", multiple=True, help=text)


def anim(text: str = "") -> Option:
    """`--anim`, files with clips: `anims`."""
    about = (
        "Take the clips of this file (glTF) too, for joints of the same names; may be repeated. A clip whose name is"
        " taken gets the file's."
    )
    return click.option("--anim", "anims", type=FILE, metavar="FILE", multiple=True, help=f"{about} {text}".rstrip())


def range_of_motion(text: str) -> Option:
    """`--range-of-motion`."""
    about = "Bend each joint about its axes and raise each morph target, one at a time, though ASSET has clips."
    return click.option("--range-of-motion", is_flag=True, help=f"{about} {text}")


def fps(text: str, default: float | None = None) -> Option:
    """`--fps`, frames per second."""
    shown = default is not None
    kind = click.FloatRange(0.1, 1000)
    return click.option("--fps", type=kind, default=default, show_default=shown, callback=_number, help=text)


def json(text: str) -> Option:
    """`--json`: `as_json`."""
    return click.option("--json", "as_json", is_flag=True, help=text)


def allow_external(text: str = "Read buffers and images outside the asset's folder too.") -> Option:
    """`--allow-external`."""
    return click.option("--allow-external", is_flag=True, help=text)


def quiet(text: str = "Print nothing but errors.") -> Option:
    """`-q`, `--quiet`."""
    return click.option("-q", "--quiet", is_flag=True, help=text)


def verbose(text: str = "Print a line for each tool.") -> Option:
    """`-v`, `--verbose`."""
    return click.option("-v", "--verbose", is_flag=True, help=text)


# Joints to turn: `pose`.
pose = click.option(
    "--pose",
    metavar="JOINT=AXIS:DEGREES",
    multiple=True,
    callback=_turns,
    help="In place of clips, turn this joint about its own axis, such as LeftLeg=x:90. May be repeated, and with"
    " --morph, for one pose.",
)
# Weights of morph targets: `morphs`.
morph = click.option(
    "--morph",
    "morphs",
    metavar="NAME=WEIGHT",
    multiple=True,
    callback=_weights,
    help="In place of clips, give this morph target a weight, such as browInnerUp=1. May be repeated, and with"
    " --pose, for one pose.",
)
max_levels = click.option(
    "--max-levels", type=click.IntRange(0, 8), help="Overrides refinement.max_levels; 0 does not refine."
)
# Bytes; the process is held to them while the command runs.
max_memory = click.option(
    "--max-memory",
    metavar="SIZE",
    default="1GB",
    show_default=True,
    callback=_memory,
    help="Refuse what would take more memory, such as 500MB or 4GB.",
)
max_vertices = click.option(
    "--max-vertices",
    type=click.IntRange(0, 100_000_000),
    default=MAX_VERTICES,
    show_default=True,
    help="Refuse tools that would add more vertices to a mesh.",
)
strict = click.option("--strict", is_flag=True, help="Treat warnings as refusals (exit code 3).")
