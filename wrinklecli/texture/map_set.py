"""Shapes on a texture that share maps, as no texel has two of them, and the images that hold them."""

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np

from wrinklecli.choices import MapKind
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.pixels import png_of
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values, flags_of, unit
from wrinklecli.texture.map_files import image_name
from wrinklecli.texture.texels import gutter

GUTTER = 8
"""Texels by which charts are widened: bilinear filters and the first mip levels read beyond borders."""

# Share of a shape's greatest height below which it does not count as being at a texel: where bumps meet, both are 0.
_PRESENT = 0.02
# Texels on which another shape may be without the two being kept apart: a line between two bumps.
_TOUCHING = 0.02
# The values of 16 bits that stand for no height, and for white.
_ZERO, _WHITE = 32768, 65535
# Texels to the farthest one that hides the sky from another.
_REACH = 64
# Directions, texels, in which the horizon is looked for.
_WAYS = [way for way in product((-1, 0, 1), repeat=2) if any(way)]
# Steps along each, texels, two of which double the way: a furrow of a few hundred texels has its walls within them.
_REACHES = distinct_values(np.round(np.sqrt(2.0 ** np.arange(2 * np.log2(_REACH) + 1))).astype(np.intp)).tolist()


@dataclass(frozen=True, slots=True)
class Shown:
    """One weight's shape on a texture.

    Attributes:
        target: The name of its weight.
        tool: The name of its tool.
        texels: (texels,) sorted numbers of the texels that it moves.
        heights: (texels,) scene units at weight 1.
        slopes: (texels, 2) as those of a `Relief`.
    """

    target: str
    tool: str
    texels: Ints
    heights: Floats
    slopes: Floats

    @property
    def shares(self) -> Floats:
        """(texels,) heights over the tallest."""
        sizes = np.abs(self.heights)
        return np.asarray(sizes / sizes.max())

    @property
    def present(self) -> Ints:
        """The texels where it counts as being there."""
        return self.texels[self.shares > _PRESENT]


@dataclass(frozen=True, slots=True)
class MapSet:
    """Shapes that share maps, as no texel has two of them.

    Attributes:
        shown: The shapes.
        charts: (size²,) the triangle under each texel, −1 for none.
        steps: (triangles, 2, 3) steps of a texel to the right and down on the surface, scene units.
    """

    shown: list[Shown]
    charts: Ints
    steps: Floats

    def encoded(self, owner: str, number: int, size: int, kinds: Sequence[MapKind], files: dict[str, bytes]) -> Json:
        """Write the images into `files`, and describe them."""
        name = partial(image_name, owner, number)
        heights, slopes = np.zeros(size**2), np.zeros((size**2, 2))
        largest, holder = np.zeros(size**2), np.full(size**2, -1, np.int16)
        filled = self.charts >= 0
        for which, each in enumerate(self.shown):
            heights[each.texels] += each.heights
            slopes[each.texels] += each.slopes
            filled[each.texels] = True
            more = each.shares > largest[each.texels]
            largest[each.texels[more]], holder[each.texels[more]] = each.shares[more], which
        beside, nearest = gutter(filled.reshape(size, size), GUTTER)

        def image(values: Floats) -> Floats:
            values[beside] = values[nearest]
            return values.reshape(size, size, *values.shape[1:])

        said: Json = {}
        if "normal" in kinds:
            normals = unit(np.column_stack([slopes, np.ones(size**2)]))
            files[name("normal")] = png_of(np.rint(image(127.5 + 127.5 * normals)).astype(np.uint8))
            said["normal"] = name("normal")
        if "height" in kinds:
            limit = float(np.abs(heights).max())
            stored = np.rint(image(_ZERO + (_WHITE - _ZERO) * heights / limit)).astype(np.uint16)
            files[name("height")] = png_of(stored)
            scale = limit * _WHITE / (_WHITE - _ZERO)
            said["height"] = {"file": name("height"), "zero": _ZERO / _WHITE, "scale": scale}
        if "ao" in kinds:
            files[name("ao")] = png_of(np.rint(255.0 * image(self._seen(heights, size))).astype(np.uint8))
            said["ao"] = name("ao")
        said["weights"] = []
        for start in range(0, len(self.shown), 4):
            part = self.shown[start : start + 4]
            mask = name(f"mask_{1 + start // 4}")
            if len(self.shown) > 1:
                # A channel of transparency only where there are four: viewers show such images as nearly nothing.
                channels = range(start, start + max(len(part), 3))
                owned = np.column_stack([holder == channel for channel in channels])
                files[mask] = png_of(image(np.where(owned, 255.0, 0.0)).astype(np.uint8))
            for channel, each in zip("rgba", part, strict=False):
                masked = {"mask": mask, "channel": channel} if len(self.shown) > 1 else {}
                said["weights"].append({"target": each.target, "tool": each.tool, **masked})
        return said

    def _seen(self, heights: Floats, size: int) -> Floats:
        """(size²,) the occlusion of (size²,) heights."""
        seen = np.ones((size, size))
        rows, columns = np.divmod(np.flatnonzero(heights), size)
        # Beyond the reach of the wrinkles all is seen.
        window = tuple(
            slice(max(int(each.min()) - _REACH, 0), int(each.max()) + _REACH + 1) for each in (rows, columns)
        )
        charts = self.charts.reshape(size, size)[window]
        raised = heights.reshape(size, size)[window]
        seen[window] = occlusion(raised, self.steps[charts], charts >= 0)
        return seen.reshape(-1)


def packed(shown: Sequence[Shown], size: int) -> list[list[Shown]]:
    """Put shapes into as few groups as first fit finds, so that those of a group meet on lines at most."""
    groups: list[tuple[list[Shown], Bools]] = []
    for each in shown:
        present = each.present
        for group, taken in groups:
            if taken[present].sum() <= _TOUCHING * len(present):
                group.append(each)
                taken[present] = True
                break
        else:
            taken = flags_of(present, size**2)
            groups.append(([each], taken))
    return [group for group, _ in groups]


def occlusion(heights: Floats, steps: Floats, filled: Bools) -> Floats:
    """(rows, columns) share of a cosine-weighted sky that wrinkles let a texel see; 1 where nothing rises.

    Along a direction with its horizon at an elevation e above the surface, a share of cos² e is seen.

    Args:
        heights: (rows, columns) scene units.
        steps: (rows, columns, 2, 3) steps of a texel to the right and down on the surface, scene units.
        filled: (rows, columns) True for texels of charts; others neither see nor hide anything.
    """
    rows, columns = heights.shape
    seen = np.zeros(heights.shape)
    for right, below in _WAYS:
        length = np.linalg.norm(right * steps[:, :, 0] + below * steps[:, :, 1], axis=2)
        rise = np.zeros(heights.shape)
        for reach in _REACHES:
            x, y = right * reach, below * reach
            if abs(x) >= columns or abs(y) >= rows:
                break
            to = slice(max(-y, 0), rows - max(y, 0)), slice(max(-x, 0), columns - max(x, 0))
            of = slice(max(y, 0), rows - max(-y, 0)), slice(max(x, 0), columns - max(-x, 0))
            tangent = (heights[of] - heights[to]) / np.maximum(reach * length[to], 1e-30)
            rise[to] = np.where(filled[of], np.maximum(rise[to], tangent), rise[to])
        seen += 1.0 / (1.0 + rise * rise)
    return np.where(filled, seen / len(_WAYS), 1.0)
