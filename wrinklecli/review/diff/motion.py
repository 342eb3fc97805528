"""Two assets compared for golden tests: what the documents mean, and what a viewer sees over time."""

import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wrinklecli.character.clip import Clip, clip_grid, no_clip, read_clips
from wrinklecli.character.pose import joint_matrices
from wrinklecli.character.scene import ScenePrimitive, pose_primitive, read_scene
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.guard import Progress, guarded, no_progress
from wrinklecli.numeric.nearest import farthest
from wrinklecli.review.diff.difference import Difference, Limits
from wrinklecli.review.diff.documents import document_differences
from wrinklecli.tools.records import Length

# Told how many times, or what share of one, are done.
_Advance = Callable[[float], None]

# On one machine the same bake gives the same bytes. Between processors float64 results differ by 2e-14, so that now and
# then a stored float32 rounds the other way, by 1.2e-7 of itself; a posed position is made of several. So: eight such
# roundings at the asset's size, or at its farthest coordinate where that is more.
DEFAULT_TOLERANCE = Length(1e-4, percent=True)
_ROUNDINGS = 8 * 2.0**-23
# Frames per second of the grid of times, which the clips' own keys join.
DEFAULT_FPS = 30.0
# Vertices of a file posed at once, over all times of a chunk: bounds the memory (about 100 bytes each).
_CHUNK = 2**16
# A vector of length 0 is 1 from any unit vector: below this squared distance there is none.
_ZERO_CHORD = 0.99


@dataclass(frozen=True, slots=True)
class Worst:
    """Where the two assets are farthest apart, as posed.

    Attributes:
        distance: Scene units.
        side: The asset that the vertex is of: A, or B where that one's vertex is far from A's surface.
        place: JSON pointer of the primitive there.
        name: Of its node.
        vertex: Of the primitive.
        clip: None for the stored pose.
        time: Seconds.
    """

    distance: float
    side: str
    place: str
    name: str
    vertex: int
    clip: str | None
    time: float


@dataclass(frozen=True, slots=True)
class Comparison:
    """What a comparison has found.

    Attributes:
        differences: All beyond the tolerance; none where the assets are the same.
        tolerance: Scene units.
        size: Diagonal of the larger asset's bounding box in the stored pose, scene units.
        times: How many moments were compared, the stored pose among them.
        worst: The greatest distance, within the tolerance or not; None where nothing could be compared.
        normal: The greatest angle between normals of one vertex, degrees; None where none could be compared.
    """

    differences: tuple[Difference, ...]
    tolerance: float
    size: float
    times: int
    worst: Worst | None
    normal: float | None

    @property
    def same(self) -> bool:
        """Whether nothing differs beyond the tolerance."""
        return not self.differences

    def lines(self, most: int | None = None) -> Iterator[str]:
        """A line for each difference, at most so many of a kind, and one for the whole."""
        shown: Counter[str] = Counter()
        for each in self.differences:
            shown[each.kind] += 1
            if most is None or shown[each.kind] <= most:
                name = f" ({each.name})" if each.name else ""
                yield f"{each.place or '/'}{name}: {each.message}"
        for kind, count in shown.items():
            if most is not None and count > most:
                yield f"... and {count - most} more of kind {kind}"
        yield self.summary

    @property
    def summary(self) -> str:
        """One line for the whole."""
        verdict = "same" if self.same else "different"
        if self.worst is None:
            return f"{verdict}: no positions to compare"
        what = f"at most {self.worst.distance:.3g} apart"
        if self.worst.distance:
            at = _when(self.worst.clip, self.worst.time)
            what += f" ({self.worst.name!r} in {self.worst.side}, vertex {self.worst.vertex}, {at})"
        moments = f"{self.times} moment{'' if self.times == 1 else 's'}"
        angle = f", normals at most {self.normal:.3g} degrees" if self.normal else ""
        return f"{verdict}: {what}{angle}; tolerance {self.tolerance:.3g}, {moments}"


