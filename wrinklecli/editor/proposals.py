"""Tools that the editor proposes, as keys of a tools file: a first guess for a new tool, and the tools of `suggest`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wrinklecli.review.suggest.draft import written_length
from wrinklecli.review.suggest.suggest import Suggestions
from wrinklecli.tools.records import WrinkleTool, in_axes
from wrinklecli.tools.yaml_edit import ToolsText


@dataclass(frozen=True, slots=True)
class Proposal:
    """A tool that `suggest` has found: its keys (Y-up), and one line about the clip that folds the place.

    A tool of the file may have the same name.
    """

    name: str
    why: str
    values: Mapping[str, Any]


def proposed_keys(tool: WrinkleTool) -> dict[str, Any]:
    """The keys of a tool from `suggest.placed`, without its name and its ends."""
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


def proposals_of(found: Suggestions) -> list[Proposal]:
    """Make a proposal of each tool that `suggest` has found."""
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


def to_axes(values: Mapping[str, Any], up: str) -> dict[str, Any]:
    """Convert Y-up places in the keys of a tool to the axes of a file."""
    turned = dict(values)
    for key in ("origin", "target"):
        if key in turned:
            turned[key] = list(in_axes(turned[key], up))
    if "path" in turned:
        turned["path"] = [list(in_axes(point, up)) for point in turned["path"]]
    if up == "z" and turned.get("mirror") in ("y", "z"):
        turned["mirror"] = {"y": "z", "z": "y"}[turned["mirror"]]
    return turned
