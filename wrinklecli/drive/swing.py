"""The drive of flesh: springs that follow a joint, and weights for the shapes in which flesh swings.

The joint carries a place c. Each spring is a number n, the part of the limit to which its shape moves, with
n'' + 2 ζ ω n' + ω² n = w · (g - c''): it stays behind where the joint starts and runs on where it stops. The vector w
is the spring's gain times its load, a direction in the joint's space, over the animated scale. The damper is between
flesh and joint: a damper against the world would drag behind a walk. Flesh turns along with its joint.

A clip's keys are joined by a smooth curve that goes nowhere between two keys at the same place (`slopes`), as straight
lines between keys would kick the spring at each of them. In steps of a 360th of a second or less the place
runs straight, so a kick at each of them is the change of its velocity. All springs together keep the limit by
themselves (`numeric.limited`).

Gravity g is that against the rest pose, g - R R₀ᵀ g with the joint's turn R, as the mesh was modelled under gravity;
and a share of it, as soft springs sag by more than flesh does.

Finally, the least number, if it is below 0, is taken from all, and the last target, equal to minus the sum of the
others, gets it.

In extras, a drive has the `joint`, the place `at` and `gravity` in its space (at rest, times the share), its `scale` at
rest, and for each of `modes` `frequency`, `damping`, `load` and `gain`.

Sources: C. Larboulette, M.-P. Cani, B. Arnaldi, *Dynamic Skinning*, SCCG 2005 (springs that follow a skeleton).
Differs: each step has a closed form, so springs of any frequency stay stable, and they keep a limit.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from itertools import compress
from typing import Any, NamedTuple

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE, node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.drive.stored import MOST_KEPT, Json, read_number, read_numbers, read_spring, stored
from wrinklecli.drive.table import BaseDrive
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, determinants, distinct_values
from wrinklecli.numeric.limited import STEPS, LimitedSwing, settled, swing
from wrinklecli.numeric.memory import once
from wrinklecli.numeric.spring import Spring

GRAVITY = 9.81
"""Metres per second squared, along -y: glTF's unit is the metre, and its y points up."""

KEYS_ASKED = 12.0
"""Keys per second below which the curve through a clip's keys is far from a motion that swings flesh.

At 3 Hz and 12 keys per second it is 2 % off a fine integration, at 6 keys per second 17 %.
"""

