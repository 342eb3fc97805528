"""A small picture of a proposed tool: the place before, and with its wrinkles at their tallest.

The renderer of `preview` draws it, so nothing is asked of the browser.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wrinklecli.editor.attached import ShownMesh
from wrinklecli.editor.page.drawing import Body, body_of, outline_of
from wrinklecli.editor.page.viewpoints import ASPECT, frame_tool
from wrinklecli.editor.proposals import TriedTool
from wrinklecli.gltf.pixels import Bytes
from wrinklecli.numeric.arrays import Array, vertex_normals
from wrinklecli.review.preview.paints import Paint, Texture
from wrinklecli.review.preview.render import Snapshot, render

_HEIGHT = 126  # pixels: two pictures fill the width of the panel
_MARGIN = 1.3  # distance over the one that just fits the tool
_GAP = 4  # pixels of paper between the two


def before_and_after(tried: TriedTool, paints: Mapping[int, Sequence[Paint]]) -> Bytes:
    """Draw a tool's place before and after: (height, width, 3) sRGB. `paints` are those of each node's primitives."""
    nodes = [mesh.source.ground.rig.node for mesh in tried.after]
    bodies = [body_of(mesh.source, paints[node]) for mesh, node in zip(tried.after, nodes, strict=True)]
    number = nodes.index(tried.attached.ground.rig.node)
    mesh = tried.after[number]
    outline = outline_of(tried.attached, mesh.source, number, (0.0, 0.0, 0.0))
    coarse = mesh.source.ground.surface.triangles
    camera = frame_tool(outline, bodies[number], mesh.positions, coarse, margin=_MARGIN)
    size = round(ASPECT * _HEIGHT), _HEIGHT
    before, after = (render(_snapshot(bodies, shown), camera, size=size) for shown in (tried.before, tried.after))
    return np.hstack([before, np.full((_HEIGHT, _GAP, 3), 255, np.uint8), after])


def _snapshot(bodies: Sequence[Body], shown: Sequence[ShownMesh]) -> Snapshot:
    """The triangles of bodies, whose points are at the positions of meshes."""
    parts: list[tuple[Array, ...]] = []
    textures: list[Texture] = []
    for body, mesh in zip(bodies, shown, strict=True):
        normals = vertex_normals(mesh.positions, body.triangles)
        for drawn in body.meshes:
            texture, corners = drawn.paint.texture, drawn.points[drawn.triangles]
            if texture is not None and texture not in textures:
                textures.append(texture)
            texture_number = -1 if texture is None else textures.index(texture)
            parts.append(
                (
                    mesh.positions[corners],
                    normals[corners],
                    drawn.paint.colours[drawn.triangles],
                    drawn.paint.coordinates[drawn.triangles],
                    np.full(len(corners), texture_number),
                )
            )
    places, turned, colours, coordinates, numbers = map(np.concatenate, zip(*parts, strict=True))
    return Snapshot(places, turned, colours, coordinates, numbers, tuple(textures))
