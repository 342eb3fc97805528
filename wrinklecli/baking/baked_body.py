"""A baked body as its extras describe it: nodes with their morph targets, and the drives that set these.

Source: the extras of `extras.encode_extras`.
"""

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.baking.parts import PARTS
from wrinklecli.character.rig import morph_target_names, read_rig
from wrinklecli.drive.drive import LAYOUT, StoredDrive, is_baked, stored_drives, wrinkle_entry
from wrinklecli.errors import AssetError, listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats

# The names that `bake` gives to morph targets.
_BAKED = re.compile(r"wrinkle_.+_[0-9]+")


@dataclass(frozen=True, slots=True)
class BakedPart:
    """A node whose mesh has morph targets of a body.

    Attributes:
        node: The node's name.
        mesh: The mesh's name, if it has one.
        primitives: The number of the mesh's primitives.
        targets: The names of its morph targets.
        stored: (targets,) weights in the stored pose.
        skinned: True if the node has a skin.
    """

    node: str
    mesh: str | None
    primitives: int
    targets: tuple[str, ...]
    stored: Floats
    skinned: bool


@dataclass(frozen=True, slots=True)
class BakedBody:
    """A node that carries baked effects, with the other nodes among which its mesh was split.

    Attributes:
        parts: The node itself, whose mesh has all of the asset's own morph targets, and the others.
        drives: The drives of its morph targets, first those of segments, then those of joints.
        undriven: Names of further morph targets of effects, which nothing in the extras can drive.
        ambiguous: True if a scene or another node has the node's name too, as three.js writes it.
        draft: True if it was baked as a draft.
    """

    parts: tuple[BakedPart, ...]
    drives: tuple[StoredDrive, ...]
    undriven: frozenset[str]
    ambiguous: bool
    draft: bool

    @property
    def node(self) -> str:
        """Name of the node itself."""
        return self.parts[0].node

    @property
    def skinned(self) -> bool:
        """True if a skin moves it."""
        return self.parts[0].skinned

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the morph targets of the node itself."""
        return self.parts[0].targets

    def stored(self, names: Sequence[str]) -> Floats:
        """(names,) weights of some morph targets in the stored pose."""
        weights = {name: each for part in self.parts for name, each in zip(part.targets, part.stored, strict=True)}
        return np.array([weights[name] for name in names])

    def with_targets(self, names: Sequence[str]) -> "BakedBody":
        """The body with further morph targets of some names on the node itself, whose weights are 0 at rest."""
        more = tuple(name for name in names if name not in self.targets)
        own = self.parts[0]
        own = replace(own, targets=(*own.targets, *more), stored=np.concatenate([own.stored, np.zeros(len(more))]))
        return replace(self, parts=(own, *self.parts[1:])) if more else self

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the morph targets of its drives, in order."""
        return tuple(name for each in self.drives for name in each.targets)

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the node's own morph targets that are not driven."""
        driven = set(self.driven)
        return tuple(name for name in self.targets if name not in driven)

    @property
    def original(self) -> tuple[str, ...]:
        """Names of the targets that the asset had before it was baked, all of which are the node's own."""
        return tuple(name for name in self.kept if name not in self.undriven)


