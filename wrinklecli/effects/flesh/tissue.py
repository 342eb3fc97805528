"""The tissue of a region: what of it is within the body, what holds it, and the shapes in which it swings.

The region is the part of the body within a ball, or within a mask, cut into cubes (`numeric.elements`). It is held by
bones and by what lies beyond the region: there, tissue is stiffer the nearer it is, and at last does not move. So
shapes fade smoothly into the still skin, and regions that touch add up without a crease.

The result depends on the region's geometry alone. Frequency, damping and limit come after it, so a change of them finds
it again: it is kept in this process, and in a store if a caller gives one.

Source: C. Larboulette, M.-P. Cani, B. Arnaldi, *Dynamic Skinning: Adding Real-time Dynamic Effects to an Existing
Character Animation*, SCCG 2005. Differs: that paper attaches springs to an offset of the skeleton, with weights that
fall off by distance; here, the weights are those of an elastic solid.
"""

from itertools import product

import numpy as np

from wrinklecli.effects.kept import digest_of, keep, kept_solution, read_records, written_records
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, components, flags_of, ramp, smoothstep
from wrinklecli.numeric.closest import is_inside, nearest_of
from wrinklecli.numeric.elements import CORNERS, Modes, Tissue, ritz_modes
from wrinklecli.numeric.memory import once
from wrinklecli.surface.bones import bone_distances

NODES = 2_400
"""Nodes of a region, about: more of them move the shapes by less than the error of six springs, and take longer."""

# Part of the way from a bone to the skin up to which nothing moves, and from which on bones do not hold.
_HELD, _LOOSE = 0.15, 0.65
# Part of the radius from which on the rest of the body holds.
_INNER = 0.3
# Softness below which tissue does not move: its stiffness would be 50 times that of loose flesh.
_LEAST_SOFTNESS = 0.02
# Cubes along the longest side of the box in which the region's volume is measured first.
_PROBED = 14
# Parts of a cube along an axis, by which it is measured how much of it is filled.
_PARTS = 3
# Layers of cubes beyond the tissue into which its moves are continued, for skin that the cubes miss.
_LAYERS = 3
# Regions whose shapes this process keeps.
_MOST = 16
# Bytes of a stored solution at most: a grid of 100 nodes along each side and 9 shapes would take twice as much.
_MOST_BYTES = 2**27


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """The body from which a region is cut, world space at rest.

    Attributes:
        positions: (vertices, 3) of the skin.
        triangles: (triangles, 3).
        bones: (bones, 2, 3) ends of the bones.
    """

    positions: Floats
    triangles: Ints
    bones: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """The place of a region.

    Attributes:
        at: (3,) its middle, on the skin.
        radius: Scene units.
        softness: (vertices,) factors from 0 to 1 at the skin's vertices, continued inwards; None if all are 1.
    """

    at: Floats
    radius: float
    softness: Floats | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Swings:
    """The shapes in which a region swings, on its grid.

    Attributes:
        low: (3,) place of the grid's first node.
        size: Length of a cube's edge, scene units.
        values: (modes, x, y, z, 3) displacements under a vector r_k along the mode's load, at the nodes of the grid.
        loads: (modes, 3) unit vectors.
        speeds: (modes,) ω of each mode over that of the first.
        tissue: The elements, for those who want to check the reduction.
    """

    low: Floats
    size: float
    values: Floats
    loads: Floats
    speeds: Floats
    tissue: Tissue

    def moves(self, points: Floats) -> Floats:
        """(modes, points, 3) displacements at (points, 3), smooth to the second derivative; 0 beyond the grid.

        The values at nodes are coefficients of a cubic B-spline, which blurs them by less than a cube.
        """
        places = (points - self.low) / self.size
        base = np.floor(places).astype(np.intp)
        t = places - base
        weights = np.stack(
            [(1.0 - t) ** 3, 3.0 * t**3 - 6.0 * t**2 + 4.0, -3.0 * t**3 + 3.0 * t**2 + 3.0 * t + 1.0, t**3]
        )
        weights = weights / 6.0
        counts = np.array(self.values.shape[1:4])
        found = np.zeros((len(self.values), len(points), 3))
        within = ((base >= 1) & (base + 2 < counts)).all(axis=1)
        near = base[within]
        for i, j, k in product(range(4), repeat=3):
            factor = weights[i, within, 0] * weights[j, within, 1] * weights[k, within, 2]
            x, y, z = near[:, 0] + i - 1, near[:, 1] + j - 1, near[:, 2] + k - 1
            found[:, within] += factor[:, None] * self.values[:, x, y, z]
        return found


