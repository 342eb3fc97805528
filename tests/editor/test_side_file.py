"""The side file: it keeps unsaved text, and whatever else has its name is neither read, followed nor replaced."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from wrinklecli.editor.edits import Edits
from wrinklecli.editor.store import Store

TEXT = "version: 1\ntools: [{name: a, origin: [0, 0, 0], target: [0, 1, 0], width: 0.3}]\n"
START = b'{"wrinkle_edit": 1, "base": "", "text": '
OTHERS: dict[str, tuple[Callable[[Path], object], str]] = {
    "a link": (lambda side: side.symlink_to("asset.glb"), "is a link"),
    "a link to nothing": (lambda side: side.symlink_to("none"), "is a link"),
    "a link to a pipe": (lambda side: (os.mkfifo(side.parent / "pipe"), side.symlink_to("pipe")), "is a link"),
    "another name of the asset": (lambda side: side.hardlink_to(side.parent / "asset.glb"), "not a file of wrinkle"),
    "a pipe": (os.mkfifo, "not a regular file"),
    "a folder": (Path.mkdir, "Is a directory"),
    "a file": (lambda side: side.write_text("mine"), "not a file of wrinkle edit"),
    "an empty file": (Path.touch, "not a file of wrinkle edit"),
    "a later version": (lambda side: side.write_text('{"wrinkle_edit": 12, "text": ""}'), "another version"),
    "too large": (lambda side: (side.write_bytes(START), os.truncate(side, 10**11)), "larger than 52 MB"),
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A tools file beside an asset."""
    (tmp_path / "asset.glb").write_bytes(b"glTF")
    (tmp_path / "tools.yaml").write_text(TEXT)
    return tmp_path / "tools.yaml"


def side_of(path: Path) -> Path:
    return path.with_name(".tools.yaml.unsaved")


def opened(path: Path) -> Edits:
    edits = Edits(Store(str(path)))
    edits.recover()
    return edits


@pytest.mark.parametrize("kind", OTHERS)
def test_what_is_no_side_file_stays_and_is_said_once(kind: str, path: Path) -> None:
    plant, said = OTHERS[kind]
    plant(side_of(path))
    before = os.lstat(side_of(path))
    edits = opened(path)
    edits.set_value("a", ("bumps",), 7)
    edits.set_value("a", ("bumps",), 8)
    edits.undo()
    edits.save()
    (note,) = edits.notes
    assert note.startswith(f"{side_of(path)}: ")
    assert said in note
    assert "unsaved edits are not kept" in note
    after = os.lstat(side_of(path))
    assert (after.st_ino, after.st_mode, after.st_size) == (before.st_ino, before.st_mode, before.st_size)
    assert (path.parent / "asset.glb").read_bytes() == b"glTF"
    assert "bumps: 7" in path.read_text()


@pytest.mark.parametrize("rest", [b"[" * 200_000, b"[" * 500 + b"]" * 500 + b"}", b"1}", b'"\xff"}', b'"ver', b'"1"}}'])
def test_a_damaged_side_file_is_set_aside(rest: bytes, path: Path) -> None:
    side_of(path).write_bytes(START + rest)
    edits = opened(path)
    (note,) = edits.notes
    assert note == f"{side_of(path)}: is damaged, and is {side_of(path)}.1 now"
    assert Path(f"{side_of(path)}.1").read_bytes() == START + rest
    edits.set_value("a", ("bumps",), 7)
    assert opened(path).text == edits.text


def test_the_file_of_another_user_is_not_believed(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened(path).set_value("a", ("bumps",), 7)
    monkeypatch.setattr(os, "geteuid", lambda: side_of(path).stat().st_uid + 1)
    again = opened(path)
    assert again.text == TEXT
    assert "another user" in again.notes[0]


def test_a_link_that_is_planted_meanwhile_is_not_followed(path: Path) -> None:
    edits = opened(path)
    edits.set_value("a", ("bumps",), 7)
    side_of(path).unlink()
    side_of(path).symlink_to("asset.glb")
    edits.set_value("a", ("bumps",), 8)
    assert (path.parent / "asset.glb").read_bytes() == b"glTF"
    assert "is a link" in edits.notes[-1]
    side_of(path).unlink()
    edits.set_value("a", ("bumps",), 9)
    assert opened(path).text == edits.text


def test_text_is_kept_as_it_is_and_for_its_owner_alone(path: Path) -> None:
    path.write_text(TEXT + "# ä, 日本 and \u2028\n")
    edits = opened(path)
    edits.rename("a", "knee 左")
    assert opened(path).text == edits.text
    assert side_of(path).stat().st_mode & 0o077 == 0
    assert sorted(each.name for each in path.parent.iterdir()) == [".tools.yaml.unsaved", "asset.glb", "tools.yaml"]


def test_edits_that_do_not_fit_take_a_name_that_is_free(path: Path) -> None:
    for number in (1, 2):
        opened(path).set_value("a", ("bumps",), 3 + number)
        path.write_text(TEXT.replace("0.3}", f"0.4{number}}}"))
        (kept, *_) = [note for note in opened(path).notes if "do not fit" in note]
        assert kept.endswith(f".tools.yaml.unsaved.{number}")
    assert "bumps: 4" in side_of(path).with_name(".tools.yaml.unsaved.1").read_text()


@pytest.mark.slow
@pytest.mark.long
def test_no_text_of_a_side_file_is_more_than_a_line(path: Path) -> None:
    for text in ("", "tools: [", "[" * 1000, "a: &a [*a]", "tools: [*a]", "\x00", '"\\ud800"', "version: 1\ntools: 5"):
        for base in (TEXT, text):
            edits = opened(path)
            edits._store.side.write(base, text)
            again = opened(path)
            assert again.text == TEXT
            assert all(len(note.splitlines()) == 1 for note in again.notes)
            for each in path.parent.glob(".tools.yaml.unsaved*"):
                each.unlink()
