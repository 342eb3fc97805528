"""Springs that follow a joint: against a fine integration, at rest, in loops, and through extras."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

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


def keyed(keys: float, *, ends: bool = True) -> Clip:
    """The jump with so many keys a second; a turn at its end keeps it from being a loop."""
    times = np.linspace(0.0, SECONDS, round(SECONDS * keys) + 1)
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(times), 1))
    turns[-1] = [0.0, 0.005, 0.0, 1.0] if ends else turns[-1]
    return clip(times, jump(times), turns)


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


@pytest.mark.parametrize(("keys", "error"), [(60, 0.01), (30, 0.01), (30.5, 0.01), (29.5, 0.01), (24, 0.02)])
def test_sparse_straight_keys_swing_as_the_motion_that_they_sample(rig: Rig, keys: float, error: float) -> None:
    """Straight lines between 30 keys a second would be 3 % off. At 29.5, no key lies at a half of the clip."""
    wanted = integrated()
    found = drive().swing(rig, keyed(keys)).at(TIMES)[:, 0]
    assert np.abs(found - wanted).max() < error * np.abs(wanted).max()


def test_a_steady_walk_is_no_motion_of_the_flesh(rig: Rig) -> None:
    times = np.linspace(0.0, 1.0, 31)
    walk = clip(times, np.outer(times, [0.0, 0.0, 1.4]))
    assert np.abs(drive().weights_in(rig, walk)(TIMES)).max() < 1e-6


def test_a_loop_ends_as_it_begins(rig: Rig) -> None:
    times = np.linspace(0.0, 1.0, 31)
    bob = np.stack([0 * times, 0.03 * np.sin(4 * np.pi * times), 1.4 * times], axis=1)
    weights = drive().weights_in(rig, clip(times, bob))(np.array([0.0, 0.25, 0.5, 0.75, 1.0]))
    assert weights[0] == pytest.approx(weights[-1], abs=1e-9)
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
    sag = 10.0 * 3.0 / (2 * np.pi * FREQUENCY) ** 2
    length = np.sqrt(2.0) * sag
    assert numbers == pytest.approx(np.array([0.0, sag, -sag]) * np.tanh(length) / length, rel=1e-6)


def test_the_cap_and_the_weights(rig: Rig) -> None:
    """However hard a body is thrown, weights are from 0 to 1, and the numbers no longer than 1."""
    wild = drive(modes=tuple(replace(each, gain=1000.0) for each in drive().modes))
    weights = wild.weights_in(rig, keyed(60))(TIMES)
    assert weights.min() >= 0.0
    assert weights.max() <= 1.0
    lengths = np.linalg.norm(signed(weights), axis=1)
    assert 0.99 < lengths.max() <= 1.0 + 1e-12
    assert signed(nonnegative(np.array([[0.3, -0.4, 0.1]]))) == pytest.approx(np.array([[0.3, -0.4, 0.1]]))


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
