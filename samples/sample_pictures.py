"""Draws pictures/NAME.png of the samples' bakes, before and after: `python samples/sample_pictures.py NAME FILE`.

The samples have one plain colour each. For the pictures they are painted: skin with freckles, a face, trunks, denim.
Needs the extra `preview`, and the bake out/NAME.glb. With a FILE that ends in .glb it writes the painted sample alone.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from _body import HEAD
from _figure import _paint_head, _paint_jeans, _woven
from _shapes import Bools, Floats, smoothstep
from key_pictures import RAKING
from touch_picture import skin, textured
from wrinklecli import PreviewOptions, Style, preview
from wrinklecli.gltf.document import read_document
from wrinklecli.texture.texels import covered, gutter

HERE = Path(__file__).resolve().parent
IMAGE = 1024  # pixels of a side, as `skin` has
GUTTER = 8  # pixels beside a chart that have its colour
TRUNKS = (52, 74, 122)  # sRGB of 255
HAIRLINE = 0.016  # metres
WAIST, TURN_UP = 0.965, 0.10  # metres: where the trunks end, and below it all of the jeans is turned up
# Clip, moment, view, focus and radius of each picture.
SHOTS = {
    "wrist": ("extend", 0.9, "-30:45", (0.01, 0.02, 0.0), 0.062),
    "head": ("raise_brows", 0.8, "15:8", (0.0, 0.243, 0.06), 0.088),
    "head_keyed": ("think", 1.6, "35:8", (0.0, 0.243, 0.06), 0.088),
    "body": ("jump", 1.12, "45:12", (0.0, 1.13, 0.06), 0.19),
    "touch": ("drag", 1.0, "-35:50", (0.045, 0.015, 0.0), 0.034),
    "trousers": ("squat", 0.65, "140:8", (0.09, 0.5, -0.07), 0.2),
    "trousers_field": ("squat", 0.6, "75:10", (0.0, 0.75, 0.03), 0.28),
}


def paint_face(colours: Floats, at: Floats) -> None:
    """Paint hair, brows, eyes and lips. The hair begins higher than the figure's, as wrinkles reach up there."""
    x, y, z = at.T
    places = np.column_stack([np.abs(x), y + HEAD[1] - HAIRLINE * smoothstep(0.25, 0.30, y), z])
    _paint_head(colours, places, z > -0.02)


def paint_trunks(colours: Floats, at: Floats) -> None:
    """Paint bathing trunks."""
    colours[(at[:, 1] < WAIST) & (np.abs(at[:, 0]) < 0.24)] = TRUNKS


def paint_denim(colours: Floats, at: Floats) -> None:
    """Paint jeans, turned up at their ends."""
    places = np.column_stack([np.abs(at[:, 0]), np.maximum(at[:, 1], TURN_UP), at[:, 2]])
    _paint_jeans(colours, places, np.ones(len(at), np.bool_), at[:, 2] > 0.0)


PAINTERS: dict[str, Callable[[Floats, Floats], None]] = {
    "head": paint_face,
    "body": paint_trunks,
    "trousers": paint_denim,
}


def painted(asset: Path, name: str) -> Image.Image:
    """The texture of a sample."""
    paint = PAINTERS.get(name)
    if paint is None:
        return skin()
    # Head and body are larger than the hand whose skin it is.
    colours = np.tile(np.array(skin().resize((IMAGE // 2, IMAGE // 2)), np.float64), (2, 2, 1)).reshape(-1, 3)
    cloth = np.full(IMAGE * IMAGE, name == "trousers")
    document = read_document(asset)
    (primitive,) = document.items("meshes")[0]["primitives"]
    positions, uvs = (document.accessor(primitive["attributes"][key]) for key in ("POSITION", "TEXCOORD_0"))
    triangles = document.accessor(primitive["indices"]).reshape(-1, 3).astype(np.intp)
    filled: Bools = np.zeros(IMAGE * IMAGE, np.bool_)
    for texels, which, shares in covered(uvs[triangles].astype(np.float64), IMAGE):
        at = np.einsum("nk,nkd->nd", shares, positions[triangles[which]].astype(np.float64))
        own = colours[texels]
        paint(own, at)
        colours[texels], filled[texels] = own, True
    beside, nearest = gutter(filled.reshape(IMAGE, IMAGE), GUTTER)
    colours[beside] = colours[nearest]
    return Image.fromarray(_woven(colours, IMAGE, cloth=cloth))


def main(name: str, out: Path) -> None:
    """Draw the picture of a bake, or write the painted sample."""
    asset = HERE / f"{name.split('_')[0]}.glb"
    if out.suffix == ".glb":
        out.write_bytes(textured(asset.read_bytes(), painted(asset, asset.stem)))
        return
    clip, time, view, focus, radius = SHOTS[name]
    with tempfile.TemporaryDirectory() as folder:
        image, shown = painted(asset, asset.stem), []
        for number, path in enumerate((asset, HERE / "out" / f"{name}.glb")):
            shown.append(Path(folder) / f"{number}.glb")
            shown[-1].write_bytes(textured(path.read_bytes(), image))
        options = PreviewOptions(
            clips=(clip,),
            times=(time,),
            views=(view,),
            focus=focus,
            radius=radius,
            follow=True,
            labels=("before", "after"),
            size=(480, 480),
            style=Style(key=RAKING),
        )
        preview(shown, out, options)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
