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

# Pixels from the corner of the page; what lies below the text takes the clicks.
_OVER_VIEW = "position:fixed;left:15px;top:12px;z-index:5;max-width:min(36em,55vw);max-height:40vh;overflow:hidden;"
_OVER_VIEW += "pointer-events:none;background:#fffd;border-radius:4px"
HIDDEN = '<style>div:has(> div > div > p > label[for="{}"]){{display:none}}</style>'
"""HTML that hides the widget of an id."""
RESET = "reset"
"""Title of a hidden line, by which a tab names the widget of a key to take away."""

# Fields keep the keyboard focus after a click, even checkboxes, and the page's commands hear no key then. This script
# passes Ctrl-S on, and Ctrl-Z too unless a line of text has the focus, where it undoes typing. Enter leaves a field.
# A command hears a key that goes down, but not when it is released: B, if it was held, is pressed again then. What is
# under the mouse is told by a key, too: that of the element, or 0. A press on a material's picture presses the key of
# its command: a click would be lost if the picture is drawn anew meanwhile.
_SCRIPT = """
if (!window.wrinkleKeys) {
  window.wrinkleKeys = true;
  const press = keys => {
    for (const kind of ["keydown", "keyup"])
      document.body.dispatchEvent(new KeyboardEvent(kind, {...keys, bubbles: true, cancelable: true}));
  };
  document.addEventListener("keydown", event => {
    const field = event.target;
    if (!event.isTrusted || !field.matches("input, textarea")) return;
    const clicked = field.readOnly || ["checkbox", "radio"].includes(field.type);
    const isText = !clicked && !["decimal", "numeric"].includes(field.inputMode);
    if (event.key === "Escape") {
      field.blur();
      press({key: "Escape", code: "Escape"});
    }
    if (event.key === "Enter" && !clicked) setTimeout(() => field.blur());
    const key = event.key.toLowerCase();
    if (!(event.ctrlKey || event.metaKey) || !(key === "s" || (key === "z" && !isText))) return;
    event.preventDefault();
    event.stopPropagation();
    field.blur();
    const {ctrlKey, metaKey, shiftKey, code} = event;
    press({key: event.key, code, ctrlKey, metaKey, shiftKey});
  }, true);
  let since = null;
  document.addEventListener("keydown", event => {
    if (!event.isTrusted || event.code !== "KeyB") return;
    if (event.repeat) event.stopPropagation();
    else since = event.timeStamp;
  }, true);
  document.addEventListener("keyup", event => {
    if (!event.isTrusted || event.code !== "KeyB" || since === null || event.target.matches("input, textarea")) return;
    // ms: a longer press is a key that was held.
    if (event.timeStamp - since > 400) press({key: "b", code: "KeyB"});
    since = null;
  }, true);
  let under = "0";
  document.addEventListener("mouseover", event => {
    const key = event.target.closest("[data-wrinkle-key]")?.dataset.wrinkleKey ?? "0";
    if (key !== under) press({key, code: "Digit" + key});
    under = key;
  });
  const reset = event => {
    const field = event.target, label = field.closest("div:has(label)")?.querySelector("label");
    const own = label?.innerText.startsWith("×") && (event.type === "dblclick" || field.closest("label"));
    if (!own || field.matches("input, textarea")) return;
    const line = [...document.querySelectorAll("label")].find(each => each.innerText === "reset");
    const box = line.closest("div:has(input)").querySelector("input");
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(box, label.htmlFor);
    box.dispatchEvent(new Event("input", {bubbles: true}));
  };
  // A number that is typed may be beyond the ends of its slider, to which viser would set it when it is left.
  document.addEventListener("focusout", event => {
    if (["decimal", "numeric"].includes(event.target.inputMode)) event.stopPropagation();
  }, true);
  document.addEventListener("click", reset);
  document.addEventListener("dblclick", reset);
  document.addEventListener("pointerdown", event => {
    const key = event.target.closest("[data-wrinkle-press]")?.dataset.wrinklePress;
    if (key) press({
      key: key.toLowerCase(), code: (/[0-9]/.test(key) ? "Digit" : "Key") + key, altKey: true, shiftKey: true,
    });
  });
}
"""
KEYBOARD = f'<img src="data:," style="display:none" onerror="{html.escape(_SCRIPT)}">'
"""HTML that runs the script once in each tab: viser has no place for scripts, but an image that fails runs one."""


class PageHost(Protocol):
    """The page, as its parts see it, with a queue for quick actions and one for actions that take seconds.

    `chosen` is the name of the tool that the page shows.
    """

    server: viser.ViserServer
    session: Session
    work: WorkQueue
    slow: WorkQueue
    chosen: str | None

    @property
    def shown_clip(self) -> str | None:
        """Name of the clip that is shown, or of the pose; None at rest."""

    @property
    def shown_time(self) -> float:
        """Shown time of the clip, seconds."""

    def say(self, text: str, colour: str = GOOD) -> None:
        """Show a message."""

    def refresh(self) -> None:
        """Show the session's state."""

    def show(self) -> None:
        """Show the player's moment."""

    def choose(self, name: str | None, *, look: bool) -> None:
        """Show a tool, and with `look` turn the cameras to it, at the moment when it is tallest."""

    def compare(self, baked: BakedFile, *, shown: bool = False) -> None:
        """Offer to show a baked file instead of the edited asset, or show it at once."""

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


def add_shortcut(page: PageHost, label: str, action: Action, **keys: Any) -> None:
    """Add a command for an action, with its keys."""
    _on_event(page.server.gui.add_command(label, **keys).on_trigger, page.work, action)


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
