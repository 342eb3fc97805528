"""A script runs in each tab for keys and the mouse, and says in a hidden line what viser has no message for.

Elements of the page's own HTML say something when they are pressed (`data-say`), when the mouse comes over them
(`data-over`), and when they come in sight (`data-seen`). While one of them has `data-hover`, the place of the mouse in
the view is said, too. A style in each tab puts what `data-strip` marks below the view.
"""

import html
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeAlias, TypeVar

import viser

from wrinklecli.editor.page.widgets import PageHost

Heard: TypeAlias = Callable[[str, viser.ClientHandle], object]
"""Called with a value that a tab says, and the tab."""
_Thing = TypeVar("_Thing")

_LINE = "said by the tab"  # title of the hidden line
# viser docks panels left and right only. So a grid lays out the view, the strip below it, and the panel beside both. On
# a narrow page viser lays its panel over the view: there, the panel is below the view, and the strip at its lower end.
_STYLE = """
[data-dock-root] { display: grid; grid-template: minmax(0, 1fr) auto / auto minmax(0, 1fr) auto }
[data-dock-root] > :first-child { position: relative !important; inset: 0 !important; grid-area: 1 / 2 }
[data-dock-region] { position: relative !important; grid-area: 1 / 1 / span 2 }
[data-dock-region="right"] { grid-column: 3 }
[data-floating-window]:has([data-strip]) {
  position: relative !important; inset: 0 !important; width: auto !important; grid-area: 2 / 2;
  [data-dock-resize], [data-dock-griphandle] { display: none !important }
  [data-dock-group] { flex-direction: row !important }
  [data-dock-strip] { flex-direction: column; background: none !important }
  [data-dock-group] > :last-child { flex: 1; min-width: 0; container-type: inline-size }
}
div:has(> div [data-dock-root]):has(> .mantine-Paper-root) {
  flex-direction: column;
  > .mantine-Paper-root { position: static !important; width: 100% !important; flex-shrink: 0 }
  .mantine-ScrollArea-viewport { scroll-padding-bottom: 12em }
  .mantine-ScrollArea-content > div { width: 100% !important }
}
div:has(> .mantine-Tabs-root [data-strip]) {
  position: sticky; bottom: 0; z-index: 9; background: var(--mantine-color-body); container-type: inline-size
}
div:has(> [data-strip]) { display: none }
/* A tab with little in it, and no tool's curve, leave the view as high as it is. */
div:has(> div > [data-strip]) {
  display: grid; grid-template-columns: repeat(auto-fit, minmax(15em, 1fr)); align-content: start;
  min-height: 7em; padding-top: .5em !important;
  @container (max-width: 40em) { min-height: 9.5em }
  @container (max-width: 31em) { min-height: 10.8em }
  div:has(> p > label) { width: 4.2em !important }
}
div:has(> div > [data-strip="play"]) {
  grid-template: auto auto minmax(64px, auto) / 3fr 2fr;
  > :nth-child(n + 4) { grid-column: span 2 }
  > :nth-child(5) { padding: 0 3.6em 0 4.2em }
  @container (min-width: 40em) {
    grid: auto minmax(64px, auto) / auto-flow 15em 1fr;
    > :nth-child(n + 4) { grid-column: auto }
  }
}
/* The scroll bar leaves the widgets free. */
.mantine-ScrollArea-content:not(.mantine-ScrollArea-content *) { padding-right: .7em }
/* viser's own notes lie low in the panel, not over the view, go in 20 s, and take clicks on their buttons alone. */
.mantine-Notifications-root { inset: auto .7em .7em auto !important }
div:has(> div [data-dock-root]):has(> .mantine-Paper-root) .mantine-Notifications-root { bottom: 12em !important }
.mantine-Notification-root { pointer-events: none !important; animation: go 1s 20s forwards }
@keyframes go { to { opacity: 0; visibility: hidden } }
.mantine-Notification-root button { pointer-events: all }
"""
# Fields keep the keyboard focus after a click, even checkboxes, and the page's commands hear no key then. This script
# passes Ctrl-S on, and Ctrl-Z too unless a line of text has the focus, where it undoes typing. Enter leaves a field.
# A command hears a key that goes down, but not when it is released: B, if it was held, is pressed again then. What is
# pressed says so as the button goes down: a click would be lost if it is drawn anew meanwhile.
_SCRIPT = """
if (!window.wrinkleKeys) {
  window.wrinkleKeys = true;
  document.head.append(Object.assign(document.createElement("style"), {textContent: `STYLE`}));
  // viser drops a text that another one follows at once. A random number makes each text a new one.
  const waiting = new Map();
  let sends = false;
  const send = () => {
    sends = waiting.size > 0;
    if (!sends) return;
    const [kind, value] = waiting.entries().next().value;
    waiting.delete(kind);
    const line = [...document.querySelectorAll("label")].find(each => each.innerText === "LINE");
    const box = line?.closest("div:has(input)").querySelector("input");
    if (box) {
      const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
      set.call(box, `${Math.random()} ${kind} ${value}`);
      box.dispatchEvent(new Event("input", {bubbles: true}));
    }
    setTimeout(send, 100);
  };
  const say = (kind, value) => {
    waiting.set(kind, value);
    if (!sends) send();
  };
  const sayOf = text => say(...text.split(" "));
  const press = keys => {
    for (const kind of ["keydown", "keyup"])
      document.body.dispatchEvent(new KeyboardEvent(kind, {...keys, bubbles: true, cancelable: true}));
  };
  document.addEventListener("keydown", event => {
    const field = event.target;
    if (!event.isTrusted) return;
    if (!field.matches("input, textarea")) {
      if (event.key === "?") say("keys", "");
      return;
    }
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
  let over = "";
  document.addEventListener("mouseover", event => {
    const found = event.target.closest("[data-over]")?.dataset.over ?? "";
    if (found !== over) sayOf(found || over.split(" ")[0] + " ");
    over = found;
  });
  const sayPlace = (kind, event, more = "") => {
    const box = event.target.getBoundingClientRect();
    say(kind, `${(event.clientX - box.x) / box.width} ${(event.clientY - box.y) / box.height}${more}`);
  };
  document.addEventListener("pointermove", event => {
    if (event.target.matches("canvas") && document.querySelector("[data-hover]")) sayPlace("at", event);
  }, true);
  // A drag with Shift turns the light, and one with a brush paints; neither turns the view.
  let drags = "";
  for (const kind of ["pointerdown", "pointermove", "pointerup"])
    document.addEventListener(kind, event => {
      if (kind === "pointerdown") {
        const brush = document.querySelector("[data-brush]") ? "paint" : "";
        drags = event.button === 0 && event.target.matches("canvas") ? (event.shiftKey ? "light" : brush) : "";
      }
      if (!drags) return;
      event.stopPropagation();
      const more = drags === "light" ? "" : ` ${Number(event.altKey) + 2 * Number(kind === "pointerup")}`;
      if (event.target.matches("canvas")) sayPlace(drags, event, more);
      if (kind === "pointerup") drags = "";
    }, true);
  // viser does not say when a folder opens.
  let seen = "";
  setInterval(() => {
    const shown = [...document.querySelectorAll("[data-seen]")].find(each => each.getClientRects().length);
    if (shown && shown.dataset.seen !== seen) sayOf(shown.dataset.seen);
    seen = shown?.dataset.seen ?? "";
  }, 300); // ms: a hand that opens a folder waits no longer
  const reset = event => {
    const field = event.target, label = field.closest("div:has(label)")?.querySelector("label");
    const own = label?.innerText.startsWith("×") && (event.type === "dblclick" || field.closest("label"));
    if (own && !field.matches("input, textarea")) say("reset", label.htmlFor);
  };
  // A number that is typed may be beyond the ends of its slider, to which viser would set it when it is left.
  document.addEventListener("focusout", event => {
    if (["decimal", "numeric"].includes(event.target.inputMode)) event.stopPropagation();
  }, true);
  document.addEventListener("click", reset);
  document.addEventListener("dblclick", reset);
  for (const kind of ["pointerdown", "click"])
    document.addEventListener(kind, event => {
      const text = event.target.closest("[data-say]")?.dataset.say;
      // A click by the keyboard has no detail.
      if (text && (kind === "pointerdown" || event.detail === 0)) sayOf(text);
    });
}
""".replace("LINE", _LINE).replace("STYLE", _STYLE)


def run_script(page: PageHost, heard: Mapping[str, Heard]) -> None:
    """Run the script in each tab, and call a function for each kind of what a tab says."""
    gui = page.server.gui
    # viser has no place for scripts, but an image that fails runs one.
    gui.add_html(f'<img src="data:," style="display:none" onerror="{html.escape(_SCRIPT)}">')
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
