"""The tool of a fold, in the numbers that are written: its name, size and bumps, and its twin across x = 0."""

import json
import math
from dataclasses import replace

import numpy as np

from wrinklecli.review.suggest.folds import Fold
from wrinklecli.tools.materials import MATERIALS, usual_bumps
from wrinklecli.tools.mirror import split_side
from wrinklecli.tools.records import Length, RestLengthMorph, WrinkleTool

# Length of a bump, as a part of the patch's width: wrinkles are several times as long as they are wide, those of cloth
# most. There are as many as the material has, or so many more where its bumps would be longer.
_BUMP_OF_WIDTH = {"skin": 0.3, "cloth": 0.15, "leather": 0.3, None: 0.3}
_MORE_BUMPS = 3
# Width of a tool, as a multiple of its region's: the attenuation falls to half within the region, and to 0 beyond it.
# Of a region across x = 0 the whole is known, which fades by itself.
_WIDTH_OF_REGION, _WIDTH_ACROSS = 1.4, 1.15
# Slack before the first wrinkle, per cent of the rest distance, where a joint makes it: clips rarely come back to the
# stored pose, and 1 % already shows.
SLACK = 5


def stem_and_side(driver: str, otherwise: str) -> tuple[str, str]:
    """What tools about a joint or a morph target are named, and L or R where its name says a side.

    Where it has no letters that a tool's name may have, they are named `otherwise`.
    """
    stem, side = split_side(driver.rsplit(":", 1)[-1])
    words = "".join(c if c.isascii() and c.isalnum() else " " for c in stem).split()
    return "_".join(words if any(c.isalpha() for word in words for c in word) else otherwise.split()), side


def newly_named(tools: list[WrinkleTool], stem: str, names: set[str]) -> list[WrinkleTool]:
    """Tools of a stem, with the first number after it that makes none of their identifiers one that is taken."""
    named, number = tools, 1
    while any(tool.identifier in names for tool in named):
        number += 1
        named = [replace(tool, name=f"{stem}_{number}{tool.name[len(stem) :]}") for tool in tools]
    return named


def pair_of(fold: Fold, stem: str, side: str, size: float | None) -> list[WrinkleTool]:
    """The tools of a fold on either side of x = 0, the left one first: on the side of x > 0, or as joints say."""
    region = fold.region
    width = width_of(fold)
    across = abs(float(np.cross(region.normal, region.along)[0]))
    if across > 0.5:
        # Two bells whose middles are half a width apart add up to an even height between them.
        width = min(width, 4.0 * abs(float(region.centre[0])) / across)
    here = tool_of(fold, f"{stem}.L", width, size)
    if (side or ("L" if region.centre[0] > 0 else "R")) == "R":
        here = _across(here, here.name)
    return [here, _across(here, f"{stem}.R")]


def width_of(fold: Fold) -> float:
    """Of a tool, scene units."""
    return min((_WIDTH_ACROSS if fold.region.on_plane else _WIDTH_OF_REGION) * fold.region.width, fold.widest)


def _across(tool: WrinkleTool, name: str) -> WrinkleTool:
    """A tool's mirror image across x = 0."""
    origin, *between, target = ((0.0 - x, y, z) for x, y, z in map(place_of, tool.points))
    return replace(tool, name=name, origin=origin, between=tuple(between), target=target)


def written_length(length: object) -> str:
    """A rest length of a suggested tool, as YAML."""
    if isinstance(length, RestLengthMorph):
        return f"{{morph: {json.dumps(length.morph)}, full: {length.full.value:g}%}}"
    return f"{length.value:g}%" if isinstance(length, Length) else "auto"


def place_of(anchor: object) -> tuple[float, float, float]:
    """An anchor of a suggested tool, which is always a place."""
    assert isinstance(anchor, tuple)
    return anchor


def tool_of(fold: Fold, name: str, width: float, size: float | None = None) -> WrinkleTool:
    """A tool in the numbers that are written."""
    # Downwards, or along x or z, whichever way the direction was found.
    axis = int(np.argmax(np.abs(fold.target - fold.origin)))
    points = np.stack([fold.origin, *fold.between, fold.target])
    if (points[0, axis] < points[-1, axis]) == (axis == 1):
        points = points[::-1]
    span = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    (a, b, c), *between, (d, e, f) = ([round(float(x), decimals(span)) + 0.0 for x in point] for point in points)
    usual = usual_bumps(fold.material)
    longest = _BUMP_OF_WIDTH[fold.material] * width
    if size is not None and longest / 2.0 < size < 1.5 * longest:
        longest = size
    bumps = min(max(usual, round(span / longest)), usual + _MORE_BUMPS)
    if fold.facet:
        # Among flat faces a bump that is shorter than these reads as a step.
        bumps = max(1, min(bumps, int(span / fold.facet)))
    return WrinkleTool(
        name=name,
        node=fold.mesh.node,
        origin=(a, b, c),
        between=tuple((x, y, z) for x, y, z in between),
        target=(d, e, f),
        width=Length(round(width, 1 - math.floor(math.log10(width)))),
        material=fold.material,
        # Bumps that rise one after another stand alone on either side of a joint until it is half bent.
        strategy="everywhere",
        bumps=bumps,
        rest_length="auto" if fold.by_morph else Length(100.0 - SLACK, percent=True),
        **(MATERIALS[fold.material].defaults if fold.material else {}),
    )


def decimals(span: float) -> int:
    """Decimals of a position: a hundredth of the span, or less."""
    return max(2 - math.floor(math.log10(span)), 0)
