"""The check of values by a schema finds what a library for all of JSON Schema finds."""

import copy
import random
from pathlib import Path
from typing import Any

import pytest
import yaml
from jsonschema_rs import Draft202012Validator

from wrinklecli.batching.manifest_schema import MANIFEST_SCHEMA
from wrinklecli.tools.checked import faults
from wrinklecli.tools.json_schema import Schema
from wrinklecli.tools.schema import PRESETS_SCHEMA, TOOLS_SCHEMA

ROOT = Path(__file__).parents[2]
# Values of every type, near limits, and words that only some keys take.
ODD = [
    *(None, True, False, 0, 1, -1, 3, 1.0, 0.5, 2.5, 65, 1e10, "", "a", "none", "auto", "x", "5%", "50 %", "101%", "%"),
    *("1e3", "1GB", "both_ends", "wrist", "a" * 300, [], [0], [0, 0, 0], [1, 2, 3, 4], ["a", "a"], [[0, 0.5]], {}),
    *({"a": 1}, {"joint": "a"}, {"marker": "a"}, {"mesh": "a", "joint": "b"}, {"keys": {"a": [[0, 1]]}}),
]
MANIFEST = {"version": 1, "jobs": [{"asset": "a.glb", "tools": "t.yaml", "out": "o.glb", "fps": 30, "clips": ["a"]}]}


def known_keys(schema: Any) -> set[str]:
    """The keys that a schema names anywhere."""
    if isinstance(schema, list):
        return set().union(*map(known_keys, schema))
    if not isinstance(schema, dict):
        return set()
    return set(schema.get("properties", ())).union(*map(known_keys, schema.values()))


def changed(value: Any, keys: list[str], chance: random.Random) -> Any:
    """A copy of a value with one part replaced, dropped or added, anywhere in it."""
    root = [copy.deepcopy(value)]
    holder: Any = root
    step: Any = 0
    while isinstance(holder[step], dict | list) and holder[step] and chance.random() < 0.8:
        holder = holder[step]
        step = chance.choice(list(holder) if isinstance(holder, dict) else range(len(holder)))
    odd, found = copy.deepcopy(chance.choice(ODD)), holder[step]
    match chance.randrange(4):
        case 0 if isinstance(found, dict):
            found[chance.choice(keys)] = odd
        case 1 if isinstance(found, list):
            found.append(odd)
        case 2 if holder is not root:
            del holder[step]
        case _:
            holder[step] = odd
    return root[0]


def texts() -> list[tuple[Schema, Any]]:
    tools = [yaml.safe_load(path.read_text(encoding="utf-8")) for path in sorted((ROOT / "configs").glob("*.yaml"))]
    presets = yaml.safe_load((ROOT / "wrinklecli" / "tools" / "presets.yaml").read_text(encoding="utf-8"))
    return [*((TOOLS_SCHEMA, each) for each in tools), (PRESETS_SCHEMA, presets), (MANIFEST_SCHEMA, MANIFEST)]


@pytest.mark.parametrize("number", range(len(texts())))
def test_faults_are_those_that_a_library_finds(number: int) -> None:
    schema, whole = texts()[number]
    library, keys, chance = Draft202012Validator(schema), sorted(known_keys(schema)), random.Random(number)
    refused = 0
    for _ in range(150):
        value = whole
        for _ in range(chance.choice([1, 1, 2, 4])):
            value = changed(value, keys, chance)
        wanted = {(tuple(each.instance_path), each.schema_path[-1]) for each in library.iter_errors(value)}
        found = {(place, keyword) for place, _, keyword in faults(value, schema)}
        assert found == wanted, value
        refused += bool(wanted)
    assert refused > 20


def test_numbers_and_words_are_told_apart() -> None:
    def accepts(value: Any, **schema: Any) -> bool:
        return not list(faults(value, schema))

    assert accepts(1.0, type="integer")
    assert not accepts(1.5, type="integer")
    assert not accepts(float("inf"), type="integer")
    assert not accepts(True, type=["number", "string"])
    assert not accepts(1, type="boolean")
    assert not accepts(True, enum=[1])
    assert not accepts(float("nan"), minimum=0.0)
    assert not accepts("5%\n", pattern="^[0-9]%$")
    assert not accepts(["a", "b", "a"], uniqueItems=True)
