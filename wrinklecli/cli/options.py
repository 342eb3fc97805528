"""The options that several commands have, each declared once."""

import math
import re
from collections.abc import Callable
from typing import Any

import click

from wrinklecli.numeric.memory import held, parse_bytes
from wrinklecli.tools.records import MAX_VERTICES

# Decorates a command's function, as `click.option(…)` does.
Option = Callable[[Callable[..., Any]], Callable[..., Any]]

# A file by name, which shells complete; whether it is there is for the core to say.
FILE = click.Path(readable=False)

_NUMBER = r"[+-]?(?:\d{1,9}(?:\.\d{0,9})?|\.\d{1,9})"


def clip_option(text: str) -> Option:
    """`--clip`, the names of clips: `clips`."""
    return click.option("--clip", "clips", metavar="NAME", multiple=True, help=text)


def anim_option(text: str) -> Option:
    """`--anim`, files with clips: `anims`."""
    about = (
        "Take the clips of this file (glTF) too, for joints of the same names; may be repeated. A clip whose name is"
        " taken gets the file's."
    )
    return click.option("--anim", "anims", type=FILE, metavar="FILE", multiple=True, help=f"{about} {text}".rstrip())


def range_of_motion_option(text: str) -> Option:
    """`--range-of-motion`."""
    about = "Bend each joint about its axes and raise each morph target, one at a time, though ASSET has clips."
    return click.option("--range-of-motion", is_flag=True, help=f"{about} {text}")


def pose_option() -> Option:
    """`--pose`, joints turned: `pose`."""
    return click.option(
        "--pose",
        metavar="JOINT=AXIS:DEGREES",
        multiple=True,
        callback=_turns,
        help="In place of clips, turn this joint about its own axis, such as LeftLeg=x:90. May be repeated, and with"
        " --morph, for one pose.",
    )


def morph_option() -> Option:
    """`--morph`, weights of morph targets: `morphs`."""
    return click.option(
        "--morph",
        "morphs",
        metavar="NAME=WEIGHT",
        multiple=True,
        callback=_weights,
        help="In place of clips, give this morph target a weight, such as browInnerUp=1. May be repeated, and with"
        " --pose, for one pose.",
    )


def _turns(
    _context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> tuple[tuple[str, str, float], ...]:
    """Names, axes and degrees. Names may hold `=` and `:`, as Mixamo's do."""
    found = [re.fullmatch(rf"(.+)=([xyz]):({_NUMBER})", value, re.IGNORECASE | re.DOTALL) for value in values]
    for value, each in zip(values, found, strict=True):
        if each is None:
            raise click.BadParameter(f"{value!r} is not JOINT=AXIS:DEGREES, such as LeftLeg=x:90", param=parameter)
    return tuple((each[1], each[2].lower(), float(each[3])) for each in found if each is not None)


def _weights(
    _context: click.Context, parameter: click.Parameter, values: tuple[str, ...]
) -> tuple[tuple[str, float], ...]:
    """Names and weights."""
    found = [re.fullmatch(rf"(.+)=({_NUMBER})", value, re.DOTALL) for value in values]
    for value, each in zip(values, found, strict=True):
        if each is None:
            raise click.BadParameter(f"{value!r} is not NAME=WEIGHT, such as browInnerUp=1", param=parameter)
    return tuple((each[1], float(each[2])) for each in found if each is not None)


def tool_option(text: str) -> Option:
    """`--tool`, the names of tools: `only`."""
    return click.option("--tool", "only", metavar="NAME", multiple=True, help=text)


def fps_option(text: str, *, default: float | None = None) -> Option:
    """`--fps`, frames per second."""
    return click.option(
        "--fps",
        type=click.FloatRange(0.1, 1000),
        default=default,
        show_default=default is not None,
        callback=_number,
        help=text,
    )


def max_levels_option() -> Option:
    """`--max-levels`, in place of the tools file's."""
    text = "Overrides refinement.max_levels; 0 does not refine."
    return click.option("--max-levels", type=click.IntRange(0, 8), help=text)


def allow_external_option(
    text: str = "Read buffers and images outside the asset's folder too.",
) -> Option:
    """`--allow-external`."""
    return click.option("--allow-external", is_flag=True, help=text)


def max_memory_option() -> Option:
    """`--max-memory`, bytes; the process is held to it while the command runs."""
    return click.option(
        "--max-memory",
        metavar="SIZE",
        default="1GB",
        show_default=True,
        callback=_memory,
        help="Refuse what would take more memory, such as 500MB or 4GB.",
    )


def max_vertices_option() -> Option:
    """`--max-vertices`, of refinement."""
    return click.option(
        "--max-vertices",
        type=click.IntRange(0, 100_000_000),
        default=MAX_VERTICES,
        show_default=True,
        help="Refuse tools that would add more vertices to a mesh.",
    )


def json_option(text: str) -> Option:
    """`--json`: `as_json`."""
    return click.option("--json", "as_json", is_flag=True, help=text)


def strict_option() -> Option:
    """`--strict`."""
    return click.option("--strict", is_flag=True, help="Treat warnings as refusals (exit code 3).")


def quiet_option(text: str = "Print nothing but errors.") -> Option:
    """`-q`, `--quiet`."""
    return click.option("-q", "--quiet", is_flag=True, help=text)


def verbose_option(text: str = "Print a line for each tool.") -> Option:
    """`-v`, `--verbose`."""
    return click.option("-v", "--verbose", is_flag=True, help=text)


def length(_context: click.Context, parameter: click.Parameter, value: str | None) -> Any:
    """A length in scene units, or per cent."""
    if value is None:
        return None
    from wrinklecli.tools.records import parse_length

    try:
        return parse_length(value)
    except ValueError as error:
        message = f"{value!r} is neither a length above 0 nor a percentage such as 1%"
        raise click.BadParameter(message, param=parameter) from error


def _memory(context: click.Context, parameter: click.Parameter, value: str) -> int:
    """A size in bytes, decimal units; until the command ends, the process cannot take more."""
    try:
        size = parse_bytes(value)
    except ValueError as error:
        raise click.BadParameter(str(error), param=parameter) from error
    context.with_resource(held(size))
    return size


def _number(_context: click.Context, parameter: click.Parameter, value: float | None) -> float | None:
    """A number: `nan` is in no range and outside none."""
    if value is not None and math.isnan(value):
        raise click.BadParameter("'nan' is not a number", param=parameter)
    return value
