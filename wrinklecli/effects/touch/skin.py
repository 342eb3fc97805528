"""The skin round a touch: how firmly each place is held, where it is from the pad, and how far it slides.

The slide is that of a membrane that is tethered to what is below (`numeric.membrane`). The load is a smooth pad: one
with a hard edge would turn triangles over. Skin over a bone near the surface is held more, and so is skin that curves,
as a straight slide would leave it there: else a slide on the back of a hand would reach its palm.
"""

from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, components, renumbered, unit
from wrinklecli.numeric.edges import numbered_edges
from wrinklecli.numeric.laplacian import vertex_areas
from wrinklecli.numeric.membrane import Membrane
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.bones import BoneLines, bone_distances
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.refine import Refinement

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

FADED = 4.0
"""Lengths of decay beyond the pad at which the skin is held: of the slide, less than 1/50 would be left there."""

# Width of the load over the pad's radius: that of a Gaussian whose flank is as steep as a fingertip's.
_PAD = 0.8
# Width of the blur of normals over the pad's radius.
_SMOOTH = 0.5
# Bounds of the factor by which bones tether: skin far from bones has the reach that is asked for, and a bone at the
# surface does not hold the skin for good.
_BONES = (1.0, 16.0)
# Tether of skin that bends by 1 radian over the reach, over that of flat skin: a slide along a tangent leaves a surface
# by half its square over the radius. With 4, the slide fades over less than half of the radius there.
_CURVED = 4.0
# Tether of skin that joints beyond the place carry, as fingers and thumb beyond a hand's back, over that of other skin:
# they take their skin along, wherever they turn. Without it, the slide on a hand whose fingers close by 20° (its thumb
# by 8°) is 3.4 % off one that is solved there; with 4, 6, 8 and 16 it is 2.1, 1.9, 1.8 and 1.4, and the strain there is
# -0.46, -0.47, -0.48 and -0.52 for -0.43.
_CARRIED = 6.0
# Part of the place that a joint carries at most if it is beyond it.
_BEYOND = 0.1
# Least part by which skin that faces away is held: behind a limb, tethers are 400 times as strong.
_LEAST_FACING = 0.05
# Vertices near the end of a slide by which the surface is found there.
_NEIGHBOURS = 8
# Directions of the greatest slides to which the four ways are fitted: on a real hand slides of up to 10 mm are at most
# 0.48 mm off at 99 %. Fitted to 8 directions, and to slides of half the length as well, they were 0.55.
_FITTED_DIRECTIONS = 16
# Least factor of a mask below which skin does not move.
_LEAST_SOFT = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """The place of a touch on a body at rest, world space.

    Attributes:
        at: (3,) its middle, on the skin.
        axes: (3, 3) unit vectors: forward, sideways, and the skin's normal.
        pad: Radius of the tip, scene units.
        reach: Length over which the slide decays, scene units.
    """

    at: Floats
    axes: Floats
    pad: float
    reach: float

    def polar(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) distances from the middle, and (…,) angles from forward towards sideways, of (…, 3) positions."""
        relative = positions - self.at
        forward, sideways = relative @ self.axes[0], relative @ self.axes[1]
        return np.sqrt(np.sum(relative**2, axis=-1)), np.arctan2(sideways, forward)

    def load(self, positions: Floats) -> Floats:
        """(…,) force of the pad per area at (…, 3) positions, 1 in its middle."""
        distances, _ = self.polar(positions)
        return np.exp(-0.5 * (distances / (_PAD * self.pad)) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class Hold:
    """The hold on the coarse skin of a body.

    Attributes:
        tethers: (vertices,) as a `Membrane` has them.
        still: (vertices,) 1 for those that do not move, else 0.
        normals: (vertices, 3) unit normals of the planes in which they slide, world space at rest.
    """

    tethers: Floats
    still: Floats
    normals: Floats


def hold_of(ground: Ground, place: Place, soft: Floats | None, still: Floats | None = None) -> Hold:
    """Find how the coarse skin is held.

    Args:
        ground: The mesh at rest, or in another pose.
        place: The place of the touch.
        soft: (vertices,) factors from 0 to 1 of a mask; None without one.
        still: (vertices,) as found at rest, for another pose; None at rest.
    """
    rest = ground.rest
    positions, triangles = rest.positions, rest.triangles
    starts, ends = (
        np.concatenate([triangles, triangles[:, ::-1]]).reshape(-1),
        np.roll(np.concatenate([triangles, triangles[:, ::-1]]), -1, axis=1).reshape(-1),
    )
    ways, turns = positions[ends] - positions[starts], rest.normals[ends] - rest.normals[starts]
    lengths = np.sum(ways**2, axis=1)
    bends = (np.sum(ways * turns, axis=1) / np.where(lengths > 0, lengths, 1.0)) ** 2
    counts = np.bincount(starts, minlength=len(positions))
    curved = np.bincount(starts, bends, len(positions)) / np.maximum(counts, 1)
    tethers = (1.0 + _CURVED * place.reach**2 * curved) / place.reach**2
    tethers *= 1.0 + _CARRIED * _carried_beyond(ground, place)
    tethers /= np.maximum((1.0 + rest.normals @ place.axes[2]) / 2.0, _LEAST_FACING) ** 2
    bones = BoneLines.of(ground) if ground.rig.skinned else None
    if bones is not None and len(bones.nodes):
        segments = np.stack([bones.starts, bones.ends], axis=1)
        depths = bone_distances(positions, segments)
        (own,) = bone_distances(place.at[None], segments)
        tethers *= np.clip((own / np.maximum(depths, 1e-12)) ** 2, *_BONES)
    held = _still(ground, place, soft) if still is None else still > 0
    if soft is not None:
        tethers /= np.maximum(soft, _LEAST_SOFT) ** 2
    return Hold(tethers, held.astype(np.float64), _smooth_normals(positions, triangles, rest.normals, ~held, place))


def _carried_beyond(ground: Ground, place: Place) -> Floats:
    """(vertices,) part of the skin that joints beyond the place carry: those below the one that carries it most."""
    surface, rest, count = ground.surface, ground.rest, len(ground.rig.joints)
    if not ground.rig.skinned:
        return np.zeros(len(surface.positions))
    triangle, corners, _ = rest.closest_point(place.at)
    own = corners @ surface.dense_weights(rest.triangles[triangle], count)
    below = ground.rig.joints_below
    beyond = np.flatnonzero(below[int(np.argmax(own))] & (below @ own < _BEYOND))
    return np.asarray(surface.dense_weights(np.arange(len(surface.positions)), count)[:, beyond].sum(axis=1))


def _still(ground: Ground, place: Place, soft: Floats | None) -> Bools:
    """(vertices,) True for those that do not move: of other meshes, materials, limbs, and hard ones of a mask."""
    rest, surface = ground.rest, ground.surface
    triangles = rest.triangles
    still = ground.contacts.held.copy()
    looks = ground.looks[surface.primitives]
    triangle, _, _ = rest.closest_point(place.at)
    other = looks != looks[triangle]
    still[triangles[other]] = True
    still |= ~_joined(rest.positions, triangles[~other], int(triangles[triangle][0]), place)
    if soft is not None:
        still |= soft < _LEAST_SOFT
    return still


def _smooth_normals(positions: Floats, triangles: Ints, normals: Floats, moving: Bools, place: Place) -> Floats:
    """(vertices, 3) unit normals, those of (moving) vertices blurred over a part of the pad."""
    chosen = np.flatnonzero(moving)
    masses = vertex_areas(positions, triangles)[chosen]
    own, places = normals[chosen], positions[chosen]
    found = normals.copy()
    for part in portions(len(chosen), len(chosen)):
        squares = np.sum((places[part, None] - places) ** 2, axis=2)
        # Skin that faces away, as that of the next finger, does not count.
        weights = np.exp(-0.5 * squares / (_SMOOTH * place.pad) ** 2) * np.maximum(own[part] @ own.T, 0.0)
        found[chosen[part]] = unit((weights * masses) @ own)
    return found


def _joined(positions: Floats, triangles: Ints, seed: int, place: Place) -> Bools:
    """(vertices,) True for those that the mesh joins with the place, within the slide's reach."""
    distances, _ = place.polar(positions)
    near = distances < place.pad + FADED * place.reach
    near[seed] = True
    edges, _ = numbered_edges(triangles)
    labels = components(edges[near[edges].all(axis=1)], len(near))
    return np.asarray(near & (labels == labels[seed]))


