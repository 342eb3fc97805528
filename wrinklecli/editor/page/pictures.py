"""Small pictures of a tool: its place with the wrinkles, and before.

The renderer of `preview` draws them, so nothing is asked of the browser.
"""

import base64
from collections.abc import Mapping, Sequence

import numpy as np

from wrinklecli.character.paints import Paint
from wrinklecli.editor.attached import ShownMesh
from wrinklecli.editor.page.drawing import Body, body_of, outline_of
from wrinklecli.editor.page.viewpoints import ASPECT, frame_tool
from wrinklecli.editor.raised import RaisedTool
from wrinklecli.gltf.pixels import Bytes, jpeg_of
from wrinklecli.numeric.arrays import vertex_normals
from wrinklecli.review.preview.render import Snapshot, render

_HEIGHT = 126  # pixels: two pictures fill the width of the panel
_WIDTH = round(ASPECT * _HEIGHT)
_MARGIN = 1.3  # distance over the one that just fits the tool
_GAP = 4  # pixels of paper between the two
ONE, BOTH = f"{_WIDTH}/{_HEIGHT}", f"{2 * _WIDTH + _GAP}/{_HEIGHT}"
"""Width/height of a picture, and of the one before and after."""


def picture_of(
    raised: RaisedTool, time: float, paints: Mapping[int, Sequence[Paint]], *, before: bool = False
) -> Bytes:
    """Draw a tool's place at a time of its clip, from the side that shows most of it: (height, width, 3) sRGB.

    Args:
        raised: The tool.
        time: Seconds.
        paints: Those of each node's primitives.
        before: Draw it without the wrinkles, too, on the left.
    """
    nodes = [mesh.ground.rig.node for mesh in raised.meshes]
    bodies = [body_of(mesh, paints[node]) for mesh, node in zip(raised.meshes, nodes, strict=True)]
    number = nodes.index(raised.attached.ground.rig.node)
    mesh, points = raised.meshes[number], raised.shown(time)[number].positions
    outline = outline_of(raised.attached, mesh, number, (0.0, 0.0, 0.0))
    camera = frame_tool(outline, bodies[number], points, mesh.ground.surface.triangles, margin=_MARGIN)
    shown = (raised.shown(time, wrinkled=wrinkled) for wrinkled in ([False, True] if before else [True]))
    first, *second = (render(_snapshot(bodies, each), camera, size=(_WIDTH, _HEIGHT)) for each in shown)
    gap = np.full((_HEIGHT, _GAP, 3), 255, np.uint8)
    return np.hstack([first, gap, *second]) if second else first


def image(picture: Bytes | None, shape: str) -> str:
    """HTML of a picture that is as wide as its place, with its width/height; of a grey tile if there is none yet."""
    style = f"aspect-ratio:{shape};width:100%;display:block;background:#e8ebef;border-radius:3px"
    if picture is None:
        return f'<div style="{style}"></div>'
    return f'<img src="data:image/jpeg;base64,{base64.b64encode(jpeg_of(picture)).decode()}" style="{style}">'


def _snapshot(bodies: Sequence[Body], shown: Sequence[ShownMesh]) -> Snapshot:
    """The triangles of bodies, whose points are at the positions of meshes."""
    parts = []
    for body, mesh in zip(bodies, shown, strict=True):
        normals = vertex_normals(mesh.positions, body.triangles)
        for drawn in body.meshes:
            corners = drawn.points[drawn.triangles]
            parts.append((mesh.positions[corners], normals[corners], drawn.triangles, drawn.paint))
    return Snapshot.of(parts)
