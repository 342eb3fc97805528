"""The extension for Blender, as far as it needs no Blender: `tests/clients/blender_addon_check.py` has the rest."""

import importlib.util
import json
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from kit.command import Wrinkle
from kit.limb import limb_asset, tool, write_tools
from kit.places import ROOT
from wrinklecli.cli import cli
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.read import given_values, load_tools, parse_tools
from wrinklecli.tools.records import identifier
from wrinklecli.tools.schema import TOOLS_SCHEMA

FOLDER = ROOT / "samples" / "blender"
CONFIGS = sorted(each for each in (ROOT / "configs").glob("*.yaml"))


def _loaded() -> ModuleType:
    spec = importlib.util.spec_from_file_location("wrinkle_blender", FOLDER / "wrinkle_blender.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


addon = _loaded()
KINDS = tuple(addon.KINDS)
KEYS = [(kind, key) for kind in KINDS for key in addon.keys_of(TOOLS_SCHEMA, kind)]
# As many digits as the extension writes.
NUMBERS = st.floats(-1e6, 1e6).map(lambda value: float(f"{value:.6g}")) | st.integers(-(2**31), 2**31)
NAMES = st.text(st.characters(categories=["L", "N", "P", "Z", "S"]), max_size=12)
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | NAMES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=3),
    max_leaves=8,
)


@given(VALUES)
def test_a_value_in_one_line_is_read_as_it_was(value: Any) -> None:
    text = addon.flow(value)
    assert yaml.safe_load(text) == value
    assert "\n" not in text


@pytest.mark.parametrize(
    "value", ["80%", "yes", "NULL", "1e5", "0x10", "a: b", "# no", "- a", "brow.L", "none", "a b", ""]
)
def test_text_stays_text(value: str) -> None:
    assert yaml.safe_load(addon.flow({value: value})) == {value: value}


@given(st.lists(st.floats(-1e4, 1e4, width=32), min_size=3, max_size=3))
def test_a_place_is_written_to_a_millionth_of_its_size(place: list[float]) -> None:
    found = addon.tidy(place)
    largest = max(map(abs, place))
    assert max(abs(a - b) for a, b in zip(place, found, strict=True)) <= 5.0001e-6 * largest
    assert yaml.safe_load(addon.flow(found)) == found


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: path.stem)
def test_a_file_that_is_turned_means_the_same(path: Path) -> None:
    values, _ = given_values(path)
    turned = addon.z_up(values)
    assert turned["up"] == "z"
    assert addon.z_up(turned) == turned
    read, again = (parse_tools(json.dumps(each), name="t.yaml") for each in (values, turned))
    assert read.effects == again.effects


def test_mirror_planes_and_offsets_are_turned_too() -> None:
    anchor = {"joint": "hips", "offset": [1, 2, 3]}
    file = {
        "version": 1,
        "defaults": {"mirror": "z"},
        "tools": [{"name": "a.L", "path": [[1, 2, 3], {"marker": "m"}], "width": 1, "mirror": "y"}],
        "muscles": [{"name": "b.L", "origin": anchor, "insertion": [4, 5, 6]}],
        "touches": [{"name": "c", "at": [1, 2, 3], "pad": 1, "by": anchor, "towards": [7, 8, 9]}],
        "fields": [{"name": "d.L", "mirror": "z", "joints": ["hip.L"]}],
    }
    found = [parse_tools(json.dumps(each), name="t.yaml") for each in (file, addon.z_up(file))]
    assert found[0].effects == found[1].effects


def places(key_schema: dict[str, Any], place: list[int]) -> list[Any]:
    """The values of a key that hold a place, as far as the schema knows such."""
    if "else" in key_schema:
        inner = key_schema["then"].get("properties", {})
        held = [{key: each} for key, part in inner.items() for each in places(part, place)]
        return held + places(key_schema["else"], place)
    if key_schema.get("items", {}).get("minItems") == 3:
        return [[each] for each in places(key_schema["items"], place)]
    return [place] if key_schema.get("minItems") == key_schema.get("maxItems") == 3 else []


@pytest.mark.parametrize("kind", [kind for kind, each in addon.KINDS.items() if each.points])
def test_every_place_of_the_schema_is_turned(kind: str) -> None:
    keys = TOOLS_SCHEMA["properties"][kind]["items"]["properties"]
    pairs = [
        ({key: value}, {key: turned})
        for key, each in keys.items()
        for value, turned in zip(places(each, [1, 2, 3]), places(each, [1, -3, 2]), strict=True)
    ]
    assert len(pairs) >= 1
    assert addon.z_up({kind: [value for value, _ in pairs]})[kind] == [turned for _, turned in pairs]


@given(st.text(st.sampled_from("LRlr._-: abLeftRightEFIGHT"), max_size=12))
def test_sides_are_those_of_the_tools_file(name: str) -> None:
    assert addon.other_side(name) == exchange_sides(name)


