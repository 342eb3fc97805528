"""The reasons why contact does not count in a pose: clauses about contact.

A surface that the solver leaves early, or that it pulls apart, is worse than one that passes through itself. So such a
pose does not count: see module `remaining` for what is shown there.
"""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

_Result = TypeVar("_Result")

UNSETTLED = "did not settle"
"""The solver ended before its steps were short enough."""
TORN = "would tear the surface"
"""It lengthens an edge to more than twice its length, or turns a triangle over: see module `tearing`."""
TOO_MANY_STEPS = "takes most steps in poses that do not settle, and is solved no further,"
"""The solver does not get ahead; it would take minutes."""
DEGENERATE = "cannot be computed, as the surface is degenerate, or touches itself everywhere at rest"
"""The solver's numbers have no answer, or nothing is left that may collide."""

WORSE = "would leave more crossings than the skin alone"
"""The surface crosses more than with wrinkles alone, or more beneath them than the skin."""


def unless_degenerate(work: Callable[[], _Result]) -> _Result | None:
    """The result of some work; None if its numbers have no answer: ipctk, SciPy and numpy raise different errors."""
    try:
        return work()
    except (ArithmeticError, np.linalg.LinAlgError, RuntimeError) as error:
        if isinstance(error, RuntimeError) and type(error) is not RuntimeError:
            raise
        return None
