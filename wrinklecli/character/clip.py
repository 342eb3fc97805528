"""Clips: animations with their channels, the values of channels over time, and the times at which clips are sampled.

Source: glTF 2.0 specification, §3.11 and appendix C (animation).
"""

import hashlib
from collections.abc import Container, Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from wrinklecli.character.rig import LARGEST, TRANSFORM_DEFAULTS, Rig, in_range, moving_nodes, stored_weights
from wrinklecli.errors import AssetError, BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import Animated, Channels, target_count
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, float32_values, unit_quaternions

KEY_GAP = 1e-3
"""Least time between two keys, seconds: no player shows less, and Blender drops keys closer than 0.42 ms."""

KEY_STEP = 1 / 600
"""Added keys are multiples of this, seconds, as whole frames are at 24, 25, 30, 50 and 60 per second."""

# `KEY_GAP` for times that are rounded to float32, seconds: frames at 1,000 per second are just that far apart.
_ROUNDED_GAP = 0.999 * KEY_GAP
# Bytes of a channel without its values, which all nodes that show one mesh share.
_CHANNEL_BYTES = 2048
# Most frames of a clip: almost two hours at 30 per second.
_MOST_FRAMES = 200_000
# Greatest difference of the numbers of equal rotations, scales and weights: a tenth of a degree.
_SAME_POSE = 1e-3


@dataclass(frozen=True, slots=True)
class Channel:
    """One animated property.

    Attributes:
        index: The channel's index in its animation; of several that move weights of one node, that of the first.
        path: translation, rotation, scale or weights.
        times: (keys,) seconds, strictly ascending.
        values: (keys, components), or (keys, 3, components) for CUBICSPLINE: in-tangent, value, out-tangent.
        interpolation: LINEAR, STEP or CUBICSPLINE.
        fault: Why the values are of no use: whoever asks for them raises it. Other nodes can do without.
    """

    index: int
    node: int
    path: str
    times: Floats
    values: Floats
    interpolation: str
    fault: AssetError | None = None

    @property
    def points(self) -> Floats:
        """(keys, components) values without tangents."""
        return self.values[:, 1] if self.interpolation == "CUBICSPLINE" else self.values


