"""Camera positions: one that sees the whole asset, and one that sees most of a tool.

`preview` takes a longer lens, and looks at the wrinkles themselves. Here the user turns the camera on, so a few points
of the tool and the coarse triangles suffice, and the answer is immediate.
"""

import numpy as np

from wrinklecli.editor.page.drawing import Body, ToolOutline, outline_of
from wrinklecli.editor.raised import RaisedTool
from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.review.preview.camera import VIEWS, Camera, camera_axes
from wrinklecli.review.preview.rays import Occluders

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
_POINTS = 40  # points of a tool that are tested for each direction
_ABOVE = 0.08  # height of the tested points above the coarse triangles, in half diagonals, as wrinkles may be
_EARLIER = (1.0, 0.75, 0.5)  # parts of the time to a tool's peak at which it may be shown
_PLAIN = 0.4  # part of a tool, by the cosines of its normals, that is plainly seen: half of one round a limb
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
    camera, _ = _best_camera(outline, body, points, hiding, margin)
    return camera


def clear_time(raised: RaisedTool) -> float:
    """Find the time, seconds, at which most is seen of a tool: its peak, or one before if the fold hides it then."""
    nodes = [mesh.ground.rig.node for mesh in raised.meshes]
    number = nodes.index(raised.attached.ground.rig.node)
    mesh = raised.meshes[number]
    outline, body = outline_of(raised.attached, mesh, number, (0.0, 0.0, 0.0)), Body(mesh.faces, ())
    start = raised.clip.start if raised.clip.start < raised.time else raised.clip.end
    best, most = raised.time, 0.0
    for part in _EARLIER:
        time = start + part * (raised.time - start)
        points = raised.shown(time)[number].positions
        _, part_seen = _best_camera(outline, body, points, mesh.ground.surface.triangles, _TOOL_MARGIN)
        seen = part_seen * raised.height_at(time)
        if seen > most:
            best, most = time, seen
        if part == 1 and part_seen >= _PLAIN:
            break
    return best


def _best_camera(outline: ToolOutline, body: Body, points: Floats, hiding: Ints, margin: float) -> tuple[Camera, float]:
    """The camera of `frame_tool`, and the part of the tool that it shows."""
    places, normals = outline.points.positions(body, points), outline.points.normals(body, points)
    reach = float(np.linalg.norm(np.ptp(places, axis=0))) / 2
    chosen = np.unique(np.linspace(0, len(places) - 1, _POINTS).astype(int))
    tested, facing = places[chosen] + _ABOVE * reach * normals[chosen], normals[chosen]
    directions = [(azimuth, elevation) for elevation in _ELEVATIONS for azimuth in _AZIMUTHS]
    cameras = [
        Camera.framing(places, camera_axes(*each), aspect=ASPECT, margin=margin, tangent=_TANGENT)
        for each in directions
    ]
    eyes = np.array([camera.eye for camera in cameras])
    seen = Occluders.of(points[hiding]).free(tested, facing, unit(eyes[:, None] - tested))
    scores = np.sum(seen * (np.array([camera.axes[2] for camera in cameras]) @ facing.T).clip(min=0.0), axis=1)
    scores *= 1 - _LEVEL + _LEVEL * np.cos(np.radians([elevation for _, elevation in directions]))
    best = int(np.argmax(scores))
    return cameras[best], float(scores[best]) / len(chosen)
