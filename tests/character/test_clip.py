"""Clips: channels against formulas written out here, grids of times, and what is malformed."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit.asset import Asset, Interpolation
from kit.limb import limb_asset
from kit.pointers import add_pointer, by_pointers
from kit.prepared import as_document, limb, rotation_matrix
from wrinklecli.character.clip import KEY_GAP, Channel, Clip, clip_grid, linear_keys, read_clips, sample
from wrinklecli.character.pose import morph_weights
from wrinklecli.character.rig import read_rig
from wrinklecli.errors import AssetError, TooMuchError
from wrinklecli.numeric.memory import Memory

Floats = NDArray[np.float64]
KEYS = np.array([0.5, 1.0, 2.5, 2.75])
TIMES = np.concatenate([np.linspace(-0.5, 4.0, 91), KEYS])


def stored(times: Any) -> Floats:
    return np.asarray(times).astype(np.float32).astype(np.float64)


def channel(values: Any, interpolation: str, *, path: str = "translation", keys: Floats = KEYS) -> Channel:
    return Channel(0, 0, path, keys, np.asarray(values, np.float64), interpolation)


def between(time: float) -> int | None:
    """The key before a time, None outside the keys."""
    return next((k for k, (low, high) in enumerate(pairwise(KEYS)) if low <= time < high), None)


def test_linear() -> None:
    values = np.random.default_rng(1).normal(size=(4, 3))
    wanted = np.stack([np.interp(TIMES, KEYS, column) for column in values.T], axis=1)
    assert sample(channel(values, "LINEAR"), TIMES) == pytest.approx(wanted, abs=1e-14)


def test_step_holds_each_key_until_the_next_exactly() -> None:
    values = np.arange(12.0).reshape(4, 3)
    times = np.concatenate([TIMES, np.nextafter(KEYS, -np.inf)])
    wanted = [values[max(int((time >= KEYS).sum()) - 1, 0)] for time in times]
    assert np.array_equal(sample(channel(values, "STEP"), times), wanted)


def test_cubicspline() -> None:
    values = np.random.default_rng(2).normal(size=(4, 3, 5))
    result = sample(channel(values, "CUBICSPLINE", path="weights"), TIMES)
    for time, row in zip(TIMES, result, strict=True):
        k = between(time)
        if k is None:
            wanted = values[0, 1] if time < KEYS[0] else values[-1, 1]
        else:
            # glTF 2.0, appendix C.5, as it is printed there.
            td = KEYS[k + 1] - KEYS[k]
            t = (time - KEYS[k]) / td
            wanted = (
                (2 * t**3 - 3 * t**2 + 1) * values[k, 1]
                + td * (t**3 - 2 * t**2 + t) * values[k, 2]
                + (-2 * t**3 + 3 * t**2) * values[k + 1, 1]
                + td * (t**3 - t**2) * values[k + 1, 0]
            )
        assert row == pytest.approx(wanted, abs=1e-13)


@pytest.mark.parametrize("degrees", [0.0, 1e-6, 1e-3, 30.0, 179.0, 181.0, 300.0, 359.9999])
def test_slerp_turns_evenly_the_short_way(degrees: float) -> None:
    axis = np.array([1.0, 2.0, -2.0]) / 3.0
    half = np.radians(degrees) / 2
    values = [[0, 0, 0, 1], [*(np.sin(half) * axis), np.cos(half)]]
    turn = (degrees + 180.0) % 360.0 - 180.0
    shares = np.linspace(0.0, 1.0, 9)
    result = sample(channel(values, "LINEAR", path="rotation", keys=np.array([0.0, 1.0])), shares)
    for share, quaternion in zip(shares, result, strict=True):
        h = np.radians(turn * share) / 2
        wanted = rotation_matrix([*(np.sin(h) * axis), np.cos(h)])
        assert rotation_matrix(quaternion) == pytest.approx(wanted, abs=1e-12)
        assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-15)


def test_slerp_of_keys_that_are_not_unit_is_that_of_their_directions() -> None:
    values = np.random.default_rng(3).normal(size=(4, 4))
    unit = values / np.linalg.norm(values, axis=1, keepdims=True)
    one, other = (sample(channel(v, "LINEAR", path="rotation"), TIMES) for v in (values * 0.3, unit))
    assert one == pytest.approx(other, abs=1e-14)


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
@pytest.mark.parametrize("path", ["translation", "rotation"])
def test_held_before_the_first_and_after_the_last_key(interpolation: str, path: str) -> None:
    width = 4 if path == "rotation" else 3
    shape = (4, 3, width) if interpolation == "CUBICSPLINE" else (4, width)
    values = np.random.default_rng(4).normal(size=shape)
    moved = channel(values, interpolation, path=path)
    first, at_first, at_last, last = sample(moved, np.array([-9.0, KEYS[0], KEYS[-1], 99.0]))
    assert np.array_equal(first, at_first)
    assert np.array_equal(last, at_last)


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_single_key_holds_for_ever(interpolation: str) -> None:
    values = np.array([[[9.0, 9.0, 9.0], [1.0, 2.0, 3.0], [9.0, 9.0, 9.0]]])
    moved = channel(values if interpolation == "CUBICSPLINE" else values[:, 1], interpolation, keys=KEYS[:1])
    assert np.array_equal(sample(moved, TIMES), np.tile([1.0, 2.0, 3.0], (len(TIMES), 1)))


def test_clips_of_one_name_and_of_none_are_told_apart() -> None:
    asset = limb_asset(rings=3, sides=4)
    (animation,) = asset.gltf["animations"]
    unnamed = {key: value for key, value in animation.items() if key != "name"}
    asset.gltf["animations"] = [animation, unnamed, animation, {"name": "empty", "channels": [], "samplers": []}]
    clips = read_clips(as_document(asset))
    assert [clip.name for clip in clips] == ["fold", "animation_1", "fold#2"]
    assert [clip.index for clip in clips] == [0, 1, 2]
    assert (clips[0].start, clips[0].end) == (0.0, 2.0)


def test_channels_of_extensions_are_left_out() -> None:
    asset = limb_asset(rings=3, sides=4)
    pointer = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/materials/0"}}}
    asset.gltf["animations"][0]["channels"] += [{"sampler": 0, "target": pointer}, {"sampler": 0, "target": {}}]
    (clip,) = read_clips(as_document(asset))
    assert [(c.index, c.node, c.path) for c in clip.channels] == [(0, 2, "rotation")]


@pytest.mark.parametrize("weights", ["nodes", "meshes"])
@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
def test_pointers_at_nodes_are_read_as_their_channels(interpolation: Interpolation, weights: str) -> None:
    asset = limb_asset(rings=3, sides=4, morphs=2, morph_clip=interpolation, interpolation=interpolation)
    (plain,) = read_clips(as_document(asset))
    (pointed,) = read_clips(as_document(by_pointers(asset, weights=weights)))
    assert plain.moves_as(pointed)
    assert [channel.index for channel in plain.channels] == [channel.index for channel in pointed.channels]


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP", "CUBICSPLINE"])
@pytest.mark.parametrize("path", ["translation", "rotation", "scale", "weights"])
def test_keys_before_the_start_of_players_give_way_to_one_at_0(path: str, interpolation: Interpolation) -> None:
    rng = np.random.default_rng(5)
    width = {"rotation": 4, "weights": 2}.get(path, 3)
    values = rng.uniform(-1, 1, (5, 3, width) if interpolation == "CUBICSPLINE" else (5, width))
    for keys in ([-1.0, -0.25, 0.5, 1.0, 2.0], [-2.0, -1.0, 0.0, 0.5, 1.0], [-5.0, -4.0, -3.0, -2.0, -1.0]):
        asset = limb_asset(rings=3, sides=4, morphs=2, clip=None)
        moved: dict[str, Any] = {}
        asset.channel(moved, 0 if path == "weights" else 2, path, keys, values, interpolation)
        asset.append("animations", moved)
        (clip,) = read_clips(as_document(asset))
        assert clip.early
        assert clip.start == 0.0
        at = np.concatenate([np.linspace(0.0, 2.5, 41), [each for each in keys if each >= 0.0]])
        wanted = channel(stored(values), interpolation, path=path, keys=np.array(keys))
        assert sample(clip.channels[0], at) == pytest.approx(sample(wanted, at), abs=1e-9)


KINDS: list[Interpolation] = ["LINEAR", "STEP", "CUBICSPLINE"]


@pytest.mark.parametrize("first", KINDS)
@pytest.mark.parametrize("second", KINDS)
def test_single_weights_move_as_each_does_alone(first: Interpolation, second: Interpolation) -> None:
    rng = np.random.default_rng(3)
    asset = limb_asset(rings=3, sides=4, morphs=3, weights_at="mesh")
    alone = []
    for number, kind, times in ((0, first, KEYS), (2, second, np.array([0.0, 1.0, 1.5, 4.0]))):
        values = rng.uniform(0, 1, (4, 3) if kind == "CUBICSPLINE" else 4)
        add_pointer(asset, f"/nodes/0/weights/{number}", times, values, kind)
        alone.append(channel(stored(values).reshape(*values.shape, 1), kind, path="weights", keys=times))
    document = as_document(asset)
    (clip,) = read_clips(document)
    joined = clip.channel(0, "weights")
    assert joined is not None
    assert joined.interpolation == (
        first if first == second else "CUBICSPLINE" if "CUBICSPLINE" in (first, second) else "LINEAR"
    )
    # But for the millisecond before each jump in which straight lines cross over.
    steps = [each for each in alone if each.interpolation == "STEP" and joined.interpolation != "STEP"]
    jumps = np.concatenate([np.zeros(0), *(each.times for each in steps)])
    at = TIMES[~((TIMES[:, None] > jumps - 1.1 * KEY_GAP) & (TIMES[:, None] < jumps)).any(axis=1)]
    played = sample(joined, at)
    assert played[:, 0] == pytest.approx(sample(alone[0], at)[:, 0], abs=1e-6)
    assert played[:, 2] == pytest.approx(sample(alone[1], at)[:, 0], abs=1e-6)
    assert (played[:, 1] == read_rig(document, 0).morph_weights[1]).all()


def test_weights_of_the_node_go_before_those_of_its_mesh() -> None:
    asset = limb_asset(rings=3, sides=4, morphs=2)
    add_pointer(asset, "/nodes/0/weights/1", [0.0, 1.0], [0.5, 0.75])
    add_pointer(asset, "/meshes/0/weights", [0.0, 2.0], np.array([[0.0, 1.0], [1.0, 1.0]]))
    (clip,) = read_clips(as_document(asset))
    joined = clip.channel(0, "weights")
    assert joined is not None
    assert sample(joined, np.array([0.0, 1.0, 2.0])) == pytest.approx(np.array([[0, 0.5], [0.5, 0.75], [1, 0.75]]))


def test_weights_of_a_mesh_move_each_node_that_shows_it() -> None:
    asset = limb_asset(rings=3, sides=4, morphs=2, morph_clip="LINEAR")
    shown = [{"name": "copy", "mesh": 0, "skin": 0}, {"name": "held", "mesh": 0, "skin": 0, "weights": [0.0, 0.0]}]
    copy, held = (asset.append("nodes", node) for node in shown)
    (clip,) = read_clips(as_document(by_pointers(asset, weights="meshes")))
    first, second = clip.channel(0, "weights"), clip.channel(copy, "weights")
    assert first is not None
    assert second is not None
    assert np.array_equal(first.values, second.values)
    assert clip.channel(held, "weights") is None


def test_pointers_at_a_mesh_of_many_nodes_take_bounded_memory() -> None:
    asset = limb_asset(rings=3, sides=4, morphs=2, morph_clip="LINEAR")
    asset.gltf["nodes"] += [{"mesh": 0, "skin": 0} for _ in range(300)]
    document = as_document(by_pointers(asset, weights="meshes"))
    (clip,) = read_clips(document)
    assert sum(channel.path == "weights" for channel in clip.channels) == 301
    with pytest.raises(TooMuchError, match="weights of nodes that show one mesh"):
        read_clips(replace(document, memory=Memory(100_000)))


def test_a_malformed_pointer_at_weights_is_refused_as_a_channel_is() -> None:
    asset = limb_asset(rings=3, sides=4, morphs=2)
    add_pointer(asset, "/meshes/0/weights", [0.0, 1.0, 2.0], [0.0, 1.0, 0.0])
    with pytest.raises(AssetError, match="channels/1: a key of weights has 1 numbers, not 2"):
        read_clips(as_document(asset))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sampler": 9}, "no sampler"),
        ({"sampler": -1}, "is -1"),
        ({"sampler": None}, "is None"),
        ({"target": {"node": 99, "path": "rotation"}}, "refers to nodes.99."),
        ({"target": {"node": 2, "path": "translation"}}, "a key of translation has 4 numbers"),
    ],
)
def test_malformed_channel_is_refused(change: dict[str, Any], message: str) -> None:
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["animations"][0]["channels"][0] |= change
    with pytest.raises(AssetError, match=rf"limb\.glb#/animations/0.*{message}"):
        read_clips(as_document(asset))


@pytest.mark.parametrize(
    ("times", "values", "interpolation", "message"),
    [
        ([0, 1, 1], np.ones((3, 4)), "LINEAR", "key times must rise"),
        ([0, 2, 1], np.ones((3, 4)), "LINEAR", "key times must rise"),
        ([0, np.nan], np.ones((2, 4)), "LINEAR", "key times must rise"),
        ([0, 1, 2], np.ones((4, 4)), "LINEAR", "3 key times do not fit 16 values"),
        ([0, 1], np.ones((2, 4)), "CUBICSPLINE", "2 key times do not fit 8 values"),
        ([0, 1], np.full((2, 4), np.inf), "LINEAR", "not a finite number"),
        ([0, 1], np.ones((2, 4)), "SMOOTH", "'SMOOTH' is not of glTF 2.0"),
    ],
)
def test_malformed_sampler_is_refused(times: Any, values: Any, interpolation: Any, message: str) -> None:
    asset = Asset({"asset": {"version": "2.0"}, "nodes": [{}]})
    animation: dict[str, Any] = {}
    asset.channel(animation, 0, "rotation", np.array(times, np.float32), values, interpolation)
    asset.append("animations", animation)
    with pytest.raises(AssetError, match=f"#/animations/0/channels/0: .*{message}"):
        sample(read_clips(as_document(asset))[0].channels[0], TIMES)


def test_clip_that_animates_another_number_of_weights_is_refused() -> None:
    asset = limb_asset(rings=3, sides=4, morphs=2, morph_clip="LINEAR", clip=None)
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["targets"].pop()
    document = as_document(asset)
    with pytest.raises(AssetError, match=r"animations/0.* 2 "):
        morph_weights(read_rig(document, 0), read_clips(document)[0], np.zeros(1))


@pytest.mark.parametrize("fps", [0.1, 1.0, 24.0, 29.97, 1000.0])
def test_grid_begins_and_ends_with_the_clip_and_takes_its_keys(fps: float) -> None:
    rig, clip = limb(morphs=1, morph_clip="LINEAR")
    times = clip_grid(clip, rig, fps=fps)
    assert (np.diff(times) > 0).all()
    assert times[0] == 0.0
    assert times[-1] == 2.0
    keys = stored([0.0, 0.3, 0.7, 1.0, 1.5, 2.0])
    assert np.isin(keys, times).all()
    frames = stored(np.arange(int(2 * fps) + 1) / fps)
    apart = np.abs(frames[:, None] - keys).min(axis=1)
    assert np.isin(frames[apart >= KEY_GAP], times).all()
    # Rounded to float32 values, which are 1.2e-7 apart.
    assert np.diff(times).min() >= KEY_GAP - 3e-7
    assert np.diff(times).max() <= 1 / fps + KEY_GAP
    assert len(clip_grid(clip, None, fps=fps)) <= int(2 * fps) + 2


def test_grid_of_a_clip_that_does_not_begin_at_0() -> None:
    _, clip = limb()
    late = replace(clip, start=5.25, end=5.25 + 2 / 3)
    times = clip_grid(late, None, fps=3)
    assert times == pytest.approx([5.25, 5.25 + 1 / 3, 5.25 + 2 / 3], abs=1e-6)


def test_jumps_are_keyed_on_both_sides() -> None:
    rig, clip = limb(interpolation="STEP")
    times = clip_grid(clip, rig, fps=1)
    assert times == pytest.approx([0.0, 0.999, 1.0, 1.999, 2.0], abs=3e-7)
    assert np.diff(times).min() >= KEY_GAP


@given(
    st.lists(st.floats(0.0, 0.02), min_size=1, max_size=9, unique=True),
    st.lists(st.floats(0.0, 0.02), max_size=9, unique=True),
    st.sampled_from(["LINEAR", "STEP"]),
)
def test_times_are_apart_but_for_keys_of_own_weights(others: list[float], own: list[float], kind: str) -> None:
    rig, clip = limb(morphs=1, clip=None, morph_clip="LINEAR")
    channels = []
    for path, keys in (("translation", others), ("weights", own)):
        times = np.unique(stored(keys))
        if len(times):
            channels.append(Channel(0, rig.node, path, times, np.zeros((len(times), 1)), kind))
    shortest = replace(clip, channels=tuple(channels), start=0.0, end=0.02)
    times = clip_grid(shortest, rig, fps=300)
    ends = stored([0.0, 0.02])
    kept = np.unique(np.concatenate([ends, *(linear_keys(each) for each in channels if each.path == "weights")]))
    assert np.isin(kept, times).all()
    # A thousandth less is taken for the same: times are rounded.
    close = np.diff(times) < 0.999 * KEY_GAP
    assert np.isin(times[:-1][close], kept).all()
    assert np.isin(times[1:][close], kept).all()
    # Nothing is far from where it was asked for.
    assert np.abs(np.unique(stored(others))[:, None] - times).min(axis=1).max() < KEY_GAP


def test_linear_keys_of_steps_play_them_but_for_a_millisecond() -> None:
    times = stored([0.0, 0.5, 0.5015, 1.0])
    channel = Channel(0, 0, "weights", times, np.array([[0.0], [1.0], [0.25], [0.5]]), "STEP")
    keys = linear_keys(channel)
    assert np.isin(times, keys).all()
    # None before the third key: it would be closer than a millisecond to the second.
    assert len(keys) == 6
    assert np.diff(keys).min() >= KEY_GAP
    assert sample(channel, keys)[:, 0].tolist() == [0.0, 0.0, 1.0, 0.25, 0.25, 0.5]
    assert np.array_equal(linear_keys(replace(channel, interpolation="LINEAR")), times)


def test_clips_of_the_same_motion_have_one_digest() -> None:
    values = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    channel = Channel(0, 1, "translation", np.array([0.0, 1.0]), values, "STEP")

    def clip(*channels: Channel) -> Clip:
        return Clip(0, "", channels, 0.0, 1.0)

    assert clip(channel).moves_as(clip(replace(channel, index=3, values=values * [1.0, -1.0, 1.0])))
    others = [
        replace(channel, node=2),
        replace(channel, path="scale"),
        replace(channel, interpolation="LINEAR"),
        replace(channel, times=np.array([0.0, 2.0])),
        replace(channel, values=-values),
        replace(channel, values=values.reshape(-1, 1), times=np.arange(6.0)),
    ]
    assert not any(clip(channel).moves_as(clip(each)) for each in others)
    assert not clip(channel, others[0]).moves_as(clip(channel))


@pytest.mark.parametrize(
    ("path", "interpolation", "values", "held"),
    [
        ("translation", "LINEAR", np.tile([1.0, -0.0, 3.0], (4, 1)), True),
        ("scale", "STEP", np.ones((4, 3)), True),
        ("translation", "LINEAR", np.eye(4, 3), False),
        # Tangents move it between equal keys, and normalised rotations differ in the last digit.
        ("translation", "CUBICSPLINE", np.ones((4, 3, 3)), False),
        ("rotation", "LINEAR", np.tile([0.0, 0.6, 0.0, 0.8], (4, 1)), False),
    ],
)
def test_held_values_are_the_samples_to_the_bit(path: str, interpolation: str, values: Floats, held: bool) -> None:
    each = channel(values, interpolation, path=path)
    found = Clip(0, "clip", (each,), KEYS[0], KEYS[-1]).held
    assert list(found) == ([(0, path)] if held else [])
    for value in found.values():
        assert sample(each, TIMES).tobytes() == np.tile(value, (len(TIMES), 1)).tobytes()


@pytest.mark.parametrize(
    ("ends", "loops"),
    [
        ([], True),
        ([("translation", [0.0, 0.0, 0.0], [5.0, 0.0, 0.0])], True),
        ([("rotation", [0.0, 0.6, 0.0, 0.8], [0.0, -0.6, 0.0, -0.8])], True),
        ([("rotation", [0.0, 0.6, 0.0, 0.8], [0.0, -0.6, 0.0, 0.8])], False),
        ([("scale", [1.0, 1.0, 1.0], [1.0, 1.0, 1.01])], False),
        ([("weights", [0.0, 1.0], [0.0, 1.0])], True),
        ([("weights", [0.0, 1.0], [0.0, 0.9])], False),
        ([("scale", [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]), ("weights", [0.0], [0.1])], False),
    ],
)
@pytest.mark.parametrize("interpolation", ["LINEAR", "CUBICSPLINE"])
def test_a_clip_loops_if_it_ends_as_it_began_wherever_it_goes(
    ends: list[tuple[str, list[float], list[float]]], loops: bool, interpolation: str
) -> None:
    channels = []
    for path, first, last in ends:
        values = np.array([first, np.full(len(first), 0.3), np.full(len(first), 0.7), last])
        # Tangents say nothing of the pose.
        keyed = np.stack([0.1 * values, values, -values], axis=1) if interpolation == "CUBICSPLINE" else values
        channels.append(channel(keyed, interpolation, path=path))
    assert Clip(0, "clip", tuple(channels), 0.0, 1.0).loops == loops
