"""Fills a folder with a figure, its tools, its bake and a picture of it, which a new user looks at first."""

import os
import tempfile
from collections.abc import Callable
from importlib import resources
from pathlib import Path

from wrinklecli.baking.pipeline import bake
from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.files.outputs import Outputs, part_of
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.guard import Progress, log_progress
from wrinklecli.review.preview.preview import preview, refuse_missing
from wrinklecli.review.preview.preview_options import PreviewOptions

ASSET, TOOLS, BAKED, PICTURE = "figure.glb", "figure.yaml", "wrinkled.glb", "wrinkled.png"
# The whole figure, at the moment of the clip and from the side at which most wrinkles are seen.
_SHOT = PreviewOptions(
    clips=("squat",),
    times=(0.9,),
    views=("30:8",),
    focus=(0.0, 0.73, 0.08),
    radius=0.64,
    columns=2,
    size=(560, 700),
    labels=("before", "after"),
)


@dataclass(frozen=True, slots=True)
class Demo:
    """The files of a demo.

    Attributes:
        paths: Paths of the files, in the order of work.
        picture: Path of the picture; None without the libraries that draw it.
        missing: Why there is no picture; None if there is one.
    """

    paths: tuple[str, ...]
    picture: str | None
    missing: str | None


def demo(folder: str | os.PathLike[str], *, outputs: Outputs | None = None, progress: Progress = log_progress) -> Demo:
    """Make the demo in a folder that is new or empty.

    Args:
        folder: Where to write; it is made if it is missing.
        outputs: Other files to write. If None, the files are committed before returning.
        progress: Called with a stage's name, steps done and steps in all.

    Raises:
        BakeError: The folder holds files, or cannot be written.

    Examples:
        >>> from wrinklecli import demo
        >>> [path.rpartition("/")[2] for path in demo("wrinkle-demo").paths]
        ['figure.glb', 'figure.yaml', 'wrinkled.glb', 'wrinkled.png']
    """
    place = Path(folder)
    _refuse_files(place)
    with part_of(outputs) as written, tempfile.TemporaryDirectory() as temporary:
        written.make_folders(place)  # what cannot be made is found before the work
        made = {name: Path(temporary) / name for name in (ASSET, TOOLS, BAKED, PICTURE)}
        for name in (ASSET, TOOLS):
            made[name].write_bytes(kept(name))
        bake(made[ASSET], made[TOOLS], made[BAKED], progress=progress)
        missing = _drawn(made, progress)
        if missing is not None:
            del made[PICTURE]
        for name, path in made.items():
            written.add_bytes(place / name, path.read_bytes(), last=name == BAKED)
    paths = tuple(os.fspath(place / name) for name in made)
    return Demo(paths, None if missing else os.fspath(place / PICTURE), missing)


def kept(name: str) -> bytes:
    """The figure or its tools, as the package has them."""
    return resources.files("wrinklecli.example").joinpath(name).read_bytes()


def _refuse_files(folder: Path) -> None:
    """Raise BakeError where the demo would get among files of the user."""
    try:
        full = folder.exists() and any(folder.iterdir())
    except (OSError, ValueError) as error:
        raise BakeError(f"cannot be used: {getattr(error, 'strerror', None) or error}", where=str(folder)) from error
    if full:
        raise BakeError("holds files; the demo goes into a new or an empty folder", where=str(folder))


def _drawn(made: "dict[str, Path]", progress: Callable[[str, int, int], None]) -> str | None:
    """Draw figure and bake side by side; why not, if the libraries are missing."""
    try:
        refuse_missing()
    except WrinkleError as error:
        return str(error)
    preview([made[ASSET], made[BAKED]], made[PICTURE], _SHOT, progress=progress)
    return None
