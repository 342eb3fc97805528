"""The page of `wrinkle edit`: it shows a session as widgets and a 3D view, and turns user actions into edits."""

import contextlib
import html
import logging
import os
import threading
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from typing import Any

import viser

from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.clicked import NEW_KINDS
from wrinklecli.editor.free_pose import POSE
from wrinklecli.editor.page.access import Access
from wrinklecli.editor.page.controls import ToolControls
from wrinklecli.editor.page.mask_brush import MaskBrush
from wrinklecli.editor.page.material_panel import MaterialPanel
from wrinklecli.editor.page.panels import FileButtons, PosePanel
from wrinklecli.editor.page.player import CurveChart, Player
from wrinklecli.editor.page.pointer import Pointer
from wrinklecli.editor.page.server import serve
from wrinklecli.editor.page.suggestions import SuggestPanel
from wrinklecli.editor.page.tab import one_of, run_script
from wrinklecli.editor.page.viewpoints import clear_time
from wrinklecli.editor.page.viewport import Viewport
from wrinklecli.editor.page.widgets import (
    ASKS,
    BAD,
    GOOD,
    PANEL_WIDTH,
    QUIET,
    SetMode,
    TypedText,
    add_group,
    add_shortcut,
    on_set,
    over_view,
    paragraph_of,
    show_changed,
)
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.editor.session import EditedTool, Session
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.tools.schema import KINDS
from wrinklecli.tools.yaml_edit import Steps

_SLIDE_SECONDS = 0.35  # seconds without a change after which a slider has been released
_TYPE_SECONDS = 0.8  # seconds without a key after which a line has been typed
_DRAG_SECONDS = 20.0  # likewise for a drag, which says itself when it ends unless its tab is closed
_FOLLOW_SECONDS = 0.15  # seconds without a change after which widgets other than the 3D view follow a slider
_WARN_SECONDS = 1.0  # seconds between an edit and the search for warnings
_CLOSE_SECONDS = 2.0  # seconds that the end waits for slow work
_MAX_LINES = 6  # lines of an error message
_ALL = "– all –"  # in place of a tool's name, among names
_BRAND = (31, 111, 214)  # sRGB
_WARNING = "#b35c00"
_ROW = (
    "border:0;padding:4px 2px;background:none;color:inherit;font:inherit;font-size:.9em;text-align:left;cursor:pointer"
)
_COLUMN = '<div style="padding:0 12px;text-align:right;opacity:.6;font-size:.75em">greatest height over length</div>'
_DOT = "display:inline-block;width:.7em;height:.7em;border-radius:50%;margin-right:.5em"
_START = "Choose a tool in the list: it is shown where it is tallest. B shows it without wrinkles."
_START_EMPTY = (
    "Find places proposes tools. A new field takes a click on a garment, a tool two, across the wrinkles to be.\n"
    "Drag turns the view, with the right button it moves, the wheel comes closer."
)
_NO_WARNINGS, _CHECKING = "no warnings", "checking …"
_NO_CONTACT = "It is edited without its contact, which Bake resolves."
_TURN = "Pose turns joints by hand."
_DRAG_DOT = "Drag its dot: the skin slides."


