"""Keeps the inputs of a run apart from its outputs, and outputs from each other, by whatever names the files have."""

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Generic, TypeAlias, TypeVar

from wrinklecli.frozen import dataclass

Identity: TypeAlias = tuple[int | str, ...]
"""Device and inode of a file; or of the nearest folder above it that exists, and the names from there."""

Owner = TypeVar("Owner")


def is_path(text: str) -> bool:
    """True if a file may have this path: it has no null character, and no half of a character."""
    try:
        return b"\0" not in os.fsencode(text)
    except UnicodeEncodeError:
        return False


@dataclass(frozen=True, slots=True)
class Clash(Generic[Owner]):
    """An output that is also an input or another output.

    Attributes:
        output: Path of the output, as it was given.
        writer: Owner of the output.
        other: Owner of the input or of the other output.
        is_input: True if the output is also an input.
    """

    output: str
    writer: Owner
    other: Owner
    is_input: bool


class Identities:
    """Identities of files, which need not exist. Each folder is looked up once, so that many files take little time.

    `have_several_names` is True if a file that was looked up has hard links.
    """

    def __init__(self) -> None:
        self.have_several_names = False
        self._folders: dict[str, tuple[str, Identity]] = {}

    def of(self, path: str) -> tuple[Identity, ...]:
        """Every identity of a file: two paths name one file if they share one.

        Devices and pipes have none, as several outputs may go there.
        """
        return self.look_up(path)[1]

    def look_up(self, path: str) -> tuple[str, tuple[Identity, ...]]:
        """The real path of the folder that a file is in, and every identity of the file."""
        folder, name = os.path.split(path)
        if name in ("", os.curdir, os.pardir) or not is_path(path):
            real, known = self._folder(path)
            return os.path.dirname(real), (known,)
        real, known = self._folder(folder)
        found = os.path.join(real, name)
        try:
            status = os.lstat(found)
        except OSError:
            return real, ((*known, name),)
        if stat.S_ISLNK(status.st_mode):
            target = os.path.realpath(found)
            return (real, ((*known, name),)) if os.path.islink(target) else self.look_up(target)  # a loop stays one
        if stat.S_ISCHR(status.st_mode) or stat.S_ISFIFO(status.st_mode):
            return real, ()
        self.have_several_names |= status.st_nlink > 1 and stat.S_ISREG(status.st_mode)
        return real, ((*known, name), (status.st_dev, status.st_ino))

    def of_folder(self, folder: str) -> Identity:
        """The identity of a folder."""
        return self._folder(folder)[1]

    def upwards(self, folder: str) -> Iterator[Identity]:
        """The identity of a folder and of each one above it."""
        real, known = self._folder(folder)
        yield known
        while (upper := os.path.dirname(real)) != real:
            real, known = self._folder(upper)
            yield known

    def _folder(self, folder: str) -> tuple[str, Identity]:
        """Real path and identity of a folder."""
        if folder not in self._folders:
            self._folders[folder] = self._look_up(folder)
        return self._folders[folder]

    def _look_up(self, folder: str) -> tuple[str, Identity]:
        if not is_path(folder):
            return folder, (folder,)
        real = os.path.realpath(folder or os.curdir)
        with suppress(OSError):
            status = os.stat(real)
            return real, (status.st_dev, status.st_ino)
        upper, name = os.path.split(real)
        return real, (*self._folder(upper)[1], name) if upper != real else (real,)


class Claims(Generic[Owner]):
    """The inputs and outputs of a run, each with its owner.

    `identify` gives the identities of a path; by default it is a local path.
    """

    def __init__(self, identify: Callable[[str], tuple[Identity, ...]] | None = None) -> None:
        self._identify = identify or Identities().of
        self._inputs: dict[Identity, Owner] = {}
        self._outputs: dict[Identity, tuple[str, Owner]] = {}

    def add_input(self, path: str, owner: Owner) -> Clash[Owner] | None:
        """Note that a file is read, and return the first clash with an output."""
        clashes: list[Clash[Owner]] = []
        for each in self._identify(path):
            self._inputs.setdefault(each, owner)
            if each in self._outputs:
                clashes.append(Clash(*self._outputs[each], owner, is_input=True))
        return clashes[0] if clashes else None

    def add_output(self, path: str, owner: Owner) -> Clash[Owner] | None:
        """Note that a file is written, and return the first clash with an input or another output."""
        identities = self._identify(path)
        clashes = [Clash(path, owner, self._inputs[each], is_input=True) for each in identities if each in self._inputs]
        for each in identities:
            if each in self._outputs:
                clashes.append(Clash(path, owner, self._outputs[each][1], is_input=False))
            self._outputs.setdefault(each, (path, owner))
        return clashes[0] if clashes else None

    def owner_of(self, path: str) -> Owner | None:
        """The owner of an input, or else of an output; None if the file is neither."""
        identities = self._identify(path)
        owners = [self._inputs[each] for each in identities if each in self._inputs]
        owners += [self._outputs[each][1] for each in identities if each in self._outputs]
        return owners[0] if owners else None
