"""Draws pictures/figure.webp: the figure of `wrinkle demo` in motion, as it was made and with its wrinkles.

`python samples/figure_picture.py FILE [FOLDER]`. The folder keeps the demo. Needs the extra `preview`.
"""

import sys
from dataclasses import replace
from pathlib import Path

from _panels import frames_of, run, save_panels
from wrinklecli import PreviewOptions, demo

HERE = Path(__file__).resolve().parent
FPS = 15
# Clips in the order in which they are shown: two steps twice, then a squat.
CLIPS = ("walk", "walk", "squat")


def main(out: Path, folder: Path) -> None:
    """Draw the picture."""
    made = demo(folder / "demo")
    assets = (Path(made.paths[0]), Path(made.paths[2]))
    options = PreviewOptions(
        fps=FPS, views=("30:8",), focus=(0.0, 0.83, 0.03), radius=0.60, size=(340, 520), labels=("before", "after")
    )
    drawn = {clip: frames_of(assets, folder / f"{clip}.webp", replace(options, clips=(clip,))) for clip in set(CLIPS)}
    save_panels([[frame for clip in CLIPS for frame in drawn[clip]]], out, fps=FPS, quality=75)


if __name__ == "__main__":
    run(main, sys.argv[1:], HERE / "pictures" / "figure.webp")
