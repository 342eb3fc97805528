"""A mesh in parts: some of its triangles become meshes and nodes of their own, which move as before.

Source: glTF 2.0 §3.7.2 (meshes), §3.7.2.2 (morph targets), §3.11 (animation).
"""

import copy
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, count
from typing import Any

import numpy as np

from wrinklecli.errors import BakeError
from wrinklecli.gltf.edited_document import INDEX_DATA, VERTEX_DATA, EditedDocument, index_type
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Ints

# Extensions of a node that hold for whatever mesh shows there; others, such as lights, would be there twice.
_OF_MESHES = ("KHR_node_visibility", "EXT_mesh_gpu_instancing")
# What a node that is below another need not have, as that one has it.
_INHERITED = ("matrix", "translation", "rotation", "scale")
# Extensions of a document in whose lists objects name a mesh, or a node, and mostly a morph target by its number.
_BINDING = {"VRM": "mesh", "VRMC_vrm": "node"}


@dataclass(frozen=True, slots=True)
class Part:
    """What one mesh of several gets.

    Attributes:
        triangles: For each primitive, (triangles, 3) vertices; where other parts have nothing of it, it stays whole.
        targets: Numbers of its morph targets, rising. Those left out change nothing of it.
    """

    triangles: tuple[Ints, ...]
    targets: tuple[int, ...]


def split_node(edited: EditedDocument, node: int, parts: Sequence[Part]) -> list[int]:
    """Split a node's mesh: the first part stays, each other gets a mesh and node, with the same skin and materials.

    Where a skin moves them, new nodes stand beside the old one; elsewhere below it, so that they move with it. Vertices
    keep their order and every stored bit, so that parts agree where they meet, in every pose.

    Args:
        edited: The document, of whose mesh nothing has been changed.
        node: Whose mesh no other node shows.
        parts: Two or more; each has something of a primitive.

    Returns:
        The nodes of all parts.

    Raises:
        BakeError: Something sets the mesh's morph targets in a way that several meshes cannot follow.
    """
    gltf = edited.gltf
    _refuse_pointers(edited, node)
    mesh = gltf["meshes"][gltf["nodes"][node]["mesh"]]
    primitives: list[list[Json]] = [[] for _ in parts]
    for number, primitive in enumerate(mesh["primitives"]):
        divided = _Divided(edited, primitive)
        owners = [k for k, part in enumerate(parts) if len(part.triangles[number])] or [0]
        # The largest takes the places of what was there, so that the record of the original finds most of it.
        for k in sorted(owners, key=lambda k: -len(parts[k].triangles[number])):
            alone = len(owners) == 1
            triangles, targets = parts[k].triangles[number], parts[k].targets
            primitives[k].append(divided.whole(targets) if alone else divided.take(triangles, targets))
        divided.drop_left_over()
    nodes = [node]
    for k, part in enumerate(parts[1:], start=1):
        made = {key: copy.deepcopy(each) for key, each in mesh.items() if key != "primitives"}
        made = _named(made, k + 1, gltf["meshes"]) | {"primitives": primitives[k]}
        gltf["meshes"].append(_with_targets(made, part.targets))
        nodes.append(_beside(edited, nodes[-1], node, k + 1, part.targets))
        _follow(edited, node, nodes[-1], part.targets)
    old = gltf["nodes"][node]
    gltf["meshes"][old["mesh"]] = _with_targets(mesh | {"primitives": primitives[0]}, parts[0].targets)
    gltf["nodes"][node] = _with_targets(old, parts[0].targets)
    _keep_weights(edited, node, parts[0].targets)
    _bind(gltf, nodes, parts)
    return nodes


