"""What the page shows in 3D: the session's meshes at the player's moment, tools on them, and where cameras stand."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import viser

from wrinklecli.character.scene import read_scene
from wrinklecli.editor.attached import ShownMesh
from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.page.drawing import Body, SurfacePoints, ToolOutline, body_of, mark_of, picked
from wrinklecli.editor.page.drawn_scene import LOOKS, Drag, DrawnScene, Look
from wrinklecli.editor.page.player import Player
from wrinklecli.editor.page.viewpoints import FOV, SIDES, close, whole
from wrinklecli.editor.page.widgets import add_group, on_set
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.editor.session import Session
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.preview.camera import Camera
from wrinklecli.review.preview.heat import point_colours
from wrinklecli.review.preview.paints import Paint, read_paints
from wrinklecli.review.preview.shown import INKS

_SETTLES = 0.08  # seconds in which a browser reads a coloured mesh
_ASIDE = 1.15  # widths of the asset between it and its rest pose beside it
# Lights, from where and how strong: one aslant on either face, so that folds stand out wherever one looks from, and one
# from below. They are further away than any asset is large.
_LIGHTS = {(0.7, 1.0, 1.0): 2.0, (-0.7, 0.8, -1.0): 1.8, (-0.6, -1.0, 0.6): 0.5}
_FAR = 1e6  # scene units
_SKY, _GROUND, _AMBIENT = (255, 255, 255), (150, 152, 158), 0.9
_UP = np.array([0.0, 1.0, 0.0])
# What a camera may see, over its distance: as near as one may come, and all around.
_NEARER, _FURTHER = 100.0, 100.0
_BACKGROUND = ((236, 239, 243), (203, 208, 215))  # sRGB above and below


@dataclass(frozen=True, slots=True)
class Hit:
    """Where the pointer meets a mesh.

    Attributes:
        mesh: The mesh.
        place: (3,) at rest.
        spot: The one spot, of the triangles that are shown.
    """

    mesh: ShownMesh
    place: Floats
    spot: SurfacePoints


class Viewport:
    """The 3D view of all tabs, with the widgets that say how it looks.

    Args:
        server: The page's.
        work: Does what widgets ask for.
        session: What is shown.
        drag: Called where a tool's dot is dragged.
    """

    def __init__(self, server: viser.ViserServer, work: WorkQueue, session: Session, drag: Drag) -> None:
        self._server, self._work, self._session = server, work, session
        server.scene.set_up_direction("+y")
        server.scene.set_background_image(_background())
        _add_lights(server.scene)
        self._view = DrawnScene(server, "asset", drag)
        self._rest_view = DrawnScene(server, "rest", lambda *_: None)
        self._bodies: tuple[Body, ...] = ()
        self._marks: dict[str, tuple[Patch, ToolOutline]] = {}  # as long as the triangles are the same
        self._chosen: str | None = None
        self.shown: list[ShownMesh] = []
        self._document: Document | None = None
        self._baked: BakedFile | None = None
        self.read()

    def read(self) -> None:
        """Read what colours the asset, where that is another than before."""
        if self._session.document is self._document:
            return
        self._document = self._session.document
        self._paints, unread = _paints_of(self._document)
        self._session.notes += unread
        self.shown = []  # so that all is drawn anew

    def compare(self, baked: BakedFile) -> None:
        """Proposal to show what was baked in place of what is edited."""
        self._baked, (self._baked_paints, _) = baked, _paints_of(baked.document)
        self._as_baked.visible = True

    def drop_old(self) -> None:
        """Proposal what was baked no more, where something else is edited by now."""
        if self._baked is not None and self._baked.text != self._session.text:
            self._baked, self._as_baked.value, self._as_baked.visible = None, False, False

    def add_widgets(self, gui: viser.GuiApi, show: Callable[[], None], *, heat: bool) -> None:
        """Add what says how it looks, to where the program is in the page; `show` calls this one's."""
        self._look: Any = gui.add_dropdown("surface", LOOKS, initial_value="heat" if heat else "clay")
        self._wire: Any = gui.add_checkbox("wire", initial_value=False)
        tip = "Show what Bake has written, in place of what is edited; its clips, as it plays them."
        self._as_baked: Any = gui.add_checkbox("baked file", initial_value=False, hint=tip, visible=False)
        self._beside: Any = gui.add_checkbox("rest beside", initial_value=False, hint="Show it at rest, too.")
        add_group(gui, self._work, "look from", {side: partial(self.look_at_all, side) for side in SIDES})
        for each in (self._look, self._wire, self._beside):
            on_set(each, self._work, "dress", self._dress)
        on_set(self._as_baked, self._work, "as baked", show)

    def show(self, player: Player, chosen: str | None) -> None:
        """Show the player's moment, with dots on the chosen tool."""
        before = self.shown
        self.shown = self._meshes(player.clip, player.time)
        pairs = list(zip(self.shown, before, strict=False))
        same = len(before) == len(self.shown) and all(new.source is old.source for new, old in pairs)
        # What is dragged moves other vertices of the triangles that are there.
        alike = len(before) == len(self.shown) and all(np.array_equal(new.faces, old.faces) for new, old in pairs)
        with self._server.atomic():
            if not alike:
                self._chosen = chosen
                self._marks.clear()
                self._dress()
                return
            if not same or chosen != self._chosen:
                self._chosen = chosen
                self._mark()
            self._move()

    def _meshes(self, clip: str | None, time: float) -> list[ShownMesh]:
        """All meshes at a moment: of the baked file, where it is chosen and has the clip, else as edited."""
        if self._baked is not None and self._as_baked.value and self._baked.plays(clip):
            return self._baked.meshes(clip, time)
        return self._session.meshes(clip, time, wait=False)

    @property
    def _is_baked(self) -> bool:
        """Whether the shown meshes are of the baked file."""
        return self._baked is not None and any(mesh.source in self._baked.sources for mesh in self.shown)

    @property
    def _points(self) -> list[Floats]:
        return [mesh.positions for mesh in self.shown]

    def _dress(self) -> None:
        """Show meshes that are new, or that look otherwise than before."""
        look: Look = self._look.value
        wire, beside = bool(self._wire.value), bool(self._beside.value)
        paints = self._baked_paints if self._is_baked else self._paints
        self._bodies = tuple(body_of(mesh.source, paints[mesh.source.ground.rig.node]) for mesh in self.shown)
        with self._server.atomic():
            self._view.dress(self._bodies, self._points, look, wire=wire)
            self._mark()
            rest = [mesh.positions for mesh in self._meshes(None, 0.0)] if beside else []
            self._rest_view.dress(self._bodies if beside else (), rest, look, wire=wire)
            if self._rest_view.move(rest, self._heats(rest)):
                self._work.put_later("settle rest", _SETTLES, self._rest_view.settle)
            width = max(float(np.ptp(each[:, 0])) for each in (self._everything(), *rest) if len(each))
            self._rest_view.place((-_ASIDE * width, 0.0, 0.0), visible=beside)
            self._move()

    def _move(self) -> None:
        if self._view.move(self._points, self._heats(self._points)):
            self._work.put_later("settle", _SETTLES, self._view.settle)

    def _heats(self, points: Sequence[Floats]) -> list[Floats]:
        """Of each body, its (points, 3) being there, their colours; none where compression does not show."""
        if self._look.value != "heat":
            return []
        pairs = zip(self.shown, points, strict=False)
        return [point_colours(mesh.source.rest_positions, places, mesh.faces) for mesh, places in pairs]

    def _mark(self) -> None:
        """Draw the tools on the shown meshes."""
        marks = []
        for number, (name, tool) in enumerate(() if self._is_baked else self._session.attached_tools().items()):
            patch, mark = self._marks.get(name, (None, None))
            if mark is None or patch is not tool.patch:
                body = self._body_of(tool.plan.rig.node)
                mark = mark_of(tool, self.shown[body].source, body, INKS[number % len(INKS)])
                self._marks[name] = tool.patch, mark
            marks.append(mark)
        self._view.mark(marks, self._chosen, self._points)

    def _body_of(self, node: int) -> int:
        return next(k for k, mesh in enumerate(self.shown) if mesh.source.ground.rig.node == node)

    def _everything(self) -> Floats:
        """(points, 3) all that is shown; the world's origin where nothing is."""
        return np.concatenate(self._points) if any(map(len, self._points)) else np.zeros((1, 3))

    # Where cameras stand.

    def look_at_all(self, side: str = "front") -> None:
        """Let the cameras see the whole asset from a side, a little from above."""
        self._point_cameras(whole(self._everything(), side))

    def look_at_tool(self, name: str) -> None:
        """Let the cameras face a tool; they stay where it does not fit."""
        _, mark = self._marks.get(name, (None, None))
        if mark is not None:
            body = mark.spots.body
            mesh = self.shown[body]
            self._point_cameras(close(mark, self._bodies[body], mesh.positions, mesh.source.ground.surface.triangles))

    def _point_cameras(self, wanted: Camera) -> None:
        position, distance = wanted.eye, float(np.linalg.norm(wanted.eye - wanted.centre)) or 1.0
        start = self._server.initial_camera
        start.look_at, start.position, start.up, start.fov = wanted.centre, position, _UP, FOV
        start.near, start.far = distance / _NEARER, distance * _FURTHER
        for client in self._server.get_clients().values():
            with client.atomic():
                client.camera.up_direction = _UP
                client.camera.fov = FOV
                client.camera.near, client.camera.far = start.near, start.far
                # In this order: to move a camera moves what it looks at.
                client.camera.position = position
                client.camera.look_at = wanted.centre

    # What is under the pointer.

    def hit(self, origin: Floats, direction: Floats) -> Hit | None:
        """What a ray from (3,) in (3,) meets first; None where it misses."""
        best, found = np.inf, None
        for number, mesh in enumerate(self.shown):
            hit = picked(origin, direction, mesh.positions, mesh.faces)
            if hit is not None and hit[0] < best:
                best, triangle, barycentrics = hit
                place = barycentrics @ mesh.source.rest_positions[mesh.faces[triangle]]
                found = Hit(mesh, place, SurfacePoints(number, np.array([triangle]), barycentrics[None]))
        return found

    def point_out(self, hit: Hit | None) -> None:
        """Show a dot on what was hit, or none."""
        self._view.point_out(None if hit is None else hit.spot, self._points)

    def tool_at(self, mesh: ShownMesh, place: Floats) -> str | None:
        """The tool of the file whose patch, or whose partner's, is at a (3,) place at rest."""
        laid = self._session.attached_tools()
        for tool in self._session.tools():
            for name in (tool.name, tool.partner):
                found = laid.get(name) if name else None
                if found is None or found.plan.rig.node != mesh.source.ground.rig.node:
                    continue
                patch = found.carried.patch
                u, v = patch.coordinates(place)
                near = abs(float((place - patch.path.middle) @ patch.normal)) < patch.span
                if near and 0 <= u <= 1 and abs(v) <= 1:
                    return tool.name
        return None


