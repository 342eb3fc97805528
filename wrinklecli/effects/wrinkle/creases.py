"""Lowers wrinkles in creases, where a joint folds the surface more sharply than a bump is wide.

On the inside of a fold, normals lean towards each other. Vertices that rise along them by h come nearer to each other
by a fraction κh of their distance, where κ is the curvature of the folded surface. From κh = 1 on, triangles turn over,
which shows as teeth and dark tiles. So wrinkles are lower where κh becomes large while a joint bends the tool, whatever
clips there are, and rise again over half a bump to either side: a crease keeps low, clean wrinkles. Morph targets bend
no normals, so they make no crease.

Not in the paper, which moves the vertices of posed surfaces along their normals everywhere, as `creases: keep` does.
"""

import numpy as np

from wrinklecli.character.pose import blend
from wrinklecli.character.rig import Rig
from wrinklecli.effects.wrinkle.bending import bent_nodes, carried_by
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, bilinear, bounded, children, cross, dot, renumbered
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.materials import PLAIN_HEIGHT
from wrinklecli.tools.records import RestLengthMorph

# κh from which heights are lowered: together with their own slopes, wrinkles turn over before κh is 1.
_MOST_NEARER = 0.35
# Factor on the height in the sharpest creases: there is still a wrinkle.
_LEAST_FACTOR = 0.2
# Loss of height that nobody sees.
_LEAST_LOSS = 0.02
# Cosine of a displacement and the folded surface's normal that counts like `_MOST_NEARER`: a coarse triangle in a
# crease turns away from what it carries, without a curvature of its own. Below 0 the fold turns it inside out.
_OBLIQUE = 0.25
# Least such cosine that is told from 0.
_LEAST_COSINE = 1e-3
# κh at the corners of a coarse triangle up to which its inside is smooth too.
_SMOOTH = 0.1
# Angles by which the joint turns: limbs bend by 90° in the range of motion, and knees and elbows, which bend farther,
# hide their creases then.
_ANGLES = np.radians([30.0, 60.0, 90.0])
# Cells of the map of losses along a control interval, and the most cells along either side of the map.
_CELLS = 4
_MOST_CELLS = 256
# Margin of the map round the patch, over its length and its half width.
_MARGIN = 0.2
# Cells to either side over which a loss stays as it is, and the standard deviation, cells, of the bell by which it
# fades farther on: half a bump in all.
_SPREAD = 2
_FADING = 2.0


@dataclass(frozen=True, slots=True)
class _Points:
    """Points of coarse triangles.

    Attributes:
        triangles: (triangles, 3) indices into the vertices that are posed.
        which: (points,) the triangle of each point.
        within: (points, 3) its barycentric coordinates there.
    """

    triangles: Ints
    which: Ints
    within: Floats


def creased(carried: CarriedPatch, fine: Refinement, rest: Rest, rig: Rig) -> CarriedPatch:
    """Lower the wrinkles of a tool in creases; the tool itself if no joint makes one, or it keeps its height there.

    Strengths, masks and keys have nothing to do with it: they multiply or raise what is left.
    """
    patch, vertices = carried.patch, carried.vertices
    if not patch.shape_strength or patch.tool.creases == "keep":
        return carried
    positions, normals = fine.posed_at(rest, vertices)
    u, v = patch.coordinates(positions)
    nearer = _nearer(carried, fine, rest, rig, patch.share(u, v, patch.cosines(u, normals)))
    losses = 1.0 - np.maximum(bounded(nearer / _MOST_NEARER), _LEAST_FACTOR)
    if losses.max() < _LEAST_LOSS:
        return carried
    return faded(carried, losses, np.stack([u, v], axis=1))


def faded(carried: CarriedPatch, losses: Floats, places: Floats) -> CarriedPatch:
    """Lower the wrinkles of a tool by (vertices,) losses from 0 to 1, smoothly over half a bump to either side.

    `places` are (vertices, 2) u and v at rest.
    """
    return carried.times(1.0 - _spread(losses, places, carried.patch))


