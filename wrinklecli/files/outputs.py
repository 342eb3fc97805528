"""Outputs of a command: files that are all written, or none.

Each is written into a folder of this run's, `.wrinkle-…`, beside its destination. When all of them are there, they are
renamed into their places, the main ones last. So a file is whole at any moment; where something fails, and where a
signal ends the run before the renaming, all is as it was. Killed outright amid the renaming, which no system does of
several files at once, a run leaves some old and some new, the last main output old; its folder is taken away by a later
one.
"""

import errno
import os
import re
import stat
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass
from itertools import chain
from types import TracebackType
from typing import IO, TypeAlias

from wrinklecli.errors import BakeError
from wrinklecli.files.workplace import Workplace

Write: TypeAlias = Callable[[IO[bytes]], object]
# By which a file is known: its real path, and device and inode where it is there.
_Identity: TypeAlias = str | tuple[int, int]


@dataclass(slots=True)
class _Output:
    """A file to be.

    Attributes:
        path: As the user typed it.
        target: Its real path, so that a link stays one.
        through: What is there is a device or a pipe, which is written to and not replaced.
        staged: Where it is meanwhile; none before it is written.
        last: Whether it is put into its place after those that are not.
    """

    path: str
    target: str
    through: bool
    staged: str | None = None
    last: bool = False


