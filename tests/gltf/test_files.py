"""Files are complete, or not there."""

import os
from pathlib import Path
from typing import Any

import pytest

from wrinklecli.errors import BakeError
from wrinklecli.gltf.files import FileGroup, make_folders, replace_bytes, replace_file


@pytest.mark.parametrize("fault", ["write", "fsync", "chmod", "replace", "interrupt"])
@pytest.mark.parametrize("existing", [True, False])
def test_failed_write_leaves_the_old_file_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str, existing: bool
) -> None:
    target = tmp_path / "out.glb"
    if existing:
        target.write_bytes(b"old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    def write(file: Any) -> None:
        file.write(b"new")
        if fault == "write":
            fail()
        if fault == "interrupt":
            raise KeyboardInterrupt

    if fault in ("fsync", "chmod", "replace"):
        monkeypatch.setattr(os, fault, fail)
    expected = KeyboardInterrupt if fault == "interrupt" else BakeError
    with pytest.raises(expected) as caught:
        replace_file(str(target), write)
    if fault != "interrupt":
        assert str(caught.value) == f"{target}: cannot be written: No space left on device"
    assert [path.name for path in tmp_path.iterdir()] == (["out.glb"] if existing else [])
    assert not existing or target.read_bytes() == b"old"


def test_out_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "folder.glb").mkdir()
    for name in ("missing/out.glb", "folder.glb"):
        with pytest.raises(BakeError, match="cannot be written"):
            replace_bytes(str(tmp_path / name), b"new")
    assert os.listdir(tmp_path) == ["folder.glb"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes into read-only folders")
def test_read_only_folder(tmp_path: Path) -> None:
    (tmp_path / "out.glb").write_bytes(b"old")
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(BakeError, match="cannot be written: Permission denied"):
            replace_bytes(str(tmp_path / "out.glb"), b"new")
    finally:
        tmp_path.chmod(0o700)
    assert (tmp_path / "out.glb").read_bytes() == b"old"


def test_replaced_file_is_as_readable_as_any_other(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    assert replace_bytes(str(tmp_path / "new"), b"12345") == 5
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_link_to_an_out_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")
    replace_bytes(str(tmp_path / "link"), b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_bytes() == b"new"


def test_folders_are_made_outermost_first_and_named(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    wanted = [str(tmp_path / "there" / "a"), str(tmp_path / "there" / "a" / "b")]
    assert make_folders(wanted[-1]) == wanted
    assert make_folders(wanted[-1]) == []


def test_folders_that_cannot_all_be_made_leave_none(tmp_path: Path) -> None:
    with pytest.raises(BakeError, match="cannot be written"):
        make_folders(str(tmp_path / "a" / "b" / ("c" * 300)))
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("fault", [BakeError("no"), KeyboardInterrupt()])
def test_a_group_of_files_that_fails_leaves_what_was_there(tmp_path: Path, fault: BaseException) -> None:
    (tmp_path / "old").write_bytes(b"old")

    def fail() -> None:
        with FileGroup() as files:
            files.make_folders(str(tmp_path / "a" / "b"))
            assert files.replace_bytes(str(tmp_path / "a" / "b" / "new"), b"12345") == 5
            files.replace_bytes(str(tmp_path / "old"), b"new")
            raise fault

    with pytest.raises(type(fault)):
        fail()
    assert os.listdir(tmp_path) == ["old"]


def test_a_group_of_files_stays(tmp_path: Path) -> None:
    with FileGroup() as files:
        files.make_folders(str(tmp_path / "a"))
        files.replace_bytes(str(tmp_path / "a" / "new"), b"new")
    assert (tmp_path / "a" / "new").read_bytes() == b"new"
