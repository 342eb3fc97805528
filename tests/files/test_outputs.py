"""Outputs are all in their places, or nothing has changed."""

import os
import re
import socket
import stat
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from kit.command import files
from wrinklecli.errors import BakeError
from wrinklecli.files import workplace
from wrinklecli.files.outputs import Outputs


def put(path: Path | str, data: bytes = b"new") -> None:
    with Outputs() as outputs:
        outputs.add_bytes(path, data)


@contextmanager
def fails(kind: type[BaseException], line: str | None = None) -> Iterator[Outputs]:
    """Outputs that come to nothing, as an error is raised meanwhile or in the end."""
    with pytest.raises(kind, match=line), Outputs() as outputs:
        yield outputs


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


# All or none


def test_nothing_is_there_before_all_is_written(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"old")
    with Outputs() as outputs:
        assert outputs.add_bytes(tmp_path / "a", b"12345") == 5
        outputs.make_folders(tmp_path / "b" / "c")
        outputs.add_bytes(tmp_path / "b" / "c" / "d", b"new")
        assert (tmp_path / "a").read_bytes() == b"old"
        assert not (tmp_path / "b" / "c" / "d").exists()
    assert files(tmp_path) == {"a": b"12345", "b/c/d": b"new"}
    assert names(tmp_path) == {"a", "b"}
    assert names(tmp_path / "b" / "c") == {"d"}


