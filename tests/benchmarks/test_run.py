"""Sections of the benchmarks run, on next to nothing, so that they stay right as the program changes."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from kit.clients import give_up, requireinstall

RUN = Path(__file__).with_name("run.py")
# Sections that take 4 to 12 s each, even on next to nothing. Whoever compares a release runs them.
DEAR = ("growth", "scaling", "ways", "batches")


def sections() -> list[str]:
    """Names in SECTIONS, as the text has them, but for dear ones: who imports the module gets its number of threads."""
    (found,) = [
        node.value
        for node in ast.parse(RUN.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "SECTIONS"
    ]
    assert isinstance(found, ast.DictComp)
    names = [each.id for each in ast.walk(found.generators[0].iter) if isinstance(each, ast.Name)]
    assert set(DEAR) < set(names)
    return [name for name in names if name not in DEAR]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    places = {**os.environ, "PYTHONPATH": str(RUN.parents[2])}
    command = [sys.executable, str(RUN), *arguments]
    return subprocess.run(command, env=places, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("part", range(2))
def test_sections_run(part: int) -> None:
    """A process runs every second section, since each process imports all anew."""
    chosen = sections()[part::2]
    if "drawn" in chosen:
        requireinstall()
        if shutil.which("chromium") is None:
            give_up("chromium is not installed")
    done = run("--tiny", *(word for section in chosen for word in ("--only", section)))
    assert done.returncode == 0, done.stderr
    for section in chosen:
        # Without Blender, its orders are written and the bake that it is compared with is looked at.
        assert f"ran {section}: " in done.stdout or (section == "blender" and "no bpy" in done.stderr), done.stderr


@pytest.mark.slow
@pytest.mark.long
def test_a_section_that_fails_keeps_the_rows_of_others(tmp_path: Path) -> None:
    broken = tmp_path / "tests" / "benchmarks"
    shutil.copytree(RUN.parent, broken, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("wrinklecli", "samples", "configs"):
        (tmp_path / name).symlink_to(RUN.parents[2] / name)
    (tmp_path / "tests" / "kit").symlink_to(RUN.parents[1] / "kit")
    page = (broken / "run.py").read_text(encoding="utf-8")
    (broken / "run.py").write_text(page.replace('"--max-levels", str(levels)', '"--no-such-option"'), encoding="utf-8")
    command = [sys.executable, str(broken / "run.py"), "--tiny", "--only", "rates", "--only", "frames"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1
    assert "ran frames: finished frames" in done.stdout
    assert "failed: rates" in done.stderr
    assert "No such option" in done.stderr


@pytest.mark.slow
@pytest.mark.long
def test_a_change_of_the_program_meets_its_tests(tmp_path: Path) -> None:
    tests = "tests/numeric/test_spring.py"
    chosen = ("--count", "1", "--seed", "1", "--only", "numeric/spring.py:8", "--tests", tests)
    command = [sys.executable, str(RUN.with_name("mutants.py")), str(tmp_path), *chosen]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert "Counter({'quick': 1})" in done.stdout, done.stdout + done.stderr