# Pieces of a clip at least, so that a curve has something to go through.
_LEAST_PIECES = 4
# Samples per second of channels that are smooth between their keys (CUBICSPLINE).
_SAMPLES = 60.0
# Points of a loop beyond either end that the slopes at its ends depend on.
_AROUND = 2


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
        gain: The part of the limit to which a way of length 1 along the load moves the shape.
    """

    spring: Spring
    load: Floats
    gain: float


@dataclass(frozen=True, slots=True, eq=False)
class SwingDrive(BaseDrive):
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

    _swings: dict[bytes, LimitedSwing] = field(default_factory=dict, init=False, repr=False)

    @property
    def nodes(self) -> frozenset[int]:
        """The nodes whose matrices the drive needs."""
        return frozenset({self.node})

    def of_targets(self, kept: Bools) -> "SwingDrive":
        """The drive of some of its (targets,) alone, the last among them."""
        modes = tuple(compress(self.modes, kept))
        return replace(self, modes=modes, targets=tuple(compress(self.targets, kept)))

    def carried(self, rig: Rig, clip: Clip | None, times: Floats, known: dict[int, Floats] | None = None) -> Carried:
        """The joint at (frames,) seconds of a clip, or in the stored pose; `known` is as in `node_rows`."""
        (rows,) = node_rows(rig, clip, times, [self.node], known)
        matrices = np.broadcast_to(rows, (3, 4, len(times))).transpose(2, 0, 1)
        places = matrices[:, :, :3] @ self.at + matrices[:, :, 3]
        lengths = np.sqrt((matrices[:, :, :3] ** 2).sum(axis=1, keepdims=True))
        scales = np.cbrt(np.abs(determinants(matrices[:, :, :3]))) / self.scale
        return Carried(places, matrices[:, :, :3] / np.maximum(lengths, TINY), scales)

    def swing(self, rig: Rig, clip: Clip) -> LimitedSwing:
        """Let the springs follow a clip, once. A clip that ends as it begins, in pose and speed, counts as a loop."""
        return once(self._swings, clip.motion, partial(self._followed, rig, clip), MOST_KEPT)

    def _followed(self, rig: Rig, clip: Clip) -> LimitedSwing:
        """Let the springs follow a clip."""
        keys = key_times(rig, clip, self.node)
        places = self.carried(rig, clip, keys).places
        periodic = clip.loops and goes_round(keys, places)
        begins, places = divided(keys, places, slopes(keys, places, periodic=periodic), 1.0 / STEPS)
        velocities = np.diff(places, axis=0) / np.diff(begins)[:, None]
        before = np.concatenate([velocities[-1:] if periodic else velocities[:1], velocities[:-1]])
        joint = self.carried(rig, clip, begins[:-1])
        directions = self._directions(joint)
        kicks = np.einsum("sky,sy->sk", directions, before - velocities) / self._speeds
        return swing([each.spring for each in self.modes], begins, kicks, self._loads(joint), periodic=periodic)

    @property
    def _speeds(self) -> Floats:
        """(modes,) ω of the springs."""
        return np.array([each.spring.speed for each in self.modes])

    def _directions(self, joint: Carried) -> Floats:
        """(frames, modes, 3) vectors w in the world; 0 while the joint is scaled to nothing."""
        shown = joint.scales > LEAST_SCALE
        loads = np.stack([each.gain * each.load for each in self.modes])
        scales = (shown / np.where(shown, joint.scales, 1.0))[:, None, None]
        return np.asarray(np.einsum("fxy,my->fmx", joint.turns, loads) * scales)

    def _loads(self, joint: Carried) -> Floats:
        """(frames, modes) numbers to which gravity beyond that of the rest pose would move free springs."""
        down = np.array([0.0, -float(np.linalg.norm(self.gravity)), 0.0])
        pulls = down - joint.turns @ self.gravity
        return np.asarray(np.einsum("fmx,fx->fm", self._directions(joint), pulls) / self._speeds**2)

    def reader(self, rig: Rig, clip: Clip | None) -> Callable[[Floats, dict[int, Floats]], Floats]:
        """A function from (frames,) seconds of a clip, and rows known as in `node_rows`, to (frames, targets) weights.

        The springs' own numbers say nothing to anybody, so the weights count as what is measured. Without a clip the
        body stands in its stored pose.
        """
        if clip is None:
            return lambda times, _known: nonnegative(settled(self._loads(self.carried(rig, None, times))))
        followed = self.swing(rig, clip)

        def read(times: Floats, known: dict[int, Floats]) -> Floats:
            shown = self.carried(rig, clip, times, known).scales > LEAST_SCALE
            return nonnegative(followed.at(times) * shown[:, None])

        return read

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
        frequency, damping = read_spring(each)
        spring = Spring(2.0 * np.pi * frequency, damping)
        modes.append(Mode(spring, read_numbers(each["load"], 3), read_number(each["gain"])))
    targets = tuple(str(name) for name in data["targets"])
    scale = read_number(data["scale"])
    at, gravity = (read_numbers(data[key], 3) for key in ("at", "gravity"))
    if not modes or len(targets) != len(modes) + 1 or not scale > 0:
        raise ValueError
    return SwingDrive(str(data["name"]), nodes[str(data["joint"])], at, scale, gravity, tuple(modes), targets)


def nonnegative(numbers: Floats) -> Floats:
    """(frames, shapes + 1) weights in [0, 1] from (frames, shapes) numbers in [-1, 1].

    A further shape is equal to minus the sum of the others. Blender and some other players allow no weight below 0 or
    above 1.
    """
    below = np.minimum(numbers.min(axis=1, initial=0.0), 0.0)[:, None]
    return np.concatenate([(numbers - below) / 2.0, -below], axis=1)


def signed(weights: Floats) -> Floats:
    """(frames, shapes) numbers in [-1, 1] from (frames, shapes + 1) weights: the inverse of `nonnegative`."""
    return np.asarray(2.0 * weights[:, :-1] - weights[:, -1:])


def key_times(rig: Rig, clip: Clip, node: int) -> Floats:
    """(keys,) sorted seconds of all keys of a clip that move a node, with the clip's ends, and where keys are few more.

    Where all channels are smooth between their keys, there are as many times as the curve needs. Others get none
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
    # Two keys a float32 step apart are a jump of the pose, which no curve follows: the later one counts.
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


