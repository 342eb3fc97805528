"""A script of the page: keys that fields keep to themselves reach its commands, so that Ctrl-S always saves.

The page's commands hear no key while a field has the focus, and a field keeps that after a click, even a checkbox.
Ctrl-Z stays with a line of text, where it takes back what was typed; Enter leaves the field.

What serves the page has no place for scripts: an image that is none runs it.
"""

import html

_SCRIPT = """
if (!window.wrinkleKeys) {
  window.wrinkleKeys = true;
  document.addEventListener("keydown", event => {
    const field = event.target;
    if (!event.isTrusted || !field.matches("input, textarea")) return;
    const clicked = field.readOnly || ["checkbox", "radio"].includes(field.type);
    const isText = !clicked && !["decimal", "numeric"].includes(field.inputMode);
    if (event.key === "Enter" && !clicked) setTimeout(() => field.blur());
    const key = event.key.toLowerCase();
    if (!(event.ctrlKey || event.metaKey) || !(key === "s" || (key === "z" && !isText))) return;
    event.preventDefault();
    event.stopPropagation();
    field.blur();
    const {ctrlKey, metaKey, shiftKey, code} = event;
    const again = {key: event.key, code, ctrlKey, metaKey, shiftKey, bubbles: true, cancelable: true};
    document.body.dispatchEvent(new KeyboardEvent("keydown", again));
  }, true);
}
"""

KEYBOARD = f'<img src="data:," style="display:none" onerror="{html.escape(_SCRIPT)}">'
"""HTML that runs it, once for each tab."""