class Page:
    """A page that shows a session until `close`, to those of `access`, at a port, of which 0 stands for any free one.

    With `heat` it begins with the surface coloured by its compression. See `PageHost` for its attributes.

    Attributes:
        wanted: A session of another asset, which a user asks to see in place of this one.
        known: The tools file of each asset that was shown so far, by its path. The page offers to open these.

    Raises:
        WrinkleError: The port is taken, or the host is no address of this machine.
    """

    def __init__(
        self,
        session: Session,
        access: Access | None = None,
        port: int = 0,
        *,
        heat: bool = False,
        known: Mapping[str, str] | None = None,
    ) -> None:
        self.session = session
        shown = {os.path.abspath(session.asset): os.path.abspath(session.path)}
        self.known = {**shown, **(known or {}), **shown}
        self.wanted: Session | None = None
        self.work = WorkQueue(self._fail)
        # Actions that take seconds have a thread of their own, so that a clip plays on.
        self.slow = WorkQueue(lambda error: self.work.put(object(), lambda: self._fail(error)))
        self._access = access or Access.to("127.0.0.1")
        self.server = serve(self._access, port)
        self._pointer = Pointer(self)
        self._viewport = Viewport(self, self._pointer.drag)
        self._pointer.listen(self._viewport)
        self.chosen: str | None = None
        self._pending: tuple[Hashable, Callable[[], None]] | None = None  # the key of a draft, and the edit it becomes
        self.keys = {"Shift+drag": "Light from where the mouse is", "?": "These keys"}
        self._warnings: dict[str, list[str]] = {}
        self._moves: dict[str, float] = {}  # greatest moves of the skin over the length, by name
        # The text that was last checked, and what is said where there are no warnings.
        self._checked, self._verdict = "", _CHECKING
        self._said = "", GOOD  # the message and its colour
        self._found = ""  # HTML of the problems below the message
        self._build(heat=heat)
        self.refresh()
        self._viewport.look_at_all()
        self._threads = [threading.Thread(target=each.run, daemon=True) for each in (self.work, self.slow)]
        for thread in self._threads:
            thread.start()

    @property
    def port(self) -> int:
        """Port on which the page is served."""
        return self.server.get_port()

    @property
    def address(self) -> str:
        """Address of the page, with its token."""
        return self._access.address(self.port)

    def close(self) -> None:
        """Finish the current edit and end the server; a running save is finished, a running bake is given up."""
        self._files.close()
        self.stop_work(_CLOSE_SECONDS)
        with contextlib.suppress(WrinkleError):
            self.commit()
        self.server.stop()

    def instead(self) -> "Page":
        """Close this page, and show the session that is wanted at the same address."""
        assert self.wanted is not None
        port = self.port
        self.close()
        return Page(self.wanted, self._access, port, known=self.known)

    def stop_work(self, patience: float | None = None) -> None:
        """End the threads of this page, and wait some seconds for slow work, or until it is done if None."""
        for work, thread in zip((self.work, self.slow), self._threads, strict=True):
            work.end()
            thread.join(patience if work is self.slow else None)

    # Widgets.

    def _build(self, *, heat: bool) -> None:
        gui, session = self.server.gui, self.session
        gui.configure_theme(show_logo=False, show_share_button=False, brand_color=_BRAND)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_WIDTH)
        self._head = gui.add_html("")
        self._message = gui.add_html("")
        self.say(_START if session.tools() else _START_EMPTY, ASKS)
        self._files = FileButtons(self)
        play = gui.add_panel()
        with play.add_tab("Play"):
            gui.add_html('<i data-strip="play"></i>')
            self.player = Player(self)
        with play.add_tab("View"):
            gui.add_html('<i data-strip="view"></i>')
            self._viewport.add_widgets(heat=heat)
            self.player.add_speed()
        with play.add_tab("Pose"):
            gui.add_html('<i data-strip="pose"></i>')
            self._pose_panel = PosePanel(self, self.player)
        play.float(x=15, y=-15, width=PANEL_WIDTH)
        play.expand()
        self._pointer.add_buttons()
        self._names: Any = gui.add_dropdown("chosen", (_ALL,), hint="Escape leaves a tool, or what is pending.")
        on_set(self, self._names, "chosen", self._choose_named)
        add_shortcut(self, "Cancel what is pending, or leave the tool", self._escape, "escape")
        self._list = gui.add_folder("Tools")
        with self._list:
            self._rows: Any = gui.add_html("")
        self._suggest_panel = SuggestPanel(self, self.player, self._viewport)
        self._tool_panel: Any = gui.add_folder("Tool", visible=False)
        with self._tool_panel:
            self._name: Any = gui.add_text("name", "")
            self._typed_name = TypedText(self._name)
            on_set(self, self._name, "name", self._rename)
            tip = "Also make the tool of the other side: x negated, left and right exchanged in its name."
            self._both_sides: Any = gui.add_checkbox("both sides", initial_value=False, hint=tip)
            on_set(self, self._both_sides, "both sides", self._mirror)
            actions: dict[str, Callable[[EditedTool], str | None]] = {
                "Solo": lambda tool: session.solo(() if tool.solo else (tool.name,)),
                "On/off": lambda tool: session.enable(tool.name, enabled=not tool.enabled),
                "Copy": lambda tool: session.copy(tool.name),
                "Delete": lambda tool: session.delete(tool.name),
            }
            edits = {label: partial(self._edit, edit) for label, edit in actions.items()}
            add_group(self, "tool", {"Look": self._look, **edits})
            self._materials = MaterialPanel(self, self._viewport)
            self._brush = MaskBrush(self, self._viewport)
            clips = [clip.name for clip in session.clips if clip.name not in session.range_clips]
            self._controls = {key: ToolControls(gui, self._changed, clips, key) for key in KINDS}
            self._curve = CurveChart(gui)
        heard = {
            "reset": self._unset,
            "choose": one_of(session.tools, lambda tool: self.choose(tool.name, look=True)),
            "switch": one_of(session.tools, self._switch),
            "new": one_of(lambda: [*NEW_KINDS], self._pointer.press),
            "at": self._pointer.hover,
            "light": self._viewport.light_from,
            "paint": self._brush.paint,
            "draw": self._materials.draw,
            "material": one_of(lambda: [*self._materials.titles], self._materials.take),
            "proposal": self._suggest_panel.point_at,
            "keys": lambda *_: self.say("\n".join(f"{key}: {does}" for key, does in self.keys.items()), QUIET),
        }
        run_script(self, heard)

    # Messages.

    @property
    def shown_clip(self) -> str | None:
        """Name of the clip that is shown, or of the pose; None at rest."""
        return self.player.clip

    @property
    def shown_time(self) -> float:
        """Shown time of the clip, seconds."""
        return self.player.time

    def say(self, text: str, colour: str = GOOD) -> None:
        """Show a message in the corner of the view, or remove it."""
        self._said = text, colour
        self.show_messages()

    def show_messages(self) -> None:
        """Show the message, the problems below it, which it does not repeat, and the legend of the view."""
        text, colour = self._said
        text = "\n".join(line for line in text.splitlines() if paragraph_of(line, _WARNING) not in self._found)
        said = paragraph_of(text, colour) if text else ""
        show_changed(self._message, "content", over_view(said + self._found + self._viewport.legend))

    def _fail(self, error: BaseException) -> None:
        """Show an error; the page goes on."""
        if isinstance(error, WrinkleError):
            self.say("\n".join(error.lines[:_MAX_LINES]), BAD)
        else:
            logging.getLogger(__name__).error("this is a bug of wrinkle's", exc_info=error)
            self.say(f"a bug of wrinkle's: {type(error).__name__}: {error}", BAD)
        with contextlib.suppress(WrinkleError):
            self.refresh()

    # What is shown.

    def compare(self, baked: BakedFile) -> None:
        """Offer to show a baked file instead of the edited asset, until the tools change."""
        self._viewport.compare(baked)
        self.show()

    def refresh(self) -> None:
        """Show the session's state, after every edit."""
        tools = self.session.tools()
        if self.chosen not in [tool.name for tool in tools]:
            self.chosen = None
        kept = "saved" if os.path.lexists(self.session.path) else "no file yet"
        state = "not saved yet" if self.session.changed else kept
        name = html.escape(os.path.basename(self.session.path))
        self._head.content = (
            f'<div style="padding:4px 12px;overflow-wrap:anywhere"><b>{name}</b>'
            f'<span style="opacity:.6"> · {_counts(tools)} · {state}</span></div>'
        )
        self._tool_panel.visible = self.chosen is not None
        chosen = next((tool for tool in tools if tool.name == self.chosen), None)
        if chosen is not None:
            self._show_tool(chosen)
        else:
            self._brush.show(None)
        if not self.session.is_refined or self._checked != self.session.text:
            self._verdict = _CHECKING
            self.slow.put("refine", self._refine)
            self.slow.put_later("warn", _WARN_SECONDS, self._warn)
        problems = "".join(map(self._problems_of, tools if chosen is None else [chosen]))
        self._found = problems or (paragraph_of(self._verdict, QUIET) if tools else "")
        self.show_messages()
        self._viewport.refresh()
        self._suggest_panel.refresh()
        self.player.refresh()
        self._pose_panel.refresh()
        self.show()
        self._list_tools(tools)
        self.work.put_later("chart", 0.0, self._chart)
        self._files.show_notes()

    def _refine(self) -> None:
        """Refine the mesh for the current tools; on the slow thread."""
        self.session.refine()
        self.work.put("refined", self.show)

    def _warn(self) -> None:
        """Collect the warnings of `check`; on the slow thread."""
        self._checked, self._verdict = self.session.text, ""  # which stays if the check fails
        warnings, moves = self.session.warnings(), self.session.greatest_moves()

        def show() -> None:
            self._warnings, self._moves, self._verdict = warnings, moves, _NO_WARNINGS
            self.refresh()

        self.work.put("warned", show)

    def _show_tool(self, tool: EditedTool) -> None:
        """Show a tool in its panel."""
        self._tool_panel.label = tool.name
        self._typed_name.show(tool.name, tool.name)
        self._both_sides.value = tool.partner is not None
        for key, controls in self._controls.items():
            controls.set_visible(visible=key == tool.list_key)
        controls = self._controls[tool.list_key]
        controls.show(tool.keys, self.session.inherited(tool), tool.length or 1.0, [*self.session.presets])
        self._brush.show(tool.name if "mask" in tool.keys else None)
        self._materials.show(tool.name if tool.list_key == "tools" else None)

    def _problems_of(self, tool: EditedTool) -> str:
        """HTML of a tool's problem, or of its warnings."""
        if tool.problem:
            return paragraph_of(tool.problem, BAD)
        note = paragraph_of(_NO_CONTACT, QUIET) if tool.values.get("contact") not in (None, False, "off") else ""
        names = [tool.name] if tool.partner is None else [tool.name, tool.partner]
        lines = [line for name in names for line in self._warnings.get(name, [])]
        return "".join(paragraph_of(line, _WARNING) for line in lines) + note

    def _list_tools(self, tools: Sequence[EditedTool]) -> None:
        """Show a row for each tool."""
        names = (_ALL, *(tool.name for tool in tools))
        show_changed(self._names, "options", names)
        self._names.value = self.chosen or _ALL
        # With a tool chosen, the rest makes room for its sliders.
        for each in (self._files.opened, self._suggest_panel.folder, self._pointer.buttons):
            show_changed(each, "visible", self.chosen is None)
        show_changed(self._list, "visible", self.chosen is None and bool(tools))
        self._names.visible = self.chosen is not None
        rows = "".join(self._row_of(number, tool) for number, tool in enumerate(tools))
        show_changed(self._rows, "content", (_COLUMN if self._moves else "") + rows)

    def _row_of(self, number: int, tool: EditedTool) -> str:
        """HTML of a tool's row: its colour in the view, its name with notes, and a switch."""
        notes = [
            "" if tool.list_key == "tools" else KINDS[tool.list_key].words[0],
            "solo" if tool.solo else "",
            f"and {tool.partner}" if tool.partner else "",
            "does not fit" if tool.problem else "warnings" if self._warnings.get(tool.name) else "",
        ]
        shown = ", ".join(note for note in notes if note)
        marked = BAD if tool.problem else _WARNING if self._warnings.get(tool.name) else "inherit"
        said = f' <span style="color:{marked};opacity:.8">({html.escape(shown)})</span>' if shown else ""
        dot = f'<span style="{_DOT};background:{self._viewport.colour_of(tool.name)}"></span>'
        height = f"{100 * self._moves[tool.name]:.0f} %" if tool.name in self._moves else ""
        switch, off = ("on", "") if tool.enabled else ("off", "opacity:.5")
        return (
            f'<div style="display:flex;padding:0 12px;{off}">'
            f'<button data-say="choose {number}" style="{_ROW};flex:1">{dot}{html.escape(tool.name)}{said}</button>'
            f'<span style="{_ROW};opacity:.6">{height}</span>'
            f'<button data-say="switch {number}" style="{_ROW}" title="Switch it on or off">{switch}</button></div>'
        )

    def show(self) -> None:
        """Show the player's moment."""
        self._viewport.show(self.player, self.chosen)
        self._chart_now()

    def _chart(self) -> None:
        """Draw the charts of the chosen tool."""
        clip, over = self.player.clip, None
        attached = self.session.attached_tools().get(self.chosen) if self.chosen else None
        if self.chosen is not None:
            if attached is not None:
                self._curve.set_ranges(attached.span, attached.attached.greatest_height)
            over = None if clip is None else self.session.heights(self.chosen, clip)
        self.player.show_heights(over)
        self._chart_now()

    def _chart_now(self) -> None:
        if self.chosen is not None:
            self.player.show_now()
            self._curve.show(self.session.curve(self.chosen, self.player.clip, self.player.time))

    # User actions: choosing and looking.

    def choose(self, name: str | None, *, look: bool) -> None:
        """Show a tool, and with `look` turn the cameras to it, at the moment when it is tallest."""
        self._pointer.give_up()
        self.commit()
        self.chosen = name
        self.refresh()
        if look:
            self._look()

    def _look(self) -> None:
        """Turn the cameras to the chosen tool where it is tallest, or seen before; a pose that is set by hand stays."""
        if self.chosen is None:
            return
        attached = self.session.attached().get(self.chosen)
        if self.player.clip != POSE and attached is not None:
            raised = self.session.raised(self.chosen)
            if raised is None:
                how = _TURN if attached.attached.drag is None else _DRAG_DOT
                self.say(f"{self.chosen}: no clip raises it. {how}", ASKS)
            else:
                time, tallest, clip = clear_time(raised), raised.time, raised.clip.name
                self.player.go(clip, time)
                hidden = "" if time == tallest else f", where the fold hides it; this is {time:.2f} s"
                does = "is tallest" if attached.attached.moves is None else "moves the skin most"
                self.say(f"{self.chosen} {does} at {tallest:.2f} s of {clip}{hidden}")
        self._viewport.look_at_tool(self.chosen)

    # User actions: editing.

    def _changed(self, steps: Steps, value: Any, mode: SetMode) -> None:
        """Set a key of the chosen tool; called by widgets."""
        name = self.chosen
        if name is None:
            return
        key = (name, *steps)

        def edit(draft: bool) -> None:
            self.session.set_value(name, steps, value, draft=draft, slides=mode == "slides")

        actions: dict[SetMode, Callable[[], None]] = {
            "slides": lambda: self.slide(key, edit),
            "typed": lambda: self._commit_later(key, _TYPE_SECONDS, lambda: edit(False)),
            "at once": lambda: self._edit(lambda _tool: edit(False)),
        }
        self.work.put(("set", steps), actions[mode])

    def slide(self, key: Hashable, edit: Callable[[bool], None], *, dragged: bool = False) -> None:
        """Show a draft of an edit, which `edit` makes if called with True, and make the edit if no draft follows.

        A draft of another key becomes an edit first. A draft that is refused leaves the one before it to become one.
        A draft that is `dragged` waits for `commit`, so that one drag is one step to undo however slowly it moves.
        """
        self._commit_other(key)
        edit(True)
        self._commit_later(key, _DRAG_SECONDS if dragged else _SLIDE_SECONDS, lambda: edit(False))
        self.show()  # the 3D view follows at once, other widgets later
        self.work.put_later("follow", _FOLLOW_SECONDS, self.refresh)

    def _commit_later(self, key: Hashable, seconds: float, edit: Callable[[], None]) -> None:
        """Make an edit after some seconds, unless another one of the same key follows."""
        self._commit_other(key)
        self._pending = key, edit
        self.work.put_later("commit", seconds, self.commit)

    def _commit_other(self, key: Hashable) -> None:
        """Turn a draft or a typed value of another key into an edit."""
        if self._pending is not None and self._pending[0] != key:
            self.commit()

    def commit(self) -> None:
        """Turn a draft or a typed value into an edit."""
        self.work.drop("commit")
        pending, self._pending = self._pending, None
        if pending is not None:
            pending[1]()
            self.refresh()

    def _edit(self, edit: Callable[[EditedTool], str | None]) -> None:
        """Edit the chosen tool; the edit may return the name of a tool to choose then."""
        self.commit()
        tool = next((tool for tool in self.session.tools() if tool.name == self.chosen), None)
        if tool is not None:
            self.chosen = edit(tool) or tool.name
            self.say("")
            self.refresh()

    def _unset(self, widget: str, _tab: viser.ClientHandle) -> None:
        """Take away the key whose widget a tab names."""

        def unset(tool: EditedTool) -> None:
            key = self._controls[tool.list_key].key_of(widget)
            if key in tool.own:
                self.session.unset(tool.name, (key,))

        self._edit(unset)

    def _switch(self, tool: EditedTool) -> None:
        """Switch the tool of a row on or off."""
        self.commit()
        self.session.enable(tool.name, enabled=not tool.enabled)
        self.refresh()

    def _choose_named(self) -> None:
        name = self._names.value
        self.choose(None if name == _ALL else name, look=name != _ALL)

    def _escape(self) -> None:
        """Cancel what is pending, or else leave the chosen tool."""
        if not any(each.give_up() for each in (self._pointer, self._brush, self._files, self._materials)):
            self.choose(None, look=False)

    def _rename(self) -> None:
        old, new = self.chosen, str(self._name.value)

        def rename() -> None:
            if old is not None and new not in ("", old):
                self.session.rename(old, new)
                self.chosen = new
                self.say("")

        self._commit_later("name", _TYPE_SECONDS, rename)

    def _mirror(self) -> None:
        axis = "x" if self._both_sides.value else None
        self._edit(lambda tool: self.session.mirror(tool.name, axis))


def _counts(tools: Sequence[EditedTool]) -> str:
    """Count the effects of each list that has any."""
    keys = [tool.list_key for tool in tools]
    return ", ".join(counted(keys.count(key), *kind.words) for key, kind in KINDS.items() if key in (keys or ["tools"]))
