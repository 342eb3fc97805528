"""Controls made from the schema: each key has one, and what they write is what the schema takes."""

import pytest
from jsonschema_rs import Draft202012Validator

from wrinklecli.choices import GROUPS
from wrinklecli.editor.page.key_controls import ELSEWHERE, KeyControl, as_written, key_controls, percent_of
from wrinklecli.tools.schema import ITEMS

EVERY = {list_key: {control.key: control for control in key_controls(list_key)} for list_key in ITEMS}
CONTROLS = EVERY["tools"]
PLAIN = [
    (list_key, control)
    for list_key, controls in EVERY.items()
    for control in controls.values()
    if control.kind != "json"
]


@pytest.mark.parametrize("list_key", ITEMS)
def test_every_key_has_a_control_or_is_set_elsewhere(list_key: str) -> None:
    keys, controls = ITEMS[list_key].keys, EVERY[list_key]
    assert {*controls, *ELSEWHERE[list_key]} == set(keys)
    assert all(control.tip == keys[key]["description"] for key, control in controls.items())


@pytest.mark.parametrize(("list_key", "control"), PLAIN, ids=lambda each: getattr(each, "key", each))
def test_what_a_control_offers_is_valid(list_key: str, control: KeyControl) -> None:
    written = [as_written(control, value, before, 0.2) for value in offered(control) for before in (None, 0.1, "80%")]
    validator = Draft202012Validator(ITEMS[list_key].keys[control.key])
    assert [value for value in written if not validator.is_valid(value)] == []


def offered(control: KeyControl) -> list[object]:
    """Some values that the widgets of a control can have."""
    if control.kind == "flag":
        return [True, False]
    if control.kind == "text":
        return ["", "a"]
    if control.kind == "list":
        return [[part.high for part in control.parts], []]
    if control.kind == "record":
        return [*control.choices, *({part.key: end(part) for part in control.parts} for end in (lowest, highest))]
    numbers = [] if control.kind == "choice" else [control.low, control.high]
    return [*control.choices, *numbers]


def lowest(control: KeyControl) -> float:
    return control.low


def highest(control: KeyControl) -> float:
    return control.high


def test_a_length_stays_what_it_was_written_as() -> None:
    width = CONTROLS["width"]
    assert as_written(width, 50.0, "80%", 0.2) == "50%"
    assert as_written(width, 50.0, 0.3, 0.2) == 0.1
    assert percent_of(0.1, 0.2) == percent_of("50%", 0.2) == 50.0


@pytest.mark.parametrize("list_key", ITEMS)
def test_controls_stand_in_the_order_of_groups_and_of_the_table(list_key: str) -> None:
    keys, controls = [*ITEMS[list_key].keys], [*EVERY[list_key].values()]
    order = [(GROUPS.index(control.group), keys.index(control.key)) for control in controls]
    assert order == sorted(order)


def test_a_slider_ends_where_values_are_usual_and_not_where_they_are_refused() -> None:
    strength, (frequency, _) = CONTROLS["strength"], CONTROLS["lag"].parts
    keys = ITEMS["tools"].keys
    assert keys["strength"]["minimum"] < strength.low < 0 < strength.high < keys["strength"]["maximum"]
    assert frequency.slides
    assert frequency.high < keys["lag"]["then"]["properties"]["frequency"]["maximum"]


def test_frequency_and_damping_of_flesh_have_sliders() -> None:
    """They are felt while a clip plays."""
    flesh = EVERY["flesh"]
    assert all(flesh[key].slides for key in ("frequency", "damping", "gravity", "limit"))
    assert flesh["frequency"].step == 0.1
    assert flesh["gravity"].high == 100.0
    assert as_written(flesh["shapes"], "3", 6, 0.2) == 3
