"""Errors and the words of their messages."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from kit.drawn import CHARACTERS
from wrinklecli.errors import AssetError, RefusedError, WrinkleError, counted, listed, log_findings, nearest, shortened


@given(st.text(CHARACTERS, max_size=60), st.integers(2, 40))
@example("a" * 10, 10)
def test_a_long_text_keeps_its_two_ends(text: str, longest: int) -> None:
    cut = shortened(text, longest)
    if len(text) <= longest:
        assert cut == text
    else:
        begin, end = cut.split(" … ", 1) if text.count(" … ") == 0 else (cut[: longest // 2], cut[-(longest // 2) :])
        assert (text.startswith(begin), text.endswith(end)) == (True, True)
        assert len(begin) == len(end) == longest // 2


@pytest.mark.parametrize(
    ("count", "shown", "more"),
    [(0, 0, None), (1, 1, None), (21, 21, None), (22, 20, "2 more"), (1500, 20, "1,480 more")],
)
def test_many_names_are_cut_to_the_first(count: int, shown: int, more: str | None) -> None:
    words = listed(f"n{number}" for number in range(count)).split(", ")
    assert words == ([*(f"'n{number}'" for number in range(shown)), *([more] if more else [])] or ["none"])


def test_numbers_have_their_plural() -> None:
    assert [counted(number, "key") for number in (0, 1, 2, 1234)] == ["0 keys", "1 key", "2 keys", "1,234 keys"]
    assert counted(2, "vertex", "vertices") == "2 vertices"
    assert counted(1, "vertex", "vertices") == "1 vertex"


def test_a_hint_names_the_nearest_known_name() -> None:
    assert nearest("wirst", ["hand", "wrist"]) == "; did you mean 'wrist'?"
    assert nearest("zebra", ["hand", "wrist"]) == nearest("wrist", []) == ""
    assert nearest("wrist", ["wrists" * 20, "writs"]) == "; did you mean 'writs'?"


def test_an_error_prints_its_place_and_its_message() -> None:
    error = AssetError("has no skin", where="hand.glb")
    assert (str(error), error.lines, error.places) == (
        "hand.glb: has no skin",
        ("hand.glb: has no skin",),
        ("hand.glb",),
    )
    assert str(WrinkleError("alone")) == "alone"
    assert len(str(WrinkleError("m" * 10_000, where="w" * 10_000))) < 1300


def test_one_error_reports_several_problems() -> None:
    both = WrinkleError.of_all([AssetError("one", where="a"), RefusedError.of_all([RefusedError("two", where="b")])])
    assert both.lines == ("a: one", "b: two")
    assert both.places == ("a", "b")
    again = WrinkleError.of_all([AssetError("one", where="a"), both, AssetError("one", where="c")])
    assert again.lines == ("a: one", "b: two", "c: one")
    assert (both.exit_code, RefusedError("two").exit_code) == (1, 3)


@given(st.lists(st.integers(0, 200), min_size=1, max_size=300), st.integers(1, 60))
def test_very_many_lines_are_cut_to_the_first_and_a_number(found: list[int], part: int) -> None:
    """Whether problems come one by one or in parts, each is a line or is counted."""
    numbers = list(dict.fromkeys(found))
    alone = [AssetError("is odd", where=str(number)) for number in numbers]
    parts = (WrinkleError.of_all(alone[first : first + part]) for first in range(0, len(alone), part))
    for error in (WrinkleError.of_all(iter(alone)), WrinkleError.of_all(parts)):
        shown, more = min(len(numbers), 50), len(numbers) - 50
        assert error.lines[:shown] == tuple(f"{number}: is odd" for number in numbers[:shown])
        assert error.places[:shown] == tuple(map(str, numbers[:shown]))
        assert error.lines[shown:] == ((f"and {more:,} more",) if more > 0 else ())
        assert len(error.places) == len(error.lines)
        assert error.more == max(more, 0)


def test_a_fault_of_both_sides_of_a_mirrored_entry_is_one_line() -> None:
    """One of the other side alone has its own line."""
    both = [
        WrinkleError("is 3 thick", where=f"tools.yaml:4: muscles[0]{side}.thickness")
        for side in ("", " (mirrored as biceps.R)")
    ]
    alone = WrinkleError("is no joint", where="tools.yaml:5: muscles[1] (mirrored as calf.R).origin")
    assert WrinkleError.of_all([*both, alone]).lines == (*both[0].lines, *alone.lines)


def test_a_name_that_is_no_text_is_logged_as_text(caplog: pytest.LogCaptureFixture) -> None:
    log_findings(["is not used"], where="\udcff.glb")
    assert caplog.messages == ["\\udcff.glb: is not used"]
