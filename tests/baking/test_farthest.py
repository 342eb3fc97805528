"""The farthest vertex of two bodies is that which posing all of them finds, and no distance exceeds its bound."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wrinklecli.baking.farthest import Frames, Pair, bounds_of, farthest, finer_bounds, rounding

from wrinklecli.baking import farthest as module
from wrinklecli.character.skin import Skin, pose, prepare
from wrinklecli.numeric.arrays import Floats

FRAMES, VERTICES, JOINTS = 5, 40, 3


def rotations(chance: np.random.Generator, *shape: int) -> Floats:
    found, _ = np.linalg.qr(chance.normal(size=(*shape, 3, 3)))
    return found


def bodies(seed: int, *, shapes: int, scale: float, apart: float, pruned: bool) -> tuple[Pair, Frames, Frames]:
    """Two bodies in the same frames; the second one's numbers differ by about `apart`."""
    chance = np.random.default_rng(seed)
    weights = chance.dirichlet(np.ones(JOINTS), VERTICES) * (chance.random((VERTICES, JOINTS)) < 0.8) + 1e-9
    weights /= weights.sum(axis=1, keepdims=True)
    stored = weights + apart * chance.random(weights.shape)
    if pruned:
        stored[:5, 0] = 0.0
    stored /= stored.sum(axis=1, keepdims=True)
    positions, deltas = chance.normal(size=(VERTICES, 3)), 0.1 * chance.normal(size=(shapes, VERTICES, 3))

    def near(values: Floats) -> Floats:
        return values + apart * chance.normal(size=values.shape)

    matrices = np.zeros((FRAMES, JOINTS, 4, 4))
    matrices[:, :, :3, :3] = rotations(chance, FRAMES, JOINTS) * scale ** chance.uniform(-1, 1, (FRAMES, JOINTS, 1, 3))
    matrices[:, :, :3, 3] = chance.normal(size=(FRAMES, JOINTS, 3))
    matrices[:, :, 3, 3] = 1.0
    played, offsets = chance.random((FRAMES, shapes)), 0.1 * chance.normal(size=(FRAMES, 3, VERTICES))
    first, second = prepare(weights, positions, deltas), prepare(stored, near(positions), near(deltas))
    after = Frames(matrices, near(played) if shapes else played, near(offsets))
    return Pair(first, second), Frames(matrices, played, offsets), after


def all_distances(pair: Pair, before: Frames, after: Frames) -> Floats:
    def posed(skin: Skin, frames: Frames) -> Floats:
        return pose(skin, frames.matrices, frames.weights, frames.offsets)[0]

    return np.linalg.norm(posed(pair.second, after) - posed(pair.first, before), axis=1)


@given(
    seed=st.integers(0, 10_000),
    shapes=st.sampled_from([0, 2]),
    scale=st.sampled_from([1.0, 3.0]),
    apart=st.sampled_from([0.0, 1e-8, 1e-3]),
    pruned=st.booleans(),
    moved=st.sampled_from(["both", "first", "second", "none"]),
    few=st.sampled_from([0.0, 1.0]),
)
def test_the_farthest_vertex_is_that_of_all_posed(
    seed: int, shapes: int, scale: float, apart: float, pruned: bool, moved: str, few: float
) -> None:
    pair, before, after = bodies(seed, shapes=shapes, scale=scale, apart=apart, pruned=pruned)
    before = before if moved in ("both", "first") else dataclasses.replace(before, offsets=None)
    after = after if moved in ("both", "second") else dataclasses.replace(after, offsets=None)
    distances = all_distances(pair, before, after)
    slack = rounding(pair, before)
    for bounds in (bounds_of(pair, before, after), finer_bounds(pair, before, after)):
        assert (distances <= bounds + slack).all()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_FEW", few)  # with finer bounds, and without
        found, frame = farthest(pair, before, after, 0.0)
    assert found == pytest.approx(distances.max(), abs=slack)
    assert distances[frame].max() == pytest.approx(found, abs=slack)


@pytest.mark.parametrize("moved", [True, False])
@pytest.mark.parametrize("damaged", ["weights", "position", "offset", "shape", "joint"])
def test_one_damaged_number_is_found(damaged: str, moved: bool) -> None:
    """The fault is in the file's body alone, in one vertex and frame; others are right but for rounding."""
    pair, before, after = bodies(1, shapes=2, scale=1.0, apart=1e-8, pruned=False)
    if not moved:
        before, after = (dataclasses.replace(each, offsets=None) for each in (before, after))
    second, vertex, frame = pair.second, 17, 3
    weights, places, matrices = second.weights.copy(), second.places.copy(), after.matrices.copy()
    offsets = np.zeros((FRAMES, 3, VERTICES)) if after.offsets is None else after.offsets.copy()
    if damaged == "weights":
        weights[:2, vertex] += [0.01, -0.01]
    elif damaged == "position":
        places[1, 0, vertex] += 0.01
    elif damaged == "shape":
        places[1, 2, vertex] += 0.01
    elif damaged == "offset":
        offsets[frame, 2, vertex] += 0.01
    else:
        matrices[frame, 1, 0, 3] += 0.01
    pair = Pair(pair.first, Skin(weights, places, None))
    after = Frames(matrices, after.weights, offsets)
    found, at = farthest(pair, before, after, 1e-6)
    distances = all_distances(pair, before, after)
    assert distances.max() > 1e-3
    assert found == pytest.approx(distances.max(), rel=1e-9)
    assert distances[at].max() == pytest.approx(found, rel=1e-9)


def test_distances_that_are_known_are_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    pair, before, after = bodies(2, shapes=0, scale=1.0, apart=1e-8, pruned=False)

    def fail(*_: Any, **__: Any) -> Any:
        raise AssertionError("posed")

    monkeypatch.setattr(module, "pose", fail)
    assert farthest(pair, before, after, 1e-3) == (0.0, 0)


def test_only_vertices_that_may_be_farthest_are_posed(monkeypatch: pytest.MonkeyPatch) -> None:
    pair, before, after = bodies(3, shapes=0, scale=1.0, apart=1e-8, pruned=False)
    assert after.offsets is not None
    after.offsets[2, 0, 9] += 0.01
    posed = []

    def counted(skin: Skin, matrices: Floats, *rest: Any) -> Any:
        posed.append(len(matrices) * skin.weights.shape[1])
        return pose(skin, matrices, *rest)

    monkeypatch.setattr(module, "pose", counted)
    assert farthest(pair, before, after, 0.0)[1] == 2
    assert posed[2:] == [1, 1]


def test_bodies_without_vertices_are_nowhere_apart() -> None:
    nothing = prepare(np.zeros((0, 1)), np.zeros((0, 3)), np.zeros((0, 0, 3)))
    frames = Frames(np.tile(np.eye(4), (2, 1, 1, 1)), np.zeros((2, 0)), np.zeros((2, 3, 0)))
    assert farthest(Pair(nothing, nothing), frames, frames, 0.0) == (0.0, 0)
