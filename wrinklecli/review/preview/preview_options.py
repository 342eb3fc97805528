"""Options of a preview: what to show of assets, and how."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

from wrinklecli.numeric.memory import MAX_MEMORY
from wrinklecli.tools.records import MAX_VERTICES

# Pixels of a picture; with a grid, there are three side by side.
USUAL_SIZE, GRID_SIZE = (800, 600), (620, 620)
MOST_SIDE = 16_383  # pixels of a picture's width or height: the most that WebP holds


@dataclass(frozen=True, slots=True)
class Style:
    """How to draw.

    Attributes:
        wire: Draw the triangles' edges too.
        clay: Draw all in grey, whatever the colours.
        backfaces: Draw triangles that are seen from behind in red.
        lit_from_right: Turn the light round, so that the mirror image of a thing is drawn as its mirror image.
    """

    wire: bool = False
    clay: bool = False
    backfaces: bool = False
    lit_from_right: bool = False


PLAIN = Style()


@dataclass(frozen=True, slots=True)
class PreviewOptions:
    """What to show of assets, and how.

    Attributes:
        tools: A YAML file of tools, which are applied to the one asset and drawn on it.
        only: Names of tools; all where left out.
        review: Show every tool close up, before and after, at its peak.
        before: Show the asset without the tools beside it.
        hide_tools: Apply the tools, but do not draw them.
        anims: Files with more clips, for joints of the same names.
        range_of_motion: Bend joints and raise morph targets, one at a time, though there are clips; without any,
            a few such motions are shown.
        pose: Joints to turn, by name, axis and degrees, for one pose that is shown in place of clips.
        morphs: Names of morph targets and their weights in this pose.
        clips: Names; the first of the first asset where left out.
        rest: Show the stored pose, and no clip.
        times: Seconds; where left out, moments are spread over each clip.
        frames: How many moments of each clip.
        fps: Moments per second: of the clip, and of the animation.
        views: Names of `VIEWS`, `facing` (the wrinkles' side) or azimuth:elevation in degrees.
        focus: (3,) the point to look at, world space; where left out, the wrinkles, or else all.
        radius: How far around that point the camera sees, scene units.
        follow: The camera moves with the wrinkles, or with the skin that is at `focus` in the stored pose.
        size: Width and height of each picture, pixels; where left out, as suits what is shown.
        columns: Moments in a row of a sheet.
        labels: One for each asset, or for before and after.
        grid: Draw axes, a ruler and the names of joints, over the stored pose where no moment is named.
        heat: Colour the surface by its compression against the stored pose.
        style: How to draw.
        allow_external: Read buffers and images outside the asset's folder too.
        max_memory: Bytes that reading may take.
        max_vertices: That tools may add to a mesh.
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
        """Width and height of each picture, pixels, where nothing else is known of what is shown."""
        return self.size or (GRID_SIZE if self.grid else USUAL_SIZE)

    @property
    def names_a_moment(self) -> bool:
        """Whether any of them says when something is to be shown, or in which pose."""
        return any((self.clips, self.times, self.frames, self.fps, self.rest, self.pose, self.morphs))

    @property
    def names_a_shot(self) -> bool:
        """Whether any of them says when, or how, or beside what something is to be shown."""
        shots = (self.grid, self.views, self.focus, self.radius, self.follow, self.labels)
        return self.names_a_moment or any(shots)
