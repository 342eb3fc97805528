"""`wrinkle doctor`: what it finds, its bake, and what it keeps to itself."""

import json
import os
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from kit.command import Wrinkle
from kit.places import ROOT
from wrinklecli.cli.doctor import EXTRAS


def test_it_says_the_versions_and_that_the_bake_is_right(wrinkle: Wrinkle, tmp_path: Path) -> None:
    ran = wrinkle("doctor")
    assert (ran.code, ran.lines) == (0, [])
    shown = dict(line.split(maxsplit=1) for line in ran.out.splitlines())
    assert shown["wrinkle"] == metadata.version("wrinklecli")
    assert shown["bake"].startswith("ok in ")
    for library in ("numpy", "pygltflib", "trimesh", "click", "pyyaml"):
        assert shown[library] == metadata.version(library)
    assert str(tmp_path) not in ran.out
    assert os.path.expanduser("~") not in ran.out
    assert list(Path.cwd().iterdir()) == []


@pytest.mark.slow
def test_extras_are_those_of_the_metadata(wrinkle: Wrinkle, monkeypatch: pytest.MonkeyPatch) -> None:
    requires = [
        "click>=8.1",
        "numpy>=999",
        'no-such-package>=1.0; extra == "draco"',
        'click>=8.1; extra == "draco"',
        'click[more]>=8.1; extra == "edit"',
    ]
    monkeypatch.setattr(metadata, "requires", lambda _: requires)
    found = json.loads(wrinkle("doctor", "--json").out)
    assert next(iter(found)) == "doctor"
    click = metadata.version("click")
    assert found["libraries"] == {"click": click, "numpy": None}
    assert found["extras"]["draco"]["packages"] == {"no-such-package": None, "click": click}
    assert [name for name, extra in found["extras"].items() if extra["found"]] == ["edit"]
    assert "[draco]    missing no-such-package; for assets" in wrinkle("doctor").out


def test_it_lists_the_extras_that_all_installs() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert extras["all"] == [f"wrinklecli[{','.join(EXTRAS)}]"]
    assert set(EXTRAS) == set(extras) - {"all", "test", "test-more", "lint"}


def test_a_bake_that_fails_is_one_line_and_names_no_home(wrinkle: Wrinkle, monkeypatch: pytest.MonkeyPatch) -> None:
    home = os.path.expanduser("~")

    def broken(*_: object, **__: object) -> None:
        raise ImportError(f"cannot load\n{home}/lib/blas.so")

    monkeypatch.setattr("wrinklecli.baking.pipeline.bake", broken)
    ran = wrinkle("doctor")
    assert ran.code == 1
    assert ran.lines == ["doctor: the bake of the demo's figure failed: wrinkle does not work here"]
    assert ran.out.splitlines()[-1].endswith("failed: ImportError: cannot load ~/lib/blas.so")
