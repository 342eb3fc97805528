"""Bake the saved tools as `wrinkle bake` does, in a process of its own, and play the written file."""

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from types import FrameType

from wrinklecli.baking.job import BakeOptions
from wrinklecli.baking.pipeline import bake
from wrinklecli.batching.cache import Cache, Solutions
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.editor.asset import LoadedAsset, ReadOptions
from wrinklecli.editor.attached import PlayableMesh, ShownMesh
from wrinklecli.editor.session import Session
from wrinklecli.effects.kept import solutions_in
from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.guard import Progress, guarded, log_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.processes import core_count
from wrinklecli.tools.records import ToolsFile

_PATIENCE = 2.0  # seconds in which a bake that was told to end removes what it has written so far


@dataclass(frozen=True, slots=True)
class BakedFile:
    """A baked file, read again, with lines about the bake and the text of the tools file that was baked.

    The wrinkles of its meshes (`sources`) are morph targets.
    """

    summary: str
    text: str
    document: Document
    sources: tuple[PlayableMesh, ...]
    clips: dict[str, Clip]

    def plays(self, clip: str | None) -> bool:
        """True if the file has a clip, or None is asked for: the stored pose. Clips that `wrinkle` made up are not."""
        return clip is None or clip in self.clips

    def meshes(self, clip: str | None, time: float) -> list[ShownMesh]:
        """All meshes at a time of a clip, seconds, as the file plays it."""
        played = None if clip is None else self.clips[clip]
        return [ShownMesh(each, each.posed(played, time)) for each in self.sources]


@dataclass(frozen=True, slots=True)
class SavedBake:
    """A bake of a saved tools file, of a text, into the file's folder; a cache has what bakes before it have solved."""

    asset: str
    tools: str
    text: str
    read_options: ReadOptions
    cache: str

    @classmethod
    def of(cls, session: Session, cache: str) -> "SavedBake":
        """The bake of what a session has saved."""
        return cls(session.asset, session.path, session.saved_text, session.read_options, cache)

    @property
    def out(self) -> str:
        """Path of the baked file."""
        asset = os.path.splitext(os.path.basename(self.asset))[0]
        return os.path.join(os.path.dirname(self.tools), f"{asset}_wrinkled.glb")

    def run(self, progress: Progress = log_progress, jobs: int = 1) -> str:
        """Bake, with so many processes, and return lines about it.

        Raises:
            WrinkleError: The bake fails.
        """
        options = BakeOptions(
            anims=self.read_options.anims,
            allow_external=self.read_options.allow_external,
            max_memory=self.read_options.max_memory,
            replace=True,  # the editor too shows the original of a baked asset
            jobs=jobs,
        )
        with solutions_in(Solutions(Cache(self.cache))):
            report = bake(self.asset, self.tools, self.out, options, progress=progress)
        return "\n".join((f"{self.out}: {report.summary}", *report.warnings))

    def read(self, summary: str) -> BakedFile:
        """Read the file that `run` has written.

        Raises:
            WrinkleError: The file cannot be read.
        """
        with guarded(self.out):
            memory = Memory(self.read_options.max_memory)
            document = read_document(self.out, allow_external=self.read_options.allow_external, memory=memory)
            clips = read_clips(document)
            attached = LoadedAsset(document, clips).attach(ToolsFile(path=self.out))
        return BakedFile(summary, self.text, document, attached.meshes, {clip.name: clip for clip in clips})


class RunningBake:
    """A bake in a process of its own until it is done or cancelled, so that a page goes on meanwhile.

    Args:
        task: The bake.
        progress: Called with a stage's name, steps done and steps in all.
        done: Called with the file, or with the error that ended the bake; never called after `cancel`. Both are called
            on another thread.
    """

    def __init__(self, task: SavedBake, progress: Progress, done: Callable[[BakedFile | WrinkleError], object]) -> None:
        self._task, self._progress, self._done = task, progress, done
        self._cancelled = False
        # A process that is forked would have the locks of other threads.
        context = multiprocessing.get_context("spawn")
        receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(target=_bake, args=(task, sender))
        self._process.start()
        sender.close()
        threading.Thread(target=self._listen, args=(receiver,), daemon=True).start()

    def cancel(self) -> None:
        """End the bake, of which nothing is left."""
        self._cancelled = True
        self._process.terminate()
        self._process.join(_PATIENCE)
        with suppress(OSError):  # it has ended
            # Kill those that it has started, too.
            if self._process.pid is not None and hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()

    def _listen(self, receiver: Connection) -> None:
        found: BakedFile | WrinkleError
        try:
            while isinstance(answer := receiver.recv(), tuple):
                if not self._cancelled:
                    self._progress(*answer)
            found = self._task.read(answer) if isinstance(answer, str) else BakeError.of_all(map(BakeError, answer))
        except EOFError:
            found = BakeError("the bake has ended without a word")
        except WrinkleError as error:
            found = error
        self._process.join()
        if not self._cancelled:
            self._done(found)


def _end(_number: int, _frame: FrameType | None) -> None:
    """Take back what is written so far, and end."""
    raise SystemExit


def _bake(task: SavedBake, sender: Connection) -> None:
    """Send steps, then lines about the bake as a text, or those of an error as a list; the process's main function."""
    if hasattr(os, "setsid"):
        os.setsid()  # `cancel` ends it together with the processes that it starts
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the page, which ends this
    signal.signal(signal.SIGTERM, _end)
    try:
        sender.send(task.run(lambda *step: sender.send(step), jobs=core_count()))
    except WrinkleError as error:
        sender.send(list(error.lines))
