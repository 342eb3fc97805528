"""A tools file's text edited in place: what an edit does not touch keeps every byte, comments and anchors too.

`yaml_parts` says between which characters each value stands, and an edit puts others there. Libraries that read a
file and write it anew keep comments, but neither the spaces of a flow list, nor quotes, nor where lines break; and the
most usual one reads YAML 1.2, which has other words for true than this program's files.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

from wrinklecli.errors import ConfigError
from wrinklecli.tools.yaml_parts import Part, dashes, read_parts
from wrinklecli.tools.yaml_tree import Node, read_tree

Steps: TypeAlias = Sequence[str | int]
"""Keys and indices that lead to a value within a tool, such as `("clips", "walk")`."""

# Text that YAML reads as the same text without quotes: names, and percentages.
_PLAIN = re.compile(r"[A-Za-z_](?:[A-Za-z0-9_. -]*[A-Za-z0-9_.-])?|[0-9]+(?:\.[0-9]+)?%")
_WORDS = {"true", "yes", "on", "false", "no", "off", "null"}
_ANCHOR = re.compile(r"&[^\s,\[\]{}]+[ \t]*")


@dataclass(frozen=True, slots=True)
class _Change:
    """Text in place of some characters."""

    start: int
    end: int
    text: str


def written(value: Any) -> str:
    """A value in one line of YAML, as the reader of tools files takes it back."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, str):
        plain = _PLAIN.fullmatch(value) and value.lower() not in _WORDS
        return value if plain else json.dumps(value, ensure_ascii=False)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{written(str(key))}: {written(each)}" for key, each in value.items()) + "}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(written, value)) + "]"
    return repr(value)


