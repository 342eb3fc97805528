"""Mirrors a tool to the other side, and finds the part of a name that says a side."""

import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from itertools import count
from typing import Any

from wrinklecli.tools.body import ActivationMorph
from wrinklecli.tools.records import Position, RestLengthMorph, identifier, moved_point, with_points

_SIDES = {"L": "R", "l": "r", "Left": "Right", "left": "right", "LEFT": "RIGHT"}
_OTHER_SIDE = _SIDES | {right: left for left, right in _SIDES.items()}
# A letter stands alone between separators, a word is no part of another (bright, cleft, Leftover).
_SIDE = re.compile(
    r"(?:^|(?<=[._\- :]))[LRlr](?=$|[._\- :])|(?:Left|Right)(?![a-z])|"
    r"(?<![A-Za-z])(?:left|right)(?![a-z])|(?<![A-Z])(?:LEFT|RIGHT)(?![A-Z])"
)


def exchange_sides(name: str) -> str:
    """A name with left and right exchanged; the same name if it says no side."""
    return _SIDE.sub(lambda match: _OTHER_SIDE[match[0]], name)


def split_side(name: str) -> tuple[str, str]:
    """A name without its first side, and `L` or `R` for that side; no letter if the name says no side."""
    match = _SIDE.search(name)
    if match is None:
        return name, ""
    return name[: match.start()] + name[match.end() :], match[0][0].upper()


def numbered(stem: str, taken: Collection[str]) -> str:
    """A stem with the least number from which no taken identifier comes; a side of the stem stays at its end."""
    body, side = (stem[:-2], stem[-2:]) if stem[-2:] in (".L", ".R") else (stem, "")
    return next(name for number in count(1) if identifier(name := f"{body}_{number}{side}") not in taken)


def mirrored(record: type, values: Mapping[str, Any], axis: str) -> dict[str, Any]:
    """The keys of the effect on the other side of an axis's plane: names of one side become names of the other."""

    def other_side(position: Position) -> Position:
        x, y, z = (0.0 - value if axis == name else value for name, value in zip("xyz", position, strict=True))
        return (x, y, z)

    other = with_points(record, values, lambda point: moved_point(point, other_side, exchange_sides))
    for key in ("name", "node", "joint"):
        if isinstance(values.get(key), str):
            other[key] = exchange_sides(values[key])
    for key in ("node", "meshes", "joints"):
        if isinstance(names := values.get(key), tuple):
            other[key] = tuple(map(exchange_sides, names))
    for key in ("rest_length", "activation"):
        if isinstance(driver := values.get(key), RestLengthMorph | ActivationMorph):
            other[key] = replace(driver, morph=exchange_sides(driver.morph))
    return other
