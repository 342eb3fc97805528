"""What `suggest` finds, as a list of the page to accept from, one by one."""

from typing import Any

import viser

from wrinklecli.editor.page.widgets import ASKS, PageCommands, on
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.editor.proposals import Proposal
from wrinklecli.editor.session import Session
from wrinklecli.gltf.document import Document


class SuggestPanel:
    """Tools that are offered.

    Args:
        gui: Of the page; widgets go to where the program is in it.
        work: Does what they ask for.
        slow: Does what takes seconds.
        session: That is edited.
        desk: The page.
    """

    def __init__(
        self, gui: viser.GuiApi, work: WorkQueue, slow: WorkQueue, session: Session, desk: PageCommands
    ) -> None:
        self._gui, self._work, self._slow, self._session, self._desk = gui, work, slow, session, desk
        self._folder: Any = gui.add_folder("Suggested")
        self._offered: list[Any] = []
        self._document: Document | None = None  # that they are for
        with self._folder:
            tip = "Looks for the places that clips compress most, as wrinkle suggest does."
            self._find = gui.add_button("Find places", icon=viser.Icon.SEARCH, color="gray", hint=tip)
        on(self._find.on_click, work, self._ask)

    def _ask(self) -> None:
        self._desk.say("looking for places that fold …", ASKS)
        self._slow.put("offers", self._look)

    def _look(self) -> None:
        offers = self._session.proposals()
        self._work.put("offers", lambda: self._show(offers))

    def drop_old(self) -> None:
        """Proposal nothing that was found in what the asset was before."""
        if self._document is not self._session.document:
            for old in self._offered:
                old.remove()
            self._offered.clear()

    def _show(self, offers: list[Proposal]) -> None:
        """A button for each offer."""
        self._document = None
        self.drop_old()
        self._document = self._session.document
        for offer in offers:
            with self._folder:
                button: Any = self._gui.add_button(f"+ {offer.name}", color="gray", hint=offer.why)
            self._offered.append(button)
            self._listen(button, offer)
        self._desk.say(f"{len(offers)} found: a click takes one" if offers else "nothing found that folds")

    def _listen(self, button: Any, offer: Proposal) -> None:
        def accept() -> None:
            self._desk.settle()
            name = self._session.accept(offer)
            button.remove()
            self._offered.remove(button)
            self._desk.choose(name, look=True)

        on(button.on_click, self._work, accept)
