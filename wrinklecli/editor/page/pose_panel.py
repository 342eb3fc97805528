"""Sliders of the free pose: the turns of one joint and the weight of one morph target at a time."""

import html
from functools import partial
from typing import Any

from wrinklecli.character.posing import posable
from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.page.player import Player
from wrinklecli.editor.page.widgets import PageHost, add_group, on_set, paragraph
from wrinklecli.gltf.document import Document

_AXES = ("x", "y", "z")
_MAX_DEGREES = 180.0
_DEGREES_STEP = 1.0
_WEIGHT_STEP = 0.01
_NOTHING = "–"


class PosePanel:
    """Widgets for the free pose, which a player shows, at the current place of the panel."""

    def __init__(self, page: PageHost, player: Player) -> None:
        self._session, self._player = page.session, player
        gui = page.server.gui
        self._document: Document | None = None
        self._joint: Any = gui.add_dropdown("joint", (_NOTHING,), hint="Turned on from the stored pose.")
        self._axes: dict[str, Any] = {}
        for axis in _AXES:
            tip = f"About its own axis {axis}."
            self._axes[axis] = gui.add_slider(f"{axis} (°)", -_MAX_DEGREES, _MAX_DEGREES, _DEGREES_STEP, 0.0, hint=tip)
            on_set(page, self._axes[axis], f"pose {axis}", partial(self._turn, axis))
        self._morph: Any = gui.add_dropdown("morph target", (_NOTHING,))
        self._weight: Any = gui.add_slider("weight", 0.0, 1.0, _WEIGHT_STEP, 0.0)
        add_group(page, "pose", {"Pose": self._show, "As stored": partial(self._take, FreePose())})
        self._options: Any = gui.add_html("")
        on_set(page, self._weight, "pose weight", self._set_weight)
        for choice in (self._joint, self._morph):
            on_set(page, choice, "posed", self.refresh)

    def refresh(self) -> None:
        """Show the session's free pose, and the joints and morph targets of its asset."""
        if self._document is not self._session.document:
            self._document = self._session.document
            for choice, names in zip((self._joint, self._morph), posable(self._document), strict=True):
                chosen = choice.value
                choice.options = names or (_NOTHING,)
                choice.value = chosen if chosen in names else choice.options[0]
                choice.visible = bool(names)
            for slider in self._axes.values():
                slider.visible = self._joint.visible
            self._weight.visible = self._morph.visible
        pose = self._session.pose
        turns, weights = dict(pose.turns), dict(pose.weights)
        for axis, slider in self._axes.items():
            slider.value = turns.get((self._joint.value, axis), 0.0)
        self._weight.value = weights.get(self._morph.value, 0.0)
        self._options.content = paragraph(f"<code>{html.escape(pose.options)}</code>" if pose.options else "")

    def _turn(self, axis: str) -> None:
        degrees = float(self._axes[axis].value)
        self._take(self._session.pose.with_turn(self._joint.value, axis, degrees))

    def _set_weight(self) -> None:
        self._take(self._session.pose.with_weight(self._morph.value, float(self._weight.value)))

    def _take(self, pose: FreePose) -> None:
        self._session.take_pose(pose)
        self.refresh()
        self._show()

    def _show(self) -> None:
        if self._player.playing:
            self._player.toggle()
        self._player.go(POSE, 0.0)