def _nearer(carried: CarriedPatch, fine: Refinement, rest: Rest, rig: Rig, shares: Floats) -> Floats:
    """(vertices,) greatest κh of a tool's vertices, or what counts like it where a fold turns the surface away.

    A vertex rises by its (vertices,) share of the height of the tallest bump.
    """
    patch, parents = carried.patch, fine.subdivision.parents
    nearer = np.zeros(len(carried.vertices))
    used, corners = renumbered(fine.surface.triangles[patch.members])
    folds = _folds(patch, fine, rest, rig, used)
    if not len(folds):
        return nearer
    vectors, at_rest = (fine.bind_positions[used], fine.raising_at(used)), fine.blended_at(fine.rest, used)
    # Bumps that are higher than those of `max_height: auto` are steeper, and their flanks turn over first.
    height = min(patch.curve.greatest_height, PLAIN_HEIGHT * patch.bump_width)

    def greatest(points: _Points) -> Floats:
        """(points,) greatest κh of points that rise like the tallest bump."""
        _, cosines = _curvatures(points, at_rest, *vectors)
        outward = np.where(cosines < 0.0, -1.0, 1.0)
        found = np.zeros(len(points.which))
        for fold in folds:
            curvatures, cosines = _curvatures(points, fold, *vectors)
            oblique = _MOST_NEARER * _OBLIQUE / np.maximum(outward * cosines, _LEAST_COSINE)
            found = np.maximum(found, np.maximum(curvatures * height, oblique))
        return found

    at_corners = _Points(corners, np.repeat(np.arange(len(corners)), 3), np.tile(np.eye(3), (len(corners), 1)))
    sharp = np.flatnonzero((greatest(at_corners).reshape(-1, 3) * shares.max() > _SMOOTH).any(axis=1))
    rows = children(parents, patch.members[sharp])
    which = np.repeat(np.searchsorted(patch.members[sharp], parents[rows]), 3)
    # A vertex is looked at in each of its coarse triangles, so that their order in the file changes nothing.
    looks, firsts = np.unique(fine.triangles[rows].ravel() * len(sharp) + which, return_index=True)
    vertices = looks // max(len(sharp), 1)
    moved = np.isin(vertices, carried.vertices, kind="table")  # else it imports `numpy.ma`
    vertices, firsts = vertices[moved], firsts[moved]
    points = _Points(corners[sharp], which[firsts], fine.subdivision.barycentrics_of(rows).reshape(-1, 3)[firsts])
    at = np.searchsorted(carried.vertices, vertices)
    np.maximum.at(nearer, at, greatest(points) * shares[at])
    return nearer


def _folds(patch: Patch, fine: Refinement, rest: Rest, rig: Rig, vertices: Ints) -> Floats:
    """(angles, vertices, 3, 4) bind to world space while all joints that bend a tool turn together; empty without.

    Both thighs below a skirt are raised when someone sits down; one alone folds less of it.
    """
    bent = [] if isinstance(patch.tool.rest_length, RestLengthMorph) else bent_nodes(patch, rig)
    matrices = np.repeat(rest.matrices[None], len(_ANGLES), axis=0)
    turned = [_turned(matrices, patch, rest, rig, node) for node in bent if node in rig.joints]
    if not any(turned):
        return np.zeros((0, len(vertices), 3, 4))
    weights = fine.surface.dense_weights(vertices, len(rig.joints))
    acting = np.flatnonzero(weights.any(axis=0))
    return blend(weights[:, acting], matrices[:, acting])


def _turned(matrices: Floats, patch: Patch, rest: Rest, rig: Rig, node: int) -> bool:
    """Turn a joint and what hangs on it in (angles, joints, 4, 4) matrices, if that brings the tool's ends together."""
    number = int(np.flatnonzero(rig.joints == node)[0])
    centre = (rest.matrices[number] @ np.linalg.inv(rig.inverse_binds[number]))[:3, 3]
    below = rig.joints_below[number]
    shares = [carried_by(anchor, rig).get(node, 0.0) for anchor in patch.anchors]
    ends = np.array([anchor.position for anchor in patch.anchors])
    axis = np.stack(cross(patch.along, patch.normal))
    lengths = []
    for way in (axis, -axis):
        turned = (ends - centre) @ _turn(way, _ANGLES[0])[:3, :3].T + centre
        moved = ends + np.array(shares)[:, None] * (turned - ends)
        lengths.append(float(np.linalg.norm(np.diff(moved, axis=0), axis=1).sum()))
    if min(lengths) >= patch.span:
        return False
    turns = np.stack([_turn(axis if lengths[0] <= lengths[1] else -axis, angle) for angle in _ANGLES])
    turns[:, :3, 3] = centre - turns[:, :3, :3] @ centre
    matrices[:, below] = turns[:, None] @ rest.matrices[below]
    return True


