"""The demand of a path: how much its control curve must take up for the skin to keep its length in a bend.

The control curve keeps its length above a straight line. Skin on the inside of a bend is no straight line: heights
above a concave line make it shorter, linear blend skinning shrinks heights there, the distance of two anchors cuts the
corners of the skin between them, and edges of the mesh cut the corners of wrinkles. So the joint below a path is
turned, the length of the path's line is measured under wrinkles of all heights, and the curve takes up as much as keeps
the line as long as it was. Above a straight line of short edges this equals the shortening itself: there, and where
nothing bends, the curve is exact without a demand.

The demand is measured twice. `demand_of` knows only the coarse surface and takes wrinkles for smooth; its result tells
the tool's greatest height before the mesh is refined. `demanding` then measures the line on which the path cuts the
refined mesh.

Not in the paper, whose tools are straight; straight tools have no demand.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import blend, node_matrices, transform
from wrinklecli.character.rig import Rig
from wrinklecli.character.skin import Influences, SkinnedMesh, skinned_mesh
from wrinklecli.character.surface import Surface
from wrinklecli.drive.stored import TAUT
from wrinklecli.effects.wrinkle.bending import MOMENTS, bent_node, turns_of
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.curve import ControlCurve
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats, Ints, children, inverses, renumbered, singular, unit
from wrinklecli.numeric.intersections import edges_of
from wrinklecli.surface.path import Curve
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph

# Least and greatest u of a joint that bends a path: a joint beside an end turns all of it.
_BETWEEN = (0.1, 0.9)
# The line uses every second sample of a path.
_EVERY = 2
# Points of the line per control interval: the length that wrinkles add is right to 1e-3.
_POINTS = 16
# Wrinkles under which the line is measured: square roots of the fraction of the rest length that they take up.
_TRIED = np.linspace(0.0, 0.985, 65)
# Least approach of the ends from one row of the demand to the next, as a fraction of the rest length.
_LEAST_STEP = 1e-4
# Least number of edges per control interval of a mesh that shows its bumps. With fewer, crests are missed, and the
# higher bumps that this would ask for are spikes.
_LEAST_EDGES = 2.0


def demand_of(patch: Patch, surface: Surface, rest: Rest, rig: Rig) -> Floats | None:
    """(2, rows) `ControlCurve.demand` for smooth wrinkles; None for straight tools and paths that no joint bends.

    The patch's members are not read.
    """
    path = patch.path
    if not isinstance(path, Curve) or isinstance(patch.tool.rest_length, RestLengthKeys | RestLengthMorph):
        return None
    node = bent_node(patch, rig)
    if node is None:
        return None
    place = node_matrices(rig, None, np.zeros(1), [node])[0, 0, :3, 3]
    if not _BETWEEN[0] < path.locate(place).u < _BETWEEN[1]:
        return None
    line = _Line.of_path(patch, path, surface, rest, rig)
    return None if line is None else _demand(patch, line, rig)


def demanding(carried: CarriedPatch, fine: Refinement, rig: Rig) -> CarriedPatch:
    """Replace a tool's demand by that of the refined mesh, whose edges cut corners.

    The demand for smooth wrinkles stays if the tool is projected in each frame, or the mesh is too coarse for the
    tool's bumps.
    """
    patch = carried.patch
    if patch.curve.demand is None or carried.ring is not None:
        return carried
    line = _Line.of_mesh(carried, fine, rig)
    demand = None if line is None else _demand(patch, line, rig)
    if demand is None:
        return carried
    return replace(carried, patch=replace(patch, curve=replace(patch.curve, demand=demand)))


def _demand(patch: Patch, line: "_Line", rig: Rig) -> Floats | None:
    """(2, rows) demand of a line in the tool's bend; None if there is none."""
    times, motion, shares = _bend(patch, rig)
    if not len(times):
        return None
    curve = _unlimited(patch.curve)
    lengths = np.full(len(_TRIED), curve.rest_length)
    amplitudes, _ = curve.follow((1.0 - _TRIED**2) * lengths, lengths)
    heights = line.heights(amplitudes)
    wanted = line.rest_length * curve.rest_length / patch.span
    roots, asked = [0.0], [0.0]
    for points, directions, share in zip(*line.posed(motion, times), shares, strict=True):
        found = np.maximum.accumulate(line.lengths(points, directions, heights))
        # There is no demand if the line is long enough without wrinkles, or if no wrinkles make it long enough.
        if found[0] < wanted < found[-1]:
            roots.append(float(np.sqrt(share)))
            asked.append(max(asked[-1], float(np.interp(wanted, found, _TRIED))))
    if len(roots) == 1:
        return None
    return np.array([[*roots, np.sqrt(TAUT)], [*asked, np.sqrt(TAUT)]])


