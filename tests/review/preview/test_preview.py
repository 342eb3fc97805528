"""`wrinkle preview`: what is in a file, and what is said where it cannot be drawn."""

import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from kit.limb import limb_asset
from kit.pictures import SIZE, baked, draw, limb, near, picture
from wrinklecli import cli
from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.review.preview.camera import FACING, VIEWS
from wrinklecli.review.preview.preview_options import MOST_SIDE
from wrinklecli.review.preview.sheet_layout import MOST_PIXELS
from wrinklecli.review.preview.shown import INKS

Json = dict[str, Any]


@pytest.mark.slow
def test_one_asset_gives_a_sheet_over_time_and_two_give_columns(tmp_path: Path) -> None:
    asset, _, wrinkled = baked(tmp_path)
    seen: Json = {"focus": (0, 0.1, 0), "radius": 0.5, "size": SIZE, "labels": ["a"], "views": ["oblique"]}
    for name, path in (("a", asset), ("b", wrinkled)):
        draw([path], tmp_path / f"{name}.png", times=(0.5, 1.0), columns=2, **seen)
    draw([asset, wrinkled], tmp_path / "ab.png", times=(0.5, 1.0), **seen | {"labels": ["a", "a"]})
    single, other, side = (picture(tmp_path / f"{name}.png") for name in ("a", "b", "ab"))
    width, height = SIZE
    assert single.shape == (height, 2 * width + 4, 3)
    assert side.shape == (2 * height + 4, 2 * width + 4, 3)
    for row, column in ((0, 0), (1, width + 4)):
        across = side[row * (height + 4) :][:height]
        assert np.array_equal(across[:, :width], single[:, column : column + width])
        assert np.array_equal(across[:, width + 4 :], other[:, column : column + width])
    assert not np.array_equal(single[:, width + 4 :], other[:, width + 4 :])


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("ending", ["png", "webp", "gif"])
def test_the_same_input_gives_the_same_bytes(tmp_path: Path, ending: str) -> None:
    asset, tools, _ = baked(tmp_path)
    for name in ("a", "b"):
        draw([asset], tmp_path / f"{name}.{ending}", tools=tools, heat=True, frames=3, size=SIZE)
    assert (tmp_path / f"a.{ending}").read_bytes() == (tmp_path / f"b.{ending}").read_bytes()


