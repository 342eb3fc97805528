"""Tools attached to the meshes of an asset, ready to be shown at any moment.

A mesh is put together from the asset's own triangles and from the parts that groups of tools have refined, so that one
part can be exchanged without touching the rest.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import moving_nodes
from wrinklecli.character.skin import Skin, pose, prepare
from wrinklecli.drive.touch import TouchDrive
from wrinklecli.editor.clip_cache import ClipCache
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.body import OUTLINED, largest_moves, moves_at_rest
from wrinklecli.effects.effect import MeshPlan, Part, SamplingOptions, Seen
from wrinklecli.effects.plan import mesh_warnings, skin_parts
from wrinklecli.effects.sampling import moving_clips, play_below_skin
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, Ints, any_of, children, distinct_values
from wrinklecli.numeric.guard import log_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.review.preview.peaks import tallest_clip
from wrinklecli.surface.ground import Ground
from wrinklecli.surface.region import Region
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import ToolsFile


@dataclass(frozen=True, eq=False)
class Cluster:
    """Tools that overlap on a mesh and are planned together.

    Attributes:
        plan: Plan of these tools alone.
        parts: The tools on the skin.
        parents: (triangles,) of the coarse mesh, sorted, that the tools move or refine.
        triangles: (triangles,) of the refined mesh, sorted, that replace `parents`.
        skin: Vertices that refinement has added, ready to be posed.
    """

    plan: MeshPlan
    parts: tuple[Part, ...]
    parents: Ints
    triangles: Ints
    skin: Skin

    @classmethod
    def from_plan(cls, plan: MeshPlan) -> "Cluster":
        """Find the triangles that differ from the coarse mesh."""
        fine, old = plan.fine, len(plan.fine.surface.positions)
        influences = fine.weights.among(distinct_values(fine.surface.joints))
        skin = prepare(influences, fine.positions[old:], fine.morph_deltas[:, old:])
        return cls(plan, (), np.zeros(0, np.intp), np.zeros(0, np.intp), skin).with_parts(skin_parts(plan))

    def with_parts(self, parts: Iterable[Part]) -> "Cluster":
        """Show other tools on the same triangles, and keep those that are shown, so that faces stay."""
        fine, every = self.plan.fine, tuple(parts)
        moved = np.zeros(len(fine.positions), bool)
        for part in every:
            moved[part.vertices] = True
        changed = fine.subdivision.parents[any_of(moved, fine.triangles)]
        parents = distinct_values(np.concatenate([self.parents, changed, fine.replaced]))
        triangles = children(fine.subdivision.parents, parents)
        return replace(self, parts=every, parents=parents, triangles=triangles)

    @property
    def old_count(self) -> int:
        """Number of coarse vertices, with which the refined mesh begins."""
        return len(self.plan.fine.surface.positions)

    def without(self, taken: Bools) -> "Cluster":
        """Leave out (triangles,) of the coarse mesh that other clusters show; provisional ones may overlap."""
        if not taken[self.parents].any():
            return self
        parents = self.parents[~taken[self.parents]]
        return replace(self, parents=parents, triangles=children(self.plan.fine.subdivision.parents, parents))


@dataclass(frozen=True, eq=False)
class PlayableMesh:
    """A node's mesh with its tools; the same object as long as only the pose changes.

    Its vertices are the welded coarse ones, followed by the new ones of each cluster.

    Attributes:
        ground: Coarse mesh at rest.
        driven: The same mesh with the drives of its morph targets as they are edited.
        skin: Coarse vertices, ready to be posed.
    """

    ground: Ground
    driven: Ground
    skin: Skin
    clusters: tuple[Cluster, ...]
    cache: ClipCache

    @property
    def node(self) -> str:
        """Name of the node."""
        return self.ground.rig.node_name

    @cached_property
    def kept(self) -> Ints:
        """(triangles,) of the coarse mesh, sorted, that no cluster replaces."""
        kept = np.ones(len(self.ground.surface.triangles), bool)
        for cluster in self.clusters:
            kept[cluster.parents] = False
        return np.flatnonzero(kept)

    @cached_property
    def faces(self) -> Ints:
        """(triangles, 3) vertices: the kept coarse triangles, then those of each cluster, wound as they are at rest."""
        parts = [self.ground.surface.triangles[self.kept]]
        for cluster, shift in zip(self.clusters, self.shifts, strict=True):
            faces = cluster.plan.fine.triangles[cluster.triangles]
            parts.append(np.where(faces < cluster.old_count, faces, faces + shift))
        return np.concatenate(parts)[:, :: self.way]

    @property
    def way(self) -> int:
        """1 if triangles wind as they are stored, -1 if the joints mirror the mesh."""
        return int(self.ground.rest.way)

    @cached_property
    def parents(self) -> Ints:
        """(triangles,) the coarse triangle that each of `faces` is a part of."""
        split = [each.plan.fine.subdivision.parents[each.triangles] for each in self.clusters]
        return np.concatenate([self.kept, *split])

    @cached_property
    def rest_positions(self) -> Floats:
        """(vertices, 3) at rest, without wrinkles."""
        new = [each.plan.fine.rest_positions[each.old_count :] for each in self.clusters]
        return np.concatenate([self.ground.rest.positions, *new])

    def smooth(self, values: Floats) -> Floats:
        """(vertices,) values from (coarse vertices,) ones, as smooth as the surface is refined."""
        new = [each.plan.fine.subdivision.positions(values[:, None])[each.old_count :, 0] for each in self.clusters]
        return np.concatenate([values, *new])

    def positions_in(self, pose: Rest) -> Floats:
        """(vertices, 3) in a pose of the coarse mesh, without wrinkles."""
        if pose is self.ground.rest:
            return self.rest_positions
        parts = [pose.positions]
        for each in self.clusters:
            fine = each.plan.fine
            parts.append(fine.posed_at(pose, np.arange(each.old_count, len(fine.positions)))[0])
        return np.concatenate(parts)

    @cached_property
    def shifts(self) -> list[int]:
        """Offset from the vertex numbers of each cluster's plan to those of this mesh, for new vertices."""
        counts = [len(each.skin) for each in self.clusters]
        shifts: list[int] = np.cumsum([0, *counts])[:-1].tolist()
        return shifts

    def posed(
        self, clip: Clip | None, time: float, *, wrinkled: bool = True, held: Mapping[int, float] | None = None
    ) -> Floats:
        """(vertices, 3) in world space at a time of a clip, seconds, or in the stored pose if there is no clip.

        `held` are weights of morph targets, by number, that replace those of the clip.
        """
        rig, old = self.driven.rig, len(self.ground.surface.positions)
        matrices, weights = self.cache.pose(self.ground, self.driven, clip, time)
        if held:
            weights = weights.copy()
            weights[0, list(held)] = list(held.values())
        skins = (self.skin, *(each.skin for each in self.clusters))
        ends = np.cumsum([0, *(len(each) for each in skins)])
        offsets = np.zeros((1, 3, int(ends[-1])))
        for cluster, shift in zip(self.clusters, self.shifts, strict=True):
            for part in cluster.parts if wrinkled else ():
                numbers, vertices = self.cache.numbers_at(self.driven, part, clip, time), part.vertices
                moved = part.displacements(cluster.plan.fine, rig, clip, np.array([time]), numbers)[0]
                offsets[0][:, np.where(vertices < old, vertices, vertices + shift)] += moved.T
        parts = [
            pose(skin, matrices, weights, offsets[:, :, start:end])[0][0]
            for skin, start, end in zip(skins, ends[:-1], ends[1:], strict=True)
        ]
        return np.concatenate(parts, axis=1).T