def compare(
    a: str | os.PathLike[str],
    b: str | os.PathLike[str],
    *,
    tolerance: Length = DEFAULT_TOLERANCE,
    posed: bool = False,
    clips: Sequence[str] = (),
    fps: float = DEFAULT_FPS,
    allow_external: bool = False,
    progress: Progress = no_progress,
) -> Comparison:
    """Compare two assets.

    Positions are compared in every clip that both have, vertex by vertex where the triangles are the same, otherwise
    by the distance of each one's vertices from the other's triangles. `posed` leaves it at that: the documents may
    differ in whatever a viewer does not see move.

    Args:
        a: The first .gltf or .glb, such as the golden.
        b: The second.
        tolerance: The greatest distance at which they are the same: scene units, or per cent of the asset's size. The
            same share holds for numbers that are no lengths. In per cent it is never below eight float32 roundings.
        posed: Compare only posed positions.
        clips: Names of the clips to compare; all, and the stored pose, where left out.
        fps: Frames per second of the grid of times, which the clips' own keys join.
        allow_external: Read buffers and images outside the assets' folders too.
        progress: Called with a stage's name, steps done and steps in all.

    Raises:
        AssetError: An asset is missing or malformed, or neither has a clip of a name.
        BakeError: A clip has more than 200,000 frames.

    Example:
        >>> compare("knee.golden.glb", "knee.glb").same
        True
    """
    documents = [read_document(path, allow_external=allow_external) for path in (a, b)]
    sides = []
    for document in documents:
        with guarded(document.path):
            sides.append(_Side(document, read_scene(document), read_clips(document)))
    names = list(dict.fromkeys(clip.name for side in sides for clip in side.clips))
    for name in clips:
        if name not in names:
            where = f"{documents[0].path} and {documents[1].path}"
            raise AssetError(f"have {no_clip(name, names)}", where=where)
    with guarded(f"{documents[0].path} and {documents[1].path}"):
        return _compare(sides[0], sides[1], tolerance, posed, clips, fps, progress)


@dataclass(frozen=True, slots=True)
class _Side:
    """One of the two assets."""

    document: Document
    parts: tuple[ScenePrimitive, ...]
    clips: tuple[Clip, ...]


def _compare(
    a: _Side, b: _Side, tolerance: Length, posed: bool, clips: Sequence[str], fps: float, progress: Progress
) -> Comparison:
    boxes = [_stored_boxes(side) for side in (a, b)]
    size = max(float(np.linalg.norm(np.ptp(_joined(each), axis=0))) for each in boxes)
    reach = max(float(np.abs(_joined(each)).max()) for each in boxes)
    limit = tolerance.resolve(size)
    if tolerance.percent:
        limit = max(limit, _ROUNDINGS * reach)
    # Where there is nothing to see, numbers are all that is compared.
    share = limit / size if size and limit else DEFAULT_TOLERANCE.value / 100
    found: list[Difference] = []
    if not posed:
        limits = Limits(limit or share, share, _scales(a))
        found += document_differences(a.document, b.document, limits, clips=clips)
    moments, others = _moments(a, b, clips, fps)
    # Comparing the documents has found these too.
    found += others if posed else []
    total, done = sum(len(moment.times) for moment in moments), 0.0

    def advance(times: float) -> None:
        nonlocal done
        done += times
        progress("compare", round(done), total)

    seen = _together([_compare_moment(a, b, moment, limit, advance) for moment in moments])
    return Comparison((*found, *seen.differences), limit, size, seen.times, seen.worst, seen.normal)


def _stored_boxes(side: _Side) -> list[Floats]:
    """(2, 3) bounds of each part in the stored pose, scene units; where some are hidden, NaN for these."""
    boxes = []
    for part in side.parts:
        posed = pose_primitive(part, None, np.zeros(1))
        positions = posed.positions[0]
        box = np.stack([positions.min(axis=0), positions.max(axis=0)])
        boxes.append(np.full((2, 3), np.nan) if posed.hidden[0] else box)
    return boxes


def _joined(boxes: Sequence[Floats]) -> Floats:
    """(2, 3) bounds of all boxes that are shown; 0 where none is."""
    shown = [box for box in boxes if not np.isnan(box).any()]
    if not shown:
        return np.zeros((2, 3))
    return np.stack([np.min([box[0] for box in shown], axis=0), np.max([box[1] for box in shown], axis=0)])


