"""The steps of editing a tools file, which can be undone, redone, saved, merged and recovered.

A step is an immutable record of the file's text, so undoing restores the same bytes. Methods may be called from several
threads.
"""

import os
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

import numpy as np

from wrinklecli.editor.store import Store, names_of, without_empty_list
from wrinklecli.errors import ConfigError, WrinkleError, nearest
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.tools.materials import Preset, presets
from wrinklecli.tools.mirror import exchange_sides, numbered, split_side
from wrinklecli.tools.read import read_values
from wrinklecli.tools.records import ToolsFile, identifier, in_axes
from wrinklecli.tools.schema import KINDS, POINT_KEYS, TOOL_KEYS
from wrinklecli.tools.yaml_edit import Steps, ToolsText, with_part

_MAX_STEPS = 300  # steps that can be undone
_MAX_MERGED = 100  # steps before and after the current one that remain when the file has changed on disk
_SLIDE_SECONDS = 3.0  # seconds within which a slider that is set again is still the same drag
_PLACE_DIGITS = 3  # significant digits of a place relative to its tool's length: a thousandth of the length


@dataclass(frozen=True, slots=True)
class Step:
    """A state of the edited file, and in words the edit that led to it.

    `solo` names the tools that are shown alone; if it is empty, all are shown.
    """

    file: ToolsText
    solo: frozenset[str] = frozenset()
    done: str = ""


@dataclass(frozen=True, slots=True)
class Draft:
    """A tool of a list of the file while a value is being dragged: its own keys, and the tools file with them."""

    list_key: str
    number: int
    values: Mapping[str, Any]
    settings: ToolsFile


