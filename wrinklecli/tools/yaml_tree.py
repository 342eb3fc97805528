"""Reads YAML text into a tree that knows its lines, within limits; problems of the YAML itself are collected.

Source: YAML 1.1 as PyYAML's SafeLoader reads it. Differs: see `_Composer`.
"""

import json
import math
import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any

import yaml

from wrinklecli.errors import SHOWN, counted
from wrinklecli.frozen import dataclass

MAX_BYTES = 4_000_000  # a thousand tools take about 500 kB
MAX_NODES = 100_000  # values, counted again for each alias: ten aliases of ten aliases of … are a bomb
MAX_DEPTH = 32  # levels of nesting; the contract needs 8

_TAG = "tag:yaml.org,2002:"
_BOOLS = {"true": True, "yes": True, "on": True, "false": False, "no": False, "off": False}
_NUMBER = re.compile(r"[-+]?(?:0|[1-9][0-9]*)")
_DECIMAL = re.compile(r"[-+]?(?:(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+)")

# The line ends that PyYAML counts.
_LINE_END = re.compile("\r\n|[\r\n\x85\u2028\u2029]")
# Indent, dashes of list items, and a key if there is one.
_ENTRY = re.compile(r"( *)((?:- +)*)(?:([\w.\"'-]+): *(?:[^ ]|$))?")


def explained(text: str, problem: str, line: int, context: str, start: int) -> tuple[int, str]:
    """The line, from 1, and a message for text that PyYAML cannot read; PyYAML's words if none here fit.

    Args:
        text: The YAML.
        problem: PyYAML's words for the problem.
        line: Line of the problem, from 0.
        context: PyYAML's words for the part that it was reading.
        start: First line of that part, from 0.
    """
    lines = _LINE_END.split(text)[: line + 1]
    if "block" in context or "not allowed here" in problem or "cannot start any token" in problem:
        found = _at_its_start(lines)
        if found is not None:
            return found
    if "flow sequence" in context or "flow mapping" in context:
        opened, closed = "[]" if "sequence" in context else "{}"
        return start + 1, f"YAML: no {closed} closes this {opened}, or a comma is missing"
    if "quoted scalar" in context and "unexpected end" in problem:
        return start + 1, "YAML: a quote is opened here, but not closed"
    if "could not find expected ':'" in problem:
        return start + 1, "YAML: expected `key: value`, with a space behind the colon"
    if "not allowed here" in problem:
        return line + 1, "YAML: a value that has a colon in it needs quotes"
    if "cannot start any token" in problem or "scanning an alias" in context:
        return line + 1, "YAML: a value that begins with such a character needs quotes"
    return line + 1, "YAML: " + ", ".join(part for part in (problem, context) if part)


def _at_its_start(lines: list[str]) -> tuple[int, str] | None:
    """The fault at the start of the last line or of the line above it: a tab, a dash, or the indent."""
    here = lines[-1]
    if "\t" in here[: len(here) - len(here.lstrip())]:
        return len(lines), "YAML: indented by a tab; only spaces are taken"
    written = [number for number, each in enumerate(lines) if each.strip() and not each.lstrip().startswith("#")]
    for number in written[-2:]:
        if re.match(r" *-[A-Za-z_\"']", lines[number]):
            return number + 1, "YAML: a space is missing behind the dash"
    indent = len(here) - len(here.lstrip(" "))
    beside = [each for each in _open(lines, written[:-1]) if (each.name == "-") == here.lstrip().startswith("-")]
    if not beside or any(each.indent == indent for each in beside):
        return None
    # The inner one of two that are equally near.
    near = min(beside, key=lambda each: (abs(each.indent - indent), -each.indent))
    return len(lines), (
        f"YAML: indented by {counted(indent, 'space')}, but `{near.name}` on line {near.line} by {near.indent}:"
        " what belongs together is indented alike"
    )


@dataclass(frozen=True, slots=True)
class _Entry:
    """A key, or the dash of a list item."""

    name: str  # of the key, or `-`
    line: int  # from 1
    indent: int  # characters before it


def _open(lines: list[str], numbers: list[int]) -> list[_Entry]:
    """The entries of some lines that could have another entry beside them."""
    entries: list[_Entry] = []
    for number in numbers:
        match = _ENTRY.match(lines[number])
        if match is None:
            continue
        found = [_Entry("-", number + 1, at) for at in range(match.start(2), match.end(2)) if lines[number][at] == "-"]
        if match[3] is not None:
            found.append(_Entry(match[3], number + 1, match.start(3)))
        for each in found:
            entries = [other for other in entries if other.indent < each.indent] + [each]
    return entries


@dataclass(frozen=True, slots=True)
class Node:
    """A YAML value: plain Python, the 1-based line of its key, its words in a message, and its parts."""

    value: Any
    line: int
    shown: str
    children: Mapping[str | int, "Node"]


