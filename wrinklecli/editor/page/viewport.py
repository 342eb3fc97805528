"""The 3D view: the session's meshes at the player's moment, tools on them, cameras, and what is under the mouse."""

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import viser

from wrinklecli.character.paints import Colour, Paint, Texture, read_paints
from wrinklecli.character.scene import read_scene
from wrinklecli.editor.attached import AttachedBelow, AttachedTool, PlayableMesh, ShownMesh
from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.guessed_tools import Compressed
from wrinklecli.editor.mask_canvas import MaskCanvas
from wrinklecli.editor.page.drawing import Body, SurfacePoints, ToolOutline, body_of, outline_of
from wrinklecli.editor.page.drawn_scene import HINT, HINTED, LOOKS, Drag, DrawnScene, Look
from wrinklecli.editor.page.player import Player
from wrinklecli.editor.page.tab import numbers_of
from wrinklecli.editor.page.viewpoints import FOV, SIDES, frame_asset, frame_tool
from wrinklecli.editor.page.widgets import QUIET, PageHost, add_group, add_shortcut, on_set, paragraph_of
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.pixels import linear_rgb
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.closest import closest_point
from wrinklecli.numeric.memory import once
from wrinklecli.numeric.rays import distances_along
from wrinklecli.review.preview.camera import Camera
from wrinklecli.review.preview.heat import HEAT, HEAT_TICKS, heat_colours, point_colours
from wrinklecli.review.preview.shown import INKS
from wrinklecli.surface.ground import Ground

_READ_SECONDS = 0.08  # seconds in which a browser reads a coloured mesh
# Strength of each light by its direction: one aslant on either side, so that folds stand out from everywhere, and one
# from below.
_LIGHTS = {(0.7, 1.0, 1.0): 2.0, (-0.7, 0.8, -1.0): 1.8, (-0.6, -1.0, 0.6): 0.5}
_DIRECTIONS = [np.array(each) for each in _LIGHTS]
_LIGHT_DISTANCE = 1e6  # scene units, more than any asset is large
_SKY = (255, 255, 255)  # sRGB of light from above
_GROUND = (150, 152, 158)  # sRGB of light from below
_AMBIENT = 0.9  # strength of the light from sky and ground
_BACKGROUND = ((236, 239, 243), (203, 208, 215))  # sRGB above and below
_BACKGROUND_ROWS = 64  # pixels, which the browser stretches and smooths
_UP = np.array([0.0, 1.0, 0.0])  # as in glTF
_DEPTH = 100.0  # a camera sees from its distance over this to its distance times this


@dataclass(frozen=True, slots=True)
class Hit:
    """The point of a mesh under the mouse.

    Attributes:
        place: (3,) position at rest, world space.
        spot: The point on the shown triangles.
        distance: From the eye, scene units.
    """

    mesh: ShownMesh
    place: Floats
    spot: SurfacePoints
    distance: float


