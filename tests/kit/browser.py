"""A page in a real browser: Chromium, driven through its DevTools protocol, by mouse, keyboard and what the page shows.

Source: https://chromedevtools.github.io/devtools-protocol/, domains Page, Runtime and Input.
"""

import base64
import json
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

from kit.clients import give_up
from kit.work import PATIENCE

_STEADY = 0.15  # seconds in which what moves has moved
# A page that draws itself all the time takes all of a core without a GPU, and shows no more than ten times a second.
_SELDOM = """
const draw = requestAnimationFrame.bind(window);
window.requestAnimationFrame = (each) => setTimeout(() => draw(each), 100);
window.cancelAnimationFrame = clearTimeout;
"""
# Without a GPU, what is drawn takes the processor longer than all else that a page does. A canvas on which nothing is
# drawn or cleared is not put on the page anew either.
_UNDRAWN = """
for (const {prototype} of [WebGLRenderingContext, WebGL2RenderingContext])
    for (const name of Object.keys(prototype))
        if (/^(blit|clear|draw(?!ing))/.test(name)) prototype[name] = () => {};
"""
_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-gpu-compositing",  # without a GPU, the page around the scene takes half of what is drawn
    "--disable-sync",
    "--no-first-run",
    "--remote-debugging-port=0",
)


