"""Points that nodes and morph targets carry: the weighted sum over nodes, whether anything moves these or not."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.prepared import rig_of
from wrinklecli.character.carried import CarriedPoint, carried_places, pose_carriers, pose_carriers_in
from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.pose import morph_weights, node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.numeric.arrays import Floats

TIMES = np.linspace(0.0, 1.0, 5)


def rig_and_clip(numbers: np.random.Generator) -> tuple[Rig, Clip]:
    """A chain of three joints below the mesh's node, of which a clip moves and scales the last, and two targets."""
    chain = [
        {"name": f"joint_{k}", "translation": numbers.normal(size=3).tolist(), "children": [k + 1]} for k in (1, 2)
    ]
    rig = rig_of({"mesh": 0}, *chain, {"name": "joint_3", "scale": [1.0, 2.0, 0.5]})
    keys = {
        (3, "translation"): numbers.normal(size=(5, 3)),
        (3, "scale"): numbers.uniform(0.5, 2.0, (5, 3)),
        (0, "weights"): numbers.uniform(-1.0, 1.0, (5, 2)),
    }
    channels = [Channel(-1, node, path, TIMES, values, "LINEAR") for (node, path), values in keys.items()]
    return replace(rig, morph_names=("a", "b"), morph_weights=np.array([0.3, 0.0])), Clip(
        -1, "clip", tuple(channels), 0.0, 1.0
    )


def random_point(numbers: np.random.Generator) -> CarriedPoint:
    """A point of all three joints, which the first target does not move."""
    weights = numbers.dirichlet(np.ones(3))
    points = np.zeros((3, 3, 4))
    points[0, :, :3], points[0, :, 3], points[2, :, :3] = numbers.normal(size=(3, 3)), 1.0, numbers.normal(size=(3, 3))
    return CarriedPoint(np.array([1, 2, 3]), weights, points * weights[:, None], numbers.uniform(0.5, 2.0, 3))


def summed(point: CarriedPoint, rig: Rig, clip: Clip | None) -> tuple[Floats, Floats]:
    """The place and scale of a point over time, as the module's docstring has them."""
    matrices = node_matrices(rig, clip, TIMES, point.nodes.tolist())
    weights = np.concatenate([np.ones((len(TIMES), 1)), morph_weights(rig, clip, TIMES)], axis=1)
    place = np.einsum("fkab,fm,mkb->af", matrices, weights, point.points)[:3]
    scale = np.cbrt(np.abs(np.linalg.det(matrices[:, :, :3, :3])) * point.shares) @ point.weights
    return place, scale


@given(st.integers(0, 1000), st.booleans())
def test_a_point_is_the_weighted_sum_over_its_nodes(seed: int, moving: bool) -> None:
    numbers = np.random.default_rng(seed)
    rig, clip = rig_and_clip(numbers)
    points = [random_point(numbers) for _ in range(3)]
    carriers = pose_carriers(points, rig, clip if moving else None, TIMES)
    for point in points:
        found = carried_places(point, carriers, len(TIMES))
        for got, wanted in zip(found, summed(point, rig, clip if moving else None), strict=True):
            assert got == pytest.approx(wanted, abs=1e-12)


def test_nodes_that_several_points_share_are_posed_once() -> None:
    numbers = np.random.default_rng(1)
    rig, clip = rig_and_clip(numbers)
    point = random_point(numbers)
    carriers = pose_carriers([point, point], rig, clip, TIMES)
    assert len(carriers.rows) == len(carriers.scales) == 3
    assert [each.shape[2] for each in carriers.rows] == [1, 1, len(TIMES)]


@given(st.integers(0, 1000))
def test_motions_posed_at_once_are_those_posed_one_by_one(seed: int) -> None:
    """Also where a motion moves none of the nodes, as the stored pose does."""
    numbers = np.random.default_rng(seed)
    rig, clip = rig_and_clip(numbers)
    points, clips = [random_point(numbers) for _ in range(2)], [clip, None, clip]
    together = pose_carriers_in(points, rig, [(each, TIMES, {}) for each in clips])
    apart = [pose_carriers(points, rig, each, TIMES) for each in clips]
    for point in points:
        place, scale = carried_places(point, together, 3 * len(TIMES))
        places, scales = zip(*(carried_places(point, each, len(TIMES)) for each in apart), strict=True)
        assert place == pytest.approx(np.concatenate(places, axis=1), abs=1e-12)
        assert scale == pytest.approx(np.concatenate(scales), abs=1e-12)


@given(st.integers(0, 1000))
def test_drives_move_the_points_that_their_targets_carry(seed: int) -> None:
    """A drive moves one coordinate of one node's part of a point alone; a drive that moves none is not asked."""
    numbers = np.random.default_rng(seed)
    rig, clip = rig_and_clip(numbers)
    clip = replace(clip, channels=clip.channels[:2])
    values = numbers.uniform(size=len(TIMES))
    acting, idle = (Mock(targets=(name,)) for name in ("acting", "idle"))
    acting.weights_in.return_value = lambda _times: values[:, None]
    idle.weights_in.side_effect = AssertionError
    driven, plain = rig.driven_by([idle, acting]), random_point(numbers)
    moves = np.zeros((2, 3, 4))
    moves[1, seed % 3, seed % 2] = 1.0
    points = [replace(plain, points=np.concatenate([plain.points, each])) for each in (moves, 0.0 * moves)]
    carriers = pose_carriers(points, driven, clip, TIMES)
    place, before = (carried_places(point, carriers, len(TIMES))[0] for point in points)
    column = node_matrices(rig, clip, TIMES, [1 + seed % 3])[:, 0, :3, seed % 2]
    assert place - before == pytest.approx((values[:, None] * column).T, abs=1e-12)
