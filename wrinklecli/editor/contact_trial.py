"""Contact of one tool, resolved on demand in one clip, in a process of its own, so that the page goes on meanwhile."""

import multiprocessing
import os
import signal
import tempfile
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import Connection

from wrinklecli.baking.job import BakeOptions, job_of
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.moved import Motions
from wrinklecli.editor.asset import LoadedAsset, ReadOptions
from wrinklecli.editor.baked_file import BakedFile
from wrinklecli.editor.free_pose import POSE, FreePose
from wrinklecli.editor.session import EditedTool, Session
from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.writer import write
from wrinklecli.numeric.guard import Progress, guarded
from wrinklecli.numeric.processes import core_count
from wrinklecli.review.preview.apply import PlannedTools, apply_tools
from wrinklecli.tools.records import ToolsFile


@dataclass(frozen=True, slots=True)
class ContactTrial:
    """The question: how does a tool look with its contact resolved?

    Attributes:
        asset: Path of the asset,
        read_options: and the way to read it.
        settings: All tools that fit; of these only the tool and its partner have contact.
        tool: Name of the tool.
        clip: Name of the clip; `POSE` for the pose.
        pose: The pose that is set.
        text: Text of the tools file, from which `settings` were read.
    """

    asset: str
    read_options: ReadOptions
    settings: ToolsFile
    tool: str
    clip: str
    pose: FreePose
    text: str


def trial_of(session: Session, tool: EditedTool, clip: str) -> ContactTrial:
    """The trial of a tool of a session, and of the tool that its `mirror` makes, among the tools that are shown."""
    own, fitting = {tool.name, tool.partner}, session.attached_tools()
    settings = session.settings()
    effects = tuple(
        each if each.name in own else each.without_contact
        for each in settings.effects
        if each.name in fitting or each not in settings.on_skin
    )
    return ContactTrial(
        asset=session.asset,
        read_options=session.read_options,
        settings=replace(settings, effects=effects),
        tool=tool.name,
        clip=clip,
        pose=session.pose,
        text=session.text,
    )


@dataclass(frozen=True, slots=True)
class _Answer:
    """The end of a trial: lines about contact that is left out, or the lines of an error."""

    left_out: tuple[str, ...] = ()
    errors: tuple[str, ...] = ()


class RunningTrial:
    """A trial that runs in a process of its own until it is done or cancelled.

    Args:
        trial: The tool and the clip.
        progress: Called with a stage's name, steps done and steps in all.
        done: Called with the file, or with the error that ended the trial; never called after `cancel`. Both are called
            on another thread.
    """

    def __init__(
        self, trial: ContactTrial, progress: Progress, done: Callable[[BakedFile | WrinkleError], None]
    ) -> None:
        self.trial, self._progress, self._done = trial, progress, done
        self._cancelled = False
        # A process that is forked would have the locks of other threads.
        context = multiprocessing.get_context("spawn")
        self._folder = tempfile.TemporaryDirectory()
        self._out = os.path.join(self._folder.name, "trial.glb")
        receiver, sender = context.Pipe(duplex=False)
        self._process = context.Process(target=_solve, args=(trial, self._out, sender))
        self._process.start()
        sender.close()
        self._thread = threading.Thread(target=self._listen, args=(receiver,), daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """End the trial, of which nothing is left."""
        self._cancelled = True
        with suppress(OSError):  # it has ended, or has no group yet
            # Kill a process and those that it has started.
            if self._process.pid is not None and hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        self._thread.join()

    def _listen(self, receiver: Connection) -> None:
        answer: object = None
        try:
            while not isinstance(answer := receiver.recv(), _Answer):
                if not self._cancelled:
                    self._progress(*answer)
        except EOFError:  # the process has ended without an answer
            answer = _Answer(errors=("contact could not be resolved: its process has ended",))
        self._process.join()
        found: BakedFile | WrinkleError
        try:
            found = self._baked(answer)
        except WrinkleError as error:
            found = error
        self._folder.cleanup()
        if not self._cancelled:
            self._done(found)

    def _baked(self, answer: _Answer) -> BakedFile:
        """Read the file that the process has written.

        Raises:
            WrinkleError: The process has failed, or the file cannot be read.
        """
        if answer.errors:
            raise BakeError.of_all([BakeError(line) for line in answer.errors])
        trial, options = self.trial, self.trial.read_options
        default = f"{trial.tool}: this is its contact in {trial.clip}, as Bake resolves it"
        summary = "\n".join(answer.left_out) or default
        found = BakedFile.read(self._out, options, summary, trial.text, f"contact of {trial.tool}")
        # The clip is the one that was added last if it is the pose.
        shown = [*found.clips.values()][-1] if trial.clip == POSE else found.clips[trial.clip]
        return replace(found, clips={trial.clip: shown})


def _solve(trial: ContactTrial, out: str, sender: Connection) -> None:
    """Write the asset with the tools; the process's main function."""
    if hasattr(os, "setsid"):
        os.setsid()  # `cancel` ends it together with the processes that it starts
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the page, which ends this
    try:
        sender.send(_Answer(left_out=tuple(_solved(trial, out, lambda *step: sender.send(step)))))
    except WrinkleError as error:
        sender.send(_Answer(errors=tuple(error.lines)))


def _solved(trial: ContactTrial, out: str, progress: Progress) -> list[str]:
    """Write the asset with the tools, and return lines about contact that is left out."""
    with guarded(trial.asset):
        document = LoadedAsset.read(trial.asset, trial.read_options).document
        pose = trial.pose if trial.clip == POSE else FreePose()
        motions = Motions(range_of_motion=False, pose=pose.joint_turns, morphs=pose.weights)
        job = job_of(document, trial.settings, BakeOptions(jobs=core_count()), motions)
        planned = PlannedTools(trial.settings, job, tuple(plan_meshes(job)), (), ())
        edited, left_out = apply_tools(planned, [job.pose or trial.clip], progress)
        write(EditedDocument(edited), out)
    return left_out