def _unlimited(curve: ControlCurve) -> ControlCurve:
    """The curve for incompressible tissue, whose bumps have no greatest height unless they rise one after another."""
    height = np.inf if len(curve.groups) == 1 else curve.max_height
    return replace(curve, compressible=0.0, max_height=height, demand=None)


def _bend(patch: Patch, rig: Rig) -> tuple[Floats, Clip, Floats]:
    """The turn that brings a tool's ends together, as far as it does.

    Returns:
        (rows,) times, the motion, and (rows,) sorted fractions of the rest length by which the ends approach.
    """
    times = np.linspace(0.0, 1.0, MOMENTS)
    turns = turns_of(patch, rig)
    every = []
    for motion in turns:
        distances, lengths, *_ = patch.segment.lengths(rig, motion, times)
        every.append(np.maximum(TAUT - distances / lengths, 0.0))
    chosen = int(np.argmax([shares.max() for shares in every]))
    shares = every[chosen]
    rising = np.flatnonzero(np.diff(np.maximum.accumulate(shares), prepend=0.0) > _LEAST_STEP)
    return times[rising], turns[chosen], shares[rising]


@dataclass(frozen=True, slots=True)
class _Line:
    """The line of the surface under a path: points mixed from a few vertices, which joints move and wrinkles raise.

    Attributes:
        mesh: The vertices, without triangles that matter.
        directions: (vertices, 3) displacement for a height of 1, bind space.
        shapes: (groups, modes, vertices) heights per unit of amplitude.
        rest_points: (vertices, 3) world space at rest.
        corners: (points, k) vertices from which each point is mixed.
        shares: (points, k) weight of each; a row sums to 1.
    """

    mesh: SkinnedMesh
    directions: Floats
    shapes: Floats
    rest_points: Floats
    corners: Ints
    shares: Floats

    @classmethod
    def of_path(cls, patch: Patch, path: Curve, surface: Surface, rest: Rest, rig: Rig) -> "_Line | None":
        """The line below a path at rest, under smooth wrinkles; None if its blended matrices are singular."""
        feet = [rest.closest_point(point)[:2] for point in path.points[::_EVERY]]
        corners = surface.triangles[[triangle for triangle, _ in feet]]
        barycentrics = np.stack([found for _, found in feet])
        # The line is straight between the path's samples.
        places = path.arc_lengths[::_EVERY] / path.length
        us = np.linspace(0.0, 1.0, _POINTS * patch.curve.interval_count + 1)
        behind = np.clip(np.searchsorted(places, us), 1, len(places) - 1)
        t = ((us - places[behind - 1]) / (places[behind] - places[behind - 1]))[:, None]

        def mixed(values: Floats) -> Floats:
            found: Floats = np.einsum("pc,pcx->px", barycentrics, values)
            return found[behind - 1] + t * (found[behind] - found[behind - 1])

        of_corners = surface.dense_weights(corners.reshape(-1), len(rig.joints)).reshape(*corners.shape, -1)
        weights = mixed(of_corners)
        blended = blend(weights, rest.matrices[None])[0]
        if singular(blended).any():
            return None
        normals = unit(mixed(rest.normals_at(corners.reshape(-1)).reshape(*corners.shape, 3)))
        positions, *deltas = (mixed(each[corners]) for each in (surface.positions, *surface.morph_deltas))
        none = np.zeros((0, 3), np.intp)
        return cls(
            mesh=skinned_mesh(rig, Influences.of(weights), positions, np.reshape(deltas, (-1, *positions.shape)), none),
            directions=np.einsum("pij,pj->pi", inverses(blended), normals),
            shapes=patch.curve.shapes(us),
            rest_points=transform(blended[None], mixed(rest.bind_positions[corners]))[0],
            corners=np.arange(len(us))[:, None],
            shares=np.ones((len(us), 1)),
        )

    @classmethod
    def of_mesh(cls, carried: CarriedPatch, fine: Refinement, rig: Rig) -> "_Line | None":
        """The line on which v = 0 cuts a refined mesh; None if its edges are too long to show the bumps."""
        patch = carried.patch
        triangles = fine.triangles[children(fine.subdivision.parents, patch.members)]
        used, edges = renumbered(edges_of(triangles))
        u, v = patch.coordinates(fine.posed_at(patch.pose, used)[0])
        longest = 1.0 / (_LEAST_EDGES * patch.curve.interval_count) * (1.0 + 1e-9)
        # There is no line where places jump from one part of the path to another.
        cut = ((v[edges] >= 0.0).sum(axis=1) == 1) & (np.abs(np.diff(u[edges], axis=1)[:, 0]) <= longest)
        edges = edges[cut]
        if len(edges) < 2:
            return None
        second = v[edges[:, 0]] / (v[edges[:, 0]] - v[edges[:, 1]])
        shares = np.stack([1.0 - second, second], axis=1)
        us = np.sum(shares * u[edges], axis=1)
        order = np.argsort(us, kind="stable")
        us, edges, shares = us[order], edges[order], shares[order]
        inside = (us > 0.0) & (us < 1.0)
        ends = [_between(us, edges, shares, end) for end in (0.0, 1.0)]
        pad = ((0, 0), (0, 2))
        corners = np.concatenate([ends[0][0], np.pad(edges[inside], pad), ends[1][0]])
        shares = np.concatenate([ends[0][1], np.pad(shares[inside], pad), ends[1][1]])
        if np.diff(np.sum(shares * u[corners], axis=1), prepend=0.0, append=1.0).max() > longest:
            return None
        directions, shapes = np.zeros((len(used), 3)), np.zeros((*patch.curve.greatest_amplitudes.shape, len(used)))
        at = np.flatnonzero(np.isin(used, carried.vertices))
        moved = np.searchsorted(carried.vertices, used[at])
        directions[at] = carried.directions[moved] / patch.shape_strength
        shapes[..., at] = carried.shapes[..., moved]
        return cls(
            mesh=fine.skinned(rig, used),
            directions=directions,
            shapes=shapes,
            rest_points=fine.rest_positions[used],
            corners=corners,
            shares=shares,
        )

    @property
    def rest_length(self) -> float:
        """Length at rest, scene units."""
        points = np.einsum("pk,pkx->px", self.shares, self.rest_points[self.corners])
        return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())

    def heights(self, amplitudes: Floats) -> Floats:
        """(points, tried, k) heights of each point's vertices under (tried, groups, modes) amplitudes, scene units."""
        of_vertices: Floats = np.einsum("tgm,gmv->vt", amplitudes, self.shapes)
        return of_vertices[self.corners].transpose(0, 2, 1)

    def posed(self, motion: Clip, times: Floats) -> tuple[Floats, Floats]:
        """(frames, vertices, 3) positions at (frames,) seconds of a motion, and directions, both in world space."""
        positions, matrices = self.mesh.carried(motion, times)
        return positions, np.einsum("fvij,vj->fvi", matrices, self.directions)

    def lengths(self, points: Floats, directions: Floats, heights: Floats) -> Floats:
        """(tried,) lengths of the line under `heights`, from (vertices, 3) posed points and directions, scene units."""
        shares = self.shares[..., None]
        ground = (shares * points[self.corners]).sum(axis=1)
        raised = np.matmul(heights, shares * directions[self.corners])
        steps = np.diff(ground[:, None] + raised, axis=0)
        return np.asarray(np.sqrt(np.einsum("ptx,ptx->pt", steps, steps)).sum(axis=0), np.float64)


def _between(us: Floats, edges: Ints, shares: Floats, u: float) -> tuple[Ints, Floats]:
    """(1, 4) vertices and weights of the point at u on a line of (cuts,) sorted us, or of the line's nearest end."""
    behind = int(np.clip(np.searchsorted(us, u), 1, len(us) - 1))
    t = float(np.clip((u - us[behind - 1]) / max(us[behind] - us[behind - 1], TINY), 0.0, 1.0))
    mixed = np.concatenate([(1.0 - t) * shares[behind - 1], t * shares[behind]])
    return np.concatenate([edges[behind - 1], edges[behind]])[None], mixed[None]