@dataclass(frozen=True, slots=True)
class Problem:
    """A fault at a line and a path of the file, such as `tools[0].width`; `of_tag` if it is the value's tag."""

    line: int
    path: str
    message: str
    of_tag: bool = False


def without_tagged(problems: Iterable[Problem]) -> list[Problem]:
    """Problems without those of a value that has a tag, as nobody knows what it was meant to be."""
    problems = list(problems)
    tagged = {problem.path for problem in problems if problem.of_tag}
    return [problem for problem in problems if problem.of_tag or problem.path not in tagged]


class _TooMuchError(yaml.MarkedYAMLError):
    """The text exceeds a limit of this module."""


class _Composer(yaml.SafeLoader):
    """Composes nodes as SafeLoader does, within limits; a plain scalar is a number only if YAML 1.1 and 1.2 agree.

    Differs from SafeLoader: 010, 1:30, 0x10, 1_000 and 2020-01-01 stay text, 1e-3 is a number; .inf, .nan and 1e999,
    for which JSON has no numbers, stay text too.
    """

    yaml_implicit_resolvers = {}  # noqa: RUF012 - as the base class declares it

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self.depth = 0
        self.count = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self.depth += 1
        self.count += 1
        mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
        if self.depth > MAX_DEPTH:
            raise _TooMuchError(problem=f"nested more than {MAX_DEPTH} levels deep", problem_mark=mark)
        if self.count > MAX_NODES:
            raise _TooMuchError(problem=f"more than {MAX_NODES:,} values", problem_mark=mark)
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


for _kind, _pattern, _first in (
    ("merge", re.compile(r"^<<$"), ["<"]),
    ("null", re.compile(r"^(?:~|null|Null|NULL|)$"), ["~", "n", "N", ""]),
    (
        "bool",
        re.compile(f"^(?:{'|'.join(form for word in _BOOLS for form in (word, word.title(), word.upper()))})$"),
        list("tTfFyYnNoO"),
    ),
    ("int", re.compile(f"^(?:{_NUMBER.pattern})$"), list("-+0123456789")),
    ("float", re.compile(f"^(?:{_DECIMAL.pattern})$"), list("-+0123456789.")),
):
    _Composer.add_implicit_resolver(_TAG + _kind, _pattern, _first)


def printable(text: str, limit: int = SHOWN) -> str:
    """Text that is safe in a line of a terminal: it is cut, and control characters become escapes."""
    cut = text if len(text) <= limit else text[: limit - 1] + "…"
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in cut)


def path_to(path: str, key: str | int) -> str:
    """The path of a part: `tools[0]`, `tools[0].width`, `tools[0].clips['my walk']`."""
    if isinstance(key, int):
        return f"{path}[{key}]"
    if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]*", key) is None:
        return f"{path}['{printable(key)}']"
    return f"{path}.{printable(key)}" if path else printable(key)


