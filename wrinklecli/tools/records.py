"""What a file of wrinkling tools says, as frozen records: lengths, anchors, tools, and the settings of a bake.

`read` makes them. `configs/README.md` is the reference of the keys.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

from wrinklecli.choices import Attachment, Attenuation, MaterialName, Profile, RestPose, Scheme, Snap, Strategy, Up

Position: TypeAlias = tuple[float, float, float]

# New vertices of a mesh at most, unless an option allows more: ten times a real-time character. No key of the file.
MAX_VERTICES = 200_000


@dataclass(frozen=True, slots=True)
class Length:
    """A length in scene units, or per cent of the tool's own rest distance.

    Args:
        value: Scene units, or 80.0 for `80%`.
        percent: Whether `value` is a percentage.
    """

    value: float
    percent: bool = False

    def resolve(self, rest_distance: float) -> float:
        """Scene units, given the distance of the tool's anchors at rest in scene units."""
        return self.value / 100.0 * rest_distance if self.percent else self.value


def parse_length(value: float | str) -> Length:
    """A length as people write it: 0.02, `0.02` or `80%`.

    Raises:
        ValueError: It is no finite length above 0.
    """
    percent = isinstance(value, str) and value.endswith("%")
    found = float(value.removesuffix("%") if isinstance(value, str) else value)
    if not 0 < found < math.inf:
        raise ValueError(f"{value!r} is no length above 0")
    return Length(found, percent=percent)


@dataclass(frozen=True, slots=True)
class Marker:
    """An anchor given by the position of a node of the asset, such as an exported empty.

    Args:
        marker: Node whose position at rest is the anchor.
    """

    marker: str


@dataclass(frozen=True, slots=True)
class RestFrame:
    """A clip's pose at a time, taken as the rest pose.

    Args:
        clip: Name of the clip.
        time: Seconds from its start.
    """

    clip: str
    time: float = 0.0


@dataclass(frozen=True, slots=True)
class Sampling:
    """At which times which clips are evaluated.

    Args:
        fps: Samples per second, joined with the clip's own key times.
        clips: Names of the clips to bake, or `all`.
    """

    fps: float = 30.0
    clips: Literal["all"] | tuple[str, ...] = "all"


@dataclass(frozen=True, slots=True)
class RefinementSettings:
    """How finely the mesh is subdivided under the wrinkles.

    Args:
        max_levels: Most times that an edge is halved; 0 keeps the mesh.
        edges_per_interval: Edges on each control interval, half a bump; a whole number but in a draft.
        scheme: How new vertices are placed: rounding the surface a little, not at all, or as Zorin's scheme does.
    """

    max_levels: int = 4
    edges_per_interval: float = 2
    scheme: Scheme = "butterfly"


@dataclass(frozen=True, slots=True)
class RestLengthKeys:
    """Rest lengths keyed by hand, the paper's forehead; clips that are not named keep the rest distance.

    Args:
        keys: For each clip its keys: seconds, rising, and the length then.
    """

    keys: Mapping[str, tuple[tuple[float, Length], ...]] = field(hash=False)


@dataclass(frozen=True, slots=True)
class RestLengthMorph:
    """A rest length driven by a morph target's weight: the rest distance at 0, `full` at 1.

    Args:
        morph: Name of the morph target.
        full: Rest length at weight 1.
    """

    morph: str
    full: Length


@dataclass(frozen=True, slots=True)
class Lag:
    """How heights follow the shortening late: a damped spring.

    Args:
        frequency: Swings per second, were it not damped.
        damping: Share of the damping from which on it does not overshoot.
    """

    frequency: float = 6.0
    damping: float = 0.5


@dataclass(frozen=True, slots=True)
class Contact:
    """How folds that touch are kept from crossing.

    Args:
        per_clip: Whether a clip that still crosses with the targets of all clips gets targets of its own.
        ignore: Nodes whose meshes may go through the tool's.
    """

    per_clip: bool = False
    ignore: tuple[str, ...] = ()


def in_axes(position: Sequence[float], up: str) -> tuple[float, float, float]:
    """A Y-up position with the axes of a tools file."""
    x, y, z = position
    return (x, y, z) if up == "y" else (x, 0.0 - z, y)