@dataclass(frozen=True)
class Clip:
    """An animation: the channels that move nodes and morph weights.

    Attributes:
        index: The animation's index in the document; -1 if it is in none.
        name: The animation's name, or `animation_0` by index.
        channels: What moves nodes and morph weights, by a node and a path or by a pointer.
        start: Time of the first key, seconds.
        end: Time of the last key, seconds.
        early: True if the file has keys before 0 s, where players begin; `channels` begin there.
    """

    index: int
    name: str
    channels: tuple[Channel, ...]
    start: float
    end: float
    early: bool = False

    @cached_property
    def by_target(self) -> dict[tuple[int, str], Channel]:
        """The channel of each node and path; of several the last."""
        return {(channel.node, channel.path): channel for channel in self.channels}

    @cached_property
    def moves(self) -> bool:
        """True if a value changes from key to key: clips that exporters write of one pose hold still."""
        return any((np.ptp(channel.points, axis=0) > _SAME_POSE).any() for channel in self.channels)

    @cached_property
    def held(self) -> dict[tuple[int, str], Floats]:
        """The value of each translation and scale whose channel has the same one at all keys, as exporters write."""
        return {
            place: channel.values[0] + 0.0
            for place, channel in self.by_target.items()
            if channel.path in ("translation", "scale")
            and channel.interpolation != "CUBICSPLINE"
            and (channel.values == channel.values[0]).all()
        }

    @cached_property
    def rhythms(self) -> dict[tuple[int, str], object]:
        """A key of each channel that `sample_together` takes, by node and path, equal for channels sampled at once.

        Most exporters give all channels of a clip the same key times.
        """
        return {
            place: (channel.path, channel.values.shape, channel.times.tobytes())
            for place, channel in self.by_target.items()
            if channel.interpolation == "LINEAR" and channel.fault is None and len(channel.times) > 1
        }

    @cached_property
    def nodes(self) -> frozenset[int]:
        """The nodes that have a channel."""
        return frozenset(channel.node for channel in self.channels)

    @cached_property
    def paths(self) -> frozenset[str]:
        """The paths that have a channel."""
        return frozenset(channel.path for channel in self.channels)

    def key_times(self) -> Floats:
        """(keys,) sorted distinct key times of all channels, seconds."""
        return np.unique(np.concatenate([channel.times for channel in self.channels]))

    def moves_as(self, other: "Clip") -> bool:
        """True if another clip has the same keys, to the bit, for the same nodes; names may differ."""
        return self.motion == other.motion

    @cached_property
    def motion(self) -> bytes:
        """A digest of all channels, which finds equal clips among thousands without comparing all pairs."""
        digest = hashlib.blake2b()
        for each in self.channels:
            # Names of paths and interpolations have no space; -0 and 0 are one value.
            digest.update(f"{each.node} {each.path} {each.interpolation} {each.values.shape} ".encode())
            digest.update(each.times.tobytes() + (each.values + 0.0).tobytes())
        return digest.digest()

    @cached_property
    def loops(self) -> bool:
        """True if the clip ends with the rotations, scales and weights of its beginning; a body may walk off."""
        turning = [each for each in self.channels if each.path != "translation" and each.fault is None]
        ends = [(each.points[0], each.points[-1]) for each in turning]
        # A quaternion and its negative are the same rotation.
        return all(np.abs(a - b).max() < _SAME_POSE or np.abs(a + b).max() < _SAME_POSE for a, b in ends)

    def channel(self, node: int, path: str) -> Channel | None:
        """The channel of a node's property."""
        return self.by_target.get((node, path))


def read_clips(document: Document) -> tuple[Clip, ...]:
    """Read the document's animations that move a node or morph weights.

    If two animations have one name, the later one gets `#` and its index behind it.

    Raises:
        AssetError: A sampler is malformed.
    """
    clips: list[Clip] = []
    names: set[str] = set()
    known = Channels(document.gltf)
    for index, animation in enumerate(document.items("animations")):
        channels = tuple(_read_channels(document, animation, index, known))
        if not channels:
            continue
        names.add(name := clip_name(animation, index, names))
        early = any(channel.times[0] < 0.0 for channel in channels)
        channels = tuple(map(_from_zero, channels)) if early else channels
        start = min(float(channel.times[0]) for channel in channels)
        end = max(float(channel.times[-1]) for channel in channels)
        clips.append(Clip(index, name, channels, start, end, early))
    return tuple(clips)


def clip_name(animation: Json, index: int, taken: Container[str]) -> str:
    """The name of an animation's clip; a name that is taken gets the animation's index behind it."""
    name = animation.get("name") or f"animation_{index}"
    return f"{name}#{index}" if name in taken else name


def _read_channels(document: Document, animation: Json, index: int, known: Channels) -> Iterator[Channel]:
    """Read the channels that move nodes; those that move weights of one node by pointers become one."""
    found: list[tuple[Animated, Channel]] = []
    pieces: dict[int, list[tuple[Animated, Channel]]] = {}
    for number, channel in enumerate(animation.get("channels", [])):
        moved = known.moved(channel)
        if moved is None:
            continue
        where = document.where("animations", index, "channels", number)
        sampler = animation["samplers"][channel["sampler"]]
        wanted = 1 if moved.element is not None else _width(document, moved)
        if len(moved.nodes) > 1:
            document.memory.claim(_CHANNEL_BYTES * len(moved.nodes), "weights of nodes that show one mesh", where=where)
        read = _read_channel(document, sampler, number, moved, wanted, where)
        for node in moved.nodes:
            found.append((moved, replace(read, node=node)))
            if moved.path == "weights":
                pieces.setdefault(node, []).append(found[-1])
    for moved, channel in found:
        parts = pieces[channel.node] if moved.path == "weights" else []
        several = len(parts) > 1 and any(each.mesh is not None for each, _ in parts)
        if not several and all(each.element is None for each, _ in parts):
            yield channel
        elif channel is parts[0][1]:
            yield _joined_weights(parts, stored_weights(document, channel.node))


