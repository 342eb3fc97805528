"""README's table of speed is made from the last row of results.csv."""

from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def rows() -> Any:
    spec = spec_from_file_location("benchmark_rows", Path(__file__).with_name("rows.py"))
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_table_of_readme_is_that_of_the_last_row(rows: Any) -> None:
    """If it fails: `python tests/benchmarks/run.py --readme`."""
    page = (ROOT / "tests" / "benchmarks" / "README.md").read_text(encoding="utf-8")
    assert rows.readme_with(page, rows.readme_table(rows.recorded()[-1])) == page


def test_a_figure_edited_by_hand_is_noticed(rows: Any) -> None:
    page = (ROOT / "tests" / "benchmarks" / "README.md").read_text(encoding="utf-8")
    table = rows.readme_table(rows.recorded()[-1])
    figure = next(cell for cell in table.split("|")[9:] if cell.strip()[:1].isdigit())
    edited = page.replace(figure, figure.replace(figure.strip()[0], "9" if figure.strip()[0] != "9" else "8"))
    assert rows.readme_with(edited, table) != edited


def test_every_column_has_a_goal(rows: Any) -> None:
    told = ("release", "python", "numpy", "machine", "date", "cores", "processor", "load")
    for name in rows.recorded()[-1]:
        assert name in told or rows.goal_of(name).reach > 0, name


def test_a_ratio_that_misses_its_goal_is_bold_and_one_that_is_missing_is_said(rows: Any) -> None:
    row = {**rows.recorded()[-1], "density": "2.5", "memory_morph": "1.4", "memory_frames": ""}
    table = rows.readme_table(row)
    assert "| **2.5** | ≤ 1.5 |" in table
    assert "| 1.4; not measured | ≤ 1.5; ≤ 2.5 |" in table


def test_a_release_that_is_measured_again_keeps_its_other_columns(
    rows: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "RESULTS", tmp_path / "results.csv")
    for release, names in (("1", ("help", "bytes")), ("2", ("help", "density")), ("2", ("help",))):
        rows.record(release, [rows.Row(name, name, "all", float(release), "") for name in names])
    first, second = rows.recorded()
    assert (first["release"], first["bytes"], first["density"]) == ("1", "1", "")
    assert (second["help"], second["bytes"], second["density"]) == ("2", "", "2")
