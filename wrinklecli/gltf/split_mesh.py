"""Splits a mesh into parts: some of its triangles become separate meshes and nodes, which move as before.

Source: glTF 2.0 §3.7.2 (meshes), §3.7.2.2 (morph targets), §3.11 (animation).
"""

import copy
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import EXTENSION, channels_of, has_target_names, pointer_of
from wrinklecli.gltf.edited_document import INDEX_DATA, VERTEX_DATA, EditedDocument, index_type
from wrinklecli.gltf.references import unused_name
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Ints, places_of, renumbered

# Extensions of a node that apply to its mesh; others, such as lights, would be there twice.
_OF_MESHES = ("KHR_node_visibility", "EXT_mesh_gpu_instancing")
# What follows `/nodes/0` in pointers at properties of a node that parts have too.
_OF_PARTS = re.compile(rf"/(translation|rotation|scale)$|/extensions/({'|'.join(_OF_MESHES)})/")
# Extensions of a document whose lists have objects with a mesh, or a node, and mostly the index of a morph target.
_BINDING = {"VRM": "mesh", "VRMC_vrm": "node"}


@dataclass(frozen=True, slots=True)
class Part:
    """The content of one of several meshes.

    Attributes:
        triangles: (triangles, 3) vertices for each primitive; a primitive of one part alone stays whole.
        targets: Sorted indices of the part's morph targets. Others change nothing of it.
    """

    triangles: tuple[Ints, ...]
    targets: tuple[int, ...]


def split_node(edited: EditedDocument, node: int, parts: Sequence[Part]) -> list[int]:
    """Split a node's mesh into two or more parts: the first stays, each other one gets a mesh and a node.

    Skin and materials are the same. New nodes stand beside the old one, with its transform and its channels, as
    three.js gives the weights of a node to nodes below it. Vertices keep their order and every stored bit, so that
    parts meet in every pose. The mesh must be unchanged, and no other node may show it.

    Returns:
        The nodes of all parts.

    Raises:
        BakeError: An animation or a level of detail sets the mesh in a way that several meshes cannot follow.
    """
    gltf = edited.gltf
    _refuse_pointers(edited, node)
    _refuse_levels(edited, node)
    mesh = gltf["meshes"][gltf["nodes"][node]["mesh"]]
    primitives: list[list[Json]] = [[] for _ in parts]
    for number, primitive in enumerate(mesh["primitives"]):
        divided = DividedPrimitive(edited, primitive)
        owners = [k for k, part in enumerate(parts) if len(part.triangles[number])] or [0]
        # The largest part reuses the old indices, so that the record of the original finds most of the data.
        for k in sorted(owners, key=lambda k: -len(parts[k].triangles[number])):
            alone = len(owners) == 1
            triangles, targets = parts[k].triangles[number], parts[k].targets
            if alone:
                made = divided.whole(targets)
            else:
                rows, corners = renumbered(triangles)
                made = divided.take(rows, corners, targets)
            primitives[k].append(_with_targets(made, targets))
        divided.drop_left_over()
    nodes = [node]
    for k, part in enumerate(parts[1:], start=1):
        made = {key: copy.deepcopy(each) for key, each in mesh.items() if key != "primitives"}
        made = _named(made, k + 1, gltf["meshes"]) | {"primitives": primitives[k]}
        gltf["meshes"].append(_with_targets(made, part.targets))
        nodes.append(_beside(gltf, nodes[-1], node, k + 1, part.targets))
        _follow(edited, node, nodes[-1], part.targets)
    old = gltf["nodes"][node]
    gltf["meshes"][old["mesh"]] = _with_targets(mesh | {"primitives": primitives[0]}, parts[0].targets)
    gltf["nodes"][node] = _with_targets(old, parts[0].targets)
    _keep_weights(edited, node, parts[0].targets)
    _bind(gltf, nodes, parts)
    return nodes


