"""No vertex of two bodies is farther apart than its bound, which is exact where their skin weights differ."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.baking.apart import Frames, Pair
from wrinklecli.character.skin import Influences, Skin, pose, prepare
from wrinklecli.numeric.arrays import Floats

FRAMES, VERTICES, JOINTS = 5, 40, 3
# Vertices whose skin weights differ if some are pruned.
PRUNED = 5


def rotations(chance: np.random.Generator, *shape: int) -> Floats:
    found, _ = np.linalg.qr(chance.normal(size=(*shape, 3, 3)))
    return found


def bodies(
    seed: int, *, shapes: int = 2, scale: float = 1.0, apart: float = 1e-8, pruned: bool = False
) -> tuple[Pair, Frames, Frames]:
    """Two bodies in the same frames; the second one's numbers differ by about `apart`."""
    chance = np.random.default_rng(seed)
    weights = chance.dirichlet(np.ones(JOINTS), VERTICES) * (chance.random((VERTICES, JOINTS)) < 0.8) + 1e-9
    weights /= weights.sum(axis=1, keepdims=True)
    stored = weights + apart * chance.random(weights.shape)
    if pruned:
        stored[:PRUNED, 0] = 0.0
    stored /= stored.sum(axis=1, keepdims=True)
    positions, deltas = chance.normal(size=(VERTICES, 3)), 0.1 * chance.normal(size=(shapes, VERTICES, 3))

    def near(values: Floats) -> Floats:
        return values + apart * chance.normal(size=values.shape)

    matrices = np.zeros((FRAMES, JOINTS, 4, 4))
    matrices[:, :, :3, :3] = rotations(chance, FRAMES, JOINTS) * scale ** chance.uniform(-1, 1, (FRAMES, JOINTS, 1, 3))
    matrices[:, :, :3, 3] = chance.normal(size=(FRAMES, JOINTS, 3))
    matrices[:, :, 3, 3] = 1.0
    played, offsets = chance.random((FRAMES, shapes)), 0.1 * chance.normal(size=(FRAMES, 3, VERTICES))
    first, second = (
        prepare(Influences.of(weights), positions, deltas),
        prepare(Influences.of(stored), near(positions), near(deltas)),
    )
    after = Frames(matrices, near(played) if shapes else played, near(offsets))
    return Pair(first, second), Frames(matrices, played, offsets), after


def all_distances(pair: Pair, before: Frames, after: Frames) -> Floats:
    """(frames, vertices) distances in world space."""

    def posed(skin: Skin, frames: Frames) -> Floats:
        return pose(skin, frames.matrices, frames.weights, frames.offsets)[0]

    return np.linalg.norm(posed(pair.second, after) - posed(pair.first, before), axis=1)


def differing(pair: Pair) -> np.ndarray:
    """(vertices,) True where skin weights differ by more than those that float32 rounds."""
    return np.abs(pair.second.influences.dense() - pair.first.influences.dense()).sum(axis=0) > 1e-6


@given(
    seed=st.integers(0, 10_000),
    shapes=st.sampled_from([0, 2]),
    scale=st.sampled_from([1.0, 3.0]),
    apart=st.sampled_from([0.0, 1e-8, 1e-3]),
    pruned=st.booleans(),
    moved=st.sampled_from(["both", "first", "second", "none"]),
    still=st.booleans(),
)
def test_no_distance_exceeds_its_bound(
    seed: int, shapes: int, scale: float, apart: float, pruned: bool, moved: str, still: bool
) -> None:
    pair, before, after = bodies(seed, shapes=shapes, scale=scale, apart=apart, pruned=pruned)
    before = before if moved in ("both", "first") else dataclasses.replace(before, offsets=None)
    after = after if moved in ("both", "second") else dataclasses.replace(after, offsets=None)
    if not still:
        matrices = after.matrices.copy()
        matrices[2, 1, 0, 3] += apart
        after = dataclasses.replace(after, matrices=matrices)
    distances, bounds = all_distances(pair, before, after), pair.bounds(before, after)
    assert bounds.shape == (FRAMES, VERTICES)
    rounding = 1e-13 * scale * np.abs(before.matrices).max()
    assert (distances <= bounds + rounding).all()
    exact = differing(pair) if np.array_equal(before.matrices, after.matrices) else np.ones(VERTICES, bool)
    assert bounds[:, exact] == pytest.approx(distances[:, exact], abs=rounding)
    if pruned:
        assert exact[:PRUNED].any()


@given(seed=st.integers(0, 10_000))
def test_bodies_that_are_the_same_are_nowhere_apart(seed: int) -> None:
    pair, before, _ = bodies(seed, apart=0.0)
    same = Pair(pair.first, pair.first)
    assert not same.bounds(before, before).any()


@given(seed=st.integers(0, 10_000), apart=st.sampled_from([1e-6, 1e-3]))
def test_under_one_joint_that_stretches_nothing_the_bound_of_a_shape_is_its_move(seed: int, apart: float) -> None:
    """The bound is tight: it is the distance wherever all joints turn alike, and no skin weight differs."""
    pair, before, after = bodies(seed, apart=apart)
    pair = Pair(pair.first, dataclasses.replace(pair.second, influences=pair.first.influences))
    pair = Pair(pair.first, dataclasses.replace(pair.second, places=pair.first.places))
    matrices = np.repeat(before.matrices[:, :1], JOINTS, axis=1)
    before, after = (dataclasses.replace(each, matrices=matrices) for each in (before, after))
    distances = all_distances(pair, before, after)
    factors = pair.bounds(before, after) / distances
    # A turn's matrix times its transpose has sums of rows of 1 but for rounding.
    assert factors == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("moved", [True, False])
@pytest.mark.parametrize("damaged", ["weights", "position", "offset", "shape", "joint"])
def test_one_damaged_number_is_found(damaged: str, moved: bool) -> None:
    """The fault is in the file's body alone, in one vertex and frame; others are right but for rounding."""
    pair, before, after = bodies(1)
    if not moved:
        before, after = (dataclasses.replace(each, offsets=None) for each in (before, after))
    second, vertex, frame = pair.second, 17, 3
    weights, places, matrices = second.influences.dense(), second.places.copy(), after.matrices.copy()
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
    pair = Pair(pair.first, Skin(Influences.of(weights.T), places, None))
    after = Frames(matrices, after.weights, offsets)
    bounds, distances = pair.bounds(before, after), all_distances(pair, before, after)
    assert distances.max() > 1e-3
    assert (distances <= bounds + 1e-12).all()
    if damaged != "joint":
        assert bounds.max(axis=0).argmax() == vertex
    # Rounded matrices of turns have factors a little above 1, and mixed ones shorten.
    assert bounds.max() < 4 * distances.max()
    # What is right but for rounding does not hide a fault.
    others = np.delete(bounds, vertex, axis=1) if damaged != "joint" else np.delete(bounds, frame, axis=0)
    assert damaged == "joint" or others.max() < 1e-5


def test_bodies_without_vertices_are_nowhere_apart() -> None:
    nothing = prepare(Influences.of(np.zeros((0, 1))), np.zeros((0, 3)), np.zeros((0, 0, 3)))
    frames = Frames(np.tile(np.eye(4), (2, 1, 1, 1)), np.zeros((2, 0)), np.zeros((2, 3, 0)))
    assert Pair(nothing, nothing).bounds(frames, frames).shape == (2, 0)
