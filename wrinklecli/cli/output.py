"""What commands print: lines that names cannot break out of, JSON, warnings, a bar of progress on a terminal."""

import json
import os
import re
import sys
from typing import IO, Any

import click

from wrinklecli.cli.streams import may_be_lost
from wrinklecli.errors import shortened
from wrinklecli.files.outputs import Outputs

# Characters of a word, such as a name or a path, and of a line that are shown; of longer ones their ends.
_LONGEST_WORD = 600
_LONGEST_LINE = 10_000
_LONG_WORD = re.compile(rf"\S{{{_LONGEST_WORD + 1},}}")


def printable(line: str) -> str:
    """A line that cannot break out of itself, flood or command a terminal, whatever names an asset holds."""
    line = shortened(_LONG_WORD.sub(lambda word: shortened(word[0], _LONGEST_WORD), line), _LONGEST_LINE)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def say(line: str, *, style: dict[str, Any] | None = None) -> None:
    """A line on standard error, for people."""
    with may_be_lost():
        click.echo(click.style(printable(line), **(style or {})), err=True, color=_colours(sys.stderr))


def warn(warning: str) -> None:
    """A warning on standard error."""
    with may_be_lost():
        marked = click.style("warning:", fg="yellow") + " " + printable(warning)
        click.echo(marked, err=True, color=_colours(sys.stderr))


def emit(line: str, *, style: dict[str, Any] | None = None) -> None:
    """A line on standard output: data that was asked for."""
    click.echo(click.style(printable(line), **(style or {})), color=_colours(sys.stdout))


def emit_json(data: dict[str, Any]) -> None:
    """An object on standard output, names as the asset has them: JSON escapes what could do harm."""
    click.echo(json.dumps(data, indent=1, allow_nan=False))


def write_text(output: str | None, text: str, outputs: Outputs) -> None:
    """Text to a file, or to standard output for none and `-`."""
    if output is None or output == "-":
        click.echo(text, nl=False)
    else:
        outputs.add_bytes(output, text.encode())


def _colours(stream: IO[str]) -> bool | None:
    """None leaves the choice to the stream: colours on a terminal only. See no-color.org."""
    return False if os.environ.get("NO_COLOR") else None if stream.isatty() else False


class Progress:
    """A bar on a terminal, nothing in a pipe."""

    def __init__(self, *, quiet: bool = False) -> None:
        self._shown = not quiet and sys.stderr.isatty()
        self._drawn = False

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def clear(self) -> None:
        """Take the bar away, to print a line."""
        if self._drawn:
            with may_be_lost():
                click.echo("\r\x1b[K", nl=False, err=True)
            self._drawn = False

    def show(self, stage: str, done: int, total: int, *, note: str = "") -> None:
        """Draw a stage's share of steps that are done, and a note behind it."""
        if self._shown:
            width = 30
            filled = width * done // max(total, 1)
            bar = f"{stage:>8} {'#' * filled}{'.' * (width - filled)} {done}/{total}  {note}".rstrip()
            with may_be_lost():
                click.echo(f"\r\x1b[K{bar}", nl=False, err=True)
            self._drawn = True
