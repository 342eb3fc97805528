"""Bakes with clips of other files: they are baked like the asset's own, and the record has the asset alone."""

from pathlib import Path
from typing import Any

import pytest

from kit.asset import bare_skeleton
from kit.clients import assert_valid
from kit.command import Wrinkle, files
from kit.limb import limb, limb_asset, tool, write_tools
from kit.player import Gltf, wrinkle_columns
from wrinklecli import bake

LIMB: dict[str, Any] = {"rings": 9, "sides": 6, "morphs": 1}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A body without clips, its tools, the clip of its joints in another file, and the whole as it is usually."""
    limb(tmp_path / "body.glb", **LIMB, clip=None)
    limb(tmp_path / "whole.glb", **LIMB)
    anim = limb_asset(**LIMB)
    bare_skeleton(anim.gltf)
    anim.gltf["images"] = [{"uri": "skin.png"}]
    anim.write(tmp_path / "anim.gltf", buffer="file")
    (tmp_path / "skin.png").write_bytes(b"\x89PNG")
    write_tools(tmp_path / "tools.yaml", tool())
    return tmp_path


def baked(folder: Path, asset: str, out: str, *anims: str, **options: Any) -> bytes:
    report = bake(
        folder / asset, folder / "tools.yaml", folder / out, anims=[folder / each for each in anims], **options
    )
    assert {str(folder / each) for each in anims} <= {*report.inputs}
    return (folder / out).read_bytes()


@pytest.mark.slow
def test_a_bake_with_the_clips_of_another_file_is_that_of_the_whole(folder: Path) -> None:
    baked(folder, "body.glb", "still.glb")
    baked(folder, "whole.glb", "one.glb")
    data = baked(folder, "body.glb", "out.glb", "anim.gltf")
    out, one, still = (Gltf(folder / name) for name in ("out.glb", "one.glb", "still.glb"))
    times, expected = one.keys("fold", "limb")
    found = out.keys("fold", "limb")
    assert found[0] == pytest.approx(times)
    assert found[1] == pytest.approx(expected)
    assert expected[:, wrinkle_columns(one, "limb")].max() > 0.1
    assert out.keys("fold", 2, "rotation")[1] == pytest.approx(one.keys("fold", 2, "rotation")[1])
    # Targets hang on no clip.
    assert (out.deltas("limb") == still.deltas("limb")).all()
    assert_valid(out.path)
    # The record is that of the asset alone, with and without the clips.
    assert baked(folder, "out.glb", "again.glb", "anim.gltf", replace=True) == data
    assert baked(folder, "out.glb", "alone.glb", replace=True) == (folder / "still.glb").read_bytes()
    # To .gltf, the clips lie in a file beside it.
    baked(folder, "body.glb", "out.gltf", "anim.gltf")
    assert Gltf(folder / "out.gltf").keys("fold", "limb")[1] == pytest.approx(expected)
    assert_valid(folder / "out.gltf")
    assert baked(folder, "out.gltf", "again.gltf", replace=True)


def test_what_is_wrong_with_an_anim_is_one_line_and_nothing_is_written(folder: Path, wrinkle: Wrinkle) -> None:
    stranger = limb_asset(**LIMB)
    bare_skeleton(stranger.gltf)
    for node in stranger.gltf["nodes"]:
        node["name"] = f"other {node['name']}"
    stranger.write(folder / "stranger.glb")
    (folder / "cut.glb").write_bytes((folder / "whole.glb").read_bytes()[:200])
    before = files(folder)
    for name, message in (("stranger.glb", "has no joints of"), ("cut.glb", "truncated"), ("none.glb", "no such file")):
        arguments = [folder / "body.glb", folder / "tools.yaml", "--anim", folder / name, "-o", folder / "out.glb"]
        ran = wrinkle("bake", *arguments)
        assert ran.code == 1
        (line,) = ran.lines
        assert f"{name}: " in line
        assert message in line.lower()
    assert files(folder) == before


def test_no_file_of_an_anim_is_written_over(folder: Path, wrinkle: Wrinkle) -> None:
    before = files(folder)
    for name in ("anim.gltf", next(each for each in before if each.endswith(".bin")), "skin.png"):
        option = ["-o", folder / name] if name.endswith("gltf") else ["-o", folder / "o.glb", "--report", folder / name]
        ran = wrinkle("bake", folder / "body.glb", folder / "tools.yaml", "--anim", folder / "anim.gltf", *option)
        assert ran.code == 1, name
        assert name in ran.lines[-1]
        assert files(folder) == before


def test_the_depfile_names_anims(folder: Path, wrinkle: Wrinkle, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    ran = wrinkle("bake", "body.glb", "tools.yaml", "--anim", "anim.gltf", "-o", "out.glb", "--depfile", "out.d")
    assert ran.code == 0
    assert set((folder / "out.d").read_text().splitlines()[0].split()[1:]) == {
        "body.glb",
        "tools.yaml",
        "anim.gltf",
        next(path.name for path in folder.glob("*.bin")),
    }
