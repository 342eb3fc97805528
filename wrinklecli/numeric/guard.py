"""The guard around a command: numbers out of range and lack of memory become errors, and BLAS runs one thread."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from traceback import extract_tb
from typing import TypeAlias

import numpy as np
from threadpoolctl import ThreadpoolController

import wrinklecli
from wrinklecli.errors import AssetError, BakeError

# Called with a stage's name, steps done and steps in all.
Progress: TypeAlias = Callable[[str, int, int], None]

# The libraries of BLAS, as they were found when so many modules had been imported.
_known: tuple[int, ThreadpoolController] | None = None


def no_progress(_stage: str, _done: int, _total: int) -> None:
    """A `Progress` that tells nobody."""


def one_thread() -> AbstractContextManager[object]:
    """BLAS runs one thread meanwhile, that of libraries too that were imported since `guarded` looked for them."""
    global _known
    # To look for libraries takes milliseconds, which an edit has few of; none comes without a module.
    count = len(sys.modules)
    if _known is None or _known[0] != count:
        _known = count, ThreadpoolController()
    limits: AbstractContextManager[object] = _known[1].limit(limits=1, user_api="blas")
    return limits


@contextmanager
def guarded(asset: str) -> Iterator[None]:
    """Stop where numbers leave the range of floats or memory ends, and say so: NaN would go unseen into the file.

    BLAS runs one thread meanwhile: with several, sums change their last bits, and files with them; and threads of
    small products wait for each other longer than they work.

    Args:
        asset: Path of the file that is worked on, for the message.

    Raises:
        AssetError: A number overflowed or has no value.
        BakeError: There is too little memory.
    """
    try:
        with np.errstate(all="raise", under="ignore"), one_thread():
            yield
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        own = [
            each
            for each in extract_tb(error.__traceback__)
            if each.filename.startswith(os.path.dirname(wrinklecli.__file__))
        ]
        place = f", {os.path.basename(own[-1].filename)}:{own[-1].lineno}" if own else ""
        message = (
            "holds numbers, or the tools file does, that are too large or too small to compute with"
            f" ({error}{place}); if they look right, it is a fault of wrinkle's"
        )
        raise AssetError(message, where=asset) from error
    except MemoryError as error:
        raise BakeError("takes more memory than there is, or than --max-memory allows", where=asset) from error
