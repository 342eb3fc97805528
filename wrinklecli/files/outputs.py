"""Writes the outputs of a command: all files, or none.

Each file is written into a folder of this run, `.wrinkle-…`, beside its destination. When all are complete, they are
renamed to their destinations, the main ones last. So a file is complete at any moment, and an error, or a signal before
the renaming, changes nothing. Runs that end at once rename one after another, as each locks the folders, so that the
files are those of one of them. If a run is killed during the renaming, which no system does for several files at once,
some files are old and some new, the last main output old; a later run removes its folder.
"""

import errno
import os
import re
import stat
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, ExitStack, nullcontext, suppress
from itertools import chain
from types import TracebackType
from typing import IO, TypeAlias

from wrinklecli.errors import BakeError, log
from wrinklecli.files.claims import Claims, Clash
from wrinklecli.files.workplace import Workplace, locked
from wrinklecli.frozen import dataclass

Write: TypeAlias = Callable[[IO[bytes]], object]


@dataclass(slots=True)
class _Output:
    """A future file.

    Attributes:
        path: The path that the user typed.
        target: The real path, so that a link stays a link.
        through: True for a device or a pipe, which is written to and not replaced.
        staged: Temporary path; None before the file is written.
        last: True for a main output, which is renamed after the others.
        refusal: The message if another file has its place by then; None for one that may be replaced.
    """

    path: str
    target: str
    through: bool
    staged: str | None = None
    last: bool = False
    refusal: str | None = None


class Outputs:
    """The files that a command writes: a `with` block commits them when it ends, and discards them if it raises.

    `at_commit` is called when all files are written, before the first is renamed.
    """

    def __init__(self, *, at_commit: Callable[[], object] = lambda: None) -> None:
        self._at_commit = at_commit
        self._claims = Claims[str]()  # an owner is what a file is besides, for messages
        self._outputs: dict[str, list[_Output]] = {}  # by real path; a device may have several
        self._dropped: list[Callable[[], Iterable[str]]] = []
        self._own: set[str] = set()
        self._folders: list[str] = []  # new ones, outermost first
        self._workplaces: dict[str, Workplace] = {}  # by parent folder

    def __enter__(self) -> "Outputs":
        return self

    def __exit__(self, kind: type[BaseException] | None, _error: object, _trace: TracebackType | None) -> None:
        try:
            if kind is None:
                self._commit()
        finally:
            self.discard()

    def protect(self, files: Iterable[str | os.PathLike[str]], *, used: str = "an input") -> None:
        """Never overwrite or drop these files; BakeError if an output is one of them, by whatever name.

        `used` says for the message what the files are.
        """
        for path in files:
            _refuse(self._claims.add_input(os.fspath(path), used))

    def claim(self, path: str | os.PathLike[str]) -> None:
        """Announce an output, so that a wrong path is found before the work is done.

        Raises:
            BakeError: The file is an input or another output, or cannot be written there.
        """
        self._claim(os.fspath(path))

    def add(self, path: str | os.PathLike[str], write: Write, *, last: bool = False, durable: bool = True) -> int:
        """Write a file, claimed or not, and give its size in bytes.

        Args:
            path: The destination.
            write: Called with the open file.
            last: True for a main output, which is renamed after the others.
            durable: Wait until the disk has the data. For a thousand files that takes longer than writing them.

        Raises:
            BakeError: The path is wrong, as in `claim`, or the disk is full.
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
        """Write a file with some content, as `add` does."""
        return self.add(path, lambda file: file.write(data), last=last, durable=durable)

    def add_new(self, path: str | os.PathLike[str], data: bytes | memoryview, refusal: str) -> None:
        """Write a file with some content, and refuse with a message if another one has its place at the commit."""
        self.add_bytes(path, data)
        self._outputs[_real(os.fspath(path))][-1].refusal = refusal

    @property
    def written(self) -> list[str]:
        """The paths of the files that have been written, as the user typed them."""
        return [each.path for each in chain.from_iterable(self._outputs.values()) if each.staged]

    def found(self, path: str | os.PathLike[str]) -> str | None:
        """The file with the content that a path will have, staged or existing, if any."""
        written = [each.staged for each in self._outputs.get(_real(os.fspath(path)), ()) if each.staged]
        return written[0] if written else os.fspath(path) if os.path.exists(path) else None

    def is_input(self, path: str | os.PathLike[str]) -> bool:
        """True if a file was noted by `protect`, by whatever name."""
        clash = self._claims.owner_of(os.fspath(path))
        return clash is not None and _real(os.fspath(path)) not in self._outputs

    def would_replace(self, path: str | os.PathLike[str]) -> bool:
        """True if a path names a file with content, which an output would replace."""
        path = os.fspath(path)
        with suppress(OSError, ValueError):
            return not _is_written_through(path) and os.stat(path).st_size > 0
        return False

    def own(self, paths: Iterable[str]) -> None:
        """Note files of an earlier run for the same purpose, which may be replaced although their content differs."""
        self._own |= set(map(_real, paths))

    def is_own(self, path: str) -> bool:
        """True if a file was noted by `own`, and is not written here."""
        return _real(path) in self._own and self.found(path) == path

    def make_folders(self, path: str | os.PathLike[str]) -> None:
        """Make a folder and those above it, which are removed again if the outputs are discarded.

        Raises:
            BakeError: A folder cannot be made.
        """
        path = os.fspath(path)
        if not path or os.path.isdir(path):
            return
        self.make_folders(os.path.dirname(path))
        if os.path.isdir(path):  # such as `a/..` after making `a`
            return
        self._folders.append(path)
        try:
            os.mkdir(path)
        except (OSError, ValueError) as error:  # ValueError: a null character
            self._folders.remove(path)
            if not os.path.isdir(path):  # otherwise another process has made it meanwhile
                raise _unwritable(path, error) from error

    def drop(self, find: Callable[[], Iterable[str]]) -> None:
        """Remove files after the commit, unless they are inputs or outputs.

        `find` names them right before the first renaming, when no other run changes them any more.
        """
        self._dropped.append(find)

    def discard(self) -> None:
        """Remove everything that is not committed. This may be called at any moment, also from a signal handler."""
        for workplace in self._workplaces.values():
            workplace.remove()
        for folder in reversed(self._folders):
            with suppress(OSError):  # another program may have put something into it
                os.rmdir(folder)

    def _claim(self, path: str) -> _Output:
        try:
            output = _Output(path, os.path.realpath(path), through=_is_written_through(path))
            if not output.through:
                _refuse(self._claims.add_output(path, "another output"))
                _refuse_folder(os.path.dirname(output.target))
        except (OSError, ValueError) as error:
            raise _unwritable(path, error) from error
        self._outputs.setdefault(output.target, []).append(output)
        return output

    def _workplace(self, output: _Output) -> Workplace:
        """The folder for a staged output: on the same disk, or any for a device or a pipe."""
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
        """Rename all files to their destinations, or none."""
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
        renamed = [each for each in written if not each.through]
        with ExitStack() as stack:
            for folder in sorted({os.path.dirname(each.target) for each in renamed}):
                stack.enter_context(locked(folder))
            dropped = [path for find in self._dropped for path in find() if self._claims.owner_of(path) is None]
            for each in renamed:
                if each.refusal is not None and _is_other(each.target, str(each.staged)):
                    raise BakeError(each.refusal, where=each.path)
            self._at_commit()
            self._rename(renamed)
            self._folders.clear()
            for path in dropped:
                with suppress(OSError):
                    os.unlink(path)
        for each in written:
            log("info", f"{each.path}: written")

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
            if os.path.exists(str(outputs[-1].staged)):  # otherwise all are renamed
                for output, old in reversed(begun):
                    # Undo a renaming that was done.
                    with suppress(OSError):
                        if not os.path.exists(str(output.staged)):
                            os.replace(old, output.target) if os.path.exists(old) else os.unlink(output.target)
            if isinstance(error, OSError):
                raise _unwritable(begun[-1][0].path, error) from error
            raise


def part_of(outputs: Outputs | None) -> AbstractContextManager[Outputs]:
    """A `with` block over outputs that the caller commits, or over new ones that the block commits."""
    return Outputs() if outputs is None else nullcontext(outputs)


def _refuse(clash: Clash[str] | None) -> None:
    """Raise BakeError for an output that is an input or another output."""
    if clash is not None and clash.is_input:
        raise BakeError(f"is {clash.other} too and would be overwritten", where=clash.output)
    if clash is not None:
        raise BakeError(f"is {clash.other} too: each needs a name of its own", where=clash.output)


def _real(path: str) -> str:
    return path if "\0" in path else os.path.realpath(path)


def _unwritable(path: str | os.PathLike[str], error: OSError | ValueError) -> BakeError:
    reason = error.strerror if isinstance(error, OSError) else None
    return BakeError(f"cannot be written: {reason or error}", where=os.fspath(path))


def _is_written_through(path: str) -> bool:
    """True if a path names a device, a pipe or a standard stream of this process.

    Raises:
        OSError: The path names something else that is no regular file.
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
    """The descriptor of this process that a path names: a shell may append to its file."""
    named = re.fullmatch(r"/(?:dev|proc/self)/fd/(\d+)", os.path.abspath(path))
    numbers = [1, 2, int(named[1])] if named else [1, 2]
    for descriptor in numbers:
        with suppress(OSError):
            if os.path.samestat(os.stat(path), os.fstat(descriptor)):
                return descriptor
    return None


