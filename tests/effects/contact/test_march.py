"""Contact by property: a tube that folds through itself touches, never crosses, and moves nowhere else."""

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from wrinklecli.numeric.intersections import Crossings

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.bent_tube import SIDES, bent, tube
from wrinklecli.effects.contact import march as march_module
from wrinklecli.effects.contact.march import _direction, _energy, march
from wrinklecli.effects.contact.tissue import FREE, SOFT, SkinnedPose, SolverState, Tissue


def test_what_differs_by_rounding_is_not_moved() -> None:
    """Processors round otherwise: which poses touch, and so all shapes, would depend on them."""
    posed = SkinnedPose(np.ones((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    moves = np.array([[1e-12, 0.0, -1e-15], [1e-12, 0.5, 0.0]])
    assert (SolverState(posed.positions + moves, posed).correction == [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]]).all()


@pytest.mark.slow
@pytest.mark.long
@settings(max_examples=2, phases=[Phase.explicit, Phase.generate])
@given(radius=st.floats(40, 80), width=st.floats(50, 150), bump=st.floats(0, 6))
@example(radius=76.72348742133249, width=83.99595266258446, bump=5.545185716566744)  # flat: edges in a triangle's plane
@example(radius=50.0, width=50.0, bump=5.136912376636445)  # a step that rounds: it moved what is not free by 2e-15
def test_a_folded_tube_touches_and_never_crosses(radius: float, width: float, bump: float) -> None:
    import ipctk

    rest, triangles = tube(radius)
    poses = [bent(rest, angle, width, bump) for angle in np.radians(np.arange(0.0, 91.0, 6.0))]
    crossings = Crossings.of(rest, triangles)
    marked = np.zeros(len(rest), bool)
    for posed in poses:
        _, through = crossings.at(posed.positions)
        marked[triangles[through]] = True
    near = np.abs(rest[:, 0]) < np.abs(rest[marked, 0]).max(initial=0.0) + FREE * SOFT
    free = near & (np.arange(len(rest)) >= SIDES) & (np.arange(len(rest)) < len(rest) - SIDES)
    apart = np.abs(rest[:, 0]) - np.abs(rest[marked, 0]).max(initial=0.0)

    def tissue_of() -> Tissue:
        return Tissue(rest, triangles, np.ones(len(triangles), bool), free, np.ones(len(rest), bool), apart.clip(0.0))

    tissue = tissue_of()
    first = None
    for number, (posed, state) in enumerate(zip(poses, march(tissue, poses), strict=True)):
        assert not ipctk.has_intersections(tissue.mesh, tissue.placed(state.positions))
        # A pose that contact leaves alone may have edges in the plane of a triangle: rounding decides on which side.
        assert not state.correction.any() or not len(crossings.at(state.positions)[0])
        assert not state.correction[~free].any()
        first = number if first is None and len(crossings.at(posed.positions)[0]) else first
        if state.converged and tissue.is_clear(posed.positions):
            # Where nothing touches, all vertices are where the pose wants them.
            assert np.abs(state.correction).max() < 0.1
    assert marked.any() == (first is not None)
    # A second march gives the same bits.
    again = list(march(tissue_of(), poses[: (first or 0) + 2]))
    same = list(march(tissue, poses[: (first or 0) + 2]))
    assert np.array_equal(again[-1].positions, same[-1].positions)


@pytest.mark.quick(1)
def test_a_short_whole_step_ends_a_pose_where_further_steps_would_end_it(monkeypatch: pytest.MonkeyPatch) -> None:
    rest, triangles = tube(50.0)
    poses = [bent(rest, angle, 80.0, 3.0) for angle in np.radians(np.arange(0.0, 91.0, 6.0))]
    free = (np.arange(len(rest)) >= SIDES) & (np.arange(len(rest)) < len(rest) - SIDES)
    every, apart = np.ones(len(triangles), bool), np.zeros(len(rest))

    tissue = Tissue(rest, triangles, every, free, np.ones(len(rest), bool), apart)

    def marched(followed: float) -> tuple[int, list[float]]:
        monkeypatch.setattr(march_module, "_FOLLOWED", followed)
        steps, energies = 0, []
        for state in march(tissue, poses):
            assert state.converged
            steps += state.steps
            volumes = tissue.pieces.volumes(state.posed.positions)
            near = tissue.collisions(state.positions)
            energies.append(_energy(tissue, state.positions, state.posed, volumes, near))
        return steps, energies

    (steps, energies), (most_steps, least_energies) = marched(march_module._FOLLOWED), marched(0.0)
    assert steps < most_steps
    # The barrier's own energy differs by a few per cent.
    assert sum(energies) < 1.1 * sum(least_energies)


@pytest.mark.slow
@settings(max_examples=2, phases=[Phase.generate])
@given(radius=st.floats(40, 70), gap=st.floats(5, 8), angle=st.floats(26, 40), bump=st.floats(20, 30))
def test_a_tube_stays_in_a_sleeve_that_bends_with_it(radius: float, gap: float, angle: float, bump: float) -> None:
    rest, triangles = tube(radius)
    count = len(rest)
    places, through = np.concatenate([rest, tube(radius + gap)[0]]), np.concatenate([triangles, triangles + count])
    own = np.arange(2 * count) < count
    turns = np.radians(np.arange(0.0, angle, 5.0))
    poses = [_within(places, own, turn, bump) for turn in turns]
    crossings = Crossings.of(places, through)
    marked = np.zeros(2 * count, bool)
    for posed in poses:
        marked |= _crossing(crossings, own, posed.positions)
    apart = np.abs(places[:, 0]) - np.abs(places[marked & own, 0]).max(initial=0.0)
    free = (apart < FREE * SOFT) & (np.abs(places[:, 0]) < places[:, 0].max())
    states = [
        list(march(Tissue(places, through, np.ones(len(through), bool), free, own, apart.clip(0.0)), poses))
        for _ in range(2)
    ]
    assert marked.any()
    assert not states[0][0].correction.any()
    for state, again in zip(*states, strict=True):
        # The sleeve is where its skin puts it.
        shown = np.where(own[:, None], state.positions, state.posed.positions)
        assert not _crossing(crossings, own, shown).any()
        assert np.abs(state.correction[~free]).max() < 1e-6
        assert np.array_equal(state.positions, again.positions)


@pytest.mark.slow
def test_the_slope_of_a_step_is_the_derivative_of_the_energy() -> None:
    """Elastic, volume and barrier terms: each of them and its gradient, where the surface touches itself."""
    rest, triangles = tube(60.0)
    poses = [bent(rest, turn, 60.0, 0.0) for turn in np.radians(np.arange(0.0, 91.0, 15.0))]
    free = np.abs(rest[:, 0]) < rest[:, 0].max()
    apart = (np.abs(rest[:, 0]) - 60.0).clip(0.0)
    tissue = Tissue(rest, triangles, np.ones(len(triangles), bool), free, np.ones(len(rest), bool), apart)
    *_, state = march(tissue, poses)
    assert tissue.is_clear(rest)
    assert state.near is not None
    assert not tissue.is_clear(state.positions)
    posed = bent(rest, np.radians(95.0), 60.0, 0.0)
    assert not tissue.is_clear(posed.positions)
    positions = state.positions + np.where(free, 0.05, 0.0)[:, None] * np.sin(np.arange(3 * len(rest)).reshape(-1, 3))
    near, volumes = tissue.collisions(positions), tissue.pieces.volumes(posed.positions)
    direction, slope = _direction(tissue, tissue.response(), positions, posed, volumes, near)
    step = 1e-5 / np.abs(direction).max()
    ahead, behind = (
        _energy(tissue, there, posed, volumes, tissue.collisions(there))
        for there in (positions + step * direction, positions - step * direction)
    )
    assert slope < 0
    assert (ahead - behind) / (2.0 * step) == pytest.approx(slope, rel=1e-4)


@pytest.mark.slow
def test_the_ends_of_a_limb_get_to_their_pose_in_few_steps() -> None:
    """They move by 20 units and more, with nothing in their way."""
    rest, triangles = tube(60.0)
    poses = [bent(rest, turn, 60.0, 0.0) for turn in np.radians(np.arange(0.0, 91.0, 6.0))]
    free = np.abs(rest[:, 0]) < rest[:, 0].max()
    apart = (np.abs(rest[:, 0]) - 60.0).clip(0.0)
    tissue = Tissue(rest, triangles, np.ones(len(triangles), bool), free, np.ones(len(rest), bool), apart)
    states = list(march(tissue, poses))
    assert all(state.converged for state in states)
    touching = [state.steps for state in states if state.near is not None]
    assert np.median(touching) <= 5  # 7 if no vertex moves by more than 4 units in a step


@pytest.mark.slow
def test_what_cannot_collide_is_not_in_the_way() -> None:
    """Another limb of the same mesh folds through itself: its vertices belong to no triangle that collides."""
    rest, triangles = tube(60.0)
    count = len(rest)
    turns = np.radians(np.arange(0.0, 91.0, 15.0))
    poses = [bent(rest, turn, 60.0, 0.0) for turn in turns]
    through = np.unique(triangles[Crossings.of(rest, triangles).at(poses[-1].positions)[1]])
    apart = (np.abs(rest[:, 0]) - np.abs(rest[through, 0]).max()).clip(0.0)
    free = (apart < FREE * SOFT) & (np.abs(rest[:, 0]) < rest[:, 0].max())
    alone = Tissue(rest, triangles, np.ones(len(triangles), bool), free, np.ones(count, bool), apart)

    def beside(places: np.ndarray, share: float) -> np.ndarray:
        return np.concatenate([places, share * rest + [0.0, 0.0, 900.0]])

    both = Tissue(
        beside(rest, 1.0),
        np.concatenate([triangles, triangles + count]),
        np.arange(2 * len(triangles)) < len(triangles),
        np.concatenate([free, np.zeros(count, bool)]),
        np.ones(2 * count, bool),
        np.concatenate([apart, np.full(count, 900.0)]),
    )
    shrunk = [
        SkinnedPose(beside(posed.positions, 1.0 - number / 6), np.concatenate([posed.matrices] * 2))
        for number, posed in enumerate(poses)
    ]
    states = list(march(both, shrunk))
    assert all(state.converged for state in states)
    assert states[-1].near is not None
    for state, other in zip(states, march(alone, poses), strict=True):
        assert state.positions[:count] == pytest.approx(other.positions, abs=0.05)


def _within(places: np.ndarray, own: np.ndarray, turn: float, bump: float) -> SkinnedPose:
    """A pose of a tube with bumps, and of a smooth tube round it."""
    inner, outer = bent(places[own], turn, 150.0, bump), bent(places[~own], turn, 150.0, 0.0)
    return SkinnedPose(*(np.concatenate(pair) for pair in zip(astuple(inner), astuple(outer), strict=True)))


def _crossing(crossings: Crossings, own: np.ndarray, positions: np.ndarray) -> np.ndarray:
    """True for vertices that take part in a crossing, other than of the sleeve with itself."""
    edges, triangles = crossings.at(positions)
    ends, corners = crossings.edges[edges], crossings.triangles[triangles]
    counts = own[ends[:, 0]] | own[corners[:, 0]]
    marked = np.zeros(len(positions), bool)
    marked[ends[counts]] = marked[corners[counts]] = True
    return marked
