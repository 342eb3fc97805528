"""A tools file being edited: every step an immutable record of its text, to be undone, done again, saved and recovered.

Undoing gives the same bytes, as the text is the state. Methods may be called from several threads.
"""

import os
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wrinklecli.editor.store import Store, names_of, read_file
from wrinklecli.errors import ConfigError, WrinkleError, nearest
from wrinklecli.numeric.arrays import Floats
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.read import read_values
from wrinklecli.tools.records import ToolsFile, identifier, in_axes
from wrinklecli.tools.yaml_edit import Steps, ToolsText, with_part

# Steps that can be undone, and that can be after the file has changed on disk, to either side: each is merged with it.
_MOST_STEPS, _MOST_MERGED = 300, 100


@dataclass(frozen=True, slots=True)
class Step:
    """A state of the edited file.

    Attributes:
        file: Its text.
        solo: Names of the tools that are shown alone; all where there are none.
        done: What made it, for a tip at undo.
    """

    file: ToolsText
    solo: frozenset[str] = frozenset()
    done: str = ""


@dataclass(frozen=True, slots=True)
class Draft:
    """A tool while something of it is dragged.

    Attributes:
        number: Of the tool in the file.
        values: What it says itself then.
        settings: The tools file with it.
    """

    number: int
    values: Mapping[str, Any]
    settings: ToolsFile