def _scales(side: _Side) -> dict[int, float]:
    """By mesh, how many scene units a bind unit is in the stored pose, in the mean of its vertices."""
    scales: dict[int, float] = {}
    for part in side.parts:
        matrices = joint_matrices(part.rig, None, np.zeros(1))[0, :, :3, :3]
        shares = part.skin.weights.sum(axis=1)
        scale = float(shares @ np.cbrt(np.abs(np.linalg.det(matrices))) / shares.sum())
        if scale > 0:
            scales[part.rig.mesh] = max(scale, scales.get(part.rig.mesh, 0.0))
    return scales


# Moments


@dataclass(frozen=True, slots=True)
class _Moment:
    """A clip of both assets, or the stored pose, and when to look."""

    clips: tuple[Clip | None, Clip | None]
    times: Floats

    @property
    def name(self) -> str | None:
        return self.clips[0].name if self.clips[0] else None


def _moments(a: _Side, b: _Side, chosen: Sequence[str], fps: float) -> tuple[list[_Moment], list[Difference]]:
    """The stored pose and the clips that both have; and what of the clips differs."""
    moments: list[_Moment] = []
    found: list[Difference] = []
    others = {clip.name: clip for clip in b.clips if not chosen or clip.name in chosen}
    one_switches = False
    for clip in a.clips:
        if chosen and clip.name not in chosen:
            continue
        other = others.pop(clip.name, None)
        place = f"/animations/{clip.index}"
        if other is None:
            found.append(Difference("structure", place, clip.name, "only in A"))
            continue
        spans = np.array([[clip.start, clip.end], [other.start, other.end]])
        # Times are stored in float32.
        if (np.abs(spans[0] - spans[1]) > _ROUNDINGS * np.maximum(1.0, np.abs(spans[0]))).any():
            shown = " -> ".join(f"{start:.6g} to {end:.6g} s" for start, end in spans.tolist())
            found.append(Difference("animation", place, clip.name, shown))
        switches = [each for each in (_switch_times(a, clip), _switch_times(b, other)) if len(each)]
        if len(switches) == 1:
            # Frames shown one after another are what they stand for at their own times only, and the stored pose is
            # the first of them.
            one_switches = True
            times = switches[0]
        else:
            grids = [clip_grid(each, None, fps=fps) for each in (clip, other)]
            times = np.unique(np.concatenate([*grids, clip.key_times(), other.key_times()]))
        moments.append(_Moment((clip, other), times))
    found += [Difference("structure", f"/animations/{clip.index}", clip.name, "only in B") for clip in others.values()]
    if not chosen and not one_switches:
        moments.insert(0, _Moment((None, None), np.zeros(1)))
    return moments, found


def _switch_times(side: _Side, clip: Clip) -> Floats:
    """(times,) when a clip shows or hides a mesh by scaling its node in steps; none where it does not."""
    scales = {channel.node: channel for channel in clip.channels if channel.path == "scale"}
    switching = {
        node: channel
        for node, channel in scales.items()
        if channel.interpolation == "STEP" and (channel.values == 0).all(axis=1).any() and channel.values.any()
    }
    times = [np.zeros(0)]
    for part in side.parts:
        node = part.rig.node
        while node >= 0:
            if node in switching and not part.rig.skinned:
                times.append(switching[node].times)
            node = int(part.rig.parents[node])
    return np.unique(np.concatenate(times))


# Positions


@dataclass(frozen=True, slots=True)
class _Apart:
    """How far a part, or what is left of both assets, is apart in a clip.

    Attributes:
        worst: The greatest distance.
        normal: The greatest angle between normals, degrees; None where there are none on both sides.
        off: How many vertices are beyond the tolerance; None where surfaces were compared.
        total: Of how many.
    """

    worst: Worst
    normal: float | None
    off: int | None
    total: int


@dataclass(frozen=True, slots=True)
class _Seen:
    """What posing has shown.

    Attributes:
        times: How many moments.
        worst: The greatest distance.
        normal: The greatest angle between normals, degrees.
        differences: What is beyond the tolerance.
    """

    times: int
    worst: Worst | None
    normal: float | None
    differences: tuple[Difference, ...]