def _from_zero(channel: Channel) -> Channel:
    """A channel with a key at 0 s in place of those before, which plays the same from there on."""
    times, values = channel.times, channel.values
    if times[0] >= 0.0 or channel.fault is not None:
        return channel
    kept, zero = times > 0.0, np.zeros(1)
    if channel.interpolation == "CUBICSPLINE":
        # Rotations are not scaled to unit length before the whole polynomial is known.
        into, out = spline_slopes(channel, zero)
        first = np.stack([into, sample(replace(channel, path="weights"), zero), out], axis=1)
    else:
        first = sample(channel, zero)
    return replace(channel, times=np.append(zero, times[kept]), values=np.concatenate([first, values[kept]]))


def _width(document: Document, moved: Animated) -> int:
    """The numbers of a key of a whole property."""
    if moved.path != "weights":
        return len(TRANSFORM_DEFAULTS[moved.path])
    return target_count(document.gltf, document.items("nodes")[moved.nodes[0]].get("mesh"))


def _read_channel(document: Document, sampler: Json, number: int, moved: Animated, wanted: int, where: str) -> Channel:
    """Read a channel for the first of the nodes that it moves."""
    times, values = (document.accessor(sampler[key]) for key in ("input", "output"))
    interpolation = sampler.get("interpolation", "LINEAR")
    if interpolation not in ("LINEAR", "STEP", "CUBICSPLINE"):
        raise AssetError(f"interpolation {interpolation!r} is not of glTF 2.0", where=where)
    groups = 3 if interpolation == "CUBICSPLINE" else 1
    if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
        raise AssetError("key times must rise", where=where)
    if values.size == 0 or values.size % (len(times) * groups):
        raise AssetError(f"{len(times)} key times do not fit {values.size} values", where=where)
    fault = None
    if not in_range(values):
        fault = AssetError(f"a key value is not a finite number, or above {LARGEST:g}", where=where)
    values = values.reshape((len(times), 3, -1) if groups == 3 else (len(times), -1))
    if values.shape[-1] != wanted:
        raise AssetError(f"a key of {moved.path} has {values.shape[-1]} numbers, not {wanted}", where=where)
    return Channel(number, moved.nodes[0], moved.path, times, values.astype(np.float64), interpolation, fault)


def _joined_weights(parts: Sequence[tuple[Animated, Channel]], stored: Floats) -> Channel:
    """One channel of all weights of a node from several, each of which moves one or all of them.

    Weights of the node go before those of its mesh, then later channels before earlier ones. Weights that none moves
    are as `stored`. The keys are those of all parts; the interpolation is theirs if they agree. Otherwise STEP becomes
    LINEAR (see `linear_keys`), and beside CUBICSPLINE straight lines get their secants as tangents, so that each
    weight moves as before.
    """
    for _, channel in parts:
        if channel.fault is not None:
            return channel
    owner = np.full(len(stored), -1)
    for number, (moved, _) in sorted(enumerate(parts), key=lambda each: each[1][0].mesh is None):
        owner[slice(None) if moved.element is None else moved.element] = number
    moving = [(parts[number][1], np.flatnonzero(owner == number)) for number in np.unique(owner[owner >= 0])]
    kinds = {channel.interpolation for channel, _ in moving}
    kind = kinds.pop() if len(kinds) == 1 else "CUBICSPLINE" if "CUBICSPLINE" in kinds else "LINEAR"
    keys = [each.times if kind == "STEP" else linear_keys(each) for each, _ in moving]
    times = distinct_values(np.concatenate(keys))
    values = np.tile(stored, (len(times), 1))
    into, out = np.zeros(values.shape), np.zeros(values.shape)
    for channel, columns in moving:
        places = columns if channel.values.shape[-1] == len(stored) else [0]
        values[:, columns] = sample(channel, times)[:, places]
        if channel.interpolation == "CUBICSPLINE":
            into[:, columns], out[:, columns] = (each[:, places] for each in spline_slopes(channel, times))
        elif len(times) > 1:
            secants = np.diff(values[:, columns], axis=0) / np.diff(times)[:, None]
            into[1:, columns], out[:-1, columns] = secants, secants
    first = parts[0][1]
    whole = np.stack([into, values, out], axis=1) if kind == "CUBICSPLINE" else values
    return Channel(first.index, first.node, "weights", times, whole, kind)