@pytest.mark.quick(1)
@pytest.mark.parametrize("ending", ["gif", "webp"])
@pytest.mark.parametrize(
    ("options", "count", "milliseconds"),
    [
        ({"times": (0.0, 0.5, 1.0), "fps": 3.0}, 3, 1000),
        ({"fps": 8.0}, 16, 2000),
        ({"frames": 6}, 6, 2000),
        ({"times": (0.0, 0.5, 1.0)}, 3, 200),
        ({}, 30, 2000),
    ],
)
def test_an_animation_has_so_many_frames_and_takes_as_long_as_the_clip(
    tmp_path: Path, ending: str, options: Json, count: int, milliseconds: int
) -> None:
    out = tmp_path / f"fold.{ending}"
    made = draw([limb(tmp_path, rings=5, sides=6)], out, size=(32, 24), views=["front"], **options)
    assert made.shown == f"{count} moments"
    with Image.open(out) as image:
        total = 0
        frames = []
        for number in range(count):
            image.seek(number)
            frames.append(np.asarray(image.convert("RGB")))
            total += image.info["duration"]
        with pytest.raises(EOFError):
            image.seek(count)
        assert image.info["loop"] == 0
    assert total == pytest.approx(milliseconds, abs=10)
    assert (np.abs(frames[0].astype(int) - frames[count // 2]) > 60).any(), "it moves"


@pytest.mark.slow
def test_tools_show_what_their_bake_would(tmp_path: Path) -> None:
    asset, tools, wrinkled = baked(tmp_path)
    seen: Json = {"times": (0.4, 1.0), "size": SIZE, "labels": ["x"]}
    first = draw([asset], tmp_path / "a.png", tools=tools, hide_tools=True, **seen)
    second = draw([wrinkled], tmp_path / "b.png", **seen)
    draw([asset], tmp_path / "c.png", **seen, views=second.views)
    assert first.views == second.views
    shown, expected, smooth = (picture(tmp_path / f"{name}.png").astype(int) for name in "abc")
    # Weight tracks of one clip and of all have their keys elsewhere: within the same error.
    assert np.abs(shown - expected).mean() < 0.2
    assert np.abs(shown - smooth).mean() > 3


@pytest.mark.slow
def test_tools_are_drawn_on_the_right_side_and_named(tmp_path: Path) -> None:
    asset, tools, _ = baked(tmp_path)
    counts = {}
    for view in ("top", "bottom"):
        draw([asset], tmp_path / "a.png", tools=tools, before=True, rest=True, views=[view], size=(160, 120))
        shown = picture(tmp_path / "a.png")
        counts[view] = (near(shown[:120, :160], INKS[0]), near(shown[:120, 164:], INKS[0]))
        assert near(shown[120:], INKS[0], within=5) > 50, "a swatch in the legend"
    assert counts["top"][0] == 0
    assert counts["top"][1] > 50
    assert counts["bottom"] == (0, 0)
    draw([asset], tmp_path / "b.png", tools=tools, hide_tools=True, rest=True, views=["top"], size=(160, 120))
    assert near(picture(tmp_path / "b.png"), INKS[0]) == 0


def run(
    arguments: Sequence[str | Path], capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> tuple[int, str]:
    """Exit code and standard error of `wrinkle preview`."""
    monkeypatch.setattr(sys, "argv", ["wrinkle", "preview", *map(str, arguments)])
    capfd.readouterr()
    code: Any = 0
    try:
        cli.main()
    except SystemExit as leaving:
        code = leaving.code or 0
    captured = capfd.readouterr()
    assert captured.out == ""
    return code, captured.err


@pytest.mark.slow
def test_the_command_says_what_it_has_drawn(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asset, tools, _ = baked(tmp_path)
    out = tmp_path / "a.png"
    options = ["--tools", tools, "--before", "--times", "0,1", "--size", "64x48", "--views", "-30:45,facing", "-o", out]
    code, said = run([asset, *options], capfd, monkeypatch)
    assert code == 0
    assert re.fullmatch(rf"{out}: 132 × 2\d\d pixels, 2 moments, seen from -30:45, -?\d+:-?\d+\n", said)
    assert run([asset, *options, "-q"], capfd, monkeypatch) == (0, "")


def test_help_names_every_view(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["wrinkle", "preview", "--help"])
    cli.main()
    shown = " ".join(capfd.readouterr().out.split())
    assert f"{', '.join(VIEWS)}, {FACING} (" in shown


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.glb"], "Missing option '-o'"),
        (["a.glb", "-o", "a.jpg"], "none of .png, .webp, .gif"),
        (["a", "b", "c", "-o", "a.png"], "at most two"),
        (["a", "b", "--tools", "t.yaml", "-o", "a.png"], "takes one ASSET"),
        (["a", "--review", "-o", "a.gif"], "'--review' makes a sheet"),
        (["a", "--review", "--times", "1", "-o", "a.png"], "goes without '--times'"),
        (["a", "--review", "--labels", "x", "-o", "a.png"], "has 1, not 2"),
        (["a", "--before", "-o", "a.png"], "needs '--tools'"),
        (["a", "--hide-tools", "-o", "a.png"], "needs '--tools'"),
        (["a", "--rest", "--times", "1", "-o", "a.png"], "one moment"),
        (["a", "--times", "1", "--frames", "3", "-o", "a.png"], "exclude"),
        (["a", "--times", "1,x", "-o", "a.png"], "numbers between commas"),
        (["a", "--times", "inf", "-o", "a.png"], "numbers between commas"),
        (["a", "--frames", "0", "-o", "a.png"], "0 is not in the range"),
        (["a", "--frames", "99999", "-o", "a.png"], "99999 is not in the range"),
        (["a", "--fps", "nan", "-o", "a.png"], "not a number"),
        (["a", "--size", "8x600", "-o", "a.png"], "of 16 to 16383 pixels"),
        (["a", "--size", "99999x600", "-o", "a.png"], "of 16 to 16383 pixels"),
        (["a", "--size", "800", "-o", "a.png"], "WIDTHxHEIGHT"),
        (["a", "--views", "nose", "-o", "a.png"], "none of facing"),
        (["a", "--focus", "1,2", "-o", "a.png"], "2 numbers, not 3"),
        (["a", "--focus", "1,2,3", "-o", "a.png"], "needs '--radius'"),
        (["a", "--radius", "0", "-o", "a.png"], "not a length above 0"),
        (["a", "--radius", "inf", "-o", "a.png"], "not a length above 0"),
        (["a", "--labels", "x,y", "-o", "a.png"], "has 2, not 1"),
    ],
)
def test_wrong_usage_is_said_and_ends_in_2(
    arguments: list[str], said: str, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, error = run(arguments, capfd, monkeypatch)
    assert code == 2
    assert said in " ".join(error.split())


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"clips": ["walk"]}, "has no clip 'walk'; there are 'fold'"),
        ({"size": (16_000, 16_000), "times": (0.0, 1.0)}, "at most 16383 each way"),
        ({"size": (16_000, 16_000), "times": (0.0, 1.0), "out": "a.gif"}, "at most 1"),
        ({"out": "limb.glb"}, "ends in none of"),
        ({"out": "none/a.png"}, "cannot be written"),
        ({"times": (0.5, 9.0)}, "no clip that is shown has a moment at 9 s: 'fold' from 0 to 2 s"),
        ({"fps": 1000.0, "frames": None, "clips": ["fold"] * 9}, "too many"),
    ],
)
def test_what_cannot_be_drawn_is_said_in_a_line(tmp_path: Path, options: Json, said: str) -> None:
    path = limb(tmp_path, rings=3, sides=4)
    out = tmp_path / options.pop("out", "a.png")
    if "size" not in options:
        options["size"] = (16, 16)
    with pytest.raises(WrinkleError, match=re.escape(said)) as caught:
        draw([path], out, **options)
    assert len(caught.value.lines) == 1
    assert [each.name for each in tmp_path.iterdir()] == ["limb.glb"]


