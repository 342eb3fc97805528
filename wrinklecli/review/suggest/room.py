"""Room for wrinkles: how high a tool's may be before they reach what lies over the surface at rest, such as a hem."""

import numpy as np

from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import unit
from wrinklecli.numeric.nearest import balls, distances_along, near_points
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
    near = near_points(corners, places[chosen], usual)
    triangles, corners = surface.triangles[near], corners[near]
    middles, radii = balls(corners)
    most = np.inf
    for number in chosen:
        close = np.sum((middles - places[number]) ** 2, axis=1) < (usual * factors[number] + radii) ** 2
        apart = close & (triangles[:, :, None] != members[number]).all(axis=(1, 2))
        room = float(distances_along(places[number], rays[number], corners[apart]).min(initial=np.inf))
        if room < usual * factors[number]:
            most = min(most, _TAKEN * room / factors[number])
    return most
