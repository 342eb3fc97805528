"""Two documents compared by what they mean, not by how they are stored.

Nodes are paired by their names from the roots down, all else through what refers to it. Accessors are compared as
decoded numbers, images as bytes, animations by the values that they play. So the order and layout of accessors, buffer
views and buffers, sparse and dense or compressed storage, .gltf and .glb, values left out and values that are the
specification's default, and `asset.generator` make no difference.

Source: glTF 2.0 specification, §3 (concepts) and §5 (defaults of properties).
"""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from wrinklecli.character.clip import Channel, Clip, read_clips, sample
from wrinklecli.character.rig import morph_target_names, read_rig
from wrinklecli.character.surface import dense_influences, read_primitive
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import TRIANGLES, Document
from wrinklecli.gltf.files import read_uri
from wrinklecli.gltf.shape import COMPRESSIONS, Json
from wrinklecli.numeric.arrays import Array, Floats

Kind = Literal["structure", "value", "geometry", "image", "animation", "pose"]
_Place = tuple[str | int, ...]

_SHOWN = 60  # characters of a value that a message repeats
# Top-level arrays that say how data is stored, and those that are compared through what refers to them.
_STORAGE = ("accessors", "bufferViews", "buffers")
_KINDS = ("nodes", "scenes", "meshes", "skins", "materials", "textures", "images", "samplers", "cameras", "animations")
# What JSON of a kind refers to, by key, at any depth; `attributes` below an extension are accessors.
_REFERENCES: dict[str, dict[str, str]] = {
    "nodes": {"mesh": "meshes", "camera": "cameras", "attributes": "accessors"},
    "primitives": {"material": "materials"},
    "textures": {"source": "images", "sampler": "samplers"},
}
# Values that a key left out stands for (glTF 2.0 §5); extensions have defaults of their own.
_DEFAULTS: dict[str, Json] = {
    "primitives": {"mode": TRIANGLES},
    "materials": {
        "alphaCutoff": 0.5,
        "alphaMode": "OPAQUE",
        "baseColorFactor": [1.0, 1.0, 1.0, 1.0],
        "doubleSided": False,
        "emissiveFactor": [0.0, 0.0, 0.0],
        "metallicFactor": 1.0,
        "pbrMetallicRoughness": {},
        "roughnessFactor": 1.0,
        "scale": 1.0,
        "strength": 1.0,
        "texCoord": 0,
    },
    "samplers": {"wrapS": 10497, "wrapT": 10497},
    "document": {"scene": 0},
}
_TRANSFORM = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
# An image's bytes count, not where they lie nor the type that they show themselves.
_IMAGE_STORAGE = ("uri", "bufferView", "mimeType")


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


def document_differences(a: Document, b: Document, limits: Limits, *, clips: Sequence[str] = ()) -> list[Difference]:
    """All in which two documents differ.

    Args:
        a: The first.
        b: The second.
        limits: How far numbers may be apart.
        clips: Names of the animations to compare, as of `read_clips`; all where left out.

    Raises:
        AssetError: A document is malformed.
    """
    walk = _Walk(a, b, limits)
    walk.pair_nodes()
    for pair in sorted(walk.nodes.items()):
        walk.compare_node(*pair)
    walk.compare_scenes()
    walk.compare_animations(clips)
    walk.compare_unreferenced()
    walk.compare_top()
    return walk.found


