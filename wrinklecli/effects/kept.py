"""Solutions that effects look up and keep by what they depend on, in a store that a caller gives."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol, TypeVar

Solution = TypeVar("Solution")


class Store(Protocol):
    """A place for solutions that other processes share. Nothing that it gives back is trusted."""

    def find(self, key: str, most: int) -> bytes | None:
        """The solution of a key, of at most so many bytes; None if there is none."""

    def keep(self, key: str, data: bytes) -> None:
        """Keep a solution."""

    def refuse(self, key: str, reason: str) -> None:
        """Say why what `find` gave is not used."""


_store: ContextVar[Store | None] = ContextVar("_store", default=None)


@contextmanager
def solutions_in(store: Store) -> Iterator[None]:
    """Look solutions up in a store, and keep new ones there."""
    token = _store.set(store)
    try:
        yield
    finally:
        _store.reset(token)


def stored(
    key: str,
    solve: Callable[[], Solution],
    *,
    read: Callable[[bytes], Solution],
    written: Callable[[Solution], bytes],
    what: str,
    most: int,
) -> Solution:
    """The solution of a key from the store, or a new one, which is kept there.

    Args:
        key: A digest of all that the solution depends on.
        solve: Finds it.
        read: Reads a stored one; raises a KeyError, TypeError, ValueError, OverflowError or RecursionError if it is
            damaged.
        written: The bytes of one.
        what: What it is, for messages, such as "a solution of this region".
        most: Bytes of a stored one at most.
    """
    store = _store.get()
    if store is None:
        return solve()
    data = store.find(key, most)
    if data is not None:
        try:
            return read(data)
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            store.refuse(key, f"is not {what} ({error})")
    solution = solve()
    store.keep(key, written(solution))
    return solution