def goes_round(times: Floats, places: Floats) -> bool:
    """True if (times, 3) places go on from the last as they began at the first, apart from where they are.

    At most the change of velocity there is twice that at the keys beside it, or a tenth of all change in the clip.
    """
    velocities = np.diff(places, axis=0) / np.diff(times)[:, None]
    change, *beside = np.sqrt(((velocities[[0, 1, -1]] - velocities[[-1, 0, -2]]) ** 2).sum(axis=1)).tolist()
    return bool(change <= max(2.0 * max(beside), 0.1 * float(np.sqrt((np.ptp(velocities, axis=0) ** 2).sum()))))


def slopes(times: Floats, points: Floats, *, periodic: bool) -> Floats:
    """(points, columns) slopes at (points,) sorted times of a curve through (points, columns), three of them at least.

    A curve that is `periodic` goes on as from its beginning, from where it ends. The slope is that of the parabola
    through the point and its two neighbours, but is limited so that the curve rises nowhere where the points fall, and
    rests where they rest: a curve of continuous acceleration would move before a motion begins. A smooth crest between
    two points stays, as a limit that knows single steps alone would cut it off: at 30 points a second, springs of 8 Hz
    then are 20 % off, here 2 %.

    Source: H. T. Huynh, *Accurate Monotone Cubic Interpolation*, SIAM Journal on Numerical Analysis 30, 1993 (its limit
        M3), which widens that of F. N. Fritsch and R. E. Carlson, *Monotone Piecewise Cubic Interpolation*, ibid. 17,
        1980.
    """
    if periodic:
        whole, span = points[-1] - points[0], times[-1] - times[0]
        before, after = slice(-1 - _AROUND, -1), slice(1, 1 + _AROUND)
        times = np.concatenate([times[before] - span, times, times[after] + span])
        points = np.concatenate([points[before] - whole, points, points[after] + whole])
    spans = np.diff(times)[:, None]
    steps = np.diff(points, axis=0) / spans
    bends = np.diff(steps, axis=0) / (spans[1:] + spans[:-1])
    # A bend of a piece is the less of those at its two points; beyond the ends, they go on.
    bends = np.concatenate([bends[:1], bends, bends[-1:]])
    bends = _least(bends[:-1], bends[1:])
    mean = (spans[1:] * steps[:-1] + spans[:-1] * steps[1:]) / (spans[1:] + spans[:-1])
    tended = _least(steps[:-1] + bends[:-1] * spans[:-1], steps[1:] - bends[1:] * spans[1:])
    most = np.maximum(3.0 * np.abs(_least(steps[:-1], steps[1:])), 1.5 * np.abs(tended))
    inner = _least(mean, np.sign(tended) * most)
    first, last = (_least(2.0 * steps[end] - inner[end], 3.0 * steps[end])[None] for end in (0, -1))
    found = np.concatenate([first, inner, last])
    return found[_AROUND:-_AROUND] if periodic else found


def _least(a: Floats, b: Floats) -> Floats:
    """The one of two numbers that is nearer to 0; 0 if their signs differ."""
    return np.where(a * b > 0.0, np.where(np.abs(a) < np.abs(b), a, b), 0.0)


def divided(times: Floats, points: Floats, slopes: Floats, most: float) -> tuple[Floats, Floats]:
    """(parts + 1,) times, with those of the points, about `most` apart or less, and (parts + 1, columns) there.

    Args:
        times: (points,) sorted.
        points: (points, columns) of the curve.
        slopes: (points, columns) of the curve.
        most: Seconds; between two points, all parts are alike.
    """
    spans = np.diff(times)
    # Keys are float32: at 200 s, spans are off by up to 15 µs, which is half a hundredth of a 360th of a second.
    counts = np.maximum(np.ceil(spans / most - 1e-2), 1.0).astype(np.intp)
    pieces = np.repeat(np.arange(len(spans)), counts)
    fractions = (np.arange(len(pieces)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[pieces]
    t, wide = fractions[:, None], spans[pieces, None]
    found = (
        points[pieces] * (1.0 + 2.0 * t) * (1.0 - t) ** 2
        + points[pieces + 1] * t**2 * (3.0 - 2.0 * t)
        + wide * (slopes[pieces] * t * (1.0 - t) ** 2 - slopes[pieces + 1] * t**2 * (1.0 - t))
    )
    return (
        np.append(times[pieces] + fractions * spans[pieces], times[-1]),
        np.concatenate([found, points[-1:]]),
    )
