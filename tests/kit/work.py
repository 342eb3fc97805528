"""Work is counted in calls, without the clock: they are the same on every machine and under any load."""

import sys
from collections.abc import Callable
from typing import Any

from wrinklecli.numeric.guard import one_thread

# Seconds for what has to happen: other programs may run, but nothing may wait for ever.
PATIENCE = 300.0


def calls_of(*functions: Callable[[], Any]) -> list[int]:
    """Calls of Python's and C's functions during a call of each; the first one runs once before, to fill caches."""
    functions[0]()
    with one_thread():  # which looks for the libraries that the first call has imported
        pass
    counts = []
    for function in functions:
        count = 0

        def note(_frame: Any, event: str, _argument: Any) -> None:
            nonlocal count
            count += event in ("call", "c_call")

        before = sys.getprofile()
        sys.setprofile(note)
        try:
            function()
        finally:
            sys.setprofile(before)
        counts.append(count)
    return counts
