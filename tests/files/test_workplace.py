"""Folders that killed runs have left are taken away, those of others are not."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from kit.places import ROOT
from wrinklecli.files.outputs import Outputs
from wrinklecli.files.workplace import Workplace

_WEEK = 7 * 24 * 3600.0


def run(folder: Path) -> set[str]:
    """A run that writes one file into a folder; the names that are there after it."""
    with Outputs() as outputs:
        outputs.add_bytes(folder / "out", b"new")
    return {path.name for path in folder.iterdir()} - {"out"}


def killed(folder: Path) -> Path:
    """What a run leaves that is killed while it writes."""
    program = (
        "import os, sys; from wrinklecli.files.outputs import Outputs\n"
        "Outputs().add_bytes(sys.argv[1] + '/x', b'half'); os.kill(os.getpid(), 9)"
    )
    subprocess.run([sys.executable, "-c", program, str(folder)], cwd=ROOT, check=False)
    (left,) = folder.glob(".wrinkle-*")
    assert [path.read_bytes() for path in left.iterdir()] == [b"half"]
    return left


def test_what_a_killed_run_has_left_is_taken_away(tmp_path: Path) -> None:
    killed(tmp_path)
    assert run(tmp_path) == set()


def test_what_a_run_beside_this_one_writes_stays(tmp_path: Path) -> None:
    with Outputs() as outputs:
        outputs.add_bytes(tmp_path / "theirs", b"theirs")
        old = next(tmp_path.glob(".wrinkle-*"))
        os.utime(old, (0, 0))
        assert run(tmp_path) == {old.name}
    assert (tmp_path / "theirs").read_bytes() == b"theirs"


def test_what_another_machine_writes_stays_for_a_week(tmp_path: Path) -> None:
    left = killed(tmp_path)
    digits = "00000000" if "-00000000-" not in left.name else "00000001"
    other = left.rename(tmp_path / f".wrinkle-{digits}-{left.name[-16:]}")
    assert run(tmp_path) == {other.name}
    old = time.time() - _WEEK - 60
    os.utime(other, (old, old))
    assert run(tmp_path) == set()


def test_what_only_looks_alike_stays(tmp_path: Path) -> None:
    left = killed(tmp_path)
    (left / "notes").touch()
    file = tmp_path / f"{left.name[:-1]}z"
    file.touch()
    target = tmp_path / "folder"
    target.mkdir()
    (target / "1").touch()
    link = tmp_path / f".wrinkle-{left.name[9:17]}-{'0' * 16}"
    link.symlink_to("folder")
    (tmp_path / ".wrinkle-rc").mkdir()
    assert run(tmp_path) == {left.name, file.name, "folder", link.name, ".wrinkle-rc"}
    assert (target / "1").exists()
    assert (left / "notes").exists()


def test_a_folder_that_is_taken_away_as_it_is_made_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, mkdir = [], os.mkdir

    def slow(path: str, mode: int) -> None:
        mkdir(path, mode)
        made.append(path)
        if len(made) == 1:
            os.rmdir(path)

    monkeypatch.setattr(os, "mkdir", slow)
    workplace = Workplace(str(tmp_path))
    workplace.make()
    assert len(made) == 2
    Path(workplace.next_path()).touch()
    workplace.remove()
    workplace.remove()
    assert os.listdir(tmp_path) == []


def test_a_disk_without_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import fcntl

    left = killed(tmp_path)

    def refuse(*_: object) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr(fcntl, "flock", refuse)
    assert run(tmp_path) == {left.name}
