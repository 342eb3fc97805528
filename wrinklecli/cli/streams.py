"""Standard streams that are closed or full, and signals: a command still ends with a line and an exit code."""

import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from traceback import walk_tb
from types import FrameType
from typing import IO

import click

from wrinklecli.files.outputs import Outputs

# The signals that end a process and can be handled; Windows has no SIGHUP.
_ENDING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def open_streams() -> None:
    """Open the standard streams that the process was started without, so that no other file gets their numbers.

    As in GNU's programs, writing to standard output then fails, as it would have failed before.
    """
    for number, flags in ((0, os.O_WRONLY), (1, os.O_RDONLY), (2, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, flags)  # the lowest number that is free
    if sys.stdout is None:
        sys.stdout = open(1, "w", closefd=False)  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(2, "w", closefd=False)  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Like standard error: names of an asset may have characters that the encoding of the terminal lacks.
        sys.stdout.reconfigure(errors="backslashreplace")


@contextmanager
def may_be_lost() -> Iterator[None]:
    """Ignore errors of writing to standard error: its lines are for people, and no reason to fail."""
    try:
        yield
    except OSError:
        _give_up(sys.stderr)


def is_of_output(error: OSError) -> bool:
    """True if the error came from writing to standard output, which is then closed."""
    # Only standard output: lines on standard error are written inside `may_be_lost`.
    found = any(frame.f_code is click.echo.__code__ for frame, _ in walk_tb(error.__traceback__))
    if found:
        _give_up(sys.stdout)
    return found


def _give_up(stream: IO[str]) -> None:
    """Send the rest of a stream nowhere, since it would fail again at exit."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def leave_at_signals() -> None:
    """From now on, a signal ends the command with a line and `SystemExit`, so that open files are closed."""

    def leave(number: int, _frame: FrameType | None) -> None:
        _say_interrupted()
        sys.exit(128 + number)

    _handle(leave)


@contextmanager
def command_outputs() -> Iterator[Outputs]:
    """Collect the files of a command. A signal before they are committed discards them; a later one is ignored."""
    with Outputs(at_commit=_ignore_signals) as outputs:

        def end(number: int, _frame: FrameType | None) -> None:
            # Not by an exception, which might be raised inside the handling of another one.
            outputs.discard()
            _say_interrupted()
            os._exit(128 + number)

        _handle(end)
        yield outputs


@contextmanager
def job_outputs() -> Iterator[Outputs]:
    """Like `command_outputs`, for one of many jobs: afterwards, signals are handled as before."""
    before = {each: signal.getsignal(each) for each in _ENDING}
    try:
        with command_outputs() as outputs:
            yield outputs
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def _handle(handler: Callable[[int, FrameType | None], object]) -> None:
    for each in _ENDING:
        if signal.getsignal(each) != signal.SIG_IGN:  # as for a job in the background, or after `nohup`
            signal.signal(each, handler)


def _say_interrupted() -> None:
    with suppress(OSError):  # not through `sys.stderr`, which may be writing
        os.write(2, b"\r\x1b[K"[: 4 * os.isatty(2)] + b"wrinkle: interrupted\n")


def _ignore_signals() -> None:
    for each in _ENDING:
        signal.signal(each, signal.SIG_IGN)