@dataclass(frozen=True, slots=True)
class ShownMesh:
    """A node's mesh at a moment.

    Attributes:
        source: Mesh that was posed; another object whenever faces change.
        positions: (vertices, 3) world space, scene units.
    """

    source: PlayableMesh
    positions: Floats

    @property
    def faces(self) -> Ints:
        """(triangles, 3) vertices; the same array as long as `source` is the same object."""
        return self.source.faces


@dataclass(frozen=True, slots=True)
class AttachedTool:
    """A tool on its mesh, carried on the refined surface, with the plan for it and the tools that overlap it."""

    ground: Ground
    plan: MeshPlan
    part: Part

    @property
    def attached(self) -> AnyAttached:
        """The tool on the coarse mesh."""
        return self.part.attached

    @property
    def span(self) -> float:
        """Length of the tool at rest, scene units."""
        return float(self.attached.span)

    @property
    def region(self) -> Region:
        """The region of the coarse mesh that it moves."""
        return self.attached.regions[0]

    @property
    def excess(self) -> Floats:
        """(vertices,) of the coarse mesh, as that of `AttachedBelow`, for a field: it has no patch to outline."""
        places = self.ground.rest.positions
        return self.region.share(*self.region.coordinates(places), np.ones(len(places))) - OUTLINED

    def holds(self, place: Floats, _triangle: int = 0) -> bool:
        """True if a (3,) place at rest, on a triangle of the coarse mesh, is on the tool."""
        region = self.region.at_rest
        u, v = region.coordinates(place)
        near = abs(float((place - region.path.middle) @ region.path.normal)) < region.span
        return bool(near and 0 <= u <= 1 and abs(v) <= 1)

    def heights(self, cache: ClipCache, clip: Clip) -> tuple[Floats, Floats]:
        """(frames,) seconds of a clip, and (frames,) height of the highest bump, scene units."""
        numbers = cache.numbers(self.ground, self.part, clip)
        return cache.times(clip), self.part.heights(self.plan.fine, clip, numbers)

    def seen(self, cache: ClipCache, clips: Sequence[Clip]) -> list[Seen]:
        """Its measurements and weights in each clip that moves its mesh."""
        return [cache.seen(self.ground, self.part, clip) for clip in moving_clips(self.plan, clips)]

    def greatest(self, cache: ClipCache, clips: Sequence[Clip]) -> tuple[Clip, float] | None:
        """The clip that raises it most, as a review finds it, and the time, seconds; None if no clip raises it."""
        found = tallest_clip([self.part.facts_in(self.plan, each) for each in self.seen(cache, clips)])
        return None if found is None else (next(each for each in clips if each.name == found["name"]), found["time"])


