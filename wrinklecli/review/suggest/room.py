"""Room for wrinkles: how high a tool's may be before they reach what lies over the surface at rest, such as a hem."""

import numpy as np

from wrinklecli.method.patch import Patch
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.numeric.nearest import ray_distances
from wrinklecli.review.suggest.measure import MeasuredMesh

# Rays that look for what lies over a patch: its triangles, of very many every so many.
_RAYS = 150
# Factor on the height below which a patch fades, so that it reaches nothing.
_LOW = 0.2
# Part of the room that wrinkles take: rays miss what lies between them.
_TAKEN = 0.8


def highest(mesh: MeasuredMesh, patch: Patch) -> float:
    """The height that a patch's bumps may have, scene units; infinite where nothing lies within the usual one."""
    surface, positions = mesh.surface, mesh.rest.positions
    members = surface.triangles[patch.members]
    places = positions[members].mean(axis=1)
    rays = unit(mesh.rest.normals[members].sum(axis=1))
    factors = np.abs(patch.magnitudes(*patch.coordinates(places), rays))
    chosen = np.flatnonzero(factors > _LOW)
    chosen = chosen[:: -(-len(chosen) // _RAYS) or 1]
    usual = patch.curve.max_height
    if not len(chosen) or not np.isfinite(usual):
        return np.inf
    corners = positions[surface.triangles]
    centres = corners.mean(axis=1)
    radii = np.sqrt(np.max(np.sum((corners - centres[:, None]) ** 2, axis=2), axis=1))
    middle = places[chosen].mean(axis=0)
    reach = usual + float(np.sqrt(np.max(np.sum((places[chosen] - middle) ** 2, axis=1))))
    near = np.flatnonzero(np.sqrt(np.sum((centres - middle) ** 2, axis=1)) < reach + radii)
    most = np.inf
    for number in chosen:
        apart = ~np.isin(surface.triangles[near], members[number]).any(axis=1)
        distances = _distances(places[number], rays[number], corners[near[apart]])
        room = float(distances.min(initial=np.inf))
        if room < usual * factors[number]:
            most = min(most, _TAKEN * room / factors[number])
    return most


def _distances(start: Floats, ray: Floats, corners: Floats) -> Floats:
    """(triangles,) how far along a ray each is."""
    shape = (len(corners), 3)
    return ray_distances(np.broadcast_to(start, shape), np.broadcast_to(ray, shape), corners)
