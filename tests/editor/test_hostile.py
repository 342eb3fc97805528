"""What is wrong with files is said in a line, and no file is ever half written."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from kit.asset import stored
from kit.command import files
from kit.guard import Fault, failing, only_within
from kit.limb import limb, limb_asset
from wrinklecli.editor.asset import ReadOptions
from wrinklecli.editor.session import Session
from wrinklecli.errors import BakeError, WrinkleError

TOOL = "tools: [{name: a, origin: [-0.4, 0.25, 0], target: [0.4, 0.25, 0], width: 0.3}]\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("tools: [", "YAML"),
        ("- 1\n", "expected a mapping"),
        ("version: 1\ntools: 5\n", "tools.yaml:2: tools"),
        ("", "empty"),
        ("version: 1\nrest: {clip: none}\n" + TOOL, "'none'"),
    ],
)
def test_a_broken_file_is_a_line(text: str, said: str, tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", rings=6, sides=6)
    (tmp_path / "tools.yaml").write_text(text)
    with pytest.raises(WrinkleError, match=said):
        Session(path, tmp_path / "tools.yaml").meshes(None, 0.0)
    assert (tmp_path / "tools.yaml").read_text() == text


def test_a_clip_with_a_nan_is_a_line(tmp_path: Path) -> None:
    asset = limb_asset(rings=6, sides=6)
    (sampler,) = asset.gltf["animations"][0]["samplers"]
    stored(asset, sampler["output"])[1] = np.nan
    session = Session(asset.write(tmp_path / "limb.glb"))
    session.meshes(None, 0.0)
    with pytest.raises(WrinkleError, match="finite"):
        session.meshes(session.clips[0].name, 0.5)


def test_an_asset_that_takes_too_much_memory_is_a_line(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", rings=60, sides=60)
    with pytest.raises(WrinkleError, match="max-memory"):
        Session(path, read_options=ReadOptions(max_memory=100_000)).meshes(None, 0.0)


def test_an_interrupted_save_leaves_a_whole_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = limb(tmp_path / "limb.glb", rings=6, sides=6)
    tools = tmp_path / "tools.yaml"
    tools.write_text("version: 1\n" + TOOL)
    own = str(tmp_path / "own")
    session = Session(path, tools, own_folder=own)
    session.set_value("a", ("bumps",), 2)

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            session.save()
    assert tools.read_text() == "version: 1\n" + TOOL
    assert session.changed
    assert Session(path, tools, own_folder=own).text == session.text
    session.save()
    assert "bumps: 2" in tools.read_text()
    assert sorted(each.name for each in tmp_path.rglob("*")) == ["limb.glb", "own", "tools.yaml"]


@pytest.mark.parametrize("name", ["ENOSPC", "EIO", "EROFS", "EACCES"])
def test_a_save_on_a_disk_that_fails_changes_nothing_and_is_a_line(name: str, tmp_path: Path) -> None:
    path, tools = limb(tmp_path / "limb.glb", rings=6, sides=6), tmp_path / "tools.yaml"
    tools.write_text("version: 1\n" + TOOL)
    session = Session(path, tools)
    session.set_value("a", ("bumps",), 2)
    before = files(tmp_path)
    for left in range(20):
        with only_within(tmp_path), failing(Fault(name, left if name in ("ENOSPC", "EIO") else 0)):
            try:
                session.save()
            except BakeError as error:
                said = error.lines
            else:
                break
        assert said == (f"{tools}: cannot be written: {os.strerror(getattr(errno, name))}",)
        assert files(tmp_path) == before
        assert session.changed
    assert left > 0
    session.save()
    assert "bumps: 2" in tools.read_text()
    assert files(tmp_path).keys() == {"limb.glb", "tools.yaml"}
