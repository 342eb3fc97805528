"""`wrinkle doctor`."""

import os
import re
import sys
from collections.abc import Sequence
from typing import Any

import click

from wrinklecli.cli import options as opt
from wrinklecli.cli.batch import CACHE
from wrinklecli.cli.output import emit, emit_json
from wrinklecli.errors import WrinkleError, aligned, shortened

_PACKAGE = "wrinklecli"
# The extras for users, in the order of the lines. Which packages each needs is read from the installed metadata.
EXTRAS = {
    "batch": "batch with more workers than one, and URLs",
    "contact": "contact: resolve",
    "draco": "assets compressed by Draco",
    "edit": "wrinkle edit",
    "maps": "wrinkle maps",
    "plot": "check --plot",
    "preview": "wrinkle preview, masks in images",
}
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*(?:>=\s*([0-9][\w.]*))?")
_EXTRA = re.compile(r"""extra\s*==\s*["']([^"']+)["']""")
# A strip of skin, one unit long. The clip moves its end by a fifth of that, so that wrinkles must rise.
_ROWS, _COLUMNS = 9, 5
_TOOLS = """version: 1
tools:
  - name: doctor
    origin: [0.1, 0.0, 0.0]
    target: [0.9, 0.0, 0.0]
    width: 0.4
    bumps: 2
"""
_LONGEST = 300  # characters of a failure


@click.command(
    short_help="Say what is installed and if a bake works.",
    epilog="Example: wrinkle doctor --json",
)
@opt.json("Print the same as JSON.")
def doctor(*, as_json: bool) -> None:
    """Print versions, extras, cores and memory, and bake a tiny asset, for a bug report.

    The text has no names of users and no paths of their folders. The asset is made and baked in a temporary folder,
    which is removed. "cache" is the cache of batch in the current folder.

    \b
    --json prints an object; within a version, keys are only added:
      doctor     1, the version
      wrinkle    version
      python     implementation and version
      platform   system and processor
      libraries  name to version; null if missing
      extras     name to for (its use), found (whether all it needs is there)
                 and packages: each with its version, or null if missing or
                 older than it must be
      cores      how many this process may use
      memory     bytes of the machine; null if unknown
      cache      whether the cache of batch is in this folder
      bake       ok, seconds, and message (null if ok)

    Exit codes: 0 the bake is right; 1 it is not; 2 wrong usage; 70 a bug.
    """  # noqa: D301
    found = _found()
    if as_json:
        emit_json(found)
    else:
        for line in _lines(found):
            emit(line)
    if not found["bake"]["ok"]:
        raise WrinkleError("the bake of a tiny asset failed: wrinkle does not work here", where="doctor")


def _found() -> dict[str, Any]:
    """The object that `--json` prints."""
    import platform

    from wrinklecli.numeric.memory import physical_memory
    from wrinklecli.numeric.processes import core_count

    required, extras = _requirements()
    packages = {name: {each: _version(each, least) for each, least in extras.get(name, {}).items()} for name in EXTRAS}
    return {
        "doctor": 1,
        "wrinkle": _version(_PACKAGE),
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "libraries": {name: _version(name, least) for name, least in required.items()},
        "extras": {
            name: {
                "for": purpose,
                "found": bool(packages[name]) and None not in packages[name].values(),
                "packages": packages[name],
            }
            for name, purpose in EXTRAS.items()
        },
        "cores": core_count(),
        "memory": physical_memory(),
        "cache": os.path.isdir(CACHE),
        "bake": _bake(),
    }


def _lines(found: dict[str, Any]) -> Sequence[str]:
    """The same for people."""
    from wrinklecli.numeric.memory import shown_bytes

    rows = [
        ("wrinkle", found["wrinkle"] or "not installed"),
        ("python", found["python"]),
        ("platform", found["platform"]),
        *((name, version or "missing") for name, version in found["libraries"].items()),
    ]
    for name, extra in found["extras"].items():
        missing = [each for each, version in extra["packages"].items() if version is None]
        state = "found" if extra["found"] else f"missing {', '.join(missing)}".rstrip()
        rows.append((f"[{name}]", f"{state}; for {extra['for']}"))
    bake = found["bake"]
    return aligned(
        [
            *rows,
            ("cores", str(found["cores"])),
            ("memory", "unknown" if found["memory"] is None else shown_bytes(found["memory"])),
            ("cache", "found" if found["cache"] else "none in this folder"),
            ("bake", f"ok in {bake['seconds']:.2f} s" if bake["ok"] else f"failed: {bake['message']}"),
        ],
        texts=2,
    )


def _requirements() -> tuple[dict[str, str], dict[str, dict[str, str]]]:
    """Names of required packages with their least versions (may be empty), and the same for each extra."""
    from importlib import metadata

    required: dict[str, str] = {}
    extras: dict[str, dict[str, str]] = {}
    try:
        lines = metadata.requires(_PACKAGE) or []
    except metadata.PackageNotFoundError:
        lines = []
    for line in lines:
        requirement, _, marker = line.partition(";")
        found, extra = _REQUIREMENT.match(requirement.strip()), _EXTRA.search(marker)
        if found:
            (extras.setdefault(extra[1], {}) if extra else required)[found[1]] = found[2] or ""
    return required, extras


