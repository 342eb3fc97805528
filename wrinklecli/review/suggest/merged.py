"""Suggestions added to a tools file that is there already: every line of it stays as it is."""

from collections.abc import Mapping

from wrinklecli.errors import ConfigError
from wrinklecli.frozen import dataclass
from wrinklecli.tools.mirror import exchange_sides, numbered
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import identifier, with_axes
from wrinklecli.tools.schema import KINDS
from wrinklecli.tools.yaml_edit import ToolsText, written_lines


@dataclass(frozen=True, slots=True)
class Merged:
    """A tools file with what was suggested.

    Attributes:
        text: The text of the file.
        added: By list, the number of entries that it did not have.
    """

    text: str
    added: Mapping[str, int]


def merged(name: str, text: str, suggested: str, *, external: bool = False) -> Merged:
    """Add the entries of a text of `suggest` that a file does not have, with the comments above each.

    The file has an entry of the same name for the same node, or one whose mirror image has that name. A name that an
    entry of another node has gets a number. The file's `defaults` hold for what is added, but for places.

    Args:
        name: The file's name.
        text: Its text.
        suggested: The text that is added.
        external: Read files of presets outside the file's folder too.

    Raises:
        ConfigError: The file is not valid, or would not be.
    """
    file, new = ToolsText(text, name), ToolsText(suggested)
    taken: dict[str, set[str | None]] = {}
    listed = any(file.of_list(key).tools for key in KINDS)
    for each in parse_tools(text, name=name, external=external).effects if listed else ():
        taken.setdefault(identifier(each.name), set()).add(each.node)
    for values in (each for key in KINDS for each in file.of_list(key).tools):  # those that are disabled too
        taken.setdefault(identifier(str(values["name"])), set()).add(values.get("node"))
    file = _with_presets(file, new.header.get("presets", []))
    added: dict[str, int] = {}
    comments = _comments(suggested)
    for key, kind in KINDS.items():
        for values in new.of_list(key).tools:
            called, node = str(values["name"]), values.get("node")
            if node in taken.get(identifier(called), ()):
                continue
            unlike = {"mirror": "none"} if file.of_list(key).defaults.get("mirror") not in (None, "none") else {}
            free = numbered(called, taken) if identifier(called) in taken else called
            given = {**unlike, **new.of_list(key).defaults, **values, "name": free}
            first, *others = written_lines(with_axes(kind, given, file.up))
            file = file.of_list(key).with_item([first, *comments.get(called, ()), *others])
            added[key] = added.get(key, 0) + 1
            taken |= {identifier(each): {node} for each in (free, exchange_sides(free))}
    if added:
        parse_tools(file.text, name=name, external=external)
    return Merged(file.text, added)


def _with_presets(file: ToolsText, paths: list[str]) -> ToolsText:
    """A file that names further files of presets."""
    own = file.header.get("presets", [])
    if paths and isinstance(own, Mapping):
        message = "has presets of its own, and names no files beside them; move them to a file"
        raise ConfigError(message, where=file.name)
    named = [own] if isinstance(own, str) else list(own)
    more = [path for path in paths if path not in named]
    return file.with_key("presets", [*named, *more]) if more else file


def _comments(suggested: str) -> dict[str, list[str]]:
    """The lines of comments right above each entry of a text of `suggest`, by the entry's name."""
    found: dict[str, list[str]] = {}
    above: list[str] = []
    for line in suggested.splitlines():
        if line.startswith("  - name: "):
            found[line.removeprefix("  - name: ")] = above
        above = [*above, line.strip()] if line.startswith("  #") else []
    return found
