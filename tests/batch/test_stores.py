"""What libraries of stores answer, and what is said of it; no run leaves anything behind."""

import errno
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from kit.command import Wrinkle
from kit.limb import limb_asset, write_tools
from wrinklecli.batch import stores
from wrinklecli.batch.stores import StoreError

fsspec = pytest.importorskip("fsspec")
URL = "memory:///b/limb.glb"


@pytest.fixture
def store() -> Iterator[Any]:
    """A store with an asset and tools for it."""
    made = fsspec.filesystem("memory")
    with tempfile.TemporaryDirectory() as name:
        made.pipe_file("/b/limb.glb", limb_asset(rings=7, sides=6).write(Path(name, "limb.glb")).read_bytes())
        tools = write_tools(Path(name, "tools.yaml"), refinement={"max_levels": 0}, sampling={"fps": 4})
        made.pipe_file("/b/tools.yaml", tools.read_bytes())
    yield made
    made.rm("/b", recursive=True)


class BrokenError(OSError):
    """As aiohttp has them."""


@pytest.mark.parametrize(
    ("raised", "said"),
    [
        (FileNotFoundError("b/limb.glb"), "No such file or directory"),
        (FileNotFoundError("The specified bucket does not exist"), "The specified bucket does not exist"),
        (PermissionError("Access Denied\nmore"), "Access Denied"),
        (PermissionError(), "Permission denied"),
        (OSError(errno.ENOSPC, "No space left on device"), "No space left on device"),
    ],
)
def test_an_answer_is_an_error_with_its_reason(
    store: Any, raised: OSError, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(store), "open", raising(raised))
    with pytest.raises(type(raised)) as caught:
        stores.read(URL)
    assert caught.value.strerror == said


@pytest.mark.parametrize(
    "raised",
    [
        BrokenError("broken"),
        ConnectionResetError(errno.ECONNRESET, "reset"),
        OSError(errno.EBUSY, "SlowDown"),
        ValueError(),
    ],
)
def test_no_answer_may_be_one_another_time(store: Any, raised: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(store), "open", raising(raised))
    with pytest.raises(StoreError, match="the store does not answer: "):
        stores.read(URL)


def raising(error: Exception) -> Any:
    def fail(*_: object, **__: object) -> Any:
        raise error

    return fail


def test_what_may_not_be_listed_or_written_is_said_before_the_first_bake(
    store: Any, wrinkle: Wrinkle, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ("--tools", "memory:///b/tools.yaml", "--out", "memory:///b/out/{stem}.glb")
    monkeypatch.setattr(type(store), "pipe_file", raising(PermissionError("Access Denied")))
    ran = wrinkle("batch", URL, *arguments, "--cache", "memory:///b/cache")
    assert (ran.code, ran.lines) == (
        1,
        ["memory:///b/cache/CACHEDIR.TAG: the cache cannot be written: Access Denied"],
    )
    monkeypatch.setattr(type(store), "glob", raising(PermissionError("Access Denied")))
    ran = wrinkle("batch", "memory:///b/*.glb", *arguments)
    assert (ran.code, ran.lines) == (
        1,
        ["asset: found 'memory:///b/*.glb', which cannot be listed: Access Denied"],
    )


def test_what_a_killed_run_fetched_is_taken_away(
    store: Any, wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert store.exists("/b/limb.glb")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    machine = Path("/proc/sys/kernel/random/boot_id")
    if not machine.exists():
        pytest.skip("knows its own folders by the boot's number")
    left = tmp_path / "temporary" / f".wrinkle-{machine.read_text()[:8]}-{os.urandom(8).hex()}" / "1" / "0"
    left.mkdir(parents=True)
    (left / "limb.glb").write_bytes(b"fetched")
    assert wrinkle("batch", URL, "--tools", "memory:///b/tools.yaml", "--out", "out.glb").code == 0
    assert list((tmp_path / "temporary").iterdir()) == []
    assert (tmp_path / "out.glb").exists()
