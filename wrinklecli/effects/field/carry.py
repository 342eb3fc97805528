"""A field on the refined surface: the displacements of its shapes, in bind space."""

import numpy as np

from wrinklecli.character.skin import pose, prepare
from wrinklecli.effects.field import irregular
from wrinklecli.effects.field.attach import AttachedField
from wrinklecli.effects.field.compression import shortest
from wrinklecli.effects.field.factors import weights_of
from wrinklecli.effects.field.material import Fabric
from wrinklecli.effects.field.stripes import Sides, phases
from wrinklecli.effects.shapes import Middles
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, face_normals, unit
from wrinklecli.numeric.laplacian import Sheet
from wrinklecli.surface.refine import Refinement

# Replaces a divisor of 0.
_TINY = 1e-300
# Part of the greatest displacement below which a shape moves nothing: a tenth of the default --max-error. Shapes that
# are not negative fade slowly, and would else be all over a garment.
_UNSEEN = 1e-3
# Part of the greatest height below which a place has no phase.
_LEAST = 0.01
# Length of ψ below which waves level out: it is 0 at a fork, and 1 half a wavelength beside it.
_FORK = 0.5
# Difference of the greatest and least stretch over the greatest from which on a direction counts wholly.
_CLEAR = 0.16
# Most poses, those with the greatest weights, in which triangles are looked at.
_POSES = 64
# Cosine of the turn of a triangle beyond which its wrinkle is lowered, part by which that is, and passes.
_TURNED, _LOWERED, _PASSES = 0.26, 0.35, 8
# Length round such a triangle, in wavelengths, over which that fades, and the average from which on it is whole.
_NEAR, _WIDER = 0.25, 4.0
# Length over which heights are averaged, in wavelengths: linear mixtures of coarse values have creases.
_SMOOTH = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class Displacements:
    """A field on the refined surface.

    Attributes:
        deltas: (shapes, vertices, 3) at weight 1, bind space.
        middles: Those of edges, beyond the mean of their ends.
        shares: (vertices,) parts of the greatest height, without waves, which later fields leave to it.
        remaining: The greatest height over that without tools and earlier fields.
    """

    deltas: Floats
    middles: Middles
    shares: Floats
    remaining: float


def displaced(attached: AttachedField, fine: Refinement, free: Floats) -> Displacements:
    """Carry a field to the refined surface, of which tools leave it (fine vertices,) parts from 0 to 1."""
    shapes = attached.factors.shapes
    count = len(shapes)
    values = fine.subdivision.interpolate(np.concatenate([shapes, attached.directions.T, attached.wavelengths[None]]).T)
    greatest = values[:, :count].max(axis=1)
    faces = fine.triangles[(greatest[fine.triangles] > _LEAST * greatest.max()).any(axis=1)]
    faces = faces[(faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])]
    vertices = distinct_values(faces)
    values, shares = values[vertices], greatest[vertices] / greatest.max()
    positions, normals = fine.rest_positions[vertices], fine.rest_normals_at(vertices)
    sheet = Sheet.of(positions, np.searchsorted(vertices, faces))
    heights = np.maximum(sheet.averaging(_SMOOTH * attached.wavelength).of(values[:, :count]), 0.0)
    whole = max(float(heights.max(initial=0.0)), _TINY)
    heights *= (free[vertices] * np.minimum(shares / _LEAST, 1.0))[:, None]
    remaining = float(heights.max(initial=0.0)) / whole
    waves = _waves(attached, sheet, normals, values[:, count:], shares)
    outward = fine.raising_at(vertices)
    moves = (heights * waves.heights[:, None]).T[:, :, None] * outward
    left = _lowered(attached, fine, sheet, vertices, moves)
    moves *= left[:, None]
    lengths = np.sqrt(np.sum(moves**2, axis=2))
    moves = np.where((lengths > _UNSEEN * lengths.max(initial=0.0))[:, :, None], moves, 0.0)
    heights *= left[:, None]
    a, b = waves.sides.T
    bent = (waves.middles - (waves.heights[a] + waves.heights[b]) / 2.0)[:, None] * (heights[a] + heights[b]) / 2.0
    found = np.zeros((count, len(fine.positions), 3))
    found[:, vertices] = moves
    edges = Middles.numbers_of(vertices[waves.sides], fine)
    covered = np.zeros(len(free))
    covered[vertices] = np.minimum(heights.max(axis=1) / heights.max(initial=_TINY), 1.0)
    middles = Middles(edges, bent.T[:, :, None] * (outward[a] + outward[b]) / 2.0)
    return Displacements(found, middles, covered, remaining)


