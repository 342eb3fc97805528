"""Faults that contact must not make in a surface: two bakes, with contact and without, as a player shows them."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kit.player import Gltf, Json
from wrinklecli.baking.report import Report
from wrinklecli.numeric.intersections import Crossings, edges_of, widened

LEFT_OUT, LEAVES = "it is left out of this fold", "contact leaves crossings"
"""Words of a line about a fold: it has no contact; or contact leaves crossings there, and how many."""

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
# Moments of a clip, evenly spread: at and between the keys of weights.
_MOMENTS = 25
# Edges are torn beyond these parts of the longer, and of the shorter, of their lengths at rest and without contact.
_LONGEST, _SHORTEST = 2.0, 0.5
# So many edges from what crosses without contact is the bottom of a crease, which is pressed together.
_PRESSED_RINGS = 3
# Cosine between a triangle and each of its neighbours below which it is turned over.
_TURNED = -0.5
# Seconds beside a pose that does not settle in which contact fades: it begins earlier if less would cross so.
_FADE = 0.2
# Greatest part that contact may take or give of the volume of a piece of limb, as long as it is thick, for each fold.
_VOLUME = 0.01


def faults(with_contact: Path, without: Path, report: Report, mesh: str, clip: str, radius: float) -> list[str]:
    """Each fault of a bake with contact, in words; none if it holds what is promised.

    Args:
        with_contact: The bake with `contact: resolve`.
        without: The same bake with `contact: off`.
        report: The report of the first.
        mesh: The node with the tools.
        clip: The clip to play.
        radius: Radius of the limb, scene units.
    """
    return list(_faults(Gltf(with_contact), Gltf(without), report, mesh, clip, radius))


def moments(file: Gltf, clip: str, count: int) -> Floats:
    """(count,) seconds of a clip, evenly spread over the keys of all of its channels."""
    keys = [file.array(each["input"])[:, 0] for each in file.clip(clip)["samplers"]]
    return np.linspace(min(each[0] for each in keys), max(each[-1] for each in keys), count)


def treated_crossings(
    file: Gltf, mesh: str | int, clip: str, times: Floats, report: Json, resolved: Gltf, *, said: Sequence[str]
) -> NDArray[np.int64]:
    """(times,) edges through triangles at vertices that tools or contact move in a bake, as another file has them.

    Edges that pass through a triangle at rest too do not count.

    Args:
        file: The bake, the same without contact, or the asset.
        mesh: The node with the tools.
        clip: The clip to play.
        times: Seconds of the clip.
        report: The report of the bake with contact.
        resolved: The bake with contact.
        said: Leave out folds of which a line says one of these.
    """
    treated = _treated(resolved, report, mesh, said)
    # Vertices of the asset keep their numbers in each primitive, and new ones follow.
    counts = [
        [each.json["accessors"][part["attributes"]["POSITION"]]["count"] for part in each.mesh(mesh)["primitives"]]
        for each in (resolved, file)
    ]
    starts = np.concatenate([[0], np.cumsum(counts[0])[:-1]])
    rows = np.concatenate([start + np.arange(count) for start, count in zip(starts, counts[1], strict=True)])
    firsts, welded = _welded(file.attribute(mesh, "POSITION"))
    marked = np.zeros(len(firsts), bool)
    marked[welded[treated[rows]]] = True
    triangles = _whole(welded[file.triangles(mesh)])
    trees = Crossings.of(file.attribute(mesh, "POSITION")[firsts], triangles)
    (rest,) = file.pose(mesh, None, [0.0])[:, firsts]
    return _counts(trees, rest, file.pose(mesh, clip, times)[:, firsts], marked)


def own_crossings(
    file: Gltf, mesh: str | int, clip: str, times: Floats, *, without: Sequence[int] = ()
) -> NDArray[np.int64]:
    """(times,) edges of a mesh that pass through its own triangles, without some of the morph targets."""
    places = file.attribute(mesh, "POSITION")
    firsts, welded = _welded(places)
    trees = Crossings.of(places[firsts], _whole(welded[file.triangles(mesh)]))
    posed = file.pose(mesh, clip, times, without=without)[:, firsts]
    return np.array([len(trees.at(positions)[0]) for positions in posed])


def _faults(one: Gltf, other: Gltf, report: Report, mesh: str, clip: str, radius: float) -> Iterator[str]:
    times = moments(one, clip, _MOMENTS)
    rest = one.attribute(mesh, "POSITION")
    firsts, welded = _welded(rest)
    triangles = _whole(welded[one.triangles(mesh)])
    if not np.array_equal(rest, other.attribute(mesh, "POSITION")):
        yield "other vertices than without contact"
        return
    shown, given = (each.pose(mesh, clip, times)[:, firsts] for each in (one, other))
    still = [each.pose(mesh, None, [0.0])[:, firsts] for each in (one, other)]
    if not (np.array_equal(shown[0], given[0]) and np.array_equal(*still)):
        yield "not at rest where the other is"
    treated = _treated(one, report.data, mesh)[firsts]
    trees = Crossings.of(rest[firsts], triangles)
    counts = [sum(len(trees.at(positions)[0]) for positions in each) for each in (shown, given)]
    left = _counts(trees, still[0][0], shown, treated)
    left[_said(report, clip, times)] = 0
    if left.any():
        yield f"{left.sum()} crossings left in treated folds, most ({left.max()}) at {times[np.argmax(left)]:.3g} s"
    if counts[0] > counts[1]:
        yield f"{counts[0]} crossings, {counts[1]} without contact"
    yield from _torn(rest[firsts], triangles, trees, shown, given, times)
    if any(fold["targets"] for fold in report.data["folds"]):
        closed, whole = _closed(triangles), len(report.data["folds"]) * 2.0 * np.pi * radius**3
        for frame in range(_MOMENTS):
            lost = abs(_volume(shown[frame], closed) - _volume(given[frame], closed)) / whole
            if lost > _VOLUME:
                yield f"volume changed by {100 * lost:.2g} % at {times[frame]:.3g} s"
                break


def _said(report: Report, clip: str, times: Floats) -> NDArray[np.bool_]:
    """(times,) True where a line says that contact does not settle, or beside it, where contact fades."""
    said = np.zeros(len(times), bool)
    for each in (each for fold in report.data["folds"] for each in fold.get("left", ())):
        if each["clip"] == clip and each["poses"]:
            assert any(f"contact {each['reason']} in {clip!r} at " in line for line in report.data["warnings"])
            said |= (times > each["begin"] - _FADE) & (times < each["end"] + _FADE)
    return said


def _torn(
    rest: Floats, triangles: Ints, trees: Crossings, shown: Floats, given: Floats, times: Floats
) -> Iterator[str]:
    edges, beside = edges_of(triangles), _neighbours(triangles)
    at_rest = _lengths(rest, edges)
    pressed, every = np.zeros(len(rest), bool), np.ones(len(rest), bool)
    for positions in given:
        pressed |= trees.vertices_at(positions, every)
    for _ in range(_PRESSED_RINGS):
        pressed = widened(edges, pressed)
    for frame, time in enumerate(times):
        found, wanted = _lengths(shown[frame], edges), _lengths(given[frame], edges)
        longer = found / np.maximum(wanted, at_rest)
        shorter = np.where(pressed[edges].any(axis=1), 1.0, found / np.minimum(wanted, at_rest))
        if longer.max() > _LONGEST:
            yield f"an edge {longer.max():.3g} times as long at {time:.3g} s"
        if shorter.min() < _SHORTEST:
            yield f"an edge {shorter.min():.3g} times as long at {time:.3g} s"
        turned = _turned(shown[frame], triangles, beside) & ~_turned(given[frame], triangles, beside)
        if turned.any():
            yield f"{np.count_nonzero(turned)} triangles turned over at {time:.3g} s"
        if longer.max() > _LONGEST or shorter.min() < _SHORTEST or turned.any():
            return


def _welded(positions: Floats) -> tuple[Ints, Ints]:
    """One vertex for each place, and the place of each vertex."""
    _, firsts, numbers = np.unique(positions, axis=0, return_index=True, return_inverse=True)
    return firsts, numbers.reshape(-1)


def _whole(triangles: Ints) -> Ints:
    """The triangles with three vertices."""
    return triangles[(np.diff(np.sort(triangles, axis=1), axis=1) > 0).all(axis=1)]


def _counts(trees: Crossings, rest: Floats, shown: Floats, marked: NDArray[np.bool_]) -> NDArray[np.int64]:
    """(frames,) edges that pass through triangles, with a marked vertex of either, and that do not so at rest."""
    still, found = set(zip(*trees.at(rest), strict=True)), []
    for positions in shown:
        edges, crossed = trees.at(positions)
        ours = marked[trees.edges[edges]].any(axis=1) | marked[trees.triangles[crossed]].any(axis=1)
        found.append(len(set(zip(edges[ours], crossed[ours], strict=True)) - still))
    return np.array(found)


def _treated(file: Gltf, report: Json, mesh: str | int, said: Sequence[str] = (LEFT_OUT,)) -> NDArray[np.bool_]:
    """(vertices,) True for those that tools or contact move, but not in folds of which a line says one of these."""
    names, deltas = file.mesh(mesh).get("extras", {}).get("targetNames", []), file.deltas(mesh)

    def moved(parts: Iterable[Json]) -> NDArray[np.bool_]:
        columns = [names.index(name) for part in parts for name in part["targets"]]
        return np.asarray(deltas[columns].any(axis=(0, 2)))

    lines = [line.partition(": ") for line in report["warnings"] if any(words in line for words in said)]
    without = {name for tools, _, _ in lines for name in tools.split(", ")}
    tools, folds = report["tools"], [fold for fold in report["folds"] if fold["targets"]]
    folds = [fold for fold in folds if without.isdisjoint(fold["tools"])]
    treated = moved(tool for tool in tools if tool["name"] not in without) | moved(folds)
    return treated & ~moved(tool for tool in tools if tool["name"] in without)


def _lengths(positions: Floats, edges: Ints) -> Floats:
    return np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)


def _neighbours(triangles: Ints) -> Ints:
    """(triangles, 3) the triangle across each side, -1 for none."""
    owners: dict[tuple[int, int], list[int]] = {}
    for number, corners in enumerate(triangles.tolist()):
        for k in range(3):
            owners.setdefault((min(corners[k - 1], corners[k]), max(corners[k - 1], corners[k])), []).append(number)
    found = np.full((len(triangles), 3), -1)
    for number, corners in enumerate(triangles.tolist()):
        for k in range(3):
            others = owners[min(corners[k - 1], corners[k]), max(corners[k - 1], corners[k])]
            found[number, k] = next((other for other in others if other != number), -1)
    return found


def _turned(positions: Floats, triangles: Ints, beside: Ints) -> NDArray[np.bool_]:
    """(triangles,) True for those that face away from all of their three neighbours."""
    a, b, c = (positions[triangles[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-30)[:, None]
    cosines = np.einsum("tj,tnj->tn", normals, normals[beside])
    return np.asarray((cosines < _TURNED).all(axis=1) & (beside >= 0).all(axis=1))


def _closed(triangles: Ints) -> list[Ints]:
    """(triangles, 3), and the sides of each open border, (sides, 2), the other way round."""
    sides = triangles[:, [[2, 0], [0, 1], [1, 2]]].reshape(-1, 2)
    open_sides = sides[(_neighbours(triangles) < 0).reshape(-1)][:, ::-1]
    borders, follows = [], {int(one): int(two) for one, two in open_sides}
    while follows:
        start, end = follows.popitem()
        border = [(start, end)]
        while end in follows:
            border.append((end, follows.pop(end)))
            end = border[-1][1]
        borders.append(np.array(border))
    return [triangles, *borders]


def _volume(positions: Floats, closed: list[Ints]) -> float:
    """Volume of a surface, as `_closed` gives it: lids to the mean of each border close it."""
    triangles, *borders = closed
    corners = positions[triangles]
    lids = [np.concatenate([positions[each], np.tile(positions[each].mean(axis=(0, 1)), (len(each), 1, 1))], axis=1)
            for each in borders]  # fmt: skip
    a, b, c = np.concatenate([corners, *lids]).transpose(1, 0, 2)
    return float(np.sum(a * np.cross(b, c)) / 6.0)
