"""Visitors of the page of `wrinkle edit`, what they send, and the command with such visitors until it is ended."""

import contextlib
import os
import random
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from kit.work import PATIENCE

Edit = list[Any]

VISITS = ("connect", "send", "bytes", "text", "get", "leave")
_LOOKS = 0.002  # seconds between two looks at whether the page is there
_KINDS = ("ScenePointerMessage", "ViewerCameraMessage", "SceneNodeClickMessage", "SceneNodeDragMessage")
# fmt: off
_OTHERS = [
    "GuiButtonHoldMessage", "GuiFormSubmitMessage", "GuiFormDirtyMessage", "FileTransferStartUpload",
    "FileTransferPart", "CommandTriggerMessage", "GetRenderResponseMessage", "LocalStorageGetItemResponseMessage",
    "ShareUrlRequest", "ShareUrlDisconnect", "GuiRemoveMessage", "RemoveSceneNodeMessage", "RunJavascriptMessage",
    "ResetGuiMessage", "SetSceneNodeVisibilityMessage", "TransformControlsDragStartMessage",
    "TransformControlsDragEndMessage", "NoMessage", "GuiCloseModalMessage", "GuiModalMessage", "MeshMessage",
    "BackgroundImageMessage", "Message", "",
]
_FIELDS = [
    "uuid", "updates", "name", "wxyz", "position", "owner", "event_type", "ray_origin", "ray_direction",
    "screen_pos", "modifier", "phase", "instance_index", "button", "payload", "render_uuid", "source_component_uuid",
    "transfer_uuid", "filename", "mime_type", "part_count", "size_bytes", "part_index", "content", "command_uuid",
    "type", "self", "__init__",
]
_PROPERTIES = [
    "value", "value", "value", "value", "value", "removed", "visible", "label", "disabled", "order", "options",
    "hint", "min", "max", "step", "update_cb", "_impl", "uuid", "parent_container_id", "gui_api", "sync_cb",
    "is_button", "__class__",
]
_VALUES = [
    True, True, True, False, None, 0, 1, 2, -1, 0.5, 1e308, -1e308, 10**18, float("nan"), float("inf"), "", "1",
    "50%", "limb", "fold", "none", "other", "a: b", "x" * 100_000, "\n\x1b[31m", "\ud800", "{[", "#", "]]}", [], {},
    [0, 0, 0], [1e30] * 3, [float("nan")] * 3, [None] * 3, ["a", "b", "c"], [1, 2], [[[[]]]], {"a": 1}, "off",
    "resolve", "20%", "x",
]
_NODES = ["", "/", "/none", "/tools", "/limb", "/handles", "/handles/0", "/origin", "/target", "/mesh", "x" * 10_000]
_HOSTS = ["evil.example", "127.0.0.1.evil.example", "localhost", "0.0.0.0", "[::1]", "127.0.0.1", "", "a b"]
_TARGETS = ["/", "/../../etc/passwd", "/%2e%2e/%2e%2e/etc/passwd", "//etc/passwd", "/limb.glb", "/" + "x" * 9000, "*"]
# fmt: on


def visits(chance: random.Random) -> Iterator[Edit]:
    """A few tabs connect from somewhere, send messages of all kinds, ask for files, and leave."""
    yield ["connect", "visit", _headers(chance) if chance.random() < 0.3 else {}]
    for _ in range(chance.choice([1, 3, 8, 20])):
        match chance.randrange(20):
            case 0:
                yield ["connect", "visit", _headers(chance)]
            case 1:
                yield ["get", "visit", chance.choice(_TARGETS), _headers(chance)]
            case 2:
                data = [b"", b"\xff" * 40, b"\xc1", b"\x80", b"\xdd\xff\xff\xff\xff", b"\x81\xa4type", b"\x91" * 5000]
                yield ["bytes", "visit", chance.choice(data).hex()]
            case 3:
                yield ["text", "visit", chance.choice(["", "{}", "x" * 100_000])]
            case 4:
                yield ["leave", "visit"]
            case _:
                yield ["send", "visit", _message(chance)]


def _headers(chance: random.Random) -> dict[str, str]:
    """The site that a page says it is from, and the name by which it asks for this machine; `{port}` is the page's."""
    headers = {}
    if chance.random() < 0.7:
        port = chance.choice(["", ":80", ":{port}", ":{port}", ":1"])
        headers["Origin"] = f"{chance.choice(['http', 'http', 'https', 'file'])}://{chance.choice(_HOSTS)}{port}"
    if chance.random() < 0.4:
        headers["Host"] = f"{chance.choice(_HOSTS)}{chance.choice(['', ':{port}', ':80'])}"
    return headers


