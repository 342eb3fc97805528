"""The tool of a candidate, in the numbers that are written: its name, size and bumps, and its twin across x = 0."""

import math
import re
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from wrinklecli.choices import Part
from wrinklecli.review.suggest.candidates import Candidate
from wrinklecli.review.suggest.text import REST_LENGTH
from wrinklecli.tools.json_schema import readers_of
from wrinklecli.tools.materials import Preset, preset_for
from wrinklecli.tools.mirror import split_side
from wrinklecli.tools.records import Length, WrinkleTool

# Width of a tool over its region's: the attenuation falls to half within the region, and to 0 beyond it.
WIDTH_OF_REGION = 1.4
# The same for a region across x = 0, which is known as a whole and fades by itself.
_WIDTH_ACROSS = 1.15
# The same for one on a trunk: wrinkles fade where its flanks turn away, and a narrower tool would end before them.
_WIDTH_OF_TRUNK = 2.2
_TRUNK: tuple[Part, ...] = ("hips", "spine", "chest", "neck")
# Words of morph targets that raise a forehead.
_BROWS = re.compile(r"brow|forehead", re.IGNORECASE)


def preset_of(candidate: Candidate) -> Preset | None:
    """The preset for what a candidate is made of and for its part of the body; else its substance."""
    material, known = candidate.material, candidate.presets
    if material is None:
        return None
    if candidate.by_morph:
        # A forehead is skin, whatever its colours.
        return known["forehead_young" if _BROWS.search(candidate.driver) else material]
    return preset_for(material, candidate.part, known)


def stem_and_side(driver: str) -> tuple[str, str]:
    """The stem of tools' names, and the side L or R if the driver's name has one.

    The stem is `fold` if the driver's name has no letters that a tool's name may have.
    """
    stem, side = split_side(driver.rsplit(":", 1)[-1])
    words = "".join(c if c.isascii() and c.isalnum() else " " for c in stem).split()
    return "_".join(words if any(c.isalpha() for word in words for c in word) else ["fold"]), side


def renamed(tools: list[WrinkleTool], stem: str, taken: Collection[str]) -> list[WrinkleTool]:
    """Tools with the least number after the stem of their names that makes all identifiers new."""
    found, number = tools, 1
    while any(tool.identifier in taken for tool in found):
        number += 1
        found = [replace(tool, name=f"{stem}_{number}{tool.name[len(stem) :]}") for tool in tools]
    return found


def pair_of(candidate: Candidate, stem: str, side: str) -> list[WrinkleTool]:
    """The tools of a candidate and of its mirror image, the left one first.

    The candidate is on the side that its driver's name has, else it is left for x > 0.
    """
    here = tool_of(candidate, f"{stem}.L", width_of(candidate))
    if (side or ("L" if candidate.region.centre[0] > 0 else "R")) == "R":
        here = across_x(here, here.name)
    return [here, across_x(here, f"{stem}.R")]


def width_of(candidate: Candidate) -> float:
    """The usual width of a candidate's tool, scene units."""
    region, factor = candidate.region, WIDTH_OF_REGION
    if region.on_plane:
        factor = _WIDTH_OF_TRUNK if candidate.part in _TRUNK else _WIDTH_ACROSS
    return min(factor * region.width, candidate.widest)


def across_x(tool: WrinkleTool, name: str) -> WrinkleTool:
    """A tool's mirror image across x = 0."""
    origin, *between, target = ((0.0 - x, y, z) for x, y, z in map(place_of, tool.points))
    return replace(tool, name=name, origin=origin, between=tuple(between), target=target)


def place_of(anchor: object) -> tuple[float, float, float]:
    """An anchor of a suggested tool, which is never a marker."""
    assert isinstance(anchor, tuple)
    return anchor


def tool_of(candidate: Candidate, name: str, width: float) -> WrinkleTool:
    """The tool of a candidate, in the numbers that are written."""
    # Downwards, or else along x or z, whichever way the segment was found.
    axis = int(np.argmax(np.abs(candidate.target - candidate.origin)))
    points = np.stack([candidate.origin, *candidate.between, candidate.target])
    if (points[0, axis] < points[-1, axis]) == (axis == 1):
        points = points[::-1]
    span = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    (a, b, c), *between, (d, e, f) = ([round(float(x), decimals(span)) + 0.0 for x in point] for point in points)
    chosen = preset_of(candidate)
    given = chosen.fields(readers_of(WrinkleTool)) if chosen else {}
    return WrinkleTool(
        name=name,
        node=candidate.mesh.node,
        origin=(a, b, c),
        between=tuple((x, y, z) for x, y, z in between),
        target=(d, e, f),
        material=None if chosen is None else chosen.name,
        **{
            **given,
            "width": Length(round(width, 1 - math.floor(math.log10(width)))),
            "rest_length": "auto" if candidate.by_morph else REST_LENGTH,
            # Bumps that rise one after another stand alone on either side of a joint until it is half bent.
            "strategy": "everywhere",
        },
    )


def decimals(span: float) -> int:
    """Decimals of a position: a hundredth of the span, or finer."""
    return max(2 - math.floor(math.log10(span)), 0)
