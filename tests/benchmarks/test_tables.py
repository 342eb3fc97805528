"""README's tables of contact and of fields are made from their .csv files, and their cases run."""

import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent


def run(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(HERE / script), *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("script", ["contact_table.py", "fields_table.py"])
def test_the_table_of_readme_is_that_of_its_csv(script: str, tmp_path: Path) -> None:
    """If it fails: `python tests/benchmarks/SCRIPT --readme`."""
    shown = run(script, "--readme", "--to", str(tmp_path / "README.md"))
    assert shown.returncode == 0, shown.stderr
    assert (tmp_path / "README.md").read_text() == (HERE / "README.md").read_text()


@pytest.mark.slow
@pytest.mark.long
def test_a_case_of_contact_is_measured() -> None:
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    done = run("contact_table.py", "--only", "one_sided")
    assert done.stdout.startswith("ok  fold: one sided"), done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.long
def test_a_case_of_fields_is_measured() -> None:
    done = run("fields_table.py", "--only", "figure")
    squat, walk = done.stdout.splitlines()
    assert squat.startswith("ok  figure squat"), done.stdout + done.stderr
    assert "figure walk" in walk
