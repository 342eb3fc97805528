"""The panel of materials and presets: pictures of the chosen tool with each, one of which a click gives the tool."""

import html
from functools import partial
from typing import Any

import viser

from wrinklecli.editor.page.pictures import ONE, image, picture_of
from wrinklecli.editor.page.viewpoints import clear_time
from wrinklecli.editor.page.viewport import Viewport
from wrinklecli.editor.page.widgets import ASKS, PageHost, show_changed
from wrinklecli.gltf.pixels import Bytes

_GRID = "display:grid;grid-template-columns:repeat(3,1fr);gap:6px;padding:2px 12px 8px;font-size:.8em;line-height:1.2"
_TITLE = "Materials"


class MaterialPanel:
    """Pictures of materials, with their `titles` by name, at the current place of the panel."""

    def __init__(self, page: PageHost, viewport: Viewport) -> None:
        self._page, self._session, self._viewport = page, page.session, viewport
        known = page.session.presets
        own = page.session.settings().presets
        self.titles = {name: known[name].title for name in dict.fromkeys([*own, *known])}
        self._tool: str | None = None
        self._shown = 0  # tools so far
        self._waiting = 0  # pictures that are not drawn yet
        self._time: float | None = None  # at which all are drawn, seconds
        self._pictures: dict[str, Bytes] = {}
        self._folder: Any = page.server.gui.add_folder(_TITLE, expand_by_default=False)
        with self._folder:
            self._grid: Any = page.server.gui.add_html("")
        self._show_grid()

    def show(self, tool: str | None) -> None:
        """Show a tool's pictures, of which there are none if it was another tool before; None hides the panel."""
        show_changed(self._folder, "visible", tool is not None)
        if tool != self._tool:
            self.give_up()
            self._tool, self._time, self._pictures = tool, None, {}
            self._shown += 1
            self._show_grid()

    def draw(self, _value: str, _tab: viser.ClientHandle) -> None:
        """Draw the pictures that are not there yet, as their folder is open."""
        if self._tool is None or self._waiting or len(self._pictures) == len(self.titles):
            return
        self._time, self._waiting = None, len(self.titles)
        for name in self.titles:
            self._page.slow.put(("material", name), partial(self._draw, self._tool, name))

    def give_up(self) -> bool:
        """Draw no more; False if nothing waits to be drawn."""
        waits, self._waiting = self._waiting > 0, 0
        self._folder.label = _TITLE
        return waits

    def _draw(self, tool: str, name: str) -> None:
        """Draw a tool with a material; on the slow thread."""
        if tool != self._tool or not self._waiting:
            return
        raised = self._session.try_material(tool, name)
        if raised is not None and self._time is None:
            self._time = clear_time(raised)  # one time for all, so that they can be compared
        picture = None if raised is None else picture_of(raised, self._time or 0.0, self._viewport.paints)

        def show() -> None:
            if tool != self._tool or not self._waiting:
                return
            self._waiting -= 1
            if picture is not None:
                self._pictures[name] = picture
                self._show_grid()
            done = len(self.titles) - self._waiting
            self._folder.label = f"{_TITLE}: {done} of {len(self.titles)}" if self._waiting else _TITLE

        self._page.work.put(object(), show)

    def take(self, name: str) -> None:
        """Give the chosen tool a material."""
        self._page.commit()
        tool = self._page.chosen
        if tool is None or tool != self._tool:  # none, or one below the skin, which has no material
            self._page.say("Choose a tool first.", ASKS)
            return
        removed = self._session.set_material(tool, name)
        self._page.refresh()
        without = f", without its own {', '.join(removed)}; Undo brings them back" if removed else ""
        self._page.say(f"{tool}: {self.titles[name]}{without}")

    def _show_grid(self) -> None:
        cells = [
            f'<div data-say="material {number}" title="{html.escape(name)}" style="cursor:pointer">'
            f"{image(self._pictures.get(name), ONE)}{html.escape(title)}</div>"
            for number, (name, title) in enumerate(self.titles.items())
        ]
        self._grid.content = f'<div style="{_GRID}" data-seen="draw {self._shown}">{"".join(cells)}</div>'
