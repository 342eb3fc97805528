"""Rays: Embree is not asked for what it cannot have."""

import subprocess
import sys
from pathlib import Path

import pytest

from kit.limb import limb_asset

MAIN = "from wrinklecli.cli import main; main()"


@pytest.mark.quick(1)
@pytest.mark.parametrize("size", ["50MB", "150MB"])
def test_too_little_memory_is_a_line_and_no_crash(tmp_path: Path, size: str) -> None:
    limb_asset(rings=7, sides=6).write(tmp_path / "limb.glb")
    command = [sys.executable, "-c", MAIN, "preview", tmp_path / "limb.glb", "-o", tmp_path / "limb.png"]
    ended = subprocess.run([*command, "--max-memory", size], capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stderr.count("\n")) == (1, 1)
    assert "takes more memory than there is" in ended.stderr
