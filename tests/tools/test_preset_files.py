"""Files of presets that tools files name: what they say counts, and what is wrong with them has a line."""

from io import BytesIO
from pathlib import Path

import pytest

from kit.places import ROOT
from kit.tools_text import HEAD
from wrinklecli.errors import ConfigError
from wrinklecli.tools.files_beside import files_beside, with_files_beside
from wrinklecli.tools.materials import presets
from wrinklecli.tools.read import load_merged, load_tools
from wrinklecli.tools.records import ToolsFile

STUDIO = "felt: {title: Felt coat, material: cloth, bumps: 2}\nthin: {material: felt, width: 40%}\n"


def tools_of(folder: Path, named: str, material: str = "felt", *, external: bool = False) -> ToolsFile:
    """The tools of a file in a folder that names files of presets."""
    path = folder / "t.yaml"
    path.write_text(f"presets: {named}\n{HEAD}    material: {material}\n    width: 1\n")
    return load_tools(path, external=external)


def lines_of(folder: Path, named: str, material: str = "felt") -> list[str]:
    """The problems of such a file, with the folder left out."""
    with pytest.raises(ConfigError) as raised:
        tools_of(folder, named, material)
    return [line.replace(f"{folder}/", "") for line in raised.value.lines]


@pytest.mark.parametrize("named", ["studio.yaml", "[studio.yaml]", "./studio.yaml", "[more.yaml, studio.yaml]"])
def test_a_tool_has_a_preset_of_a_file(named: str, tmp_path: Path) -> None:
    (tmp_path / "studio.yaml").write_text(STUDIO)
    (tmp_path / "more.yaml").write_text("felt: {bumps: 9}\n")
    found = tools_of(tmp_path, named)
    written = tools_of(tmp_path, "{felt: {material: cloth, bumps: 2}}")
    assert [tool.bumps for tool in found.tools] == [2]
    assert found.tools[0] == written.tools[0]
    assert {*found.presets} == {"felt", "thin"}
    assert str(tmp_path / "studio.yaml") in map(str, map(Path, found.files_beside))


def test_the_built_in_presets_are_such_a_file(tmp_path: Path) -> None:
    (tmp_path / "studio.yaml").write_text((ROOT / "wrinklecli/tools/presets.yaml").read_text())
    assert tools_of(tmp_path, "studio.yaml", "wrist").presets == presets()


