"""Options of a bake, as a record or by name, and names in the tools file that the asset has or lacks."""

from pathlib import Path

import pytest

import wrinklecli
from kit.limb import Json, limb, limb_asset, tool, write_tools
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.errors import WrinkleError


def test_options_are_a_record_or_named_or_both(tmp_path: Path) -> None:
    asset, tools = limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml", sampling={"fps": 10})
    record = BakeOptions(max_levels=0, accessors="dense")
    made = [
        wrinklecli.bake(asset, tools, tmp_path / "record.glb", record),
        wrinklecli.bake(asset, tools, tmp_path / "named.glb", max_levels=0, accessors="dense"),
        wrinklecli.bake(asset, tools, tmp_path / "both.glb", BakeOptions(max_levels=0), accessors="dense"),
    ]
    assert made[0].data == made[1].data == made[2].data
    written = {(tmp_path / f"{name}.glb").read_bytes() for name in ("record", "named", "both")}
    assert len(written) == 1
    assert wrinklecli.BakeOptions is BakeOptions


def test_an_unknown_option_is_an_error(tmp_path: Path) -> None:
    asset, tools = limb(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml")
    with pytest.raises(TypeError, match="max_level"):
        wrinklecli.bake(asset, tools, tmp_path / "out.glb", max_level=0)
    assert not (tmp_path / "out.glb").exists()


def faults(path: Path, *tools: Json, **header: object) -> list[str]:
    """What is wrong with tools on an asset, without the name of their file."""
    file = write_tools(path.parent / "tools.yaml", *tools, **header)
    with pytest.raises(WrinkleError) as caught:
        read_job(path, file, BakeOptions())
    return [line.removeprefix(f"{file}:1: ") for line in caught.value.lines]


def test_clips_that_the_file_names_and_the_asset_lacks_are_errors_unless_the_tool_is_optional(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb")
    tools = [
        tool(clips={"fold": 1, "flod": 0}),
        tool(name="keyed", rest_length={"keys": {"fodl": [[0, 1]]}}),
        tool(name="perhaps", clips={"walk": 0}, optional=True),
        tool(name="inherits"),
    ]
    header = {"sampling": {"clips": ["fold", "fond"]}, "defaults": {"clips": {"run": 1}}}
    absent = "the asset has no clip"
    assert faults(path, *tools, **header) == [
        f"sampling.clips: {absent} 'fond'; did you mean 'fold'?; there are 'fold'",
        f"tools[0].clips.flod: {absent} 'flod'; did you mean 'fold'?; there are 'fold'",
        f"defaults.clips.run: {absent} 'run'; there are 'fold'",
        f"tools[1].rest_length.keys.fodl: {absent} 'fodl'; did you mean 'fold'?; there are 'fold'",
    ]
    job = read_job(path, write_tools(tmp_path / "tools.yaml", tools[2]), BakeOptions())
    assert job.warnings == ("perhaps: the asset has no clip 'walk'; there are 'fold'",)
    # What is asked for on the command line stands for what the file says.
    file = write_tools(tmp_path / "tools.yaml", sampling={"clips": ["fond"]})
    assert [clip.name for clip in read_job(path, file, BakeOptions(clips=["fold"])).clips] == ["fold"]


def test_a_tool_s_mesh_is_said_or_asked_for_by_name(tmp_path: Path) -> None:
    asset = limb_asset()
    asset.append("nodes", {"name": "twin", "mesh": 0, "skin": 0})
    asset.gltf["meshes"][0]["name"] = "Cylinder"
    path = asset.write(tmp_path / "limb.glb")
    tools = [tool(), tool(name="b", node="twn"), tool(name="c", node="Cylinder")]
    assert faults(path, *tools) == [
        "tools[0]: several meshes deform; say which, by node: one of 'limb', 'twin'",
        "tools[1].node: node 'twn' is no node with a mesh; did you mean 'twin'?; there are 'limb', 'twin'",
        "tools[2].node: node 'Cylinder' is no node with a mesh; the mesh of that name is on 'limb', 'twin'; there are"
        " 'limb', 'twin'",
    ]
    pairs = [tool(name=f"{name}.L", mirror="x", origin=[0.1, 0.2, 0.0]) for name in "abc"]
    several = "several meshes deform; say which, by node: one of 'limb', 'twin'"
    assert faults(path, *pairs) == [f"tools[0]: {several}; the same holds for 5 more tools"]
