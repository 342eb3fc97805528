"""What becomes of an edited tools file on disk: merged, never overwritten, and never lost."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.editor.edits import Edits
from wrinklecli.editor.store import Store
from wrinklecli.errors import ConfigError
from wrinklecli.tools.read import load_tools

TEXT = """\
# Mine.
version: 1
defaults: {width: 0.3}
tools:
  - name: a.L     # the first
    origin: [0, 0, 1.50]
    target: [0, 1, 1.50]

  - name: b.L
    origin: [1, 0, 0]
    target: [1, 1, 0]
  - {name: c, origin: [2, 0, 0], target: [2, 1, 0]}
"""


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with three tools."""
    (tmp_path / "tools.yaml").write_text(TEXT)
    return tmp_path / "tools.yaml"


def opened(path: Path) -> Edits:
    edits = Edits(Store(str(path), own_folder=f"{path}.own"))
    edits.recover()
    return edits


@pytest.mark.parametrize("edited", [False, True])
def test_a_file_that_is_removed_is_said_to_be_gone_and_loses_nothing(path: Path, edited: bool) -> None:
    edits = opened(path)
    if edited:
        edits.set_value("a.L", ("bumps",), 9)
    text = edits.text
    path.unlink()
    assert edits.merge()
    assert edits.notes[-1] == f"{path}: has been removed; saving writes it again"
    assert (edits.text, edits.changed, edits.merge()) == (text, True, False)
    # Killed now, the next run has it all.
    assert opened(path).text == text
    edits.save()
    assert path.read_text() == text
    assert not edits.changed


@pytest.mark.slow
def test_what_others_write_meanwhile_is_merged_tool_by_tool(path: Path) -> None:
    edits = opened(path)
    edits.set_value("a.L", ("bumps",), 7)
    edits.delete("c")
    edits.copy("a.L")
    theirs = TEXT.replace("target: [1, 1, 0]", "target: [1, 2, 0]").replace("# Mine.", "# Theirs.")
    path.write_text(theirs)
    edits.save()
    assert path.read_text().startswith("# Theirs.")
    assert [(each.name, each.bumps, each.target) for each in load_tools(path).tools] == [
        ("a.L", 7, (0, 1, 1.5)),
        ("b.L", 4, (1, 2, 0)),
        ("a_1.L", 7, (0, 1, 1.5)),
    ]
    assert edits.text == path.read_text()
    assert not edits.changed
    # Undoing takes back what was done here alone.
    while edits.undo():
        pass
    assert edits.text == theirs


def test_what_was_changed_here_and_there_is_not_overwritten(path: Path) -> None:
    edits = opened(path)
    edits.set_value("a.L", ("bumps",), 7)
    path.write_text(theirs := TEXT.replace("1.50", "1.55"))
    with pytest.raises(ConfigError, match=r"a\.L: was changed here, and otherwise in the file on disk"):
        edits.save()
    assert path.read_text() == theirs
    path.write_text("tools: [")
    with pytest.raises(ConfigError):
        edits.save()
    edits.save(overwrite=True)
    assert path.read_text() == edits.text


def test_a_crash_loses_nothing(path: Path) -> None:
    first = opened(path)
    first.set_value("a.L", ("bumps",), 7)
    again = opened(path)
    assert again.text == first.text
    assert "unsaved edits" in again.notes[0]
    again.undo()
    assert again.text == TEXT
    again.redo()
    again.save()
    assert [each.name for each in path.parent.iterdir() if each.is_file()] == ["tools.yaml"]
    assert not [*Path(f"{path}.own").iterdir()]
    assert opened(path).undo() is None


@pytest.mark.slow
def test_a_crash_beside_another_edit_loses_neither(path: Path) -> None:
    first = opened(path)
    first.set_value("a.L", ("bumps",), 7)
    path.write_text(TEXT.replace("[1, 1, 0]", "[1, 2, 0]"))
    assert opened(path).text == first.text.replace("[1, 1, 0]", "[1, 2, 0]")
    path.write_text(TEXT.replace("1.50", "1.55"))
    first.set_value("a.L", ("bumps",), 8)
    other = opened(path)
    assert other.text == path.read_text()
    assert len([*Path(f"{path}.own").glob("tools.yaml.*.unsaved.1")]) == 1


