"""Independent pieces of work in processes, which begin as copies of this one.

Processes and not threads, as the libraries of contact keep Python's lock.
"""

import io
import os
import pickle
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from wrinklecli.numeric.guard import one_thread

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

# What a process was copied for: the work, its items, and the objects that results refer to.
_work: tuple[Callable[[Any], Any], Sequence[Any], "_Shared"] | None = None


def core_count() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_processes(
    function: Callable[[_Item], _Result],
    items: Sequence[_Item],
    jobs: int,
    *,
    shared: Sequence[object] = (),
    size: Callable[[_Item], float] | None = None,
) -> Iterator[_Result]:
    """Give the function's result for each item, in the order of the items, worked out by up to so many processes.

    With a `size`, the largest items are begun first, so that no process is left with a long one in the end.

    Results come back as copies, but what they hold of the `shared` objects is these themselves. Where the system has
    no `fork`, or there is one process or item, the work is done here.

    Raises:
        Exception: The function's own, when it is this item's turn.
    """
    global _work
    if min(jobs, len(items)) < 2 or not hasattr(os, "fork"):
        yield from map(function, items)
        return
    # Imported here, as most commands need none of it.
    from concurrent.futures import ProcessPoolExecutor, wait
    from multiprocessing import get_context

    objects = _Shared(shared)
    _work = function, items, objects
    pool = ProcessPoolExecutor(min(jobs, len(items)), mp_context=get_context("fork"))
    try:
        # All processes are copied at the first of these.
        order = range(len(items)) if size is None else sorted(range(len(items)), key=lambda each: -size(items[each]))
        begun = {number: pool.submit(_do, number) for number in order}
        found = [begun.pop(number) for number in range(len(items))]
        _work = None
        wait(found)
    finally:
        # Before the first result is used, as a process that copies itself should have no threads.
        pool.shutdown(cancel_futures=True)
    while found:
        yield objects.read(found.pop(0).result())


def _do(number: int) -> bytes:
    """Work one item out, in a process of its own."""
    assert _work is not None
    function, items, objects = _work
    with one_thread():
        return objects.written(function(items[number]))


class _Shared:
    """Objects that both sides have, and that are not copied with results."""

    def __init__(self, objects: Sequence[object]) -> None:
        self._objects = objects
        self._numbers = {id(each): number for number, each in enumerate(objects)}

    def written(self, result: object) -> bytes:
        """The bytes of a result."""
        numbers = self._numbers

        class Pickler(pickle.Pickler):
            def persistent_id(self, obj: object) -> int | None:
                return numbers.get(id(obj))

        stream = io.BytesIO()
        Pickler(stream, protocol=pickle.HIGHEST_PROTOCOL).dump(result)
        return stream.getvalue()

    def read(self, data: bytes) -> Any:
        """The result."""
        objects = self._objects

        class Unpickler(pickle.Unpickler):
            def persistent_load(self, number: int) -> object:
                return objects[number]

        return Unpickler(io.BytesIO(data)).load()