def read_bodies(document: Document) -> list[BakedBody]:
    """Read the nodes that carry baked effects.

    Raises:
        AssetError: There are none, or their extras are not what `bake` writes.
    """
    bodies = []
    for index, node in enumerate(document.items("nodes")):
        entry = wrinkle_entry(node)
        if not is_baked(node) or "mesh" not in node:
            continue
        where = document.where("nodes", index, "extras", "wrinkle")
        if not node.get("name"):
            raise AssetError("tracks find their mesh by the node's name, and it has none", where=where)
        try:
            stored = stored_drives(entry)
            layout = entry.get("layout", 1)
            if layout != LAYOUT:
                newer = f"a newer `wrinkle`, and this one reads layout {LAYOUT}"
                whose = "an older `wrinkle`: bake it again from its source" if layout == 1 else newer
                raise AssetError(f"has the layout {layout!r} of {whose}", where=where)
            parts = tuple(_read_part(document, each) for each in (index, *part_nodes(document, index)))
            stored.sort(key=lambda each: "joint" in each)
            drives = tuple(StoredDrive.read(each) for each in stored if each["targets"])
            undriven = frozenset(str(name) for name in entry.get("undriven", ()))
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise AssetError("is not what `wrinkle bake` writes", where=where) from error
        there = {name for part in parts for name in part.targets}
        gone = [name for each in drives for name in each.targets if name not in there]
        if gone:
            raise AssetError(f"the mesh has lost its morph targets {listed(gone)}", where=where)
        bodies.append(
            BakedBody(
                parts=parts,
                drives=drives,
                undriven=undriven,
                ambiguous=any(count_named(document, part.node) > 1 for part in parts),
                draft=entry.get("draft") is True,
            )
        )
    if not any(body.drives for body in bodies):
        if lost := lost_record(document):
            raise AssetError(lost, where=document.path)
        raise AssetError("carries no wrinkles of `wrinkle bake` that anchors drive", where=document.path)
    return bodies


def lost_record(document: Document) -> str | None:
    """The fault of a file that has a bake's morph targets, by their names, but no extras of a bake; None without."""
    nodes = document.items("nodes")
    if any(map(is_baked, nodes)):
        return None
    meshes = document.items("meshes")
    names = [name for mesh in meshes for name in morph_target_names(mesh) if _BAKED.fullmatch(name)]
    if not names:
        return None
    return (
        f"has morph targets of a bake, {listed(dict.fromkeys(names))}, but no extras.wrinkle, which other software has"
        " dropped: Blender's exporter keeps them if 'Custom Properties' is on"
    )


def part_nodes(document: Document, node: int) -> list[int]:
    """The other nodes among which a baked node's mesh was split.

    Raises:
        KeyError, TypeError, AttributeError: The extras are not what `bake` writes.
    """
    nodes = document.items("nodes")
    names = {each.get("name"): index for index, each in enumerate(nodes) if "mesh" in each}
    return [names[name] for name in wrinkle_entry(nodes[node]).get(PARTS, ())]


def wrinkle_targets(document: Document) -> dict[int, frozenset[str]]:
    """For each node the names of the morph targets that a bake has added, by its extras."""
    nodes = document.items("nodes")
    found = {index: _wrinkle_targets(node) for index, node in enumerate(nodes)}
    return found | {part: found[part] | found[body] for part, body in bodies_of_parts(document).items()}


def bodies_of_parts(document: Document) -> dict[int, int]:
    """The node that carries the extras, for each other node with a part of its split mesh."""
    found: dict[int, int] = {}
    for index, node in enumerate(document.items("nodes")):
        try:
            found |= dict.fromkeys(part_nodes(document, index) if _wrinkle_targets(node) else (), index)
        except (KeyError, TypeError, AttributeError):
            continue
    return found


def _read_part(document: Document, node: int) -> BakedPart:
    rig = read_rig(document, node)
    mesh = document.items("meshes")[rig.mesh]
    name = mesh.get("name")
    return BakedPart(
        node=document.items("nodes")[node]["name"],
        mesh=name if isinstance(name, str) else None,
        primitives=len(mesh["primitives"]),
        targets=rig.morph_names,
        stored=rig.morph_weights,
        skinned=rig.skinned,
    )


def _wrinkle_targets(node: Json) -> frozenset[str]:
    entry = wrinkle_entry(node)
    try:
        return frozenset(
            {name for each in stored_drives(entry) for name in each["targets"]} | set(entry.get("undriven", ()))
        )
    except (KeyError, TypeError, AttributeError):
        return frozenset()  # no bake has written these extras


def count_named(document: Document, name: str) -> int:
    """The number of nodes and scenes of a name, as three.js writes it."""
    names = (each.get("name", "") for kind in ("nodes", "scenes") for each in document.items(kind))
    return sum(_sanitized(each) == _sanitized(name) for each in names)


def _sanitized(name: str) -> str:
    """A name as three.js writes it. Source: PropertyBinding.sanitizeNodeName of three.js."""
    return re.sub(r"[\[\].:/]", "", re.sub(r"\s", "_", name))
