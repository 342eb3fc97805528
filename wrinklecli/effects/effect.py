"""Effects: they move a mesh by a few fixed shapes in bind space, added up by weights over time.

A kind of effect attaches its tools to the mesh at rest and names the regions where edges must be split (`Attached`).
All effects of a kind on the refined mesh are a `Layer`, which makes an `Effect` for each tool or fold: targets to
write, and the drive that sets their weights, in the clips of the asset and in those of other files alike. Layers act in
one order, and each sees the body as moved by those before it.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.choices import Mode
from wrinklecli.drive.drive import AnyDrive, Drive
from wrinklecli.drive.table import Table, Weights
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.shapes import Shape
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.guard import Progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import EffectTool, ToolsFile

LayerType = TypeVar("LayerType", bound="Layer")
ToolType = TypeVar("ToolType", bound=EffectTool)
AttachedOfKind = TypeVar("AttachedOfKind", bound=AnyAttached)

VISIBLE = 1e-3
"""Shortening over the rest length below which a tool counts as not shortened."""


@dataclass(frozen=True, slots=True)
class Target:
    """A morph target to write: its name and shape, and the number of that among all shapes of the effect.

    Those that move no vertex have no target, so a finer mesh may have targets of more numbers.
    """

    name: str
    shape: Shape
    number: int = 0


@dataclass(frozen=True, slots=True)
class Motion:
    """One clip, sampled.

    Attributes:
        times: (frames,) seconds.
        keys: (keys,) numbers of the frames that a track needs, linear between them.
        readings: The measurements of each effect's drive at these times, such as a segment's lengths.
        weights: For each effect (frames, targets) weights of its targets.
    """

    clip: Clip
    times: Floats
    keys: Ints
    readings: tuple[Any, ...]
    weights: tuple[Floats, ...]

    def seen(self, number: int) -> "Seen":
        """The effect of a number in this clip."""
        return Seen(self, self.readings[number], self.weights[number])


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
        copies: The names of nodes that show a copy of the mesh at its place.
        unread: A line for each other mesh that cannot be read.
    """

    rig: Rig
    rest: Rest
    fine: Refinement
    layers: tuple["Layer", ...]
    tallest: float
    max_error: float
    scale: float
    has_normals: bool
    copies: tuple[str, ...]
    unread: tuple[str, ...]

    @property
    def attributes(self) -> int:
        """The attributes of a morph target: POSITION, and NORMAL if the mesh has it."""
        return 1 + self.has_normals

    @property
    def parts(self) -> "list[Part]":
        """The effects, as far as they are known before clips are sampled."""
        return [part for layer in self.layers for part in layer.parts]

    def layer(self, kind: type[LayerType]) -> LayerType | None:
        """The layer of a kind; None if there is none."""
        return next((each for each in self.layers if isinstance(each, kind)), None)


class Seen(NamedTuple):
    """An effect in one clip: the measurements of its drive, and (frames, targets) weights, at the motion's times."""

    motion: Motion
    reading: Any
    weights: Floats


class Words(Protocol):
    """An effect's words about itself, for people."""

    @property
    def remedy(self) -> str:
        """The way to leave the effect out, for messages about too many targets; empty if fewer bumps are."""

    @property
    def left_out(self) -> str | None:
        """The warning that says why nothing of the effect is made; None if it is made."""

    def summary(self, effects: int, targets: int) -> str:
        """Count the effects of this kind, and their targets, for a bake's summary; empty if they count as tools."""

    def describe(self, plan: MeshPlan, targets: tuple[str, ...]) -> Json:
        """The effect's entry in the report, with the names of its targets: JSON values only."""

    def describe_clip(self, seen: Seen) -> Json | None:
        """The effect's entry in a clip of a detailed report; None if there is none."""

    def warnings(self, plan: MeshPlan, clips: Sequence[Seen], up: str, /) -> list[str]:
        """Warnings for users, from the effect in all clips; `up` is the axis of positions."""


class Remixes(ABC):
    """Other morph targets that play the same motion, for the limits of engines."""

    @abstractmethod
    def with_unit_weights(self, effect: "Effect") -> "Effect":
        """The effect with weights in [0, 1]."""

    def with_fewest_targets(
        self,
        effect: "Effect",
        _plan: MeshPlan,
        _tolerance: float,
        *,
        at_once: bool,  # noqa: ARG002
    ) -> "Effect":
        """The effect with the fewest targets, or the fewest `at_once`, within a tolerance, scene units."""
        return effect

    def with_at_most(self, effect: "Effect", _most: int) -> "Effect":
        """An effect of its main targets alone, so many at most; the same one if it needs all of them."""
        return effect


