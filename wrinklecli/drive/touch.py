"""The drive of a touch: how far a tip has slid the skin, and the weights of slide, dent and rings that follow from it.

The slide d has a part forward and a part sideways. Its shapes are those of an elastic skin, which is linear, so their
weights are d / `grip`; each of the four ways has a target of its own, so that no weight is below 0. Moves add up
linearly, but a surface that is curved otherwise forward than sideways is left least by ways along its main
curvatures: `turn` is the angle from forward to the first way. The dent's weight is the depth of the tip below the
skin over `deepest`. A ring rises with f(|d| / grip) · cos(angle of d - angle of its window), where f is a table that
starts like a square root, as all wrinkles do.

Slides and depths are keyed in some clips, linear between keys, and held before the first one. After the last one
the tip lets go, and the skin springs back: x'' = -ω² x - 2 ζ ω x'.

Where a joint bends the skin, eight more targets change the slides: their weights are those of the four ways times the
sine of the bend towards the skin, and then away from it. The sine is the third coordinate of the way between the two
points `limb`, which the other side of the joint carries, in the axes from the place's middle.

In other clips a node may touch. Its coordinates are those in the axes from the place's middle to the points before,
beside and above it, times `pad`; its height is the third less that of the skin, which `bend` gives: a f² + b f s + c
s² at f forward and s sideways. It touches once it is nearer than `deepest` and less than `pad` from the middle,
sticks to the skin and takes it along until the slide is `grip`, then slips, and lets go once it is farther than
`deepest` or than `pad` + `grip` from the middle. A player that knows the tip at its frames alone reads in `ends`
when it lets go between them. A clip that loops begins as it ends.

A touch may travel along a row of places, `spacing` apart, each of which faces the next one. A tip has coordinates in
the axes of each place; those that count are a mean, by the shares of the two places beside the tip, which are linear
between them and sum to 1. The tip's way forward is the distance along the row. Where the tip is less its slide, two
places share the slide in the same way, and each does what a fixed one does with its part. A place of a row has three
targets, so that 24 are enough for eight places: slides forward and back, and the rings ahead.

In extras, a drive has the `anchors` of its place (the middle, and the points before, beside and above it), `pad`,
`grip` and `deepest` in scene units, `bend`, the tip `by` if there is one, `release` with `frequency` and `damping`,
`limb` if there is one, `windows` in radians, `turn` in radians unless it is 0, `rises` (rows of slide over grip and
weight), by clip `keys`: rows of seconds, slide forward and sideways, and depth, scene units; and by clip `ends`, the
seconds at which the tip lets go. One that travels has its `spacing`, and in `row` the `anchors`, `bend`, `windows` and
`rises` of each further place.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from itertools import compress
from typing import ClassVar, Self

import numpy as np

from wrinklecli.character.carried import CarriedPoint, carried_places, pose_carriers
from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import LEAST_SCALE
from wrinklecli.character.rig import Rig
from wrinklecli.drive.segment import point_json, read_point
from wrinklecli.drive.stored import MOST_KEPT, Json, read_keys, read_number, read_numbers, read_spring, stored
from wrinklecli.drive.table import BaseDrive
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, determinants
from wrinklecli.numeric.memory import once
from wrinklecli.numeric.spring import Spring

# Samples per second of the tip's way, at least; most of a clip; and halvings between two in which a contact begins.
_SAMPLES, _MOST_SAMPLES, _HALVINGS = 240.0, 100_000, 12
# Part of the pad by which a tip that ends where it began may be elsewhere, and of the time between two samples.
_SAME = 1e-3
# Part of the grip by which the skin may jump where a clip loops: rings start like a square root, and jump by 0.3 % of
# their height. And rounds of a loop at most until it comes round: a tip that rubs the skin slips in the first one.
_LEAST_LEFT, _ROUNDS = 1e-5, 4
# Slides forward, sideways, back and to the other side, and the dent; and those of them with targets in a row.
EVERY, IN_ROW = (0, 1, 2, 3, 4), (0, 2)


@dataclass(frozen=True, slots=True, eq=False)
class TouchPlace:
    """A place where a tip slides the skin.

    Attributes:
        anchors: The middle of the place, and points before, beside and above it, a pad away.
        bend: (3,) the skin's height round the middle, one over scene units.
        windows: (windows,) directions of the rings' windows, radians.
        rises: (rows, 2) slides over the greatest, and weights of the rings; sorted.
    """

    anchors: tuple[CarriedPoint, ...]
    bend: Floats
    windows: Floats
    rises: Floats

    def to_json(self, names: Sequence[str], morph_names: Sequence[str]) -> Json:
        """The place as extras store it, by the names of all nodes and of the rig's morph targets."""
        return {
            "anchors": [point_json(point, names, morph_names) for point in self.anchors],
            "bend": stored(self.bend),
            "windows": stored(self.windows),
            "rises": stored(self.rises, 5),
        }

    @classmethod
    def read(cls, data: Json, nodes: Mapping[str, int], morph_names: Sequence[str]) -> Self:
        """Read a place in extras.

        Raises:
            KeyError, TypeError, ValueError: The extras are not what `bake` writes.
        """
        anchors = tuple(read_point(each, nodes, morph_names) for each in data["anchors"])
        rises = read_numbers(data["rises"], -1, 2)
        if len(anchors) != 4 or not len(rises) or not (np.diff(rises[:, 0]) > 0).all():
            raise ValueError
        return cls(anchors, read_numbers(data["bend"], 3), read_numbers(data["windows"], -1), rises)


