"""Widgets for the keys of a tool, one for each control, in tabs; and for its strength in each clip."""

import json
from collections.abc import Callable, Mapping, Sequence
from itertools import takewhile
from typing import Any

import viser

from wrinklecli.editor.page.key_controls import NONE, KeyControl, as_written, key_controls, percent_of
from wrinklecli.editor.page.widgets import QUIET, SetMode, TypedText, on_user_change, paragraph_of, show_changed
from wrinklecli.tools.effective import EffectiveValue, Source
from wrinklecli.tools.schema import TOOL_KEYS
from wrinklecli.tools.yaml_edit import Steps

Change = Callable[[Steps, Any, SetMode], None]
"""Called with the steps to a value within a tool, the value as the file has it, and how it was set."""

# Words of a dropdown that stand for another widget:
_LENGTH = "a length"
_MAPPING = "by hand"
_OWN = "as below"
# Marks before the title of a key, by the source of its value; what is built in has none.
_MARKS: Mapping[Source, str] = {"tool": "× ", "material": "◇ ", "defaults": "≡ ", "built-in": ""}
_LEGEND = "× set in this tool: click it, or the slider twice, to unset · ◇ from the material · ≡ from the defaults"
_MAX_SHOWN = 24  # characters of a value among those to go back to
_CLIPS_TAB = "Clips"
_USUAL_PERCENT = 25.0  # per cent of the tool's length that a new length has at least
_DIGITS = 3  # decimals of a number from a slider


