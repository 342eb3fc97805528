"""The mouse on the mesh: it clicks the places of new effects, chooses tools, and drags their dots and touched skin."""

import time
from typing import Any

import numpy as np
import viser

from wrinklecli.editor.attached import AttachedTool
from wrinklecli.editor.clicked import NEW_KINDS
from wrinklecli.editor.page.key_controls import as_written, key_controls
from wrinklecli.editor.page.tab import numbers_of
from wrinklecli.editor.page.viewport import Hit, Viewport
from wrinklecli.editor.page.widgets import ASKS, BAD, PageHost, show_changed
from wrinklecli.errors import WrinkleError
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.region import Region

_WIDTH = next(control for control in key_controls() if control.key == "width")
# Distance of two points over that from the eye, below which a hand means one: 5 pixels of a page of 800.
_SAME_SPOT = 0.004
_FRAME = 1 / 30  # seconds between two pictures of skin that springs back
# Seconds without a move after which a hand lets go, which says itself when it does unless its tab is closed.
_HELD_SECONDS = 20.0
_CANCEL = "Cancel"
_AGAIN = f"Click another place, or {_CANCEL}."
_ROW = "display:grid;grid-template-columns:repeat(5,1fr);gap:4px;padding:2px 12px 6px"
_BUTTON = "padding:4px 0;border:1px solid #ced4da;border-radius:4px;background:none;color:inherit;cursor:pointer;"
_BUTTON += "font:inherit;font-size:.75em"
_PRESSED = "background:#fff3e0;border-color:#e8590c"
# Lines of 24 by 24 units: of each list a folded strip, a shirt, a spindle, a drop that swings, and a tip with rings.
_ICON = '<svg viewBox="0 0 24 24" width="22" height="22" style="display:block;margin:auto" fill="none"'
_ICON += ' stroke="currentColor" stroke-width="1.6" stroke-linecap="round" stroke-linejoin="round"><path d="{}"/></svg>'
_ICONS = {
    "tools": "M3 16c2 0 2-8 4.5-8s2.500 8 4.500 8 2-8 4.500-8 2.500 8 4.500 8",
    "fields": "M9 4c1 2 5 2 6 0l6 4-3 4-2-1v9H8v-9l-2 1-3-4zM9.500 14c2 1 3-1 5 0M9.500 17c2 1 3-1 5 0",
    "muscles": "M3 12c4-1 5-5 9-5s5 4 9 5c-4 1-5 5-9 5s-5-4-9-5zM8 12h8",
    "flesh": "M12 5c3 4 5 6 5 9a5 5 0 0 1-10 0c0-3 2-5 5-9zM3 11v5M21 11v5",
    "touches": "M12 3v7M9 3v6a3 3 0 0 0 6 0V3M8 15c2 2 6 2 8 0M5 17c3 4 11 4 14 0",
}


class Pointer:
    """The mouse on the mesh, and the `buttons` that begin a new effect."""

    def __init__(self, page: PageHost) -> None:
        self._page, self._work, self._session = page, page.work, page.session
        self._new: str | None = None  # list of the file that a new effect is begun for
        self._hits: list[Hit] = []  # that were clicked for it

    def listen(self, viewport: Viewport) -> None:
        """Take the clicks in a viewport."""
        self._viewport = viewport
        clicks: Any = self._page.server.scene.on_click()
        clicks(self._clicked)

    def add_buttons(self) -> None:
        """Add the buttons that begin a new effect, of which the pressed one ends it."""
        self.buttons: Any = self._page.server.gui.add_html("")
        self._show_buttons()

    def press(self, list_key: str) -> None:
        """Begin the new effect whose button is pressed, in place of any other; or end it, if it was begun."""
        before = self._new
        self.give_up()
        if list_key != before:
            self._new = list_key
            self._show_buttons()
            self._viewport.seek(folds=NEW_KINDS[list_key].folds)
            self._page.say(NEW_KINDS[list_key].asks[0], ASKS)

    def _show_buttons(self) -> None:
        pressed = ' aria-pressed="true" data-hover'
        buttons = "".join(
            f'<button data-say="new {number}" style="{_BUTTON};{_PRESSED if key == self._new else ""}"'
            f"{pressed if key == self._new else ''}>{_ICON.format(_ICONS[key])}"
            f"{_CANCEL if key == self._new else kind.title}</button>"
            for number, (key, kind) in enumerate(NEW_KINDS.items())
        )
        show_changed(self.buttons, "content", f'<div style="{_ROW}">{buttons}</div>')

    def hover(self, value: str, tab: viser.ClientHandle) -> None:
        """Show where a click would take a place of the new effect, and the line to it from the one before."""
        if self._new is not None:
            hit = self._viewport.seen(tab.camera, *numbers_of(value, 2))
            self._viewport.point_at([*self._hits[-1:], *([hit] if hit is not None else [])])

    def give_up(self) -> bool:
        """End a new effect; False if none was begun."""
        begun = self._new is not None
        if begun:
            self._end()
            self._page.say("")
        return begun

    def _end(self) -> None:
        self._new, self._hits = None, []
        self._viewport.point_at(())
        self._viewport.seek(folds=False)
        self._show_buttons()

    async def _clicked(self, event: viser.SceneClickEvent) -> None:
        origin, direction = np.array(event.ray_origin, float), np.array(event.ray_direction, float)
        self._work.put_event(lambda: self._click(origin, direction))

    def _click(self, origin: Floats, direction: Floats) -> None:
        hit = self._viewport.hit(origin, direction)
        if self._new is not None:
            self._click_place(hit, self._new)
        elif hit is not None:
            self._page.choose(self._viewport.tool_at(hit) or self._page.chosen, look=False)

    def _click_place(self, hit: Hit | None, list_key: str) -> None:
        """Take a click for a new effect; places before the last one stay until that makes one that fits."""
        kind, hits = NEW_KINDS[list_key], self._hits
        if hit is None:
            self._page.say(f"There is no mesh. {kind.asks[len(hits)]}", ASKS)
        elif hits and _is_same_spot(hit, hits[-1].place):
            self._page.say(f"It began there. {_AGAIN}", ASKS)
        elif len(hits) + 1 < len(kind.asks):
            hits.append(hit)
            self._viewport.point_at(hits)
            self._page.say(kind.asks[len(hits)], ASKS)
        else:
            self._page.commit()
            self._page.say("measuring …", ASKS)  # a field of a dressed body takes seconds
            clicks, node = [each.place.tolist() for each in (*hits, hit)], hit.mesh.source.node
            try:
                name = self._session.add(list_key, clicks, node, clip=self._page.shown_clip)
            except WrinkleError as error:
                self._page.say("\n".join((error.lines[0], _AGAIN)), BAD)
                return
            self._end()
            self._page.choose(name, look=False)
            self._page.say(f"{name} is new: {kind.then}")

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