def _together(several: Sequence[_Seen]) -> _Seen:
    worsts = [each.worst for each in several if each.worst is not None]
    normals = [each.normal for each in several if each.normal is not None]
    return _Seen(
        sum(each.times for each in several),
        max(worsts, key=lambda each: each.distance, default=None),
        max(normals, default=None),
        tuple(difference for each in several for difference in each.differences),
    )


def _compare_moment(a: _Side, b: _Side, moment: _Moment, tolerance: float, advance: _Advance) -> _Seen:
    """Compare what both show in a clip."""
    shown = [_shown(side.parts, clip, moment.times) for side, clip in zip((a, b), moment.clips, strict=True)]
    # Times at which both show the same parts go together.
    _, groups = np.unique(np.concatenate(shown, axis=1), axis=0, return_inverse=True)
    groups = groups.reshape(-1)
    same_clip = _equal_clips(*moment.clips)
    found: dict[str, _Apart] = {}
    alone: dict[str, Difference] = {}
    for group in dict.fromkeys(groups.tolist()):
        times = moment.times[groups == group]
        frame = int(np.argmax(groups == group))
        parts_a, parts_b = (
            [side.parts[k] for k in np.flatnonzero(each[frame])] for side, each in zip((a, b), shown, strict=True)
        )
        pairs, left_a, left_b = _matched(parts_a, parts_b, moment, float(times[0]), tolerance)
        share = 1.0 / max(len(pairs) + int(bool(left_a and left_b)), 1)
        results = []
        for one, other in pairs:
            if same_clip and _equal_parts(one, other):
                results.append(_untouched(one, moment, float(times[0])))
                advance(share * len(times))
            else:
                results.append(_compare_vertices(one, other, moment, times, tolerance, advance, share))
        if left_a and left_b:
            results.append(_compare_surfaces(left_a, left_b, moment, times, advance, share))
        else:
            for part in (*left_a, *left_b):
                message = f"{_when(moment.name, float(times[0]))}: only in {'A' if left_a else 'B'}"
                alone.setdefault(_place(part), Difference("pose", _place(part), part.name, message))
        for result in results:
            key = result.worst.place
            if key not in found or result.worst.distance > found[key].worst.distance:
                found[key] = result
    beyond = [_difference(each) for each in found.values() if each.worst.distance > tolerance]
    normals = [each.normal for each in found.values() if each.normal is not None]
    worst = max((each.worst for each in found.values()), key=lambda each: each.distance, default=None)
    return _Seen(len(moment.times), worst, max(normals, default=None), (*alone.values(), *beyond))


def _shown(parts: Sequence[ScenePrimitive], clip: Clip | None, times: Floats) -> Bools:
    """(times, parts) whether a part is shown; a node that is scaled to nothing is not."""
    shown = np.ones((len(times), len(parts)), bool)
    by_node: dict[int, Bools] = {}
    for column, part in enumerate(parts):
        if not part.rig.skinned:
            if part.rig.node not in by_node:
                matrices = joint_matrices(part.rig, clip, times)[:, 0, :3, :3]
                by_node[part.rig.node] = np.linalg.det(matrices) != 0
            shown[:, column] = by_node[part.rig.node]
    return shown


def _matched(
    parts_a: Sequence[ScenePrimitive], parts_b: Sequence[ScenePrimitive], moment: _Moment, time: float, tolerance: float
) -> tuple[list[tuple[ScenePrimitive, ScenePrimitive]], list[ScenePrimitive], list[ScenePrimitive]]:
    """Pairs of parts of the same triangles, and those that are left of each asset.

    Among several of the same triangles: the one of the same name, or where that is elsewhere, the nearest.
    """
    waiting: dict[tuple[int, bytes], list[ScenePrimitive]] = {}
    for part in parts_b:
        waiting.setdefault(_topology(part), []).append(part)
    pairs, left_a = [], []
    for part in parts_a:
        candidates = waiting.get(_topology(part), [])
        if not candidates:
            left_a.append(part)
            continue
        chosen = candidates[0]
        if len(candidates) > 1:
            at = np.array([time])
            positions = pose_primitive(part, moment.clips[0], at).positions

            def away(other: ScenePrimitive, positions: Floats = positions, at: Floats = at) -> float:
                return float(np.abs(pose_primitive(other, moment.clips[1], at).positions - positions).max())

            named = [each for each in candidates if (each.name, each.primitive) == (part.name, part.primitive)]
            chosen = named[0] if named and away(named[0]) <= tolerance else min(candidates, key=away)
        candidates.remove(chosen)
        pairs.append((part, chosen))
    return pairs, left_a, [part for candidates in waiting.values() for part in candidates]


