"""Contact worked out by several processes: the same bytes as by one."""

from pathlib import Path

import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.folds import knees


@pytest.mark.slow
def test_the_file_does_not_depend_on_the_number_of_processes(tmp_path: Path) -> None:
    asset, tools = knees(inwards=0.0, angle=90.0, sides=8).write(tmp_path, contact="resolve")
    made = []
    for jobs in (1, 2, 4):  # both folds, and their sweeps
        report = wrinklecli.bake(asset, tools, tmp_path / "out.glb", jobs=jobs)
        assert all(fold["targets"] for fold in report.data["folds"])
        made.append((tmp_path / "out.glb").read_bytes())
    assert made == made[:1] * 3
