"""The tool of the other side: what `mirror` makes of a tool, and which part of a name says a side."""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from wrinklecli.tools.records import Marker, Position, RestLengthMorph

_SIDES = {"L": "R", "l": "r", "Left": "Right", "left": "right", "LEFT": "RIGHT"}
_OTHER_SIDE = _SIDES | {right: left for left, right in _SIDES.items()}
# A letter stands alone between separators, a word is no part of another (bright, cleft, Leftover).
_SIDE = re.compile(
    r"(?:^|(?<=[._\- :]))[LRlr](?=$|[._\- :])|(?:Left|Right)(?![a-z])|"
    r"(?<![A-Za-z])(?:left|right)(?![a-z])|(?<![A-Z])(?:LEFT|RIGHT)(?![A-Z])"
)


def exchange_sides(name: str) -> str:
    """A name with each of its sides turned into the other; the same name where it has none."""
    return _SIDE.sub(lambda match: _OTHER_SIDE[match[0]], name)


def split_side(name: str) -> tuple[str, str]:
    """A name without its first side, and `L` or `R` for that; nothing where `mirror` would find none to exchange."""
    match = _SIDE.search(name)
    if match is None:
        return name, ""
    return name[: match.start()] + name[match.end() :], match[0][0].upper()


def _mirror_anchor(anchor: Position | Marker, axis: str) -> Position | Marker:
    if isinstance(anchor, Marker):
        return Marker(exchange_sides(anchor.marker))
    x, y, z = (0.0 - value if axis == name else value for name, value in zip("xyz", anchor, strict=True))
    return (x, y, z)


def mirrored(values: Mapping[str, Any], axis: str) -> dict[str, Any]:
    """The keys of the tool on the other side: whatever names one side names the other."""
    other = dict(values)
    other["name"] = exchange_sides(values["name"])
    for key in ("origin", "target"):
        if key in values:
            other[key] = _mirror_anchor(values[key], axis)
    if "path" in values:
        other["path"] = tuple(_mirror_anchor(point, axis) for point in values["path"])
    if isinstance(values.get("node"), str):
        other["node"] = exchange_sides(values["node"])
    if isinstance(driver := values.get("rest_length"), RestLengthMorph):
        other["rest_length"] = replace(driver, morph=exchange_sides(driver.morph))
    return other
