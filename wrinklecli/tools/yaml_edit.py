"""Edits of a tools file's text: each edit replaces a few characters, and every other byte stays as it was.

PyYAML's events say between which characters each value stands, so comments, spaces, quotes, anchors and line ends
outside an edit cannot change. `tests/benchmarks/README.md` says how ruamel.yaml did, which writes the file anew.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import yaml

from wrinklecli.errors import ConfigError
from wrinklecli.frozen import dataclass
from wrinklecli.tools.yaml_tree import read_tree

Steps: TypeAlias = Sequence[str | int]
"""Keys and indices that lead to a value within a tool, such as `("clips", "walk")`."""

# Text that replaces the characters from a start to an end.
_Change: TypeAlias = tuple[int, int, str]

# Text that YAML reads as the same text without quotes: names, and percentages.
_PLAIN = re.compile(r"[A-Za-z_](?:[A-Za-z0-9_. -]*[A-Za-z0-9_.-])?|[0-9]+(?:\.[0-9]+)?%")
_WORDS = {"true", "yes", "on", "false", "no", "off", "null"}
_ANCHOR = re.compile(r"&[^\s,\[\]{}]+[ \t]*")
_BRACKET = re.compile(r"(&\S+\s+)?\{")
_DASH = re.compile(r"^ *(-)", re.MULTILINE)


def written(value: Any) -> str:
    """A value in one line of YAML, which the reader of tools files reads as the same value."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if value is None:
        return "null"
    if isinstance(value, str):
        plain = _PLAIN.fullmatch(value) and value.lower() not in _WORDS
        quoted = json.dumps(value, ensure_ascii=False)
        return value if plain else "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in quoted)
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{written(str(key))}: {written(each)}" for key, each in value.items()) + "}"
    if isinstance(value, Sequence):
        return "[" + ", ".join(map(written, value)) + "]"
    # In YAML 1.1 a number with an exponent and no point is text.
    return np.format_float_positional(value, trim="0") if isinstance(value, float) else repr(value)


def written_lines(values: Mapping[str, Any]) -> list[str]:
    """A line of YAML for each key of a mapping, such as a tool."""
    return [f"{written(key)}: {written(value)}" for key, value in values.items()]


def with_part(values: Any, steps: Steps, value: Any) -> Any:
    """A copy of values with another value at some steps; missing mappings are made."""
    if not steps:
        return value
    first, *others = steps
    if isinstance(first, int):
        return [with_part(each, others, value) if k == first else each for k, each in enumerate(values)]
    found = values if isinstance(values, Mapping) else {}
    return {**found, first: with_part(found.get(first), others, value)}


def _without_part(values: Any, steps: Steps) -> Any:
    """A copy of values without the value at some steps."""
    first, *others = steps
    if isinstance(values, list):
        return [_without_part(each, others) if k == first else each for k, each in enumerate(values)]
    if not isinstance(values, Mapping) or first not in values:
        return values
    kept = {key: each for key, each in values.items() if key != first}
    return {**values, first: _without_part(values[first], others)} if others else kept


def _part_of(values: Any, steps: Steps) -> Any:
    """The value at some steps; None if there is none."""
    for step in steps:
        if isinstance(values, Mapping):
            values = values.get(str(step))
        elif isinstance(values, list) and isinstance(step, int):
            values = values[step]
        else:
            return None
    return values


def _value_of(lines: Sequence[str]) -> Any:
    """The value that lines of YAML say."""
    root, _ = read_tree("\n".join(lines))
    return None if root is None else root.value


