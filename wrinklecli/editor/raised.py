"""An effect with the clip that raises it most, and the meshes of the asset over that clip, with it and without."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.editor.attached import AttachedBelow, AttachedTool, AttachedTools, PlayableMesh, ShownMesh
from wrinklecli.editor.clip_cache import ClipCache
from wrinklecli.frozen import dataclass


@dataclass(frozen=True, eq=False, slots=True)
class RaisedTool:
    """An effect and the clip that raises it most, or in which it moves the skin most.

    Attributes:
        meshes: All meshes of the asset, with the tools that are shown.
        time: The frame of the clip at which it is tallest, seconds.
    """

    attached: AttachedTool | AttachedBelow
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
        """The tool's height at a time of the clip, scene units, between those of its frames."""
        return float(np.interp(time, *self.attached.heights(self.cache, self.clip)))


def raised_tool(tools: AttachedTools, name: str, cache: ClipCache, clips: Sequence[Clip]) -> RaisedTool | None:
    """Find the clip that raises an effect most; None if it does not fit, or no clip raises it."""
    attached = tools.every.get(name)
    found = None if attached is None else attached.greatest(cache, clips)
    if attached is None or found is None:
        return None
    clip, time = found
    times = cache.times(clip)
    return RaisedTool(attached, tools.meshes, cache, clip, float(times[np.argmin(np.abs(times - time))]))