def slides_of(place: Place, positions: Floats, triangles: Ints, hold: Hold) -> Floats:
    """(2, vertices, 3) slides forward and sideways whose mean under the pad is 1, world space at rest.

    Args:
        place: The place of the touch.
        positions: (vertices, 3) of the skin.
        triangles: (triangles, 3).
        hold: How each of these vertices is held.
    """
    moving = hold.still < 1.0
    faces = np.flatnonzero(moving[triangles].any(axis=1))
    used, corners = renumbered(triangles[faces])
    found = np.zeros((2, *positions.shape))
    if not len(used):
        return found
    outward = hold.normals[used]
    forward = place.axes[0] - (outward @ place.axes[0])[:, None] * outward
    flat = np.sqrt(np.sum(forward**2, axis=1)) < 1e-6
    forward[flat] = np.cross(outward[flat], place.axes[1])
    forward = unit(forward)
    sideways = np.cross(outward, forward)
    axes = np.stack([forward, sideways])
    load = place.load(positions[used]) * np.clip(outward @ place.axes[2], 0.0, 1.0)
    membrane = Membrane(positions[used], corners, axes, hold.tethers[used], ~moving[used])
    tangential = place.axes[:2, None] - (place.axes[:2] @ outward.T)[..., None] * outward
    slides = membrane.slides(load[:, None] * tangential)
    masses = vertex_areas(positions[used], corners)
    weights = masses * np.where(place.polar(positions[used])[0] < place.pad, 1.0, 0.0)
    if not weights.any():
        weights = masses * load
    for slide, axis, into in zip(slides, place.axes, found, strict=False):
        mean = float(weights @ (slide @ axis)) / float(weights.sum())
        into[used] = slide / mean if mean > 0 else 0.0
    return found


