"""Lines and tables that commands print."""

import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.drawn import CHARACTERS
from wrinklecli.cli.output import Progress, printable
from wrinklecli.errors import aligned

WORDS = st.text("abc de", max_size=6).map(str.strip)


@given(st.text(CHARACTERS, max_size=40))
def test_a_line_cannot_command_the_terminal(text: str) -> None:
    shown = printable(text)
    assert shown.isprintable()
    assert printable(shown) == shown
    assert shown == text or not text.isprintable()


def test_long_words_and_lines_are_cut_in_the_middle() -> None:
    word = printable("before " + "a" * 700 + "b" * 700 + " after")
    assert word.startswith("before aaa")
    assert word.endswith("bbb after")
    assert " … " in word
    assert len(word) < 630
    assert len(printable("ab " * 10_000)) < 10_010


@given(st.lists(st.tuples(WORDS, WORDS, WORDS), min_size=1, max_size=5), st.integers(0, 3))
def test_columns_of_a_table_are_aligned(rows: list[tuple[str, str, str]], texts: int) -> None:
    widths = [max(len(row[k]) for row in rows) for k in range(3)]
    starts = [sum(widths[:k]) + 2 * k for k in range(3)]
    for row, line in zip(rows, aligned(rows, texts), strict=True):
        assert line == line.rstrip()
        for k, (cell, start, width) in enumerate(zip(row, starts, widths, strict=True)):
            placed = line[start : start + width].ljust(width)
            assert placed == (cell.ljust(width) if k < texts else cell.rjust(width))


def test_a_bar_grows_on_a_terminal_and_goes(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with Progress() as hidden:
        hidden.show("bake", 1, 3)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with Progress() as shown:
        for done in range(4):
            shown.show("bake", done, 3, note="soon")
            bar = "#" * (10 * done) + "." * (30 - 10 * done)
            assert capsys.readouterr().err.endswith(f"    bake {bar} {done}/3  soon")
    assert capsys.readouterr().err == "\r\x1b[K"
    for lines in (False, True):
        with Progress(quiet=True, lines=lines) as quiet:
            quiet.show("bake", 1, 3)
        assert capsys.readouterr().err == ""


def test_a_program_gets_a_line_for_each_new_per_cent(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    with Progress(lines=True) as shown:
        for done in range(1001):
            shown.show("proving", done, 1000, note="soon")
        shown.show("writing", 0, 0)
    lines = [f"progress: proving {percent}%" for percent in range(101)]
    assert capsys.readouterr().err.splitlines() == [*lines, "progress: writing 0%"]