def _refuse_folder(folder: str) -> None:
    """Raise OSError if files cannot be put into a folder."""
    if not stat.S_ISDIR(os.stat(folder).st_mode):
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
    if not os.access(folder, os.W_OK | os.X_OK):
        read_only = hasattr(os, "statvfs") and os.statvfs(folder).f_flag & os.ST_RDONLY
        number = errno.EROFS if read_only else errno.EACCES
        raise OSError(number, os.strerror(number))


def _write_through(output: _Output) -> None:
    """Copy a staged file to its device or pipe."""
    import shutil

    number = _open_descriptor(output.path)
    descriptor = os.open(output.path, os.O_WRONLY) if number is None else os.dup(number)
    with open(str(output.staged), "rb") as source, open(descriptor, "wb") as target:
        shutil.copyfileobj(source, target)


def _keep_mode_and_owner(output: _Output) -> None:
    """Give a staged file the mode and owner of the file that it replaces, as far as allowed."""
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
            except OSError:  # the new group gets no more rights than everyone
                mode &= 0o707 | (mode & 0o007) << 3
    os.chmod(str(output.staged), mode)


def _is_other(path: str, staged: str) -> bool:
    """True if a file is there and has other bytes than one that is staged."""
    import filecmp

    try:
        return not filecmp.cmp(path, staged, shallow=False)
    except FileNotFoundError:
        return False


def _keep_copy(path: str, copy: str) -> None:
    """Give a file, if it exists, a second name, or copy it if the disk has no links."""
    if not os.path.exists(path):
        return
    try:
        os.link(path, copy)
    except OSError:
        import shutil

        shutil.copy2(path, copy)