def slides_on(fine: Refinement, positions: Floats, place: Place, hold: Hold) -> Floats:
    """(2, fine vertices, 3) slides on the refined skin at (fine vertices, 3) positions, as `slides_of`."""
    spread = fine.subdivision.interpolate(np.column_stack([hold.tethers, hold.still, hold.normals]))
    return slides_of(place, positions, fine.triangles, Hold(spread[:, 0], spread[:, 1], unit(spread[:, 2:])))


def slides_on_surface(positions: Floats, normals: Floats, slides: Floats) -> Floats:
    """(4, vertices, 3) moves forward, sideways, back and to the other side, whose sums stay near the surface.

    A slide along a tangent leaves a surface of radius R by half its square over R, but moves add up linearly: a move
    that ends on the surface is too low at a half of it, and beside another one. So each gets the part along the normals
    that fits the greatest slides of all directions best, by least squares.

    Args:
        positions: (vertices, 3) of the skin.
        normals: (vertices, 3) unit vectors.
        slides: (2, vertices, 3) greatest slides forward and sideways, along the skin's tangents.
    """
    from scipy.spatial import cKDTree

    angles = np.arange(_FITTED_DIRECTIONS) * (2.0 * np.pi / _FITTED_DIRECTIONS)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    fit = np.linalg.pinv(np.maximum(np.concatenate([ways, -ways], axis=1), 0.0))
    tree = cKDTree(positions)
    moving = np.flatnonzero(np.any(slides, axis=(0, 2)))
    moves = np.concatenate([slides, -slides])
    still = _way_back(tree, positions, normals, moving, np.zeros(3))
    for way, shares in zip(ways, fit.T, strict=True):
        back = _way_back(tree, positions, normals, moving, np.tensordot(way, slides[:, moving], axes=1))
        moves[:, moving] += shares[:, None, None] * (back - still)
    return moves


def _way_back(tree: "cKDTree", positions: Floats, normals: Floats, moving: Ints, slide: Floats) -> Floats:
    """(moving, 3) ways back to the surface from the ends of a (moving, 3) slide of the (moving,) vertices.

    The tangent planes of the (vertices, 3) positions near each end say where the surface is there, if what they say
    without a slide is taken off: where vertices are sparse, these planes lie beside the surface.
    """
    ends = positions[moving] + slide
    distances, near = (np.asarray(each) for each in tree.query(ends, k=min(_NEIGHBOURS, len(positions))))
    weights = np.exp(-((distances / np.maximum(np.median(distances, axis=1, keepdims=True), 1e-12)) ** 2))
    # Skin on the other side, or of the next finger, does not count.
    weights *= np.maximum(np.einsum("vkx,vx->vk", normals[near], normals[moving]), 0.0) + 1e-9
    weights /= weights.sum(axis=1, keepdims=True)
    outward = unit(np.einsum("vk,vkx->vx", weights, normals[near]))
    above = np.einsum("vk,vkx,vkx->v", weights, ends[:, None] - positions[near], normals[near])
    return np.asarray(-above[:, None] * outward)


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """The triangles of refined skin that may move.

    A bake refines the skin of a touch twice: for the touch alone, and together with all other effects. Most patches are
    the same both times, and what was fitted once holds.

    Attributes:
        vertices: (vertices,) sorted fine vertices.
        corners: (triangles, 3) numbers among these.
        positions: (vertices, 3) bind space.
        blended: (vertices, 3, 4) bind to world space at rest.
    """

    vertices: Ints
    corners: Ints
    positions: Floats
    blended: Floats

    @classmethod
    def of(cls, fine: Refinement, hold: Hold) -> "Patch":
        """The patch of refined skin whose coarse vertices are held."""
        moving = fine.subdivision.interpolate(hold.still[:, None])[:, 0] < 1.0
        vertices, corners = renumbered(fine.triangles[moving[fine.triangles].any(axis=1)])
        return cls(vertices, corners, fine.positions[vertices], fine.blended_at(fine.rest, vertices))

    def equals(self, other: "Patch") -> bool:
        """True if both are refined alike, whatever the numbers of their vertices."""
        return (
            np.array_equal(self.corners, other.corners)
            and np.array_equal(self.positions, other.positions)
            and np.array_equal(self.blended, other.blended)
        )

    def spread(self, values: Floats, count: int) -> Floats:
        """(…, count, 3) values of the first vertices from (…, vertices, 3) ones of the patch; 0 beside it."""
        found = np.zeros((*values.shape[:-2], count, 3))
        within = self.vertices < count
        found[..., self.vertices[within], :] = values[..., within, :]
        return found


NO_PATCH = Patch(np.zeros(0, np.intp), np.zeros((0, 3), np.intp), np.zeros((0, 3)), np.zeros((0, 3, 4)))
"""The patch of skin on which nothing is fitted yet."""
