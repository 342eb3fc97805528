"""`wrinkle track`."""

from dataclasses import asdict
from typing import Any

import click

from wrinklecli.choices import FPS
from wrinklecli.cli import options as opt
from wrinklecli.cli.output import emit_json, say, warn
from wrinklecli.cli.streams import command_outputs
from wrinklecli.errors import counted, listed
from wrinklecli.files.formats import MODEL_ENDINGS

_LEAST_ERROR = 0.048828125  # per cent: 1/2048, the error of the table of weights in the extras of a node


def _share(value: str) -> float:
    """Read a percentage above the error of the table as a ratio."""
    try:
        found = float(value.removesuffix("%")) if value.endswith("%") else -1.0
    except ValueError:
        found = -1.0
    if not _LEAST_ERROR < found <= 100:
        raise ValueError(f"{value!r} is not a percentage above {_LEAST_ERROR}%, to which the table of weights is right")
    return found / 100


@click.command(
    short_help="Add wrinkles to clips in other files.",
    epilog="Example: wrinkle track body_wrinkled.glb clips/walk.glb clips/run.glb -o tracked",
)
@click.argument("baked", type=opt.FILE)
@click.argument("anims", type=opt.FILE, metavar="ANIM...", nargs=-1, required=True)
@opt.file("-o", "--output", "folder", metavar="DIR", required=True, text="Where to write, under the same names.")
@opt.fps("Frames per second of the grid of sample times.", default=FPS)
@opt.valued(
    "--max-error",
    metavar="PERCENT",
    default="1%",
    read=_share,
    text="Greatest error of a weight, in per cent of the greatest weight. A greater error needs fewer keys.",
)
@opt.allow_external("Read buffers and images outside the files' folders too.")
@opt.max_memory
@opt.strict
@opt.json()
@opt.quiet()
@opt.verbose()
def track(
    baked: str, anims: tuple[str, ...], folder: str, as_json: bool, quiet: bool, verbose: bool, **options: Any
) -> None:
    """Add the wrinkles of BAKED, a body that `wrinkle bake` has written, to clips kept in other files.

    Joints are matched by name. Each ANIM (glTF) is written into DIR with weight tracks added to its clips.

    Exit codes: 0 done; 1 an input is at fault, nothing written; 2 wrong usage; 3 refused (--strict), nothing
    written; 70 a bug.
    """
    for path in anims:
        if not path.lower().endswith(MODEL_ENDINGS):
            raise click.BadParameter(f"{path!r} does not end in {listed(MODEL_ENDINGS)}", param_hint="ANIM")

    with command_outputs() as outputs:
        from wrinklecli.baking.track import track as run

        every = run(baked, anims, folder, outputs=outputs, **options)
        if as_json:
            emit_json({"track": 1, "baked": baked, "files": list(map(asdict, every))})
    if quiet or as_json:
        return
    for made in every:
        for warning in made.warnings:
            warn(warning)
        for line in (*made.tools, *made.flat) if verbose else made.notes:
            say(line)
        clips = counted(len(made.clips), "clip")
        say(f"{made.path}: {clips}{': ' if made.clips else ''}{', '.join(made.clips)}")
