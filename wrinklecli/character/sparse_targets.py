"""Reads and adds up morph targets at the few vertices that each moves, so that many of them cost little.

Source: glTF 2.0 §3.7.2.2 (morph targets), §3.6.2.3 (sparse accessors).
"""

from collections.abc import Iterator, Sequence
from functools import cached_property, partial

import numpy as np

from wrinklecli.character.rig import LARGEST, in_range
from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Array, Floats, Ints
from wrinklecli.numeric.memory import once

# Most targets that are added up by one product, zeros and all; more are if they move at least this part of all
# vertices each, in the mean: otherwise zeros would take too much memory.
_FEW_TARGETS, _FULL = 16, 0.125


@dataclass(frozen=True, slots=True)
class SparseDeltas:
    """The nonzero changes of one attribute by a morph target.

    Attributes:
        vertices: (changed,) distinct vertices.
        deltas: (changed, 3) at weight 1.
    """

    vertices: Ints
    deltas: Floats

    def of_rows(self, rows: Ints) -> "SparseDeltas":
        """The deltas of chosen vertices, by the (vertices,) new index of each; -1 if it is not chosen."""
        found = rows[self.vertices]
        return SparseDeltas(found[found >= 0], self.deltas[found >= 0])


def read_sparse_deltas(
    document: Document, primitives: Sequence[Json], starts: Ints, name: str, *, first: int, where: str
) -> list[SparseDeltas]:
    """Read the morph targets from `first` on of primitives with equally many targets, for one attribute.

    The vertices of the primitives follow one another, from (primitives + 1,) `starts`.

    Raises:
        AssetError: An accessor is malformed, has numbers that are not finite, or more elements than there are vertices.
    """
    read: dict[int, tuple[Ints, Array]] = {}
    found = []
    for number in range(first, len(primitives[0].get("targets", []))):
        parts = []
        for primitive, start, end in zip(primitives, starts.tolist(), starts[1:].tolist(), strict=False):
            accessor = primitive["targets"][number].get(name)
            if accessor is None:
                continue
            each = SparseDeltas(*once(read, accessor, partial(document.changes, accessor)))
            fits = each.deltas.shape[1:] == (3,) and each.vertices.max(initial=-1) < end - start
            if not fits or not in_range(each.deltas):
                message = f"accessor {accessor} must hold 3 finite numbers up to {LARGEST:g} for {end - start} vertices"
                raise AssetError(message, where=where)
            parts.append(SparseDeltas(each.vertices + start, each.deltas))
        found.append(_joined(parts))
    return found


def _joined(parts: Sequence[SparseDeltas]) -> SparseDeltas:
    """Concatenate the deltas of primitives."""
    vertices, deltas = [np.zeros(0, np.intp)], [np.zeros((0, 3))]
    for part in parts:
        if len(part.vertices):
            vertices.append(part.vertices)
            deltas.append(part.deltas)
    return SparseDeltas(np.concatenate(vertices), np.concatenate(deltas))


@dataclass(frozen=True)
class Targets:
    """Morph targets of one attribute, ready to be added up."""

    targets: tuple[SparseDeltas, ...]
    vertex_count: int

    def added(self, weights: Floats) -> Floats:
        """(frames, 3, vertices) sums of the deltas by (frames, targets) weights."""
        if len(self._moving) <= _FEW_TARGETS or self._moved >= _FULL * len(self._moving) * self.vertex_count:
            return (weights[:, self._moving] @ self._dense).reshape(len(weights), 3, self.vertex_count)
        total = np.zeros((len(weights), 3, self.vertex_count))
        for target, played in zip(self.targets, weights.T, strict=True):
            frames = np.flatnonzero(played)
            if len(frames) and len(target.vertices):
                moves = played[frames, None, None] * target.deltas.T
                total[np.ix_(frames, np.arange(3), target.vertices)] += moves
        return total

    def parts(self, ends: Sequence[int]) -> "Iterator[Targets]":
        """The targets of vertices up to each of some sorted ends, the last of which is the number of vertices."""
        pieces = []
        for target in self.targets:
            order = np.argsort(target.vertices)
            cuts = np.searchsorted(target.vertices[order], ends[:-1])
            vertices, deltas = target.vertices[order], target.deltas[order]
            pieces.append(zip(np.split(vertices, cuts), np.split(deltas, cuts), strict=True))
        for start, end, *some in zip([0, *ends[:-1]], ends, *pieces, strict=True):
            yield Targets(tuple(SparseDeltas(vertices - start, deltas) for vertices, deltas in some), end - start)

    @cached_property
    def _moving(self) -> Ints:
        """Numbers of the targets that move any vertex."""
        return np.flatnonzero([len(target.vertices) for target in self.targets])

    @cached_property
    def _moved(self) -> int:
        """The number of vertices that targets move, added up."""
        return sum(len(target.vertices) for target in self.targets)

    @cached_property
    def _dense(self) -> Floats:
        """(moving, 3 vertices) deltas with zeros, of the targets that move any."""
        dense = np.zeros((len(self._moving), 3, self.vertex_count))
        for row, number in zip(dense, self._moving.tolist(), strict=True):
            row[:, self.targets[number].vertices] = self.targets[number].deltas.T
        return dense.reshape(len(dense), 3 * self.vertex_count)
