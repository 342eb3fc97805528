"""Explains text that is no YAML to the people who wrote it: its indents, dashes, brackets and quotes."""

import re

from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass

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
