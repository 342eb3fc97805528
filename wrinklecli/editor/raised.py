"""A tool with the clip that raises it most, and the meshes of the asset over that clip, with it and without."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.editor.attached import AttachedTool, AttachedTools, PlayableMesh, ShownMesh
from wrinklecli.editor.clip_cache import ClipCache
from wrinklecli.frozen import dataclass
from wrinklecli.review.preview.peaks import tallest_clip


@dataclass(frozen=True, eq=False, slots=True)
class RaisedTool:
    """A tool and the clip that raises it most.

    Attributes:
        meshes: All meshes of the asset, with the tools that are shown.
        time: The frame of the clip at which the tool is tallest, seconds.
    """

    attached: AttachedTool
    meshes: tuple[PlayableMesh, ...]
    cache: ClipCache
    clip: Clip
    time: float

    @property
    def height(self) -> float:
        """The tool's greatest height, scene units."""
        return self.height_at(self.time)

    def shown(self, time: float, *, wrinkled: bool = True) -> list[ShownMesh]:
        """The meshes at a time of the clip."""
        return [ShownMesh(each, each.posed(self.clip, time, wrinkled=wrinkled)) for each in self.meshes]

    def height_at(self, time: float) -> float:
        """The tool's height at a time of the clip, scene units."""
        numbers = self.cache.numbers_at(self.attached.ground, self.attached.part, self.clip, time)
        (height,) = self.attached.part.heights(self.attached.plan.fine, self.clip, numbers)
        return float(height)


def raised_tool(tools: AttachedTools, name: str, cache: ClipCache, clips: Sequence[Clip]) -> RaisedTool | None:
    """Find the clip that raises a tool most, as a review does; None if the tool does not fit, or no clip raises it."""
    attached = tools.tools.get(name)
    found = None if attached is None else tallest_clip(attached.facts_in(cache, clips))
    if attached is None or found is None:
        return None
    clip = next(clip for clip in clips if clip.name == found["name"])
    times = cache.times(clip)
    return RaisedTool(attached, tools.meshes, cache, clip, float(times[np.argmin(np.abs(times - found["time"]))]))
