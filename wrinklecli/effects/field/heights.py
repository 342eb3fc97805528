"""Heights of wrinkles in poses: as much as keeps the length of the surface, and no more than has room there.

A surface that is shortened to 1 − ε along a direction keeps its length in sine waves of rest length λ and half height
A = λ/π √(ε (1 − ε)), to second order in ε. They are greatest at ε = ½, so no other limit of strain is needed.
"""

from typing import Any

import numpy as np

from wrinklecli.character.pose import transform
from wrinklecli.effects.field.compression import Gauges, along, posed_rigidly, rigid_parts, shortest
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, face_normals, inverses, smoothstep, vertex_normals
from wrinklecli.numeric.laplacian import Average, Sheet, curvatures
from wrinklecli.surface.rest import Rest

# Lengths of averages, in wavelengths: of strain, which folds even out over about a wave; of limits, a fraction of one.
_STRAIN, _LIMITS = 0.8, 0.3
# Diffusion of heights along crests and across, in wavelengths: a fold of cloth is longer than the compression that
# makes it, and tapers.
_ALONG, _ACROSS = 1.2, 0.3
# Length over which directions go on beyond the compression, in wavelengths.
_DIRECTIONS = 1.5
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
# Lost part of the length below which folds fade: heights go with its root, so what is hardly anything would be seen.
_LEAST_LOST = 0.01
# Times that cloth slips by the length of the average of strain.
_SLIPS = 5
# Least factor by which skinning makes heights lower that is made up for: a limb bent by 106 degrees. What is turned
# further is hidden in its crease, where taller folds take shapes from what is seen.
_LEAST_LOWER = 0.6
# Replaces a divisor of 0.
_TINY = 1e-300


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Half heights of wrinkles in poses, on the coarse surface at rest.

    Attributes:
        heights: (poses, vertices) scene units, at rest.
        directions: (vertices, 6) the strains of all poses, weighted by their heights: the surface's wrinkles run across
            the direction that is shortened most.
        lines: (vertices, 3) these directions, unit vectors without signs.
    """

    heights: Floats
    directions: Floats
    lines: Floats


def measure(
    sheet: Sheet,
    rest: Rest,
    joints: Ints,
    weights: Floats,
    matrices: Floats,
    *,
    wavelength: float,
    wavelengths: Floats,
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
        wavelength: The typical one at rest, scene units.
        wavelengths: (vertices,) those of places.
        slack: Compression that makes no fold.
        allowed: (vertices,) from 0 to 1, factors of the height.
    """
    normals, gauges = rest.normals, Gauges.of(sheet.positions, sheet.triangles)
    smooth, fine = sheet.averaging(_STRAIN * wavelength), sheet.averaging(_LIMITS * wavelength)
    lost, total = np.zeros((len(matrices), len(sheet.positions))), np.zeros((len(sheet.positions), 6))
    for row, pose in zip(lost, matrices, strict=True):
        moved = posed_rigidly(sheet.positions, joints, weights, rigid_parts(pose, rest.matrices))
        strain = smooth.of_integrals(sheet.to_vertices(gauges.strains(moved)))
        least, _, across = shortest(strain, normals)
        # What shrinks alike in all directions has none in which it would fold.
        shorter = 1.0 - np.exp(least - np.minimum(across, 0.0))
        taken_up = smoothstep(np.clip((shorter - slack) / max(_RISE * slack, _TINY), 0.0, 1.0))
        row += np.where(allowed > 0, np.maximum(shorter, 0.0) * taken_up, 0.0)
        total += (_squares(row) * (allowed * wavelengths) ** 2)[:, None] * strain
    directions = sheet.averaging(_DIRECTIONS * wavelength).of(total)
    _, lines, _ = shortest(directions, normals)
    raising = np.einsum("vbc,vc->vb", inverses(rest.blended), normals)
    room = np.stack(
        [_room(sheet, rest, joints, weights, pose, gauges, fine, lines, raising, wavelengths) for pose in matrices]
    )
    squares = _squares(_slipped(lost, room[:, 0], smooth))
    drawn = _drawn_out(sheet, lines, np.sqrt(squares), wavelength)
    heights = np.sqrt(np.minimum(drawn**2, room[:, 0])) * wavelengths / np.pi * allowed / room[:, 1]
    return Heights(heights, directions, lines)


