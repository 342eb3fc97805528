"""Folds: the surface round a joint that bends between the ends of some tools, posed with all its wrinkles and fields.

Not in the paper, which names contact as a goal. Contact is solved for each fold on its own, that is for the tools over
one joint and the surface round it that may touch.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import chain
from typing import Any, Protocol, TypeAlias

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Rig
from wrinklecli.character.skin import SkinnedMesh
from wrinklecli.choices import Part
from wrinklecli.effects.contact.hinge import Hinge, hinge_of
from wrinklecli.effects.contact.pose_faults import unless_degenerate
from wrinklecli.effects.contact.rise import Rise, rise_of
from wrinklecli.effects.contact.tissue import FREE, SOFT, UNITS, Tissue
from wrinklecli.effects.kept import kept_search
from wrinklecli.effects.wrinkle.activity import activities
from wrinklecli.effects.wrinkle.bending import bent_node
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.lookup import looked_up
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, components, distinct_values, flags_of
from wrinklecli.numeric.closest import nearest_of
from wrinklecli.numeric.intersections import Crossings, widened
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import Contact

RINGS = 3
"""Least number of edges from a crossing to vertices that stand still: on a coarse limb the next neighbours did."""
FAINT = 1 / 64
"""Part of a height that nobody sees. It stands for the skin alone: where that is exactly as it was, sides that are
symmetric touch by chance, and do not count as crossing."""
# Distance from the joint in which the surface may touch or give way, in radii of the limb: thighs and calves swell.
REACH_RADII = 3.6
# Least radius of the limb, in lengths of the segment: a joint may lie in the skin.
_LEAST_RADIUS = 0.25
# Poses on the way to either end of a joint's range in which other meshes are checked for nearness.
_NEARNESS_POSES = 4
# Moments of a clip at which other meshes are checked for crossing themselves, at most.
_MOMENTS = 8


Look: TypeAlias = tuple[Clip, Floats]
"""A motion, and (frames,) seconds of it."""
Poses: TypeAlias = Iterator[tuple[Floats, Floats]]
"""Frame by frame (vertices, 3) positions in world space, and (vertices, 3, 3) matrices from bind space."""
Search: TypeAlias = Callable[[Poses], Ints]
"""Finds numbers from 0 on in poses."""


def evenly(count: int, most: int) -> Ints:
    """(chosen,) indices of at most so many things of a count, evenly spread with both ends."""
    return distinct_values(np.linspace(0, count - 1, most if count else 0).astype(int))


class Mover(Protocol):
    """A field, or contact that is resolved, in folds."""

    @property
    def vertices(self) -> Ints:
        """(vertices,) sorted fine vertices that it moves."""

    def displacements(self, fine: Refinement, rig: Rig, clip: Clip | None, times: Floats) -> Floats:
        """(frames, vertices, 3) displacements of these, bind space."""


Movers: TypeAlias = Sequence[Mover]


@dataclass(frozen=True)
class Fold:
    """The surface round a joint, with all tools that wrinkle it.

    Attributes:
        patches: The tools whose contact is resolved here, as they are baked.
        hinge: The joint, or the motion that raises the tools' wrinkles if no joint bends.
        vertices: (vertices,) sorted fine welded vertices.
        triangles: (triangles, 3) indices into `vertices`, followed by the vertices of other meshes.
        own: (vertices,) False for vertices of other meshes, and for those that are not connected with the tools.
        radius: Radius of the limb, scene units.
        pivot: (3,) place of the joint at rest, world space.
        rig: The mesh's joints.
        rest: Its rest pose.
        fine: The refined surface.
        carried: All tools on the mesh.
        movers: All that moves it beside these.
        crossed: (vertices,) True for those that cross without contact, in the fold's own motion or in clips.
        others: The parts of other meshes that may touch the fold.
        parts: The folds of which this is the union; none in a fold of one joint.
    """

    patches: tuple[Patch, ...]
    hinge: Hinge | Rise
    vertices: Ints
    triangles: Ints
    own: Bools
    radius: float
    pivot: Floats
    rig: Rig
    rest: Rest
    fine: Refinement
    carried: tuple[CarriedPatch, ...]
    crossed: Bools
    movers: tuple[Mover, ...] = ()
    others: tuple[SkinnedMesh, ...] = ()
    parts: "tuple[Fold, ...]" = ()

    @property
    def per_clip(self) -> bool:
        """True if targets may depend on the clips, as all tools allow."""
        return all((each.tool.contact or Contact()).per_clip for each in self.patches)

    @property
    def ignored(self) -> set[str]:
        """Names of the nodes whose meshes its tools ignore."""
        return {name for each in self.patches for name in (each.tool.contact or Contact()).ignore}

    @property
    def tools(self) -> tuple[str, ...]:
        """The names of the tools whose contact is resolved here."""
        return tuple(each.tool.name for each in self.patches)

    @cached_property
    def own_tools(self) -> list[int]:
        """The numbers of the tools whose contact is resolved here, among those of the mesh."""
        return [number for number, each in enumerate(self.carried) if each.patch.tool.name in self.tools]

    @cached_property
    def raised(self) -> Bools:
        """(vertices,) True for those that these tools may move."""
        moved = [self.shared_with(self.carried[number].vertices)[0] for number in self.own_tools]
        return flags_of(np.concatenate([np.zeros(0, np.intp), *moved]), len(self.own))

    @property
    def crosses(self) -> bool:
        """True if anything of its own crosses without contact."""
        return bool(self.crossed[self.own].any())

    @cached_property
    def apart(self) -> Floats:
        """(vertices,) distance at rest from the vertices that cross, solver's units.

        Where edges are long, a vertex counts as nearer, so that corrections fade over at least `RINGS` edges.
        """
        marked, places = self.crossed, self.rest_positions
        apart = nearest_of(places[marked], places)[0] * UNITS / self.radius
        for ring in range(1, RINGS + 1):
            marked, within = widened(self.crossings.edges, marked), marked
            apart = np.where(marked & ~within, np.minimum(apart, FREE * SOFT * ring / (RINGS + 1)), apart)
        return apart

    @property
    def near(self) -> Bools:
        """(vertices,) True for those so near to what crosses that contact may move them."""
        return self.apart < FREE * SOFT

    @property
    def solved_part(self) -> "Fold":
        """The part of which contact may move a corner; nothing that changes further away changes its solution."""
        return self.part(np.asarray(self.near[self.triangles].any(axis=1)))

    @property
    def counted_part(self) -> "Fold":
        """The part of which contact or the fold's tools may move a corner: crossings are counted in it."""
        return self.part(np.asarray((self.near | self.raised)[self.triangles].any(axis=1)))

    def part(self, chosen: Bools) -> "Fold":
        """The fold with the chosen (triangles,) and their vertices only."""
        vertices, local = np.unique(self.triangles[chosen], return_inverse=True)
        ends = len(chosen) - np.cumsum([len(each.triangles) for each in self.others][::-1], dtype=int)[::-1]
        others = zip(self.others, np.split(chosen, ends)[1:], strict=True)
        return replace(
            self,
            vertices=self.vertices[vertices[vertices < len(self.vertices)]],
            triangles=local.reshape(-1, 3),
            own=self.own[vertices],
            crossed=self.crossed[vertices],
            others=tuple(other.part(some) for other, some in others if some.any()),
        )

    @property
    def border(self) -> Bools:
        """(vertices,) True for its mesh's vertices with triangles beyond the fold, which must stay."""
        inside = np.bincount(self.triangles.reshape(-1), minlength=len(self.own))[: len(self.vertices)]
        starts = self.fine.around.starts
        return np.asarray(starts[self.vertices + 1] - starts[self.vertices] > inside)

    @cached_property
    def free(self) -> Bools:
        """(vertices,) True for those that the solver may move."""
        free = self.near
        free[: len(self.vertices)] &= ~self.border
        return free

    @cached_property
    def tissue(self) -> Tissue:
        """The fold as the solver sees it; nothing of it may collide if the surface is degenerate."""
        edges, crossed = self.crossings.at(self.rest_positions)
        # Triangles without a free corner never touched one.
        colliding = np.asarray(self.free[self.triangles].any(axis=1))
        colliding[crossed] = False
        through = np.zeros(len(self.free), bool)
        through[self.crossings.edges[edges]] = True
        colliding[(through & ~self.own)[self.triangles].any(axis=1)] = False
        rest = self.rest_positions * UNITS / self.radius
        tissue = Tissue(rest, self.triangles, colliding, self.free, self.own, self.apart)
        return unless_degenerate(tissue.ready) or replace(tissue, colliding=np.zeros_like(colliding))

    @property
    def free_vertices(self) -> Ints:
        """(free,) sorted fine vertices that the solver may move."""
        return self.vertices[np.flatnonzero(self.free & self.own)]

    @property
    def joint(self) -> str | None:
        """Name of the joint that bends it, if one does."""
        return self.rig.names[self.hinge.signal.node] if isinstance(self.hinge, Hinge) else None

    def degrees(self, clip: Clip, times: Floats) -> Floats | None:
        """(frames,) turns of that joint at (frames,) seconds of a clip."""
        return np.degrees(self.hinge.reading(self.rig, clip, times).rows) if isinstance(self.hinge, Hinge) else None

    def strides(self, clip: Clip, times: Floats) -> Floats:
        """(frames, parts) angles of the joints at (frames,) seconds of a clip, in strides."""
        return np.stack([each.hinge.strides(self.rig, clip, times) for each in self.parts or (self,)], axis=1)

    @cached_property
    def rest_positions(self) -> Floats:
        """(vertices, 3) world space at rest, followed by the vertices of other meshes."""
        others = [each.carried(self.rest.clip, self.rest.time)[0][0] for each in self.others]
        return np.concatenate([self.fine.rest_positions[self.vertices], *others])

    @cached_property
    def mesh(self) -> SkinnedMesh:
        """Its vertices, ready to be posed without wrinkles."""
        return self.fine.skinned(self.rig, self.vertices)

    @cached_property
    def crossings(self) -> Crossings:
        """The edges and triangles that may cross."""
        return Crossings.of(self.rest_positions, self.triangles)

    @cached_property
    def moved(self) -> list[tuple[CarriedPatch, Ints, Ints]]:
        """The tools that move any vertices, the indices of these here, and their indices among the tool's."""
        return [(each, *both) for each in self.carried if len((both := self.shared_with(each.vertices))[0])]

    def shared_with(self, vertices: Ints) -> tuple[Ints, Ints]:
        """The indices here, and among others, of (others,) sorted fine vertices that are in both."""
        _, here, there = np.intersect1d(self.vertices, vertices, assume_unique=True, return_indices=True)
        return here, there

    def _amplitudes(self, clip: Clip | None, times: Floats) -> list[Floats]:
        """The (frames, groups, modes) amplitudes of the tools in `moved` at (frames,) seconds of a clip.

        Nothing lags in a motion that no file has (of index -1), since it stands for all clips, fast or slow.
        """
        patches = [carried.patch for carried, *_ in self.moved]
        if clip is not None and clip.index < 0:
            known = dict[int, Floats]()
            return [looked_up(each.curve, each.segment.lengths(self.rig, clip, times, known)) for each in patches]
        return [each.amplitudes for each in activities(patches, self.rig, clip, times)]

    def at_height(self, factor: float) -> "Fold":
        """The fold with the wrinkles of its own tools at a part of their height."""
        carried = [
            each.times(np.full(len(each.vertices), factor)) if number in self.own_tools else each
            for number, each in enumerate(self.carried)
        ]
        return replace(self, carried=tuple(carried))

    def poses(self, clip: Clip | None, times: Floats, moves: Movers = ()) -> Poses:
        """Pose the wrinkled surface at (frames,) seconds of a clip, followed by the vertices of other meshes.

        Other `moves` add to those of `movers`.
        """
        amplitudes = self._amplitudes(clip, times)
        for part in portions(len(times), 8 * len(self.vertices)):
            now, offsets = times[part], np.zeros((len(times[part]), len(self.vertices), 3))
            for (carried, here, there), own in zip(self.moved, amplitudes, strict=True):
                offsets[:, here] += displacements(carried, self.fine, self.rig, clip, now, own[part])[:, there]
            for each in (*self.movers, *moves):
                here, there = self.shared_with(each.vertices)
                offsets[:, here] += each.displacements(self.fine, self.rig, clip, now)[:, there]
            every = [self.mesh.carried(clip, now, offsets), *(each.carried(clip, now) for each in self.others)]
            yield from zip(*(np.concatenate(each, axis=1) for each in zip(*every, strict=True)), strict=True)

    def inputs(self, clip: Clip | None, times: Floats, moves: Movers = ()) -> Iterator[Any]:
        """The arrays on which `poses` depends, and on nothing else; to pose takes ten times as long."""
        for each in (self.mesh, *self.others):
            yield from each.inputs(clip, times)
        for (carried, here, there), amplitudes in zip(self.moved, self._amplitudes(clip, times), strict=True):
            yield here
            if carried.ring is None:
                yield from (carried.patch.clip_strength(clip) * amplitudes, carried.shapes[..., there])
                yield carried.directions[there]
            else:
                yield displacements(carried, self.fine, self.rig, clip, times, amplitudes)[:, there]
        for mover in (*self.movers, *moves):
            here, there = self.shared_with(mover.vertices)
            yield from (here, mover.displacements(self.fine, self.rig, clip, times)[:, there])

    def searched(self, looks: Sequence[Look], count: int, search: Search, *inputs: Any, moves: Movers = ()) -> Ints:
        """(count,) numbers that a search finds in the fold's poses, from where they are kept by what it depends on.

        Args:
            looks: Motions, and (frames,) seconds of each.
            count: Number of what is found.
            search: Finds it in `poses`.
            inputs: The arrays on which the search depends besides, but the triangles and rest positions of the fold.
            moves: As `poses` takes them.
        """
        looks, fixed = [look for look in looks if len(look[1])], [self.triangles, self.rest_positions, *inputs]
        known = chain(fixed, *(self.inputs(*look, moves) for look in looks))
        poses = chain.from_iterable(self.poses(*look, moves) for look in looks)
        return kept_search(partial(search, poses), search.__qualname__, count, known)

    def meshes_crossing_themselves(self, clip: Clip, times: Floats) -> set[str]:
        """Nodes with other meshes that cross themselves at some of (frames,) seconds of a clip, and not at rest."""
        chosen, found = times[evenly(len(times), _MOMENTS)], set[str]()
        for each in self.others:
            (rest,), _ = each.carried(self.rest.clip, self.rest.time)
            trees = Crossings.of(rest, each.triangles)
            if not trees.pairs_at(rest) and any(map(trees.pairs_at, each.carried(clip, chosen)[0])):
                found.add(each.rig.node_name)
        return found


