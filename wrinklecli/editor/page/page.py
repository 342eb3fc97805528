"""The page of `wrinkle edit`: a session's state as widgets and pictures, and what people do there as its edits."""

import contextlib
import html
import logging
import os
import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import viser

from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.page.controls import Steps, ToolControls
from wrinklecli.editor.page.file_buttons import FileButtons
from wrinklecli.editor.page.keyboard import KEYBOARD
from wrinklecli.editor.page.player import Charts, Player
from wrinklecli.editor.page.pointer import Pointer
from wrinklecli.editor.page.pose_panel import PosePanel
from wrinklecli.editor.page.server import Address, serve
from wrinklecli.editor.page.suggest_panel import SuggestPanel
from wrinklecli.editor.page.viewport import Viewport
from wrinklecli.editor.page.widgets import BAD, GOOD, SetMode, TypedText, add_group, on, on_set
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.editor.session import EditedTool, Session
from wrinklecli.errors import WrinkleError, counted

_SLIDES = 0.35  # seconds without a further change after which a slider has been let go
_TYPES = 0.8  # seconds without a further key after which a line has been typed
_LINES = 2.9  # heights of a letter that two lines take
_PATIENCE = 2.0  # seconds that the end waits for what can be left
_WIDE = 380  # pixels of the panel
_FOLLOWS = 0.15  # seconds without a further change after which all but the mesh shows what slides
_WARNS = 1.0  # seconds after an edit, before what `check` would warn of is looked for
_WARNING = "#b35c00"
_HINT = (
    "None yet. New tool takes two clicks on the mesh, across the wrinkles to be; Find places looks for folds. "
    "Drag turns the view, with the right button it moves, the wheel comes closer."
)


