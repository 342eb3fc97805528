"""Whatever a message of a tab says, no control is lost, no thread ends, and every tab can still save."""

import contextlib
import dataclasses
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import msgspec
import pytest
import viser
import viser.infra
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from kit.browser import until
from kit.drawn import CHARACTERS
from kit.limb import limb
from kit.work import PATIENCE
from wrinklecli.editor.page import server, work_queue
from wrinklecli.editor.page.messages import is_sent
from wrinklecli.editor.page.page import Page
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.editor.session import Session

TOOL = "version: 1\ntools: [{name: a, origin: [-0.4, 0.25, 0], target: [0.4, 0.25, 0], width: 0.3}]\n"
CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": [1, 0, 0, 0],
    "position": [0, 0, -3],
    "fov": 1,
    "near": 0.1,
    "far": 100,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0, 0, 0],
    "up_direction": [0, 1, 0],
}
CLICK: dict[str, Any] = {
    "type": "ScenePointerMessage",
    "event_type": "click",
    "ray_origin": [0, 0, -3],
    "ray_direction": [0, 0, 1],
    "screen_pos": [[0.5, 0.5]],
    "modifier": None,
}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A page of a limb with a tool."""
    folder = tmp_path_factory.mktemp("page")
    (folder / "limb.yaml").write_text(TOOL)
    page = Page(Session(limb(folder / "limb.glb", rings=8, sides=6)))
    page.choose("a", look=False)
    yield page
    page.close()


def tab(page: Page) -> ClientConnection:
    """A tab that shows the page."""
    address = page.address.replace("http", "ws", 1)
    protocol: Any = f"viser-v{viser.__version__}"
    connection = connect(address, subprotocols=[protocol], max_size=None, open_timeout=PATIENCE)
    threading.Thread(target=lambda: [None for _ in connection], daemon=True).start()
    connection.send(msgspec.msgpack.encode(CAMERA))
    return connection


def controls(page: Page) -> dict[str, Any]:
    return dict(page.server.gui._gui_input_handle_from_uuid)


def control(page: Page, label: str) -> str:
    """The id of a control, by its title without marks."""
    return next(
        uuid for uuid, each in controls(page).items() if str(getattr(each, "label", "")).lstrip("×◇≡ ") == label
    )


def set_to(uuid: object, **updates: object) -> dict[str, object]:
    return {"type": "GuiUpdateMessage", "uuid": uuid, "updates": updates}


def sent(page: Page, message: object) -> bool:
    return is_sent(msgspec.msgpack.encode(message), controls(page))


def assert_alive(page: Page) -> None:
    """Edits and saves the tool in a tab, after all that was asked for before."""
    ready: Future[None] = Future()

    def begin() -> None:
        try:
            page.commit()
            page.choose("a", look=False)
            page.session.unset("a", ("bumps",))
            page.refresh()  # a control that shows nine already would not tell the page of nine
        except BaseException as error:
            ready.set_exception(error)
        else:
            ready.set_result(None)

    # By the page's own thread, as nothing else may then change what the page shows.
    page.work.put(begin, begin)
    ready.result(PATIENCE)
    with tab(page) as alive:
        for uuid, value in ((control(page, "bumps"), 9), (control(page, "file"), "Save")):
            alive.send(msgspec.msgpack.encode(set_to(uuid, value=value)))
            until(lambda: "bumps: 9" in page.session.text, "nine bumps")
    until(lambda: "bumps: 9" in Path(page.session.path).read_text(), "a saved tool")


def answered(page: Page, sender: ClientConnection, monkeypatch: pytest.MonkeyPatch) -> None:
    """Waits until the page has read all that a tab has sent, and has put what that asks for into its queue."""
    last, seen = msgspec.msgpack.encode({"type": "TheLast"}), threading.Event()

    def look(data: str | bytes, of: Any) -> bool:
        if data == last:
            seen.set()
        return is_sent(data, of)

    monkeypatch.setattr(server, "is_sent", look)
    # Again and again, as the page has begun to wait for the next one before.
    until(lambda: sender.send(last) or seen.is_set(), "the last message")
    # viser calls what controls do in threads; once all of them are here, none does anything else.
    pool = page.server._thread_executor
    together = threading.Barrier(pool._max_workers + 1, timeout=PATIENCE)
    for _ in range(pool._max_workers):
        pool.submit(together.wait)
    together.wait()


@pytest.mark.slow
def test_no_message_takes_a_control_away(page: Page) -> None:
    with tab(page) as hostile:
        for uuid in controls(page):
            for updates in ({"removed": True}, {"value": True, "removed": True}, {"update_cb": []}, {"visible": False}):
                hostile.send(msgspec.msgpack.encode(set_to(uuid, **updates)))
                assert not sent(page, set_to(uuid, **updates))
        assert_alive(page)


def test_what_no_tab_sends_is_dropped(page: Page) -> None:
    bumps, clip, file = (control(page, label) for label in ("bumps", "clip", "file"))
    assert sent(page, CAMERA)
    assert sent(page, CLICK)
    assert sent(page, set_to(bumps, value=5))
    assert sent(page, set_to(bumps, value=99)), "it can be typed, and the schema refuses it"
    assert sent(page, set_to(file, value="Save"))
    for value in (float("nan"), float("inf"), 1e300, "5", None, True, [5], {"a": 5}, b"5"):
        assert not sent(page, set_to(bumps, value=value))
        assert not sent(page, {**CAMERA, "fov": value if value != 1e300 else -value})
    for message in (
        set_to(clip, value="none"),
        set_to(file, value="Format"),
        set_to(control(page, "name"), value="x" * 200_000),
        set_to("none", value=1),
        set_to([bumps], value=1),
        set_to(bumps),
        {"type": "GuiUpdateMessage", "uuid": bumps, "updates": [["value", 1]]},
        {**CAMERA, "position": [0, 0, float("nan")]},
        {**CAMERA, "position": [0, 0]},
        {**CLICK, "ray_origin": ["0", 0, 0]},
        {**CLICK, "event_type": "explode"},
        {"type": "GuiRemoveMessage", "uuid": bumps},
        {"type": "ResetGuiMessage"},
        {"type": "GuiFormDirtyMessage", "uuid": "x"},
        {"type": "RunJavascriptMessage", "source": "alert(1)"},
        {"type": ["GuiUpdateMessage"]},
        {"type": "CommandTriggerMessage"},
        {"type": "ShareUrlRequest"},
        [],
        17,
    ):
        assert not sent(page, message), message
    deep = b"\x91" * 100_000 + b"\xc0"
    for data in ("text", b"", b"\xff" * 40, deep, msgspec.msgpack.encode(CLICK)[:-3]):
        assert not is_sent(data, controls(page))


@st.composite
def messages(draw: st.DrawFn, kinds: list[type]) -> dict[str, Any]:
    """A message of any kind with any fields."""
    numbers = st.sampled_from([0, 1, -1, 0.5, 60, 1e11, 1e300, -1e300, float("nan"), float("inf"), 2**63])
    values = st.recursive(
        st.one_of(
            numbers, st.none(), st.booleans(), st.sampled_from(["", "a", "start", "click", "x" * 9999, "\ud7ff"])
        ),
        lambda parts: st.one_of(
            st.lists(parts, max_size=4), st.dictionaries(st.text(CHARACTERS, max_size=3), parts, max_size=2)
        ),
        max_leaves=6,
    )
    kind = draw(st.sampled_from(kinds))
    fields = {
        field.name: draw(st.one_of(st.lists(numbers, min_size=3, max_size=3), values))
        for field in dataclasses.fields(kind)
    }
    return {"type": kind.__name__, **fields}


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.filterwarnings("ignore:Do not use the .random. module")  # as pings of other threads do after 20 s
def test_after_hundreds_of_messages_every_tab_edits_and_saves(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    every = [kind for kind in viser.infra.Message.get_subclasses() if dataclasses.is_dataclass(kind)]
    hostile = tab(page)

    # On a busy machine messages are made more slowly, which says nothing of the page.
    @settings(max_examples=600, suppress_health_check=[HealthCheck.too_slow])
    @given(messages(sorted(every, key=lambda kind: kind.__name__)), st.integers(0, 10**6), st.booleans())
    def attack(message: dict[str, Any], number: int, own: bool) -> None:
        nonlocal hostile
        known = sorted(controls(page))
        if own:
            values = [each for key, each in message.items() if key != "type"] or [number]
            message = set_to(
                known[number % len(known)], value=values[0], **{"removed": True} if number % 7 == 0 else {}
            )
        try:
            hostile.send(msgspec.msgpack.encode(message))
        except ConnectionClosed:
            hostile = tab(page)

    attack()
    answered(page, hostile, monkeypatch)
    with contextlib.suppress(ConnectionClosed):
        hostile.close()
    assert_alive(page)


@pytest.mark.slow
def test_a_flood_of_clicks_does_not_grow(page: Page, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work_queue, "_MAX_EVENTS", 20)
    free = threading.Event()
    page.work.put("busy", lambda: free.wait(PATIENCE) and None)
    with tab(page) as hostile:
        for _ in range(100):
            hostile.send(msgspec.msgpack.encode(set_to(control(page, "file"), value="Undo")))
        # The page itself may ask for a little more meanwhile.
        until(lambda: 20 <= len(page.work._asked) < 25, "a full queue")
    free.set()
    assert_alive(page)


def test_nothing_that_an_action_raises_ends_the_queue() -> None:
    failed: list[BaseException] = []
    done = threading.Event()

    def fail(error: BaseException) -> None:
        failed.append(error)
        raise RuntimeError("this too")

    queue = WorkQueue(fail)
    thread = threading.Thread(target=queue.run, daemon=True)
    thread.start()

    def raise_it(error: BaseException) -> None:
        raise error

    for error in (ValueError(), RecursionError(), MemoryError(), SystemExit(), GeneratorExit()):
        queue.put(object(), lambda error=error: raise_it(error))  # type: ignore[misc]
    queue.put(object(), done.set)
    assert done.wait(PATIENCE)
    assert len(failed) == 5
    queue.end()
    thread.join(PATIENCE)
