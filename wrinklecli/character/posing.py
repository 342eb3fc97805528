"""Makes a pose of named joints turned by degrees about their own axes, and of named morph targets with weights."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrinklecli.character.anims import NamedNodes
from wrinklecli.character.clip import Channel, Clip
from wrinklecli.character.joined import with_clips, with_free_nodes
from wrinklecli.character.motion import raising, turned_axis, turning
from wrinklecli.character.rig import LARGEST, Rig, read_hierarchy, read_rig
from wrinklecli.errors import AssetError, unknown
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, unit_quaternions

JointTurn = tuple[str, str, float]
"""A joint's name, its own axis x, y or z, and degrees."""
MorphWeight = tuple[str, float]
"""A morph target's name, in all meshes that have it, and its weight."""


def with_pose(document: Document, turns: Sequence[JointTurn], weights: Sequence[MorphWeight]) -> Document:
    """Add a pose to a document as a clip of one key.

    Turns start at the stored pose; several turns of a joint follow one another. Other morph targets stay as stored.

    Raises:
        AssetError: There is no joint or morph target of a name, or a joint is stored as a matrix that shears.
        ValueError: An axis is unknown, or a number is not finite or out of range.
    """
    document = with_free_nodes(document, [_joint(document, name) for name, _, _ in turns])
    return with_clips(document, [pose_clip(document, turns, weights)])


def joints_alike(document: Document, turns: Sequence[JointTurn]) -> dict[str, str]:
    """The names of the joints that turn and are only alike without prefixes, by the names that the turns have."""
    return _named(document).alike(name for name, _, _ in turns)


def pose_clip(document: Document, turns: Sequence[JointTurn], weights: Sequence[MorphWeight]) -> Clip:
    """Make the clip that `with_pose` adds, but turn no joint that is stored as a matrix."""
    if any(axis not in ("x", "y", "z") for _, axis, _ in turns):
        raise ValueError("axes of joints are x, y and z")
    if not all(abs(number) <= LARGEST for number in [*(each[2] for each in turns), *(each[1] for each in weights)]):
        raise ValueError(f"degrees and weights are numbers up to {LARGEST:g}")
    channels = [*_turned(document, turns), *_raised(document, dict(weights))]
    words = [*(f"{name}={axis}:{degrees:g}" for name, axis, degrees in turns), *(f"{n}={w:g}" for n, w in weights)]
    return Clip(-1, " ".join(words), tuple(channels), 0.0, 0.0)


def posable(document: Document) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of all joints that `pose_clip` can turn, and of all morph targets."""
    stored = read_hierarchy(document).locals
    named = _named(document)
    joints = [name for name in _joint_names(named) if "rotation" in stored[named.joints[name]]]
    morphs = dict.fromkeys(name for rig in _rigs(document) for name in rig.morph_names)
    return tuple(joints), tuple(morphs)


def _joint(document: Document, name: str) -> int:
    """The joint of a name, or any other node of the name if there is no such joint."""
    named = _named(document)
    found = named.joint(name)
    if found is None:
        known = _joint_names(named)
        raise AssetError(unknown("has no joint", name, known), where=document.path)
    return found


def _named(document: Document) -> NamedNodes:
    """The nodes by name, the joints of all skins first."""
    joints = [joint for skin in document.items("skins") for joint in skin.get("joints", [])]
    return NamedNodes.of(document.items("nodes"), [joints])


def _joint_names(named: NamedNodes) -> list[str]:
    """The names of the joints of all skins."""
    return list(
        dict.fromkeys(named.nodes[joint]["name"] for joint in named.groups[0] if named.nodes[joint].get("name"))
    )


def _rigs(document: Document) -> list[Rig]:
    """The rigs of all meshes."""
    hierarchy = read_hierarchy(document)
    return [read_rig(document, node, hierarchy) for node, each in enumerate(document.items("nodes")) if "mesh" in each]


def _turned(document: Document, turns: Sequence[JointTurn]) -> list[Channel]:
    """Make the channels of joints that turn."""
    hierarchy = read_hierarchy(document)
    rotations: dict[int, Floats] = {}
    for name, axis, degrees in turns:
        node = _joint(document, name)
        if "rotation" not in hierarchy.locals[node]:
            where = document.where("nodes", node)
            raise AssetError(f"{name!r} cannot turn: it is stored as a matrix that shears", where=where)
        stored = rotations.get(node, unit_quaternions(hierarchy.locals[node]["rotation"]))
        about = turned_axis(stored, np.eye(3)["xyz".index(axis)])
        rotations[node] = turning(node, stored, about, np.radians(degrees), np.ones(1)).values[0]
    return [Channel(0, node, "rotation", np.zeros(1), value[None], "LINEAR") for node, value in rotations.items()]


def _raised(document: Document, weights: Mapping[str, float]) -> list[Channel]:
    """Make the channels of all meshes that have one of the morph targets."""
    rigs = _rigs(document)
    known = dict.fromkeys(name for rig in rigs for name in rig.morph_names)
    AssetError.unless_known("has no morph target", weights, known, where=document.path)
    channels = []
    for rig in rigs:
        numbers = {number: weights[name] for number, name in enumerate(rig.morph_names) if name in weights}
        if numbers:
            values = raising(rig, numbers, np.ones(1)).values
            channels.append(Channel(0, rig.node, "weights", np.zeros(1), values, "LINEAR"))
    return channels
