"""The assets that were edited last, each with its tools file, in a small file of the user's own."""

import json
import os
from collections.abc import Mapping
from contextlib import suppress

from wrinklecli.errors import WrinkleError
from wrinklecli.files.outputs import Outputs

_KEPT = 12  # assets: as many as a list shows without scrolling
_MAX_BYTES = 1_000_000  # of a file that this program has written


def recent(path: str) -> dict[str, str]:
    """The tools file of each asset that was edited, the last one first; none if the file is absent or damaged."""
    try:
        with open(path, "rb") as file:
            pairs = json.loads(file.read(_MAX_BYTES))["recent"]
        return {os.path.abspath(asset): os.path.abspath(tools) for asset, tools in pairs}
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return {}


def remember(path: str, edited: Mapping[str, str]) -> None:
    """Put assets with their tools files before those that the file has; a folder that cannot be written is no error."""
    pairs = [*{**edited, **{key: each for key, each in recent(path).items() if key not in edited}}.items()][:_KEPT]
    with suppress(WrinkleError, OSError):
        os.makedirs(os.path.dirname(path), mode=0o700, exist_ok=True)
        with Outputs() as outputs:
            outputs.add_bytes(path, json.dumps({"recent": pairs}).encode())