def identifier(name: str) -> str:
    """A tool's name in letters, digits and `_`."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name)


@dataclass(frozen=True, slots=True, kw_only=True)
class WrinkleTool:
    """One wrinkling tool, defaults, material and mirror applied.

    Args:
        name: Unique name.
        node: Node of the mesh, None where the file leaves it out.
        origin: World space at rest, Y-up, scene units; or a marker.
        target: As origin.
        between: Points of its path between these two; none for a straight tool.
        snap: What anchors go to.
        width: Full width across the segment.
        material: What gave it the values that the file does not say; None for none.
        strategy: Which bumps rise first.
        bumps: Wrinkles along the segment.
        gap: Flat control intervals between neighbouring bumps.
        max_height: Highest point of a bump; `auto`; or None for no limit.
        compressible: Share of every shortening that the tissue takes itself, from 0 to 0.95.
        details: Shares of the shortening for finer wrinkles, each > 0, their sum < 1.
        profile: Shape of a bump.
        bow: By how much crests are bent like an arc, from -1 to 1.
        variation: How irregular the bumps are, from 0, ruled, to 1.
        seed: What their irregularity is drawn from; None for the name.
        branch: Chance of a bump to merge with its neighbour on a side of the patch.
        attenuation: How a wrinkle fades across the width.
        attachment: `skin`, or the paper's `patch`.
        strength: Factor of the height.
        clips: Strength by clip name, in place of `strength`.
        rest_length: `auto`, a length, or what drives it.
        lag: How heights follow the shortening late; None where they follow at once.
        contact: How folds that touch are kept from crossing; None where they are not.
        enabled: Whether it is baked; a `ToolsFile` keeps only those.
        optional: Whether an absent node is a note rather than an error.
        mirrored: Whether `mirror` made it.
        where: Its place in the file for later errors, such as `tools.yaml:12: tools[0]`.
        places: Those of what the file says of it, by keys, such as those of `rest_length.morph`; see `place`.
    """

    name: str
    node: str | None = None
    origin: Position | Marker
    target: Position | Marker
    between: tuple[Position | Marker, ...] = ()
    snap: Snap = "surface"
    width: Length
    material: MaterialName | None = None
    strategy: Strategy = "everywhere"
    bumps: int = 4
    gap: int = 0
    max_height: Literal["auto"] | Length | None = "auto"
    compressible: float = 0.0
    details: tuple[float, ...] = ()
    profile: Profile = "smooth"
    bow: float = 0.0
    variation: float = 0.3
    seed: int | None = None
    branch: float = 0.25
    attenuation: Attenuation = "bell"
    attachment: Attachment = "skin"
    strength: float = 1.0
    clips: Mapping[str, float] = field(default_factory=dict, hash=False)
    rest_length: Literal["auto"] | Length | RestLengthKeys | RestLengthMorph = "auto"
    lag: Lag | None = None
    contact: Contact | None = None
    enabled: bool = True
    optional: bool = False
    mirrored: bool = False
    where: str = ""
    places: Mapping[tuple[str, ...], str] = field(default_factory=dict, hash=False, compare=False)

    def place(self, *keys: str) -> str:
        """The place of what the file says of it, for later errors, such as `tools.yaml:14: tools[0].node`."""
        return self.places.get(keys, self.where)

    @property
    def points(self) -> tuple[Position | Marker, ...]:
        """From origin to target."""
        return (self.origin, *self.between, self.target)

    def point_name(self, number: int) -> str:
        """What messages call one of the points."""
        return f"path[{number}]" if self.between else ("origin", "target")[number]

    def place_of(self, number: int, *keys: str) -> str:
        """The place of one of the points in the file, whichever way it is given there."""
        given = ("path", str(number)) if ("path",) in self.places or self.between else (("origin", "target")[number],)
        return self.place(*given, *keys)

    @property
    def identifier(self) -> str:
        """The name in letters, digits and `_`, as in the morph targets `wrinkle_IDENTIFIER_1`; unique too."""
        return identifier(self.name)

    def strength_in(self, clip: str) -> float:
        """The factor of the height while a clip plays."""
        return self.clips.get(clip, self.strength)


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolsFile:
    """A file of tools.

    Args:
        path: The file as the user typed it.
        version: Version of the format.
        up: The up axis of the file; positions here are Y-up already.
        rest: Pose in which the tools are attached.
        sampling: At which times which clips are evaluated.
        refinement: How finely the mesh is subdivided.
        tools: The enabled tools in the file's order, a mirrored one behind its source.
        places: Of what stands beside the tools, by keys, such as those of `rest.clip`, for later errors.
        beside: Further files that this one is merged with.
    """

    path: str
    version: int = 1
    up: Up = "y"
    rest: RestPose | RestFrame = "stored"
    sampling: Sampling = field(default_factory=Sampling)
    refinement: RefinementSettings = field(default_factory=RefinementSettings)
    tools: tuple[WrinkleTool, ...]
    places: Mapping[tuple[str, ...], str] = field(default_factory=dict, hash=False, compare=False)
    beside: tuple[str, ...] = ()

    def place(self, *keys: str) -> str:
        """The place of what stands beside the tools, for later errors, such as `tools.yaml:4: rest.clip`."""
        return self.places.get(keys, self.path)
