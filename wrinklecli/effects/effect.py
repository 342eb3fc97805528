"""Effects: they move a mesh by a few fixed shapes in bind space, added up by weights over time.

A kind of effect attaches its tools to the mesh at rest and names the regions where edges must be split (`Attached`).
All effects of a kind on the refined mesh are a `Layer`. When clips are sampled, a layer makes an `Effect` for each tool
or fold: targets to write, their weights, and the drive that sets these in clips of other files. Layers act in one
order, and each sees the body as moved by those before it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, ClassVar, Protocol, Self, TypeVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.character.sparse_targets import SparseDeltas
from wrinklecli.choices import Mode
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.swing import SwingDrive
from wrinklecli.drive.touch import TouchDrive
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.shapes import Shape
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.guard import Progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.piecewise import Signal
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import EffectTool, ToolsFile

LayerType = TypeVar("LayerType", bound="Layer")


@dataclass(frozen=True, slots=True)
class Target:
    """A morph target to write: its name and shape."""

    name: str
    shape: Shape


@dataclass(frozen=True, slots=True)
class Motion:
    """One clip, sampled.

    Attributes:
        times: (frames,) seconds.
        keys: (keys,) numbers of the frames that a track needs, straight between them.
        states: The measurements of each effect at these times, such as a segment's lengths; None if it keeps none.
        weights: For each effect (frames, shapes) weights as sampled; empty before there are shapes.
    """

    clip: Clip
    times: Floats
    keys: Ints
    states: tuple[Any, ...]
    weights: tuple[Floats, ...] = ()


@dataclass(frozen=True, slots=True)
class SamplingOptions:
    """Times and limits of the sampling of clips.

    Attributes:
        fps: Frames per second of the grid.
        mode: `frames` samples the grid alone, `morph` the times that straight lines between keys need.
        memory: The limit on samples.
        progress: Called with a stage's name, steps done and steps in all.
        jobs: Processes that resolve contact.
    """

    fps: float
    mode: Mode
    memory: Memory
    progress: Progress
    jobs: int = 1


@dataclass(frozen=True, slots=True)
class MeshPlan:
    """The effects on one node's mesh, attached and refined: everything but time.

    Attributes:
        rig: The rig, with the targets of effects that move the mesh below the skin; `rig.own` is the asset's.
        fine: The refined surface, with these targets among its morph targets.
        layers: The effects, kind by kind, in the order in which they act.
        tallest: The largest move that any effect can make, as a rule the height of the tallest wrinkle, scene units.
            If there are several kinds, it is that of the kind with the smallest moves, as errors show most there.
        max_error: Scene units.
        scale: World over bind units, at rest.
        has_normals: True if the mesh has NORMALs, so that shapes need them too.
    """

    rig: Rig
    rest: Rest
    fine: Refinement
    layers: tuple["Layer", ...]
    tallest: float
    max_error: float
    scale: float
    has_normals: bool

    def layer(self, kind: type[LayerType]) -> LayerType | None:
        """The layer of a kind; None if there is none."""
        return next((each for each in self.layers if isinstance(each, kind)), None)


@dataclass(frozen=True, slots=True)
class Effect(ABC):
    """One effect on a mesh: its morph targets, their weights over time, and words about both.

    By default, an effect has no other targets that would meet an engine's limit.

    Attributes:
        identifier: The part of the targets' names that is the effect's own.
        targets: One for each shape; None for a shape that moves no vertex, which is not written.
    """

    identifier: str
    targets: tuple[Target | None, ...]

    section: ClassVar[str]
    """The key of extras and report under which effects of this kind stand."""
    remedy: ClassVar[str] = ""
    """The way to leave these effects out, for messages about too many targets."""

    @property
    @abstractmethod
    def name(self) -> str:
        """The effect's name in messages."""

    @property
    @abstractmethod
    def drive(self) -> Drive | SwingDrive | TouchDrive | None:
        """The drive that sets the weights of the targets in clips that were never baked; None if there is none."""

    @property
    def left_out(self) -> str | None:
        """The warning that says why nothing of the effect is made; None if it is made."""
        return None

    @property
    def max_error(self) -> float | None:
        """The error that the moves of the effect itself may have, scene units; None if it is the plan's."""
        return None

    @property
    def columns(self) -> Ints:
        """Numbers of the shapes that have a target."""
        return np.array([index for index, target in enumerate(self.targets) if target is not None], np.intp)

    @property
    def target_names(self) -> tuple[str, ...]:
        """The names of the targets that are written."""
        return tuple(target.name for target in self.targets if target is not None)

    def written(self, weights: Floats) -> Floats:
        """The columns of (frames, shapes) weights that have a target."""
        chosen: Floats = weights[:, self.columns]
        return chosen

    @abstractmethod
    def shape_weights(self, sampled: Floats) -> Floats:
        """(frames, shapes) weights of the targets' shapes from (frames, …) weights as sampled."""

    @abstractmethod
    def stored_weights(self, rig: Rig) -> Floats:
        """(targets,) weights of the written targets in the stored pose."""

    @abstractmethod
    def weights_at(self, rig: Rig, motion: Motion, sampled: Floats, times: Floats) -> Floats:
        """(times, …) weights as sampled at further times of a motion, from its (frames, …) ones."""

    def acting(self, _rig: Rig, _clip: Clip, _time: float) -> list[tuple[Shape, float]]:
        """The shapes that act at a moment of a motion that is in no file, each with its weight, without a filter."""
        return []

    @classmethod
    def observe(cls, effects: Sequence[Self], _rig: Rig, _motion: Motion, _times: Floats, _known: Sequence[Any]) -> Any:
        """The measurements of effects at sorted (times,), among which are the motion's, where they are `_known`."""
        return [None] * len(effects)

    @classmethod
    def count_targets(cls, effects: Sequence["Effect"]) -> str:
        """Count the targets of all effects of this kind, for a bake's summary; empty if they are counted as tools'."""
        return f"{len(targets_of(effects))} of {cls.section}"

    # For the limits of engines.

    def with_unit_weights(self, _sampled: Sequence[Floats]) -> "Effect":
        """The same motion with weights in [0, 1], from each clip's (frames, …) weights as sampled."""
        return self

    def with_fewest_targets(self, _plan: MeshPlan, _tolerance: float, *, at_once: bool) -> tuple["Effect", float]:
        """The same motion with the fewest targets, or the fewest `at_once`, and its error; lengths are scene units."""
        assert at_once in (True, False)
        return self, 0.0

    @property
    def most_at_once(self) -> int:
        """The greatest number of targets whose weights differ from 0 at a time."""
        return len(self.target_names)

    def turns(self, _rig: Rig, _clip: Clip, _keys: Floats, _weights: Floats) -> Floats:
        """Times between (keys,) seconds with (keys, shapes) weights that keep fewer targets active at once."""
        return np.zeros(0)

    # For the proof.

    @abstractmethod
    def exact_shapes(self, vertices: Ints) -> Iterator[SparseDeltas]:
        """Each of the method's own shapes at (vertices,) fine welded vertices, at weight 1."""

    @abstractmethod
    def exact_weights(self, motion: Motion, sampled: Floats, times: Floats, state: Any) -> Floats:
        """(times, shapes) the method's weights of `exact_shapes`, from the effect's measurements at the times."""

    def moved_in_frames(
        self, _plan: MeshPlan, _clip: Clip, _times: Floats, _chosen: Ints, _state: Any
    ) -> tuple[Ints, Callable[[slice], Floats]] | None:
        """Give fine vertices that move besides `exact_shapes`, and their (part of chosen times, vertices, 3) moves.

        `_state` is measured at all (times,), of which the (chosen,) are compared. None if no such vertex moves.
        """
        return None

    def raised(self, times: Floats, _state: Any) -> Bools:
        """(times,) True where the normals of the effect are worth comparing."""
        return np.zeros(len(times), np.bool_)

    @abstractmethod
    def telling(self, exact: Floats, state: Any) -> set[int]:
        """Numbers of the times at which an error would show most, from the (times, shapes) exact weights."""

    @abstractmethod
    def weight_error(self, played: Floats, exact: Floats, state: Any, clip: Clip) -> float:
        """Largest error of the moves that (times, targets) played weights stand for, scene units."""

    # For people.

    @abstractmethod
    def describe(self, plan: MeshPlan) -> Json:
        """The effect's entry in the report: JSON values only."""

    def describe_clip(self, _motion: Motion, _state: Any) -> Json | None:
        """The effect's entry in a clip of a detailed report; None if there is none."""
        return None

    @abstractmethod
    def warnings(self, plan: MeshPlan, motions: Sequence[tuple[Motion, Any, Floats]], *, up: str) -> list[str]:
        """Warnings for users, from motions with the effect's measurements and weights in them."""


