"""The memory of commands on an avatar with many joints, as crowds have them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kit.avatar import avatar
from kit.limb import write_tools

# Bytes, whatever is done with 30,000 triangles and 250 joints, is 1 GB. A third of the triangles take a third of the
# time, and of what a command takes beyond its libraries.
MOST = 0.3e9
KNEE = {"origin": [0.1, 0.56, -0.05], "target": [0.1, 0.42, -0.045], "width": 0.08, "bumps": 3, "mirror": "x"}
# A process counts what its parent has when it starts, and the parent of a command is to be small.
LAUNCH = """
import resource, subprocess, sys
code = subprocess.call(sys.argv[1:], stdout=subprocess.DEVNULL)
print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
sys.exit(code)
"""
ELBOW = {"origin": [0.4, 1.39, 0.045], "target": [0.5, 1.39, 0.045], "width": 0.06, "bumps": 2, "mirror": "x"}


def peak(folder: Path, *arguments: str) -> int:
    """Run a command that must do its work, and give the most bytes that it took."""
    main = [sys.executable, "-c", "from wrinklecli.cli import main; main()", *arguments]
    done = subprocess.run(
        [sys.executable, "-c", LAUNCH, *main], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == (1 if arguments[0] == "diff" else 0), done.stderr
    return int(done.stdout) * (1 if sys.platform == "darwin" else 1024)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The avatar with clips and without, tools for it, and a bake of each."""
    made = tmp_path_factory.mktemp("avatar")
    for clips in (True, False):
        avatar(clips=clips, coarse=True).write(made / ("clips.glb" if clips else "still.glb"))
    write_tools(made / "tools.yaml", {"name": "knee.L", **KNEE}, {"name": "elbow.L", **ELBOW}, refinement={})
    return made


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.skipif(os.name != "posix", reason="needs Unix")
def test_no_command_takes_over_300_mb_for_a_coarse_avatar(folder: Path) -> None:
    tools = "tools.yaml"
    taken = {
        # Without clips, so in its range of motion.
        "suggest": peak(folder, "suggest", "still.glb", "-o", "suggested.yaml", "--count", "2"),
        "bake": peak(folder, "bake", "clips.glb", tools, "-o", "baked.glb"),
        "bake still": peak(folder, "bake", "still.glb", tools, "-o", "still_baked.glb"),
    }
    for command in (
        ("inspect", "clips.glb"),
        ("check", "clips.glb", tools, "--plot", "plot.svg"),
        ("check", "still.glb", tools),
        ("preview", "clips.glb", "--tools", tools, "-o", "picture.png", "--size", "160x120"),
        ("diff", "--posed", "clips.glb", "baked.glb"),
        ("maps", "clips.glb", tools, "-o", "maps", "--size", "128"),
        ("track", "still_baked.glb", "clips.glb", "-o", "tracked"),
    ):
        taken[" ".join(command)] = peak(folder, *command)
    assert {name: size for name, size in taken.items() if size > MOST} == {}
