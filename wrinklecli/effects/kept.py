"""Solutions that effects look up and keep by what they depend on, in a store that a caller gives."""

import json
from base64 import b64decode, b64encode
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from hashlib import blake2b
from types import MappingProxyType
from typing import Any, Protocol, TypeVar

import numpy as np

from wrinklecli.numeric.arrays import Ints

Solution = TypeVar("Solution")

# Kinds of numbers in stored arrays.
_NUMBERS = ("<f8", "<i8", "|b1")


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


def is_kept() -> bool:
    """True if solutions are kept in a store."""
    return _store.get() is not None


def digest_of(arrays: Iterable[Any], name: str = "") -> str:
    """A digest of arrays, and of a name; with shapes, as the numbers of two in a row may be divided otherwise."""
    digest = blake2b(name.encode(), digest_size=32)
    for each in map(np.ascontiguousarray, arrays):
        digest.update(f"{each.shape} {each.dtype.str} ".encode())
        digest.update(each.tobytes())
    return digest.hexdigest()


def kept_search(search: Callable[[], Ints], name: str, count: int, inputs: Iterable[Any]) -> Ints:
    """(count,) numbers from 0 on that a search finds, from the store if they are there.

    The search depends on its `inputs`, which are arrays, and on nothing else. No other search has its name.
    """
    if not is_kept():
        return search()

    def numbers(data: bytes) -> Ints:
        return np.frombuffer(data, "<u4", count).astype(np.intp)

    key = digest_of(inputs, name)
    found = kept_solution(key, numbers, what="what was searched for", most=4 * count)
    if found is None:
        found = search()
        keep(key, found.astype("<u4").tobytes)
    return found


def kept_solution(key: str, read: Callable[[bytes], Solution], *, what: str, most: int) -> Solution | None:
    """The solution of a key from the store; None without a store, or if it has none.

    Args:
        key: A digest of all that the solution depends on.
        read: Reads a stored one; raises an error, as `read_records` does, if it is damaged.
        what: What it is, for messages, such as "a solution of this region".
        most: Bytes of a stored one at most.
    """
    store = _store.get()
    data = store.find(key, most) if store is not None else None
    if store is None or data is None:
        return None
    try:
        return read(data)
    except (AttributeError, LookupError, TypeError, ValueError, OverflowError, RecursionError) as error:
        store.refuse(key, f"is not {what} ({error})")
        return None


def keep(key: str, written: Callable[[], bytes]) -> None:
    """Keep the bytes of a solution, if there is a store."""
    store = _store.get()
    if store is not None:
        store.keep(key, written())


def plain(value: Any, numbers: Mapping[int, int] = MappingProxyType({})) -> Any:
    """A value as JSON has it: records by their fields, and in place of known objects, by their ids, numbers."""
    if id(value) in numbers:
        return {"known": numbers[id(value)]}
    if isinstance(value, np.ndarray):
        content = np.ascontiguousarray(value, value.dtype.newbyteorder("<"))
        return {"array": [content.shape, content.dtype.str, b64encode(content.tobytes()).decode()]}
    if is_dataclass(value):
        return {type(value).__name__: [plain(getattr(value, each.name), numbers) for each in fields(value)]}
    if isinstance(value, Mapping):
        return {"map": [[key, plain(each, numbers)] for key, each in value.items()]}
    return [plain(each, numbers) for each in value] if isinstance(value, (list, tuple)) else value


def written_records(solution: Any, known: Sequence[object] = ()) -> bytes:
    """The bytes of a solution that is made of records, with numbers in place of known objects."""
    return json.dumps(plain(solution, {id(each): number for number, each in enumerate(known)})).encode()


def read_records(data: bytes, kinds: Sequence[type[Any]], known: Sequence[object] = ()) -> Any:
    """Read a stored solution, which is made of records of some kinds; others lack what its reader looks for.

    Raises:
        AttributeError, LookupError, TypeError, ValueError, OverflowError, RecursionError: It is none.
    """
    records = {each.__name__: each for each in kinds}

    def value(entry: Any) -> Any:
        if isinstance(entry, list):
            return tuple(map(value, entry))
        if not isinstance(entry, dict):
            return entry
        ((kind, content),) = [*entry.items()][:1]
        if kind == "known":
            return known[content]
        if kind == "array":
            shape, numbers, text = content
            return np.frombuffer(b64decode(text), _NUMBERS[_NUMBERS.index(numbers)]).reshape(shape)
        return {key: value(each) for key, each in content} if kind == "map" else records[kind](*map(value, content))

    return value(json.loads(data))