class Edits:
    """A tools file and its steps. Its tools are the effects of all of its lists, which have names apart.

    An edit raises ConfigError, and changes nothing, if the file would not be valid. With `draft=True` an edit replaces
    the last draft and is no step; the next edit without it is a step, and ends the draft even if it is refused. `notes`
    are lines about changes of the files.

    Raises:
        ConfigError: The file is not valid.
    """

    def __init__(self, store: Store) -> None:
        self.notes: list[str] = []
        self._store = store
        self._lock = threading.RLock()
        self._steps: list[Step] = [Step(ToolsText(store.base, store.path))]
        self._at = 0
        self._draft: Draft | None = None
        self._drag: tuple[Steps, Step, float] | None = None  # the slider that was dragged last, its step and its time
        self._read: tuple[str, ToolsFile] | None = None
        self._settings_of(self._steps[0].file)

    @property
    def path(self) -> str:
        """Path of the tools file."""
        return self._store.path

    @property
    def text(self) -> str:
        """Text that would be saved, without a draft."""
        return self._base.file.text

    @property
    def saved_text(self) -> str:
        """Text that was last read or saved."""
        return self._store.base

    @property
    def changed(self) -> bool:
        """True if there is something to save."""
        return self.text != self.saved_text

    def settings(self) -> ToolsFile:
        """Read the enabled tools of the file as a bake does, without a draft."""
        return self._settings_of(self._base.file)

    @property
    def presets(self) -> dict[str, Preset]:
        """All materials by name: the built-in ones, and those of the file."""
        return {**presets(), **self.settings().presets}

    # Edits.

    def add_presets(self, path: str) -> None:
        """Let the file name a file of presets, unless it does so already."""
        with self._guarded():
            written = os.path.relpath(path, os.path.dirname(self.path) or os.curdir).replace(os.sep, "/")
            named = self._base.file.header.get("presets", [])
            if isinstance(named, dict):
                message = f"the file has presets of its own; write them into {path} first"
                raise ConfigError(message, where=self.settings().place("presets"))
            files = [named] if isinstance(named, str) else list(named)
            if written not in map(os.path.normpath, files):
                value = [*files, written] if files else written
                self._become(self._base.file.with_key("presets", value), f"take the presets of {path}")

    def read_presets(self) -> None:
        """Read the files of presets again, which others have changed.

        Raises:
            ConfigError: One is not valid; the presets stay as they were.
        """
        with self._guarded():
            step = self._base
            self._read = step.file.text, self._store.read(step.file)
            self._steps[self._at] = replace(step)  # a new one, so that what follows from it is found anew
            self._draft = None
            self.notes.append(f"{', '.join(self.settings().preset_files)}: has changed on disk, and was read again")

    def set_value(self, tool: str, steps: Steps, value: Any, *, draft: bool = False, slides: bool = False) -> None:
        """Set a key of a tool, or a part of it, to a value as the file has it; lengths are numbers, or text like `80%`.

        The steps to the value are such as `("bumps",)`, `("clips", "walk")` or `("lag", "damping")`. If the value
        `slides`, the edit is one step with that of the same slider just before, as a hand may rest in a drag.
        """
        with self._guarded():
            if not draft:
                self._draft = None
            file, number = self._entry(tool)
            own, inherited = file.tools[number], file.defaults
            key = str(steps[0])
            if len(steps) > 1 and key not in own and key in inherited:
                # A tool's own mapping replaces the inherited one, so it starts as a copy.
                steps, value = (key,), with_part(inherited[key], steps[1:], value)
            if draft:
                self._draft = self._drafted(file, number, with_part(own, steps, value))
            else:
                drag = (tool, *steps) if slides else None
                self._become(file.with_value(number, steps, value), f"set {key} of {tool}", drag)

    def set_material(self, tool: str, material: str) -> list[str]:
        """Set the material of a tool in one step, and remove the tool's own keys that the material gives.

        Returns:
            The keys that were removed.
        """
        with self._guarded():
            file, number = self._entry(tool)
            file = file.with_value(number, ("material",), material)
            removed = [key for key in file.tools[number] if key in self._given_by(material)]
            for key in removed:
                file = file.without(number, (key,))
            self._become(file, f"make {tool} {material}")
            return removed

    def unset(self, tool: str, steps: Steps) -> None:
        """Remove a key from a tool, so that its default holds again."""
        with self._guarded():
            file, number = self._entry(tool)
            self._become(file.without(number, steps), f"reset {steps[0]} of {tool}")

    def move_point(self, tool: str, number: int, place: Sequence[float], *, draft: bool = False) -> None:
        """Move a point of a tool to a (3,) place at rest, world space: 0 is the origin, the last is the target."""
        with self._guarded():
            file, index = self._entry(tool)
            own = file.tools[index]
            steps = ("path", number) if "path" in own else (("origin", "target")[number],)
            self.set_value(tool, steps, self._written_place(place, length_of(own)), draft=draft)

    def copy(self, tool: str) -> str:
        """Copy a tool, and return the name of the copy."""
        with self._guarded():
            file, number = self._entry(tool)
            name = self._new_name(tool)
            self._become(file.with_copy(number, name), f"copy {tool}")
            return name

    def rename(self, tool: str, name: str) -> None:
        """Rename a tool."""
        with self._guarded():
            file, number = self._entry(tool)
            self._become(file.with_value(number, ("name",), name), f"rename {tool} to {name}")

    def delete(self, tool: str) -> None:
        """Delete a tool."""
        with self._guarded():
            file, number = self._entry(tool)
            self._become(without_empty_list(file.without_tool(number)), f"delete {tool}")

    def enable(self, tool: str, *, enabled: bool) -> None:
        """Enable or disable a tool in the file."""
        self.set_value(tool, ("enabled",), enabled)

    def mirror(self, tool: str, axis: str | None) -> str:
        """Give a tool a partner on the other side of x, y or z = 0, or remove the partner.

        Returns:
            The name of the tool, which gets a side at its end if it has a partner and names no side.
        """
        with self._guarded():
            file, number = self._entry(tool)
            inherited = file.defaults.get("mirror")
            if axis is None and inherited in (None, "none"):
                self.unset(tool, ("mirror",))
                return tool
            name = tool
            if axis is not None and exchange_sides(tool) == tool:
                name = f"{tool}.{_side_of(file.tools[number], axis)}"
                file = file.with_value(number, ("name",), name)
            self._become(file.with_value(number, ("mirror",), axis or "none"), f"mirror {name}")
            return name

    def solo(self, tools: Sequence[str]) -> None:
        """Show some tools alone, or all if none are named; the file does not change."""
        with self._guarded():
            self._push(replace(self._base, solo=frozenset(tools), done="solo"))

    def undo(self) -> str | None:
        """Go one step back, and say in words which edit that takes back; None if there is none."""
        return self._go(-1)

    def redo(self) -> str | None:
        """Go one step forward, and say in words which edit that makes again; None if there is none."""
        return self._go(1)

    # The file on disk.

    def save(self, *, overwrite: bool = False) -> None:
        """Write the file, merged tool by tool with changes by others unless `overwrite` is set.

        Raises:
            ConfigError: A tool was changed here and by others, a line each; nothing is written.
            BakeError: The file cannot be written.
        """
        with self._lock:
            if not overwrite:
                self.merge()
            self._store.write(self.text)

    def merge(self) -> bool:
        """Merge changes by others into each step, so that undoing takes back only edits made here.

        Returns:
            False if others have changed nothing.

        Raises:
            ConfigError: A tool was changed here and by others, a line each; no step has changed.
        """
        with self._lock:
            now = self._store.on_disk()
            if now == self._store.base:
                return False
            if self._store.is_gone:  # which deletes no tool: all of them are unsaved now
                self._store.base = now
                self._keep()
                self.notes.append(f"{self.path}: has been removed; saving writes it again")
                return True
            current = self._merged(self._base, now)
            before = self._merged_steps(self._steps[: self._at][::-1], now)[::-1]
            after = self._merged_steps(self._steps[self._at + 1 :], now)
            self._steps, self._at, self._draft = [*before, current, *after], len(before), None
            self._store.base = now
            self._keep()
            self.notes.append(f"{self.path}: has changed on disk; both are here now")
            return True

    def recover(self) -> None:
        """Recover the unsaved edits of an earlier session as a step."""
        try:
            unsaved = self._store.unsaved()
        except ConfigError as error:
            self.notes += error.lines
            return
        if unsaved is None:
            return
        base, text = unsaved
        try:
            self._become(self._store.merged(text, self._store.base, since=base), "recover unsaved edits")
            self.notes.append(f"{self.path}: unsaved edits of an earlier session are here again; undo takes them away")
        except WrinkleError as error:
            assert self._store.side is not None
            try:
                aside = self._store.side.set_aside()
            except ConfigError as another:
                self.notes += another.lines
            else:
                self.notes.append(f"{self.path}: unsaved edits of an earlier session do not fit, and are in {aside}")
            self.notes += error.lines

    # Internals.

    @property
    def _base(self) -> Step:
        """The current step, without a draft."""
        return self._steps[self._at]

    def _guarded(self) -> AbstractContextManager[object]:
        """Let one thread in at a time."""
        return self._lock

    def _merged(self, step: Step, now: str) -> Step:
        return replace(step, file=self._store.merged(step.file.text, now))

    def _merged_steps(self, steps: Sequence[Step], now: str) -> list[Step]:
        """Merge steps in the order away from the current one, up to one that cannot be merged."""
        merged: list[Step] = []
        for step in steps[:_MAX_MERGED]:
            try:
                merged.append(self._merged(step, now))
            except ConfigError:
                break
        return merged

    def _settings_of(self, file: ToolsText) -> ToolsFile:
        """Read the enabled tools of a file as a bake does, or raise ConfigError."""
        if self._read is None or self._read[0] != file.text:
            self._read = file.text, self._store.read(file)
        return self._read[1]

    def _given_by(self, material: str) -> set[str]:
        """The keys that a material gives a tool in place of its own; the width is fitted to the place, and stays."""
        return ({*self.presets[material].keys, "bumps", "max_height"} - {"width"}) & {*TOOL_KEYS}

    def _drafted(self, file: ToolsText, number: int, values: Mapping[str, Any]) -> Draft:
        """Give a tool other values. Its partner stays; a file of many tools takes too long to read for each frame."""
        name = str(file.tools[number].get("name"))
        header = {key: each for key, each in file.header.items() if key in ("version", "up", "presets", "defaults")}
        try:
            read = read_values({**header, file.key: [values]}, name=self.path, known=self.presets).effects
        except ConfigError as error:  # alone, the tool is the first of line 1
            alone, place = f"{self.path}:1: {file.key}[0]", f"{self.path}: {name}"
            error.lines = tuple(line.replace(alone, place, 1) for line in error.lines)
            raise
        drafted = {tool.name: tool for tool in read}
        settings = self._settings_of(file)
        effects = [
            replace(drafted.get(name, tool), where=tool.where) if tool.name == name else tool
            for tool in settings.effects
        ]
        return Draft(file.key, number, values, replace(settings, effects=tuple(effects)))

    def _become(self, file: ToolsText, done: str, drag: Steps | None = None) -> None:
        """Add a step with another text, if it is valid; or let the current step become it, if that is the same drag."""
        file = file.of_list("tools")
        self._settings_of(file)
        now = time.monotonic()
        if drag is not None and self._drag is not None:
            before, step, moment = self._drag
            if before == drag and step is self._base and now - moment < _SLIDE_SECONDS:
                del self._steps[self._at :]
                self._at -= 1
        self._push(Step(file, self._base.solo, done))
        self._drag = None if drag is None else (drag, self._base, now)

    def _push(self, step: Step) -> None:
        self._draft = None
        if (step.file.text, step.solo) != (self._base.file.text, self._base.solo):
            self._steps = [*self._steps[: self._at + 1], step][-_MAX_STEPS:]
            self._at = len(self._steps) - 1
        self._keep()

    def _go(self, by: int) -> str | None:
        with self._lock:
            before, self._draft = self._at, None
            if not 0 <= before + by < len(self._steps):
                return None
            self._at += by
            self._keep()
            return self._steps[max(before, self._at)].done

    def _keep(self) -> None:
        """Write unsaved text to the side file; note once if that fails."""
        try:
            self._store.keep(self.text)
        except WrinkleError as error:
            if error.lines[0] not in self.notes:
                self.notes.append(error.lines[0])

    def _entry(self, tool: str) -> tuple[ToolsText, int]:
        """The file with the list that has a tool, and the tool's number there."""
        names: list[str] = []
        for key in KINDS:
            file = self._base.file.of_list(key)
            here = names_of(file)
            if tool in here:
                return file, here.index(tool)
            names += here
        raise ConfigError(f"no tool is named {tool!r}{nearest(tool, names)}", where=self.path)

    def _new_name(self, stem: str) -> str:
        """Number a stem so that no tool has the name; a side of the stem stays at its end."""
        return numbered(stem, self._taken_names())

    def _taken_names(self) -> set[str]:
        """The identifiers of all tools, with mirrored and disabled ones."""
        file = self._base.file
        own = [name for key in KINDS for name in names_of(file.of_list(key))]
        every = (*own, *(each.name for each in self.settings().effects))
        return {identifier(name) for name in every}

    def _written_place(self, place: Sequence[float], span: float) -> list[float]:
        """Convert a Y-up place to the file's axes, rounded to a thousandth of the tool's span or less."""
        digits = max(_PLACE_DIGITS - int(np.floor(np.log10(span))), 0) if span > 0 else 2 * _PLACE_DIGITS
        turned = in_axes([float(x) for x in place], self._base.file.up)
        return [round(each, digits) + 0.0 for each in turned]


def length_of(tool: Mapping[str, Any]) -> float:
    """The length of a tool from point to point, scene units, without points that are markers."""
    return float(np.linalg.norm(np.diff(_places(tool), axis=0), axis=1).sum())


def _places(tool: Mapping[str, Any]) -> Floats:
    """(points, 3) of a tool in the axes of its file, without points that are markers or hang on joints."""
    return np.array([each for each in _points(tool) if isinstance(each, list)], float).reshape(-1, 3)


def _points(tool: Mapping[str, Any]) -> list[Any]:
    """The points of a tool as the file has them."""
    return tool["path"] if "path" in tool else [tool[key] for key in POINT_KEYS if key in tool]


def _side_of(tool: Mapping[str, Any], axis: str) -> str:
    """L or R, by the places of a tool on x, y or z, or else by the names of the nodes that it hangs on."""
    places = _places(tool)
    if len(places):
        return "L" if float(places[:, "xyz".index(axis)].sum()) > 0 else "R"
    nodes = [str(name) for each in _points(tool) if isinstance(each, dict) for name in each.values()]
    nodes += [str(tool.get(key, "")) for key in ("joint", "node", "joints")]
    sides = [split_side(name)[1] for name in nodes]
    return next((side for side in sides if side), "R")
