"""One thread that does all of an editor's work, one piece after the other: what tabs ask for, and what is due.

Callbacks of a page come from many tabs at once and faster than they can be answered. They are only put down here. What
is asked for again before it was done, such as the next position of a slider, replaces what was asked for before.
"""

import threading
import time
from collections.abc import Callable, Hashable
from typing import TypeAlias

Action: TypeAlias = Callable[[], None]


class WorkQueue:
    """Things to do.

    Args:
        fail: Called with what an action has raised; the work goes on.
    """

    def __init__(self, fail: Callable[[Exception], None]) -> None:
        self._fail = fail
        self._asked: dict[Hashable, Action] = {}
        self._due: dict[Hashable, tuple[float, Action]] = {}
        self._changed = threading.Condition()
        self._ended = False
        self._was_due = False

    def put(self, key: Hashable, action: Action) -> None:
        """Do something as soon as may be, in place of what waits under the same key."""
        with self._changed:
            self._asked[key] = action
            self._changed.notify()

    def put_later(self, key: Hashable, seconds: float, action: Action) -> None:
        """Do something after some seconds, in place of what waits under the same key, from now on."""
        with self._changed:
            self._due[key] = (time.monotonic() + seconds, action)
            self._changed.notify()

    def drop(self, key: Hashable) -> None:
        """Do not do what waits under a key."""
        with self._changed:
            self._asked.pop(key, None)
            self._due.pop(key, None)

    @property
    def ended(self) -> bool:
        """Whether there is to be nothing more."""
        return self._ended

    def end(self) -> None:
        """Let `run` return once what it is at is done."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def run(self) -> None:
        """Do what there is to do until the end."""
        while (action := self._next()) is not None:
            try:
                action()
            except Exception as error:
                self._fail(error)

    def _next(self) -> Action | None:
        """What to do next; waits until there is something. None at the end."""
        with self._changed:
            while not self._ended:
                now = time.monotonic()
                ready = [key for key, (due, _) in self._due.items() if due <= now]
                # In turns: a clip plays on while a slider is dragged, and a slow clip holds up no click.
                if ready and not (self._was_due and self._asked):
                    self._was_due = True
                    return self._due.pop(min(ready, key=lambda key: self._due[key][0]))[1]
                if self._asked:
                    self._was_due = False
                    return self._asked.pop(next(iter(self._asked)))
                soonest = min((due for due, _ in self._due.values()), default=None)
                self._changed.wait(None if soonest is None else max(soonest - now, 0.0))
        return None
