"""What the parts of the page share: how they tell it what was done, and how their widgets ask for work."""

from collections.abc import Callable, Hashable, Mapping
from typing import Any, Literal, Protocol, TypeAlias

import viser

from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.page.work_queue import WorkQueue

GOOD, BAD, ASKS = "#1c7a3f", "#c92a2a", "#1f6fd6"
"""Colours of what the page says: it is done, it failed, something is to be done."""

SetMode: TypeAlias = Literal["at once", "slides", "typed"]
"""How a widget sets a value: where it slides or is typed more follows, of which only the last is an edit."""


class PageCommands(Protocol):
    """The page, for its parts."""

    @property
    def chosen(self) -> str | None:
        """The name of the tool that it shows."""

    def say(self, text: str, colour: str = GOOD) -> None:
        """Show a line."""

    def refresh(self) -> None:
        """Show the session's state."""

    def choose(self, name: str | None, *, look: bool) -> None:
        """Show a tool, and let the cameras look at it."""

    def compare(self, baked: BakedFile) -> None:
        """Proposal to show what was baked in place of what is edited."""

    def slide(self, of: Hashable, edit: Callable[[bool], None]) -> None:
        """Show a draft of an edit."""

    def settle(self) -> None:
        """Make an edit of what slides or is typed."""


class TypedText:
    """A line of text that somebody types: what the program shows is put there only where that is something new.

    Args:
        widget: Of the page.
    """

    def __init__(self, widget: Any) -> None:
        self.widget = widget
        self._shown: tuple[str, object] = ("", None)

    def show(self, of: str, value: object) -> None:
        """Show the value of something that has a name."""
        if self._shown != (of, value):
            self._shown = of, value
            self.widget.value = value


def add_group(gui: viser.GuiApi, work: WorkQueue, title: str, actions: Mapping[str, Callable[[], None]]) -> None:
    """A button for each action, in one row."""

    async def clicked(event: Any) -> None:
        # Of several clicks in a row none replaces another.
        work.put(object(), actions[event.target.value])

    gui.add_button_group(title, tuple(actions)).on_click(clicked)


def on(register: Callable[[Any], object], work: WorkQueue, action: Callable[[], None]) -> None:
    """Do something on each click of a button, or each stroke of a key."""

    async def told(_event: object) -> None:
        work.put(object(), action)

    register(told)


def on_set(widget: Any, work: WorkQueue, key: str, action: Callable[[], None]) -> None:
    """Do something where somebody has set a widget; what the program itself shows is no wish of anybody's."""

    async def told(event: Any) -> None:
        if event.client is not None:
            work.put(key, action)

    widget.on_update(told)
