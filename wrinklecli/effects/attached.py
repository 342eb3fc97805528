"""Effects on a mesh at rest, before refinement: what may be asked of any of them."""

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias, TypeVar

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import DrivenTargets, Rig
from wrinklecli.drive.segment import Segment
from wrinklecli.numeric.arrays import Floats, Ints
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.region import Region
from wrinklecli.tools.records import EffectTool

if TYPE_CHECKING:
    from wrinklecli.drive.touch import TouchDrive

Tool = TypeVar("Tool", bound=EffectTool, covariant=True)


class Moves(NamedTuple):
    """Morph targets of an effect that moves the whole body below the skin, for the effects after it.

    Attributes:
        drive: The names of the targets, and their weights.
        deltas: (targets, vertices, 3) of the coarse surface, bind space.
        refined: A function that gives them for all vertices of the refined surface; None if they are interpolated.
        tuned: A function from another entry for the same targets, which differs by `DRIVING` keys, to its drive; None
            if there are no such keys.
    """

    drive: DrivenTargets
    deltas: Floats
    refined: Callable[[Refinement], Floats] | None = None
    tuned: Callable[[Any], DrivenTargets] | None = None


class Drag(NamedTuple):
    """A tip that drags skin.

    Attributes:
        drive: The slide and the dent, over time.
        at: (3,) the place on the skin at rest.
        reach: The distance from there within which skin slides, scene units.
        folding: The slide from which on the skin looks folded, scene units.
    """

    drive: "TouchDrive"
    at: Floats
    reach: float
    folding: float


class Attached(Protocol[Tool]):
    """A tool on the mesh at rest, before refinement; what is not said otherwise holds for one without a segment."""

    @property
    def tool(self) -> Tool:
        """Its entry in the tools file."""

    @property
    def span(self) -> float:
        """The length of which per cent in its entry are: of the tool or the muscle, or a radius; scene units."""

    @property
    def regions(self) -> Sequence[Region]:
        """The regions where edges must be split."""

    @property
    def greatest_height(self) -> float:
        """The largest move of the effect, scene units."""

    @property
    def moves(self) -> Moves | None:
        """The morph targets by which the effect moves the mesh before later effects see it; None if they do not."""

    @property
    def covers(self) -> Sequence[str]:
        """Names of other meshes that lie over it and stay as they are, so that it may come through them."""

    @property
    def segment(self) -> Segment | None:
        """The segment or path whose length moves it; None if something else does."""
        return None

    @property
    def bump_width(self) -> float:
        """The width of a bump, scene units."""
        return self.span

    def may_move(self, _fine: Refinement) -> Sequence[Ints]:
        """For each target the vertices of a refined surface that it may move, before that carries the effect.

        They are known of fields alone, which move so many that it matters.
        """
        return ()

    @property
    def full(self) -> float:
        """The shortening of its segment, over the rest length, from which on it moves no farther; 1 for none."""
        return 1.0

    @property
    def flatter(self) -> str:
        """A remedy that makes it turn fewer triangles over, as the end of a warning."""
        return "a lower one avoids it"

    @property
    def keyed_clips(self) -> Collection[str]:
        """Names of clips that move it, though they may move no joint."""
        return ()

    @property
    def drag(self) -> Drag | None:
        """The tip that drags its skin; None if none does."""
        return None

    def clip_warnings(self, _rig: Rig, _clips: Sequence[tuple[Clip, Floats]]) -> list[str]:
        """Warnings about clips that say too little of how it moves, by (frames, targets) weights in each."""
        return []

    def fitting_compressible(self, _lengths: Iterable[tuple[Floats, Floats]], _height: float | None = None) -> float:
        """The part of each shortening, 0 to 1, that the tissue must take so that bumps are full at the greatest one.

        Args:
            _lengths: For each clip (frames,) lengths of the segment and (frames,) rest lengths, scene units.
            _height: Another height at which bumps grow no more.
        """
        return 0.0


AnyAttached: TypeAlias = Attached[Any]
