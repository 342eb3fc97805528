"""The side file: it keeps unsaved text in a folder of the user's own, and what cannot be kept there is said once."""

from pathlib import Path

import pytest

from wrinklecli.editor.edits import Edits
from wrinklecli.editor.store import Store

TEXT = "version: 1\ntools: [{name: a, origin: [0, 0, 0], target: [0, 1, 0], width: 0.3}]\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A tools file."""
    (tmp_path / "tools.yaml").write_text(TEXT)
    return tmp_path / "tools.yaml"


def store(path: Path) -> Store:
    return Store(str(path), own_folder=str(path.parent / "own"))


def side_of(path: Path) -> Path:
    side = store(path).side
    assert side is not None
    return Path(side.path)


def opened(path: Path) -> Edits:
    edits = Edits(store(path))
    edits.recover()
    return edits


def test_a_folder_that_takes_no_side_file_is_said_once(path: Path) -> None:
    (path.parent / "own").write_text("mine")
    edits = opened(path)
    edits.notes.clear()
    edits.set_value("a", ("bumps",), 7)
    edits.set_value("a", ("bumps",), 8)
    edits.undo()
    edits.save()
    (note,) = edits.notes
    assert (
        note
        == f"{side_of(path)}: cannot be written: File exists: unsaved edits are not kept there, and a crash loses them"
    )
    assert (path.parent / "own").read_text() == "mine"
    assert "bumps: 7" in path.read_text()


@pytest.mark.parametrize(
    "data", [b"", b"[" * 200_000, b"{}", b"[1]", b'{"base": "", "text": 1}', b'{"base": "\xff"}', b"1"]
)
def test_a_damaged_side_file_is_set_aside(data: bytes, path: Path) -> None:
    (path.parent / "own").mkdir()
    side_of(path).write_bytes(data)
    edits = opened(path)
    (note,) = edits.notes
    assert note == f"{side_of(path)}: is damaged, and is {side_of(path)}.1 now"
    assert Path(f"{side_of(path)}.1").read_bytes() == data
    edits.set_value("a", ("bumps",), 7)
    assert opened(path).text == edits.text


def test_text_is_kept_as_it_is_for_its_owner_alone_and_nothing_beside_the_file(path: Path) -> None:
    path.write_text(TEXT + "# ä, 日本 and \u2028\n")
    edits = opened(path)
    edits.rename("a", "knee 左")
    assert opened(path).text == edits.text
    assert side_of(path).parent.stat().st_mode & 0o077 == 0
    assert sorted(each.name for each in path.parent.iterdir()) == ["own", "tools.yaml"]


def test_files_of_one_name_have_side_files_of_their_own(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = path.parent / "other" / "tools.yaml"
    other.parent.mkdir()
    other.write_text(TEXT)
    edits = opened(path)
    edits.set_value("a", ("bumps",), 7)
    assert Edits(Store(str(other), own_folder=str(path.parent / "own"))).text == TEXT
    monkeypatch.chdir(path.parent)
    again = Edits(Store("other/../tools.yaml", own_folder=str(path.parent / "own")))
    again.recover()
    assert again.text == edits.text


def test_edits_that_do_not_fit_take_a_name_that_is_free(path: Path) -> None:
    for number in (1, 2):
        opened(path).set_value("a", ("bumps",), 3 + number)
        path.write_text(TEXT.replace("0.3}", f"0.4{number}}}"))
        (kept, *_) = [note for note in opened(path).notes if "do not fit" in note]
        assert kept.endswith(f".unsaved.{number}")
    assert "bumps: 4" in Path(f"{side_of(path)}.1").read_text()


@pytest.mark.slow
@pytest.mark.long
def test_no_text_of_a_side_file_is_more_than_a_line(path: Path) -> None:
    for text in ("", "tools: [", "[" * 1000, "a: &a [*a]", "tools: [*a]", "\x00", '"\\ud800"', "version: 1\ntools: 5"):
        for base in (TEXT, text):
            side = opened(path)._store.side
            assert side is not None
            side.write(base, text)
            again = opened(path)
            assert again.text == TEXT
            assert all(len(note.splitlines()) == 1 for note in again.notes)
            for each in (path.parent / "own").iterdir():
                each.unlink()
