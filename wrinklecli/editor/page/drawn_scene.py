"""The nodes of the browser's 3D scene: bodies, textured, grey or coloured by compression, and tools drawn on them."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
import viser

from wrinklecli.character.paints import Colour
from wrinklecli.editor.page.drawing import Body, SurfacePoints, ToolOutline, line_between
from wrinklecli.editor.page.painted_mesh import PaintedMesh, image_of
from wrinklecli.editor.page.widgets import show_changed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.pixels import Bytes, srgb
from wrinklecli.numeric.arrays import Floats, vertex_normals
from wrinklecli.review.preview.overlay import INK

Look = Literal["textures", "clay", "heat"]
HINT: Colour = (1.0, 0.55, 0.0)
"""Colour of what is hinted at, or pointed at, sRGB."""
HINTED = "(suggested)"
"""Name of the outline of a tool that is not in the file."""
LOOKS: tuple[Look, ...] = ("textures", "clay", "heat")

_CLAY = (203, 198, 190)  # sRGB
_DOT = 0.05  # radius of an anchor's dot over the tool's length …
_MIN_DOT = 0.002  # … but at least this, over the size of all bodies …
_MAX_DOT = 0.009  # … and at most this
_EDGE_DOT = 0.7  # radius of an edge's dot over that of an anchor's
_LINE = 1.5  # pixels
_CHOSEN_LINE = 3.0  # pixels

Drag = Callable[[str, int, Floats, Floats, str], None]
"""Called with `anchor`, `edge` or `skin`, its number, a ray's origin and direction, and `start`, `update` or `end`."""


@dataclass(slots=True)
class _PaintedNodes:
    """A mesh that the browser takes a moment to read. Of its two nodes, one is shown while the other is read."""

    mesh: PaintedMesh
    front: viser.GlbHandle
    back: viser.GlbHandle
    waiting: bool = False

    def swap(self) -> None:
        """Show the node that has been read meanwhile."""
        if self.waiting:
            self.back.visible, self.front.visible = True, False
            self.front, self.back, self.waiting = self.back, self.front, False


