"""A mesh with tools on it: which of its triangles each group of tools refines, and where all are at a moment.

What lies under no tool is the asset's own; so a mesh is put together from it and the parts that tools have refined, and
one of these is exchanged for another without a look at the rest.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wrinklecli.baking.plan import Ground, MeshPlan
from wrinklecli.character.clip import Clip
from wrinklecli.character.skin import Skin, pose, prepare
from wrinklecli.editor.clip_cache import ClipCache
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.numeric.arrays import Bools, Floats, Ints, any_of, children, distinct_values, vertex_normals


@dataclass(frozen=True, eq=False)
class Cluster:
    """Tools that lie together on a mesh, planned together.

    Attributes:
        plan: Of these tools alone.
        parents: (triangles,) of the coarse mesh, rising, that they move or refine.
        triangles: (triangles,) of the refined mesh, rising, in place of these.
        skin: The new vertices, ready to be posed.
    """

    plan: MeshPlan
    parents: Ints
    triangles: Ints
    skin: Skin

    @classmethod
    def of(cls, plan: MeshPlan, before: "Cluster | None" = None) -> "Cluster":
        """What of a refined mesh differs from the coarse one; and what did before, so that faces seldom change."""
        fine, old = plan.fine, len(plan.fine.surface.positions)
        moved = np.zeros(len(fine.positions), bool)
        moved[old:] = True
        for carried in plan.carried_patches:
            moved[carried.vertices] = True
        parents = distinct_values(fine.subdivision.parents[any_of(moved, fine.triangles)])
        if before is not None:
            parents, skin = distinct_values(np.concatenate([before.parents, parents])), before.skin
        else:
            weights = fine.weights[:, distinct_values(fine.surface.joints)]
            skin = prepare(weights, fine.positions[old:], fine.morph_deltas[:, old:])
        return cls(plan, parents, children(fine.subdivision.parents, parents), skin)

    @property
    def old_count(self) -> int:
        """Vertices of the coarse mesh, which the refined one begins with."""
        return len(self.plan.fine.surface.positions)

    def apart_from(self, taken: Bools) -> "Cluster":
        """It without what is at (triangles,) of the coarse mesh that others show already; in a hurry some may."""
        if not taken[self.parents].any():
            return self
        parents = self.parents[~taken[self.parents]]
        return replace(self, parents=parents, triangles=children(self.plan.fine.subdivision.parents, parents))


@dataclass(frozen=True, eq=False)
class PlayableMesh:
    """A node's mesh with all tools on it: the same object as long as all is the same but the pose.

    Its vertices are those of the coarse mesh, welded, then the new ones of each cluster.

    Attributes:
        ground: The mesh at rest.
        skin: Its vertices, ready to be posed.
        clusters: Its tools.
        played: Where poses and heights come from.
    """

    ground: Ground
    skin: Skin
    clusters: tuple[Cluster, ...]
    played: ClipCache

    @property
    def node(self) -> str:
        """The name of the node."""
        return self.ground.rig.names[self.ground.rig.node]

    @cached_property
    def kept(self) -> Ints:
        """(triangles,) of the coarse mesh that are shown as they are, rising."""
        kept = np.ones(len(self.ground.surface.triangles), bool)
        for cluster in self.clusters:
            kept[cluster.parents] = False
        return np.flatnonzero(kept)

    @cached_property
    def faces(self) -> Ints:
        """(triangles, 3) vertices: of the coarse mesh's triangles that are kept, then of those of each cluster."""
        parts = [self.ground.surface.triangles[self.kept]]
        for cluster, shift in zip(self.clusters, self.shifts, strict=True):
            faces = cluster.plan.fine.triangles[cluster.triangles]
            parts.append(np.where(faces < cluster.old_count, faces, faces + shift))
        return np.concatenate(parts)

    @cached_property
    def parents(self) -> Ints:
        """(triangles,) the triangle of the coarse mesh that each of `faces` is, or is a part of."""
        split = [each.plan.fine.subdivision.parents[each.triangles] for each in self.clusters]
        return np.concatenate([self.kept, *split])

    @cached_property
    def rest_positions(self) -> Floats:
        """(vertices, 3) at rest, without wrinkles."""
        new = [each.plan.fine.rest_positions[each.old_count :] for each in self.clusters]
        return np.concatenate([self.ground.rest.positions, *new])

    @cached_property
    def shifts(self) -> list[int]:
        """What is added to the numbers of each cluster's new vertices."""
        counts = [each.skin.weights.shape[1] for each in self.clusters]
        shifts: list[int] = np.cumsum([0, *counts])[:-1].tolist()
        return shifts

    def posed(self, clip: Clip | None, time: float, *, wrinkled: bool = True) -> Floats:
        """(vertices, 3) at a time of a clip, seconds, world space; in the stored pose where there is no clip.

        Args:
            clip: The animation.
            time: Seconds.
            wrinkled: With wrinkles.
        """
        rig, old = self.ground.rig, len(self.ground.surface.positions)
        matrices, weights = self.played.pose(self.ground, clip, time)
        skins = (self.skin, *(each.skin for each in self.clusters))
        ends = np.cumsum([0, *(each.weights.shape[1] for each in skins)])
        offsets = np.zeros((1, 3, int(ends[-1])))
        for cluster, shift in zip(self.clusters, self.shifts, strict=True):
            plan = cluster.plan
            for carried in plan.carried_patches if wrinkled else ():
                amplitudes, _ = self.played.at(self.ground, carried.patch, clip, time)
                moved = displacements(carried, plan.fine, rig, plan.rest, clip, np.array([time]), amplitudes)[0]
                offsets[0][:, np.where(carried.vertices < old, carried.vertices, carried.vertices + shift)] += moved.T
        parts = [
            pose(skin, matrices, weights, offsets[:, :, start:end])[0][0]
            for skin, start, end in zip(skins, ends[:-1], ends[1:], strict=True)
        ]
        return np.concatenate(parts, axis=1).T

    def normals(self, positions: Floats) -> Floats:
        """(vertices, 3) unit normals of (vertices, 3) positions."""
        return vertex_normals(positions, self.faces)


@dataclass(frozen=True, slots=True)
class ShownMesh:
    """A node's mesh at a moment.

    Attributes:
        node: Name of the node.
        laid: What of it does not change with time; another object whenever faces do.
        positions: (vertices, 3) world space, scene units.
    """

    node: str
    laid: PlayableMesh
    positions: Floats

    @property
    def faces(self) -> Ints:
        """(triangles, 3) vertices; the same array as long as `laid` is the same object."""
        return self.laid.faces

    def normals(self) -> Floats:
        """(vertices, 3) unit, area-weighted."""
        return self.laid.normals(self.positions)


@dataclass(frozen=True, slots=True)
class AttachedTool:
    """A tool on its mesh.

    Attributes:
        ground: The mesh.
        plan: Of the tool and those that lie with it.
        carried: The tool, on the refined surface.
    """

    ground: Ground
    plan: MeshPlan
    carried: CarriedPatch

    @property
    def patch(self) -> Patch:
        """It, attached."""
        return self.carried.patch


@dataclass(frozen=True, slots=True)
class AttachedTools:
    """What tools make of an asset.

    Attributes:
        meshes: Of all nodes of the scene.
        tools: Those that fit, by name.
        problems: What is wrong with the others, a line each, by name.
        hurried: Whether tools are on triangles that were not refined for them.
    """

    meshes: tuple[PlayableMesh, ...]
    tools: dict[str, AttachedTool]
    problems: dict[str, str]
    hurried: bool
