"""Reads the rig of a mesh as it is stored: hierarchy of nodes, joints, inverse binds, morph weights.

An unskinned mesh counts as skinned to its own node with weight 1, so that all later stages know one case.

Source: glTF 2.0 specification, §3.5 (nodes), §3.7.3 (skins).
"""

from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from dataclasses import field, replace
from typing import Any, Protocol

import numpy as np

from wrinklecli.errors import AssetError, BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import has_target_names, target_count
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.references import unused_name
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, Ints, affine_rows, composed_rows, unit_quaternions

# Most levels of a hierarchy and most joints of a skin: time and memory grow with them, and no real asset has as many.
_MOST_NODES = 4096
# Greatest number of a transform: no real one comes near, and products of a dozen such numbers are still finite.
LARGEST = 1e15
TRANSFORM_DEFAULTS = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}


@dataclass(frozen=True, slots=True)
class Hierarchy:
    """All nodes of a document.

    Attributes:
        parents: (nodes,) each node's parent, -1 for roots.
        locals: Stored translation, rotation (x, y, z, w) and scale of each node, or its stored 4×4 matrix.
        rows: (3, 4, nodes) upper rows of the stored local matrices.
        names: One for each node: its own, or else one that no other node has.
    """

    parents: Ints
    locals: tuple[dict[str, Floats], ...]
    rows: Floats
    names: tuple[str, ...]
    _world_rows: dict[int, Floats] = field(default_factory=dict, init=False, repr=False, compare=False)

    def world_rows(self, node: int) -> Floats:
        """(3, 4, 1) upper rows of a node's stored world matrix."""
        if node not in self._world_rows:
            # Callers ask for parents first, so this does not call itself deeply.
            parent, rows = int(self.parents[node]), self.rows[:, :, node, None]
            self._world_rows[node] = composed_rows(self.world_rows(parent), rows) if parent >= 0 else rows
        return self._world_rows[node]

    def upwards(self, node: int) -> Iterator[int]:
        """Give a node and all above it, up to its root."""
        return upwards(self.parents, node)

    def next_above(self, node: int, among: Container[int]) -> int:
        """The nearest of some nodes that are above a node; -1 if none is."""
        return next((each for each in self.upwards(int(self.parents[node])) if each in among), -1)


def upwards(parents: Ints, node: int) -> Iterator[int]:
    """Give a node and all above it, by the (nodes,) parents of nodes; nothing for -1."""
    while node >= 0:
        yield node
        node = int(parents[node])


class DrivenTargets(Protocol):
    """Morph targets that an asset does not have yet, and whose weights follow its rig."""

    @property
    def targets(self) -> tuple[str, ...]:
        """Their names."""

    def weights_in(self, rig: "Rig", clip: Any) -> Callable[[Floats], Floats]:
        """A function from (frames,) seconds of a clip to (frames, targets) weights; None is the stored pose."""


@dataclass(frozen=True, slots=True)
class Rig(Hierarchy):
    """The joints and morph targets that move the mesh of one node.

    Attributes:
        node: The node that has the mesh.
        skinned: True if the node has a skin.
        joints: (joints,) nodes; the mesh's own node if there is no skin.
        inverse_binds: (joints, 4, 4) bind space to joint space.
        morph_names: One for each morph target, see `morph_target_names`.
        morph_weights: (morph targets,) stored weights of the node, or else of the mesh.
        drives: Effects that move the mesh too. Their targets are the last of the morph targets.
    """

    node: int
    mesh: int
    skinned: bool
    joints: Ints
    inverse_binds: Floats
    morph_names: tuple[str, ...]
    morph_weights: Floats
    drives: tuple[DrivenTargets, ...] = ()

    @property
    def node_name(self) -> str:
        """Name of the node that has the mesh."""
        return self.names[self.node]

    @property
    def joints_below(self) -> Bools:
        """(joints, joints) True where the second is the first or below it."""
        numbers = {node: number for number, node in enumerate(self.joints.tolist())}
        below = np.zeros((len(self.joints), len(self.joints)), np.bool_)
        for node, number in numbers.items():
            below[[numbers[above] for above in self.upwards(node) if above in numbers], number] = True
        return below

    def morph_number(self, name: str, *, where: str) -> int:
        """The number of the morph target of a name that a tool asks for at a place of its file.

        Raises:
            BakeError: The mesh has none.
        """
        BakeError.unless_known("the mesh has no morph target", [name], self.morph_names, where=where)
        return self.morph_names.index(name)

    @property
    def own(self) -> "Rig":
        """The rig of the asset itself, which no effect moves."""
        if not self.drives:
            return self
        count = len(self.morph_names) - sum(len(each.targets) for each in self.drives)
        return replace(self, morph_names=self.morph_names[:count], morph_weights=self.morph_weights[:count], drives=())

    def driven_by(self, drives: Sequence[DrivenTargets]) -> "Rig":
        """The rig with further effects that move the mesh, and nothing at rest."""
        names = tuple(name for each in drives for name in each.targets)
        return replace(
            self,
            morph_names=self.morph_names + names,
            morph_weights=np.concatenate([self.morph_weights, np.zeros(len(names))]),
            drives=(*self.drives, *drives),
        )