@pytest.mark.parametrize(
    ("text", "other"),
    [
        ("{morph: browDownLeft}", "{morph: browDownRight}"),
        ("[shirt.L, sleeve.R]", "[shirt.R, sleeve.L]"),
        ("{joint: hand.L, offset: [1.0, 2.0, 3.0]}", "{joint: hand.R, offset: [1.0, 2.0, 3.0]}"),
        ('"upper arm.L"', '"upper arm.R"'),
    ],
)
def test_names_within_a_value_change_sides(text: str, other: str) -> None:
    assert addon.other_side_of_text(text) == other


@given(st.lists(NAMES.filter(bool), max_size=5), NAMES.filter(bool))
def test_a_free_name_differs_where_morph_targets_do(taken: list[str], stem: str) -> None:
    found = addon.free_name(stem, taken)
    assert identifier(found) not in {identifier(each) for each in taken}
    assert found.startswith(stem)


def test_a_row_is_ordered_by_clicks_or_by_edges() -> None:
    assert addon.row([7, 3], {3, 7}, []) == [7, 3]
    assert addon.row([], {3, 7}, []) == [3, 7]
    assert addon.row([5, 9, 2, 8], {9, 2, 8}, []) == [9, 2, 8]
    chain = [(4, 6), (6, 5), (5, 1)]
    assert addon.row([], {1, 4, 5, 6}, chain) == [1, 5, 6, 4]
    assert addon.row([1], {1, 4, 5, 6}, chain) == [4, 6, 5, 1], "what was clicked last is the target"
    for edges in ([(4, 6), (5, 1)], [(4, 6), (4, 5), (4, 1)], [*chain, (1, 4)], []):
        with pytest.raises(ValueError, match="one by one, or a chain"):
            addon.row([], {1, 4, 5, 6}, edges)


@pytest.mark.parametrize(("kind", "key"), KEYS)
def test_every_key_becomes_a_property_and_the_same_value_again(kind: str, key: str) -> None:
    key_schema = addon.keys_of(TOOLS_SCHEMA, kind)[key]
    samples = [addon.flow(key_schema["default"])] if key_schema.get("default") is not None else []
    samples += addon.choices(key_schema)
    for text in samples:
        field = addon.field(key_schema, text)
        assert yaml.safe_load(addon.written(field.value, field.shown.get("subtype"))) == yaml.safe_load(text)
        assert field.shown["description"] == key_schema["description"]
        if isinstance(field.value, float | int) and not isinstance(field.value, bool):
            assert field.shown["min"] <= field.value <= field.shown["max"]
            if "soft_min" in field.shown:
                assert field.shown["min"] <= field.shown["soft_min"] < field.shown["soft_max"] <= field.shown["max"]


def test_ranges_are_those_of_the_schema() -> None:
    tools = addon.keys_of(TOOLS_SCHEMA, "tools")

    def ends(key: str, text: str) -> tuple[Any, float, float]:
        made = addon.field(tools[key], text)
        return made.value, made.shown["min"], made.shown["max"]

    bumps, variation, width = (tools[key] for key in ("bumps", "variation", "width"))
    assert ends("bumps", "5") == (5, bumps["minimum"], bumps["maximum"])
    assert isinstance(ends("bumps", "5")[0], int)
    assert ends("variation", "1") == (1, variation["minimum"], variation["maximum"])
    assert isinstance(ends("variation", "1")[0], float)
    assert ends("width", "0.2") == (0.2, width["minimum"], width["maximum"])
    for key, text in (("width", "80%"), ("max_height", "5 %"), ("compressible", "43%")):
        value, least, greatest = ends(key, text)
        assert addon.written(value, "PERCENTAGE") == text.replace(" ", "")
        head = "version: 1\ntools: [{name: a, origin: [0, 0, 0], target: [1, 0, 0], "
        for bound in (least, greatest):
            parse_tools(f"{head}{'width: 1, ' * (key != 'width')}{key}: {bound}%}}]")
    assert "cloth" in addon.choices(tools["material"])
    assert addon.choices(tools["contact"]) == ["off", "resolve"]
    assert addon.choices(tools["width"]) == []


def test_sliders_and_groups_are_those_of_the_schema() -> None:
    tools = addon.keys_of(TOOLS_SCHEMA, "tools")

    def slides(key: str, text: str) -> tuple[float, float, float]:
        shown = addon.field(tools[key], text).shown
        return shown["soft_min"], shown["soft_max"], shown["step"]

    def spans(slider: dict[str, float]) -> tuple[float, float, float]:
        return slider["minimum"], slider["maximum"], slider["step"]

    assert slides("bumps", "5") == spans(tools["bumps"]["slider"])
    for key, text in (("width", "80%"), ("strength", "0.5"), ("compressible", "43%")):
        low, high, step = slides(key, text)
        assert (low, high, step / addon.STEPS) == pytest.approx(spans(tools[key]["slider"]))
    assert "soft_min" not in addon.field(tools["width"], "0.2").shown, "a slider of per cents says nothing of lengths"
    for kind in KINDS:
        keys = addon.keys_of(TOOLS_SCHEMA, kind)
        assert {key: keys[key]["group"] for key in keys} == {
            key: group for group, members in addon.groups_of(keys).items() for key in members
        }


