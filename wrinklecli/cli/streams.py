"""Standard streams that are closed or full, and signals: a command ends in a line and an exit code all the same."""

import io
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import IO

import click

from wrinklecli.files.outputs import Outputs

# Those that end a process and may be heard; Windows has no SIGHUP.
_ENDING = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


def open_streams() -> None:
    """Give the process the standard streams that it was started without, so that no other file gets their numbers.

    As GNU's programs do: what is written to standard output then fails, as it would without this.
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
        # As standard error has it: names of an asset may have characters that the terminal's encoding lacks.
        sys.stdout.reconfigure(errors="backslashreplace")


@contextmanager
def may_be_lost() -> Iterator[None]:
    """What is written to standard error within is for people: that it cannot be is no reason to fail."""
    try:
        yield
    except OSError:
        _give_up(sys.stderr)


def is_of_output(error: OSError) -> bool:
    """Whether it was standard output that could not be written to, which then goes nowhere."""
    trace = error.__traceback__
    while trace is not None:
        # What is written to standard error is inside `may_be_lost`.
        if trace.tb_frame.f_code is click.echo.__code__:
            _give_up(sys.stdout)
            return True
        trace = trace.tb_next
    return False


def _give_up(stream: IO[str]) -> None:
    """Let what a stream still holds go nowhere: it would fail again at exit."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


def leave_at_signals() -> None:
    """From now on let a signal end the command in a line, by `SystemExit`, so that what is open is closed."""

    def leave(number: int, _frame: FrameType | None) -> None:
        _say_interrupted()
        sys.exit(128 + number)

    _hear(leave)


@contextmanager
def command_outputs() -> Iterator[Outputs]:
    """What a command writes, unless a signal ends it first: then all is as it was. Later ones are not heard."""
    with Outputs(at_commit=_ignore_signals) as outputs:

        def end(number: int, _frame: FrameType | None) -> None:
            # Here and not by an exception, which may come where another one is dealt with.
            outputs.discard()
            _say_interrupted()
            os._exit(128 + number)

        _hear(end)
        yield outputs


@contextmanager
def job_outputs() -> Iterator[Outputs]:
    """As `command_outputs`, for one of many jobs: after it, signals are heard as before."""
    before = {each: signal.getsignal(each) for each in _ENDING}
    try:
        with command_outputs() as outputs:
            yield outputs
    finally:
        for each, heard in before.items():
            signal.signal(each, heard)


def _hear(signalled: Callable[[int, FrameType | None], object]) -> None:
    for each in _ENDING:
        if signal.getsignal(each) != signal.SIG_IGN:  # as for a job in the background, or after `nohup`
            signal.signal(each, signalled)


def _say_interrupted() -> None:
    with suppress(OSError):  # past `sys.stderr`, which may be at work
        os.write(2, b"\r\x1b[K"[: 4 * os.isatty(2)] + b"wrinkle: interrupted\n")


def _ignore_signals() -> None:
    for each in _ENDING:
        signal.signal(each, signal.SIG_IGN)
