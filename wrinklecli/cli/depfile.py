"""The file of `--depfile`: what an output depends on, as rules for Make and Ninja."""

from collections.abc import Iterable


def dependencies(target: str, inputs: Iterable[str]) -> str:
    """A Make rule that rebuilds the target when an input changes, and an empty rule for each input.

    The empty rules keep Make going when an input is renamed.
    """
    escaped = [_escape(path) for path in dict.fromkeys(inputs)]
    return f"{_escape(target)}: {' '.join(escaped)}\n" + "".join(f"\n{path}:\n" for path in escaped)


def _escape(path: str) -> str:
    """A path in a Make rule: a space, # and the backslashes before them escaped, $ doubled."""
    escaped: list[str] = []
    for c in path:
        if c in " #\t":
            backslashes = len(escaped)
            while backslashes and escaped[backslashes - 1] == "\\":
                backslashes -= 1
            escaped += ["\\"] * (len(escaped) - backslashes) + ["\\", c]
        else:
            escaped.append("$$" if c == "$" else c)
    return "".join(escaped)
