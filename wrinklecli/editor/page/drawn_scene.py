"""The 3D view of the page: bodies as they move, textured, grey or coloured by compression, with tools drawn on them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import viser

from wrinklecli.editor.page.drawing import Body, DrawnMesh, SurfacePoints, ToolOutline
from wrinklecli.editor.page.painted_mesh import PaintedMesh
from wrinklecli.gltf.pixels import srgb
from wrinklecli.numeric.arrays import Floats, vertex_normals

Look = Literal["textures", "clay", "heat"]
LOOKS: tuple[Look, ...] = ("textures", "clay", "heat")

_CLAY = (203, 198, 190)
_WIRE = (40, 44, 52)
_POINTED = (255, 140, 0)
# Radius of an anchor's dot: a share of the tool's length, and of the bodies' size at most and at least.
_DOT, _MOST_DOT, _LEAST_DOT = 0.05, 0.009, 0.002
_LINE, _CHOSEN_LINE = 1.5, 3.0  # pixels

Drag = Callable[[str, int, Floats, Floats, str], None]
"""Called with `anchor` or `edge`, its number, a ray's origin and direction, and `start`, `update` or `end`."""


@dataclass(slots=True)
class _Painted:
    """A mesh with colours of its own, which the browser takes a moment to read: two nodes show it in turns."""

    made: PaintedMesh
    front: viser.GlbHandle
    back: viser.GlbHandle
    waiting: bool = False

    def turn(self) -> None:
        """Show what the browser has read meanwhile."""
        if self.waiting:
            self.back.visible, self.front.visible = True, False
            self.front, self.back, self.waiting = self.back, self.front, False


