"""A queue of actions that one thread performs one after another.

Callbacks of a page arrive from many tabs, and faster than they can be answered, so they only put an action into the
queue. A new action replaces an action that waits under the same key, such as the previous position of a slider.
"""

import logging
import threading
import time
from collections.abc import Callable, Hashable
from typing import TypeAlias

Action: TypeAlias = Callable[[], object]

_MAX_EVENTS = 256  # events that may wait; while one is handled, nobody clicks more often


class WorkQueue:
    """Actions to perform. If one raises an exception, `fail` is called with it; nothing that happens ends the queue."""

    def __init__(self, fail: Callable[[BaseException], None]) -> None:
        self._fail = fail
        self._asked: dict[Hashable, Action] = {}
        self._due: dict[Hashable, tuple[float, Action]] = {}
        self._changed = threading.Condition()
        self._ended = False
        self._was_due = False

    def put(self, key: Hashable, action: Action) -> None:
        """Perform an action as soon as possible, instead of the one that waits under the key."""
        with self._changed:
            self._asked[key] = action
            self._changed.notify()

    def put_event(self, action: Action) -> None:
        """Perform an action behind all that wait, unless so many wait that no hand has caused them."""
        with self._changed:
            if len(self._asked) < _MAX_EVENTS:
                self.put(object(), action)

    def put_later(self, key: Hashable, seconds: float, action: Action) -> None:
        """Perform an action after some seconds, instead of the one that waits under the key."""
        with self._changed:
            self._due[key] = (time.monotonic() + seconds, action)
            self._changed.notify()

    def drop(self, key: Hashable) -> None:
        """Forget the actions that wait under a key."""
        with self._changed:
            self._asked.pop(key, None)
            self._due.pop(key, None)

    def end(self) -> None:
        """Let `run` return after the current action."""
        with self._changed:
            self._ended = True
            self._changed.notify()

    def run(self) -> None:
        """Perform actions until `end`."""
        while (action := self._next()) is not None:
            try:
                action()
            except BaseException as error:
                self._report(error)

    def _report(self, error: BaseException) -> None:
        """Call `fail`, whose own faults end nothing either."""
        try:
            self._fail(error)
        except BaseException as another:
            logging.getLogger(__name__).error("this is a bug of wrinkle's", exc_info=another)

    def _next(self) -> Action | None:
        """Wait for the next action; None at the end."""
        with self._changed:
            while not self._ended:
                now = time.monotonic()
                ready = [key for key, (due, _) in self._due.items() if due <= now]
                # Both kinds take turns: a clip plays on while a slider is dragged, and a slow clip delays no click.
                if ready and not (self._was_due and self._asked):
                    self._was_due = True
                    return self._due.pop(min(ready, key=lambda key: self._due[key][0]))[1]
                if self._asked:
                    self._was_due = False
                    return self._asked.pop(next(iter(self._asked)))
                soonest = min((due for due, _ in self._due.values()), default=None)
                self._changed.wait(None if soonest is None else max(soonest - now, 0.0))
        return None
