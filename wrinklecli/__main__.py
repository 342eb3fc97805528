"""Starts the command, so that Ctrl-C ends it with a line at any moment: while modules are imported, and at its end."""

import os
import signal
import sys


def main() -> None:
    """Run `wrinkle`."""
    if signal.getsignal(signal.SIGINT) is not signal.default_int_handler:  # ignored, as by `nohup`
        from wrinklecli.cli import main as run

        run()
        return
    # An exception might be raised where imports or destructors swallow it, and nothing has to be cleared up yet.
    signal.signal(signal.SIGINT, _end)
    from wrinklecli.cli import main as run

    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        run()
    except KeyboardInterrupt:  # before `run` takes care of it
        _end()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _end(*_: object) -> None:
    os.write(2, b"wrinkle: interrupted\n")
    os._exit(128 + signal.SIGINT)


if __name__ == "__main__":
    sys.argv[0] = "wrinkle"
    main()