class _Divided:
    """A primitive that parts take from; what they take of an accessor first takes its place."""

    def __init__(self, edited: EditedDocument, primitive: Json) -> None:
        self._edited = edited
        self._primitive = primitive
        self._taken: set[Any] = set()
        self._like: int = primitive["attributes"]["POSITION"]

    def whole(self, targets: Sequence[int]) -> Json:
        """All of it, with some of its morph targets."""
        self._taken.update((number, name) for number in targets for name in self._targets[number])
        made = {key: each for key, each in self._primitive.items() if key != "targets"}
        return made | ({"targets": [self._targets[number] for number in targets]} if targets else {})

    def take(self, triangles: Ints, targets: Sequence[int]) -> Json:
        """Some of its triangles, with the vertices that these have, in their order."""
        rows, corners = np.unique(triangles, return_inverse=True)
        left_out = ("attributes", "targets", "indices", "mode")
        part = {key: copy.deepcopy(each) for key, each in self._primitive.items() if key not in left_out}
        part["attributes"] = {
            name: self._elements(index, rows, name) for name, index in self._primitive["attributes"].items()
        }
        self._like = part["attributes"]["POSITION"]
        indices = corners.reshape(-1).astype(index_type(len(rows)))
        replaced = self._replaced(self._primitive.get("indices"), "indices")
        part["indices"] = self._edited.add(indices, target=INDEX_DATA, replaces=replaced)
        if targets:
            part["targets"] = [
                {name: self._deltas(index, rows, number, name) for name, index in self._targets[number].items()}
                for number in targets
            ]
        return part

    def drop_left_over(self) -> None:
        """Drop the accessors of morph targets that no part has."""
        for number, target in enumerate(self._targets):
            for name, index in target.items():
                if (number, name) not in self._taken:
                    self._edited.discard(index, like=self._like)

    @property
    def _targets(self) -> list[Json]:
        found: list[Json] = self._primitive.get("targets", [])
        return found

    def _replaced(self, index: int | None, key: Any) -> int | None:
        """An accessor, for the first part that asks for it."""
        if key in self._taken:
            return None
        self._taken.add(key)
        return index

    def _elements(self, index: int, rows: Ints, name: str) -> int:
        """An accessor of some elements of one, as they are stored."""
        return self._stored(index, rows, name, replaces=self._replaced(index, name))

    def _stored(self, index: int, rows: Ints, name: str, *, replaces: int | None) -> int:
        source = self._edited.source
        normalized = bool(source.items("accessors")[index].get("normalized"))
        return self._edited.add(
            source.stored(index)[rows],
            target=VERTEX_DATA,
            normalized=normalized,
            bounds=name == "POSITION",
            replaces=replaces,
        )

    def _deltas(self, index: int, rows: Ints, number: int, name: str) -> int:
        """The same of a morph target's."""
        source, replaces = self._edited.source, self._replaced(index, (number, name))
        if source.stored_dtype(index).kind != "f":
            return self._stored(index, rows, name, replaces=replaces)
        changed, values = source.changes(index)
        here = np.isin(changed, rows)
        vertices = np.searchsorted(rows, changed[here])
        return self._edited.add_deltas(
            vertices, values[here], count=len(rows), bounds=name == "POSITION", replaces=replaces
        )


def _with_targets(holder: Json, kept: Sequence[int]) -> Json:
    """A mesh or node whose lists over morph targets hold these alone; lists of none are left out."""
    held = dict(holder)
    if "weights" in held:
        held["weights"] = [held["weights"][number] for number in kept]
        if not kept:
            del held["weights"]
    extras = held.get("extras")
    if isinstance(extras, dict) and "targetNames" in extras:
        names = [extras["targetNames"][number] for number in kept]
        held["extras"] = {key: each for key, each in extras.items() if key != "targetNames"}
        held["extras"] |= {"targetNames": names} if names else {}
        if not held["extras"]:
            del held["extras"]
    return held


def _beside(edited: EditedDocument, before: int, node: int, number: int, targets: Sequence[int]) -> int:
    """Append a node for the last mesh, like another, below that or after the one before."""
    nodes = edited.gltf["nodes"]
    skinned = "skin" in nodes[node]
    dropped = ("children", "camera", *(() if skinned else _INHERITED))
    kept = {key: copy.deepcopy(each) for key, each in nodes[node].items() if key not in dropped}
    extensions = {key: each for key, each in kept.pop("extensions", {}).items() if key in _OF_MESHES}
    made = kept | {"mesh": len(edited.gltf["meshes"]) - 1} | ({"extensions": extensions} if extensions else {})
    nodes.append(_named(_with_targets(made, targets), number, nodes))
    if not skinned:
        nodes[node].setdefault("children", []).append(len(nodes) - 1)
    for siblings in _siblings(edited.gltf, before) if skinned else ():
        siblings.insert(siblings.index(before) + 1, len(nodes) - 1)
    return len(nodes) - 1


def _siblings(gltf: Json, node: int) -> Iterator[list[int]]:
    """The lists of nodes that have a node: its parent's, or those of scenes."""
    for holder in (*gltf["nodes"], *gltf.get("scenes", [])):
        found = holder.get("children", holder.get("nodes", []))
        if node in found:
            yield found


