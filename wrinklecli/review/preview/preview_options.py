"""The options of a preview. This module imports little, so that `wrinkle preview --help` is quick."""

import os
from collections.abc import Sequence

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.memory import MAX_MEMORY, MAX_VERTICES

# Width and height of a picture, pixels.
USUAL_SIZE = (800, 600)
# Width and height of a picture with a grid, pixels: three of them stand side by side.
GRID_SIZE = (620, 620)
# The greatest width or height of a whole picture, pixels: WebP holds no more.
MOST_SIDE = 16_383


@dataclass(frozen=True, slots=True)
class Style:
    """The style of a drawing.

    Attributes:
        wire: Draw the triangles' edges too.
        clay: Draw everything in grey.
        backfaces: Draw triangles that are seen from behind in red.
        key: Direction to the key light in camera axes (right, up, backwards), from the side so that it shows relief.
            A light at the camera reaches the shade.
    """

    wire: bool = False
    clay: bool = False
    backfaces: bool = False
    key: tuple[float, float, float] = (-0.62, 0.62, 0.48)


PLAIN = Style()


@dataclass(frozen=True, slots=True)
class PreviewOptions:
    """Options of `preview`.

    Attributes:
        tools: A YAML file of tools to apply to the one asset and to draw on it.
        only: Names of the tools to show; if empty, all.
        review: Show every tool close up, before and after, at its peak.
        before: Show the asset without the tools beside it.
        hide_tools: Apply the tools, but do not draw them.
        anims: Files with more clips, for joints of the same names.
        range_of_motion: Bend joints and raise morph targets, one at a time, though there are clips. An asset without
            clips is shown in a few such motions anyway.
        pose: Joints to turn, by name, axis and degrees, for one pose that is shown in place of clips.
        morphs: Names of morph targets and their weights in this pose.
        clips: Names of the clips to show; if empty, the first of the first asset.
        rest: Show the stored pose, and no clip.
        times: Seconds; if empty, moments are spread over each clip.
        frames: Number of moments of each clip.
        fps: Moments per second of the clip, and of the animation.
        views: Names of `VIEWS`, `facing` (the wrinkles' side) or azimuth:elevation in degrees.
        focus: (3,) point to look at, world space; if None, the wrinkles, or all if there are none.
        radius: Distance around that point that the camera sees, scene units.
        follow: Move the camera with the wrinkles, or with the skin that is at `focus` in the stored pose. Without a
            focus it moves with a body that goes further than its own size anyway.
        size: Width and height of each picture, pixels; if None, the kind of picture decides.
        columns: Moments in a row of a sheet.
        labels: One for each asset, or for before and after.
        grid: Draw axes, a ruler and the names of joints; over the stored pose unless a moment is named.
        heat: Colour the surface by its compression against the stored pose.
        allow_external: Read buffers and images outside the asset's folder too.
        max_memory: Most bytes that reading may take.
        max_vertices: Most vertices that tools may add to a mesh.
    """

    tools: str | os.PathLike[str] | None = None
    only: Sequence[str] = ()
    review: bool = False
    before: bool = False
    hide_tools: bool = False
    anims: Sequence[str | os.PathLike[str]] = ()
    range_of_motion: bool = False
    pose: Sequence[tuple[str, str, float]] = ()
    morphs: Sequence[tuple[str, float]] = ()
    clips: Sequence[str] = ()
    rest: bool = False
    times: Sequence[float] = ()
    frames: int | None = None
    fps: float | None = None
    views: Sequence[str] = ()
    focus: Sequence[float] | None = None
    radius: float | None = None
    follow: bool = False
    size: tuple[int, int] | None = None
    columns: int | None = None
    labels: Sequence[str] = ()
    grid: bool = False
    heat: bool = False
    style: Style = PLAIN
    allow_external: bool = False
    max_memory: int = MAX_MEMORY
    max_vertices: int = MAX_VERTICES

    @property
    def picture_size(self) -> tuple[int, int]:
        """Width and height of each picture, pixels."""
        return self.size or (GRID_SIZE if self.grid else USUAL_SIZE)

    @property
    def names_a_moment(self) -> bool:
        """True if an option says at which moment, or in which pose, to show the assets."""
        return any((self.clips, self.times, self.frames, self.fps, self.rest, self.pose, self.morphs))

    @property
    def names_a_shot(self) -> bool:
        """True if an option asks for more than a review can show: a moment, a view, a place, a grid or labels."""
        shots = (self.grid, self.views, self.focus, self.radius, self.follow, self.labels)
        return self.names_a_moment or any(shots)