@dataclass(frozen=True, eq=False)
class AttachedBelow:
    """A muscle or a region of flesh on its mesh.

    Attributes:
        ground: The mesh with all drives.
        columns: Numbers of its morph targets among those of the mesh.
        span: Length of the muscle, or the region's radius, scene units.
        attached: The effect at rest; another object when its displacements are others.
    """

    ground: Ground
    columns: Ints
    span: float
    attached: AnyAttached

    @cached_property
    def outlined(self) -> Bools:
        """(triangles,) True for those of the coarse mesh that are inside the outline."""
        return np.asarray((self.excess[self.ground.surface.triangles] > 0).all(axis=1))

    @cached_property
    def excess(self) -> Floats:
        """(vertices,) of the coarse mesh, how far they move over what the outline does, over the largest move."""
        moved = np.sqrt((self.deltas**2).sum(axis=2)).max(axis=0)
        return np.asarray(moved / max(float(moved.max(initial=0.0)), TINY) - OUTLINED)

    def holds(self, _place: Floats, triangle: int) -> bool:
        """True if a (3,) place at rest, on a triangle of the coarse mesh, is inside the outline."""
        return bool(self.outlined[triangle])

    @property
    def touch(self) -> TouchDrive | None:
        """The drive of a touch; None for other effects."""
        return None if self.attached.drag is None else self.attached.drag.drive

    @property
    def deltas(self) -> Floats:
        """(targets, vertices, 3) displacements at weight 1, bind space."""
        return self.ground.surface.morph_deltas[self.columns]

    def heights(self, cache: ClipCache, clip: Clip) -> tuple[Floats, Floats]:
        """(frames,) seconds of a clip, and (frames,) the largest move of the skin, scene units."""
        weights = cache.weights(self.ground, clip)[:, self.columns]
        chosen, moves = moves_at_rest(self.ground.rest.blended, self.deltas)
        return cache.times(clip), largest_moves(weights, moves) if len(chosen) else np.zeros(len(weights))

    def clip_warnings(self, cache: ClipCache, clips: Sequence[Clip]) -> list[str]:
        """The warnings about clips that say too little of how it moves."""
        rig, moving = self.ground.rig, moving_nodes(self.ground.rig)
        own = [clip for clip in clips if any(channel.node in moving for channel in clip.channels)]
        weights = [cache.weights(self.ground, clip)[:, self.columns] for clip in own]
        return self.attached.clip_warnings(rig, list(zip(own, weights, strict=True)))

    def greatest(self, cache: ClipCache, clips: Sequence[Clip]) -> tuple[Clip, float] | None:
        """The clip in which the skin moves most, and the time, seconds; None if no clip moves it."""
        peaks = []
        for number, clip in enumerate(clips):
            times, heights = self.heights(cache, clip)
            at = int(np.argmax(heights))
            peaks.append((float(heights[at]), -number, float(times[at])))
        height, number, time = max(peaks, default=(0.0, 0, 0.0))
        return (clips[-number], time) if height > 0 else None


