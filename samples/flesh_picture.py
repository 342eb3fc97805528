"""Draws pictures/flesh.webp: a body in motion, without flesh and with it.

`python samples/flesh_picture.py FILE [FOLDER]`. The body is the sample, which has cheeks too, and shakes its head and
arms. The program bakes what it draws; the folder keeps the body and what was baked. Needs the extra `preview`.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import yaml

from _body import jump, make_body, shake
from _characters import to_glb
from _panels import Frames, frames_of, run, save_panels
from wrinklecli import BakeOptions, PreviewOptions, bake

HERE = Path(__file__).resolve().parent
TOOLS = HERE.parent / "configs" / "body.yaml"
CHEEKS = {"name": "cheek.L", "at": [0.046, 1.605, 0.071], "radius": 0.045, "frequency": 6, "mirror": "x"}
FPS = 15


class Panel(NamedTuple):
    """A clip, the side from which it is seen, and the place and the radius of what is seen, metres."""

    clip: str
    view: str
    focus: tuple[float, float, float]
    radius: float


PANELS = (
    Panel("jump", "70:5", (0.0, 1.0, 0.05), 0.3),
    Panel("jump", "150:5", (0.0, 0.94, -0.02), 0.24),
    Panel("shake", "30:0", (0.28, 1.27, -0.02), 0.17),
    Panel("shake", "20:5", (0.0, 1.6, 0.05), 0.15),
)
SIZE = (220, 220)  # pixels of each picture


def panel_of(assets: tuple[Path, Path], number: int) -> Frames:
    """The frames of a panel: the body as it was made and baked, side by side."""
    panel = PANELS[number]
    options = PreviewOptions(
        clips=(panel.clip,),
        fps=FPS,
        views=(panel.view,),
        focus=panel.focus,
        radius=panel.radius,
        follow=True,
        size=SIZE,
        labels=("without", "flesh"),
    )
    return frames_of(assets, assets[0].with_name(f"panel_{number}.webp"), options)


def main(out: Path, folder: Path) -> None:
    """Draw the picture."""
    asset, tools, baked = folder / "body.glb", folder / "body.yaml", folder / "baked.glb"
    asset.write_bytes(to_glb(replace(make_body(), clips=(jump(), shake()))))
    settings = yaml.safe_load(TOOLS.read_text(encoding="utf-8"))
    settings["flesh"].append(CHEEKS)
    tools.write_text(json.dumps(settings), encoding="utf-8")
    for warning in bake(asset, tools, baked, BakeOptions()).warnings:
        print(warning)
    panels = [panel_of((asset, baked), number) for number in range(len(PANELS))]
    save_panels(panels, out, fps=FPS, quality=75)


if __name__ == "__main__":
    run(main, sys.argv[1:], HERE / "pictures" / "flesh.webp")