@pytest.mark.parametrize("fault", ["write", "fsync", "chmod", "replace", "interrupt"])
@pytest.mark.parametrize("existing", [True, False])
def test_a_failed_write_leaves_the_old_file_and_no_other(
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
    if fault == "chmod" and not existing:
        return  # its mode is right from the beginning
    line = f"^{re.escape(str(target))}: cannot be written: No space left on device$"
    with fails(*((KeyboardInterrupt,) if fault == "interrupt" else (BakeError, line))) as outputs:
        outputs.make_folders(tmp_path / "a" / "b")
        outputs.add(target, write)
    assert names(tmp_path) == ({"out.glb"} if existing else set())
    assert not existing or target.read_bytes() == b"old"


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("failing", ["1", "2", "3"])
def test_files_that_are_in_their_places_already_are_taken_back(
    failing: str, links: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("1", "3"):
        (tmp_path / name).write_bytes(b"old")
    before, real = files(tmp_path), os.replace

    def replace(source: str, target: str) -> None:
        if os.path.basename(target) == failing and (tmp_path / failing).exists() == (failing != "2"):
            monkeypatch.setattr(os, "replace", real)
            raise OSError(28, "No space left on device")
        real(source, target)

    def no_link(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "replace", replace)
    if not links:
        monkeypatch.setattr(os, "link", no_link)
    with fails(BakeError, f"{failing}: cannot be written: No space") as outputs:
        for name in ("1", "2", "3"):
            outputs.add_bytes(tmp_path / name, b"new")
    assert files(tmp_path) == before
    assert names(tmp_path) == {"1", "3"}


def test_the_main_output_comes_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real, moved = os.replace, []

    def replace(source: str, target: str) -> None:
        moved.append(os.path.basename(target))
        real(source, target)

    monkeypatch.setattr(os, "replace", replace)
    with Outputs(at_commit=lambda: moved.append("begin")) as outputs:
        outputs.add_bytes(tmp_path / "main", b"", last=True)
        outputs.add_bytes(tmp_path / "a", b"")
        outputs.add_bytes(tmp_path / "b", b"")
    assert moved == ["begin", "a", "b", "main"]


def test_runs_that_end_at_once_leave_the_files_of_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each renames three files, and takes its time for it."""
    real = os.replace

    def replace(source: str, target: str) -> None:
        time.sleep(0.01)
        real(source, target)

    monkeypatch.setattr(os, "replace", replace)

    def write(content: bytes) -> None:
        with Outputs() as outputs:
            for name in ("a", "b", "c"):
                outputs.add_bytes(tmp_path / name, content)

    with ThreadPoolExecutor(8) as pool:
        list(pool.map(write, [bytes([number]) for number in range(8)]))
    assert len(set(files(tmp_path).values())) == 1


def test_a_lock_that_others_hold_for_ever_ends_no_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workplace, "_PATIENCE", 0.01)
    with workplace.locked(str(tmp_path)), Outputs() as outputs:
        outputs.add_bytes(tmp_path / "out", b"new")
    assert files(tmp_path) == {"out": b"new"}


def test_an_interrupt_after_the_last_renaming_takes_nothing_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.replace

    def replace(source: str, target: str) -> None:
        real(source, target)
        if target.endswith("2"):
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", replace)
    with fails(KeyboardInterrupt) as outputs:
        outputs.add_bytes(tmp_path / "1", b"new")
        outputs.add_bytes(tmp_path / "2", b"new")
    assert files(tmp_path) == {"1": b"new", "2": b"new"}


def test_folders_that_cannot_all_be_made_leave_none(tmp_path: Path) -> None:
    with fails(BakeError, "cannot be written") as outputs:
        outputs.make_folders(tmp_path / "a" / "b" / ("c" * 300))
    assert names(tmp_path) == set()


def test_a_folder_whose_name_no_folder_can_have_is_one_line(tmp_path: Path) -> None:
    with fails(BakeError, "null") as outputs:
        outputs.make_folders(tmp_path / "new" / "a\0b")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_another_makes_at_the_same_time_is_used_and_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = os.mkdir

    def mkdir(path: str) -> None:
        real(path)
        real(path)

    monkeypatch.setattr(os, "mkdir", mkdir)
    with fails(ZeroDivisionError) as outputs:
        outputs.make_folders(tmp_path / "a")
        raise ZeroDivisionError
    assert names(tmp_path) == {"a"}


def test_a_folder_with_the_files_of_others_stays(tmp_path: Path) -> None:
    with fails(ZeroDivisionError) as outputs:
        outputs.make_folders(tmp_path / "a" / "b")
        (tmp_path / "a" / "theirs").touch()
        raise ZeroDivisionError
    assert files(tmp_path) == {"a/theirs": b""}


def test_what_is_dropped_goes_with_the_others(tmp_path: Path) -> None:
    for name in ("gone", "input", "out"):
        (tmp_path / name).write_bytes(b"old")

    def write() -> None:
        with Outputs() as outputs:
            outputs.protect([tmp_path / "input"])
            outputs.add_bytes(tmp_path / "out", b"new")
            for name in ("gone", "input", "out", "absent"):
                outputs.drop(partial(list, [str(tmp_path / name)]))
            if names(tmp_path) == {"gone", "input", "out"}:
                raise BakeError("no")

    (tmp_path / "more").touch()
    write()
    assert files(tmp_path) == {"input": b"old", "more": b"", "out": b"new"}


# Where


def test_where_nothing_can_be_made(tmp_path: Path) -> None:
    (tmp_path / "folder.glb").mkdir()
    (tmp_path / "file").touch()
    (tmp_path / "loop").symlink_to("loop")
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(tmp_path / "socket"))
    before = names(tmp_path)
    for name in ("missing/out.glb", "folder.glb", "file/out.glb", "loop", "socket", "a\0b", "x" * 300):
        with pytest.raises(BakeError, match="cannot be written: ") as caught:
            put(tmp_path / name)
        assert len(caught.value.lines) == 1
    assert names(tmp_path) == before
    listening.close()


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes into read-only folders")
def test_a_read_only_folder(tmp_path: Path) -> None:
    (tmp_path / "out.glb").write_bytes(b"old")
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(BakeError, match="cannot be written: Permission denied"):
            put(tmp_path / "out.glb")
    finally:
        tmp_path.chmod(0o700)
    assert (tmp_path / "out.glb").read_bytes() == b"old"


def test_a_disk_that_cannot_be_written_is_said_to_be_read_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder without permission is another fault, with another cure."""
    monkeypatch.setattr(os, "access", lambda *_: False)
    with fails(BakeError, "out: cannot be written: Permission denied") as outputs:
        outputs.claim(tmp_path / "out")
    flags = os.statvfs_result((0,) * 8 + (os.ST_RDONLY, 255))
    monkeypatch.setattr(os, "statvfs", lambda _: flags)
    with fails(BakeError, "out: cannot be written: Read-only file system") as outputs:
        outputs.claim(tmp_path / "out")


def test_a_new_file_is_as_readable_as_any_other(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    put(tmp_path / "new")
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode


@pytest.mark.parametrize("mode", [0o600, 0o444, 0o664])
def test_a_file_that_is_replaced_keeps_its_mode(mode: int, tmp_path: Path) -> None:
    (tmp_path / "out").write_bytes(b"old")
    (tmp_path / "out").chmod(mode)
    put(tmp_path / "out")
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == mode
    assert (tmp_path / "out").read_bytes() == b"new"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_file_that_is_replaced_keeps_its_owner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "out").write_bytes(b"old")
    os.chown(tmp_path / "out", 1234, 4321)
    put(tmp_path / "out")
    status = (tmp_path / "out").stat()
    assert (status.st_uid, status.st_gid) == (1234, 4321)
    (tmp_path / "out").chmod(0o674)

    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "chown", refuse)
    put(tmp_path / "out")
    assert stat.S_IMODE((tmp_path / "out").stat().st_mode) == 0o644, "our group gets no more than all others"


def test_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")
    (tmp_path / "dangling").symlink_to("other")
    put(tmp_path / "link")
    put(tmp_path / "dangling")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "dangling").is_symlink()
    assert (tmp_path / "real").read_bytes() == (tmp_path / "other").read_bytes() == b"new"