def _topology(part: ScenePrimitive) -> tuple[int, bytes]:
    return len(part.vertices.positions), part.triangles.tobytes()


def _equal_clips(one: Clip | None, other: Clip | None) -> bool:
    """Whether two clips have the same keys to the bit, by the same numbers of nodes."""
    if one is None or other is None:
        return one is other
    return one.moves_as(other)


def _equal_parts(one: ScenePrimitive, other: ScenePrimitive) -> bool:
    """Whether two parts are the same to the bit, as is all that moves them: a clip then poses both alike."""
    first, second = one.rig, other.rig
    if (first.node, first.skinned, len(first.locals)) != (second.node, second.skinned, len(second.locals)):
        return False
    arrays = [
        (
            *(part.vertices.positions, part.vertices.morph_deltas, part.vertices.normals, part.vertices.normal_deltas),
            *(part.vertices.joints, part.vertices.weights),
            *(part.rig.joints, part.rig.inverse_binds, part.rig.parents, part.rig.morph_weights),
        )
        for part in (one, other)
    ]
    return all(_equal(*pair) for pair in zip(*arrays, strict=True)) and all(
        here.keys() == there.keys() and all(np.array_equal(here[key], there[key]) for key in here)
        for here, there in zip(first.locals, second.locals, strict=True)
    )


def _equal(one: NDArray[Any] | None, other: NDArray[Any] | None) -> bool:
    return one is other if one is None or other is None else np.array_equal(one, other)


def _untouched(part: ScenePrimitive, moment: _Moment, time: float) -> _Apart:
    """What comparing a part with itself would give."""
    worst = Worst(0.0, "A", _place(part), part.name, 0, moment.name, time)
    return _Apart(worst, None if part.vertices.normals is None else 0.0, 0, len(part.vertices.positions))