class Part(Protocol):
    """One effect on a refined mesh."""

    @property
    def attached(self) -> AnyAttached:
        """It at rest."""
        ...

    @property
    def region(self) -> int:
        """The number of its first region among those of the refinement."""
        ...

    @property
    def vertices(self) -> Ints:
        """(vertices,) the fine welded vertices that it may move, sorted."""
        ...

    @property
    def shares(self) -> Floats:
        """(vertices,) their greatest moves over the greatest of all."""
        ...

    @property
    def us(self) -> Floats:
        """(vertices,) their places across its crests, from 0 to 1: u, unless crests are bent."""
        ...

    def reader(self, rig: Rig, clip: Clip | None) -> Signal:
        """A function from (frames,) seconds of a clip to (frames, numbers) by which the effect moves.

        What they are is known to the effect alone.
        """
        ...

    def displacements(
        self, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, numbers: Floats | None = None
    ) -> Floats:
        """(frames, vertices, 3) their displacements at (frames,) seconds of a clip, bind space.

        `numbers` are the reader's at these times, if they are known.
        """
        ...

    def heights(self, fine: Refinement, clip: Clip | None, numbers: Floats) -> Floats:
        """(frames,) the height of its highest bump, scene units, by the reader's (frames, numbers) in a clip."""
        ...

    def cut(self, clip: Clip | None, numbers: Floats) -> Floats:
        """(points, 2) the cut of what it raises along its middle at one moment: places and heights, scene units.

        `numbers` are (1, numbers). There are no points for an effect without a control curve.
        """
        ...

    def facts(self, plan: MeshPlan, up: str) -> Json:
        """What an artist wants to know of it, whatever moves it: JSON values only; `up` is the axis of positions."""
        ...

    def facts_in(self, plan: MeshPlan, clip: Clip, times: Floats, numbers: Floats) -> Json:
        """What an artist wants to know of it in a clip: its `name`, the greatest `height` of the effect, its `time`.

        The reader has given (frames, numbers) at (frames,) seconds.
        """
        ...

    def place_warnings(self, plan: MeshPlan) -> list[str]:
        """Warnings about its place on the mesh, whatever moves it."""
        ...


