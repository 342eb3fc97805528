"""Options of a bake, as a record or by name, and names in the tools file that the asset has or lacks."""

from pathlib import Path

import pytest

import wrinklecli
from kit.asset import Asset
from kit.limb import Json, limb, limb_asset, tool, write_tools
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.errors import WrinkleError
from wrinklecli.review.inspect import inspect


@pytest.mark.slow
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


def unnamed() -> Asset:
    """A limb and a lining, as gltfpack leaves them: on nodes without names, below the nodes that had these names."""
    asset = limb_asset()
    limb, scene = asset.gltf["nodes"][0], asset.gltf["scenes"][0]["nodes"]
    asset.gltf["meshes"][0]["name"] = "Cylinder"
    asset.gltf["meshes"].append({**asset.gltf["meshes"][0], "name": "Inner"})
    for name, mesh in (("limb", 0), ("lining", 1)):
        bare = asset.append("nodes", {"mesh": mesh, "skin": 0})
        scene.append(asset.append("nodes", {"name": name, "children": [bare]}))
    limb.clear()
    return asset


def test_a_mesh_is_called_by_its_number_its_parent_or_its_own_name(tmp_path: Path) -> None:
    path = unnamed().write(tmp_path / "limb.glb")
    wanted = {"node_3": 3, "limb": 3, "Cylinder": 3, "node_5": 5, "lining": 5, "Inner": 5}
    for name, node in wanted.items():
        assert list(read_job(path, write_tools(tmp_path / "t.yaml", tool(node=name)), BakeOptions()).by_node) == [node]
    assert [each["node"] for each in inspect(path)["deforming"]] == ["node_3", "node_5"]
    assert faults(path, tool(), tool(name="b", node="limp")) == [
        "tools[0]: several meshes deform; say which, by node: one of 'limb', 'lining'",
        "tools[1].node: node 'limp' is no node with a mesh; did you mean 'limb'?; there are 'limb', 'lining'",
    ]


def test_of_two_nodes_of_one_name_each_has_a_name_of_its_own(tmp_path: Path) -> None:
    asset = unnamed()
    asset.gltf["nodes"][3]["name"] = asset.gltf["nodes"][5]["name"] = "body"
    asset.gltf["nodes"][4]["name"] = asset.gltf["nodes"][6]["name"] = "group"
    asset.gltf["meshes"][1]["name"] = "body"  # the nodes come first
    path = asset.write(tmp_path / "limb.glb")
    assert faults(path, tool(node="body"), tool(name="b", node="group")) == [
        "tools[0].node: 2 nodes with a mesh are meant by 'body'; say which: one of 'Cylinder', 'node_5'",
        "tools[1].node: 2 nodes with a mesh are meant by 'group'; say which: one of 'Cylinder', 'node_5'",
    ]
    for name, node in {"Cylinder": 3, "node_3": 3, "node_5": 5}.items():
        assert list(read_job(path, write_tools(tmp_path / "t.yaml", tool(node=name)), BakeOptions()).by_node) == [node]
    assert [each["node"] for each in inspect(path)["deforming"]] == ["node_3", "node_5"]


def test_a_tool_s_mesh_is_said_or_asked_for_by_name(tmp_path: Path) -> None:
    asset = limb_asset()
    asset.append("nodes", {"name": "twin", "mesh": 0, "skin": 0})
    asset.gltf["meshes"][0]["name"] = "Cylinder"
    path = asset.write(tmp_path / "limb.glb")
    tools = [tool(), tool(name="b", node="twn"), tool(name="c", node="Cylinder")]
    assert faults(path, *tools) == [
        "tools[0]: several meshes deform; say which, by node: one of 'limb', 'twin'",
        "tools[1].node: node 'twn' is no node with a mesh; did you mean 'twin'?; there are 'limb', 'twin'",
        "tools[2].node: 2 nodes with a mesh are meant by 'Cylinder'; say which: one of 'limb', 'twin'",
    ]
    pairs = [tool(name=f"{name}.L", mirror="x", origin=[0.1, 0.2, 0.0]) for name in "abc"]
    several = "several meshes deform; say which, by node: one of 'limb', 'twin'"
    assert faults(path, *pairs) == [f"tools[0]: {several}; the same holds for 5 more tools"]


def test_each_file_that_is_read_is_one_input(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.gltf")
    tools = write_tools(tmp_path / "tools.yaml")
    inputs = [Path(each).name for each in read_job(asset, tools, BakeOptions()).inputs]
    assert sorted(inputs) == sorted(each.name for each in tmp_path.iterdir())
