"""The side file of a tools file, which keeps unsaved text and the text that its edits began with.

It lies in a folder of the user's own, where nobody else puts anything, and not beside the tools file.
"""

import hashlib
import json
import os
from contextlib import suppress
from itertools import count
from typing import Any

from wrinklecli.errors import ConfigError, WrinkleError
from wrinklecli.files.outputs import Outputs


class SideFile:
    """The side file of the tools file at a path, in a folder."""

    def __init__(self, folder: str, tools: str) -> None:
        place = hashlib.sha256(os.fsencode(os.path.realpath(tools))).hexdigest()[:16]
        self.path = os.path.join(folder, f"{os.path.basename(tools)}.{place}.unsaved")

    def read(self) -> tuple[str, str] | None:
        """Read the text that the unsaved edits began with, and the edited text; None if there is no side file.

        A damaged side file is set aside, and ConfigError says where it is.
        """
        base: Any = None
        text: Any = None
        try:
            with open(self.path, "rb") as file:
                kept = json.load(file)
                base, text = kept["base"], kept["text"]
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._refusal(f"cannot be read: {error.strerror}") from None
        except (ValueError, LookupError, TypeError, RecursionError):
            pass
        if not isinstance(base, str) or not isinstance(text, str):
            raise ConfigError(f"is damaged, and is {self.set_aside()} now", where=self.path)
        return base, text

    def write(self, base: str, text: str) -> None:
        """Replace the side file; ConfigError if the folder or the disk does not take it."""
        try:
            os.makedirs(os.path.dirname(self.path), mode=0o700, exist_ok=True)
            with Outputs() as outputs:
                outputs.add_bytes(self.path, json.dumps({"base": base, "text": text}).encode(), durable=False)
        except OSError as error:
            raise self._refusal(f"cannot be written: {error.strerror}") from None
        except WrinkleError as error:
            raise self._refusal(error.lines[0].removeprefix(f"{self.path}: ")) from None

    def remove(self) -> None:
        """Remove the side file, if there is one."""
        with suppress(OSError):
            os.unlink(self.path)

    def set_aside(self) -> str:
        """Rename the side file, whatever it holds, to a name that is free, and return that; ConfigError if it fails."""
        aside = next(each for number in count(1) if not os.path.lexists(each := f"{self.path}.{number}"))
        try:
            os.rename(self.path, aside)
        except OSError as error:
            raise self._refusal(f"cannot be renamed: {error.strerror}") from None
        return aside

    def _refusal(self, reason: str) -> ConfigError:
        return ConfigError(f"{reason}: unsaved edits are not kept there, and a crash loses them", where=self.path)
