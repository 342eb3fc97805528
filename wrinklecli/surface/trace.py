"""Traces of the strongest compression over a surface.

Wrinkles run across the direction in which skin is compressed most. Around a corner of the eye or a joint that direction
turns from place to place; a straight tool would cross it askew, and a path follows it.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.numeric.nearest import nearest_points
from wrinklecli.surface.compression import CompressedRegion
from wrinklecli.surface.segments import surface_around
from wrinklecli.surface.sites import Sites
from wrinklecli.surface.strain import principal

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

# Steps of a trace to either side of its middle.
_STEPS = 24
# Part of the greatest loss below which compression has no clear direction: a trace goes straight on there.
CLEAR_LOSS = 0.3
# Degrees that a trace turns for each of its pieces.
_TURN = 35.0
# Most pieces of a trace.
_MOST_PIECES = 6
# Sites from which the compression at a place is interpolated.
_NEIGHBOURS = 6
# Least cosine of a site's normal and the region's; other sites are on the far side of a limb.
_FACING = -0.3
# A step that advances less than this part of its length is at a border.
_BORDER = 0.4


def trace(sites: Sites, region: CompressedRegion, tensors: Floats, lengths: tuple[float, float]) -> Floats | None:
    """Trace the strongest compression through the middle of a region.

    Args:
        sites: Points of the surface.
        region: A region of the sites.
        tensors: (sites, 6) loss tensors of a pose.
        lengths: Greatest lengths against the region's direction and along it, scene units.

    Returns:
        (points, 3) evenly spaced points on the surface, three or more; None if the surface ends at once.
    """
    triangles = surface_around(sites, region)
    if not len(triangles):
        return None
    field = _Field.of(sites, region, tensors, triangles)
    backward, forward = (
        field.walk(region.centre, sign * region.along, length)
        for sign, length in zip((-1.0, 1.0), lengths, strict=True)
    )
    line = np.concatenate([backward[:0:-1], forward])
    if len(line) < 3:
        return None
    steps = unit(np.diff(_resampled(line, _STEPS // 3), axis=0))
    turned = np.degrees(np.arccos(np.clip(np.sum(steps[1:] * steps[:-1], axis=1), -1.0, 1.0))).sum()
    return _resampled(line, min(2 + int(turned / _TURN), _MOST_PIECES))


def _resampled(line: Floats, pieces: int) -> Floats:
    """(pieces + 1, 3) evenly spaced points of a polyline."""
    ways = np.append(0.0, np.cumsum(np.sqrt(np.sum(np.diff(line, axis=0) ** 2, axis=1))))
    wanted = np.linspace(0.0, ways[-1], pieces + 1)
    return np.stack([np.interp(wanted, ways, axis) for axis in line.T], axis=1)


@dataclass(frozen=True, slots=True)
class _Field:
    """The strongest compression over a part of a surface.

    Attributes:
        corners: (triangles, 3, 3) positions of the corners.
        normals: (triangles, 3, 3) unit normals there.
        tree: Positions of the sites of this part.
        tensors: (sites, 6) loss tensors there.
    """

    corners: Floats
    normals: Floats
    tree: "cKDTree"
    tensors: Floats

    @classmethod
    def of(cls, sites: Sites, region: CompressedRegion, tensors: Floats, triangles: Ints) -> "_Field":
        """The field over (triangles, 3) around a region, from (sites, 6) tensors of all sites."""
        from scipy.spatial import cKDTree

        rest = sites.gauge.rest
        piece = sites.pieces[region.members[region.weights.argmax()]]
        chosen = (sites.pieces == piece) & (sites.normals @ region.normal > _FACING)
        return cls(
            rest.positions[triangles], rest.normals[triangles], cKDTree(sites.positions[chosen]), tensors[chosen]
        )

    def walk(self, start: Floats, along: Floats, length: float) -> Floats:
        """(points, 3) from near a (3,) start, at first in a (3,) direction, to the length or the surface's border."""
        line: list[Floats] = []
        ahead, step, peak = start, length / _STEPS, 0.0
        ranks = list(range(1, min(_NEIGHBOURS, len(self.tensors)) + 1))
        for _ in range(_STEPS + 1):
            (triangle,), shares = nearest_points(ahead[None], self.corners)
            place, normal = shares[0] @ self.corners[triangle], unit(shares[0] @ self.normals[triangle])
            if line and np.linalg.norm(place - line[-1]) < _BORDER * step:
                break
            distances, near = (np.asarray(each) for each in self.tree.query(place, k=ranks))
            weights = 1.0 / (distances**2 + step**2)
            loss, direction = principal((weights @ self.tensors[near] / weights.sum())[None], normal[None])
            peak = max(peak, float(loss[0]))
            line.append(place)
            if loss[0] >= CLEAR_LOSS * peak:
                along = direction[0] * (1.0 if direction[0] @ along >= 0 else -1.0)
            along = unit(along - (along @ normal) * normal)
            ahead = place + step * along
        return np.array(line).reshape(-1, 3)
