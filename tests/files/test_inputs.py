"""Inputs are regular files, and are read again when others have written them, not before."""

import os
from pathlib import Path

import pytest

from wrinklecli.files.inputs import Watched, open_input


def test_a_file_is_read_by_any_name(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"123")
    (tmp_path / "link").symlink_to("a")
    for name in ("a", "link"):
        with open_input(tmp_path / name) as file:
            assert file.read() == b"123"


def test_what_is_no_file_is_refused_at_once(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, reason in (
        (tmp_path / "pipe", "not a regular file"),
        (Path("/dev/zero"), "not a regular file"),
        (tmp_path, "Is a directory"),
        (tmp_path / "absent", "No such file"),
    ):
        with pytest.raises(OSError, match=reason):
            open_input(path)


def test_a_file_that_becomes_a_pipe_is_not_waited_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").touch()
    status = os.stat(tmp_path / "file")
    monkeypatch.setattr(os, "stat", lambda _: status)
    with pytest.raises(OSError, match="not a regular file"):
        open_input(tmp_path / "pipe")


def test_a_change_counts_once_it_has_stayed(tmp_path: Path) -> None:
    path = tmp_path / "limb.glb"
    watched = Watched([path, tmp_path / "tools.yaml"])
    assert not watched.changed()
    path.write_text("a")
    assert not watched.changed()
    path.write_text("abc")
    assert not watched.changed()
    assert watched.changed()
    assert not watched.changed()
    # What has changed since is not lost where more is watched.
    path.write_text("abcd")
    (tmp_path / "limb.bin").write_text("a")
    more = watched.instead([tmp_path / "limb.bin", path])
    assert more.changed()
    assert not more.changed()
    watched.changed()
    assert watched.changed()
    path.unlink()
    assert [watched.changed() for _ in range(3)] == [False, True, False]