def _lowered(attached: AttachedField, fine: Refinement, sheet: Sheet, vertices: Ints, moves: Floats) -> Floats:
    """(vertices,) factors of (shapes, vertices, 3) moves by which hardly a triangle turns in any pose.

    Moves add up, so each pose is made once, with them and without.
    """
    sweeps, factors = attached.sweeps, attached.factors
    weights = weights_of(sweeps, factors.turns, factors.tables)
    chosen = np.argsort(-(weights**2).sum(axis=1), kind="stable")[:_POSES]
    skin = prepare(fine.influences(sweeps.matrices.shape[1]).at(vertices), fine.bind_positions[vertices], moves)
    before, _ = pose(skin, sweeps.matrices[chosen], np.zeros((len(chosen), len(moves))))
    after, _ = pose(skin, sweeps.matrices[chosen], weights[chosen])
    raised = after - before
    faces = [unit(face_normals(each.T, sheet.triangles)) for each in before]
    near, left = sheet.averaging(_NEAR * attached.wavelength), np.ones(len(vertices))
    looked = list(zip(faces, before, raised, strict=True))
    for _ in range(_PASSES):
        marked, still_turned = np.zeros(len(vertices)), []
        for each in looked:
            face, still, rise = each
            moved = unit(face_normals((still + left * rise).T, sheet.triangles))
            turned = np.sum(face * moved, axis=1) < _TURNED
            if turned.any():
                marked[sheet.triangles[turned]] = 1.0
                still_turned.append(each)
        looked = still_turned
        if not looked:
            break
        left *= 1.0 - _LOWERED * np.clip(_WIDER * near.of(marked), 0.0, 1.0)
    return left


def _waves(attached: AttachedField, sheet: Sheet, normals: Floats, values: Floats, shares: Floats) -> "_Waves":
    """The waves of a field.

    Args:
        attached: The field.
        sheet: The refined surface at rest.
        normals: (vertices, 3) of it.
        values: (vertices, 7) directions as tensors, and wavelengths.
        shares: (vertices,) parts of the greatest height.
    """
    fabric, places, seed = attached.fabric, sheet.positions, attached.seed
    least, lines, across = shortest(values[:, :6], normals)
    size = np.abs(values[:, :6]).max(axis=1)
    clear = (across - least) / np.where(size > 0, size, 1.0)
    trust = np.clip(shares * np.clip(clear / _CLEAR, 0.05, 1.0), 0.0, 1.0)
    varied = (attached.wavelength, attached.tool.variation, seed)
    lines = irregular.turned(lines, normals, places, *varied)
    wavelengths = values[:, 6] * irregular.lengthened(places, *varied)
    sides = Sides.of(places, sheet.triangles, normals, lines, wavelengths)
    psi = phases(sides, places, sheet.triangles, trust, attached.wavelength, seed=seed)
    uneven = irregular.raised(places, *varied)
    return _Waves(
        uneven * _height(fabric, psi), sides.ends, uneven[sides.ends].mean(axis=1) * _height(fabric, sides.middles(psi))
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Waves:
    """Heights of waves over the half height: at (vertices,) and at the middles of (sides, 2) sides."""

    heights: Floats
    sides: Ints
    middles: Floats


def _height(fabric: Fabric, psi: Floats) -> Floats:
    """(n,) heights of waves over the half height, at (n, 2) ψ; level with their mean at forks."""
    length = np.linalg.norm(psi, axis=1)
    waves = fabric.wave(psi[:, 0] / np.where(length > 0, length, 1.0))
    level = np.clip(length / _FORK, 0.0, 1.0)
    return np.asarray(level * waves + (1.0 - level) * fabric.mean)
