"""The mouse on the mesh: it clicks the two ends of a new tool, chooses tools, and drags their dots and touched skin."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import viser

from wrinklecli.editor.attached import AttachedTool
from wrinklecli.editor.page.key_controls import as_written, key_controls
from wrinklecli.editor.page.viewport import Hit, Viewport
from wrinklecli.editor.page.widgets import ASKS, BAD, PageHost, add_button
from wrinklecli.errors import WrinkleError
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.region import Region

_WIDTH = next(control for control in key_controls() if control.key == "width")
# Distance of two points over that from the eye, below which a hand means one: 5 pixels of a page of 800.
_SAME_SPOT = 0.004
_FRAME = 1 / 30  # seconds between two pictures of skin that springs back
# Seconds without a move after which a hand lets go, which says itself when it does unless its tab is closed.
_HELD_SECONDS = 20.0
_BEGIN = {
    "tool": "Click where the tool begins. It runs across the wrinkles.",
    "muscle": "Click the skin above where the muscle begins.",
    "flesh": "Click the middle of the flesh.",
    "touch": "Click the skin that a tip touches.",
}
_MOVED = {
    "muscle": "play a clip that bends its joint",
    "flesh": "play a clip that moves the body",
    "touch": "play the clip, or drag its dot: the skin slides",
}
_END = "Now click where it ends."
_AGAIN = "Click another place where it ends, or Cancel."


class Pointer:
    """The mouse on the mesh."""

    def __init__(self, page: PageHost) -> None:
        self._page, self._work, self._session = page, page.work, page.session
        self._ends: list[Floats] | None = None  # clicked ends of a new tool; None if no new tool is begun
        self._kind = "tool"  # what these ends are of, a key of `_BEGIN`

    def listen(self, viewport: Viewport) -> None:
        """Take the clicks in a viewport."""
        self._viewport = viewport
        clicks: Any = self._page.server.scene.on_click()
        clicks(self._clicked)

    def add_button(self) -> None:
        """Add the button that begins a new tool."""
        tip = "Click where it begins and where it ends."
        self._new = add_button(self._page, "New tool", self._begin_new, icon=viser.Icon.PLUS, hint=tip)
        tip = "Click the skin where the muscle begins, and where it ends beyond the joint that it bends."
        add_button(self._page, "New muscle", lambda: self._begin("muscle"), icon=viser.Icon.PLUS, hint=tip)
        tip = "Click the middle of flesh that swings, and how far it reaches."
        add_button(self._page, "New flesh", lambda: self._begin("flesh"), icon=viser.Icon.PLUS, hint=tip)
        tip = "Click the skin that a tip touches, and where it drags that skin in the shown clip."
        add_button(self._page, "New touch", lambda: self._begin("touch"), icon=viser.Icon.PLUS, hint=tip)

    def _begin_new(self) -> None:
        if self._ends is None:
            self._ends = []
            self._new.label, self._new.color = "Cancel", "orange"
            self._page.say(_BEGIN[self._kind], ASKS)
        else:
            self._end_new()
            self._page.say("")

    def _begin(self, kind: str) -> None:
        if self._ends is None:
            self._kind = kind
            self._begin_new()

    def _end_new(self) -> None:
        self._ends, self._kind = None, "tool"
        self._viewport.highlight(None)
        self._new.label, self._new.color = "New tool", None

    async def _clicked(self, event: viser.SceneClickEvent) -> None:
        origin, direction = np.array(event.ray_origin, float), np.array(event.ray_direction, float)
        self._work.put_event(lambda: self._click(origin, direction))

    def _click(self, origin: Floats, direction: Floats) -> None:
        hit = self._viewport.hit(origin, direction)
        if self._ends is not None:
            self._click_end(hit, self._ends)
        elif hit is not None:
            self._page.choose(self._viewport.tool_at(hit) or self._page.chosen, look=False)

    def _click_end(self, hit: Hit | None, ends: list[Floats]) -> None:
        """Take a click for an end of the new tool; the first end stays until the second makes a tool."""
        if hit is None:
            self._page.say(f"There is no mesh. {_END if ends else _BEGIN[self._kind]}", ASKS)
        elif not ends:
            ends.append(hit.place)
            self._viewport.highlight(hit)
            self._page.say(_END, ASKS)
        elif _is_same_spot(hit, ends[0]):
            self._page.say(f"It began there. {_AGAIN}", ASKS)
        elif self._kind != "tool":
            self._add_below(ends[0], hit)
        else:
            self._page.commit()
            try:
                name = self._session.add_tool(ends[0].tolist(), hit.place.tolist(), hit.mesh.source.node)
            except WrinkleError as error:
                self._page.say("\n".join((error.lines[0], _AGAIN)), BAD)
                return
            self._end_new()
            self._page.choose(name, look=False)
            problem = next(tool.problem for tool in self._session.tools() if tool.name == name)
            if problem is None:
                self._page.say(f"{name} is new: drag its ends, and the dots at its sides for the width")
            else:
                self._page.say(f"{problem}\nDrag its ends, or Undo.", BAD)

    def _add_below(self, first: Floats, hit: Hit) -> None:
        """Make a muscle, with its insertion below a hit, flesh that reaches to it, or a touch that drags skin to it."""
        makers: dict[str, Callable[[Sequence[float], Sequence[float], str | None], str]] = {
            "muscle": self._session.add_muscle,
            "flesh": self._session.add_flesh,
            "touch": partial(self._session.add_touch, clip=self._page.shown_clip),
        }
        add = makers[self._kind]
        moved = _MOVED[self._kind]
        self._page.commit()
        try:
            name = add(first.tolist(), hit.place.tolist(), hit.mesh.source.node)
        except WrinkleError as error:
            self._page.say("\n".join((error.lines[0], _AGAIN)), BAD)
            return
        self._end_new()
        self._page.choose(name, look=False)
        self._page.say(f"{name} is new: {moved}, and move its sliders")

    def drag(self, kind: str, number: int, origin: Floats, direction: Floats, phase: str) -> None:
        """Move a dot of the chosen tool; see `drawn_scene.Drag`."""
        name = self._page.chosen
        if name is None or phase == "start":
            return
        if kind == "skin":
            self._work.put((kind, number), lambda: self._hold(name, origin, direction))
            if phase == "end":
                self._work.put_event(self._let_go)
            return
        self._work.put((kind, number), lambda: self._move(name, kind, number, origin, direction))
        if phase == "end":
            self._work.put_event(self._page.commit)  # behind the last move

    def _hold(self, name: str, origin: Floats, direction: Floats) -> None:
        """Slide the skin of a touch to where a ray meets it."""
        hand = self._session.hold(name, self._page.shown_clip, self._page.shown_time, origin, direction)
        if hand is None:
            return
        # What springs back from an earlier drag is held again.
        self._work.put_later("let go", _HELD_SECONDS, self._let_go)
        # Finer than a hand is; adding 0 takes the sign of 0 away.
        step = hand.drive.grip / 100.0
        forward, sideways = (np.round(hand.contact[:2] / step) * step + 0.0).tolist()
        slips = ", where it slips" if hand.slips else ""
        self._page.say(f"{name} slides by {forward:.3g} forward and {sideways:.3g} sideways{slips}")
        self._page.show()

    def _let_go(self) -> None:
        """Let skin that is held spring back."""
        hand, since = self._session.hand, time.monotonic()

        def back() -> None:
            self._session.hand = None if hand is None else hand.let_go(time.monotonic() - since)
            if self._session.hand is not None:
                self._work.put_later("let go", _FRAME, back)
            self._page.show()

        self._work.drop("let go")
        back()

    def _move(self, name: str, kind: str, number: int, origin: Floats, direction: Floats) -> None:
        hit, attached = self._viewport.hit(origin, direction), self._session.attached_tools().get(name)
        if hit is None:
            return
        if kind == "anchor":
            self._move_point(name, number, hit, attached)
        elif attached is not None:
            self._move_side(name, hit.place, attached.region)

    def _move_point(self, name: str, number: int, hit: Hit, attached: AttachedTool | None) -> None:
        """Move a point of a tool, which may be dragged back to where the tool fits."""
        ends = [] if attached is None else [anchor.position for anchor in attached.region.anchors]
        neighbours = [*ends[max(number - 1, 0) : number], *ends[number + 1 : number + 2]]
        if any(_is_same_spot(hit, end) for end in neighbours):
            self._page.say("Points next to each other lie apart: the point stays where it was.", ASKS)
            return
        self._page.say("")
        point = hit.place.tolist()
        self._page.slide(
            (name, "anchor", number),
            lambda draft: self._session.move_point(name, number, point, draft=draft),
            dragged=True,
        )

    def _move_side(self, name: str, place: Floats, region: Region) -> None:
        """Let the side of a tool lie at a (3,) place at rest."""
        percent = 200.0 * abs(float(region.at_rest.coordinates(place)[1])) * region.half_width / region.span
        before = next(tool.values.get("width") for tool in self._session.tools() if tool.name == name)
        width = as_written(_WIDTH, max(round(percent, 1), _WIDTH.low), before, region.span)
        self._page.slide(
            (name, "width"),
            lambda draft: self._session.set_value(name, ("width",), width, draft=draft),
            dragged=True,
        )


def _is_same_spot(hit: Hit, place: Floats) -> bool:
    """True if a hand that points at a hit means a (3,) place at rest."""
    return float(np.linalg.norm(hit.place - place)) < _SAME_SPOT * hit.distance
