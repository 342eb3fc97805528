"""Where the page's cameras stand: where all of the asset is seen, or at the side that shows most of a tool.

`preview` has a longer lens, and rays that see how much of the wrinkles a side shows. Here a hand turns the camera on,
so a few spots of the tool and the asset's own triangles say enough, at once.
"""

import numpy as np

from wrinklecli.editor.page.drawing import Body, ToolOutline
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.nearest import near_points, ray_distances
from wrinklecli.review.preview.camera import VIEWS, Camera, camera_axes

SIDES = ("front", "right", "back", "left")
"""Views of `preview` that the page has a button for."""

FOV = float(np.radians(35.0))
"""Vertical field of view: less than a hand's camera usually has, so that what is near is not bloated."""

_TANGENT = float(np.tan(FOV / 2))
_ELEVATION = 8.0  # degrees: level, but for what a floor shows
_ASPECT = 1.2  # width over height of the view beside its panel, of any screen
_MARGIN, _CLOSE = 1.15, 2.2  # of the distance: around all of the asset, around a tool with what bends there
# Sides from which a tool is looked at, degrees; from higher up one loses sight of which part of the body it is.
_AZIMUTHS, _ELEVATIONS = range(-180, 180, 30), (-35.0, 0.0, 35.0)
_SPOTS = 10  # of a tool, that are looked for from each side
_NEAR = 3.0  # reaches of a tool within which something may hide it
_ABOVE = 0.08  # of a tool's reach: spots are so far above the asset's own triangles, as wrinkles may be
_LEVEL = 0.15  # how much of its score a view from straight above or below would lose


def whole(points: Floats, side: str) -> Camera:
    """Sees all (points, 3) from a side."""
    axes = camera_axes(VIEWS[side][0], _ELEVATION)
    return Camera.framing(points, axes, aspect=_ASPECT, margin=_MARGIN, tangent=_TANGENT)


def close(mark: ToolOutline, body: Body, points: Floats, hiding: Ints) -> Camera:
    """Sees a tool, from the side that shows most of it.

    Args:
        mark: The tool.
        body: That it is on.
        points: (points, 3) of the body, now.
        hiding: (triangles, 3) points, that may hide it.
    """
    places, normals = mark.spots.on(body, points), mark.spots.normals(body, points)
    low, high = places.min(axis=0), places.max(axis=0)
    reach = float(np.linalg.norm(high - low)) / 2
    chosen = np.unique(np.linspace(0, len(places) - 1, _SPOTS).astype(int))
    spots, facing = places[chosen] + _ABOVE * reach * normals[chosen], normals[chosen]
    corners = points[hiding]
    corners = corners[near_points(corners, places, _NEAR * reach)]
    every = [camera_axes(azimuth, elevation) for elevation in _ELEVATIONS for azimuth in _AZIMUTHS]
    levels = [elevation for elevation in _ELEVATIONS for _ in _AZIMUTHS]
    scores = [
        _seen(spots, facing, axes[2], corners) * (1 - _LEVEL + _LEVEL * np.cos(np.radians(level)))
        for axes, level in zip(every, levels, strict=True)
    ]
    axes = every[int(np.argmax(scores))]
    return Camera.framing(places, axes, aspect=_ASPECT, margin=_CLOSE, tangent=_TANGENT)


def _seen(spots: Floats, normals: Floats, back: Floats, corners: Floats) -> float:
    """How many of (spots, 3) are seen from a (3,) direction: those that turn away a little count less."""
    shares = normals @ back
    towards = np.flatnonzero(shares > 0)
    count = len(corners)
    starts, hiding = spots[towards].repeat(count, axis=0), np.tile(corners, (len(towards), 1, 1))
    distances = ray_distances(starts, np.broadcast_to(back, starts.shape), hiding).reshape(len(towards), count)
    free = ~np.isfinite(distances).any(axis=1)
    return float(shares[towards][free].sum())
