"""The signal of a joint: the angle by which it is turned about an axis, from the stored pose."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.drive.stored import Json, read_numbers, stored
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, affine_rows, dot, unit_quaternions
from wrinklecli.numeric.memory import once

# Four times a sine and cosine of half an angle below which a turn has no axis: rounding of float32 rotations.
_LEAST_SINE = 1e-5
# The axis of another joint, whose turn counts as a whole.
_NO_AXIS = (0.0, 0.0, 0.0)


class Angles(NamedTuple):
    """The measurements of a joint.

    Attributes:
        rows: (frames,) radians about the axis, by which a table is looked up.
        turns: (frames, 3) the axis about which the joint is turned, as long as the sine of half of the angle about it:
            0 at rest, 1 at 180°; or (frames, 6) with that of another joint behind it.
    """

    rows: Floats
    turns: Floats

    @property
    def active(self) -> Bools:
        """(frames,) True: a joint always has an angle."""
        return np.ones(len(self.rows), np.bool_)

    @property
    def factors(self) -> float:
        """The factor on weights that are looked up."""
        return 1.0


@dataclass(frozen=True, slots=True, eq=False)
class JointAngle:
    """A joint that turns against its parent.

    Attributes:
        node: The joint.
        parent: The joint's parent; -1 for a root.
        axis: (3,) unit, in the parent's space.
        rest: (4,) the joint's stored rotation x, y, z, w, of unit length.
        other: Another joint, whose turn about any axis is measured, too.
    """

    node: int
    parent: int
    axis: Floats
    rest: Floats
    other: "JointAngle | None" = None

    @property
    def nodes(self) -> frozenset[int]:
        """The joints that are measured."""
        return (frozenset({self.node, self.parent}) - {-1}) | (self.other.nodes if self.other else frozenset())

    @classmethod
    def whole(cls, rig: Rig, node: int) -> "JointAngle":
        """The turn of a joint about any axis, as that of another's."""
        return cls(node, int(rig.parents[node]), np.array(_NO_AXIS), unit_quaternions(rig.locals[node]["rotation"]))

    def angles(self, rig: Rig, clip: Clip | None, times: Floats, known: dict[int, Floats] | None = None) -> Angles:
        """Measure the turn about the axis at (frames,) seconds of a clip, by world matrices with scale taken out.

        `known` is as in `node_rows`.
        """
        found = self._about(*self._turned(rig, clip, times, known))
        if self.other is None:
            return found
        return found._replace(turns=np.hstack([found.turns, self.other.angles(rig, clip, times, known).turns]))

    def _turned(
        self, rig: Rig, clip: Clip | None, times: Floats, known: dict[int, Floats] | None
    ) -> tuple[Floats, Floats, Floats]:
        """Measure the whole turn.

        Returns:
            (3, frames) axes, as long as 4 w times the sine of half the angle, where w is the cosine of that half;
            (frames,) 4 w²; and (frames, 3) axes as long as the sines.

        Source: quaternions (v, w) from the matrix of a rotation: its antisymmetric part gives 4 w v, and 1 + its trace
        is 4 w².
        """
        nodes = [self.node] if self.parent < 0 else [self.node, self.parent]
        rows = node_rows(rig, clip, times, nodes, known)
        matrices = np.stack([np.broadcast_to(r[:, :3], (3, 3, len(times))).transpose(2, 0, 1) for r in rows], axis=1)
        sizes = np.sqrt(np.sum(matrices**2, axis=2, keepdims=True))
        turns = matrices / np.where(sizes > 0, sizes, 1.0)
        own = turns[:, 0] if self.parent < 0 else np.einsum("fba,fbc->fac", turns[:, 1], turns[:, 0])
        rest = affine_rows(np.zeros((3, 1)), self.rest[:, None], np.ones((3, 1)))[:, :3, 0]
        turned = own @ rest.T
        sines = np.stack([turned[:, (k + 2) % 3, (k + 1) % 3] - turned[:, (k + 1) % 3, (k + 2) % 3] for k in range(3)])
        cosines = 1.0 + np.trace(turned, axis1=1, axis2=2)
        return sines, cosines, (sines / (2.0 * np.sqrt(np.maximum(cosines, _LEAST_SINE**2)))).T

    def _about(self, sines: Floats, cosines: Floats, halves: Floats) -> Angles:
        """The part of a turn about the axis.

        Source: the swing-twist decomposition of quaternions: the turn about the axis is the twist; v is along the whole
        turn's.
        """
        return Angles(np.asarray(2.0 * np.arctan2(dot(self.axis, sines), cosines)), halves)

    def to_json(self, names: Sequence[str]) -> Json:
        """The signal as extras store it, by the names of all nodes; a joint without an axis is another's."""
        return {
            "joint": names[self.node],
            **({"parent": names[self.parent]} if self.parent >= 0 else {}),
            "rest": stored(self.rest),
            **({"axis": stored(self.axis)} if self.axis.any() else {}),
            **({"other": self.other.to_json(names)} if self.other else {}),
        }


def angles_of(
    signals: Iterable[JointAngle], rig: Rig, clip: Clip | None, times: Floats, known: dict[int, Floats]
) -> Iterator[Angles]:
    """Measure several turns, as `JointAngle.angles` does, each joint that turns about several axes once."""
    turned = dict[tuple[float, ...], tuple[Floats, Floats, Floats]]()
    for each in signals:
        joint = (each.node, each.parent, *each.rest.tolist())
        yield each._about(*once(turned, joint, partial(each._turned, rig, clip, times, known)))


def read_angle(data: Json, nodes: Mapping[str, int]) -> JointAngle:
    """Read a joint's angle in extras, from nodes by name.

    Raises:
        KeyError, TypeError, ValueError: The extras are not what `bake` writes.
    """
    rest, axis = (read_numbers(data[key], size) for key, size in (("rest", 4), ("axis", 3)))
    if not rest.any():
        raise ValueError
    parent = data.get("parent")
    other = read_angle({**data["other"], "axis": _NO_AXIS}, nodes) if "other" in data else None
    return JointAngle(
        nodes[str(data["joint"])], -1 if parent is None else nodes[str(parent)], axis, unit_quaternions(rest), other
    )
