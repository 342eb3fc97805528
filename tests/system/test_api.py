"""The package offers functions named for the commands, each with options and an example that runs."""

import doctest
import inspect
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import pytest

import wrinklecli
from kit.limb import RADIUS, limb_asset, tool, write_tools
from kit.places import ROOT

FUNCTIONS = ("bake", "track", "check", "suggest", "diff", "inspect", "preview", "crossings", "batch")


def test_the_package_offers_every_function_with_its_options() -> None:
    assert set(FUNCTIONS) <= set(wrinklecli.__all__)
    assert set(wrinklecli.__all__) <= set(dir(wrinklecli))
    with pytest.raises(AttributeError, match="no attribute 'bakes'"):
        _ = wrinklecli.bakes


@pytest.mark.parametrize("name", FUNCTIONS)
def test_options_are_a_record_that_the_package_offers(name: str) -> None:
    function: Callable[..., Any] = getattr(wrinklecli, name)
    parameters = inspect.signature(function).parameters
    record = inspect.get_annotations(function, eval_str=True)["options"].__args__[0]
    assert is_dataclass(record)
    assert getattr(wrinklecli, record.__name__) is record
    assert parameters["options"].default is None
    with pytest.raises(TypeError, match="no_such_option"):
        function(*["missing.glb"] * list(parameters).index("options"), no_such_option=1)


def test_importing_the_package_imports_nothing_more() -> None:
    code = (
        "import sys; before = set(sys.modules); import wrinklecli\n"
        "import importlib, typing; print(*{name.split('.')[0] for name in set(sys.modules) - before})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) - {"importlib", "typing"} <= set(sys.stdlib_module_names) | {"wrinklecli"}


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in ("suggest", "track", "batch"))) for name in FUNCTIONS],
)
def test_examples_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for file in ("samples/wrist.glb", "configs/wrist.yaml"):
        (tmp_path / file).parent.mkdir()
        shutil.copy(ROOT / file, tmp_path / file)
    monkeypatch.chdir(tmp_path)
    function = getattr(wrinklecli, name)
    example = doctest.DocTestParser().get_doctest(inspect.getdoc(function) or "", {}, name, None, None)
    assert any(f"{name}(" in each.source for each in example.examples)
    doctest.DebugRunner().run(example)


def test_a_program_that_logs_gets_steps_findings_and_written_files(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    asset = limb_asset().write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(origin=[-0.3, -RADIUS, 0.0], target=[0.3, -RADIUS, 0.0]))
    out = str(tmp_path / "out.glb")
    with caplog.at_level("DEBUG", "wrinklecli"):
        report = wrinklecli.bake(asset, tools, out)
    logged = {(each.name, each.levelname, each.message) for each in caplog.records}
    assert {("wrinklecli", "WARNING", f"{asset}: {line}") for line in report.warnings} <= logged
    assert report.warnings
    assert {("wrinklecli", "INFO", f"{out}: written"), ("wrinklecli", "DEBUG", "proof: 1/1")} <= logged


PAGE = (ROOT / "wrinklecli" / "README.md").read_text(encoding="utf-8").split("## In Python", 1)[1].split("\n## ", 1)[0]


def test_the_page_names_every_function_and_its_options() -> None:
    assert {name for name in wrinklecli.__all__ if f"`{name}" not in PAGE} == set()


@pytest.mark.slow
@pytest.mark.long
def test_the_script_of_the_page_runs(tmp_path: Path) -> None:
    shutil.copy(ROOT / "samples" / "trousers.glb", tmp_path / "character.glb")
    shutil.copy(ROOT / "configs" / "trousers.yaml", tmp_path / "tools.yaml")
    script = PAGE.split("```python\n", 1)[1].split("```", 1)[0]
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("", "")
    assert (tmp_path / "sheet.png").exists()
