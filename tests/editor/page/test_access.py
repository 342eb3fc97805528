"""Only those connect who ask for the page by its own name, from the page itself, and with its token."""

import contextlib
import http.client
import logging
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
import viser
from click.testing import CliRunner
from websockets.exceptions import InvalidHandshake
from websockets.sync.client import connect

from kit.limb import limb
from kit.work import PATIENCE
from wrinklecli.cli.edit import edit
from wrinklecli.editor.page.access import Access
from wrinklecli.editor.page.page import Page
from wrinklecli.editor.session import Session


@pytest.fixture(scope="module")
def asset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return limb(tmp_path_factory.mktemp("page") / "limb.glb", rings=6, sides=6)


@pytest.fixture(scope="module")
def own(asset: Path) -> Iterator[Page]:
    """A page for this machine, which other users reach too."""
    page = Page(Session(asset), Access.to("127.0.0.1", ["Studio.example"]))
    yield page
    page.close()


@pytest.fixture(scope="module")
def shared(asset: Path) -> Iterator[Page]:
    """A page for all who reach this machine."""
    page = Page(Session(asset), Access.to("0.0.0.0"))
    yield page
    page.close()


def cookie_of(page: Page) -> str:
    """The cookie that a browser has after it has opened the printed address."""
    return f"wrinkle_edit_{page.port}={page.address.rpartition('=')[2]}"


def got(page: Page, path: str = "/", **headers: str | list[str] | None) -> tuple[int, http.client.HTTPMessage, bytes]:
    """The status, headers and text that the page answers; its port takes the place of `PORT`."""
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", page.port, timeout=PATIENCE)) as connection:
        connection.putrequest("GET", path, skip_host=True)
        for name, values in ({"Host": "127.0.0.1:PORT"} | headers).items():
            for value in [values] if isinstance(values, str) else values or ():
                connection.putheader(name, value.replace("PORT", str(page.port)))
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()


def opens(page: Page, path: str = "", **headers: str) -> bool:
    """True if a websocket is opened. Its `Host` is that of the address."""
    headers = {name: value.replace("PORT", str(page.port)) for name, value in headers.items()}
    host = headers.pop("Host", f"127.0.0.1:{page.port}")
    with (
        contextlib.suppress(InvalidHandshake),
        socket.create_connection(("127.0.0.1", page.port)) as stream,
        connect(
            f"ws://{host}/{path}",
            sock=stream,
            subprotocols=[f"viser-v{viser.__version__}"],  # type: ignore[list-item]
            additional_headers=headers,
            max_size=None,
            open_timeout=PATIENCE,
        ) as tab,
    ):
        return len(tab.recv(timeout=PATIENCE)) > 1000
    return False


NAMES = {
    "127.0.0.1:PORT": True,
    "localhost:PORT": True,
    "LocalHost:PORT": True,
    "[::1]:PORT": True,
    "192.168.1.7:9000": True,  # an address is nobody's name, and a tunnel has another port
    "[2001:db8::1]": True,
    "studio.example": True,
    "STUDIO.EXAMPLE:PORT": True,
    "evil.example:PORT": False,
    "evil.example": False,
    "studio.example.evil.example": False,
    "127.0.0.1.evil.example:PORT": False,
    "127.0.0.1:PORT@evil.example": False,
    "evil.example/127.0.0.1": False,
    "127.0.0.1:PORT, evil.example": False,
    "[::1": False,
    "[evil]": False,
    "localhost:x": False,
    "": False,
}


@pytest.mark.parametrize("host", NAMES)
def test_the_page_is_asked_for_by_an_address_or_a_known_name(own: Page, host: str) -> None:
    status, headers, _ = got(own, Host=host, Cookie=cookie_of(own))
    assert status == (200 if NAMES[host] else 403)
    assert NAMES[host] == (headers["Content-Security-Policy"] == "frame-ancestors 'none'")


def test_a_request_names_one_host(own: Page) -> None:
    assert got(own, Host=None, Cookie=cookie_of(own))[0] == 403
    assert got(own, Host=["127.0.0.1:PORT", "evil.example"], Cookie=cookie_of(own))[0] == 403


