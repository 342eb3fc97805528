"""Solutions of regions of flesh, kept by what they depend on: in this process, and in a store if a caller gives one.

A solution depends on the region's geometry alone, so a change of frequency, damping or limit finds it again.
"""

import numpy as np

from wrinklecli.effects.flesh.tissue import Body, Place, Swings, solution_key, solve
from wrinklecli.effects.kept import keep, kept_solution, read_records, written_records
from wrinklecli.numeric.elements import Tissue
from wrinklecli.numeric.memory import once

# Regions whose shapes this process keeps.
_MOST = 16
# Bytes of a stored solution at most: a grid of 100 nodes along each side and 9 shapes would take twice as much.
_MOST_BYTES = 2**27


_kept: dict[str, Swings] = {}


def swings_of(body: Body, place: Place, count: int) -> Swings:
    """The `count` shapes in which a region swings; those of the last regions are kept.

    Raises:
        NoFleshError: Nothing of the region can move.
    """
    key = solution_key(body, place, count)

    def found() -> Swings:
        swings = kept_solution(key, lambda data: _read(data, count), what="a solution of this region", most=_MOST_BYTES)
        if swings is None:
            swings = solve(body, place, count)
            keep(key, lambda: written_records(swings))
        return swings

    return once(_kept, key, found, _MOST)


def _read(data: bytes, count: int) -> Swings:
    """Read a stored solution.

    Raises:
        AttributeError, LookupError, TypeError, ValueError, OverflowError, RecursionError: It is none of so many shapes.
    """
    found: Swings = read_records(data, [Swings, Tissue])
    tissue, values = found.tissue, found.values
    fitting = (
        values.ndim == 5
        and values.shape[4] == 3
        and found.low.shape == (3,)
        and found.loads.shape == (len(values), 3)
        and found.speeds.shape == (count,) == (len(values),)
        and tissue.nodes.shape == (len(tissue.fills), 8)
        and tissue.stiffnesses.shape == tissue.fills.shape
        and tissue.fixed.shape == (int(np.prod(values.shape[1:4])),)
        and tissue.fixed.dtype == np.bool_
    )
    sizes = np.array([found.size, tissue.size])
    numbers = (found.low, values, found.loads, found.speeds, tissue.fills, tissue.stiffnesses, sizes)
    if not fitting or not all(np.isfinite(each).all() for each in numbers):
        raise ValueError("its parts do not fit")
    nodes = tissue.nodes
    if not ((sizes > 0).all() and (found.speeds > 0).all() and nodes.min() >= 0 and nodes.max() < len(tissue.fixed)):
        raise ValueError("its numbers are none of a solution")
    return found