def clip_named(clips: Sequence[Clip], name: str, *, where: str) -> Clip:
    """Find the clip of a name, or raise AssetError; `where` is the asset's path."""
    names = [clip.name for clip in clips]
    AssetError.unless_known("has no clip", [name], names, where=where)
    return clips[names.index(name)]


def chosen_clips(clips: Sequence[Clip], asked: Sequence[str], *, where: str) -> tuple[Clip, ...]:
    """Find the clips of some names, in the order of the file; all clips if no name is given.

    Raises:
        AssetError: There is no clip of a name; `where` is the asset's path.
    """
    names = [clip_named(clips, name, where=where).name for name in asked]
    return tuple(clip for clip in clips if not names or clip.name in names)


def sample(channel: Channel, times: Floats) -> Floats:
    """(frames, components) values of a channel at (frames,) seconds, held before the first and after the last key.

    Rotations have unit length.

    Raises:
        AssetError: The channel has a fault.

    Source: glTF 2.0, appendix C (LINEAR, with slerp for rotations; STEP; CUBICSPLINE).
    """
    if channel.fault is not None:
        raise channel.fault
    turning = channel.path == "rotation"
    if len(channel.times) == 1:
        points = channel.points.T
        return np.tile((unit_quaternions(points) if turning else points).T, (len(times), 1))
    if channel.interpolation == "LINEAR":
        return _sample_linear([channel], times)[:, 0].T
    keys, before, t, part = _places(channel.times, times)
    # Components come first, so that all operations run along time.
    values, points = channel.values[part], channel.points[part].T
    if channel.interpolation == "STEP":
        return _at(unit_quaternions(points) if turning else points, before + (t >= 1.0)).T
    spans = keys[1:] - keys[:-1]
    leaving, arriving = values[:-1, 2].T * spans, values[1:, 0].T * spans
    start, stop = points[:, :-1], points[:, 1:]
    # Horner's scheme, with the polynomial of each interval prepared.
    squares = -3 * start + 3 * stop - 2 * leaving - arriving
    cubes = 2 * start - 2 * stop + leaving + arriving
    blended = ((_at(cubes, before) * t + _at(squares, before)) * t + _at(leaving, before)) * t + _at(start, before)
    return (unit_quaternions(blended) if turning else blended).T


def sample_together(clip: Clip, places: Sequence[tuple[int, str]], times: Floats) -> list[Floats]:
    """(components, frames) values of the channels of some nodes and paths, as `sample` gives them.

    Numpy takes as long for all channels of one rhythm as for one of them, if frames are few.
    """
    found: dict[tuple[int, str], Floats] = {}
    alike: dict[object, list[tuple[int, str]]] = {}
    for place in places:
        rhythm = clip.rhythms.get(place)
        if rhythm is None:
            found[place] = sample(clip.by_target[place], times).T
        else:
            alike.setdefault(rhythm, []).append(place)
    for group in alike.values():
        sampled = _sample_linear([clip.by_target[place] for place in group], times)
        found.update(zip(group, sampled.transpose(1, 0, 2), strict=True))
    return [found[place] for place in places]


