"""A script runs in each tab for keys and the mouse, and says in a hidden line what viser has no message for.

Elements of the page's own HTML say something when they are pressed (`data-say`), when the mouse comes over them
(`data-over`), and when they come in sight (`data-seen`). While one of them has `data-hover`, the place of the mouse in
the view is said, too. A style in each tab puts what `data-strip` marks below the view. The script is `tab.js`, and the
style `tab.css`.
"""

import html
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypeAlias, TypeVar

import viser

from wrinklecli.editor.page.widgets import PageHost

Heard: TypeAlias = Callable[[str, viser.ClientHandle], object]
"""Called with a value that a tab says, and the tab."""
_Thing = TypeVar("_Thing")

_LINE = "said by the tab"  # title of the hidden line


def run_script(page: PageHost, heard: Mapping[str, Heard]) -> None:
    """Run the script in each tab, and call a function for each kind of what a tab says."""
    gui = page.server.gui
    style, script = (Path(__file__).with_suffix(kind).read_text(encoding="utf-8") for kind in (".css", ".js"))
    script = script.replace("LINE", _LINE).replace("STYLE", style)
    # viser has no place for scripts, but an image that fails runs one.
    gui.add_html(f'<img src="data:," style="display:none" onerror="{html.escape(script)}">')
    line = gui.add_text(_LINE, "")
    gui.add_html(f'<style>div:has(> div > div > p > label[for="{line._impl.uuid}"]) {{ display: none }}</style>')

    @line.on_update
    async def _(event: viser.GuiEvent[viser.GuiTextHandle]) -> None:
        _, kind, value = [*event.target.value.split(" ", 2), "", ""][:3]
        if event.client is not None and kind in heard:
            page.work.put(("said", kind), partial(heard[kind], value, event.client))


def numbers_of(value: str, count: int) -> list[float]:
    """The numbers of a value; zeros if these are not as many as they should be."""
    try:
        found = [float(each) for each in value.split()]
    except ValueError:
        found = []
    return found if len(found) == count and all(map(math.isfinite, found)) else [0.0] * count


def one_of(things: Callable[[], Sequence[_Thing]], action: Callable[[_Thing], object]) -> Heard:
    """Let a tab say the number of a thing, for an action."""

    def heard(value: str, _tab: viser.ClientHandle) -> None:
        numbered = {str(number): thing for number, thing in enumerate(things())}
        if value in numbered:
            action(numbered[value])

    return heard
