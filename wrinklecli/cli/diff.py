"""`wrinkle diff`."""

import math
import sys
from typing import TYPE_CHECKING, Any

import click

from wrinklecli.choices import DIFF_LINES, FPS
from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, emit, emit_json

if TYPE_CHECKING:
    from wrinklecli.review.diff.diff import Comparison


@click.command(
    short_help="Say if two assets mean the same.",
    epilog="Example: wrinkle diff goldens/trousers.glb out/trousers.glb --tolerance 0.01%",
)
@click.argument("a", type=opt.FILE)
@click.argument("b", type=opt.FILE)
@opt.length(
    "--tolerance",
    default="0.0001%",
    text="Greatest distance at which they are the same: scene units, or per cent of the asset's size (its box's"
    " diagonal). The default is eight float32 roundings, which is what the same bake may differ by between processors.",
)
@opt.flag("--posed", text="Compare only what a viewer sees move: posed positions over time.")
@opt.clip("Compare only this clip; may be repeated.")
@opt.fps("Frames per second of the times to compare at, besides all keys.", default=FPS)
@opt.allow_external("Read buffers and images outside the assets' folders too.")
@opt.max_memory
@opt.json("Print the comparison as JSON.")
@opt.quiet("Print nothing but errors; the exit code has the result.")
@opt.verbose(f"Print every difference, not {DIFF_LINES} of each kind.")
def diff(a: str, b: str, *, as_json: bool, quiet: bool, verbose: bool, **options: Any) -> None:
    """Compare two assets (glTF), a golden A and a fresh bake B.

    Documents are compared by meaning: the layout of data, sparse storage, compression and asset.generator make no
    difference. Numbers that are no lengths may differ by the ratio of the tolerance to the size of the asset. Positions
    are compared in the stored pose and in every clip: meshes with the same triangles in their order, vertex by vertex,
    all others by the distance of the vertices of each from the surface of the other. --posed compares nothing else,
    neither names nor materials nor the way in which vertices move, and it reports normals without judging them. A file
    of --mode frames is compared at the times of its frames.

    Exit codes: 0 the same; 1 different; 2 could not be compared, or wrong usage; 70 a bug.
    """
    from wrinklecli.errors import WrinkleError
    from wrinklecli.review.diff.diff import diff as run

    try:
        with Progress(quiet=quiet) as progress:
            comparison = run(a, b, progress=progress.show, **options)
    except WrinkleError as error:
        error.exit_code = 2  # 1 means that they differ
        raise
    if as_json:
        emit_json({"diff": 1, "same": comparison.same, "a": a, "b": b, **_data(comparison, posed=options["posed"])})
    elif not quiet:
        *lines, summary = comparison.lines(None if verbose else DIFF_LINES)
        for line in lines:
            emit(line)
        emit(summary, style={"fg": "green" if comparison.same else "red"})
    if not comparison.same:
        sys.exit(1)


def _data(comparison: "Comparison", *, posed: bool) -> dict[str, Any]:
    """The comparison as JSON values."""
    from dataclasses import asdict

    differences = [asdict(difference) for difference in comparison.differences]
    for each in differences:
        # NaN is infinitely far from other numbers; JSON has no infinity.
        if each["distance"] is not None and not math.isfinite(each["distance"]):
            each["distance"] = None
    return {
        "posed": posed,
        "tolerance": comparison.tolerance,
        "size": comparison.size,
        "times": comparison.times,
        "worst": asdict(comparison.worst) if comparison.worst else None,
        "normal": comparison.normal,
        "differences": differences,
    }