class Viewport:
    """The 3D view of all tabs, with the widgets for its look; `drag` is called when the user drags a tool's dot.

    Attributes:
        shown: Meshes at the present moment.
        paints: Colours of each node's primitives.
    """

    def __init__(self, page: PageHost, drag: Drag) -> None:
        self._page, self._server, self._work, self._session = page, page.server, page.work, page.session
        server = page.server
        server.scene.set_up_direction("+y")
        server.scene.set_background_image(_background())
        # Add lights without shadows: shadows of hundreds of small folds are slow, and hide the folds.
        server.scene.configure_default_lights(enabled=False)
        server.scene.configure_environment_map(None)
        server.scene.add_light_hemisphere("/lights/sky", sky_color=_SKY, ground_color=_GROUND, intensity=_AMBIENT)
        self._lights = [
            server.scene.add_light_point(f"/lights/{number}", intensity=strength, decay=0.0)
            for number, strength in enumerate(_LIGHTS.values())
        ]
        self._light(_DIRECTIONS)
        self._scene = DrawnScene(server, drag)
        self._bodies: tuple[Body, ...] = ()
        self._outlines: dict[str, tuple[object, ToolOutline]] = {}  # on the present triangles
        self._chosen: str | None = None
        self._hinted: AttachedTool | AttachedBelow | None = None
        # The greatest compression of meshes, which is shown while a place is sought.
        self._compressed: dict[Ground, Compressed] | None = None
        self._sought: dict[PlayableMesh, Floats] = {}  # its colours, which stay while a clip plays
        self._canvas: MaskCanvas | None = None  # that is painted
        self._shows_heat, self._here = False, ""  # HTML of the compression under the mouse
        self._moment: tuple[str | None, float] = (None, 0.0)
        self.shown: list[ShownMesh] = []
        self._document: Document | None = None
        self._baked: BakedFile | None = None
        self.refresh()

    def add_widgets(self, *, heat: bool) -> None:
        """Add the widgets at the current place of the panel."""
        gui = self._server.gui
        tip = "Heat is the compression of the surface below its wrinkles. H shows it, and the textures again."
        self._look: Any = gui.add_dropdown("surface", LOOKS, initial_value="heat" if heat else LOOKS[0], hint=tip)
        tip = "B hides them, and shows them again; as long as it is held, if it is."
        self._wrinkled: Any = gui.add_checkbox("wrinkles", initial_value=True, hint=tip)
        self._wire: Any = gui.add_checkbox("wire", initial_value=False)
        tip = "Show what Bake has written, in place of what is edited; its clips, as it plays them."
        self._as_baked: Any = gui.add_checkbox("baked file", initial_value=False, hint=tip, visible=False)
        add_group(self._page, "look from", {side: partial(self.look_at_all, side) for side in SIDES})
        for each in (self._look, self._wire):
            on_set(self._page, each, "bodies", self._show_bodies)
        for each in (self._wrinkled, self._as_baked):
            on_set(self._page, each, "wrinkles", self._page.show)
        add_shortcut(self._page, "Light from all sides, after Shift and a drag", partial(self._light, _DIRECTIONS), "L")
        add_shortcut(self._page, "Heat: show the compression, or the textures", self._heat, "H")
        add_shortcut(self._page, "Before or after: hide wrinkles, or show them", self._exchange, "B")

    @property
    def legend(self) -> str:
        """HTML of the colours of the compression, and of that under the mouse, while they are shown."""
        return _heat_legend() + self._here if self._shows_heat else ""

    def _exchange(self) -> None:
        """Hide the wrinkles, or show them again."""
        self._wrinkled.value = not self._wrinkled.value
        self._page.show()

    def _heat(self) -> None:
        """Colour the surface by its compression, or by its textures."""
        self._look.value = LOOKS[0] if self._look.value == "heat" else "heat"
        self._show_bodies()

    def seek(self, *, folds: bool) -> None:
        """Colour the surface by the greatest compression over all clips while a place that folds is sought."""
        if folds is not (self._compressed is not None):
            self._compressed, self._sought = {} if folds else None, {}
            self._here = ""
            self._show_bodies()
            if folds:
                self._page.slow.put("seek", self._measure)

    def show_mask(self, canvas: MaskCanvas | None) -> None:
        """Show a mask that is painted in place of the textures of its node; None for none."""
        self._canvas = canvas
        self._show_bodies()

    def repaint(self, canvas: MaskCanvas) -> None:
        """Show what was painted since."""
        self._scene.repaint([mesh.source.ground.rig.node for mesh in self.shown].index(canvas.node), canvas.shown)
        self._page.show()

    def _painted(self, node: int) -> list[Paint]:
        """The paints of a node, or the mask that is painted there."""
        canvas = self._canvas
        if canvas is None or canvas.node != node:
            return self.paints[node]
        ends = np.cumsum([len(paint.coordinates) for paint in self.paints[node]])[:-1]
        texture = Texture(canvas.shown, ("clamp", "clamp"))
        return [Paint(np.ones((len(each), 3)), each, texture) for each in np.split(canvas.coordinates, ends)]

    def _measure(self) -> None:
        """Measure the compression of each mesh; on the slow thread."""
        for mesh in self.shown:
            found = None if self._compressed is None else self._session.compressed(mesh.source)
            if found is not None and self._compressed is not None:
                self._compressed[mesh.source.ground] = found
        self._work.put("sought", self._page.show)

    def _say_compression(self, hit: Hit | None) -> None:
        """Say below the legend how far the clips compress a point, and when."""
        found = None if hit is None or not self._compressed else self._compressed.get(hit.mesh.source.ground)
        said = ""
        if hit is not None and found is not None:
            (loss,), (pose,) = found.at(hit.place[None])
            said = f"Here {100 * loss:.0f} %, at {found.peaks.times[pose]:.2f} s of {found.peaks.clips[pose].name}"
        self._here = paragraph_of(said, QUIET) if said else ""
        self._page.show_messages()

    def refresh(self) -> None:
        """Read the colours of a new asset, and withdraw the baked file if the tools have changed since."""
        if self._session.document is not self._document:
            self._document = self._session.document
            self.paints, unread = paints_of(self._document)
            self._session.notes += unread
            self.shown = []  # so that all is drawn anew
        if self._baked is not None and self._baked.text != self._session.text:
            self._baked, self._as_baked.value, self._as_baked.visible = None, False, False

    def compare(self, baked: BakedFile) -> None:
        """Offer to show a baked file instead of the edited asset."""
        self._baked, (self._baked_paints, _) = baked, paints_of(baked.document)
        self._as_baked.visible = True

    def show(self, player: Player, chosen: str | None) -> None:
        """Show the player's moment, and the dots of the chosen tool."""
        before = self.shown
        self._moment = player.clip, player.time
        self.shown = self._meshes(*self._moment, wrinkled=self._wrinkled.value)
        pairs = list(zip(self.shown, before, strict=False))
        same_sources = len(before) == len(self.shown) and all(new.source is old.source for new, old in pairs)
        # A drag moves other vertices, but of the same triangles.
        same_faces = len(before) == len(self.shown) and all(np.array_equal(new.faces, old.faces) for new, old in pairs)
        with self._server.atomic():
            if not same_faces:
                self._chosen = chosen
                self._outlines.clear()
                self._show_bodies()
                return
            if not same_sources or chosen != self._chosen:
                self._chosen = chosen
                self._show_tools()
            self._move_bodies()

    def _meshes(self, clip: str | None, time: float, *, wrinkled: bool = True) -> list[ShownMesh]:
        """All meshes at a moment: of the baked file if it is chosen and has the clip, else of the edited asset."""
        if wrinkled and self._baked is not None and self._as_baked.value and self._baked.plays(clip):
            return self._baked.meshes(clip, time)
        return self._session.meshes(clip, time, wait=False, wrinkled=wrinkled)

    @property
    def _is_baked(self) -> bool:
        """True if the shown meshes are those of the baked file."""
        return self._baked is not None and any(mesh.source in self._baked.sources for mesh in self.shown)

    @property
    def _points(self) -> list[Floats]:
        return [mesh.positions for mesh in self.shown]

    def _show_bodies(self) -> None:
        """Show meshes that are new or look different."""
        look: Look = self._look.value if self._compressed is None else "heat"
        look = look if self._canvas is None else "textures"
        self._shows_heat = look == "heat"
        self._page.show_messages()
        nodes = [mesh.source.ground.rig.node for mesh in self.shown]
        paints = [self._baked_paints[node] if self._is_baked else self._painted(node) for node in nodes]
        self._bodies = tuple(body_of(mesh.source, each) for mesh, each in zip(self.shown, paints, strict=True))
        with self._server.atomic():
            self._scene.show_bodies(self._bodies, self._points, look, wire=bool(self._wire.value))
            self._show_tools()
            self._move_bodies()

    def _move_bodies(self) -> None:
        if self._scene.move_bodies(self._points, self._heats(self.shown, self._moment)):
            self._work.put_later("swap", _READ_SECONDS, self._scene.swap)

    def _heats(self, meshes: Sequence[ShownMesh], moment: tuple[str | None, float]) -> list[Floats]:
        """Colours for the points of meshes by the compression that wrinkles answer; none if it is not shown.

        It is that at a moment of a clip, or the greatest one while a place is sought.
        """
        if self._compressed:
            return [self._greatest_heat(mesh.source, self._compressed.get(mesh.source.ground)) for mesh in meshes]
        if self._canvas is not None or (self._look.value != "heat" and self._compressed is None):
            return []
        plain = {mesh.source: mesh for mesh in self._session.meshes(*moment, wait=False, wrinkled=False)}
        return [
            point_colours(mesh.source.rest_positions, plain.get(mesh.source, mesh).positions, mesh.faces)
            for mesh in meshes
        ]

    def _greatest_heat(self, mesh: PlayableMesh, found: Compressed | None) -> Floats:
        """(points, 3) colours of a mesh by its greatest compression; those of none until it is measured."""
        if found is None:
            return linear_rgb(heat_colours(np.zeros(len(mesh.rest_positions))))
        return once(self._sought, mesh, lambda: linear_rgb(heat_colours(found.at(mesh.rest_positions)[0])))

    def _show_tools(self) -> None:
        outlines = []
        edited = {} if self._is_baked else self._session.attached()
        for number, (name, tool) in enumerate(edited.items()):
            outlines.append(self._outline(name, tool, INKS[number % len(INKS)]))
        if self._hinted is not None and not self._is_baked:
            outlines.append(self._outline(HINTED, self._hinted, HINT))
        self._scene.show_tools(outlines, self._chosen, self._points)

    def _outline(self, name: str, tool: AttachedTool | AttachedBelow, colour: Colour) -> ToolOutline:
        """Outline a tool on the present triangles, or look its outline up."""
        shape = tool.attached
        known, outline = self._outlines.get(name, (None, None))
        if outline is None or known is not shape:
            nodes = [mesh.source.ground.rig.node for mesh in self.shown]
            body = nodes.index(tool.ground.rig.node)
            outline = replace(outline_of(tool, self.shown[body].source, body, colour), name=name)
            self._outlines[name] = shape, outline
        return outline

    def colour_of(self, name: str) -> str:
        """The colour in which a tool is outlined, for HTML; none if it is not drawn."""
        _, outline = self._outlines.get(name, (None, None))
        return "none" if outline is None else f"rgb{tuple(round(255 * each) for each in outline.colour)}"

    def hint_at(self, tool: AttachedTool | AttachedBelow | None) -> None:
        """Outline a tool that is not in the file, in place of the one before; None for no tool."""
        if tool is not self._hinted:
            self._hinted = tool
            self._show_tools()

    # Cameras.

    def look_at_all(self, side: str = "front") -> None:
        """Turn the cameras to the whole asset, from a side and a little from above."""
        points = np.concatenate(self._points) if any(map(len, self._points)) else np.zeros((1, 3))
        self._point_cameras(frame_asset(points, side))

    def look_at_tool(self, name: str) -> None:
        """Turn the cameras to a tool, or to the one that is hinted at (`HINTED`), if it fits the asset."""
        _, outline = self._outlines.get(name, (None, None))
        if outline is not None:
            body = outline.points.body
            mesh = self.shown[body]
            coarse = mesh.source.ground.surface.triangles
            self._point_cameras(frame_tool(outline, self._bodies[body], mesh.positions, coarse))

    def _point_cameras(self, wanted: Camera) -> None:
        position, distance = wanted.eye, float(np.linalg.norm(wanted.eye - wanted.centre)) or 1.0
        start = self._server.initial_camera
        start.look_at, start.position, start.up, start.fov = wanted.centre, position, _UP, FOV
        start.near, start.far = distance / _DEPTH, distance * _DEPTH
        for client in self._server.get_clients().values():
            # A tab may say that it sees from where nothing can be seen; it then stays there.
            with contextlib.suppress(ValueError), client.atomic():
                client.camera.up_direction = _UP
                client.camera.fov = FOV
                client.camera.near, client.camera.far = start.near, start.far
                # The position comes first, because setting it moves `look_at` too.
                client.camera.position = position
                client.camera.look_at = wanted.centre

    # The mouse.

    def hit(self, origin: Floats, direction: Floats) -> Hit | None:
        """Find the point that a ray from (3,) in direction (3,) meets first."""
        nearest, hit = np.inf, None
        for number, mesh in enumerate(self.shown):
            distances = distances_along(origin, direction, mesh.positions[mesh.faces])
            distance = float(distances.min(initial=np.inf))
            if distance < nearest:
                nearest, triangle = distance, np.argmin(distances, keepdims=True)
                point = origin + distance * direction
                _, barycentrics, _ = closest_point(mesh.positions, mesh.faces[triangle], point)
                place = barycentrics @ mesh.source.rest_positions[mesh.faces[triangle[0]]]
                depth = float(np.linalg.norm(point - origin))
                hit = Hit(mesh, place, SurfacePoints(number, triangle, barycentrics[None]), depth)
        return hit

    def seen(self, camera: viser.CameraHandle, across: float, down: float) -> Hit | None:
        """Find the point that a camera sees at a place of the view, from 0 to 1 across and down."""
        axes, tangent = axes_of(camera), np.tan(camera.fov / 2.0)
        aspect = camera.image_width / max(camera.image_height, 1)
        right, up = (2.0 * across - 1.0) * tangent * aspect, (1.0 - 2.0 * down) * tangent
        with np.errstate(all="ignore"):  # a tab may say anything of its camera
            return self.hit(np.array(camera.position, float), axes @ [right, -up, 1.0])

    def point_at(self, hits: Sequence[Hit]) -> None:
        """Show a dot on each of at most two points, and a line between them, unless their mesh was refined since.

        Say how far the last one is compressed.
        """
        self._say_compression(hits[-1] if hits else None)
        sources = {mesh.source for mesh in self.shown}
        self._scene.point_at([hit.spot for hit in hits if hit.mesh.source in sources], self._points)

    def light_from(self, value: str, tab: viser.ClientHandle) -> None:
        """Let one light shine from where the mouse is in the view: from the eye in its middle, aslant at its sides."""
        away = 2.0 * np.array(numbers_of(value, 2)) - 1.0
        away /= max(float(np.linalg.norm(away)), 1.0)
        with np.errstate(all="ignore"):  # a tab may say anything of its camera
            self._light([axes_of(tab.camera) @ [*away, -np.sqrt(max(1.0 - float(away @ away), 0.0))]])

    def _light(self, directions: Sequence[Floats]) -> None:
        """Let lights shine from (3,) directions, and turn off those that have none."""
        for number, light in enumerate(self._lights):
            light.visible = number < len(directions)
            if light.visible:
                light.position = _LIGHT_DISTANCE * directions[number]

    def tool_at(self, hit: Hit) -> str | None:
        """Find the first effect of the file that holds a point, or whose partner does: tools come before others."""
        attached, source = self._session.attached(), hit.mesh.source
        triangle = int(source.parents[hit.spot.triangles[0]])
        for tool in self._session.tools():
            for name in (tool.name, tool.partner):
                found = attached.get(name) if name else None
                if found is None or found.ground.rig.node != source.ground.rig.node:
                    continue
                if found.holds(hit.place, triangle):
                    return tool.name
        return None


