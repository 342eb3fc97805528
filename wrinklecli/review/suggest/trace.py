"""Traces of the strongest compression over a surface, which a tool follows where a straight one would cross it askew.

Wrinkles run across the direction in which skin is compressed most. Round a corner of the eye or a joint that direction
turns from place to place, and a tool that keeps to it follows a path.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.review.suggest.regions import Region
from wrinklecli.review.suggest.segments import nearest_points, surface_around
from wrinklecli.surface.strain import principal

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# Steps of a trace to either side of its middle.
_STEPS = 24
# Part of the greatest loss below which skin has no direction to speak of: a trace goes straight on there.
_TELLING = 0.3
# Degrees of a trace's turning for each of its pieces; and the most that it has.
_TURN, _MOST_PIECES = 35.0, 6
# Sites that tell the compression at a place.
_NEIGHBOURS = 6
# Least cosine of a site's normal with a region's: others are on the far side of a limb.
_FACING = -0.3
# A step that comes less far than this part of its length is at a border.
_BORDER = 0.4
# Part of its height that a tool leaves at a place whose direction counts.
_PRESENT = 0.25


def misalignment(mesh: MeasuredMesh, patch: Patch, tensors: Floats) -> float:
    """Median angle of a tool with the direction of the strongest compression, weighted by area, degrees.

    Args:
        mesh: The mesh.
        patch: The attached tool.
        tensors: (sites, 6) what a pose loses.
    """
    sites = mesh.sites
    members = np.isin(mesh.gauge.numbers, patch.members)
    under = np.flatnonzero(sites.gather[:, members].sum(axis=1))
    u, v = patch.coordinates(sites.positions[under])
    shares = np.abs(patch.magnitudes(u, v, sites.normals[under]) / patch.shape_strength)
    on, u = under[shares > _PRESENT], u[shares > _PRESENT]
    losses, directions = principal(tensors[on], sites.normals[on])
    strained = losses > _TELLING * losses.max(initial=0.0)
    on, u, directions = on[strained], u[strained], directions[strained]
    if not len(on):
        return 0.0
    along = patch.path.directions(u)
    along = unit(along - np.sum(along * sites.normals[on], axis=1)[:, None] * sites.normals[on])
    angles = np.degrees(np.arccos(np.clip(np.abs(np.sum(along * directions, axis=1)), 0.0, 1.0)))
    order = np.argsort(angles, kind="stable")
    total = np.cumsum(sites.areas[on][order])
    return float(angles[order[np.searchsorted(total, 0.5 * total[-1])]])


def trace(mesh: MeasuredMesh, region: Region, tensors: Floats, lengths: tuple[float, float]) -> Floats | None:
    """Points of a path through the middle of a region along the strongest compression; none where it ends at once.

    Args:
        mesh: The mesh.
        region: On it.
        tensors: (sites, 6) what a pose loses.
        lengths: How far it goes against and along the region's direction at most, scene units.

    Returns:
        (points, 3) on the surface, three or more, evenly spread.
    """
    triangles = surface_around(mesh, region)
    if not len(triangles):
        return None
    field = _Field.of(mesh, region, tensors, triangles)
    ways = [
        field.walk(region.centre, sign * region.along, length)
        for sign, length in zip((-1.0, 1.0), lengths, strict=True)
    ]
    line = np.concatenate([ways[0][:0:-1], ways[1]])
    if len(line) < 3:
        return None
    steps = unit(np.diff(_spread(line, _STEPS // 3), axis=0))
    turned = np.degrees(np.arccos(np.clip(np.sum(steps[1:] * steps[:-1], axis=1), -1.0, 1.0))).sum()
    return _spread(line, min(2 + int(turned / _TURN), _MOST_PIECES))


def _spread(line: Floats, pieces: int) -> Floats:
    """(pieces + 1, 3) points of a polyline, evenly spread over its length."""
    ways = np.append(0.0, np.cumsum(np.sqrt(np.sum(np.diff(line, axis=0) ** 2, axis=1))))
    wanted = np.linspace(0.0, ways[-1], pieces + 1)
    return np.stack([np.interp(wanted, ways, axis) for axis in line.T], axis=1)


@dataclass(frozen=True, slots=True)
class _Field:
    """The strongest compression over a part of a surface.

    Attributes:
        corners: (triangles, 3, 3) places of the corners,
        normals: (triangles, 3, 3) and unit normals there.
        tree: Of the sites there.
        tensors: (sites, 6) what a pose loses at them.
    """

    corners: Floats
    normals: Floats
    tree: "cKDTree"
    tensors: Floats

    @classmethod
    def of(cls, mesh: MeasuredMesh, region: Region, tensors: Floats, triangles: Ints) -> "_Field":
        """The field over (triangles, 3) around a region."""
        from scipy.spatial import cKDTree

        sites = mesh.sites
        piece = sites.pieces[region.members[region.weights.argmax()]]
        chosen = (sites.pieces == piece) & (sites.normals @ region.normal > _FACING)
        return cls(
            mesh.rest.positions[triangles],
            mesh.rest.normals[triangles],
            cKDTree(sites.positions[chosen]),
            tensors[chosen],
        )

    @property
    def nearest(self) -> list[int]:
        """Which of the sites nearest to a place tell the compression there, from 1."""
        return list(range(1, min(_NEIGHBOURS, len(self.tensors)) + 1))

    def walk(self, start: Floats, along: Floats, length: float) -> Floats:
        """(points, 3) from near a (3,) place on the surface, at first along a (3,) direction, as far as the surface."""
        line: list[Floats] = []
        ahead, step, peak = start, length / _STEPS, 0.0
        for _ in range(_STEPS + 1):
            (triangle,), shares = nearest_points(ahead[None], self.corners)
            place, normal = shares[0] @ self.corners[triangle], unit(shares[0] @ self.normals[triangle])
            if line and np.linalg.norm(place - line[-1]) < _BORDER * step:
                break
            distances, near = (np.asarray(each) for each in self.tree.query(place, k=self.nearest))
            weights = 1.0 / (distances**2 + step**2)
            loss, direction = principal((weights @ self.tensors[near] / weights.sum())[None], normal[None])
            peak = max(peak, float(loss[0]))
            line.append(place)
            if loss[0] >= _TELLING * peak:
                along = direction[0] * (1.0 if direction[0] @ along >= 0 else -1.0)
            along = unit(along - (along @ normal) * normal)
            ahead = place + step * along
        return np.array(line).reshape(-1, 3)