class DrawnScene:
    """Bodies and tools in the view of all tabs.

    Args:
        server: The page's.
        name: Of the stage; there may be several, side by side.
        drag: Called where the hand drags a tool's dot.
    """

    def __init__(self, server: viser.ViserServer, name: str, drag: Drag) -> None:
        self._scene, self._name, self._drag = server.scene, name, drag
        self._root = self._scene.add_frame(f"/{name}", show_axes=False)
        self._bodies: tuple[Body, ...] = ()
        self._plain: dict[tuple[int, int], viser.MeshHandle] = {}
        self._painted: dict[tuple[int, int], _Painted] = {}
        self._wires: dict[int, viser.MeshHandle] = {}
        self._lines: dict[str, viser.LineSegmentsHandle] = {}
        self._dots: dict[tuple[str, int], viser.IcosphereHandle] = {}
        self._pointed: tuple[SurfacePoints, viser.IcosphereHandle] | None = None
        self._marks: tuple[ToolOutline, ...] = ()
        self._chosen: str | None = None
        self._size = 1.0

    def place(self, offset: Sequence[float], *, visible: bool) -> None:
        """Stand at a (3,) place, or do not show at all."""
        self._root.position = np.array(offset, float)
        self._root.visible = visible

    def dress(self, bodies: Sequence[Body], points: Sequence[Floats], look: Look, *, wire: bool) -> None:
        """Show these bodies from now on, their (points, 3) being there."""
        self._clear_bodies()
        self._bodies = tuple(bodies)
        every = np.concatenate([np.zeros((1, 3)), *points]) if points else np.zeros((1, 3))
        self._size = float(np.ptp(every, axis=0).max()) or 1.0
        for number, (body, places) in enumerate(zip(bodies, points, strict=True)):
            for part, mesh in enumerate(body.meshes):
                key, name = (number, part), f"/{self._name}/body{number}.{part}"
                if look == "heat" or (look == "textures" and _is_painted(mesh)):
                    texture = None if look == "heat" else mesh.paint.texture
                    made = PaintedMesh(mesh.triangles, mesh.paint.coordinates, texture)
                    normals = vertex_normals(places, body.triangles)
                    data = made.glb(places[mesh.points], normals[mesh.points], mesh.paint.colours)
                    front = self._scene.add_glb(f"{name}/a", data)
                    back = self._scene.add_glb(f"{name}/b", data, visible=False)
                    self._painted[key] = _Painted(made, front, back)
                else:
                    colour = _CLAY if look == "clay" else _colour_of(mesh)
                    self._plain[key] = self._scene.add_mesh_simple(
                        name, places[mesh.points], mesh.triangles, color=colour, side="double"
                    )
            if wire:
                self._wires[number] = self._scene.add_mesh_simple(
                    f"/{self._name}/wire{number}", places, body.triangles, color=_WIRE, wireframe=True
                )

    def move(self, points: Sequence[Floats], heats: Sequence[Floats] = ()) -> bool:
        """Show the bodies where their (points, 3) are now.

        Args:
            points: Of each body.
            heats: Of each body, (points, 3) linear colours, where compression shows.

        Returns:
            Whether `settle` is to be called in a moment.
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
                    painted.turn()
                    colours = heats[number][mesh.points] if heats else mesh.paint.colours
                    normals = vertex_normals(places, self._bodies[number].triangles)
                    painted.back.glb_data = painted.made.glb(places[mesh.points], normals[mesh.points], colours)
                    painted.waiting = True
        self._move_marks(points)
        return bool(self._painted)

    def settle(self) -> None:
        """Show what the browser has read meanwhile."""
        for painted in self._painted.values():
            painted.turn()

    def mark(self, marks: Sequence[ToolOutline], chosen: str | None, points: Sequence[Floats]) -> None:
        """Draw these tools from now on, with dots to drag on the chosen one."""
        for name in [name for name in self._lines if name not in {mark.name for mark in marks}]:
            self._lines.pop(name).remove()
        wanted = {
            (kind, number)
            for mark in marks
            if mark.name == chosen
            for kind, spots in (("anchor", mark.anchors), ("edge", mark.edges))
            for number in range(len(spots))
        }
        for key in [key for key in self._dots if key not in wanted]:
            self._dots.pop(key).remove()
        self._marks, self._chosen = tuple(marks), chosen
        for mark in marks:
            colour = _bytes_of(mark.colour)
            places = mark.spots.on(self._bodies[mark.spots.body], points[mark.spots.body], mark.lift)
            ends, thickness = places[mark.segments].astype(np.float32), _CHOSEN_LINE if mark.name == chosen else _LINE
            line = self._lines.get(mark.name)
            if line is None:
                line = self._lines[mark.name] = self._scene.add_line_segments(
                    f"/{self._name}/tool {mark.name}", ends, colour, thickness=thickness, thickness_units="screen"
                )
            else:
                line.points, line.thickness = ends, thickness
                line.colors = np.array(colour, np.uint8)
            if mark.name == chosen:
                self._add_dots(mark, places)

    def point_out(self, spot: SurfacePoints | None, points: Sequence[Floats]) -> None:
        """Show a dot on a spot, which moves with it; none for None."""
        if self._pointed is not None:
            self._pointed[1].remove()
            self._pointed = None
        if spot is not None:
            (place,) = spot.on(self._bodies[spot.body], points[spot.body])
            radius = _MOST_DOT * self._size
            dot = self._scene.add_icosphere(
                f"/{self._name}/pointed", radius, _POINTED, subdivisions=2, position=place, cast_shadow=False
            )
            self._pointed = spot, dot

    def _add_dots(self, mark: ToolOutline, places: Floats) -> None:
        ends = places[mark.anchors]
        length = float(np.sqrt(np.sum((ends[-1] - ends[0]) ** 2)))
        radius = float(np.clip(_DOT * length, _LEAST_DOT * self._size, _MOST_DOT * self._size))
        for kind, spots in (("anchor", mark.anchors), ("edge", mark.edges)):
            for number, spot in enumerate(spots):
                # The target is white inside, as a ring is.
                white = kind == "edge" or (number == len(spots) - 1)
                colour = (255, 255, 255) if white else _bytes_of(mark.colour)
                known = self._dots.get((kind, number))
                if known is not None:
                    known.position, known.color = places[spot], colour
                    continue
                dot = self._scene.add_icosphere(
                    f"/{self._name}/{kind}{number}",
                    radius * (0.7 if kind == "edge" else 1.0),
                    colour,
                    subdivisions=2,
                    position=places[spot],
                    cast_shadow=False,
                )
                self._listen(dot, kind, number)
                self._dots[kind, number] = dot

    def _listen(self, dot: viser.IcosphereHandle, kind: str, number: int) -> None:
        @dot.on_drag
        async def _(event: viser.SceneNodeDragEvent[viser.IcosphereHandle]) -> None:
            origin = np.array(event.client.camera.position, float)
            self._drag(kind, number, origin, np.array(event.end_position, float) - origin, event.phase)

    def _move_marks(self, points: Sequence[Floats]) -> None:
        for mark in self._marks:
            places = mark.spots.on(self._bodies[mark.spots.body], points[mark.spots.body], mark.lift)
            self._lines[mark.name].points = places[mark.segments].astype(np.float32)
            for kind, spots in (("anchor", mark.anchors), ("edge", mark.edges)):
                for number, spot in enumerate(spots):
                    dot = self._dots.get((kind, number))
                    if dot is not None and mark.name == self._chosen:
                        dot.position = places[spot]

        if self._pointed is not None:
            spot, dot = self._pointed
            (dot.position,) = spot.on(self._bodies[spot.body], points[spot.body])

    def _clear_bodies(self) -> None:
        self.point_out(None, ())
        for handle in (*self._plain.values(), *self._wires.values()):
            handle.remove()
        for painted in self._painted.values():
            painted.front.remove()
            painted.back.remove()
        self._plain.clear()
        self._wires.clear()
        self._painted.clear()


def _is_painted(mesh: DrawnMesh) -> bool:
    """Whether its vertices are of more colours than one."""
    return mesh.paint.texture is not None or bool(np.ptp(mesh.paint.colours, axis=0).any())


def _colour_of(mesh: DrawnMesh) -> tuple[int, int, int]:
    return _bytes_of(srgb(mesh.paint.colours[0]).tolist())


def _bytes_of(colour: Sequence[float]) -> tuple[int, int, int]:
    red, green, blue = (round(255 * channel) for channel in colour)
    return red, green, blue
