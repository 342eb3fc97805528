"""`wrinkle check --crossings`: what goes through itself or something else, when, where, before and after a bake."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import wrinklecli
from kit.asset import Asset
from kit.command import Wrinkle
from kit.limb import LENGTH, RADIUS, flat_limb, limb, limb_asset, posed_limb, sleeved_limb, tool, write_tools
from wrinklecli.baking.track import track
from wrinklecli.errors import BakeError
from wrinklecli.review.crossings import crossings


@pytest.mark.slow
def test_a_fold_that_closes_crosses_and_wrinkles_add_to_it(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", angle=140.0, rings=16, sides=12)
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=3, max_height="15%"))
    (bare,), (clip,) = crossings(asset).data["clips"], crossings(asset, tools).data["clips"]
    (counts,) = bare["counts"]
    assert bare["totals"] == [sum(counts)]
    assert bare["level"] is None
    assert counts[0] == 0 < max(counts)
    assert clip["counts"][0] == counts
    assert clip["totals"][1] > clip["totals"][0]
    place = clip["places"][0]
    assert "joint_1" in place["between"]
    # The limb folds in its middle, towards +y.
    assert abs(place["at"][0]) < LENGTH / 4
    assert 0 < place["at"][1] <= 1.2 * RADIUS

    # The baked file says the same of itself as of asset and tools together, but for float32.
    wrinklecli.bake(asset, tools, tmp_path / "out.glb")
    (baked,) = crossings(tmp_path / "out.glb").data["clips"]
    assert baked["counts"][0] == clip["counts"][0]
    assert baked["totals"][1] == pytest.approx(clip["totals"][1], rel=0.1)

    # A file that is rewritten tells no more what it was before.
    track(tmp_path / "out.glb", [tmp_path / "out.glb"], tmp_path / "tracked")
    tracked = crossings(tmp_path / "tracked" / "out.glb")
    assert tracked.data["states"] == ["asset"]
    # So parts of edges that refinement has split count one by one.
    (total,) = tracked.data["clips"][0]["totals"]
    assert baked["totals"][1] < total < 1.25 * baked["totals"][1]
    (line,) = tracked.warnings
    assert "rewritten since its bake" in line
    with pytest.raises(BakeError, match="bake from the original asset"):
        crossings(tmp_path / "tracked" / "out.glb", tools)


def test_an_open_limb_does_not_cross_but_what_passes_through_it_does(tmp_path: Path) -> None:
    asset = limb_asset(angle=20.0, rings=8, sides=8)
    assert crossings(asset.write(tmp_path / "a.glb")).data["stored_pose"] == [0]
    # The same mesh once more, without the skin and a little higher.
    asset.append("nodes", {"name": "cape", "mesh": 0, "translation": [0.01, RADIUS, 0.02]})
    asset.gltf["scenes"][0]["nodes"].append(len(asset.gltf["nodes"]) - 1)
    assert crossings(asset.write(tmp_path / "b.glb")).data["stored_pose"][0] > 0


def test_the_command_prints_tables_json_and_what_it_cannot_do(
    tmp_path: Path, wrinkle: Wrinkle, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    limb(tmp_path / "limb.glb", angle=140.0, rings=12, sides=8)
    out = wrinkle("check", "limb.glb", "--crossings").out.splitlines()
    assert out[0] == "stored pose: 0"
    assert out[1].startswith("fold: ")
    assert "in 13 moments, most at" in out[1]
    data = json.loads(wrinkle("check", "limb.glb", "--crossings", "--json", "--fps", "10").out)
    assert list(data)[:5] == ["crossings", "asset", "tools_file", "states", "stored_pose"]
    assert data["states"] == ["asset"]
    assert len(data["clips"][0]["times"]) == len(data["clips"][0]["counts"][0])
    assert wrinkle("check", "limb.glb", "--crossings", "--plot", "a.svg").code == 2
    assert wrinkle("check", "limb.glb").code == 2
    assert wrinkle("check", "limb.glb", "--crossings", "--clip", "none").code == 1


@pytest.mark.slow
def test_frames_that_are_hidden_cost_nothing(tmp_path: Path) -> None:
    """A file of frames hides all meshes but one, each in a point: boxes that all meet, with nothing that crosses."""
    asset = limb(tmp_path / "limb.glb", angle=140.0, rings=12, sides=8)
    tools = write_tools(tmp_path / "tools.yaml", tool(), refinement={"max_levels": 0})
    wrinklecli.bake(asset, tools, tmp_path / "frames.glb", mode="frames")
    wrinklecli.bake(asset, tools, tmp_path / "morphs.glb")
    shown, morphed = (crossings(tmp_path / name).data["clips"][0] for name in ("frames.glb", "morphs.glb"))
    assert shown["counts"][0][6] == morphed["counts"][1][6] > 0


@pytest.mark.slow
@pytest.mark.long
def test_clips_of_other_files_are_compared_in_the_file_baked_with_them(tmp_path: Path) -> None:
    """Clips of `bake --anim` are in the baked file alone; the original, which its record restores, plays them too."""
    asset = limb_asset(clip=None, rings=12, sides=8, joints=3, morphs=2, root={"matrix": np.eye(4).ravel().tolist()})
    bare, tools = asset.write(tmp_path / "limb.glb"), write_tools(tmp_path / "tools.yaml", tool(bumps=2))
    anims = [
        limb(tmp_path / "fold.glb", angle=260.0, joints=3, morphs=2, morph_clip="CUBICSPLINE"),
        limb(tmp_path / "grow.glb", clip="grow", joints=3, root={}),
    ]
    wanted = crossings(bare, tools, anims=anims).data["clips"]
    assert max(wanted[0]["counts"][0]) > 0
    for name, options in {"morph": {}, "split": {"split": True}, "own": {"tracks": "none"}}.items():
        wrinklecli.bake(bare, tools, tmp_path / f"{name}.glb", anims=anims, **options)
        found = crossings(tmp_path / f"{name}.glb").data["clips"]
        assert [clip["name"] for clip in found] == ["fold", "grow"]
        assert [clip["counts"][0] for clip in found] == [clip["counts"][0] for clip in wanted]
    # More clips come behind those.
    (again,) = crossings(tmp_path / "morph.glb", anims=anims[:1], clips=["fold 2"]).data["clips"]
    assert again["counts"][0] == wanted[0]["counts"][0]


def test_a_clip_of_one_moment_is_counted_once(tmp_path: Path) -> None:
    asset = posed_limb(tmp_path / "limb.glb", degrees=140.0)
    pose, *in_range = crossings(asset).data["clips"]
    assert in_range, "the clip holds still"
    assert pose["times"] == [0.5]
    assert pose["totals"] == pose["counts"][0]
    assert pose["totals"][0] > 0
    (by_hand,) = crossings(asset, pose=[("joint_1", "z", 140.0)]).data["clips"]
    assert by_hand["counts"] == pose["counts"]


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("build", [limb_asset, flat_limb])
@pytest.mark.parametrize("angle", [120.0, 140.0])
def test_what_refinement_alone_has_split_counts_once(build: Callable[..., Asset], angle: float, tmp_path: Path) -> None:
    """The tool stays flat in the clip, and its patch is refined, and round where the mesh is smooth."""
    asset = build(angle=angle, rings=16, sides=12).write(tmp_path / "limb.glb")
    tools = write_tools(
        tmp_path / "tools.yaml", tool(bumps=3, width=0.8, clips={"fold": 0}), refinement={"max_levels": 2}
    )
    (clip,) = crossings(asset, tools).data["clips"]
    before, after = (np.array(each) for each in clip["counts"])
    assert before.max() >= 24
    # The two sides of a fold are symmetric, and meet exactly.
    assert np.abs(after - before).max() <= 3
    assert clip["level"] == clip["counts"][1]
    assert clip["places"][0]["counts"] == clip["totals"]
    # Nothing is lost where wrinkles rise.
    write_tools(tools, tool(bumps=3, width=0.8), refinement={"max_levels": 2})
    (risen,) = crossings(asset, tools).data["clips"]
    assert risen["totals"][1] > 1.5 * clip["totals"][1]
    # Without the wrinkles, but in as many parts.
    assert clip["totals"][1] < sum(risen["level"]) < risen["totals"][1]


@pytest.mark.slow
def test_parts_of_a_split_mesh_and_other_meshes_count_as_ever(tmp_path: Path) -> None:
    asset = sleeved_limb(gap=0.02, rings=16, sides=12, angle=120.0).write(tmp_path / "limb.glb")
    one = tool(bumps=3, width=0.8, node="limb", clips={"fold": 0})
    tools = write_tools(tmp_path / "tools.yaml", one, refinement={"max_levels": 2})
    for split in (False, True):
        wrinklecli.bake(asset, tools, tmp_path / "out.glb", split=split)
        (clip,) = crossings(tmp_path / "out.glb").data["clips"]
        before, after = (np.array(each) for each in clip["counts"])
        assert len(clip["places"]) > 1
        # Refined, the limb is a little thicker than the coarse sleeve.
        assert np.abs(after - before).max() <= 0.1 * before.max()
