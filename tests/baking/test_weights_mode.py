"""`bake --mode weights`: the mesh stays as it is, and clips carry the weights that wrinkle maps need."""

import json
from pathlib import Path

import numpy as np
import pytest

from kit.bakes import bake_config
from kit.clients import assert_valid, compare_with_three, map_weights
from kit.command import Wrinkle
from kit.places import ROOT
from kit.player import Gltf
from kit.samples import sample
from wrinklecli import diff, maps


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", ["trousers", "head"])
def test_clips_have_the_weights_of_a_whole_bake_and_the_mesh_is_as_it_was(name: str) -> None:
    whole, made, before = bake_config(name, name), bake_config(name, name, mode="weights"), Gltf(sample(name))
    names = made.mesh(name)["extras"]["targetNames"]
    assert names == whole.mesh(name)["extras"]["targetNames"]
    times = np.linspace(0.0, 2.0, 41)
    for clip in (each["name"] for each in before.json["animations"]):
        assert np.allclose(made.weights(name, clip, times), whole.weights(name, clip, times), atol=1e-6)
        # Weights of the asset's own targets are stored anew at the keys of the new ones.
        assert np.allclose(made.pose(name, clip, times), before.pose(name, clip, times), atol=1e-7)
    assert_valid(made.path)
    compare_with_three(made.path, name, clip, times[::10].tolist(), made.pose(name, clip, times[::10]))
    assert made.path.stat().st_size - sample(name).stat().st_size < 20_000  # bytes: keys, and one entry of zeros


@pytest.mark.slow
@pytest.mark.long
def test_targets_have_the_names_and_the_weights_of_maps(tmp_path: Path) -> None:
    """A morph target of the asset raises the brows, which the page that plays maps follows as well."""
    made = bake_config("head", "head", mode="weights")
    data = maps(sample("head"), ROOT / "configs" / "head.yaml", tmp_path / "maps", size=192, supersample=1).data
    named = {weight["target"] for each in data["materials"] for part in each["sets"] for weight in part["weights"]}
    assert named <= set(made.mesh("head")["extras"]["targetNames"])
    extras = made.json["nodes"][0]["extras"]["wrinkle"]["tools"]
    assert [each["targets"] for each in extras] == [each["targets"] for each in data["nodes"][0]["wrinkle"]["tools"]]
    times = [0.0, 0.4, 0.7, 1.0]
    weights = made.weights("head", "raise_brows", np.array(times))
    assert weights.max() > 0.9
    order = made.mesh("head")["extras"]["targetNames"]
    for found, wanted in zip(
        map_weights(sample("head"), tmp_path / "maps", "raise_brows", times), weights, strict=True
    ):
        assert found.keys() == named
        assert max(abs(weight - wanted[order.index(name)]) for name, weight in found.items()) < 0.02


@pytest.mark.slow
def test_what_moves_the_mesh_is_left_out_and_the_bake_can_be_replaced(wrinkle: Wrinkle) -> None:
    tools = ROOT / "configs" / "body.yaml"
    ran = wrinkle("bake", sample("body"), tools, "--mode", "weights", "-o", "out.glb")
    assert ran.code == 0
    assert "note: belly: left out, as it moves the body; maps hold wrinkles alone" in ran.lines
    assert ran.lines[-1] == "out.glb: 4 tools, 4 morph targets, which move nothing, 3 clips"
    assert wrinkle("bake", "out.glb", tools, "--replace", "--mode", "weights", "-q", "-o", "again.glb").code == 0
    assert diff("out.glb", "again.glb").same
    assert Path("out.glb").read_bytes() == Path("again.glb").read_bytes()


def test_parts_and_muscles_alone_are_refused(wrinkle: Wrinkle, tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(
        json.dumps({"version": 1, "flesh": [{"name": "a", "at": [0, 1, 0.17], "radius": 0.1}]})
    )
    for arguments, said in (
        ((ROOT / "configs" / "body.yaml", "--split"), "split keeps morph targets from what they do not move"),
        (("m.yaml",), "has no wrinkling tool and no field that maps could show"),
    ):
        ran = wrinkle("bake", sample("body"), *arguments, "--mode", "weights", "-o", "out.glb")
        assert (ran.code, len(ran.lines)) == (1, 1)
        assert said in ran.lines[0]
        assert not Path("out.glb").exists()
