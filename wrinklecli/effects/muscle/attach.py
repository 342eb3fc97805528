"""Muscles attached to a rig: their ends on bones, the bone beneath the belly, and the skin above it.

Source: C. Larboulette, M.-P. Cani, B. Arnaldi, *Dynamic Skinning*, SCCG 2005.
"""

from collections.abc import Container
from dataclasses import replace
from typing import ClassVar

import numpy as np

from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.segment import RestLength, Segment, Tension
from wrinklecli.effects.attached import Attached, Moves
from wrinklecli.effects.muscle.shapes import Belly, Skin, bell, displaced, spindle, travelling
from wrinklecli.effects.muscle.volume import ACTIVATION, FULLEST, SHORTEST, ConstantVolume
from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, unit
from wrinklecli.surface.anchor import LEAST_SPAN
from wrinklecli.surface.bones import BoneLines, carried_by
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.path import Straight
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.region import Region
from wrinklecli.surface.rest import Rest, asked_positions, named_node
from wrinklecli.tools.body import THICKNESS, ActivationKeys, ActivationMorph, Muscle
from wrinklecli.tools.records import Marker

# Width over which the skin follows, over the same distance: an upper arm is about as wide.
_WIDTH = 2.4
# Distance of a muscle's middle from its bone, over the muscle's length, below which it bulges to no side.
_LEAST_SIDE = 0.01
# Distance of a muscle's middle from its bone, over that of the skin, above which it is no part of the limb.
_FARTHEST = 1.5

