"""The pages for people: what they link to is there, and the map of the program names every room in its order."""

import re
from pathlib import Path

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
