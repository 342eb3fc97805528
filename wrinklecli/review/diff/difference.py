"""Records and helpers that all comparisons of two documents share.

A comparison is a function of the two documents (`Sides`). It yields differences, and links to objects that are to be
compared next, in the order in which people read them.
"""

from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import field
from typing import Any, Literal

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats

Kind = Literal["structure", "value", "geometry", "image", "animation", "pose"]
# Keys and indices from the top of a document's JSON.
Place = tuple[str | int, ...]

# Eight float32 roundings, relative: they are no difference. Between processors float64 results differ by 2e-14, so that
# some stored float32 round the other way, by 1.2e-7 of themselves, and a posed position is made of several.
ROUNDINGS = 8 * 2.0**-23
# Characters of a value that a message repeats.
_SHOWN = 60
_NO_PAIRS: Mapping[int, int] = {}


@dataclass(frozen=True, slots=True)
class Difference:
    """A difference between two files.

    Attributes:
        kind: structure: something is missing, added, renamed or linked otherwise. value: a JSON value. geometry: an
            attribute, a morph target, triangles or skin weights. image: its bytes. animation: a played value. pose:
            a posed position.
        place: JSON pointer in the first file, or in the second if only the second has the place.
        name: Name of the node, mesh, clip or material; empty if it has none.
        message: The difference in words.
        distance: Scene units, if a position differs.
    """

    kind: Kind
    place: str
    name: str
    message: str
    distance: float | None = None


@dataclass(frozen=True, slots=True)
class Link:
    """References of both documents to objects that are to be compared next.

    They are indices into the top-level array named `kind`, at a place of the first document; `name` is that of the
    object that refers, for messages.
    """

    kind: str
    first: int
    second: int
    place: Place
    name: object = None


Findings = Iterator[Difference | Link]


@dataclass(frozen=True, slots=True)
class Limits:
    """The greatest differences between numbers that count as equal.

    Attributes:
        length: For positions, scene units.
        ratio: For other numbers, relative to the greater of the number and 1.
        scales: Scene units for each bind unit in the stored pose, by mesh of the first file.
    """

    length: float
    ratio: float
    scales: Mapping[int, float] = field(default_factory=dict)

    def are_apart(self, one: float, other: float) -> bool:
        """True if two JSON numbers differ; whole numbers, which are counts or choices, must be equal."""
        if isinstance(one, int) and isinstance(other, int):
            return one != other
        return abs(one - other) > self.ratio * max(1.0, abs(one), abs(other))

    def slack(self, values: Floats, *, lengths: bool = False) -> float:
        """The greatest difference that counts as equal for numbers of this size."""
        least = max(1.0, self.length / self.ratio) if lengths else 1.0
        return self.ratio * max(least, float(np.abs(values).max(initial=0.0)))


@dataclass(frozen=True, slots=True)
class Sides:
    """Two documents side by side.

    Attributes:
        nodes: Nodes of `b` by the nodes of `a` with which they are paired.
        paired: The nodes of `b` that are paired.
        skinned: For each document, the meshes that all their nodes show with a skin.
        names: For each document, the name of each node, for messages.
    """

    a: Document
    b: Document
    limits: Limits
    nodes: Mapping[int, int]
    paired: frozenset[int]
    skinned: tuple[frozenset[int], frozenset[int]]
    names: tuple[list[str], list[str]]

    @classmethod
    def of(cls, a: Document, b: Document, limits: Limits, nodes: Mapping[int, int]) -> "Sides":
        """Make the record from pairs of nodes."""
        skinned, names = (_skinned_meshes(a), _skinned_meshes(b)), (_node_names(a), _node_names(b))
        return cls(a, b, limits, nodes, frozenset(nodes.values()), skinned, names)

    def items(self, kind: str, i: int, j: int) -> tuple[Json, Json]:
        """The objects i and j of a top-level array of the two documents."""
        return self.a.items(kind)[i], self.b.items(kind)[j]

    def have_same_node(self, i: int | None, j: int | None) -> bool:
        """True if two references lead to paired nodes, or both to none."""
        if i is not None and i in self.nodes:
            return self.nodes[i] == j
        return i == j and j not in self.paired


def _skinned_meshes(document: Document) -> frozenset[int]:
    """The meshes that all their nodes show with a skin."""
    shown, rigid = set[int](), set[int]()
    for node in document.items("nodes"):
        if "mesh" in node:
            (shown if "skin" in node else rigid).add(node["mesh"])
    return frozenset(shown - rigid)


def differ(kind: Kind, place: Place, message: str, *, name: object = "", distance: float | None = None) -> Difference:
    """Make a difference at a place; a name that is not a string is left out."""
    pointer = "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in place)
    return Difference(kind, pointer, name if isinstance(name, str) else "", message, distance)


def _node_names(document: Document) -> list[str]:
    return [str(node.get("name", f"node_{index}")) for index, node in enumerate(document.items("nodes"))]


def is_index(value: Any) -> bool:
    """True if a JSON value can be an index."""
    return isinstance(value, int) and not isinstance(value, bool)


def brief(value: Any) -> str:
    """A JSON value, shortened for a message."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def pairs_by_key(
    first: Mapping[int, Hashable], second: Mapping[int, Hashable], known: Mapping[int, int] = _NO_PAIRS
) -> dict[int, int]:
    """Pair items of two assets by their keys, behind known pairs; items with equal keys are paired in their order."""
    taken, waiting = set(known.values()), dict[Hashable, list[int]]()
    for j in reversed([*second]):
        if j not in taken:
            waiting.setdefault(second[j], []).append(j)
    pairs = dict(known)
    for i, key in first.items():
        if i not in known and waiting.get(key):
            pairs[i] = waiting[key].pop()
    return pairs


def without(items: Iterable[int], others: Iterable[Any]) -> list[int]:
    """The items that are not among the others."""
    known = set(others)
    return [each for each in items if each not in known]


def only_in_one(
    kind: str, names_a: Mapping[int, Any], names_b: Mapping[int, Any], pairs: Mapping[int, int]
) -> Iterator[Difference]:
    """Tell the objects of a kind that have no pair, by the names of those of each asset."""
    for side, names, others in (("A", names_a, pairs.keys()), ("B", names_b, pairs.values())):
        for index in without(names, others):
            yield differ("structure", (kind, index), f"only in {side}", name=names[index])
