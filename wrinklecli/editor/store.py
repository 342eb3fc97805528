"""The edited tools file on disk: written whole, merged with changes by others, and protected by a side file.

Unsaved text stands in a side file, so that neither a crash nor a closed browser loses it.
"""

import os
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

from wrinklecli.editor.side_file import SideFile
from wrinklecli.errors import BakeError, ConfigError, WrinkleError
from wrinklecli.files.claims import Claims
from wrinklecli.files.inputs import open_input
from wrinklecli.files.outputs import Outputs
from wrinklecli.tools.files_beside import load_text
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import ToolsFile
from wrinklecli.tools.schema import KINDS
from wrinklecli.tools.yaml_edit import ToolsText, written_lines

_NEW_FILE = "version: 1\ntools: []\n"
# A disabled tool that is added to a file without tools before it is checked, as the reader refuses such a file.
_PLACEHOLDER = {"name": "none", "origin": [0, 0, 0], "target": [1, 0, 0], "width": 1, "enabled": False}
_BOM = b"\xef\xbb\xbf"


class Store:
    """A tools file on disk, which need not exist. `base` is the text that was last read or saved.

    With `external`, files of presets may lie outside its folder. Unsaved text is kept in `own_folder`, one of
    the user's own, if there is one.

    Raises:
        ConfigError: The file cannot be read.
    """

    def __init__(self, path: str, *, external: bool = False, own_folder: str | None = None) -> None:
        self.path = path
        self.external = external
        self.side = None if own_folder is None else SideFile(own_folder, path)
        self.base = self.on_disk()
        self._inputs: tuple[str, ...] = ()

    def protect(self, inputs: Iterable[str | os.PathLike[str]]) -> None:
        """Never write over these files, by whatever name, instead of those that were protected before.

        Raises:
            BakeError: The tools file is one of them.
        """
        self._inputs, claims = tuple(os.fspath(path) for path in inputs), Claims[str]()
        for path in self._inputs:
            claims.add_input(path, path)
        if claims.add_output(self.path, self.path) is not None:
            raise BakeError("is an input too, and would be overwritten when the tools are saved", where=self.path)

    @property
    def is_gone(self) -> bool:
        """True if there is no file."""
        return not os.path.lexists(self.path)

    def on_disk(self) -> str:
        """Read the file; if there is none, return the text of a new one.

        Raises:
            ConfigError: The file cannot be read.
        """
        return _NEW_FILE if self.is_gone else load_text(self.path)

    def keep(self, text: str) -> None:
        """Write unsaved text to the side file, or remove the side file if everything is saved.

        Raises:
            ConfigError: The side file cannot be written.
        """
        if self.side is not None and text == self.base:
            self.side.remove()
        elif self.side is not None:
            self.side.write(self.base, text)

    def unsaved(self) -> tuple[str, str] | None:
        """Read the unsaved text of an earlier session: the text that its edits began with, and the edited text.

        Raises:
            ConfigError: The side file is damaged, or cannot be read.
        """
        kept = None if self.side is None else self.side.read()
        return None if kept is None or kept[1] == self.base else kept

    def merged(self, mine: str, theirs: str, since: str | None = None) -> ToolsText:
        """Merge a text edited here with one written by others, tool by tool; both have changed `since` (or `base`).

        Raises:
            ConfigError: Both have changed a tool in different ways (a line each), or the result is not valid.
        """
        before = self.base if since is None else since
        files = (ToolsText(text, self.path) for text in (before, mine, theirs))
        return ToolsText(mine, self.path) if theirs == before else self._merged(*files)

    def read(self, file: ToolsText) -> ToolsFile:
        """Check and read a text of the file, which may have no tools.

        Raises:
            ConfigError: The text or a file of presets has problems, a line each.
        """
        text = (file.with_tool(_PLACEHOLDER) if file.is_empty else file).text
        return parse_tools(text, name=file.name, external=self.external)

    def write(self, text: str) -> None:
        """Replace the file.

        Raises:
            BakeError: The file cannot be written, or is an input.
        """
        with Outputs() as outputs:
            outputs.protect(self._inputs)
            outputs.add_bytes(self.path, self._bom() + text.encode())
        self.base = text
        self.keep(text)

    def _bom(self) -> bytes:
        """The byte order mark with which the file begins, if any."""
        try:
            with open_input(self.path) as file:
                return _BOM if file.read(len(_BOM)) == _BOM else b""
        except FileNotFoundError:
            return b""
        except OSError as error:
            raise BakeError(f"cannot be written: {error.strerror}", where=self.path) from None

    def _merged(self, base: ToolsText, mine: ToolsText, theirs: ToolsText) -> ToolsText:
        """Apply the changes from `base` to `mine` to `theirs`."""
        merged, problems = theirs, list[WrinkleError]()
        for key in KINDS:
            base, mine, theirs, merged = (each.of_list(key) for each in (base, mine, theirs, merged))
            for name in dict.fromkeys([*names_of(base), *names_of(mine)]):
                before, here, there = (_lines(each, name) for each in (base, mine, theirs))
                if here in (before, there):
                    continue
                if there != before:
                    message = "was changed here, and otherwise in the file on disk"
                    problems.append(ConfigError(message, where=f"{mine.name}: {name}"))
                else:
                    merged = without_empty_list(_with_tool_of(mine, merged, name))
        merged = without_empty_list(merged.of_list("tools"))
        if _header(mine) not in (_header(base), _header(theirs)):
            problems.append(ConfigError("more than its tools was changed here and on disk", where=mine.name))
        if not problems:
            try:
                self.read(merged)
            except ConfigError as error:
                problems.append(error)
        if problems:
            raise ConfigError.of_all(problems)
        return merged


def names_of(file: ToolsText) -> list[str]:
    """List the names of the tools of a file."""
    return [str(each.get("name")) for each in file.tools]


def without_empty_list(file: ToolsText) -> ToolsText:
    """The file without its list if that is empty; a file without any effect keeps an empty list of tools."""
    others = any(file.of_list(key).tools for key in KINDS if key != file.key)
    return file.without_empty() if others or file.key != "tools" else file


def _header(file: ToolsText) -> dict[str, Any]:
    """The keys of a file without its lists of effects."""
    return {key: value for key, value in file.header.items() if key not in KINDS}


def _lines(file: ToolsText, name: str) -> list[str] | None:
    """The lines of a tool; None if the file does not have it."""
    names = names_of(file)
    return file.lines_of(names.index(name)) if name in names else None


def _with_tool_of(mine: ToolsText, file: ToolsText, name: str) -> ToolsText:
    """Replace a tool of a file by that of another file, add it, or remove it if the other file does not have it."""
    names = names_of(file)
    if name not in names_of(mine):
        return file.without_tool(names.index(name))
    number = names_of(mine).index(name)
    at = names.index(name) if name in names else None
    with suppress(ConfigError):
        merged = file.with_item(mine.lines_of(number), instead_of=at)
        if merged.tools[len(names) if at is None else at :][:1] == (mine.tools[number],):
            return merged
    # The lines merge or repeat what is not in the file, or is something else there.
    return file.with_item(written_lines(mine.tools[number]), instead_of=at)
