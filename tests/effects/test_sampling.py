"""Motions sampled at more times: old weights stay, and new ones are those of the effect at these times."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.carried import carry_patch
from kit.limb import limb_asset, tool
from kit.prepared import prepare
from wrinklecli.effects.effect import Motion, Target
from wrinklecli.effects.sampling import with_times
from wrinklecli.effects.shapes import Shape
from wrinklecli.effects.wrinkle.activity import activity
from wrinklecli.effects.wrinkle.effect import WrinkleEffect, curve_weights

PREPARED = prepare(limb_asset(rings=9, sides=8), tool(bumps=2, lag={"frequency": 4, "damping": 0.4}))
CARRIED, _ = carry_patch(PREPARED)


def effect_and_motion(times: list[float]) -> tuple[WrinkleEffect, Motion]:
    """The limb's tool, and its clip sampled at sorted times of which every second is a key."""
    nothing = Shape(np.zeros(0, np.intp), np.zeros((0, 3)), 1.0, np.zeros(0, np.intp), np.zeros((0, 3)))
    count = CARRIED.patch.curve.greatest_amplitudes.size
    effect = WrinkleEffect("crease", tuple(Target(str(k), nothing) for k in range(count)), CARRIED, 0)
    at = np.array(times)
    found = activity(CARRIED.patch, PREPARED.rig, PREPARED.clip, at)
    weights = curve_weights(CARRIED.patch, PREPARED.clip, found)
    return effect, Motion(PREPARED.clip, at, np.arange(0, len(at), 2), (found,), (weights,))


MOMENTS = st.lists(st.integers(0, 200).map(lambda each: each / 100.0), min_size=2, max_size=12, unique=True)


@given(MOMENTS, st.data())
def test_weights_at_old_times_stay_and_new_ones_are_the_effect_s_own(moments: list[float], data: Any) -> None:
    fresh = data.draw(st.sets(st.sampled_from(moments), max_size=len(moments) - 1))
    old = sorted(set(moments) - fresh)
    effect, motion = effect_and_motion(old)
    more = with_times([effect], PREPARED.rig, motion, np.array(sorted(fresh)))
    assert more.times.tolist() == sorted(moments)
    assert more.times[more.keys].tolist() == motion.times[motion.keys].tolist()
    kept = np.searchsorted(more.times, motion.times)
    assert (more.weights[0][kept] == motion.weights[0]).all()
    _, whole = effect_and_motion(sorted(moments))
    assert more.weights[0] == pytest.approx(whole.weights[0], abs=1e-12)
    assert more.states[0].distances == pytest.approx(whole.states[0].distances, abs=1e-12)
    assert more.states[0].amplitudes == pytest.approx(whole.states[0].amplitudes, abs=1e-12)


def test_states_may_wait() -> None:
    effect, motion = effect_and_motion([0.0, 1.0])
    more = with_times([effect], PREPARED.rig, motion, np.array([0.5]), states=False)
    assert more.states is motion.states
    assert with_times([effect], PREPARED.rig, motion, np.zeros(0)) is motion
