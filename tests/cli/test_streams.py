"""Standard streams that are full or closed: a line and an exit code, no traceback, and nothing half done."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from kit.command import files
from kit.limb import limb_asset, tool, write_tools
from kit.places import ROOT

WRINKLE = shlex.join([sys.executable, "-c", "from wrinklecli.cli import main; main()"])
FULL = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    limb_asset(rings=7, sides=6).write(tmp_path / "limb.glb")
    write_tools(tmp_path / "tools.yaml", tool(bumps=1), refinement={"max_levels": 0})
    return tmp_path


def run(arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """The command with a shell's redirections; what remains of its streams."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(
        f"exec {WRINKLE} {arguments}",
        shell=True,
        executable="/bin/bash",
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.quick(0, 2)
@FULL
@pytest.mark.parametrize("away", [">/dev/full", ">&-"])
@pytest.mark.parametrize(
    "command",
    [
        "inspect limb.glb",
        "--help",
        "schema",
        "check limb.glb tools.yaml --plot new.svg",
        "suggest limb.glb -o new.yaml --json",
        "bake limb.glb tools.yaml -o out.glb --json",
        "--version",
    ],
)
def test_what_was_asked_for_on_standard_output_cannot_be_written(command: str, away: str, folder: Path) -> None:
    before = files(folder)
    ran = run(f"{command} {away}", folder)
    reason = "No space left on device" if "full" in away else "Bad file descriptor"
    said = [line for line in ran.stderr.splitlines() if not line.startswith(("warning: ", "note: "))]
    assert said == [f"standard output: cannot be written: {reason}"]
    assert ran.returncode == 1
    assert files(folder) == before


@pytest.mark.quick(0, 1)
@FULL
@pytest.mark.parametrize("away", ["2>/dev/full", "2>&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_messages_that_are_lost_are_no_failure(away: str, folder: Path) -> None:
    ran = run(f"bake limb.glb tools.yaml -o out.glb --report r.json -v {away}", folder)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")
    assert files(folder).keys() == {"limb.glb", "tools.yaml", "out.glb", "r.json"}
    assert (folder / "out.glb").read_bytes()[:4] == b"glTF", "no other file got the number of a stream"


@pytest.mark.slow
@FULL
@pytest.mark.parametrize("away", ["2>/dev/full", "2>&-"])
@pytest.mark.parametrize(("command", "code"), [("bake absent.glb tools.yaml -o out.glb", 1), ("bake limb.glb", 2)])
def test_errors_that_nobody_reads_have_their_exit_code(command: str, code: int, away: str, folder: Path) -> None:
    assert run(f"{command} {away}", folder).returncode == code


@pytest.mark.slow
@FULL
def test_a_bug_that_nobody_reads_of_has_its_exit_code(folder: Path) -> None:
    broken = "import wrinklecli.review.inspect as it; it.inspect = None; from wrinklecli.cli import main; main()"
    command = shlex.join([sys.executable, "-c", broken, "inspect", "limb.glb"])
    ran = subprocess.run(
        f"exec {command} 2>/dev/full", shell=True, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert ran.returncode == 70


@pytest.mark.slow
def test_standard_output_by_name_goes_to_what_a_shell_appends_to(folder: Path) -> None:
    (folder / "log").write_text("old\n")
    assert run("bake limb.glb tools.yaml -o out.glb --report /dev/stdout -q >> log", folder).returncode == 0
    assert (folder / "log").read_text().startswith('old\n{\n "report": 1')


@pytest.mark.slow
@FULL
def test_a_report_for_a_full_device_leaves_the_output_as_it_was(folder: Path) -> None:
    before = files(folder)
    ran = run("bake limb.glb tools.yaml -o out.glb --report /dev/full", folder)
    assert ran.stderr == "/dev/full: cannot be written: No space left on device\n"
    assert (ran.returncode, files(folder)) == (1, before)


_INTERRUPTED_AT = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # as not every shell starts tests
left = int(sys.argv.pop(1))
class Interrupts:
    def find_spec(self, name, path=None, target=None):
        global left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Interrupts())
from wrinklecli.__main__ import main
main()
"""


@pytest.mark.quick(2)
@pytest.mark.parametrize("imports", [3, 40, 10, 100, 200])
def test_an_interrupt_in_the_first_instants_is_a_line(imports: int, tmp_path: Path) -> None:
    """While the modules of the command are imported, of which the first two are the program and its start."""
    asset = limb_asset(rings=4, sides=4).write(tmp_path / "limb.glb")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", _INTERRUPTED_AT, str(imports), "bake", str(asset), "tools.yaml", "-o", "out.glb"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stdout, done.stderr.strip()) == (130, "", "wrinkle: interrupted")


def test_the_command_starts_as_a_module() -> None:
    command = [sys.executable, "-m", "wrinklecli", "--version"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stdout.split(",")[0]) == (0, "wrinkle")
