"""Helpers for the parts of the page: its commands, widgets that queue actions, and keyboard shortcuts."""

import html
from collections.abc import Callable, Hashable, Mapping
from functools import partial
from typing import Any, Literal, Protocol, TypeAlias

import viser

from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.page.work_queue import Action, WorkQueue
from wrinklecli.editor.session import Session

GOOD = "#1c7a3f"
"""Colour of a message about something done."""
BAD = "#c92a2a"
"""Colour of an error message."""
ASKS = "#1f6fd6"
"""Colour of a message that asks for a next step, or about work that goes on."""
QUIET = "#666"
"""Colour of a note."""

SetMode: TypeAlias = Literal["at once", "slides", "typed"]
"""A way to set a value. While a value slides or is typed, more follow, and only the last one is an edit."""

PANEL_WIDTH = 380
"""Pixels of the panel beside the view."""

# Beside the panel, or above it where the page is narrow; what lies below the text takes the clicks.
_OVER_VIEW = f"max-width:min(36em,max(20em,100vw - {PANEL_WIDTH + 45}px));max-height:40vh;overflow:hidden;"
_OVER_VIEW += "position:fixed;left:15px;top:12px;z-index:5;"
_OVER_VIEW += "pointer-events:none;background:#fffd;border-radius:4px"


class PageHost(Protocol):
    """The page, as its parts see it, with a queue for quick actions and one for actions that take seconds.

    `wanted` is a session to show in place of its own, and `known` has the tools file of each asset that was shown, the
    last one first. `chosen` is the name of the tool that the page shows, and `keys` says what each key does.
    """

    server: viser.ViserServer
    session: Session
    work: WorkQueue
    slow: WorkQueue
    wanted: Session | None
    known: dict[str, str]
    chosen: str | None
    keys: dict[str, str]

    @property
    def shown_clip(self) -> str | None:
        """Name of the clip that is shown, or of the pose; None at rest."""

    @property
    def shown_time(self) -> float:
        """Shown time of the clip, seconds."""

    def say(self, text: str, colour: str = GOOD) -> None:
        """Show a message."""

    def show_messages(self) -> None:
        """Show what is said, with the legend of the view."""

    def refresh(self) -> None:
        """Show the session's state."""

    def show(self) -> None:
        """Show the player's moment."""

    def choose(self, name: str | None, *, look: bool) -> None:
        """Show a tool, and with `look` turn the cameras to it, at the moment when it is tallest."""

    def compare(self, baked: BakedFile) -> None:
        """Offer to show a baked file instead of the edited asset."""

    def slide(self, key: Hashable, edit: Callable[[bool], None], *, dragged: bool = False) -> None:
        """Show a draft of an edit; one that is dragged waits for `commit`."""

    def commit(self) -> None:
        """Turn a draft or a typed value into an edit."""


def value_within(slider: Any) -> float:
    """The value of a slider within its ends, beyond which its box lets one type."""
    return float(min(max(slider.value, slider.min), slider.max))


def show_changed(widget: Any, property_name: str, value: object) -> None:
    """Set a property of a widget if it differs, so that no message goes to the tabs otherwise."""
    if getattr(widget, property_name) != value:
        setattr(widget, property_name, value)


class TypedText:
    """A line of text that someone types. The program changes it only to show something new."""

    def __init__(self, widget: Any) -> None:
        self.widget = widget
        self._shown: tuple[str, object] = ("", None)

    def show(self, name: str, value: object) -> None:
        """Show the value of a named thing."""
        if self._shown != (name, value):
            self._shown = name, value
            self.widget.value = value


def add_button(page: PageHost, label: str, action: Action, **options: Any) -> Any:
    """Add a button for an action."""
    button = page.server.gui.add_button(label, **options)
    _on_event(button.on_click, page.work, action)
    return button


def add_shortcut(page: PageHost, label: str, action: Action, hotkey: Any, modifier: Any = None) -> None:
    """Add a command for an action, with its keys, which `?` lists."""
    command = page.server.gui.add_command(label, hotkey=hotkey, modifier=modifier)
    _on_event(command.on_trigger, page.work, action)
    pressed = [*(modifier.replace("cmd/", "").split("+") if modifier else ()), hotkey]
    page.keys["+".join(each.capitalize() for each in pressed)] = label


def add_group(page: PageHost, title: str, actions: Mapping[str, Action]) -> Any:
    """Add a row of buttons, one for each action."""

    async def clicked(event: Any) -> None:
        page.work.put_event(actions[event.target.value])

    group = page.server.gui.add_button_group(title, tuple(actions))
    group.on_click(clicked)
    return group


def _on_event(register: Callable[[Any], object], work: WorkQueue, action: Action) -> None:
    async def called(_event: object) -> None:
        work.put_event(action)

    register(called)


def on_user_change(widget: Any, action: Action) -> None:
    """Call a function when a user sets a widget, but not when the program does."""

    async def called(event: Any) -> None:
        if event.client is not None:
            action()

    widget.on_update(called)


def on_set(page: PageHost, widget: Any, key: str, action: Action) -> None:
    """Perform an action when a user sets a widget, in place of one that waits under the key."""
    on_user_change(widget, partial(page.work.put, key, action))


def paragraph(content: str, colour: str = "inherit") -> str:
    """HTML of a paragraph on the panel."""
    return f'<div style="padding:2px 12px 6px;color:{colour};font-size:.85em;overflow-wrap:anywhere">{content}</div>'


def paragraph_of(text: str, colour: str) -> str:
    """HTML of a paragraph of plain text."""
    return paragraph(html.escape(text).replace("\n", "<br>"), colour)


def over_view(content: str) -> str:
    """HTML in the corner of the 3D view, which grows with its content and takes no clicks."""
    return f'<div style="{_OVER_VIEW}">{content}</div>' if content else ""
