"""`wrinkle demo`."""

import shutil
import sys
from importlib.util import find_spec

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, say
from wrinklecli.cli.streams import command_outputs


@click.command(
    short_help="Bake and draw a figure, to try out.",
    epilog="Example: wrinkle demo wrinkle-demo",
)
@click.argument("folder", metavar="[DIR]", default="wrinkle-demo")
@opt.flag("--no-open", text="Do not open the picture.")
@opt.quiet()
def demo(*, folder: str, no_open: bool, quiet: bool) -> None:
    """Write a dressed figure that walks and squats, with its wrinkles, bake them, and draw it before and after.

    DIR, wrinkle-demo if it is left out, gets figure.glb, figure.yaml, wrinkled.glb and wrinkled.png. On a terminal the
    picture is opened. It needs Pillow and embreex: pip install 'wrinklecli[preview]'.

    Exit codes: 0 done; 1 DIR holds files or cannot be written; 2 wrong usage; 70 a bug.
    """
    with command_outputs() as outputs, Progress(quiet=quiet) as progress:
        from wrinklecli.numeric.guard import guarded

        with guarded(folder):
            from wrinklecli.example.demo import demo as run

            made = run(folder, outputs=outputs, progress=progress.show)
    if not quiet:
        for path in made.paths:
            say(f"written: {path}")
        if made.missing is not None:
            say(f"note: no picture: {made.missing}")
        asset, tools, *_ = made.paths
        wrinkle = "wrinkle" if shutil.which("wrinkle") else sys.argv[0]
        say("Next, look at its wrinkles on a page, or let wrinkle propose tools for a character of your own:")
        if find_spec("viser") is None:
            say(f"  {sys.executable} -m pip install 'wrinklecli[edit]'")
        say(f"  {wrinkle} edit {asset} {tools}")
        say(f"  {wrinkle} suggest your.glb -o tools.yaml")
    if made.picture is not None and not no_open and sys.stderr.isatty():
        click.launch(made.picture)
