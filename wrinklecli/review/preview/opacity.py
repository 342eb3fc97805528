"""What a material shows of its triangles, by `alphaMode`: lace and hair have holes, and glass lets light through.

Source: glTF 2.0 §3.9.4 (alpha coverage).
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.paints import Paint, Texture, look_up
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Array, Bools, Floats, Ints
from wrinklecli.review.preview.rays import INVISIBLE

# Points along an edge of a triangle at which it is looked at, to see if all of it shows.
_POINTS = 8
_ALPHAS = (np.arange(256) / 255.0).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Opacities:
    """Which part of each triangle shows.

    Attributes:
        alphas: (triangles, 3) alpha at the corners.
        cutoffs: (triangles,) alpha from which on a point shows; 0 if all points do, infinite if alpha is opacity.
        coordinates: (triangles, 3, 2) texture coordinates of the corners.
        numbers: (triangles,) into `textures`; -1 for none.
        textures: Their one channel multiplies the alpha.
    """

    alphas: Floats
    cutoffs: Floats
    coordinates: Floats
    numbers: Ints
    textures: tuple[Texture, ...]

    @classmethod
    def of(cls, parts: Sequence[tuple[Ints, Paint]]) -> "Opacities | None":
        """Join parts, each with the (triangles, 3) vertices of its paint; None if all are opaque."""
        if not any(paint.opacity for _, paint in parts):
            return None
        textures: list[Texture] = []
        joined = []
        for vertices, paint in parts:
            alphas, cutoff, texture = np.ones(vertices.shape), 0.0, None
            if paint.opacity is not None:
                alphas, cutoff, texture = paint.opacity.alphas[vertices], paint.opacity.cutoff, paint.opacity.texture
            if texture is not None and texture not in textures:
                textures.append(texture)
            number = -1 if texture is None else textures.index(texture)
            cutoffs, numbers = np.full(len(vertices), cutoff), np.full(len(vertices), number)
            joined.append((alphas, cutoffs, paint.coordinates[vertices], numbers))
        alphas, cutoffs, coordinates, numbers = map(np.concatenate, zip(*joined, strict=True))
        return cls(alphas, cutoffs, coordinates, numbers, tuple(textures))

    def at(self, triangles: Ints, weights: Array) -> Array:
        """(points,) opacity from 0 to 1 at points of (points,) triangles, by (points, 3) barycentric weights."""
        found = np.ones(len(triangles), np.float32)
        partial = np.flatnonzero(self.cutoffs[triangles] > 0)
        triangles, weights = triangles[partial], weights[partial]
        alphas = np.einsum("pi,pi->p", weights, self.alphas[triangles])
        for number, texture in enumerate(self.textures):
            here = np.flatnonzero(self.numbers[triangles] == number)
            places = np.einsum("pi,pia->pa", weights[here], self.coordinates[triangles[here]])
            alphas[here] *= look_up(texture, places, _ALPHAS)[:, 0]
        cutoffs = self.cutoffs[triangles]
        blended = np.where(alphas < INVISIBLE, 0.0, np.where(alphas > 1.0 - INVISIBLE, 1.0, alphas))
        found[partial] = np.where(np.isinf(cutoffs), blended, alphas >= cutoffs)
        return found

    def whole(self) -> Bools:
        """(triangles,) True if all of a triangle is opaque."""
        whole = np.ones(len(self.alphas), np.bool_)
        partial = np.flatnonzero(self.cutoffs > 0)
        steps = np.arange(_POINTS + 1) / _POINTS
        for first in steps:
            for second in steps[steps <= 1.0 - first]:
                weights = np.tile([first, second, 1.0 - first - second], (len(partial), 1))
                whole[partial] &= self.at(partial, weights) == 1.0
        return whole
