"""The pages for people: what they link to is there, and the map of the program names every room in its order."""

import io
import json
import re
import sys
from pathlib import Path
from subprocess import run

import numpy as np
import pytest
from PIL import Image

from key_pictures import CAPTION, captioned, draw, packed, places, write_sheets
from key_pictures import PICTURES as DRAWN
from kit.places import ROOT

PICTURES_OF_KEYS = [*(ROOT / "samples" / "pictures").glob("key_*.webp")]
PAGES = (*ROOT.glob("*.md"), *ROOT.glob(".github/*.md"), ROOT / "wrinklecli" / "README.md")
PAGES += (*ROOT.glob("configs/*.md"), *ROOT.glob("samples/*.md"), *ROOT.glob("samples/*/README.md"))
PAGES += (*ROOT.glob("tests/*/README.md"),)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8")):
        file, _, anchor = link.partition("#")
        if file.startswith("http"):
            continue
        linked = page.parent / file if file else page
        assert linked.exists(), link
        assert not anchor or anchor in anchors(linked), link


# Words of the longest sentence, and of one in the mean: readers lose the thread of longer ones.
LONGEST, MEAN = 30, 18


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_sentences_are_short(page: Path) -> None:
    found = sentences(page.read_text(encoding="utf-8"))
    assert [sentence for sentence in found if len(sentence.split()) > LONGEST] == []
    assert sum(len(sentence.split()) for sentence in found) <= MEAN * len(found)


