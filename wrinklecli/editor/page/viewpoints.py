"""Camera positions: one that sees the whole asset, and one that sees most of a tool.

`preview` takes a longer lens, and looks at the wrinkles themselves. Here the user turns the camera on, so a few points
of the tool and the coarse triangles suffice, and the answer is immediate.
"""

from functools import partial

import numpy as np

from wrinklecli.editor.page.drawing import Body, ToolOutline, outline_of
from wrinklecli.editor.raised import RaisedTool
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.review.preview.camera import VIEWS, Camera, camera_axes
from wrinklecli.review.preview.rays import Occluders
from wrinklecli.review.preview.sides import Free, Place, Side, best_moment, best_side

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
_ABOVE = 0.08  # height of the points of a tool above the coarse triangles, in half diagonals, as wrinkles may be


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
    axes = best_side(*_place_of(outline, body, points, hiding)).axes
    places = outline.points.positions(body, points)
    return Camera.framing(places, axes, aspect=ASPECT, margin=margin, tangent=_TANGENT)


def clear_time(raised: RaisedTool) -> float:
    """Find the time, seconds, at which most is seen of a tool: its peak, or one before if the fold hides it then."""
    nodes = [mesh.ground.rig.node for mesh in raised.meshes]
    number = nodes.index(raised.attached.ground.rig.node)
    mesh = raised.meshes[number]
    outline, body = outline_of(raised.attached, mesh, number, (0.0, 0.0, 0.0)), Body(mesh.faces, ())

    def look(time: float) -> tuple[float, Side]:
        points = raised.shown(time)[number].positions
        place, free = _place_of(outline, body, points, mesh.ground.surface.triangles, raised.height_at(time))
        return time, best_side(place, free)

    start = raised.clip.start if raised.clip.start < raised.time else raised.clip.end
    return best_moment(start, raised.time, look)[0]


def _place_of(
    outline: ToolOutline, body: Body, points: Floats, hiding: Ints, height: float = 1.0
) -> tuple[Place, Free]:
    """The place of a tool whose wrinkles have a height, and what is hidden there."""
    places, normals = outline.points.positions(body, points), outline.points.normals(body, points)
    above = places + _ABOVE * float(np.linalg.norm(np.ptp(places, axis=0))) / 2 * normals
    ones = np.ones(len(above))
    return Place(above, normals, normals, ones, height * ones), partial(
        Occluders.of(points[hiding]).free, above, normals
    )
