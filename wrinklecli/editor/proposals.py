"""Tools that the editor offers, as keys of a tools file: a first guess between two places, and what `suggest` finds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from wrinklecli.review.suggest.draft import written_length
from wrinklecli.review.suggest.suggest import Suggestions
from wrinklecli.tools.records import WrinkleTool, in_axes
from wrinklecli.tools.yaml_edit import ToolsText


@dataclass(frozen=True, slots=True)
class Proposal:
    """A tool that `suggest` has found.

    Attributes:
        name: As it found it; the file may have one of this name.
        why: What folds there, in a line.
        values: Its keys, Y-up.
    """

    name: str
    why: str
    values: Mapping[str, Any]


def guessed(tool: WrinkleTool) -> dict[str, Any]:
    """What a tool of `suggest.placed` says beside its name and its ends."""
    values: dict[str, Any] = {"width": tool.width.value}
    if tool.material is not None:
        values["material"] = tool.material
    if tool.material is not None or tool.bumps != WrinkleTool.__dataclass_fields__["bumps"].default:
        values["bumps"] = tool.bumps
    if tool.max_height not in ("auto", None):
        values["max_height"] = written_length(tool.max_height)
    if tool.compressible or tool.material is not None:
        values["compressible"] = f"{100.0 * tool.compressible:.0f}%"
    if tool.rest_length != "auto":
        values["rest_length"] = written_length(tool.rest_length)
    return values


def offers_of(found: Suggestions) -> list[Proposal]:
    """The tools of a file that `suggest` would write, each by itself."""
    file = ToolsText(found.text)
    defaults = {"rest_length": file.defaults.get("rest_length", "auto")} if found.text else {}
    return [
        Proposal(
            name=each.tool.name,
            why=f"{each.driver} shortens it by {100 * each.shortening:.0f} % in {each.clip}",
            values={**values, **{key: value for key, value in defaults.items() if key not in values}},
        )
        for each, values in zip(found.tools, file.tools if found.text else (), strict=True)
    ]


def turned(values: Mapping[str, Any], up: str) -> dict[str, Any]:
    """Keys with Y-up places, in the axes of a file."""

    def place(point: Sequence[float]) -> list[float]:
        return [*in_axes(point, up)]

    found = dict(values)
    for key in ("origin", "target"):
        if key in found:
            found[key] = place(found[key])
    if "path" in found:
        found["path"] = [place(point) for point in found["path"]]
    if up == "z" and found.get("mirror") in ("y", "z"):
        found["mirror"] = {"y": "z", "z": "y"}[found["mirror"]]
    return found
