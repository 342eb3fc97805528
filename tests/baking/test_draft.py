"""A draft: a bake for a quick look, which nobody can mistake for a finished one."""

from pathlib import Path

import pytest

import wrinklecli
from kit.command import Wrinkle
from kit.limb import limb, tool, write_tools
from kit.player import Gltf


@pytest.mark.slow
def test_a_draft_is_less_refined_and_not_proven_and_says_so_wherever_it_goes(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", rings=12, sides=10)
    tools = write_tools(tmp_path / "tools.yaml")
    ran = wrinkle("bake", asset, tools, "-o", "draft.glb", "--draft")
    assert ran.code == 0
    assert ran.lines[-1].startswith("draft.glb: a draft (one level less refined, not proven), 1 tool, ")
    done = wrinklecli.bake(asset, tools, tmp_path / "done.glb")
    draft = wrinklecli.bake(asset, tools, tmp_path / "again.glb", draft=True, details=True)
    assert (draft.data["draft"], done.data["draft"]) == (True, False)
    assert draft.data["meshes"][0]["levels"] == done.data["meshes"][0]["levels"] - 1
    assert not any("residual" in clip for clip in draft.data["clips"])
    assert all("residual" in clip for clip in done.data["clips"])
    extras = [Gltf(tmp_path / name).json["nodes"][0]["extras"]["wrinkle"] for name in ("draft.glb", "done.glb")]
    assert [each.get("draft") for each in extras] == [True, None]
    assert "  a draft: neither proven nor fully refined" in wrinkle("inspect", "draft.glb").out.splitlines()
    compared = wrinkle("diff", "done.glb", "draft.glb")
    assert compared.code == 1
    assert "/nodes/0/extras/wrinkle/draft (limb): True only in B" in compared.out
    tracked = wrinkle("track", "draft.glb", asset, "-o", "tracked")
    assert any("is of `bake --draft`" in line for line in tracked.lines)
    assert wrinkle("track", "draft.glb", asset, "-o", "strict", "--strict").code == 3
    # The asset that a draft keeps is the asset: a bake of it is finished.
    wrinklecli.bake(tmp_path / "draft.glb", tools, tmp_path / "replaced.glb", replace=True)
    assert (tmp_path / "replaced.glb").read_bytes() == (tmp_path / "done.glb").read_bytes()


def test_a_draft_leaves_contact_out_and_says_so(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", rings=12, sides=10)
    tools = write_tools(tmp_path / "tools.yaml", tool(contact="resolve"))
    ran = wrinkle("bake", asset, tools, "-o", "draft.glb", "--draft")
    assert ran.code == 0
    assert any("crease: contact is left out, as in every draft" in line for line in ran.lines), ran.lines
    assert not any(
        "_contact_" in name for name in Gltf(tmp_path / "draft.glb").json["meshes"][0]["extras"]["targetNames"]
    )


@pytest.mark.parametrize("levels", [0, 1])
def test_a_draft_refines_one_level_less_than_it_may(levels: int, tmp_path: Path) -> None:
    asset, tools = limb(tmp_path / "limb.glb", rings=12, sides=10), write_tools(tmp_path / "tools.yaml")
    report = wrinklecli.bake(asset, tools, tmp_path / "out.glb", draft=True, max_levels=levels)
    assert report.data["meshes"][0]["levels"] == 0
