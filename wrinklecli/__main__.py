"""Starts the command, so that Ctrl-C ends it with a line at any moment: while modules are imported, and at its end."""

import os
import signal
import sys

# New objects before Python searches for garbage; 700 by default. A small bake makes fewer than this. Imported modules
# stay to the end, and searching them again and again is an eighth of the time of a small bake.
_BEFORE_COLLECTION = 100_000


def main() -> None:
    """Run `wrinkle`, and end the process."""
    is_handled = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # else ignored, as by `nohup`
    if is_handled:
        # An exception might be raised where imports swallow it, and nothing has to be cleared up yet.
        signal.signal(signal.SIGINT, _end)
    import gc  # here, as an interrupt may come in any import

    gc.set_threshold(_BEFORE_COLLECTION)
    from wrinklecli.cli import main as run

    status: object = None
    try:
        if is_handled:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        run()
    except KeyboardInterrupt:  # before `run` takes care of it
        _end()
    except SystemExit as ended:
        status = ended.code
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _leave(status)


def _leave(status: object) -> None:
    """End the process at once, as it takes a fortieth of a small bake to free all objects one by one.

    Python ends it as ever where other threads still run, or where a standard stream takes no more, as Python says then.
    """
    import atexit
    import threading

    if threading.active_count() == 1 and isinstance(status, int | None):
        atexit._run_exitfuncs()
        try:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(status or 0)
        except OSError:
            pass
    sys.exit(status)  # type: ignore[arg-type]


def _end(*_: object) -> None:
    os.write(2, b"wrinkle: interrupted\n")
    os._exit(128 + signal.SIGINT)


if __name__ == "__main__":
    sys.argv[0] = "wrinkle"
    main()
