"""Suggested tools: where they lie, and the command run in this process."""

from pathlib import Path

import numpy as np
from click.testing import CliRunner, Result
from numpy.typing import NDArray

from wrinklecli.cli import cli
from wrinklecli.numeric.arrays import unit
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


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, ["suggest", *map(str, arguments)])