class DividedPrimitive:
    """A primitive whose vertices are taken, all or some; the first data taken from an accessor reuses its index."""

    def __init__(self, edited: EditedDocument, primitive: Json) -> None:
        self._edited = edited
        self._primitive = primitive
        self._taken: set[Any] = set()
        self._like: int = primitive["attributes"]["POSITION"]

    def whole(self, targets: Sequence[int]) -> Json:
        """Take the whole primitive, with some of its morph targets."""
        self._taken.update((number, name) for number in targets for name in self._targets[number])
        made = {key: each for key, each in self._primitive.items() if key != "targets"}
        return made | ({"targets": [self._targets[number] for number in targets]} if targets else {})

    def take(self, rows: Ints, corners: Ints, targets: Sequence[int]) -> Json:
        """Take vertices in an order, repeated if asked, for triangles whose corners are numbers in it."""
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
        """The accessor for the first part that asks for it, then None."""
        if key in self._taken:
            return None
        self._taken.add(key)
        return index

    def _elements(self, index: int, rows: Ints, name: str) -> int:
        """Add an accessor of some stored elements of another."""
        return self._stored(index, rows, name, replaces=self._replaced(index, name))

    def _stored(self, index: int, rows: Ints, name: str, *, replaces: int | None) -> int:
        values, bounds = self._edited.source.stored(index)[rows], name == "POSITION"
        return self._edited.add_like(index, values, target=VERTEX_DATA, bounds=bounds, replaces=replaces)

    def _deltas(self, index: int, rows: Ints, number: int, name: str) -> int:
        """Add an accessor of some elements of a morph target's."""
        source, replaces = self._edited.source, self._replaced(index, (number, name))
        if source.stored_dtype(index).kind != "f":
            return self._stored(index, rows, name, replaces=replaces)
        changed, values = source.changes(index)
        taken = places_of(changed, source.items("accessors")[index]["count"], -1)[rows]
        vertices = np.flatnonzero(taken >= 0)
        return self._edited.add_deltas(
            vertices, values[taken[vertices]], count=len(rows), bounds=name == "POSITION", replaces=replaces
        )


def _with_targets(holder: Json, kept: Sequence[int]) -> Json:
    """Reduce the lists of a mesh, primitive or node over morph targets to some targets; empty lists are removed."""
    held = dict(holder)
    if "weights" in held:
        held["weights"] = [held["weights"][number] for number in kept]
        if not kept:
            del held["weights"]
    if has_target_names(held):
        extras = held["extras"]
        names = [extras["targetNames"][number] for number in kept]
        held["extras"] = {key: each for key, each in extras.items() if key != "targetNames"}
        held["extras"] |= {"targetNames": names} if names else {}
        if not held["extras"]:
            del held["extras"]
    return held


def _beside(gltf: Json, before: int, node: int, number: int, targets: Sequence[int]) -> int:
    """Append a copy of a node for the last mesh, after the node `before` in all lists that contain this.

    It has a name even if the node has none, since players find it by its name.
    """
    nodes = gltf["nodes"]
    kept = {key: copy.deepcopy(each) for key, each in nodes[node].items() if key not in ("children", "camera")}
    kept.setdefault("name", f"node_{node}")
    extensions = {key: each for key, each in kept.pop("extensions", {}).items() if key in _OF_MESHES}
    made = kept | {"mesh": len(gltf["meshes"]) - 1} | ({"extensions": extensions} if extensions else {})
    nodes.append(_named(_with_targets(made, targets), number, nodes))
    for holder in (*nodes[:-1], *gltf.get("scenes", [])):
        siblings = holder.get("children", holder.get("nodes", []))
        if before in siblings:
            siblings.insert(siblings.index(before) + 1, len(nodes) - 1)
    return len(nodes) - 1


def _named(made: Json, number: int, others: Iterable[Json]) -> Json:
    """Append the number of a part to the name of an object, if it has one, so that no other has the name."""
    if not isinstance(made.get("name"), str):
        return made
    taken = {str(each.get("name")) for each in others}
    return made | {"name": unused_name(f"{made['name']}_part{number}", taken)}