@dataclass(frozen=True, slots=True)
class _Part:
    """A value in the text.

    Attributes:
        start: Index of its first character; its anchor and tag belong to it.
        end: Index behind its last character; comments and empty lines that follow a block do not belong to it.
        kind: map, seq, scalar or alias.
        flow: True in brackets.
        anchor: Name of its anchor; of an alias, of the anchor that it repeats.
        text: What a scalar says.
        keys: Keys of a mapping, one for each of its items.
        items: Values of a mapping or a sequence.
    """

    start: int
    end: int
    kind: str
    flow: bool = False
    anchor: str | None = None
    text: str = ""
    keys: tuple["_Part", ...] = ()
    items: tuple["_Part", ...] = ()

    def within(self) -> Iterator["_Part"]:
        """This part and all below it, in the order of the text."""
        yield self
        for number, item in enumerate(self.items):
            if self.keys:
                yield from self.keys[number].within()
            yield from item.within()

    def number_of(self, step: str | int) -> int | None:
        """The index of the item at a key or an index; None if this part itself has none there."""
        found = range(len(self.items)) if isinstance(step, int) and self.kind == "seq" else [k.text for k in self.keys]
        return found.index(step) if step in found else None  # type: ignore[arg-type]


def _read_part(event: yaml.Event, events: Iterator[yaml.Event], text: str) -> _Part:
    """The value that begins with an event; takes its other events."""
    assert event.start_mark is not None
    assert event.end_mark is not None
    start, end = event.start_mark.index, event.end_mark.index
    if isinstance(event, yaml.AliasEvent):
        return _Part(start, end, "alias", anchor=event.anchor)
    if isinstance(event, yaml.ScalarEvent):
        if event.style in ("|", ">"):  # a block, which PyYAML ends where the next line begins
            end = start + len(text[start:end].rstrip())
        return _Part(start, end, "scalar", anchor=event.anchor, text=event.value)
    assert isinstance(event, yaml.SequenceStartEvent | yaml.MappingStartEvent)
    parts: list[_Part] = []
    for each in events:
        if isinstance(each, yaml.CollectionEndEvent):
            end = each.end_mark.index if each.end_mark is not None else end
            break
        parts.append(_read_part(each, events, text))
    if parts and not event.flow_style:
        end = parts[-1].end
    is_map = isinstance(event, yaml.MappingStartEvent)
    keys, items = (parts[::2], parts[1::2]) if is_map else ([], parts)
    kind = "map" if is_map else "seq"
    return _Part(start, end, kind, bool(event.flow_style), event.anchor, "", tuple(keys), tuple(items))


