"""Wrinkle maps of few texels, where the defaults would take half a minute, and of two places on one."""

from contextlib import AbstractContextManager
from functools import partial
from typing import Any
from unittest import mock

import numpy as np

from kit.samples import Editor, sample
from wrinklecli.gltf.document import read_document
from wrinklecli.texture.maps import MapOptions


def small_maps(size: int = 16) -> AbstractContextManager[Any]:
    """A block in which a bake's maps have so many texels a side."""
    return mock.patch("wrinklecli.texture.maps.MapOptions", partial(MapOptions, size=size))


def on_one_place(editor: Editor) -> None:
    """Both sides of the wrist get one side's texture, mirrored."""
    for primitive in editor.json["meshes"][0]["primitives"]:
        stored = read_document(sample("wrist")).accessor(primitive["attributes"]["TEXCOORD_0"])
        mirrored = np.column_stack([0.5 - np.abs(stored[:, 0] - 0.5), stored[:, 1]])
        primitive["attributes"]["TEXCOORD_0"] = editor.accessor(mirrored.astype(np.float32))
