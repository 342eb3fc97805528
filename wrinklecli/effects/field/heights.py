"""Heights of wrinkles in poses: as much as keeps the length of the surface, and no more than has room there.

A surface that is shortened to 1 − ε along a direction keeps its length in sine waves of rest length λ and half height
A = λ/π √(ε (1 − ε)), to second order in ε. They are greatest at ε = ½, so no other limit of strain is needed.

A crest that runs round a limb has to stretch as it rises. Flat facets do not: a thin tube that is shortened folds into
diamonds. Their length round the limb is that of facets which sink as far as folds are high, so the crests between them
run aslant to either side, the more the more the limb is curved. On what is flat they run straight across. Where a limb
is compressed aslant, one side is nearer to a ring than the other, and that which has to stretch less leads.

Source: Y. Yoshimura, *On the Mechanism of Buckling of a Circular Cylindrical Shell under Axial Compression*, NACA
TM 1390, 1955 (the diamonds). Differs: the distance of crests is that of the material.
"""

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from wrinklecli.character.pose import transform
from wrinklecli.effects.field.compression import Gauges, along, posed_rigidly, rigid_parts, shortest
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    TINY,
    Floats,
    Ints,
    any_of,
    distinct_values,
    face_normals,
    flags_of,
    inverses,
    smoothstep,
    vertex_normals,
)
from wrinklecli.numeric.laplacian import Average, Sheet, curvatures
from wrinklecli.surface.rest import Rest
from wrinklecli.surface.strain import product, tangents

