"""How tests look at work without the clock: counted in calls, the same on every machine and under any load."""

import sys
from collections.abc import Callable
from typing import Any

# Seconds for what has to happen: other programs may run, but nothing may wait for ever.
PATIENCE = 300.0


def calls_of(function: Callable[[], Any]) -> int:
    """Calls of Python's and C's functions during a call of a function; it runs once before, to fill caches."""
    function()
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
    return count
