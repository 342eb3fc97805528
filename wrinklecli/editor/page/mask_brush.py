"""The brush that paints the mask of the chosen tool on the mesh; the mask is shown in place of the textures."""

from typing import Any

import numpy as np
import viser

from wrinklecli.editor.mask_canvas import MaskCanvas
from wrinklecli.editor.page.tab import numbers_of
from wrinklecli.editor.page.viewport import Viewport
from wrinklecli.editor.page.widgets import ASKS, PageHost, add_button, show_changed, value_within
from wrinklecli.numeric.arrays import Floats

_PAINT, _DONE = "Paint mask", "Mask is done"
_ASKS = "Drag over the skin where wrinkles shall be low; with Alt held, where they shall be high again."
_NO_TEXEL = "The texture coordinates there lie outside the image."
_LEAST, _GREATEST, _USUAL = 1.0, 50.0, 15.0  # per cent of the tool's length, as its other sliders


class MaskBrush:
    """Widgets of the brush, at the current place of the panel."""

    def __init__(self, page: PageHost, viewport: Viewport) -> None:
        self._page, self._session, self._viewport = page, page.session, viewport
        self._canvas: MaskCanvas | None = None
        self._tool, self._length = "", 1.0
        self._before: Floats | None = None  # (3,) the place of the brush before
        gui = page.server.gui
        self._button = add_button(page, _PAINT, self._press, color="gray", hint=f"{_ASKS} Escape drops the mask.")
        self._radius: Any = gui.add_slider("brush (%)", _LEAST, _GREATEST, 1.0, _USUAL, visible=False)
        self._mark: Any = gui.add_html("")

    def show(self, tool: str | None) -> None:
        """Offer to paint the mask of a tool; None if it can have none."""
        show_changed(self._button, "visible", tool is not None)
        if self._canvas is not None and tool != self._tool:
            self.give_up()

    def _press(self) -> None:
        """Begin to paint, or write what was painted."""
        name = self._page.chosen
        if self._canvas is not None:
            canvas = self._canvas
            self.give_up()
            self._page.say(f"{self._tool} has the mask {self._session.set_mask(self._tool, canvas)}")
            self._page.refresh()
        elif name is not None and self._button.visible:
            self._page.commit()
            self._tool, self._canvas, self._length = name, *self._session.mask_canvas(name)
            self._show()
            self._page.say(_ASKS, ASKS)

    def give_up(self) -> bool:
        """Drop what was painted; False if nothing is."""
        painted, self._canvas, self._before = self._canvas is not None, None, None
        if painted:
            self._show()
            self._page.say("")
        return painted

    def _show(self) -> None:
        paints = self._canvas is not None
        self._button.label, self._radius.visible = _DONE if paints else _PAINT, paints
        self._mark.content = "<span data-brush></span>" if paints else ""
        self._viewport.show_mask(self._canvas)

    def paint(self, value: str, tab: viser.ClientHandle) -> None:
        """Move the brush to the mouse; a third number is odd to paint back, and over 1 at the end of a drag."""
        across, down, kind = numbers_of(value, 3)
        hit = self._viewport.seen(tab.camera, across, down)
        if self._canvas is None or hit is None or hit.mesh.source.ground.rig.node != self._canvas.node:
            self._before = None
            return
        radius = value_within(self._radius) / 100.0 * self._length
        start = hit.place if self._before is None else self._before
        if not self._canvas.paint(np.array(start), hit.place, radius, back=kind % 2 == 1):
            self._page.say(_NO_TEXEL, ASKS)
        self._before = None if kind >= 2 else hit.place
        self._viewport.repaint(self._canvas)
