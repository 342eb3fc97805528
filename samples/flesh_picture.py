"""Draws pictures/flesh.webp: the figure of `wrinkle demo` in a jump, without flesh and with it.

`python samples/flesh_picture.py [FILE]`. The program bakes and draws what this script makes. Needs the extra `preview`.
"""

import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from _body import jump
from _characters import to_glb
from _figure import make_figure
from wrinklecli import BakeOptions, PreviewOptions, bake, preview

HERE = Path(__file__).resolve().parent
BELLY = {"name": "belly", "at": [0.0, 1.015, 0.18], "radius": 0.19, "frequency": 4, "limit": "15%"}


def main(out: Path) -> None:
    """Draw the picture."""
    clip = jump()
    # Raised arms pull at the waist, where the skin weights are rough.
    still = replace(clip, rotations={name: keys for name, keys in clip.rotations.items() if "arm" not in name})
    with tempfile.TemporaryDirectory() as name:
        asset, tools, baked = (Path(name) / file for file in ("figure.glb", "tools.yaml", "baked.glb"))
        asset.write_bytes(to_glb(replace(make_figure(), clips=(still,))))
        tools.write_text(json.dumps({"version": 1, "flesh": [BELLY]}), encoding="utf-8")
        for warning in bake(asset, tools, baked, BakeOptions()).warnings:
            print(warning)
        options = PreviewOptions(
            fps=12,
            views=("35:5",),
            focus=(0.0, 1.05, 0.03),
            radius=0.27,
            follow=True,
            size=(400, 400),
            labels=("without", "with flesh"),
        )
        preview([asset, baked], out, options)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures" / "flesh.webp")