@dataclass(frozen=True, slots=True, eq=False)
class Effect:
    """One effect on a mesh: morph targets, and the drive that sets their weights.

    Attributes:
        name: Its name in messages.
        section: The key of extras and report under which effects of its kind stand.
        identifier: The part of the targets' names that is the effect's own.
        targets: One for each shape that moves a vertex.
        drive: It sets the weights of the targets, which are among its own. None if there are no targets.
        words: What it says of itself.
        exact: The response of which the drive has a table, for the proof; None if the drive's own is exact.
        error: The error of the shapes themselves, where they are fewer than the method's, scene units.
        max_error: The error that the moves of the effect itself may have, scene units; None if it is the plan's.
        remixes: Its way to hold the limits of engines; None if it has one way alone.
        least: Weights up to this are 0, so that few targets act at a time; the proof counts them.
        projected: The vertices that are projected in each frame, and a function from a clip and (frames,) seconds to
            their (frames, vertices, 3) displacements, bind space, for the proof; None if shapes do not change.
        add_up: True if several targets move one vertex at once, so that errors of their weights add up.
    """

    name: str
    section: str
    identifier: str
    targets: tuple[Target, ...]
    drive: "AnyDrive | None"
    words: Words
    exact: Weights | None = None
    error: float = 0.0
    max_error: float | None = None
    remixes: Remixes | None = None
    least: float = 0.0
    projected: tuple[Ints, Callable[[Clip, Floats], Floats]] | None = None
    add_up: bool = False

    @property
    def target_names(self) -> tuple[str, ...]:
        """The names of the targets."""
        return tuple(target.name for target in self.targets)

    def weights(self, clip: Clip | None, reading: Any, *, exact: bool = False) -> Floats:
        """(frames, targets) weights at the measurements of the drive in a clip; by the exact response for the proof."""
        if self.drive is None:
            return np.zeros((len(reading), 0))
        if exact:
            return self.drive.weights(clip, reading, self.exact)
        found = self.drive.weights(clip, reading)
        return np.where(np.abs(found) > self.least, found, 0.0)

    @property
    def most_at_once(self) -> int:
        """The greatest number of targets whose weights differ from 0 at a time, as far as one table tells."""
        if not isinstance(self.drive, Drive) or self.drive.rows or not isinstance(self.drive.response, Table):
            return len(self.targets)
        shown = np.abs(self.drive.response.table) > self.least
        return int((shown[:-1] | shown[1:]).sum(axis=1).max(initial=0))

    def stored_weights(self, rig: Rig) -> Floats:
        """(targets,) weights in the stored pose: zeros, unless the tools file has another rest pose."""
        if self.drive is None:
            return np.zeros(0)
        return np.asarray(self.weights(None, self.drive.reader(rig, None)(np.zeros(1), {}))[0])


class Part(Protocol):
    """One effect on a refined mesh."""

    @property
    def attached(self) -> AnyAttached:
        """It at rest."""

    @property
    def region(self) -> int:
        """The number of its first region among those of the refinement."""

    @property
    def vertices(self) -> Ints:
        """(vertices,) the fine welded vertices that it may move, sorted."""

    @property
    def target_vertices(self) -> list[Ints]:
        """For each of its morph targets, as far as they are known, the fine welded vertices that the target moves."""

    @property
    def shares(self) -> Floats:
        """(vertices,) their greatest moves over the greatest of all."""

    @property
    def us(self) -> Floats:
        """(vertices,) their places across its crests, from 0 to 1: u, unless crests are bent."""

    @property
    def drive(self) -> AnyDrive:
        """Its drive, which gives its measurements and weights, whether it has targets or not."""

    def sizes(self, fine: Refinement) -> Floats:
        """(weights of the drive,) the largest move that each stands for, scene units."""

    def numbers(self, clip: Clip | None, reading: Any) -> Floats:
        """(frames, numbers) by which it moves, from the measurements of its drive; it alone knows what they are."""

    def strengths(self, seen: "Seen") -> Floats:
        """(frames,) how far it is moved: shortenings over the rest length, or greatest weights."""

    def displacements(
        self, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, numbers: Floats | None = None
    ) -> Floats:
        """(frames, vertices, 3) their displacements at (frames,) seconds of a clip, bind space.

        The `numbers` at these times are found, unless they are known.
        """

    def heights(self, fine: Refinement, clip: Clip | None, numbers: Floats) -> Floats:
        """(frames,) the height of its highest bump by (frames, numbers) in a clip, scene units."""

    def cut(self, clip: Clip | None, numbers: Floats) -> Floats:
        """(points, 2) the cut of what it raises along its middle at one moment: places and heights, scene units.

        `numbers` are (1, numbers). There are no points for an effect without a control curve.
        """

    def facts(self, plan: MeshPlan, up: str) -> Json:
        """The facts that an artist wants of it, whatever moves it: JSON values only; `up` is the axis of positions."""

    def facts_in(self, plan: MeshPlan, seen: Seen) -> Json:
        """Facts that an artist wants of it in a clip: its `name`, the greatest `height` of the effect, its `time`."""

    def cuts(self, shortenings: Floats) -> tuple[Floats, Floats]:
        """(cuts, points) places and heights along its middle at (cuts,) shortenings over the rest length, scene units.

        There are no points for an effect without a control curve.
        """

    def words(self, plan: MeshPlan) -> Words:
        """Its words about itself."""


