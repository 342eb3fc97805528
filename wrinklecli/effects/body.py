"""The ground that muscles, flesh and touches share: effects that move the whole body by their drives alone.

The rig has their targets among its own, so that the anchors of later effects follow the skin that they move.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, Generic, Protocol, Self, TypeVar

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import Pose
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import AnyDrive
from wrinklecli.effects.attached import Attached
from wrinklecli.effects.effect import VISIBLE, Effect, Layer, MeshPlan, SamplingOptions, Seen, Words, driven_targets
from wrinklecli.effects.shapes import Sample, Shape, make_shapes
from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, are_nonzero, nonzero_rows
from wrinklecli.numeric.memory import Memory
from wrinklecli.surface.refine import Refinement
from wrinklecli.tools.records import EffectTool

OUTLINED = 0.3
"""Part of the largest move by which skin on the outline of a muscle, flesh, a touch or a field moves."""

# Vertices of each target by whose moves the largest move in a frame is found.
_LARGEST = 8


class AttachedBody(Attached[EffectTool], Protocol):
    """A tool at rest that has its drive already, as its weights depend on no refined surface."""

    @property
    def drive(self) -> AnyDrive:
        """The names of its targets, and their weights."""


AttachedType = TypeVar("AttachedType", bound=AttachedBody)


def body_effect(attached: AttachedBody, shapes: Sequence[Shape | None], words: Words) -> Effect:
    """The effect of a muscle, a region, a touch or a field, with such shapes.

    Targets have the names by which the drive, and the anchors of effects after it, know them.
    """
    tool, drive = attached.tool, attached.drive
    targets = driven_targets(drive.targets, shapes)
    if len(targets) < len(shapes):
        drive = drive.of_targets(np.array([shape is not None for shape in shapes]))
    return Effect(tool.name, tool.section, tool.identifier, targets, drive, words)


@dataclass(frozen=True, slots=True)
class BodyWords(ABC, Generic[AttachedType]):
    """The words that muscles, flesh, touches and fields share; the others as in `Words`.

    Attributes:
        attached: The effect at rest.
        deltas: (targets, fine vertices, 3) displacements at weight 1, bind space.
    """

    attached: AttachedType
    deltas: Floats
    left_out: ClassVar[None] = None

    @property
    def name(self) -> str:
        """Its name."""
        return self.attached.tool.name

    def summary(self, effects: int, targets: int) -> str:
        """Count the effects of its kind, and their targets."""
        return f"{counted(effects, *self.attached.tool.words)} in {counted(targets, 'morph target')}"

    def describe(self, plan: MeshPlan, targets: tuple[str, ...]) -> Json:
        """Its place, its own values, and its targets."""
        return {
            "name": self.name,
            "where": self.attached.tool.where,
            "node": plan.rig.node_name,
            **self.values(plan.rig.names),
            "moved_vertices": int(are_nonzero(self.deltas).any(axis=0).sum()),
            "targets": list(targets),
        }

    @abstractmethod
    def values(self, names: Sequence[str]) -> Json:
        """The facts in a report of this kind alone, by the names of nodes: JSON values, lengths in scene units."""


@dataclass(frozen=True, slots=True)
class BodyPart(Generic[AttachedType]):
    """A muscle, a region or a touch on the refined surface; the others as in `Part`.

    Attributes:
        deltas: (targets, fine vertices, 3) displacements at weight 1, bind space.
        layer: All of its kind.
    """

    attached: AttachedType
    region: int
    deltas: Floats
    layer: "BodyLayer[AttachedType]"

    @property
    def vertices(self) -> Ints:
        """(vertices,) those that a target moves."""
        return np.flatnonzero(are_nonzero(self.deltas).any(axis=0))

    @property
    def target_vertices(self) -> list[Ints]:
        """For each target the vertices that it moves."""
        return [nonzero_rows(target) for target in self.deltas]

    @property
    def shares(self) -> Floats:
        """(vertices,) their greatest moves by one target over the greatest of all."""
        moves = np.sqrt((self.deltas[:, self.vertices] ** 2).sum(axis=2)).max(axis=0)
        return np.asarray(moves / moves.max())

    @property
    def us(self) -> Floats:
        """(vertices,) halves: it is one bump."""
        return np.full(len(self.vertices), 0.5)

    @property
    def drive(self) -> AnyDrive:
        """The names of its targets, and their weights."""
        return self.attached.drive

    def sizes(self, fine: Refinement) -> Floats:
        """(targets,) the largest move of each."""
        _, moves = moves_at_rest(fine.blended, self.deltas)
        return np.asarray(np.sqrt((moves**2).sum(axis=2)).max(axis=1, initial=0.0))

    def numbers(self, clip: Clip | None, reading: Any) -> Floats:
        """(frames, targets) the weights of its targets."""
        return self.drive.weights(clip, reading)

    def strengths(self, seen: Seen) -> Floats:
        """(frames,) the greatest weights."""
        return np.asarray(np.abs(seen.weights).max(axis=1, initial=0.0))

    def displacements(
        self, _fine: Refinement, rig: Rig, clip: Clip | None, times: Floats, numbers: Floats | None = None
    ) -> Floats:
        """(frames, vertices, 3) the sums of its targets, bind space."""
        weights = self.drive.weights_in(rig, clip)(times) if numbers is None else numbers
        return np.asarray(np.tensordot(weights, self.deltas[:, self.vertices], axes=1))

    def heights(self, fine: Refinement, _clip: Clip | None, numbers: Floats) -> Floats:
        """(frames,) the largest moves of the skin."""
        return largest_moves(numbers, moves_at_rest(fine.blended, self.deltas)[1])

    def cut(self, _clip: Clip | None, _numbers: Floats) -> Floats:
        """(0, 2): it has no control curve."""
        return np.zeros((0, 2))

    def facts(self, _plan: MeshPlan, _up: str) -> Json:
        """Its name."""
        return {"name": self.attached.tool.name}

    def cuts(self, shortenings: Floats) -> tuple[Floats, Floats]:
        """(cuts, 0) twice: it has no control curve."""
        nothing = np.zeros((len(shortenings), 0))
        return nothing, nothing

    def facts_in(self, plan: MeshPlan, seen: Seen) -> Json:
        """Its largest move in a clip; 0 where its weights are rounding errors, or too small to be seen."""
        heights = self.heights(plan.fine, seen.motion.clip, seen.weights)
        heights[self.strengths(seen) < VISIBLE] = 0.0
        at = int(np.argmax(heights))
        return {"name": seen.motion.clip.name, "height": float(heights[at]), "time": float(seen.motion.times[at])}

    def words(self, plan: MeshPlan) -> Words:
        """Its words about itself."""
        return self.layer.words(plan, self.attached, self.deltas)


@dataclass(frozen=True, slots=True)
class BodyLayer(Layer, Generic[AttachedType]):
    """The muscles, or the regions of flesh, of a mesh.

    Attributes:
        attached: All of them at rest.
        regions: The number of the first region of each among those of the refinement.
        deltas: For each (targets, fine vertices, 3) displacements at weight 1, bind space.
    """

    attached: tuple[AttachedType, ...]
    regions: tuple[int, ...]
    deltas: tuple[Floats, ...]

    @classmethod
    def of(cls, plan: MeshPlan, numbered: Iterable[tuple[int, AttachedType]]) -> Self:
        """Let the refined surface carry them, each with the number of its first region."""
        pairs = list(numbered)
        regions, every = tuple(number for number, _ in pairs), tuple(each for _, each in pairs)
        names = plan.rig.morph_names
        columns = [[names.index(name) for name in each.drive.targets] for each in every]
        return cls(every, regions, tuple(plan.fine.morph_deltas[each] for each in columns))

    @property
    def parts(self) -> Sequence[BodyPart[AttachedType]]:
        """Each of them."""
        return [BodyPart(*each, self) for each in zip(self.attached, self.regions, self.deltas, strict=True)]

    @property
    def sampled_numbers(self) -> int:
        """Weights, as states too."""
        return sum(2 * len(each) for each in self.deltas)

    def target_sizes(self, _plan: MeshPlan, _clips: Sequence[Clip], _frames: int, _memory: Memory) -> list[int]:
        """The vertices that each target moves."""
        return [len(moved) for part in self.parts for moved in part.target_vertices]

    def effects(
        self, plan: MeshPlan, _clips: Sequence[Clip], before: Sequence[Effect], _how: SamplingOptions
    ) -> list[Effect]:
        """Make an effect of each."""
        return [*before, *(self.effect(plan, *pair) for pair in zip(self.attached, self.deltas, strict=True))]

    @abstractmethod
    def words(self, plan: MeshPlan, attached: AttachedType, deltas: Floats) -> Words:
        """The words of one of them about itself."""

    @abstractmethod
    def effect(self, plan: MeshPlan, attached: AttachedType, deltas: Floats) -> Effect:
        """The effect of one of them."""


def moves_at_rest(blended: Floats, deltas: Floats) -> tuple[Ints, Floats]:
    """Find the vertices that morph targets move, and how far.

    Args:
        blended: (vertices, 3, 4) bind to world space at rest.
        deltas: (targets, vertices, 3) displacements at weight 1, bind space.

    Returns:
        (moved,) vertices, and their (targets, moved, 3) displacements in world space.
    """
    vertices = np.flatnonzero(are_nonzero(deltas).any(axis=0))
    return vertices, np.einsum("vij,kvj->kvi", blended[vertices, :, :3], deltas[:, vertices])


def largest_moves(weights: Floats, moves: Floats) -> Floats:
    """(frames,) largest moves by (frames, targets) weights of (targets, vertices, 3) displacements.

    They are those of the vertices that each target moves most, which is about the largest of all.
    """
    most = np.argsort(-(moves**2).sum(axis=2), axis=1)[:, :_LARGEST].ravel()
    found = np.einsum("fk,kvi->fvi", weights, moves[:, most])
    return np.asarray(np.sqrt((found**2).sum(axis=2)).max(axis=1, initial=0.0))


def body_shapes(plan: MeshPlan, deltas: Floats, rows: Floats) -> list[Shape | None]:
    """The shapes of (targets, fine vertices, 3) deltas, with normals fitted at (rows, targets) weights."""
    vertices, moves = moves_at_rest(plan.fine.blended, deltas)
    pose = Pose(plan.rest.matrices, plan.rest.morph_weights)
    return make_shapes(
        plan.fine,
        vertices,
        deltas[:, vertices],
        tallest=np.sqrt(np.sum(moves**2, axis=2)).max(axis=1, initial=0.0),
        samples=[Sample(row, pose) for row in rows] if plan.has_normals else [],
    )
