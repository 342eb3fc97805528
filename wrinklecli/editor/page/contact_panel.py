"""The button that resolves the contact of the chosen tool in the shown clip, and plays what comes of it."""

import time
from typing import Any

import viser

from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.contact_trial import RunningTrial, trial_of
from wrinklecli.editor.page.player import Player
from wrinklecli.editor.page.widgets import ASKS, PageHost, add_button, show_changed
from wrinklecli.editor.session import EditedTool
from wrinklecli.errors import WrinkleError

_START, _CANCEL = "Resolve contact", "Cancel contact"
_TICK_SECONDS = 1.0  # seconds between two messages about a trial that runs


def has_contact(tool: EditedTool) -> bool:
    """True if a tool asks for contact."""
    return tool.values.get("contact") not in (None, False, "off")


class ContactPanel:
    """A button and a progress bar, at the current place of the panel. One trial runs at a time."""

    def __init__(self, page: PageHost, player: Player) -> None:
        self._page, self._session, self._player = page, page.session, player
        self._running: RunningTrial | None = None
        self._since, self._step = 0.0, ""
        tip = "Solves the shown clip as Bake would, and plays it. Until then the tool is shown without contact."
        self._button = add_button(
            page, _START, self._toggle, icon=viser.Icon.FOLD, color="gray", hint=tip, visible=False
        )
        self._progress: Any = page.server.gui.add_progress_bar(0.0, visible=False, animated=True)

    def refresh(self, tool: EditedTool | None) -> None:
        """Offer the button for a tool with contact; a trial of tools that have changed since is given up."""
        if self._running is not None and self._running.trial.text != self._session.text:
            self._end("the tools have changed: contact was not resolved")
        wanted = tool is not None and has_contact(tool)
        show_changed(self._button, "visible", self._running is not None or wanted)
        show_changed(self._button, "label", _START if self._running is None else _CANCEL)
        show_changed(self._progress, "visible", self._running is not None)

    def close(self) -> None:
        """End a trial that runs."""
        if self._running is not None:
            self._running.cancel()

    def give_up(self) -> bool:
        """Cancel a trial; False if none runs."""
        runs = self._running is not None
        if runs:
            self._end("contact was cancelled")
            self._page.refresh()
        return runs

    def _toggle(self) -> None:
        if self.give_up():
            return
        self._page.commit()
        tool = next((each for each in self._session.tools() if each.name == self._page.chosen), None)
        if tool is None or not self._button.visible:  # a click of another tab
            return
        if self._player.clip is None:
            self._page.say("Choose a clip, in which contact is to be resolved.", ASKS)
            return
        self._since, self._step, self._progress.value = time.monotonic(), "", 0.0
        self._running = RunningTrial(trial_of(self._session, tool, self._player.clip), self._stepped, self._done)
        self._page.refresh()
        self._tick()

    def _end(self, text: str) -> None:
        assert self._running is not None
        self._running.cancel()
        self._running = None
        self._page.say(text)

    def _tick(self) -> None:
        """Say how long a trial has run."""
        if self._running is not None:
            seconds = time.monotonic() - self._since
            self._page.say(f"resolving the contact of {self._running.trial.tool}: {seconds:.0f} s {self._step}", ASKS)
            self._page.work.put_later("contact", _TICK_SECONDS, self._tick)

    def _stepped(self, stage: str, done: int, total: int) -> None:
        """Take a step of the trial; on its thread."""

        def show() -> None:
            self._step = f"({stage} {done}/{total})"
            # Nearly all time goes into folds; the bar counts these.
            self._progress.value = 100.0 * done / max(total, 1) if stage == "contact" else 0.0

        self._page.work.put("contact step", show)

    def _done(self, found: BakedFile | WrinkleError) -> None:
        """Take the end of the trial; on its thread."""
        self._page.work.put("contact done", lambda: self._show(found))

    def _show(self, found: BakedFile | WrinkleError) -> None:
        if self._running is None:  # cancelled meanwhile
            return
        clip, self._running = self._running.trial.clip, None
        self._page.refresh()
        if isinstance(found, WrinkleError):
            raise found
        if found.text != self._session.text:
            return
        self._page.compare(found, shown=True)
        self._player.go(clip, self._player.time)
        self._player.toggle()
        self._page.say(f"{found.summary}\nView, {found.label}: shows the tools as they are edited again")
