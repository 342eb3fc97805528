"""The table of what contact does is made from contact.csv, and its cases run."""

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("contact_table.py")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(SCRIPT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.slow
@pytest.mark.long
def test_the_table_of_readme_is_that_of_contact_csv(tmp_path: Path) -> None:
    """If it fails: `python tests/benchmarks/contact_table.py --readme`."""
    shown = run("--readme", "--to", str(tmp_path / "README.md"))
    assert shown.returncode == 0, shown.stderr
    assert (tmp_path / "README.md").read_text() == SCRIPT.with_name("README.md").read_text()


@pytest.mark.slow
@pytest.mark.long
def test_a_case_is_measured() -> None:
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    done = run("--only", "one_sided")
    assert done.stdout.startswith("ok  fold: one sided"), done.stdout + done.stderr