ORIGINS = {
    ("127.0.0.1:PORT", "http://127.0.0.1:PORT"): True,
    ("localhost:PORT", "http://localhost:PORT"): True,
    ("studio.example", "http://studio.example"): True,
    ("studio.example", "http://Studio.Example:80"): True,
    ("studio.example:80", "http://studio.example"): True,
    ("studio.example", "https://studio.example"): True,  # behind a proxy
    ("studio.example:443", "https://studio.example"): True,
    ("studio.example:8443", "https://studio.example"): False,
    ("127.0.0.1:PORT", "http://localhost:PORT"): False,
    ("127.0.0.1:PORT", "http://127.0.0.1:9000"): False,
    ("127.0.0.1:PORT", "http://127.0.0.1"): False,
    ("127.0.0.1:PORT", "http://evil.example:PORT"): False,
    ("evil.example:PORT", "http://evil.example:PORT"): False,  # whose owner lets it point here
    ("127.0.0.1:PORT", "null"): False,
    ("127.0.0.1:PORT", "file://"): False,
    ("127.0.0.1:PORT", "http://127.0.0.1:PORT.evil.example"): False,
    ("127.0.0.1:PORT", "http://127.0.0.1:PORT@evil.example"): False,
}


@pytest.mark.quick(4)
@pytest.mark.parametrize(("host", "origin"), ORIGINS)
def test_no_other_site_is_let_in(own: Page, host: str, origin: str) -> None:
    assert got(own, Host=host, Origin=origin, Cookie=cookie_of(own))[0] == (200 if ORIGINS[host, origin] else 403)
    assert opens(own, Host=host, Origin=origin, Cookie=cookie_of(own)) == ORIGINS[host, origin]


def test_the_page_shows_no_other_server(own: Page) -> None:
    for query in ("?websocket=ws://evil.example", "?playbackPath=http://evil.example/a.viser", "?websocket"):
        assert got(own, f"/{query}", Cookie=cookie_of(own))[0] == 403
    assert opens(own, Cookie=cookie_of(own))


@pytest.mark.quick(1)
@pytest.mark.parametrize("host", ["127.0.0.1", "0.0.0.0"])
def test_all_need_the_token_of_the_address(
    request: pytest.FixtureRequest, caplog: pytest.LogCaptureFixture, host: str
) -> None:
    """Other users of this machine too, who reach its ports."""
    shared: Page = request.getfixturevalue("own" if host == "127.0.0.1" else "shared")
    caplog.set_level(logging.DEBUG)
    start, _, token = shared.address.partition("/?token=")
    assert start == f"http://{host}:{shared.port}"
    assert len(token) >= 32
    for path in (
        "/",
        "/?token=",
        "/?token=wrong",
        f"/?token={token[:-1]}",
        f"/?token={token}&websocket=ws://a",
        "/%ff",
    ):
        assert got(shared, path)[0] == 403
        assert not opens(shared, path[1:])
    status, headers, page = got(shared, f"/?token={token}")
    assert status == 200
    assert b"<html" in page
    assert headers["Referrer-Policy"] == "no-referrer"
    cookie, *attributes = headers["Set-Cookie"].split("; ")
    assert {"HttpOnly", "SameSite=Strict"} < set(attributes)
    assert opens(shared, Cookie=f"other=1; {cookie}", Origin="http://127.0.0.1:PORT")
    assert opens(shared, f"?token={token}")
    assert got(shared, Cookie=cookie)[0] == 200
    assert not opens(shared, Cookie=cookie, Origin="http://evil.example:PORT")
    assert not opens(shared, Cookie=f"{cookie.partition('=')[0]}=x\xff")
    assert token not in "".join(each.getMessage() for each in caplog.records if each.name != "websockets.client")


def test_each_page_has_another_token() -> None:
    tokens = [Access.to(host).token for host in ("0.0.0.0", "0.0.0.0", "::", "127.0.0.1", "localhost", "localhost")]
    assert len(set(tokens)) == 6
    assert Access("::1", (), "abc").address(80) == "http://[::1]:80/?token=abc"


PATHS = [
    "/../../etc/passwd",
    "/%2e%2e/%2e%2e/etc/passwd",
    "//etc/passwd",
    "/limb.glb",
    "/../server.py",
    "/assets/../..",
]


@pytest.mark.parametrize("path", PATHS)
def test_the_page_serves_its_own_files_alone(own: Page, path: str) -> None:
    """To one who may open it."""
    status, _, data = got(own, path, Cookie=cookie_of(own))
    assert status in (403, 404) or b"<html" in data
    assert not any(each in data for each in (b"root:", b"glTF", b"import "))


@pytest.mark.parametrize("name", ["", "http://studio.example", "studio.example:80", "*", "a b"])
def test_a_name_is_said_without_scheme_and_port(name: str) -> None:
    for option in ("--allow-host", *(["--host"] if not name else [])):
        result = CliRunner().invoke(edit, ["none.glb", option, name])
        assert result.exit_code == 2
        assert "expected" in result.output or "is not a name such as studio.example" in result.output
