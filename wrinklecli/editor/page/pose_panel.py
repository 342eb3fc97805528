"""The sliders of a free pose: one joint at a time about its own axes, one morph target at a time."""

import html
from typing import Any

import viser

from wrinklecli.character.posing import posable
from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.page.player import Player
from wrinklecli.editor.page.widgets import add_group, on_set
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.editor.session import Session
from wrinklecli.gltf.document import Document

_AXES = ("x", "y", "z")
_MOST_DEGREES = 180.0
_NOTHING = "–"


class PosePanel:
    """Widgets that pose what is shown.

    Args:
        gui: Of the page; widgets go to where the program is in it.
        work: Does what they ask for.
        session: Whose free pose they set.
        player: Which shows it then.
    """

    def __init__(self, gui: viser.GuiApi, work: WorkQueue, session: Session, player: Player) -> None:
        self._session, self._player = session, player
        self._document: Document | None = None
        self._joint: Any = gui.add_dropdown("joint", (_NOTHING,), hint="Turned on from the stored pose.")
        self._axes: list[Any] = [
            gui.add_slider(f"{axis} (°)", -_MOST_DEGREES, _MOST_DEGREES, 1.0, 0.0, hint=f"About its own axis {axis}.")
            for axis in _AXES
        ]
        self._morph: Any = gui.add_dropdown("morph target", (_NOTHING,))
        self._weight: Any = gui.add_slider("weight", 0.0, 1.0, 0.01, 0.0)
        add_group(gui, work, "pose", {"Pose": self._show, "As stored": self._reset})
        self._told: Any = gui.add_html("")
        for axis, slider in zip(_AXES, self._axes, strict=True):
            self._listen(slider, work, axis)
        on_set(self._weight, work, "pose weight", self._raise)
        for choice in (self._joint, self._morph):
            on_set(choice, work, "posed", self.refresh)

    def refresh(self) -> None:
        """Show the session's free pose, and what its asset has to be posed."""
        if self._document is not self._session.document:
            self._document = self._session.document
            for choice, names in zip((self._joint, self._morph), posable(self._document), strict=True):
                kept = choice.value
                choice.options = names or (_NOTHING,)
                choice.value = kept if kept in names else choice.options[0]
                choice.visible = bool(names)
            for each in self._axes:
                each.visible = self._joint.visible
            self._weight.visible = self._morph.visible
        pose = self._session.pose
        turns, weights = dict(pose.turns), dict(pose.weights)
        for axis, slider in zip(_AXES, self._axes, strict=True):
            slider.value = turns.get((self._joint.value, axis), 0.0)
        self._weight.value = weights.get(self._morph.value, 0.0)
        words = f"<code>{html.escape(pose.options)}</code>" if pose.options else ""
        self._told.content = f'<div style="padding:2px 12px 6px;font-size:.85em;overflow-wrap:anywhere">{words}</div>'

    def _listen(self, slider: Any, work: WorkQueue, axis: str) -> None:
        on_set(slider, work, f"pose {axis}", lambda: self._turn(axis, float(slider.value)))

    def _turn(self, axis: str, degrees: float) -> None:
        self._become(self._session.pose.with_turn(self._joint.value, axis, degrees))

    def _raise(self) -> None:
        self._become(self._session.pose.with_weight(self._morph.value, float(self._weight.value)))

    def _reset(self) -> None:
        self._become(FreePose())

    def _become(self, pose: FreePose) -> None:
        self._session.take_pose(pose)
        self.refresh()
        self._show()

    def _show(self) -> None:
        if self._player.playing:
            self._player.toggle()
        self._player.go(POSE, 0.0)