def read_hierarchy(document: Document) -> Hierarchy:
    """Read the nodes with their stored pose; AssetError if the hierarchy has a cycle, or nodes are malformed."""
    nodes = document.items("nodes")
    parents = read_parents(document)
    locals_ = tuple(_stored_local(each) for each in nodes)
    for index, parts in enumerate(locals_):
        if not all(in_range(part) for part in parts.values()):
            message = f"is moved by a number that is not finite, or above {LARGEST:g}"
            raise AssetError(message, where=document.where("nodes", index))
    return Hierarchy(parents, locals_, _stored_rows(locals_), _node_names(nodes))


def _node_names(nodes: Sequence[Json]) -> tuple[str, ...]:
    free = free_names(nodes)
    return tuple(node.get("name") or free(index) for index, node in enumerate(nodes))


def free_names(nodes: Sequence[Json]) -> Callable[[int], str]:
    """A function that gives a name for a node by its number, which no node has."""
    taken = {node.get("name") for node in nodes}
    return lambda index: unused_name(f"node_{index}", taken)


def read_rig(document: Document, node: int, hierarchy: Hierarchy | None = None) -> Rig:
    """Read the rig of a node with a mesh; `hierarchy` is the document's, if it has been read already.

    Raises:
        AssetError: The hierarchy has a cycle, or skin or nodes are malformed.
    """
    hierarchy = hierarchy or read_hierarchy(document)
    mesh_node = document.items("nodes")[node]
    mesh = document.items("meshes")[mesh_node["mesh"]]
    joints, inverse_binds = np.array([node], np.intp), np.eye(4)[None]
    if "skin" in mesh_node:
        joints, inverse_binds = _read_skin(document, mesh_node["skin"])
    return Rig(
        node=node,
        mesh=mesh_node["mesh"],
        skinned="skin" in mesh_node,
        joints=joints,
        inverse_binds=inverse_binds,
        parents=hierarchy.parents,
        locals=hierarchy.locals,
        rows=hierarchy.rows,
        names=hierarchy.names,
        morph_names=tuple(morph_target_names(mesh)),
        morph_weights=stored_weights(document, node),
    )


def stored_weights(document: Document, node: int) -> Floats:
    """(morph targets,) stored weights of a node with a mesh: its own, or else those of the mesh, or else 0."""
    mesh_node = document.items("nodes")[node]
    mesh = document.items("meshes")[mesh_node["mesh"]]
    weights = np.zeros(target_count(document.gltf, mesh_node["mesh"]))
    stored: Sequence[float] = (mesh_node if "weights" in mesh_node else mesh).get("weights", ())
    weights[: len(stored)] = stored[: len(weights)]
    return weights


def read_parents(document: Document) -> Ints:
    """(nodes,) the parent of each node, -1 for roots; AssetError if a node is its own ancestor or lies too deep."""
    parents = parents_of(document.items("nodes"))
    levels = levels_of(parents)
    cyclic = levels >= len(parents)
    if cyclic.any():
        raise AssetError("is its own ancestor", where=document.where("nodes", int(cyclic.argmax())))
    if levels.max(initial=0) >= _MOST_NODES:
        raise AssetError(
            f"lies {levels.max()} levels deep; at most {_MOST_NODES} are read",
            where=document.where("nodes", int(levels.argmax())),
        )
    return parents


def parents_of(nodes: Sequence[Json]) -> Ints:
    """(nodes,) the parent of each node, -1 for roots; there may be cycles."""
    parents = np.full(len(nodes), -1, np.intp)
    for index, each in enumerate(nodes):
        for child in each.get("children", []):
            parents[child] = index
    return parents


