"""The mouse on the mesh: it clicks the two ends of a new tool, chooses tools, and drags their dots."""

from typing import Any

import numpy as np
import viser

from wrinklecli.editor.page.key_controls import as_written, key_controls
from wrinklecli.editor.page.viewport import Viewport
from wrinklecli.editor.page.widgets import ASKS, PageHost, add_button
from wrinklecli.numeric.arrays import Floats

_WIDTH = next(control for control in key_controls() if control.key == "width")
_MIN_WIDTH = 1.0  # per cent of a tool's length, the least width that a drag gives it


class Pointer:
    """The mouse on the mesh."""

    def __init__(self, page: PageHost) -> None:
        self._page, self._work, self._session = page, page.work, page.session
        self._ends: list[Floats] | None = None  # clicked ends of a new tool; None if no new tool is begun

    def listen(self, viewport: Viewport) -> None:
        """Take the clicks in a viewport."""
        self._viewport = viewport
        clicks: Any = self._page.server.scene.on_click()
        clicks(self._clicked)

    def add_button(self) -> None:
        """Add the button that begins a new tool."""
        tip = "Click where it begins and where it ends."
        self._new = add_button(self._page, "New tool", self._begin_new, icon=viser.Icon.PLUS, hint=tip)

    def _begin_new(self) -> None:
        if self._ends is None:
            self._ends = []
            self._new.label, self._new.color = "Cancel", "orange"
            self._page.say("Click where the tool begins. It runs across the wrinkles.", ASKS)
        else:
            self._end_new()
            self._page.say("")

    def _end_new(self) -> None:
        self._ends = None
        self._viewport.highlight(None)
        self._new.label, self._new.color = "New tool", None

    async def _clicked(self, event: viser.SceneClickEvent) -> None:
        origin, direction = np.array(event.ray_origin, float), np.array(event.ray_direction, float)
        self._work.put_event(lambda: self._click(origin, direction))

    def _click(self, origin: Floats, direction: Floats) -> None:
        hit = self._viewport.hit(origin, direction)
        if hit is None:
            return
        if self._ends is None:
            self._page.choose(self._viewport.tool_at(hit) or self._page.chosen, look=False)
            return
        self._ends.append(hit.place)
        if len(self._ends) == 1:
            self._viewport.highlight(hit)
            self._page.say("Now click where it ends.", ASKS)
            return
        first, last = (end.tolist() for end in self._ends)
        self._end_new()
        self._page.commit()
        name = self._session.add_tool(first, last, hit.mesh.source.node)
        self._page.choose(name, look=False)
        self._page.say(f"{name} is new: drag its ends, and the dots at its sides for the width")

    def drag(self, kind: str, number: int, origin: Floats, direction: Floats, phase: str) -> None:
        """Move a dot of the chosen tool; see `drawn_scene.Drag`."""
        name = self._page.chosen
        if name is None or phase == "start":
            return
        self._work.put((kind, number), lambda: self._move(name, kind, number, origin, direction))
        if phase == "end":
            self._work.put("let go", self._page.commit)

    def _move(self, name: str, kind: str, number: int, origin: Floats, direction: Floats) -> None:
        hit, attached = self._viewport.hit(origin, direction), self._session.attached_tools().get(name)
        if hit is None or attached is None:
            return
        if kind == "anchor":
            point = hit.place.tolist()
            self._page.slide(
                (name, kind, number), lambda draft: self._session.move_point(name, number, point, draft=draft)
            )
            return
        patch = attached.patch
        percent = 200.0 * abs(float(patch.coordinates(hit.place)[1])) * patch.half_width / patch.span
        before = next(tool.values.get("width") for tool in self._session.tools() if tool.name == name)
        width = as_written(_WIDTH, max(round(percent, 1), _MIN_WIDTH), before, patch.span)
        self._page.slide((name, "width"), lambda draft: self._session.set_value(name, ("width",), width, draft=draft))
