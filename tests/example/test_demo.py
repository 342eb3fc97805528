"""`wrinkle demo`: a figure with its tools, its bake and a picture, in a folder of their own."""

import io
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from kit.clients import assert_valid
from kit.command import Wrinkle, files
from wrinklecli import CheckOptions, check
from wrinklecli.errors import WrinkleError
from wrinklecli.example import demo as module
from wrinklecli.example.characters import Character, Joint, to_glb
from wrinklecli.example.figure import base_colour, make_figure
from wrinklecli.example.png import encode_png
from wrinklecli.example.shapes import Mesh


def test_a_character_has_one_root() -> None:
    empty = Mesh(*(np.zeros((0, *shape)) for shape in ((3,), (4,), (4, 2), (3,), ())))
    joints = tuple(Joint(name, None, (0.0, 0.0, 0.0)) for name in ("hips", "hand"))
    with pytest.raises(ValueError, match=r": hips, hand$"):
        to_glb(Character("two", empty, joints, np.zeros((0, 2)), (), (1.0, 1.0, 1.0), "skin", 0.8))


@given(arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3))))
def test_other_programs_read_a_picture_as_it_was_written(pixels: np.ndarray) -> None:
    with Image.open(io.BytesIO(encode_png(pixels))) as read:
        assert read.mode == "RGB"
        assert np.array_equal(np.array(read), pixels)


def test_the_texture_has_cloth_and_skin() -> None:
    with Image.open(io.BytesIO(base_colour(128))) as image:
        colours = np.array(image, int).reshape(-1, 3)
    red, _, blue = colours.T
    assert (blue > red + 40).mean() > 0.1, "denim"
    assert ((red > blue + 50) & (red > 150)).mean() > 0.02, "skin"
    assert (np.ptp(colours, axis=1) < 40).mean() > 0.05, "the shirt's white"


@pytest.mark.slow
def test_it_makes_bakes_and_draws_a_figure(wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> None:
        raise WrinkleError("pictures need Pillow", where="preview")

    figure = make_figure()  # takes as long as the bake, and is the same in both runs
    monkeypatch.setattr(module, "make_figure", lambda: figure)
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
    assert check(folder / "figure.glb", folder / "figure.yaml", CheckOptions()).warnings == ()
    length = struct.unpack_from("<I", (folder / "figure.glb").read_bytes(), 12)[0]
    written = json.loads((folder / "figure.glb").read_bytes()[20 : 20 + length])
    assert [len(written[kind]) for kind in ("meshes", "skins", "images", "animations")] == [1, 1, 1, 1]
    # Without the libraries of pictures the other files have the same bytes, and a line says how to get a picture.
    monkeypatch.setattr(module, "refuse_missing", missing)
    ran = wrinkle("demo", tmp_path / "new")
    assert ran.code == 0
    assert any("no picture: preview: pictures need Pillow" in line for line in ran.lines)
    assert files(tmp_path / "new") == {name: each for name, each in files(folder).items() if name != "wrinkled.png"}


@pytest.mark.parametrize("place", ["full", "full/file", "full/file/below", "new/a\0b"])
def test_it_goes_among_no_files(wrinkle: Wrinkle, tmp_path: Path, place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "make_figure", None)  # it is not made in vain
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").write_text("mine")
    ran = wrinkle("demo", tmp_path / place)
    assert ran.code == 1
    assert len(ran.lines) == 1
    assert files(tmp_path) == {"full/file": b"mine"}
