"""The command turns the outcomes of a batch into results: its exit code, its report and its last line."""

import json
from pathlib import Path

import pytest

from kit.command import Wrinkle
from wrinklecli.batching.jobs import BatchJob, Outcome, Result

ARGUMENTS = ("batch", "chars/*.glb", "--tools", "t.yaml", "--out", "out/{stem}.glb", "--report", "r.jsonl")


@pytest.mark.parametrize(
    ("results", "options", "code", "begun"),
    [
        (("hit", "built"), (), 0, 2),
        (("built", "refused", "built"), (), 3, 3),
        (("failed", "refused", "built"), (), 1, 3),
        (("refused", "bug", "failed"), (), 70, 3),
        (("built", "refused", "bug"), ("--fail-fast",), 3, 2),
    ],
)
def test_the_worst_outcome_gives_the_exit_code(
    results: tuple[Result, ...],
    options: tuple[str, ...],
    code: int,
    begun: int,
    wrinkle: Wrinkle,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "chars").mkdir()
    for number in range(len(results)):
        (tmp_path / "chars" / f"{number}.glb").touch()
    (tmp_path / "t.yaml").touch()
    jobs = [BatchJob(f"job {number}", "a.glb", ("t.yaml",), f"out/{number}.glb") for number in range(len(results))]
    made = [Outcome(job, result, lines=(f"{job.where} ended",)) for job, result in zip(jobs, results, strict=True)]
    monkeypatch.setattr("wrinklecli.batching.batch.run_jobs", lambda *_, **__: iter(made))
    ran = wrinkle(*ARGUMENTS, *options)
    assert ran.code == code
    assert [json.loads(line)["result"] for line in Path("r.jsonl").read_text().splitlines()] == list(results[:begun])
    assert [line for line in ran.lines if "ended" in line] == [f"job {n}: job {n} ended" for n in range(begun)]
    missing = f", {len(results) - begun} not begun" if begun < len(results) else ""
    assert ran.lines[-1].startswith(f"{len(results)} jobs: ")
    assert missing in ran.lines[-1]
