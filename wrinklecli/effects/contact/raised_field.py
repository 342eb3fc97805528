"""Fields in folds: what they raise, and the joints that fold them."""

from dataclasses import replace
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.turned import TurnDrive
from wrinklecli.effects.body import BodyPart
from wrinklecli.effects.contact.hinge import Hinge
from wrinklecli.effects.effect import Effect, MeshPlan
from wrinklecli.effects.field.attach import AttachedField
from wrinklecli.effects.field.layer import FieldLayer
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, face_normals
from wrinklecli.surface.refine import Refinement


@dataclass(frozen=True)
class RaisedField:
    """A field on the refined surface, as contact lowers it.

    Attributes:
        part: The field.
        factors: (vertices,) of its height, at the vertices that it moves.
    """

    part: BodyPart[AttachedField]
    factors: Floats

    @classmethod
    def of(cls, part: BodyPart[AttachedField]) -> "RaisedField":
        """A field in its full height."""
        return cls(part, np.ones(len(part.vertices)))

    @property
    def patch(self) -> AttachedField:
        """The field at rest."""
        return self.part.attached

    @cached_property
    def vertices(self) -> Ints:
        """(vertices,) sorted fine vertices that it moves."""
        return self.part.vertices

    @property
    def drive(self) -> TurnDrive:
        """Its weights."""
        return self.patch.drive

    @property
    def joints(self) -> list[int]:
        """The nodes that fold it."""
        return list(dict.fromkeys(signal.node for signal, _ in self.drive.turns))

    def hinge_at(self, node: int) -> Hinge:
        """The turn of one of them that goes farthest, of several about its axes."""
        turns = [(signal, table.rows) for signal, table in self.drive.turns if signal.node == node]
        signal, rows = max(turns, key=lambda turn: float(np.ptp(turn[1])))
        return Hinge(signal, float(rows.min()), float(rows.max()))

    def near(self, pivot: Floats, radius: float, fine: Refinement) -> Ints:
        """Those of its vertices that are nearest to a place at rest, within a radius if any is."""
        apart = np.sqrt(np.sum((fine.rest_positions[self.vertices] - pivot) ** 2, axis=1))
        return np.asarray(self.vertices[apart <= max(radius, float(apart.min()))])

    def times(self, factors: Floats) -> "RaisedField":
        """The field with (vertices,) further factors of its height."""
        return replace(self, factors=self.factors * factors)

    def displacements(self, rig: Rig, clip: Clip | None, times: Floats, there: Ints) -> Floats:
        """(frames, chosen, 3) displacements of some of its vertices at (frames,) seconds, bind space."""
        deltas = self.part.deltas[:, self.vertices[there]] * self.factors[there, None]
        return np.asarray(np.tensordot(self.drive.weights_in(rig, clip)(times), deltas, axes=1))

    @property
    def ratio(self) -> float:
        """What is left of its height, in the mean."""
        sizes = np.sqrt(np.sum(self.part.deltas[:, self.vertices] ** 2, axis=2)).sum(axis=0)
        return float(sizes @ self.factors / sizes.sum())

    def effect(self, plan: MeshPlan) -> Effect:
        """The effect of the field as it is now."""
        factors = np.ones(len(plan.fine.positions))
        factors[self.vertices] = self.factors
        layer = self.part.layer
        assert isinstance(layer, FieldLayer)
        return layer.lowered(plan, self.patch, factors)


def bent_radius(node: int, pivot: Floats, fine: Refinement, rig: Rig) -> float:
    """The mean distance from a joint, at rest, of the triangles that it bends, by their areas and by how much."""
    surface = fine.surface
    corners = fine.rest_positions[surface.triangles]
    below = rig.joints_below[int(np.flatnonzero(rig.joints == node)[0])]
    carried = np.sum(surface.weights * below[surface.joints], axis=1)
    areas = np.linalg.norm(face_normals(fine.rest_positions, surface.triangles), axis=1)
    apart = np.sqrt(np.sum((corners.mean(axis=1) - pivot) ** 2, axis=1))
    return float(np.average(apart, weights=areas * np.ptp(carried[surface.triangles], axis=1)))