class _Walk:
    """Goes through two documents side by side.

    Attributes:
        a: The first document.
        b: The second.
        limits: How far numbers may be apart.
        found: What differs, so far.
        nodes: Nodes of the second by those of the first that they are paired with.
    """

    def __init__(self, a: Document, b: Document, limits: Limits) -> None:
        self.a, self.b, self.limits = a, b, limits
        self.found: list[Difference] = []
        self.nodes: dict[int, int] = {}
        self._paired: set[int] = set()
        self._names = tuple([node.get("name") for node in document.items("nodes")] for document in (a, b))
        # Pairs of objects that have been compared, or are being.
        self._seen: set[tuple[Hashable, ...]] = set()
        self._by_kind: dict[str, Callable[[int, int], None]] = {
            "meshes": self._mesh,
            "images": self._image,
            "materials": lambda i, j: self._object("materials", i, j),
            "textures": lambda i, j: self._object("textures", i, j),
            "samplers": lambda i, j: self._object("samplers", i, j),
            "cameras": lambda i, j: self._object("cameras", i, j),
            "skins": self._skin,
        }

    def _differ(
        self, kind: Kind, place: _Place, message: str, *, name: object = "", distance: float | None = None
    ) -> None:
        pointer = "".join("/" + str(part).replace("~", "~0").replace("/", "~1") for part in place)
        self.found.append(Difference(kind, pointer, name if isinstance(name, str) else "", message, distance))

    # Nodes

    def pair_nodes(self) -> None:
        """Pair nodes from the roots down: by name, then what is left and looks alike, then wherever a name is."""
        above = [_parents(document) for document in (self.a, self.b)]
        names_a, names_b = (self._names[side] for side in (0, 1))
        self._pair_below(*([i for i, parent in enumerate(each) if parent < 0] for each in above))
        waiting: dict[Any, list[int]] = {}
        for j in reversed(_from_roots(self.b, above[1])):
            if j not in self._paired and names_b[j] is not None:
                waiting.setdefault(names_b[j], []).append(j)
        for i in _from_roots(self.a, above[0]):
            while i not in self.nodes and waiting.get(names_a[i]):
                j = waiting[names_a[i]].pop()
                if j not in self._paired:
                    parents = f"{_name_at(names_a, above[0][i])} -> {_name_at(names_b, above[1][j])}"
                    self._differ("structure", ("nodes", i), f"parent {parents}", name=names_a[i])
                    self._pair_below([i], [j])
        for known, names, parents_of, side in (
            (set(self.nodes), names_a, above[0], "A"),
            (self._paired, names_b, above[1], "B"),
        ):
            for index, parent in enumerate(parents_of):
                # What lies below a node that only one file has, goes with it.
                if index not in known and (parent < 0 or parent in known):
                    self._differ("structure", ("nodes", index), f"only in {side}", name=names[index])

    def _pair_below(self, roots_a: Sequence[int], roots_b: Sequence[int]) -> None:
        """Pair two lists of nodes, and what lies below the pairs."""
        nodes_a, nodes_b = self.a.items("nodes"), self.b.items("nodes")
        names_a, names_b = self._names
        known_a, known_b = ({name for name in names if isinstance(name, str)} for names in self._names)
        stack = [(list(roots_a), list(roots_b))]
        while stack:
            level_a, level_b = stack.pop()
            level_a = [i for i in dict.fromkeys(level_a) if i not in self.nodes]
            level_b = [j for j in dict.fromkeys(level_b) if j not in self._paired]
            pairs = _paired(level_a, level_b, names_a.__getitem__, names_b.__getitem__)
            paired = set(pairs.values())
            rest_a = [i for i in level_a if i not in pairs and names_a[i] not in known_b]
            rest_b = [j for j in level_b if j not in paired and names_b[j] not in known_a]
            for i, j in _paired(rest_a, rest_b, lambda i: _look(nodes_a[i]), lambda j: _look(nodes_b[j])).items():
                message = f"{_shown(names_a[i])} -> {_shown(names_b[j])}"
                self._differ("structure", ("nodes", i, "name"), message, name=names_a[i])
                pairs[i] = j
            self.nodes |= pairs
            self._paired |= set(pairs.values())
            stack += [(_children(self.a, i), _children(self.b, j)) for i, j in pairs.items()]

    def _node_names(self) -> tuple[list[str], list[str]]:
        first, second = (
            [str(node.get("name", f"node_{index}")) for index, node in enumerate(document.items("nodes"))]
            for document in (self.a, self.b)
        )
        return first, second

    def compare_node(self, i: int, j: int) -> None:
        """Compare two paired nodes, and what they carry."""
        first, second = self.a.items("nodes")[i], self.b.items("nodes")[j]
        place, name = ("nodes", i), first.get("name")
        self._transform(i, j)
        skip = {"name", "children", "skin", "weights", "matrix", *_TRANSFORM}
        self._dicts(first, second, place, "nodes", name=name, skip=skip)
        if "mesh" in first and "mesh" in second:
            weights = _stored_weights(self.a, first), _stored_weights(self.b, second)
            # Other numbers of targets are said of the mesh.
            if len(weights[0]) == len(weights[1]):
                self._value(weights[0], weights[1], (*place, "weights"), "nodes", name=name)
        if ("skin" in first) != ("skin" in second):
            self._differ("structure", (*place, "skin"), f"only in {'A' if 'skin' in first else 'B'}", name=name)
        elif "skin" in first:
            self._refer("skins", first["skin"], second["skin"], (*place, "skin"), name)
            if "mesh" in first and "mesh" in second:
                self._influences(i, j, self._joint_pairs(first["skin"], second["skin"]))

    def _transform(self, i: int, j: int) -> None:
        first, second = self.a.items("nodes")[i], self.b.items("nodes")[j]
        name = first.get("name")
        if "matrix" in first or "matrix" in second:
            matrices = [_local_matrix(document, index) for document, index in ((self.a, i), (self.b, j))]
            moved = self._channel_gap("translation", *(each[None, :3, 3] for each in matrices))
            turned = self._channel_gap("scale", *(each[None, :3, :3].reshape(1, 9) for each in matrices))
            if moved.any() or turned.any():
                message = f"moves by {moved[0]:.3g}, turns or scales by {turned[0]:.3g}"
                self._differ("value", ("nodes", i, "matrix"), message, name=name)
            return
        for path, default in _TRANSFORM.items():
            values = [_stored(document, index, path)[None] for document, index in ((self.a, i), (self.b, j))]
            if self._channel_gap(path, *values).any():
                shown = " -> ".join(_shown(node.get(path, list(default))) for node in (first, second))
                self._differ("value", ("nodes", i, path), shown, name=name)

    def _is_same_node(self, i: Any, j: Any) -> bool:
        """Whether two references, if they are any, lead to paired nodes."""
        if _is_index(i) and i in self.nodes:
            return bool(self.nodes[i] == j)
        return bool(i == j) and j not in self._paired

    # Skins

    def _joint_pairs(self, i: int, j: int) -> dict[int, int]:
        """Joint numbers of a skin of the second document by those of the first."""
        first, second = (
            document.items("skins")[index].get("joints", []) for document, index in ((self.a, i), (self.b, j))
        )
        numbers = {node: number for number, node in enumerate(second)}
        return {
            number: number if self.nodes.get(node) in second[number : number + 1] else numbers[self.nodes[node]]
            for number, node in enumerate(first)
            if self.nodes.get(node) in numbers
        }

    def _skin(self, i: int, j: int) -> None:
        first, second = self.a.items("skins")[i], self.b.items("skins")[j]
        place, name = ("skins", i), first.get("name")
        joints_a, joints_b = first.get("joints", []), second.get("joints", [])
        pairs = self._joint_pairs(i, j)
        complete = len(pairs) == len(joints_a) == len(joints_b)
        binds_a, binds_b = _inverse_binds(self.a, first, place), _inverse_binds(self.b, second, place)
        in_order = all(k == number for k, number in pairs.items())
        apart = [
            number
            for number, other in pairs.items()
            if _gaps(binds_a[number], binds_b[other]).max() > self._slack(binds_a[number], lengths=True)
        ]
        if not self._is_same_node(first.get("skeleton"), second.get("skeleton")):
            self._differ("structure", (*place, "skeleton"), "another node", name=name)
        self._dicts(first, second, place, "skins", skip={"joints", "skeleton", "inverseBindMatrices"})
        names_a, names_b = self._node_names()
        if not complete or (apart and not in_order):
            # Joints in another order, each with its own matrix, mean the same.
            for number in range(max(len(joints_a), len(joints_b))):
                shown = [
                    repr(names[joints[number]]) if number < len(joints) else "none"
                    for names, joints in ((names_a, joints_a), (names_b, joints_b))
                ]
                if pairs.get(number) != number:
                    self._differ("structure", (*place, "joints", number), " -> ".join(shown), name=name)
        for number in apart:
            gap = _gaps(binds_a[number], binds_b[pairs[number]]).max()
            message = f"the matrix of joint {names_a[joints_a[number]]!r} differs by up to {gap:.3g}"
            self._differ("geometry", (*place, "inverseBindMatrices", number), message, name=name)

    def _influences(self, i: int, j: int, joints: Mapping[int, int]) -> None:
        """Compare the skin weights of two nodes, joint by joint."""
        rigs = read_rig(self.a, i), read_rig(self.b, j)
        key = ("influences", *(rig.mesh for rig in rigs), tuple(joints.items()))
        if key in self._seen:
            return
        self._seen.add(key)
        first, second = (
            document.items("meshes")[rig.mesh].get("primitives", [])
            for document, rig in zip((self.a, self.b), rigs, strict=True)
        )
        names = self._node_names()[0]
        for number, pair in enumerate(zip(first, second, strict=False)):
            place: _Place = ("meshes", rigs[0].mesh, "primitives", number)
            read = [
                read_primitive(document, primitive, rig, document.where(*("meshes", rig.mesh, "primitives", number)))
                for document, primitive, rig in zip((self.a, self.b), pair, rigs, strict=True)
            ]
            counts = [len(each.positions) for each in read]
            if counts[0] != counts[1]:
                continue
            # What follows joints that only one file has lies in columns of its own.
            columns = len(rigs[0].joints)
            into = np.arange(columns, columns + len(rigs[1].joints))
            into[list(joints.values())] = list(joints)
            total = columns + len(rigs[1].joints)
            gaps = np.abs(
                dense_influences(read[0].joints, read[0].weights, total)
                - dense_influences(into[read[1].joints], read[1].weights, total)
            )
            off = (gaps > self.limits.share).any(axis=1)
            if off.any():
                vertex, column = np.unravel_index(int(gaps.argmax()), gaps.shape)
                joint = f" of joint {names[int(rigs[0].joints[column])]!r}" if column < columns else ""
                message = f"vertex {vertex}: the weight{joint} differs by {gaps[vertex, column]:.3g}"
                message += _of(int(off.sum()), counts[0])
                self._differ("geometry", (*place, "attributes", "WEIGHTS_0"), message, name=names[i])

    # Meshes

    def _mesh(self, i: int, j: int) -> None:
        first, second = self.a.items("meshes")[i], self.b.items("meshes")[j]
        place, name = ("meshes", i), first.get("name")
        self._dicts(first, second, place, "meshes", skip={"primitives", "weights"})
        primitives = first.get("primitives", []), second.get("primitives", [])
        if len(primitives[0]) != len(primitives[1]):
            message = f"{len(primitives[0])} -> {len(primitives[1])} primitives"
            self._differ("structure", (*place, "primitives"), message, name=name)
        skinned = all(_is_skinned(document, mesh) for document, mesh in ((self.a, i), (self.b, j)))
        targets = morph_target_names(first)
        for number, (one, other) in enumerate(zip(*primitives, strict=False)):
            self._primitive(one, other, (*place, "primitives", number), i, targets, skinned=skinned, name=name)

    def _primitive(
        self,
        first: Json,
        second: Json,
        place: _Place,
        mesh: int,
        targets: Sequence[str],
        *,
        skinned: bool,
        name: object,
    ) -> None:
        self._dicts(first, second, place, "primitives", name=name, skip={"attributes", "indices", "targets"})
        counts = [
            len(document.accessor(primitive["attributes"]["POSITION"], user=document.path))
            if "POSITION" in primitive.get("attributes", {})
            else 0
            for document, primitive in ((self.a, first), (self.b, second))
        ]
        several = first.get("targets", []), second.get("targets", [])
        if len(several[0]) != len(several[1]):
            message = f"{len(several[0])} -> {len(several[1])} morph targets"
            self._differ("structure", (*place, "targets"), message, name=name)
        if counts[0] != counts[1]:
            self._differ("geometry", place, f"{counts[0]} -> {counts[1]} vertices", name=name)
            return
        # Skin weights are compared joint by joint, whatever their order.
        skip = ("JOINTS_", "WEIGHTS_") if skinned else ()
        self._attributes(
            first.get("attributes", {}), second.get("attributes", {}), (*place, "attributes"), mesh, name, skip=skip
        )
        self._triangles(first, second, place, counts[0], name)
        for number, (one, other) in enumerate(zip(*several, strict=False)):
            known = f"{name}, {targets[number]}" if isinstance(name, str) and number < len(targets) else name
            self._attributes(one, other, (*place, "targets", number), mesh, known, idle=True)

    def _attributes(
        self,
        first: Json,
        second: Json,
        place: _Place,
        mesh: int,
        name: object,
        *,
        skip: tuple[str, ...] = (),
        idle: bool = False,
    ) -> None:
        """Compare accessors by name; `idle` ones are zero where left out."""
        for key in dict.fromkeys([*first, *second]):
            if skip and key.startswith(skip):
                continue
            values = [
                document.accessor(source[key], user=document.path) if key in source else None
                for document, source in ((self.a, first), (self.b, second))
            ]
            one, other = values
            if one is None or other is None:
                only = other if one is None else one
                if not (idle and only is not None and not only.any()):
                    side = "A" if other is None else "B"
                    self._differ("structure", (*place, key), f"only in {side}", name=name)
                continue
            self._arrays(one, other, (*place, key), mesh, name)

    def _arrays(self, one: Array, other: Array, place: _Place, mesh: int | None, name: object) -> None:
        if one.shape != other.shape:
            shapes = " -> ".join("×".join(map(str, each.shape)) for each in (one, other))
            self._differ("geometry", place, f"{shapes} numbers", name=name)
            return
        scale = self.limits.scales.get(mesh, 1.0) if mesh is not None else 1.0
        is_place = place[-1] == "POSITION"
        gaps = _gaps(one, other)
        gaps = gaps if gaps.ndim == 1 else np.linalg.norm(gaps, axis=1) if is_place else gaps.max(axis=1)
        whole = one.dtype.kind in "iu" and other.dtype.kind in "iu"
        limit: Any = 0 if whole else self.limits.share * np.maximum(1.0, _most(one))
        if is_place:
            gaps, limit = gaps * scale, self.limits.length
        off = gaps > limit
        if off.any():
            vertex = int(np.argmax(np.where(off, gaps, -1.0)))
            worst = float(gaps[vertex])
            what = f"vertex {vertex} is {worst:.3g} off" if is_place else f"vertex {vertex} differs by {worst:.3g}"
            message = f"{what}{_of(int(off.sum()), len(gaps))}"
            self._differ("geometry", place, message, name=name, distance=worst if is_place else None)

    def _triangles(self, first: Json, second: Json, place: _Place, count: int, name: object) -> None:
        indices = [
            document.accessor(primitive["indices"], user=document.path) if "indices" in primitive else np.arange(count)
            for document, primitive in ((self.a, first), (self.b, second))
        ]
        if len(indices[0]) != len(indices[1]):
            message = f"{len(indices[0])} -> {len(indices[1])} indices"
            self._differ("geometry", (*place, "indices"), message, name=name)
        elif (off := indices[0] != indices[1]).any():
            number = int(off.argmax())
            message = f"index {number}: {indices[0][number]} -> {indices[1][number]}"
            self._differ("geometry", (*place, "indices"), f"{message}{_of(int(off.sum()), len(off))}", name=name)

    # Images

    def _image(self, i: int, j: int) -> None:
        first, second = self.a.items("images")[i], self.b.items("images")[j]
        name = first.get("name", first.get("uri"))
        name = name if isinstance(name, str) and not name.startswith("data:") else ""
        self._dicts(first, second, ("images", i), "images", name=name, skip=set(_IMAGE_STORAGE))
        data = [_image_bytes(document, index) for document, index in ((self.a, i), (self.b, j))]
        if data[0] != data[1]:
            message = f"other bytes ({len(data[0])} -> {len(data[1])})"
            self._differ("image", ("images", i), message, name=name)

    # Animations

    def compare_animations(self, chosen: Sequence[str]) -> None:
        """Pair animations by name and compare what they play."""
        first, second = self.a.items("animations"), self.b.items("animations")
        clips_a, clips_b = ({clip.index: clip for clip in read_clips(each)} for each in (self.a, self.b))
        keys = [
            {index: clips[index].name if index in clips else each.get("name") for index, each in enumerate(animations)}
            for animations, clips in ((first, clips_a), (second, clips_b))
        ]
        if chosen:
            keys = [{index: name for index, name in each.items() if name in chosen} for each in keys]
        names_a, names_b = keys
        pairs = _paired(list(names_a), list(names_b), names_a.__getitem__, names_b.__getitem__)
        # What moves the same properties under another name has been renamed.
        renamed = _paired(
            _without(names_a, pairs),
            _without(names_b, pairs.values()),
            lambda i: frozenset((self.nodes.get(node), path) for node, path in _properties(first[i])),
            lambda j: frozenset(_properties(second[j])),
        )
        for i, j in renamed.items():
            message = f"{_shown(names_a[i])} -> {_shown(names_b[j])}"
            self._differ("structure", ("animations", i, "name"), message, name=names_a[i])
        pairs |= renamed
        for i in _without(names_a, pairs):
            self._differ("structure", ("animations", i), "only in A", name=names_a[i])
        for j in _without(names_b, pairs.values()):
            self._differ("structure", ("animations", j), "only in B", name=names_b[j])
        for i, j in sorted(pairs.items()):
            self._dicts(first[i], second[j], ("animations", i), "animations", skip={"name", "channels", "samplers"})
            if i in clips_a and j in clips_b:
                self._clip(clips_a[i], clips_b[j])
            self._other_channels(i, j, clips_a.get(i), clips_b.get(j))

    def _clip(self, first: Clip, second: Clip) -> None:
        place: _Place = ("animations", first.index)
        spans = [(clip.start, clip.end) for clip in (first, second)]
        if _gaps(np.array(spans[0]), np.array(spans[1])).max() > self._slack(np.array(spans[0])):
            shown = " -> ".join(f"{start:.6g} to {end:.6g} s" for start, end in spans)
            self._differ("animation", place, shown, name=first.name)
        nodes_a, nodes_b = self._node_names()
        left = {(channel.node, channel.path): channel for channel in second.channels}
        for channel in first.channels:
            what = f"{channel.path} of {nodes_a[channel.node]!r}"
            at = (*place, "channels", channel.index)
            other = left.pop((self.nodes.get(channel.node, -1), channel.path), None)
            if other is None:
                self._differ("animation", at, f"{what}: only in A", name=first.name)
                continue
            self._channel(channel, other, at, what, first.name)
            stored = [
                document.items("animations")[clip.index]["channels"][each.index]
                for document, clip, each in ((self.a, first, channel), (self.b, second, other))
            ]
            self._dicts(stored[0], stored[1], at, "animations", name=first.name, skip={"sampler", "target"})
        for channel in left.values():
            at = ("animations", second.index, "channels", channel.index)
            what = f"{channel.path} of {nodes_b[channel.node]!r}"
            self._differ("animation", at, f"{what}: only in B", name=first.name)

    def _channel(self, first: Channel, second: Channel, place: _Place, what: str, clip: str) -> None:
        """Compare what two channels play, at and between the keys of both."""
        widths = [channel.values.shape[-1] for channel in (first, second)]
        if widths[0] != widths[1]:
            message = f"{what}: {widths[0]} -> {widths[1]} numbers a key"
            self._differ("animation", place, message, name=clip)
            return
        if first.interpolation == second.interpolation and all(
            np.array_equal(getattr(first, key), getattr(second, key)) for key in ("times", "values")
        ):
            return
        keys = np.union1d(first.times, second.times)
        between = keys[:-1, None] + np.array([0.0, 0.25, 0.5, 0.75]) * np.diff(keys)[:, None]
        times = np.append(between.reshape(-1), keys[-1])
        played = [sample(channel, times) for channel in (first, second)]
        gaps = self._channel_gap(first.path, *played)
        if gaps.max() > 0.0:
            worst = int(gaps.argmax())
            column = int(_gaps(played[0][worst], played[1][worst]).argmax())
            part = f" (number {column})" if first.path == "weights" else ""
            message = f"{what}{part} differs by {gaps[worst]:.3g} at {times[worst]:.6g} s"
            self._differ("animation", place, message, name=clip)

    def _channel_gap(self, path: str, first: Floats, second: Floats) -> Floats:
        """(times,) how far (times, components) values of a property are apart; 0 within the limits."""
        if path == "rotation":
            # A quaternion and its opposite are one rotation.
            turned = np.sum(first * second, axis=1, keepdims=True) < 0
            second = np.where(turned, -second, second)
        gaps = _gaps(first, second)
        if path == "translation":
            gap = np.sqrt(np.sum(gaps * gaps, axis=1))
            limit = np.maximum(self.limits.length, self.limits.share * _most(first))
        else:
            gap = gaps.max(axis=1, initial=0.0)
            limit = self.limits.share * np.maximum(1.0, _most(first))
        return np.where(gap > limit, gap, 0.0)

    def _other_channels(self, i: int, j: int, clip_a: Clip | None, clip_b: Clip | None) -> None:
        """Compare the channels that move no node, such as those of KHR_animation_pointer, in their order."""
        several = []
        for document, index, clip in ((self.a, i, clip_a), (self.b, j, clip_b)):
            read = {channel.index for channel in clip.channels} if clip else set()
            animation = document.items("animations")[index]
            channels = enumerate(animation.get("channels", []))
            several.append([(number, each) for number, each in channels if number not in read])
        place: _Place = ("animations", i, "channels")
        name = self.a.items("animations")[i].get("name")
        if len(several[0]) != len(several[1]):
            message = f"{len(several[0])} -> {len(several[1])} channels that move no node"
            self._differ("animation", place, message, name=name)
        for (number, first), (_, second) in zip(*several, strict=False):
            at = (*place, number)
            targets = [dict(channel.get("target", {})) for channel in (first, second)]
            nodes = [target.pop("node", None) for target in targets]
            if not self._is_same_node(nodes[0], nodes[1]):
                self._differ("animation", (*at, "target", "node"), "another node", name=name)
            self._dicts(targets[0], targets[1], (*at, "target"), "animations", name=name)
            samplers = [
                dict(document.items("animations")[index].get("samplers", [])[channel["sampler"]])
                if channel.get("sampler", -1) in range(len(document.items("animations")[index].get("samplers", [])))
                else {}
                for document, index, channel in ((self.a, i, first), (self.b, j, second))
            ]
            for key in ("input", "output"):
                values = [sampler.pop(key, None) for sampler in samplers]
                if None not in values:
                    arrays = [document.accessor(n) for document, n in zip((self.a, self.b), values, strict=True)]
                    self._arrays(arrays[0], arrays[1], (*at, key), None, name)
            self._dicts(samplers[0], samplers[1], at, "animations", name=name)

    # The rest

    def compare_scenes(self) -> None:
        """Compare scenes in their order: which nodes they show."""
        first, second = self.a.items("scenes"), self.b.items("scenes")
        if len(first) != len(second):
            self._differ("structure", ("scenes",), f"{len(first)} -> {len(second)} scenes")
        names_a, names_b = self._node_names()
        for number, (one, other) in enumerate(zip(first, second, strict=False)):
            place: _Place = ("scenes", number)
            self._dicts(one, other, place, "scenes", skip={"nodes"})
            roots = {self.nodes.get(node, -1): node for node in one.get("nodes", [])}
            others = set(other.get("nodes", []))
            for node in sorted(set(roots) - others):
                # What only one file has, has been said.
                if node >= 0:
                    self._differ("structure", (*place, "nodes"), f"{names_a[roots[node]]!r} only in A")
            for node in sorted(others - set(roots)):
                if node in self._paired:
                    self._differ("structure", (*place, "nodes"), f"{names_b[node]!r} only in B")

    def compare_unreferenced(self) -> None:
        """Compare what nothing refers to: by name, then in order."""
        for kind in self._by_kind:
            met = [key for key in self._seen if key[0] == kind]
            lefts = [
                _without(range(len(document.items(kind))), [key[1 + side] for key in met])
                for side, document in enumerate((self.a, self.b))
            ]
            names = [[each.get("name") for each in document.items(kind)] for document in (self.a, self.b)]
            found = _paired(lefts[0], lefts[1], names[0].__getitem__, names[1].__getitem__)
            rest = _without(lefts[0], found), _without(lefts[1], found.values())
            found |= dict(zip(*rest, strict=False))
            for i, j in found.items():
                self._refer(kind, i, j, (kind, i), None)
            for index in _without(lefts[0], found):
                self._differ("structure", (kind, index), "only in A", name=names[0][index])
            for index in _without(lefts[1], found.values()):
                self._differ("structure", (kind, index), "only in B", name=names[1][index])

    def compare_top(self) -> None:
        """Compare the asset's own data, its extensions, and what this version of glTF does not know."""
        names = "extensionsUsed", "extensionsRequired"
        self._dicts(self.a.gltf, self.b.gltf, (), "document", skip={*_STORAGE, *_KINDS, "asset", *names})
        self._dicts(
            self.a.gltf.get("asset", {}), self.b.gltf.get("asset", {}), ("asset",), "document", skip={"generator"}
        )
        for key in names:
            first, second = (
                {each for each in document.gltf.get(key, []) if each not in COMPRESSIONS}
                for document in (self.a, self.b)
            )
            for name in sorted(first ^ second, key=str):
                self._differ("structure", (key,), f"{name!r} only in {'A' if name in first else 'B'}")

    # JSON

    def _object(self, kind: str, i: int, j: int) -> None:
        self._dicts(self.a.items(kind)[i], self.b.items(kind)[j], (kind, i), kind)

    def _refer(self, kind: str, i: Any, j: Any, place: _Place, name: object) -> None:
        """Compare what two references lead to, once."""
        if kind == "accessors":
            arrays = [document.accessor(index, user=document.path) for document, index in ((self.a, i), (self.b, j))]
            self._arrays(arrays[0], arrays[1], place, None, name)
            return
        self.a.item(kind, i, user=self.a.where(*place))
        self.b.item(kind, j, user=self.b.path)
        if (kind, i, j) not in self._seen:
            self._seen.add((kind, i, j))
            self._by_kind[kind](i, j)

    def _dicts(
        self,
        first: Json,
        second: Json,
        place: _Place,
        kind: str,
        *,
        name: object = None,
        skip: Iterable[str] = (),
        inside: str = "",
    ) -> None:
        """Compare JSON objects key by key.

        Args:
            first: Of the first document.
            second: Of the second.
            place: Of the first.
            kind: Of the object that they belong to: what its keys refer to, and the defaults.
            name: For people; the object's own where left out.
            skip: Keys that are not compared here.
            inside: extras or extensions, where the objects are below such a key.
        """
        name = first.get("name") if name is None else name
        defaults = {} if inside else _DEFAULTS.get(kind, {})
        skipped = set(skip)
        if place[-2:] == ("extras", "wrinkle"):
            # A bake's record of what the file was made from: an index of a buffer view.
            skipped |= {"original"}
        for key in dict.fromkeys([*first, *second]):
            if key in skipped:
                continue
            at = (*place, key)
            values = [source.get(key, defaults.get(key, _MISSING)) for source in (first, second)]
            if key == "extensions" and not inside:
                values = [_stripped(value) for value in values]
            one, other = values
            deeper = key if key in ("extras", "extensions") and not inside else inside
            if one is _MISSING or other is _MISSING:
                if one is not other:
                    side, value = ("A", one) if other is _MISSING else ("B", other)
                    # An index says nothing to people.
                    shown = "" if deeper != "extras" and self._reference(at, kind, deeper) else f"{_shown(value)} "
                    self._differ("structure", at, f"{shown}only in {side}", name=name)
                continue
            self._value(one, other, at, kind, name=name, inside=deeper)

    def _value(self, one: Any, other: Any, place: _Place, kind: str, *, name: object = None, inside: str = "") -> None:
        """Compare JSON values: references by what they lead to, numbers within the limits."""
        key = place[-1]
        reference = None if inside == "extras" else self._reference(place, kind, inside)
        if reference is not None and _is_index(one) and _is_index(other):
            self._refer(reference, one, other, place, name)
        elif isinstance(one, dict) and isinstance(other, dict):
            self._dicts(one, other, place, kind, name=name, inside=inside)
        elif isinstance(one, list) and isinstance(other, list):
            if len(one) != len(other):
                self._differ("value", place, f"{len(one)} -> {len(other)} items", name=name)
            elif _are_numbers(one) and _are_numbers(other):
                if any(self._apart(*pair) for pair in zip(one, other, strict=True)):
                    self._differ("value", place, f"{_shown(one)} -> {_shown(other)}", name=name)
            else:
                for number, pair in enumerate(zip(one, other, strict=True)):
                    self._value(*pair, (*place, number), kind, name=name, inside=inside)
        elif _are_numbers([one, other]):
            if self._apart(one, other):
                self._differ("value", place, f"{_shown(one)} -> {_shown(other)}", name=name)
        elif type(one) is not type(other) or one != other:
            kind_found: Kind = "structure" if key == "name" else "value"
            self._differ(kind_found, place, f"{_shown(one)} -> {_shown(other)}", name=name)

    @staticmethod
    def _reference(place: _Place, kind: str, inside: str) -> str | None:
        """The kind of what an index at a place refers to."""
        key = place[-1]
        above = place[-2] if len(place) > 1 else ""
        if key == "index" and isinstance(above, str) and above.endswith("Texture"):
            return "textures"
        if above == "attributes" and kind == "nodes" and inside == "extensions":
            return "accessors"
        known = _REFERENCES.get(kind, {})
        return known.get(key) if isinstance(key, str) and key != "attributes" else None

    def _apart(self, one: float, other: float) -> bool:
        """Whether two JSON numbers differ; whole ones are counts or choices."""
        if isinstance(one, int) and isinstance(other, int):
            return one != other
        return abs(one - other) > self.limits.share * max(1.0, abs(one), abs(other))

    def _slack(self, values: Floats, *, lengths: bool = False) -> float:
        """How far numbers like these may be apart."""
        least = max(1.0, self.limits.length / self.limits.share) if lengths else 1.0
        return self.limits.share * max(least, float(np.abs(values).max(initial=0.0)))


