"""Compare JSON, whose references become links and whose numbers may differ a little, and accessors.

Source: glTF 2.0 specification, §5 (defaults of properties).
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import TRIANGLES, Document
from wrinklecli.gltf.shape import COMPRESSIONS, Json
from wrinklecli.numeric.arrays import Array, Floats
from wrinklecli.review.diff.difference import (
    Difference,
    Findings,
    Kind,
    Limits,
    Link,
    Place,
    Sides,
    brief,
    differ,
    is_index,
)

# The arrays to which keys of a kind of object refer, at any depth; `attributes` below an extension are accessors.
_REFERENCES: dict[str, dict[str, str]] = {
    "nodes": {"mesh": "meshes", "camera": "cameras", "attributes": "accessors"},
    "primitives": {"material": "materials"},
    "textures": {"source": "images", "sampler": "samplers"},
}
# Defaults of keys (glTF 2.0 §5); extensions have defaults of their own.
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
_MISSING: Any = object()
# Keys that say where an accessor's data lies.
_STORAGE = ("bufferView", "byteOffset")


def dict_differences(
    first: Json,
    second: Json,
    place: Place,
    kind: str,
    limits: Limits,
    *,
    name: object = None,
    skip: Iterable[str] = (),
    inside: str = "",
) -> Findings:
    """Compare JSON objects key by key.

    Args:
        first: Object of the first document.
        second: Object of the second document.
        place: Place of the first object.
        kind: Kind of the object that they are part of, which decides on references and defaults.
        limits: The greatest differences between numbers that count as equal.
        name: Name for messages; if None, the object's own.
        skip: Keys that are not compared.
        inside: "extras" or "extensions" if the objects are below such a key.
    """
    name = first.get("name") if name is None else name
    defaults = {} if inside else _DEFAULTS.get(kind, {})
    skipped = set(skip)
    if place[-2:] == ("extras", "wrinkle"):
        # This is the index of the buffer view with a bake's record of the original.
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
                # An index would mean nothing in a message.
                said = "" if deeper != "extras" and _referred(at, kind, deeper) else f"{brief(value)} "
                yield differ("structure", at, f"{said}only in {side}", name=name)
            continue
        yield from value_differences(one, other, at, kind, limits, name=name, inside=deeper)


def value_differences(
    one: Any, other: Any, place: Place, kind: str, limits: Limits, *, name: object = None, inside: str = ""
) -> Findings:
    """Compare JSON values; the arguments are those of `dict_differences`."""
    referred = None if inside == "extras" else _referred(place, kind, inside)
    if referred is not None and is_index(one) and is_index(other):
        yield Link(referred, one, other, place, name)
    elif isinstance(one, dict) and isinstance(other, dict):
        yield from dict_differences(one, other, place, kind, limits, name=name, inside=inside)
    elif isinstance(one, list) and isinstance(other, list):
        if len(one) != len(other):
            yield differ("value", place, f"{len(one)} -> {len(other)} items", name=name)
        elif _are_numbers(one) and _are_numbers(other):
            if any(limits.are_apart(*pair) for pair in zip(one, other, strict=True)):
                yield differ("value", place, f"{brief(one)} -> {brief(other)}", name=name)
        else:
            for number, pair in enumerate(zip(one, other, strict=True)):
                yield from value_differences(*pair, (*place, number), kind, limits, name=name, inside=inside)
    elif _are_numbers([one, other]):
        if limits.are_apart(one, other):
            yield differ("value", place, f"{brief(one)} -> {brief(other)}", name=name)
    elif type(one) is not type(other) or one != other:
        changed: Kind = "structure" if place[-1] == "name" else "value"
        yield differ(changed, place, f"{brief(one)} -> {brief(other)}", name=name)


def _referred(place: Place, kind: str, inside: str) -> str | None:
    """The array to which an index at a place refers, if it is one."""
    key = place[-1]
    above = place[-2] if len(place) > 1 else ""
    if key == "index" and isinstance(above, str) and above.endswith("Texture"):
        return "textures"
    if above == "attributes" and kind == "nodes" and inside == "extensions":
        return "accessors"
    known = _REFERENCES.get(kind, {})
    return known.get(key) if isinstance(key, str) and key != "attributes" else None


def _stripped(extensions: Any) -> Any:
    """Extensions without those of compression; _MISSING if no other remains."""
    if not isinstance(extensions, dict):
        return extensions
    return {key: value for key, value in extensions.items() if key not in COMPRESSIONS} or _MISSING


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def decoded(document: Document, index: int | None) -> Array | None:
    """The elements of an accessor; None without an index, or if it is malformed, as a bake may leave it."""
    try:
        return None if index is None else document.accessor(index, user=document.path)
    except AssetError:
        return None


def accessor_differences(
    sides: Sides, i: int, j: int, place: Place, *, name: object = "", scale: float = 1.0
) -> Iterator[Difference]:
    """Compare two accessors; POSITION is compared as positions, `scale` scene units for each unit."""
    one, other = decoded(sides.a, i), decoded(sides.b, j)
    if one is None or other is None:
        yield from unreadable_differences(sides, i, j, place, name=name)
        return
    if one.shape != other.shape:
        shapes = " -> ".join("×".join(map(str, each.shape)) for each in (one, other))
        yield differ("geometry", place, f"{shapes} numbers", name=name)
        return
    is_place = place[-1] == "POSITION"
    apart = gaps(one, other)
    apart = apart if apart.ndim == 1 else np.linalg.norm(apart, axis=1) if is_place else apart.max(axis=1)
    whole = one.dtype.kind in "iu" and other.dtype.kind in "iu"
    limit: Any = 0 if whole else sides.limits.ratio * np.maximum(1.0, _most(one))
    if is_place:
        apart, limit = apart * scale, sides.limits.length
    off = apart > limit
    if off.any():
        vertex = int(np.argmax(np.where(off, apart, -1.0)))
        worst = float(apart[vertex])
        what = f"vertex {vertex} is {worst:.3g} off" if is_place else f"vertex {vertex} differs by {worst:.3g}"
        message = f"{what}{count_that_differ(int(off.sum()), len(apart))}"
        yield differ("geometry", place, message, name=name, distance=worst if is_place else None)


def unreadable_differences(
    sides: Sides, i: int | None, j: int | None, place: Place, *, name: object
) -> Iterator[Difference]:
    """Compare accessors as they are stored, if one of them cannot be decoded."""
    ends = {"A": (sides.a, i), "B": (sides.b, j)}
    unreadable = [side for side, end in ends.items() if end[1] is not None and decoded(*end) is None]
    if len(unreadable) == 1:
        yield differ("geometry", place, f"cannot be decoded in {unreadable[0]}", name=name)
    elif unreadable and _stored(*ends["A"]) != _stored(*ends["B"]):
        yield differ("geometry", place, "cannot be decoded, and is stored otherwise", name=name)


def _stored(document: Document, index: Any) -> tuple[Any, bytes | None]:
    """The JSON of an accessor, and the bytes of its view if they can be read."""
    accessors = document.items("accessors")
    if index not in range(len(accessors)):
        return None, None
    accessor = accessors[index]
    try:
        data = bytes(document.view(accessor["bufferView"])) if "bufferView" in accessor else None
    except AssetError:
        data = None
    return {key: value for key, value in accessor.items() if key not in _STORAGE}, data


def property_gaps(path: str, first: Floats, second: Floats, limits: Limits) -> Floats:
    """(times,) differences of (times, components) values of a node's property; 0 within the limits."""
    if path == "rotation":
        # A quaternion and its negative are the same rotation.
        turned = np.sum(first * second, axis=1, keepdims=True) < 0
        second = np.where(turned, -second, second)
    apart = gaps(first, second)
    if path == "translation":
        gap = np.sqrt(np.sum(apart * apart, axis=1))
        limit = np.maximum(limits.length, limits.ratio * _most(first))
    else:
        gap = apart.max(axis=1, initial=0.0)
        limit = limits.ratio * np.maximum(1.0, _most(first))
    return np.where(gap > limit, gap, 0.0)


def gaps(first: Array, second: Array) -> Floats:
    """Absolute differences; 0 for equal numbers, infinite if only one is finite."""
    first, second = first.astype(np.float64), second.astype(np.float64)
    finite = np.isfinite(first) & np.isfinite(second)
    same = (first == second) | (np.isnan(first) & np.isnan(second))
    apart = np.abs(np.where(finite, first, 0.0) - np.where(finite, second, 0.0))
    return np.where(finite, apart, np.where(same, 0.0, np.inf))


def count_that_differ(count: int, total: int) -> str:
    """The end of a message: the number that differ, if it is more than 1."""
    return f"; {count} of {total} differ" if count > 1 else ""


def _most(values: Array) -> Floats:
    """(rows,) the greatest finite magnitude in each row."""
    magnitudes = np.abs(np.where(np.isfinite(values), values, 0.0)).astype(np.float64)
    return magnitudes if magnitudes.ndim == 1 else magnitudes.max(axis=1, initial=0.0)