class Outputs:
    """The files that a command writes. With `with`: in their places when the block ends, nowhere if it raises.

    Args:
        at_commit: Called when all are written, before the first is put into its place.
    """

    def __init__(self, *, at_commit: Callable[[], object] = lambda: None) -> None:
        self._at_commit = at_commit
        self._inputs: set[_Identity] = set()
        self._outputs: dict[str, list[_Output]] = {}  # by real path; several of what is written through
        self._claimed: set[_Identity] = set()
        self._dropped: list[str] = []
        self._own: set[str] = set()
        self._folders: list[str] = []  # that were made, outermost first
        self._workplaces: dict[str, Workplace] = {}  # by the folder that each is in

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(self, kind: type[BaseException] | None, _error: object, _trace: TracebackType | None) -> None:
        try:
            if kind is None:
                self._commit()
        finally:
            self.discard()

    def protect(self, inputs: Iterable[str | os.PathLike[str]]) -> None:
        """Never write over these files, nor drop them.

        Raises:
            BakeError: An output is one of them, by whatever name.
        """
        for path in inputs:
            if "\0" not in os.fspath(path) and os.path.exists(path):  # what is not there cannot be overwritten
                self._inputs |= _identities(path)
        for output in chain.from_iterable(self._outputs.values()):
            self._refuse_input(output)

    def claim(self, path: str | os.PathLike[str]) -> None:
        """Say that a file will be written: what is wrong with its path is found before the work is done.

        Raises:
            BakeError: It is an input or another output, or it cannot be written there.
        """
        self._claim(os.fspath(path))

    def add(self, path: str | os.PathLike[str], write: Write, *, last: bool = False, durable: bool = True) -> int:
        """Write a file, claimed or not; its size in bytes.

        Args:
            path: Where it will be.
            write: Called with the open file.
            last: It is a main output, put into its place after those that are not.
            durable: Wait until the disk has it. Of a thousand files that takes longer than to write them.

        Raises:
            BakeError: As `claim`, or the disk is full.
        """
        claimed = self._outputs.get(_real(os.fspath(path)), ())
        output = next((each for each in claimed if each.staged is None), None) or self._claim(os.fspath(path))
        try:
            staged = self._workplace(output).next_path()
            with open(staged, "xb") as file:
                write(file)
                file.flush()
                if durable:
                    os.fsync(file.fileno())
                size = file.tell()
        except OSError as error:
            raise _unwritable(path, error) from error
        output.staged, output.last = staged, last
        return size

    def add_bytes(
        self, path: str | os.PathLike[str], data: bytes | memoryview, *, last: bool = False, durable: bool = True
    ) -> int:
        """Write a file with this content, as `add` does."""
        return self.add(path, lambda file: file.write(data), last=last, durable=durable)

    @property
    def written(self) -> list[str]:
        """The files that have got a content, as they were named; when it is over, those that are in their places."""
        return [each.path for each in chain.from_iterable(self._outputs.values()) if each.staged]

    def found(self, path: str | os.PathLike[str]) -> str | None:
        """The file with the content that a path will have: written here, or there before."""
        written = [each.staged for each in self._outputs.get(_real(os.fspath(path)), ()) if each.staged]
        return written[0] if written else os.fspath(path) if os.path.exists(path) else None

    def own(self, paths: Iterable[str]) -> None:
        """Note files that an earlier run wrote for the same, which may be replaced though they hold something else."""
        self._own |= set(map(_real, paths))

    def is_own(self, path: str) -> bool:
        """Whether a file is one of those, and not written here."""
        return _real(path) in self._own and self.found(path) == path

    def make_folders(self, path: str | os.PathLike[str]) -> None:
        """Make a folder and those above it; where the outputs come to nothing, they go again.

        Raises:
            BakeError: One cannot be made.
        """
        path = os.fspath(path)
        if not path or os.path.isdir(path):
            return
        self.make_folders(os.path.dirname(path))
        if os.path.isdir(path):  # `a/..`, by making `a`
            return
        self._folders.append(path)
        try:
            os.mkdir(path)
        except OSError as error:
            self._folders.remove(path)
            if not os.path.isdir(path):  # another process has made it meanwhile
                raise _unwritable(path, error) from error

    def drop(self, path: str) -> None:
        """Take a file away when the others are in their places, unless it is an input or one of them."""
        self._dropped.append(path)

    def discard(self) -> None:
        """Take away all that was made and is not in its place. It may be called at any moment, from a signal too."""
        for workplace in self._workplaces.values():
            workplace.remove()
        for folder in reversed(self._folders):
            with suppress(OSError):  # others have put something into it
                os.rmdir(folder)

    def _claim(self, path: str) -> _Output:
        try:
            output = _Output(path, os.path.realpath(path), through=_is_written_through(path))
            identities = _identities(path)
            if not output.through:
                self._refuse_input(output)
                if identities & self._claimed:
                    raise BakeError("is another output too: each needs a name of its own", where=path)
                _refuse_folder(os.path.dirname(output.target))
                self._claimed |= identities
        except (OSError, ValueError) as error:
            raise _unwritable(path, error) from error
        self._outputs.setdefault(output.target, []).append(output)
        return output

    def _refuse_input(self, output: _Output) -> None:
        if not output.through and _identities(output.path) & self._inputs:
            raise BakeError("is an input too and would be overwritten", where=output.path)

    def _workplace(self, output: _Output) -> Workplace:
        """Where an output is written to: a folder on the same disk, or, for a device or a pipe, any."""
        if output.through:
            import tempfile

            folder = tempfile.gettempdir()
        else:
            folder = os.path.dirname(output.target)
        if folder not in self._workplaces:
            self._workplaces[folder] = Workplace(folder)
            self._workplaces[folder].make()
        return self._workplaces[folder]

    def _commit(self) -> None:
        """Put all files into their places, or none."""
        every = chain.from_iterable(self._outputs.values())
        written = sorted((each for each in every if each.staged), key=lambda each: each.last)
        for output in written:
            try:
                if output.through:
                    _write_through(output)
                else:
                    _keep_mode_and_owner(output)
            except OSError as error:
                raise _unwritable(output.path, error) from error
        self._at_commit()
        self._rename([each for each in written if not each.through])
        self._folders.clear()
        kept = self._inputs | self._claimed
        for path in self._dropped:
            if not _identities(path) & kept:
                with suppress(OSError):
                    os.unlink(path)

    def _rename(self, outputs: list[_Output]) -> None:
        begun: list[tuple[_Output, str]] = []
        try:
            for output in outputs:
                old = self._workplace(output).next_path()
                begun.append((output, old))
                if output is not outputs[-1]:
                    _keep_copy(output.target, old)
                os.replace(str(output.staged), output.target)
        except BaseException as error:
            if os.path.exists(str(outputs[-1].staged)):  # else all are in their places
                for output, old in reversed(begun):
                    _take_back(output, old)
            if isinstance(error, OSError):
                raise _unwritable(begun[-1][0].path, error) from error
            raise