class ToolControls:
    """Widgets for one effect of a list at a time, such as a tool, and for a tool's strength in each clip of a name.

    `change` is called when the user has set a value.
    """

    def __init__(self, gui: viser.GuiApi, change: Change, clips: Sequence[str], list_key: str) -> None:
        self._gui, self._visible = gui, True

        def change_shown(steps: Steps, value: Any, mode: SetMode) -> None:
            if self._visible:  # a tab may set what it does not show
                change(steps, value, mode)

        self._change: Change = change_shown
        self._values: Mapping[str, Any] = {}
        self._distance = 1.0
        self._shows: list[Callable[[], None]] = []
        self._titled: list[tuple[KeyControl, str, Any]] = []  # widgets that bear the title of a key
        self._widgets: dict[str, Any] = {}  # of the keys that have a single one
        controls = key_controls(list_key)
        tabs = gui.add_tab_group()
        for group in dict.fromkeys(control.group for control in controls):
            with tabs.add_tab(group):
                for control in controls:
                    if control.group == group:
                        self._add(control)
        strength = next((control for control in controls if control.key == "strength"), None)
        if clips and strength is not None:
            with tabs.add_tab(_CLIPS_TAB):
                for clip in clips:
                    self._add_strength(clip, strength)
        self._parts = (tabs, gui.add_html(paragraph_of(_LEGEND, QUIET)))

    def set_visible(self, *, visible: bool) -> None:
        """Show the widgets, or hide them."""
        self._visible = visible
        for each in self._parts:
            show_changed(each, "visible", visible)

    def show(
        self,
        keys: Mapping[str, EffectiveValue],
        inherited: Mapping[str, EffectiveValue],
        distance: float,
        materials: Sequence[str],
    ) -> None:
        """Show the keys of a tool.

        Args:
            keys: The values that count.
            inherited: What the tool's own keys would be if they were unset.
            distance: Distance of its anchors at rest, scene units.
            materials: Names of all materials, those of the file too.
        """
        if "material" in self._widgets:
            show_changed(self._widgets["material"], "options", (*materials, NONE))
        self._values, self._distance = {key: each.value for key, each in keys.items()}, distance
        for show in self._shows:
            show()
        for control, title, widget in self._titled:
            source = keys[control.key].source if control.key in keys else "built-in"
            said = f"{keys[control.key].source_words}: " if control.key in keys else ""
            back = f" × gives it back {_in_words(inherited[control.key])}." if control.key in inherited else ""
            show_changed(widget, "label", _MARKS[source] + title)
            show_changed(widget, "hint", said + control.tip + back)

    def key_of(self, widget: str) -> str | None:
        """The key whose title a widget bears, by the widget's id."""
        return next((control.key for control, _, each in self._titled if each._impl.uuid == widget), None)

    def _add(self, control: KeyControl) -> None:
        """Add the widgets of a key."""
        if control.kind == "list":
            self._add_list(control)
        elif control.kind in ("length", "record") or control.also_json:
            self._add_alternatives(control)
        elif control.kind == "json":
            self._add_json(control, control.title)
        else:
            widget = self._widgets[control.key] = self._titled_widget(control, self._widget(control, control.title))
            on_user_change(widget, lambda: self._set(control, widget.value))
            line = TypedText(widget)

            def show() -> None:
                shown = self._shown(control, self._values.get(control.key))
                if _mode(control) == "typed":
                    line.show(self._values["name"], shown)
                elif control.slides:
                    _slide_to(widget, control, shown)
                else:
                    widget.value = shown

            self._shows.append(show)

    def _titled_widget(self, control: KeyControl, widget: Any) -> Any:
        """Let the title of a widget say where the value of the control's key comes from."""
        self._titled.append((control, widget.label, widget))
        return widget

    def _widget(self, control: KeyControl, title: str) -> Any:
        """Add the widget of a single value."""
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

    def _add_alternatives(self, control: KeyControl) -> None:
        """Add a choice of words, and what some of them stand for: a length, numbers of a mapping, a line of text."""
        key, details = control.key, dict[str, list[Any]]()
        choice: Any = None
        forms = {_LENGTH: control.kind == "length", _OWN: control.kind == "record", _MAPPING: control.also_json}
        words = [*control.choices, *(word for word, is_taken in forms.items() if is_taken)]
        if control.choices:
            choice = self._titled_widget(control, self._gui.add_dropdown(control.title, words, hint=control.tip))
        if _LENGTH in words:
            length = self._widget(control, f"{control.title} (%)")
            if choice is None:
                self._titled_widget(control, length)
            on_user_change(length, lambda: self._set(control, length.value))
            details[_LENGTH] = [length]
        if _OWN in words:
            details[_OWN] = [self._widget(part, part.title) for part in control.parts]
            for each in details[_OWN]:
                on_user_change(each, lambda: self._change((key,), numbers(), "slides"))
        if _MAPPING in words:
            details[_MAPPING] = [self._add_json(control, "…", visible=False)]

        def numbers() -> dict[str, float]:
            pairs = zip(control.parts, details[_OWN], strict=True)
            return {part.key: round(float(slider.value), _DIGITS) for part, slider in pairs}

        def show_detail(word: str) -> None:
            for each, widgets in details.items():
                for widget in widgets:
                    widget.visible = each == word

        def show() -> None:
            value: Any = self._values.get(key)
            word = NONE if value is None else value if value in control.choices else _LENGTH
            if isinstance(value, Mapping | list):
                word = _OWN if _OWN in words else _MAPPING
            if choice is not None:
                choice.value = word if word in words else words[0]
            show_detail(word)
            if word == _LENGTH and _LENGTH in words:
                _slide_to(length, control, percent_of(value, self._distance))
            for part, slider in zip(control.parts, details.get(_OWN, ()), strict=True):
                _slide_to(slider, part, value.get(part.key, part.default) if word == _OWN else part.default)

        def choose() -> None:
            value, before = choice.value, self._values.get(key)
            if value == _MAPPING:
                show_detail(_MAPPING)
                return
            if value == _OWN:
                value = numbers()
            if value == _LENGTH:
                value = length.value if isinstance(before, Mapping) else max(length.value, _USUAL_PERCENT)
                before = None
            self._change((key,), as_written(control, value, before, self._distance), "at once")

        if choice is not None:
            on_user_change(choice, choose)
        self._shows.append(show)

    def _add_json(self, control: KeyControl, title: str, *, visible: bool = True) -> Any:
        """Add a line of text for a value of any form."""
        widget: Any = self._gui.add_text(title, "", hint=control.tip, visible=visible)
        if title == control.title:
            self._titled_widget(control, widget)
        key = control.key

        def change() -> None:
            try:
                value = json.loads(widget.value)
            except ValueError:
                value = widget.value or None
            self._change((key,), value, "typed")

        on_user_change(widget, change)
        line = TypedText(widget)

        def show() -> None:
            value = self._values.get(key)
            line.show(self._values["name"], "" if value is None else json.dumps(value, ensure_ascii=False))

        self._shows.append(show)
        return widget

    def _add_list(self, control: KeyControl) -> None:
        """Add a slider for each number of a list, which ends at its first 0."""
        sliders = [self._widget(part, part.title) for part in control.parts]
        self._titled_widget(control, sliders[0])

        def show() -> None:
            value = self._values.get(control.key) or []
            for number, (part, slider) in enumerate(zip(control.parts, sliders, strict=True)):
                slider.visible = number <= len(value)
                _slide_to(slider, part, value[number] if number < len(value) else 0.0)

        def change() -> None:
            numbers = (round(float(slider.value), _DIGITS) for slider in sliders)
            self._change((control.key,), [*takewhile(bool, numbers)], "slides")

        for slider in sliders:
            on_user_change(slider, change)
        self._shows.append(show)

    def _add_strength(self, clip: str, control: KeyControl) -> None:
        """Add the slider for the tool's strength in a clip."""
        tip = TOOL_KEYS["clips"]["description"]
        slider: Any = self._gui.add_slider(clip, control.low, control.high, control.step, 1.0, hint=f"{clip}: {tip}")

        def show() -> None:
            strength = float((self._values.get("clips") or {}).get(clip, self._values.get("strength", 1.0)))
            _slide_to(slider, control, strength)

        on_user_change(slider, lambda: self._change(("clips", clip), round(slider.value, _DIGITS), "slides"))
        self._shows.append(show)

    def _set(self, control: KeyControl, value: Any) -> None:
        key = control.key
        self._change((key,), as_written(control, value, self._values.get(key), self._distance), _mode(control))

    def _shown(self, control: KeyControl, value: Any) -> Any:
        """Convert a value of the file to that of a widget."""
        if value is None:
            return {"choice": NONE, "text": ""}.get(control.kind, control.low)
        if control.whole:
            return str(value)
        if control.kind == "percent":
            return float(str(value).strip().removesuffix("%"))
        return value


def _slide_to(slider: Any, control: KeyControl, value: float) -> None:
    """Show a value on a slider, also one beyond its ends, where it was typed."""
    show_changed(slider, "min", min(control.low, value))
    show_changed(slider, "max", max(control.high, value))
    slider.value = value


def _mode(control: KeyControl) -> SetMode:
    """The mode in which the control's widget sets its key."""
    return "slides" if control.slides else "at once" if control.kind in ("choice", "flag") else "typed"


def _in_words(inherited: EffectiveValue) -> str:
    """A value to go back to, with its source, in a few words."""
    value = inherited.value if isinstance(inherited.value, str) else json.dumps(inherited.value, ensure_ascii=False)
    short = value if len(value) <= _MAX_SHOWN else f"{value[:_MAX_SHOWN]}…"
    return f"{short} ({inherited.source_words})"
