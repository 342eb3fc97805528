"""The drive of flesh: springs in the world that follow a joint, and weights for the shapes in which flesh swings.

The joint carries a place c. Each spring has a vector r in the world with r'' + 2 ζ ω r' + ω² r = -(c'' - g), so it
stays behind where the joint starts and runs on where it stops. The damper is between flesh and joint: a damper against
the world would drag behind a walk. A clip's keys are joined by a spline of continuous acceleration, as straight lines
between keys would kick the spring at each of them.

Gravity g is that against the rest pose, g - R R₀ᵀ g with the joint's turn R, as the mesh was modelled under gravity;
and a share of it, as soft springs sag by more than flesh does.

In the joint's space, the part of r along a mode's load, over the animated scale, times the mode's gain gives a number.
If a is the length of the vector of all modes' numbers, these are multiplied by tanh a / a: the cap. Finally, the least
number, if it is below 0, is taken from all, and the last target, equal to minus the sum of the others, gets it.

In extras, a drive has the `joint`, the place `at` and `gravity` in its space (at rest, times the share), its `scale` at
rest, and for each of `modes` `frequency`, `damping`, `load` and `gain`.

Sources: C. Larboulette, M.-P. Cani, B. Arnaldi, *Dynamic Skinning*, SCCG 2005 (springs that follow a skeleton).
Differs: no time steps (see `numeric.spring`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE, node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.drive.stored import Json, read_number, read_numbers, stored
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, determinants, distinct_values
from wrinklecli.numeric.piecewise import Signal
from wrinklecli.numeric.quartics import Quartics
from wrinklecli.numeric.spring import Spring, SpringResponse, respond

GRAVITY = 9.81
"""Metres per second squared, along -y: glTF's unit is the metre, and its y points up."""

KEYS_ASKED = 12.0
"""Keys per second below which the spline through a clip's keys is far from a motion that swings flesh.

At 3 Hz and 12 keys per second it is 2 % off a fine integration, at 6 keys per second 17 %.
"""

# Pieces of a clip at least, so that a spline has something to go through.
_LEAST_PIECES = 4
# Samples per second of channels that are smooth between their keys (CUBICSPLINE).
_SAMPLES = 60.0
# Clips whose springs a drive keeps: the same motion is asked for at many times.
_MOST_KEPT = 64
# Greatest frequency in hertz, damping ratio and gain of a spring that extras may ask for: more than a bake writes.
_MOST = 1e4


class Carried(NamedTuple):
    """A place that a joint carries.

    Attributes:
        places: (frames, 3) in the world.
        turns: (frames, 3, 3) the joint's axes in the world, unit columns.
        scales: (frames,) the joint's scale over that at rest.
    """

    places: Floats
    turns: Floats
    scales: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Mode:
    """One spring of flesh.

    Attributes:
        spring: Its speed and damping ratio.
        load: (3,) the direction, in the joint's space, along which it moves the shape.
        gain: The weight before the cap, for a vector of length 1 along the load.
    """

    spring: Spring
    load: Floats
    gain: float


