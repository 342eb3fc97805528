"""A primitive that Draco compressed, given plain accessors.

Source: KHR_draco_mesh_compression.
"""

import numpy as np

from wrinklecli.gltf import draco
from wrinklecli.gltf.edited_document import INDEX_DATA, VERTEX_DATA, EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Array


def unpack(edited: EditedDocument, primitive: Json) -> None:
    """Give a primitive of the edited document plain accessors, where it has not got them yet."""
    extension = primitive.get("extensions", {}).pop(draco.EXTENSION, None)
    if extension is None:
        return
    if not primitive["extensions"]:
        del primitive["extensions"]
    primitive.pop("mode", None)  # a strip came as triangles
    attributes = primitive["attributes"]
    packed = dict(attributes)
    users = [(attributes, name, VERTEX_DATA) for name in attributes]
    users += [(primitive, "indices", INDEX_DATA)] if "indices" in primitive else []
    for owner, key, target in users:
        index = owner[key]
        accessor = edited.gltf["accessors"][index]
        if "bufferView" not in accessor and edited.source.is_draco(index):
            values = edited.source.stored(index)
            weights = packed.get(key.replace("JOINTS_", "WEIGHTS_")) if key.startswith("JOINTS_") else None
            if weights is not None:
                values = used_joints(values, edited.source.accessor(weights), key)
            owner[key] = edited.add(
                values,
                target=target,
                normalized=accessor.get("normalized", False),
                bounds="min" in accessor,
                replaces=index,
            )
    if extension.get("bufferView", len(edited.gltf["bufferViews"])) < len(edited.gltf["bufferViews"]):
        edited.drop_view(extension["bufferView"])


def used_joints(joints: Array, weights: Array, name: str) -> Array:
    """(vertices, 4) joints, those of weight 0 as joint 0: rounding, as Draco's, leaves some behind.

    Args:
        joints: (vertices, 4).
        weights: (vertices, 4) of the same set.
        name: JOINTS_0 or another set. In the first a vertex without weight keeps its first joint, which it follows.

    Source: glTF 2.0 §3.7.3.3, "joints with a weight of zero SHOULD be set to zero".
    """
    if weights.shape != joints.shape:
        return joints
    used = weights > 0
    if name == "JOINTS_0":
        used[:, 0] |= ~used.any(axis=1)
    return np.where(used, joints, 0).astype(joints.dtype)
