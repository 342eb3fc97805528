"""`wrinkle doctor`."""

import os
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from wrinklecli.choices import CACHE
from wrinklecli.cli import options as opt
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
    "unwrap": "maps --unwrap",
}
_REQUIREMENT = re.compile(r"([A-Za-z0-9._-]+)(?:\[[^]]*\])?\s*(?:>=\s*([0-9][\w.]*))?")
_EXTRA = re.compile(r"""extra\s*==\s*["']([^"']+)["']""")
_LONGEST = 300  # characters of a failure
# One wrinkle of the demo's figure: its own field takes longer than a report may.
_KNEE = """version: 1
tools:
  - {name: knee, origin: [0.1725, 0.6197, -0.0475], target: [0.0794, 0.3399, -0.0708], width: 0.34}
"""


@click.command(
    short_help="Say what is installed and if a bake works.",
    epilog="Example: wrinkle doctor --json",
)
@opt.json("Print the same as JSON.")
def doctor(*, as_json: bool) -> None:
    """Print versions, extras, cores and memory, and bake one wrinkle of the demo's figure, for a bug report.

    The text has no names of users and no paths of their folders. The figure is baked in a temporary folder, which is
    removed.

    Exit codes: 0 the bake is right; 1 it is not; 2 wrong usage; 70 a bug.
    """
    found = _found()
    if as_json:
        emit_json(found)
    else:
        for line in _lines(found):
            emit(line)
    if not found["bake"]["ok"]:
        raise WrinkleError("the bake of the demo's figure failed: wrinkle does not work here", where="doctor")


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
    """Bake the demo's figure in a temporary folder: whether that is right, seconds, and what failed.

    Any exception counts as a failure, since a broken library raises what it likes.
    """
    import tempfile
    import time

    begun = time.perf_counter()
    message = None
    try:
        with tempfile.TemporaryDirectory() as folder:
            try:
                from wrinklecli import bake
                from wrinklecli.example.demo import ASSET, TOOLS, kept

                asset, tools, out = (os.path.join(folder, name) for name in (ASSET, TOOLS, "out.glb"))
                for path, content in ((asset, kept(ASSET)), (tools, _KNEE.encode())):
                    Path(path).write_bytes(content)
                report = bake(asset, tools, out, max_levels=0)
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