def test_a_part_of_what_is_inherited_keeps_the_rest(tmp_path: Path) -> None:
    (tmp_path / "tools.yaml").write_text(TEXT.replace("{width: 0.3}", "{width: 0.3, clips: {walk: 0.5}}"))
    edits = opened(tmp_path / "tools.yaml")
    edits.set_value("b.L", ("clips", "run"), 0.7)
    assert dict(edits.settings().tools[1].clips) == {"walk": 0.5, "run": 0.7}
    assert dict(edits.settings().tools[0].clips) == {"walk": 0.5}


MERGING = TEXT.replace("- name: a.L     # the first", "- &T0   # the first\n    name: a.L").replace(
    "- name: b.L\n", "- <<: *T0\n    name: b.L\n"
)


@pytest.mark.slow
@pytest.mark.parametrize("theirs", [MERGING.replace("1.50]\n\n", "1.50]\n    bumps: 9\n\n"), TEXT])
def test_a_copy_stays_as_it_is_where_others_change_what_it_merges(path: Path, theirs: str) -> None:
    path.write_text(MERGING)
    edits = opened(path)
    name = edits.copy("b.L")
    (before,) = [each for each in edits.settings().tools if each.name == name]
    path.write_text(theirs)
    edits.save()
    (after,) = [each for each in load_tools(path).tools if each.name == name]
    assert replace(after, where="", places={}) == replace(before, where="", places={})


def test_a_tool_that_others_merge_is_edited_alone(path: Path) -> None:
    path.write_text(MERGING)
    edits = opened(path)
    _, *others = edits.settings().tools
    edits.set_value("a.L", ("bumps",), 7)
    edits.move_point("a.L", 1, [0, 2, 1.5])
    edits.unset("b.L", ("bumps",))
    edits.save()
    first, *same = load_tools(path).tools
    assert (first.bumps, first.target) == (7, (0, 2, 1.5))
    assert [replace(each, where="", places={}) for each in same] == [
        replace(each, where="", places={}) for each in others
    ]
    while edits.undo():
        pass
    assert edits.text == MERGING


EDITS = st.lists(
    st.one_of(
        st.tuples(st.just("set_value"), st.sampled_from("abc"), st.just(("bumps",)), st.integers(1, 9)),
        st.tuples(st.just("set_value"), st.sampled_from("abc"), st.just(("clips", "walk")), st.floats(0, 1)),
        st.tuples(st.just("set_value"), st.sampled_from("abc"), st.just(("mirror",)), st.sampled_from("xyz")),
        st.tuples(st.just("unset"), st.sampled_from("abc"), st.just(("bumps",))),
        st.tuples(st.just("move_point"), st.sampled_from("abc"), st.integers(0, 1), st.just([0.1, 0.2, 0.3])),
        st.tuples(st.just("copy"), st.sampled_from("abc")),
        st.tuples(st.just("rename"), st.sampled_from("abc"), st.sampled_from(["d", "e f.L"])),
        st.tuples(st.just("delete"), st.sampled_from("abc")),
        st.tuples(st.just("solo"), st.just(["b.L"])),
        st.tuples(st.just("undo")),
    ),
    max_size=12,
)


@pytest.mark.slow
@pytest.mark.long
@given(EDITS)
def test_undo_gives_the_same_bytes_and_save_the_same_tools(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[object, ...]]
) -> None:
    path = tmp_path_factory.mktemp("edits") / "tools.yaml"
    path.write_bytes(TEXT.encode())
    edits = opened(path)
    names = {"a": "a.L", "b": "b.L", "c": "c"}
    texts = [edits.text]
    for kind, *arguments in steps:
        if arguments and isinstance(arguments[0], str):
            arguments[0] = names[arguments[0]]
        try:
            getattr(edits, str(kind))(*arguments)
        except ConfigError:
            assert edits.text == texts[-1]
        texts.append(edits.text)
    if edits.settings().tools:
        edits.save()
        assert load_tools(path) == edits.settings()
        assert path.read_text() == edits.text
    while edits.undo():
        pass
    assert edits.text.encode() == TEXT.encode()
