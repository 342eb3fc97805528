"""Where the page is served: at one address and port, or not at all; to nobody else than who asks there."""

import contextlib
import ipaddress
import logging
import re
import socket
from dataclasses import dataclass
from functools import partial

import rich
import viser
import websockets.asyncio.server

from wrinklecli.errors import WrinkleError


@dataclass(frozen=True, slots=True)
class Address:
    """Where the page is served.

    Attributes:
        host: The address that is listened on.
        port: 0 for any that is free.
    """

    host: str = "127.0.0.1"
    port: int = 0


def serve(place: Address) -> viser.ViserServer:
    """Serve an empty page.

    Raises:
        WrinkleError: The port is taken, or the host is no address of this machine.
    """
    # The server would take the next port that is free, and say so where only data belongs.
    port = _free_port(place.host, place.port)
    rich.reconfigure(quiet=True)
    # Any other page that the browser shows could connect, too, and edit; its own is known by its origin.
    usual = websockets.asyncio.server.serve
    websockets.asyncio.server.serve = partial(usual, origins=[None, _own_origin(place.host, port)])  # type: ignore
    try:
        server = viser.ViserServer(host=place.host, port=port, verbose=False)
    finally:
        websockets.asyncio.server.serve = usual  # type: ignore[misc]
    if server.get_port() != port:
        server.stop()
        raise WrinkleError(f"port {port} was taken just now", where="edit")
    # What a damaged or hostile message raises ends at most the tab that sent it; nobody reads its traceback.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL + 1)
    loop = server.get_event_loop()
    loop.call_soon_threadsafe(loop.set_exception_handler, lambda _loop, _context: None)
    # Any page that a tab shows could ask for a tunnel through which the whole internet would reach this one.
    server.request_share_url = _refuse  # type: ignore[method-assign]
    return server


def _own_origin(host: str, port: int) -> re.Pattern[str]:
    """The origins of the page: where all addresses are listened on, of any host, at this port."""
    hosts = {"127.0.0.1", "localhost", "[::1]", host, f"[{host}]"}
    named = "|".join(map(re.escape, sorted(hosts))) if is_own(host) else r"[^/:]+|\[[^/]*\]"
    return re.compile(rf"http://(?:{named}):{port}")


def is_own(host: str) -> bool:
    """Whether no other machine reaches an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _refuse(verbose: bool = True) -> None:
    """No tunnel."""


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
