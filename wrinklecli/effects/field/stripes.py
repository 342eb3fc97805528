"""One phase over a surface, whose stripes run across a field of lines, with forks and ends where they must be.

Each vertex has a complex number ψ of length 1, whose angle is the phase. Along an edge e between lines d it should turn
by 2π d·e / λ. Where lines have no signs, ψ or its conjugate counts: the height is an even function of the phase, which
is the same for both. The energy Σ w |ψ_j − ψ_i turned|² is least for ψ of any length, and then lies in one region
alone. So ψ is made as long as 1 and diffuses in turns, over shorter and shorter lengths, and at last along the crests.

Sources: F. Knöppel, K. Crane, U. Pinkall, P. Schröder, *Stripe Patterns on Surfaces*, SIGGRAPH 2015 (the energy);
B. Merriman, J. Bence, S. Osher, *Diffusion Generated Motion by Mean Curvature*, 1992 (diffuse, then restore).
"""

from collections.abc import Callable

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats, Ints
from wrinklecli.numeric.drawn import drawn
from wrinklecli.numeric.elements import factorised
from wrinklecli.numeric.laplacian import side_weights, vertex_areas
from wrinklecli.numeric.processes import in_threads

# Lengths of the diffusion, in wavelengths, and rounds over each: one joins regions, the other makes forks sharp.
_LONG, _SHARP, _TIMES = 3.0, 0.5, 8
# Length of the average along crests, in wavelengths: what is shorter than a fold that is twice as long as wide fades.
_FOLD = 2.0
# Trust that any place has: phases go on where nothing asks for them.
_LEAST_TRUST = 1e-3
# Waves in space, one wavelength long, of which the first phases are made: some of them run across any crest.
_WAVES = 32
# Length of a ψ that is lost.
_SHORT = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Sides:
    """The sides of triangles, each once, with what a phase does along them.

    Attributes:
        ends: (sides, 2) vertices, the lower first.
        weights: (sides,) of the energy.
        turns: (sides,) radians by which the phase should turn from the first end to the second,
        signs: (sides,) and 1 if the lines at both ends point the same way, -1 if the second counts conjugated.
        crests: (sides,) from 0 to 1, how much sides run along the crests at their ends.
    """

    ends: Ints
    weights: Floats
    turns: Floats
    signs: Floats
    crests: Floats

    @classmethod
    def of(cls, positions: Floats, triangles: Ints, normals: Floats, lines: Floats, wavelengths: Floats) -> "Sides":
        """Lay (vertices, 3) unit lines with (vertices,) wavelengths along the sides of triangles."""
        pairs, cotangents = side_weights(positions, triangles)
        numbers, at = np.unique(np.sort(pairs, axis=1) @ [len(positions), 1], return_inverse=True)
        ends = np.stack(np.divmod(numbers, len(positions)), axis=1)
        weights = np.asarray(np.bincount(at, cotangents, len(ends)), np.float64)
        a, b = ends.T
        signs = np.where(np.sum(lines[a] * lines[b], axis=1) < 0, -1.0, 1.0)
        way = positions[b] - positions[a]
        steps = np.stack([_within(way, normals[a], lines[a]), _within(way, normals[b], signs[:, None] * lines[b])])
        turns = np.pi * (steps / wavelengths[ends.T]).sum(axis=0)
        across = (steps**2).mean(axis=0) / np.maximum(np.sum(way**2, axis=1), TINY)
        return cls(ends, weights, turns, signs, np.maximum(1.0 - across, 0.0) ** 2)

    def diffusion(self, weights: Floats, masses: Floats) -> Callable[[Floats], Floats]:
        """A function that makes (vertices, 2) ψ as long as 1, then diffuses it.

        Args:
            weights: (sides,) factors of the weights of sides.
            masses: (vertices,) how much each place keeps its ψ.
        """
        import scipy.sparse as sparse

        a, b = self.ends.T
        count, weights = len(masses), weights * self.weights
        cosine, sine = np.cos(self.turns), np.sin(self.turns)
        turned = -weights * np.array([[cosine, -sine], [self.signs * sine, self.signs * cosine]])
        rows, columns, values = [], [], []
        for i in range(2):
            for j in range(2):
                rows += [2 * b + i, 2 * a + j]
                columns += [2 * a + j, 2 * b + i]
                values += [turned[i, j], turned[i, j]]
        masses = np.repeat(masses, 2)
        whole = np.repeat(np.bincount(a, weights, count) + np.bincount(b, weights, count), 2) + masses
        diagonal = np.arange(2 * count)
        places = (np.concatenate([*rows, diagonal]), np.concatenate([*columns, diagonal]))
        form = sparse.csc_array((np.concatenate([*values, whole]), places), shape=(2 * count, 2 * count))
        solve = factorised(form, relax=1).solve
        return lambda psi: np.asarray(solve(masses * _restored(psi).reshape(-1)).reshape(-1, 2))

    @property
    def waves(self) -> Floats:
        """(sides,) parts of a wave from end to end."""
        return np.abs(self.turns) / (2.0 * np.pi)

    def middles(self, psi: Floats) -> Floats:
        """(sides, 2) ψ halfway along the sides, from (vertices, 2): the mean of both ends, turned half of the way."""
        (a, b), half = self.ends.T, self.turns / 2.0
        cosine, sine = np.cos(half), np.sin(half)
        (p, q), (r, s) = psi[a].T, psi[b].T
        s = self.signs * s
        return np.stack([cosine * (p + r) + sine * (s - q), cosine * (q + s) + sine * (p - r)], axis=1) / 2.0


