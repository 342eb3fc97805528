"""The buttons of the page that are about files: save, bake, undo and redo; and what others write meanwhile."""

import time
from typing import Any

import viser

from wrinklecli.editor.baked_file import BakedFile, bake_saved
from wrinklecli.editor.page.widgets import ASKS, PageCommands, add_group, on
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.editor.session import Session
from wrinklecli.errors import ConfigError

_BAR = 0.2  # seconds between two steps of a bake's progress that are shown
_LOOKS = 1.0  # seconds between two looks whether others have written the files


class _EndedError(Exception):
    """Nobody waits for what is baked; nothing of it is written."""


class FileButtons:
    """The files of a session.

    Args:
        gui: Of the page; widgets go to where the program is in it.
        work: Does what they ask for.
        slow: Does what takes seconds.
        session: Whose files they are.
        desk: The page.
    """

    def __init__(
        self, gui: viser.GuiApi, work: WorkQueue, slow: WorkQueue, session: Session, desk: PageCommands
    ) -> None:
        self._work, self._slow, self._session, self._desk = work, slow, session, desk
        self._told = 0  # of the session's notes
        actions = {"Save": self._save, "Bake": self._bake, "Undo": self._undo, "Redo": self._redo}
        add_group(gui, work, "file", actions)
        self._over: Any = gui.add_button("Save over what others have written", color="red", visible=False)
        on(self._over.on_click, work, lambda: self._save(overwrite=True))
        self._progress: Any = gui.add_progress_bar(0.0, visible=False)
        on(gui.add_command("Save", hotkey="S", modifier="cmd/ctrl").on_trigger, work, self._save)
        on(gui.add_command("Undo", hotkey="Z", modifier="cmd/ctrl").on_trigger, work, self._undo)
        on(gui.add_command("Redo", hotkey="Z", modifier="cmd/ctrl+shift").on_trigger, work, self._redo)
        slow.put_later("watch", _LOOKS, self._watch)

    def _undo(self) -> None:
        self._step(forward=False)

    def _redo(self) -> None:
        self._step(forward=True)

    def _step(self, *, forward: bool) -> None:
        self._desk.settle()
        what = self._session.redoable if forward else self._session.undoable
        (self._session.redo if forward else self._session.undo)()
        self._desk.refresh()
        self._desk.say(f"{'again' if forward else 'undone'}: {what}" if what else "nothing more")

    def _save(self, *, overwrite: bool = False) -> None:
        self._desk.settle()
        try:
            self._session.save(overwrite=overwrite)
            self._over.visible = False
        except ConfigError:
            self._over.visible = True
            raise
        self._desk.refresh()
        self._desk.say(f"saved as {self._session.path}")

    def _bake(self) -> None:
        """Save, and bake beside all else."""
        self._save()
        self._progress.visible = True
        self._desk.say("baking …", ASKS)
        self._slow.put("bake", self._bake_saved)

    def _bake_saved(self) -> None:
        last = [0.0]

        def progress(stage: str, done: int, total: int) -> None:
            if self._slow.ended:
                raise _EndedError
            # Rarely enough for the page to draw it.
            if time.monotonic() - last[0] > _BAR:
                last[0] = time.monotonic()
                self._work.put("progress", lambda: self._show_progress(stage, done, total))

        try:
            baked = bake_saved(self._session, progress)
        except _EndedError:
            return
        finally:
            self._work.put("progress", lambda: self._show_progress("", 0, 1))
        self._work.put(object(), lambda: self._show_baked(baked))

    def _show_baked(self, baked: BakedFile) -> None:
        self._desk.compare(baked)
        self._desk.say(f"{baked.summary}\nView, baked file: shows it in place")

    def _show_progress(self, stage: str, done: int, total: int) -> None:
        self._progress.visible = bool(stage)
        self._progress.value = 100.0 * done / max(total, 1)
        if stage:
            self._desk.say(f"baking: {stage} {done}/{total}", ASKS)

    def _watch(self) -> None:
        """Take up what others have written."""
        try:
            if self._session.refresh():
                self._work.put("watched", self._desk.refresh)
        finally:
            self._slow.put_later("watch", _LOOKS, self._watch)

    def tell(self) -> None:
        """Say what the session has noted since the last time."""
        notes, self._told = self._session.notes[self._told :], len(self._session.notes)
        if notes:
            self._desk.say("\n".join(notes), ASKS)
