"""The signal of a segment or path: its length between points that joints and morph targets carry, and its rest length.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004: the current distance of origin and target
against that at rest. Differs: a path has more points; animated scale is taken out; the rest length may change.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from wrinklecli.character.carried import CarriedPoint, Carriers, carried_places, pose_carriers
from wrinklecli.character.clip import Clip, motion_breaks
from wrinklecli.character.pose import LEAST_SCALE, morph_weights
from wrinklecli.character.rig import Rig
from wrinklecli.drive.stored import Json, read_numbers, stored
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats
from wrinklecli.tools.records import Lag


def point_json(point: CarriedPoint, names: Sequence[str], morph_names: Sequence[str]) -> Json:
    """A point in the spaces of its joints; `scales` are those of the joints at rest.

    It may follow the first of the rig's morph targets alone: points of effects below the skin follow the asset's own.
    """
    places = point.points[..., :3] / point.weights[:, None]
    scales = 1.0 / np.cbrt(np.where(point.shares > 0, point.shares, 1.0))
    entry: Json = {
        "joints": [names[node] for node in point.nodes.tolist()],
        "weights": stored(point.weights),
        "positions": stored(places[0]),
        "scales": stored(scales),
    }
    if places[1:].any():
        moves = zip(morph_names[: len(places) - 1], places[1:], strict=True)
        entry["morphs"] = {name: stored(deltas) for name, deltas in moves if deltas.any()}
    return entry


def read_point(data: Json, nodes: Mapping[str, int], morph_names: Sequence[str]) -> CarriedPoint:
    """Read a point on a rig whose nodes have these numbers by name.

    Raises:
        KeyError, TypeError, ValueError: The extras are not what `bake` writes.
    """
    count = len(data["joints"])
    weights, scales = (read_numbers(data[key], count) for key in ("weights", "scales"))
    if not (scales > 0).all():
        raise ValueError
    moves = {name: read_numbers(each, count, 3) for name, each in data.get("morphs", {}).items()}
    points = np.zeros((1 + len(morph_names), count, 4))
    points[0] = np.column_stack([read_numbers(data["positions"], count, 3), np.ones(count)])
    for row, name in zip(points[1:], morph_names, strict=True):
        row[:, :3] = moves.get(name, 0.0)
    numbers = np.array([nodes[str(joint)] for joint in data["joints"]], np.intp)
    return CarriedPoint(numbers, weights, points * weights[:, None], 1.0 / scales**3)


class Lengths(NamedTuple):
    """The measurements of a segment.

    Attributes:
        distances: (frames,) summed distances of neighbouring points, animated scale taken out, scene units. They are
            infinite while scale hides the character.
        rest_lengths: (frames,) scene units.
        nominal: The rest length for which weights are tabulated, scene units.
        tension: (frames,) what the activation of a muscle takes of the distances, scene units.
    """

    distances: Floats
    rest_lengths: Floats
    nominal: float
    tension: Floats | float = 0.0

    @property
    def active(self) -> Bools:
        """(frames,) True while the character is not hidden."""
        return np.isfinite(self.distances)

    @property
    def rows(self) -> Floats:
        """(frames,) shortenings, 1 - distance / rest length, by which a table is looked up; 0 while inactive."""
        return np.asarray(1.0 - np.where(self.active, self.distances, self.rest_lengths) / self.rest_lengths)

    @property
    def factors(self) -> Floats:
        """(frames,) factors on weights that are looked up: a curve that is twice as long has bumps twice as high."""
        return self.rest_lengths / self.nominal

    @property
    def ends(self) -> "Lengths":
        """The measurements without activation."""
        return self._replace(distances=self.distances + self.tension, tension=0.0)


@dataclass(frozen=True, slots=True, eq=False)
class RestLength:
    """The length of a segment below which it counts as shortened.

    Attributes:
        constant: Scene units.
        keys: By clip, (keys, 2) seconds and lengths, linear between them, in place of the constant.
        morph: Number of the morph target that takes the length from the constant to another at weight 1, and that
            length; None if no morph target does.
    """

    constant: float
    keys: Mapping[str, Floats] = field(default_factory=dict)
    morph: tuple[int, float] | None = None

    def at(self, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
        """(frames,) rest lengths at (frames,) seconds of a clip, scene units."""
        if clip is not None and clip.name in self.keys:
            return np.interp(times, *self.keys[clip.name].T)
        if self.morph is not None:
            number, full = self.morph
            shares = np.clip(morph_weights(rig.own, clip, times)[:, number], 0.0, 1.0)
            return np.asarray(self.constant + shares * (full - self.constant))
        return np.full(len(times), self.constant)


@dataclass(frozen=True, slots=True, eq=False)
class Tension:
    """An activation of a muscle, 0 to 1, that counts as a shortening of its segment.

    Attributes:
        length: The shortening at an activation of 1, scene units.
        keys: By clip, (keys, 2) seconds and activations, linear between them; 0 in other clips.
        morph: Number of the morph target whose weight is the activation, in place of keys.
    """

    length: float
    keys: Mapping[str, Floats] = field(default_factory=dict)
    morph: int | None = None

    def at(self, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
        """(frames,) shortenings at (frames,) seconds of a clip, scene units."""
        if self.morph is not None:
            return self.length * np.clip(morph_weights(rig.own, clip, times)[:, self.morph], 0.0, 1.0)
        if clip is not None and clip.name in self.keys:
            return self.length * np.interp(times, *self.keys[clip.name].T)
        return np.zeros(len(times))


@dataclass(frozen=True, slots=True, eq=False)
class Segment:
    """A segment or path through two or more carried points, from its origin to its target."""

    points: tuple[CarriedPoint, ...]
    rest_length: RestLength
    tension: Tension | None = None

    def breaks(self, clip: Clip) -> Floats:
        """(times,) seconds at which a clip keys its rest length or its tension."""
        keyed = [self.rest_length.keys, *([self.tension.keys] if self.tension else [])]
        return np.concatenate([np.zeros(0), *(each[clip.name][:, 0] for each in keyed if clip.name in each)])

    def lengths(self, rig: Rig, clip: Clip | None, times: Floats, known: dict[int, Floats] | None = None) -> Lengths:
        """Measure the segment at (frames,) seconds of a clip; in the stored pose if `clip` is None.

        `known` is as in `node_rows`.
        """
        distances = self.distances(pose_carriers(self.points, rig, clip, times, known), len(times))
        tension = 0.0 if self.tension is None else self.tension.at(rig, clip, times)
        rest = self.rest_length
        return Lengths(distances - tension, rest.at(rig, clip, times), rest.constant, tension)

    def distances(self, carriers: Carriers, count: int) -> Floats:
        """(count,) lengths without animated scale in the poses of carriers, without tension, scene units."""
        places, scales = zip(*(carried_places(each, carriers, count) for each in self.points), strict=True)
        scale = sum(scales, np.zeros(1)) / len(scales)
        hidden = scale < LEAST_SCALE
        steps = [b - a for a, b in pairwise(places)]
        apart = sum((np.sqrt(np.einsum("xf,xf->f", step, step)) for step in steps), np.zeros(1))
        return np.where(hidden, np.inf, apart / np.where(hidden, 1.0, scale))

    def spring(self, lag: Lag | None, rig: Rig, clip: Clip | None) -> Callable[[Floats, Floats, Floats], Floats] | None:
        """A filter by which a damped spring follows the shortening in a clip; None without `lag`, or without a clip.

        It turns (frames,) seconds, distances of the ends and rest lengths into other distances.
        """
        if lag is None or clip is None:
            return None
        from wrinklecli.drive.lag import spring_filter  # few tools ask for it

        def ratios(times: Floats) -> Floats:
            found = self.lengths(rig, clip, times)
            return np.asarray(found.distances / found.rest_lengths)[:, None]

        return spring_filter(lag, ratios, clip, np.concatenate([motion_breaks(clip, rig), self.breaks(clip)]))