def _paints_of(document: Document) -> tuple[dict[int, list[Paint]], tuple[str, ...]]:
    """What colours the primitives of each node, and what of it could not be read, a line each."""
    sources = read_scene(document)
    paints, unread = read_paints(document, sources)
    found: dict[int, list[Paint]] = {}
    for source, paint in zip(sources, paints, strict=True):
        found.setdefault(source.rig.node, []).append(paint)
    return found, tuple(unread)


def _background() -> Any:
    """(rows, columns, 3) of a plain wall, lighter above."""
    above, below = (np.array(colour, float) for colour in _BACKGROUND)
    shares = np.linspace(0.0, 1.0, 64)[:, None, None]
    return np.round((1 - shares) * above + shares * below).astype(np.uint8).repeat(2, axis=1)


def _add_lights(scene: viser.SceneApi) -> None:
    """Light it without shadows: those of hundreds of small folds cost more than all else, and hide what they show."""
    scene.configure_default_lights(enabled=False)
    scene.configure_environment_map(None)
    scene.add_light_hemisphere("/lights/sky", sky_color=_SKY, ground_color=_GROUND, intensity=_AMBIENT)
    for number, (place, strength) in enumerate(_LIGHTS.items()):
        scene.add_light_point(
            f"/lights/{number}", intensity=strength, decay=0.0, position=tuple(_FAR * np.array(place, float))
        )
