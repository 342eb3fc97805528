"""Where the page is served: at one address and port, or not at all; to nobody else than who asks there."""

import contextlib
import logging
import socket
from dataclasses import dataclass

import rich
import viser

from wrinklecli.errors import WrinkleError


@dataclass(frozen=True, slots=True)
class Place:
    """Where the page is served.

    Attributes:
        host: The address that is listened on.
        port: 0 for any that is free.
    """

    host: str = "127.0.0.1"
    port: int = 0


def serve(place: Place) -> viser.ViserServer:
    """Serve an empty page.

    Raises:
        WrinkleError: The port is taken, or the host is no address of this machine.
    """
    # The server would take the next port that is free, and say so where only data belongs.
    port = _free_port(place.host, place.port)
    rich.reconfigure(quiet=True)
    server = viser.ViserServer(host=place.host, port=port, verbose=False)
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
