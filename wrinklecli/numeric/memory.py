"""How much memory a command may take: claimed before it is taken, or held by the system where nobody could claim."""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from wrinklecli.errors import TooMuchError

# Bytes. Ten times what a real-time character takes, and little enough for eight bakes at once on a common machine.
MAX_MEMORY = 10**9
# New vertices of a mesh at most, unless an option allows more: ten times a real-time character.
MAX_VERTICES = 200_000
# Bytes that Python, numpy and its threads have taken before any work is done, and a little more.
_ITSELF = 2**27
_UNITS = {"MB": 10**6, "GB": 10**9, "TB": 10**12}
_LEAST_MEMORY = 50 * 10**6  # bytes; with less no sample is baked


class Memory:
    """The memory of a command: what is large is claimed here before it is taken, so that a small file cannot fill it.

    Args:
        most: Bytes, of all claims together.
    """

    def __init__(self, most: int = MAX_MEMORY) -> None:
        self.most = most
        self.claimed = 0

    @property
    def left(self) -> int:
        """Bytes that may still be claimed."""
        return max(self.most - self.claimed, 0)

    def claim(self, size: int, what: str, *, where: str) -> None:
        """Set bytes aside for the rest of the command.

        Args:
            size: Bytes.
            what: That takes them, in the plural, for the message.
            where: Its place.

        Raises:
            TooMuchError: They are more than are left.
        """
        self.check(size, what, where=where)
        self.claimed += size

    def check(self, size: int, what: str, *, where: str) -> None:
        """As `claim`, for what is soon given back."""
        if size > self.left:
            before = f", with {shown_bytes(self.claimed)} before them," if self.claimed else ""
            raise TooMuchError(
                f"{what} would take {shown_bytes(size)}{before} and at most {shown_bytes(self.most)} may be taken:"
                " raise --max-memory",
                where=where,
            )


@contextmanager
def held(size: int) -> Iterator[None]:
    """Let this process take so many bytes more at most, where the system can hold it to that; else MemoryError.

    For what cannot be estimated. It holds all threads.
    """
    try:
        import resource

        with open("/proc/self/statm") as file:
            taken = int(file.read().split()[5]) * resource.getpagesize()
    except (ImportError, OSError):  # neither Linux nor like it
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = taken + size + _ITSELF
    if soft != resource.RLIM_INFINITY:
        most = min(most, soft)
    resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def parse_bytes(text: str) -> int:
    """Bytes from `500MB` or `4GB`, decimal units.

    Raises:
        ValueError: It is no such size, or too little for any bake.
    """
    found = re.fullmatch(r"(\d{1,6}(?:\.\d{1,3})?) ?(MB|GB|TB)", text, re.IGNORECASE)
    size = int(float(found[1]) * _UNITS[found[2].upper()]) if found else 0
    if size < _LEAST_MEMORY:
        raise ValueError(f"{text!r} is no size from {shown_bytes(_LEAST_MEMORY)} up, such as 500MB or 4GB")
    return size


def shown_bytes(size: float) -> str:
    """Bytes for people, decimal units."""
    for unit in ("B", "kB", "MB"):
        if size < 999.5:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:,.3g} GB"
