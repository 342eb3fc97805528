"""The options that several commands have, each declared once. Those whose help differs are functions of its text."""

import math
import re
from collections.abc import Callable
from typing import Any, get_args

import click

from wrinklecli.choices import MAX_LEVELS
from wrinklecli.numeric.memory import MAX_MEMORY, MAX_VERTICES, default_memory, held, parse_bytes

# Decorates a command's function, as `click.option(…)` does.
Option = Callable[[Callable[..., Any]], Callable[..., Any]]


class _Path(click.Path):
    """A path, which is not empty: an empty one would mean the current folder, or a default."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Refuse an empty path."""
        if value == "":
            self.fail("the path is empty", param, ctx)
        return super().convert(value, param, ctx)


# A file or folder by name, which shells complete. The core says whether it is there.
FILE = _Path(readable=False)

_NUMBER = r"[+-]?(?:\d{1,9}(?:\.\d{0,9})?|\.\d{1,9})"
_TURN = re.compile(rf"(.+)=([xyz]):({_NUMBER})", re.IGNORECASE | re.DOTALL)
_WEIGHT = re.compile(rf"(.+)=({_NUMBER})", re.DOTALL)


def parsed(value: str, pattern: re.Pattern[str], expected: str) -> tuple[str, ...]:
    """The groups of a pattern that the whole value must match.

    Raises:
        ValueError: The value does not match.
    """
    found = pattern.fullmatch(value)
    if found is None:
        raise ValueError(f"{value!r} is not {expected}")
    return found.groups()


def _turns(values: tuple[str, ...]) -> tuple[Any, ...]:
    """Read names, axes and degrees. Names may hold `=` and `:`, as Mixamo's do."""
    found = [parsed(value, _TURN, "JOINT=AXIS:DEGREES, such as LeftLeg=x:90") for value in values]
    return tuple((name, axis.lower(), float(degrees)) for name, axis, degrees in found)


def _weights(values: tuple[str, ...]) -> tuple[Any, ...]:
    """Read names and weights."""
    found = [parsed(value, _WEIGHT, "NAME=WEIGHT, such as browInnerUp=1") for value in values]
    return tuple((name, float(weight)) for name, weight in found)


def _memory(context: click.Context, parameter: click.Parameter, value: str | None) -> int:
    """Read a size in decimal units as bytes, and hold the process to it until the command ends.

    A page that other machines reach gets no more memory than a job of a batch.
    """
    try:
        size = parse_bytes(value) if value is not None else MAX_MEMORY if _is_served(context) else default_memory()
    except ValueError as error:
        raise click.BadParameter(str(error), param=parameter) from error
    context.with_resource(held(size))
    return size


def _is_served(context: click.Context) -> bool:
    """True if the command lets other machines reach its page; options that are given are read before defaults."""
    if "host" not in context.params:
        return False
    from wrinklecli.editor.page.access import is_own

    return not is_own(context.params["host"])


def _number(value: float | None) -> float | None:
    """Refuse `nan`, which no range excludes."""
    if value is not None and math.isnan(value):
        raise ValueError("'nan' is not a number")
    return value


def _length(value: str) -> Any:
    """Read a length in scene units, or per cent."""
    from wrinklecli.tools.records import parse_length

    try:
        return parse_length(value)
    except ValueError:
        raise ValueError(f"{value!r} is neither a length above 0 nor a percentage such as 1%") from None


def file(*names: str, text: str, metavar: str = "FILE", **more: Any) -> Option:
    """A file by name."""
    return click.option(*names, type=FILE, metavar=metavar, help=text, **more)


def flag(*names: str, text: str) -> Option:
    """An option that is given or not."""
    return click.option(*names, is_flag=True, help=text)


def whole(*names: str, bounds: tuple[int, int], text: str, default: int | None = None) -> Option:
    """A whole number in a range."""
    return valued(*names, text=text, default=default, type=click.IntRange(*bounds), metavar="N")


def valued(
    *names: str, text: str, default: Any = None, read: Callable[[Any], Any] | None = None, **more: Any
) -> Option:
    """An option with a value, whose help shows the default, if there is one.

    `read` makes something of the value, which may be None; its ValueError is wrong usage.
    """

    def callback(_context: click.Context, parameter: click.Parameter, value: Any) -> Any:
        try:
            return read(value) if read else value
        except ValueError as error:
            raise click.BadParameter(str(error), param=parameter) from error

    more = {"callback": callback, **more}
    return click.option(*names, default=default, show_default=default is not None, help=text, **more)


