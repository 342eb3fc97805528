"""What the hand does on the mesh: it clicks a new tool's two ends, chooses tools, and drags their dots."""

from typing import Any

import numpy as np
import viser

from wrinklecli.editor.page.key_controls import as_written, key_controls
from wrinklecli.editor.page.viewport import Viewport
from wrinklecli.editor.page.widgets import ASKS, PageCommands, on
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.editor.session import Session
from wrinklecli.numeric.arrays import Floats

_WIDTH = next(control for control in key_controls() if control.key == "width")


class Pointer:
    """The pointer on the mesh.

    Args:
        work: Does what it asks for.
        session: What is edited.
        desk: The page.
    """

    def __init__(self, work: WorkQueue, session: Session, desk: PageCommands) -> None:
        self._work, self._session, self._desk = work, session, desk
        self._ends: list[Floats] | None = None  # of a new tool, as far as they have been clicked

    def listen(self, server: viser.ViserServer, picture: Viewport) -> None:
        """Take clicks on the picture of a server."""
        self._picture = picture
        clicks: Any = server.scene.on_click()
        clicks(self._clicked)

    def add_button(self, gui: viser.GuiApi) -> None:
        """Add what begins a new tool."""
        tip = "Click where it begins and where it ends."
        self._new: Any = gui.add_button("New tool", icon=viser.Icon.PLUS, hint=tip)

        on(self._new.on_click, self._work, self._begin_new)

    def _begin_new(self) -> None:
        if self._ends is None:
            self._ends = []
            self._new.label, self._new.color = "Cancel", "orange"
            self._desk.say("Click where the tool begins. It runs across the wrinkles.", ASKS)
        else:
            self._end_new()
            self._desk.say("")

    def _end_new(self) -> None:
        self._ends = None
        self._picture.point_out(None)
        self._new.label, self._new.color = "New tool", None

    async def _clicked(self, event: viser.SceneClickEvent) -> None:
        origin, direction = np.array(event.ray_origin, float), np.array(event.ray_direction, float)
        self._work.put(object(), lambda: self._click(origin, direction))

    def _click(self, origin: Floats, direction: Floats) -> None:
        hit = self._picture.hit(origin, direction)
        if hit is None:
            return
        if self._ends is None:
            self._desk.choose(self._picture.tool_at(hit.mesh, hit.place) or self._desk.chosen, look=False)
            return
        self._ends.append(hit.place)
        if len(self._ends) == 1:
            self._picture.point_out(hit)
            self._desk.say("Now click where it ends.", ASKS)
            return
        first, last = (end.tolist() for end in self._ends)
        self._end_new()
        self._desk.settle()
        name = self._session.add_tool(first, last, hit.mesh.node)
        self._desk.choose(name, look=False)
        self._desk.say(f"{name} is new: drag its ends, and the dots at its sides for the width")

    def drag(self, kind: str, number: int, origin: Floats, direction: Floats, phase: str) -> None:
        """A dot of the chosen tool is dragged; called by the view."""
        name = self._desk.chosen
        if name is None or phase == "start":
            return
        self._work.put((kind, number), lambda: self._move(name, kind, number, origin, direction))
        if phase == "end":
            self._work.put("let go", self._desk.settle)

    def _move(self, name: str, kind: str, number: int, origin: Floats, direction: Floats) -> None:
        hit, laid = self._picture.hit(origin, direction), self._session.attached_tools().get(name)
        if hit is None or laid is None:
            return
        place, patch = hit.place, laid.patch
        if kind == "anchor":
            self._desk.slide(
                (name, kind, number),
                lambda draft: self._session.move_point(name, number, place.tolist(), draft=draft),
            )
        else:
            percent = max(
                round(200.0 * abs(float(patch.coordinates(place)[1])) * patch.half_width / patch.span, 1), 1.0
            )
            before = next(tool.values.get("width") for tool in self._session.tools() if tool.name == name)
            width = as_written(_WIDTH, percent, before, patch.span)
            self._desk.slide(
                (name, "width"), lambda draft: self._session.set_value(name, ("width",), width, draft=draft)
            )
