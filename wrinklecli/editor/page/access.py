"""Decides who may connect to the page: whoever asks for it by a known name, and has its token.

Any site that a browser shows may connect to the ports of this machine, and its owner may let a name point here. So a
request has to name the page by an address or by a known name, and its site has to be the page itself. All users of this
machine reach its ports too, so a page that no other machine reaches has a token as well. It stands in the printed
address, as in Jupyter; a cookie keeps it for the files that the page loads and for its websocket.
"""

import ipaddress
import re
import secrets
from collections.abc import Mapping, Sequence
from urllib.parse import parse_qsl

from wrinklecli.frozen import dataclass

_TOKEN_BYTES = 24  # random ones, which nobody guesses
_HOST = re.compile(r"(\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::([0-9]{1,5}))?")
_ORIGIN = re.compile(rf"(https?)://({_HOST.pattern})")
_DEFAULT_PORTS = {"http": 80, "https": 443}
_HEADERS = {
    "Content-Security-Policy": "frame-ancestors 'none'",  # no other site shows the page under its own buttons
    "Referrer-Policy": "no-referrer",  # the token stays here
}


@dataclass(frozen=True, slots=True)
class Access:
    """The rules for connecting to a page that listens at a host.

    Attributes:
        host: The host.
        names: Names by which the page may be asked for, beside the host, `localhost` and addresses.
        token: The secret of the printed address.
    """

    host: str
    names: tuple[str, ...]
    token: str

    @classmethod
    def to(cls, host: str, names: Sequence[str] = ()) -> "Access":
        """Make the rules for a host and further names, with a new token."""
        return cls(host, tuple(names), secrets.token_urlsafe(_TOKEN_BYTES))

    def address(self, port: int) -> str:
        """The address of the page at a port."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{port}/?token={self.token}"

    def headers(self, port: int) -> Mapping[str, str]:
        """The headers of all answers at a port, by name."""
        return {**_HEADERS, "Set-Cookie": f"{_cookie(port)}={self.token}; Path=/; HttpOnly; SameSite=Strict"}

    def refusal(
        self, path: str, hosts: Sequence[str], origins: Sequence[str], cookies: Sequence[str], port: int
    ) -> str | None:
        """The reason to refuse a request; None if there is none.

        Args:
            path: The path that is asked for, with its query.
            hosts: The `Host` headers.
            origins: The `Origin` headers.
            cookies: The `Cookie` headers.
            port: The port of the page.
        """
        host = _HOST.fullmatch(hosts[0]) if len(hosts) == 1 else None
        names = {"localhost", *map(str.lower, (self.host, *self.names))}
        if host is None or not (_is_address(host[1].strip("[]")) or host[1].lower() in names):
            return "this page has another name; --allow-host NAME lets it be asked for by NAME"
        if origins and (len(origins) > 1 or not _is_same(origins[0], host)):
            return "another site asks for this page"
        query = parse_qsl(path.partition("?")[2], keep_blank_values=True)
        # The page would take others, even one that lets it show what another server sends.
        if any(key != "token" for key, _ in query):
            return "the page's address has no other options than token"
        pairs = (pair.strip().partition("=") for each in cookies for pair in each.split(";"))
        found = [*(value for _, value in query), *(value for name, _, value in pairs if name == _cookie(port))]
        token = self.token.encode()
        if not any(secrets.compare_digest(each.encode(errors="surrogateescape"), token) for each in found):
            return "this page opens at the whole address that the command has printed, with its token"
        return None


def is_own(host: str) -> bool:
    """True if no other machine reaches a host."""
    return ipaddress.ip_address(host).is_loopback if _is_address(host) else host == "localhost"


def _cookie(port: int) -> str:
    """Name of the cookie, which all pages of a host share."""
    return f"wrinkle_edit_{port}"


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return False
    return True


def _is_same(origin: str, host: re.Match[str]) -> bool:
    """True if an `Origin` is that of the site which a `Host` header names."""
    site = _ORIGIN.fullmatch(origin)
    if site is None:
        return False
    scheme, _, name, port = site.groups()
    default = _DEFAULT_PORTS[scheme]
    return (name.lower(), int(port or default)) == (host[1].lower(), int(host[2] or default))
