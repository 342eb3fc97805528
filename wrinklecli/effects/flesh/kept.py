"""Solutions of regions of flesh, kept by what they depend on: in this process, and in a store if a caller gives one.

A solution depends on the region's geometry alone, so a change of frequency, damping or limit finds it again.
"""

import json

import numpy as np

from wrinklecli.effects.flesh.tissue import Body, Place, Swings, solution_key, solve
from wrinklecli.effects.kept import keep, kept_solution
from wrinklecli.numeric.elements import Tissue
from wrinklecli.numeric.memory import once

# Regions whose shapes this process keeps.
_MOST = 16
# Bytes of a stored solution at most: a grid of 100 nodes along each side and 9 shapes would take twice as much.
_MOST_BYTES = 2**27
# The arrays of a stored solution, in their order.
_ARRAYS = {"low": "f8", "values": "f8", "loads": "f8", "speeds": "f8", "nodes": "i8", "fills": "f8",
           "stiffnesses": "f8", "fixed": "?"}  # fmt: skip


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
            keep(key, lambda: _written(swings))
        return swings

    return once(_kept, key, found, _MOST)


def _written(swings: Swings) -> bytes:
    tissue = swings.tissue
    parts = (swings.low, swings.values, swings.loads, swings.speeds, tissue.nodes, tissue.fills, tissue.stiffnesses,
             tissue.fixed)  # fmt: skip
    arrays = dict(zip(_ARRAYS, parts, strict=True))
    head = {"size": swings.size, "cube": tissue.size, "shapes": {name: each.shape for name, each in arrays.items()}}
    contents = [np.ascontiguousarray(each, f"<{_ARRAYS[name]}").tobytes() for name, each in arrays.items()]
    return b"".join([json.dumps(head).encode(), b"\n", *contents])


def _read(data: bytes, count: int) -> Swings:
    """Read a stored solution.

    Raises:
        KeyError, TypeError, ValueError, OverflowError, RecursionError: It is none of so many shapes.
    """
    line, _, rest = data[:1000].partition(b"\n")
    head, start = json.loads(line), len(line) + 1
    if not isinstance(head, dict) or not rest:
        raise ValueError("its head is none")
    arrays = {}
    for name, kind in _ARRAYS.items():
        shape = tuple(head["shapes"][name])
        if not all(type(each) is int and 0 < each < _MOST_BYTES for each in shape):
            raise ValueError(f"{name} has the shape {shape}")
        length = int(np.prod(shape, dtype=object)) * np.dtype(kind).itemsize
        if start + length > len(data):
            raise ValueError("it is cut off")
        arrays[name] = np.frombuffer(data, f"<{kind}", length // np.dtype(kind).itemsize, start).reshape(shape)
        start += length
    values, nodes, fills, fixed = (arrays[name] for name in ("values", "nodes", "fills", "fixed"))
    fitting = (
        start == len(data)
        and values.ndim == 5
        and values.shape[4] == 3
        and arrays["low"].shape == (3,)
        and arrays["loads"].shape == (len(values), 3)
        and arrays["speeds"].shape == (count,) == (len(values),)
        and nodes.shape == (len(fills), 8)
        and arrays["stiffnesses"].shape == fills.shape
        and fixed.shape == (int(np.prod(values.shape[1:4])),)
    )
    numbers = [arrays[name] for name, kind in _ARRAYS.items() if kind == "f8"]
    size, cube = float(head["size"]), float(head["cube"])
    if not fitting or not all(np.isfinite(each).all() for each in (*numbers, np.array([size, cube]))):
        raise ValueError("its parts do not fit")
    if not (size > 0 and cube > 0 and (arrays["speeds"] > 0).all() and nodes.min() >= 0 and nodes.max() < len(fixed)):
        raise ValueError("its numbers are none of a solution")
    tissue = Tissue(nodes.astype(np.intp), fills, arrays["stiffnesses"], fixed, cube)
    return Swings(arrays["low"], size, values, arrays["loads"], arrays["speeds"], tissue)