def find_folds(
    carried_patches: Sequence[CarriedPatch],
    chosen: Sequence[int],
    fine: Refinement,
    rest: Rest,
    rig: Rig,
    parts: Sequence[Part | None],
    obstacles: Callable[[Collection[str]], Sequence[SkinnedMesh]] | None = None,
    movers: Sequence[Mover] = (),
) -> tuple[list[Fold], list[int]]:
    """Find the folds of the chosen tools, and the tools that nothing shortens; tools over one joint share a fold.

    `parts` names the part of a body that each node moves, if known. `obstacles` gives the other meshes, without the
    meshes of nodes with some names.
    """
    motions: dict[int | bytes, list[int]] = {}
    rises: dict[int, Rise] = {}
    folds, without, none = list[Fold](), list[int](), np.zeros(0, np.intp)
    given: Mapping[str, Any] = {"rig": rig, "rest": rest, "fine": fine, "movers": tuple(movers)}
    bare = partial(Fold, vertices=none, triangles=none.reshape(0, 3), own=none > 0, crossed=none > 0, **given)
    for number in chosen:
        patch = carried_patches[number].patch
        motion: int | bytes | None = bent_node(patch, rig)
        rise = rise_of(patch, rig) if motion is None else None
        if rise is not None:
            rises[number], motion = rise, rise.motion.motion
        if motion is None:
            without.append(number)
        else:
            motions.setdefault(motion, []).append(number)
    for node, numbers in motions.items():
        carried = list(carried_patches)
        if isinstance(node, int):
            patches = [carried[number].patch for number in numbers]
            pivot = node_matrices(rig, rest.clip, rest.time, [node])[0, 0, :3, 3]
            radius, spread = max(_limb_radius(patch, pivot) for patch in patches), 0.0
            hinge: Hinge | Rise = hinge_of(node, patches, pivot, rig, parts[node])
        else:
            # The fold of tools that rise together counts as thick as the longest of them is long.
            patches = [rises[number].patch for number in numbers]
            for number, patch in zip(numbers, patches, strict=True):
                carried[number] = replace(carried[number], patch=patch)
            middles = np.array([np.mean([anchor.position for anchor in patch.anchors], axis=0) for patch in patches])
            pivot, radius, hinge = middles.mean(axis=0), max(patch.span for patch in patches), rises[numbers[0]]
            spread = float(np.sqrt(np.sum((middles - pivot) ** 2, axis=1)).max())
        empty = bare(patches=tuple(patches), hinge=hinge, radius=radius, pivot=pivot, carried=tuple(carried))
        fold = _within(empty, REACH_RADII * radius + spread)
        folds.append(_with_obstacles(fold, obstacles(fold.ignored) if obstacles else ()))
    return folds, without