def _turn(axis: Floats, angle: float) -> Floats:
    """(4, 4) turn about a unit axis through the origin."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn = np.eye(4)
    turn[:3, :3] += np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return turn


def _curvatures(points: _Points, blended: Floats, positions: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """Measure a posed surface at points; triangles are curved, as skin weights change along them.

    Args:
        points: The points.
        blended: (vertices, 3, 4) bind to world space.
        positions: (vertices, 3) bind space.
        directions: (vertices, 3) displacement for a height of 1, bind space.

    Returns:
        (points,) greatest curvature of the hollow there, or 0 if there is none; and (points,) cosine of the normal and
        the displacement.
    """
    # Coordinate by coordinate, as `einsum` takes ten times as long along axes of three.
    corners, within = points.triangles.T, points.within.T
    columns = blended.transpose(2, 1, 0).take(corners, axis=2)
    places, directions = (each.T.take(corners, axis=1)[:, None] for each in (positions, directions))

    def at_points(values: Floats) -> Floats:
        """(3, points) of (3, corners, triangles) values, linear in a point's coordinates."""
        return dot(within[:, None], values.transpose(1, 0, 2).take(points.which, axis=2))

    # Rates of change of place and displacement along two sides of a triangle are linear, too.
    up = at_points(dot(columns[:3], directions))
    rates: list[Floats] = []
    for end in (1, 2):
        change = (columns[:, :, end] - columns[:, :, 0])[:, :, None]
        for vectors, offset in ((places, change[3]), (directions, 0.0)):
            rate = dot(columns[:3], vectors[:, :, end, None] - vectors[:, :, 0, None])
            rate += dot(change[:3], vectors)
            rates.append(at_points(rate + offset))
    side, lean, other_side, other_lean = rates
    # First and second fundamental form, which give the principal curvatures.
    first = dot(side, side), dot(side, other_side), dot(other_side, other_side)
    second = dot(side, lean), (dot(side, other_lean) + dot(other_side, lean)) / 2.0, dot(other_side, other_lean)
    area = first[0] * first[2] - first[1] ** 2
    area = np.where(area > 0.0, area, np.inf)
    mean = (second[0] * first[2] - 2.0 * second[1] * first[1] + second[2] * first[0]) / (2.0 * area)
    product = (second[0] * second[2] - second[1] ** 2) / area
    hollow = np.sqrt(np.maximum(mean**2 - product, 0.0)) - mean
    normal = cross(side, other_side)
    lengths = np.sqrt(dot(normal, normal) * dot(up, up))
    return np.maximum(hollow, 0.0), dot(normal, up) / np.where(lengths > 0.0, lengths, np.inf)


def _spread(losses: Floats, places: Floats, patch: Patch) -> Floats:
    """(points,) losses of height that are smooth and nowhere much less than (points,) losses at (points, 2) u and v."""
    sides = np.array([patch.span, patch.half_width])
    extent = np.array([1.0 + 2.0 * _MARGIN, 2.0 + 2.0 * _MARGIN]) * sides
    cell = max(patch.span / (patch.curve.interval_count * _CELLS), float(extent.max()) / _MOST_CELLS)
    counts = np.ceil(extent / cell).astype(np.intp) + 1
    cells = np.clip((places + np.array([_MARGIN, 1.0 + _MARGIN])) * sides / cell, 0.0, counts - 1.0)
    grid = np.zeros(counts)
    np.maximum.at(grid, tuple(np.rint(cells).astype(np.intp).T), losses)
    return bilinear(_softened(grid), cells)


def _softened(grid: Floats) -> Floats:
    """Spread the values of a map to all sides, and let them fade."""
    reach = round(3.0 * _FADING)
    steps = range(-reach, reach + 1)
    bell = np.exp(-0.5 * (np.array(steps) / _FADING) ** 2)
    for axis in (0, 1):
        grid = np.max([_moved(grid, step, axis) for step in range(-_SPREAD, _SPREAD + 1)], axis=0)
    for axis in (0, 1):
        parts = (part * _moved(grid, step, axis) for part, step in zip(bell / bell.sum(), steps, strict=True))
        grid = sum(parts, np.zeros(grid.shape))
    return grid


def _moved(grid: Floats, step: int, axis: int) -> Floats:
    """A map that is moved by some cells along an axis; its border repeats."""
    count = grid.shape[axis]
    return np.take(grid, np.clip(np.arange(count) - step, 0, count - 1), axis=axis)
