"""Buttons for the files: save, bake, undo and redo; and a regular check for files that others have changed."""

import time
from functools import partial
from typing import Any

from wrinklecli.editor.baked_file import BakedFile, bake_saved
from wrinklecli.editor.page.widgets import ASKS, PageHost, add_button, add_group, add_shortcut
from wrinklecli.errors import ConfigError

_PROGRESS_SECONDS = 0.2  # seconds between two shown steps of a bake
_CHECK_SECONDS = 1.0  # seconds between two checks for changed files


class _EndedError(Exception):
    """Ends a bake that nobody waits for; nothing of it is written."""


class FileButtons:
    """Widgets for the files of a session, at the current place of the panel."""

    def __init__(self, page: PageHost) -> None:
        self._page, self._session = page, page.session
        self._noted = 0  # notes of the session that were shown
        undo, redo = partial(self._step, forward=False), partial(self._step, forward=True)
        add_group(page, "file", {"Save": self._save, "Bake": self._bake, "Undo": undo, "Redo": redo})
        overwrite = partial(self._save, overwrite=True)
        label = "Save over what others have written"
        self._overwrite = add_button(page, label, overwrite, color="red", visible=False)
        self._progress: Any = page.server.gui.add_progress_bar(0.0, visible=False)
        add_shortcut(page, "Save", self._save, hotkey="S", modifier="cmd/ctrl")
        add_shortcut(page, "Undo", undo, hotkey="Z", modifier="cmd/ctrl")
        add_shortcut(page, "Redo", redo, hotkey="Z", modifier="cmd/ctrl+shift")
        page.slow.put_later("watch", _CHECK_SECONDS, self._check_files)

    def show_notes(self) -> None:
        """Show the session's new notes."""
        notes, self._noted = self._session.notes[self._noted :], len(self._session.notes)
        if notes:
            self._page.say("\n".join(notes), ASKS)

    def _step(self, *, forward: bool) -> None:
        self._page.commit()
        step = self._session.redoable if forward else self._session.undoable
        (self._session.redo if forward else self._session.undo)()
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
        self._save()
        self._progress.visible = True
        self._page.say("baking …", ASKS)
        self._page.slow.put("bake", self._bake_saved)

    def _bake_saved(self) -> None:
        shown = 0.0

        def progress(stage: str, done: int, total: int) -> None:
            nonlocal shown
            if self._page.slow.ended:
                raise _EndedError
            if time.monotonic() - shown > _PROGRESS_SECONDS:
                shown = time.monotonic()
                self._page.work.put("progress", lambda: self._show_progress(stage, done, total))

        try:
            baked = bake_saved(self._session, progress)
        except _EndedError:
            return
        finally:
            self._page.work.put("progress", lambda: self._show_progress("", 0, 1))
        self._page.work.put(object(), lambda: self._show_baked(baked))

    def _show_baked(self, baked: BakedFile) -> None:
        self._page.compare(baked)
        self._page.say(f"{baked.summary}\nView, baked file: shows it in place")

    def _show_progress(self, stage: str, done: int, total: int) -> None:
        self._progress.visible = bool(stage)
        self._progress.value = 100.0 * done / max(total, 1)
        if stage:
            self._page.say(f"baking: {stage} {done}/{total}", ASKS)

    def _check_files(self) -> None:
        try:
            if self._session.refresh():
                self._page.work.put("watched", self._page.refresh)
        finally:
            self._page.slow.put_later("watch", _CHECK_SECONDS, self._check_files)
