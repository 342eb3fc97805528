"""Replaces the Draco stream of a primitive by plain accessors.

Source: KHR_draco_mesh_compression.
"""

import numpy as np

from wrinklecli.gltf import draco
from wrinklecli.gltf.edited_document import INDEX_DATA, VERTEX_DATA, EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Array


def unpack(edited: EditedDocument, primitive: Json) -> None:
    """Give a primitive of the edited document plain accessors, if it has none yet."""
    extension = primitive.get("extensions", {}).pop(draco.EXTENSION, None)
    if extension is None:
        return
    if not primitive["extensions"]:
        del primitive["extensions"]
    primitive.pop("mode", None)  # a strip is decoded to triangles
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
            owner[key] = edited.add_like(index, values, target=target, bounds="min" in accessor, replaces=index)
    if extension.get("bufferView", len(edited.gltf["bufferViews"])) < len(edited.gltf["bufferViews"]):
        edited.drop_view(extension["bufferView"])


def used_joints(joints: Array, weights: Array, name: str) -> Array:
    """(vertices, 4) joints with joint 0 where the (vertices, 4) weight is 0, as after rounding by Draco.

    A vertex without weight keeps its first joint of JOINTS_0, which it follows.

    Source: glTF 2.0 §3.7.3.3, "joints with a weight of zero SHOULD be set to zero".
    """
    if weights.shape != joints.shape:
        return joints
    used = weights > 0
    if name == "JOINTS_0":
        used[:, 0] |= ~used.any(axis=1)
    return np.where(used, joints, 0).astype(joints.dtype)
