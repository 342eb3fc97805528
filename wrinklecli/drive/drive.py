"""Drives: they set the weights of an effect's morph targets over time, alike in a bake, in `track` and in players.

A signal is measured in the posed rig, a filter follows it, and a response turns it into weights. A drive evaluates
itself for arrays of times, and a node's `extras.wrinkle` holds it in JSON:

Sections of the extras are played in the order of `EFFECTS`: anchors may move with the targets of those before.

- A segment has `anchors`, or `origin` and `target` where there are two. Each is the sum over its joints of weight ·
  matrix · position, where the matrix is the joint's own, to world space: optimisers that quantise positions change bind
  space and inverse bind matrices, but not the joints. `morphs` are the deltas of morph targets. The segment
  measures the summed distances of neighbouring anchors, divided by the animated scale: the mean over anchors of the sum
  over joints of weight · cbrt(det matrix) / scale.
- Its `rest_length` is constant, or follows `rest_length_keys` in some clips, or `rest_length_morph`.
- Its `lag` is a damped spring: with d = max(`taut` - distance / rest_length, 0), x'' = ω² (d - x) - 2 ζ ω x',
  ω = 2π `frequency` and ζ = `damping`, the distance is then (`taut` - max(x, 0)) · rest_length.
- A joint angle has the names of the `joint` and of its `parent`, its stored rotation `rest` (x, y, z, w) against the
  parent, and an `axis` in the parent's space. The joint's turn against its parent, both by their matrices with scale
  taken out, from that of `rest` is a matrix D; with s = (D₃₂ - D₂₃, D₁₃ - D₃₁, D₂₁ - D₁₂) it measures
  2 atan2(`axis` · s, 1 + trace D).
- Its `tension` is a shortening of the distance, `length` scene units times an activation from 0 to 1: the weight of a
  `morph` target, or `keys` of some clips, and 0 in others.
- Where a muscle has `gains`, its belly moves as its ends come nearer: `weights` are looked up by the distance without
  the tension, and are multiplied by `gains`, looked up with it.
- A segment with `lows` has further targets, in the order of the `lows` above 0: a weight below 0 is 0, and over minus
  its `lows` it is the weight of the further one.
- The response has rows of `weights`, linear between them, at `shortenings`, 1 - distance / rest length, or `angles`.
  Weights at shortenings grow with the rest length: they are those of the rows times the length now / `rest_length`.
  Besides angles there may be rows of clips, `paths`, by the whole turn of the joint, and where another joint folds the
  surface, too, by its turn as well: see `Path`.
- Flesh has `modes`, springs that follow a joint: see `drive.swing`.
- A field has `turns`, joint angles, each with rows of weights for the targets whose places it `raises`. Those of all
  turns act as `turned.together` says.
- A touch has `windows`, directions of the rings of wrinkles round it: see `drive.touch`.
- `strengths` are factors on the weights in some clips; `strength` is the factor in all others. Weights are 0 where any
  of the targets `own` is not: these belong to one clip alone, which drives them itself.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from itertools import compress
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias, TypeVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.choices import EFFECTS
from wrinklecli.drive.angle import Angles, JointAngle, read_angle
from wrinklecli.drive.segment import Lengths, RestLength, Segment, Tension, point_json, read_point
from wrinklecli.drive.stored import (
    TAUT,
    Json,
    read_keys,
    read_number,
    read_numbers,
    read_spring,
    read_strengths,
    stored,
    strengths_json,
)
from wrinklecli.drive.table import BaseDrive, BellyTable, Table, Weights, read_table, split
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, interpolated
from wrinklecli.tools.records import Lag

if TYPE_CHECKING:
    from wrinklecli.drive.swing import SwingDrive
    from wrinklecli.drive.touch import TouchDrive
    from wrinklecli.drive.turned import TurnDrive

LAYOUT = 3
"""The version of these keys, 1 in extras without the key `layout`; no other version is read."""

_Reading = TypeVar("_Reading", covariant=True)


class Reader(Protocol[_Reading]):
    """A function that measures a signal in one clip."""

    def __call__(self, times: Floats, known: dict[int, Floats], /) -> _Reading:
        """Measure at (frames,) seconds. `known` holds rows of nodes at these times, as in `node_rows`."""


class Moments(NamedTuple):
    """Seconds of a clip in which weights are looked up by the time alone."""

    times: Floats

    @property
    def active(self) -> Bools:
        """(frames,) True."""
        return np.ones(len(self.times), np.bool_)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Weights over the time of one clip, linear between (rows,) `times`, seconds: (rows, targets) `weights`."""

    times: Floats
    weights: Floats

    @property
    def corners(self) -> Floats:
        """(times,) those where a weight differs from 0, and those next to them."""
        acting = np.pad(self.weights.any(axis=1), 1)
        return self.times[acting[:-2] | acting[1:-1] | acting[2:]]