def _within(ways: Floats, normals: Floats, lines: Floats) -> Floats:
    """(sides,) parts along lines of (sides, 3) ways that are turned into the planes of normals at their length."""
    flat = ways - np.sum(ways * normals, axis=1, keepdims=True) * normals
    lengths = np.linalg.norm(ways, axis=1)
    return np.asarray(np.sum(flat * lines, axis=1) * lengths / np.maximum(np.linalg.norm(flat, axis=1), TINY))


def phases(sides: Sides, positions: Floats, triangles: Ints, trust: Floats, wavelength: float, *, seed: str) -> Floats:
    """(vertices, 2) real and imaginary parts of ψ, averaged along the crests.

    A fold is longer than it is wide. So ψ is about 1 long where crests run on, and short at forks and ends, and where
    they are dashes.

    Args:
        sides: The sides of the triangles.
        positions: (vertices, 3) at rest.
        triangles: (triangles, 3).
        trust: (vertices,) from 0 to 1, how much each place counts.
        wavelength: Typical, scene units.
        seed: From which the first phases are drawn.
    """
    a, b = sides.ends.T
    trusted = np.sqrt(trust[a] * trust[b]) + _LEAST_TRUST
    areas = vertex_areas(positions, triangles)
    kept, found = areas * (trust + _LEAST_TRUST), _drawn_at(positions, wavelength, seed)
    steps = [(_LONG, trusted, kept), (_SHARP, trusted, kept), (_FOLD, sides.crests, areas)]
    once_each = in_threads(lambda step: sides.diffusion((step[0] * wavelength) ** 2 / 4.0 * step[1], step[2]), steps)
    for diffused, times in zip(once_each, (_TIMES, _TIMES, 1), strict=True):
        for _ in range(times):
            found = diffused(found)
    return found


def _drawn_at(positions: Floats, wavelength: float, seed: str) -> Floats:
    """(vertices, 2) random ψ, the same at one place however vertices are numbered and however fine the mesh is."""
    ways = drawn(seed, "ways", _WAVES, 3)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True) * wavelength
    angles = 2.0 * np.pi * (positions @ ways.T) + np.pi * drawn(seed, "phases", _WAVES)
    return np.stack([np.cos(angles).sum(axis=1), np.sin(angles).sum(axis=1)], axis=1)


def _restored(values: Floats) -> Floats:
    """(vertices, 2) of length 1."""
    return np.asarray(values / np.maximum(np.linalg.norm(values, axis=1, keepdims=True), _SHORT))
