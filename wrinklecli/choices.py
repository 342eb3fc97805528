"""The words that tools files, manifests and options choose from: each set of words is spelled here alone.

The types are for mypy. The schemas and the command line take the words from them by `typing.get_args`.
"""

from typing import Literal, TypeAlias, get_args

FPS = 30.0
"""Frames per second where nobody asks for others."""

MAX_LEVELS = 8
"""Most times that an edge may be halved: the triangles under wrinkles are 65,536 then for one."""

MAX_COMPRESSIBLE = 95
"""Most per cent of a shortening that tissue may take itself: with all of it there are no wrinkles."""

EFFECTS = {
    "muscles": ("muscle", "tools.body.Muscle"),
    "flesh": ("flesh", "tools.body.Flesh"),
    "touches": ("touch", "tools.body.Touch"),
    "tools": ("wrinkle", "tools.records.WrinkleTool"),
    "fields": ("field", "tools.fields.Field"),
    "folds": ("contact", None),
}
"""The effects in the order in which they act; those before `tools` move the body below the skin.

The key of an effect is that of its lists in tools files, extras and reports. It gives the folder in `effects`, and the
record of an entry of a tools file. Contact has no record, as tools ask for it.
"""

# A tools file.
Up: TypeAlias = Literal["y", "z"]
RestPose: TypeAlias = Literal["stored", "bind"]
LaidPose: TypeAlias = Literal["auto", "stored", "raised"]
Scheme: TypeAlias = Literal["butterfly", "midpoint", "butterfly_full"]
Snap: TypeAlias = Literal["surface", "vertex"]
Axis: TypeAlias = Literal["x", "y", "z"]
MaterialName: TypeAlias = Literal["skin", "cloth", "leather"]
# What a place may be made of: a material, hard parts that get no tools, or nothing of it, for plain tools.
Substance: TypeAlias = Literal[MaterialName, "hard", "none"]
SUBSTANCES: tuple[Substance, ...] = get_args(Substance)
Strategy: TypeAlias = Literal["everywhere", "origin", "both_ends"]
Profile: TypeAlias = Literal["smooth", "skin", "cloth", "polyline"]
PROFILES: dict[Profile, str] = {  # with what its bumps look like
    "smooth": "smooth",
    "skin": "skin, with narrow furrows",
    "cloth": "cloth, which leans",
    "polyline": "polyline, the paper's",
}
Attenuation: TypeAlias = Literal["bell", "linear"]
Attachment: TypeAlias = Literal["skin", "patch"]
Stops: TypeAlias = Literal["features", "none"]
Creases: TypeAlias = Literal["lower", "keep"]
# The groups of the keys of effects, in the order in which one that is drawn is tuned.
Group: TypeAlias = Literal["Shape", "Irregularity", "Motion", "Place"]
GROUPS: tuple[Group, ...] = get_args(Group)
Channel: TypeAlias = Literal["r", "g", "b", "a"]
CHANNELS: tuple[Channel, ...] = get_args(Channel)
"""The channels of an image, and the components of a vertex attribute, in their order."""
# The parts of a body that joints move.
Part: TypeAlias = Literal[
    "hips", "spine", "chest", "neck", "head", "jaw", "eye", "shoulder", "upper arm", "lower arm", "hand", "palm",
    "finger", "upper leg", "lower leg", "foot", "toes", "twist",
]  # fmt: skip
PARTS: tuple[Part, ...] = get_args(Part)

# A bake.
Mode: TypeAlias = Literal["morph", "frames", "weights"]
Engine: TypeAlias = Literal["three", "unity", "unreal", "filament", "cesium", "blender", "godot3", "vtk", "spec8"]
Storage: TypeAlias = Literal["sparse", "based", "dense"]
STORAGES: tuple[Storage, ...] = get_args(Storage)
"""The storage of deltas: sparse where that is smaller; based, sparse upon zeros that are stored once, for readers that
need a buffer view there; or dense, all of them. A reader that cannot take one of them may take one behind it."""
Tracks: TypeAlias = Literal["all", "none"]
FrameFormat: TypeAlias = Literal["obj", "ply", "glb"]
MapKind = Literal["normal", "height", "ao"]
MOST_TEXELS = 8192
"""The most texels of a side of a map, samples included: common graphics cards take at most 16,384."""
DIFF_LINES = 10
"""Lines of each kind of difference that `diff` and failed tests show."""
CACHE = ".wrinkle-cache"
"""The folder in which `batch` keeps outputs, beside the manifest."""