class Lowered(NamedTuple):
    """Measurements in a clip in which the weights are lowered over time.

    Attributes:
        reading: The measurements.
        heights: (frames, 1) factors on the weights.
    """

    reading: Any
    heights: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Drive(BaseDrive):
    """A signal, a filter and a response that give the weights of some morph targets.

    Attributes:
        name: The tool's name; empty for a joint.
        signal: The measurement in the posed rig; None if weights are no function of one.
        targets: Names of the morph targets.
        response: Weights by the measurement; 0 without a signal.
        rows: By clip, weights that are known there, in place of those by the measurement: contact solves the asset's
            own clips, and vertices may be projected in each frame. They are not stored, as the clip has its track.
        heights: By clip, factors on the weights over time, one a row. They are not stored either.
        lag: The filter; None if the weights follow at once.
        strengths: By clip, factors on the weights.
        strength: The factor in all other clips.
        own: Names of further targets, each of one clip alone, that replace these there.
        lows: (weights,) as `split` takes them, for engines without weights below 0; None if there may be such.
    """

    name: str
    signal: Segment | JointAngle | None
    targets: tuple[str, ...]
    response: Table | BellyTable
    rows: Mapping[str, Rows] = field(default_factory=dict)
    heights: Mapping[str, Rows] = field(default_factory=dict)
    lag: Lag | None = None
    strengths: Mapping[str, float] = field(default_factory=dict)
    strength: float = 1.0
    own: tuple[str, ...] = ()
    lows: Floats | None = None

    @property
    def nodes(self) -> frozenset[int]:
        """The nodes whose matrices the signal needs."""
        if self.signal is None:
            return frozenset()
        if isinstance(self.signal, JointAngle):
            return self.signal.nodes
        return frozenset(node for point in self.signal.points for node in point.nodes.tolist())

    @property
    def measures(self) -> bool:
        """True if it has a signal."""
        return self.signal is not None

    def reader(self, rig: Rig, clip: Clip | None) -> Reader[Lengths | Angles | Moments | Lowered]:
        """A function from (frames,) seconds of a clip, and rows known there as in `node_rows`, to measurements."""
        read, lower = self._reader(rig, clip), None if clip is None else self.heights.get(clip.name)
        if lower is None:
            return read
        return lambda times, known: Lowered(read(times, known), interpolated(times, lower.times, lower.weights))

    def _reader(self, rig: Rig, clip: Clip | None) -> Reader[Lengths | Angles | Moments]:
        if self.signal is None or (clip is not None and clip.name in self.rows):
            return lambda times, _known: Moments(times)
        if isinstance(self.signal, JointAngle):
            return partial(self.signal.angles, rig, clip)
        segment, spring = self.signal, self.signal.spring(self.lag, rig, clip)
        if spring is None:
            return partial(segment.lengths, rig, clip)

        def read(times: Floats, known: dict[int, Floats]) -> Lengths:
            found = segment.lengths(rig, clip, times, known)
            return found._replace(distances=spring(times, found.distances, found.rest_lengths))

        return read

    def weights(self, clip: Clip | None, reading: Any, response: Weights | None = None) -> Floats:
        """(frames, targets) weights at measurements in a clip, by another response than its own if there is one."""
        if isinstance(reading, Lowered):
            return reading.heights * self.weights(clip, reading.reading, response)
        if isinstance(reading, Moments):
            found = self.rows.get("" if clip is None else clip.name)
            if found is None:
                return np.zeros((len(reading.times), len(self.targets)))
            return split(interpolated(reading.times, found.times, found.weights), self.lows)
        strength = self.strength if clip is None else self.strengths.get(clip.name, self.strength)
        return split(strength * (self.response if response is None else response).weights(reading), self.lows)

    def of_targets(self, kept: Bools) -> "Drive":
        """The drive of some of its (targets,) alone; further ones of `lows` stay with those whose place they take."""
        highs = kept[: len(kept) if self.lows is None else len(self.lows)]
        return replace(
            self,
            targets=tuple(compress(self.targets, kept)),
            response=self.response.mapped(lambda weights: weights[..., highs]),
            lows=None if self.lows is None else self.lows[highs],
        )

    def breaks(self, clip: Clip) -> Floats:
        """(times,) seconds of a clip at which the weights may have corners, besides the clip's own keys."""
        if clip.name in self.heights:
            own = replace(self, heights={}).breaks(clip)
            return np.concatenate([own, self.heights[clip.name].corners])
        if clip.name in self.rows:
            return self.rows[clip.name].corners
        return self.signal.breaks(clip) if isinstance(self.signal, Segment) else np.zeros(0)

    def why_flat(self, rig: Rig, clip: Clip, times: Floats) -> str | None:
        """Why a tool makes no wrinkle at (frames,) seconds of a clip; None for a joint, which has a tool beside it."""
        if not isinstance(self.signal, Segment):
            return None
        lengths = self.signal.lengths(rig, clip, times)
        least = float(np.min(lengths.distances / lengths.rest_lengths))
        if self.strengths.get(clip.name, self.strength) == 0:
            return f"{self.name} stays flat, as its strength is 0 in this clip"
        if np.isinf(least):
            return f"{self.name} stays flat, as the body is scaled to nothing"
        return f"{self.name} stays flat, as its ends come no closer than {100 * least:.4g} % of its rest length"

    def to_json(self, names: Sequence[str], morph_names: Sequence[str]) -> Json:
        """The drive as extras store it, by the names of all nodes and of the rig's morph targets."""
        assert self.signal is not None, "weights by time alone are in the clips' tracks"
        if isinstance(self.signal, JointAngle):
            head = self.signal.to_json(names)
        else:
            head = {"name": self.name, **_segment_json(self.signal, names, morph_names)}
            if self.lag is not None:
                head["lag"] = {"frequency": self.lag.frequency, "damping": self.lag.damping, "taut": TAUT}
        return {
            **head,
            **strengths_json(self.strengths, self.strength),
            "targets": list(self.targets),
            **({"own": list(self.own)} if self.own else {}),
            **({} if self.lows is None else {"lows": stored(self.lows)}),
            **self.response.to_json(),
        }