def _message(chance: random.Random) -> Any:
    """A message of a control, of the mouse, or of any kind; `#3` stands for the third control."""

    def vector() -> Any:
        if chance.random() < 0.2:
            return chance.choice(_VALUES)
        return [round(chance.uniform(-2, 2), 2) for _ in range(3)]

    match chance.randrange(10):
        case 0 | 1 | 2 | 3 | 4:
            updates = {chance.choice(_PROPERTIES): chance.choice(_VALUES) for _ in range(chance.choice([1, 1, 2]))}
            control = f"#{chance.randrange(100)}"
            message: Any = {"type": "GuiUpdateMessage", "uuid": control, "updates": updates}
        case 5:
            message = {"type": "TransformControlsUpdateMessage", "name": chance.choice(_NODES), "wxyz": [1, 0, 0, 0]}
            message["position"] = vector()
        case 6 | 7:
            kind = chance.choice(_KINDS)
            message = {"type": kind, "ray_origin": vector(), "ray_direction": vector(), "modifier": None}
            if kind == "ScenePointerMessage":
                message |= {"event_type": chance.choice(["click", "rect-select", "x"]), "screen_pos": [[0.5, 0.5]]}
            elif kind == "ViewerCameraMessage":
                message = {"type": kind, "wxyz": [1, 0, 0, 0], "position": vector(), "fov": 1, "near": 0.1, "far": 100}
                message |= {"image_height": 480, "image_width": 640, "look_at": vector(), "up_direction": vector()}
            else:
                message |= {"name": chance.choice(_NODES), "instance_index": None, "screen_pos": [0.5, 0.5]}
                if kind == "SceneNodeDragMessage":
                    message = {
                        "type": kind,
                        "phase": chance.choice(["start", "update", "end"]),
                        "name": message["name"],
                    }
                    message |= {f"{end}_position": vector() for end in ("start", "end")} | {"instance_index": None}
                    message |= {f"{end}_screen_pos": [0.5, 0.5] for end in ("start", "end")} | {"button": "left"}
                    message |= {"modifier": None}
        case 8:
            message = {"type": chance.choice(_OTHERS)}
            message |= {chance.choice(_FIELDS): chance.choice(_VALUES) for _ in range(chance.randrange(4))}
        case _:
            return chance.choice([*_VALUES, {"type": 5}, {"type": None}, [1, 2]])
    match chance.randrange(8):  # of another type, or incomplete
        case 0:
            message[chance.choice(list(message))] = chance.choice(_VALUES)
        case 1:
            del message[chance.choice(list(message))]
        case 2:
            message[chance.choice(_FIELDS)] = chance.choice(_VALUES)
    return message


def visited(edits: Sequence[Edit], run: Callable[[], Any], said: Callable[[], bytes]) -> Any:
    """Run `wrinkle edit` in this process while visitors do what they do, then end it; what `run` gives.

    Args:
        edits: What the visitors do.
        run: Runs the command.
        said: What it has written to its standard output so far.

    Raises:
        AssertionError: The page let in who has no business there, or does not work after it.
    """
    from wrinklecli.editor.page import page as pages

    made: list[Any] = []
    over, problems = threading.Event(), list[BaseException]()
    usual = pages.Page

    class Recorded(usual):  # type: ignore[valid-type,misc]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            super().__init__(*arguments, **options)
            made.append(self)

    def visit() -> None:
        while not (made and b"\n" in said()):
            if over.wait(_LOOKS):
                return
        try:
            _Visitors(made[0], said().decode().split()[0]).do(edits)
        except BaseException as error:
            problems.append(error)
        finally:
            handler = signal.getsignal(signal.SIGINT)
            assert callable(handler)
            handler(signal.SIGINT, None)

    handlers = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)}
    visitor = threading.Thread(target=visit)
    pages.Page = Recorded  # type: ignore[misc]
    try:
        visitor.start()
        found = run()
    finally:
        over.set()
        visitor.join()
        pages.Page = usual  # type: ignore[misc]
        for each, handler in handlers.items():
            signal.signal(each, handler)
    for problem in problems:
        raise problem
    return found