# Lengths of averages, in wavelengths: of limits, a part of a wave; of strain, which folds even out over about a wave;
# and that over which folds go on beyond the compression that makes them, and taper.
NEAR, WAVE, BEYOND = 0.3, 0.8, 1.6
# Length of a fold, in wavelengths, over which it is straight. If it followed directions that turn within less, as round
# the pivot of a joint, it would be a ring round a pit.
_FOLD = 3.0
# Greatest slope of a wrinkle in the pose that engines show, beyond which its flanks overhang.
_STEEPEST = 1.3
# Height over the concave radius of the pose, above which opposite flanks of a crease meet.
_IN_CREASE = 0.8
# Stretch across the crests from which on nothing rises: a taut sheet is flat.
_TAUT = 1.1
# Compression beyond the slack, in slacks, over which folds take it up: those of cloth that has buckled keep its length.
_RISE = 2.0
# Lost part of the length at which waves are highest.
_MOST_LOST = 0.5
# A flat facet of length μ sinks by μ² over so many radii below a tube, at its middle.
_FACETS = 8.0
# Greatest squared sine of the angle by which crests run aslant: there they run along the compression as much as across.
_MOST_ASLANT = 0.5
# Least factor by which skinning makes heights lower that is made up for: a limb bent by 106 degrees. What is turned
# further is hidden in its crease, where taller folds take shapes from what is seen.
_LEAST_LOWER = 0.6
# Decimal digits in which the motions of joints agree that carry a part as one: beyond are rounding errors.
_DIGITS = 9


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Half heights of wrinkles in poses, on the coarse surface at rest.

    Attributes:
        heights: (poses, vertices) scene units, at rest.
        directions: (vertices, 6) minus the mean, over a fold, of the products with itself of the unit direction that is
            shortened most in all poses, weighted by their heights: the surface's wrinkles run across it.
        slants: (vertices,) sines of the angles by which crests are turned from that, to either side.
        leads: (vertices,) how much more curved the surface is along crests turned to the second side than along those
            turned to the first, over the sum: from -1 to 1.
    """

    heights: Floats
    directions: Floats
    slants: Floats
    leads: Floats


def averages_over(sheet: Sheet, wavelength: float) -> tuple[Average, ...]:
    """Averages over the three lengths, `NEAR` first."""
    return tuple(sheet.averaging(length * wavelength) for length in (NEAR, WAVE, BEYOND))


def measure(
    sheet: Sheet,
    rest: Rest,
    joints: Ints,
    weights: Floats,
    matrices: Floats,
    averages: Sequence[Average],
    *,
    wavelength: float,
    wavelengths: Floats,
    radii: Floats,
    slack: float,
    allowed: Floats,
) -> Heights:
    """Measure the heights of wrinkles in (poses, joints, 4, 4) poses.

    Args:
        sheet: The surface at rest, world space.
        rest: Its rest pose, with all vertices of the sheet.
        joints: (vertices, influences) numbers of joints.
        weights: (vertices, influences) skin weights.
        matrices: Bind to world space.
        averages: Those of `averages_over`.
        wavelength: The typical one at rest, scene units.
        wavelengths: (vertices,) those of places.
        radii: (vertices,) of the limbs beneath, scene units.
        slack: Compression that makes no fold.
        allowed: (vertices,) from 0 to 1, factors of the height.
    """
    normals, surface = rest.normals, _Surface(sheet, rest, joints, weights, Gauges.of(sheet.positions, sheet.triangles))
    near, wave, beyond = averages
    axes = tangents(normals)
    lost, total = np.zeros((len(matrices), len(sheet.positions))), np.zeros((len(sheet.positions), 6))
    bent = [surface.bent(pose) for pose in matrices]
    for row, pose, triangles in zip(lost, matrices, bent, strict=True):
        strain = wave.of_integrals(surface.strains(*surface.posed_rigidly(pose, triangles), triangles))
        least, _, across = shortest(strain, axes)
        # What shrinks alike in all directions has none in which it would fold.
        shorter = np.minimum(across, 0.0) - least
        taken_up = smoothstep(np.clip((shorter - slack) / max(_RISE * slack, TINY), 0.0, 1.0))
        row += np.where(allowed > 0, np.maximum(shorter, 0.0) * taken_up, 0.0)
        total += (_squares(row) * (allowed * wavelengths) ** 2)[:, None] * strain
    least, lines, across = shortest(beyond.of(total), axes)
    directions = -sheet.averaging(_FOLD * wavelength).of(product(lines, lines) * (least < across)[:, None])
    lines = shortest(directions, axes)[1]
    around = np.cross(normals, lines)
    crests = _stiffness_along(sheet, around)

    def curved_along(form: Any, average: Average) -> Floats:
        return np.abs(average.of_integrals(np.sum((form @ sheet.positions) * normals, axis=1)))

    sunken = _FACETS * max(_typical_height(lost, sheet.areas), TINY)
    slants = np.sqrt(np.minimum(curved_along(crests, wave) * wavelengths / sunken, _MOST_ASLANT))
    level, aslant = np.sqrt(1.0 - slants**2)[:, None] * around, slants[:, None] * lines
    # Over a fold, as one that another one follows at once ends in a dent.
    one, other = (curved_along(_stiffness_along(sheet, each), beyond) for each in (level - aslant, level + aslant))
    leads = (other - one) / np.maximum(one + other, TINY)
    # Waves are longer along the compression than across their crests.
    wavelengths = wavelengths / np.sqrt(1.0 - slants**2)
    raising = np.einsum("vbc,vc->vb", inverses(rest.blended), normals)
    every, level = np.arange(len(sheet.triangles)), np.zeros(len(sheet.positions))
    still = surface.shown(rest.matrices, every, raising, (level, level + 1.0))
    room = np.zeros((len(matrices), 2, len(sheet.positions)))
    for row, pose, triangles in zip(room, matrices, bent, strict=True):
        hollows, row[1], strains = surface.shown(pose, triangles, raising, still[:2])
        stretches = along(strains, lines, lines)
        strain, concave = near.of_integrals(np.stack([stretches, hollows], axis=1)).T
        row[0] = _room(np.maximum(1.0 + strain, 0.0), concave, wavelengths)
    # Cloth slips over what is beneath, the way in which it is compressed: beside the end of a crease it would heap up.
    # Friction holds it, and what slips fades by e over the radius of the limb.
    slipping = sheet.averaging(2.0, _stiffness_along(sheet, radii[:, None] * lines))
    made = np.sqrt(_squares(_slipped(lost, room[:, 0], slipping, slack)))
    drawn = np.maximum(made, sheet.averaging(BEYOND * wavelength, crests).of(made.T).T)
    heights = np.sqrt(np.minimum(drawn**2, room[:, 0])) * wavelengths / np.pi * allowed / room[:, 1]
    return Heights(heights, directions, slants, leads)


def _typical_height(lost: Floats, areas: Floats) -> float:
    """The height from furrow to crest over the wavelength, in the mean of what folds; (poses, vertices) lost parts."""
    squares = _squares(lost)
    return float(2.0 / np.pi * np.sqrt((squares**2 @ areas).sum() / max((squares @ areas).sum(), TINY)))


def _squares(lost: Floats) -> Floats:
    """(…,) squares of π · half height over wavelength, of waves that keep a length of which (…,) parts are lost."""
    part = np.minimum(lost, _MOST_LOST)
    return np.asarray(part * (1.0 - part))


def _slipped(lost: Floats, room: Floats, average: Average, slack: float) -> Floats:
    """(poses, vertices) lost parts of the length where cloth has slipped: what has no room in a place, to those beside.

    `room` are the greatest squares, as `_squares` gives them. Folds fade where the slack is more than what is lost, as
    heights go with the root: what is hardly anything would be seen.
    """

    def spread(values: Floats) -> Floats:
        return np.maximum(average.of(values.T).T, 0.0)

    # The lost part at which waves are as high as there is room for.
    held = 0.5 - np.sqrt(np.maximum(0.25 - room, 0.0))
    loose = spread(lost)
    kept = np.minimum(loose, held)
    # Each place gets a share by the room it has left, so all of the length is kept.
    left = held - kept
    kept = np.minimum(kept + left * spread((loose - kept) / np.maximum(spread(left), TINY)), held)
    return kept * smoothstep(np.minimum(kept / max(slack, TINY), 1.0))


def _room(stretch: Floats, concave: Floats, wavelengths: Floats) -> Floats:
    """(vertices,) greatest squares of π · half height over wavelength, by slope, in creases, and where it is stretched.

    All are (vertices,): ratios of lengths across crests, concave curvatures, and wavelengths.
    """
    room = np.minimum(_STEEPEST / 2.0 * stretch, np.pi * _IN_CREASE / np.maximum(wavelengths * concave, TINY))
    return np.asarray((room * np.clip((_TAUT - stretch) / (_TAUT - 1.0), 0.0, 1.0)) ** 2)


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """A surface that poses move. Most turn one joint, and what moves as a whole keeps its shape: it is not looked at.

    Attributes are those of `measure`, and gauges on all of its triangles.
    """

    sheet: Sheet
    rest: Rest
    joints: Ints
    weights: Floats
    gauges: Gauges

    def bent(self, pose: Floats) -> Ints:
        """The triangles that joints with different motions since rest carry in a (joints, 4, 4) pose."""
        moves = np.round(pose @ self.rest.to_bind, _DIGITS).reshape(len(pose), -1)
        motions = np.unique(moves, axis=0, return_inverse=True)[1].reshape(-1)
        low, high = (
            reduce(
                nearer, [np.where(w > 0, motions[j], none) for j, w in zip(self.joints.T, self.weights.T, strict=True)]
            )
            for nearer, none in ((np.minimum, len(pose)), (np.maximum, -1))
        )
        a, b, c = self.sheet.triangles.T
        least, most = np.minimum(np.minimum(low[a], low[b]), low[c]), np.maximum(np.maximum(high[a], high[b]), high[c])
        return np.flatnonzero(least != most)

    def posed_rigidly(self, pose: Floats, triangles: Ints) -> tuple[Floats, Floats]:
        """(vertices, 3) places and normals by dual quaternions of what triangles have; the others are at rest."""
        own = distinct_values(self.sheet.triangles[triangles])
        used, joints = np.unique(self.joints[own], return_inverse=True)
        parts = rigid_parts(pose[used], self.rest.to_bind[used])
        found = np.stack([self.sheet.positions, self.sheet.positions + self.rest.normals])
        joints = joints.reshape(-1, self.joints.shape[1])
        found[:, own] = posed_rigidly(found[:, own], joints, self.weights[own], parts)
        return found[0], found[1] - found[0]

    def strains(self, places: Floats, outward: Floats | None, triangles: Ints) -> Floats:
        """(vertices, 6) integrals of the strains at (vertices, 3) places; others than these triangles have none."""
        strains = np.zeros((len(self.sheet.triangles), 6))
        strains[triangles] = self.gauges.of_some(triangles).strains(places, outward)
        return self.sheet.to_vertices(strains)

    def shown(
        self, pose: Floats, bent: Ints, raising: Floats, still: Sequence[Floats]
    ) -> tuple[Floats, Floats, Floats]:
        """Look at a pose as engines show it.

        Args:
            pose: (joints, 4, 4) bind to world space.
            bent: The triangles that it bends.
            raising: (vertices, 3) normals at rest, bind space.
            still: The first two results at rest, which hold elsewhere.

        Returns:
            (vertices,) integrals of the concave curvature; (vertices,) factors by which skinning makes heights lower;
            (vertices, 6) integrals of strains.
        """
        hollows, lower = (each.copy() for each in still)
        sheet, places = self.sheet, self.rest.positions.copy()
        if not len(bent):
            return hollows, lower, np.zeros((len(places), 6))
        own = distinct_values(sheet.triangles[bent])
        around = sheet.triangles[any_of(flags_of(own, len(places)), sheet.triangles)]
        near = distinct_values(around)
        blended = np.einsum("vk,vkab->vab", self.weights[near], pose[:, :3][self.joints[near]])
        places[near] = transform(blended[None], self.rest.bind_positions[near])[0]
        normals = vertex_normals(places, around)[own]
        curved = np.sum(curvatures(places, around)[own] * normals, axis=1)
        hollows[own] = sheet.areas[own] * np.maximum(-curved, 0.0)
        turned = np.einsum("vab,vb->va", blended[np.searchsorted(near, own), :, :3], raising[own])
        lower[own] = np.clip(np.sum(turned * normals, axis=1), _LEAST_LOWER, 1.0)
        return hollows, lower, self.strains(places, None, bent)


def _stiffness_along(sheet: Sheet, lines: Floats) -> Any:
    """The form of a diffusion along (vertices, 3) unit lines alone: the integral of the squared slope along them."""
    import scipy.sparse as sparse

    triangles, places = sheet.triangles, sheet.positions
    normal = face_normals(places, triangles)
    doubled = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / doubled
    slopes = np.stack(
        [
            np.cross(normal, places[triangles[:, (k + 2) % 3]] - places[triangles[:, (k + 1) % 3]]) / doubled
            for k in range(3)
        ],
        axis=1,
    )
    # A line field has no signs, so its products are averaged.
    rates = np.einsum("vi,vj->vij", lines, lines)[triangles].mean(axis=1)
    values = np.einsum("tki,tij,tlj->tkl", slopes, rates, slopes) * (doubled / 2.0)[:, :, None]
    rows, columns = np.repeat(triangles, 3, axis=1), np.tile(triangles, (1, 3))
    shape = (len(places), len(places))
    return sparse.csr_array((values.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=shape)
