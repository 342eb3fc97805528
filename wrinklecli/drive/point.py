"""Carried points in extras: by the names of their joints, in these joints' own spaces."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrinklecli.character.carried import CarriedPoint
from wrinklecli.drive.stored import Json, read_numbers, stored


def point_json(point: CarriedPoint, names: Sequence[str], morph_names: Sequence[str]) -> Json:
    """A point in the spaces of its joints; `scales` are those of the joints at rest.

    It may follow the first of the rig's morph targets alone: points of effects below the skin follow the asset's own.
    """
    places = point.points[..., :3] / point.weights[:, None]
    scales = 1.0 / np.cbrt(np.where(point.shares > 0, point.shares, 1.0))
    entry: Json = {
        "joints": [names[node] for node in point.nodes.tolist()],
        "weights": stored(point.weights),
        "positions": stored(places[0]),
        "scales": stored(scales),
    }
    if places[1:].any():
        moves = zip(morph_names[: len(places) - 1], places[1:], strict=True)
        entry["morphs"] = {name: stored(deltas) for name, deltas in moves if deltas.any()}
    return entry


def read_point(data: Json, nodes: Mapping[str, int], morph_names: Sequence[str]) -> CarriedPoint:
    """Read a point on a rig whose nodes have these numbers by name.

    Raises:
        KeyError, TypeError, ValueError: The extras are not what `bake` writes.
    """
    count = len(data["joints"])
    weights, scales = (read_numbers(data[key], count) for key in ("weights", "scales"))
    if not (scales > 0).all():
        raise ValueError
    moves = {name: read_numbers(each, count, 3) for name, each in data.get("morphs", {}).items()}
    points = np.zeros((1 + len(morph_names), count, 4))
    points[0] = np.column_stack([read_numbers(data["positions"], count, 3), np.ones(count)])
    for row, name in zip(points[1:], morph_names, strict=True):
        row[:, :3] = moves.get(name, 0.0)
    numbers = np.array([nodes[str(joint)] for joint in data["joints"]], np.intp)
    return CarriedPoint(numbers, weights, points * weights[:, None], 1.0 / scales**3)
