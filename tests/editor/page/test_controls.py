"""Widgets of keys: what stands in the file is what they show, also beyond the ends of a slider."""

import asyncio
import contextlib
from types import SimpleNamespace
from typing import Any

import pytest

from wrinklecli.choices import GROUPS
from wrinklecli.editor.page.controls import ToolControls
from wrinklecli.tools.effective import EffectiveValue, effective_values
from wrinklecli.tools.fields import Field
from wrinklecli.tools.materials import presets
from wrinklecli.tools.schema import ITEMS

OWN = {"name": "a", "origin": [0, 0, 0], "target": [1, 0, 0], "width": "80%"}


class Slider(SimpleNamespace):
    """A slider that a user moves."""

    def on_update(self, called: Any) -> None:
        self.called = called

    def move(self, value: float) -> None:
        self.value = value
        asyncio.run(self.called(SimpleNamespace(client=object())))


class Gui:
    """Keeps sliders and other widgets by their labels, and the labels of tabs."""

    def __init__(self) -> None:
        self.sliders: dict[str, Any] = {}
        self.others: dict[str, Any] = {}
        self.tabs: list[str] = []

    def add_slider(self, label: str, low: float, high: float, *_: float, hint: str) -> Any:
        widget = Slider(label=label, min=low, max=high, hint=hint, visible=True, value=low)
        self.sliders[label] = widget
        return widget

    def add_tab(self, label: str) -> Any:
        self.tabs.append(label)
        return contextlib.nullcontext()

    def add_tab_group(self) -> Any:
        return SimpleNamespace(add_tab=self.add_tab)

    def __getattr__(self, _name: str) -> Any:
        def add(label: str = "", *_: Any, **__: Any) -> Any:
            self.others[label] = SimpleNamespace(
                label=label, options=(), hint="", visible=True, value=None, on_update=lambda _: None
            )
            return self.others[label]

        return add


def controls(list_key: str = "tools", change: Any = lambda *_: None) -> tuple[Gui, ToolControls]:
    gui: Any = Gui()
    return gui, ToolControls(gui, change, ["walk"], list_key)


def show(shown: ToolControls, **own: Any) -> None:
    values: dict[str, EffectiveValue] = effective_values({**OWN, **own}, {}, presets())
    shown.show(values, {}, 1.0, list(presets()))


@pytest.mark.parametrize(
    ("title", "own", "value"),
    [
        ("strength", {"strength": -100}, -100),
        ("walk", {"clips": {"walk": 30}}, 30),
        ("width (%)", {"width": 5.0}, 500),
        ("frequency (Hz)", {"lag": {"frequency": 60, "damping": 1}}, 60),
    ],
)
def test_a_slider_reaches_to_the_value_in_the_file_and_back(title: str, own: dict[str, Any], value: float) -> None:
    gui, shown = controls()
    slider = gui.sliders[title]
    ends = slider.min, slider.max
    assert not ends[0] <= value <= ends[1]
    show(shown, **own)
    assert (slider.value, slider.min, slider.max) == (value, min(ends[0], value), max(ends[1], value))
    show(shown)
    assert (slider.min, slider.max) == ends
    assert ends[0] <= slider.value <= ends[1]


def test_a_field_shows_what_its_material_gives_and_a_list_as_one_by_hand() -> None:
    gui, shown = controls("fields")
    for joints, word in (("all", "all"), (["hip"], "by hand")):
        values = effective_values({"name": "a", "joints": joints}, {}, presets(), Field)
        shown.show(values, {}, 0.5, list(presets()))
        assert gui.others["joints"].value == word
    assert [gui.sliders[title].value for title in ("wavelength (%)", "slack (%)", "variation")] == [10.0, 1.0, 0.15]
    assert gui.others["node"].value == "", "for none"
    assert "clips" not in gui.others


@pytest.mark.parametrize("list_key", ITEMS)
def test_tabs_are_the_groups_of_the_keys_in_their_order(list_key: str) -> None:
    gui, _ = controls(list_key)
    groups = {each["group"] for each in ITEMS[list_key].keys.values()}
    assert gui.tabs == [*(group for group in GROUPS if group in groups), *["Clips"] * (list_key in ("tools", "fields"))]


@pytest.mark.parametrize(
    ("title", "own", "steps", "value"),
    [
        ("walk", {}, ("clips", "walk"), 0.123),
        ("details 1", {"details": [0.5, 0.25]}, ("details",), [0.123]),
        ("damping", {"lag": {"frequency": 3, "damping": 1}}, ("lag",), {"frequency": 3.0, "damping": 0.123}),
    ],
)
def test_a_slider_writes_thousandths(title: str, own: dict[str, Any], steps: tuple[str, ...], value: Any) -> None:
    changes: list[tuple[Any, ...]] = []
    gui, shown = controls(change=lambda *change: changes.append(change))
    show(shown, **own)
    for number, slider in gui.sliders.items():
        if number.startswith("details") and number != title:
            slider.value = 0.0  # which ends the list
    gui.sliders[title].move(0.12345)
    assert changes == [(steps, value, "slides")]