def _squares(lost: Floats) -> Floats:
    """(…,) squares of π · half height over wavelength, of waves that keep a length of which (…,) parts are lost."""
    part = np.minimum(lost, _MOST_LOST)
    return np.asarray(part * (1.0 - part))


def _slipped(lost: Floats, room: Floats, average: Average) -> Floats:
    """(poses, vertices) lost parts of the length where cloth slips from places without room to those beside them.

    `room` are the greatest squares, as `_squares` gives them.
    """
    # The lost part at which waves are as high as there is room for.
    held = 0.5 - np.sqrt(np.maximum(0.25 - room, 0.0))
    kept = np.minimum(lost, held)
    excess = lost - kept
    for _ in range(_SLIPS):
        kept += np.maximum(average.of(excess.T).T, 0.0)
        excess = np.maximum(kept - held, 0.0)
        kept -= excess
    return kept * smoothstep(np.minimum(kept / _LEAST_LOST, 1.0))


def _room(
    sheet: Sheet,
    rest: Rest,
    joints: Ints,
    weights: Floats,
    pose: Floats,
    gauges: Gauges,
    fine: Average,
    direction: Floats,
    raising: Floats,
    wavelengths: Floats,
) -> Floats:
    """Room for waves across (vertices, 3) directions in a pose as engines show it.

    `raising` are the (vertices, 3) normals at rest, bind space.

    Returns:
        (2, vertices): the greatest squares of π · half height over wavelength, by slope, in creases, and where the
        surface is stretched; and the factor by which skinning makes heights lower.
    """
    blended = np.einsum("vk,vkab->vab", weights, pose[:, :3][joints])
    shown = transform(blended[None], rest.bind_positions)[0]
    normals = vertex_normals(shown, sheet.triangles)
    stretches = along(sheet.to_vertices(gauges.strains(shown)), direction, direction)
    hollows = sheet.areas * np.maximum(-np.sum(curvatures(shown, sheet.triangles) * normals, axis=1), 0.0)
    strain, concave = fine.of_integrals(np.stack([stretches, hollows], axis=1)).T
    stretch = np.exp(strain)
    room = np.minimum(_STEEPEST / 2.0 * stretch, np.pi * _IN_CREASE / np.maximum(wavelengths * concave, _TINY))
    room *= np.clip((_TAUT - stretch) / (_TAUT - 1.0), 0.0, 1.0)
    turned = np.einsum("vab,vb->va", blended[:, :, :3], raising)
    lower = np.clip(np.sum(turned * normals, axis=1), _LEAST_LOWER, 1.0)
    return np.stack([room**2, lower])


def _drawn_out(sheet: Sheet, across: Floats, heights: Floats, wavelength: float) -> Floats:
    """(poses, vertices) heights that go on along their crests, with the greatest as it was."""
    if not heights.any():
        return heights
    made = sheet.averaging(np.sqrt(2.0) * wavelength, _anisotropic(sheet, across)).of(heights.T).T
    made = np.maximum(made, 0.0)
    return np.asarray(made * (heights.max() / made.max()))


def _anisotropic(sheet: Sheet, across: Floats) -> Any:
    """The form of a diffusion that acts along crests more than along the (vertices, 3) directions across them."""
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
    lines = np.einsum("vi,vj->vij", across, across)[triangles].mean(axis=1)
    rates = _ALONG**2 * np.eye(3) + (_ACROSS**2 - _ALONG**2) * lines
    values = np.einsum("tki,tij,tlj->tkl", slopes, rates, slopes) * (doubled / 2.0)[:, :, None]
    rows, columns = np.repeat(triangles, 3, axis=1), np.tile(triangles, (1, 3))
    shape = (len(places), len(places))
    return sparse.csr_array((values.reshape(-1), (rows.reshape(-1), columns.reshape(-1))), shape=shape)
