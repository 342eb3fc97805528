"""The values that count are those of a bake, and each says where it comes from."""

from typing import Any

import pytest

from wrinklecli.tools.effective import effective_values, inherited_values
from wrinklecli.tools.fields import Field
from wrinklecli.tools.json_schema import readers_of
from wrinklecli.tools.materials import presets, presets_of
from wrinklecli.tools.read import read_values
from wrinklecli.tools.records import WrinkleTool

TOOL = {"name": "a", "origin": [0, 0, 0], "target": [1, 0, 0], "width": 1}
OWN_PRESETS: dict[str, Any] = {"cuff": {"material": "cloth", "gap": 2, "profile": "smooth", "max_height": "3%"}}
KNOWN = {**presets(), **presets_of(OWN_PRESETS, presets())}
CASES: list[tuple[dict[str, Any], dict[str, Any]]] = [
    ({}, {}),
    *(({"material": name}, {}) for name in KNOWN),
    *(({}, {"material": name, "profile": "smooth"}) for name in KNOWN),
    ({"material": "cloth", "variation": 0.2, "gap": 2}, {"variation": 0.9, "details": [0.2]}),
    ({"material": None, "lag": None}, {"material": "skin", "lag": {"frequency": 3}}),
    ({"material": "none", "max_height": None}, {"max_height": "5%", "compressible": "12.5%"}),
    ({"material": "skin", "compressible": "0%", "bumps": 4}, {}),
]


@pytest.mark.parametrize(("own", "defaults"), CASES)
def test_the_values_that_count_are_those_of_a_bake(own: dict[str, Any], defaults: dict[str, Any]) -> None:
    own = {**TOOL, **own}
    (tool,) = read_values({"version": 1, "presets": OWN_PRESETS, "defaults": defaults, "tools": [own]}).tools
    readers = readers_of(WrinkleTool)
    found = effective_values(own, defaults, KNOWN)
    for key in {*found, *readers} - {*WrinkleTool.own_keys, "mirror"}:
        assert readers[key](found[key].value) == getattr(tool, key), key


@pytest.mark.parametrize("own", [{}, {"material": "leather"}, {"slack": "7%", "variation": None, "wavelength": "auto"}])
def test_the_values_of_a_field_are_those_of_a_bake(own: dict[str, Any]) -> None:
    """Its material gives them, also where the file asks for that by a word."""
    own = {"name": "a", **own}
    (tool,) = read_values({"version": 1, "fields": [own]}).effects
    readers = readers_of(Field)
    found = effective_values(
        {key: each for key, each in own.items() if each not in (None, "auto")}, {}, presets(), Field
    )
    for key in readers.keys() - {"mirror"}:
        assert readers[key](found[key].value) == getattr(tool, key), key
    sources = {key: found[key].source_words for key in ("slack", "strength")}
    assert sources == {"slack": "own key" if "slack" in own else f"material {tool.material}", "strength": "built in"}


def test_each_value_says_where_it_comes_from() -> None:
    own, defaults = {**TOOL, "material": "skin", "bumps": 5}, {"variation": 0.5, "bumps": 7}
    found = effective_values(own, defaults, KNOWN)
    assert {key: found[key].source_words for key in ("bumps", "variation", "profile", "gap")} == {
        "bumps": "own key",
        "variation": "the file's defaults",
        "profile": "material skin",
        "gap": "built in",
    }
    assert (found["profile"].value, found["compressible"].value) == ("skin", "87%")


def test_a_key_that_is_reset_has_what_it_inherits() -> None:
    own = {**TOOL, "material": "cloth", "bumps": 5, "profile": "smooth"}
    found = inherited_values(own, {"bumps": 7}, KNOWN)
    assert (found["bumps"].value, found["bumps"].source) == (7, "defaults")
    assert (found["profile"].value, found["profile"].source) == ("cloth", "material")
    assert found["material"].value is None
    assert not found.keys() & {"name", "origin", "target", "width"}
