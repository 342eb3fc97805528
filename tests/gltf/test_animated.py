"""Channels move what a node and a path name, or a JSON pointer that resolves to a property."""

from typing import Any

import pytest

from kit.limb import limb_asset
from kit.pointers import EXTENSION, pointer
from wrinklecli.gltf.animated import Animated, Channels, drop_channels, forget_pointers


def moved(target: Any, **node: Any) -> Animated | None:
    """The property that a channel moves in a limb of two morph targets whose mesh a further node shows."""
    gltf = limb_asset(morphs=2, rings=3, sides=4).gltf
    gltf["nodes"].append({"name": "copy", "mesh": 0, **node})
    return Channels(gltf).moved({"sampler": 0, "target": target})


@pytest.mark.parametrize("path", ["translation", "rotation", "scale", "weights"])
def test_a_pointer_at_a_property_of_a_node_moves_what_node_and_path_move(path: str) -> None:
    assert moved(pointer(f"/nodes/0/{path}")) == moved({"node": 0, "path": path}) == Animated((0,), path)


def test_a_single_weight_has_its_number() -> None:
    assert moved(pointer("/nodes/0/weights/1")) == Animated((0,), "weights", 1)


@pytest.mark.parametrize("element", [None, 0])
def test_weights_of_a_mesh_move_the_nodes_that_have_none_of_their_own(element: int | None) -> None:
    text = pointer("/meshes/0/weights" + ("" if element is None else f"/{element}"))
    copy = 3
    assert moved(text) == Animated((0, copy), "weights", element, 0)
    assert moved(text, weights=[0.0, 0.0]) == Animated((0,), "weights", element, 0)


@pytest.mark.parametrize(
    "text",
    [
        "/nodes/9/rotation",
        "/nodes/00/rotation",
        "/nodes/-1/rotation",
        "/nodes/0/rotation/0",
        "/nodes/0/matrix",
        "/nodes/1/weights",
        "/nodes/0/weights/2",
        "/nodes/0/weights/",
        "/nodes/0/weights.length",
        "/meshes/0/rotation",
        "/meshes/1/weights",
        "/meshes/0/weights/2",
        f"/nodes/{'9' * 5000}/scale",
        "/nodes/0/scale\n",
        "nodes/0/scale",
        "/materials/0/alphaCutoff",
        "",
        None,
        7,
    ],
)
def test_a_pointer_at_nothing_else_moves_nothing(text: Any) -> None:
    assert moved(pointer(text)) is None


@pytest.mark.parametrize("target", [{}, {"path": "pointer", "extensions": 3}, {"path": "pointer", "node": 0}])
def test_a_target_without_a_pointer_moves_nothing(target: Any) -> None:
    assert moved(target) is None
    assert moved({"path": "pointer", "extensions": {EXTENSION: None}}) is None


def test_dropped_channels_take_the_samplers_that_no_other_has() -> None:
    channels = [{"sampler": each, "target": {}} for each in (2, 0, 1, 0)]
    animation = {"channels": list(channels), "samplers": [{"input": each} for each in range(3)]}
    assert drop_channels(animation, [channels[0], channels[1]]) == [{"input": 2}]
    assert animation["channels"] == [{"sampler": 1, "target": {}}, {"sampler": 0, "target": {}}]
    assert animation["samplers"] == [{"input": 0}, {"input": 1}]


def test_the_extension_is_listed_while_a_channel_has_a_pointer() -> None:
    lists = {"extensionsUsed": ["A", EXTENSION], "extensionsRequired": [EXTENSION]}
    gltf: dict[str, Any] = {"animations": [{"channels": [{"target": pointer("/materials/0/alphaCutoff")}]}], **lists}
    forget_pointers(gltf)
    assert gltf["extensionsUsed"] == ["A", EXTENSION]
    gltf["animations"][0]["channels"][0]["target"] = {"node": 0, "path": "scale"}
    forget_pointers(gltf)
    assert gltf["extensionsUsed"] == ["A"]
    assert "extensionsRequired" not in gltf
