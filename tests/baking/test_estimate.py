"""Estimates: what a bake would make is known before any of it is made, and refused in a line where it is too much."""

from pathlib import Path
from typing import Any

import pytest

from kit.bakes import bake_once
from kit.limb import limb, tool, write_tools
from wrinklecli import bake
from wrinklecli.baking import pipeline, sample
from wrinklecli.baking.estimate import morph_target_bytes
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.errors import BakeError, TooMuchError
from wrinklecli.review.check import check

MANY = tool(bumps=8, strategy="origin", details=[0.2], profile="polyline")


@pytest.fixture
def paths(tmp_path: Path) -> tuple[Path, Path]:
    return limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml", MANY)


@pytest.mark.parametrize("accessors", ["sparse", "dense"])
def test_bytes_of_targets_are_those_that_are_written(paths: tuple[Path, Path], accessors: Any) -> None:
    (plan,) = plan_meshes(read_job(*paths, BakeOptions()))
    count, size = morph_target_bytes(plan, dense=accessors == "dense")
    baked = bake_once(paths[0], MANY, accessors=accessors)
    (primitive,) = baked.json["meshes"][0]["primitives"]
    assert 1 <= count / len(primitive["targets"]) < 1.3
    numbers = {index for target in primitive["targets"] for index in target.values()}
    written = 0
    for each in (baked.json["accessors"][number] for number in numbers):
        sparse = each.get("sparse")
        width = {5121: 1, 5123: 2, 5125: 4}[sparse["indices"]["componentType"]] if sparse else 0
        written += (sparse["count"] if sparse else each["count"]) * (12 + width)
    assert 0.6 < size / written < 1.5


@pytest.mark.parametrize(
    ("options", "memory", "line"),
    [
        ({"accessors": "dense"}, 1_000_000, r"^limb: 16 dense morph targets of [\d,]+ vertices would take .*--max-mem"),
        ({}, 200_000, r"^limb: 16 morph targets of [\d,]+ vertices would take .*: raise --max-memory$"),
        ({"fps": 1000.0}, 900_000, r"^limb: 2,001 samples of 1 tool would take .*: raise --max-memory$"),
    ],
)
def test_too_much_is_refused_before_it_is_made(
    paths: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, options: Any, memory: int, line: str
) -> None:
    monkeypatch.delattr(sample, "activities")
    with pytest.raises(TooMuchError, match=line):
        bake(*paths, paths[0].with_name("out.glb"), max_memory=memory, **options)
    if "fps" in options:
        with pytest.raises(TooMuchError, match=line):
            check(*paths, max_memory=memory, **options)


def test_frames_that_no_glb_holds_are_refused(paths: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(pipeline, "sample_clips")
    with pytest.raises(
        BakeError, match=r"^limb: 200,001 frames of [\d,]+ vertices would be .* GB, and a .glb holds 4 GiB"
    ):
        bake(*paths, paths[0].with_name("out.glb"), mode="frames", fps=100_000.0)