def test_a_long_clip_is_not_drawn_at_any_rate(tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4, clip=None)
    animation: Json = {"name": "long"}
    asset.channel(animation, 1, "translation", [0.0, 1e30], [[0.0, 0.0, 0.0], [5.0, 0.0, 2.0]])
    asset.append("animations", animation)
    with pytest.raises(WrinkleError, match="at most 10000"):
        draw([asset.write(tmp_path / "a.glb")], tmp_path / "a.gif", size=(16, 16))


def test_an_input_is_not_overwritten(tmp_path: Path) -> None:
    path = limb(tmp_path, rings=3, sides=4)
    link = tmp_path / "link.png"
    link.symlink_to(path)
    with pytest.raises(WrinkleError, match="would be overwritten"):
        draw([path], link, size=(16, 16))


def test_an_asset_without_triangles_shows_nothing(tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["meshes"][0]["primitives"][0]["mode"] = 0
    with pytest.raises(AssetError, match="nothing to see"):
        draw([asset.write(tmp_path / "a.glb")], tmp_path / "a.png", size=(16, 16))


def test_beside_another_an_asset_may_show_nothing(tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4)
    del asset.gltf["scenes"][0]["nodes"]
    paths = [asset.write(tmp_path / "empty.glb"), limb(tmp_path, rings=3, sides=4)]
    draw(paths, tmp_path / "a.png", size=(16, 16), focus=(0.0, 1.0, 0.0), radius=2.0, follow=True)
    assert (tmp_path / "a.png").exists()


def test_bounds_hold_a_sheet_in_memory() -> None:
    assert MOST_SIDE**2 < MOST_PIXELS <= 2**28


@pytest.mark.slow
@pytest.mark.parametrize("missing", ["embreex", "PIL"])
def test_a_missing_extra_is_one_line_that_says_what_to_install(tmp_path: Path, missing: str) -> None:
    path = limb(tmp_path, rings=3, sides=4)
    program = (
        f"import sys; sys.modules['{missing}'] = None\n"
        f"sys.argv = ['wrinkle', 'preview', {str(path)!r}, '-o', {str(tmp_path / 'a.png')!r}]\n"
        "from wrinklecli.cli import main\n"
        "main()\n"
    )
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert result.returncode == 1
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert "pip install 'wrinklecli[preview]'" in line
    assert not (tmp_path / "a.png").exists()
