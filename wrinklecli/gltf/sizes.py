"""How many bytes of its buffers a document needs for some of its accessors.

Source: glTF 2.0 §3.6.2; EXT_meshopt_compression.
"""

from collections.abc import Iterable

from wrinklecli.gltf.document import COMPONENT_TYPES, SIZE_TYPES
from wrinklecli.gltf.new_data import aligned
from wrinklecli.gltf.references import view_parts
from wrinklecli.gltf.shape import Json

_COMPONENT_BYTES = {number: dtype.itemsize for dtype, number in COMPONENT_TYPES.items()}
_COMPONENTS = {name: size for size, name in SIZE_TYPES.items()}


def stored_bytes(gltf: Json, accessors: Iterable[int]) -> int:
    """Bytes of VEC and SCALAR accessors in buffers: what several read is counted once, JSON not at all.

    Of a compressed view, which has no places for single accessors, each takes the share that it would uncompressed.
    """
    views = gltf.get("bufferViews", [])
    places: dict[tuple[int, int], float] = {}
    for index in set(accessors):
        accessor = gltf["accessors"][index]
        sparse = accessor.get("sparse", {})
        element = _COMPONENT_BYTES[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
        # Of vertex attributes each element begins at a multiple of 4 bytes.
        parts = [(accessor, accessor["count"] * aligned(element))]
        if sparse:
            index_bytes = _COMPONENT_BYTES[sparse["indices"]["componentType"]]
            parts += [(sparse["indices"], sparse["count"] * index_bytes), (sparse["values"], sparse["count"] * element)]
        for part, size in parts:
            if "bufferView" in part:
                whole, *packed = [each.get("byteLength", 0) for each in view_parts(views[part["bufferView"]])]
                share = packed[0] / max(whole, 1) if packed else 1.0
                place = part["bufferView"], part.get("byteOffset", 0)
                places[place] = max(places.get(place, 0.0), size * share)
    return round(sum(places.values()))
