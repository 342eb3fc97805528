"""The errors that users can mend: one flat tree, which the command line turns into lines and exit codes."""

import re
import sys
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Literal, TypeVar

SHOWN = 40  # characters of a value that a message repeats
_LONGEST = 600  # characters of a message, and of its place
_MOST_LINES = 50  # lines of an error: a screen; who mends these sees the others
_MOST_LISTED = 20  # names in a message
_MOST_NAMES = 1000  # among which a hint is searched
_LONGEST_NAME = 100  # characters of a name for a hint; people type no longer ones
_MIRRORED = re.compile(r" \(mirrored as .*?\)")  # what the place of a tool's other side has beside its own

Item = TypeVar("Item")
Made = TypeVar("Made")


class WrinkleError(Exception):
    """A fault of the input, printed as `where: message`, with a line for each problem.

    Args:
        message: The value that was found, and the values that are accepted.
        where: File, line and path, such as `tools.yaml:12: tools[2].strategy` or
            `hand.glb#/meshes/0/primitives/1`.

    Attributes:
        lines: The lines to print.
        places: `where` of each line.
        more: The number of problems that have no line; the last line says so.
    """

    exit_code = 1

    def __init__(self, message: str, *, where: str = "") -> None:
        super().__init__(message)
        line = shortened(message, _LONGEST)
        self.lines: tuple[str, ...] = (f"{shortened(where, _LONGEST)}: {line}" if where else line,)
        self.places: tuple[str, ...] = (where,)
        self.more = 0

    def __str__(self) -> str:
        return "\n".join(self.lines)

    @classmethod
    def of_all(cls, problems: Iterable["WrinkleError"]) -> "WrinkleError":
        """One error that reports all the problems at once, a line each.

        A problem of many tools has one line, and so has a problem of both sides of a mirrored tool.

        Of very many lines, the first are kept and the others are counted: a generator of problems takes no memory.
        """
        error, kept, more = cls(""), dict[tuple[str, str], tuple[str, str]](), 0
        for each in problems:
            pairs = list(zip(each.places, each.lines, strict=True))
            for place, line in pairs[:-1] if each.more else pairs:
                said = (_MIRRORED.sub("", place), _MIRRORED.sub("", line))
                if len(kept) < _MOST_LINES:
                    kept.setdefault(said, (place, line))
                else:
                    more += said not in kept
            more += each.more
        if more:
            kept["", ""] = ("", f"and {more:,} more")
        error.places, error.lines, error.more = *zip(*kept.values(), strict=True), more
        return error

    @classmethod
    def every(cls, make: Callable[[Item], Made], items: Iterable[Item]) -> list[Made]:
        """Make something of every item.

        Raises:
            WrinkleError: Some cannot be made; it has the problems of all items.
        """
        found: list[Made] = []
        problems: list[WrinkleError] = []
        for item in items:
            try:
                found.append(make(item))
            except WrinkleError as error:
                problems.append(error)
        if problems:
            # A fault of the whole file is a fault of each item.
            raise problems[0] if len({str(each) for each in problems}) == 1 else cls.of_all(problems)
        return found

    @classmethod
    def unless_known(cls, what: str, asked: Iterable[str], known: Collection[str], *, where: str) -> None:
        """Raise an error, in the words of `unknown`, for the first name asked for that is not known."""
        for name in asked:
            if name not in known:
                raise cls(unknown(what, name, known), where=where)


class ConfigError(WrinkleError):
    """The tools file is at fault."""


class AssetError(WrinkleError):
    """The glTF asset is at fault."""


class TooMuchError(WrinkleError):
    """A command would take more memory than `--max-memory` allows."""


class BakeError(WrinkleError):
    """Tools and asset do not go together, or the result cannot be written."""


class RefusedError(BakeError):
    """The result exceeds a limit that the user has set (`--max-error`, `--strict`)."""

    exit_code = 3


def refuse_warnings(warnings: Sequence[str], *, where: str, shown: bool = False) -> None:
    """Refuse what has warnings, as `--strict` asks: a line for each, unless they are `shown` already, and one for why.

    Raises:
        RefusedError: There is a warning.
    """
    if warnings:
        lines = [] if shown else [RefusedError(f"warning: {line}") for line in warnings]
        why = RefusedError(f"refused by --strict: {counted(len(warnings), 'warning')}", where=where)
        raise RefusedError.of_all([*lines, why])


def log(level: Literal["debug", "info", "warning"], line: str) -> None:
    """Log a line as `wrinklecli`, unless the program has not imported `logging`, so that nobody listens."""
    if (logging := sys.modules.get("logging")) is not None:
        logger = logging.getLogger("wrinklecli")
        if not logger.handlers:  # otherwise Python prints warnings itself
            logger.addHandler(logging.NullHandler())
        # Names of files may hold bytes that are no text, which handlers cannot write.
        getattr(logger, level)(line.encode(errors="backslashreplace").decode())


def log_findings(warnings: Iterable[str], notes: Iterable[str] = (), *, where: str) -> None:
    """Log the warnings and notes that a function returns."""
    for warning in warnings:
        log("warning", f"{where}: {warning}")
    for note in notes:
        log("info", f"{where}: {note}")


def shortened(text: str, longest: int) -> str:
    """Cut the middle out of text that is longer than `longest` characters."""
    half = longest // 2
    return text if len(text) <= longest else f"{text[:half]} … {text[-half:]}"


def listed(names: Iterable[str]) -> str:
    """Write names for a message: `'bend', 'fist'`, or `none`. Many names are cut to the first and a number."""
    shown = [repr(name) for name in names]
    more = [f"{len(shown) - _MOST_LISTED:,} more"] if len(shown) > _MOST_LISTED + 1 else []
    return ", ".join([*shown[: _MOST_LISTED + 1 - len(more)], *more]) or "none"


def counted(count: int, one: str, many: str = "") -> str:
    """Write a number of things for a message: `1 key`, `2 keys`. `many` is the plural if it needs more than an s."""
    return f"{count:,} {one if count == 1 else many or one + 's'}"


def megabytes(count: int) -> str:
    """Write bytes for a table or a sentence that compares them: `12.3 MB`."""
    return f"{count / 1e6:.1f} MB"


def aligned(rows: Sequence[Sequence[str]], texts: int) -> list[str]:
    """Align a table, a line for each row. The first `texts` columns stand to the left, numbers to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = "<" * texts + ">" * (len(widths) - texts)
    shapes = [f"{{:{side}{width}}}" for side, width in zip(sides, widths, strict=True)]
    return ["  ".join(shapes).format(*row).rstrip() for row in rows]


def nearest(name: str, names: Iterable[str]) -> str:
    """Write a hint for a message, `; did you mean 'wrist'?`, or nothing if no known name is near."""
    import difflib

    # The comparison takes time by the square of the length.
    short = [each for each in names if len(each) <= _LONGEST_NAME][:_MOST_NAMES]
    near = difflib.get_close_matches(name[:_LONGEST_NAME], short, 1)
    return f"; did you mean {near[0]!r}?" if near else ""


def unknown(what: str, name: str, names: Collection[str]) -> str:
    """Write that nothing has a name, what is near, and what there is: `no clip 'bent'; …`."""
    return f"{what} {name!r}{nearest(name, names)}; there are {listed(names)}"