class Layer(Protocol):
    """All effects of one kind on a refined mesh."""

    @property
    def parts(self) -> Sequence[Part]:
        """The effects, as far as they are known before clips are sampled."""
        ...

    @property
    def is_solved(self) -> bool:
        """True if its effects are found by a solver, which takes minutes."""
        ...

    @property
    def section(self) -> str:
        """The key of extras and report under which these effects stand."""
        ...

    @property
    def drives_alone(self) -> bool:
        """True if drives alone move its effects, whatever other effects do, so that it can be sampled by itself."""
        ...

    @property
    def samples_anew(self) -> bool:
        """True if it samples the effects before it again, with its own, and does not look at their motions."""
        ...

    @property
    def moved(self) -> Sequence[Ints]:
        """The fine welded vertices that each effect may move."""
        ...

    @property
    def named_clips(self) -> frozenset[str]:
        """Names of clips in which an effect acts differently from other clips of the same motion."""
        ...

    @property
    def keyed_clips(self) -> frozenset[str]:
        """Names of clips that move an effect, though they may move no joint."""
        ...

    @property
    def sampled_numbers(self) -> int:
        """The count of numbers that are kept for each sampled time."""
        ...

    @property
    def projected(self) -> int:
        """The number of vertices that are posed at each time that is sampled."""
        ...

    def target_sizes(self, plan: MeshPlan, clips: Sequence[Clip], frames: int, memory: Memory) -> list[int]:
        """An estimate, before clips are sampled, of the welded vertices that each morph target moves, at most.

        Raises:
            BakeError: There would be too many targets.
            TooMuchError: Sampling would take more memory than there may be.
        """
        ...

    def sample(
        self,
        plan: MeshPlan,
        clips: Sequence[Clip],
        effects: Sequence[Effect],
        motions: Sequence[Motion],
        how: SamplingOptions,
    ) -> tuple[list[Effect], list[Motion]]:
        """Run the effects over clips.

        Args:
            plan: The whole mesh.
            clips: The clips that move the mesh.
            effects: The effects of the layers before.
            motions: The clips as these effects sampled them; none for the first layer.
            how: Times and limits.

        Returns:
            The effects of the layers before and of this one, and motions with the weights of all.

        Raises:
            BakeError: There are too many shapes.
        """
        ...

    def warnings(self, plan: MeshPlan, clips: Sequence[Clip]) -> list[str]:
        """Warnings for users about several effects together, besides those of each."""
        ...


