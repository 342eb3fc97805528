"""Serve the page at one address and port, only to those who may connect, and only with messages that tabs send."""

import contextlib
import gc
import http
import logging
import socket
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import rich
import viser
import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from wrinklecli.editor.page.access import Access
from wrinklecli.editor.page.messages import MAX_BYTES, is_sent
from wrinklecli.errors import WrinkleError
from wrinklecli.numeric.memory import leave_room

# Bytes of the messages that a tab gets first, rounded up: a mesh of 100,000 vertices, packed and sent.
_TAB = 10**7
_Answer: TypeAlias = Callable[[ServerConnection, Request], Response | None]
"""Answers a request, or returns None to open a websocket."""


def serve(access: Access, port: int) -> viser.ViserServer:
    """Serve an empty page; port 0 stands for any free port.

    Raises:
        WrinkleError: The port is taken, or the host is no address of this machine.
    """
    # Left alone, viser would take the next free port, and print messages to stdout, which is for data.
    port = _free_port(access.host, port)
    rich.reconfigure(quiet=True)
    # A damaged or hostile message ends at most the tab that sent it; nobody reads its traceback, and no log the token.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL + 1)
    usual = websockets.asyncio.server.serve
    viser.infra.Message.as_serializable_dict = _sendable_dict  # type: ignore
    served: list[viser.ViserServer] = []
    waiting: set[ServerConnection] = set()  # tabs that have got nothing yet

    def controls() -> Mapping[str, Any]:
        return served[0].gui._gui_input_handle_from_uuid if served else {}

    class CheckedConnection(ServerConnection):
        async def recv(self, decode: bool | None = None) -> Any:
            while not is_sent(data := await super().recv(decode), controls()):
                pass
            return data

        async def send(self, *arguments: Any, **options: Any) -> None:
            await super().send(*arguments, **options)
            waiting.discard(self)

        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            waiting.discard(self)

    def checked_serve(*arguments: Any, process_request: _Answer, **options: Any) -> Any:
        options |= {"max_size": MAX_BYTES, "create_connection": CheckedConnection}
        return usual(*arguments, process_request=_checked(process_request, access, port, waiting), **options)

    websockets.asyncio.server.serve = checked_serve  # type: ignore
    try:
        server = viser.ViserServer(host=access.host, port=port, verbose=False)
    finally:
        websockets.asyncio.server.serve = usual  # type: ignore[misc]
    served.append(server)
    if server.get_port() != port:
        server.stop()
        raise WrinkleError(f"port {port} was taken just now", where="edit")
    loop = server.get_event_loop()
    loop.call_soon_threadsafe(loop.set_exception_handler, lambda _loop, _context: None)
    # A tab could ask for a tunnel that opens this page to the whole internet.
    server.request_share_url = lambda verbose=True: None  # type: ignore[method-assign]  # noqa: ARG005
    return server


def _checked(answer: _Answer, access: Access, port: int, waiting: set[ServerConnection]) -> _Answer:
    """Answer the requests to a port that `access` does not refuse, and note the tabs that wait for their messages."""

    def checked_answer(connection: ServerConnection, request: Request) -> Response | None:
        hosts, origins, cookies = (request.headers.get_all(name) for name in ("Host", "Origin", "Cookie"))
        refusal = access.refusal(request.path, hosts, origins, cookies, port)
        if refusal is not None:
            return connection.respond(http.HTTPStatus.FORBIDDEN, f"wrinkle edit: {refusal}\n")
        response = answer(connection, request)
        if response is not None:
            response.headers.update(access.headers(port))
            return response
        # Tabs that are gone leave what they were sent, up to a megabyte each, in cycles, which Python looks for rarely.
        gc.collect()
        try:
            leave_room(_TAB * (len(waiting) + 1))
        except MemoryError:
            reason = "no memory is left for one more tab; close others, or raise --max-memory"
            return connection.respond(http.HTTPStatus.SERVICE_UNAVAILABLE, f"wrinkle edit: {reason}\n")
        waiting.add(connection)
        return None

    return checked_answer


_usual_dict = viser.infra.Message.as_serializable_dict


def _sendable_dict(message: Any, *arguments: Any, **options: Any) -> Any:
    """A message as viser makes it, but for halves of characters in names, at which its packing would fail for good."""
    return _sendable(_usual_dict(message, *arguments, **options))


def _sendable(value: Any) -> Any:
    if isinstance(value, str):
        return value if value.isascii() else value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, dict):
        return {_sendable(key): _sendable(each) for key, each in value.items()}
    return type(value)(map(_sendable, value)) if type(value) in (list, tuple) else value


def _free_port(host: str, port: int) -> int:
    with contextlib.ExitStack() as stack:
        try:
            family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
            tried = stack.enter_context(socket.socket(family, kind, protocol))
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            tried.bind(address)
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            hint = "; take another by --port, or 0 for any that is free"
            raise WrinkleError(f"port {port} of {host}: {reason}{hint}", where="edit") from None
        found: int = tried.getsockname()[1]
        return found
