"""The list of tools that `suggest` proposes, to be accepted one by one."""

from functools import partial
from typing import Any

import viser

from wrinklecli.editor.page.widgets import ASKS, PageHost, add_button
from wrinklecli.editor.proposals import Proposal
from wrinklecli.gltf.document import Document


class SuggestPanel:
    """Widgets for proposed tools, at the current place of the panel."""

    def __init__(self, page: PageHost) -> None:
        self._page = page
        self._folder: Any = page.server.gui.add_folder("Suggested")
        self._buttons: dict[int, Any] = {}
        self._document: Document | None = None  # the asset that the proposals are for
        with self._folder:
            tip = "Looks for the places that clips compress most, as wrinkle suggest does."
            add_button(page, "Find places", self._ask, icon=viser.Icon.SEARCH, color="gray", hint=tip)

    def drop_outdated(self) -> None:
        """Remove the proposals if the asset has changed."""
        if self._document is not self._page.session.document:
            for button in self._buttons.values():
                button.remove()
            self._buttons.clear()

    def _ask(self) -> None:
        self._page.say("looking for places that fold …", ASKS)
        self._page.slow.put("proposals", self._find)

    def _find(self) -> None:
        proposals = self._page.session.proposals()
        self._page.work.put("proposals", lambda: self._show(proposals))

    def _show(self, proposals: list[Proposal]) -> None:
        self._document = None
        self.drop_outdated()
        self._document = self._page.session.document
        for number, proposal in enumerate(proposals):
            accept = partial(self._accept, number, proposal)
            with self._folder:
                label = f"+ {proposal.name}"
                self._buttons[number] = add_button(self._page, label, accept, color="gray", hint=proposal.why)
        self._page.say(f"{len(proposals)} found: a click takes one" if proposals else "nothing found that folds")

    def _accept(self, number: int, proposal: Proposal) -> None:
        self._page.commit()
        name = self._page.session.accept(proposal)
        self._buttons.pop(number).remove()
        self._page.choose(name, look=True)
