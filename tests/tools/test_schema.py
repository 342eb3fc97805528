"""The JSON Schema of the tools file: what editors accept and mark is what a bake accepts and refuses."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from jsonschema_rs import Draft202012Validator, meta

from kit.command import Wrinkle, files
from kit.tools_text import ANCHORS, BAD_HEADERS, BAD_TOOL_KEYS, HEAD, LENGTH, NAMES, OPTIONS, README
from wrinklecli.errors import ConfigError
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.schema import TOOLS_SCHEMA
from wrinklecli.tools.yaml_tree import read_tree

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
EXAMPLES = sorted(CONFIGS.glob("*.yaml"))
VALIDATOR = Draft202012Validator(TOOLS_SCHEMA)
# What JSON Schema has no words for: sums and order.
BEYOND = ("details: [0.5, 0.5]", "rest_length: {keys: {a: [[1, 1], [1, 2]]}}")


def values_of(text: str) -> Any:
    """What YAML 1.2 reads, as an editor does; None where the text is no YAML of a tools file."""
    root, problems = read_tree(text)
    return None if root is None or problems else root.value


def accepts(text: str) -> bool:
    value = values_of(text)
    return value is not None and VALIDATOR.is_valid(value)


@pytest.mark.slow
def test_the_schema_is_one() -> None:
    meta.validate(TOOLS_SCHEMA)
    assert TOOLS_SCHEMA["$schema"] == "https://json-schema.org/draft/2020-12/schema"


def test_the_committed_schema_is_what_the_command_prints(wrinkle: Wrinkle, tmp_path: Path) -> None:
    committed = (CONFIGS / "schema.json").read_text()
    ran = wrinkle("schema")
    assert (ran.code, ran.lines) == (0, [])
    assert ran.out == committed, "write it again: wrinkle schema -o configs/schema.json"
    assert wrinkle("schema", "-o", "-").out == committed
    assert (wrinkle("schema", "-o", "s.json").out, wrinkle("schema", "--output", "s.json").code) == ("", 0)
    assert files(tmp_path) == {"s.json": committed.encode()}
    failed = wrinkle("schema", "-o", "absent/s.json")
    assert (failed.code, failed.out, len(failed.lines)) == (1, "", 1)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_examples_are_accepted_and_lead_editors_to_the_schema(path: Path) -> None:
    text = path.read_text()
    (reference,) = re.findall(r"\A# yaml-language-server: \$schema=(\S+)$", text, re.MULTILINE)
    assert json.loads((path.parent / reference).read_text()) == TOOLS_SCHEMA
    assert list(VALIDATOR.iter_errors(values_of(text))) == []
    assert list(VALIDATOR.iter_errors(yaml.safe_load(text))) == []


def test_the_reference_s_example_is_accepted() -> None:
    example = re.findall(r"```yaml\n(.*?)```", README, re.DOTALL)[0]
    assert accepts(example)


@pytest.mark.parametrize("more", [more for more, _ in BAD_TOOL_KEYS if more not in BEYOND])
def test_a_bad_key_of_a_tool_is_marked(more: str) -> None:
    assert accepts(f"{HEAD}    width: 1\n")
    lines = "".join(f"    {line}\n" for line in more.splitlines())
    assert not accepts(f"{HEAD}{lines}    width: 1\n")


@pytest.mark.parametrize("line", [line for line, _ in BAD_HEADERS])
def test_a_bad_header_is_marked(line: str) -> None:
    head = HEAD.removeprefix("version: 1\n") if line.startswith("version") else HEAD
    assert not accepts(f"{line}\n{head}    width: 1\n")


@pytest.mark.parametrize("more", BEYOND)
def test_what_the_schema_cannot_say_a_bake_says(more: str) -> None:
    assert more in dict(BAD_TOOL_KEYS)
    assert accepts(f"{HEAD}    {more}\n    width: 1\n")


@given(
    st.fixed_dictionaries({"name": NAMES, "origin": ANCHORS, "target": ANCHORS}, optional={**OPTIONS, "width": LENGTH})
)
def test_what_a_bake_accepts_is_accepted(written: dict[str, Any]) -> None:
    width = {} if "width" in written else {"width": 1}
    assert list(VALIDATOR.iter_errors({"version": 1, "tools": [written | width]})) == []
    assert list(VALIDATOR.iter_errors({"version": 1, "defaults": width, "tools": [written]})) == []
    shared = {key: value for key, value in written.items() if key not in ("name", "origin", "target")}
    own = {key: written[key] for key in ("name", "origin", "target")}
    assert list(VALIDATOR.iter_errors({"version": 1, "defaults": shared | width, "tools": [own]})) == []


def test_a_width_must_be_somewhere() -> None:
    for header in ("", "defaults:\n", "defaults: {bumps: 3}\n"):
        assert not accepts(header + HEAD)
        assert accepts(f"{header}{HEAD}    width: 1\n")
    assert accepts("defaults: {width: 80%}\n" + HEAD)


@pytest.mark.parametrize(
    ("written", "good"),
    [
        *((text, True) for text in ("0.01%", ".01%", "+00.019 %", "1%", "9999.99%", "10000%", "010000.00%", "100.%")),
        *((text, False) for text in ("0%", "0.009%", "10000.1%", "10001%", "99999%", "-1%", "%", ".%", "1 %%", "1e1%")),
        (f"{'0' * 40}1%", False),
    ],
)
def test_percentages(written: str, good: bool) -> None:
    text = f"{HEAD}    width: {json.dumps(written)}\n"
    assert accepts(text) is good
    if good:
        assert parse_tools(text).tools[0].width.value == pytest.approx(float(written.rstrip(" %")))
    else:
        with pytest.raises(ConfigError, match=r"width: found .* expected a length"):
            parse_tools(text)


def test_sliders_go_up_in_steps_to_values_that_the_key_may_have() -> None:
    def found(schema: Any) -> Iterator[dict[str, Any]]:
        if isinstance(schema, dict):
            yield from [schema] if "slider" in schema else []
        for each in schema.values() if isinstance(schema, dict) else schema if isinstance(schema, list) else ():
            yield from found(each)

    sliders = list(found(TOOLS_SCHEMA))
    assert len(sliders) > 20
    for each in sliders:
        slider = each["slider"]
        low, high = slider["minimum"], slider["maximum"]
        assert 0.0 < slider["step"] <= high - low, slider
        assert each.get("minimum", low) <= low < high <= each.get("maximum", high), slider
