"""Serve the page at one address and port, and only to those who ask there."""

import contextlib
import ipaddress
import logging
import re
import socket
from functools import partial

import rich
import viser
import websockets.asyncio.server

from wrinklecli.errors import WrinkleError


def serve(host: str, port: int) -> viser.ViserServer:
    """Serve an empty page; port 0 stands for any free port.

    Raises:
        WrinkleError: The port is taken, or the host is no address of this machine.
    """
    # Left alone, viser would take the next free port, and print messages to stdout, which is for data.
    port = _free_port(host, port)
    rich.reconfigure(quiet=True)
    # Any other page in the browser could connect and edit; our page is known by its origin.
    usual = websockets.asyncio.server.serve
    origins = [None, _own_origin(host, port)]
    websockets.asyncio.server.serve = partial(usual, origins=origins)  # type: ignore
    try:
        server = viser.ViserServer(host=host, port=port, verbose=False)
    finally:
        websockets.asyncio.server.serve = usual  # type: ignore[misc]
    if server.get_port() != port:
        server.stop()
        raise WrinkleError(f"port {port} was taken just now", where="edit")
    # A damaged or hostile message ends at most the tab that sent it; nobody reads its traceback.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL + 1)
    loop = server.get_event_loop()
    loop.call_soon_threadsafe(loop.set_exception_handler, lambda _loop, _context: None)
    # A tab could ask for a tunnel that opens this page to the whole internet.
    server.request_share_url = _refuse_tunnel  # type: ignore[method-assign]
    return server


def _own_origin(host: str, port: int) -> re.Pattern[str]:
    """Match the origins of the page: any host at the port if the page listens on all addresses."""
    hosts = {"127.0.0.1", "localhost", "[::1]", host, f"[{host}]"}
    named = "|".join(map(re.escape, sorted(hosts))) if is_own(host) else r"[^/:]+|\[[^/]*\]"
    return re.compile(rf"http://(?:{named}):{port}")


def is_own(host: str) -> bool:
    """True if no other machine reaches an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


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
