"""Compare two documents by their meaning, not by how they are stored.

Nodes are paired by their names from the roots down, other objects through their references. Accessors are compared as
decoded numbers, images as bytes, animations by the values that they play. So these make no difference: the order and
layout of accessors, buffer views and buffers; sparse, dense or compressed storage; .gltf or .glb; a default value or no
value; and `asset.generator`.

Source: glTF 2.0 specification, §3 (concepts).
"""

from collections.abc import Callable, Iterator, Sequence

from wrinklecli.character.rig import Hierarchy, read_hierarchy, read_rig
from wrinklecli.errors import AssetError
from wrinklecli.gltf.shape import COMPRESSIONS
from wrinklecli.review.diff.animations import animation_differences
from wrinklecli.review.diff.difference import (
    Difference,
    Findings,
    Link,
    Place,
    Sides,
    differ,
    only_in_one,
    pairs_by_key,
    without,
)
from wrinklecli.review.diff.meshes import image_differences, mesh_differences
from wrinklecli.review.diff.nodes import node_differences
from wrinklecli.review.diff.skins import influence_differences, joint_pairs, skin_differences, stored_influences
from wrinklecli.review.diff.values import accessor_differences, dict_differences

# Top-level arrays that say how data is stored.
_STORAGE = ("accessors", "bufferViews", "buffers")
# Top-level arrays whose objects are compared where they are referred to.
_REFERRED = ("meshes", "images", "materials", "textures", "samplers", "cameras", "skins")
_COMPARED = (*_REFERRED, "nodes", "scenes", "animations")
# Comparisons of objects that are more than their JSON.
_COMPARISONS: dict[str, Callable[[Sides, int, int], Findings]] = {
    "meshes": mesh_differences,
    "images": image_differences,
    "skins": skin_differences,
}


def document_differences(sides: Sides, *, clips: Sequence[str] = ()) -> list[Difference]:
    """All differences between two documents but those of how their nodes are paired.

    Only the named clips are compared, or all without names.

    Raises:
        AssetError: A document is malformed.
    """
    walk = _Walk(sides)
    return [
        *walk.node_differences(),
        *walk.follow(_scene_differences(sides)),
        *walk.follow(animation_differences(sides, clips)),
        *walk.unreferenced_differences(),
        *walk.follow(_top_differences(sides)),
    ]


class _Walk:
    """Follows links through two documents; `met` has the kinds and indices of the pairs that were compared."""

    def __init__(self, sides: Sides) -> None:
        self.sides = sides
        self.met: set[tuple[str, int, int]] = set()

    def follow(self, found: Findings) -> Iterator[Difference]:
        """Yield differences, and for each link the differences of the objects to which it leads."""
        sides = self.sides
        for each in found:
            if isinstance(each, Difference):
                yield each
                continue
            # References of materials may be broken.
            ends = (sides.a, each.first), (sides.b, each.second)
            in_a, in_b = (index in range(len(document.items(each.kind))) for document, index in ends)
            key = each.kind, each.first, each.second
            if in_a != in_b:
                yield differ("structure", each.place, f"leads somewhere only in {'A' if in_a else 'B'}")
            elif in_a and each.kind == "accessors":
                yield from accessor_differences(sides, each.first, each.second, each.place, name=each.name)
            elif in_a and key not in self.met:
                self.met.add(key)
                if each.kind in _COMPARISONS:
                    yield from self.follow(_COMPARISONS[each.kind](sides, each.first, each.second))
                else:
                    pair = sides.items(each.kind, each.first, each.second)
                    yield from self.follow(dict_differences(*pair, (each.kind, each.first), each.kind, sides.limits))

    def node_differences(self) -> Iterator[Difference]:
        """Compare paired nodes with their meshes, skins and cameras."""
        sides = self.sides
        weighed = set()
        hierarchies: list[Hierarchy] = []
        for i, j in sorted(sides.nodes.items()):
            yield from self.follow(node_differences(sides, i, j))
            first, second = sides.items("nodes", i, j)
            if all("skin" in node and "mesh" in node for node in (first, second)):
                joints = joint_pairs(sides, first["skin"], second["skin"])
                key = first["mesh"], second["mesh"], tuple(joints.items())
                if key not in weighed:
                    weighed.add(key)
                    try:
                        hierarchies = hierarchies or [read_hierarchy(document) for document in (sides.a, sides.b)]
                        rig_a, rig_b = read_rig(sides.a, i, hierarchies[0]), read_rig(sides.b, j, hierarchies[1])
                        found: list[Difference | Link] = [*influence_differences(sides, rig_a, rig_b, joints)]
                    except AssetError:  # malformed influences are compared as they are stored
                        found = list(stored_influences(sides, first["mesh"], second["mesh"]))
                    yield from self.follow(iter(found))

    def unreferenced_differences(self) -> Iterator[Difference]:
        """Compare objects to which nothing refers, paired by name, then in their order."""
        documents = self.sides.a, self.sides.b
        for kind in _REFERRED:
            met = [key for key in self.met if key[0] == kind]
            names_a, names_b = (
                {
                    index: document.items(kind)[index].get("name")
                    for index in without(range(len(document.items(kind))), [key[1 + side] for key in met])
                }
                for side, document in enumerate(documents)
            )
            pairs = pairs_by_key(names_a, names_b)
            pairs |= dict(zip(without(names_a, pairs), without(names_b, pairs.values()), strict=False))
            yield from self.follow(Link(kind, i, j, (kind, i)) for i, j in pairs.items())
            yield from only_in_one(kind, names_a, names_b, pairs)


def _scene_differences(sides: Sides) -> Findings:
    """Compare scenes, in their order, by the nodes that they show."""
    first, second = sides.a.items("scenes"), sides.b.items("scenes")
    if len(first) != len(second):
        yield differ("structure", ("scenes",), f"{len(first)} -> {len(second)} scenes")
    names_a, names_b = sides.names
    for number, (one, other) in enumerate(zip(first, second, strict=False)):
        place: Place = ("scenes", number)
        yield from dict_differences(one, other, place, "scenes", sides.limits, skip={"nodes"})
        roots = {sides.nodes.get(node, -1): node for node in one.get("nodes", [])}
        others = set(other.get("nodes", []))
        for node in sorted(set(roots) - others):
            # Nodes that only one file has were reported before.
            if node >= 0:
                yield differ("structure", (*place, "nodes"), f"{names_a[roots[node]]!r} only in A")
        for node in sorted(others - set(roots)):
            if node in sides.paired:
                yield differ("structure", (*place, "nodes"), f"{names_b[node]!r} only in B")


def _top_differences(sides: Sides) -> Findings:
    """Compare the asset's own data, its extensions, and keys that glTF 2.0 does not define."""
    a, b, limits = sides.a.gltf, sides.b.gltf, sides.limits
    lists = "extensionsUsed", "extensionsRequired"
    yield from dict_differences(a, b, (), "document", limits, skip={*_STORAGE, *_COMPARED, "asset", *lists})
    one, other = a.get("asset", {}), b.get("asset", {})
    yield from dict_differences(one, other, ("asset",), "document", limits, skip={"generator"})
    for key in lists:
        first, second = ({each for each in gltf.get(key, []) if each not in COMPRESSIONS} for gltf in (a, b))
        for name in sorted(first ^ second, key=str):
            yield differ("structure", (key,), f"{name!r} only in {'A' if name in first else 'B'}")
