"""`wrinkle track`."""

import math

import click


def _number(_context: click.Context, parameter: click.Parameter, value: float) -> float:
    """A number: `nan` is in no range and outside none."""
    if math.isnan(value):
        raise click.BadParameter("'nan' is not a number", param=parameter)
    return value


@click.command(
    epilog="Example: wrinkle track body_wrinkled.glb clips/walk.glb clips/run.glb -o tracked",
)
@click.argument("baked")
@click.argument("anims", metavar="ANIM...", nargs=-1, required=True)
@click.option("-o", "--output", "folder", metavar="DIR", required=True, help="Where to write, under the same names.")
@click.option(
    "--fps",
    type=click.FloatRange(0.1, 1000),
    default=30.0,
    show_default=True,
    callback=_number,
    help="Frames per second of the grid of sample times.",
)
@click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
def track(baked: str, anims: tuple[str, ...], folder: str, fps: float, quiet: bool) -> None:
    """Add the wrinkles of BAKED, a body that `wrinkle bake` has written, to clips kept in other files.

    Joints are matched by name. Each ANIM (glTF) is written into DIR with weight tracks added to its clips.

    Exit codes: 0 done; 1 an input is at fault, nothing written; 2 wrong usage; 70 a bug.
    """
    for path in anims:
        if not path.lower().endswith((".glb", ".gltf")):
            raise click.BadParameter(f"{path!r} ends neither in .glb nor .gltf", param_hint="ANIM")

    from wrinklecli.cli.common import printable
    from wrinklecli.track import track as run

    for made in run(baked, anims, folder, fps=fps):
        if quiet:
            continue
        for warning in made.warnings:
            click.echo(f"warning: {printable(warning)}", err=True)
        clips = f"{len(made.clips)} clip{'' if len(made.clips) == 1 else 's'}"
        click.echo(printable(f"{made.path}: {clips}{': ' if made.clips else ''}{', '.join(made.clips)}"), err=True)
