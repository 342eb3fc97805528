"""Estimates: the size of a bake is known before anything is made, and a line refuses what is too much."""

from pathlib import Path
from typing import Any

import pytest

from kit.bakes import bake_once
from kit.limb import limb, tool, write_tools
from wrinklecli import bake
from wrinklecli.baking import estimate, pipeline
from wrinklecli.baking.estimate import morph_target_bytes, target_sizes
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects import sampling
from wrinklecli.effects.wrinkle import posed, projected
from wrinklecli.errors import BakeError, TooMuchError
from wrinklecli.review.check import check

MANY = tool(bumps=8, strategy="origin", details=[0.2], profile="polyline")
ANEW = tool(attachment="patch", variation=0)
SAMPLES = r"^limb: 2,001 samples of 1 tool would take .*: raise --max-memory$"


@pytest.fixture
def paths(tmp_path: Path) -> tuple[Path, Path]:
    return limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml", MANY, refinement={})


@pytest.mark.quick(1, 2)
@pytest.mark.parametrize(("tools", "accessors"), [(MANY, "sparse"), (MANY, "dense"), (ANEW, "sparse")])
def test_bytes_of_targets_are_those_that_are_written(tmp_path: Path, tools: Any, accessors: Any) -> None:
    asset = limb(tmp_path / "limb.glb")
    job = read_job(asset, write_tools(tmp_path / "tools.yaml", tools), BakeOptions())
    (plan,) = plan_meshes(job)
    moved = target_sizes(plan, job.clips, 61, job.document.memory)
    size = morph_target_bytes(plan, moved, dense=accessors == "dense")
    baked = bake_once(asset, tools, accessors=accessors)
    (primitive,) = baked.json["meshes"][0]["primitives"]
    assert 0.7 < len(moved) / len(primitive["targets"]) < 1.3
    numbers = {index for target in primitive["targets"] for index in target.values()}
    written = 0
    for each in (baked.json["accessors"][number] for number in numbers):
        sparse = each.get("sparse")
        width = {5121: 1, 5123: 2, 5125: 4}[sparse["indices"]["componentType"]] if sparse else 0
        written += (sparse["count"] if sparse else each["count"]) * (12 + width)
    assert 0.6 < size / written < 1.5


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("tools", "options", "memory", "line"),
    [
        (
            MANY,
            {"accessors": "dense"},
            1_000_000,
            r"^limb: 16 dense morph targets of [\d,]+ vertices would take .*--max-mem",
        ),
        (MANY, {}, 200_000, r"^limb: 16 morph targets of [\d,]+ vertices would take .*: raise --max-memory$"),
        (MANY, {"fps": 1000.0}, 900_000, SAMPLES),
        (ANEW, {"fps": 1000.0}, 300_000, SAMPLES),
        (ANEW, {"fps": 1000.0}, 3_000_000, r" tools\[0\]: 2,001 frames of \d+ vertices, as \d+ shapes, would take"),
    ],
)
def test_too_much_is_refused_before_it_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tools: Any, options: Any, memory: int, line: str
) -> None:
    asset, path = limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml", tools, refinement={})
    monkeypatch.delattr(sampling, "play_keys")
    monkeypatch.delattr(projected, "play_keys")
    with pytest.raises(TooMuchError, match=line):
        bake(asset, path, tmp_path / "out.glb", max_memory=memory, **options)
    if line == SAMPLES:
        with pytest.raises(TooMuchError, match=line):
            check(asset, path, max_memory=memory, **options)


def test_frames_that_no_glb_holds_are_refused(paths: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(pipeline, "sample_effects")
    with pytest.raises(
        BakeError, match=r"^limb: 200,001 frames of [\d,]+ vertices would be .* GB, and a .glb holds 4 GiB"
    ):
        bake(*paths, paths[0].with_name("out.glb"), mode="frames", fps=100_000.0)


@pytest.mark.slow
def test_a_tool_that_slides_in_too_many_ways_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asset, tools = limb(tmp_path / "limb.glb", rings=16, angle=160.0), tmp_path / "tools.yaml"
    sliding = tool(attachment="patch", profile="polyline", bumps=8)
    write_tools(tools, sliding, refinement={"max_levels": 2})
    frames: list[int] = []
    original = posed._posed_at_once

    def counting(*arguments: Any) -> Any:
        frames.append(len(arguments[5]))
        return original(*arguments)

    monkeypatch.setattr(posed, "_posed_at_once", counting)
    said = (
        r" tools\[0\]: would need about \d{3} morph targets for about [\d,]+ moments of [\d,]+ .*,"
        r" and 256 may be, .*smooth"
    )
    with pytest.raises(BakeError, match=said):
        bake(asset, tools, tmp_path / "out.glb")
    assert not (tmp_path / "out.glb").exists()
    # A bake would pose some 6,000.
    assert sum(frames) < 32 + 5 * 16 + 128 + 256 + 8


@pytest.mark.slow
def test_more_vertices_are_not_projected_than_may_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asset = limb(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", ANEW, tool(name="other", attachment="patch"), tool(name="still"))
    (plan,) = plan_meshes(read_job(asset, tools, BakeOptions()))
    projected = sum(len(part.vertices) for part in plan.parts[:2])
    assert plan.layers[0].projected == projected
    monkeypatch.setattr(estimate, "_MOST_PROJECTED", 61 * projected)
    assert check(asset, tools).data["tools"]
    assert check(asset, tools, fps=90, only=["still"]).data["tools"]
    line = (
        rf"^limb: {projected} vertices under .* in each of 81 frames, {81 * projected:,} in all, and .*: use attachment"
    )
    with pytest.raises(BakeError, match=line):
        check(asset, tools, fps=40)
    for mode in ("morph", "frames"):
        with pytest.raises(BakeError, match=line):
            bake(asset, tools, tmp_path / "out.glb", fps=40, mode=mode)


@pytest.mark.slow
def test_values_between_keys_are_no_more_than_may_be(tmp_path: Path) -> None:
    asset, tools = limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml", ANEW, sampling={"fps": 0.5})
    with pytest.raises(
        TooMuchError, match=r"^fold: [\d,]+ moments of \d+ values to find keys would take .* MB.*-memory$"
    ):
        bake(asset, tools, tmp_path / "out.glb", max_memory=3_400_000)
    assert bake(asset, tools, tmp_path / "out.glb", max_memory=30_000_000).data["tools"]