# Equal intervals along the belly, and round it, with two edges each by default: straight edges then miss the bulge by
# (1/8)² / 8 · 2π², which is 4 % of its height, and a limb gets about 20 edges round.
_INTERVALS = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Bulge(Region):
    """The skin above a belly, with u along the muscle or round the limb.

    Attributes:
        belly: The muscle.
        greatest_height: Of the displacement, scene units.
        members: (members,) sorted coarse triangles.
        pose: The surface at rest.
        turned: True if u runs round the limb.
    """

    belly: Belly
    greatest_height: float
    members: Ints
    pose: Rest
    turned: bool = False

    intervals: ClassVar[float] = _INTERVALS

    @property
    def span(self) -> float:
        """The belly's length, or the width over which the skin follows."""
        return self._width if self.turned else self._length

    @property
    def half_width(self) -> float:
        """Half the belly's length, or half the width over which the skin follows."""
        return (self._length if self.turned else self._width) / 2.0

    @property
    def path(self) -> Straight:
        """The line above the muscle, or across it, that touches the skin in the middle."""
        belly = self.belly
        along = np.cross(belly.axis, belly.side) if self.turned else unit(belly.insertion - belly.origin)
        middle, normal = belly.foot + belly.depth * belly.side, unit(belly.side - (belly.side @ along) * along)
        return Straight(middle - 0.5 * self.span * along, along, normal, self.span)

    @property
    def _length(self) -> float:
        return self.belly.span - self.belly.tendons

    @property
    def _width(self) -> float:
        return 2.0 * self.belly.widest * self.belly.depth

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) u from 0 to 1 and v from -1 to 1 of (…, 3) world positions at rest."""
        belly = self.belly
        along = (belly.along(positions) - belly.tendons / 2.0) / (belly.span - belly.tendons)
        relative = positions - belly.foot
        aside = np.arctan2(relative @ np.cross(belly.axis, belly.side), relative @ belly.side) / belly.widest
        return ((aside + 1.0) / 2.0, 2.0 * along - 1.0) if self.turned else (along, aside)

    def cosines(self, u: Floats, _normals: Floats) -> Floats:
        """(…,) ones: the other side of the limb is farther round than the skin follows."""
        return np.ones(np.shape(u))

    def share(self, u: Floats, v: Floats, _cosines: Floats) -> Floats:
        """(…,) fractions of the displacement along the muscle and round the limb."""
        along, aside = ((v + 1.0) / 2.0, 2.0 * u - 1.0) if self.turned else (u, v)
        return np.abs(spindle(along, 0.0, 1.0) * bell(aside))


def bulges_on(ground: Ground, belly: Belly, heights: Floats) -> tuple[Bulge, Bulge]:
    """The skin above a belly, whose vertices move by (vertices,) heights at most, once along it and once round it."""
    members = ground.rest.around.faces_of(np.flatnonzero(heights))
    bulge = Bulge(belly, float(np.abs(heights).max()), members, ground.rest)
    return bulge, replace(bulge, turned=True)


@dataclass(frozen=True, slots=True, eq=False)
class AttachedMuscle(Attached[Muscle]):
    """A muscle on a mesh at rest.

    Attributes:
        tool: The muscle of the tools file.
        belly: Its place and size.
        bones: The nodes that carry its ends, origin first.
        bone: The node whose bone the belly lies along.
        response: Weights by its length.
        drive: These as a table, for its targets.
        deltas: (targets, vertices, 3) displacements of the coarse surface at weight 1, bind space.
        heights: (vertices,) greatest displacements of the coarse surface, scene units.
        regions: The skin that is refined, once along the muscle and once round the limb.
        covers: Names of other meshes that lie over the muscle, so near that it reaches them, and have no muscles.
    """

    tool: Muscle
    belly: Belly
    bones: tuple[int, int]
    bone: int
    response: ConstantVolume
    drive: Drive
    deltas: Floats
    heights: Floats
    regions: tuple[Bulge, Bulge]
    covers: tuple[str, ...]

    @property
    def idle(self) -> bool:
        """True if nothing ever changes its length: one bone carries both ends, and it has no activation."""
        return self.bones[0] == self.bones[1] and self.tool.activation is None

    @property
    def span(self) -> float:
        """The muscle's length."""
        return self.belly.span

    @property
    def keyed_clips(self) -> frozenset[str]:
        """The clips that key its activation."""
        return frozenset(clip for clip, _ in self.tool.named_clips)

    @property
    def full(self) -> float:
        """The shortening from which on its fibres get no thicker."""
        response = self.response
        return 1.0 - (response.tendons + SHORTEST * response.belly) / response.rest_length

    @property
    def greatest_height(self) -> float:
        """The largest move of the skin, scene units."""
        return float(np.abs(self.heights).max())

    @property
    def moves(self) -> Moves:
        """Its targets, for the effects after it."""
        return Moves(self.drive, self.deltas, self._refined)

    @property
    def segment(self) -> Segment:
        """From its origin to its insertion."""
        assert isinstance(self.drive.signal, Segment)
        return self.drive.signal

    def _refined(self, fine: Refinement) -> Floats:
        """(targets, vertices, 3) displacements of the refined surface at weight 1, bind space."""
        skin = Skin(fine.rest_positions, fine.blended, fine.rest_normals_at)
        return _with_lows(displaced(self.belly, self.response, skin)[0], self.response.lows)


