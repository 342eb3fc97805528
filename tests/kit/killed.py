"""A command that a signal ends at every line of the modules that write.

`python tests/kit/killed.py FOLDER SIGNAL STEP ARGUMENT…` runs `wrinkle ARGUMENT…` in a folder up to where it is to
write its first file. From there a child goes on that gets the signal at the first line, then one that gets it STEP
lines later, and so on until one has no more lines. After each a line of JSON says what it left, and the folder is put
back.
"""

import atexit
import hashlib
import json
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from subprocess import run
from types import FrameType
from typing import Any

if __name__ == "__main__":
    sys.path[0] = str(Path(__file__).resolve().parents[1])

from kit.places import ROOT

_WATCHED = (
    "files/outputs.py",
    "files/workplace.py",
    "gltf/writer.py",
    "gltf/images.py",
    "cli/streams.py",
    "batch/stores.py",
    "editor/store.py",
)


@dataclass(frozen=True)
class Ended:
    """What a child did that got a signal.

    Attributes:
        line: How many lines it had come to, of those watched.
        reached: Whether it had so many: else it ran to its end.
        code: Its exit code; the negative signal if that ended it.
        left: Contents of the folder.
    """

    line: int
    reached: bool
    code: int
    left: dict[str, str]


def contents(folder: Path) -> dict[str, str]:
    """Mode and digest of every file below a folder; folders have none."""
    return {
        str(path.relative_to(folder)): ""
        if path.is_dir()
        else f"{path.stat().st_mode:o} {hashlib.sha256(path.read_bytes()).hexdigest()}"
        for path in sorted(folder.rglob("*"))
    }


def ended_at_lines(folder: Path, sign: int, step: int, *arguments: str) -> list[Ended]:
    """Run a command in a folder, and end it at every line, or at one of so many."""
    command = [sys.executable, __file__, str(folder), str(int(sign)), str(step), *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ran = run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    return [Ended(**json.loads(line)) for line in ran.stdout.splitlines()]


def signal_at_line(number: int, sign: int, tell: int) -> None:
    """Send a signal to this process when it has come to so many lines more of the watched modules."""

    def send() -> None:
        os.write(tell, b"!")
        os.kill(os.getpid(), sign)

    act_at_line(number, send)


def act_at_line(number: int, act: Callable[[], object]) -> None:
    """Call a function when this process has come to so many lines more of the watched modules."""
    left = number

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal left
        if not frame.f_code.co_filename.endswith(_WATCHED):
            return None
        if event == "line":
            left -= 1
            if left == 0:
                act()
        return trace

    frame: FrameType | None = sys._getframe()
    while frame is not None:
        frame.f_trace = trace
        frame = frame.f_back
    sys.settrace(trace)


def _try_lines(folder: Path, sign: int, step: int, out: int) -> None:
    """Fork for each line, and say what each left on a descriptor; this returns in the children."""
    from wrinklecli.files.workplace import Workplace

    kept = folder.with_name(f"{folder.name}-kept")
    shutil.copytree(folder, kept)
    # Held open, so that none of the files that are put back gets the inode of one that the command knows.
    held = [path.open("rb") for path in folder.rglob("*") if path.is_file()]
    number, reached = 1, True
    while reached:
        hear, tell = os.pipe()
        child = os.fork()
        if child == 0:
            signal_at_line(number, sign, tell)
            return
        os.close(tell)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        reached = os.read(hear, 1) == b"!"
        os.close(hear)
        for each in _folders(folder):  # as a later run does
            later = Workplace(str(each))
            later.make()
            later.remove()
        os.write(out, json.dumps(vars(Ended(number, reached, code, contents(folder)))).encode() + b"\n")
        for path in folder.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        shutil.copytree(kept, folder, dirs_exist_ok=True)
        number += step
    for file in held:
        file.close()
    os._exit(0)


def _folders(folder: Path) -> Iterator[Path]:
    """A folder, and those below it that are no workplaces."""
    yield folder
    for path in sorted(folder.rglob("*")):
        if path.is_dir() and not path.name.startswith(".wrinkle-"):
            yield path


def _main() -> None:
    from wrinklecli.cli import main
    from wrinklecli.files.outputs import Outputs

    folder, sign, step = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    if sign != signal.SIGKILL:
        signal.signal(sign, signal.SIG_DFL)  # whatever this process was started with, as by `nohup`
    add = Outputs.add
    # What the command prints is not looked at.
    out, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)

    def add_from_here(self: Outputs, *arguments: Any, **options: Any) -> int:
        Outputs.add = add  # type: ignore[method-assign]
        _try_lines(folder, sign, step, out)
        os.dup2(nowhere, 2)
        return self.add(*arguments, **options)

    Outputs.add = add_from_here  # type: ignore[method-assign]
    sys.argv = ["wrinkle", *sys.argv[4:]]
    code = 0
    try:
        main()
    except SystemExit as ended:
        code = int(ended.code or 0)
    # What is still to be done at the end is done; all that is imported is not taken apart in hundreds of children.
    atexit._run_exitfuncs()
    os._exit(code)


if __name__ == "__main__":
    _main()