class Page:
    """A served page, until `close`.

    Args:
        session: What it edits.
        place: Where it is served.
        heat: Whether to begin with the surface coloured by its compression.

    Raises:
        WrinkleError: The port is taken, or the host is no address of this machine.

    Attributes:
        server: That has the tabs, with their cameras.
        chosen: The name of the tool that the page shows; none for none.
        player: What says which moment is shown.
    """

    def __init__(self, session: Session, place: Address, *, heat: bool = False) -> None:
        self._session = session
        self._work = WorkQueue(self._fail)
        # What takes seconds: a clip plays on meanwhile.
        self._slow = WorkQueue(lambda error: self._work.put(object(), lambda: self._fail(error)))
        self.server = serve(place)
        self._hand = Pointer(self._work, session, self)
        self._picture = Viewport(self.server, self._work, session, self._hand.drag)
        self._hand.listen(self.server, self._picture)
        self.chosen: str | None = None
        # What slides or is typed, and what makes an edit of it.
        self._waiting: tuple[Hashable, Callable[[], None]] | None = None
        self._buttons: dict[str, Any] = {}
        self._warnings: dict[str, list[str]] = {}
        self._build(heat=heat)
        self.refresh()
        self._picture.look_at_all()
        self._threads = [threading.Thread(target=each.run, daemon=True) for each in (self._work, self._slow)]
        for thread in self._threads:
            thread.start()

    @property
    def port(self) -> int:
        """That the page is served on."""
        return self.server.get_port()

    def close(self) -> None:
        """End what is being done, and serve no more; what is being saved is saved, what is being baked is not."""
        self.rest(_PATIENCE)
        with contextlib.suppress(WrinkleError):
            self.settle()
        self.server.stop()

    def rest(self, patience: float | None = None) -> None:
        """Do nothing more by itself, and serve what is there.

        Args:
            patience: Seconds to wait for what takes long; as long as it takes where left out.
        """
        for work, thread in zip((self._work, self._slow), self._threads, strict=True):
            work.end()
            thread.join(patience if work is self._slow else None)

    # Widgets.

    def _build(self, *, heat: bool) -> None:
        gui = self.server.gui
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=(31, 111, 214))
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_WIDE)
        gui.add_html(KEYBOARD)
        self._head = gui.add_html("")
        self._said = gui.add_html("")
        self.say("")
        self._keeping = FileButtons(gui, self._work, self._slow, self._session, self)
        play = gui.add_panel()
        with play.add_tab("Play"):
            self.player = Player(self.server, self._work, self._session.clips, self._session.frame_times, self._show)
        with play.add_tab("View"):
            self._picture.add_widgets(gui, self._show, heat=heat)
            self.player.add_speed(gui)
        with play.add_tab("Pose"):
            self._poser = PosePanel(gui, self._work, self._session, self.player)
        play.float(x=15, y=-15, width=420)
        self._hand.add_button(gui)
        self._list = gui.add_folder("Tools")
        with self._list:
            self._hint = gui.add_html(_line(_HINT, "#666"))
        self._proposals = SuggestPanel(gui, self._work, self._slow, self._session, self)
        self._panel: Any = gui.add_folder("Tool", visible=False)
        with self._panel:
            self._add_tool_panel(gui)

    def _add_tool_panel(self, gui: viser.GuiApi) -> None:
        self._name: Any = gui.add_text("name", "")
        self._name_line = TypedText(self._name)
        on_set(self._name, self._work, "name", self._rename)
        tip = "Also make the tool of the other side: x negated, left and right exchanged in its name."
        self._twin: Any = gui.add_checkbox("both sides", initial_value=False, hint=tip)
        on_set(self._twin, self._work, "twin", self._mirror)
        actions = {
            "Look": self._look,
            "Solo": self._solo,
            "On/off": self._switch,
            "Copy": self._copy,
            "Delete": self._delete,
        }
        add_group(gui, self._work, "tool", actions)
        clips = [clip.name for clip in self._session.clips if clip.name not in self._session.range_clips]
        self._controls = ToolControls(gui, self._changed, self._unset, clips)
        self._told = gui.add_html("")  # below what a hand is at, which must not move
        self._charts = Charts(gui)

    # What is said.

    def say(self, text: str, colour: str = GOOD) -> None:
        """A line on the page; none for an empty text. Two have their room, so that nothing below moves."""
        self._said.content = f'<div style="min-height:{_LINES}em">{_line(text, colour)}</div>'

    def _fail(self, error: Exception) -> None:
        """Say what went wrong; the page stays."""
        if isinstance(error, WrinkleError):
            self.say("\n".join(error.lines[:6]), BAD)
        else:
            logging.getLogger(__name__).error("this is a bug of wrinkle's", exc_info=error)
            self.say(f"a bug of wrinkle's: {type(error).__name__}: {error}", BAD)
        with contextlib.suppress(WrinkleError):
            self.refresh()

    # What is shown.

    def compare(self, baked: BakedFile) -> None:
        """Proposal to show what was baked in place of what is edited, until that is another."""
        self._picture.compare(baked)
        self._show()

    def refresh(self) -> None:
        """Show the session's state: after every edit."""
        tools = self._session.tools()
        names = [tool.name for tool in tools]
        if self.chosen not in names:
            self.chosen = None
        state = "not saved yet" if self._session.changed else "saved"
        name = html.escape(os.path.basename(self._session.path))
        self._head.content = (
            f'<div style="padding:4px 12px;overflow-wrap:anywhere"><b>{name}</b>'
            f'<span style="opacity:.6"> · {counted(len(tools), "tool")} · {state}</span></div>'
        )
        self._list_tools(tools)
        self._panel.visible = self.chosen is not None
        for tool in tools:
            if tool.name == self.chosen:
                self._panel.label = tool.name
                self._name_line.show(tool.name, tool.name)
                self._twin.value = tool.partner is not None
                self._told.content = self._told_of(tool)
                laid = self._session.attached_tools().get(tool.name)
                span = tool.length if laid is None else laid.patch.span
                self._controls.show(tool.values, sorted(tool.own), span or 1.0)
        self._picture.read()
        self._picture.drop_old()
        self._proposals.drop_old()
        self.player.take(self._session.clips)
        self._poser.refresh()
        self._show()
        self._work.put_later("chart", 0.0, self._chart)
        self._keeping.tell()
        if not self._session.is_refined:
            self._slow.put("settle", self._refine)
            self._slow.put_later("warn", _WARNS, self._warn)

    def _refine(self) -> None:
        """Refine for what tools are now, beside all else."""
        self._session.refine()
        self._work.put("refined", self._show)

    def _warn(self) -> None:
        """Find out what `check` would warn of, beside all else."""
        found = self._session.warnings()

        def tell() -> None:
            self._warnings = found
            self.refresh()

        self._work.put("warned", tell)

    def _told_of(self, tool: EditedTool) -> str:
        """What is wrong with a tool, and what `check` would warn of."""
        if tool.problem:
            return _line(tool.problem, BAD)
        contact = tool.values.get("contact") not in (None, False, "off")
        left_out = _line("Bake resolves its contact; until then it is shown without.", "#666") if contact else ""
        names = [tool.name] if tool.partner is None else [tool.name, tool.partner]
        return left_out + "".join(_line(line, _WARNING) for name in names for line in self._warnings.get(name, []))

    def _list_tools(self, tools: Sequence[EditedTool]) -> None:
        """A button for each tool."""
        self._hint.visible = not tools
        for name in [name for name in self._buttons if name not in {tool.name for tool in tools}]:
            self._buttons.pop(name).remove()
        for order, tool in enumerate(tools):
            notes = [
                "" if tool.enabled else "off",
                "solo" if tool.solo else "",
                f"and {tool.partner}" if tool.partner else "",
                "does not fit" if tool.problem else "warnings" if self._warnings.get(tool.name) else "",
            ]
            told = ", ".join(note for note in notes if note)
            label = f"{tool.name} ({told})" if told else tool.name
            if tool.name not in self._buttons:
                with self._list:
                    button = self._buttons[tool.name] = self.server.gui.add_button(label)
                self._listen(button, tool.name)
            button = self._buttons[tool.name]
            button.label, button.order = label, float(order)
            button.color = "blue" if tool.name == self.chosen else "red" if tool.problem else "gray"

    def _listen(self, button: Any, name: str) -> None:
        on(button.on_click, self._work, lambda: self.choose(name, look=True))

    def _show(self) -> None:
        """Show the player's moment."""
        self._picture.show(self.player, self.chosen)
        self._chart_now()

    def _chart(self) -> None:
        """Draw the chosen tool's curves."""
        clip, over = self.player.clip, None
        laid = self._session.attached_tools().get(self.chosen) if self.chosen else None
        if self.chosen is not None and laid is not None:
            patch = laid.carried.patch
            self._charts.show_reach(patch.span, patch.greatest_height)
            over = None if clip is None else self._session.heights(self.chosen, clip)
        self._charts.show_heights(over)
        self._chart_now()

    def _chart_now(self) -> None:
        if self.chosen is not None:
            self._charts.show_now(self.player.time)
            self._charts.show_curve(self._session.curve(self.chosen, self.player.clip, self.player.time))

    # What people do: choosing and looking.

    def choose(self, name: str | None, *, look: bool) -> None:
        """Show a tool, and let the cameras look at it."""
        self.settle()
        self.chosen = name
        self.refresh()
        if look and name is not None:
            self._picture.look_at_tool(name)

    def _look(self) -> None:
        if self.chosen is not None:
            self._picture.look_at_tool(self.chosen)

    # What people do: editing.

    def _changed(self, steps: Steps, value: Any, way: SetMode) -> None:
        """Set a key of the chosen tool; called by widgets."""
        name = self.chosen
        if name is None:
            return

        def edit(draft: bool) -> None:
            self._session.set_value(name, steps, value, draft=draft)

        actions: dict[SetMode, Callable[[], None]] = {
            "slides": lambda: self.slide((name, *steps), edit),
            "typed": lambda: self._wait((name, *steps), _TYPES, lambda: edit(False)),
            "at once": lambda: self._edit(lambda: edit(False)),
        }
        self._work.put(("set", steps), actions[way])

    def slide(self, of: Hashable, edit: Callable[[bool], None]) -> None:
        """Show a draft of an edit, which becomes one as soon as nothing follows.

        Args:
            of: What is edited; a draft of anything else becomes an edit before.
            edit: Called with whether it is a draft.
        """
        self._wait(of, _SLIDES, lambda: edit(False))
        edit(True)
        # The mesh comes first.
        self._show()
        self._work.put_later("follow", _FOLLOWS, self.refresh)

    def _wait(self, of: Hashable, seconds: float, edit: Callable[[], None]) -> None:
        """Make an edit as soon as nothing follows that is of the same."""
        if self._waiting is not None and self._waiting[0] != of:
            self.settle()
        self._waiting = of, edit
        self._work.put_later("waits", seconds, self.settle)

    def settle(self) -> None:
        """Make an edit of what slides or is typed."""
        self._work.drop("waits")
        waiting, self._waiting = self._waiting, None
        if waiting is not None:
            waiting[1]()
            self.refresh()

    def _edit(self, action: Callable[[], object]) -> None:
        self.settle()
        action()
        self.say("")
        self.refresh()

    def _unset(self, key: str) -> None:
        name = self.chosen
        if name is not None:
            self._work.put(("unset", key), lambda: self._edit(lambda: self._session.unset(name, (key,))))

    def _rename(self) -> None:
        old, new = self.chosen, str(self._name.value)

        def rename() -> None:
            if old is not None and new not in ("", old):
                self._session.rename(old, new)
                self.chosen = new
                self.say("")

        self._wait("name", _TYPES, rename)

    def _mirror(self) -> None:
        if self.chosen is not None:
            self.settle()
            self.choose(self._session.mirror(self.chosen, "x" if self._twin.value else None), look=False)

    def _chosen_tool(self) -> EditedTool | None:
        return next((tool for tool in self._session.tools() if tool.name == self.chosen), None)

    def _solo(self) -> None:
        chosen = self._chosen_tool()
        if chosen is not None:
            self._edit(lambda: self._session.solo(() if chosen.solo else (chosen.name,)))

    def _switch(self) -> None:
        chosen = self._chosen_tool()
        if chosen is not None:
            self._edit(lambda: self._session.enable(chosen.name, enabled=not chosen.enabled))

    def _copy(self) -> None:
        if self.chosen is not None:
            self.settle()
            self.choose(self._session.copy(self.chosen), look=False)

    def _delete(self) -> None:
        if self.chosen is not None:
            name = self.chosen
            self._edit(lambda: self._session.delete(name))


def _line(text: str, colour: str) -> str:
    """Text as HTML, of a colour."""
    shown = html.escape(text).replace("\n", "<br>")
    return f'<div style="padding:2px 12px 6px;color:{colour};font-size:.85em;overflow-wrap:anywhere">{shown}</div>'
