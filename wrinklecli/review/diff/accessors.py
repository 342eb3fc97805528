"""Compare accessors of two documents as numbers, or as they are stored if they cannot be decoded."""

from collections.abc import Iterator
from typing import Any

from wrinklecli.errors import AssetError, TooMuchError
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Array
from wrinklecli.review.diff.difference import Difference, Place, Sides, differ
from wrinklecli.review.diff.values import array_differences

# Keys that say where an accessor's data lies.
_STORAGE = ("bufferView", "byteOffset")


def decoded(document: Document, index: int | None) -> Array | None:
    """The elements of an accessor; None without an index, or if it is malformed, as a bake may leave it."""
    try:
        return None if index is None else document.accessor(index, user=document.path)
    except TooMuchError:
        raise
    except AssetError:
        return None


def accessor_differences(
    sides: Sides, i: int, j: int, place: Place, *, name: object = "", scale: float = 1.0
) -> Iterator[Difference]:
    """Compare two accessors; POSITION is compared as positions, `scale` scene units for each unit."""
    one, other = decoded(sides.a, i), decoded(sides.b, j)
    if one is None or other is None:
        yield from unreadable_differences(sides, i, j, place, name=name)
    else:
        yield from array_differences(one, other, place, sides.limits, name=name, scale=scale)


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
    except TooMuchError:
        raise
    except AssetError:
        data = None
    return {key: value for key, value in accessor.items() if key not in _STORAGE}, data