def _with_obstacles(fold: Fold, obstacles: Sequence[SkinnedMesh]) -> Fold:
    """Add the parts of other meshes that come near a fold in its joint's motion, by their bounding boxes."""
    times, clips = np.linspace(0.0, 1.0, _NEARNESS_POSES), [clip for clip, _ in fold.hinge.sweeps]
    posed = (np.array([places for places, _ in fold.poses(clip, times)]) for clip in clips)
    boxes = [(places.min(axis=1), places.max(axis=1)) for places in posed]
    triangles, others, count = [fold.triangles], list[SkinnedMesh](), len(fold.vertices)
    for obstacle in obstacles:
        near = np.zeros(len(obstacle.triangles), bool)
        for clip, (low, high) in zip(clips, boxes, strict=True):
            corners = obstacle.carried(clip, times)[0].take(obstacle.triangles, axis=1)
            meeting = (corners.max(axis=2) >= low[:, None]) & (corners.min(axis=2) <= high[:, None])
            near |= meeting.all(axis=2).any(axis=0)
        if near.any():
            others.append(obstacle.part(near))
            triangles.append(others[-1].triangles + count)
            count += len(others[-1].bind_positions)
    own = np.concatenate([fold.own, np.zeros(count - len(fold.own), bool)])
    return replace(
        fold, others=tuple(others), triangles=np.concatenate(triangles), own=own, crossed=np.zeros(len(own), bool)
    )


