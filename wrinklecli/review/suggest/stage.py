"""Suggested tools in a pose: the refined mesh near each, without and with its wrinkles, and what else is near it."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.skin import SkinnedMesh
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.effect import MeshPlan, Part
from wrinklecli.effects.plan import carry
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import (
    Bools,
    Floats,
    Ints,
    among,
    any_of,
    children,
    diagonal,
    distinct_values,
    face_normals,
    flags_of,
    unit,
    vertex_normals,
)
from wrinklecli.numeric.intersections import Crossings, sides_of
from wrinklecli.review.suggest.layers import Layers
from wrinklecli.surface.ground import Ground

# Part of a tool's greatest displacement above which a vertex is on its place; below, wrinkles have nearly faded.
SHOWN = 0.05
# Reach of what is near a place over the greatest side of its box: what is further off hides it only from afar.
_NEAR = 3.0
# Edges that begin to cross, over the square root of the place's edges, which is how many a line across it meets, from
# which a fold has a slit, which contact closes: a tenth of a line across the place.
_SLIT = 0.1
# Bits of a triangle that a box meets, as `np.packbits` fills them from the left.
_ALL_SIDES = 0b11111100


@dataclass(frozen=True)
class Placement:
    """A tool or a field on the refined mesh.

    Attributes:
        plan: The mesh.
        ground: The same at rest.
        attached: The tool or the field at rest.
    """

    plan: MeshPlan
    ground: Ground
    attached: AnyAttached

    @cached_property
    def part(self) -> Part:
        """It on the refined mesh, which carries a field only now, lowered as a bake lowers it.

        Raises:
            BakeError: It moves nothing.
        """
        plan = self.plan if self.plan.layers else carry(self.plan, self.ground, [self.attached])
        return next(part for part in plan.parts if part.attached.tool.name == self.attached.tool.name)

    @property
    def targets(self) -> Sequence[Ints]:
        """For each morph target the vertices that it may move."""
        return self.attached.may_move(self.plan.fine) or self.part.target_vertices

    @property
    def coarse(self) -> bool:
        """True if edges under it stay too long for its wrinkles."""
        members = self.attached.regions[0].members
        return bool(among(members, self.plan.fine.subdivision.unmet).any())

    @property
    def departs(self) -> bool:
        """True if refinement moves the surface under it so much that one sees it at rest, as cloth does not show."""
        return self.attached.segment is not None and self.plan.fine.departs(self.part.region)

    @cached_property
    def moved(self) -> Ints:
        """(vertices,) those that it moves."""
        return self.part.vertices

    @cached_property
    def shown(self) -> Ints:
        """(vertices,) those of them that it moves so far that they are on its place."""
        return self.moved[self.part.shares > SHOWN]

    @cached_property
    def mesh(self) -> SkinnedMesh:
        """The refined mesh, ready to be posed."""
        return self.plan.fine.skinned(self.plan.rig)


@dataclass(frozen=True)
class StagedTool:
    """A tool and what is near it in a pose. Vertices are those of the refined mesh that are near, then all others'.

    Attributes:
        flat_positions: (vertices, 3) without wrinkles, new vertices in the planes of the coarse triangles.
        flat_normals: (vertices, 3) of the coarse surface, as its shading interpolates them; not of unit length.
        plain: (vertices, 3) world space, without wrinkles.
        wrinkled: (vertices, 3) with them.
        triangles: (triangles, 3) of the mesh, then those of other meshes.
        place: (triangles,) True for those that the tool moves.
        shaded_flat: True if the mesh has no normals.
        places: (vertices, 2) u along the curve of the wrinkles, which follows their crests, and v across; else NaN.
        bumps: Number of the tool's bumps.
    """

    flat_positions: Floats
    flat_normals: Floats
    plain: Floats
    wrinkled: Floats
    triangles: Ints
    place: Bools
    shaded_flat: bool
    places: Floats
    bumps: int

    @classmethod
    def of(cls, placement: Placement, layers: Layers, clip: Clip, time: float) -> "StagedTool":
        """Pose a tool at a time of a clip, seconds, amid all layers."""
        plan, part = placement.plan, placement.part
        fine, mesh, times = plan.fine, placement.mesh, np.array([time])
        plain, chosen, region = mesh.positions_at(clip, time), placement.moved, part.attached.regions[0]
        moved = part.displacements(fine, plan.rig, clip, times)
        wrinkled, shown = plain.copy(), mesh.only(chosen).posed(clip, times, offsets=moved)
        wrinkled[chosen] = shown.positions[0]
        way = -1 if shown.mirrored[0] else 1
        faces, place = fine.triangles[:, ::way], np.zeros(len(fine.triangles), np.bool_)
        members = children(fine.subdivision.parents, region.members)
        on = flags_of(placement.shown, len(plain))
        place[members] = on[faces[members]].any(axis=1)
        low, high = _box(np.concatenate([plain[faces[place]], wrinkled[faces[place]]]))
        reach = _NEAR * float((high - low).max())
        low, high = low - reach, high + reach
        near = place | meets(plain, faces, low, high)
        used = distinct_values(faces[near])
        numbers = np.zeros(len(plain), np.intp)
        numbers[used] = np.arange(len(used))
        others = np.concatenate([np.zeros((0, 3, 3)), *layers.near(clip, time, low, high, node=plan.rig.node)])
        others = others[meets(others.reshape(-1, 3), np.arange(3 * len(others)).reshape(-1, 3), low, high)]
        corners = others.reshape(-1, 3)
        beside = len(used) + np.arange(len(corners)).reshape(-1, 3)
        old = len(fine.surface.positions)
        flat = fine.subdivision.interpolate(plain[:old])
        normals = fine.subdivision.interpolate(vertex_normals(plain[:old], fine.surface.triangles[:, ::way]))
        across_others = np.repeat(face_normals(corners, np.arange(len(corners)).reshape(-1, 3)), 3, axis=0)
        places = np.full((len(plain), 2), np.nan)
        if part.attached.segment is not None:
            _, across = region.coordinates(fine.posed_at(region.pose, chosen)[0])
            places[chosen] = np.stack([part.us, across], axis=1)
        return cls(
            flat_positions=np.concatenate([flat[used], corners]),
            flat_normals=np.concatenate([normals[used], across_others]),
            plain=np.concatenate([plain[used], corners]),
            wrinkled=np.concatenate([wrinkled[used], corners]),
            triangles=np.concatenate([numbers[faces[near]], beside]),
            place=np.append(place[near], np.zeros(len(others), np.bool_)),
            shaded_flat=not plan.has_normals,
            places=np.concatenate([places[used], np.full((len(corners), 2), np.nan)]),
            bumps=1 if part.attached.segment is None else part.attached.tool.bumps,
        )

    @property
    def shown(self) -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
        """(vertices, 3) positions and normals as an engine shows the asset, and the same with wrinkles.

        A bake keeps the asset's normals, and turns them as wrinkles turn the surface. So the facets of a coarse mesh,
        which the refined surface has, are seen neither before nor after.
        """
        before = unit(self.flat_normals)
        turns = vertex_normals(self.wrinkled, self.triangles) - vertex_normals(self.plain, self.triangles)
        return (self.flat_positions, before), (self.wrinkled, before + turns)

    @cached_property
    def height(self) -> float:
        """The greatest displacement, scene units."""
        return float(np.linalg.norm(self.wrinkled - self.plain, axis=1).max(initial=0.0))

    @cached_property
    def size(self) -> float:
        """The diagonal of the box round the place, scene units."""
        return diagonal(self.plain[self.triangles[self.place]].reshape(-1, 3))

    @cached_property
    def crossings(self) -> int:
        """The number of edges that pass through triangles at the place without wrinkles: bumps in a crease may meet."""
        there = flags_of(distinct_values(self.triangles[self.place]), len(self.plain))
        near = meets(self.plain, self.triangles, *_box(self.plain[there]))
        crossings = Crossings.of(self.plain, self.triangles[near])
        edges, triangles = crossings.at(self.plain)
        corners = np.concatenate([crossings.edges[edges], crossings.triangles[triangles]], axis=1)
        return int(there[corners].any(axis=1).sum())

    @property
    def has_slit(self) -> bool:
        """True if a fold crosses along so much of its length that contact should close it."""
        low, high = sides_of(self.triangles[self.place]).T
        edges = len(distinct_values(low * len(self.plain) + high))
        return self.crossings > _SLIT * float(np.sqrt(edges))


def _box(corners: Floats) -> tuple[Floats, Floats]:
    """Least and greatest coordinates of (…, 3) corners."""
    points = corners.reshape(-1, 3)
    return points.min(axis=0), points.max(axis=0)


def meets(positions: Floats, triangles: Ints, low: Floats, high: Floats) -> Bools:
    """(triangles,) True if the box round a triangle of (vertices, 3) positions meets that from `low` to `high`."""
    # Some corner is not above the box, and some corner is not below it, along each axis: a bit for each of the six.
    sides = np.packbits(np.concatenate([positions <= high, positions >= low], axis=1), axis=1)[:, 0]
    meets: Bools = any_of(sides, triangles) == _ALL_SIDES
    return meets
