// Fields keep the keyboard focus after a click, even checkboxes, and the page's commands hear no key then. This script
// passes Ctrl-S on, and Ctrl-Z too unless a line of text has the focus, where it undoes typing. Enter leaves a field.
// A command hears a key that goes down, but not when it is released: B, if it was held, is pressed again then. What is
// pressed says so as the button goes down: a click would be lost if it is drawn anew meanwhile.
// tab.py puts tab.css and the title of the hidden line in the place of the two words in capitals.
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