def _within(fold: Fold, reach: float) -> Fold:
    """A fold with the fine vertices within reach of its joint, and a few edges further."""
    fine, seeds = fold.fine, np.concatenate([fold.carried[number].vertices for number in fold.own_tools])
    near = np.sum((fine.rest_positions - fold.pivot) ** 2, axis=1) <= reach**2
    near[seeds] = True
    for _ in range(RINGS):
        near[fine.triangles[near[fine.triangles].any(axis=1)]] = True
    return _between(fold, near, seeds)


def grown(fold: Fold, further: Ints, distance: float) -> Fold:
    """The same fold with all of its mesh that is within a distance of some fine vertices at rest, scene units."""
    places = fold.fine.rest_positions
    near = np.isfinite(nearest_of(places[further], places, within=distance)[0])
    near[fold.vertices] = True
    return _between(fold, near, fold.vertices[fold.own[: len(fold.vertices)]])


def _between(fold: Fold, near: Bools, seeds: Ints) -> Fold:
    """The same fold with the part of its mesh between the (fine vertices,) that are near.

    Its own are those that are connected with some of (seeds,).
    """
    triangles, count = fold.fine.triangles[near[fold.fine.triangles].all(axis=1)], len(fold.vertices)
    vertices, local = np.unique(triangles, return_inverse=True)
    local = local.reshape(-1, 3)
    pieces = components(local[:, [0, 1, 1, 2]].reshape(-1, 2), len(vertices))
    own = np.isin(pieces, distinct_values(pieces[np.isin(vertices, seeds)]))
    if fold.rig.node_name in fold.ignored:
        local = (np.cumsum(own) - 1)[local[own[local[:, 0]]]]
        vertices, own = vertices[own], own[own]
    others = fold.triangles[fold.triangles[:, 0] >= count] + (len(vertices) - count)
    crossed = np.isin(vertices, fold.vertices[fold.crossed[:count]])
    return replace(
        fold,
        vertices=vertices,
        triangles=np.concatenate([local, others]),
        own=np.concatenate([own, fold.own[count:]]),
        crossed=np.concatenate([crossed, fold.crossed[count:]]),
    )


def _limb_radius(patch: Patch, pivot: Floats) -> float:
    """Distance of a joint from a tool's segment, scene units."""
    apart = pivot - patch.origin.position
    away = apart - np.clip(apart @ patch.along, 0.0, patch.span) * patch.along
    return max(float(np.linalg.norm(away)), _LEAST_RADIUS * patch.span)
