"""Suggested tools: made once in a run of the tests, where they lie, and the command run in this process."""

import json
import pickle
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from kit.kept import identity, kept
from kit.places import ROOT
from wrinklecli.cli import cli
from wrinklecli.numeric.arrays import unit
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.review.suggest.suggest_options import SuggestOptions
from wrinklecli.tools.records import WrinkleTool

Floats = NDArray[np.float64]


def in_assets(name: str) -> Path:
    """An asset of others in the folder beside the repository; the test is skipped where it is not there."""
    path = ROOT.parent / "shared" / "assets" / name
    if not path.exists():
        pytest.skip(f"{path} is not here")
    return path


def suggest_once(asset: Path, **options: Any) -> Suggestions:
    """The suggestions for an asset in one file; the same are looked for only once. `inputs` may name another folder.

    Args:
        asset: The asset.
        options: Of `suggest`.
    """
    return _suggested(asset, json.dumps(options, sort_keys=True))


@cache
def _suggested(asset: Path, options: str) -> Suggestions:
    def make(folder: Path) -> None:
        (folder / "found").write_bytes(pickle.dumps(suggest(asset, **json.loads(options))))

    found = pickle.loads((kept(("suggest", *identity(asset), options), make) / "found").read_bytes())
    assert isinstance(found, Suggestions)
    return found


@contextmanager
def each_once() -> Iterator[None]:
    """A block in which commands get the suggestions that others have asked for; see `suggest_once`."""
    usual = SuggestOptions()
    # What is suggested does not depend on these.
    aside = ("progress", "folder", "jobs", "max_memory")

    def remembered(asset: str, **options: Any) -> Suggestions:
        asked = {name: value for name, value in options.items() if name not in aside and value != getattr(usual, name)}
        return suggest_once(Path(asset).absolute(), **asked)

    with mock.patch.object(sys.modules[suggest.__module__], "suggest", remembered):
        yield


def middle(tool: WrinkleTool) -> Floats:
    return (ends(tool)[0] + ends(tool)[1]) / 2.0


def ends(tool: WrinkleTool) -> tuple[Floats, Floats]:
    assert isinstance(tool.origin, tuple)
    assert isinstance(tool.target, tuple)
    return np.array(tool.origin), np.array(tool.target)


def along(tool: WrinkleTool) -> Floats:
    origin, target = ends(tool)
    return unit(target - origin)


def squeezed(tool: WrinkleTool, span: float) -> Suggestion:
    """A suggestion of a tool on `kit.sheet.sheet`, whose one clip halves its span."""
    return Suggestion(
        tool=tool,
        mirrored=False,
        mesh="sheet",
        driver="squeeze",
        by_morph=True,
        clip="squeeze",
        time=1.0,
        span=span,
        clips={"squeeze": span / 2.0},
        shortening=0.5,
        score=1.0,
    )


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, ["suggest", *map(str, arguments)])
