"""Pictures that previews draw, what is in them, and a limb to draw."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from kit.limb import limb_asset, tool, write_tools
from wrinklecli import bake
from wrinklecli.review.preview.preview import Preview, preview
from wrinklecli.review.preview.preview_options import PreviewOptions
from wrinklecli.review.preview.render import PAPER

Bytes = NDArray[np.uint8]
Json = dict[str, Any]

SIZE = (80, 60)  # pixels of a small picture
BUMPY: Json = {"name": "fold", "bumps": 2, "width": 0.4}


def picture(path: Path) -> Bytes:
    """(height, width, 3) sRGB of the first frame of a file."""
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def covered(pixels: Bytes) -> NDArray[np.bool_]:
    """Which pixels show something."""
    paper = np.array([round(255 * each) for each in PAPER])
    return np.asarray((np.abs(pixels.astype(int) - paper) > 2).any(axis=2))


def near(pixels: Bytes, colour: Sequence[float], *, within: float = 40) -> int:
    """How many pixels have about this colour."""
    return int((np.abs(pixels - 255 * np.array(colour)).max(axis=2) < within).sum())


def reds(pixels: Bytes) -> int:
    """How many pixels are red above all."""
    red, green, blue = np.moveaxis(pixels.astype(int), 2, 0)
    return int((red > 100 + np.maximum(green, blue)).sum())


def limb(folder: Path, *, name: str = "limb", **options: Any) -> Path:
    """A limb that folds, written to a folder."""
    return limb_asset(**{"rings": 17, "sides": 12, **options}).write(folder / f"{name}.glb")


def baked(folder: Path) -> tuple[Path, Path, Path]:
    """An asset, its tools, and the bake of both."""
    asset, tools = limb(folder), write_tools(folder / "tools.yaml", tool(**BUMPY))
    bake(asset, tools, folder / "baked.glb")
    return asset, tools, folder / "baked.glb"


def draw(assets: Sequence[Path], out: Path, **options: Any) -> Preview:
    """Draw a preview with some options."""
    return preview(assets, out, PreviewOptions(**options))
