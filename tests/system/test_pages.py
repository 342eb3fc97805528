"""The pages for people: what they link to is there, and the map of the program names every room in its order."""

import re
import sys
from pathlib import Path
from subprocess import run

import pytest

from kit.places import ROOT

PAGES = (*ROOT.glob("*.md"), *(ROOT / page for page in (".github/CONTRIBUTING.md", "wrinklecli/README.md")))
PAGES += (*ROOT.glob("configs/*.md"), *ROOT.glob("samples/*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    # Headings as GitHub makes anchors of them.
    headings = {re.sub(r"[^\w -]", "", line.lstrip("# ")).lower().replace(" ", "-") for line in text.splitlines()}
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        file, _, anchor = link.partition("#")
        if file.startswith("http"):
            continue
        assert (page.parent / file).exists(), link
        if not file:
            assert anchor in headings, link


def test_the_map_names_every_room() -> None:
    table = re.findall(r"^\| \[(\w+)\]\(\1\) \|", (ROOT / "wrinklecli" / "README.md").read_text(), re.MULTILINE)
    rooms = [path.parent.name for path in (ROOT / "wrinklecli").glob("*/__init__.py")]
    assert sorted(table) == sorted(rooms)


def test_the_map_shows_every_module() -> None:
    drawn = (ROOT / "samples" / "pictures" / "method_flow.svg").read_text(encoding="utf-8")
    modules = {path.stem for path in (ROOT / "wrinklecli").glob("*/*.py")} - {"__init__"}
    assert {name for name in modules if name not in drawn} == set(), "make -C samples figures"


@pytest.mark.slow
def test_figures_are_drawn_from_the_program(tmp_path: Path) -> None:
    run([sys.executable, ROOT / "samples" / "figures.py", tmp_path], check=True, env={"PYTHONPATH": str(ROOT)})
    kept = {path.name for path in (ROOT / "samples" / "pictures").glob("method_*.svg")}
    assert {path.name for path in tmp_path.iterdir()} == kept
