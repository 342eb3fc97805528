"""Camera positions: one that sees the whole asset, and one that sees most of a tool.

`preview` takes a longer lens, and casts rays to see how much of the wrinkles a side shows. Here the user turns the
camera on, so a few points of the tool and the coarse triangles suffice, and the answer is immediate.
"""

import numpy as np

from wrinklecli.editor.page.drawing import Body, ToolOutline
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.numeric.nearest import near_points, ray_distances
from wrinklecli.review.preview.camera import VIEWS, Camera, camera_axes

SIDES = ("front", "right", "back", "left")
"""Views of `preview` that have a button on the page."""

FOV = float(np.radians(35.0))
"""Vertical field of view, radians: smaller than usual for a page, so that near parts do not look swollen."""

ASPECT = 1.2
"""Width over height of the view beside the panel, for any screen, and of small pictures."""

_TANGENT = float(np.tan(FOV / 2))
_ELEVATION = 8.0  # degrees above level, which shows where a floor would be
_ASSET_MARGIN = 1.15  # distance over the one that just fits the asset
_TOOL_MARGIN = 2.2  # distance over the one that just fits a tool, to show what bends there
_AZIMUTHS = range(-180, 180, 30)  # degrees, tried for a tool
_ELEVATIONS = (-35.0, 0.0, 35.0)  # degrees, tried for a tool; from higher up a part of the body is hard to recognise
_POINTS = 10  # points of a tool that are tested for each direction
_NEAR = 3.0  # half diagonals of a tool's box within which triangles may hide it
_ABOVE = 0.08  # height of the tested points above the coarse triangles, in half diagonals, as wrinkles may be
_LEVEL = 0.15  # share of its score that a view from straight above or below would lose


def frame_asset(points: Floats, side: str) -> Camera:
    """Place a camera that sees all (points, 3) from a side."""
    axes = camera_axes(VIEWS[side][0], _ELEVATION)
    return Camera.framing(points, axes, aspect=ASPECT, margin=_ASSET_MARGIN, tangent=_TANGENT)


def frame_tool(
    outline: ToolOutline, body: Body, points: Floats, hiding: Ints, *, margin: float = _TOOL_MARGIN
) -> Camera:
    """Place a camera on the side that shows most of a tool on a body, which is at (points, 3) positions.

    `hiding` are the (triangles, 3) points of the triangles that may hide the tool; `margin` is a factor of the
    distance.
    """
    places, normals = outline.points.positions(body, points), outline.points.normals(body, points)
    low, high = places.min(axis=0), places.max(axis=0)
    reach = float(np.linalg.norm(high - low)) / 2
    chosen = np.unique(np.linspace(0, len(places) - 1, _POINTS).astype(int))
    tested, facing = places[chosen] + _ABOVE * reach * normals[chosen], normals[chosen]
    corners = points[hiding]
    corners = corners[near_points(corners, places, _NEAR * reach)]
    directions = [(azimuth, elevation) for elevation in _ELEVATIONS for azimuth in _AZIMUTHS]
    every = [camera_axes(azimuth, elevation) for azimuth, elevation in directions]
    scores = [
        _visible(tested, facing, axes[2], corners) * (1 - _LEVEL + _LEVEL * np.cos(np.radians(elevation)))
        for axes, (_, elevation) in zip(every, directions, strict=True)
    ]
    axes = every[int(np.argmax(scores))]
    return Camera.framing(places, axes, aspect=ASPECT, margin=margin, tangent=_TANGENT)


def _visible(points: Floats, normals: Floats, back: Floats, corners: Floats) -> float:
    """Count the (points, 3) that are visible from a (3,) direction, each weighted by the cosine of its normal."""
    cosines = normals @ back
    towards = np.flatnonzero(cosines > 0)
    count = len(corners)
    starts, hiding = points[towards].repeat(count, axis=0), np.tile(corners, (len(towards), 1, 1))
    distances = ray_distances(starts, np.broadcast_to(back, starts.shape), hiding).reshape(len(towards), count)
    free = ~np.isfinite(distances).any(axis=1)
    return float(cosines[towards][free].sum())
