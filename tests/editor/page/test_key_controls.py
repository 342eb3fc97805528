"""Controls made from the schema: each key has one, and what they write is what the schema takes."""

import pytest
from jsonschema import Draft202012Validator

from wrinklecli.editor.page.key_controls import ELSEWHERE, KeyControl, as_written, key_controls, percent_of
from wrinklecli.tools.schema import TOOL_KEYS

CONTROLS = {control.key: control for control in key_controls()}
PLAIN = [control for control in CONTROLS.values() if control.kind != "json"]


def test_every_key_has_a_control_or_is_set_elsewhere() -> None:
    assert {*CONTROLS, *ELSEWHERE} == set(TOOL_KEYS)
    assert all(control.tip == TOOL_KEYS[key]["description"] for key, control in CONTROLS.items())


@pytest.mark.parametrize("control", PLAIN, ids=lambda each: each.key)
def test_what_a_control_offers_is_valid(control: KeyControl) -> None:
    written = [as_written(control, value, before, 0.2) for value in offered(control) for before in (None, 0.1, "80%")]
    validator = Draft202012Validator(TOOL_KEYS[control.key])
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
