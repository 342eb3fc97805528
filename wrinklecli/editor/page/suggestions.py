"""The panel of proposed tools: a picture of each before and after, where it lies, and buttons that show and take it."""

import html
from functools import partial
from typing import Any

import viser

from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.page.drawn_scene import HINTED
from wrinklecli.editor.page.pictures import BOTH, image, picture_of
from wrinklecli.editor.page.player import Player
from wrinklecli.editor.page.viewpoints import clear_time
from wrinklecli.editor.page.viewport import Viewport
from wrinklecli.editor.page.widgets import ASKS, PageHost, add_button, add_group, show_changed
from wrinklecli.editor.proposals import Proposal
from wrinklecli.editor.raised import RaisedTool
from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.pixels import Bytes


@dataclass(slots=True, eq=False)
class _Row:
    """A proposal with its widgets; once it was tried on the asset, the tool, and the time at which it is shown."""

    proposal: Proposal
    card: Any
    buttons: Any
    raised: RaisedTool | None = None
    time: float = 0.0


class SuggestPanel:
    """Widgets for proposed tools, at the current place of the panel."""

    def __init__(self, page: PageHost, player: Player, viewport: Viewport) -> None:
        self._page, self._session, self._player, self._viewport = page, page.session, player, viewport
        self.folder: Any = page.server.gui.add_folder("Suggested")
        self._rows: list[_Row] = []
        self._document: Document | None = None  # the asset that the proposals are for
        with self.folder:
            tip = "Looks for the places that clips compress most, or the pose that is set and shown."
            add_button(page, "Find places", self._ask, icon=viser.Icon.SEARCH, color="gray", hint=tip)
            tip = "Adds all that are shown, in one step to undo."
            self._all = add_button(page, "Take all", self._take_all, color="gray", hint=tip, visible=False)

    def refresh(self) -> None:
        """Hide proposals whose places have tools by now, and remove all if the asset has changed."""
        if self._document is not self._session.document:
            self._clear()
        for row in self._rows:
            free = not self._session.is_taken(row.proposal)
            show_changed(row.card, "visible", free)
            show_changed(row.buttons, "visible", free)
        show_changed(self._all, "visible", sum(row.card.visible for row in self._rows) > 1)

    def _clear(self) -> None:
        self._viewport.hint_at(None)
        for row in self._rows:
            row.card.remove()
            row.buttons.remove()
        self._rows = []

    def _ask(self) -> None:
        posed = self._player.clip == POSE and self._session.pose != FreePose()
        self._page.say(f"looking for places that {'the pose' if posed else 'the motions'} fold …", ASKS)
        self._page.slow.put("proposals", partial(self._find, posed=posed))

    def _find(self, *, posed: bool) -> None:
        """Find proposals; on the slow thread."""
        proposals = self._session.proposals(posed=posed)
        self._page.work.put("proposals", lambda: self._show(proposals))

    def _show(self, proposals: list[Proposal]) -> None:
        self._clear()
        self._document = self._session.document
        for number, proposal in enumerate(proposals):
            with self.folder:
                row = _Row(proposal, self._page.server.gui.add_html(""), None)
                actions = {"Look": partial(self._look, row), "Take": partial(self._take, row)}
                row.buttons = add_group(self._page, proposal.name, actions)
            self._rows.append(row)
            row.card.content = _card(number, row, None)
            self._page.slow.put(("try", number), partial(self._try, number, row))
        self.refresh()
        free = sum(row.card.visible for row in self._rows)
        taken = f"; {counted(len(proposals) - free, 'place')} with tools left out" if free < len(proposals) else ""
        nothing = self._session.notes[-1] if self._session.notes else "nothing found that folds"
        self._page.say(f"{free} found: Take adds one{taken}" if proposals else nothing)

    def _try(self, number: int, row: _Row) -> None:
        """Try a proposal on the asset and draw it; on the slow thread."""
        raised = self._session.try_out(row.proposal) if row in self._rows else None
        time = 0.0 if raised is None else clear_time(raised)
        picture = None if raised is None else picture_of(raised, time, self._viewport.paints, before=True)

        def show() -> None:
            if row in self._rows:
                row.raised, row.time = raised, time
                row.card.content = _card(number, row, picture)

        self._page.work.put(object(), show)

    def point_at(self, number: str, _tab: viser.ClientHandle) -> None:
        """Outline a proposal while the mouse is over its picture."""
        raised = {str(k): row.raised for k, row in enumerate(self._rows)}.get(number)
        self._viewport.hint_at(None if raised is None else raised.attached)

    def _look(self, row: _Row) -> None:
        """Go to where a proposal would be tallest."""
        if row.raised is None or row not in self._rows:
            self._page.say("It does not fit the tools as they are, or is not drawn yet.", ASKS)
            return
        self._viewport.hint_at(row.raised.attached)
        self._player.go(self._player.name_of(row.raised.clip), row.time)
        self._viewport.look_at_tool(HINTED)

    def _take(self, row: _Row) -> None:
        if row not in self._rows or not row.card.visible:  # the second click of two, or that of another tab
            return
        self._page.commit()
        (name,) = self._session.accept(row.proposal)
        self._viewport.hint_at(None)
        self._page.choose(name, look=True)

    def _take_all(self) -> None:
        self._page.commit()
        names = self._session.accept(*(row.proposal for row in self._rows if row.card.visible))
        self._viewport.hint_at(None)
        self._page.refresh()
        self._page.say(f"{', '.join(names)}: added")


def _card(number: int, row: _Row, picture: Bytes | None) -> str:
    """HTML of a proposal: its picture, and below it the reason, the height and the clip."""
    raised, why = row.raised, row.proposal.why
    when = "" if raised is None else f"; {raised.height:.3g} tall at {raised.time:.2f} s of {raised.clip.name}"
    text = html.escape(f"{why[:1].upper()}{why[1:]}{when}")
    style = "padding:4px 12px;font-size:.85em;overflow-wrap:anywhere"
    return f'<div data-over="proposal {number}" style="{style}">{image(picture, BOTH)}{text}</div>'
