"""A checker on skin that slides: it shows how far each place of the skin has gone, which plain skin hides."""

from dataclasses import replace

import numpy as np

from wrinklecli.character.paints import Texture
from wrinklecli.gltf.pixels import Bytes
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.preview.render import Snapshot

# Cells in the greatest slide of a picture: their edges show a tenth of it.
_CELLS = 3.0
# Greatest number of cells across the skin that slides: smaller ones flicker.
_MOST_CELLS = 40.0
# Part of the greatest slide from which skin gets the checker.
_LEAST_SLIDE = 0.01
# The two tones, 8-bit sRGB, which multiply the colour of the skin.
_TONES = (255, 196)
# Pixels of a cell: its edges are as sharp as those of the picture.
_CELL_PIXELS = 32


def _texture() -> Texture:
    """Two by two cells, which repeat."""
    tones = np.array([_TONES, _TONES[::-1]], np.uint8)
    pixels: Bytes = np.repeat(np.kron(tones, np.ones((_CELL_PIXELS, _CELL_PIXELS), np.uint8))[..., None], 3, axis=2)
    return Texture(pixels)


_CHECKER = _texture()


def checked(before: Snapshot, after: Snapshot, axes: Floats) -> tuple[Snapshot, Snapshot]:
    """Draw a checker on the triangles that have slid from one snapshot to another, in place of their texture.

    It is straight where nothing has slid, as seen along (3, 3) the rows of a camera: right, up and backwards. The
    snapshots have the same triangles.
    """
    slides = np.linalg.norm(after.corners - before.corners, axis=2).max(axis=1)
    greatest = float(slides.max(initial=0.0))
    if not greatest > 0:
        return before, after
    chosen = np.flatnonzero(slides > _LEAST_SLIDE * greatest)
    places = before.corners[chosen] @ axes[:2].T
    cell = max(greatest / _CELLS, float(np.ptp(places.reshape(-1, 2), axis=0).max()) / _MOST_CELLS)
    coordinates, numbers = after.coordinates.copy(), after.texture_numbers.copy()
    coordinates[chosen] = (places - places.reshape(-1, 2).mean(axis=0)) / (2.0 * cell)
    numbers[chosen] = len(after.textures)
    textures = (*after.textures, _CHECKER)
    one, other = (
        replace(each, coordinates=coordinates, texture_numbers=numbers, textures=textures) for each in (before, after)
    )
    return one, other