class _TreeBuilder:
    """Turns composed YAML nodes into `Node`s, and collects problems of the YAML itself."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []
        self.count = 0

    def build(self, node: yaml.Node, line: int, path: str, depth: int = 1) -> Node:
        """Turn a value and all below it; raises _TooMuchError if aliases make it too large, or endless."""
        self._spend(node, depth)
        children: dict[str | int, Node]
        kind = node.tag.removeprefix(_TAG)
        if isinstance(node, yaml.MappingNode):
            self._check_tag(kind, ("map",), line, path)
            children = {
                key: self.build(value, key_line, path_to(path, key), depth + 1)
                for key, (key_line, value) in self._members(node, path, depth, report=True).items()
            }
            return Node({key: child.value for key, child in children.items()}, line, "a mapping", children)
        if isinstance(node, yaml.SequenceNode):
            self._check_tag(kind, ("seq",), line, path)
            children = {
                i: self.build(item, item.start_mark.line + 1, path_to(path, i), depth + 1)
                for i, item in enumerate(node.value)
            }
            shown = f"a list of {len(children)}"
            return Node([child.value for child in children.values()], line, shown, children)
        shown = printable(node.value)
        if isinstance(node, yaml.ScalarNode) and node.style is not None:
            shown = f"'{shown}'"
        return Node(self._scalar(node.value, kind, line, path), line, shown or "nothing", {})

    def _scalar(self, text: str, kind: str, line: int, path: str) -> Any:
        if any("\ud800" <= c <= "\udfff" for c in text):
            self.problems.append(Problem(line, path, f"found '{printable(text)}', expected valid Unicode"))
            return printable(text)
        match kind:
            case "str" | "merge":
                return text
            case "null" if text in ("", "~") or text.lower() == "null":
                return None
            case "bool" if text.lower() in _BOOLS:
                return _BOOLS[text.lower()]
            case "int" if _NUMBER.fullmatch(text) and len(text) <= 18:
                return int(text)
            case "int" | "float" if _NUMBER.fullmatch(text) or _DECIMAL.fullmatch(text):
                number = float(text)
                return number if math.isfinite(number) else text
        self._check_tag(kind, (), line, path)
        return text

    def _check_tag(self, kind: str, accepted: Collection[str], line: int, path: str) -> None:
        if kind not in accepted:
            message = f"found the tag {printable(kind)}, expected a value without it"
            self.problems.append(Problem(line, path, message, of_tag=True))

    def _members(
        self, node: yaml.MappingNode, path: str, depth: int, *, report: bool
    ) -> dict[str, tuple[int, yaml.Node]]:
        """Line and value of each key, `<<` merged; keys stay as written, so that a clip may be called on, or 1."""
        own: dict[str, tuple[int, yaml.Node]] = {}
        merged: dict[str, tuple[int, yaml.Node]] = {}
        problems: list[Problem] = []
        first_lines: dict[str, int] = {}
        for key_node, value in node.value:
            line = key_node.start_mark.line + 1
            if not isinstance(key_node, yaml.ScalarNode):
                problems.append(Problem(line, path, "found a key that is no text, expected a name"))
                continue
            key = key_node.value
            if any("\ud800" <= c <= "\udfff" for c in key):
                problems.append(Problem(line, path_to(path, key), "not valid Unicode"))
            elif key in first_lines:
                message = f"duplicate key, first on line {first_lines[key]}"
                problems.append(Problem(line, path_to(path, key), message))
            elif key_node.tag == _TAG + "merge":
                first_lines[key] = line
                for source in value.value if isinstance(value, yaml.SequenceNode) else [value]:
                    self._spend(source, depth + 1)
                    if isinstance(source, yaml.MappingNode):
                        inherited = self._members(source, path, depth + 1, report=False)
                        self.count += len(inherited)
                        merged = {**inherited, **merged}
                    else:
                        problems.append(Problem(line, path_to(path, key), "expected a mapping to merge"))
            else:
                first_lines[key] = line
                own[key] = (line, value)
        if report:  # a merged mapping's own problems are reported where it stands
            self.problems += problems
        return {**merged, **own}

    def _spend(self, node: yaml.Node, depth: int) -> None:
        self.count += 1
        if depth > MAX_DEPTH:
            problem = f"nested more than {MAX_DEPTH} levels deep: an alias stands within its own anchor"
        elif self.count > MAX_NODES:
            problem = f"more than {MAX_NODES:,} values once the aliases are expanded"
        else:
            return
        raise _TooMuchError(problem=problem, problem_mark=node.start_mark)


def plain_values(text: str) -> Any:
    """Read YAML of our own as plain values."""
    # By libyaml it takes a twelfth of the time: 12 ms less for a bake. PyYAML may be installed without.
    return yaml.load(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))


def tree_of(value: Any, line: int = 1) -> Node:
    """The tree of plain Python values, all on one line."""
    children: dict[str | int, Node] = {}
    if isinstance(value, Mapping):
        children = {str(key): tree_of(each, line) for key, each in value.items()}
        return Node({key: child.value for key, child in children.items()}, line, "a mapping", children)
    if isinstance(value, list | tuple):
        children = {number: tree_of(each, line) for number, each in enumerate(value)}
        return Node([child.value for child in children.values()], line, f"a list of {len(children)}", children)
    shown = f"'{printable(value)}'" if isinstance(value, str) else json.dumps(value)
    return Node(value, line, shown, {})


def read_tree(text: str, expected: str = "a mapping with version and tools") -> tuple[Node | None, list[Problem]]:
    """The tree and the problems of the YAML itself; no tree for an empty file or YAML that cannot be read.

    `expected` says what an empty file should have.
    """
    if len(text) > MAX_BYTES:
        return None, [Problem(1, "", f"found {len(text):,} characters, expected at most {MAX_BYTES:,}")]
    builder = _TreeBuilder()
    line = 1
    try:
        composer = _Composer(text)
        try:
            root = composer.get_single_node()
        except (ValueError, OverflowError) as error:  # escapes and versions that PyYAML does not check
            return None, [Problem(composer.line + 1, "", f"YAML: {printable(str(error), 80)}")]
        if root is None:
            return None, [Problem(1, "", f"the file is empty, expected {expected}")]
        return builder.build(root, root.start_mark.line + 1, ""), builder.problems
    except yaml.MarkedYAMLError as error:
        marks = (error.problem_mark or error.context_mark, error.context_mark or error.problem_mark)
        at, start = (mark.line if mark is not None else 0 for mark in marks)
        line, message = explained(text, error.problem or "", at, error.context or "", start)
        return None, [Problem(line, "", printable(message, 200))]
    except yaml.reader.ReaderError as error:
        line += text.count("\n", 0, error.position)
        code = error.character if isinstance(error.character, int) else ord(error.character)
        return None, [Problem(line, "", f"YAML: character U+{code:04X} is not allowed")]
