"""`wrinkle demo`: a figure with its tools, its bake and a picture, in a folder of their own."""

import json
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from kit.clients import assert_valid
from kit.command import Wrinkle, files
from wrinklecli.errors import WrinkleError
from wrinklecli.example import demo as module


@pytest.mark.slow
@pytest.mark.long
def test_it_bakes_and_draws_a_figure(wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise WrinkleError("pictures need Pillow", where="preview")

    folder = tmp_path / "a" / "b"
    ran = wrinkle("demo", folder)
    assert (ran.code, ran.out) == (0, "")
    names = ("figure.glb", "figure.yaml", "wrinkled.glb", "wrinkled.png")
    assert ran.lines[:4] == [f"written: {folder / name}" for name in names]
    assert "warning" not in "".join(ran.lines)
    assert sorted(files(folder)) == sorted(names)
    assert_valid(folder / "figure.glb", folder / "wrinkled.glb")
    with Image.open(folder / "wrinkled.png") as picture:
        before, after = (
            np.array(picture.convert("L"), float)[:, : picture.width // 2 * 2]
            .reshape(picture.height, 2, -1)
            .swapaxes(0, 1)
        )
    assert (np.abs(before - after) > 12).mean() > 0.01, "the wrinkles are seen"
    length = struct.unpack_from("<I", (folder / "figure.glb").read_bytes(), 12)[0]
    written = json.loads((folder / "figure.glb").read_bytes()[20 : 20 + length])
    assert [len(written[kind]) for kind in ("meshes", "skins", "images", "animations")] == [1, 1, 1, 2]
    # Without the libraries of pictures the other files have the same bytes, and a line says how to get a picture.
    monkeypatch.setattr(module, "refuse_missing", missing)
    monkeypatch.setattr(module, "bake", lambda *paths, **_: shutil.copy(folder / "wrinkled.glb", paths[2]))
    ran = wrinkle("demo", tmp_path / "new")
    assert ran.code == 0
    assert any("no picture: preview: pictures need Pillow" in line for line in ran.lines)
    assert files(tmp_path / "new") == {name: each for name, each in files(folder).items() if name != "wrinkled.png"}


@pytest.mark.parametrize("place", ["full", "full/file", "full/file/below", "new/a\0b"])
def test_it_goes_among_no_files(wrinkle: Wrinkle, tmp_path: Path, place: str) -> None:
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    ran = wrinkle("demo", tmp_path / place)
    assert ran.code == 1
    assert len(ran.lines) == 1
    assert files(tmp_path) == {"full/file": b"mine"}
