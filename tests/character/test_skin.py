"""Posing as matrix products, against the definitions."""

import numpy as np
import pytest

from wrinklecli.character.pose import blend, transform
from wrinklecli.character.skin import Influences, pose, prepare
from wrinklecli.numeric.arrays import unit


def a_skin(seed: int, *, vertices: int = 300, joints: int = 7, shapes: int = 4, frames: int = 11):
    """Weights of one to four joints, shapes on parts of the vertices, and joints that also scale and shear."""
    random = np.random.default_rng(seed)
    weights = np.zeros((vertices, joints))
    for row in weights:
        chosen = random.choice(joints, random.integers(1, min(joints, 4) + 1), replace=False)
        row[chosen] = random.dirichlet(np.ones(len(chosen)))
    positions = random.normal(size=(vertices, 3))
    deltas = random.normal(size=(shapes, vertices, 3)) * (random.random((shapes, vertices, 1)) < 0.3)
    normals = unit(random.normal(size=(vertices, 3)))
    normal_deltas = 0.2 * deltas[..., ::-1]
    matrices = np.tile(np.eye(4), (frames, joints, 1, 1))
    matrices[:, :, :3] += 0.2 * random.normal(size=(frames, joints, 3, 4))
    return weights, positions, deltas, normals, normal_deltas, matrices, random.normal(size=(frames, shapes))


def by_definition(weights, positions, deltas, normals, normal_deltas, matrices, played):
    blended = blend(weights, matrices)
    placed = transform(blended, positions + np.tensordot(played, deltas, axes=1))
    inverses = np.linalg.inv(blended[..., :3])
    turned = np.einsum("fvba,fvb->fva", inverses, normals + np.tensordot(played, normal_deltas, axes=1))
    return placed, unit(turned)


@pytest.mark.parametrize(("seed", "joints", "shapes"), [(0, 1, 0), (1, 1, 3), (2, 2, 1), (3, 7, 4), (4, 40, 0)])
def test_positions_and_normals_are_those_of_the_definition(seed: int, joints: int, shapes: int) -> None:
    *stored, matrices, played = a_skin(seed, joints=joints, shapes=shapes)
    placed, turned = by_definition(*stored, matrices, played)
    positions, normals = pose(prepare(Influences.of(stored[0]), *stored[1:]), matrices, played)
    assert np.abs(positions.transpose(0, 2, 1) - placed).max() < 1e-12
    assert normals is not None
    assert np.abs(normals.transpose(0, 2, 1) - turned).max() < 1e-8


def test_mirroring_joints_turn_normals_by_the_inverse_transpose() -> None:
    weights, positions, _, normals, _, matrices, _ = a_skin(0, joints=1, shapes=0)
    matrices[:] = np.diag([-1.0, 1.0, 1.0, 1.0])
    none = np.zeros((0, len(positions), 3))
    skin = prepare(Influences.of(weights), positions, none, normals, none)
    _, turned = pose(skin, matrices, np.zeros((len(matrices), 0)))
    assert turned is not None
    assert np.allclose(turned[0].T, normals * [-1.0, 1.0, 1.0])


def test_without_normals_there_are_none() -> None:
    weights, positions, deltas, *_, matrices, played = a_skin(2)
    positions_alone, normals = pose(prepare(Influences.of(weights), positions, deltas), matrices, played)
    assert normals is None
    assert positions_alone.shape == (len(matrices), 3, len(positions))


def test_chunks_of_time_do_not_show() -> None:
    *stored, matrices, played = a_skin(3, vertices=3000, frames=60)
    skin = prepare(Influences.of(stored[0]), *stored[1:])
    whole, _ = pose(skin, matrices, played)
    parts = [pose(skin, matrices[k : k + 7], played[k : k + 7])[0] for k in range(0, 60, 7)]
    assert np.abs(np.concatenate(parts) - whole).max() < 1e-14


@pytest.mark.parametrize("columns", [None, [2, 3, 9]])
def test_influences_are_the_weights_of_all_joints(columns: list[int] | None) -> None:
    random = np.random.default_rng(5)
    dense = random.random((50, 3)) * (random.random((50, 3)) < 0.6)
    dense[:, 1] = 0.0
    numbers = np.arange(3) if columns is None else np.array(columns)
    influences = Influences.of(dense, None if columns is None else numbers, None if columns is None else 12)
    whole = np.zeros((50, influences.joint_count))
    whole[:, numbers] = dense
    assert np.array_equal(influences.dense().T, whole)
    assert len(influences.joints) == 2
    acting = influences.acting
    assert acting.tolist() == numbers[[0, 2]].tolist()
    assert np.array_equal(influences.among(acting).dense().T, whole[:, acting])
    chosen = np.array([3, 3, 40])
    assert np.array_equal(influences.at(chosen).dense().T, whole[chosen])
    wider = Influences.of(np.ones((4, influences.joint_count)))
    assert np.array_equal(influences.before(wider).dense().T, np.concatenate([whole, wider.dense().T]))