class Layer(Protocol):
    """All effects of one kind on a refined mesh.

    Attributes:
        section: The key of extras and report under which these effects stand.
        is_solved: True if its effects are found by a solver, which takes minutes.
    """

    section: ClassVar[str]
    is_solved: ClassVar[bool] = False

    @property
    def parts(self) -> Sequence[Part]:
        """The effects, as far as they are known before clips are sampled."""
        return ()

    @property
    def named_clips(self) -> frozenset[str]:
        """Names of clips in which an effect acts differently from other clips of the same motion."""
        return frozenset()

    @property
    def sampled_numbers(self) -> int:
        """The count of numbers that are kept for each sampled time."""
        return 0

    @property
    def projected(self) -> int:
        """The number of vertices that are posed at each time that is sampled."""
        return 0

    def target_sizes(self, _plan: MeshPlan, _clips: Sequence[Clip], _frames: int, _memory: Memory) -> list[int]:
        """An estimate, before clips are sampled, of the welded vertices that each morph target moves, at most.

        There is none if the effects have few targets and few vertices.

        Raises:
            BakeError: There would be too many targets.
            TooMuchError: Sampling would take more memory than there may be.
        """
        return []

    def effects(
        self, plan: MeshPlan, clips: Sequence[Clip], before: Sequence[Effect], how: SamplingOptions
    ) -> list[Effect]:
        """Make the effects of the layers before and of this one.

        Args:
            plan: The whole mesh.
            clips: The clips that move the mesh, for effects that depend on them: contact, and vertices that are
                projected in each frame.
            before: The effects of the layers before, which contact may lower.
            how: Times and limits.

        Raises:
            BakeError: There are too many shapes.
        """

    def warnings(self, _plan: MeshPlan, _clips: Sequence[Clip]) -> list[str]:
        """Warnings for users about several effects together, besides those of each."""
        return []


class EffectKind(ABC, Generic[ToolType, AttachedOfKind]):
    """One kind of effect, from the tools that ask for it to a layer of them."""

    @property
    def is_installed(self) -> bool:
        """True if the libraries that it needs are installed."""
        return True

    @abstractmethod
    def attach(self, tools: Sequence[ToolType], ground: Ground, settings: ToolsFile) -> Sequence[AttachedOfKind]:
        """Attach tools of this kind to a mesh at rest.

        Raises:
            WrinkleError: Tools do not fit, a line for each.
        """

    def bound(self, attached: Sequence[AttachedOfKind], _ground: Ground) -> Sequence[AttachedOfKind]:
        """Let tools that are attached end where features of the surface and masks end them.

        Raises:
            WrinkleError: Nothing is left of some, a line for each.
        """
        return attached

    def sketch(
        self, _attached: AttachedOfKind, _region: int, _fine: Refinement, _pinned: Bools, _before: Part | None = None
    ) -> Part | None:
        """Let a refined surface carry a tool of this kind quickly, as while someone drags it.

        Args:
            _attached: The tool.
            _region: The number of its first region.
            _fine: The surface, which may have been refined for another tool.
            _pinned: (coarse vertices,) True for those that must not move.
            _before: The same tool on this surface as it was, whose shapes may serve again.

        Returns:
            None for an effect that moves the body with its rig.

        Raises:
            BakeError: It moves no vertex.
        """
        return None

    def driven_by(self, attached: AttachedOfKind, _tool: ToolType) -> AttachedOfKind:
        """The same for another entry of the tool that changes its drive alone; where none does, the tool itself."""
        return attached

    @abstractmethod
    def plan(self, plan: MeshPlan, ground: Ground, attached: Sequence[tuple[int, AttachedOfKind]]) -> Layer:
        """The layer of this kind on a refined mesh.

        Args:
            plan: The mesh with the layers before this one.
            ground: The mesh at rest.
            attached: The attached tools of this kind, each with the number of its first region.

        Raises:
            BakeError: Tools do not fit, a line for each.
        """

    @abstractmethod
    def lines(self, entry: Json) -> list[str]:
        """The lines that `check` prints for the entry of one of these effects."""


def named_targets(identifier: str, shapes: Iterable[Shape | None]) -> tuple[Target, ...]:
    """Targets `wrinkle_NAME_1`, `wrinkle_NAME_2` … for the shapes that there are, by an effect's identifier."""
    there = [(number, shape) for number, shape in enumerate(shapes) if shape is not None]
    return tuple(
        Target(f"wrinkle_{identifier}_{count}", shape, number) for count, (number, shape) in enumerate(there, start=1)
    )


def driven_targets(names: Iterable[str], shapes: Iterable[Shape | None]) -> tuple[Target, ...]:
    """Targets for the shapes that there are, by the names that a drive has for all."""
    named = enumerate(zip(names, shapes, strict=True))
    return tuple(Target(name, shape, number) for number, (name, shape) in named if shape is not None)


def targets_of(effects: Iterable[Effect]) -> tuple[Target, ...]:
    """The morph targets of all effects, in order."""
    return tuple(target for each in effects for target in each.targets)


def target_weights(motion: Motion) -> Floats:
    """(frames, targets) weights of the targets of all effects in one clip."""
    return np.concatenate([np.zeros((len(motion.times), 0)), *motion.weights], axis=1)
