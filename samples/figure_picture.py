"""Draws pictures/figure.webp: the figure of `wrinkle demo` in motion, as it was made and with its wrinkles.

`python samples/figure_picture.py FILE [FOLDER]`. The folder keeps the demo. Needs the extra `preview`.
"""

import sys
from pathlib import Path

from _panels import frames_of, run, save_panels
from wrinklecli import PreviewOptions, demo

HERE = Path(__file__).resolve().parent
FPS = 15
# Side, place and radius of what is seen, metres, and the size in pixels: the whole figure, and its legs from behind.
PANELS = (
    ("40:8", (0.0, 0.80, 0.0), 0.84, (250, 330)),
    ("128:5", (0.05, 0.62, -0.02), 0.40, (250, 330)),
)


def main(out: Path, folder: Path) -> None:
    """Draw the picture."""
    made = demo(folder / "demo")
    assets = (Path(made.paths[0]), Path(made.paths[2]))
    panels = []
    for number, (view, focus, radius, size) in enumerate(PANELS):
        options = PreviewOptions(
            clips=("squat",), fps=FPS, views=(view,), focus=focus, radius=radius, size=size, labels=("before", "after")
        )
        panels.append(frames_of(assets, folder / f"panel_{number}.webp", options))
    save_panels(panels, out, fps=FPS, quality=75)


if __name__ == "__main__":
    run(main, sys.argv[1:], HERE / "pictures" / "figure.webp")