AnyDrive: TypeAlias = "Drive | SwingDrive | TouchDrive | TurnDrive"


@dataclass(frozen=True, slots=True, eq=False)
class StoredDrive:
    """A drive as extras hold it, by the names of joints: these may be in another file.

    Attributes:
        name: The tool's name, or the joint's.
        joints: Names of all joints that its signal needs.
        targets: Names of its morph targets.
        keyed: Names of the clips that key its rest length or its tension.
        data: The whole drive as stored.
    """

    name: str
    joints: tuple[str, ...]
    targets: tuple[str, ...]
    keyed: frozenset[str]
    data: Json

    @property
    def measures_segment(self) -> bool:
        """True if its signal is a segment, False if it is a joint, several joints or a tip."""
        return not any(key in self.data for key in ("joint", "windows", "turns"))

    @property
    def acts_alone(self) -> bool:
        """True if it acts without others, False for a fold, which has nothing to move where no tool acts."""
        return self.measures_segment or any(key in self.data for key in ("modes", "windows", "turns"))

    @property
    def carrying_targets(self) -> frozenset[str]:
        """Names of the morph targets that carry its anchors."""
        if not self.measures_segment:
            return frozenset()
        return frozenset(name for anchor in anchors_of(self.data) for name in anchor.get("morphs", {}))

    @classmethod
    def read(cls, data: Json) -> "StoredDrive":
        """Read and check a drive in extras.

        Raises:
            KeyError, TypeError, ValueError: The extras are not what `bake` writes.
        """
        turns = data.get("turns", [data, *([data["other"]] if "other" in data else [])] if "joint" in data else [])
        if turns:
            joints = [joint for each in turns for joint in (each["joint"], each.get("parent")) if joint is not None]
        else:
            further = [anchor for place in data.get("row", ()) for anchor in anchors_of(place)]
            points = [*anchors_of(data), *([data["by"]] if "by" in data else []), *data.get("limb", ()), *further]
            joints = [joint for point in points for joint in point["joints"]]
        names = tuple(dict.fromkeys(str(joint) for joint in joints))
        targets = tuple(str(name) for name in data["targets"])
        drive = cls(str(data.get("name", names[0])), names, targets, _keyed(data), data)
        drive.on({name: number for number, name in enumerate(names)}, sorted(drive.carrying_targets))
        return drive

    def on(self, nodes: Mapping[str, int], morph_names: Sequence[str]) -> AnyDrive:
        """The drive on a rig, from nodes by name, and the names of the rig's morph targets."""
        data = self.data
        # Imported here, as most bakes have no such drive.
        if "modes" in data:
            from wrinklecli.drive.swing import read_swing

            return read_swing(data, nodes)
        if "windows" in data:
            from wrinklecli.drive.touch import read_touch

            return read_touch(data, nodes, morph_names)
        if "turns" in data:
            from wrinklecli.drive.turned import read_turned

            return read_turned(data, nodes)
        joint = "joint" in data
        lows = read_numbers(data["lows"], -1) if "lows" in data else None
        response = read_table(data, len(self.targets) if lows is None else len(lows))
        if lows is not None and (not (lows >= 0).all() or len(lows) + np.count_nonzero(lows) != len(self.targets)):
            raise ValueError
        strengths, strength = read_strengths(data)
        return Drive(
            name=self.name,
            signal=read_angle(data, nodes) if joint else _read_segment(data, nodes, morph_names),
            targets=self.targets,
            response=response,
            lag=Lag(*read_spring(data["lag"])) if "lag" in data else None,
            strengths=strengths,
            strength=strength,
            own=tuple(str(name) for name in data.get("own", ())),
            lows=lows,
        )