@dataclass(frozen=True)
class ToolsText:
    """The text of a tools file.

    Attributes:
        text: Of it; lines may end as they do on any system.
        name: What messages call the file.
    """

    text: str
    name: str = "<tools>"

    @cached_property
    def _root(self) -> Part:
        return read_parts(self.text, self.name)

    @cached_property
    def _dashes(self) -> list[int]:
        return dashes(self.text)

    @cached_property
    def _tools(self) -> Part | None:
        """What stands behind `tools`; None where the key is not there."""
        for key, item in zip(self._root.keys, self._root.items, strict=True):
            if self.text[key.start : key.end].strip("\"'") == "tools":
                return item
        return None

    @cached_property
    def tools(self) -> tuple[Mapping[str, Any], ...]:
        """What each tool of the file says itself, by key; empty where it is no mapping."""
        return tuple(node.value if isinstance(node.value, dict) else {} for node in self._nodes)

    @cached_property
    def is_empty(self) -> bool:
        """Whether it is a mapping that names no tool, which the reader refuses, but an editor begins with."""
        root, _ = read_tree(self.text)
        return root is not None and isinstance(root.value, dict) and root.value.get("tools") in (None, [])

    @cached_property
    def _nodes(self) -> tuple[Node, ...]:
        root, _ = read_tree(self.text)
        tools = root.children.get("tools") if root is not None else None
        return tuple(tools.children.values()) if tools is not None and isinstance(tools.value, list) else ()

    @cached_property
    def beside(self) -> Mapping[str, Any]:
        """What the file says beside its tools, by key."""
        root, _ = read_tree(self.text)
        value = root.value if root is not None and isinstance(root.value, dict) else {}
        return {key: each for key, each in value.items() if key != "tools"}

    @property
    def defaults(self) -> Mapping[str, Any]:
        """What holds for tools that say nothing else, by key."""
        return self.beside.get("defaults") or {}

    @property
    def up(self) -> str:
        """The axis that points up where the file says places."""
        return str(self.beside.get("up", "y"))

    def item(self, number: int) -> str:
        """The text of one of the tools, from behind its dash."""
        part = self._item(number)
        return self.text[part.start : part.end]

    def with_value(self, number: int, steps: Steps, value: Any) -> "ToolsText":
        """The file with another value in one of its tools; the key is added where the tool itself has none.

        Args:
            number: Of the tool.
            steps: To the value.
            value: Plain Python: text, numbers, lists, mappings.

        Raises:
            ConfigError: The tool is an alias, or others repeat a block of what would go.
        """
        part = self._item(number)
        values: Any = self.tools[number]
        for depth, step in enumerate(steps):
            below, last = self._below(part, step), depth + 1 == len(steps)
            values = values[step] if isinstance(step, int) else values.get(step)
            if below is None or not (last or self._is_own(below)):
                # What it repeats or is merged with is written out, to be changed here alone.
                found = value if last else with_part(values, steps[depth + 1 :], value)
                return self._inserted(part, str(step), found) if below is None else self._replaced(below, found)
            part = below
        return self._replaced(part, value)

    def _is_own(self, part: Part) -> bool:
        """Whether a part of a value can be changed without a change of what stands elsewhere."""
        return part.kind in ("map", "seq") and not self._uses(part)

    def without(self, number: int, steps: Steps) -> "ToolsText":
        """The file without a key of one of its tools; as it is where the tool itself has none.

        Raises:
            ConfigError: As for `with_value`.
        """
        part = self._item(number)
        for step in steps[:-1]:
            below = self._below(part, step)
            if below is None:
                return self
            part = below
        names = [self.text[key.start : key.end].strip("\"'") for key in part.keys]
        return self._with([self._removal(part, names.index(str(steps[-1])))]) if steps[-1] in names else self

    def with_tool(self, values: Mapping[str, Any]) -> "ToolsText":
        """The file with one more tool, at its end, a line for each of its keys.

        Raises:
            ConfigError: The file is no mapping.
        """
        return self.with_item([f"{written(key)}: {written(value)}" for key, value in values.items()])

    def with_copy(self, number: int, name: str) -> "ToolsText":
        """The file with a copy of one of its tools behind it, of another name and without its anchors.

        Raises:
            ConfigError: The tool is an alias.
        """
        part = self._item(number)
        changes = [
            _Change(each.start, each.start + len(found[0]), "")
            for each in part.within()
            if each.kind != "alias" and (found := _ANCHOR.match(self.text, each.start))
        ]
        body = _changed(self.text[part.start : part.end], changes, part.start)
        copied = self._with(self._insertion(_lines(body), behind=number))
        return copied.with_value(number + 1, ("name",), name)

    def with_item(self, lines: Sequence[str], *, instead_of: int | None = None) -> "ToolsText":
        """The file with one more tool at its end, or in place of another.

        Args:
            lines: Of its text, without a dash; those after the first are indented against it.
            instead_of: Number of the tool that goes.

        Raises:
            ConfigError: The file is no mapping, or others repeat what would go.
        """
        if instead_of is None:
            return self._with(self._insertion(lines, behind=None))
        part = self._item(instead_of)
        text = self._newline.join([lines[0], *(" " * self._column(part.start) + line for line in lines[1:])])
        if part.flow and len(lines) > 1:
            text = "{" + ", ".join(lines) + "}"
        return self._with([_Change(part.start, part.end, text), *self._moved_anchors(part.start, part.end)])

    def lines_of(self, number: int) -> list[str]:
        """The lines of one of the tools, as `with_item` takes them."""
        part = self._item(number)
        first, *others = _lines(self.item(number))
        column = self._column(part.start)
        return [first, *(line[column:] if not line[:column].strip() else line.lstrip() for line in others)]

    def without_tool(self, number: int) -> "ToolsText":
        """The file without one of its tools and the comments right above it.

        Raises:
            ConfigError: Others repeat a block of it.
        """
        tools, part = self._tools, self._item(number)
        assert tools is not None
        if len(tools.items) == 1 and not tools.flow:
            start, end = self._lead(part), min(self._line_end(part.end) + len(self._newline), len(self.text))
            changes = [_Change(self._behind_colon, self._behind_colon, " []"), _Change(start, end, "")]
            return self._with([*changes, *self._moved_anchors(start, end)])
        if tools.flow:
            start, end = tools.items[number - 1].end if number else part.start, part.end
            if not number and len(tools.items) > 1:
                end = tools.items[1].start
        else:
            start = self._lead(part)
            last = number == len(tools.items) - 1
            end = self._line_end(part.end) + len(self._newline) if last else self._lead(tools.items[number + 1])
        return self._with([_Change(start, min(end, len(self.text)), ""), *self._moved_anchors(start, end)])

    @property
    def _behind_colon(self) -> int:
        """The place behind the colon of `tools`."""
        keys = (key for key, item in zip(self._root.keys, self._root.items, strict=True) if item is self._tools)
        return self.text.index(":", next(keys).end) + 1

    @property
    def _newline(self) -> str:
        return "\r\n" if "\r\n" in self.text else "\n"

    def _item(self, number: int) -> Part:
        tools = self._tools
        assert tools is not None
        part = tools.items[number]
        if part.kind != "map":
            line = self.text.count("\n", 0, part.start) + 1
            raise ConfigError("is no mapping of its own; write it out to edit it", where=f"{self.name}:{line}")
        return part

    def _below(self, part: Part, step: str | int) -> Part | None:
        """The value of a key, or the item of an index, that a part has itself."""
        if isinstance(step, int):
            return part.items[step] if part.kind == "seq" and step < len(part.items) else None
        for key, item in zip(part.keys, part.items, strict=False):
            if self.text[key.start : key.end].strip("\"'") == step:
                return item
        return None

    def _replaced(self, part: Part, value: Any) -> "ToolsText":
        """Another value in place of one; an anchor stays, unless others repeat it: the first of these takes it."""
        text, start = written(value), part.start
        if part.anchor is not None and part.kind != "alias" and not self._uses(part):
            found = _ANCHOR.match(self.text[part.start :])
            start += found.end() if found else 0
        if self.text[start - 1 : start] == ":":
            text = " " + text  # where nothing stood
        return self._with([_Change(start, part.end, text), *self._moved_anchors(start, part.end)])

    def _inserted(self, part: Part, key: str, value: Any) -> "ToolsText":
        """A key behind the last of a mapping."""
        text = f"{written(key)}: {written(value)}"
        if part.flow or not part.items:
            at = part.items[-1].end if part.items else self.text.index("{", part.start) + 1
            return self._with([_Change(at, at, f", {text}" if part.items else text)])
        at = self._line_end(part.end)
        indent = " " * self._column(part.keys[0].start)
        return self._with([_Change(at, at, f"{self._newline}{indent}{text}")])

    def _removal(self, part: Part, number: int) -> _Change:
        """A key of a mapping taken away, with the comment on its line."""
        key, item = part.keys[number], part.items[number]
        last = number == len(part.keys) - 1
        if len(part.keys) == 1:
            start, end, text = part.start, part.end, "{}"
        elif part.flow and number:
            start, end, text = part.items[number - 1].end, item.end, ""
        elif number == 0:
            start, end, text = key.start, part.keys[1].start, ""
        else:
            start, text = self._line_start(key.start), ""
            end = self._line_end(item.end) + len(self._newline)
            if last and end > len(self.text):
                start, end = start - len(self._newline), len(self.text)
        if self._moved_anchors(start, end):
            line = self.text.count("\n", 0, start) + 1
            raise ConfigError("others repeat this value by an alias; change it instead", where=f"{self.name}:{line}")
        return _Change(start, end, text)

    def _insertion(self, lines: Sequence[str], *, behind: int | None) -> list[_Change]:
        """One more tool, behind another, whose lines have their indentation already, or at the end."""
        tools, newline = self._tools, self._newline
        new = newline + "  - " + f"{newline}    ".join(lines)
        if tools is None:
            at = self._line_end(self._root.end)
            return [_Change(at, at, f"{newline}tools:{new}")]
        if not tools.items:
            at = self._line_end(tools.end)
            return [_Change(self._behind_colon, tools.end, ""), _Change(at, at, new)]
        part = tools.items[-1 if behind is None else behind]
        if tools.flow:
            body = lines[0] if lines[0].startswith("{") else "{" + ", ".join(lines) + "}"
            return [_Change(part.end, part.end, f", {body}")]
        dash = self._dash(part)
        column = self._column(dash)
        inner = self._column(part.start) if self._line_start(part.start) <= dash else column + 2
        first = " " * column + "-" + " " * (inner - column - 1) + lines[0]
        indent = " " * inner if behind is None else ""
        at = self._line_end(part.end)
        spaced = len(tools.items) == 1 or self.text[: self._lead(tools.items[-1])].endswith(newline * 2)
        text = newline.join([first, *(indent + line for line in lines[1:])])
        return [_Change(at, at, newline * (1 + spaced) + text)]

    def _uses(self, part: Part) -> list[Part]:
        """The aliases that repeat an anchored value."""
        found: list[Part] = []
        for each in self._root.within() if part.anchor is not None else ():
            if each.start > part.start and each.anchor == part.anchor:
                if each.kind != "alias":
                    break
                found.append(each)
        return found

    def _moved_anchors(self, start: int, end: int) -> list[_Change]:
        """What goes away between two characters, put where it is repeated first.

        Raises:
            ConfigError: It is more than a line.
        """
        changes: list[_Change] = []
        reached = start
        for part in self._root.within():
            if part.anchor is None or part.kind == "alias" or part.start < reached or part.end > end:
                continue
            uses = [each for each in self._uses(part) if not start <= each.start < end]
            if not uses:
                continue
            text = self.text[part.start : part.end]
            if "\n" in text or (part.kind in ("map", "seq") and not part.flow):
                line = self.text.count("\n", 0, part.start) + 1
                message = f"holds the anchor &{part.anchor}, which others repeat; write these out first"
                raise ConfigError(message, where=f"{self.name}:{line}")
            changes.append(_Change(uses[0].start, uses[0].end, text))
            reached = part.end
        return changes

    def _with(self, changes: Sequence[_Change]) -> "ToolsText":
        return ToolsText(_changed(self.text, changes), self.name)

    def _dash(self, part: Part) -> int:
        """The dash of an item of a block sequence."""
        return max(dash for dash in self._dashes if dash < part.start)

    def _lead(self, part: Part) -> int:
        """Where the line of an item begins, or the comments right above it."""
        start = self._line_start(self._dash(part))
        while start > 0:
            above = self._line_start(start - 1)
            if not self.text[above:start].lstrip().startswith("#"):
                break
            start = above
        return start

    def _column(self, at: int) -> int:
        return at - self._line_start(at)

    def _line_start(self, at: int) -> int:
        return self.text.rfind("\n", 0, at) + 1

    def _line_end(self, at: int) -> int:
        """The end of a line, before what breaks it."""
        if self.text[at - 1 : at] == "\n":
            at -= 1  # text in a block of its own ends with its line
        end = self.text.find("\n", at)
        end = len(self.text) if end < 0 else end
        return end - 1 if self.text[end - 1 : end] == "\r" else end


def _lines(text: str) -> list[str]:
    return re.split(r"\r?\n", text)


def with_part(values: Any, steps: Steps, value: Any) -> Any:
    """A copy of values with another one at some steps; mappings that are not there are made."""
    first, *others = steps
    if isinstance(first, int):
        items = values if isinstance(values, Sequence) else ()
        return [
            with_part(each, others, value) if others else value if k == first else each for k, each in enumerate(items)
        ]
    found = values if isinstance(values, Mapping) else {}
    return {**found, first: with_part(found.get(first), others, value) if others else value}


def _changed(text: str, changes: Sequence[_Change], offset: int = 0) -> str:
    """Text with some of its characters replaced, counted from an offset."""
    for change in sorted(changes, key=lambda each: each.start, reverse=True):
        text = text[: change.start - offset] + change.text + text[change.end - offset :]
    return text
