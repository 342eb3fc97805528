"""Moving pictures of several panels: what the program draws from each side, joined frame by frame."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

from PIL import Image, ImageSequence

from wrinklecli import PreviewOptions, preview

COLUMNS = 2

Frames = list[Image.Image]


def frames_of(assets: Sequence[Path], drawn: Path, options: PreviewOptions) -> Frames:
    """Draw assets side by side into a file; return its frames."""
    preview(assets, drawn, options)
    with Image.open(drawn) as picture:
        return [frame.convert("RGB") for frame in ImageSequence.Iterator(picture)]


def save_panels(panels: Sequence[Frames], out: Path, *, fps: int, quality: int) -> None:
    """Write panels of one size, in rows of two, as one moving picture that lasts as long as the shortest."""
    wide, high = panels[0][0].size
    columns = min(COLUMNS, len(panels))
    pictures = []
    for number in range(min(map(len, panels))):
        picture = Image.new("RGB", (columns * wide, -(-len(panels) // columns) * high))
        for place, frames in enumerate(panels):
            picture.paste(frames[number], (place % columns * wide, place // columns * high))
        pictures.append(picture)
    out.parent.mkdir(parents=True, exist_ok=True)
    duration = round(1000 / fps)
    pictures[0].save(
        out, save_all=True, append_images=pictures[1:], duration=duration, loop=0, quality=quality, method=4
    )


def run(main: Callable[[Path, Path], None], arguments: Sequence[str], usual: Path) -> None:
    """Draw to the file that the arguments name, with the folder that they name, or one that is deleted behind it."""
    target = Path(arguments[0]) if arguments else usual
    if len(arguments) > 1:
        main(target, Path(arguments[1]))
    else:
        with tempfile.TemporaryDirectory() as name:
            main(target, Path(name))