def length(name: str, *, default: str, text: str) -> Option:
    """A length in scene units or per cent."""
    return valued(name, text=text, default=default, metavar="LENGTH", read=_length)


def choice(name: str, words: Any, text: str) -> Option:
    """One of the words of a Literal type; the first is the default."""
    values = get_args(words)
    return valued(name, text=text, default=values[0], type=click.Choice(values))


def clip(text: str) -> Option:
    """`--clip`, names of clips: `clips`."""
    return click.option("--clip", "clips", metavar="NAME", multiple=True, help=text)


def tool(text: str) -> Option:
    """`--tool`, names of tools: `only`."""
    return click.option("--tool", "only", metavar="NAME", multiple=True, help=text)


def anim(text: str = "") -> Option:
    """`--anim`, files with clips: `anims`."""
    about = (
        "Also take the clips of this file (glTF), for joints of the same names; may be repeated. A clip whose name"
        " exists already gets the name of its file."
    )
    return click.option("--anim", "anims", type=FILE, metavar="FILE", multiple=True, help=f"{about} {text}".rstrip())


def presets(text: str) -> Option:
    """`--presets`, files of presets: `presets`."""
    about = "Also take the presets of this file (YAML); may be repeated."
    return click.option("--presets", type=FILE, metavar="FILE", multiple=True, help=f"{about} {text}")


def range_of_motion(text: str) -> Option:
    """`--range-of-motion`."""
    about = "Turn each joint as far as it goes and raise each morph target, one at a time, even if ASSET has clips."
    return flag("--range-of-motion", text=f"{about} {text}")


def fps(text: str, default: float | None = None) -> Option:
    """`--fps`, frames per second."""
    return valued("--fps", text=text, default=default, type=click.FloatRange(0.1, 1000), read=_number)


def json(text: str = "Print what was made as JSON, in place of lines.") -> Option:
    """`--json`: `as_json`."""
    return flag("--json", "as_json", text=f"{text} Its keys: configs/json.md.")


def allow_external(text: str = "Also read buffers, images and presets outside the folders that name them.") -> Option:
    """`--allow-external`."""
    return flag("--allow-external", text=text)


def quiet(text: str = "Print nothing but errors.") -> Option:
    """`-q`, `--quiet`."""
    return flag("-q", "--quiet", text=text)


def verbose(text: str = "Print a line for each tool.") -> Option:
    """`-v`, `--verbose`."""
    return flag("-v", "--verbose", text=text)


_ONE_POSE = "May be repeated, and with {}, for one pose."
# Joints to turn: `pose`.
pose = valued(
    "--pose",
    metavar="JOINT=AXIS:DEGREES",
    multiple=True,
    read=_turns,
    text="In place of clips, turn this joint about its own axis, such as LeftLeg=x:90. " + _ONE_POSE.format("--morph"),
)
# Weights of morph targets: `morphs`.
morph = valued(
    "--morph",
    "morphs",
    metavar="NAME=WEIGHT",
    multiple=True,
    read=_weights,
    text="In place of clips, give this morph target a weight, such as browInnerUp=1. " + _ONE_POSE.format("--pose"),
)
max_levels = whole("--max-levels", bounds=(0, MAX_LEVELS), text="Overrides refinement.max_levels; 0 does not refine.")
# Bytes; the process is held to them while the command runs.
max_memory = valued(
    "--max-memory",
    text="Refuse an asset that would take more memory, such as 500MB or 4GB; by default half of the free memory, and at"
    " least 1GB.",
    metavar="SIZE",
    callback=_memory,
)
max_vertices = whole(
    "--max-vertices",
    bounds=(0, 100_000_000),
    text="Refuse tools that would add more vertices to a mesh.",
    default=MAX_VERTICES,
)
progress = flag("--progress", text="Print a line `progress: STAGE N%` for each per cent of a stage, for programs.")
strict = flag("--strict", text="Treat warnings as refusals (exit code 3).")