class Edits:
    """A tools file and its steps.

    Every edit raises ConfigError where the file would not be valid; nothing has changed then. `draft=True` is for what
    is dragged: it replaces the last draft and is no step; the first edit without it is. `drop_draft` gives a draft up.

    Args:
        store: The file on disk.

    Attributes:
        notes: What happened to the files, a line each, newest last.

    Raises:
        ConfigError: The file is not valid.
    """

    def __init__(self, store: Store) -> None:
        self.notes: list[str] = []
        self._store = store
        self._lock = threading.RLock()
        self._steps: list[Step] = [Step(store.text(store.base))]
        self._at = 0
        self._draft: Draft | None = None
        self._read: tuple[str, ToolsFile] | None = None
        self._settings_of(self._steps[0].file)

    @property
    def path(self) -> str:
        """Of the tools file."""
        return self._store.path

    @property
    def text(self) -> str:
        """Of the tools file as it would be saved, without a draft."""
        return self._base.file.text

    @property
    def solo_tools(self) -> frozenset[str]:
        """Names of those that are shown alone; all where there are none."""
        return self._base.solo

    @property
    def changed(self) -> bool:
        """Whether there is something to save."""
        return self.text != self.saved_text

    @property
    def saved_text(self) -> str:
        """Of the tools file as it was last read or saved."""
        return self._store.base

    @property
    def undoable(self) -> str | None:
        """What `undo` would take back; None for nothing."""
        return self._base.done if self._at else None

    @property
    def redoable(self) -> str | None:
        """What `redo` would do again; None for nothing."""
        return self._steps[self._at + 1].done if self._at + 1 < len(self._steps) else None

    def set_value(self, tool: str, steps: Steps, value: Any, *, draft: bool = False) -> None:
        """Set a key of a tool, or what is within it: `("bumps",)`, `("clips", "walk")`, `("lag", "damping")`.

        Args:
            tool: Its name.
            steps: To the value.
            value: As the schema has it; lengths as numbers or text such as `80%`.
            draft: See the class.
        """
        with self._guarded():
            file, number = self._base.file, self._number(tool)
            own, inherited = file.tools[number], file.defaults
            key = str(steps[0])
            if len(steps) > 1 and key not in own and key in inherited:
                # A tool's own mapping stands in place of what it inherits.
                steps, value = (key,), with_part(inherited[key], steps[1:], value)
            if draft:
                self._draft = self._drafted(number, with_part(own, steps, value))
            else:
                self._become(file.with_value(number, steps, value), f"{tool}: {key}")

    def unset(self, tool: str, steps: Steps) -> None:
        """Take a key away from a tool: what the file's defaults or the schema say holds then."""
        with self._guarded():
            self._become(self._base.file.without(self._number(tool), steps), f"{tool}: {steps[0]}")

    def move_point(self, tool: str, number: int, place: Sequence[float], *, draft: bool = False) -> None:
        """Move one of a tool's points to a place at rest, world space: 0 is the origin, the last is the target."""
        with self._guarded():
            own = self._base.file.tools[self._number(tool)]
            steps = ("path", number) if "path" in own else (("origin", "target")[number],)
            self.set_value(tool, steps, self._written_place(place, length_of(own)), draft=draft)

    def copy(self, tool: str) -> str:
        """Copy a tool; the copy's name."""
        with self._guarded():
            name = self._new_name(tool)
            self._become(self._base.file.with_copy(self._number(tool), name), f"{name} is a copy")
            return name

    def rename(self, tool: str, name: str) -> None:
        """Give a tool another name."""
        with self._guarded():
            self._become(self._base.file.with_value(self._number(tool), ("name",), name), f"{tool} is {name}")

    def delete(self, tool: str) -> None:
        """Take a tool away."""
        with self._guarded():
            self._become(self._base.file.without_tool(self._number(tool)), f"{tool} is gone")

    def enable(self, tool: str, *, enabled: bool) -> None:
        """Switch a tool on or off in the file."""
        self.set_value(tool, ("enabled",), enabled)

    def mirror(self, tool: str, axis: str | None) -> str:
        """Give a tool a partner on the other side of x, y or z = 0, or none.

        Returns:
            Its name: that of a tool with a partner ends with its side, where it names none.
        """
        with self._guarded():
            file, number = self._base.file, self._number(tool)
            inherited = file.defaults.get("mirror")
            if axis is None and inherited in (None, "none"):
                self.unset(tool, ("mirror",))
                return tool
            name = tool
            if axis is not None and exchange_sides(tool) == tool:
                side = float(_places(file.tools[number])[:, "xyz".index(axis)].sum())
                name = f"{tool}.{'L' if side > 0 else 'R'}"
                file = file.with_value(number, ("name",), name)
            self._become(file.with_value(number, ("mirror",), axis or "none"), f"{name}: mirror")
            return name

    def solo(self, tools: Sequence[str]) -> None:
        """Show some tools alone; all again where there are none. The file stays as it is."""
        with self._guarded():
            self._push(replace(self._base, solo=frozenset(tools), done="solo"))

    def drop_draft(self) -> None:
        """Give a draft up."""
        with self._lock:
            self._draft = None

    def undo(self) -> bool:
        """Go a step back; whether there was one."""
        return self._go(-1)

    def redo(self) -> bool:
        """Go a step forward again; whether there was one."""
        return self._go(1)

    # The files.

    def save(self, *, overwrite: bool = False) -> None:
        """Write the file, merged tool by tool with what others have written meanwhile.

        Args:
            overwrite: Whatever they have written.

        Raises:
            ConfigError: Tools were changed here and there, a line each; nothing is written.
            BakeError: It cannot be written.
        """
        with self._lock:
            if not overwrite:
                self.merge()
            self._store.write(self.text)

    def merge(self) -> bool:
        """Take up what others have written into the file; whether there was anything.

        Each step gets it, so that undoing takes back only what was done here.

        Raises:
            ConfigError: Tools were changed here and there, a line each; nothing has changed then.
        """
        with self._lock:
            now = self._store.on_disk()
            if now == self._store.base:
                return False
            steps = [replace(self._base, file=self._store.merged(self.text, now))]
            at = 0
            for way in (-1, 1):
                others = self._steps[self._at + 1 :] if way > 0 else self._steps[: self._at][::-1]
                for step in others[:_MOST_MERGED]:
                    try:
                        found = replace(step, file=self._store.merged(step.file.text, now))
                    except ConfigError:
                        break  # steps beyond it would be reached through it alone
                    steps = [*steps, found] if way > 0 else [found, *steps]
                    at += way < 0
            self._steps, self._at, self._draft, self._store.base = steps, at, None, now
            self._keep()
            self.notes.append(f"{self.path}: has changed on disk; both are here now")
            return True

    def recover(self) -> None:
        """Take up what an earlier session has not saved."""
        found = self._store.unsaved()
        if found is None:
            return
        was, text = found
        try:
            self._become(self._store.merged(text, self._store.base, since=was), "unsaved edits of an earlier session")
            self.notes.append(f"{self.path}: unsaved edits of an earlier session are here again; undo takes them away")
        except WrinkleError as error:
            kept = f"{self._store.side}.1"
            os.replace(self._store.side, kept)
            self.notes += [
                f"{self.path}: unsaved edits of an earlier session do not fit, and are in {kept}",
                *error.lines,
            ]

    # Within.

    @property
    def _base(self) -> Step:
        """What an edit changes: the present step, whatever is drafted."""
        return self._steps[self._at]

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """One thread at a time."""
        with self._lock:
            yield

    def settings(self) -> ToolsFile:
        """The tools file as a bake reads it, with its enabled tools and without a draft."""
        return self._settings_of(self._base.file)

    def _settings_of(self, file: ToolsText) -> ToolsFile:
        """A tools file as a bake reads it, with its enabled tools.

        Raises:
            ConfigError: It is not valid.
        """
        if self._read is None or self._read[0] != file.text:
            self._read = file.text, read_file(file)
        return self._read[1]

    def _drafted(self, number: int, values: Mapping[str, Any]) -> Draft:
        """A tool with other values, read by itself, as a file of many takes longer than a frame. Its partner stays.

        Raises:
            ConfigError: They are not valid.
        """
        file = self._base.file
        name = str(file.tools[number].get("name"))
        beside = {key: each for key, each in file.beside.items() if key in ("version", "up", "defaults")}
        drafted = {tool.name: tool for tool in read_values({**beside, "tools": [values]}, name=self.path).tools}
        tools = [drafted.get(name, tool) if tool.name == name else tool for tool in self._settings_of(file).tools]
        return Draft(number, values, replace(self._settings_of(file), tools=tuple(tools)))

    def _become(self, file: ToolsText, done: str) -> None:
        """Take a text for the present state, if it is valid."""
        self._settings_of(file)
        self._push(Step(file, self._base.solo, done))

    def _push(self, step: Step) -> None:
        self._draft = None
        if (step.file.text, step.solo) == (self._base.file.text, self._base.solo):
            return
        self._steps = [*self._steps[: self._at + 1], step][-_MOST_STEPS:]
        self._at = len(self._steps) - 1
        self._keep()

    def _go(self, by: int) -> bool:
        with self._lock:
            self._draft = None
            able = 0 <= self._at + by < len(self._steps)
            if able:
                self._at += by
                self._keep()
            return able

    def _keep(self) -> None:
        """Put what is not saved where a later session finds it."""
        try:
            self._store.keep(self.text)
        except WrinkleError as error:
            if error.lines[0] not in self.notes:
                self.notes.append(error.lines[0])

    def _number(self, tool: str) -> int:
        names = names_of(self._base.file)
        if tool not in names:
            raise ConfigError(f"no tool is named {tool!r}{nearest(tool, names)}", where=self.path)
        return names.index(tool)

    def _new_name(self, stem: str) -> str:
        """A name of a stem that no tool has, with the side at its end where the stem has one."""
        taken = self._taken_names()
        body, side = (stem[:-2], stem[-2:]) if stem[-2:] in (".L", ".R") else (stem, "")
        number = 1
        while identifier(name := f"{body}_{number}{side}") in taken:
            number += 1
        return name

    def _taken_names(self) -> set[str]:
        """The identifiers of all tools, mirrored and disabled ones too."""
        every = (*names_of(self._base.file), *(tool.name for tool in self.settings().tools))
        return {identifier(name) for name in every}

    def _written_place(self, place: Sequence[float], span: float) -> list[float]:
        """A Y-up place in the file's axes, with as many digits as matter: a thousandth of the segment, or less."""
        digits = max(3 - int(np.floor(np.log10(span))), 0) if span > 0 else 6
        turned = in_axes([float(x) for x in place], self._base.file.up)
        return [round(each, digits) + 0.0 for each in turned]


def length_of(tool: Mapping[str, Any]) -> float:
    """How far it is from point to point of a tool, scene units; markers left out."""
    return float(np.linalg.norm(np.diff(_places(tool), axis=0), axis=1).sum())


def _places(tool: Mapping[str, Any]) -> Floats:
    """(points, 3) a tool's points, in the axes of its file, without those that are markers."""
    points = tool["path"] if "path" in tool else [tool["origin"], tool["target"]]
    return np.array([each for each in points if isinstance(each, list)], float).reshape(-1, 3)
