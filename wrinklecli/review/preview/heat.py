"""Show as a colour what folds a surface, and how it folds.

Compression says how much shorter each place is than in the stored pose; crests and furrows are where wrinkles rise and
sink.
"""

import numpy as np

from wrinklecli.character.paints import Colour
from wrinklecli.character.scene import ScenePrimitive
from wrinklecli.character.weld import weld
from wrinklecli.gltf.pixels import linear_rgb
from wrinklecli.numeric.arrays import Floats, Ints, face_normals
from wrinklecli.numeric.membrane import stretches

# Compression, which is 1 minus the smallest principal stretch, and its colour, sRGB. Darker is more.
HEAT: tuple[tuple[float, Colour], ...] = (
    (0.0, (0.84, 0.84, 0.82)),
    (0.1, (0.98, 0.90, 0.55)),
    (0.25, (0.98, 0.62, 0.22)),
    (0.45, (0.85, 0.20, 0.16)),
    (0.65, (0.50, 0.06, 0.36)),
    (0.8, (0.16, 0.03, 0.28)),
)
# Compressions that a legend names.
HEAT_TICKS = np.linspace(0.0, HEAT[-1][0], 5).tolist()

# Height of a wrinkle over the greatest that has half of the colour of a crest.
_HALF = 0.05
# Colours of furrows, of what no wrinkle moves, and of crests, sRGB.
_FURROW, _STILL, _CREST = (0.10, 0.22, 0.48), HEAT[0][1], (0.98, 0.78, 0.30)


def heat_colours(losses: Floats) -> Floats:
    """(…, 3) sRGB colours of (…) compressions."""
    stops = [loss for loss, _ in HEAT]
    channels = [np.interp(losses, stops, [colour[k] for _, colour in HEAT]) for k in range(3)]
    return np.stack(channels, axis=-1)


def compressions(primitive: ScenePrimitive, positions: Floats) -> Floats:
    """(vertices,) compression against the stored pose, of (vertices, 3) world-space positions."""
    stored = primitive.positions_at(None, 0.0)
    vertices = primitive.vertices
    places = weld(vertices.positions, vertices.morph_deltas, vertices.joints, vertices.weights).points
    return _means(stored, positions, primitive.triangles, places)[places]


def crest_colours(shapes: Floats, normals: Floats) -> Floats:
    """(vertices, 3) linear RGB of crests and furrows, those of low wrinkles nearly as plain as those of high ones.

    Args:
        shapes: (shapes, vertices, 3) displacements that rise together, bind space.
        normals: (vertices, 3), bind space.
    """
    risen = np.einsum("sva,va->v", shapes, normals)
    parts = risen / (np.abs(risen) + (_HALF * float(np.abs(risen).max(initial=0.0)) or 1.0))
    colours = [np.interp(parts, (-1.0, 0.0, 1.0), ends) for ends in zip(_FURROW, _STILL, _CREST, strict=True)]
    return linear_rgb(np.stack(colours, axis=-1))


def point_colours(rest: Floats, posed: Floats, triangles: Ints) -> Floats:
    """(points, 3) linear RGB of the compression from (points, 3) rest positions to posed ones."""
    return linear_rgb(heat_colours(_means(rest, posed, triangles, np.arange(len(rest)))))


def _means(rest: Floats, posed: Floats, triangles: Ints, places: Ints) -> Floats:
    """(places,) area-weighted mean compression of the triangles around each place; `places` is (vertices,)."""
    losses = compression(rest[triangles], posed[triangles])
    areas = np.sqrt(np.sum(face_normals(rest, triangles) ** 2, axis=1))
    into = places[triangles].ravel()
    sums = np.bincount(into, np.repeat(losses * areas, 3), len(places))
    weights = np.bincount(into, np.repeat(areas, 3), len(places))
    return np.asarray(sums / np.where(weights > 0, weights, 1.0))


def compression(rest: Floats, posed: Floats) -> Floats:
    """(triangles,) 1 minus the smallest principal stretch, at least 0; 0 for a triangle without area at rest.

    `rest` and `posed` are (triangles, 3, 3) corners.
    """
    edges = rest[:, 1:] - rest[:, :1]
    solid = np.sum(np.cross(edges[:, 0], edges[:, 1]) ** 2, axis=1) > 1e-12 * np.sum(edges**2, axis=(1, 2)) ** 2
    losses = np.zeros(len(rest))
    losses[solid] = np.maximum(1.0 - np.abs(stretches(rest[solid], posed[solid])), 0.0)
    return losses
