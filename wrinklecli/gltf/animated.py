"""Finds what the channels of animations move: properties of nodes, named by a node and a path or by a JSON pointer.

Source: glTF 2.0 §3.11; KHR_animation_pointer; glTF 2.0 Asset Object Model (core pointers). A pointer that resolves to
no property moves nothing.
"""

import re
from collections import defaultdict
from collections.abc import Sequence
from functools import cached_property
from typing import Any

from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.references import drop_extensions
from wrinklecli.gltf.shape import Json, place

EXTENSION = "KHR_animation_pointer"

# Properties of a node that channels animate.
_PATHS = ("translation", "rotation", "scale", "weights")
# Greater numbers are no index of any list.
_INDEX = r"(0|[1-9]\d{0,8})"
_POINTER = re.compile(rf"/(nodes|meshes)/{_INDEX}/({'|'.join(_PATHS)})(?:/{_INDEX})?")


@dataclass(frozen=True, slots=True)
class Animated:
    """The property that a channel moves.

    Attributes:
        nodes: The nodes that have the property, or that show the mesh that has it.
        path: translation, rotation, scale or weights.
        element: The number of a single weight; None for all, and for other properties.
        mesh: The mesh that has the weights; None if the node has.
    """

    nodes: tuple[int, ...]
    path: str
    element: int | None = None
    mesh: int | None = None


@dataclass(frozen=True)
class Channels:
    """The properties of a document that channels may move."""

    gltf: Json

    def moved(self, channel: Json) -> Animated | None:
        """The property that a channel moves; None if it is none of a node.

        Weights of a mesh move the nodes that show it and have no weights of their own.
        """
        target = channel.get("target", {})
        if target.get("path") != "pointer":
            known = "node" in target and target.get("path") in _PATHS
            return Animated((target["node"],), target["path"]) if known else None
        found = _POINTER.fullmatch(pointer_of(channel) or "")
        if found is None:
            return None
        nodes = self.gltf.get("nodes", [])
        number, element = int(found[2]), None if found[4] is None else int(found[4])
        if found[3] != "weights":
            whole = found[1] == "nodes" and element is None and number < len(nodes)
            return Animated((number,), found[3]) if whole else None
        mesh: Any = number if found[1] == "meshes" else nodes[number].get("mesh") if number < len(nodes) else None
        count = target_count(self.gltf, mesh)
        if not count or (element is not None and element >= count):
            return None
        if found[1] == "nodes":
            return Animated((number,), "weights", element)
        followers = self._followers.get(number)
        return Animated(followers, "weights", element, number) if followers else None

    @cached_property
    def _followers(self) -> dict[int, tuple[int, ...]]:
        """The nodes that show each mesh and have no weights of their own."""
        followers = defaultdict(list)
        for index, node in enumerate(self.gltf.get("nodes", [])):
            if "mesh" in node and "weights" not in node:
                followers[node["mesh"]].append(index)
        return {mesh: tuple(nodes) for mesh, nodes in followers.items()}


def pointer_of(channel: Json) -> str | None:
    """The JSON pointer by which a channel names what it moves, if it has one."""
    extensions = channel.get("target", {}).get("extensions")
    extension = extensions.get(EXTENSION) if isinstance(extensions, dict) else None
    pointer = extension.get("pointer") if isinstance(extension, dict) else None
    return pointer if isinstance(pointer, str) else None


def channels_of(gltf: Json) -> list[tuple[Json, Json]]:
    """All channels that there are now, each behind its animation."""
    return [(animation, each) for animation in gltf.get("animations", []) for each in animation.get("channels", [])]


def target_count(gltf: Json, mesh: int | None) -> int:
    """The number of a mesh's morph targets; 0 if there is no such mesh."""
    meshes = gltf.get("meshes", [])
    if mesh is None or mesh >= len(meshes):
        return 0
    return len((meshes[mesh].get("primitives") or [{}])[0].get("targets", []))


def has_target_names(holder: Json) -> bool:
    """True if the extras of a mesh or a primitive hold names of morph targets."""
    extras = holder.get("extras")
    return isinstance(extras, dict) and isinstance(extras.get("targetNames"), list)


def check_channels(gltf: Json, path: str) -> None:
    """Check that each channel that moves a node has a sampler with input and output; AssetError otherwise."""
    channels = Channels(gltf)
    for index, animation in enumerate(gltf.get("animations", [])):
        samplers = animation.get("samplers", [])
        for number, channel in enumerate(animation.get("channels", [])):
            if channels.moved(channel) is not None:
                which = channel.get("sampler", len(samplers))
                if which >= len(samplers) or not {"input", "output"} <= samplers[which].keys():
                    where = place(path, "animations", index, "channels", number)
                    raise AssetError("has no sampler with input and output", where=where)


def moves_weights(channel: Json, node: int, mesh: int | None = None) -> bool:
    """True if a channel moves weights of a node, or of a mesh, or names a single one of them."""
    target = channel.get("target", {})
    if target.get("path") != "pointer":
        return bool(target.get("node") == node and target.get("path") == "weights")
    places = [f"/nodes/{node}/weights/", *([] if mesh is None else [f"/meshes/{mesh}/weights/"])]
    return f"{pointer_of(channel)}/".startswith(tuple(places))


def without_pointer(target: Json) -> Json:
    """A copy of a channel's target without its pointer."""
    extensions = {key: each for key, each in target.get("extensions", {}).items() if key != EXTENSION}
    kept = {key: each for key, each in target.items() if key != "extensions"}
    return kept | ({"extensions": extensions} if extensions else {})


def drop_channels(animation: Json, gone: Sequence[Json]) -> list[Json]:
    """Remove channels from an animation, and give their samplers that no other channel has, which go too."""
    channels = [channel for channel in animation["channels"] if not any(channel is each for each in gone)]
    used = {channel["sampler"] for channel in channels if "sampler" in channel}
    dropped = {channel["sampler"] for channel in gone} - used
    kept = [index for index in range(len(animation["samplers"])) if index not in dropped]
    left_out = [animation["samplers"][index] for index in sorted(dropped)]
    animation["channels"] = channels
    animation["samplers"] = [animation["samplers"][index] for index in kept]
    for channel in channels:
        if "sampler" in channel:
            channel["sampler"] = kept.index(channel["sampler"])
    return left_out


def forget_pointers(gltf: Json) -> None:
    """Take the extension from the lists of those that are used and required, if no channel has a pointer."""
    if all(pointer_of(channel) is None for _, channel in channels_of(gltf)):
        drop_extensions(gltf, {EXTENSION})