def test_presets_of_a_later_file_may_be_made_from_those_of_an_earlier_one(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(STUDIO)
    (tmp_path / "b.yaml").write_text("loden: {material: felt, gap: 1}\n")
    assert tools_of(tmp_path, "[a.yaml, b.yaml]", "loden").tools[0].bumps == 2
    assert lines_of(tmp_path, "[b.yaml, a.yaml]")[0].startswith("b.yaml:1: loden.material: found felt, expected skin,")


def test_merged_files_know_all_files_of_presets(tmp_path: Path) -> None:
    for name in "ab":
        (tmp_path / name).mkdir()
        (tmp_path / name / "studio.yaml").write_text(STUDIO)
        tools_of(tmp_path / name, "studio.yaml")
    other = tmp_path / "b" / "t.yaml"
    other.write_text(other.read_text().replace("name: ", "name: other_"))
    merged = load_merged([tmp_path / "a" / "t.yaml", other])
    assert [*merged.files_beside] == [str(tmp_path / name / "studio.yaml") for name in "ab"]
    assert [*with_files_beside([other])] == [str(other), str(tmp_path / "b" / "studio.yaml")]


@pytest.mark.parametrize(
    ("studio", "lines"),
    [
        ("felt: {bupms: 2}\n", ["studio.yaml:1: felt.bupms: unknown key, did you mean bumps?"]),
        (
            "\nfelt: {bumps: 0}\nthin: {gap: x}\n",
            [
                "studio.yaml:2: felt.bumps: found 0, expected a whole number from 1 to 64",
                "studio.yaml:3: thin.gap: found x, expected a whole number from 0 to 64",
            ],
        ),
        ("- felt\n", ["studio.yaml:1: found a list of 1, expected a mapping of names to keys of tools"]),
        ("", ["studio.yaml:1: the file is empty, expected a mapping of names to keys of tools"]),
        (
            "felt: {mask: {image: face.png}}\n",
            [
                "studio.yaml:1: felt.mask: found a mapping, expected {attribute: …} or none, as an image"
                " belongs to one tools file"
            ],
        ),
    ],
)
def test_mistakes_in_a_file_of_presets_have_a_line_there(studio: str, lines: list[str], tmp_path: Path) -> None:
    (tmp_path / "studio.yaml").write_text(studio)
    assert lines_of(tmp_path, "studio.yaml") == lines


@pytest.mark.parametrize(
    ("named", "line"),
    [
        ("none.yaml", "none.yaml: cannot be read: No such file or directory"),
        (".", ".: cannot be read: Is a directory"),
        ("[5]", "t.yaml:1: presets[0]: found 5, expected text, in quotes where YAML would read a number, true, false"),
        ("[]", "t.yaml:1: presets: found a list of 0, expected a mapping of names to keys of tools, or a file of such"),
        ("''", "t.yaml:1: presets: found '', expected a mapping of names to keys of tools, or a file of such, or a"),
        ('"a\\0b"', "t.yaml:1: presets: found 'a\\x00b', expected a file below the folder of this one"),
        ("../up.yaml", "t.yaml:1: presets: found ../up.yaml, expected a file below the folder of this one; others are"),
        ("/etc/passwd", "t.yaml:1: presets: found /etc/passwd, expected a file below the folder of this one; others"),
        ("[link.yaml]", "t.yaml:1: presets[0]: found link.yaml, expected a file below the folder of this one; others"),
    ],
)
def test_a_file_that_is_none_or_elsewhere_is_refused(named: str, line: str, tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "up.yaml").write_text("felt: {secret: 1}\n")
    (folder / "link.yaml").symlink_to(tmp_path / "up.yaml")
    (found,) = lines_of(folder, named)
    assert found.startswith(line), found


def test_with_external_a_file_may_be_elsewhere(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    (tmp_path / "studio.yaml").write_text(STUDIO)
    found = tools_of(folder, "../studio.yaml", external=True)
    assert (found.tools[0].bumps, found.files_beside) == (2, (str(folder / "../studio.yaml"),))


@pytest.mark.parametrize("kind", ["flesh", "touches"])
def test_the_image_of_a_mask_is_known_whatever_it_masks(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    sizes = {"flesh": "radius: 1", "touches": "pad: 1"}[kind]
    path.write_text(f"version: 1\n{kind}:\n  - {{name: a, at: [0, 0, 0], {sizes}, mask: {{image: soft.png}}}}\n")
    assert load_tools(path).files_beside == (str(tmp_path / "soft.png"),)
    assert [*with_files_beside([path])] == [str(path), str(tmp_path / "soft.png")]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("presets: a.yaml\ntools: 5\n", ["a.yaml"]),
        ("presets: [a.yaml, 5, '', {b: 1}, a.yaml]\n", ["a.yaml"]),
        ("presets: {felt: {mask: {image: a.png}}, thin: 5}\ndefaults: {mask: {image: b.png}}\n", ["b.png", "a.png"]),
        ("tools: [{mask: {image: a.png}}, 5, {mask: none}]\n", ["a.png"]),
        ("flesh: [{mask: {image: a.png}}]\ntouches: [{mask: {image: b.png}}]\n", ["a.png", "b.png"]),
        ('"pre\\x73ets": a.yaml\n', ["a.yaml"]),
        ("[presets]\n", []),
        ("presets: [\n", []),
    ],
)
def test_the_files_of_a_faulty_tools_file_are_known(text: str, named: list[str]) -> None:
    """No output may overwrite them, whatever else is wrong."""
    assert files_beside(BytesIO(text.encode())) == named
