"""Draws pictures/stroke.webp: a finger strokes a forearm from elbow to wrist.

`python samples/stroke_picture.py [FILE]`. The program bakes and draws the hand of the sample `touch`, whose finger goes
another way here. Needs the extra `preview`.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from _characters import Clip, to_glb
from _shapes import Floats, smoothstep
from _touch import AT, HIGH, make_touch
from make_samples import make_wrist
from touch_picture import skin, textured
from wrinklecli import BakeOptions, PreviewOptions, bake, preview

HERE = Path(__file__).resolve().parent
# Heights of the skin along the middle of the forearm's back, metres.
SKIN = np.array([[-0.2, 0.0386], [-0.16, 0.0374], [-0.12, 0.0334], [-0.08, 0.0272], [-0.04, 0.0233], [-0.01, 0.0222]])
ELBOW, WRIST = -0.185, -0.02
PRESSED = 0.001
SECONDS = 3.0
TOOLS = f"""
version: 1
touches:
  - name: forearm
    at: [{ELBOW}, {np.interp(ELBOW, *SKIN.T):.4f}, 0.0]
    along: [[-0.1, {np.interp(-0.1, *SKIN.T):.4f}, 0.0], [{WRIST}, {np.interp(WRIST, *SKIN.T):.4f}, 0.0]]
    pad: 0.012
    by: {{joint: other_index, offset: [0.0, -0.0065, 0.0]}}
    wrinkles: {{variation: 1}}
"""


def stroke() -> tuple[Floats, dict[str, Floats], dict[str, Floats]]:
    """(keys,) seconds, no rotations, and the offsets of the finger."""
    times = np.arange(round(SECONDS * 30) + 1) / 30.0
    x = ELBOW - 0.005 + (WRIST - ELBOW + 0.015) * smoothstep(0.4, 2.5, times)
    down = smoothstep(0.0, 0.4, times) * smoothstep(2.9, 2.55, times)
    y = np.interp(x, *SKIN.T) - AT[1] - PRESSED - HIGH * down
    return times, {}, {"other_index": np.stack([x - AT[0], y, 0.0 * x], axis=1)}


def main(out: Path) -> None:
    """Draw the picture."""
    hand = replace(make_touch(make_wrist()), clips=(Clip("stroke", *stroke()),))
    with tempfile.TemporaryDirectory() as folder:
        tools, asset, baked = (Path(folder) / name for name in ("tools.yaml", "hand.glb", "baked.glb"))
        tools.write_text(TOOLS)
        asset.write_bytes(textured(to_glb(hand), skin()))
        for warning in bake(asset, tools, baked, BakeOptions()).warnings:
            print(warning)
        options = PreviewOptions(
            fps=12,
            # The light rakes over the skin in front of the finger, whose shadow falls behind it.
            views=("-150:45",),
            # The tip of the finger at rest.
            focus=(AT[0], AT[1] + HIGH, 0.0),
            radius=0.03,
            follow=True,
            size=(840, 540),
            labels=("a stroke",),
        )
        preview([baked], out, options)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures" / "stroke.webp")