@dataclass(frozen=True, slots=True)
class AttachedTools:
    """All tools of a file on the meshes of an asset: those that fit, and a line for each that does not, by name.

    They are provisional if some are on triangles that were not refined for them. `below` are muscles and flesh.
    """

    meshes: tuple[PlayableMesh, ...]
    tools: dict[str, AttachedTool]
    below: dict[str, AttachedBelow]
    problems: dict[str, str]
    provisional: bool

    @property
    def every(self) -> dict[str, AttachedTool | AttachedBelow]:
        """All effects that fit."""
        return {**self.tools, **self.below}

    def warnings(self, cache: ClipCache, clips: Sequence[Clip], settings: ToolsFile) -> dict[str, list[str]]:
        """Collect the warnings of `check` by tool; those about whole meshes have an empty name."""
        found: dict[str, list[str]] = {}
        for tool in self.tools.values():
            lines = tool.part.words(tool.plan).warnings(tool.plan, tool.seen(cache, clips), settings.up)
            _add_by_name(found, [tool.attached.tool.name], lines)
        for plan in (cluster.plan for mesh in self.meshes for cluster in mesh.clusters):
            names = [part.attached.tool.name for part in skin_parts(plan)]
            for name, lines in _driven_warnings(plan, clips, settings):
                _add_by_name(found, [name], lines)
                names.append(name)
            _add_by_name(found, names, mesh_warnings(plan, settings, clips))
        for name, below in self.below.items():
            _add_by_name(found, [name], below.clip_warnings(cache, clips))
        return found

    def greatest_moves(self, cache: ClipCache, clips: Sequence[Clip]) -> dict[str, float]:
        """Measure how far each effect moves the skin at most in any clip, over its length, by name."""
        return {
            name: max((float(each.heights(cache, clip)[1].max()) for clip in clips), default=0.0) / each.span
            for name, each in self.every.items()
        }


def _driven_warnings(plan: MeshPlan, clips: Sequence[Clip], settings: ToolsFile) -> Iterator[tuple[str, list[str]]]:
    """The name and the warnings of each effect on the refined triangles of a plan that its drive alone moves."""
    sampling = SamplingOptions(settings.sampling.fps, "morph", Memory(), log_progress)
    for effect, seen in play_below_skin(plan, moving_clips(plan, clips), sampling):
        yield effect.name, effect.words.warnings(plan, seen, settings.up)


def _add_by_name(found: dict[str, list[str]], names: Iterable[str], lines: Iterable[str]) -> None:
    """Add each line to the name that it begins with."""
    for line in lines:
        name = next((each for each in names if line.startswith((f"{each}: ", f"{each} and "))), "")
        if line not in found.setdefault(name, []):
            found[name].append(line)
