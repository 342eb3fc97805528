"""Draws pictures/flesh.webp: belly, buttocks, upper arm and cheeks of a body in motion, without flesh and with it.

`python samples/flesh_picture.py [FILE]`. The program itself bakes and draws the body that `_body.py` makes; a second
argument is a folder that keeps the body and what was baked. Needs the extra `preview`.
"""

import json
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageSequence

from _body import make_body
from _gltf import to_glb
from wrinklecli import BakeOptions, PreviewOptions, bake, preview

HERE = Path(__file__).resolve().parent
REGIONS = [
    {"name": "belly", "at": [0.0, 1.02, 0.18], "radius": 0.15},
    {"name": "buttock.L", "at": [0.09, 0.92, -0.165], "radius": 0.11, "frequency": 5, "mirror": "x"},
    {"name": "upper_arm.L", "at": [0.28, 1.27, -0.1], "radius": 0.09, "frequency": 5, "mirror": "x"},
    {"name": "cheek.L", "at": [0.055, 1.6, 0.09], "radius": 0.045, "frequency": 6, "mirror": "x"},
]
# For each panel its clip, the side from which it is seen, the place and the radius of what is seen, metres.
PANELS = (
    ("jump", "70:5", (0.0, 1.0, 0.05), 0.3),
    ("jump", "150:5", (0.0, 0.94, -0.02), 0.24),
    ("shake", "30:0", (0.28, 1.27, -0.02), 0.17),
    ("shake", "0:5", (0.0, 1.6, 0.08), 0.15),
)
SIZE = (220, 220)  # pixels of each picture
FPS = 15
COLUMNS = 2


def frames_of(asset: Path, baked: Path, folder: Path, panel: int) -> list[Image.Image]:
    """The frames of a panel: the body without flesh and with it, side by side."""
    clip, view, focus, radius = PANELS[panel]
    out = folder / f"panel_{panel}.webp"
    options = PreviewOptions(
        clips=(clip,),
        fps=FPS,
        views=(view,),
        focus=focus,
        radius=radius,
        follow=True,
        size=SIZE,
        labels=("without", "flesh"),
    )
    preview([asset, baked], out, options)
    with Image.open(out) as picture:
        return [frame.convert("RGB") for frame in ImageSequence.Iterator(picture)]


def main(out: Path, folder: Path) -> None:
    """Draw the picture."""
    asset, tools, baked = folder / "body.glb", folder / "flesh.yaml", folder / "baked.glb"
    asset.write_bytes(to_glb(make_body()))
    tools.write_text(json.dumps({"version": 1, "flesh": REGIONS}), encoding="utf-8")
    for warning in bake(asset, tools, baked, BakeOptions()).warnings:
        print(warning)
    panels = [frames_of(asset, baked, folder, number) for number in range(len(PANELS))]
    wide, high = panels[0][0].size
    pictures = []
    for number in range(min(map(len, panels))):
        picture = Image.new("RGB", (COLUMNS * wide, -(-len(panels) // COLUMNS) * high))
        for place, frames in enumerate(panels):
            picture.paste(frames[number], (place % COLUMNS * wide, place // COLUMNS * high))
        pictures.append(picture)
    out.parent.mkdir(parents=True, exist_ok=True)
    pictures[0].save(
        out, save_all=True, append_images=pictures[1:], duration=round(1000 / FPS), loop=0, quality=75, method=4
    )


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures" / "flesh.webp"
    if len(sys.argv) > 2:
        main(target, Path(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as name:
            main(target, Path(name))