def axes_of(camera: viser.CameraHandle) -> Floats:
    """(3, 3) axes of a camera in columns: right, down, forwards."""
    return np.asarray(viser.transforms.SO3(np.asarray(camera.wxyz)).as_matrix())


def paints_of(document: Document) -> tuple[dict[int, list[Paint]], tuple[str, ...]]:
    """Read the colours of each node's primitives; also return a line for each that cannot be read."""
    sources = read_scene(document)
    paints, unread = read_paints(document, sources)
    by_node: dict[int, list[Paint]] = {}
    for source, paint in zip(sources, paints, strict=True):
        by_node.setdefault(source.rig.node, []).append(paint)
    return by_node, tuple(unread)


def _heat_legend() -> str:
    """HTML of the colours of compression."""
    last = HEAT[-1][0]
    stops = ", ".join(f"rgb{tuple(round(255 * c) for c in colour)} {100 * loss / last:.0f}%" for loss, colour in HEAT)
    ticks = "".join(f"<span>{100 * tick:.0f} %</span>" for tick in HEAT_TICKS)
    return paragraph_of("compressed by", QUIET) + (
        f'<div style="margin:0 12px;height:12px;background:linear-gradient(90deg, {stops})"></div>'
        f'<div style="margin:0 12px 6px;display:flex;justify-content:space-between;font-size:.75em">{ticks}</div>'
    )


def _background() -> Any:
    """(rows, 2, 3) sRGB of a plain wall, lighter above."""
    above, below = (np.array(colour, float) for colour in _BACKGROUND)
    depths = np.linspace(0.0, 1.0, _BACKGROUND_ROWS)[:, None, None]
    return np.round((1 - depths) * above + depths * below).astype(np.uint8).repeat(2, axis=1)