def _version(package: str, least: str = "") -> str | None:
    """The installed version of a package; None if it is missing or older than `least`."""
    from importlib import metadata

    try:
        version = metadata.version(package)
    except metadata.PackageNotFoundError:
        return None
    return version if _numbers(version) >= _numbers(least) else None


def _numbers(version: str) -> list[int]:
    """The numbers of a version, for comparison."""
    return [int(each) for each in re.findall(r"\d+", version)]


def _bake() -> dict[str, Any]:
    """Bake a tiny asset in a temporary folder: whether that is right, seconds, and what failed.

    Any exception counts as a failure, since a broken library raises what it likes.
    """
    import tempfile
    import time

    begun = time.perf_counter()
    message = None
    try:
        with tempfile.TemporaryDirectory() as folder:
            asset, tools, out = (os.path.join(folder, name) for name in ("tiny.glb", "tools.yaml", "out.glb"))
            try:
                from wrinklecli import bake

                with open(asset, "wb") as file:
                    file.write(_tiny_asset())
                with open(tools, "w") as text:
                    text.write(_TOOLS)
                report = bake(asset, tools, out)
                if not report.data["tools"][0]["targets"] or not os.path.getsize(out) > os.path.getsize(asset):
                    message = "no wrinkles were written"
            except Exception as error:
                message = _without_paths(error, folder)
    except OSError as error:
        message = _without_paths(error, "")
    return {"ok": message is None, "seconds": round(time.perf_counter() - begun, 3), "message": message}


def _without_paths(error: Exception, folder: str) -> str:
    """One line that says an error, without paths of the user's folders."""
    text = str(error) if isinstance(error, WrinkleError) else f"{type(error).__name__}: {error}"
    # The temporary folder may lie in the home folder, and libraries too.
    for path, shown in ((folder, "TEMPORARY"), (sys.prefix, "PREFIX"), (os.path.expanduser("~"), "~")):
        if len(path) > 1:
            text = text.replace(path, shown)
    return shortened(" ".join(text.split()), _LONGEST)


def _tiny_asset() -> bytes:
    """A .glb of a strip of skin on two joints, one of which a clip moves towards the other."""
    import json
    import struct

    xs = [row / (_ROWS - 1) for row in range(_ROWS) for _ in range(_COLUMNS)]
    zs = [column / (_COLUMNS - 1) - 0.5 for _ in range(_ROWS) for column in range(_COLUMNS)]
    corners = [row * _COLUMNS + column for row in range(_ROWS - 1) for column in range(_COLUMNS - 1)]
    # Counter-clockwise from above.
    faces = [i + k for i in corners for k in (0, 1, _COLUMNS, 1, _COLUMNS + 1, _COLUMNS)]
    one = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]
    columns: list[tuple[str, str, int, list[Any]]] = [
        ("f", "VEC3", 5126, [each for x, z in zip(xs, zs, strict=True) for each in (x, 0.0, z)]),
        ("f", "VEC3", 5126, [0.0, 1.0, 0.0] * len(xs)),
        ("B", "VEC4", 5121, [0, 1, 0, 0] * len(xs)),
        ("f", "VEC4", 5126, [each for x in xs for each in (1.0 - x, x, 0.0, 0.0)]),
        ("H", "SCALAR", 5123, faces),
        ("f", "MAT4", 5126, [*one, 0.0, 0.0, 0.0, 1.0, *one, -1.0, 0.0, 0.0, 1.0]),
        ("f", "SCALAR", 5126, [0.0, 1.0]),
        ("f", "VEC3", 5126, [1.0, 0.0, 0.0, 0.8, 0.0, 0.0]),
    ]
    widths = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}
    data, views = b"", []
    accessors: list[dict[str, Any]] = []
    for code, kind, component, values in columns:
        packed = struct.pack(f"<{len(values)}{code}", *values)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(packed)})
        accessor = {"bufferView": len(accessors), "componentType": component, "type": kind}
        accessors.append({**accessor, "count": len(values) // widths[kind]})
        data += packed + bytes(-len(packed) % 4)
    accessors[0] |= {"min": [0.0, 0.0, -0.5], "max": [1.0, 0.0, 0.5]}
    accessors[6] |= {"min": [0.0], "max": [1.0]}
    attributes = {"POSITION": 0, "NORMAL": 1, "JOINTS_0": 2, "WEIGHTS_0": 3}
    gltf = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"name": "strip", "mesh": 0, "skin": 0},
            {"name": "root", "children": [2]},
            {"name": "end", "translation": [1.0, 0.0, 0.0]},
        ],
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 4}]}],
        "skins": [{"joints": [1, 2], "inverseBindMatrices": 5}],
        "animations": [
            {
                "name": "press",
                "samplers": [{"input": 6, "output": 7}],
                "channels": [{"sampler": 0, "target": {"node": 2, "path": "translation"}}],
            }
        ],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    return header + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
