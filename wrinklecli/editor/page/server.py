"""Serve the page at one address and port, only to those who may connect, and only with messages that tabs send."""

import contextlib
import logging
import socket
from collections.abc import Mapping
from typing import Any

import rich
import viser
import websockets.asyncio.server

from wrinklecli.editor.page.access import Access, Answer
from wrinklecli.editor.page.messages import MAX_BYTES, connection_of
from wrinklecli.errors import WrinkleError


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
    served: list[viser.ViserServer] = []

    def controls() -> Mapping[str, Any]:
        return served[0].gui._gui_input_handle_from_uuid if served else {}

    def checked_serve(*arguments: Any, process_request: Answer, **options: Any) -> Any:
        options |= {"max_size": MAX_BYTES, "create_connection": connection_of(controls)}
        return usual(*arguments, process_request=access.checked(process_request, port), **options)

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
    server.request_share_url = _refuse_tunnel  # type: ignore[method-assign]
    return server


def _refuse_tunnel(verbose: bool = True) -> None:
    """Open no tunnel."""


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
