"""Refines a surface once, in bind space, until the triangles under each region can show its displacement.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on mesh refinement. Differs: the paper
refines the posed mesh on the fly; here refinement acts once and before skinning, so that the skeleton survives. Edges
are compared with half an interval of the region (by default: `edges_per_interval: 2`), where the paper compares them
with one. Edges are not split where hardly any of the displacement remains.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from wrinklecli.character.pose import transform
from wrinklecli.character.rig import Rig
from wrinklecli.character.skin import Influences, SkinnedMesh, skinned_mesh
from wrinklecli.character.surface import Surface
from wrinklecli.choices import Scheme
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    KnownRows,
    VertexFaces,
    any_of,
    children,
    components,
    diagonal,
    distinct,
    distinct_values,
    flags_of,
    inverses,
    renumbered,
    unit,
    vertex_normals,
)
from wrinklecli.numeric.collapses import collapse_edges
from wrinklecli.numeric.edges import turn_diagonals
from wrinklecli.numeric.memory import MAX_VERTICES
from wrinklecli.numeric.red_green import Level
from wrinklecli.numeric.subdivide import Subdivision, subdivide
from wrinklecli.surface.prune import Poses, forbidden_splits, joint_distances, prune, spread_weights
from wrinklecli.surface.region import Region, Steps, members_of
from wrinklecli.surface.rest import Rest, carried_normals
from wrinklecli.surface.rounding import LaidSurface, hard_edges, rounded
from wrinklecli.tools.records import RefinementSettings

# Fraction of a region's greatest displacement above which a displacement is visible.
_LEAST_SHOWN = 0.01
# Factor by which edges across a sharp furrow are shorter than others: as for 3 edges an interval in place of 2.
_FURROWED = 1.5
# Factor by which edges across a border of a mask are shorter than others: its teeth are as high as the bump.
_BORDERED = 3.0
# Part of the greatest displacement by which a face may depart from what a mask leaves: one sees a tenth of a bump.
_MASK_ERROR = 0.1
# Power of the fraction of the displacement by which edges are longer. An error of normals is in proportion to the
# fraction and the square of the length, which gives 1/2; but edges along the fading side must also show how it fades.
_FADING = 0.25
# Bits of a triangle that meets a region, as `np.packbits` fills them from the left.
_ALL_BORDERS = 0b11110000
# Fraction of the displacement below which edges do not become longer: there they are 1.5 times as long, so that none
# across a furrow is longer than edges elsewhere. On the side of a wrist, longer ones turn normals by more than 10°.
_LEAST_SHARE = 0.2
# Visible departure of the refined surface from the old one at rest, over the greatest displacement.
_DEPARTURE = 0.3


@dataclass(frozen=True)
class Refinement:
    """A surface refined under its regions. New vertices follow the old ones, both among welded and glTF vertices.

    Attributes:
        rest: The rest pose of the coarse surface.
        positions: (vertices, 3) stored positions, bind space.
        morph_deltas: (morph targets, vertices, 3).
        bind_positions: (vertices, 3) positions under the morph weights of the rest pose, bind space.
        rest_positions: (vertices, 3) world space at rest.
        weights: Skin weights of new vertices before pruning.
        joints_pruned: (new vertices, influences) the joints that the file can store.
        weights_pruned: (new vertices, influences).
        corners: (triangles, 3) glTF vertices.
        sources: (new glTF vertices, 3) coarse glTF vertices from which each is mixed.
        shares: (new glTF vertices, 3) weight of each source; a row sums to 1.
        primitives: (new glTF vertices,).
        weld: (glTF vertices,) the welded vertex of each.
        schemes: The scheme that places new vertices, for each region: the setting, or `midpoint` on a faceted mesh.
        hard_shares: (regions,) fraction of the region's coarse edges that are hard.
        departures: (regions,) greatest distance of new vertices from the coarse surface, over the greatest
            displacement.
    """

    surface: Surface
    rest: Rest
    subdivision: Subdivision
    positions: Floats
    morph_deltas: Floats
    bind_positions: Floats
    rest_positions: Floats
    weights: Influences
    joints_pruned: Ints
    weights_pruned: Floats
    corners: Ints
    sources: Ints
    shares: Floats
    primitives: Ints
    weld: Ints
    schemes: tuple[Scheme, ...]
    hard_shares: Floats
    departures: Floats

    def departs(self, region: int) -> bool:
        """True if refinement moves the surface at rest under a region of a number so much that one sees it."""
        return bool(self.departures[region] > _DEPARTURE)

    @cached_property
    def normals(self) -> Floats:
        """(vertices, 3) unit normals of `bind_positions`, as `normals_at` of every vertex."""
        return vertex_normals(self.bind_positions, self.triangles)

    def normals_at(self, vertices: Ints) -> Floats:
        """(chosen, 3) unit normals of `bind_positions`."""
        return self._normals.at(vertices, lambda missing: self.around.normals_at(self.bind_positions, missing))

    @cached_property
    def _normals(self) -> KnownRows:
        return KnownRows.of(len(self.positions))

    @cached_property
    def around(self) -> VertexFaces:
        """The triangles of each vertex."""
        return VertexFaces.of(self.triangles, len(self.bind_positions))

    @cached_property
    def pieces(self) -> Ints:
        """(vertices,) equal numbers for those of one connected piece of the surface."""
        a, b, c = self.triangles.T
        return components(np.stack([np.append(a, a), np.append(b, c)], axis=1), len(self.positions))

    @cached_property
    def blended(self) -> Floats:
        """(vertices, 3, 4) bind to world space at rest."""
        return self.blended_at(self.rest, np.arange(len(self.positions)))

    def blended_at(self, pose: Rest, vertices: Ints) -> Floats:
        """(chosen, 3, 4) bind to world space in a pose of the coarse surface."""
        return self.subdivision.of_vertices(vertices, pose.blended.reshape(-1, 12)).reshape(-1, 3, 4)

    @cached_property
    def rest_normals(self) -> Floats:
        """(vertices, 3) unit normals in world space at rest."""
        return carried_normals(self.blended, self.normals)

    def rest_normals_at(self, vertices: Ints) -> Floats:
        """(chosen, 3) unit normals in world space at rest."""
        return carried_normals(self.blended_at(self.rest, vertices), self.normals_at(vertices))

    def raising_at(self, vertices: Ints) -> Floats:
        """(chosen, 3) moves in bind space that raise vertices by 1 along their normals at rest; 0 where singular."""
        return self._raising.at(
            vertices,
            lambda missing: np.einsum(
                "vij,vj->vi", inverses(self.blended_at(self.rest, missing)), self.rest_normals_at(missing)
            ),
        )

    @cached_property
    def _raising(self) -> KnownRows:
        return KnownRows.of(len(self.positions))

    def posed_at(self, pose: Rest, vertices: Ints) -> tuple[Floats, Floats]:
        """(chosen, 3) positions and unit normals in a pose of the coarse surface, world space.

        The normals are mixed from those of the coarse vertices, so they turn evenly. Normals of refined triangles jump
        from facet to facet where the surface is not rounded, and so would heights that depend on them.
        """
        normals = self._mixed_normals(pose, vertices)
        if pose is self.rest:
            return self.rest_positions[vertices], normals
        raised = np.flatnonzero(pose.morph_weights)
        bind = self.positions[vertices]
        bind = bind + np.tensordot(pose.morph_weights[raised], self.morph_deltas[raised][:, vertices], axes=1)
        return transform(self.blended_at(pose, vertices)[None], bind)[0], normals

    def _mixed_normals(self, pose: Rest, vertices: Ints) -> Floats:
        if self.subdivision.linear is None:
            return pose.normals_at(vertices)
        rows = self.subdivision.linear.chosen(vertices)
        used, columns = renumbered(rows.columns)
        return unit(replace(rows, columns=columns, column_count=len(used)) @ pose.normals_at(used))

    @cached_property
    def rest_size(self) -> float:
        """Diagonal of the bounding box at rest, scene units."""
        return diagonal(self.rest_positions)

    @property
    def pruned_count(self) -> int:
        """Number of new welded vertices that have more joints than the file can store."""
        return int(((self.weights.weights > 0).sum(axis=0) > self.weights_pruned.shape[1]).sum())

    @property
    def triangles(self) -> Ints:
        """(triangles, 3) welded vertices."""
        return self.subdivision.triangles

    @property
    def triangle_primitives(self) -> Ints:
        """(triangles,) the primitive of each triangle."""
        return self.surface.primitives[self.subdivision.parents]

    @property
    def replaced(self) -> Ints:
        """(triangles,) sorted coarse triangles that others replace."""
        parents = self.subdivision.parents
        same = ~self.subdivision.changed & (self.triangles == self.surface.triangles[parents]).all(axis=1)
        return np.flatnonzero(~flags_of(parents[same], len(self.surface.triangles)))

    def dense_weights(self, vertices: Ints, joint_count: int) -> Floats:
        """(vertices, joints) skin weights before pruning."""
        old = len(self.surface.positions)
        dense = np.zeros((len(vertices), joint_count))
        is_old = vertices < old
        dense[is_old] = self.surface.dense_weights(vertices[is_old], joint_count)
        dense[~is_old] = self.weights.at(vertices[~is_old] - old).dense().T
        return dense

    def influences(self, joint_count: int, vertices: Ints) -> Influences:
        """The skin weights of some vertices before pruning, by their joints."""
        old, is_new = len(self.surface.positions), vertices >= len(self.surface.positions)
        parts = self.surface.influences(joint_count).at(vertices[~is_new]), self.weights.at(vertices[is_new] - old)
        return parts[0].before(parts[1]).at(np.argsort(np.argsort(is_new, kind="stable")))

    def skinned(self, rig: Rig, vertices: Ints | None = None) -> SkinnedMesh:
        """The mesh, or (vertices,) sorted ones with the triangles that have no others, as a rig moves it."""
        chosen = np.arange(len(self.positions)) if vertices is None else vertices
        triangles = self.triangles[flags_of(chosen, len(self.positions))[self.triangles].all(axis=1)]
        return skinned_mesh(
            rig,
            self.influences(len(rig.joints), chosen),
            self.positions[chosen],
            self.morph_deltas[:, chosen],
            np.searchsorted(chosen, triangles),
        )


def refine(
    surface: Surface,
    rest: Rest,
    regions: Sequence[Region],
    rig: Rig,
    *,
    settings: RefinementSettings,
    contacts: Bools,
    influences: int,
    poses: Poses,
    tolerance: float,
    max_vertices: int = MAX_VERTICES,
) -> Refinement:
    """Split the triangles under the regions until these can show their displacement.

    An edge of a member triangle is split where |Δu| > 1/(intervals · edges_per_interval). An edge is not split where
    less than a hundredth of the displacement remains along all of it, at a region's border or on faces that turn away,
    unless finer splits need it.

    Args:
        surface: The coarse mesh.
        rest: Its rest pose.
        regions: All regions on the mesh.
        rig: The mesh's joints.
        settings: `refinement` of the tools file.
        contacts: (vertices,) True for vertices that touch another mesh: an edge between two of these is not split.
        influences: Greatest number of joints of a vertex in the file.
        poses: Poses of the asset's clips.
        tolerance: Scene units. An edge is not split if the midpoint's skin weights, pruned to `influences`, would move
            the midpoint further off in any pose.
        max_vertices: Greatest number of new vertices.
    """
    members = members_of(regions, len(surface.triangles))
    forbids = forbidden_splits(
        surface, rest, members, rig, regions, contacts=contacts, influences=influences, poses=poses, tolerance=tolerance
    )
    hard = hard_edges(surface, rest.bind_positions, regions)
    laid = _laid(regions, surface)
    subdivision = subdivide(
        surface.triangles,
        len(surface.positions),
        wants=lambda level: (
            np.any([_long_edges(level, each, settings) for each in laid], axis=0)
            | _edges_at_masks(level, laid, surface, settings)
        ),
        forbids=forbids,
        shows=lambda level: _showing_edges(level, laid),
        max_levels=settings.max_levels,
        max_vertices=max_vertices,
        near=members,
        scheme="midpoint" if settings.scheme == "midpoint" else "butterfly",
        hard=hard.vertices if settings.scheme == "butterfly" else None,
        where=rig.node_name,
    )
    blended = subdivision.interpolate_new(rest.blended.reshape(-1, 12)).reshape(-1, 3, 4)
    placed = rounded(
        surface,
        subdivision,
        regions,
        blended=blended,
        laid=[each.on(subdivision) for each in laid],
        at_rest=rest.morph_weights,
        full=settings.scheme == "butterfly_full",
    )
    bind = placed.positions + np.tensordot(rest.morph_weights, placed.morph_deltas, axes=1)
    old, old_corners = len(surface.positions), len(surface.weld)
    corners, sources, shares, primitives, weld = _split_corners(surface, subdivision)
    rest_positions = np.concatenate([rest.positions, transform(blended[None], bind[old:])[0]])
    corners, faces = _simplified(surface, subdivision, corners, weld, rest_positions, regions, settings)
    used, corners = _renumbered(corners, old_corners, len(weld))
    vertices, weld = _renumbered(weld[used], old, len(bind))
    subdivision = subdivision.reduced(weld[corners], faces, vertices)
    weights, acting = _new_weights(surface, subdivision, len(rig.joints))
    joints_pruned, weights_pruned = prune(weights, joint_distances(rig, regions, acting), influences)
    joints_pruned = np.where(weights_pruned > 0, np.append(acting, 0)[joints_pruned], 0)
    of_new = used[old_corners:] - old_corners
    faceted = hard.faceted & (settings.scheme == "butterfly")
    return Refinement(
        surface=surface,
        rest=rest,
        subdivision=subdivision,
        positions=placed.positions[vertices],
        morph_deltas=placed.morph_deltas[:, vertices],
        bind_positions=bind[vertices],
        rest_positions=rest_positions[vertices],
        weights=Influences.of(weights, acting, len(rig.joints)),
        joints_pruned=joints_pruned,
        weights_pruned=weights_pruned,
        corners=corners,
        sources=sources[of_new],
        shares=shares[of_new],
        primitives=primitives[of_new],
        weld=weld,
        schemes=tuple("midpoint" if each else settings.scheme for each in faceted),
        hard_shares=hard.shares,
        departures=placed.departures,
    )


def _simplified(
    surface: Surface,
    subdivision: Subdivision,
    corners: Ints,
    weld: Ints,
    places: Floats,
    regions: Sequence[Region],
    settings: RefinementSettings,
) -> tuple[Ints, Ints]:
    """Take new vertices out that no edge needs, and turn edges along crests, where only one region has split triangles.

    Args:
        surface: The coarse mesh.
        subdivision: The refined mesh.
        corners: (triangles, 3) glTF vertices.
        weld: (glTF vertices,) their vertices.
        places: (vertices, 3) at rest, world space.
        regions: All regions; some say how long edges are for them.
        settings: How long they may be.

    Returns:
        (left, 3) corners, and the (left,) sorted triangles that they replace.
    """
    faces, owners = np.arange(len(corners)), np.zeros(len(corners), np.intp)
    for region in regions:
        owners[children(subdivision.parents, region.members)] += 1
    is_new = (np.bincount(weld)[weld] == 1) & (weld >= len(surface.positions))
    for region in regions:
        steps = region.steps(subdivision)
        if steps is None:
            continue
        lengths = partial(_of_corners, steps, weld, _greatest_step(region, settings))
        tolerance = _LEAST_SHOWN * region.greatest_height
        free = flags_of(children(subdivision.parents, region.members), len(subdivision.parents))
        free &= (owners == 1) & subdivision.changed
        corners = corners.copy()
        corners[free[faces]] = turn_diagonals(corners[free[faces]], places[weld], lengths, tolerance)
        beside = flags_of(corners[~free[faces]].ravel(), len(weld))
        corners, left = collapse_edges(corners, weld, places[weld], lengths, is_new & ~beside, tolerance)
        faces = faces[left]
        corners[free[faces]] = turn_diagonals(corners[free[faces]], places[weld], lengths, tolerance)
    return corners, faces


def _of_corners(steps: Steps, weld: Ints, greatest: float, ends: Ints) -> Floats:
    """(edges,) steps of edges with (edges, 2) glTF vertices, over the greatest one that they may have."""
    return steps(weld[ends]) / greatest


def _renumbered(members: Ints, old: int, count: int) -> tuple[Ints, Ints]:
    """Leave out what is no member of so many vertices, of which the `old` first ones stay.

    Returns:
        (left,) sorted vertices, and the members by their numbers among these.
    """
    left = flags_of(members, count)
    left[:old] = True
    return np.flatnonzero(left), (np.cumsum(left) - 1)[members]


@dataclass(frozen=True, slots=True)
class _Laid:
    """The regions that are laid in one pose, and the coarse surface in that pose.

    Attributes:
        normals: (vertices, 3) unit normals in the pose; 0 beside the regions.
    """

    pose: Rest
    regions: tuple[Region, ...]
    normals: Floats

    def on(self, subdivision: Subdivision) -> LaidSurface:
        """The coarse surface at the new vertices of a subdivision."""
        blended = subdivision.interpolate_new(self.pose.blended.reshape(-1, 12)).reshape(1, -1, 3, 4)
        places = transform(blended, subdivision.interpolate_new(self.pose.bind_positions))[0]
        return LaidSurface(self.pose, places, unit(subdivision.interpolate_new(self.normals)))


def _laid(regions: Sequence[Region], surface: Surface) -> list[_Laid]:
    """Group regions by their poses."""
    found = []
    for pose in {id(region.pose): region.pose for region in regions}.values():
        own = tuple(region for region in regions if region.pose is pose)
        under = distinct_values(surface.triangles[members_of(own, len(surface.triangles))])
        normals = np.zeros((len(surface.positions), 3))
        normals[under] = pose.normals_at(under)
        found.append(_Laid(pose, own, normals))
    return found


def _long_edges(level: Level, laid: _Laid, settings: RefinementSettings) -> Bools:
    """(edges,) edges on a region of one pose that are too long along u to show its displacement."""
    last = level.number == settings.max_levels
    wanted = np.zeros(len(level.edges), bool)
    places = _places(level, laid)
    turned, scratch = _directions(level, laid) if last else np.zeros((0, 3)), np.zeros(len(places))
    borders = np.zeros(len(places), np.uint8)
    for region in laid.regions:
        faces = children(level.parents, region.members)
        of_faces = distinct_values(level.triangle_edges[faces])
        told = region.steps(level)
        if told is not None:
            wanted[of_faces] |= told(level.edges[of_faces]) > _greatest_step(region, settings)
            continue
        triangles = level.triangles[faces]
        vertices = distinct_values(triangles)
        u, v = region.coordinates(places[vertices])
        # Some corner is beyond each border's line, on the region's side: a bit for each of the four.
        borders[vertices] = np.packbits([u > 0, u < 1, v > -1, v < 1], axis=0)[0]
        meets = any_of(borders, triangles) == _ALL_BORDERS
        # The last level only counts edges: edges that show the displacement, if not its sharpest furrows, will do.
        u = region.bowed(u, v) if last else region.stretched(u, v)
        edges = distinct_values(level.triangle_edges[faces[meets]])
        ends = _at(level.edges[edges], vertices, u, scratch)
        steps = np.abs(ends[:, 1] - ends[:, 0])
        if last and not region.projected:
            # The little that remains at the border of a region is not missed.
            steps = steps * _greatest_shares(level, edges, region, places, turned, scratch)
        elif len(region.furrows) and not region.projected:
            steps = steps * _weights(region, ends, _at(level.edges[edges], vertices, v, scratch))
        wanted[edges] |= steps > _greatest_step(region, settings)
    return wanted


def _weights(region: Region, stretched: Floats, v: Floats) -> Floats:
    """(edges,) weights of steps along a region with sharp furrows, from (edges, 2) coordinates of the edges' ends.

    Edges across a furrow must be shorter: the lines at which it crosses them would show as teeth. Where the region
    fades, edges may be longer.
    """
    # Column by column, as numpy is slow to reduce rows of two.
    low, high = np.minimum(*stretched.T), np.maximum(*stretched.T)
    furrowed = np.searchsorted(region.furrows, high, "right") > np.searchsorted(region.furrows, low, "left")
    nearest = np.where(v[:, 0] * v[:, 1] > 0, np.minimum(*np.abs(v).T), 0.0)
    shares = region.share(np.full(len(v), 0.5), nearest, np.ones(len(v)))
    return np.where(furrowed, _FURROWED, 1.0) * np.maximum(shares, _LEAST_SHARE) ** _FADING


def _edges_at_masks(level: Level, laid: Sequence[_Laid], surface: Surface, settings: RefinementSettings) -> Bools:
    """(edges,) edges of faces on which a mask changes between the corners, if they are too long to show its border.

    The last level only counts edges that are still too long. A hard border always has some, so none are wanted there.
    """
    wanted = np.zeros(len(level.edges), bool)
    if level.number == settings.max_levels:
        return wanted
    for each in laid:
        if all(region.mask is None for region in each.regions):
            continue
        places, turned = _places(level, each), _directions(level, each)
        scratch = np.zeros(len(places))
        for region in each.regions:
            if region.mask is None:
                continue
            faces = children(level.parents, region.members)
            errors = region.mask.errors(surface.corners[level.parents[faces]], level.barycentrics[faces], level.number)
            faces, errors = faces[errors > _MASK_ERROR], errors[errors > _MASK_ERROR]
            edges, at = renumbered(level.triangle_edges[faces])
            shares = _greatest_shares(level, edges, region, places, turned, scratch)[at]
            edges = level.triangle_edges[faces[errors * shares.max(axis=1) > _MASK_ERROR]]
            lengths = np.linalg.norm(np.diff(places[level.edges[edges]], axis=2), axis=3)[:, :, 0]
            wanted[edges[lengths > region.span * _greatest_step(region, settings) / _BORDERED]] = True
    return wanted


def _showing_edges(level: Level, laid: Sequence[_Laid]) -> Bools:
    """(edges,) edges along which a region leaves some displacement."""
    shown = np.zeros(len(level.edges), bool)
    for each in laid:
        places, turned = _places(level, each), _directions(level, each)
        scratch = np.zeros(len(places))
        for region in each.regions:
            edges = distinct_values(level.triangle_edges[children(level.parents, region.members)])
            # Any member may come to lie on a region onto which vertices are projected in each frame.
            shown[edges] |= (
                region.projected or _greatest_shares(level, edges, region, places, turned, scratch) > _LEAST_SHOWN
            )
    return shown


def _greatest_shares(
    level: Level, edges: Ints, region: Region, places: Floats, normals: Floats, scratch: Floats
) -> Floats:
    """(edges,) greatest fraction of a region's displacement along each edge; 0 before and behind the region.

    The (vertices, 3) `places` and unit `normals` in the region's pose are right for the level's vertices on regions.
    """
    pairs = level.edges[edges]
    vertices = distinct_values(pairs)
    u, v = region.coordinates(places[vertices])
    cosines = region.cosines(u, normals[vertices])
    u, v, cosines = (_at(pairs, vertices, each, scratch).T for each in (u, v, cosines))
    within = (np.maximum(*u) > 0) & (np.minimum(*u) < 1)
    # The path runs between ends on either side, unless these are nearest to parts of the path that are far apart.
    lengths = np.linalg.norm(places[pairs[:, 1]] - places[pairs[:, 0]], axis=1) / region.half_width
    a, b = np.abs(v)
    between = np.maximum(a + b - lengths, 0.0) / 2.0
    nearest = np.where(v[0] * v[1] > 0, np.minimum(a, b), between)
    shares = region.share(np.full(len(edges), 0.5), nearest, np.maximum(*cosines))
    return np.where(within, shares, 0.0)


def _greatest_step(region: Region, settings: RefinementSettings) -> float:
    """Greatest |Δu| of an edge that shows the region's displacement."""
    return 1.0 / (region.intervals * settings.edges_per_interval)


