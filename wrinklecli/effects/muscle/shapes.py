"""The shape of a belly under the skin: a spindle along its segment that fades round the limb.

The skin moves along its normal by the thickness that the belly gains, times a spindle along the segment, times a bell
round the bone. Both fall to 0 smoothly, whatever the skin weights of the joints are: masks by these weights would make
lumps at a joint's border. Skin that faces the bone, as an armpit or a groin does, stays where it is, and so does skin
that is much farther from the bone than the skin above the belly, as that of other limbs. No vertex moves by more than a
part of the way to skin that it faces.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from wrinklecli.effects.muscle.volume import FULLEST, ConstantVolume, flexed
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, bounded, interpolated, inverses, ramp, singular, smoothstep, unit
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.region import FACING

# Distances from the bone, over that of the skin above the belly, beyond which nothing and up to which all moves: limbs
# are rarely oval beyond 1.4, and what touches a limb lies behind its skin.
_NEAR = (2.2, 1.5)
# Greatest angle round the bone to which the skin follows, radians: 150°, as the other side of a limb has its own
# muscles.
_MOST_ANGLE = np.radians(150.0)
# Part of the way to opposite skin that a vertex may move: both sides may have a muscle.
_OF_GAP = 0.45
# Least cosine of a vertex's normal and the way to skin that it may run into, 45°, and greatest of both normals, 120°.
_AHEAD, _OPPOSITE = 0.7, -0.5
# How deep the furrow to the neighbour is: round the limb, the bell is times 1 - this · the square of the angle. The
# furrow is 8 % of the bulge then; without one, a bulge fades into the limb, and none is seen.
_FURROW = 2.5
# Power of the place along the belly: its crest lies at 0.42 of its length, as a biceps or a calf is fullest near its
# origin.
_HEAVY = 0.8
# Shapes of a belly that travels: between three, its skin is 5 % of the bulge beside that of a spindle. And thicknesses
# at which the greatest weight of each is looked for.
_SHAPES, _MOMENTS = 3, 129
# A vertex whose height is below this ratio of the greatest stays still: nobody would see it.
_LEAST = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Belly:
    """The place and size of a muscle at rest, world space and scene units.

    Attributes:
        origin, insertion: (3,) its ends.
        tendons: Length of both tendons together, of which each end has a half.
        thickness: Of the belly in its middle.
        width: Along the skin, over which the skin follows.
        depth: Distance from the bone to the skin above the belly.
        foot: (3,) the point of the bone beneath the middle.
        axis: (3,) unit vector along the bone.
        side: (3,) unit vector from the bone to the belly.
    """

    origin: Floats
    insertion: Floats
    tendons: float
    thickness: float
    width: float
    depth: float
    foot: Floats
    axis: Floats
    side: Floats

    @property
    def span(self) -> float:
        """The distance of the ends."""
        return float(np.linalg.norm(self.insertion - self.origin))

    @property
    def widest(self) -> float:
        """The angle round the bone, from the middle of the belly, to which the skin follows, radians."""
        return float(min(self.width / (2.0 * self.depth), _MOST_ANGLE))

    def along(self, places: Floats) -> Floats:
        """(…,) distances of (…, 3) places from the origin along the muscle, scene units."""
        return (places - self.origin) @ unit(self.insertion - self.origin)

    def round(self, places: Floats, normals: Floats) -> Floats:
        """(…,) factors of the height round the bone, at (…, 3) places of the skin with (…, 3) unit normals."""
        relative = places - self.foot
        outward = relative - (relative @ self.axis)[..., None] * self.axis
        distances = np.linalg.norm(outward, axis=-1)
        outward = unit(outward)
        angles = np.arccos(np.clip(outward @ self.side, -1.0, 1.0))
        facing = smoothstep(ramp(np.sum(outward * normals, axis=-1), *FACING))
        close = smoothstep(ramp(distances / self.depth, *_NEAR))
        return bell(angles / self.widest) * facing * close


def bell(aside: Floats) -> Floats:
    """(…,) the height over that above the middle, at (…,) angles over the greatest to which the skin follows.

    It is below 0 in a furrow on either side.
    """
    squares = aside**2
    return np.asarray(np.maximum(1.0 - squares, 0.0) ** 2 * (1.0 - _FURROW * squares))


def spindle(along: Floats, start: float, length: float) -> Floats:
    """(…,) the thickness of a belly over its greatest, at (…,) distances along a muscle; 0 on its tendons."""
    shares = np.clip((along - start) / length, 0.0, 1.0)
    return np.asarray(np.sin(np.pi * shares**_HEAVY) ** 2)


def travelling(*, activated: bool) -> tuple[Floats, Floats, Floats]:
    """The shapes of a belly that travels, between which its skin moves straight, each with weights up to 1.

    Args:
        activated: True if the muscle may also be thicker than the distance of its ends makes it.

    Returns:
        (knots,) thicknesses over that at rest, that the distance of the ends gives; (knots,) thicknesses gained by each
        shape at weight 1; and (knots, knots) weights there, each of its own shape.
    """
    knots = np.linspace(1.0, FULLEST, _SHAPES)
    moments = np.linspace(1.0, FULLEST, _MOMENTS)
    gains = (flexed(moments) if activated else moments) - 1.0
    return knots, (gains[:, None] * interpolated(moments, knots, np.eye(_SHAPES))).max(axis=0), np.eye(_SHAPES)


def heights_along(belly: Belly, knots: Floats, gains: Floats, along: Floats) -> Floats:
    """(knots, places) heights of the skin above the middle of a belly, at (places,) distances from its origin.

    What a belly gains lies above it. A belly that travels is as near to its origin as at rest, and gets shorter there.

    Args:
        belly: The muscle at rest.
        knots: (knots,) thicknesses over that at rest that its length has; 1 for a belly that does not travel.
        gains: (knots,) thicknesses gained.
        along: (places,) scene units.
    """
    start, length = belly.tendons / 2.0, belly.span - belly.tendons
    profiles = [spindle(along, start, each) for each in (length / knots**2).tolist()]
    return belly.thickness * (gains[:, None] * np.reshape(profiles, (len(gains), len(along))))


class Skin(NamedTuple):
    """A surface at rest, coarse or refined.

    Attributes:
        positions: (vertices, 3) world space.
        blended: (vertices, 3, 4) bind to world space.
        normals_at: Gives (chosen, 3) unit normals of (chosen,) vertices, world space.
    """

    positions: Floats
    blended: Floats
    normals_at: Callable[[Ints], Floats]


def displaced(belly: Belly, response: ConstantVolume, skin: Skin) -> tuple[Floats, Floats]:
    """Displace the skin above a belly.

    Args:
        belly: The muscle at rest.
        response: The weights of its targets.
        skin: The coarse or the refined skin.

    Returns:
        (targets, vertices, 3) displacements in bind space, and (vertices,) the greatest heights, scene units.
    """
    along = belly.along(skin.positions)
    vertices = np.flatnonzero((along > belly.tendons / 2.0) & (along < belly.span - belly.tendons / 2.0))
    normals = skin.normals_at(vertices)
    mix = response.mix
    heights = heights_along(belly, response.knots, response.gains, along[vertices])
    heights *= belly.round(skin.positions[vertices], normals)
    greatest = np.abs(heights).max(axis=0, initial=0.0)
    seen = (greatest > _LEAST * greatest.max(initial=0.0)) & ~singular(skin.blended[vertices][:, :, :3])
    vertices, normals, heights = vertices[seen], normals[seen], heights[:, seen]
    heights *= _allowed(skin, vertices, normals, heights)
    deltas, greatest = np.zeros((mix.shape[1], len(skin.positions), 3)), np.zeros(len(skin.positions))
    inward = inverses(skin.blended[vertices][:, :, :3])
    # Each target stands alone at one of the knots.
    parts = mix.T @ heights
    deltas[:, vertices] = np.einsum("vij,vj,kv->kvi", inward, normals, parts)
    greatest[vertices] = np.abs(heights).max(axis=0)
    return deltas, greatest


def _allowed(skin: Skin, vertices: Ints, normals: Floats, heights: Floats) -> Floats:
    """(vertices,) factors that keep (targets, vertices) heights clear of skin that the vertices face at rest."""
    greatest = np.abs(heights).max(axis=0, initial=0.0)
    reach = float(greatest.max(initial=0.0)) / _OF_GAP
    if not reach:
        return np.ones(len(vertices))
    places = skin.positions[vertices]
    low, high = places.min(axis=0) - reach, places.max(axis=0) + reach
    near = np.flatnonzero(((skin.positions > low) & (skin.positions < high)).all(axis=1))
    others, facing = skin.positions[near], skin.normals_at(near)
    gaps = np.full(len(vertices), np.inf)
    for part in portions(len(vertices), len(near)):
        own, here = normals[part], places[part]
        ahead = own @ others.T - np.sum(own * here, axis=1)[:, None]
        squares = np.sum(here**2, axis=1)[:, None] - 2.0 * here @ others.T + np.sum(others**2, axis=1)
        # Skin opposite: within reach, in front of the vertex, and facing it.
        opposite = (squares < reach**2) & (ahead > _AHEAD * np.sqrt(np.maximum(squares, 0.0)))
        opposite &= own @ facing.T < _OPPOSITE
        gaps[part] = np.where(opposite & (ahead > 0), ahead, np.inf).min(axis=1, initial=np.inf)
    return bounded(greatest / (_OF_GAP * gaps))