def attach_muscle(muscle: Muscle, ground: Ground, bones: BoneLines, swelling: Container[str | None]) -> AttachedMuscle:
    """Attach a muscle to a mesh.

    Args:
        muscle: It.
        ground: The mesh.
        bones: Those of the mesh.
        swelling: The nodes of the file that have muscles: clothes among them swell with the skin below.

    Raises:
        WrinkleError: It does not fit.
    """
    rig, rest = ground.rig, ground.rest
    places = asked_positions(rig, rest, muscle)
    span = float(np.linalg.norm(places[1] - places[0]))
    if span <= LEAST_SPAN * ground.surface.size:
        raise BakeError("origin and insertion are one point", where=muscle.where)
    tendons = muscle.tendon.resolve(span)
    if tendons >= span:
        raise BakeError(
            f"its tendons are {tendons:.4g} long together, and the whole muscle is {span:.4g}: nothing is left to"
            " shorten",
            where=muscle.place("tendon"),
        )
    ends = _carrying_node(muscle, 0, places[0], rig, bones), _carrying_node(muscle, 1, places[1], rig, bones)
    found = bones.side_of(ground, places.mean(axis=0), places[1] - places[0])
    bone, depth = rig.names[found.node], found.depth
    if found.apart < _LEAST_SIDE * span:
        raise BakeError(
            f"its middle lies in the bone of {bone!r}, so it bulges to no side; move its ends to the side of the limb"
            " on which it lies",
            where=muscle.where,
        )
    if depth > span or found.apart > _FARTHEST * depth:
        skin = f"skin is {depth:.4g} from" if depth < np.inf else "no skin lies on that side of"
        raise BakeError(
            f"there is no skin near it: its middle is {found.apart:.4g} from the bone of {bone!r}, and {skin} that"
            " bone",
            where=muscle.where,
        )
    room = found.room(ground)
    thickness = _resolved(muscle.thickness, THICKNESS * room, room)
    if thickness > 2.0 * depth:
        raise BakeError(
            f"is {thickness:.4g} thick, where bone and skin are {depth:.4g} apart; at most twice that fits",
            where=muscle.place("thickness"),
        )
    belly = Belly(
        origin=places[0],
        insertion=places[1],
        tendons=tendons,
        thickness=thickness,
        width=_resolved(muscle.width, _WIDTH * depth, span),
        depth=depth,
        foot=found.foot,
        axis=found.axis,
        side=found.side,
    )
    modes = np.ones(1), np.array([FULLEST - 1.0]), np.ones((1, 1))
    if muscle.travel:
        modes = travelling(activated=muscle.activation is not None)
    response = ConstantVolume(span, tendons, *modes)
    deltas, heights = displaced(belly, response, Skin(rest.positions, rest.blended, rest.normals_at))
    if not heights.any():
        raise BakeError("no vertex lies above it", where=muscle.where)
    segment = Segment(
        tuple(carried_by(ground, node, place) for node, place in zip(ends, places, strict=True)),
        RestLength(span),
        _tension(muscle, ACTIVATION * response.belly, rig),
    )
    deltas = _with_lows(deltas, response.lows)
    drive = Drive(muscle.name, segment, muscle.target_names(len(deltas)), response.table(), lows=response.lows)
    regions = bulges_on(ground, belly, heights)
    covers = tuple(name for name in ground.meshes_over(np.maximum(heights, 0.0)) if name not in swelling)
    return AttachedMuscle(muscle, belly, ends, found.node, response, drive, deltas, heights, regions, covers)


def _with_lows(deltas: Floats, lows: Floats) -> Floats:
    """(targets, vertices, 3) displacements, with those of the further targets of `lows`."""
    return np.concatenate([deltas, -lows[lows > 0, None, None] * deltas[lows > 0]])


def _resolved(wanted: object, usual: float, whole: float) -> float:
    """A length of the tools file, scene units, where per cents are of the `whole`; `usual` if it is auto."""
    return usual if wanted == "auto" else wanted.resolve(whole)  # type: ignore[attr-defined]


def _carrying_node(muscle: Muscle, number: int, place: Floats, rig: Rig, bones: BoneLines) -> int:
    """The node that carries an end of a muscle: the one that it names or hangs on, or the nearest bone's joint."""
    point, joints = muscle.points[number], set(rig.joints.tolist())
    if isinstance(point, tuple):
        return bones.nodes[bones.nearest(place)]
    node = named_node(rig, muscle, number)
    if isinstance(point, Marker) and node not in joints:
        node = rig.next_above(node, joints)
    return node if node >= 0 else bones.nodes[bones.nearest(place)]


def _tension(muscle: Muscle, length: float, rig: Rig) -> Tension | None:
    """The activation of a muscle; None for one that its length alone thickens.

    Raises:
        BakeError: The mesh has no such morph target.
    """
    wanted = muscle.activation
    if isinstance(wanted, ActivationKeys):
        return Tension(length, {clip: np.array(keys, np.float64) for clip, keys in wanted.keys.items()})
    if isinstance(wanted, ActivationMorph):
        number = rig.own.morph_number(wanted.morph, where=muscle.place("activation", "morph"))
        return Tension(length, morph=number)
    return None
