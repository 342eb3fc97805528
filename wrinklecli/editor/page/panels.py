"""Panels of the page beside those of tools: the buttons for files, and the free pose."""

import html
import os
from contextlib import ExitStack
from functools import partial
from typing import Any

from wrinklecli.batching.stores import scratch
from wrinklecli.character.posing import posable
from wrinklecli.editor.baked_file import BakedFile, RunningBake, SavedBake
from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.page.player import Player
from wrinklecli.editor.page.widgets import (
    ASKS,
    PageHost,
    add_button,
    add_group,
    add_shortcut,
    on_set,
    paragraph,
    value_within,
)
from wrinklecli.editor.session import Session
from wrinklecli.errors import ConfigError, WrinkleError
from wrinklecli.files.formats import MODEL_ENDINGS
from wrinklecli.gltf.document import Document

_CHECK_SECONDS = 1.0  # seconds between two checks for changed files
_AXES = ("x", "y", "z")
_MAX_DEGREES = 180.0  # greatest turn of a joint, of either sign
_DEGREES_STEP = 1.0  # step of a turn
_WEIGHT_STEP = 0.01  # step of a morph target's weight, which goes from 0 to 1
_NOTHING = "–"  # the only choice of an asset without joints or morph targets
_OPEN_TIP = (
    "Another asset, of this folder or edited before, with its tools file. Edits that are not saved here are kept."
)


class FileButtons:
    """Widgets for the files of a session, at the current place of the panel; `opened` chooses the asset."""

    def __init__(self, page: PageHost) -> None:
        self._page, self._session = page, page.session
        self._noted = 0  # notes of the session that were shown
        self._running: RunningBake | None = None
        # A folder for what no bake of this page solves again, once there is a bake.
        self._solved, self._held = "", ExitStack()
        undo, redo = partial(self._step, forward=False), partial(self._step, forward=True)
        add_group(page, "file", {"Save": self._save, "Bake": self._bake, "Undo": undo, "Redo": redo})
        overwrite = partial(self._save, overwrite=True)
        self._folder, shown = os.path.split(self._session.asset)
        # Only files beside the shown one and those that are known, so that a page which others reach opens no others.
        beside = sorted(each for each in os.listdir(self._folder or ".") if each.lower().endswith(MODEL_ENDINGS))
        here = os.path.abspath(self._folder)
        known = [path for path in page.known if os.path.dirname(path) != here and os.path.isfile(path)]
        names = [*dict.fromkeys([shown, *beside, *known])]
        self.opened: Any = page.server.gui.add_dropdown("open", names, hint=_OPEN_TIP)
        on_set(page, self.opened, "open", lambda: page.slow.put("open", self._open_beside))
        label = "Save over what others have written"
        self._overwrite = add_button(page, label, overwrite, color="red", visible=False)
        self._progress: Any = page.server.gui.add_progress_bar(0.0, visible=False)
        add_shortcut(page, "Save", self._save, "S", "cmd/ctrl")
        add_shortcut(page, "Undo", undo, "Z", "cmd/ctrl")
        add_shortcut(page, "Redo", redo, "Z", "cmd/ctrl+shift")
        page.slow.put_later("watch", _CHECK_SECONDS, self._check_files)

    def show_notes(self) -> None:
        """Show the session's new notes."""
        notes, self._noted = self._session.notes[self._noted :], len(self._session.notes)
        if notes:
            self._page.say("\n".join(notes), ASKS)

    def _open_beside(self) -> None:
        """Read another asset, of the folder or by its whole path, with its tools file; on the slow thread."""
        name, self.opened.value = self.opened.value, os.path.basename(self._session.asset)
        path = os.path.join(self._folder, name)
        tools = self._page.known.get(os.path.abspath(path))
        self._page.wanted = Session(path, tools, self._session.read_options, self._session.own_folder)

    def _step(self, *, forward: bool) -> None:
        self._page.commit()
        step = self._session.redo() if forward else self._session.undo()
        self._page.refresh()
        self._page.say(
            f"{'redone' if forward else 'undone'}: {step}" if step else f"nothing to {'redo' if forward else 'undo'}"
        )

    def _save(self, *, overwrite: bool = False) -> None:
        self._page.commit()
        try:
            self._session.save(overwrite=overwrite)
            self._overwrite.visible = False
        except ConfigError:
            self._overwrite.visible = True
            raise
        self._page.refresh()
        self._page.say(f"saved as {self._session.path}")

    def _bake(self) -> None:
        self.give_up()
        self._save()
        self._solved = self._solved or self._held.enter_context(scratch())
        work = self._page.work
        self._running = RunningBake(
            SavedBake.of(self._session, self._solved),
            lambda *step: work.put("progress", lambda: self._show_progress(*step)),
            lambda found: work.put("baked", lambda: self._show_baked(found)),
        )
        self._show_progress("reading", 0, 1)

    def give_up(self) -> bool:
        """Cancel a bake; False if none runs."""
        running, self._running, self._progress.visible = self._running, None, False
        if running is not None:
            running.cancel()
            self._page.say("the bake was cancelled")
        return running is not None

    def close(self) -> None:
        """End a bake that runs, and forget what bakes have solved."""
        self.give_up()
        self._held.close()

    def _show_baked(self, found: BakedFile | WrinkleError) -> None:
        if self._running is None:  # cancelled meanwhile
            return
        self._running, self._progress.visible = None, False
        if isinstance(found, WrinkleError):
            raise found
        self._page.compare(found)
        self._page.say(f"{found.summary}\nThe tab View shows it in place: baked file")

    def _show_progress(self, stage: str, done: int, total: int) -> None:
        if self._running is not None:
            self._progress.visible, self._progress.value = True, 100.0 * done / max(total, 1)
            self._page.say(f"baking: {stage} {done}/{total}; Escape cancels it", ASKS)

    def _check_files(self) -> None:
        try:
            if self._session.refresh():
                self._page.work.put("watched", self._page.refresh)
        finally:
            self._page.slow.put_later("watch", _CHECK_SECONDS, self._check_files)


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
        degrees = value_within(self._axes[axis])
        self._take(self._session.pose.with_turn(self._joint.value, axis, degrees))

    def _set_weight(self) -> None:
        self._take(self._session.pose.with_weight(self._morph.value, value_within(self._weight)))

    def _take(self, pose: FreePose) -> None:
        self._session.take_pose(pose)
        self.refresh()
        self._show()

    def _show(self) -> None:
        self._player.go(POSE, 0.0)
