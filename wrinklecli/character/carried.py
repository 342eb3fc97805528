"""Points that joints and morph targets carry, and their places over time, from which effects measure their signals.

A point of a skinned surface is a weighted mean of points, each rigid with one joint. Its world position is the sum over
influences k of world(nodes[k]) @ (points[0] + sum over morph targets m of w_m points[m])[k].
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import morph_weights, node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, determinants


@dataclass(frozen=True, slots=True, eq=False)
class CarriedPoint:
    """A point that some nodes and morph targets of an asset carry.

    Attributes:
        nodes: (influences,) the nodes that carry it, usually joints.
        weights: (influences,) factors that sum to 1.
        points: (1 + morph targets, influences, 4) homogeneous points times their weights, in the nodes' own spaces: the
            point itself, then the delta of each morph target. The fourth number is the weight, or 0 in deltas.
        shares: (influences,) 1 / |det| of each node's world matrix at rest. A node's scale relative to rest is the cube
            root of this times the |det| of a pose.
    """

    nodes: Ints
    weights: Floats
    points: Floats
    shares: Floats


@dataclass(frozen=True, slots=True)
class Carriers:
    """The nodes that carry some points, posed at a few times.

    Attributes:
        numbers: The index into `rows` and `scales` of each pair of a node and its `shares`.
        rows: (3, 4, frames) rows of each node's world matrix; one frame if nothing moves the node.
        scales: (frames,) each node's scale relative to rest, for as many frames.
        weights: (frames, morph targets).
    """

    numbers: Mapping[tuple[int, float], int]
    rows: Sequence[Floats]
    scales: Sequence[Floats]
    weights: Floats


def pose_carriers(
    points: Iterable[CarriedPoint],
    rig: Rig,
    clip: Clip | None,
    times: Floats,
    known: dict[int, Floats] | None = None,
) -> Carriers:
    """Pose the nodes of some points at (frames,) seconds, each once; in the stored pose if `clip` is None.

    `known` is as in `node_rows`.
    """
    return pose_carriers_in(list(points), rig, [(clip, times, {} if known is None else known)])


def pose_carriers_in(
    points: Sequence[CarriedPoint], rig: Rig, motions: Sequence[tuple[Clip | None, Floats, dict[int, Floats]]]
) -> Carriers:
    """Pose the nodes of some points as `pose_carriers`, in one motion after another: clip, times and known rows."""
    pairs = sorted({pair for each in points for pair in zip(each.nodes.tolist(), each.shares.tolist(), strict=True)})
    nodes = [node for node, _ in pairs]
    by_motion = [node_rows(rig, clip, times, nodes, known) for clip, times, known in motions]
    counts = [len(times) for _, times, _ in motions]
    rows = [_joined(each, counts) for each in zip(*by_motion, strict=True)]
    scales = [
        np.cbrt(share * np.abs(determinants(each[:, :3].transpose(2, 0, 1))))
        for each, (_, share) in zip(rows, pairs, strict=True)
    ]
    weights = np.concatenate([_weights(points, rig, clip, times) for clip, times, _ in motions])
    return Carriers({pair: number for number, pair in enumerate(pairs)}, rows, scales, weights)


def _joined(rows: Sequence[Floats], counts: Sequence[int]) -> Floats:
    """(3, 4, frames) rows of a node in motions of so many frames each; one frame if no motion moves the node."""
    first = rows[0]
    if len(rows) == 1 or all(each is first or (each.shape[2] == 1 and np.array_equal(each, first)) for each in rows):
        return first
    every = [np.broadcast_to(each, (3, 4, count)) for each, count in zip(rows, counts, strict=True)]
    return np.concatenate(every, axis=2)


def _weights(points: Sequence[CarriedPoint], rig: Rig, clip: Clip | None, times: Floats) -> Floats:
    """(frames, morph targets) weights; 0 for those of drives that carry none of the points."""
    if not rig.drives:
        return morph_weights(rig, clip, times)
    # Points of effects that are attached before others know fewer targets.
    carrying = np.zeros(len(rig.morph_names), bool)
    for point in points:
        carrying[: len(point.points) - 1] |= point.points[1:].any(axis=(1, 2))
    return morph_weights(rig, clip, times, carrying)


def carried_places(point: CarriedPoint, carriers: Carriers, count: int) -> tuple[Floats, Floats]:
    """(3, count) world-space places of a point in `count` poses, and its (count,) scales relative to rest."""
    acting = np.flatnonzero(point.points[1:].any(axis=(1, 2)))
    weights, points = carriers.weights[:, acting], point.points[np.append(0, 1 + acting)]
    place, scale = np.zeros((3, count)), np.zeros(count)
    # The sum over all nodes that nothing moves: the point itself, and the delta of each morph target.
    still = np.zeros((1 + len(acting), 3))
    pairs = zip(point.nodes.tolist(), point.shares.tolist(), strict=True)
    for pair, weight, each in zip(pairs, point.weights, points.transpose(1, 0, 2), strict=True):
        rows = carriers.rows[carriers.numbers[pair]]
        scale += weight * carriers.scales[carriers.numbers[pair]]
        if rows.shape[2] == 1:
            still += np.einsum("mc,rc->mr", each, rows[:, :, 0])
            continue
        morphed = each[0, :, None]
        if len(acting):
            morphed = morphed + np.einsum("mc,fm->cf", each[1:], weights)
        for column in range(4):
            place += rows[:, column] * morphed[column]
    if len(acting):
        place += np.einsum("mr,fm->rf", still[1:], weights)
    place += still[0, :, None]
    return place, scale