_MISSING: Any = object()


def _stripped(extensions: Any) -> Any:
    """Extensions without those of storage; none where no other is left."""
    if not isinstance(extensions, dict):
        return extensions
    return {key: value for key, value in extensions.items() if key not in COMPRESSIONS} or _MISSING


def _is_index(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def _name_at(names: Sequence[Any], index: int) -> str:
    return repr(names[index]) if index >= 0 else "none"


def _of(count: int, total: int) -> str:
    return f"; {count} of {total} differ" if count > 1 else ""


def _gaps(first: Array, second: Array) -> Floats:
    """Absolute differences of numbers; 0 where both are the same, infinite where one is no finite number."""
    first, second = first.astype(np.float64), second.astype(np.float64)
    finite = np.isfinite(first) & np.isfinite(second)
    same = (first == second) | (np.isnan(first) & np.isnan(second))
    gaps = np.abs(np.where(finite, first, 0.0) - np.where(finite, second, 0.0))
    return np.where(finite, gaps, np.where(same, 0.0, np.inf))


def _most(values: Array) -> Floats:
    """(rows,) the greatest finite magnitude in each row."""
    magnitudes = np.abs(np.where(np.isfinite(values), values, 0.0)).astype(np.float64)
    return magnitudes if magnitudes.ndim == 1 else magnitudes.max(axis=1, initial=0.0)


def _parents(document: Document) -> list[int]:
    parents = [-1] * len(document.items("nodes"))
    for index in range(len(parents)):
        for child in _children(document, index):
            parents[child] = index
    return parents


def _from_roots(document: Document, parents: Sequence[int]) -> list[int]:
    """The nodes, each after its parent; those of cycles are left out."""
    order = [index for index, parent in enumerate(parents) if parent < 0]
    for index in order:
        order += [child for child in _children(document, index) if parents[child] == index]
    return order


def _children(document: Document, node: int) -> list[int]:
    children: list[int] = document.items("nodes")[node].get("children", [])
    for child in children:
        document.item("nodes", child, user=document.where("nodes", node, "children"))
    return children


def _without(items: Iterable[int], others: Iterable[Any]) -> list[int]:
    """The items that are none of the others."""
    known = set(others)
    return [each for each in items if each not in known]


def _paired(
    first: Sequence[int], second: Sequence[int], key_a: Callable[[int], Any], key_b: Callable[[int], Any]
) -> dict[int, int]:
    """Items of equal keys, those of the same key in their order."""
    waiting: dict[Hashable, list[int]] = {}
    for j in reversed(second):
        waiting.setdefault(_hashable(key_b(j)), []).append(j)
    pairs = {}
    for i in first:
        found = waiting.get(_hashable(key_a(i)))
        if found:
            pairs[i] = found.pop()
    return pairs


def _hashable(key: Any) -> Hashable:
    return key if isinstance(key, Hashable) else repr(key)


def _look(node: Json) -> tuple[Hashable, ...]:
    """What nodes of other names have in common if they are the same."""
    return (*(key in node for key in ("mesh", "skin", "camera")), len(node.get("children", [])))


def _stored_weights(document: Document, node: Json) -> list[float]:
    """The stored weights of a node's morph targets, those of the node before those of the mesh."""
    mesh = document.item("meshes", node["mesh"], user=document.path)
    count = len(morph_target_names(mesh))
    weights = node.get("weights") or mesh.get("weights") or []
    return [float(weight) for weight in [*weights, *[0.0] * count][:count]]


def _stored(document: Document, index: int, key: str) -> Floats:
    """The numbers of a node's transform."""
    default = _TRANSFORM.get(key, (0.0,) * 16)
    values = np.array(document.items("nodes")[index].get(key, default), np.float64)
    if values.shape != (len(default),):
        raise AssetError(f"has {values.size} numbers, not {len(default)}", where=document.where("nodes", index, key))
    return values


def _local_matrix(document: Document, index: int) -> Floats:
    """(4, 4) of a node."""
    if "matrix" in document.items("nodes")[index]:
        return _stored(document, index, "matrix").reshape(4, 4).T
    # Imported here, as few files mix both forms and it takes longer than all of numpy.
    from scipy.spatial.transform import Rotation

    translation, rotation, scale = (_stored(document, index, path) for path in _TRANSFORM)
    matrix = np.eye(4)
    matrix[:3, :3] = (Rotation.from_quat(rotation).as_matrix() if rotation.any() else np.eye(3)) * scale
    matrix[:3, 3] = translation
    return matrix


def _inverse_binds(document: Document, skin: Json, place: _Place) -> Floats:
    """(joints, 4, 4) as stored, transposed."""
    count = len(skin.get("joints", []))
    if "inverseBindMatrices" not in skin:
        return np.tile(np.eye(4), (count, 1, 1))
    stored = document.accessor(skin["inverseBindMatrices"], user=document.where(*place))
    matrices = np.zeros((count, 4, 4))
    rows = stored[:count].reshape(-1, 4, 4) if stored.shape[1:] == (16,) else matrices[:0]
    matrices[: len(rows)] = rows
    return matrices


def _is_skinned(document: Document, mesh: int) -> bool:
    """Whether every node that shows a mesh has a skin."""
    users = [node for node in document.items("nodes") if node.get("mesh") == mesh]
    return bool(users) and all("skin" in node for node in users)


def _image_bytes(document: Document, index: int) -> bytes:
    image, where = document.items("images")[index], document.where("images", index)
    if "bufferView" in image:
        return bytes(document.view(image["bufferView"], user=where))
    uri = image.get("uri")
    return bytes(read_uri(uri, document.path, where, allow_external=document.allow_external)[0]) if uri else b""


def _properties(animation: Json) -> set[tuple[Any, Any]]:
    """The nodes and paths that an animation moves."""
    targets = [channel.get("target", {}) for channel in animation.get("channels", [])]
    return {(target.get("node"), target.get("path")) for target in targets}
