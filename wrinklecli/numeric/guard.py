"""The guard around a command: numbers out of range and lack of memory become errors, and BLAS runs one thread."""

import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from traceback import extract_tb
from typing import TypeAlias

import numpy as np
from threadpoolctl import ThreadpoolController

import wrinklecli
from wrinklecli.errors import AssetError, BakeError, log
from wrinklecli.numeric.memory import allowed_memory, is_lack, keep_freed, shown_bytes

# Called with the name of a stage, steps done and steps in all.
Progress: TypeAlias = Callable[[str, int, int], None]

# The number of imported modules when the libraries of BLAS were looked for, and these libraries.
_known: tuple[int, ThreadpoolController] | None = None


def log_progress(stage: str, done: int, total: int) -> None:
    """Log progress, for a program that asks for it."""
    log("debug", f"{stage}: {done}/{total}")


def one_thread() -> AbstractContextManager[object]:
    """Let BLAS run one thread meanwhile, also in libraries that were imported since the last call."""
    global _known
    # Looking for libraries takes milliseconds, which matter to an edit; a new library comes with a new module.
    count = len(sys.modules)
    if _known is None or _known[0] != count:
        _known = count, ThreadpoolController()
    limits: AbstractContextManager[object] = _known[1].limit(limits=1, user_api="blas")
    return limits


@contextmanager
def guarded(asset: str) -> Iterator[None]:
    """Turn overflow and lack of memory into errors that name the asset: NaN would go unnoticed into the file.

    BLAS runs one thread meanwhile: with several, the last bits of sums, and so of files, would vary, and threads of
    small products wait for each other longer than they work.

    Raises:
        AssetError: A number overflowed or is undefined.
        BakeError: There is too little memory.
    """
    keep_freed()
    try:
        with np.errstate(all="raise", under="ignore"), one_thread():
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        message = (
            "holds numbers, or the tools file does, that are too large or too small to compute with"
            f" ({error}, {_place_of(error)}); if they look right, it is a fault of wrinkle's"
        )
        raise AssetError(message, where=asset) from error
    except (MemoryError, ImportError) as error:
        if not is_lack(error):
            raise
        # The system refuses numpy's arrays before they are filled, whichever step asks for one.
        shape, dtype = getattr(error, "shape", None), getattr(error, "dtype", None)
        need = "more" if shape is None or dtype is None else f"{shown_bytes(math.prod(shape) * dtype.itemsize)} more"
        limit = "" if (most := allowed_memory()) is None else f" ({shown_bytes(most)})"
        message = (
            f"takes more memory than there is, or than --max-memory allows{limit}: {_place_of(error)} needs {need}"
        )
        raise BakeError(message, where=asset) from error


def _place_of(error: BaseException) -> str:
    """The function of this package, with its line, from which an error came."""
    package = os.path.dirname(wrinklecli.__file__)
    own = (each for each in extract_tb(error.__traceback__) if each.filename.startswith(package))
    # A `<lambda>` says nothing, nor does what only asks for room.
    *_, last = (each for each in own if not each.name.startswith("<") and each.name not in ("leave_room", "start_blas"))
    return f"{last.name} ({os.path.relpath(last.filename, package)}:{last.lineno})"
