"""What libraries of stores answer, and what is said of it; no run leaves anything behind."""

import errno
import json
import os
import tempfile
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from kit import web
from kit.clients import need
from kit.command import Wrinkle
from kit.limb import limb_asset, write_tools
from wrinklecli.batching import stores, worker
from wrinklecli.batching.stores import StoreError

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
    assert (ran.code, ran.lines[:2]) == (
        1,
        [
            "warning: memory:///b/cache/CACHEDIR.TAG: the cache cannot be written: Access Denied; outputs are not kept",
            "memory:///b/out/limb.glb: cannot be written: Access Denied",
        ],
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


SLOW = [web.stopped, web.silent, web.dribbled, web.crawling, web.broken]
SMALL = 10**6  # bytes that a file may have in these tests


@pytest.fixture
def http() -> None:
    need("aiohttp")


@pytest.mark.usefixtures("http")
@pytest.mark.parametrize(
    ("address", "answer", "number", "said"),
    [
        ("{}/a.glb", web.announced, errno.EFBIG, "has 10 GB or more, and at most 1 MB are read"),
        ("{}/a.glb", web.endless, errno.EFBIG, "at most 1 MB are read"),
        ("{}/a.glb", web.inflated(20 * SMALL), errno.EFBIG, "at most 1 MB are read"),
        ("zip://a.glb::{}/a.zip", web.sound(web.zipped(bytes(20 * SMALL))), errno.EFBIG, "has 20 MB or more"),
        ("zip://a.glb::{}/a.zip", web.announced, errno.EFBIG, "has 10 GB or more"),
        ("tar://a.glb::{}/a.tar.gz", web.sound(web.tarred(bytes(20 * SMALL))), errno.EFBIG, "at most 1 MB are read"),
        ("{}/none", web.endless, errno.ENOENT, "No such file or directory"),
    ],
)
def test_a_file_at_a_url_has_no_more_bytes_than_may_be_read(
    address: str, answer: web.Answer, number: int, said: str, tmp_path: Path
) -> None:
    path = f"/{address.rpartition('/')[2]}" if "none" not in address else "/a.glb"
    with web.served({path: answer}) as server, pytest.raises(OSError, match=said) as caught:
        stores.fetch(address.format(server), str(tmp_path / "a.glb"), SMALL)
    assert caught.value.errno == number
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("http")
@pytest.mark.parametrize("chain", ["", "zip://a.glb::"])
@pytest.mark.parametrize("answer", SLOW, ids=lambda each: each.__name__)
def test_a_server_that_stops_or_dribbles_does_not_answer(
    answer: web.Answer, chain: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stores, "_PATIENCE", 0.3)
    began = time.monotonic()
    with web.served({"/a.zip": answer}) as server, pytest.raises(StoreError, match="the store does not answer: "):
        stores.read(f"{chain}{server}/a.zip")
    assert time.monotonic() - began < 20.0  # seconds: less than `_PATIENCE` is otherwise, for a busy machine


@pytest.mark.usefixtures("http")
def test_a_list_that_dribbles_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing watches its pace, and each byte comes in time."""
    monkeypatch.setattr(stores, "_PATIENCE", 0.1)
    with web.served({"/": web.dribbled}) as server, pytest.raises(StoreError, match="the store does not answer"):
        stores.matches(f"{server}/*.glb", "")


@pytest.mark.usefixtures("http")
def test_a_refused_connection_is_no_missing_file() -> None:
    with web.served({}) as server:
        pass
    with pytest.raises(StoreError, match="Cannot connect"):
        stores.read(f"{server}/a.yaml")


@pytest.mark.usefixtures("http")
def test_archives_are_read_by_url() -> None:
    answers = {"/a.zip": web.sound(web.zipped(bytes(1000))), "/a.tar.gz": web.sound(web.tarred(bytes(1000)))}
    with web.served(answers) as server:
        assert stores.read(f"zip://a.glb::{server}/a.zip", 2000) == bytes(1000)
        assert stores.read(f"tar://a.glb::{server}/a.tar.gz", SMALL) == bytes(1000)
        with pytest.raises(FileNotFoundError):
            stores.read(f"zip://b.glb::{server}/a.zip")


@pytest.mark.usefixtures("http")
def test_a_zip_that_says_less_than_it_has_is_no_larger() -> None:
    answers = {"/a.zip": web.sound(web.zipped(bytes(20 * SMALL), said=1000))}
    with web.served(answers) as server, pytest.raises((OSError, StoreError)):
        stores.read(f"zip://a.glb::{server}/a.zip", SMALL)


@pytest.mark.usefixtures("http")
@pytest.mark.parametrize("large", ["limb.gltf", "tools.yaml", "limb.bin", "clips.glb"])
def test_a_job_says_which_of_its_files_is_too_large(large: str, wrinkle: Wrinkle, tmp_path: Path) -> None:
    limb_asset(rings=7, sides=6).write(tmp_path / "limb.gltf")
    write_tools(tmp_path / "tools.yaml", refinement={"max_levels": 0}, sampling={"fps": 4})
    limb_asset(rings=7, sides=6).write(tmp_path / "clips.glb")
    answers = {f"/{path.name}": web.sound(path.read_bytes()) for path in tmp_path.iterdir()}
    gltf = json.loads((tmp_path / "limb.gltf").read_text())
    gltf["buffers"][0]["uri"] = "limb.bin"
    answers |= {"/limb.gltf": web.sound(json.dumps(gltf).encode()), "/limb.bin": web.sound(web.BLOCK)}
    job = {"out": str(tmp_path / "out.glb"), "max_memory": "50MB", "anim": "clips.glb"}
    lines = json.dumps({"asset": "limb.gltf", "tools": "tools.yaml", **job}).encode()
    answers |= {f"/{large}": web.announced, "/jobs.jsonl": web.sound(lines)}
    with web.served(answers) as server:
        ran = wrinkle("batch", f"{server}/jobs.jsonl", "--cache", tmp_path / "cache", "-q")
    at = f"{server}/jobs.jsonl:1: jobs[0]: {server}/{large}"
    assert ran.lines == [f"{at}: cannot be read: has 10 GB or more, and at most 50 MB are read: raise max_memory"]
    assert ran.code == 1
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("http")
def test_a_store_that_breaks_off_is_asked_again(
    wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "_FIRST_PAUSE", 0.01)
    asset = limb_asset(rings=7, sides=6).write(tmp_path / "limb.glb").read_bytes()
    tools = write_tools(tmp_path / "tools.yaml", refinement={"max_levels": 0}, sampling={"fps": 4}).read_bytes()
    asked: list[str] = []

    def at_last(request: BaseHTTPRequestHandler, ended: Event) -> None:
        asked.append(request.path)
        (web.sound(asset) if len(asked) == 3 else web.broken)(request, ended)

    with web.served({"/limb.glb": at_last, "/tools.yaml": web.sound(tools)}) as server:
        arguments = ("--tools", f"{server}/tools.yaml", "--out", tmp_path / "out.glb", "--cache", tmp_path / "cache")
        ran = wrinkle("batch", f"{server}/limb.glb", *arguments, "-q", "--retry", "1")
        assert (ran.code, len(asked), len(ran.lines)) == (1, 2, 1)
        assert ran.lines[0].startswith(f"{server}/limb.glb: the store does not answer: ")
        assert wrinkle("batch", f"{server}/limb.glb", *arguments, "-q").code == 0


@pytest.mark.slow
@pytest.mark.usefixtures("http")
def test_a_manifest_is_no_larger_than_one_may_be(wrinkle: Wrinkle, tmp_path: Path) -> None:
    with web.served({"/jobs.yaml": web.announced}) as server:
        ran = wrinkle("batch", f"{server}/jobs.yaml", "--cache", tmp_path / "cache")
    said = f"{server}/jobs.yaml: cannot be read: has 10 GB or more, and at most 100 MB are read"
    assert (ran.code, ran.lines) == (1, [said])
    (tmp_path / "jobs.yaml").touch()
    os.truncate(tmp_path / "jobs.yaml", 10**10)
    ran = wrinkle("batch", tmp_path / "jobs.yaml")
    assert (ran.code, len(ran.lines)) == (1, 1)
    assert "at most 100 MB are read" in ran.lines[0]
