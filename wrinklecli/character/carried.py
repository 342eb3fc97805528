"""Points that joints and morph targets carry, and where they go over time: all that an effect's signal needs to pose.

A point of a skinned surface is a weighted mean of points that one joint each carries rigidly. Its world position is the
sum over influences k of world(nodes[k]) @ (points[0] + sum over morph targets m of w_m points[m])[k].
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import morph_weights, node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.numeric.arrays import Floats, Ints, determinants


@dataclass(frozen=True, slots=True, eq=False)
class CarriedPoint:
    """A point that some nodes and morph targets of an asset carry.

    Attributes:
        nodes: (influences,) the nodes that carry it, joints as a rule.
        weights: (influences,) their shares, summing to 1.
        points: (1 + morph targets, influences, 4) homogeneous points times their weights, in the nodes' own spaces: the
            point itself, then what each morph target adds. The fourth number is the weight itself, 0 in morph deltas.
        shares: (influences,) 1 / |det| of each node's world matrix at rest. Times the |det| of a pose, the cube root
            is how much a node is scaled against rest.
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
        rows: For each (3, 4, frames) of its world matrix; one frame where nothing moves it.
        scales: For each (frames,) its scale against rest; as many frames.
        weights: (frames, morph targets).
    """

    numbers: Mapping[tuple[int, float], int]
    rows: Sequence[Floats]
    scales: Sequence[Floats]
    weights: Floats


def pose_carriers(points: Iterable[CarriedPoint], rig: Rig, clip: Clip | None, times: Floats) -> Carriers:
    """Pose the nodes of some points at (frames,) seconds, each once; in the stored pose if `clip` is None."""
    pairs = sorted({pair for each in points for pair in zip(each.nodes.tolist(), each.shares.tolist(), strict=True)})
    rows = node_rows(rig, clip, times, [node for node, _ in pairs])
    scales = [
        np.cbrt(share * np.abs(determinants(each[:, :3].transpose(2, 0, 1))))
        for each, (_, share) in zip(rows, pairs, strict=True)
    ]
    return Carriers({pair: number for number, pair in enumerate(pairs)}, rows, scales, morph_weights(rig, clip, times))


def carried_places(point: CarriedPoint, carriers: Carriers, count: int) -> tuple[Floats, Floats]:
    """(3, count) where `count` poses take a point, world space, and (count,) how they scale it against rest."""
    acting = np.flatnonzero(point.points[1:].any(axis=(1, 2)))
    weights, points = carriers.weights[:, acting], point.points[np.append(0, 1 + acting)]
    place, scale = np.zeros((3, count)), np.zeros(count)
    # What all nodes that nothing moves make together: a point, and what each morph target adds to it.
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
