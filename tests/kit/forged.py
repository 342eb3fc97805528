"""Records of original assets that were changed and sealed again, as one who knows the format would do it."""

import json
from collections.abc import Callable

from kit.asset import Json
from wrinklecli.baking import original
from wrinklecli.gltf.document import Document


def forge(gltf: Json, data: bytes, change: Callable[[Json], None]) -> tuple[Json, bytes]:
    """A baked file's JSON and buffer, with a record that says something else.

    Args:
        gltf: The JSON of a file with one buffer that ends with a record; it is changed.
        data: Its buffer.
        change: What to do to the record's JSON.
    """
    document = Document("forged.glb", gltf, (memoryview(data),), ())
    content = original._read_record(document, original.wrinkled(gltf), 2**28)
    head, _, dead = content.partition(b"\n")
    made = json.loads(head)
    change(made)
    view = gltf["bufferViews"][-1]
    bare = original._without_record(gltf)
    before = data[: view["byteOffset"]]
    packed = original._compressed(json.dumps(made).encode() + b"\n" + dead, original._dictionary(bare, []))
    record = original._HEADER.pack(original._digest(bare, [[before]]), 0) + packed
    view["byteLength"] = len(record)
    gltf["buffers"][0]["byteLength"] = len(before) + len(record)
    return gltf, before + record