@dataclass(frozen=True, slots=True, eq=False)
class Swing:
    """Flesh over one clip: each mode's springs along x, y and z of the world."""

    responses: tuple[SpringResponse, ...]

    def at(self, times: Floats) -> Floats:
        """(frames, modes, 3) vectors r at (frames,) seconds."""
        return np.stack([each.at(times) for each in self.responses], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class SwingDrive:
    """Springs that follow a joint and set the weights of a region's targets.

    Attributes:
        name: The region's name.
        node: The joint.
        at: (3,) the place that it carries, in its own space.
        scale: Its scale at rest.
        gravity: (3,) gravity at rest in its own space, times the share that acts, scene units per second squared.
        modes: The springs.
        targets: Names of the morph targets, the last equal to minus the sum of the others.
    """

    name: str
    node: int
    at: Floats
    scale: float
    gravity: Floats
    modes: tuple[Mode, ...]
    targets: tuple[str, ...]
    own: ClassVar[tuple[str, ...]] = ()
    measures: ClassVar[bool] = True
    _swings: dict[bytes, Swing] = field(default_factory=dict, init=False, repr=False)

    @property
    def nodes(self) -> frozenset[int]:
        """The nodes whose matrices the drive needs."""
        return frozenset({self.node})

    def carried(self, rig: Rig, clip: Clip | None, times: Floats, known: dict[int, Floats] | None = None) -> Carried:
        """The joint at (frames,) seconds of a clip, or in the stored pose; `known` is as in `node_rows`."""
        (rows,) = node_rows(rig, clip, times, [self.node], known)
        matrices = np.broadcast_to(rows, (3, 4, len(times))).transpose(2, 0, 1)
        places = matrices[:, :, :3] @ self.at + matrices[:, :, 3]
        lengths = np.sqrt((matrices[:, :, :3] ** 2).sum(axis=1, keepdims=True))
        scales = np.cbrt(np.abs(determinants(matrices[:, :, :3]))) / self.scale
        return Carried(places, matrices[:, :, :3] / np.maximum(lengths, 1e-30), scales)

    def swing(self, rig: Rig, clip: Clip) -> Swing:
        """Let the springs follow a clip, once. A clip that ends in the pose of its beginning counts as a loop."""
        if clip.motion not in self._swings:
            if len(self._swings) >= _MOST_KEPT:
                self._swings.clear()
            self._swings[clip.motion] = self._followed(rig, clip)
        return self._swings[clip.motion]

    def _followed(self, rig: Rig, clip: Clip) -> Swing:
        """Let the springs follow a clip."""
        times = key_times(rig, clip, self.node)
        places, turns, _ = self.carried(rig, clip, times)
        periodic = clip.loops
        # A walk goes on as it went: its mean velocity is no motion of the flesh.
        elapsed = (times - times[0]) / (times[-1] - times[0])
        places = places - elapsed[:, None] * (places[-1] - places[0])
        pulls = self._pulls(turns)
        if periodic:
            places[-1], pulls[-1] = places[0], pulls[0]
        accelerations, pulls_between = (_spline(times, each, periodic=periodic) for each in (places, pulls))
        spans = np.diff(times)
        forces = pulls_between - _bent(accelerations, spans)
        signals = [Quartics(times[:-1], spans, forces / mode.spring.speed**2) for mode in self.modes]
        pairs = zip(self.modes, signals, strict=True)
        return Swing(tuple(respond(mode.spring, each, periodic=periodic) for mode, each in pairs))

    def reader(self, rig: Rig, clip: Clip | None) -> Callable[[Floats, dict[int, Floats]], Floats]:
        """A function from (frames,) seconds of a clip, and rows known as in `node_rows`, to (frames, targets) weights.

        The springs' own numbers say nothing to anybody, so the weights count as what is measured.
        """
        if clip is None:
            return lambda times, _known: nonnegative(self.numbers(*self._settled(rig, times)))
        swing = self.swing(rig, clip)
        return lambda times, known: nonnegative(self.numbers(swing.at(times), self.carried(rig, clip, times, known)))

    def weights(self, _clip: Clip | None, reading: Floats, _response: object = None) -> Floats:
        """(frames, targets) the weights that are measured."""
        return reading

    def weights_in(self, rig: Rig, clip: Clip | None) -> Signal:
        """A function from (frames,) seconds of a clip to (frames, targets) weights; None is the stored pose."""
        read = self.reader(rig, clip)
        return lambda times: read(times, {})

    def breaks(self, _clip: Clip) -> Floats:
        """None: springs have no corners."""
        return np.zeros(0)

    def why_flat(self, _rig: Rig, _clip: Clip, _times: Floats) -> str | None:
        """Nothing: flesh makes no wrinkles."""
        return None

    def _settled(self, rig: Rig, times: Floats) -> tuple[Floats, Carried]:
        """(frames, modes, 3) vectors of a body that stands in its stored pose, and its joint."""
        carried = self.carried(rig, None, times)
        squares = np.array([each.spring.speed for each in self.modes]) ** 2
        return self._pulls(carried.turns)[:, None] / squares[:, None], carried

    def _pulls(self, turns: Floats) -> Floats:
        """(frames, 3) gravity beyond that of the rest pose, for (frames, 3, 3) turns of the joint."""
        down = np.array([0.0, -float(np.linalg.norm(self.gravity)), 0.0])
        return np.asarray(down - turns @ self.gravity)

    def numbers(self, vectors: Floats, carried: Carried) -> Floats:
        """(frames, modes) capped numbers from (frames, modes, 3) vectors in the world."""
        loads = np.stack([each.gain * each.load for each in self.modes])
        local = np.einsum("fxy,fmx->fmy", carried.turns, vectors)
        shown = carried.scales > LEAST_SCALE
        found = np.einsum("my,fmy->fm", loads, local) * (shown / np.where(shown, carried.scales, 1.0))[:, None]
        lengths = np.sqrt((found**2).sum(axis=1, keepdims=True))
        return np.asarray(found * np.where(lengths > 0, np.tanh(lengths) / np.where(lengths > 0, lengths, 1.0), 1.0))

    def to_json(self, names: Sequence[str], morph_names: Sequence[str]) -> Json:
        """The drive as extras store it, by the names of all nodes and of the rig's morph targets."""
        assert morph_names is not None
        return {
            "name": self.name,
            "joint": names[self.node],
            "at": stored(self.at),
            "scale": stored(self.scale),
            "gravity": stored(self.gravity),
            "modes": [
                {
                    "frequency": stored(each.spring.speed / (2.0 * np.pi)),
                    "damping": stored(each.spring.damping),
                    "load": stored(each.load),
                    "gain": stored(each.gain),
                }
                for each in self.modes
            ],
            "targets": list(self.targets),
        }


def read_swing(data: Json, nodes: Mapping[str, int]) -> SwingDrive:
    """Read a drive of flesh in extras, on a rig whose nodes have these numbers by name.

    Raises:
        KeyError, TypeError, ValueError: The extras are not what `bake` writes.
    """
    modes = []
    for each in data["modes"]:
        frequency, damping, gain = (read_number(each[key]) for key in ("frequency", "damping", "gain"))
        if not (0 < frequency < _MOST and 0 < damping < _MOST):
            raise ValueError
        load = read_numbers(each["load"], 3)
        modes.append(Mode(Spring(2.0 * np.pi * frequency, damping), load, gain))
    targets = tuple(str(name) for name in data["targets"])
    scale = read_number(data["scale"])
    at, gravity = (read_numbers(data[key], 3) for key in ("at", "gravity"))
    if not modes or len(targets) != len(modes) + 1 or not scale > 0:
        raise ValueError
    return SwingDrive(str(data["name"]), nodes[str(data["joint"])], at, scale, gravity, tuple(modes), targets)


def nonnegative(numbers: Floats) -> Floats:
    """(frames, modes + 1) weights in [0, 1] from (frames, modes) numbers in [-1, 1]: see `NonNegativeBasis`."""
    below = np.minimum(numbers.min(axis=1, initial=0.0), 0.0)[:, None]
    return np.concatenate([(numbers - below) / 2.0, -below], axis=1)


def signed(weights: Floats) -> Floats:
    """(frames, modes) numbers in [-1, 1] from (frames, modes + 1) weights: the inverse of `nonnegative`."""
    return np.asarray(2.0 * weights[:, :-1] - weights[:, -1:])


def key_times(rig: Rig, clip: Clip, node: int) -> Floats:
    """(keys,) sorted seconds of all keys of a clip that move a node, with the clip's ends, and where keys are few more.

    Where all channels are smooth between their keys, there are as many times as the spline needs. Others get none
    between their keys: a place on a straight line lies beside the smooth curve, and would kick the spring.
    """
    moving = _moving_channels(rig, clip, node)
    end = max(clip.end, float(np.nextafter(np.float32(clip.start), np.float32(np.inf))))
    keys = np.concatenate([[clip.start, end], *(each.times for each in moving)])
    inside = distinct_values(keys[(keys >= clip.start) & (keys <= end)])
    pieces = _LEAST_PIECES
    smooth = bool(moving) and all(each.interpolation == "CUBICSPLINE" for each in moving)
    if smooth:
        pieces = max(pieces, int(np.ceil(_SAMPLES * (end - clip.start))))
    if smooth or len(inside) <= _LEAST_PIECES:
        inside = distinct_values(np.concatenate([np.linspace(clip.start, end, pieces + 1), inside]))
    # Two keys a float32 step apart are a jump of the pose, which no spline follows: the later one counts.
    apart = np.append(np.diff(inside) > 1e-4 * (end - clip.start) / pieces, True)
    apart[0] = True
    return np.asarray(inside[apart])


def keys_per_second(rig: Rig, clip: Clip, node: int) -> float:
    """The keys per second that move a node in a clip; infinite where nothing moves it, or smoothly between keys."""
    moving = _moving_channels(rig, clip, node)
    if not moving or all(each.interpolation == "CUBICSPLINE" for each in moving) or not clip.end > clip.start:
        return float("inf")
    keys = distinct_values(np.concatenate([each.times for each in moving]))
    return float((len(keys) - 1) / max(keys[-1] - keys[0], 1e-9))


def _moving_channels(rig: Rig, clip: Clip, node: int) -> list[Any]:
    """The channels of a clip that turn, shift or scale a node or one above it, and that change at all."""
    above = set(rig.upwards(node))
    return [
        each
        for each in clip.channels
        if each.node in above and each.path != "weights" and bool((each.points != each.points[0]).any())
    ]


def _spline(times: Floats, values: Floats, *, periodic: bool) -> Floats:
    """(pieces, 5, columns) coefficients, the constant first, of the elapsed fraction of each piece of a C² spline.

    It goes through (times, columns) values; at its ends it is straight, if it is not periodic.
    """
    from scipy.interpolate import CubicSpline

    found = CubicSpline(times, values, bc_type="periodic" if periodic else "natural").c
    spans = np.diff(times)[:, None]
    powers = np.zeros((len(spans), 5, values.shape[1]))
    for power in range(4):
        powers[:, power] = found[3 - power] * spans**power
    return powers


def _bent(powers: Floats, spans: Floats) -> Floats:
    """(pieces, 5, columns) second derivatives of quartics by time."""
    squares = (spans**2)[:, None]
    bent = np.zeros(powers.shape)
    for power in range(3):
        bent[:, power] = (power + 1) * (power + 2) * powers[:, power + 2] / squares
    return bent
