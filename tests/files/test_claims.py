"""Inputs and outputs of a run are told apart, whatever names they have."""

import os
from pathlib import Path

import pytest

from wrinklecli.files.claims import Claims, Identities

# Names of a file that exists, of one that does not, and of one in a folder that does not.
NAMES = {
    "file": ["./file", "sub/../file", "file_link", "hard", "here/file", "here/here/hard"],
    "absent": ["./absent", "sub/../absent", "absent_link", "here/absent"],
    "new/sub/file": ["./new/sub/file", "new/./sub/file", "new/x/../sub/file", "here/new/sub/file", "new_link/sub/file"],
}


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("file").write_bytes(b"old")
    Path("sub").mkdir()
    for link, target in (("file_link", "file"), ("absent_link", "absent"), ("here", "."), ("new_link", "new")):
        Path(link).symlink_to(target)
    os.link("file", "hard")
    return tmp_path


@pytest.mark.parametrize(("name", "other"), [(name, other) for name, others in NAMES.items() for other in others])
def test_an_output_by_another_name_clashes(name: str, other: str, folder: Path) -> None:
    for first, second in ((name, other), (other, name), (str(folder / name), other)):
        claims = Claims[int]()
        assert claims.add_input(first, 1) is None
        clash = claims.add_output(second, 2)
        assert clash is not None
        assert (clash.output, clash.writer, clash.other, clash.is_input) == (second, 2, 1, True)
        again = claims.add_output(first, 3)
        assert again is not None
        assert (again.output, again.writer) == (first, 3)

        later = Claims[int]()
        assert later.add_output(first, 1) is None
        twice = later.add_output(second, 2)
        assert twice is not None
        assert (twice.output, twice.writer, twice.other, twice.is_input) == (second, 2, 1, False)
        read = later.add_input(second, 4)
        assert read is not None
        assert (read.output, read.writer) in ((first, 1), (second, 2))
        assert (read.other, read.is_input) == (4, True)
        assert later.owner_of(first) == 4
        assert later.owner_of(second) == 4


def test_files_of_their_own_do_not(folder: Path) -> None:
    claims = Claims[str]()
    for path in (
        "file",
        "sub/file",
        "new/file",
        "new/sub",
        "fil",
        "loop",
        "a\0b",
        "\ud800",
        "\ud800/a",
        "x" * 300,
        "/",
        "",
    ):
        assert claims.owner_of(path) is None
        assert claims.add_output(path, path) is None, path
    assert claims.add_input(str(folder.parent), "") is None
    (folder / "loop").symlink_to("loop")
    assert Claims[str]().add_input("loop", "") is None


def test_several_outputs_go_to_a_device_or_a_pipe() -> None:
    os.mkfifo("pipe")
    claims = Claims[str]()
    for path in ("/dev/null", "pipe"):
        assert claims.add_input(path, "") is None
        assert claims.add_output(path, "") is None
        assert claims.add_output(path, "") is None


def test_the_folders_of_a_file_are_known_by_any_name() -> None:
    identities = Identities()
    for name, others in NAMES.items():
        folder = identities.look_up(name)[0]
        for other in others:
            if "hard" not in other:
                assert identities.look_up(other)[0] == folder
    assert identities.of_folder("here/sub") in list(identities.upwards("here/sub/new"))
    assert identities.of_folder("sub") not in list(identities.upwards("new"))
    assert identities.of_folder("") == identities.of_folder("here")


def test_each_folder_is_looked_up_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looks: list[str] = []
    real = os.path.realpath
    monkeypatch.setattr(os.path, "realpath", lambda path: looks.append(path) or real(path))
    claims = Claims[int]()
    for number in range(100):
        claims.add_input(f"sub/{number}", number)
        claims.add_output(f"new/{number}", number)
    assert len(looks) <= 4
