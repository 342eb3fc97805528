"""The preset of the paper, held to an implementation of the paper that shares no code with the package."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from kit.bakes import bake_once
from kit.player import Gltf, Json
from kit.reference import AS_BAKED, PROJECTED, Ours, Tool, Wrinkles
from kit.samples import sample
from kit.tools_text import first_tool
from wrinklecli.tools.records import WrinkleTool

# The part of the tallest wrinkle beyond which a vertex counts as off.
OFF = 0.01
# The part of the tallest wrinkle from which a vertex counts as displaced.
DISPLACED = 1e-3
FRAMES = 13


@dataclass(frozen=True)
class Case:
    """A sample with the paper's tools on it, and a clip that shortens them; they do not overlap."""

    asset: str
    clip: str
    tools: tuple[Tool, ...]


PALM = Tool((-0.034, -0.0221, 0.0), (0.030, -0.0200, 0.0), 0.070, bumps=5)
# Its bumps rise one after another.
BACK = Tool((-0.032, 0.0221, 0.0), (0.032, 0.0195, 0.0), 0.075, strategy="origin", max_height=0.006)
BROW = Tool((0.0, 0.2395, 0.0890), (0.0, 0.2875, 0.0717), 0.20)
KNEE = Tool((0.1587, 0.6507, -0.0619), (0.0562, 0.3792, -0.0580), 0.22)
OTHER_KNEE = replace(KNEE, origin=(-0.1587, 0.6507, -0.0619), target=(-0.0562, 0.3792, -0.0580))
CASES = {
    "wrist": Case("wrist", "flex", (PALM,)),
    "back": Case("wrist", "extend", (BACK,)),
    "brow": Case(
        "head",
        "raise_brows",
        (Tool((0.028, 0.2400, 0.0847), (0.028, 0.2880, 0.0635), 0.056, 5, "both_ends", "linear", max_height=0.003),),
    ),
    "forehead": Case("head", "raise_brows", (BROW,)),
    "knees": Case("trousers", "squat", (KNEE, OTHER_KNEE)),
}


def written(tool: Tool, **keys: Any) -> Json:
    """A tool as the tools file has it: the paper in a word, and what the paper leaves to the artist."""
    place = {"origin": [*tool.origin], "target": [*tool.target], "width": tool.width}
    asked = {"bumps": tool.bumps, "strategy": tool.strategy, "attenuation": tool.attenuation}
    limit = {} if np.isinf(tool.max_height) else {"max_height": tool.max_height}
    return {"material": "larboulette2004", **place, **asked, **limit, **keys}


def off(case: Case, ours: Ours, **keys: Any) -> float:
    """The part of the displaced vertices of all frames that are not where the reference has them."""
    asset = Gltf(sample(case.asset))
    tools = [{"name": f"tool{number}", **written(each, **keys)} for number, each in enumerate(case.tools)]
    baked = bake_once(case.asset, *tools, top={"refinement": {"max_levels": 0}})
    references = [Wrinkles(asset, 0, each, ours) for each in case.tools]
    times = np.linspace(0.0, asset.array(asset.clip(case.clip)["samplers"][0]["input"]).max(), FRAMES)
    wanted = np.array([np.sum([each.moved(case.clip, time) for each in references], axis=0) for time in times])
    found = baked.pose(0, case.clip, times) - asset.pose(0, case.clip, times)
    heights = np.linalg.norm(wanted, axis=2)
    displaced = np.maximum(heights, np.linalg.norm(found, axis=2)) > DISPLACED * heights.max()
    gaps = np.linalg.norm(found - wanted, axis=2)
    assert displaced.sum() > 500, "this compares nothing"
    return float((gaps[displaced] > OFF * heights.max()).mean())


@pytest.mark.quick(1, 2)
@pytest.mark.parametrize("name", CASES)
def test_the_preset_is_the_paper(name: str) -> None:
    assert off(CASES[name], PROJECTED, attachment="patch") == 0.0


@pytest.mark.quick(0, 3)
@pytest.mark.parametrize("name", CASES)
def test_the_preset_is_the_paper_on_the_skin(name: str) -> None:
    assert off(CASES[name], AS_BAKED) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["wrist", "knees"])
def test_wrinkles_that_are_lower_in_creases_are_not_the_paper_s(name: str) -> None:
    assert off(CASES[name], AS_BAKED, creases="lower") > 0.05


def test_keys_win_over_the_preset() -> None:
    tool: WrinkleTool = first_tool("width: 1\nmaterial: larboulette2004\ncreases: lower\nsnap: surface")
    assert (tool.creases, tool.snap, tool.profile, tool.bumps) == ("lower", "surface", "polyline", 4)
