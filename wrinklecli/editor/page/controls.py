"""The widgets that set a tool's keys, one for each control of the schema, in tabs; and its strength clip by clip."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import viser

from wrinklecli.editor.page.key_controls import GROUPS, NONE, KeyControl, as_written, key_controls, percent_of
from wrinklecli.editor.page.widgets import SetMode, TypedText
from wrinklecli.tools.schema import TOOL_KEYS

Steps = tuple[str | int, ...]
Change = Callable[[Steps, Any, SetMode], None]
"""Called with the steps to a value within a tool, the value as a file has it, and how it was set."""

_LENGTH, _MAPPING, _OWN = "a length", "by hand", "as below"
_CLIPS = "Clips"


class ToolControls:
    """Widgets for one tool at a time, whose values they show.

    Args:
        gui: The page's.
        change: Called when somebody has set one.
        unset: Called with a key that is to hold what the file's defaults say again.
        clips: Names of all clips.
    """

    def __init__(self, gui: viser.GuiApi, change: Change, unset: Callable[[str], None], clips: Sequence[str]) -> None:
        self._gui, self._change = gui, change
        self._inputs: dict[str, Any] = {}
        self._values: Mapping[str, Any] = {}
        self._distance = 1.0
        self._shows: list[Callable[[], None]] = []
        controls = key_controls()
        tabs = gui.add_tab_group()
        for group in dict.fromkeys([*GROUPS, *(control.group for control in controls)]):
            with tabs.add_tab(group):
                for control in controls:
                    if control.group == group:
                        self._add(control)
        if clips:
            with tabs.add_tab(_CLIPS):
                for clip in clips:
                    self._add_strength(clip)
        self._own: Any = gui.add_dropdown(
            "reset a key", ("–",), hint="Takes it away from the tool: what the file's defaults say holds then."
        )

        def reset() -> None:
            if self._own.value != "–":
                unset(self._own.value)

        self._on(self._own, reset)

    def show(self, values: Mapping[str, Any], own: Sequence[str], distance: float) -> None:
        """Show the values of a tool.

        Args:
            values: What holds, by key.
            own: Keys that the tool itself has.
            distance: Of its anchors at rest, scene units.
        """
        self._values, self._distance = values, distance
        for show in self._shows:
            show()
        self._own.options = ("–", *(key for key in own if key in self._inputs))
        self._own.value = "–"

    def _add(self, control: KeyControl) -> None:
        """Add the widgets of a key."""
        if control.kind in ("list", "record"):
            self._add_parts(control)
        elif control.kind == "length":
            self._add_length(control)
        elif control.kind == "json":
            self._add_json(control, control.title)
        elif control.kind == "choice" and control.also_json:
            self._add_worded(control)
        else:
            made = self._plain(control, control.title)
            self._inputs[control.key] = made
            self._on(made, lambda: self._set(control, (control.key,), made.value))
            line = TypedText(made)

            def show() -> None:
                shown = self._shown(control, self._values.get(control.key))
                if _way(control) == "typed":
                    line.show(self._values["name"], shown)
                else:
                    made.value = shown

            self._shows.append(show)

    def _plain(self, control: KeyControl, title: str) -> Any:
        """The widget of a single value."""
        gui, tip = self._gui, control.tip
        if control.kind == "choice":
            return gui.add_dropdown(title, control.choices, hint=tip)
        if control.kind == "flag":
            return gui.add_checkbox(title, initial_value=False, hint=tip)
        if control.kind == "text":
            return gui.add_text(title, "", hint=tip)
        low, high, step = control.low, control.high, control.step
        start = min(max(0, low), high)
        if control.slides:
            return gui.add_slider(title, low, high, step, start, hint=tip)
        return gui.add_number(title, start, min=low, max=high, step=step, hint=tip)

    def _add_length(self, control: KeyControl) -> None:
        """A slider, and where the key may be a word too, the choice of one."""
        key = control.key
        choice: Any = None
        words = [*control.choices, _LENGTH, *([_MAPPING] if control.also_json else [])]
        if control.choices:
            choice = self._gui.add_dropdown(control.title, words, hint=control.tip)
        title = f"{'' if control.choices else control.title + ' '}(% of length)"
        slider: Any = self._gui.add_slider(
            title, control.low, control.high, control.step, control.low, hint=control.tip
        )
        text = self._add_json(control, "…", visible=False) if control.also_json else None
        self._inputs[key] = slider

        def show() -> None:
            value = self._values.get(key)
            word = NONE if value is None else value if value in control.choices else None
            if isinstance(value, Mapping):
                word = _MAPPING
            slider.visible = word is None
            if text is not None:
                text.visible = word == _MAPPING
            if choice is not None:
                choice.value = word or _LENGTH
            if word is None:
                percent = percent_of(value, self._distance)
                slider.max = max(control.high, percent)
                slider.min = min(control.low, percent)
                slider.value = percent

        def chosen() -> None:
            if choice.value == _MAPPING:
                slider.visible = False
                if text is not None:
                    text.visible = True
                return
            before = self._values.get(key)
            value = choice.value
            if value == _LENGTH:
                before, value = None, slider.value if isinstance(before, Mapping) else max(slider.value, 25.0)
            self._change((key,), as_written(control, value, before, self._distance), "at once")

        if choice is not None:
            self._on(choice, chosen)
        self._on(slider, lambda: self._set(control, (key,), slider.value))
        self._shows.append(show)

    def _add_worded(self, control: KeyControl) -> None:
        """The choice of a word, or a line of text for a mapping."""
        key = control.key
        choice: Any = self._gui.add_dropdown(control.title, (*control.choices, _MAPPING), hint=control.tip)
        text = self._add_json(control, "…", visible=False)
        self._inputs[key] = choice

        def show() -> None:
            value = self._values.get(key)
            text.visible = isinstance(value, Mapping)
            choice.value = _MAPPING if text.visible else value or control.choices[0]

        def chosen() -> None:
            if choice.value == _MAPPING:
                text.visible = True
            else:
                self._change((key,), choice.value, "at once")

        self._on(choice, chosen)
        self._shows.append(show)

    def _add_json(self, control: KeyControl, title: str, *, visible: bool = True) -> Any:
        """A line of text for a value of any form."""
        made: Any = self._gui.add_text(title, "", hint=control.tip, visible=visible)
        key = control.key

        def written() -> None:
            try:
                value = json.loads(made.value)
            except ValueError:
                value = made.value
            self._change((key,), value, "typed")

        self._on(made, written)
        line = TypedText(made)
        self._shows.append(
            lambda: line.show(self._values["name"], json.dumps(self._values.get(key), ensure_ascii=False))
        )
        self._inputs.setdefault(key, made)
        return made

    def _add_parts(self, control: KeyControl) -> None:
        """A slider for each number; those of a list end at the first 0, those of a mapping are there or not at all."""
        key, is_list = control.key, control.kind == "list"
        choice: Any = None
        if not is_list:
            choice = self._gui.add_dropdown(control.title, (*control.choices, _OWN), hint=control.tip)
        made = [self._plain(part, part.title) for part in control.parts]
        self._inputs[key] = choice or made[0]

        def show() -> None:
            value: Any = self._values.get(key) or ([] if is_list else None)
            if choice is not None:
                choice.value = _OWN if isinstance(value, Mapping) else NONE
            for number, (part, each) in enumerate(zip(control.parts, made, strict=True)):
                if is_list:
                    each.visible = number <= len(value)
                    each.value = value[number] if number < len(value) else 0.0
                else:
                    each.visible = isinstance(value, Mapping)
                    each.value = (value or {}).get(part.key, part.default) if each.visible else part.default

        def changed(way: SetMode = "slides") -> None:
            numbers = [round(float(each.value), 3) for each in made]
            if is_list:
                count = next((k for k, number in enumerate(numbers) if number == 0), len(numbers))
                self._change((key,), numbers[:count], way)
            else:
                self._change(
                    (key,), {part.key: number for part, number in zip(control.parts, numbers, strict=True)}, way
                )

        for each in made:
            self._on(each, changed)
        if choice is not None:
            self._on(
                choice, lambda: changed("at once") if choice.value == _OWN else self._change((key,), NONE, "at once")
            )
        self._shows.append(show)

    def _add_strength(self, clip: str) -> None:
        """The tool's strength in a clip."""
        tip = TOOL_KEYS["clips"]["description"]
        made: Any = self._gui.add_slider(clip, -2.0, 2.0, 0.05, 1.0, hint=f"{clip}: {tip}")

        def show() -> None:
            found = float((self._values.get("clips") or {}).get(clip, self._values.get("strength", 1.0)))
            made.min, made.max = min(-2.0, found), max(2.0, found)
            made.value = found

        self._on(made, lambda: self._change(("clips", clip), round(made.value, 3), "slides"))
        self._shows.append(show)

    def _set(self, control: KeyControl, steps: Steps, value: Any) -> None:
        written = as_written(control, value, self._values.get(control.key), self._distance)
        self._change(steps, written, _way(control))

    def _shown(self, control: KeyControl, value: Any) -> Any:
        """A value of a file as a widget has it."""
        if value is None:
            return {"choice": NONE, "text": ""}.get(control.kind, control.low)
        if control.kind == "percent":
            return float(str(value).strip().removesuffix("%"))
        return value

    def _on(self, made: Any, changed: Callable[[], None]) -> None:
        async def told(event: Any) -> None:
            # What the program itself shows is no wish of anybody's.
            if event.client is not None:
                changed()

        made.on_update(told)


def _way(control: KeyControl) -> SetMode:
    """How its widget sets the key."""
    return "slides" if control.slides else "at once" if control.kind in ("choice", "flag") else "typed"