def _follow(edited: EditedDocument, node: int, part: int, targets: Sequence[int]) -> None:
    """Let the node of a part move as another node: with the same keys, and the weights of its morph targets."""
    for animation, channel in channels_of(edited.gltf):
        target = channel["target"]
        pointer = pointer_of(channel) or ""
        made: Json = copy.deepcopy(channel)
        if _OF_PARTS.match(pointer.removeprefix(f"/nodes/{node}")):
            made["target"]["extensions"][EXTENSION]["pointer"] = pointer.replace(f"/{node}/", f"/{part}/", 1)
        elif target.get("node") == node and (target.get("path") != "weights" or targets):
            made["target"]["node"] = part
        else:
            continue
        if target.get("path") == "weights":
            sampler = animation["samplers"][channel["sampler"]]
            made["sampler"] = len(animation["samplers"])
            animation["samplers"].append(sampler | {"output": _columns(edited, sampler["output"], node, targets)})
        animation["channels"].append(made)


def _keep_weights(edited: EditedDocument, node: int, targets: Sequence[int]) -> None:
    """Reduce the node's own weights to those of its first part's morph targets; no other channel has their samplers."""
    for animation, channel in channels_of(edited.gltf):
        if channel["target"].get("node") == node and channel["target"].get("path") == "weights":
            sampler = animation["samplers"][channel["sampler"]]
            sampler["output"] = _columns(edited, sampler["output"], node, targets, replaces=sampler["output"])


def _columns(
    edited: EditedDocument, index: int, node: int, targets: Sequence[int], *, replaces: int | None = None
) -> int:
    """Add an accessor of the weights of some morph targets of a node's mesh, from the one of all targets."""
    source = edited.source
    mesh = source.items("meshes")[source.items("nodes")[node]["mesh"]]
    weights = source.stored(index).reshape(-1, len(mesh["primitives"][0]["targets"]))[:, list(targets)]
    return edited.add_like(index, weights.reshape(-1), replaces=replaces)


def _bind(gltf: Json, nodes: Sequence[int], parts: Sequence[Part]) -> None:
    """Let everything that an extension sets for the mesh, such as an expression, be set for all parts.

    Source: VRM 0.x (blendShapeMaster, firstPerson) and VRMC_vrm 1.0 (expressions, firstPerson).
    """
    for name, key in _BINDING.items():
        places = [gltf["nodes"][node]["mesh"] for node in nodes] if key == "mesh" else nodes
        _bind_in(gltf.get("extensions", {}).get(name), key, places, parts)


def _bind_in(value: Any, key: str, places: Sequence[int], parts: Sequence[Part]) -> None:
    """Copy list entries below a value for the first place to the others, with the indices of their targets."""
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
    """Raise BakeError if an animation names the weights of a node, or its mesh, in a pointer."""
    mesh = edited.gltf["nodes"][node]["mesh"]
    for animation, channel in channels_of(edited.gltf):
        pointer = pointer_of(channel) or ""
        if f"{pointer}/".startswith((f"/nodes/{node}/weights/", f"/meshes/{mesh}/")):
            raise BakeError(
                f"cannot be split: {animation.get('name')!r} moves {pointer} by {EXTENSION}",
                where=edited.source.where("nodes", node),
            )


def _refuse_levels(edited: EditedDocument, node: int) -> None:
    """Raise BakeError if a node has levels of detail, or is one: a player then shows it, or others in its place."""
    for holder, each in enumerate(edited.gltf["nodes"]):
        levels = each.get("extensions", {}).get("MSFT_lod", {}).get("ids", [])
        if levels and node in (holder, *levels):
            raise BakeError(
                "cannot be split: it is one of the levels of detail of MSFT_lod",
                where=edited.source.where("nodes", node),
            )