def _places(keys: Floats, times: Floats) -> tuple[Floats, Ints, Floats, slice]:
    """The places of (frames,) times among two or more keys.

    Returns:
        The keys that are needed; (frames,) indices of the ones before, and fractions of the intervals after these; and
        the part of all keys, as a few times of a long clip need only the keys around them.
    """
    before = np.minimum(np.maximum(keys.searchsorted(times, side="right") - 1, 0), len(keys) - 2)
    part = slice(int(before.min(initial=len(keys) - 2)), int(before.max(initial=0)) + 2)
    keys, before = keys[part], before - part.start
    t = np.minimum(np.maximum((times - _at(keys, before)) / _at(keys[1:] - keys[:-1], before), 0.0), 1.0)
    return keys, before, t, part


def _sample_linear(channels: Sequence[Channel], times: Floats) -> Floats:
    """(components, channels, frames) values of LINEAR channels of one path and with the same key times."""
    _, before, t, part = _places(channels[0].times, times)
    points = np.stack([each.values[part] for each in channels]).transpose(2, 0, 1)
    if channels[0].path == "rotation":
        return _slerp(unit_quaternions(points), before, t)
    return _at(points, before) + _at(points[..., 1:] - points[..., :-1], before) * t


def _at(values: Floats, places: Ints) -> Floats:
    """(…, frames) values of (…, keys) at indices in range: "clip" avoids a check, and indexing takes longer still."""
    return values.take(places, axis=-1, mode="clip")


def _slerp(points: Floats, before: Ints, t: Floats) -> Floats:
    """(4, …, frames) rotations at fractions t of the intervals `before`, (frames,) each, of (4, …, keys) unit ones."""
    start, stop = points[..., :-1], points[..., 1:]
    cosine = np.einsum("c...,c...->...", start, stop)
    stop = np.where(cosine < 0, -stop, stop)
    # The arc cosine of the product would lose half the digits of a small angle; sum and difference do not.
    angle = 2.0 * np.arctan2(
        *(np.sqrt(np.einsum("c...,c...->...", each, each)) for each in (stop - start, stop + start))
    )
    sine = np.sin(angle)
    # Below this angle the division would lose more digits than a straight line.
    near = sine < 1e-6
    inverse = np.where(near, 0.0, 1.0 / np.where(near, 1.0, sine))
    whole, inverse = _at(angle, before), _at(inverse, before)
    turned = t * whole
    first, second = np.sin(whole - turned) * inverse, np.sin(turned) * inverse
    if near.any():
        straight = _at(near, before)
        first, second = np.where(straight, 1.0 - t, first), np.where(straight, t, second)
    between: Floats = first * _at(start, before) + second * _at(stop, before)
    return np.where(near.any(axis=-1, keepdims=True), unit_quaternions(between), between) if near.any() else between


def spline_slopes(channel: Channel, at: Floats) -> tuple[Floats, Floats]:
    """(keys, targets) derivatives per second of a CUBICSPLINE channel before and after each time."""
    keys, values = channel.times, channel.values
    slopes = []
    for side in ("left", "right"):
        if len(keys) == 1:
            slopes.append(np.zeros((len(at), values.shape[2])))
            continue
        piece = np.searchsorted(keys, at, side="left" if side == "left" else "right") - 1
        outside = (piece < 0) | (piece > len(keys) - 2)
        piece = np.clip(piece, 0, len(keys) - 2)
        span = (keys[piece + 1] - keys[piece])[:, None]
        t = (at - keys[piece])[:, None] / span
        change = values[piece + 1, 1] - values[piece, 1]
        slope = (
            6.0 * (t - t * t) * change / span
            + (1.0 - 4.0 * t + 3.0 * t * t) * values[piece, 2]
            + (3.0 * t * t - 2.0 * t) * values[piece + 1, 0]
        )
        slopes.append(np.where(outside[:, None], 0.0, slope))
    return slopes[0], slopes[1]