@dataclass(frozen=True, slots=True, eq=False)
class TouchDrive(BaseDrive):
    """A tip that slides the skin of one place, or of a row of places.

    Attributes:
        name: The touch's name.
        places: One, or those of a row in order.
        pad: Radius of the tip, scene units.
        grip: Greatest slide, scene units.
        deepest: Greatest depth, and height below which a tip touches, scene units.
        release: The spring by which the skin comes back.
        targets: Names of the morph targets: slides forward, sideways, back and to the other side, each turned by
            `turn`, the dent, the windows, and with a `limb` the changes of the four slides in a bend towards the skin,
            and in one away from it. In a row for each place slides forward and back, and the windows.
        keys: By clip, (keys, 4) seconds, slides forward and sideways, and depths, scene units; of one place alone.
        tip: The node that touches; None if there is none.
        ends: By clip in which the node touches, the sorted seconds at which it lets go; the last may be the clip's end.
        turn: Angle from forward to the first slide, radians.
        limb: Two points, a pad apart along the limb at rest, beyond the joint that bends the skin; None if none does.
        spacing: Distance between two places of a row at rest, scene units.
    """

    name: str
    places: tuple[TouchPlace, ...]
    pad: float
    grip: float
    deepest: float
    release: Spring
    targets: tuple[str, ...]
    keys: Mapping[str, Floats] = field(default_factory=dict)
    tip: CarriedPoint | None = None
    ends: Mapping[str, Floats] = field(default_factory=dict)
    turn: float = 0.0
    limb: tuple[CarriedPoint, CarriedPoint] | None = None
    spacing: float = 0.0
    _strokes: dict[bytes, tuple[Floats, ...]] = field(default_factory=dict, init=False, repr=False)

    bent: ClassVar[int] = 8
    """Targets behind those of the rings, if a joint bends the skin."""

    @property
    def nodes(self) -> frozenset[int]:
        """The nodes that carry the places and the tip."""
        anchors = [point for place in self.places for point in place.anchors]
        points = [*anchors, *([] if self.tip is None else [self.tip]), *(self.limb or ())]
        return frozenset(node for point in points for node in point.nodes.tolist())

    @property
    def slides(self) -> tuple[int, ...]:
        """Numbers, among slides forward, sideways, back and to the other side, and the dent, of those with a target."""
        return IN_ROW if len(self.places) > 1 else EVERY

    def of_targets(self, kept: Bools) -> "TouchDrive":
        """The drive of some of its (targets,) alone, all slides and bends among them: windows may move nothing."""
        places, end = [], 0
        for place in self.places:
            first = end + len(self.slides)
            end = first + len(place.windows)
            places.append(replace(place, windows=place.windows[kept[first:end]]))
        return replace(self, places=tuple(places), targets=tuple(compress(self.targets, kept)))

    @property
    def length(self) -> float:
        """The length of the row, scene units."""
        return self.spacing * (len(self.places) - 1)

    def shares(self, along: Floats) -> Floats:
        """(places, frames) shares of the places at (frames,) distances along the row; they sum to 1."""
        passed = np.clip(along, 0.0, self.length) / (self.spacing or 1.0)
        return np.maximum(1.0 - np.abs(passed - np.arange(len(self.places))[:, None]), 0.0)

    def tip_in(self, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
        """(frames, 3) the tip's place forward, sideways and above the skin, at (frames,) seconds, scene units.

        It is infinitely far away where the skin is scaled to nothing.
        """
        assert self.tip is not None
        found, all_shown = np.zeros((len(self.places), len(times), 3)), np.ones(len(times), np.bool_)
        for place, each in zip(self.places, found, strict=True):
            middle, axes, shown, (tip,) = self.axes_in(rig, clip, times, [self.tip], place)
            each[:] = self.pad * np.linalg.solve(axes, (tip - middle)[:, :, None])[:, :, 0]
            forward, sideways = each[:, 0], each[:, 1]
            each[:, 2] -= place.bend @ np.stack([forward**2, forward * sideways, sideways**2])
            all_shown &= shown
        along = np.clip(found[:-1, :, 0], 0.0, self.spacing).sum(axis=0)
        found[:, :, 0] += self.spacing * np.arange(len(found))[:, None]
        return np.where(all_shown[:, None], np.einsum("kf,kfx->fx", self.shares(along), found), np.inf)

    def axes_in(
        self,
        rig: Rig,
        clip: Clip | None,
        times: Floats,
        others: Sequence[CarriedPoint] = (),
        place: TouchPlace | None = None,
    ) -> tuple[Floats, Floats, Bools, list[Floats]]:
        """A place, by default the first one, at (frames,) seconds: its middle, its axes, and where other points are.

        Returns:
            (frames, 3) world space, (frames, 3, 3) columns forward, sideways and above, `pad` long at rest, (frames,)
            False where joints are scaled to nothing, and for each of the others (frames, 3) world space.
        """
        anchors = (place or self.places[0]).anchors
        points = [*anchors, *others]
        carriers = pose_carriers(points, rig, clip, times)
        places = [carried_places(each, carriers, len(times))[0].T for each in points]
        middle, *ends = places[: len(anchors)]
        axes = np.stack([end - middle for end in ends], axis=2)
        shown = np.abs(determinants(axes)) >= (LEAST_SCALE * self.pad) ** 3
        return middle, np.where(shown[:, None, None], axes, np.eye(3)), shown, places[len(anchors) :]

    def remaining(self, seconds: Floats) -> Floats:
        """(…,) what is left of a slide (…,) seconds after the tip has let go, over the slide then."""
        cosine, sine = self.release.decay(self.release.speed * np.maximum(seconds, 0.0))
        return np.asarray(cosine + self.release.damping * sine)

    def strokes_in(self, rig: Rig, clip: Clip | None) -> tuple[Floats, ...]:
        """The contacts of a clip, in order: (keys, 5) rows.

        A row has seconds, slides forward and sideways, the depth, and the distance along the row of the skin below.
        """
        if clip is None:
            return ()
        if clip.name in self.keys:
            return (np.pad(self.keys[clip.name], ((0, 0), (0, 1))),)
        if self.tip is None:
            return ()
        return once(self._strokes, clip.motion, partial(self._touched, rig, clip), MOST_KEPT)

    def ends_in(self, rig: Rig, clips: Sequence[Clip]) -> dict[str, Floats]:
        """The sorted seconds at which the node lets go, by each clip in which it touches."""
        strokes = {clip.name: self.strokes_in(rig, clip) for clip in clips if clip.name not in self.keys}
        starts = {clip.name: clip.start for clip in clips}
        return {
            name: np.array([rows[-1, 0] for rows in each if rows[-1, 0] >= starts[name]])
            for name, each in strokes.items()
            if each
        }

    def _touched(self, rig: Rig, clip: Clip) -> tuple[Floats, ...]:
        """The strokes of the tip in a clip. A loop begins where the last stroke of the round before leaves the skin."""
        count = int(np.clip(np.ceil((clip.end - clip.start) * _SAMPLES), 1, _MOST_SAMPLES))
        times = np.linspace(clip.start, clip.end, count + 1)
        breaks = [each.times for each in clip.channels if each.path != "weights"]
        times = np.unique(np.concatenate([times, *(b[(b > clip.start) & (b < clip.end)] for b in breaks)]))
        tips = self.tip_in(rig, clip, times)
        strokes = self._strokes_of(rig, clip, times, tips, np.zeros((0, 5)))
        if not strokes or not clip.loops or not np.allclose(tips[-1], tips[0], 0.0, _SAME * self.pad):
            return strokes
        for _ in range(_ROUNDS):
            first, last = self._released(strokes, np.array([clip.start, clip.end]))[:, :2]
            if float(np.hypot(*(last - first))) < _LEAST_LEFT * self.grip:
                break
            earlier = strokes[-1] - [clip.end - clip.start, 0.0, 0.0, 0.0, 0.0]
            strokes = self._strokes_of(rig, clip, times, tips, earlier)
        return strokes

    def _strokes_of(self, rig: Rig, clip: Clip, times: Floats, tips: Floats, earlier: Floats) -> tuple[Floats, ...]:
        """The strokes of (frames, 3) tips at (frames,) seconds of a clip, after (keys, 5) those of an earlier one."""
        strokes: list[Floats] = []
        rows: list[Floats] = []
        if len(earlier):
            # At the clip's end the tip still held the skin, or had let go.
            if earlier[-1, 0] >= clip.start - _SAME / _SAMPLES:
                rows = [np.array([clip.start, *earlier[-1, 1:]])]
            else:
                strokes = [earlier]
        before = tips[0]
        for number, (time, tip) in enumerate(zip(times.tolist(), tips, strict=True)):
            held = self._touches(tip, held=bool(rows))
            if held != bool(rows) and number:
                changed = self._change(rig, clip, float(times[number - 1]), time, held=held)
                (edge,) = self.tip_in(rig, clip, np.array([changed]))
                if held:
                    left = self._released(strokes, np.array([changed]))[0, :2]
                    rows, before = [np.array([changed, *left, 0.0, edge[0] - left[0]])], edge
                elif changed > rows[-1][0]:
                    # A tip beside skin that is scaled to nothing is nowhere: it lets go where it was.
                    rows.append(self._row(changed, rows[-1], before, edge if np.isfinite(edge).all() else before))
            if held:
                row = self._row(time, rows[-1] if rows else np.zeros(5), before, tip, depth=-float(tip[2]))
                rows = [*rows, row] if not rows or time > rows[-1][0] else [row]
            elif rows:
                strokes.append(np.stack(rows))
                rows = []
            before = tip
        return (*strokes, *([np.stack(rows)] if rows else []))

    def _touches(self, tip: Floats, *, held: bool) -> bool:
        """True if a tip at (3,) is near enough, or still is where it has `held` the skin."""
        return bool(tip[2] < self.deepest and self.away(tip) < (self.pad + self.grip if held else self.pad))

    def away(self, tips: Floats) -> Floats:
        """(…,) distances along the skin from the place, or from the row, of (…, 3) places of a tip."""
        along = tips[..., 0] - np.clip(tips[..., 0], 0.0, self.length)
        return np.asarray(np.hypot(along, tips[..., 1]))

    def _change(self, rig: Rig, clip: Clip, low: float, high: float, *, held: bool) -> float:
        """The second between two at which the tip comes, if `held` is what it is at the later one, or goes."""
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            same = self._touches(self.tip_in(rig, clip, np.array([middle]))[0], held=not held) == held
            low, high = (low, middle) if same else (middle, high)
        return high

    def _row(self, time: float, last: Floats, before: Floats, tip: Floats, *, depth: float = 0.0) -> Floats:
        """(5,) the key at a second, after the tip has gone from one (3,) place to another since the last (5,) key."""
        slide = last[1:3] + (tip - before)[:2]
        slide = slide * min(1.0, self.grip / max(float(np.hypot(*slide)), TINY))
        return np.array([time, *slide, depth, tip[0] - slide[0]])

    def contacts_in(self, rig: Rig, clip: Clip | None) -> Callable[[Floats], Floats]:
        """A function from (frames,) seconds of a clip to (frames, 4) contacts, as `weights_of_contacts` has them."""
        strokes = self.strokes_in(rig, clip)
        return lambda times: self._released(strokes, times)

    def _released(self, strokes: Sequence[Floats], times: Floats) -> Floats:
        """(frames, 4) contacts by strokes, after each of which the skin springs back until the next."""
        found = np.zeros((len(times), 4))
        for number, rows in enumerate(strokes):
            since = times >= (rows[0, 0] if number else -np.inf)
            at = times[since]
            own = np.stack([np.interp(at, rows[:, 0], column) for column in rows[:, 1:].T], axis=1)
            own[:, 2] = np.clip(own[:, 2], 0.0, self.deepest)
            own[:, :3] *= self.remaining(at - rows[-1, 0])[:, None]
            found[since] = own
        found[:, 2] = np.maximum(found[:, 2], 0.0)
        return found

    def bends_in(self, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
        """(frames,) sines of the bend of the limb against the place, towards the skin, at (frames,) seconds."""
        if self.limb is None:
            return np.zeros(len(times))
        _, axes, shown, (one, other) = self.axes_in(rig, clip, times, self.limb)
        heights = np.linalg.solve(axes, (other - one)[:, :, None])[:, 2, 0]
        return np.where(shown, np.clip(heights, -1.0, 1.0), 0.0)

    def weights_of_contacts(self, contacts: Floats, bends: Floats | None = None) -> Floats:
        """(frames, targets) weights of (frames, 4) contacts.

        Args:
            contacts: Slides forward and sideways, depths, and distances along the row, which may be left out for 0;
                scene units.
            bends: (frames,) sines of the limb's bend; None at rest.
        """
        slides, depths = contacts[:, :2] / self.grip, contacts[:, 2] / self.deepest
        sines = np.zeros(len(slides)) if bends is None else bends
        limb = None if self.limb is None else sines
        found = []
        for share, place in zip(self.shares(contacts[:, 3:].sum(axis=1)), self.places, strict=True):
            whole = weights_of(slides, depths, place.windows, place.rises, self.turn, limb, share)
            found.append(whole[:, [*self.slides, *range(len(EVERY), whole.shape[1])]])
        return np.concatenate(found, axis=1)

    def contact_of(self, weights: Floats) -> tuple[Floats, Floats]:
        """(frames,) lengths of the slides, and (frames,) depths, of (frames, targets) weights, scene units."""
        firsts = np.cumsum([0, *(len(self.slides) + len(place.windows) for place in self.places[:-1])])
        slides = np.zeros((len(weights), len(EVERY)))
        slides[:, list(self.slides)] = weights[:, firsts[:, None] + np.arange(len(self.slides))].sum(axis=1)
        return self.grip * np.sqrt((slides[:, :4] ** 2).sum(axis=1)), self.deepest * slides[:, 4]

    def reader(self, rig: Rig, clip: Clip | None) -> Callable[[Floats, dict[int, Floats]], Floats]:
        """A function from (frames,) seconds of a clip, and rows known as in `node_rows`, to (frames, targets) weights.

        The weights count as what is measured.
        """
        strokes = self.strokes_in(rig, clip)
        return lambda times, _known: self.weights_of_contacts(
            self._released(strokes, times), self.bends_in(rig, clip, times)
        )

    def breaks(self, clip: Clip) -> Floats:
        """(times,) seconds at which a clip keys the touch."""
        return self.keys[clip.name][:, 0] if clip.name in self.keys else np.zeros(0)

    def to_json(self, names: Sequence[str], morph_names: Sequence[str]) -> Json:
        """The drive as extras store it, by the names of all nodes and of the rig's morph targets."""
        place, *row = [each.to_json(names, morph_names) for each in self.places]
        return {
            "name": self.name,
            "anchors": place["anchors"],
            "pad": stored(self.pad),
            "grip": stored(self.grip),
            "deepest": stored(self.deepest),
            "bend": place["bend"],
            **({} if self.tip is None else {"by": point_json(self.tip, names, morph_names)}),
            **({} if self.limb is None else {"limb": [point_json(each, names, morph_names) for each in self.limb]}),
            "release": {
                "frequency": stored(self.release.speed / (2.0 * np.pi)),
                "damping": stored(self.release.damping),
            },
            "windows": place["windows"],
            **({"turn": stored(self.turn)} if self.turn else {}),
            "rises": place["rises"],
            **({"spacing": stored(self.spacing), "row": row} if row else {}),
            **({"keys": {clip: stored(keys) for clip, keys in self.keys.items()}} if self.keys else {}),
            **({"ends": {clip: stored(each) for clip, each in self.ends.items()}} if self.ends else {}),
            "targets": list(self.targets),
        }


def read_touch(data: Json, nodes: Mapping[str, int], morph_names: Sequence[str]) -> TouchDrive:
    """Read a drive of a touch in extras, on a rig whose nodes have these numbers by name.

    Raises:
        KeyError, TypeError, ValueError: The extras are not what `bake` writes.
    """
    pad, grip, deepest = (read_number(data[key]) for key in ("pad", "grip", "deepest"))
    frequency, damping = read_spring(data["release"])
    ends = {clip: read_numbers(each, -1) for clip, each in data.get("ends", {}).items()}
    limb = tuple(read_point(each, nodes, morph_names) for each in data.get("limb", ()))
    if not min(pad, grip, deepest) > 0 or len(limb) not in (0, 2):
        raise ValueError
    found = TouchDrive(
        name=str(data["name"]),
        places=tuple(TouchPlace.read(each, nodes, morph_names) for each in (data, *data.get("row", ()))),
        pad=pad,
        grip=grip,
        deepest=deepest,
        release=Spring(2.0 * np.pi * frequency, damping),
        targets=tuple(str(name) for name in data["targets"]),
        keys=read_keys(data, 4),
        tip=read_point(data["by"], nodes, morph_names) if "by" in data else None,
        ends=ends,
        turn=read_number(data.get("turn", 0.0)),
        limb=(limb[0], limb[1]) if limb else None,
        spacing=read_number(data.get("spacing", 0.0)),
    )
    in_row = len(found.places) > 1
    count = sum(len(found.slides) + len(place.windows) for place in found.places)
    if len(found.targets) != count + (TouchDrive.bent if limb else 0):
        raise ValueError
    if (found.spacing > 0) != in_row or (in_row and (found.keys or limb)):
        raise ValueError
    return found


def weights_of(
    slides: Floats,
    depths: Floats,
    windows: Floats,
    rises: Floats,
    turn: float,
    bends: Floats | None,
    share: Floats | float = 1.0,
) -> Floats:
    """(frames, targets) weights for (frames, 2) slides over the grip, and (frames,) depths over the deepest.

    `bends` are (frames,) sines of a limb's bend; None without a limb. A place of a row slides by its (frames,) `share`.
    The rest is as in `TouchDrive`.
    """
    lengths = np.sqrt((slides**2).sum(axis=1))
    # Beyond its grip the tip slips.
    slides = slides / np.maximum(lengths, 1.0)[:, None] * np.reshape(share, (-1, 1))
    lengths = share * np.minimum(lengths, 1.0)
    ways = slides / np.maximum(lengths, 1e-12)[:, None]
    ahead = ways @ np.stack([np.cos(windows), np.sin(windows)])
    rings = np.interp(lengths, *rises.T)[:, None] * np.maximum(ahead, 0.0)
    slides = slides @ turned(turn).T
    parts = [np.maximum(slides, 0.0), np.maximum(-slides, 0.0), np.clip(depths, 0.0, 1.0)[:, None], rings]
    for side in () if bends is None else (np.maximum(bends, 0.0), np.maximum(-bends, 0.0)):
        changes = side[:, None] * slides
        parts += [np.maximum(changes, 0.0), np.maximum(-changes, 0.0)]
    return np.concatenate(parts, axis=1)


def turned(turn: float) -> Floats:
    """(2, 2) axes of the slides' targets, each forward and sideways, at an angle in radians from forward."""
    cosine, sine = np.cos(turn), np.sin(turn)
    return np.array([[cosine, sine], [-sine, cosine]])