class Page:
    """The one page of a browser.

    Args:
        connection: To its DevTools.

    Attributes:
        errors: What the console shows as errors, with requests that fail and exceptions.
    """

    def __init__(self, connection: Any) -> None:
        self._connection, self._sent, self._held, self._shift = connection, 0, False, False
        self.errors: list[str] = []

    def call(self, method: str, **parameters: object) -> dict[str, Any]:
        """The answer of a method of the protocol."""
        self._sent += 1
        self._connection.send(json.dumps({"id": self._sent, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._connection.recv(timeout=PATIENCE))
            if answer.get("id") == self._sent:
                assert "error" not in answer, (method, answer["error"])
                result: dict[str, Any] = answer["result"]
                return result
            self._hear(answer)

    def _hear(self, event: dict[str, Any]) -> None:
        """Keep what an event says of an error."""
        match event:
            case {"method": "Runtime.exceptionThrown", "params": {"exceptionDetails": found}}:
                self.errors.append(str(found.get("exception", found).get("description", found)))
            case {"method": "Runtime.consoleAPICalled", "params": {"type": "error", "args": found}}:
                self.errors.append(" ".join(str(each.get("value", each.get("description"))) for each in found))
            case {"method": "Log.entryAdded", "params": {"entry": {"level": "error", "text": text, **more}}}:
                self.errors.append(f"{text} {more.get('url', '')}")

    def value(self, expression: str) -> Any:
        """What a JavaScript expression is."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, expression: str) -> Any:
        """What a JavaScript expression is, once that is true."""
        return until(lambda: self.value(expression), expression)

    def click(self, x: float, y: float) -> None:
        """Press and release the left button there, CSS pixels."""
        self.drag([(x, y)])

    def drag(self, way: list[tuple[float, float]], *, shift: bool = False) -> None:
        """Press the left button at the first place and release it at the last, each once the page has drawn itself.

        What is new in a scene can be hit only when it was drawn, and a loaded machine takes a second for that.
        """
        self._shift = shift
        self.hold(way)
        self.release(way[-1])

    def hold(self, way: list[tuple[float, float]]) -> None:
        """Press the left button at the first place, as `drag` does, and keep it pressed at the last."""
        self._mouse("mouseMoved", *way[0])
        self._drawn()
        self._mouse("mousePressed", *way[0])
        for place in way[1:]:
            self._drawn()
            self._mouse("mouseMoved", *place)
        self._drawn()

    def move(self, place: tuple[float, float]) -> None:
        """Move the mouse."""
        self._mouse("mouseMoved", *place)

    def can_be_dragged(self, place: tuple[float, float]) -> bool:
        """True if the mouse, which moves there with Shift down, lies on something that viser says can be dragged."""
        self.call("Input.dispatchMouseEvent", type="mouseMoved", x=place[0], y=place[1], buttons=0, modifiers=8)
        self._drawn()
        cursors = "[...document.querySelectorAll('canvas')].map(each => each.style.cursor)"
        return "pointer" in self.value(cursors)

    def release(self, place: tuple[float, float]) -> None:
        """Release the left button, and Shift if it is down."""
        self._mouse("mouseReleased", *place)
        self._shift = False

    def _drawn(self) -> None:
        """Wait until the page has drawn what it holds."""
        self.value("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")

    def _mouse(self, kind: str, x: float, y: float) -> None:
        self._held = kind == "mousePressed" or (self._held and kind == "mouseMoved")
        button = {"button": "left"} if self._held or kind == "mouseReleased" else {}
        clicks = {} if kind == "mouseMoved" else {"clickCount": 1}
        keys = {"modifiers": 8} if self._shift else {}
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, buttons=int(self._held), **button, **clicks, **keys)

    def type(self, text: str) -> None:
        """Type text where the focus is, in place of what is selected."""
        self.call("Input.insertText", text=text)

    def press(self, key: str, *, code: int, modifiers: int = 0) -> None:
        """Press and release a key, such as Enter, of a Windows key code; modifiers: 2 is Ctrl."""
        for kind in ("rawKeyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent",
                type=kind,
                key=key,
                code=key,
                windowsVirtualKeyCode=code,
                modifiers=modifiers,
            )

    def press_button(self, text: str) -> None:
        """Click the button that shows a text, with notes in brackets behind it or without."""
        shown = "each.innerText.trim().split(' (')[0]"
        found = f"[...document.querySelectorAll('button')].find(each => {shown} === {text!r})"
        self.press_element(found)

    def press_text(self, text: str) -> None:
        """Click the innermost element that shows a text, whatever it is."""
        shown = f"[...document.querySelectorAll('*')].filter(each => each.innerText?.trim() === {text!r})"
        self.press_element(f"{shown}.at(-1)")

    def press_element(self, element: str) -> None:
        """Click the element that a JavaScript expression gives."""
        self.click(*self._middle(element))

    def point_at(self, element: str) -> None:
        """Move the mouse over the element that a JavaScript expression gives."""
        self._mouse("mouseMoved", *self._middle(element))

    def fill(self, label: str, text: str) -> None:
        """Type into the field that has a label, in place of what it holds, and press Enter."""
        field = self.press_field(label)
        self.value(f"{field}.select()")
        self.type(text)
        self.press("Enter", code=13)

    def press_field(self, label: str) -> str:
        """Click the field that has a label, and return the JavaScript expression for it."""
        of_label = f"[...document.querySelectorAll('label')].find(each => each.innerText.trim() === {label!r})"
        row = f"{of_label}?.parentElement.parentElement.parentElement"
        field = f"[...({row}?.querySelectorAll('input:not([type=hidden])') ?? [])].at(-1)"
        self.press_element(field)
        return field

    def _middle(self, element: str) -> list[float]:
        """Where the middle of an element is, once it is there and moves no more."""
        place = "(each => { each?.scrollIntoView({block: 'nearest'}); const box = each?.getBoundingClientRect();"
        place += f" return box && [box.x + box.width / 2, box.y + box.height / 2]; }})({element})"
        found, before = self.wait(place), None
        while found != before:  # panels grow and lists open for a while
            time.sleep(_STEADY)
            self._drawn()
            found, before = self.wait(place), found  # a panel that is shown anew has it no more for a moment
        assert isinstance(found, list)
        return found

    def screenshot(self, path: Path) -> None:
        """Write what the page shows, a .png."""
        path.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))


def until(look: Callable[[], Any], what: str) -> Any:
    """What a function returns, once that is true."""
    end = time.monotonic() + PATIENCE
    while not (found := look()):
        assert time.monotonic() < end, f"never: {what}"
        time.sleep(0.05)
    return found


class _Quiet(SimpleHTTPRequestHandler):
    """Serves a folder without a word."""

    def log_message(self, *_: object) -> None:
        """Nothing."""


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """A web server's address whose pages are the files of a folder, behind links too."""
    handler = partial(_Quiet, directory=str(folder))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@contextmanager
def browsing(folder: Path, address: str, size: tuple[int, int] = (1280, 800), *, drawn: bool = True) -> Iterator[Page]:
    """A page at an address. Skips the test where there is no Chromium; fails it where `CI` is set.

    Args:
        folder: For what the browser keeps.
        address: Of the page.
        size: CSS pixels.
        drawn: False if nobody looks at the pixels of a 3D scene. The page poses its scene and finds what the mouse is
            over all the same.
    """
    program = next((found for name in _NAMES if (found := shutil.which(name))), None)
    if program is None:
        give_up(f"none of {', '.join(_NAMES)} is installed: no browser to try the page in")
    from websockets.sync.client import connect

    profile = folder / "profile"
    command = [program, *_OPTIONS, f"--window-size={size[0]},{size[1]}", f"--user-data-dir={profile}", "about:blank"]
    browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        port = until(lambda: _port(profile), "the browser's port")
        listed = until(lambda: _pages(port), "the browser's page")
        with connect(listed[0]["webSocketDebuggerUrl"], max_size=None, open_timeout=PATIENCE) as connection:
            page = Page(connection)
            page.call(
                "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False
            )
            for domain in ("Page", "Runtime", "Log"):  # else it evaluates no such script, and tells of no error
                page.call(f"{domain}.enable")
            for script in (_SELDOM,) if drawn else (_SELDOM, _UNDRAWN):
                page.call("Page.addScriptToEvaluateOnNewDocument", source=script)
            page.call("Page.navigate", url=address)
            yield page
    finally:
        browser.terminate()
        browser.wait()


def _port(profile: Path) -> str:
    file = profile / "DevToolsActivePort"
    lines = file.read_text().splitlines() if file.is_file() else []
    return lines[0] if len(lines) == 2 else ""


def _pages(port: str) -> list[dict[str, str]]:
    from urllib.request import urlopen

    with urlopen(f"http://127.0.0.1:{port}/json/list", timeout=PATIENCE) as answer:
        return [each for each in json.load(answer) if each["type"] == "page"]
