"""The side file `.NAME.unsaved` beside a tools file, which keeps unsaved text and the text that its edits began with.

Anybody who may write to the folder may put something else in its place. So only a file that this user's editor has
written is read, replaced or removed, and the new file takes its name: nothing is ever written through a link.
"""

import json
import os
import stat
from contextlib import suppress
from functools import partial
from typing import Any, BinaryIO

from wrinklecli.errors import ConfigError
from wrinklecli.files.workplace import Workplace
from wrinklecli.tools.yaml_tree import MAX_BYTES

_VERSION = 1  # of the format
_START = f'{{"wrinkle_edit": {_VERSION}, '.encode()  # each side file begins with these bytes
_MAX_BYTES = 13 * MAX_BYTES  # two texts, where JSON takes at most six bytes for a character, and the keys
_MODE = 0o600  # the tools file may be nobody else's business
# The open neither follows a link nor waits for a pipe. Windows has no such flags.
_FLAGS = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


class SideFile:
    """The side file of the tools file at a path. A method raises ConfigError if something else has its name."""

    def __init__(self, tools: str) -> None:
        folder, name = os.path.split(tools)
        self.path = os.path.join(folder, f".{name}.unsaved")

    def read(self) -> tuple[str, str] | None:
        """Read the text that the unsaved edits began with, and the edited text; None if there is no side file.

        A damaged side file is set aside, and ConfigError says where it is.
        """
        file = self._opened()
        if file is None:
            return None
        with file:
            data = file.read(_MAX_BYTES + 1)
        try:
            kept: Any = json.loads(data)
            base, text = kept["base"], kept["text"]
        except (ValueError, KeyError, RecursionError):
            base = text = None
        if not isinstance(base, str) or not isinstance(text, str):
            raise ConfigError(f"is damaged, and is {self.set_aside()} now", where=self.path)
        return base, text

    def write(self, base: str, text: str) -> None:
        """Replace the side file; ConfigError also if the folder or the disk does not take it."""
        self._check()
        data = json.dumps({"wrinkle_edit": _VERSION, "base": base, "text": text}).encode()
        place = Workplace(os.path.dirname(self.path) or os.curdir)
        try:
            place.make()
            staged = place.next_path()
            with open(staged, "xb", opener=partial(os.open, mode=_MODE)) as file:
                file.write(data)
            os.replace(staged, self.path)
        except OSError as error:
            raise self._refusal(f"cannot be written: {error.strerror}") from None
        finally:
            place.remove()

    def remove(self) -> None:
        """Remove the side file, if there is one."""
        with suppress(OSError, ConfigError):
            self._check()
            os.unlink(self.path)

    def set_aside(self) -> str:
        """Rename the side file, whatever it holds, to a name that is free, and return that; ConfigError if it fails."""
        self._check()
        number = 1
        while os.path.lexists(aside := f"{self.path}.{number}"):
            number += 1
        try:
            os.rename(self.path, aside)
        except OSError as error:
            raise self._refusal(f"cannot be renamed: {error.strerror}") from None
        return aside

    def _check(self) -> None:
        """Raise ConfigError if something else has the name of the side file."""
        file = self._opened()
        if file is not None:
            file.close()

    def _opened(self) -> BinaryIO | None:
        """Open the side file to read; None if nothing has its name."""
        try:
            # Windows opens links, so they are looked for as well.
            if stat.S_ISLNK(os.lstat(self.path).st_mode):
                raise self._refusal("is a link")
            file = open(self.path, "rb", opener=lambda path, flags: os.open(path, flags | _FLAGS))  # noqa: SIM115
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._refusal(f"cannot be read: {error.strerror}") from None
        try:
            self._refuse_others(os.fstat(file.fileno()))
            if file.read(len(_START)) != _START:
                raise self._refusal("is not a file of wrinkle edit, or one of another version")
            file.seek(0)
        except BaseException:
            file.close()
            raise
        return file

    def _refuse_others(self, status: os.stat_result) -> None:
        if not stat.S_ISREG(status.st_mode):
            raise self._refusal("is not a regular file")
        if hasattr(os, "geteuid") and status.st_uid != os.geteuid():
            raise self._refusal("is the file of another user")
        if status.st_size > _MAX_BYTES:
            raise self._refusal(f"is larger than {_MAX_BYTES // 1_000_000} MB")

    def _refusal(self, reason: str) -> ConfigError:
        return ConfigError(f"{reason}: unsaved edits are not kept there, and a crash loses them", where=self.path)
