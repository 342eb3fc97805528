"""A field on the refined surface: the displacements of its shapes, in bind space."""

import numpy as np

from wrinklecli.character.skin import pose, prepare
from wrinklecli.effects.field.attach import AttachedField
from wrinklecli.effects.field.compression import shortest
from wrinklecli.effects.field.factors import weights_of
from wrinklecli.effects.field.stripes import Sides, phases
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, face_normals, inverses, unit
from wrinklecli.numeric.drawn import drawn
from wrinklecli.numeric.laplacian import Sheet
from wrinklecli.surface.refine import Refinement

# Part of the greatest height below which a place has no phase.
_LEAST = 0.01
# Length of ψ below which waves level out: it is 0 at a fork, and 1 half a wavelength beside it.
_FORK = 0.5
# Waves of the irregularity in space, and their lengths in wavelengths, evenly between these two.
_WAVES, _SHORTEST, _LONGEST = 12, 4.0, 9.0
# Difference of the greatest and least stretch over the greatest from which on a direction counts wholly.
_CLEAR = 0.16
# Radians by which lines are turned, and logarithm by which heights differ, for a variation of 1.
_TURNS, _UNEVEN = 1.2, 1.5
# Poses, those with the greatest weights, in which triangles are looked at.
_POSES = 24
# Cosine of the turn of a triangle beyond which its wrinkle is lowered, part by which that is, and passes.
_TURNED, _LOWERED, _PASSES = 0.26, 0.35, 8
# Length round such a triangle, in wavelengths, over which that fades, and the average from which on it is whole.
_NEAR, _WIDER = 0.25, 4.0
# Length over which heights are averaged, in wavelengths: linear mixtures of coarse values have creases.
_SMOOTH = 0.3


def displaced(attached: AttachedField, fine: Refinement) -> Floats:
    """(shapes, vertices, 3) displacements of the refined surface at weight 1, bind space."""
    shapes = attached.factors.shapes
    found = np.zeros((len(shapes), len(fine.positions), 3))
    values = fine.subdivision.interpolate(np.concatenate([shapes, attached.directions.T]).T)
    heights, tensors = values[:, : len(shapes)], values[:, len(shapes) :]
    greatest = heights.max(axis=1)
    faces = fine.triangles[(greatest[fine.triangles] > _LEAST * greatest.max()).any(axis=1)]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    vertices = distinct_values(faces)
    triangles = np.searchsorted(vertices, faces)
    positions, normals = fine.rest_positions[vertices], fine.rest_normals_at(vertices)
    sheet = Sheet.of(positions, triangles)
    own = np.maximum(sheet.averaging(_SMOOTH * attached.wavelength).of(heights[vertices]), 0.0)
    own *= np.minimum(greatest[vertices] / (_LEAST * greatest.max()), 1.0)[:, None]
    waves = _waves(attached, sheet, normals, tensors[vertices], greatest[vertices] / greatest.max())
    inward = np.einsum("vij,vj->vi", inverses(fine.blended[vertices]), normals)
    moves = (own * waves[:, None]).T[:, :, None] * inward
    found[:, vertices] = moves * _lowered(attached, fine, sheet, vertices, moves)[:, None]
    return found


def _lowered(attached: AttachedField, fine: Refinement, sheet: Sheet, vertices: Ints, moves: Floats) -> Floats:
    """(vertices,) factors of (shapes, vertices, 3) moves by which hardly a triangle turns in any pose.

    Moves add up, so each pose is made once, with them and without.
    """
    sweeps, factors = attached.sweeps, attached.factors
    weights = weights_of(sweeps, factors.turns, factors.tables, sweeps.angles)
    chosen = np.argsort(-(weights**2).sum(axis=1), kind="stable")[:_POSES]
    skin = prepare(fine.influences(sweeps.matrices.shape[1]).at(vertices), fine.bind_positions[vertices], moves)
    before, _ = pose(skin, sweeps.matrices[chosen], np.zeros((len(chosen), len(moves))))
    after, _ = pose(skin, sweeps.matrices[chosen], weights[chosen])
    raised = after - before
    faces = [unit(face_normals(each.T, sheet.triangles)) for each in before]
    near, left = sheet.averaging(_NEAR * attached.wavelength), np.ones(len(vertices))
    for _ in range(_PASSES):
        turned = np.zeros(len(sheet.triangles), np.bool_)
        for face, still, rise in zip(faces, before, raised, strict=True):
            moved = unit(face_normals((still + left * rise).T, sheet.triangles))
            turned |= np.sum(face * moved, axis=1) < _TURNED
        if not turned.any():
            break
        marked = np.zeros(len(vertices))
        marked[sheet.triangles[turned]] = 1.0
        left *= 1.0 - _LOWERED * np.clip(_WIDER * near.of(marked), 0.0, 1.0)
    return left


def _waves(attached: AttachedField, sheet: Sheet, normals: Floats, tensors: Floats, shares: Floats) -> Floats:
    """(vertices,) heights of the waves over the half height."""
    fabric = attached.fabric
    least, lines, across = shortest(tensors, normals)
    size = np.abs(tensors).max(axis=1)
    clear = (across - least) / np.where(size > 0, size, 1.0)
    lines = _turned(lines, normals, _TURNS * fabric.variation * _irregular(attached, sheet.positions, "lines"))
    trust = np.clip(shares * np.clip(clear / _CLEAR, 0.05, 1.0), 0.0, 1.0)
    wavelengths = attached.wavelength * np.exp(fabric.variation * _irregular(attached, sheet.positions, "lengths"))
    sides = Sides.of(sheet.positions, sheet.triangles, normals, lines, wavelengths)
    psi = phases(sides, sheet.positions, sheet.triangles, trust, attached.wavelength, seed=attached.seed)
    length = np.linalg.norm(psi, axis=1)
    waves = fabric.wave(psi[:, 0] / np.where(length > 0, length, 1.0))
    level = np.clip(length / _FORK, 0.0, 1.0)
    uneven = np.exp(_UNEVEN * fabric.variation * _irregular(attached, sheet.positions, "heights") - 0.0)
    return np.asarray(uneven * (level * waves + (1.0 - level) * fabric.mean))


def _turned(lines: Floats, normals: Floats, angles: Floats) -> Floats:
    """(vertices, 3) unit lines in the planes of (vertices, 3) normals, turned by (vertices,) radians."""
    cosine, sine = np.cos(angles)[:, None], np.sin(angles)[:, None]
    return cosine * lines + sine * np.cross(normals, lines)


def _irregular(attached: AttachedField, positions: Floats, what: str) -> Floats:
    """(vertices,) smooth random numbers at (vertices, 3) places, about from -2 to 2, for meshes however fine."""
    ways = drawn(attached.seed, f"ways of {what}", _WAVES, 3)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    lengths = attached.wavelength * np.linspace(_SHORTEST, _LONGEST, _WAVES)
    turns = np.pi * drawn(attached.seed, f"turns of {what}", _WAVES)
    waves = np.cos(2.0 * np.pi * (positions @ (ways / lengths[:, None]).T) + turns)
    return np.asarray(waves.sum(axis=1) * np.sqrt(2.0 / _WAVES))
