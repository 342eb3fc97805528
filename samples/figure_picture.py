"""Draws pictures/figure.webp: the figure of `wrinkle demo` in motion, as it was made and with its wrinkles.

`python samples/figure_picture.py [FILE]`. Needs the extra `preview`.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from PIL import Image, ImageSequence

from wrinklecli import PreviewOptions, demo, preview

HERE = Path(__file__).resolve().parent
FPS = 15
# Clips in the order in which they are shown.
CLIPS = ("squat", "walk")


def main(out: Path) -> None:
    """Draw the picture."""
    drawn = {}
    with tempfile.TemporaryDirectory() as name:
        made = demo(Path(name) / "demo")
        options = PreviewOptions(
            fps=FPS, views=("30:8",), focus=(0.0, 0.87, 0.03), radius=0.75, size=(480, 640), labels=("before", "after")
        )
        for clip in CLIPS:
            file = Path(name) / f"{clip}.webp"
            preview([made.paths[0], made.paths[2]], file, replace(options, clips=(clip,)))
            with Image.open(file) as picture:
                drawn[clip] = [frame.convert("RGB") for frame in ImageSequence.Iterator(picture)]
    first, *others = (frame for clip in CLIPS for frame in drawn[clip])
    duration = round(1000 / FPS)
    first.save(out, save_all=True, append_images=others, duration=duration, loop=0, quality=75, method=4)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures" / "figure.webp")
