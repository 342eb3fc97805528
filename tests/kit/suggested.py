"""Suggested tools: where they lie, and the command run in this process."""

from pathlib import Path

import numpy as np
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from wrinklecli.cli import cli
from wrinklecli.numeric.arrays import unit
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.tools.records import WrinkleTool

Floats = NDArray[np.float64]


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