class EffectKind(Protocol):
    """One kind of effect, from tools to a layer."""

    @property
    def section(self) -> str:
        """The key of extras and report under which these effects stand."""
        ...

    @property
    def is_installed(self) -> bool:
        """True if the libraries that it needs are installed."""
        ...

    def attach(self, tools: Sequence[EffectTool], ground: Ground, settings: ToolsFile) -> Sequence[AnyAttached]:
        """Attach the tools of this kind to a mesh at rest.

        Raises:
            WrinkleError: Tools do not fit, a line for each.
        """
        ...

    def bound(self, attached: Sequence[AnyAttached], ground: Ground) -> Sequence[AnyAttached]:
        """Let tools that are attached end where features of the surface and masks end them.

        Raises:
            WrinkleError: Nothing is left of some, a line for each.
        """
        ...

    def sketch(self, attached: AnyAttached, region: int, fine: Refinement, pinned: Bools) -> Part | None:
        """Let a refined surface carry a tool of this kind quickly, as while someone drags it.

        Args:
            attached: The tool.
            region: The number of its first region.
            fine: The surface, which may have been refined for another tool.
            pinned: (coarse vertices,) True for those that must not move.

        Returns:
            None for another kind, and for an effect that moves the body with its rig.

        Raises:
            BakeError: It moves no vertex.
        """
        ...

    def plan(self, plan: MeshPlan, ground: Ground, attached: Sequence[tuple[int, AnyAttached]]) -> Layer | None:
        """The layer of this kind on a refined mesh; None if no tool asks for it.

        Args:
            plan: The mesh with the layers before this one.
            ground: The mesh at rest.
            attached: All attached tools, each with the number of its first region.

        Raises:
            BakeError: Tools do not fit, a line for each.
        """
        ...

    def lines(self, entry: Json) -> list[str]:
        """What `check` prints of its entry for one of these effects."""
        ...


def named_targets(identifier: str, shapes: Iterable[Shape | None]) -> tuple[Target | None, ...]:
    """Targets `wrinkle_NAME_1`, `wrinkle_NAME_2` … for the shapes that there are, by an effect's identifier."""
    targets: list[Target | None] = []
    number = 0
    for shape in shapes:
        number += shape is not None
        targets.append(None if shape is None else Target(f"wrinkle_{identifier}_{number}", shape))
    return tuple(targets)


def targets_of(effects: Iterable[Effect]) -> tuple[Target, ...]:
    """The morph targets of all effects, in order."""
    return tuple(target for each in effects for target in each.targets if target is not None)


def target_weights(effects: Sequence[Effect], motion: Motion) -> Floats:
    """(frames, targets) weights of the targets of all effects in one clip."""
    columns = [each.written(each.shape_weights(weights)) for each, weights in zip(effects, motion.weights, strict=True)]
    return np.concatenate(columns, axis=1)
