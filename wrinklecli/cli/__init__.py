"""The command line: options in, exit code out. The core never prints and never exits."""

import sys

import click

from wrinklecli.cli.bake import bake
from wrinklecli.cli.common import say
from wrinklecli.cli.track import track
from wrinklecli.errors import WrinkleError

_BUG = 70  # EX_SOFTWARE of sysexits.h


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
@click.version_option(package_name="wrinklecli", prog_name="wrinkle")
def cli() -> None:
    """Bake dynamic wrinkles into animated glTF characters."""


cli.add_command(bake)
cli.add_command(track)


def main() -> None:
    """Run `wrinkle`; the one place where errors become lines and exit codes."""
    try:
        cli.main(prog_name="wrinkle", standalone_mode=False)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        click.echo("wrinkle: interrupted", err=True)
        sys.exit(130)
    except WrinkleError as error:
        for line in error.lines:
            say(line)
        sys.exit(error.exit_code)
    except Exception:
        import traceback

        traceback.print_exc()
        click.echo("wrinkle: this is a bug of wrinkle's; please report it with the lines above", err=True)
        sys.exit(_BUG)