def clip_grid(clip: Clip, rig: Rig | None, *, fps: float, corners: Floats | None = None) -> Floats:
    """(frames,) sorted seconds, float32 values: a grid over the clip with its end, and the keys that move a rig.

    (corners,) further seconds count as keys.

    Each jump of a STEP channel has a time just before it, too. No two times are closer than `KEY_GAP`, except the keys
    of the rig's own morph weights, which a track keeps, and the two ends. A time of the grid gives way to a key, and a
    key to a later one.

    Raises:
        BakeError: There would be more than 200,000 frames.
    """
    if (clip.end - clip.start) * fps > _MOST_FRAMES:
        raise BakeError(
            f"lasts {clip.end - clip.start:.6g} s, at {fps:.6g} frames per second more than {_MOST_FRAMES:,} frames",
            where=clip.name,
        )
    count = int(np.floor((clip.end - clip.start) * fps * (1.0 + 1e-9)))
    moving = set() if rig is None else moving_nodes(rig)
    keys = [np.zeros(0) if corners is None else corners[(corners > clip.start) & (corners < clip.end)]]
    kept = [np.array([clip.start, clip.end])]
    for channel in clip.channels:
        if channel.node in moving:
            own = rig is not None and channel.node == rig.node and channel.path == "weights"
            (kept if own else keys).append(linear_keys(channel))
    grid = distinct_values(float32_values(np.concatenate(kept)))
    grid = _joined(grid, distinct_values(float32_values(np.concatenate(keys))))
    return _joined(grid, float32_values(clip.start + np.arange(count + 1) / fps))


def linear_keys(channel: Channel) -> Floats:
    """(keys,) sorted seconds between which straight lines play a LINEAR or STEP channel, except within `KEY_GAP`.

    A STEP channel has its keys and, one gap before each, the last float32 time at which the channel has not jumped yet,
    unless the key before is closer than two gaps.
    """
    if channel.interpolation != "STEP":
        return channel.times
    before = _just_before(channel.times[1:] - KEY_GAP)
    return distinct_values(np.concatenate([channel.times, before[before >= channel.times[:-1] + KEY_GAP]]))


def _joined(kept: Floats, more: Floats) -> Floats:
    """(times,) sorted: the kept ones, and those of `more` at least `KEY_GAP` from these and from the next added one."""
    padded, after = np.concatenate([[-np.inf], kept, [np.inf]]), np.searchsorted(kept, more)
    nearest = np.minimum(more - padded[after], padded[after + 1] - more)
    return distinct_values(np.concatenate([kept, _apart(more[nearest >= _ROUNDED_GAP])]))


def _apart(times: Floats) -> Floats:
    """(remaining,) sorted times of which each is at least `KEY_GAP` before the next."""
    if not (np.diff(times) < _ROUNDED_GAP).any():
        return times
    remaining = [float(times[-1])]
    for time in times[-2::-1].tolist():
        if remaining[-1] - time >= _ROUNDED_GAP:
            remaining.append(time)
    return np.array(remaining[::-1])


def motion_breaks(clip: Clip, rig: Rig) -> Floats:
    """(breaks,) sorted seconds, float32 values, between which a clip moves a rig smoothly.

    A jump of a STEP channel gives two: its key and the last float32 time before it.
    """
    moving = moving_nodes(rig)
    keys = [np.zeros(0)]
    for channel in clip.channels:
        if channel.node in moving:
            keys.append(channel.times)
            if channel.interpolation == "STEP":
                keys.append(_just_before(channel.times[1:]))
    return distinct_values(float32_values(np.concatenate(keys)))


def _just_before(times: Floats) -> Floats:
    """The last float32 time before each time."""
    return np.nextafter(times.astype(np.float32), np.float32(-np.inf)).astype(np.float64)