def levels_of(parents: Ints) -> Ints:
    """(nodes,) the number of nodes above each, by their parents; in and below a cycle at least that of all nodes."""
    above, levels = parents, (parents >= 0).astype(np.intp)
    # Each round doubles the generations that are looked up: a chain of 100,000 nodes takes 17 rounds.
    for _ in range(len(parents).bit_length()):
        levels = levels + np.where(above >= 0, levels[above], 0)
        above = np.where(above >= 0, above[above], -1)
    return levels


def from_roots(parents: Ints) -> list[int]:
    """All nodes but those in and below a cycle, each after its parent."""
    levels = levels_of(parents)
    return [node for node in np.argsort(levels, kind="stable").tolist() if levels[node] < len(parents)]


def morph_target_names(mesh: Json) -> list[str]:
    """A name for each morph target of a mesh: from `extras.targetNames`, or else `target_0` by index.

    Where the mesh has no names, those of a primitive count, as older VRM files have them there.
    """
    primitives = mesh.get("primitives") or [{}]
    named = filter(has_target_names, (mesh, *primitives))
    names: list[Any] = next((each["extras"]["targetNames"] for each in named), [])
    return [str(names[k]) if k < len(names) else f"target_{k}" for k in range(len(primitives[0].get("targets", [])))]


def _read_skin(document: Document, index: int) -> tuple[Ints, Floats]:
    skin = document.items("skins")[index]
    where = document.where("skins", index)
    joints = skin.get("joints", [])
    if not joints:
        raise AssetError("has no joints", where=where)
    if len(joints) > _MOST_NODES:
        raise AssetError(f"has {len(joints)} joints; at most {_MOST_NODES} are read", where=where)
    if "inverseBindMatrices" not in skin:
        return np.array(joints, np.intp), np.tile(np.eye(4), (len(joints), 1, 1))
    stored = document.accessor(skin["inverseBindMatrices"], user=where)
    if stored.shape[1:] != (16,) or len(stored) < len(joints):
        raise AssetError(f"needs {len(joints)} inverse bind matrices, has {len(stored)}", where=where)
    if not in_range(stored[: len(joints)]):
        accessor = document.where("accessors", str(skin["inverseBindMatrices"]))
        raise AssetError(
            f"holds inverse bind matrices with a number that is not finite, or above {LARGEST:g}", where=accessor
        )
    # glTF stores matrices column by column.
    return np.array(joints, np.intp), stored[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)


def in_range(values: Floats) -> bool:
    """True if all numbers are finite and no larger than `LARGEST`."""
    with np.errstate(invalid="ignore"):
        return bool(values.min(initial=0.0) >= -LARGEST and values.max(initial=0.0) <= LARGEST)


def _stored_local(node: Json) -> dict[str, Floats]:
    if "matrix" in node:
        return {"matrix": np.array(node["matrix"], np.float64).reshape(4, 4).T}
    local = {}
    for path, default in TRANSFORM_DEFAULTS.items():
        local[path] = np.array(node.get(path, default), np.float64)
    return local


def local_rows(node: Json) -> Floats:
    """(3, 4) upper rows of a node's stored local matrix."""
    return _stored_rows([_stored_local(node)])[:, :, 0]


def _stored_rows(local: Sequence[dict[str, Floats]]) -> Floats:
    """(3, 4, nodes) upper rows of the nodes' local matrices."""
    rows = np.zeros((3, 4, len(local)))
    free = [index for index, parts in enumerate(local) if "matrix" not in parts]
    if free:
        translations, rotations, scales = (
            np.array([local[index][path] for index in free]) for path in TRANSFORM_DEFAULTS
        )
        rows[:, :, free] = affine_rows(translations.T, unit_quaternions(rotations.T), scales.T)
    for index, parts in enumerate(local):
        if "matrix" in parts:
            rows[:, :, index] = parts["matrix"][:3]
    return rows


def moving_nodes(rig: Rig, joints: Iterable[int] | None = None) -> frozenset[int]:
    """The nodes whose channels can move a mesh: its node, its joints and their ancestors.

    `joints` are indices into the rig's joints; by default all.
    """
    nodes: set[int] = {rig.node}
    for joint in range(len(rig.joints)) if joints is None else joints:
        node = int(rig.joints[joint])
        while node >= 0 and node not in nodes:
            nodes.add(node)
            node = int(rig.parents[node])
    return frozenset(nodes)
