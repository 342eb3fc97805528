"""Differences between two documents: the record of one, and what all comparisons of documents share.

A comparison is a function of the two documents side by side (`Sides`) and yields what it finds in the order in which
people read it: differences, and links to what is to be compared next.
"""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats

Kind = Literal["structure", "value", "geometry", "image", "animation", "pose"]
Place = tuple[str | int, ...]  # keys and indices from the top of a document's JSON

# Between processors float64 results differ by 2e-14, so that now and then a stored float32 rounds the other way, by
# 1.2e-7 of itself; a posed position is made of several. So: eight such roundings are no difference.
ROUNDINGS = 8 * 2.0**-23
_SHOWN = 60  # characters of a value that a message repeats


@dataclass(frozen=True, slots=True)
class Difference:
    """One thing in which two files differ.

    Attributes:
        kind: structure: something is missing, added, renamed or linked otherwise. value: a JSON value. geometry: an
            attribute, a morph target, triangles or skin weights. image: its bytes. animation: a played value. pose:
            what a viewer sees.
        place: JSON pointer in the first file; in the second where only that has it.
        name: Of the node, mesh, clip or material, for people; empty where it has none.
        message: What differs.
        distance: Scene units, where what differs is a place.
    """

    kind: Kind
    place: str
    name: str
    message: str
    distance: float | None = None


@dataclass(frozen=True, slots=True)
class Link:
    """References of both documents that lead to what is to be compared next, unless it has been.

    Attributes:
        kind: The top-level array that they point into.
        first: Index there in the first document.
        second: In the second.
        place: Of the reference, in the first.
        name: Of what refers, for people.
    """

    kind: str
    first: int
    second: int
    place: Place
    name: object = None


Found = Iterator[Difference | Link]


@dataclass(frozen=True, slots=True)
class Limits:
    """How far numbers may be apart.

    Attributes:
        length: Of places, scene units.
        share: Of numbers that are no lengths, of the greater of the number and 1.
        scales: By mesh of the first file, how many scene units a bind unit is in the stored pose.
    """

    length: float
    share: float
    scales: Mapping[int, float] = field(default_factory=dict)

    def are_apart(self, one: float, other: float) -> bool:
        """Whether two JSON numbers differ; whole ones are counts or choices."""
        if isinstance(one, int) and isinstance(other, int):
            return one != other
        return abs(one - other) > self.share * max(1.0, abs(one), abs(other))

    def slack(self, values: Floats, *, lengths: bool = False) -> float:
        """How far numbers like these may be apart."""
        least = max(1.0, self.length / self.share) if lengths else 1.0
        return self.share * max(least, float(np.abs(values).max(initial=0.0)))


@dataclass(frozen=True, slots=True)
class Sides:
    """Two documents side by side.

    Attributes:
        a: The first.
        b: The second.
        limits: How far numbers may be apart.
        nodes: Nodes of the second by those of the first that they are paired with.
        paired: The nodes of the second that are paired.
        skinned: Of each, the meshes of which every node that shows them has a skin.
    """

    a: Document
    b: Document
    limits: Limits
    nodes: Mapping[int, int]
    paired: frozenset[int]
    skinned: tuple[frozenset[int], frozenset[int]]

    @classmethod
    def of(cls, a: Document, b: Document, limits: Limits, nodes: Mapping[int, int]) -> "Sides":
        """Of two documents, by pairs of their nodes."""
        return cls(a, b, limits, nodes, frozenset(nodes.values()), (_skinned_meshes(a), _skinned_meshes(b)))

    def items(self, kind: str, i: int, j: int) -> tuple[Json, Json]:
        """An object of a top-level array in either document."""
        return self.a.items(kind)[i], self.b.items(kind)[j]

    def have_same_node(self, i: int | None, j: int | None) -> bool:
        """Whether two references, if they are any, lead to paired nodes."""
        if i is not None and i in self.nodes:
            return self.nodes[i] == j
        return i == j and j not in self.paired


def _skinned_meshes(document: Document) -> frozenset[int]:
    """The meshes of which every node that shows them has a skin."""
    shown, rigid = set[int](), set[int]()
    for node in document.items("nodes"):
        if "mesh" in node:
            (shown if "skin" in node else rigid).add(node["mesh"])
    return frozenset(shown - rigid)


def differ(kind: Kind, place: Place, message: str, *, name: object = "", distance: float | None = None) -> Difference:
    """A difference at a place; a name that is no text is left out."""
    pointer = "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in place)
    return Difference(kind, pointer, name if isinstance(name, str) else "", message, distance)


def node_names(document: Document) -> list[str]:
    """The name of each node, for people."""
    return [str(node.get("name", f"node_{index}")) for index, node in enumerate(document.items("nodes"))]


def is_index(value: Any) -> bool:
    """Whether a JSON value can be an index."""
    return isinstance(value, int) and not isinstance(value, bool)


def shown(value: Any) -> str:
    """A JSON value as messages repeat it."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def pairs_by_key(
    first: Sequence[int], second: Sequence[int], key_a: Callable[[int], Hashable], key_b: Callable[[int], Hashable]
) -> dict[int, int]:
    """Items of the second list by those of the first with equal keys; those of the same key in their order."""
    waiting: dict[Hashable, list[int]] = {}
    for j in reversed(second):
        waiting.setdefault(key_b(j), []).append(j)
    pairs = {}
    for i in first:
        found = waiting.get(key_a(i))
        if found:
            pairs[i] = found.pop()
    return pairs


def without(items: Iterable[int], others: Iterable[Any]) -> list[int]:
    """The items that are none of the others."""
    known = set(others)
    return [each for each in items if each not in known]
