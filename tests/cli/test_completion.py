"""`wrinkle completion`: scripts for shells. That bash completes by one is in `system/test_manners.py`."""

import subprocess
from pathlib import Path

import pytest

from kit.command import Wrinkle


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_each_shell_gets_its_script(wrinkle: Wrinkle, shell: str) -> None:
    ran = wrinkle("completion", shell)
    assert (ran.code, ran.lines) == (0, [])
    assert f"_WRINKLE_COMPLETE={shell}_complete" in ran.out


@pytest.mark.parametrize("arguments", [[], ["tcsh"]])
def test_no_shell_or_an_unknown_one_is_wrong_usage(wrinkle: Wrinkle, arguments: list[str]) -> None:
    assert wrinkle("completion", *arguments).code == 2


def test_bash_takes_the_script(wrinkle: Wrinkle, tmp_path: Path) -> None:
    script = tmp_path / "script"
    script.write_text(wrinkle("completion", "bash").out)
    subprocess.run(["bash", "-n", script], check=True)
