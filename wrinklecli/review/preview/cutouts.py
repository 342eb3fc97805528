"""Triangles that a material with `alphaMode: MASK` shows in part, as lace and hair: rays pass through the rest.

Source: glTF 2.0 §3.9.4 (alpha coverage).
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Array, Bools, Floats, Ints
from wrinklecli.review.preview.paints import Cutout, Texture, look_up

# Points along an edge of a triangle at which it is looked at, to see if all of it shows.
_POINTS = 8
_ALPHAS = (np.arange(256) / 255.0).astype(np.float32)


@dataclass(frozen=True, slots=True)
class Cutouts:
    """Which part of each triangle shows.

    Attributes:
        alphas: (triangles, 3) alpha at the corners over the cutoff; infinite if all of the triangle shows.
        coordinates: (triangles, 3, 2) texture coordinates of the corners.
        numbers: (triangles,) into `textures`; -1 for none.
        textures: Their one channel multiplies the alpha.
    """

    alphas: Floats
    coordinates: Floats
    numbers: Ints
    textures: tuple[Texture, ...]

    @classmethod
    def of(cls, parts: Sequence[tuple[Ints, Cutout | None]]) -> "Cutouts | None":
        """Join parts, each with the (triangles, 3) vertices of its cutout, if any; None if no part has one."""
        if not any(cutout for _, cutout in parts):
            return None
        textures: list[Texture] = []
        joined = []
        for vertices, cutout in parts:
            if cutout is None:
                whole = np.full(vertices.shape, np.inf), np.zeros((*vertices.shape, 2)), np.full(len(vertices), -1)
                joined.append(whole)
                continue
            if cutout.texture is not None and cutout.texture not in textures:
                textures.append(cutout.texture)
            number = -1 if cutout.texture is None else textures.index(cutout.texture)
            numbers = np.full(len(vertices), number)
            joined.append((cutout.alphas[vertices], cutout.coordinates[vertices], numbers))
        alphas, coordinates, numbers = map(np.concatenate, zip(*joined, strict=True))
        return cls(alphas, coordinates, numbers, tuple(textures))

    def shown(self, triangles: Ints, weights: Array) -> Bools:
        """(points,) True for points of (points,) triangles, by (points, 3) barycentric weights, that show."""
        shown = np.ones(len(triangles), np.bool_)
        cut = np.flatnonzero(np.isfinite(self.alphas[triangles, 0]))
        triangles, weights = triangles[cut], weights[cut]
        alphas = np.einsum("pi,pi->p", weights, self.alphas[triangles])
        for number, texture in enumerate(self.textures):
            here = np.flatnonzero(self.numbers[triangles] == number)
            places = np.einsum("pi,pia->pa", weights[here], self.coordinates[triangles[here]])
            alphas[here] *= look_up(texture, places, _ALPHAS)[:, 0]
        shown[cut] = alphas >= 1.0
        return shown

    def whole(self) -> Bools:
        """(triangles,) True if all of a triangle shows."""
        whole = np.ones(len(self.alphas), np.bool_)
        cut = np.flatnonzero(np.isfinite(self.alphas[:, 0]))
        steps = np.arange(_POINTS + 1) / _POINTS
        for first in steps:
            for second in steps[steps <= 1.0 - first]:
                weights = np.tile([first, second, 1.0 - first - second], (len(cut), 1))
                whole[cut] &= self.shown(cut, weights)
        return whole
