"""Weight tracks: old channels play as they did, and new weights run straight."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.prepared import limb
from wrinklecli.character.clip import Channel, linear_keys, sample
from wrinklecli.character.weight_track import Track, pad, widen

Floats = NDArray[np.float64]


def stored(times: Any) -> Floats:
    return np.asarray(times).astype(np.float32).astype(np.float64)


def played(track: Track, times: Floats) -> Floats:
    """What a player shows of a written track."""
    return sample(Channel(0, 0, "weights", track.times, track.values, track.interpolation), times)


def weights_of(track: Track) -> Floats:
    return track.values[:, 1] if track.interpolation == "CUBICSPLINE" else track.values


def random_weights(rng: np.random.Generator, times: Floats) -> Floats:
    return rng.uniform(0, 1, (len(times), 2))


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
@pytest.mark.parametrize("seed", range(5))
def test_old_weights_play_as_before_and_new_ones_run_straight(interpolation: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig, clip = limb(morphs=3, morph_clip=interpolation)
    channel = clip.channel(0, "weights")
    assert channel is not None
    # New keys before, between, at and after the old ones.
    times = np.unique(stored(np.concatenate([rng.uniform(-0.2, 2.0, 12), channel.times[1:3]])))
    fresh = random_weights(rng, times)
    track = widen(channel, rig, clip, times, fresh)
    assert track.interpolation == ("CUBICSPLINE" if interpolation == "CUBICSPLINE" else "LINEAR")
    assert np.array_equal(track.times, stored(track.times))
    assert (np.diff(track.times) > 0).all()
    assert np.isin(times, track.times).all()
    assert np.isin(channel.times, track.times).all()
    at = np.concatenate([rng.uniform(-0.5, 2.5, 200), channel.times, times])
    if interpolation == "STEP":
        # But for a millisecond before each jump, in which LINEAR keys cross over.
        jumps = channel.times[1:]
        step = np.setdiff1d(linear_keys(channel), channel.times)
        assert len(step) == len(jumps)
        at = at[~((at[:, None] > step) & (at[:, None] < jumps)).any(axis=1)]
        at = np.concatenate([at, step])
    result = played(track, at)
    # Values are below 2, so this is a few roundings; splitting a cubic costs some more of them.
    assert result[:, :3] == pytest.approx(sample(channel, at), abs=1e-12)
    wanted = np.stack([np.interp(at, times, column) for column in fresh.T], axis=1)
    assert result[:, 3:] == pytest.approx(wanted, abs=1e-12)


@given(
    keys=st.lists(st.integers(0, 200), min_size=1, max_size=5, unique=True),
    fresh=st.lists(st.integers(-20, 220), min_size=1, max_size=5, unique=True),
    interpolation=st.sampled_from(["LINEAR", "STEP", "CUBICSPLINE"]),
    seed=st.integers(0, 99),
)
def test_any_keys_can_be_joined(keys: list[int], fresh: list[int], interpolation: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rig, clip = limb(morphs=1, clip=None, morph_clip="LINEAR")
    times, key_times = stored(np.sort(fresh) / 64), stored(np.sort(keys) / 64)
    shape = (len(keys), 3, 1) if interpolation == "CUBICSPLINE" else (len(keys), 1)
    channel = Channel(0, 0, "weights", key_times, rng.normal(size=shape), interpolation)
    its_clip = replace(clip, channels=(channel,))
    track = widen(channel, rig, its_clip, times, random_weights(rng, times))
    # 1/64 s apart, so that no sample falls in the millisecond before a jump.
    at = np.arange(-30, 240) / 64 + 1 / 200
    assert played(track, at)[:, :1] == pytest.approx(sample(channel, at), abs=1e-11)


def test_step_of_keys_one_float_apart() -> None:
    rig, clip = limb(morphs=1, clip=None, morph_clip="STEP")
    first = np.float32(0.5)
    times = np.array([first, np.nextafter(first, np.float32(1)), 1.0], np.float64)
    channel = Channel(0, 0, "weights", times, np.array([[0.0], [1.0], [0.25]]), "STEP")
    track = widen(channel, rig, replace(clip, channels=(channel,)), np.array([0.0, 2.0]), np.zeros((2, 1)))
    assert (np.diff(track.times) > 0).all()
    assert np.array_equal(played(track, times)[:, 0], [0.0, 1.0, 0.25])


def test_without_a_channel_old_weights_stay_as_stored() -> None:
    rig, clip = limb(morphs=2, weights_at="node")
    times = np.array([0.0, 0.5, 2.0])
    fresh = np.array([[0.0], [0.5], [1.0]])
    track = widen(None, rig, clip, times, fresh)
    assert track.interpolation == "LINEAR"
    assert np.array_equal(track.times, times)
    assert np.array_equal(track.values, [[0.5, 0.5, 0.0], [0.5, 0.5, 0.5], [0.5, 0.5, 1.0]])


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_no_new_targets_is_no_fault(interpolation: str) -> None:
    rig, clip = limb(morphs=2, morph_clip=interpolation)
    channel = clip.channel(0, "weights")
    assert channel is not None
    track = widen(channel, rig, clip, np.array([0.0, 1.0]), np.zeros((2, 0)))
    assert weights_of(track).shape == (len(track.times), 2)


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_padding_keeps_keys_and_interpolation_and_holds_new_weights(interpolation: str) -> None:
    _, clip = limb(morphs=2, morph_clip=interpolation)
    channel = clip.channel(0, "weights")
    assert channel is not None
    track = pad(channel, np.array([0.25, 0.0, 1.0]))
    assert track.interpolation == interpolation
    assert np.array_equal(track.times, channel.times)
    at = np.linspace(-0.5, 2.5, 61)
    assert np.array_equal(played(track, at)[:, :2], sample(channel, at))
    assert played(track, at)[:, 2:] == pytest.approx(np.tile([0.25, 0.0, 1.0], (61, 1)), abs=1e-15)
