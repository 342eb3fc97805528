"""Springs that follow a joint: against a fine integration, at rest, in loops, and through extras."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from scipy.interpolate import PchipInterpolator

from kit.bakes import place
from kit.flesh import SECONDS, body, jump
from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.drive.swing import Mode, SwingDrive, key_times, keys_per_second, nonnegative, read_swing, signed
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.spring import Spring

FREQUENCY, DAMPING = 3.0, 0.25
TIMES = np.linspace(0.0, SECONDS, 401)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return read_rig(read_document(place(body(None))), 0)


def drive(**changes: Any) -> SwingDrive:
    spring = Spring(2 * np.pi * FREQUENCY, DAMPING)
    modes = tuple(Mode(spring, load, 10.0) for load in np.eye(3))
    return replace(SwingDrive("belly", 1, np.zeros(3), 1.0, np.zeros(3), modes, tuple("abcd")), **changes)


def clip(times: Floats, places: Floats, turns: Floats | None = None, interpolation: str = "LINEAR") -> Clip:
    channels = [Channel(0, 1, "translation", times, places, interpolation)]
    if turns is not None:
        channels.append(Channel(1, 1, "rotation", times, turns, interpolation))
    return Clip(0, "jump", tuple(channels), float(times[0]), float(times[-1]))


def keyed(keys: float) -> Clip:
    """The jump with so many keys a second; a turn at its end keeps it from being a loop."""
    times = np.linspace(0.0, SECONDS, round(SECONDS * keys) + 1)
    return clip(times, jump(times), once(times))


def once(times: Floats) -> Floats:
    """(times, 4) turns, of which the last keeps a clip from being a loop."""
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
    turns[-1] = [0.0, 0.005, 0.0, 1.0]
    return turns


def integrated() -> Floats:
    """(times, 3) places of a damped weight against its ground, by small steps."""
    speed, steps = 2 * np.pi * FREQUENCY, 20
    fine = np.linspace(0.0, SECONDS, steps * (len(TIMES) - 1) + 1)
    step = fine[1]
    pushed = np.gradient(np.gradient(jump(fine), step, axis=0), step, axis=0)
    place, velocity, found = np.zeros(3), np.zeros(3), []
    for push in pushed:
        found.append(place)
        velocity = velocity + step * (-push - 2 * DAMPING * speed * velocity - speed**2 * place)
        place = place + step * velocity
    return np.array(found)[::steps]


def small(gain: float = 0.1, **changes: Any) -> SwingDrive:
    """A drive whose limit is ten metres: none of its swings comes near to it."""
    return drive(modes=tuple(replace(each, gain=gain) for each in drive().modes), **changes)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("keys", "error"), [(60, 0.01), (30, 0.01), (30.5, 0.01), (29.5, 0.01), (24, 0.02)])
def test_sparse_straight_keys_swing_as_the_motion_that_they_sample(rig: Rig, keys: float, error: float) -> None:
    """Straight lines between 30 keys a second would be 3 % off. At 29.5, no key lies at a half of the clip."""
    wanted = integrated()
    found = small().swing(rig, keyed(keys)).at(TIMES) / 0.1
    assert np.abs(found - wanted).max() < error * np.abs(wanted).max()


@pytest.mark.quick(2)
@pytest.mark.parametrize("keys", [12.0, 24.0, 29.97, 30.0, 60.0])
@pytest.mark.parametrize("speed", [0.3, 3.0])
def test_nothing_moves_before_its_cause(rig: Rig, keys: float, speed: float) -> None:
    """A body stands, jumps within a key, and stands again: flesh is at rest before, to the last digits."""
    times = np.arange(0.0, 2.0, 1.0 / keys)
    start = times[times.searchsorted(0.5)]
    ways = np.clip(times - start, 0.0, 0.7)
    jumps = clip(times, np.outer(ways, [0.0, speed, 0.0]), once(times))
    found = drive().swing(rig, jumps).at(np.linspace(0.0, 2.0, 2001))
    before = np.linspace(0.0, 2.0, 2001) <= start
    assert not found[before].any()
    assert np.abs(found[~before]).max() > 0.01


def landing(speed: float, frequency: float, damping: float = 0.1) -> tuple[Floats, Floats]:
    """(times,) seconds and (times, 3) numbers of a body that falls at a speed and stops within a 60th of a second."""
    times = np.arange(0.0, 2.0, 1.0 / 60.0)
    ways = np.outer(np.minimum(times - 0.5, 0.0), [0.2 * speed, -speed, 0.0])
    modes = tuple(
        Mode(Spring(2.0 * np.pi * frequency * faster, damping * faster), load, 50.0)
        for faster, load in zip((1.0, 1.3, 2.7), np.eye(3), strict=True)
    )
    return times, np.asarray(drive(modes=modes).swing(BODY, clip(times, ways, once(times))).at(FINE))


BODY = read_rig(read_document(place(body(None))), 0)
FINE = np.linspace(0.0, 1.9, 1901)


@pytest.mark.quick(3)
@pytest.mark.parametrize("frequency", [0.5, 2.0, 4.0, 8.0, 20.0])
@pytest.mark.parametrize("speed", [0.5, 3.0, 10.0])
def test_at_any_landing_frames_are_near_and_energy_falls(frequency: float, speed: float) -> None:
    """At 60 frames a second two neighbours differ by less than half of the limit, and what swings dies away."""
    _, numbers = landing(speed, frequency)
    assert np.linalg.norm(numbers, axis=1).max() <= 1.0 + 1e-9
    sixtieth = np.linalg.norm(numbers[17:] - numbers[:-17], axis=1)
    assert sixtieth.max() < 0.5
    speeds = 2.0 * np.pi * frequency * np.array([1.0, 1.3, 2.7])
    velocities = np.gradient(numbers, FINE[1], axis=0) / speeds
    energies = (numbers**2 + velocities**2).sum(axis=1)[530:-1]
    assert (np.diff(energies) < 2e-3 * energies[0] + 1e-12).all()
    assert np.abs(np.diff(energies)).sum() < 1.03 * energies[0] + 1e-9


@pytest.mark.parametrize("speed", [0.05, 0.4])
def test_a_soft_belly_swings_at_its_frequency_and_damping(speed: float) -> None:
    """4 Hz and a tenth of critical damping, by the crossings and crests of what is left after a landing."""
    _, numbers = landing(speed, 4.0)
    heights = numbers[530:, 1]
    crossings = np.flatnonzero(heights[:-1] * heights[1:] < 0)
    at = crossings + heights[crossings] / (heights[crossings] - heights[crossings + 1])
    hertz = 1.3 * 4.0
    assert (len(at) - 1) / 2.0 / ((at[-1] - at[0]) * FINE[1]) == pytest.approx(hertz * np.sqrt(1 - 0.13**2), rel=0.005)
    crests = [np.abs(heights[low:high]).max() for low, high in pairwise(crossings[1:7])]
    decrement = np.log(crests[0] / crests[-1]) / 4.0
    assert decrement / np.hypot(np.pi, decrement) == pytest.approx(0.13, rel=0.03)


def test_a_hard_landing_is_that_of_a_fine_integration() -> None:
    """The integration follows the law of the page in steps of a 4800th of a second, and the fall between the keys."""
    times, found = landing(3.0, 4.0)
    drop = clip(times, np.outer(np.minimum(times - 0.5, 0.0), [0.6, -3.0, 0.0]))
    keys = drop.channels[0].points
    speeds, dampings, step = 8.0 * np.pi * np.array([1.0, 1.3, 2.7]), 0.1 * np.array([1.0, 1.3, 2.7]), 1.0 / 4800.0
    number, velocity, lost, wanted = np.zeros(3), np.zeros(3), np.zeros(3), []
    curve = PchipInterpolator(times, keys)
    places = curve(np.arange(0.45, 0.95, step))
    for kick in np.diff(np.diff(places, axis=0), axis=0) / step:
        wanted.append(number)
        push = -50.0 * kick
        push = push - (number @ number) * max(push @ number, 0.0) * number
        share = np.clip(-(push @ lost) / max(lost @ lost, 1e-30), 0.0, 1.0)
        push, lost = push + share * lost, (1.0 - share) * lost
        velocity = velocity + push - step * (2.0 * dampings * speeds * velocity + speeds**2 * number)
        taken = ((velocity / np.minimum(speeds, 24.0)) ** 2).sum()
        kept = min(np.sqrt(max(1.0 - number @ number, 0.0) / max(taken, 1e-30)), 1.0)
        lost = (lost + (1.0 - kept) * velocity) * np.exp(-30.0 * step)
        velocity = kept * velocity
        number = number + step * velocity
    at = np.arange(int(0.05 / step), len(wanted), int(1.0 / 60.0 / step))
    close = np.abs(np.array(wanted)[at] - found[np.rint((0.45 + at * step) / FINE[1]).astype(int)])
    assert close.max() < 0.03


@pytest.mark.quick(3)
@pytest.mark.parametrize("keys", [12.0, 15.0, 24.0, 30.0, 60.0])
@pytest.mark.parametrize("frequency", [2.0, 4.0, 8.0])
def test_a_sudden_start_leaves_flesh_behind_at_any_keys(keys: float, frequency: float) -> None:
    """A body that flies up at 2.5 m/s from one key to the next: flesh sinks for a quarter of a swing or more, by what
    the greatest speed of a swing allows, however the curve through the keys overshoots.
    """
    times = np.arange(0.0, 1.5, 1.0 / keys)
    start = times[times.searchsorted(0.4)]
    flown = np.maximum(times - start, 0.0)
    heights = np.maximum(2.5 * flown - 9.81 / 2.0 * flown**2, 0.0)
    soft = drive(modes=(Mode(Spring(2.0 * np.pi * frequency, 0.1), np.array([0.0, 1.0, 0.0]), 50.0),))
    numbers = soft.swing(BODY, clip(times, np.outer(heights, [0.0, 1.0, 0.0]), once(times))).at(FINE)[:, 0]
    crossing = np.flatnonzero(numbers > 1e-9)[0]
    assert numbers[:crossing].min() < -0.7 * min(24.0 / (2.0 * np.pi * frequency), 1.0)
    assert FINE[crossing] - start > 0.25 / frequency


def test_a_steady_walk_is_no_motion_of_the_flesh(rig: Rig) -> None:
    times = np.linspace(0.0, 1.0, 31)
    walk = clip(times, np.outer(times, [0.0, 0.0, 1.4]))
    assert np.abs(drive().weights_in(rig, walk)(TIMES)).max() < 1e-6


@pytest.mark.slow
def test_a_loop_ends_as_it_begins(rig: Rig) -> None:
    times = np.linspace(0.0, 1.0, 31)
    bob = np.stack([0 * times, 0.03 * np.sin(4 * np.pi * times), 1.4 * times], axis=1)
    weights = drive().weights_in(rig, clip(times, bob))(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    assert weights[0] == pytest.approx(weights[-1], abs=1e-6)
    assert weights[0] == pytest.approx(weights[2], abs=1e-3)
    assert np.abs(signed(weights)).max() > 0.05


def test_gravity_pulls_where_the_body_turns_and_not_at_rest(rig: Rig) -> None:
    """A body that lies on its back sags along its own -z, by g / ω²."""
    hanging = drive(gravity=np.array([0.0, -3.0, 0.0]))
    times = np.linspace(0.0, 1.0, 31)
    still = np.zeros((31, 3))
    half = np.sqrt(0.5)
    assert np.abs(hanging.weights_in(rig, clip(times, still))(times)).max() < 1e-12
    lying = clip(times, still, np.tile([-half, 0.0, 0.0, half], (31, 1)))
    numbers = signed(hanging.weights_in(rig, lying)(np.array([0.5])))[0]
    load = np.sqrt(2.0) * 10.0 * 3.0 / (2 * np.pi * FREQUENCY) ** 2
    size = float(np.linalg.norm(numbers))
    assert numbers == pytest.approx(np.array([0.0, size, -size]) / np.sqrt(2.0), rel=1e-6)
    assert size == pytest.approx(load * (1.0 - size**4), rel=1e-6)


@pytest.mark.parametrize("speed", [3.0, 0.0])
def test_a_clip_that_ends_at_another_speed_is_no_loop(rig: Rig, speed: float) -> None:
    """A body that starts from rest and runs on stands still at first; a walk at one speed goes round."""
    times = np.linspace(0.0, 1.0, 31)
    ahead = speed * times**2 / 2.0 + 0.05 * np.cos(2.0 * np.pi * times)
    numbers = drive().swing(rig, clip(times, np.outer(ahead, [0.0, 0.0, 1.0]))).at(np.array([0.0, 1.0]))
    assert (np.abs(numbers[0] - numbers[1]).max() < 1e-5) == (speed == 0.0)
    assert (np.abs(numbers[0]).max() == 0.0) == (speed > 0.0)


def test_the_cap_and_the_weights(rig: Rig) -> None:
    """However hard a body is thrown, weights are from 0 to 1, and the numbers no longer than 1."""
    wild = drive(modes=tuple(replace(each, gain=1000.0) for each in drive().modes))
    weights = wild.weights_in(rig, keyed(60))(TIMES)
    assert weights.min() >= 0.0
    assert weights.max() <= 1.0
    lengths = np.linalg.norm(signed(weights), axis=1)
    assert 0.8 < lengths.max() <= 1.0 + 1e-12


def test_a_hidden_body_does_not_swing(rig: Rig) -> None:
    times = np.linspace(0.0, 1.0, 31)
    hidden = Clip(0, "hide", (Channel(0, 1, "scale", times, np.full((31, 3), 1e-9), "LINEAR"),), 0.0, 1.0)
    assert not drive().weights_in(rig, hidden)(times).any()


def test_keys_are_those_of_channels_that_move_the_joint(rig: Rig) -> None:
    still = clip(np.array([0.0, 1.0]), np.zeros((2, 3)))
    assert keys_per_second(rig, still, 1) == np.inf
    assert keys_per_second(rig, keyed(8), 1) == pytest.approx(8.0)
    assert len(key_times(rig, still, 1)) == 5
    spline = np.zeros((3, 3, 3))
    spline[1, 1] = 1.0
    smooth = clip(np.array([0.0, 0.5, 1.0]), spline, interpolation="CUBICSPLINE")
    assert len(key_times(rig, smooth, 1)) == 61
    assert keys_per_second(rig, smooth, 1) == np.inf


def test_extras_give_the_same_drive(rig: Rig) -> None:
    before = drive(gravity=np.array([0.0, -3.0, 0.0]), at=np.array([0.0, 0.1, 0.2]))
    data = before.to_json(rig.names, ())
    after = read_swing(data, {name: number for number, name in enumerate(rig.names)})
    weights = [each.weights_in(rig, keyed(30))(TIMES) for each in (before, after)]
    assert np.abs(weights[0] - weights[1]).max() < 1e-6


@pytest.mark.parametrize(
    ("key", "value"),
    [("scale", 0), ("at", [0, 1]), ("modes", []), ("targets", ["a"])],
)
def test_extras_of_others_are_refused(rig: Rig, key: str, value: Any) -> None:
    data = drive().to_json(rig.names, ()) | {key: value}
    with pytest.raises((KeyError, TypeError, ValueError)):
        read_swing(data, {name: number for number, name in enumerate(rig.names)})


@given(arrays(np.float64, array_shapes(min_dims=2, max_dims=2, max_side=6), elements=st.floats(-1.0, 1.0, width=32)))
def test_weights_are_from_0_to_1_and_mean_the_signed_numbers(numbers: Floats) -> None:
    weights = nonnegative(numbers)
    assert weights.shape == (len(numbers), numbers.shape[1] + 1)
    assert weights.min() >= 0.0
    assert weights.max() <= 1.0 + 1e-12
    assert signed(weights) == pytest.approx(numbers, abs=1e-9)
    # The further shape is minus the sum of the others, and is not needed where no number is negative.
    parts = signed(np.eye(numbers.shape[1] + 1))
    assert weights @ parts == pytest.approx(numbers, abs=1e-9)
    assert not nonnegative(np.abs(numbers))[:, -1].any()
