"""Crossings of a refined surface, counted as on the surface before: what refinement alone has split counts once."""

from collections.abc import Sequence
from dataclasses import field, replace
from functools import cached_property

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import morph_weights
from wrinklecli.character.scene_surface import CrossingPairs, SceneSurface
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct, distinct_values
from wrinklecli.numeric.closest import Tree

# Greatest distance of a new vertex from the coarse triangle on which it lies, relative to the longest edge of that:
# where a tool may raise the surface, it is rounded by up to an eighth of an edge times the angle across it.
_FARTHEST = 0.1
# Least barycentric coordinate that counts: an edge that is halved four times gives multiples of 1/16, and rounding
# shifts these by less.
_LEAST_COORDINATE = 0.05
# Coarse vertices of a vertex that is not on the coarse surface, and fillers of rows.
_UNKNOWN, _NONE = -2, -1


@dataclass(frozen=True)
class CoarseCounter:
    """Reduces crossings of a refined surface to those that its coarse surface would have, where no new target moves it.

    A part of an edge or triangle counts as the whole, and an edge within a triangle, which the coarse surface has not,
    does not count there. Where new morph targets move the surface, all crossings count.

    Attributes:
        coarse: The surface before a bake.
        fine: The surface after it.
    """

    coarse: SceneSurface
    fine: SceneSurface
    # For each vertex of the fine surface that was asked for, the coarse vertices between which it lies.
    _known: dict[int, tuple[int, ...]] = field(default_factory=dict)

    @cached_property
    def level(self) -> SceneSurface:
        """The fine surface, which no new morph target moves."""
        meshes = []
        for number, mesh in enumerate(self.fine.meshes):
            places = mesh.skin.places.copy()
            places[:, 1:][:, self._new[number]] = 0.0
            meshes.append(replace(mesh, skin=replace(mesh.skin, places=places)))
        return replace(self.fine, meshes=tuple(meshes))

    @cached_property
    def _new(self) -> list[list[int]]:
        """For each mesh of the fine surface the numbers of the morph targets that the coarse one has not."""
        owned = {rig.node: rig.morph_names for rig in self.coarse.rigs}
        wholes = [owned.get(self.fine.rigs[whole].node) for whole in self.fine.wholes]
        return [
            [k for k, name in enumerate(rig.morph_names) if before is None or name not in before]
            for rig, before in zip(self.fine.rigs, wholes, strict=True)
        ]

    @property
    def is_moved(self) -> bool:
        """True if the fine surface has new morph targets."""
        return any(self._new)

    def reduced(self, clip: Clip | None, times: Floats, found: Sequence[CrossingPairs]) -> list[CrossingPairs]:
        """The crossings of each of (frames,) seconds of a clip, or without one of the stored pose, that count."""
        self._look_up([*(each.edges for each in found), *(each.triangles for each in found)])
        return [self._distinct(each, moved) for each, moved in zip(found, self._moved(clip, times), strict=True)]

    def _distinct(self, found: CrossingPairs, moved: Bools) -> CrossingPairs:
        """The crossings that count while the (vertices,) `moved` are moved by new targets."""
        if not len(found.edges):
            return found
        edges, triangles = (self._wholes(each, moved) for each in (found.edges, found.triangles))
        # Within a triangle, or at one that shares a corner, a coarse surface has no crossing.
        whole = (edges[:, 0] == 0) & (triangles[:, 0] == 0)
        beside = (edges[:, 1:, None] == triangles[:, None, 1:]) & (edges[:, 1:, None] != _NONE)
        counting = np.flatnonzero(~(whole & ((edges[:, 3] != _NONE) | beside.any(axis=(1, 2)))))
        firsts, _ = distinct(np.hstack([edges, triangles])[counting])
        chosen = np.sort(counting[firsts])
        return CrossingPairs(found.edges[chosen], found.triangles[chosen])

    def _wholes(self, parts: Ints, moved: Bools) -> Ints:
        """(parts, 4) a row for each of (parts, corners), equal for parts of one coarse edge or triangle.

        A row begins with 0 and has coarse vertices, sorted, or begins with 1 and has the corners.
        """
        known = np.full((len(parts), parts.shape[1], 3), _NONE)
        for corner, vertices in enumerate(parts.T):
            for row, vertex in enumerate(vertices.tolist()):
                found = self._known[vertex]
                known[row, corner, : len(found)] = found
        between = np.sort(known.reshape(len(parts), -1), axis=1)
        # Of equal neighbours the first goes.
        between[:, :-1][between[:, :-1] == between[:, 1:]] = _NONE
        between = np.sort(between, axis=1)[:, ::-1]
        still = ~moved[parts].any(axis=1) & (between[:, -1] != _UNKNOWN) & (between[:, 3:] == _NONE).all(axis=1)
        rows = np.full((len(parts), 4), _NONE)
        rows[:, 0] = ~still
        rows[:, 1 : 1 + parts.shape[1]] = parts
        rows[still, 1:] = between[still, :3]
        return rows

    def _moved(self, clip: Clip | None, times: Floats) -> Bools:
        """(frames, vertices) True where morph targets that the coarse surface has not move the fine one."""
        moved = np.zeros((len(times), len(self.fine.positions)), bool)
        for number, mesh in enumerate(self.fine.meshes):
            rig, skin = mesh.rig, mesh.skin
            there = slice(self.fine.starts[number], self.fine.starts[number + 1])
            new = self._new[number]
            acting = morph_weights(rig, clip, times)[:, new] != 0
            moved[:, there] = acting @ skin.places[:, 1:][:, new].any(axis=0)
        return moved

    def _look_up(self, asked: Sequence[Ints]) -> None:
        """Find the coarse vertices between which the vertices of some edges and triangles lie."""
        vertices = distinct_values(np.concatenate([np.zeros(0, np.intp), *(each.reshape(-1) for each in asked)]))
        fresh = np.array([vertex for vertex in vertices.tolist() if vertex not in self._known], np.intp)
        owners = np.searchsorted(self.fine.starts, fresh, side="right") - 1
        for part in distinct_values(owners).tolist():
            chosen = fresh[owners == part]
            node = self.fine.rigs[self.fine.wholes[part]].node
            whole = next((number for number, rig in enumerate(self.coarse.rigs) if rig.node == node), None)
            if whole is None:
                self._known.update(dict.fromkeys(chosen.tolist(), (_UNKNOWN,)))
                continue
            places = self.fine.meshes[part].skin.places[:, 0, chosen - self.fine.starts[part]].T
            self._known.update(zip(chosen.tolist(), self._between(whole, places), strict=True))

    def _between(self, whole: int, places: Floats) -> list[tuple[int, ...]]:
        """The vertices of a coarse surface between which each of (places, 3) lies, bind space."""
        start, end = self.coarse.starts[whole : whole + 2]
        positions = np.ascontiguousarray(self.coarse.meshes[whole].skin.places[:, 0].T)
        every = self.coarse.crossings.triangles
        triangles = every[(every[:, 0] >= start) & (every[:, 0] < end)] - start
        found = list[tuple[int, ...]]()
        for place, triangle, coordinates, nearest in zip(
            places, *Tree.of(positions, triangles).closest_points(places), strict=True
        ):
            corners = triangles[triangle]
            edges = positions[corners] - positions[np.roll(corners, 1)]
            on_it = np.linalg.norm(nearest - place) <= _FARTHEST * np.linalg.norm(edges, axis=1).max()
            between = corners[coordinates > _LEAST_COORDINATE] + start
            found.append(tuple(between.tolist()) if on_it else (_UNKNOWN,))
        return found
