"""Results that several tests look at, made once in a run of the tests, by the first worker that needs them.

They are kept by what they were made from, the code apart: nothing is kept from one run to the next, unless
`kit.places` is given a folder that remains.
"""

import hashlib
import tempfile
from collections.abc import Callable
from fcntl import LOCK_EX, flock
from pathlib import Path

from kit.places import FOLDER, SHARED


def kept(inputs: object, make: Callable[[Path], object]) -> Path:
    """The folder that a function fills; workers that need it meanwhile wait for the first.

    Args:
        inputs: All that the content of the folder depends on; its `repr` is the key.
        make: Gets an empty folder, which is moved when it returns.
    """
    folder = SHARED / f"kept-{hashlib.sha256(repr(inputs).encode()).hexdigest()}"
    if not folder.exists():
        with folder.with_suffix(".lock").open("w") as lock:
            flock(lock, LOCK_EX)
            if not folder.exists():
                fresh = Path(tempfile.mkdtemp(dir=FOLDER))
                make(fresh)
                fresh.rename(folder)
    return folder


def identity(asset: Path) -> tuple[str, str]:
    """Name and digest of an asset in one file, to be part of a key."""
    return asset.name, hashlib.sha256(asset.read_bytes()).hexdigest()