def _on_regions(level: Level, regions: Sequence[Region], values: Callable[[Ints], Floats]) -> Floats:
    """(vertices, 3) values of a level's vertices that are on any region, from a function of these; 0 for all others.

    They are found once for all regions: many may lie on one spot.
    """
    members = distinct_values(np.concatenate([region.members for region in regions]))
    vertices = distinct_values(level.triangles[children(level.parents, members)])
    found = np.zeros((int(level.triangles.max(initial=-1)) + 1, 3))
    found[vertices] = values(vertices)
    return found


def _places(level: Level, laid: _Laid) -> Floats:
    """(vertices, 3) world positions in a pose of a level's vertices on its regions, on the coarse surface."""

    def positions(vertices: Ints) -> Floats:
        blended = level.of_vertices(vertices, laid.pose.blended.reshape(-1, 12)).reshape(1, -1, 3, 4)
        return np.asarray(transform(blended, level.of_vertices(vertices, laid.pose.bind_positions))[0])

    return _on_regions(level, laid.regions, positions)


def _directions(level: Level, laid: _Laid) -> Floats:
    """(vertices, 3) unit normals in a pose of a level's vertices on its regions."""
    return _on_regions(level, laid.regions, lambda vertices: unit(level.of_vertices(vertices, laid.normals)))


