"""Finds references in a document's JSON: to accessors, buffer views and the bytes of buffers.

Source: glTF 2.0 specification, §3.6; EXT_meshopt_compression and KHR_draco_mesh_compression.
"""

from collections.abc import Container, Iterator
from itertools import chain, count
from typing import Any

from wrinklecli.gltf.shape import COMPRESSIONS, DRACO, MESHOPT, Json


def view_parts(view: Json) -> Iterator[Json]:
    """The parts of a view that refer to bytes of a buffer: itself, and the extension that compresses it."""
    yield view
    extensions = view.get("extensions", {})
    yield from (extensions[name] for name in MESHOPT if name in extensions)


def draco_primitives(gltf: Json) -> Iterator[Json]:
    """The primitives that Draco compresses."""
    for mesh in gltf.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            if DRACO in primitive.get("extensions", {}):
                yield primitive


def is_placeholder(gltf: Json, buffer: int) -> bool:
    """True if a buffer needs no data, as all its views are compressed into other buffers."""
    views = [(view, list(view_parts(view))) for view in gltf.get("bufferViews", [])]
    shown = [parts for view, parts in views if view.get("buffer") == buffer]
    read = any(part.get("buffer") == buffer for _, parts in views for part in parts[1:])
    return not read and bool(shown) and all(len(parts) > 1 for parts in shown)


def accessor_references(gltf: Json) -> Iterator[tuple[int, str]]:
    """Give the accessor of every reference in the core specification, with its kind of data."""
    for mesh in gltf.get("meshes", []):
        for primitive in mesh.get("primitives", []):
            yield from ((index, "geometry") for index in primitive.get("attributes", {}).values())
            yield from ((index, "morph targets") for each in primitive.get("targets", []) for index in each.values())
            if "indices" in primitive:
                yield primitive["indices"], "indices"
    for skin in gltf.get("skins", []):
        if "inverseBindMatrices" in skin:
            yield skin["inverseBindMatrices"], "skins"
    for animation in gltf.get("animations", []):
        for sampler in animation.get("samplers", []):
            yield from ((sampler[key], "animation") for key in ("input", "output") if key in sampler)


def accessor_views(accessor: Json) -> Iterator[int]:
    """The buffer views that an accessor reads."""
    sparse = accessor.get("sparse", {})
    for source in (accessor, sparse.get("indices", {}), sparse.get("values", {})):
        if "bufferView" in source:
            yield source["bufferView"]


def view_references(gltf: Json) -> Iterator[int]:
    """Give the buffer view of every known reference."""
    for accessor in gltf.get("accessors", []):
        yield from accessor_views(accessor)
    yield from draco_views(gltf)
    yield from (image["bufferView"] for image in gltf.get("images", []) if "bufferView" in image)


def draco_views(gltf: Json) -> Iterator[int]:
    """Give the buffer view of every reference to a Draco stream."""
    for primitive in draco_primitives(gltf):
        if "bufferView" in primitive["extensions"][DRACO]:
            yield primitive["extensions"][DRACO]["bufferView"]


def extension_integers(value: Any, *, inside: bool = False) -> Iterator[int]:
    """Give every integer below an `extensions` object that we do not understand: a possible reference."""
    if isinstance(value, dict):
        for key, child in value.items():
            if key != "extras" and not (inside and key in COMPRESSIONS):
                yield from extension_integers(child, inside=inside or key == "extensions")
    elif isinstance(value, list):
        for child in value:
            yield from extension_integers(child, inside=inside)
    elif inside and isinstance(value, int) and not isinstance(value, bool):
        yield value


def compressions(gltf: Json) -> set[str]:
    """The compressions that a document's objects use."""
    users = [*gltf.get("bufferViews", []), *gltf.get("buffers", []), *draco_primitives(gltf)]
    return {name for user in users for name in user.get("extensions", {}) if name in COMPRESSIONS}


def drop_extensions(gltf: Json, gone: set[str]) -> None:
    """Take extensions from the lists of those that are used and required; a list without any goes."""
    for key in ("extensionsUsed", "extensionsRequired"):
        if gone.intersection(gltf.get(key, [])):
            gltf[key] = [name for name in gltf[key] if name not in gone]
            if not gltf[key]:
                del gltf[key]


def unused_name(name: str, taken: Container[str | None], between: str = "_") -> str:
    """A name, or else the name with the least number from 2 on, that is not taken."""
    names = chain([name], (f"{name}{between}{number}" for number in count(2)))
    return next(each for each in names if each not in taken)


def view_span(view: Json) -> tuple[int, int]:
    """The range of bytes that a view, or the extension that compresses it, shows of its buffer."""
    start = view.get("byteOffset", 0)
    return start, start + view.get("byteLength", 0)
