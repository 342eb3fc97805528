"""What a preview shows of assets without clips, of poses, and of clips of other files."""

from pathlib import Path

import pytest

from kit.command import Wrinkle
from kit.limb import limb, tool, write_tools
from wrinklecli.character.moved import Motions, moved
from wrinklecli.gltf.document import read_document
from wrinklecli.review.preview.moments import plan_moments
from wrinklecli.review.preview.preview import with_motions
from wrinklecli.review.preview.preview_options import PreviewOptions

SMALL = "--size=64x48"


def shown(path: Path, options: PreviewOptions, motions: Motions, *, animated: bool = False) -> list[tuple[str, float]]:
    joined = moved(read_document(path), [0], motions)
    moments = plan_moments(joined.document, with_motions(options, joined, animated=animated), animated=animated)
    return [(str(moment.clip), moment.time) for moment in moments]


def test_of_an_asset_without_clips_six_motions_are_shown_at_their_ends(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", clip=None, joints=4, morphs=3)
    found = shown(path, PreviewOptions(), Motions())
    # One of each joint, then morph targets.
    names = [name.split()[0] for name, _ in found]
    assert sorted(names) == ["joint_1", "joint_2", "joint_3", "morph_0", "morph_1", "morph_2"]
    assert {time for _, time in found} == {1.0}
    assert [name for name, _ in shown(path, PreviewOptions(clips=["morph_1"], times=(0.5,)), Motions())] == ["morph_1"]
    assert shown(path, PreviewOptions(rest=True), Motions(range_of_motion=False)) == [("None", 0.0)]
    assert len(shown(path, PreviewOptions(), Motions(), animated=True)) == 6 * 15
    assert shown(path, PreviewOptions(), Motions(morphs=[("morph_0", 1.0)])) == [("morph_0=1", 0.0)]
    folds = limb(tmp_path / "folds.glb")
    anims = Motions(anims=[folds])
    assert {name for name, _ in shown(limb(tmp_path / "grows.glb", clip="grow"), PreviewOptions(), anims)} == {"fold"}
    assert {name for name, _ in shown(folds, PreviewOptions(), Motions(range_of_motion=True))} == {"fold"}


def test_clips_that_hold_still_count_as_none(tmp_path: Path) -> None:
    """Exporters write the pose of the character as such a clip."""
    path = limb(tmp_path / "limb.glb", angle=0.0)
    assert {name for name, _ in shown(path, PreviewOptions(), Motions())} > {"joint_1 about x, +45°"}
    assert {name for name, _ in shown(path, PreviewOptions(clips=["fold"]), Motions())} == {"fold"}
    (note,) = moved(read_document(path), [0], Motions()).notes
    assert note.endswith("its clips hold still; looked at in 6 motions of 1 joint")


@pytest.mark.slow
def test_the_command_shows_poses_motions_and_clips_of_other_files(tmp_path: Path, wrinkle: Wrinkle) -> None:
    pytest.importorskip("embreex")
    path = limb(tmp_path / "limb.glb", clip=None, rings=7, sides=6)
    whole = limb(tmp_path / "whole.glb", rings=7, sides=6)
    tools, out = write_tools(tmp_path / "tools.yaml", tool()), tmp_path / "out.png"
    ran = wrinkle("preview", path, "-o", out, SMALL)
    assert ran.code == 0
    assert "has no clip; looked at in 6 motions of 1 joint" in ran.lines[-2]
    assert "6 moments" in ran.lines[-1]
    for options, told in (
        (["--pose=joint_1=z:60"], "1 moment"),
        (["--anim", whole], "5 moments"),
        (["--tools", tools], "1 tool"),
        (["--tools", tools, "--review", "--pose=joint_1=z:60"], "1 tool"),
        (["--tools", tools, "--anim", whole, "--clip=fold", "--times=1"], "1 moment"),
        (["--clip=joint_1 about z, +90°"], "5 moments"),
    ):
        ran = wrinkle("preview", path, "-o", out, SMALL, *options)
        assert ran.code == 0, ran.lines
        assert told in ran.lines[-1]
    ran = wrinkle("preview", path, "-o", out, "--pose=joint_1=z:60", "--rest")
    assert (ran.code, "without '--rest'" in ran.lines[-1]) == (2, True)
    ran = wrinkle("preview", path, "-o", out, "--anim", out)
    assert ran.code == 1
    assert "out.png" in ran.lines[0]
