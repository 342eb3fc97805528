"""The file of `--depfile`: what an output depends on, as rules for Make and Ninja.

Source: GNU Make manual, §3.1.1 (splitting lines), §4.2 (rule syntax), §4.4 (wildcards); Ninja's depfile_parser.in.cc,
which reads a part of Make's quoting (& ' " since Ninja 1.12). What both were seen to read: `tests/cli/test_depfile.py`.
"""

import os
import re
from collections.abc import Iterable

from wrinklecli.errors import WrinkleError

# Control characters, wildcards, and characters that end a list of files or have a meaning in Make or Ninja.
_NOT_CARRIED = re.compile(r"[\x00-\x1f\x7f*?\[;|<>^`]")
# A backslash before a character that is itself quoted; names that one of the two drops, looks up elsewhere or assigns.
_NOT_CARRIED_AT = re.compile(r"\\[#:$=]|[ :\\)]$|^(\./+)*(~|-l|\.[A-Z_]+$)|^[+!]?=|^$")
# A target that would be a pattern, a variable, a group of targets, or an option of Make.
_NO_TARGET = re.compile(r"[%=]|&$|^(\./+)*\.[^/]*$")
# These words make the word behind them a variable if it has a =.
_MODIFIERS = {"define", "export", "override", "private", "undefine", "unexport"}


def dependencies(target: str, inputs: Iterable[str]) -> bytes:
    """Write a Make rule that rebuilds the target when an input changes, and an empty rule for each input.

    The empty rules keep Make going when an input is renamed; a path that means something else there has none.

    Raises:
        WrinkleError: Make or Ninja would take a path for something else, however it is quoted.
    """
    paths = list(dict.fromkeys(inputs))
    # `target: a=b` sets a variable, but `target: c a=b` does not.
    paths.sort(key=lambda path: "=" in path or path in _MODIFIERS)
    for path in (target, *paths):
        if _NOT_CARRIED.search(path) or _NOT_CARRIED_AT.search(path):
            raise _refusal(path)
    if _NO_TARGET.search(target):
        raise _refusal(target)
    if any("=" in path for path in paths) and ("=" in paths[0] or paths[0] in _MODIFIERS):
        raise _refusal(next(path for path in paths if "=" in path))
    rules = [f"{_escape(target)}: {' '.join(map(_escape, paths))}\n"]
    rules += [f"\n{_escape(path)}:\n" for path in paths if not _NO_TARGET.search(path)]
    return os.fsencode("".join(rules))


def _refusal(path: str) -> WrinkleError:
    return WrinkleError("is a name that Make or Ninja cannot read from --depfile; rename it", where=path)


def _escape(path: str) -> str:
    """Quote a path for a Make rule: spaces (with backslashes before them), # and : by backslashes, $ by another $."""
    return re.sub(r"(\\*) ", r"\1\1\\ ", path).replace("$", "$$").replace("#", r"\#").replace(":", r"\:")