# Inputs and other outputs


@pytest.mark.parametrize("name", ["input", "./input", "sub/../input", "link", "hard", "here/input"])
@pytest.mark.parametrize("claimed", [True, False])
def test_an_input_is_never_written(name: str, claimed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("input").write_bytes(b"old")
    Path("sub").mkdir()
    Path("link").symlink_to("input")
    Path("here").symlink_to(".")
    os.link("input", "hard")
    with fails(BakeError, f"{name}: is an input too and would be overwritten") as outputs:
        outputs.add_bytes("first", b"new")
        if claimed:
            outputs.claim(name)
        outputs.protect(["input"])
        outputs.add_bytes(name, b"new")
    assert not Path("first").exists()
    assert Path("input").read_bytes() == b"old"


@pytest.mark.parametrize("name", ["out", "sub/../out", "link", "hard"])
def test_two_outputs_are_two_files(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("sub").mkdir()
    Path("out").write_bytes(b"old")
    Path("link").symlink_to("out")
    os.link("out", "hard")
    with fails(BakeError, f"{name}: is another output too") as outputs:
        outputs.add_bytes("out", b"new")
        outputs.add_bytes(name, b"new")
    assert Path("out").read_bytes() == b"old"


# What is no file


def test_a_device_is_written_to_and_stays_one() -> None:
    before = os.stat("/dev/null")
    with Outputs() as outputs:
        for _ in range(2):
            outputs.claim("/dev/null")
        for _ in range(3):
            outputs.add_bytes("/dev/null", b"new")
    after = os.stat("/dev/null")
    assert stat.S_ISCHR(after.st_mode)
    assert (after.st_ino, after.st_mode) == (before.st_ino, before.st_mode)


def test_a_full_device_changes_nothing(tmp_path: Path) -> None:
    with fails(BakeError, "/dev/full: cannot be written: No space left") as outputs:
        outputs.add_bytes(tmp_path / "a", b"new")
        outputs.add_bytes("/dev/full", b"new", last=True)
    assert names(tmp_path) == set()


def test_a_pipe_is_written_to(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append((tmp_path / "pipe").read_bytes()))
    reader.start()
    put(tmp_path / "pipe", b"new")
    reader.join()
    assert read == [b"new"]
    assert stat.S_ISFIFO((tmp_path / "pipe").stat().st_mode)


@pytest.mark.parametrize("path", ["/dev/fd/{}", "/proc/self/fd/{}"])
def test_what_a_shell_appends_to_keeps_what_it_has(path: str, tmp_path: Path) -> None:
    (tmp_path / "log").write_bytes(b"old ")
    with open(tmp_path / "log", "ab") as log:
        put(path.format(log.fileno()))
    assert (tmp_path / "log").read_bytes() == b"old new"