class _Visitors:
    """Tabs of a page, the last one of which sends what is sent."""

    def __init__(self, page: Any, address: str) -> None:
        import viser

        split = urlsplit(address)
        self._host, self._port, self._query = str(split.hostname), page.port, f"?{split.query}" if split.query else ""
        self._page = page
        self._protocol = f"viser-v{viser.__version__}"
        self._tab: Any = None

    def do(self, edits: Sequence[Edit]) -> None:
        """Do what visitors do, then see that a sound tab is served, and that both threads work."""
        with contextlib.ExitStack() as self._tabs:
            for what, _, *values in edits:
                with contextlib.suppress(OSError, EOFError):  # whatever is answered; a tab may be shown the door
                    getattr(self, f"_{what}")(*values)
            with self._connected({}) as sound:
                assert len(sound.recv(timeout=PATIENCE)) > 1000, "a new tab is not shown the page"
            for name in ("work", "slow"):
                done = threading.Event()
                getattr(self._page, name).put(object(), done.set)
                assert done.wait(PATIENCE), f"the page's thread for {name} does no more"

    def _connected(self, headers: dict[str, str]) -> Any:
        """Open a tab of a page that says where it is from, and what it takes this machine for."""
        import socket

        from websockets.sync.client import connect

        usual = f"[{self._host}]" if ":" in self._host else self._host
        headers = {name: value.format(port=self._port) for name, value in headers.items()}
        options: dict[str, Any] = {"origin": headers["Origin"]} if "Origin" in headers else {}
        end = socket.create_connection((self._host, self._port), timeout=PATIENCE)
        try:
            return connect(
                f"ws://{headers.get('Host', f'{usual}:{self._port}')}/{self._query}",
                sock=end,
                subprotocols=[self._protocol],  # type: ignore[list-item]
                max_size=None,
                open_timeout=PATIENCE,
                **options,
            )
        except BaseException:
            end.close()
            raise

    def _connect(self, headers: dict[str, str]) -> None:
        from websockets.exceptions import WebSocketException

        try:
            tab = self._connected(headers)
        except (WebSocketException, ValueError):
            return
        origin = headers.get("Origin", "")
        assert "evil" not in origin, f"let a page in from {origin}"
        self._tab = self._tabs.enter_context(tab)

    def _get(self, target: str, headers: dict[str, str]) -> None:
        import socket

        lines = [
            f"GET {target} HTTP/1.1",
            *(f"{name}: {value}" for name, value in headers.items()),
            "Connection: close",
        ]
        with socket.create_connection((self._host, self._port), timeout=PATIENCE) as asked:
            asked.sendall("\r\n".join([*lines, "", ""]).format(port=self._port).encode())
            answer = asked.recv(2**16)
        assert b"root:" not in answer, "served a file of this machine"
        assert not answer.partition(b"\r\n\r\n")[2].startswith(b"glTF"), "served a file of the folder"

    def _send(self, message: Any) -> None:
        import msgspec

        if isinstance(message, dict) and str(message.get("uuid", "")).startswith("#"):
            controls = list(self._page.server.gui._gui_input_handle_from_uuid)
            number = str(message["uuid"])[1:]
            message = {**message, "uuid": controls[int(number) % len(controls)] if number else ""}
        try:
            data = msgspec.msgpack.encode(message)
        except (OverflowError, UnicodeError, ValueError):
            return
        self._sent(data)

    def _bytes(self, text: str) -> None:
        self._sent(bytes.fromhex(text))

    def _text(self, text: str) -> None:
        self._sent(text)

    def _sent(self, data: bytes | str) -> None:
        from websockets.exceptions import ConnectionClosed

        if self._tab is None:
            self._connect({})
        try:
            self._tab.send(data)
        except ConnectionClosed:
            self._tab = None

    def _leave(self) -> None:
        if self._tab is not None:
            self._tab.close()
            self._tab = None


def watched(edits: Sequence[Edit], folder: Path, run: Callable[[], Any]) -> Any:
    """Run a command that watches files in this process; whenever it waits, one file more is changed, then it ends."""
    left = list(edits)
    sound = (folder / "sound.glb").read_bytes() if (folder / "sound.glb").is_file() else b""
    contents: dict[str, bytes] = {}
    held: list[int] = []
    usual, count = time.sleep, 0

    def meanwhile(seconds: float) -> None:
        nonlocal count
        if threading.current_thread() is not threading.main_thread():
            usual(seconds)
            return
        count += 1
        if count % 3:  # a change is noticed at the second look
            return
        if not left:
            raise KeyboardInterrupt
        what, _, name = left.pop(0)
        path = folder / name
        if path.is_file() and not path.is_symlink():
            contents.setdefault(name, path.read_bytes())
        with contextlib.suppress(OSError):
            path.rmdir() if path.is_dir() else path.unlink()
        match what:
            case "half":
                path.write_bytes(contents.get(name, b"")[: len(contents.get(name, b"")) // 2])
            case "pipe":
                os.mkfifo(path)
                held.append(os.open(path, os.O_RDWR))  # a picture fits into it, so who writes it need not wait
            case "folder":
                path.mkdir()
            case "again":
                path.write_bytes(contents.get(name, b""))
            case "sound":
                path.write_bytes(sound)

    time.sleep = meanwhile
    try:
        return run()
    finally:
        time.sleep = usual
        for each in held:
            os.close(each)