def _compare_vertices(
    one: ScenePrimitive,
    other: ScenePrimitive,
    moment: _Moment,
    times: Floats,
    tolerance: float,
    advance: _Advance,
    share: float,
) -> _Apart:
    """Compare two parts of the same triangles, vertex by vertex; `share` of each time is theirs."""
    seen = _used(one)
    # A slice is not copied.
    used: Ints | slice = seen if len(seen) < len(one.vertices.positions) else slice(None)
    off = np.zeros(len(seen), bool)
    worst, normal = _untouched(one, moment, float(times[0])).worst, None
    step = max(1, _CHUNK // len(one.vertices.positions))
    for start in range(0, len(times), step):
        now = times[start : start + step]
        first, second = (pose_primitive(part, clip, now) for part, clip in zip((one, other), moment.clips, strict=True))
        squared = _squared_distances(first.positions, second.positions)[:, used]
        beyond = squared > tolerance**2
        if beyond.any():
            off |= beyond.any(axis=0)
        frame, vertex = np.unravel_index(int(squared.argmax()), squared.shape)
        if squared[frame, vertex] > worst.distance**2:
            far, when = float(np.sqrt(squared[frame, vertex])), float(now[frame])
            worst = replace(worst, distance=far, vertex=int(seen[vertex]), time=when)
        if first.normals is not None and second.normals is not None:
            normal = max(normal or 0.0, _greatest_angle(first.normals, second.normals, used))
        advance(share * len(now))
    return _Apart(worst, normal, int(off.sum()), len(seen))


def _used(part: ScenePrimitive) -> Ints:
    """The vertices that are seen: those of triangles, or all points and lines."""
    return np.unique(part.triangles) if len(part.triangles) else np.arange(len(part.vertices.positions))


def _squared_distances(first: Floats, second: Floats) -> Floats:
    """(frames, vertices) of (frames, vertices, 3), coordinate by coordinate, as posing leaves them in memory."""
    squared = np.zeros(first.shape[:2])
    for k in range(3):
        apart = first[..., k] - second[..., k]
        apart *= apart
        squared += apart
    return squared


def _greatest_angle(first: Floats, second: Floats, used: Ints | slice) -> float:
    """Degrees between unit vectors (frames, vertices, 3); those of which one is 0 are left out."""
    squared = _squared_distances(first, second)[:, used]
    if squared.max(initial=0.0) > _ZERO_CHORD:
        lengths = (_squared_distances(each, np.zeros(3))[:, used] for each in (first, second))
        squared = np.where(next(lengths) * next(lengths) > 0, squared, 0.0)
    chord = float(np.sqrt(squared.max(initial=0.0)))
    return float(np.degrees(2.0 * np.arcsin(min(chord / 2.0, 1.0))))


def _compare_surfaces(
    left_a: Sequence[ScenePrimitive],
    left_b: Sequence[ScenePrimitive],
    moment: _Moment,
    times: Floats,
    advance: _Advance,
    share: float,
) -> _Apart:
    """Compare parts of other triangles by the distance of each one's vertices from the other's triangles."""
    worst = _untouched(left_a[0], moment, float(times[0])).worst
    soups = [_Soup.of(parts) for parts in (left_a, left_b)]
    hints: list[Ints | None] = [None, None]
    step = max(1, _CHUNK // max(soup.vertex_count for soup in soups))
    for start in range(0, len(times), step):
        now = times[start : start + step]
        posed = [
            np.concatenate([pose_primitive(part, clip, now).positions for part in parts], axis=1)
            for parts, clip in zip((left_a, left_b), moment.clips, strict=True)
        ]
        for frame, time in enumerate(now.tolist()):
            for k, side in enumerate("AB"):
                points = posed[k][frame][soups[k].used]
                corners = posed[1 - k][frame][soups[1 - k].triangles]
                found = farthest(points, corners, hints=hints[k], floor=worst.distance)
                hints[k] = found.hints
                if found.point >= 0:
                    part, vertex = soups[k].vertex(int(soups[k].used[found.point]))
                    worst = Worst(found.distance, side, _place(part), part.name, vertex, moment.name, time)
            advance(share)
    return _Apart(worst, None, None, 0)


@dataclass(frozen=True, slots=True)
class _Soup:
    """Parts as one surface.

    Attributes:
        parts: They.
        starts: (parts + 1,) the first vertex of each.
        used: The vertices that are seen.
        triangles: (triangles, 3); points, and vertices of lines, are triangles without extent.
    """

    parts: tuple[ScenePrimitive, ...]
    starts: Ints
    used: Ints
    triangles: Ints

    @classmethod
    def of(cls, parts: Sequence[ScenePrimitive]) -> "_Soup":
        starts = np.cumsum([0] + [len(part.vertices.positions) for part in parts])
        used = [_used(part) + start for part, start in zip(parts, starts, strict=False)]
        triangles = [
            part.triangles + start if len(part.triangles) else np.repeat(each[:, None], 3, axis=1)
            for part, each, start in zip(parts, used, starts, strict=False)
        ]
        return cls(tuple(parts), starts, np.concatenate(used), np.concatenate(triangles))

    @property
    def vertex_count(self) -> int:
        return int(self.starts[-1])

    def vertex(self, number: int) -> tuple[ScenePrimitive, int]:
        """The part that a vertex is of, and its number there."""
        index = int(np.searchsorted(self.starts, number, side="right")) - 1
        return self.parts[index], number - int(self.starts[index])


def _place(part: ScenePrimitive) -> str:
    return f"/meshes/{part.rig.mesh}/primitives/{part.primitive}"


def _when(clip: str | None, time: float) -> str:
    return "stored pose" if clip is None else f"clip {clip!r} at {time:.6g} s"


def _difference(apart: _Apart) -> Difference:
    worst = apart.worst
    if apart.off is None:
        other = "B" if worst.side == "A" else "A"
        message = f"vertex {worst.vertex} of {worst.side} is {worst.distance:.3g} from the surface of {other}"
    else:
        message = f"vertex {worst.vertex} is {worst.distance:.3g} off"
        message += f"; {apart.off} of {apart.total} are" if apart.off > 1 else ""
    return Difference("pose", worst.place, worst.name, f"{_when(worst.clip, worst.time)}: {message}", worst.distance)
