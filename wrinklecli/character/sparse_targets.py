"""Morph targets that move few vertices each: read, kept and added up at those alone, so that many of them cost little.

Source: glTF 2.0 §3.7.2.2 (morph targets), §3.6.2.3 (sparse accessors).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.rig import LARGEST, in_range
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints


@dataclass(frozen=True, slots=True)
class SparseDeltas:
    """What a morph target adds to one attribute, where that is not 0.

    Attributes:
        vertices: (changed,) each once.
        deltas: (changed, 3) at weight 1.
    """

    vertices: Ints
    deltas: Floats

    def of_rows(self, rows: Ints) -> "SparseDeltas":
        """The same of chosen vertices, by their (vertices,) rows among these; -1 for those not chosen."""
        found = rows[self.vertices]
        return SparseDeltas(found[found >= 0], self.deltas[found >= 0])


def read_sparse_deltas(
    document: Document, primitives: Sequence[Json], starts: Ints, name: str, *, first: int, where: str
) -> list[SparseDeltas]:
    """Read the last morph targets of some primitives of a mesh, whose vertices follow one another.

    Args:
        document: The asset.
        primitives: With as many targets each.
        starts: (primitives + 1,) the first vertex of each.
        name: The attribute.
        first: The number of the first target to read.
        where: The mesh, for messages.

    Raises:
        AssetError: An accessor is malformed, has numbers that are not finite, or more elements than there are vertices.
    """
    read: dict[int, SparseDeltas] = {}
    found = []
    for number in range(first, len(primitives[0].get("targets", []))):
        parts = []
        for primitive, start, end in zip(primitives, starts.tolist(), starts[1:].tolist(), strict=False):
            accessor = primitive["targets"][number].get(name)
            if accessor is None:
                continue
            if accessor not in read:
                read[accessor] = SparseDeltas(*document.changes(accessor))
            each = read[accessor]
            fits = each.deltas.shape[1:] == (3,) and each.vertices.max(initial=-1) < end - start
            if not fits or not in_range(each.deltas):
                message = f"accessor {accessor} must hold 3 finite numbers up to {LARGEST:g} for {end - start} vertices"
                raise AssetError(message, where=where)
            parts.append(SparseDeltas(each.vertices + start, each.deltas))
        found.append(_joined(parts))
    return found


def _joined(parts: Sequence[SparseDeltas]) -> SparseDeltas:
    """What targets of primitives that follow one another change."""
    vertices, deltas = [np.zeros(0, np.intp)], [np.zeros((0, 3))]
    for part in parts:
        if len(part.vertices):
            vertices.append(part.vertices)
            deltas.append(part.deltas)
    return SparseDeltas(np.concatenate(vertices), np.concatenate(deltas))


def added(targets: Sequence[SparseDeltas], weights: Floats, vertex_count: int) -> Floats:
    """(frames, 3, vertices) what (frames, targets) weights of morph targets add to an attribute."""
    total = np.zeros((len(weights), 3, vertex_count))
    for target, played in zip(targets, weights.T, strict=True):
        frames = np.flatnonzero(played)
        if len(frames) and len(target.vertices):
            moved = played[frames, None, None] * target.deltas.T
            if len(frames) == len(weights):
                total[:, :, target.vertices] += moved
            else:
                total[np.ix_(frames, np.arange(3), target.vertices)] += moved
    return total
