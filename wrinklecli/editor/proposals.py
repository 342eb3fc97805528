"""Proposals of the editor, as keys of a tools file: a first guess for a new tool, and what `suggest` finds."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from wrinklecli.editor.attached import AttachedTool
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.review.suggest.suggest import Suggestions
from wrinklecli.tools.json_schema import defaults_of
from wrinklecli.tools.materials import presets
from wrinklecli.tools.records import WrinkleTool, usual_effect, written_keys
from wrinklecli.tools.yaml_edit import ToolsText

_SAME_WAY = 0.8  # cosine of the directions of two tools from which they make the same folds; crossing ones are two


@dataclass(frozen=True)
class Proposal:
    """An effect of a list that `suggest` has found: its keys (Y-up), and one line about the clip that folds the place.

    One of the file may have the same name.
    """

    name: str
    why: str
    values: Mapping[str, Any]
    list_key: str = "tools"

    @cached_property
    def _points(self) -> Floats:
        """(points, 3) places from origin to target."""
        points = self.values["path"] if "path" in self.values else [self.values["origin"], self.values["target"]]
        return np.array(points, float)

    def is_taken(self, tool: AttachedTool) -> bool:
        """True if an effect on the proposal's mesh makes the same folds: a field there, or a tool at its middle."""
        if self.list_key not in tool.attached.tool.sections:
            return False
        if tool.attached.segment is None:
            return True
        points, half = self._points, len(self._points) // 2
        middle = points[half] if len(points) % 2 else (points[half - 1] + points[half]) / 2.0
        along = unit((points[-1] - points[0])[None])[0]
        return tool.holds(middle) and abs(float(along @ tool.region.path.along)) > _SAME_WAY


def proposed_keys(tool: WrinkleTool) -> dict[str, Any]:
    """The keys of a tool from `guessed_tools`, without its name and its ends."""
    shown = () if tool.material is None else ("material", "bumps", "compressible")
    values = written_keys(tool, usual_effect(tool, presets()), shown)
    return {key: value for key, value in values.items() if key not in ("name", "origin", "target")}


def proposals_of(found: Suggestions) -> list[Proposal]:
    """Make a proposal of what `suggest` has found, with the defaults of its file that are not built in."""
    if not found.text:
        return []
    file = ToolsText(found.text)
    usual = defaults_of(WrinkleTool)
    defaults = {key: value for key, value in file.defaults.items() if value != usual.get(key)}
    fields = [
        Proposal(each.field.name, each.why, values, "fields")
        for each, values in zip(found.fields, file.of_list("fields").tools, strict=True)
    ]
    tools = [
        Proposal(
            name=each.tool.name,
            why=f"{each.words_of_both}, shortened by {100 * each.shortening:.0f} % in {each.clip}",
            values={**values, **{key: value for key, value in defaults.items() if key not in values}},
        )
        for each, values in zip(found.tools, file.tools, strict=True)
    ]
    return fields + tools
