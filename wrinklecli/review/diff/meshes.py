"""Compare meshes of two documents by their decoded primitives, attributes, morph targets and triangles; and images."""

from collections.abc import Iterator

import numpy as np

from wrinklecli.character.rig import morph_target_names
from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.images import read_image
from wrinklecli.gltf.shape import Json
from wrinklecli.review.diff.difference import Difference, Findings, Place, Sides, differ
from wrinklecli.review.diff.values import (
    accessor_differences,
    count_that_differ,
    decoded,
    dict_differences,
    unreadable_differences,
)

# Keys that say where an image's bytes lie, or that the bytes say themselves.
_IMAGE_STORAGE = ("uri", "bufferView", "mimeType")


@dataclass(frozen=True, slots=True)
class _Mesh:
    """Facts about a mesh for the comparisons of its primitives: its stored name and the names of its targets.

    `skinned` if skins move it in both documents; `scale` is in scene units for each bind unit.
    """

    name: object
    targets: tuple[str, ...]
    skinned: bool
    scale: float


def mesh_differences(sides: Sides, i: int, j: int) -> Findings:
    """Compare two meshes, primitive by primitive in their order."""
    first, second = sides.items("meshes", i, j)
    place, name = ("meshes", i), first.get("name")
    yield from dict_differences(first, second, place, "meshes", sides.limits, skip={"primitives", "weights"})
    primitives = first.get("primitives", []), second.get("primitives", [])
    if len(primitives[0]) != len(primitives[1]):
        message = f"{len(primitives[0])} -> {len(primitives[1])} primitives"
        yield differ("structure", (*place, "primitives"), message, name=name)
    skinned = i in sides.skinned[0] and j in sides.skinned[1]
    mesh = _Mesh(name, tuple(morph_target_names(first)), skinned, sides.limits.scales.get(i, 1.0))
    for number, (one, other) in enumerate(zip(*primitives, strict=False)):
        yield from _primitive_differences(sides, one, other, (*place, "primitives", number), mesh)


def _primitive_differences(sides: Sides, first: Json, second: Json, place: Place, mesh: _Mesh) -> Findings:
    name = mesh.name
    skip = {"attributes", "indices", "targets"}
    yield from dict_differences(first, second, place, "primitives", sides.limits, name=name, skip=skip)
    stored_a, stored_b = (primitive.get("attributes", {}).get("POSITION") for primitive in (first, second))
    positions = decoded(sides.a, stored_a), decoded(sides.b, stored_b)
    counts = [0 if each is None else len(each) for each in positions]
    targets = first.get("targets", []), second.get("targets", [])
    if len(targets[0]) != len(targets[1]):
        message = f"{len(targets[0])} -> {len(targets[1])} morph targets"
        yield differ("structure", (*place, "targets"), message, name=name)
    if counts[0] != counts[1]:
        at: Place = (*place, "attributes", "POSITION")
        yield from unreadable_differences(sides, stored_a, stored_b, at, name=name)
        yield differ("geometry", place, f"{counts[0]} -> {counts[1]} vertices", name=name)
        return
    attributes_a, attributes_b = (
        # Skin weights are compared elsewhere, joint by joint.
        {
            key: index
            for key, index in primitive.get("attributes", {}).items()
            if not (mesh.skinned and key.startswith(("JOINTS_", "WEIGHTS_")))
        }
        for primitive in (first, second)
    )
    at = (*place, "attributes")
    yield from _attribute_differences(sides, attributes_a, attributes_b, at, name=name, scale=mesh.scale)
    at = (*place, "indices")
    ours, theirs = (
        decoded(document, primitive["indices"]) if "indices" in primitive else np.arange(counts[0])
        for document, primitive in ((sides.a, first), (sides.b, second))
    )
    if ours is None or theirs is None:
        yield from unreadable_differences(sides, first.get("indices"), second.get("indices"), at, name=name)
    elif len(ours) != len(theirs):
        yield differ("geometry", at, f"{len(ours)} -> {len(theirs)} indices", name=name)
    elif (off := ours != theirs).any():
        number = int(off.argmax())
        message = f"index {number}: {ours[number]} -> {theirs[number]}{count_that_differ(int(off.sum()), len(off))}"
        yield differ("geometry", at, message, name=name)
    for number, (one, other) in enumerate(zip(*targets, strict=False)):
        known = f"{name}, {mesh.targets[number]}" if isinstance(name, str) and number < len(mesh.targets) else name
        at = (*place, "targets", number)
        yield from _attribute_differences(sides, one, other, at, name=known, scale=mesh.scale, idle=True)


def _attribute_differences(
    sides: Sides, first: Json, second: Json, place: Place, *, name: object, scale: float, idle: bool = False
) -> Iterator[Difference]:
    """Compare accessors by name; with `idle`, one that is all zeros may be left out."""
    for key in dict.fromkeys([*first, *second]):
        if key in first and key in second:
            yield from accessor_differences(sides, first[key], second[key], (*place, key), name=name, scale=scale)
            continue
        side, only = ("A", decoded(sides.a, first[key])) if key in first else ("B", decoded(sides.b, second[key]))
        if not (idle and only is not None and not only.any()):
            yield differ("structure", (*place, key), f"only in {side}", name=name)


def image_differences(sides: Sides, i: int, j: int) -> Findings:
    """Compare two images byte by byte."""
    first, second = sides.items("images", i, j)
    name = first.get("name", first.get("uri"))
    name = name if isinstance(name, str) and not name.startswith("data:") else ""
    yield from dict_differences(
        first, second, ("images", i), "images", sides.limits, name=name, skip=set(_IMAGE_STORAGE)
    )
    data = [_image_bytes(document, index) for document, index in ((sides.a, i), (sides.b, j))]
    if data[0] != data[1]:
        sizes = ["unreadable" if each is None else str(len(each)) for each in data]
        yield differ("image", ("images", i), f"other bytes ({' -> '.join(sizes)})", name=name)
    elif data[0] is None and first.get("uri") != second.get("uri"):
        yield differ("image", ("images", i), "other files, which cannot be read", name=name)


def _image_bytes(document: Document, index: int) -> bytes | None:
    """The bytes of an image, empty if it names none; None if they cannot be read, as a bake may leave them."""
    image = document.items("images")[index]
    try:
        return bytes(read_image(document, index)[0]) if "bufferView" in image or image.get("uri") else b""
    except AssetError:
        return None
