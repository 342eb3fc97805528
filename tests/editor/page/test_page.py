"""The page for those who mean it no good: what they send ends at most their own tab."""

import contextlib
import gc
import os
import socket
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest
import viser
import zstandard
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from kit.browser import until
from kit.limb import limb, limb_asset
from kit.work import PATIENCE
from wrinklecli.editor import edits
from wrinklecli.editor.page import server
from wrinklecli.editor.page.page import Page
from wrinklecli.editor.session import Session
from wrinklecli.errors import WrinkleError
from wrinklecli.review.preview.heat import point_colours

TABS = 100
MOMENTS = 100
TOOL = "tools: [{name: a, origin: [-0.4, 0.25, 0], target: [0.4, 0.25, 0], width: 0.3}]\n"
EVIL = [
    b"",
    b"\xff" * 40,
    msgspec.msgpack.encode(17),
    msgspec.msgpack.encode({"type": "NoMessage"}),
    msgspec.msgpack.encode({"type": "GuiUpdateMessage"}),
    msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "none", "updates": {"value": 1}}),
    msgspec.msgpack.encode({"type": "ShareUrlRequest"}),
    msgspec.msgpack.encode({"type": "ScenePointerMessage", "event_type": "click", "ray_origin": None}),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page of a limb without tools."""
    folder = tmp_path_factory.mktemp("page")
    page = Page(Session(limb(folder / "limb.glb", rings=8, sides=6)))
    yield page
    page.close()


def tab(page: Page, **options: object) -> ClientConnection:
    address = page.address.replace("http", "ws", 1)
    options = {"subprotocols": [f"viser-v{viser.__version__}"], "max_size": None, "open_timeout": PATIENCE} | options
    return connect(address, **options)  # type: ignore[arg-type]


def test_it_offers_what_was_edited_elsewhere_and_is_there_still(page: Page, tmp_path: Path) -> None:
    other = str(limb(tmp_path / "other.glb", rings=3, sides=4))
    known = {other: "", "/elsewhere/gone.glb": "", os.path.abspath(page.session.asset): page.session.path}
    shown = Page(Session(page.session.asset), known=known)
    try:
        assert shown._files.opened.options == ("limb.glb", other)
        assert page._files.opened.options == ("limb.glb",)
    finally:
        shown.close()


def test_heat_is_the_compression_below_the_wrinkles_with_a_legend(page: Page) -> None:
    viewport, session, moment = page._viewport, page.session, ("fold", 1.0)
    session.add("tools", [(-0.4, 0.25, 0.0), (0.4, 0.25, 0.0)])
    assert not viewport._heats(session.meshes(*moment), moment)
    for shown in (True, False):
        viewport._heat()
        assert ("compressed by" in page._message.content) == shown
        if shown:
            (colours,) = viewport._heats(session.meshes(*moment), moment)
    (plain,) = session.meshes(*moment, wrinkled=False)
    (wrinkled,) = session.meshes(*moment)
    found = [point_colours(each.source.rest_positions, each.positions, each.faces) for each in (plain, wrinkled)]
    assert np.array_equal(colours, found[0])
    assert not np.array_equal(*found)
    session.undo()


def unpacked(data: str | bytes) -> bytes:
    """The packed messages of a window, which are compressed behind two numbers."""
    assert isinstance(data, bytes)
    size = int.from_bytes(data[8:16], "little")
    return zstandard.ZstdDecompressor().decompress(data[16 : 16 + size])


@pytest.mark.slow
def test_hostile_messages_end_no_other_tab(page: Page) -> None:
    with tab(page) as other:
        other.recv(timeout=PATIENCE)
        for message in EVIL:
            with tab(page) as hostile, contextlib.suppress(ConnectionClosed):
                hostile.send(message)
                hostile.recv(timeout=PATIENCE)
        with contextlib.suppress(TimeoutError):
            while True:
                other.recv(timeout=0.1)
        page.say("still here")
        assert other.recv(timeout=PATIENCE)


@pytest.mark.slow
@pytest.mark.long
def test_many_tabs_show_one_session(page: Page) -> None:
    with contextlib.ExitStack() as stack:
        tabs = [stack.enter_context(tab(page)) for _ in range(TABS)]
        assert all(len(each.recv(timeout=PATIENCE)) > 1000 for each in tabs)


@pytest.mark.slow
def test_tabs_that_are_gone_leave_nothing(page: Page) -> None:
    """Each has some hundred kilobytes, and Python looks for them rarely, if at all; the next tab frees them."""
    gc.disable()
    try:
        for _ in range(8):
            gone = tab(page)
            gone.recv(timeout=PATIENCE)
            gone.socket.shutdown(socket.SHUT_RDWR)  # so that the page learns of it now, not by its next ping

        def are_freed() -> bool:
            with tab(page) as another:
                another.recv(timeout=PATIENCE)
                return sum(isinstance(each, ServerConnection) for each in gc.get_objects()) <= 3

        until(are_freed, "no old connections")
    finally:
        gc.enable()


def test_names_with_half_a_character_are_shown(tmp_path: Path) -> None:
    asset = limb_asset(rings=8, sides=6)
    for kind in ("nodes", "meshes", "animations"):
        for each in asset.gltf[kind]:
            each["name"] = "half \ud801"
    asset.gltf["nodes"][0]["name"] = "limb \ud802"
    page = Page(Session(asset.write(tmp_path / "limb.glb")))
    try:
        with tab(page) as shown:
            assert b"half \\ud801" in b"".join(unpacked(shown.recv(timeout=PATIENCE)) for _ in range(2))
    finally:
        page.close()


def test_a_tab_for_which_no_memory_is_left_is_refused(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    """The packing of messages would end the process where there is none."""

    def none_left(_size: int) -> None:
        raise MemoryError

    monkeypatch.setattr(server, "leave_room", none_left)
    with pytest.raises(InvalidStatus, match="503"):
        tab(page)


def test_other_pages_are_not_let_in(page: Page) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        tab(page, origin="http://evil.example")
    with tab(page, origin=f"http://127.0.0.1:{page.port}") as own:
        assert own.recv(timeout=PATIENCE)


@pytest.mark.slow
def test_what_slides_is_not_lost_to_what_slides_next(tmp_path: Path) -> None:
    (tmp_path / "limb.yaml").write_text("version: 1\n" + TOOL)
    session = Session(limb(tmp_path / "limb.glb", rings=8, sides=6))
    page = Page(session)
    try:
        page.stop_work()  # so that nothing becomes an edit by itself
        page.choose("a", look=True)
        for key, value in (("bumps", 3), ("bumps", 4), ("gap", 1)):
            page.slide(key, lambda draft, at=key, to=value: session.set_value("a", (at,), to, draft=draft))
        assert ("bumps: 4" in session.text, "gap: 1" in session.text) == (True, False)
        page.commit()
        assert "gap: 1" in session.text
        assert session.undo()
        assert session.undo()
        assert not session.undo()
    finally:
        page.close()


def test_a_taken_port_is_said_in_a_line(page: Page, tmp_path: Path) -> None:
    session = Session(limb(tmp_path / "limb.glb", rings=8, sides=6))
    with pytest.raises(WrinkleError, match=r"^edit: port \d+ of 127\.0\.0\.1: .*--port") as caught:
        Page(session, port=page.port)
    assert len(caught.value.lines) == 1


@pytest.mark.slow
@pytest.mark.long
def test_a_day_of_edits_and_moments_takes_no_more_memory(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edits, "_MAX_STEPS", MOMENTS)
    session = page.session
    name = session.add("tools", [(-0.3, 0.25, 0.0), (0.3, 0.25, 0.0)])

    def held(seed: int) -> tuple[int, int, int]:
        """Objects, threads and descriptors after as many edits as can be undone, each shown with a moment of a clip."""
        for number in range(MOMENTS):
            session.set_value(name, ("bumps",), 2 + (number + seed) % 7)
            done = threading.Event()
            page.work.put(object(), partial(page.player.go, session.clips[0].name, number / MOMENTS))
            page.work.put(object(), page.refresh)
            page.work.put(object(), done.set)
            assert done.wait(PATIENCE)
        gc.collect()
        return len(gc.get_objects()), threading.active_count(), len(os.listdir("/proc/self/fd"))

    with tab(page) as opened:
        threading.Thread(target=lambda: list(map(len, opened)), daemon=True).start()
        first, later = held(0), held(1)
    assert later[0] < 1.02 * first[0]
    assert later[1:] == first[1:]
