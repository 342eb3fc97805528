"""The edited tools file on disk: written whole, merged with what others have written meanwhile, kept in a side file.

What is not saved yet stands in the side file `.NAME.unsaved`, beside the file and with what that was, so that neither
a crash nor a closed browser loses it.
"""

import json
import os
from collections.abc import Sequence
from contextlib import suppress

from wrinklecli.errors import ConfigError, WrinkleError
from wrinklecli.files.outputs import Outputs
from wrinklecli.tools.read import load_text, parse_tools
from wrinklecli.tools.records import ToolsFile
from wrinklecli.tools.yaml_edit import ToolsText

NEW = "version: 1\ntools: []\n"
"""The text of a file that is not there yet."""

# A tool that no file has, for a file without tools, which the reader refuses.
_NO_TOOL = {"name": "none", "origin": [0, 0, 0], "target": [1, 0, 0], "width": 1, "enabled": False}
_BOM = b"\xef\xbb\xbf"
_VERSION = 1


class Store:
    """A tools file on disk.

    Args:
        path: Of it; it need not be there.

    Attributes:
        path: As it was typed.
        base: Its text as it was read or saved last, which edits began with.

    Raises:
        ConfigError: It cannot be read.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.base = self.on_disk()

    @property
    def side(self) -> str:
        """The side file."""
        folder, name = os.path.split(self.path)
        return os.path.join(folder, f".{name}.unsaved")

    def on_disk(self) -> str:
        """The text that the file has now; that of a new one where it is not there.

        Raises:
            ConfigError: It cannot be read.
        """
        return load_text(self.path) if os.path.lexists(self.path) else NEW

    def text(self, text: str) -> ToolsText:
        """A text of the file."""
        return ToolsText(text, self.path)

    def keep(self, text: str) -> None:
        """Put what is not saved into the side file; where all is saved, take that away.

        Raises:
            WrinkleError: It cannot be written.
        """
        if text == self.base:
            self.forget()
            return
        data = json.dumps({"wrinkle_edit": _VERSION, "base": self.base, "text": text})
        with Outputs() as outputs:
            outputs.add_bytes(self.side, data.encode(), durable=False)

    def forget(self) -> None:
        """Take the side file away."""
        with suppress(OSError):
            os.unlink(self.side)

    def unsaved(self) -> tuple[str, str] | None:
        """What an earlier session has not saved: what the file was then, and the text; None where there is nothing."""
        try:
            with open(self.side, encoding="utf-8") as file:
                found = json.load(file)
            if found["wrinkle_edit"] == _VERSION and found["text"] != self.base:
                return str(found["base"]), str(found["text"])
        except (OSError, ValueError, KeyError, TypeError):
            return None
        return None

    def merged(self, text: str, now: str, since: str | None = None) -> ToolsText:
        """A text, with what others have changed in the file, tool by tool.

        Args:
            text: What was made of the file here.
            now: What others have made of it.
            since: What it was before both; `base` where left out.

        Raises:
            ConfigError: Of all tools that were changed here and there, a line each; or the result is not valid.
        """
        before = self.base if since is None else since
        return self.text(text) if now == before else _merged(*map(self.text, (before, text, now)))

    def write(self, text: str) -> None:
        """Write a text in place of what is there.

        Raises:
            BakeError: It cannot be written.
        """
        start = b""
        with suppress(OSError), open(self.path, "rb") as file:
            start = _BOM if file.read(len(_BOM)) == _BOM else b""
        with Outputs() as outputs:
            outputs.add_bytes(self.path, start + text.encode())
        self.base = text
        self.forget()


def read_file(file: ToolsText) -> ToolsFile:
    """Check a tools file, which may be without tools, and give what it says.

    Raises:
        ConfigError: All of its problems.
    """
    return parse_tools((file.with_tool(_NO_TOOL) if file.is_empty else file).text, name=file.name)


def _lines(file: ToolsText, name: str) -> list[str] | None:
    """The text of a tool; None where the file has none of this name."""
    names = names_of(file)
    return file.lines_of(names.index(name)) if name in names else None


def names_of(file: ToolsText) -> list[str]:
    """The names of the tools of a file."""
    return [str(each.get("name")) for each in file.tools]


def _merged(base: ToolsText, mine: ToolsText, theirs: ToolsText) -> ToolsText:
    """What both have made of a file."""
    found, problems = theirs, list[WrinkleError]()
    for name in dict.fromkeys([*names_of(base), *names_of(mine)]):
        was, here, there = (_lines(each, name) for each in (base, mine, theirs))
        if here in (was, there):
            continue
        if there != was:
            message = "was changed here, and otherwise in the file on disk"
            problems.append(ConfigError(message, where=f"{mine.name}: {name}"))
        else:
            found = _with_lines(found, name, here)
    if mine.beside not in (base.beside, theirs.beside):
        problems.append(ConfigError("more than its tools was changed here and on disk", where=mine.name))
    if not problems:
        try:
            read_file(found)
        except ConfigError as error:
            problems.append(error)
    if problems:
        raise ConfigError.of_all(problems)
    return found


def _with_lines(file: ToolsText, name: str, lines: Sequence[str] | None) -> ToolsText:
    """A file with another text of a tool, which may be new to it, or go."""
    names = names_of(file)
    if lines is None:
        return file.without_tool(names.index(name))
    return file.with_item(lines, instead_of=names.index(name) if name in names else None)
