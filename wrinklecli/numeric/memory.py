"""Limits the memory of a command: large arrays are claimed before they are made, and the system limits the process."""

import math
import os
import re
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import TypeVar

from wrinklecli.errors import TooMuchError

# Bytes that a job of a batch may take, or of a server: a real-time character takes a tenth, and eight fit a machine.
MAX_MEMORY = 10**9
# Bytes on a GPU for the wrinkles of a character, unless an option allows more: half of a texture of 2,048 by 2,048.
GPU_BUDGET = 8 * 10**6
# Most new vertices of a mesh unless an option allows more: ten times a real-time character.
MAX_VERTICES = 200_000
# Bytes that Python, numpy and its threads take before any work is done, rounded up.
_ITSELF = 2**27
# Bytes of CPython's objects by the mark that each needs in the text: a value with its slot in a list, a key with its
# slot in a dict, an empty dict, an empty list.
_MARK_BYTES = {b",": 64, b":": 104, b"{": 136, b"[": 56}
# Bytes of the largest block from whose size glibc learns, 32 MiB, less what it stores with one, rounded up.
_LARGEST_KEPT = 2**25 - 2**16
# Bytes that OpenBLAS takes for its buffer, 32 MiB, rounded up.
_BLAS = 40 * 10**6
_UNITS = ("KB", "MB", "GB", "TB")
_LEAST_MEMORY = 50 * 10**6  # bytes; with less no sample is baked

# What the loader of Linux says of a library for which there is too little memory.
_UNLOADED = re.compile("cannot map|failed to map|annot allocate")
Key = TypeVar("Key", bound=Hashable)
Result = TypeVar("Result")
_held: list[int] = []  # the sizes to which `held` holds this process, the innermost last


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


def once(known: dict[Key, Result], key: Key, make: Callable[[], Result], most: float = math.inf) -> Result:
    """The result of a key, made if it is not known; all are forgotten before there would be more than so many."""
    if key not in known:
        if len(known) >= most:
            known.clear()
        known[key] = make()
    return known[key]


def json_memory(data: bytes) -> int:
    """Most bytes that the values of a JSON text take, counted by the marks between them."""
    return len(data) + sum(size * data.count(mark) for mark, size in _MARK_BYTES.items())


@contextmanager
def held(size: int) -> Iterator[None]:
    """Raise MemoryError when this process, with all threads, takes so many bytes more, if the system can limit it.

    Arrays are refused before they are filled, so no step needs to say its size by itself; `Memory` is for work that
    would take long before it asks for them.
    """
    taken = _taken()
    if taken is None:
        yield
        return
    import resource

    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = taken + size + _ITSELF
    if soft != resource.RLIM_INFINITY:
        most = min(most, soft)
    resource.setrlimit(resource.RLIMIT_DATA, (most, hard))
    _held.append(size)
    try:
        yield
    finally:
        _held.pop()
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def allowed_memory() -> int | None:
    """Bytes to which `held` holds this process; None if it does not."""
    return min(_held, default=None)


def share(count: int) -> None:
    """Leave this process one of so many equal shares of what `held` leaves it, as several take the rest."""
    try:
        import resource
    except ImportError:  # not a Unix
        return
    taken, (most, hard) = _taken(), resource.getrlimit(resource.RLIMIT_DATA)
    if taken is not None and most != resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_DATA, (taken + max(most - taken, 0) // count, hard))


def _taken() -> int | None:
    """Bytes of data that this process takes; None where the system does not say."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[5]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:  # not a Linux
        return None


def is_lack(error: BaseException) -> bool:
    """True if an error says that memory is lacking; a library that cannot be loaded without it is an ImportError."""
    return isinstance(error, MemoryError) or (isinstance(error, ImportError) and bool(_UNLOADED.search(str(error))))


def leave_room(size: int) -> None:
    """Raise MemoryError if so many bytes cannot be had, for libraries that do worse without them."""
    import numpy as np

    np.empty(size, np.uint8)


@cache
def keep_freed() -> None:
    """Let glibc keep the memory of arrays that are gone, for the next ones, as new pages take a tenth of a bake.

    By itself it gives back what exceeds twice the largest block that was ever freed, up to 32 MiB. So one is freed
    here, of which no byte was used.
    """
    with suppress(MemoryError):
        leave_room(_LARGEST_KEPT)


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


def available_memory(root: str = "/") -> int | None:
    """Bytes that are free for new work, of the machine and of the control groups that hold this process.

    None where the system does not say. `root` is where its files are.
    """
    found = [_number_in(os.path.join(root, "proc/meminfo"), "MemAvailable:", 1024)]
    if found == [None]:
        found = [physical_memory()]
    for line in _lines_of(os.path.join(root, "proc/self/cgroup")):
        _, kinds, path = line.split(":", 2)
        if kinds not in ("", "memory"):
            continue
        base, most, taken, cached = _GROUP_FILES[kinds]
        base = os.path.join(root, base)
        folder = os.path.normpath(base + path)
        while folder.startswith(base):
            files = [_number_in(os.path.join(folder, name), key) for name, key in (most, taken, cached)]
            if files[0] is not None:
                # The system gives back what it keeps of files when a group needs it.
                found.append(max(files[0] - (files[1] or 0) + (files[2] or 0), 0))
            folder = os.path.dirname(folder)
    return min((each for each in found if each is not None), default=None)


# By the kind of a control group its folder, then the files and keys of its limit, of what it takes, and of files kept.
_GROUP_FILES = {
    "": ("sys/fs/cgroup", ("memory.max", ""), ("memory.current", ""), ("memory.stat", "inactive_file")),
    "memory": (
        "sys/fs/cgroup/memory",
        ("memory.limit_in_bytes", ""),
        ("memory.usage_in_bytes", ""),
        ("memory.stat", "total_inactive_file"),
    ),
}


def _lines_of(path: str) -> list[str]:
    """The lines of a file of the system; none if it is not there."""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return []


def _number_in(path: str, key: str, unit: int = 1) -> int | None:
    """The number behind a key at the start of a line, times a unit; None if it is not there, or `max`."""
    for line in _lines_of(path):
        if line.startswith(key) and (words := line.removeprefix(key).split()) and words[0].isdecimal():
            return int(words[0]) * unit
    return None


def default_memory() -> int:
    """Bytes that a command of a person may take: half of what is free at its start, and at least 1 GB."""
    return max(MAX_MEMORY, (available_memory() or 0) // 2)


def parse_bytes(text: str, least: int = _LEAST_MEMORY) -> int:
    """Bytes from `500MB` or `4GB`, decimal units; ValueError if the text is no size, or too small, as for any bake."""
    found = re.fullmatch(r"(\d{1,6}(?:\.\d{1,3})?) ?(kB|MB|GB|TB)", text, re.IGNORECASE)
    size = int(float(found[1]) * 1000 ** (1 + _UNITS.index(found[2].upper()))) if found else 0
    if size < least:
        raise ValueError(f"{text!r} is no size from {shown_bytes(least)} up, such as 500MB or 4GB")
    return size


def shown_bytes(size: float) -> str:
    """Bytes for people, decimal units."""
    for unit in ("B", "kB", "MB"):
        if size < 999.5:
            return f"{size:.3g} {unit}"
        size /= 1000
    return f"{size:,.3g} GB"
