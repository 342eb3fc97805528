"""Printing: lines that names cannot break out of, JSON, tables, warnings, and a progress bar on a terminal."""

import json
import os
import re
import sys
from collections.abc import Iterable
from typing import IO, Any

import click

from wrinklecli.cli.streams import may_be_lost
from wrinklecli.errors import shortened
from wrinklecli.files.outputs import Outputs

# Longer words, such as names and paths, and longer lines are shown without their middle.
_LONGEST_WORD = 600  # characters
_LONGEST_LINE = 10_000  # characters
_LONG_WORD = re.compile(rf"\S{{{_LONGEST_WORD + 1},}}")


def printable(line: str) -> str:
    """Escape and shorten a line, so that names of an asset cannot end it, flood a terminal or command one."""
    line = shortened(_LONG_WORD.sub(lambda word: shortened(word[0], _LONGEST_WORD), line), _LONGEST_LINE)
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def say(line: str, *, style: dict[str, Any] | None = None) -> None:
    """Print a line for people on standard error."""
    with may_be_lost():
        click.echo(click.style(printable(line), **(style or {})), err=True, color=_colours(sys.stderr))


def warn(warning: str) -> None:
    """Print a warning on standard error."""
    with may_be_lost():
        marked = click.style("warning:", fg="yellow") + " " + printable(warning)
        click.echo(marked, err=True, color=_colours(sys.stderr))


def say_findings(notes: Iterable[str], warnings: Iterable[str]) -> None:
    """Print notes and warnings on standard error."""
    for note in notes:
        say(f"note: {note}")
    for warning in warnings:
        warn(warning)


def emit(line: str, *, style: dict[str, Any] | None = None) -> None:
    """Print a line of data on standard output."""
    click.echo(click.style(printable(line), **(style or {})), color=_colours(sys.stdout))


def emit_json(data: dict[str, Any]) -> None:
    """Print an object on standard output. Names stay as the asset has them, since JSON escapes harmful characters."""
    click.echo(json.dumps(data, indent=1, allow_nan=False))


def write_text(output: str | None, text: str, outputs: Outputs) -> None:
    """Write text to a file; None and `-` mean standard output."""
    if output is None or output == "-":
        click.echo(text, nl=False)
    else:
        outputs.add_bytes(output, text.encode())


def _colours(stream: IO[str]) -> bool | None:
    """False without colours; None leaves the choice to click. Source: no-color.org."""
    return False if os.environ.get("NO_COLOR") else None if stream.isatty() else False


class Progress:
    """Draws a bar on a terminal, and nothing in a pipe; with `lines`, prints lines for another program instead."""

    def __init__(self, *, quiet: bool = False, lines: bool = False) -> None:
        self._shown = not quiet and not lines and sys.stderr.isatty()
        self._lines = lines and not quiet
        self._printed = ("", -1)
        self._drawn = False

    def __enter__(self) -> "Progress":
        return self

    def __exit__(self, *_: object) -> None:
        self.clear()

    def clear(self) -> None:
        """Remove the bar, to print a line."""
        if self._drawn:
            with may_be_lost():
                click.echo("\r\x1b[K", nl=False, err=True)
            self._drawn = False

    def show(self, stage: str, done: int, total: int, *, note: str = "") -> None:
        """Draw how many steps of a stage are done, and a note behind them; a line only for each new per cent."""
        if self._lines:
            percent = 100 * done // max(total, 1)
            if (stage, percent) != self._printed:
                self._printed = (stage, percent)
                with may_be_lost():
                    click.echo(f"progress: {stage} {percent}%", err=True)
        if self._shown:
            width = 30
            filled = width * done // max(total, 1)
            bar = f"{stage:>8} {'#' * filled}{'.' * (width - filled)} {done}/{total}  {note}".rstrip()
            with may_be_lost():
                click.echo(f"\r\x1b[K{bar}", nl=False, err=True)
            self._drawn = True
