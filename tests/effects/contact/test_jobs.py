"""Contact worked out by several processes: the same bytes as by one."""

import os
from pathlib import Path

import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.folds import knees
from wrinklecli.effects.contact import sample


@pytest.mark.slow
@pytest.mark.long
def test_the_file_does_not_depend_on_the_number_of_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asset, tools = knees(inwards=0.0, angle=90.0, sides=8).write(tmp_path, contact="resolve")
    fit = sample._spanned

    def logged(*args: object) -> object:
        with (tmp_path / "fits.txt").open("a", encoding="utf-8") as file:
            print(os.getpid(), file=file)
        return fit(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(sample, "_spanned", logged)
    made = []
    for jobs in (1, 4):  # both folds, and their sweeps
        (tmp_path / "fits.txt").unlink(missing_ok=True)
        report = wrinklecli.bake(asset, tools, tmp_path / "out.glb", jobs=jobs)
        assert all(fold["targets"] for fold in report.data["folds"])
        made.append((tmp_path / "out.glb").read_bytes())
        processes = set((tmp_path / "fits.txt").read_text(encoding="utf-8").split())
        assert (str(os.getpid()) in processes) == (jobs == 1), "the folds are fitted by the processes, too"
    assert made == made[:1] * 2