class NoFleshError(Exception):
    """A region has no tissue that could move."""


def solution_key(body: Body, place: Place, count: int) -> str:
    """A digest of all that `solve` depends on, besides this program."""
    softness = np.zeros(0) if place.softness is None else place.softness
    return digest_of([body.positions, body.triangles, body.bones, place.at, [place.radius, count], softness])


def solve(body: Body, place: Place, count: int) -> Swings:
    """The `count` shapes in which a region swings.

    Raises:
        NoFleshError: Nothing of the region can move.
    """
    low, size, counts = _grid(body, place)
    tissue, known = _tissue(body, place, low, size, counts)
    modes = ritz_modes(tissue, count)
    return Swings(low, size, _continued(modes, known, counts), modes.loads, modes.speeds / modes.speeds[0], tissue)


def _grid(body: Body, place: Place) -> tuple[Floats, float, Ints]:
    """The first node of a grid over the region, the length of a cube's edge, and (3,) counts of nodes."""
    # The box that holds the region.
    low = np.maximum(place.at - place.radius, body.positions.min(axis=0))
    high = np.minimum(place.at + place.radius, body.positions.max(axis=0))
    if not (high > low).all():
        raise NoFleshError
    step = float((high - low).max()) / _PROBED
    counts = np.maximum((high - low) / step, 1.0).astype(np.intp)
    points = low + step * (_places(counts) + 0.5)
    points = points[is_inside(points, body.positions, body.triangles)]
    volume = step**3 * int((_softness(body, place, points) > _LEAST_SOFTNESS).sum()) if len(points) else 0.0
    if not volume:
        raise NoFleshError
    # A cube that the skin cuts has nodes outside: about half as many again as there are cubes within.
    size = float(np.cbrt(1.5 * volume / NODES))
    cubes = np.ceil((high - low) / size).astype(np.intp) + 2
    middle = (low + high) / 2.0
    return middle - size * (cubes / 2.0), size, cubes + 1


def _places(counts: Ints) -> Ints:
    """(places, 3) whole coordinates of all places of a grid of (3,) counts, one row after another."""
    return np.indices(counts.tolist()).reshape(3, -1).T


def _softness(body: Body, place: Place, points: Floats) -> Floats:
    """(points,) softness of tissue: 1 where nothing holds it, 0 at bones and beyond the region."""
    away = np.sqrt(((points - place.at) ** 2).sum(axis=1)) / place.radius
    soft = 1.0 - smoothstep(ramp(away, _INNER, 1.0))
    chosen = np.flatnonzero(soft > 0)
    at = points[chosen]
    skin, nearest = nearest_of(body.positions, at)
    if len(body.bones):
        bone = bone_distances(at, body.bones)
        part = bone / np.maximum(bone + skin, 1e-12)
        soft[chosen] *= smoothstep(ramp(part, _HELD, _LOOSE))
    if place.softness is not None:
        soft[chosen] *= place.softness[nearest]
    return soft


def _tissue(body: Body, place: Place, low: Floats, size: float, counts: Ints) -> tuple[Tissue, Bools]:
    """The elements of a region, and (nodes,) True for the nodes of the grid where the displacement is known."""
    numbers = np.arange(int(counts.prod())).reshape(counts)
    nodes = low + size * _places(counts)
    within = is_inside(nodes, body.positions, body.triangles)
    cubes = numbers[tuple(np.moveaxis(_places(counts - 1)[:, None] + CORNERS, 2, 0))]
    soft = _softness(body, place, nodes)
    mean = soft[cubes].mean(axis=1)
    # The parts of a cube whose middles are within count as filled.
    movable = np.flatnonzero(mean > _LEAST_SOFTNESS)
    parts = size / _PARTS * (_places(np.full(3, _PARTS)) + 0.5)
    fills = np.zeros(len(cubes))
    middles = (nodes[cubes[movable, :1]] + parts).reshape(-1, 3)
    fills[movable] = is_inside(middles, body.positions, body.triangles).reshape(len(movable), -1).mean(axis=1)
    active = np.flatnonzero(fills)
    active = active[_connected(cubes[active], nodes[cubes[active]].mean(axis=1), place.at, len(nodes))]
    used = flags_of(cubes[active], len(nodes))
    fixed = ~used | (soft < _LEAST_SOFTNESS)
    # Flesh that nothing holds would float away.
    if fixed.all() or not (fixed & used).any():
        raise NoFleshError
    stiffnesses = 1.0 / np.maximum(mean[active], _LEAST_SOFTNESS)
    beyond = ((nodes - place.at) ** 2).sum(axis=1) > place.radius**2
    return Tissue(cubes[active], fills[active], stiffnesses, fixed, size), used | within | beyond