def _named(made: Json, number: int, others: Iterable[Json]) -> Json:
    """An object that is another's part of a number, by its name, if it has one; longer where that is taken."""
    if not isinstance(made.get("name"), str):
        return made
    taken = {str(each.get("name")) for each in others}
    name = f"{made['name']}_part{number}"
    names = chain([name], (f"{name}_{again}" for again in count(2)))
    return made | {"name": next(each for each in names if each not in taken)}


def _follow(edited: EditedDocument, node: int, part: int, targets: Sequence[int]) -> None:
    """Let a part's node move as another does: the same keys, and of weights those of its morph targets."""
    for animation in edited.gltf.get("animations", []):
        for channel in list(animation["channels"]):
            target = channel["target"]
            followed = targets if target.get("path") == "weights" else "skin" in edited.gltf["nodes"][node]
            if target.get("node") != node or not followed:
                continue
            made: Json = copy.deepcopy(channel)
            made["target"]["node"] = part
            if target.get("path") == "weights":
                sampler = animation["samplers"][channel["sampler"]]
                made["sampler"] = len(animation["samplers"])
                output = _columns(edited, sampler["output"], node, targets)
                animation["samplers"].append(sampler | {"output": output})
            animation["channels"].append(made)


def _keep_weights(edited: EditedDocument, node: int, targets: Sequence[int]) -> None:
    """Let the node's own weights be those of its first part's morph targets; no other channel has their samplers."""
    for animation in edited.gltf.get("animations", []):
        for channel in animation["channels"]:
            if channel["target"].get("node") == node and channel["target"].get("path") == "weights":
                sampler = animation["samplers"][channel["sampler"]]
                old = sampler["output"]
                sampler["output"] = _columns(edited, old, node, targets, replaces=old)


def _columns(
    edited: EditedDocument, index: int, node: int, targets: Sequence[int], *, replaces: int | None = None
) -> int:
    """An accessor of the weights of some morph targets of a node's mesh, from that of all of them."""
    source = edited.source
    mesh = source.items("meshes")[source.items("nodes")[node]["mesh"]]
    weights = source.stored(index).reshape(-1, len(mesh["primitives"][0]["targets"]))[:, list(targets)]
    normalized = bool(source.items("accessors")[index].get("normalized"))
    return edited.add(weights.reshape(-1), normalized=normalized, replaces=replaces)


def _bind(gltf: Json, nodes: Sequence[int], parts: Sequence[Part]) -> None:
    """Let what an extension sets of the mesh, such as an expression, be set of all parts.

    Source: VRM 0.x (blendShapeMaster, firstPerson) and VRMC_vrm 1.0 (expressions, firstPerson).
    """
    for name, key in _BINDING.items():
        places = [gltf["nodes"][node]["mesh"] for node in nodes] if key == "mesh" else nodes
        _bind_in(gltf.get("extensions", {}).get(name), key, places, parts)


def _bind_in(value: Any, key: str, places: Sequence[int], parts: Sequence[Part]) -> None:
    """Let lists below a value that name the first of some places name the others too, with targets' numbers there."""
    for each in value.values() if isinstance(value, dict) else list(value) if isinstance(value, list) else ():
        _bind_in(each, key, places, parts)
        if not isinstance(value, list) or not isinstance(each, dict) or each.get(key) != places[0]:
            continue
        number = each.get("index")
        for place, part in zip(places[1:], parts[1:], strict=True):
            if number is None:
                value.append(copy.deepcopy(each) | {key: place})
            elif number in part.targets:
                value.append(copy.deepcopy(each) | {key: place, "index": part.targets.index(number)})


def _refuse_pointers(edited: EditedDocument, node: int) -> None:
    """Check that no animation names a node or its mesh in a text.

    Raises:
        BakeError: One does.
    """
    mesh = edited.gltf["nodes"][node]["mesh"]
    for animation in edited.gltf.get("animations", []):
        for channel in animation["channels"]:
            extension = channel["target"].get("extensions", {}).get("KHR_animation_pointer", {})
            pointer = str(extension.get("pointer", ""))
            if f"{pointer}/".startswith((f"/nodes/{node}/", f"/meshes/{mesh}/")):
                raise BakeError(
                    f"cannot be split: {animation.get('name')!r} moves {pointer} by KHR_animation_pointer",
                    where=edited.source.where("nodes", node),
                )
