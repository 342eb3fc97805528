"""Describe an asset by its JSON: meshes, skins, clips, morph targets, extensions, bytes, and baked tools.

Counts and durations are those that accessors state. Geometry is decoded for the bounds only.
"""

import math
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from itertools import accumulate, pairwise
from typing import Any

import numpy as np

from wrinklecli.baking.original import original, wrinkled
from wrinklecli.character.clip import clip_name
from wrinklecli.character.mesh_names import own_names
from wrinklecli.character.pose import stored_positions
from wrinklecli.character.rig import Hierarchy, from_roots, morph_target_names, read_hierarchy
from wrinklecli.character.scene import read_scene
from wrinklecli.drive.drive import anchors_of, wrinkle_entry
from wrinklecli.errors import AssetError, TooMuchError, WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import Channels, pointer_of
from wrinklecli.gltf.document import TRIANGLE_FAN, TRIANGLE_STRIP, TRIANGLES, Document, read_document
from wrinklecli.gltf.files import local_file, path_of
from wrinklecli.gltf.images import read_image
from wrinklecli.gltf.references import accessor_references, accessor_views, draco_views, view_parts
from wrinklecli.gltf.shape import COMPRESSIONS, Json
from wrinklecli.numeric.arrays import distinct_values, significant
from wrinklecli.numeric.guard import guarded
from wrinklecli.numeric.memory import MAX_MEMORY, Memory

# Version of the JSON.
VERSION = 1
# Names of the modes of primitives, by number.
_MODES = ("points", "lines", "line loop", "line strip", "triangles", "triangle strip", "triangle fan")
# Kinds of bytes.
KINDS = ("geometry", "indices", "morph targets", "animation", "skins", "images", "original", "other")


@dataclass(frozen=True, slots=True)
class InspectOptions:
    """Options of `inspect`.

    Attributes:
        allow_external: Read buffers outside the asset's folder too, and count the bytes of images there.
        max_memory: Most bytes that reading the asset may take.
    """

    allow_external: bool = False
    max_memory: int = MAX_MEMORY


def inspect(asset: str | os.PathLike[str], options: InspectOptions | None = None, **named: Any) -> Json:
    """Describe an asset.

    Args:
        asset: The .gltf or .glb to read.
        options: The defaults of `InspectOptions` if None.
        named: Single options by their names in `InspectOptions`, in place of those in `options`.

    Returns:
        JSON values only. `bytes` are counted as stored, compressed or not; `original` is the record that a bake keeps
        so that it can be replaced; `other` is the rest of the files: JSON, padding and unused data. `bounds`, and a
        skin's `rest` (its joints' positions), are world space in the stored pose, or None if unknown. A skin's
        `parents` are the numbers of the joints above its joints.

    Raises:
        AssetError: The asset is malformed.
        TypeError: `InspectOptions` lacks a name of `named`.

    Examples:
        >>> from wrinklecli import inspect
        >>> [clip["name"] for clip in inspect("samples/wrist.glb")["clips"]]
        ['flex', 'extend']
    """
    options = replace(options or InspectOptions(), **named)
    with guarded(os.fspath(asset)):
        memory = Memory(options.max_memory)
        return _describe(read_document(asset, allow_external=options.allow_external, memory=memory))


def _describe(document: Document) -> Json:
    gltf = document.gltf
    about = gltf.get("asset", {})
    generator = about.get("generator")
    files, kinds = _bytes(document)
    meshes = [_describe_mesh(document, index) for index in range(len(document.items("meshes")))]
    try:
        hierarchy = read_hierarchy(document)
    except (AssetError, TooMuchError):
        hierarchy = None
    return {
        "inspect": VERSION,
        "asset": document.path,
        "version": about.get("version"),
        "generator": generator if isinstance(generator, str) else None,
        "extensions_used": list(gltf.get("extensionsUsed", [])),
        "extensions_required": list(gltf.get("extensionsRequired", [])),
        "meshes": meshes,
        "bounds": _stored_bounds(document),
        "nodes": len(document.items("nodes")),
        "deforming": list(_deforming(document, meshes)),
        "skins": [_describe_skin(document, index, hierarchy) for index in range(len(document.items("skins")))],
        "clips": list(_clips(document)),
        "unplayed": list(_unplayed(document)),
        "wrinkles": list(_wrinkles(document)),
        "replaceable": _is_replaceable(document),
        "files": files,
        "bytes": kinds,
    }


