"""Adds clips to a document in memory, behind its own animations."""

from collections.abc import Collection, Sequence
from functools import partial
from typing import Any

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, affine_rows, determinants
from wrinklecli.numeric.memory import once

# Greatest difference, relative to a matrix's largest number, between it and the product of its decomposition.
_SHEARED = 1e-6


def with_clips(document: Document, clips: Sequence[Clip]) -> Document:
    """Append clips of the document's nodes as animations; the indices of the clips do not matter."""
    if not clips:
        return document
    edited = EditedDocument(document)
    edited.gltf.setdefault("animations", []).extend([_animation(edited, clip) for clip in clips])
    joined = edited.document()
    return document.extended(joined.gltf, joined.buffers)


def _animation(edited: EditedDocument, clip: Clip) -> Json:
    """Add the data of a clip and give its JSON; channels with the same key times share them."""
    samplers: list[Json] = []
    inputs: dict[bytes, int] = {}
    for channel in clip.channels:
        times = channel.times.astype(np.float32)
        keys = once(inputs, times.tobytes(), partial(edited.add, times, bounds=True))
        if channel.fault is not None:
            raise channel.fault
        # Each weight is a separate element.
        width = (-1,) if channel.path == "weights" else (-1, channel.values.shape[-1])
        values = edited.add(channel.values.astype(np.float32).reshape(width))
        samplers.append({"input": keys, "interpolation": channel.interpolation, "output": values})
    channels = [
        {"sampler": number, "target": {"node": each.node, "path": each.path}}
        for number, each in enumerate(clip.channels)
    ]
    return {"name": clip.name, "samplers": samplers, "channels": channels}


def with_free_nodes(document: Document, nodes: Collection[int]) -> Document:
    """Replace matrices of nodes by translation, rotation and scale, which alone can be animated.

    A matrix that shears has no such parts (glTF 2.0 §3.5.3); its node stays as it is.
    """
    freed = {}
    for index in nodes:
        node = document.items("nodes")[index]
        parts = _parts(np.array(node["matrix"], np.float64).reshape(4, 4).T) if "matrix" in node else None
        if parts is not None:
            freed[index] = {key: value for key, value in node.items() if key != "matrix"} | parts
    if not freed:
        return document
    every = [freed.get(index, node) for index, node in enumerate(document.items("nodes"))]
    return document.extended(document.gltf | {"nodes": every}, document.buffers)


def _parts(matrix: Floats) -> dict[str, Any] | None:
    """Translation, rotation and scale of a (4, 4) matrix; None if it shears or is singular."""
    from scipy.spatial.transform import Rotation  # few nodes have a matrix

    scale = np.sqrt(np.sum(matrix[:3, :3] ** 2, axis=0))
    if not scale.min() > 0:
        return None
    scale[0] *= -1.0 if determinants(matrix[:3, :3]) < 0 else 1.0
    try:
        rotation = Rotation.from_matrix(matrix[:3, :3] / scale).as_quat()
    except ValueError:  # no positive determinant
        return None
    again = affine_rows(matrix[:3, 3, None], rotation[:, None], scale[:, None])[..., 0]
    if not np.abs(again - matrix[:3]).max() <= _SHEARED * np.abs(matrix).max():
        return None
    parts = {"translation": matrix[:3, 3], "rotation": rotation, "scale": scale}
    return {key: [float(value) for value in values] for key, values in parts.items()}