def test_what_is_written_is_read_as_a_tools_file(tmp_path: Path) -> None:
    entries = {
        "tools": [{"name": "knee", "origin": "[0.0, 1.0, 2.0]", "target": "[0.0, 1.0, 3.0]", "clips": "{walk: 0.8}"}],
        "flesh": [{"name": "belly", "at": "[1.0, 2.0, 3.0]", "radius": "0.2"}],
        "muscles": [],
        "fields": [{"name": "shirt", "node": "shirt", "slack": "5%", "joints": "[arm.L, arm.R]"}],
    }
    header = {"refinement": {"edges_per_interval": 3}, "defaults": {"width": "80%"}}
    (tmp_path / "tools.yaml").write_text(addon.tools_text(header, entries))
    read = load_tools(tmp_path / "tools.yaml")
    tool, region, cloth = read.effects
    assert tool.origin == (0.0, 2.0, -1.0)
    assert tool.clips == {"walk": 0.8}
    assert (read.refinement.edges_per_interval, region.radius) == (3, 0.2)
    assert (cloth.slack, cloth.joints) == (0.05, ("arm.L", "arm.R"))
    entries["tools"][0]["clips"] = "{}\nup: y"
    with pytest.raises(ValueError, match="knee: clips has a line break"):
        addon.tools_text(header, entries)


def test_a_bake_says_how_far_it_is(tmp_path: Path, wrinkle: Wrinkle) -> None:
    limb_asset(rings=7, sides=6).write(tmp_path / "limb.glb")
    write_tools(tmp_path / "tools.yaml", tool(bumps=1), refinement={"max_levels": 0}, sampling={"fps": 4})
    line = addon.bake_command(
        "wrinkle", tmp_path / "limb.glb", tmp_path / "tools.yaml", tmp_path / "out.glb", draft=True
    )
    said = [addon.progress_of(each) for each in wrinkle(*line[1:]).lines]
    steps = [each for each in said if each is not None]
    parts = [part for _, part in steps]
    assert len(parts) > 1
    assert parts == sorted(parts)
    assert parts[-1] == 1
    assert said[-1] is None, "the line that says what was made"


def test_what_a_bake_says_has_no_temporary_names() -> None:
    said = "/t/.w_x.yaml:11: tools[0].bumps: found 0\n/t/out.glb: 1 tool"
    assert addon.without_paths(said, Path("/t/.w_x.yaml"), Path("/t/out.glb")) == "tools[0].bumps: found 0\n1 tool"


@pytest.mark.parametrize("code", [0, 1])
def test_a_job_runs_beside_and_ends_with_its_code(code: int) -> None:
    script = f"import sys; print('progress: two words 50%\\nerror', file=sys.stderr); sys.exit({code})"
    job = addon.Job([sys.executable, "-c", script])
    assert job.wait() == job.code() == code
    assert (job.stage, job.part, job.lines) == ("two words", 0.5, ["error"])


def test_a_job_is_stopped() -> None:
    job = addon.Job([sys.executable, "-c", "import time; time.sleep(60)"])
    assert job.code() is None
    job.stop()
    assert job.wait() != 0


def test_the_command_is_found_in_an_environment_or_on_the_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for place in ("linux/bin/wrinkle", "windows/Scripts/wrinkle.exe", "plain/wrinkle"):
        program = tmp_path / place
        program.parent.mkdir(parents=True)
        program.touch(0o755)
        top = tmp_path / place.split("/")[0]
        assert Path(addon.find_command(str(top))) == program
        assert Path(addon.find_command(str(program))) == program
    monkeypatch.setenv("PATH", str(tmp_path / "linux" / "bin"))
    assert Path(addon.find_command("")) == tmp_path / "linux" / "bin" / "wrinkle"
    monkeypatch.setenv("PATH", str(tmp_path))
    for chosen, said in (("", "no `wrinkle` on the PATH"), (str(tmp_path), "is no `wrinkle`, and no environment")):
        with pytest.raises(FileNotFoundError, match=said):
            addon.find_command(chosen)


def test_the_options_it_calls_are_there() -> None:
    for name, options in {"bake": ("--progress", "--draft"), "schema": ("--read",), "edit": ("--no-browser",)}.items():
        known = {flag for each in cli.commands[name].params for flag in each.opts}
        assert set(options) <= known


def test_the_extension_is_packed_with_its_manifest(tmp_path: Path) -> None:
    for name in ("a.zip", "b.zip"):
        addon.extension_zip(tmp_path / name)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "a.zip") as package:
        assert package.namelist() == ["__init__.py", "blender_manifest.toml"]
        assert package.read("__init__.py") == (FOLDER / "wrinkle_blender.py").read_bytes()
        manifest = tomllib.loads(package.read("blender_manifest.toml").decode())
    assert manifest["version"] == ".".join(map(str, addon.bl_info["version"]))
    # Limits of Blender's own validation.
    assert len(manifest["tagline"]) <= 64
    assert all(len(each) <= 64 for each in manifest["permissions"].values())
    assert manifest["blender_version_min"] == "4.2.0"