def _node_name(document: Document, index: int) -> str:
    return document.items("nodes")[index].get("name") or f"node_{index}"


def _count(document: Document, index: int) -> int:
    count: int = document.items("accessors")[index].get("count", 0)
    return count


def _describe_mesh(document: Document, index: int) -> Json:
    mesh = document.items("meshes")[index]
    primitives = [_describe_primitive(document, primitive) for primitive in mesh.get("primitives", [])]
    return {
        "name": mesh.get("name"),
        "vertices": sum(each["vertices"] for each in primitives),
        "triangles": sum(each["triangles"] for each in primitives),
        "morph_targets": morph_target_names(mesh),
        "primitives": primitives,
    }


def _describe_primitive(document: Document, primitive: Json) -> Json:
    attributes, materials = primitive.get("attributes", {}), document.items("materials")
    vertices = _count(document, attributes["POSITION"]) if "POSITION" in attributes else 0
    corners = _count(document, primitive["indices"]) if "indices" in primitive else vertices
    mode = primitive.get("mode", TRIANGLES)
    by_mode = {TRIANGLES: corners // 3, TRIANGLE_STRIP: max(corners - 2, 0), TRIANGLE_FAN: max(corners - 2, 0)}
    material = primitive.get("material", len(materials))
    return {
        "mode": _MODES[mode] if mode < len(_MODES) else str(mode),
        "vertices": vertices,
        "triangles": by_mode.get(mode, 0),
        "attributes": list(attributes),
        "morph_targets": len(primitive.get("targets", [])),
        "material": materials[material].get("name") if material < len(materials) else None,
        "compression": next((name for name in COMPRESSIONS if name in _compressions(document, primitive)), None),
    }


def _compressions(document: Document, primitive: Json) -> set[str]:
    """The extensions of a primitive, and of the views of its accessors."""
    found = set(primitive.get("extensions", {}))
    used = [*primitive.get("attributes", {}).values(), *([primitive["indices"]] if "indices" in primitive else [])]
    views = document.items("bufferViews")
    for view in (view for index in used for view in accessor_views(document.items("accessors")[index])):
        found |= set(views[view].get("extensions", {}))
    return found


def _deforming(document: Document, meshes: list[Json]) -> Iterator[Json]:
    """The nodes whose mesh has a skin or morph targets, so that a tool can be on them."""
    names = own_names(document)
    for index, node in enumerate(document.items("nodes")):
        if "mesh" not in node:
            continue
        morphs = len(meshes[node["mesh"]]["morph_targets"])
        if "skin" in node or morphs:
            yield {
                "node": names[index],
                "mesh": node["mesh"],
                "skin": node.get("skin"),
                "morph_targets": morphs,
            }


def _stored_bounds(document: Document) -> Json | None:
    """The box around the visible scene in the stored pose; None if a mesh cannot be read."""
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    try:
        for primitive in read_scene(document):
            posed = primitive.posed(None, np.zeros(1))
            positions = posed.positions[0, distinct_values(primitive.triangles)]
            if len(positions) and not posed.hidden[0]:
                low, high = np.minimum(low, positions.min(axis=0)), np.maximum(high, positions.max(axis=0))
    except (WrinkleError, MemoryError):
        return None
    return {"min": low.tolist(), "max": high.tolist()} if np.isfinite([low, high]).all() else None


def _describe_skin(document: Document, index: int, hierarchy: Hierarchy | None) -> Json:
    skin = document.items("skins")[index]
    joints = skin.get("joints", [])
    rest = None if hierarchy is None else stored_positions(hierarchy, joints).tolist()
    names = [_node_name(document, joint) for joint in joints]
    parents = None if hierarchy is None else _parents(joints, hierarchy)
    return {"name": skin.get("name"), "joints": names, "rest": rest, "parents": parents}


def _parents(joints: list[int], hierarchy: Hierarchy) -> list[int | None]:
    """The nearest joint above each joint, by its number in the skin; None for the topmost."""
    numbers = {node: number for number, node in reversed([*enumerate(joints)])}
    above: dict[int, int | None] = {}
    for node in from_roots(hierarchy.parents):
        parent = int(hierarchy.parents[node])
        above[node] = numbers.get(parent, above.get(parent))
    return [above[joint] for joint in joints]


def _clips(document: Document) -> Iterator[Json]:
    """The animations by the names that `--clip` takes, with the times that their accessors state."""
    names: set[str] = set()
    known = Channels(document.gltf)
    for index, animation in enumerate(document.items("animations")):
        paths = Counter[str]()
        groups, inputs = dict[int, tuple[int, ...]](), set()
        for channel in animation.get("channels", []):
            moved = known.moved(channel)
            if moved is not None:
                paths[moved.path] += 1
                # Pointers at one mesh share their nodes, and there may be many of both.
                groups[id(moved.nodes) if moved.mesh is not None else -moved.nodes[0]] = moved.nodes
                inputs.add(animation["samplers"][channel["sampler"]]["input"])
        if not inputs:
            continue
        names.add(name := clip_name(animation, index, names))
        accessors = [document.items("accessors")[each] for each in sorted(inputs)]
        starts, ends = (_bounds(accessors, key) for key in ("min", "max"))
        yield {
            "name": name,
            "start": min(starts) if starts else None,
            "end": max(ends) if ends else None,
            "keys": max(_count(document, each) for each in inputs),
            "nodes": len(set[int]().union(*groups.values())),
            "channels": dict(sorted(paths.items())),
        }


def _unplayed(document: Document) -> Iterator[Json]:
    """The channels that move no node, and what they move by a pointer; a bake keeps them as they are."""
    known = Channels(document.gltf)
    for index, animation in enumerate(document.items("animations")):
        for channel in animation.get("channels", []):
            if known.moved(channel) is None:
                yield {"animation": animation.get("name") or f"animation_{index}", "pointer": pointer_of(channel)}


def _bounds(accessors: Iterable[Json], key: str) -> list[float]:
    """The first numbers of accessors' `min` or `max`, which key times must have; none if one is missing."""
    try:
        return [_number(each[key][0]) for each in accessors]
    except (LookupError, TypeError, ValueError):
        return []


def _wrinkles(document: Document) -> Iterator[Json]:
    """The effects that a bake has recorded on each node, but for contact, which belongs to its tools."""
    for index in wrinkled(document.gltf):
        entry = wrinkle_entry(document.items("nodes")[index])
        try:
            yield {
                "node": _node_name(document, index),
                "method": entry.get("method"),
                "draft": entry.get("draft") is True,
                **{
                    key: [_described(key, each) for each in entry[key]]
                    for key in _DESCRIBED
                    if key in entry or key == "tools"
                },
                "undriven": [str(name) for name in entry.get("undriven", [])],
            }
        except (LookupError, TypeError, ValueError, AttributeError) as error:
            where = document.where("nodes", index, "extras", "wrinkle")
            raise AssetError("is not what `wrinkle bake` writes", where=where) from error


def _segment(drive: Json) -> Json:
    """The joints of a drive by a segment, and its length."""
    first, *between, last = map(_joints, anchors_of(drive))
    return {
        "origin_joints": first,
        **({"between_joints": between} if "anchors" in drive else {}),
        "target_joints": last,
        "rest_length": _number(drive["rest_length"]),
    }


def _turn(turn: Json) -> Json:
    """A joint that folds a field."""
    ends = [significant(math.degrees(_number(turn["angles"][end])), 4) for end in (0, -1)]
    return {"joint": str(turn["joint"]), "degrees": ends, "shapes": len(turn["weights"][0])}


# The effects by their lists in extras, each with what describes one beside its name and its targets.
_DESCRIBED: Mapping[str, Callable[[Json], Json]] = {
    "muscles": _segment,
    "flesh": lambda drive: {
        "joint": str(drive["joint"]),
        "frequencies": [_number(mode["frequency"]) for mode in drive["modes"]],
    },
    "touches": lambda drive: {
        "joints": _joints(anchors_of(drive)[0]),
        "pad": _number(drive["pad"]),
        "grip": _number(drive["grip"]),
        "directions": len(drive["windows"]),
    },
    "tools": _segment,
    "fields": lambda drive: {"turns": list(map(_turn, drive["turns"]))},
}


def _described(kind: str, drive: Json) -> Json:
    """An effect as a bake has recorded it."""
    own = _DESCRIBED[kind](drive)
    return {"name": str(drive["name"]), **own, "targets": [str(name) for name in drive["targets"]]}


def _joints(anchor: Json) -> list[str]:
    """The names of the joints that carry an anchor."""
    return [str(joint) for joint in anchor["joints"]]


def _is_replaceable(document: Document) -> bool | None:
    """True if `bake --replace` can remove all wrinkles of the file; None if it has none."""
    if not wrinkled(document.gltf):
        return None
    try:
        original(document)
    except WrinkleError:
        return False
    return True


def _number(value: Any) -> float:
    """A JSON number as a float; ValueError if it is not a number, or too large."""
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > sys.float_info.max:
        raise ValueError(value)
    return float(value)


def _bytes(document: Document) -> tuple[list[Json], Json]:
    """Every file of the asset with its size, None for an unreadable image; and the bytes of each kind."""
    sizes: dict[str, int | None] = {name: os.path.getsize(name) for name in document.files}
    kinds = dict.fromkeys(KINDS, 0)
    for view, users in _view_users(document).items():
        stored = list(view_parts(document.items("bufferViews")[view]))[-1].get("byteLength", 0)
        total = sum(users.values())
        cuts = [stored * part // total for part in accumulate(users.values(), initial=0)]
        for kind, (low, high) in zip(users, pairwise(cuts), strict=True):
            kinds[kind] += high - low
    for number, image in enumerate(document.items("images")):
        if isinstance(image.get("uri"), str):
            size, name = _image_size(document, number)
            kinds["images"] += size or 0
            if name is not None:
                sizes.setdefault(name, size)
    whole = sum(size or 0 for size in sizes.values())
    kinds["other"] = max(whole - sum(kinds.values()), 0)
    return [{"name": name, "bytes": size} for name, size in sizes.items()], kinds


def _view_users(document: Document) -> dict[int, Counter[str]]:
    """Count the elements of each kind in each used buffer view."""
    users: defaultdict[int, Counter[str]] = defaultdict(Counter)
    kinds: dict[int, str] = {}
    for index, kind in accessor_references(document.gltf):
        kinds.setdefault(index, kind)
    for index, kind in kinds.items():
        accessor = document.items("accessors")[index]
        for view in accessor_views(accessor):
            users[view][kind] += max(accessor.get("count", 0), 1)
    for view in draco_views(document.gltf):
        users[view]["geometry"] += 1
    for image in document.items("images"):
        if "bufferView" in image:
            users[image["bufferView"]]["images"] += 1
    for node in wrinkled(document.gltf):
        kept = wrinkle_entry(document.items("nodes")[node]).get("original")
        if isinstance(kept, int) and kept in range(len(document.items("bufferViews"))):
            users[kept]["original"] += 1
    return users


def _image_size(document: Document, number: int) -> tuple[int | None, str | None]:
    """The bytes of an image with a URI, None if unreadable, and its file, None for a data URI."""
    uri = document.items("images")[number]["uri"]
    if uri.startswith("data:"):
        try:
            return len(read_image(document, number)[0]), None
        except (AssetError, TooMuchError):
            return None, None
    try:
        where = document.where("images", number)
        name = local_file(uri, document.path, where, allow_external=document.allow_external)
        return os.path.getsize(name) if os.path.isfile(name) and os.access(name, os.R_OK) else None, name
    except (AssetError, TooMuchError):
        return None, os.path.join(os.path.dirname(document.path), path_of(uri))
