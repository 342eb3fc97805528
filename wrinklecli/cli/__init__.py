"""The command line: options in, exit code out. The core never prints and never exits."""

import os
import sys
from collections import UserDict
from importlib import import_module

import click

from wrinklecli.cli.output import say
from wrinklecli.cli.streams import is_of_output, may_be_lost, open_streams
from wrinklecli.errors import WrinkleError
from wrinklecli.numeric.memory import is_lack

_BUG = 70  # EX_SOFTWARE of sysexits.h
# In the order of use; the module of the same name has each.
_COMMANDS = (
    "demo",
    "inspect",
    "suggest",
    "edit",
    "check",
    "bake",
    "maps",
    "preview",
    "diff",
    "track",
    "batch",
    "schema",
    "completion",
    "doctor",
)


class _Commands(UserDict[str, click.Command]):
    """The commands by their names. Each is imported when it is asked for: a bake needs few of their modules."""

    def __getitem__(self, name: str) -> click.Command:
        if name not in self:
            raise KeyError(name)
        command: click.Command = getattr(import_module(f"wrinklecli.cli.{name}"), name)
        return command


class _InOrder(click.Group):
    """Lists its commands as they were added: in the order of use."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        return list(self.commands)


@click.group(
    cls=_InOrder,
    commands=_Commands.fromkeys(_COMMANDS),
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    epilog="Example: wrinkle bake samples/trousers.glb configs/trousers.yaml -o out.glb",
)
@click.version_option(package_name="wrinklecli", prog_name="wrinkle")
def cli() -> None:
    """Bake dynamic wrinkles into animated glTF characters."""


def main() -> None:
    """Run `wrinkle`; the one place where errors become lines and exit codes."""
    # Bakes use one thread. OpenBLAS takes 40 MB for each core when it is loaded, and if `--max-memory` leaves less than
    # that, OpenBLAS tries for ever.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    open_streams()
    try:
        cli.main(prog_name="wrinkle", standalone_mode=False)
    except click.ClickException as error:
        with may_be_lost():
            error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        say("wrinkle: interrupted")
        sys.exit(130)
    except WrinkleError as error:
        for line in error.lines:
            say(line)
        sys.exit(error.exit_code)
    except Exception as error:
        if is_lack(error):  # while libraries are loaded; later, `guarded` names the file
            say("wrinkle: takes more memory than there is, or than --max-memory allows")
            sys.exit(1)
        if isinstance(error, OSError) and is_of_output(error):
            say(f"standard output: cannot be written: {error.strerror}")
            sys.exit(1)
        import traceback

        with may_be_lost():
            traceback.print_exc()
        say("wrinkle: this is a bug of wrinkle's; please report it with the lines above")
        sys.exit(_BUG)
