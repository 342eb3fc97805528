"""Independent pieces of work in threads, and in processes, which begin as copies of this one.

Threads share what they read, and suit work on long arrays; most else, as the libraries of contact, keeps Python's lock.
"""

import io
import os
import pickle
from collections.abc import Callable, Generator, Sequence
from contextvars import copy_context
from traceback import format_exception
from typing import TYPE_CHECKING, Any, TypeVar

from wrinklecli.numeric.guard import one_thread
from wrinklecli.numeric.memory import share

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")

# Bytes that a number takes in a pipe.
_NUMBER = 8
# Most items for several processes: their numbers are all written ahead into a pipe, which holds 16 kB everywhere.
_MOST_ITEMS = 2**14 // _NUMBER
# Processes, this one among them, that share the cores.
_sharing = 1


def core_count() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_threads(function: Callable[[_Item], _Result], items: Sequence[_Item]) -> list[_Result]:
    """Give the function's result for each item, in the order of the items, worked out on this process's share of cores.

    Numpy leaves Python's lock to others while it works on an array. All threads have ended when this returns, so the
    process may copy itself.
    """
    from concurrent.futures import ThreadPoolExecutor

    # How numpy treats overflow is part of a context, which one thread alone can be in.
    contexts = [copy_context() for _ in items]
    with ThreadPoolExecutor(max(core_count() // _sharing, 1)) as threads:
        return list(threads.map(lambda context, item: context.run(function, item), contexts, items))


def in_processes(
    function: Callable[[_Item], _Result],
    items: Sequence[_Item],
    jobs: int,
    *,
    shared: Sequence[object] = (),
    size: Callable[[_Item], float] | None = None,
) -> Generator[_Result, None, None]:
    """Give the function's result for each item, in the order of the items, worked out by up to so many processes.

    With a `size`, the largest items are begun first, so that no process is left with a long one in the end. A result
    is given as soon as it is there, while others are still worked out. This process has no further threads meanwhile,
    so it may copy itself. The processes share the memory that `held` leaves this one; an item that needs more than such
    a share is worked out here.

    Results come back as copies, but what they hold of the `shared` objects is these themselves. Where the system has
    no `fork`, or there is one process or item, the work is done here, each piece when its result is asked for.

    Raises:
        Exception: The function's own, when it is this item's turn.
        ChildProcessError: A process ended before its work.
    """
    if min(jobs, len(items)) < 2 or len(items) > _MOST_ITEMS or not hasattr(os, "fork"):
        yield from map(function, items)
        return
    # Imported here, as most commands need none of it.
    from multiprocessing import get_context
    from multiprocessing.connection import wait

    objects = _Shared(shared)
    order = range(len(items)) if size is None else sorted(range(len(items)), key=lambda each: -size(items[each]))
    tasks, numbers = os.pipe()
    os.write(numbers, b"".join(number.to_bytes(_NUMBER, "little") for number in order))
    os.close(numbers)
    context = get_context("fork")
    workers, found = {}, dict[int, bytes]()
    try:
        for _ in range(min(jobs, len(items))):
            results, end = context.Pipe(duplex=False)
            process = context.Process(target=_work, args=(function, items, objects, tasks, end, min(jobs, len(items))))
            process.start()
            end.close()
            workers[results] = process
        for number in range(len(items)):
            while number not in found:
                if not workers:
                    raise ChildProcessError("a process ended before its work")
                ready = wait(list(workers))
                for each in [each for each in workers if each in ready]:
                    try:
                        done, data = each.recv()
                    except (EOFError, OSError):
                        workers.pop(each).join()
                        each.close()
                    else:
                        found[done] = data
            result, error = objects.read(found.pop(number))
            if isinstance(error, MemoryError):
                # What is too large for a share may fit in all of the memory.
                result = function(items[number])
            elif error is not None:
                raise error
            yield result
    finally:
        os.close(tasks)
        for results, process in workers.items():
            process.kill()
            process.join()
            results.close()


def _work(
    function: Callable[[Any], Any],
    items: Sequence[Any],
    objects: "_Shared",
    tasks: int,
    results: "Connection",
    count: int,
) -> None:
    """Work items out in one of `count` processes, until none is left."""
    global _sharing
    _sharing *= count
    share(count)
    with one_thread():
        while task := os.read(tasks, _NUMBER):
            number = int.from_bytes(task, "little")
            try:
                data = objects.written((function(items[number]), None))
            except Exception as error:
                # The place is not sent along; the text of it is.
                error.add_note("".join(format_exception(error)))
                data = objects.written((None, error))
            results.send((number, data))


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
