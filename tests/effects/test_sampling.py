"""Motions: a weight at a time does not depend on other times, lines between keys are right, and twins share times."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.bakes import place
from kit.limb import RADIUS, limb_asset, tool, write_tools
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.clip import KEY_GAP, Clip
from wrinklecli.effects.effect import Effect, MeshPlan, SamplingOptions, target_weights
from wrinklecli.effects.sampling import duplicates_of, motion_at, move_sizes, play, sample_effects
from wrinklecli.numeric.guard import log_progress
from wrinklecli.numeric.memory import Memory

HOW = SamplingOptions(30.0, "morph", Memory(), log_progress)
TOOLS = [
    tool(bumps=2, lag={"frequency": 4, "damping": 0.4}),
    tool(name="keyed", strategy="origin", bumps=3, rest_length={"keys": {"fold": [[0, "100%"], [1, "120%"]]}}),
    tool(name="half", origin=[-0.3, RADIUS, 0.0], target=[0.3, RADIUS, 0.0], clips={"other": 0.5}),
]


@cache
def planned() -> tuple[MeshPlan, Clip, tuple[Effect, ...]]:
    """A limb with tools of several kinds, and its effects."""
    made = limb_asset(rings=9, sides=8)
    made.append("animations", {**made.gltf["animations"][0], "name": "other"})
    asset = place(made)
    tools = write_tools(asset.with_name(f"{asset.stem}_sampling.yaml"), *TOOLS)
    job = read_job(asset, tools, BakeOptions())
    (plan,) = plan_meshes(job)
    effects, (motion, _) = sample_effects(plan, job.clips, HOW)
    return plan, motion.clip, tuple(effects)


MOMENTS = st.lists(st.integers(0, 200).map(lambda each: each / 100.0), min_size=2, max_size=12, unique=True)


@pytest.mark.slow
@given(MOMENTS, st.data())
def test_weights_at_a_time_do_not_depend_on_other_times(moments: list[float], data: st.DataObject) -> None:
    plan, clip, effects = planned()
    every = np.array(sorted(moments))
    some = np.array(sorted(data.draw(st.sets(st.sampled_from(moments), min_size=1))))
    rows = np.searchsorted(every, some)
    whole, part = (motion_at(plan, effects, clip, times, np.arange(len(times))) for times in (every, some))
    for one, other in zip(whole.weights, part.weights, strict=True):
        assert one[rows] == pytest.approx(other, abs=1e-12)
    for one, other in zip(whole.readings, part.readings, strict=True):
        assert one.distances[rows] == pytest.approx(other.distances, abs=1e-12)


@pytest.mark.slow
def test_straight_lines_between_keys_give_the_weights() -> None:
    """Lines are off by half of the bound, and 1.7 times that where roots start between two divisible times."""
    plan, clip, effects = planned()
    (motion,) = play(plan, effects, [clip], HOW)
    sizes, keys = move_sizes(plan, effects), motion.times[motion.keys]
    assert 2 < len(keys) < len(motion.times)
    assert (keys[0], keys[-1]) == (clip.start, clip.end)
    gaps = np.diff(motion.times)
    wide = gaps >= 2.0 * KEY_GAP
    between = motion.times[:-1][wide, None] + gaps[wide, None] * np.linspace(0.1, 0.9, 9)
    times = np.union1d(motion.times, between)
    exact = target_weights(motion_at(plan, effects, clip, times, np.arange(len(times))))
    for at, share in ((motion.times, 0.5), (times, 0.5 * 1.7)):
        lines = np.stack([np.interp(at, keys, column) for column in target_weights(motion)[motion.keys].T], axis=1)
        assert (np.abs(lines - exact[np.isin(times, at)]) * sizes).max() <= share * plan.max_error
    assert exact.max() > 0.5


def test_clips_of_one_motion_share_times_and_those_with_keys_of_their_own_do_not() -> None:
    plan, clip, effects = planned()
    clips = [clip, *(replace(clip, name=name) for name in ("twin", "other", "third"))]
    assert duplicates_of(plan, clips) == [0, 1, 2, 1]
    motions = play(plan, effects, clips, HOW)
    assert motions[3].times is motions[1].times
    assert (target_weights(motions[3]) == target_weights(motions[1])).all()
    assert (motions[2].weights[2] != 0).any()
    halved = motion_at(plan, effects, clips[2], motions[1].times, motions[1].keys)
    assert halved.weights[2] == pytest.approx(0.5 * motions[1].weights[2], abs=1e-12)
    # The rest length is keyed in one of the clips alone.
    assert motions[0].weights[1].max() > motions[1].weights[1].max()


def test_an_error_bound_of_its_own_counts_for_an_effect() -> None:
    plan, _, effects = planned()
    plain = move_sizes(plan, effects)
    assert plain == pytest.approx([target.shape.tallest for each in effects for target in each.targets])
    lax = [replace(effects[0], max_error=4.0 * plan.max_error), *effects[1:]]
    first = len(effects[0].targets)
    assert move_sizes(plan, lax)[:first] == pytest.approx(0.25 * plain[:first])
    assert (move_sizes(plan, lax)[first:] == plain[first:]).all()


def test_errors_of_targets_that_all_move_each_vertex_add_up() -> None:
    plan, _, effects = planned()
    projected = replace(effects[1], projected=(np.zeros(0, np.intp), lambda _clip, times: np.zeros((len(times), 0, 3))))
    count = len(effects[1].targets)
    assert count > 1
    assert move_sizes(plan, [projected]) == pytest.approx(count * move_sizes(plan, [effects[1]]))


def test_weights_up_to_the_least_are_left_out_but_in_the_proof() -> None:
    plan, clip, effects = planned()
    (motion,) = play(plan, effects[1:2], [clip], HOW)
    (weights,), (reading,) = motion.weights, motion.readings
    fewer = replace(effects[1], least=0.25)
    found, small = fewer.weights(clip, reading), np.abs(weights) <= 0.25
    assert weights[small].any()
    assert not found[small].any()
    assert (found[~small] == weights[~small]).all()
    assert (fewer.weights(clip, reading, exact=True) == effects[1].weights(clip, reading, exact=True)).all()


def test_frames_are_the_grid_alone() -> None:
    plan, clip, effects = planned()
    (motion,) = play(plan, effects, [clip], replace(HOW, mode="frames", fps=10.0))
    assert motion.times == pytest.approx(np.linspace(0.0, 2.0, 21), abs=1e-6)
    assert motion.keys.tolist() == list(range(21))