def part_of(outputs: Outputs | None) -> AbstractContextManager[Outputs]:
    """With `with`: outputs that a caller puts into their places; for none, own ones, which are there at its end."""
    return Outputs() if outputs is None else nullcontext(outputs)


def _identities(path: str | os.PathLike[str]) -> set[_Identity]:
    found: set[_Identity] = {_real(os.fspath(path))}
    with suppress(OSError, ValueError):
        status = os.stat(path)
        found.add((status.st_dev, status.st_ino))
    return found


def _real(path: str) -> str:
    return path if "\0" in path else os.path.realpath(path)


def _unwritable(path: str | os.PathLike[str], error: OSError | ValueError) -> BakeError:
    reason = error.strerror if isinstance(error, OSError) else None
    return BakeError(f"cannot be written: {reason or error}", where=os.fspath(path))


def _is_written_through(path: str) -> bool:
    """Whether a path names a device or a pipe, or what this process has as a standard stream.

    Raises:
        OSError: It names something else that is no regular file.
    """
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return False
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if stat.S_ISCHR(mode) or stat.S_ISFIFO(mode) or _open_descriptor(path) is not None:
        return True
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is neither a file, nor a pipe, nor a character device")
    return False


def _open_descriptor(path: str) -> int | None:
    """The descriptor of this process that a path stands for: its file may be one that a shell appends to."""
    named = re.fullmatch(r"/(?:dev|proc/self)/fd/(\d+)", os.path.abspath(path))
    numbers = [1, 2, int(named[1])] if named else [1, 2]
    for descriptor in numbers:
        with suppress(OSError):
            if os.path.samestat(os.stat(path), os.fstat(descriptor)):
                return descriptor
    return None


def _refuse_folder(folder: str) -> None:
    """Check that files can be put into a folder.

    Raises:
        OSError: They cannot.
    """
    if not stat.S_ISDIR(os.stat(folder).st_mode):
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))


def _write_through(output: _Output) -> None:
    """Copy a file to the device or pipe that is there."""
    import shutil

    number = _open_descriptor(output.path)
    descriptor = os.open(output.path, os.O_WRONLY) if number is None else os.dup(number)
    with open(str(output.staged), "rb") as source, open(descriptor, "wb") as target:
        shutil.copyfileobj(source, target)


def _keep_mode_and_owner(output: _Output) -> None:
    """Give a file those of the one that it will replace, as far as that is allowed."""
    try:
        old, new = os.stat(output.target), os.stat(str(output.staged))
    except FileNotFoundError:
        return
    mode = old.st_mode & 0o777
    if hasattr(os, "chown") and (old.st_uid, old.st_gid) != (new.st_uid, new.st_gid):
        try:
            os.chown(str(output.staged), old.st_uid, old.st_gid)
        except OSError:
            try:
                os.chown(str(output.staged), -1, old.st_gid)
            except OSError:  # another group gets no more than all others
                mode &= 0o707 | (mode & 0o007) << 3
    os.chmod(str(output.staged), mode)


def _keep_copy(path: str, copy: str) -> None:
    """Give a file, if it is there, a second name; where the disk has no links, copy it."""
    if not os.path.exists(path):
        return
    try:
        os.link(path, copy)
    except OSError:
        import shutil

        shutil.copy2(path, copy)


def _take_back(output: _Output, old: str) -> None:
    """Undo a renaming, if it was done."""
    with suppress(OSError):
        if not os.path.exists(str(output.staged)):
            os.replace(old, output.target) if os.path.exists(old) else os.unlink(output.target)
