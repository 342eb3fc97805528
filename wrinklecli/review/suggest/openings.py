"""Rims of a face: lips that meet, lids and nostrils, where a surface slides over another and makes no folds."""

import numpy as np

from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.nearest import pairs_within
from wrinklecli.review.suggest.measure import MeasuredMesh
from wrinklecli.surface.compression import CompressedRegion

# How near a rim is at most, as a part of the region's length, for what moves there to be the rim.
_NEAR = 0.8
# Cosine of normals below which two sites look at each other.
_OPPOSITE = -0.3


def rims(mesh: MeasuredMesh) -> Floats:
    """(points, 3) where the surface ends, or looks at itself nearer than two neighbourhoods' radii."""
    sites, triangles = mesh.sites, mesh.gauge.triangles
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    # One number for each pair of vertices: rows take ten times as long to sort.
    distinct, counts = np.unique(edges @ [len(mesh.rest.positions), 1], return_counts=True)
    ends = mesh.rest.positions[np.unique(np.divmod(distinct[counts == 1], len(mesh.rest.positions)))]
    pairs = pairs_within(sites.positions, 2.0 * sites.radius)
    first, second = pairs.T
    between = sites.positions[second] - sites.positions[first]
    facing = np.sum(sites.normals[first] * sites.normals[second], axis=1) < _OPPOSITE
    facing &= np.sum(between * sites.normals[first], axis=1) > 0
    facing &= np.sum(between * sites.normals[second], axis=1) < 0
    return np.concatenate([ends, sites.positions[np.unique(pairs[facing])]])


def is_rim(region: CompressedRegion, points: Floats) -> bool:
    """Whether a region lies on one of the (points, 3) of rims."""
    if not len(points):
        return False
    nearest = float(np.sqrt(np.min(np.sum((points - region.centre) ** 2, axis=1))))
    return nearest < _NEAR * region.length