def _keyed(data: Json) -> frozenset[str]:
    """Names of the clips that key a rest length, a tension or a touch."""
    keyed = (data.get("rest_length_keys", {}), data.get("tension", {}).get("keys", {}), data.get("keys", {}))
    return frozenset(clip for each in keyed for clip in each)


def is_baked(node: Json) -> bool:
    """True if a node's extras have an entry `wrinkle`, whoever wrote it."""
    extras = node.get("extras")
    return isinstance(extras, dict) and extras.get("wrinkle") is not None


def wrinkle_entry(node: Json) -> Json:
    """The entry `wrinkle` of a node's extras; empty without one, or if it is no object."""
    entry = node["extras"]["wrinkle"] if is_baked(node) else {}
    return entry if isinstance(entry, dict) else {}


def stored_drives(entry: Json) -> list[Json]:
    """The drives in a node's extras, in the order in which they act; KeyError if no bake has written them."""
    return [drive for name in EFFECTS for drive in (entry[name] if name == "tools" else entry.get(name, ()))]


def anchors_of(data: Json) -> list[Json]:
    """The anchors of a segment in extras, from origin to target; KeyError if there are none."""
    return list(data["anchors"]) if "anchors" in data else [data["origin"], data["target"]]


def _segment_json(segment: Segment, names: Sequence[str], morph_names: Sequence[str]) -> Json:
    points = [point_json(point, names, morph_names) for point in segment.points]
    # A player of two anchors does not look for those of a path.
    anchors = dict(zip(("origin", "target"), points, strict=True)) if len(points) == 2 else {"anchors": points}
    rest, tension = segment.rest_length, segment.tension
    head = {**anchors, "rest_length": stored(rest.constant)}
    if tension is not None:
        keys = {clip: stored(each) for clip, each in tension.keys.items()}
        drawn = {"keys": keys} if tension.morph is None else {"morph": morph_names[tension.morph]}
        head["tension"] = {"length": stored(tension.length), **drawn}
    if rest.morph is not None:
        number, full = rest.morph
        return {**head, "rest_length_morph": {"name": morph_names[number], "full": stored(full)}}
    return {**head, "rest_length_keys": {clip: stored(keys) for clip, keys in rest.keys.items()}} if rest.keys else head


def _read_segment(data: Json, nodes: Mapping[str, int], morph_names: Sequence[str]) -> Segment:
    points = tuple(read_point(anchor, nodes, morph_names) for anchor in anchors_of(data))
    morph, constant = data.get("rest_length_morph"), read_number(data["rest_length"])
    keys = read_keys(data, 2, "rest_length_keys")
    full = read_number(morph["full"]) if morph else constant
    lengths = [constant, full, *(x for each in keys.values() for x in each[:, 1])]
    if len(points) < 2 or not all(length > 0 for length in lengths):
        raise ValueError
    there = morph is not None and str(morph["name"]) in morph_names
    follows = (list(morph_names).index(str(morph["name"])), full) if morph and there else None
    return Segment(points, RestLength(constant, keys, follows), _read_tension(data, morph_names))


def _read_tension(data: Json, morph_names: Sequence[str]) -> Tension | None:
    said = data.get("tension")
    if said is None:
        return None
    keys, name = read_keys(said, 2), said.get("morph")
    there = name is not None and str(name) in morph_names
    return Tension(read_number(said["length"]), keys, list(morph_names).index(str(name)) if there else None)
