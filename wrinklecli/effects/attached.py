"""Effects on a mesh at rest, before refinement: what may be asked of any of them."""

from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple, Protocol

from wrinklecli.character.rig import DrivenTargets
from wrinklecli.drive.touch import TouchDrive
from wrinklecli.numeric.arrays import Floats
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.region import Region
from wrinklecli.tools.records import EffectTool


class Moves(NamedTuple):
    """Morph targets of an effect that moves the whole body below the skin, for the effects after it.

    Attributes:
        drive: The names of the targets, and their weights.
        deltas: (targets, vertices, 3) of the coarse surface, bind space.
        refined: A function that gives them for all vertices of the refined surface; None if they are interpolated.
    """

    drive: DrivenTargets
    deltas: Floats
    refined: Callable[[Refinement], Floats] | None = None


class Drag(NamedTuple):
    """A tip that drags skin.

    Attributes:
        drive: The slide and the dent, over time.
        at: (3,) the place on the skin at rest.
        reach: The distance from there within which skin slides, scene units.
        folding: The slide from which on the skin looks folded, scene units.
    """

    drive: TouchDrive
    at: Floats
    reach: float
    folding: float


class Attached(Protocol):
    """A tool on the mesh at rest, before refinement."""

    @property
    def tool(self) -> EffectTool:
        """Its entry in the tools file."""
        ...

    @property
    def span(self) -> float:
        """The length of which per cent in its entry are: of the tool or the muscle, or a radius; scene units."""
        ...

    @property
    def regions(self) -> Sequence[Region]:
        """The regions where edges must be split."""
        ...

    @property
    def greatest_height(self) -> float:
        """The largest move of the effect, scene units."""
        ...

    @property
    def moves(self) -> Moves | None:
        """The morph targets by which the effect moves the mesh before later effects see it; None if they do not."""
        ...

    @property
    def covers(self) -> Sequence[str]:
        """Names of other meshes that lie over it and stay as they are, so that it may come through them."""
        ...

    @property
    def keyed_clips(self) -> Collection[str]:
        """Names of clips that move it, though they may move no joint."""
        ...

    @property
    def drag(self) -> Drag | None:
        """The tip that drags its skin; None if none does."""
        ...