def _at(corners: Ints, vertices: Ints, values: Floats, scratch: Floats) -> Floats:
    """(corners, …) of the (vertices,) values, by vertices; overwrites some of `scratch`, (vertices of the level,)."""
    scratch[vertices] = values
    return scratch[corners]


def _new_weights(surface: Surface, subdivision: Subdivision, joint_count: int) -> tuple[Floats, Ints]:
    """(new vertices, acting) skin weights before pruning, and the (acting,) joints that have any."""
    old = len(surface.positions)
    if subdivision.linear is None:
        return np.zeros((0, 0)), np.zeros(0, np.intp)
    split = distinct_values(subdivision.linear.columns[subdivision.linear.starts[old] :])
    acting = distinct_values(surface.joints[split][surface.weights[split] > 0])
    dense = spread_weights(surface, split, joint_count, acting)
    return subdivision.linear.of_rows(np.arange(old, subdivision.vertex_count), dense), acting


def _split_corners(surface: Surface, subdivision: Subdivision) -> tuple[Ints, Ints, Floats, Ints, Ints]:
    """Find the glTF vertices of the fine triangles: corners; sources, shares and primitives of new ones; weld.

    A corner of a fine triangle is a mix of its coarse triangle's corners. Two corners are one glTF vertex if they mix
    the same glTF vertices of one primitive in the same shares. So a UV seam stays a seam, and one vertex along an edge
    stays one.
    """
    old_count = len(surface.weld)
    changed = subdivision.changed
    fine_corners = surface.corners[subdivision.parents]
    parents = subdivision.parents[changed]
    shares = subdivision.barycentrics_of(np.flatnonzero(changed)).reshape(-1, 3)
    sources = np.repeat(surface.corners[parents], 3, axis=0)
    is_new = (shares < 1.0).all(axis=1)
    corners = sources[np.arange(len(sources)), np.argmax(shares, axis=1)]
    # Shares are multiples of 2^-levels, so their numerators are exact keys. Unused sources count as none.
    numerators = (shares[is_new] * 2**subdivision.levels).astype(np.intp)
    used = np.where(numerators > 0, sources[is_new], old_count)
    order = np.argsort(used, axis=1, kind="stable")
    used, numerators = np.take_along_axis(used, order, 1), np.take_along_axis(numerators, order, 1)
    primitive = np.repeat(surface.primitives[parents], 3)[is_new]
    welded = subdivision.triangles[changed].reshape(-1)[is_new]
    keys = np.column_stack([welded, primitive, used, numerators])
    firsts, which = distinct(keys)
    unique = keys[firsts]
    corners[is_new] = old_count + which
    fine_corners[changed] = corners.reshape(-1, 3)
    picked = np.where(unique[:, 5:] > 0, unique[:, 2:5], 0)
    return (
        fine_corners,
        picked,
        unique[:, 5:] / 2**subdivision.levels,
        unique[:, 1],
        np.concatenate([surface.weld, unique[:, 0]]),
    )