def _connected(cubes: Ints, middles: Floats, at: Floats, count: int) -> Ints:
    """The cubes that hang together with the one nearest to a place: a hand beside a thigh is not its flesh."""
    if not len(cubes):
        raise NoFleshError
    links = np.stack([np.repeat(cubes[:, :1], 7, axis=1), cubes[:, 1:]], axis=2).reshape(-1, 2)
    labels = components(links, count)
    seed = int(((middles - at) ** 2).sum(axis=1).argmin())
    return np.flatnonzero(labels[cubes[:, 0]] == labels[cubes[seed, 0]])


def _continued(modes: Modes, known: Bools, counts: Ints) -> Floats:
    """(modes, x, y, z, 3) displacements on the whole grid, continued from where they are known into a few layers."""
    shape = tuple(counts.tolist())
    values = np.moveaxis(modes.shapes, 0, 1).reshape(*shape, -1)
    done = known.reshape(shape)
    for _ in range(_LAYERS):
        total, near = np.zeros(values.shape), np.zeros(shape)
        for step in product((-1, 0, 1), repeat=3):
            here, there = zip(*(_shifted(each) for each in step), strict=True)
            total[here] += values[there] * done[there][..., None]
            near[here] += done[there]
        fresh = ~done & (near > 0)
        values[fresh] = total[fresh] / near[fresh][:, None]
        done = done | fresh
    return np.moveaxis(values.reshape(*shape, len(modes.shapes), 3), 3, 0)


def _shifted(step: int) -> tuple[slice, slice]:
    """The part of an axis that has a neighbour by a step, and that of these neighbours."""
    here, there = slice(max(-step, 0), min(-step, 0) or None), slice(max(step, 0), min(step, 0) or None)
    return here, there


_kept: dict[str, Swings] = {}


def swings_of(body: Body, place: Place, count: int) -> Swings:
    """The `count` shapes in which a region swings; those of the last regions are kept.

    Raises:
        NoFleshError: Nothing of the region can move.
    """
    key = solution_key(body, place, count)

    def found() -> Swings:
        swings = kept_solution(key, lambda data: _read(data, count), what="a solution of this region", most=_MOST_BYTES)
        if swings is None:
            swings = solve(body, place, count)
            keep(key, lambda: written_records(swings))
        return swings

    return once(_kept, key, found, _MOST)


def _read(data: bytes, count: int) -> Swings:
    """Read a stored solution.

    Raises:
        AttributeError, LookupError, TypeError, ValueError, OverflowError, RecursionError: It is none of so many shapes.
    """
    found: Swings = read_records(data, [Swings, Tissue])
    tissue, values = found.tissue, found.values
    fitting = (
        values.ndim == 5
        and values.shape[4] == 3
        and found.low.shape == (3,)
        and found.loads.shape == (len(values), 3)
        and found.speeds.shape == (count,) == (len(values),)
        and tissue.nodes.shape == (len(tissue.fills), 8)
        and tissue.stiffnesses.shape == tissue.fills.shape
        and tissue.fixed.shape == (int(np.prod(values.shape[1:4])),)
        and tissue.fixed.dtype == np.bool_
    )
    sizes = np.array([found.size, tissue.size])
    numbers = (found.low, values, found.loads, found.speeds, tissue.fills, tissue.stiffnesses, sizes)
    if not fitting or not all(np.isfinite(each).all() for each in numbers):
        raise ValueError("its parts do not fit")
    nodes = tissue.nodes
    if not ((sizes > 0).all() and (found.speeds > 0).all() and nodes.min() >= 0 and nodes.max() < len(tissue.fixed)):
        raise ValueError("its numbers are none of a solution")
    return found
