"""Limits the memory of a command: large arrays are claimed before they are made, and the system limits the process."""

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager

from wrinklecli.errors import TooMuchError

# Bytes. A real-time character takes a tenth of this, and eight bakes at once fit a common machine.
MAX_MEMORY = 10**9
# Most new vertices of a mesh unless an option allows more: ten times a real-time character.
MAX_VERTICES = 200_000
# Bytes that Python, numpy and its threads take before any work is done, rounded up.
_ITSELF = 2**27
# Bytes of CPython's objects by the mark that each needs in the text: a value with its slot in a list, a key with its
# slot in a dict, an empty dict, an empty list.
_MARK_BYTES = {b",": 64, b":": 104, b"{": 136, b"[": 56}
# Bytes that OpenBLAS takes for its buffer, 32 MiB, rounded up.
_BLAS = 40 * 10**6
_UNITS = {"MB": 10**6, "GB": 10**9, "TB": 10**12}
_LEAST_MEMORY = 50 * 10**6  # bytes; with less no sample is baked


class Memory:
    """The bytes that a command may take, claimed before large arrays are made: no small file can fill memory."""

    def __init__(self, most: int = MAX_MEMORY) -> None:
        self.most = most
        self.claimed = 0

    @property
    def left(self) -> int:
        """Bytes that may still be claimed."""
        return max(self.most - self.claimed, 0)

    def claim(self, size: int, what: str, *, where: str) -> None:
        """Reserve bytes for the rest of the command; `what` names their use, in the plural, for the message.

        Raises:
            TooMuchError: More bytes than are left.
        """
        self.check(size, what, where=where)
        self.claimed += size

    def check(self, size: int, what: str, *, where: str) -> None:
        """Raise what `claim` raises, without a reservation: the bytes are soon given back."""
        if size > self.left:
            before = f", with {shown_bytes(self.claimed)} before them," if self.claimed else ""
            raise TooMuchError(
                f"{what} would take {shown_bytes(size)}{before} and at most {shown_bytes(self.most)} may be taken:"
                " raise --max-memory",
                where=where,
            )


def json_memory(data: bytes) -> int:
    """Most bytes that the values of a JSON text take, counted by the marks between them."""
    return len(data) + sum(size * data.count(mark) for mark, size in _MARK_BYTES.items())


@contextmanager
def held(size: int) -> Iterator[None]:
    """Raise MemoryError when this process, with all threads, takes so many bytes more, if the system can limit it.

    This serves where memory cannot be estimated before it is taken.
    """
    try:
        import resource

        with open("/proc/self/statm") as file:
            taken = int(file.read().split()[5]) * resource.getpagesize()
    except (ImportError, OSError):  # not a Linux
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


def leave_room(size: int) -> None:
    """Raise MemoryError if so many bytes cannot be had, for libraries that do worse without them."""
    import numpy as np

    np.empty(size, np.uint8)


def start_blas() -> None:
    """Let the BLAS of SciPy take its buffer, as it does when it first computes.

    Without room for the buffer, OpenBLAS asks for it again and again, for ever.

    Raises:
        MemoryError: There is too little room.
    """
    import numpy as np
    from scipy.linalg.blas import dtrsv

    leave_room(_BLAS)
    dtrsv(np.eye(2), np.ones(2))


def physical_memory() -> int | None:
    """Bytes of memory that the machine has; None where the system does not say."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):  # Windows has no sysconf
        return None


def parse_bytes(text: str) -> int:
    """Bytes from `500MB` or `4GB`, decimal units; ValueError if the text is no size, or too small for any bake."""
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
