"""`wrinkle maps`."""

from typing import Any, get_args

import click

from wrinklecli.choices import MOST_TEXELS, MapKind
from wrinklecli.cli import options as opt
from wrinklecli.cli.output import Progress, emit_json, say, say_findings
from wrinklecli.cli.streams import command_outputs
from wrinklecli.errors import listed, refuse_warnings
from wrinklecli.files.formats import MODEL_ENDINGS

_SMALLEST = 16


def _size(value: str) -> int:
    """Read the texels of a side; a text, as other commands read widths and heights."""
    if not value.isdecimal() or not _SMALLEST <= int(value[:6]) <= MOST_TEXELS:
        raise ValueError(f"{value!r} is not a whole number from {_SMALLEST} to {MOST_TEXELS}")
    return int(value)


def _kinds(value: str) -> tuple[str, ...]:
    """Read names of maps between commas."""
    known = get_args(MapKind)
    found = tuple(dict.fromkeys(each.strip() for each in value.split(",")))
    if not set(found) <= set(known):
        raise ValueError(f"{value!r} is not a list of {', '.join(known)}")
    return found


@click.command(
    short_help="Write normal, height and occlusion maps of the wrinkles.",
    epilog="Example: wrinkle maps samples/trousers.glb configs/trousers.yaml -o maps --size 1024",
)
@click.argument("asset", type=opt.FILE)
@click.argument("tools", type=opt.FILE)
@opt.file("-o", "--output", "folder", metavar="DIR", required=True, text="Where to write the images and maps.json.")
@opt.valued(
    "--size",
    metavar="N",
    default="2048",
    read=_size,
    text="Texels of a side of each image.",
)
@opt.valued(
    "--maps",
    "kinds",
    metavar="KINDS",
    default="normal,height,ao",
    read=_kinds,
    text="The maps to write, between commas.",
)
@opt.whole("--supersample", bounds=(1, 4), default=2, text="Samples of a texel along either side.")
@opt.flag("--separate", text="Write maps for each weight, not shared ones with masks.")
@opt.file(
    "--unwrap",
    text="Write ASSET with a further set of texture coordinates to this .glb or .gltf, for the maps alone.",
)
@opt.anim("Tools may name them.")
@opt.tool("Use this tool only; may be repeated.")
@opt.allow_external()
@opt.max_memory
@opt.strict
@opt.json()
@opt.quiet()
def maps(asset: str, tools: str, folder: str, strict: bool, as_json: bool, quiet: bool, **options: Any) -> None:
    """Write maps of the wrinkles that the tools of TOOLS (YAML) would make on ASSET (glTF), whose mesh stays as it is.

    For each material under a tool or a field, in its own texture coordinates, DIR gets a normal map (tangent space, as
    glTF's), a height map (16 bits) and an occlusion map of the full wrinkles. Weights whose places do not overlap share
    maps, and masks say which texels belong to which weight. maps.json lists the files, and holds the numbers that turn
    a pose into weights, as a baked file's extras do.

    A bump needs 10 texels to look right. Fewer are a warning, and fewer than 6 are refused, with the --size that is
    enough. --unwrap FILE lays what the tools move into texture coordinates for maps alone, a further set beside those
    that ASSET has, and writes ASSET with them to FILE. texCoord in maps.json is the number of the set. This needs
    xatlas: pip install 'wrinklecli[unwrap]'.

    Maps leave out contact, muscles, flesh and touches, which move the mesh.

    Exit codes: 0 done; 1 the input is at fault, nothing written; 2 wrong usage; 3 refused (--strict with warnings),
    nothing written; 70 a bug.
    """
    if options["size"] * options["supersample"] > MOST_TEXELS:
        raise click.UsageError(f"'--size' times '--supersample' is more than {MOST_TEXELS}.")
    unwrap = options["unwrap"]
    if unwrap is not None and not unwrap.lower().endswith(MODEL_ENDINGS):
        raise click.BadParameter(f"{unwrap!r} does not end in {listed(MODEL_ENDINGS)}", param_hint="--unwrap")
    with command_outputs() as outputs:
        from wrinklecli.texture.maps import maps as run

        with Progress(quiet=quiet) as progress:
            made = run(asset, tools, folder, outputs=outputs, progress=progress.show, **options)
        if strict:
            refuse_warnings(made.warnings, where=asset)
        if as_json:
            emit_json({"maps": 1, "asset": asset, "tools_file": tools, **made.record})
    if quiet or as_json:
        return
    say_findings(made.notes, made.warnings)
    say(f"{folder}: {made.summary}")