@dataclass(frozen=True)
class ToolsText:
    """The text of a tools file; each edit gives another one.

    An edit changes one tool alone, whatever others repeat of it by aliases or merge. What they share is written out in
    that tool, or the tool merges what it was. Edits raise ConfigError for a tool that is an alias, and where a block
    that others repeat would have to go. `number` is a tool's index, `steps` lead to a value within it.

    Attributes:
        text: The YAML; lines may end as they do on any system.
        name: What messages call the file.
        key: The list whose items are edited, and are called tools here.
    """

    text: str
    name: str = "<tools>"
    key: str = "tools"

    @cached_property
    def _value(self) -> Any:
        root, _ = read_tree(self.text)
        return root.value if root is not None else None

    @cached_property
    def tools(self) -> tuple[Mapping[str, Any], ...]:
        """The keys that each tool has itself; none for a tool that is no mapping."""
        tools = self._value.get(self.key) if isinstance(self._value, dict) else None
        return tuple(each if isinstance(each, dict) else {} for each in tools) if isinstance(tools, list) else ()

    @property
    def is_empty(self) -> bool:
        """True for a mapping that names no tool, which the reader refuses, but an editor begins with."""
        return isinstance(self._value, dict) and self._value.get(self.key) in (None, [])

    def of_list(self, key: str) -> "ToolsText":
        """The same text with the items of another list as its tools."""
        return self if key == self.key else replace(self, key=key)

    @property
    def header(self) -> Mapping[str, Any]:
        """The keys of the file without its tools."""
        value = self._value if isinstance(self._value, dict) else {}
        return {key: each for key, each in value.items() if key != self.key}

    @property
    def defaults(self) -> Mapping[str, Any]:
        """The keys that every tool inherits; effects of other lists inherit none."""
        return (self.header.get("defaults") or {}) if self.key == "tools" else {}

    @property
    def up(self) -> str:
        """The axis that points up where the file gives positions."""
        return str(self.header.get("up", "y"))

    def with_value(self, number: int, steps: Steps, value: Any) -> "ToolsText":
        """Set a value to plain Python (text, numbers, lists, mappings); a key that the tool lacks is added."""

        def is_right(edited: ToolsText) -> bool:
            found = _part_of(edited.tools[number], steps)
            return edited.tools == self._with_tools(number, with_part(self.tools[number], steps, found))

        return self._first_right(
            is_right,
            lambda: self._valued(number, steps, value),
            lambda: self._apart(number)._valued(number, steps, value),
        )

    def without(self, number: int, steps: Steps) -> "ToolsText":
        """Remove a key of a tool, its own one and one that it merges."""
        tools = self._with_tools(number, _without_part(self.tools[number], steps))
        return self._first_right(
            lambda edited: edited.tools == tools,
            lambda: self._unset(number, steps),
            lambda: self._unset(number, steps)._unset(number, steps),
            lambda: self._apart(number)._unset(number, steps),
        )

    def with_tool(self, values: Mapping[str, Any]) -> "ToolsText":
        """Add a tool at the end, with a line for each of its keys."""
        return self.with_item(written_lines(values))

    def with_copy(self, number: int, name: str) -> "ToolsText":
        """Add a copy of a tool behind it, with another name and without anchors."""
        copy = {**self.tools[number], "name": name}
        anchored = (each.start for each in self._item(number).within() if each.anchor and each.kind != "alias")
        gone = [(*found.span(), "") for at in anchored if (found := _ANCHOR.match(self.text, at))]
        lines = self._changed(*gone).lines_of(number)
        behind = number + 1
        return self._first_right(
            lambda edited: edited.tools == (*self.tools[:behind], copy, *self.tools[behind:]),
            lambda: self._with(*self._new_tool(lines, behind=number))._valued(behind, ("name",), name),
            # The tool repeats an anchor that it has again itself, so that the copy would repeat the new one.
            lambda: self._with(*self._new_tool(written_lines(copy), behind=number)),
        )

    def with_item(self, lines: Sequence[str], *, instead_of: int | None = None) -> "ToolsText":
        """Add a tool at the end, or in place of the tool `instead_of`.

        Args:
            lines: Lines of the tool without a dash; those after the first are indented relative to it.
            instead_of: Index of the replaced tool.
        """
        if instead_of is None:
            return self._with(*self._new_tool(lines, behind=-1))
        part = self._item(instead_of)
        change = (part.start, part.end, self._indented(lines, self._column(part.start)))
        # Anchors move to others only if these lines do not have them again.
        return self._first_right(
            lambda edited: edited.tools == self._with_tools(instead_of, *edited.tools[instead_of : instead_of + 1]),
            lambda: self._changed(change),
            lambda: self._with(change),
        )

    def lines_of(self, number: int) -> list[str]:
        """The lines of a tool, as `with_item` takes them."""
        part = self._item(number)
        first, *others = re.split(r"\r?\n", self.text[part.start : part.end])
        indents = [len(each) - len(each.lstrip()) for each in others if not re.match(r"\s*(#|$)", each)]
        column = min([self._column(part.start), *indents])
        return [first, *(line[column:] if not line[:column].strip() else line.lstrip() for line in others)]

    def without_tool(self, number: int) -> "ToolsText":
        """Remove a tool and the comments right above it."""
        return self._first_right(
            lambda edited: edited.tools == self._with_tools(number), lambda: self._with(*self._tool_removal(number))
        )

    def without_empty(self) -> "ToolsText":
        """Remove the list if it is empty, as the reader refuses it beside other lists."""
        at = self._root.number_of(self.key)
        if at is None or self.tools:
            return self
        if self._root.flow:
            return self._with(self._removal(self._root, at))
        ends = self._line_start(self._root.keys[at].start), self._line_end(self._root.items[at].end, behind=True)
        return self._changed((*ends, ""))

    def with_key(self, key: str, value: Any) -> "ToolsText":
        """Set a key of the file to a value in one line; a new one stands right before the tools."""
        root = self._root
        at, tools = root.number_of(key), root.number_of(self.key)
        if at is not None:
            return self._with(self._value_at(root, at, value))
        if root.flow or tools is None:
            return self._with(self._addition(root, key, value))
        start = root.keys[tools].start
        return self._with((start, start, f"{written(key)}: {written(value)}{self._newline}"))

    # Edits that change one tool alone.

    def _first_right(self, is_right: Callable[["ToolsText"], bool], *edits: Callable[[], "ToolsText"]) -> "ToolsText":
        """The result of the first edit that changes what it should, and nothing that others share with it."""
        if "*" not in self.text:  # no aliases: nothing is shared
            return edits[0]()
        problems: list[ConfigError] = []
        for edit in edits:
            try:
                edited = edit()
            except ConfigError as error:
                problems.append(error)
                continue
            if edited._value is not None and edited.header == self.header and is_right(edited):
                return edited
        message = "other tools repeat a part of this one, or this one of others; write these parts out first"
        raise problems[0] if problems else ConfigError(message, where=self.name)

    def _with_tools(self, number: int, *instead: Any) -> tuple[Any, ...]:
        """The keys of all tools, with others instead of those of a tool."""
        return (*self.tools[:number], *instead, *self.tools[number + 1 :])

    def _valued(self, number: int, steps: Steps, value: Any) -> "ToolsText":
        """Set a value where it stands, although others may repeat the tool."""
        part = self._item(number)
        values: Any = self.tools[number]
        for depth, step in enumerate(steps):
            values = _part_of(values, (step,))
            at, further = part.number_of(step), steps[depth + 1 :]
            if at is not None and further and self._is_own(part.items[at]):
                part = part.items[at]
                continue
            # A value that is repeated or merged from elsewhere is written out here, so that it changes here alone.
            found = with_part(values, further, value)
            return self._with(self._addition(part, str(step), found) if at is None else self._value_at(part, at, found))
        raise ValueError("expected one step at least")

    def _unset(self, number: int, steps: Steps) -> "ToolsText":
        """Remove a value where it stands, although others may repeat the tool."""
        part, values = self._item(number), self.tools[number]
        for depth, step in enumerate(steps):
            at, found = part.number_of(step), _part_of(values, steps[: depth + 1])
            last = depth == len(steps) - 1
            if last and at is not None:
                return self._with(self._removal(part, at))
            if found is None:
                return self
            if last:
                return self._with(self._written_merge(part, step, _part_of(values, steps[:depth])))
            if at is None or not self._is_own(part.items[at]):
                kept = _without_part(found, steps[depth + 1 :])
                return self._valued(number, steps[: depth + 1], kept)
            part = part.items[at]
        raise ValueError("expected one step at least")

    def _apart(self, number: int) -> "ToolsText":
        """Let a tool merge what it was, so that its own keys are new, and others repeat what it was."""
        part = self._item(number)
        if part.flow:
            return self._changed((part.start, part.start, "{<<: "), (part.end, part.end, "}"))
        first, *others = self.lines_of(number)
        lines = [f"<<: {first}", *(f"  {line}" if line else line for line in others)]
        if not first.startswith("&"):
            lines = ["<<:", f"  {first}", *lines[1:]]
        change = (part.start, part.end, self._indented(lines, self._column(part.start)))
        return self._changed(change)

    # The places of values in the text.

    @cached_property
    def _root(self) -> _Part:
        events = yaml.parse(self.text, Loader=yaml.SafeLoader)
        try:
            for event in events:
                if isinstance(event, yaml.DocumentStartEvent):
                    return _read_part(next(events), events, self.text)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise ConfigError(f"cannot be read as YAML: {error}", where=self.name) from None
        raise ConfigError("the file is empty", where=self.name)

    @property
    def _tools(self) -> _Part | None:
        """The value of `tools`; None where the key is missing."""
        at = self._root.number_of(self.key)
        return None if at is None else self._root.items[at]

    @property
    def _behind_colon(self) -> int:
        """The index behind the colon of `tools`."""
        at = self._root.number_of(self.key)
        assert at is not None
        return self.text.index(":", self._root.keys[at].end) + 1

    def _item(self, number: int) -> _Part:
        tools = self._tools
        assert tools is not None
        part = tools.items[number]
        if part.kind != "map":
            raise ConfigError("is no mapping of its own; write it out to edit it", where=self._place(part))
        return part

    def _uses(self, part: _Part) -> list[_Part]:
        """The aliases that repeat an anchored value."""
        found: list[_Part] = []
        for each in self._root.within() if part.anchor is not None else ():
            if each.start > part.start and each.anchor == part.anchor:
                if each.kind != "alias":
                    break
                found.append(each)
        return found

    def _is_own(self, part: _Part) -> bool:
        """True if a change within a part changes nothing elsewhere."""
        return part.kind in ("map", "seq") and not self._uses(part)

    def _place(self, part: _Part) -> str:
        return f"{self.name}:{self.text.count(chr(10), 0, part.start) + 1}"

    def _dash(self, part: _Part) -> tuple[int, int]:
        """Indices of an item's dash and of the start of the dash's line."""
        found = [*_DASH.finditer(self.text, 0, part.start)][-1]
        return found.start(1), found.start()

    def _lead(self, part: _Part) -> int:
        """Index of the start of the line with an item's dash, or of the comments right above it."""
        _, start = self._dash(part)
        while start > 0:
            above = self._line_start(start - 1)
            if not self.text[above:start].lstrip().startswith("#"):
                break
            start = above
        return start

    @property
    def _newline(self) -> str:
        return "\r\n" if "\r\n" in self.text else "\n"

    def _line_start(self, at: int) -> int:
        return self.text.rfind("\n", 0, at) + 1

    def _line_end(self, at: int, *, behind: bool = False) -> int:
        """Index of the end of a line, before its line break or `behind` it."""
        end = self.text.find("\n", at)
        if end < 0:
            return len(self.text)
        return end + 1 if behind else end - (self.text[end - 1 : end] == "\r")

    def _column(self, at: int) -> int:
        return at - self._line_start(at)

    # Changes of the text.

    def _changed(self, *changes: _Change) -> "ToolsText":
        text = self.text
        for start, end, instead in sorted(changes, key=lambda change: change[0], reverse=True):
            text = text[:start] + instead + text[end:]
        return replace(self, text=text)

    def _with(self, *changes: _Change) -> "ToolsText":
        """Apply changes; an anchored value that they remove moves to the first alias that repeats it."""
        moved = [each for start, end, _ in changes for each in self._moved_anchors(start, end)]
        return self._changed(*changes, *moved)

    def _moved_anchors(self, start: int, end: int) -> Iterator[_Change]:
        reached = start
        for part in self._root.within():
            if part.anchor is None or part.kind == "alias" or part.start < reached or part.end > end:
                continue
            uses = [each for each in self._uses(part) if not start <= each.start < end]
            if not uses:
                continue
            text = self.text[part.start : part.end]
            if "\n" in text or (part.kind in ("map", "seq") and not part.flow):
                message = f"holds the anchor &{part.anchor}, which others repeat by an alias; write these out first"
                raise ConfigError(message, where=self._place(part))
            yield (uses[0].start, uses[0].end, text)
            reached = part.end

    def _value_at(self, parent: _Part, number: int, value: Any) -> _Change:
        """Replace an item's value; an anchor that nothing repeats stays."""
        part, text = parent.items[number], written(value)
        start = part.start
        if part.kind != "alias" and not self._uses(part) and (found := _ANCHOR.match(self.text, start)):
            start = found.end()
        return (start, part.end, " " * (not self.text[start - 1].isspace()) + text)

    def _addition(self, part: _Part, key: str, value: Any) -> _Change:
        """Add a key behind the last one of a mapping."""
        text = f"{written(key)}: {written(value)}"
        if part.flow and self.text[part.start] != "{" and part.anchor is None:  # a pair in a list: [name: a]
            return (part.start, part.end, f"{{{self.text[part.start : part.end]}, {text}}}")
        if part.flow:
            at = part.items[-1].end if part.items else self.text.index("{", part.start) + 1
            return (at, at, f", {text}" if part.items else text)
        at = self._line_end(part.end)
        return (at, at, f"{self._newline}{' ' * self._column(part.keys[0].start)}{text}")

    def _removal(self, part: _Part, number: int) -> _Change:
        """Remove an item: from brackets with its comma, from a block with its lines and the comments on them."""
        starts = [each.start for each in part.keys or part.items]
        start, end = starts[number], part.items[number].end
        if len(starts) == 1:
            return (part.start, part.end, "{}" if part.keys else "[]")
        if part.flow and number + 1 < len(starts):
            return (start, starts[number + 1], "")
        if part.flow:
            before = part.items[number - 1].end
            # On a line of its own it leaves the comma before it, behind which a comment may stand.
            return (start if "\n" in self.text[before:start] else before, end, "")
        line = self._line_start(start)
        if self.text[line:start].lstrip().startswith("-"):  # the dash stays
            return (line + len(self.text[line:start].rstrip()), self._line_end(end), "")
        return (line, self._line_end(end, behind=True), "")

    def _written_merge(self, part: _Part, key: str | int, values: Mapping[str, Any]) -> _Change:
        """Write out what a mapping of some values merges, without a key."""
        at = part.number_of("<<")
        assert at is not None
        own = {each.text for each in part.keys}
        merged = {name: each for name, each in values.items() if name not in own and name != key}
        if not merged:
            return self._removal(part, at)
        start = part.keys[at].start
        between = ", " if part.flow else f"{self._newline}{' ' * self._column(start)}"
        return (start, part.items[at].end, between.join(written_lines(merged)))

    def _tool_removal(self, number: int) -> list[_Change]:
        """Remove a tool and the comments right above it."""
        tools, part = self._tools, self._item(number)
        assert tools is not None
        if tools.flow:
            return [self._removal(tools, number)]
        last = number == len(tools.items) - 1
        end = self._line_end(part.end, behind=True) if last else self._lead(tools.items[number + 1])
        none = [(self._behind_colon, self._behind_colon, " []")] if len(tools.items) == 1 else []
        return [*none, (self._lead(part), end, "")]

    def _new_tool(self, lines: Sequence[str], *, behind: int) -> list[_Change]:
        """Add a tool behind another one."""
        tools, newline = self._tools, self._newline
        if (tools is None or not tools.items) and self._root.flow:
            entry = [_value_of(lines)]
            if tools is None:
                return [self._addition(self._root, self.key, entry)]
            return [(tools.start, tools.end, written(entry))]
        if tools is None or not tools.items:
            new = f"{newline}  - {self._indented(lines, 4)}"
            at = self._line_end((tools or self._root).end)
            if tools is None:
                return [(at, at, f"{newline}{self.key}:{new}")]
            return [(self._behind_colon, tools.end, ""), (at, at, new)]
        part = tools.items[behind]
        if tools.flow:
            return [(part.end, part.end, f", {self._indented(lines, self._column(part.start))}")]
        dash, line = self._dash(part)
        indent = self._column(part.start) if line == self._line_start(part.start) else dash - line + 2
        text = f"{self.text[line:dash]}-".ljust(indent) + self._indented(lines, indent)
        at = self._line_end(part.end)
        spaced = len(tools.items) == 1 or self.text[: self._lead(tools.items[-1])].endswith(newline * 2)
        return [(at, at, newline * (1 + spaced) + text)]

    def _indented(self, lines: Sequence[str], indent: int) -> str:
        """The text of a tool's lines behind a dash; one line if all tools stand in brackets."""
        tools = self._tools
        if tools is not None and tools.items and tools.flow and not _BRACKET.match(lines[0]):
            return written(_value_of(lines))
        return self._newline.join([lines[0], *(" " * indent + line if line else line for line in lines[1:])])
