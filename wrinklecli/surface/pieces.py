"""Cuts a surface into pieces of one colour, such as a sleeve, a hand or a belt: each is made of one substance.

Source: P. F. Felzenszwalb, D. P. Huttenlocher, *Efficient graph-based image segmentation*, IJCV 59 (2), 2004. Differs:
sizes are areas, and what is too small becomes part of the neighbour that looks most like it.
"""

import numpy as np

from wrinklecli.numeric.arrays import Floats, Ints, components, root_of
from wrinklecli.numeric.edges import Edges

# Part of a mesh's area below which a place is a part of the piece round it, such as a button, or a letter on a shirt.
_LEAST = 0.004
# Difference of colours in Oklab, beyond those within it, over which a piece of that size still grows; a larger piece
# grows over smaller ones. On 26 characters pieces mix cloth with others on 2 to 3 % of the area from 0.005 to 0.04, and
# on 5 % at 0.08.
_STEP = 0.01


def difference(one: Floats, other: Floats) -> Floats:
    """The distances of (…, 3) colours in Oklab. Shadows are painted into textures, so lightness counts half."""
    return np.asarray(np.sqrt(np.sum(((one - other) * [0.5, 1.0, 1.0]) ** 2, axis=-1)))


def pieces_of(triangles: Ints, apart: Ints, colours: Floats, areas: Floats) -> Ints:
    """Number the pieces of a surface.

    Args:
        triangles: (triangles, 3) welded vertices.
        apart: (triangles,) numbers, such as that of the primitive; those of a piece are equal.
        colours: (triangles, 3) in Oklab.
        areas: (triangles,) areas.

    Returns:
        (triangles,) the piece of each.
    """
    edges = Edges.of(triangles)
    links = np.stack([edges.one // 3, edges.other // 3], axis=1)
    links = links[apart[links[:, 0]] == apart[links[:, 1]]]
    least = _LEAST * float(areas.sum())
    pieces = _grown(links, difference(*colours[links.T]), areas, _STEP * least)
    while True:
        sizes = np.asarray(np.bincount(pieces, areas), np.float64)
        means = np.stack([np.bincount(pieces, areas * each) for each in colours.T], axis=1) / sizes[:, None]
        joined = _absorbed(pieces[links], means, sizes, least)
        if not len(joined):
            return pieces
        pieces = components(joined, len(sizes))[pieces]


def _grown(links: Ints, steps: Floats, areas: Floats, scale: float) -> Ints:
    """(triangles,) the pieces after each link, the smallest step first, has joined two that differ as little within."""
    roots, sizes, most = list(range(len(areas))), areas.tolist(), (scale / areas).tolist()

    order = np.argsort(steps, kind="stable")
    for (one, other), step in zip(links[order].tolist(), steps[order].tolist(), strict=True):
        first, second = root_of(roots, one), root_of(roots, other)
        if first != second and step <= most[first] and step <= most[second]:
            roots[second] = first
            sizes[first] += sizes[second]
            most[first] = step + scale / sizes[first]
    return np.unique([root_of(roots, each) for each in range(len(areas))], return_inverse=True)[1].reshape(-1)


def _absorbed(borders: Ints, colours: Floats, sizes: Floats, least: float) -> Ints:
    """(joined, 2) the pieces that are too small, and for each the larger neighbour with the nearest colour."""
    pairs = np.concatenate([borders, borders[:, ::-1]])
    small, large = pairs.T
    # Of equal ones the later counts as the larger.
    grows = (sizes[large] > sizes[small]) | ((sizes[large] == sizes[small]) & (large > small))
    pairs = pairs[(sizes[small] < least) & grows]
    small, large = pairs.T
    pairs = pairs[np.lexsort((large, difference(colours[small], colours[large]), small))]
    return np.asarray(pairs[np.flatnonzero(np.diff(pairs[:, 0], prepend=-1))])