def sentences(text: str) -> list[str]:
    """The sentences of a page, of four words at least, without headings, code, pictures and targets of links."""
    text = re.sub(r"```.*?```|^#.*?$|!\[[^]]*\]\([^)]*\)", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", text)
    # Items of lists and cells of tables begin anew.
    text = re.sub(r"^\s*(?:-|\d+\.)\s|(?<!\\)\|", "\n\n", text, flags=re.MULTILINE)
    blocks = (" ".join(block.split()) for block in text.split("\n\n"))
    parts = (part for block in blocks for part in re.split(r"(?<=[.!?:;])\** (?=[A-Z`*\"])", block))
    return [part for part in parts if len(part.split()) > 3]


def test_sentences_are_told_apart() -> None:
    text = "# A head of many words\nOne of two words. *Two* of [a\nlink](there is/more) and `a b`: Three.\n"
    text += "- an item: with a clause; more\n```\nno word of this counts\n```\n"
    text += "| a cell of five words | b |\n|---|---|\n![nor this one here](x.png)\n"
    assert sentences(text) == [
        "One of two words.",
        "*Two* of a link and `a b`:",
        "an item: with a clause; more",
        "a cell of five words",
    ]


def anchors(page: Path) -> set[str]:
    """The headings of a page as GitHub makes anchors of them."""
    lines = page.read_text(encoding="utf-8").splitlines()
    return {re.sub(r"[^\w -]", "", line.lstrip("# ")).lower().replace(" ", "-") for line in lines if line[:1] == "#"}


def test_the_map_names_every_room() -> None:
    table = re.findall(r"^\| \[(\w+)\]\(\1\) \|", (ROOT / "wrinklecli" / "README.md").read_text(), re.MULTILINE)
    rooms = [path.parent.name for path in (ROOT / "wrinklecli").glob("*/__init__.py")]
    assert sorted(table) == sorted(rooms)


def test_the_page_of_the_program_names_modules_that_are_there() -> None:
    page = (ROOT / "wrinklecli" / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:\w+/)+\w+)`", page))
    assert named, "such as `baking/proof`"
    found = {
        name for name in named if (ROOT / "wrinklecli" / name).is_dir() or (ROOT / "wrinklecli" / f"{name}.py").exists()
    }
    assert named == found


def test_the_map_shows_every_module() -> None:
    drawn = (ROOT / "samples" / "pictures" / "method_flow.svg").read_text(encoding="utf-8")
    modules = {path.stem for path in (ROOT / "wrinklecli").glob("*/*.py")} - {"__init__"}
    assert {name for name in modules if name not in drawn} == set(), "make -C samples figures"


@pytest.mark.slow
@pytest.mark.long
def test_figures_are_drawn_from_the_program(tmp_path: Path) -> None:
    run([sys.executable, ROOT / "samples" / "figures.py", tmp_path], check=True, env={"PYTHONPATH": str(ROOT)})
    kept = {path.name for path in (ROOT / "samples" / "pictures").glob("method_*.svg")}
    assert {path.name for path in tmp_path.iterdir()} == kept


def test_keys_have_small_pictures_beside_their_description() -> None:
    pages = "\n".join(page.read_text(encoding="utf-8") for page in ROOT.glob("configs/*.md"))
    pictures = sorted(PICTURES_OF_KEYS)
    assert [path.stem.removeprefix("key_") for path in pictures] == sorted(DRAWN), "make -C samples keys"
    sizes = [path.stat().st_size for path in pictures]
    assert max(sizes) <= 40_000
    assert sum(sizes) <= 600_000
    for path in pictures:
        key = path.stem.removeprefix("key_")
        section = next(part for part in re.split(r"\n##? ", pages) if path.name in part)
        assert f"| `{key}` |" in section, "a picture stands in the section of its key"


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("part", range(2))
def test_pictures_of_keys_are_drawn_from_the_program(part: int, tmp_path: Path) -> None:
    """Of each picture its last panel, which shows most of what its key does, and all captions."""
    write_sheets(tmp_path)
    for path in sorted(PICTURES_OF_KEYS)[part::2]:
        look, panels = DRAWN[path.stem.removeprefix("key_")]
        with Image.open(path) as picture:
            kept = picture.convert("RGB")
        shown, (corners, (wide, high)) = captioned(panels), places(len(panels))
        assert shown.size == kept.size
        for x, y in corners:
            shown.paste(kept.crop((x, y, x + wide, y + high)), (x, y))
        shown.paste(draw(look, panels[-1], tmp_path, (wide, high)), corners[-1])
        with Image.open(io.BytesIO(packed(shown))) as picture:
            again = picture.convert("RGB")
        for x, y in corners:
            # Grey levels of 255 of squares of four pixels: packing, which this does twice, changes single ones.
            box = (x, y - CAPTION, x + wide, y + high)
            pair = [np.array(each.crop(box).convert("L").reduce(4), float) for each in (kept, again)]
            assert np.abs(pair[0] - pair[1]).mean() < 1, f"{path.name} is old: make -C samples keys"


@pytest.mark.slow
@pytest.mark.long
def test_the_script_draws_the_picture_of_a_key(tmp_path: Path) -> None:
    script, kept = ROOT / "samples" / "key_pictures.py", ROOT / "samples" / "pictures" / "key_max_height.webp"
    run([sys.executable, script, tmp_path, "max_height"], check=True, env={"PYTHONPATH": str(ROOT)})
    (drawn,) = tmp_path.iterdir()
    assert drawn.name == kept.name
    pair = [np.array(Image.open(each).convert("L"), float) for each in (drawn, kept)]
    assert np.abs(pair[0] - pair[1]).mean() < 1


def keys_of_json(command: str) -> set[str]:
    """The keys that configs/json.md gives for the object of a command, in the first column of its first table."""
    text = (ROOT / "configs" / "json.md").read_text(encoding="utf-8")
    table = (
        text.partition(f"\n## {command}\n")[2].partition("\n## ")[0].partition("|---|---|\n")[2].partition("\n\n")[0]
    )
    return {key for row in table.splitlines() for key in re.findall(r"`(\w+)`", row.split("|")[1])}


WRIST, TOOLS = "samples/wrist.glb", "configs/wrist.yaml"
OF_COMMANDS = [
    ("bake", ["bake", WRIST, TOOLS, "--draft", "--clip", "flex", "--tool", "palm_side", "-o", "OUT/out.glb"]),
    ("check", ["check", WRIST, TOOLS, "--tool", "palm_side"]),
    ("check --crossings", ["check", WRIST, "--crossings"]),
    ("diff", ["diff", WRIST, WRIST]),
    ("inspect", ["inspect", WRIST]),
    ("preview", ["preview", WRIST, "-o", "OUT/out.png"]),
    ("suggest", ["suggest", WRIST, "--count", "1"]),
]
SOMETIMES = {"muscles", "flesh", "touches", "fields", "contact", "engine", "maps"}


@pytest.mark.slow
@pytest.mark.parametrize(("command", "line"), OF_COMMANDS, ids=[command for command, _ in OF_COMMANDS])
def test_the_page_lists_the_keys_that_a_command_prints(command: str, line: list[str], tmp_path: Path) -> None:
    line = [each.replace("OUT", str(tmp_path)) for each in line]
    done = run([sys.executable, "-m", "wrinklecli", *line, "--json"], cwd=ROOT, capture_output=True, check=True)
    printed, listed = set(json.loads(done.stdout)), keys_of_json(command)
    assert printed <= listed
    assert listed - printed <= SOMETIMES
