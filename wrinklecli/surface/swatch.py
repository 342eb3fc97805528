"""Samples the pictures of a surface: the base colour and the metal of a place.

Points are spread over the triangles of a place in proportion to their weights, so that one atlas, of which a mesh uses
small parts, says of each place what is drawn there.

Source: B. Ottosson, *A perceptual color space for image processing*, 2020 (Oklab).
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import field
from functools import cache

import numpy as np

from wrinklecli.character.paints import (
    Opacity,
    Texture,
    pixels_at,
    read_opacity,
    read_texture,
    texture_coordinates,
    texture_info,
    vertex_colours,
)
from wrinklecli.errors import AssetError, TooMuchError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.pixels import Bytes, linear_rgb
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import PLASTIC, Bools, Floats, Ints, distinct_values
from wrinklecli.numeric.memory import once

# Errors of a texture or of colours that are malformed.
_MALFORMED = (AssetError, TooMuchError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError)
# Linear RGB of the 256 stored values of sRGB.
_LINEAR = linear_rgb(np.arange(256) / 255.0)
# Points on a place: a stuff that covers a twentieth of it gets about 25 of them, enough to be told from chance.
_POINTS = 512
# Points on a triangle for its mean colour.
_POINTS_OF_TRIANGLE = 16
# Linear RGB to the responses of cones, and the cube roots of these to Oklab.
_CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_OKLAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


SAMPLED = 3 * _POINTS
"""Numbers of a place that are looked up at once: colours of its points."""


@dataclass(frozen=True, slots=True, eq=False)
class Swatches:
    """The looks of places.

    Attributes:
        colours: (places, points, 3) in Oklab.
        pictured: (places,) the part of the points that a texture colours.
        coloured: (places,) the part of the points whose colour the file says, by a texture, a factor or vertices.
        metallic: (places,) mean of the metallic factor times its texture.
    """

    colours: Floats
    pictured: Floats
    coloured: Floats
    metallic: Floats


@dataclass(frozen=True, slots=True)
class _Coat:
    """The base colour, metal and opacity of a primitive; textures at (vertices, 2) coordinates."""

    factor: Floats
    vertex_colours: Floats
    base: tuple[Texture, Floats] | None
    metal: tuple[Texture, Floats] | None
    metallic: float
    coloured: bool
    opacity: Opacity | None

    def shows(self, shares: Floats, corners: Ints) -> Floats:
        """(points,) opacity at (points, 3) shares of (points, 3) corners."""
        assert self.opacity is not None, "all of it shows otherwise"
        alphas: Floats = np.einsum("pk,pk->p", shares, self.opacity.alphas[corners])
        if self.opacity.texture is not None and self.base is not None:
            alphas = alphas * _looked_up((self.opacity.texture, self.base[1]), shares, corners)[:, 0] / 255.0
        return alphas if np.isinf(self.opacity.cutoff) else (alphas >= self.opacity.cutoff).astype(np.float64)


@dataclass(slots=True)
class Pictures:
    """The textures of a document, each read once, when a place first asks for it.

    Attributes:
        document: The document.
        notes: A line for each texture that cannot be read.
    """

    document: Document
    notes: list[str] = field(default_factory=list)
    _textures: dict[str, Texture | None] = field(default_factory=dict)
    _coats: dict[tuple[int, int, int], _Coat] = field(default_factory=dict)

    def swatches(
        self, mesh: int, primitives: Ints, corners: Ints, starts: Ints, places: Sequence[tuple[Ints, Floats]]
    ) -> Swatches:
        """Sample places of a mesh, with one look at each picture for all of them.

        Args:
            mesh: Index of the mesh.
            primitives: (triangles,) the primitive of each.
            corners: (triangles, 3) glTF vertices at their corners, numbered through all primitives.
            starts: (primitives + 1,) the first glTF vertex of each primitive.
            places: The numbers of triangles of each, and how much of the place each triangle has.
        """
        triangles = np.concatenate([own[_spread(weights)] for own, weights in places])
        shares = np.tile(_evenly_spread(_POINTS), (len(places), 1))
        found = self._sampled(mesh, primitives, corners, starts, triangles, shares)
        means = (each.reshape(len(places), _POINTS).mean(axis=1) for each in found[1:])
        return Swatches(found[0].reshape(len(places), _POINTS, 3), *means)

    def colours(self, mesh: int, primitives: Ints, corners: Ints, starts: Ints) -> Floats:
        """(triangles, 3) the mean colour of each triangle of a mesh, in Oklab; the parameters of `swatches`."""
        every = np.arange(len(corners))
        total = np.zeros((len(corners), 3))
        for share in _evenly_spread(_POINTS_OF_TRIANGLE):
            total += self._sampled(mesh, primitives, corners, starts, every, np.tile(share, (len(corners), 1)))[0]
        return total / _POINTS_OF_TRIANGLE

    def shown(self, mesh: int, primitives: Ints, corners: Ints, starts: Ints) -> Floats:
        """(triangles,) the part of each triangle that alpha does not cut away; the parameters of `swatches`."""
        found = np.ones(len(corners))
        for primitive in distinct_values(primitives).tolist():
            first, end = int(starts[primitive]), int(starts[primitive + 1])
            coat, here = self._coat(mesh, primitive, end - first), np.flatnonzero(primitives == primitive)
            if coat.opacity is not None:
                at, shares = corners[here] - first, _evenly_spread(_POINTS_OF_TRIANGLE)
                found[here] = np.mean([coat.shows(np.tile(share, (len(at), 1)), at) for share in shares], axis=0)
        return found

    def _sampled(
        self, mesh: int, primitives: Ints, corners: Ints, starts: Ints, triangles: Ints, shares: Floats
    ) -> tuple[Floats, Bools, Bools, Floats]:
        """The colour, if a picture or the file says it, and the metal of (points, 3) shares on (points,) triangles."""
        colours, metallic = np.zeros((len(triangles), 3)), np.zeros(len(triangles))
        pictured, coloured = np.zeros(len(triangles), bool), np.zeros(len(triangles), bool)
        for primitive in distinct_values(primitives[triangles]).tolist():
            here = np.flatnonzero(primitives[triangles] == primitive)
            first, end = int(starts[primitive]), int(starts[primitive + 1])
            coat = self._coat(mesh, primitive, end - first)
            at, parts = corners[triangles[here]] - first, shares[here]
            colours[here] = coat.factor * np.einsum("pk,pkc->pc", parts, coat.vertex_colours[at])
            coloured[here] = coat.coloured or coat.base is not None
            if coat.base is not None:
                colours[here] *= _LINEAR[_looked_up(coat.base, parts, at)]
                pictured[here] = True
            metallic[here] = coat.metallic
            if coat.metal is not None:
                metallic[here] *= _looked_up(coat.metal, parts, at)[:, 2] / 255.0
        return np.cbrt(np.maximum(colours, 0.0) @ _CONES.T) @ _OKLAB.T, pictured, coloured, metallic

    def _coat(self, mesh: int, primitive: int, count: int) -> _Coat:
        stored = self.document.items("meshes")[mesh]["primitives"][primitive]
        return once(self._coats, (mesh, primitive, count), lambda: self._read(stored, count))

    def _read(self, primitive: Json, count: int) -> _Coat:
        """Read the looks of a primitive. What is malformed says nothing."""
        materials = self.document.items("materials")
        number = primitive.get("material", len(materials))
        material = materials[number] if isinstance(number, int) and 0 <= number < len(materials) else {}
        looks = material.get("pbrMetallicRoughness")
        looks = looks if isinstance(looks, dict) else {}
        factor = looks.get("baseColorFactor")
        if not isinstance(factor, list) or len(factor) != 4 or not all(_is_number(x) for x in factor):
            factor = None
        base = self._texture(primitive, "baseColorTexture", count)
        metal = self._texture(primitive, "metallicRoughnessTexture", count)
        # By default a material is metallic, which many files with neither key nor texture do not mean.
        metallic = looks.get("metallicFactor", 0.0 if metal is None else 1.0)
        of_vertices, opacity = np.ones((count, 3)), None
        with suppress(ImportError, *_MALFORMED):
            of_vertices = vertex_colours(self.document, primitive, count)
            opacity = read_opacity(self.document, primitive, count)
        return _Coat(
            np.clip(np.array([1.0] * 3 if factor is None else factor[:3], float), 0.0, 1.0),
            of_vertices,
            base,
            metal,
            float(metallic) if _is_number(metallic) else 0.0,
            factor is not None or "COLOR_0" in primitive["attributes"],
            opacity,
        )

    def _texture(self, primitive: Json, key: str, count: int) -> tuple[Texture, Floats] | None:
        try:
            info = texture_info(self.document, primitive, key)
            if not info:
                return None
            index = repr(info.get("index"))
            if index not in self._textures:
                self._textures[index] = None
                self._textures[index] = read_texture(self.document, info)
            texture = self._textures[index]
            return None if texture is None else (texture, texture_coordinates(self.document, primitive, info, count))
        except ImportError as error:
            # Once, however many textures there are.
            note = f"textures say nothing of what surfaces are made of without Pillow ({error})"
            self.notes = [f"{note}: pip install 'wrinklecli[preview]'"]
            return None
        except _MALFORMED as error:
            self.notes.append(f"a texture says nothing of what the surface is made of, as it cannot be read: {error}")
            return None


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _spread(weights: Floats) -> Ints:
    """(points,) triangles in proportion to their weights."""
    bounds = np.cumsum(weights)
    at = (np.arange(_POINTS) + 0.5) / _POINTS * bounds[-1]
    return np.asarray(np.minimum(np.searchsorted(bounds, at), len(weights) - 1))


@cache
def _evenly_spread(count: int) -> Floats:
    """(count, 3) barycentric coordinates that are evenly spread, by `PLASTIC` and folded."""
    u, v = (np.arange(1, count + 1)[:, None] * [PLASTIC, PLASTIC**2] % 1.0).T
    outside = u + v > 1.0
    u, v = np.where(outside, 1.0 - u, u), np.where(outside, 1.0 - v, v)
    return np.stack([1.0 - u - v, u, v], axis=1)


def _looked_up(picture: tuple[Texture, Floats], shares: Floats, corners: Ints) -> Bytes:
    """(points, channels) stored values at (points, 3) shares of (points, 3) corners."""
    texture, coordinates = picture
    numbers = pixels_at(texture, np.einsum("pk,pkc->pc", shares, coordinates[corners]))
    return texture.pixels.reshape(-1, texture.pixels.shape[2]).take(numbers, axis=0)