class DrawnScene:
    """Bodies and tools in the 3D view of all tabs; `drag` is called when the user drags a tool's dot."""

    def __init__(self, server: viser.ViserServer, drag: Drag) -> None:
        self._scene, self._drag = server.scene, drag
        self._bodies: tuple[Body, ...] = ()
        self._plain: dict[tuple[int, int], viser.MeshHandle] = {}
        self._painted: dict[tuple[int, int], _PaintedNodes] = {}
        self._wires: dict[int, viser.MeshHandle] = {}
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self._dots: dict[tuple[str, int], viser.IcosphereHandle] = {}
        self._pointed: list[tuple[SurfacePoints, viser.IcosphereHandle]] = []
        self._line = self._scene.add_line_segments(
            "/asset/line", np.zeros((1, 2, 3)), _bytes_of(HINT), thickness_units="screen", visible=False
        )
        self._outlines: tuple[ToolOutline, ...] = ()
        self._chosen: str | None = None
        self._size = 1.0

    def show_bodies(self, bodies: Sequence[Body], points: Sequence[Floats], look: Look, *, wire: bool) -> None:
        """Show other bodies, each with (points, 3) positions."""
        self._clear_bodies()
        self._bodies = tuple(bodies)
        every = np.concatenate([np.zeros((1, 3)), *points]) if points else np.zeros((1, 3))
        self._size = float(np.ptp(every, axis=0).max()) or 1.0
        for number, (body, places) in enumerate(zip(bodies, points, strict=True)):
            for part, mesh in enumerate(body.meshes):
                key, name = (number, part), f"/asset/body{number}.{part}"
                has_colours = mesh.paint.texture is not None or np.ptp(mesh.paint.colours, axis=0).any()
                if look == "heat" or (look == "textures" and has_colours):
                    texture = None if look == "heat" else mesh.paint.texture
                    painted = PaintedMesh(mesh.triangles, mesh.paint.coordinates, texture)
                    normals = vertex_normals(places, body.triangles)
                    data = painted.glb(places[mesh.points], normals[mesh.points], mesh.paint.colours)
                    front = self._scene.add_glb(f"{name}/a", data)
                    back = self._scene.add_glb(f"{name}/b", data, visible=False)
                    self._painted[key] = _PaintedNodes(painted, front, back)
                else:
                    colour = _CLAY if look == "clay" else _bytes_of(srgb(mesh.paint.colours[0]).tolist())
                    self._plain[key] = self._scene.add_mesh_simple(
                        name, places[mesh.points], mesh.triangles, color=colour, side="double"
                    )
            if wire:
                self._wires[number] = self._scene.add_mesh_simple(
                    f"/asset/wire{number}", places, body.triangles, color=_bytes_of(INK), wireframe=True
                )

    def move_bodies(self, points: Sequence[Floats], heats: Sequence[Floats] = ()) -> bool:
        """Move each body to (points, 3) positions, and the tools on it; return True if `swap` is needed in a moment.

        `heats` are (points, 3) linear colours of each body, if compression is shown.
        """
        for number, places in enumerate(points):
            if number in self._wires:
                self._wires[number].vertices = places.astype(np.float32)
            for part, mesh in enumerate(self._bodies[number].meshes):
                key = (number, part)
                if key in self._plain:
                    self._plain[key].vertices = places[mesh.points].astype(np.float32)
                else:
                    painted = self._painted[key]
                    painted.swap()
                    colours = heats[number][mesh.points] if heats else mesh.paint.colours
                    normals = vertex_normals(places, self._bodies[number].triangles)
                    painted.back.glb_data = painted.mesh.glb(places[mesh.points], normals[mesh.points], colours)
                    painted.waiting = True
        self._move_outlines(points)
        return bool(self._painted)

    def repaint(self, body: int, pixels: Bytes) -> None:
        """Give a body other (height, width, 3) pixels, which it shows when it moves next."""
        for (number, _), painted in self._painted.items():
            if number == body:
                painted.mesh.image = image_of(pixels)

    def swap(self) -> None:
        """Show the meshes that the browser has read meanwhile."""
        for painted in self._painted.values():
            painted.swap()

    def show_tools(self, outlines: Sequence[ToolOutline], chosen: str | None, points: Sequence[Floats]) -> None:
        """Show other tools on bodies with (points, 3) positions; the chosen tool has dots to drag."""
        for name in self._lines.keys() - {outline.name for outline in outlines}:
            self._lines.pop(name).remove()
        wanted = {key for outline in outlines if outline.name == chosen for key, _ in _dots_of(outline)}
        for key in self._dots.keys() - wanted:
            self._dots.pop(key).remove()
        self._outlines, self._chosen = tuple(outlines), chosen
        for outline in outlines:
            colour = _bytes_of(outline.colour)
            places = self._positions(outline, points)
            ends = places[outline.segments].astype(np.float32)
            thickness = _CHOSEN_LINE if outline.name in (chosen, HINTED) else _LINE
            line = self._lines.get(outline.name)
            if line is None:
                line = self._lines[outline.name] = self._scene.add_line_segments(
                    f"/asset/tool {outline.name}", ends, colour, thickness=thickness, thickness_units="screen"
                )
            else:
                line.points, line.thickness = ends, thickness
                line.colors = np.array(colour, np.uint8)
            if outline.name == chosen:
                self._show_dots(outline, places)

    def point_at(self, spots: Sequence[SurfacePoints], points: Sequence[Floats]) -> None:
        """Show a dot on each of at most two single points, which move with their bodies, and a line between them."""
        for _, dot in self._pointed[len(spots) :]:
            dot.remove()
        dots = [dot for _, dot in self._pointed[: len(spots)]]
        for number in range(len(dots), len(spots)):
            dots.append(self._add_dot(f"pointed{number}", _MAX_DOT * self._size, _bytes_of(HINT), np.zeros(3)))
        self._pointed = list(zip(spots, dots, strict=True))
        self._move_pointed(points)

    def _move_pointed(self, points: Sequence[Floats]) -> None:
        for spot, dot in self._pointed:
            (dot.position,) = spot.positions(self._bodies[spot.body], points[spot.body])
        line = np.zeros((0, 2, 3))
        if len(self._pointed) == 2:
            (spot, dot), (_, other) = self._pointed
            line = line_between(self._bodies[spot.body], points[spot.body], dot.position, other.position)
        show_changed(self._line, "visible", len(line) > 0)
        if len(line):
            self._line.points = line.astype(np.float32)

    def _show_dots(self, outline: ToolOutline, places: Floats) -> None:
        radius = float(np.clip(_DOT * outline.length, _MIN_DOT * self._size, _MAX_DOT * self._size))
        target = ("anchor", len(outline.anchors) - 1)
        for key, spot in _dots_of(outline):
            kind, number = key
            colour = _bytes_of((1.0, 1.0, 1.0) if kind == "edge" or key == target else outline.colour)
            shown = self._dots.get(key)
            if shown is not None:
                shown.position, shown.color = places[spot], colour
                continue
            size = radius * _EDGE_DOT if kind == "edge" else radius
            dot = self._dots[key] = self._add_dot(f"{kind}{number}", size, colour, places[spot])
            self._listen(dot, kind, number)

    def _add_dot(self, name: str, radius: float, colour: tuple[int, int, int], place: Floats) -> viser.IcosphereHandle:
        return self._scene.add_icosphere(
            f"/asset/{name}", radius, colour, subdivisions=2, position=place, cast_shadow=False
        )

    def _listen(self, dot: viser.IcosphereHandle, kind: str, number: int) -> None:
        @dot.on_drag
        async def _(event: viser.SceneNodeDragEvent[viser.IcosphereHandle]) -> None:
            origin = np.array(event.client.camera.position, float)
            self._drag(kind, number, origin, np.array(event.end_position, float) - origin, event.phase)

    def _positions(self, outline: ToolOutline, points: Sequence[Floats]) -> Floats:
        """(points, 3) positions of an outline."""
        body = outline.points.body
        return outline.points.positions(self._bodies[body], points[body], outline.lift)

    def _move_outlines(self, points: Sequence[Floats]) -> None:
        for outline in self._outlines:
            places = self._positions(outline, points)
            self._lines[outline.name].points = places[outline.segments].astype(np.float32)
            for key, spot in _dots_of(outline) if outline.name == self._chosen else ():
                if key in self._dots:
                    self._dots[key].position = places[spot]
        self._move_pointed(points)

    def _clear_bodies(self) -> None:
        self.point_at((), ())
        for handle in (*self._plain.values(), *self._wires.values()):
            handle.remove()
        for painted in self._painted.values():
            painted.front.remove()
            painted.back.remove()
        self._plain.clear()
        self._wires.clear()
        self._painted.clear()


def _dots_of(outline: ToolOutline) -> list[tuple[tuple[str, int], int]]:
    """The kind and number of each dot of a tool, and its point of the outline."""
    kinds = (("anchor", outline.anchors), ("edge", outline.edges), ("skin", outline.skins))
    return [((kind, number), spot) for kind, spots in kinds for number, spot in enumerate(spots.tolist())]


def _bytes_of(colour: Sequence[float]) -> tuple[int, int, int]:
    red, green, blue = (round(255 * channel) for channel in colour)
    return red, green, blue
