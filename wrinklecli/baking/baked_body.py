"""A baked body as its extras describe it: nodes, their tools by the names of joints, and tables of weights.

Source: the extras that `extras.encode_extras` writes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.baking.parts import PARTS
from wrinklecli.character.rig import read_rig
from wrinklecli.effects.wrinkle.lookup import CurveTable
from wrinklecli.errors import AssetError, listed
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, affine_rows, unit_quaternions
from wrinklecli.tools.records import Lag

# Of a control curve: 64 bumps with gaps of 64, the most of a tools file, have 4,160.
_MOST_INTERVALS = 10_000
# Swings per second and damping of a spring, more than a tools file may ask for.
_FASTEST = 1_000.0


@dataclass(frozen=True, slots=True)
class BakedAnchor:
    """One anchor: a point in the space of each of its joints.

    Attributes:
        joints: Their names.
        weights: (joints,) summing to 1.
        positions: (joints, 3).
        scales: (joints,) of the joints at rest.
        morphs: (joints, 3) by which a morph target moves the positions.
    """

    joints: tuple[str, ...]
    weights: Floats
    positions: Floats
    scales: Floats
    morphs: dict[str, Floats]


@dataclass(frozen=True, slots=True)
class BakedTool:
    """A tool as the extras have it.

    Attributes:
        name: Of the tool.
        anchors: From origin to target, two or more.
        rest_length: Scene units.
        morph: The morph target that drives the rest length, and the length at weight 1.
        keys: By clip, (keys, 2) seconds and rest lengths.
        lag: How the heights lag; None where they do not.
        strengths: By clip, factors on the weights.
        targets: Names of its morph targets.
        rows: (rows,) 1 - distance / rest length, rising; none where there is a curve.
        table: (rows, targets) weights.
        curve: In place of these, where the rest length changes.
    """

    name: str
    anchors: tuple[BakedAnchor, ...]
    rest_length: float
    morph: tuple[str, float] | None
    keys: dict[str, Floats]
    lag: Lag | None
    strengths: dict[str, float]
    targets: tuple[str, ...]
    rows: Floats
    table: Floats
    curve: CurveTable | None

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of all joints of its anchors."""
        return tuple(dict.fromkeys(joint for anchor in self.anchors for joint in anchor.joints))


@dataclass(frozen=True, slots=True)
class BakedFold:
    """A fold whose contact is resolved, as the extras have it.

    Attributes:
        joint: Name of the joint that bends it.
        parent: Name of the node above; none for a root.
        rest: (3, 3) the joint's stored turn against the parent.
        axis: (3,) that it turns about, in the parent's space.
        targets: Names of its morph targets.
        own: Names of those that act in a clip alone, in place of these.
        angles: (rows,) radians, rising.
        table: (rows, targets) weights.
    """

    joint: str
    parent: str | None
    rest: Floats
    axis: Floats
    targets: tuple[str, ...]
    own: tuple[str, ...]
    angles: Floats
    table: Floats

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of the nodes that tell its angle."""
        return (self.joint,) if self.parent is None else (self.joint, self.parent)


@dataclass(frozen=True, slots=True)
class BakedPart:
    """A node whose mesh has morph targets of a body.

    Attributes:
        node: Its name.
        mesh: Of its mesh; none where it has no name.
        primitives: How many the mesh has.
        targets: The names of its morph targets.
        stored: (targets,) weights in the stored pose.
    """

    node: str
    mesh: str | None
    primitives: int
    targets: tuple[str, ...]
    stored: Floats


@dataclass(frozen=True, slots=True)
class BakedBody:
    """A node that carries wrinkles, with the other nodes among which its mesh was split.

    Attributes:
        parts: The node itself, whose mesh has all of the asset's own morph targets, and the others.
        tools: Those that the extras can drive, and folds that no joint bends, which follow a tool's segment too.
        folds: Those whose contact is resolved.
        undriven: Names of further morph targets of wrinkles, which no extras can drive.
        ambiguous: Whether a scene or another node has the node's name too.
        draft: Whether it is of a bake that was one.
    """

    parts: tuple[BakedPart, ...]
    tools: tuple[BakedTool, ...]
    folds: tuple[BakedFold, ...]
    undriven: frozenset[str]
    ambiguous: bool
    draft: bool

    @property
    def node(self) -> str:
        """Name of the node itself."""
        return self.parts[0].node

    @property
    def targets(self) -> tuple[str, ...]:
        """Names of the morph targets of the node itself."""
        return self.parts[0].targets

    def stored(self, names: Sequence[str]) -> Floats:
        """(names,) weights of some morph targets in the stored pose."""
        weights = {name: each for part in self.parts for name, each in zip(part.targets, part.stored, strict=True)}
        return np.array([weights[name] for name in names])

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the morph targets of its tools and folds, in order."""
        of_each = [*(tool.targets for tool in self.tools), *(fold.targets for fold in self.folds)]
        return tuple(name for targets in of_each for name in targets)

    @property
    def kept(self) -> tuple[str, ...]:
        """Names of the node's own morph targets that are not driven."""
        return tuple(name for name in self.targets if name not in self.driven)

    @property
    def original(self) -> tuple[str, ...]:
        """Names of those that the asset had before it was baked, all of which are the node's own."""
        return tuple(name for name in self.kept if name not in self.undriven)


def read_bodies(document: Document) -> list[BakedBody]:
    """The nodes that carry wrinkles.

    Raises:
        AssetError: There are none, or what they carry is not what `bake` writes.
    """
    bodies = []
    for index, node in enumerate(document.items("nodes")):
        extras = node.get("extras")
        if not isinstance(extras, dict) or "wrinkle" not in extras or "mesh" not in node:
            continue
        where = document.where("nodes", index, "extras", "wrinkle")
        if not node.get("name"):
            raise AssetError("tracks find their mesh by the node's name, and it has none", where=where)
        try:
            parts = tuple(_read_part(document, each) for each in (index, *part_nodes(document, index)))
            stored = extras["wrinkle"].get("folds", ())
            # A fold that no joint bends is driven as a tool.
            driven_alike = [*extras["wrinkle"]["tools"], *(fold for fold in stored if "joint" not in fold)]
            tools = tuple(_read_tool(tool) for tool in driven_alike if tool["targets"])
            folds = tuple(_read_fold(fold) for fold in stored if "joint" in fold and fold["targets"])
            undriven = frozenset(str(name) for name in extras["wrinkle"].get("undriven", ()))
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise AssetError("is not what `wrinkle bake` writes", where=where) from error
        driven = [*(tool.targets for tool in tools), *(fold.targets for fold in folds)]
        there = {name for part in parts for name in part.targets}
        gone = [name for each in driven for name in each if name not in there]
        if gone:
            raise AssetError(f"the mesh has lost its morph targets {listed(gone)}", where=where)
        bodies.append(
            BakedBody(
                parts=parts,
                tools=tools,
                folds=folds,
                undriven=undriven,
                ambiguous=any(count_named(document, part.node) > 1 for part in parts),
                draft=extras["wrinkle"].get("draft") is True,
            )
        )
    if not any(body.tools for body in bodies):
        raise AssetError("carries no wrinkles of `wrinkle bake` that anchors drive", where=document.path)
    return bodies


def part_nodes(document: Document, node: int) -> list[int]:
    """The other nodes among which a baked node's mesh was split.

    Raises:
        KeyError: One is not there, or others: the extras are not what `bake` writes.
    """
    nodes = document.items("nodes")
    names = {each.get("name"): index for index, each in enumerate(nodes) if "mesh" in each}
    return [names[name] for name in nodes[node]["extras"]["wrinkle"].get(PARTS, ())]


def wrinkle_targets(document: Document) -> dict[int, frozenset[str]]:
    """For each node the names of the morph targets that a bake has added; none where no extras say so."""
    nodes = document.items("nodes")
    found = {index: _wrinkle_targets(node) for index, node in enumerate(nodes)}
    return found | {part: found[part] | found[body] for part, body in bodies_of_parts(document).items()}


def bodies_of_parts(document: Document) -> dict[int, int]:
    """For each node with a part of a split mesh, but the one that carries the extras, that one."""
    found: dict[int, int] = {}
    for index, node in enumerate(document.items("nodes")):
        try:
            found |= dict.fromkeys(part_nodes(document, index) if _wrinkle_targets(node) else (), index)
        except (KeyError, TypeError, AttributeError):
            continue
    return found


def _read_part(document: Document, node: int) -> BakedPart:
    rig = read_rig(document, node)
    mesh = document.items("meshes")[rig.mesh]
    name = mesh.get("name")
    return BakedPart(
        node=document.items("nodes")[node]["name"],
        mesh=name if isinstance(name, str) else None,
        primitives=len(mesh["primitives"]),
        targets=rig.morph_names,
        stored=rig.morph_weights,
    )


def _wrinkle_targets(node: Json) -> frozenset[str]:
    extras = node.get("extras")
    try:
        entry = extras["wrinkle"] if isinstance(extras, dict) else {}
        driven = [*entry["tools"], *entry.get("folds", ())]
        return frozenset({name for each in driven for name in each["targets"]} | set(entry.get("undriven", ())))
    except (KeyError, TypeError, AttributeError):
        return frozenset()  # not what a bake writes: nothing is known of wrinkles


def anchors_of(tool: Json) -> list[Json]:
    """The anchors of a tool in extras, from origin to target.

    Raises:
        KeyError: They are not there.
    """
    return list(tool["anchors"]) if "anchors" in tool else [tool["origin"], tool["target"]]


def _read_tool(data: Json) -> BakedTool:
    targets = tuple(str(name) for name in data["targets"])
    anchors = tuple(map(_read_anchor, anchors_of(data)))
    if len(anchors) < 2:
        raise ValueError
    morph = data.get("rest_length_morph")
    curve = _read_curve(data["curve"], len(targets)) if "curve" in data else None
    rows, table = np.zeros(0), np.zeros((0, len(targets)))
    if curve is None:
        rows = _rising(data["shortenings"])
        table = np.array(data["weights"], np.float64).reshape(len(rows), len(targets))
    keys = {clip: np.array(each, np.float64).reshape(-1, 2) for clip, each in data.get("rest_length_keys", {}).items()}
    if any(not len(each) or not (np.diff(each[:, 0]) > 0).all() for each in keys.values()):
        raise ValueError
    lengths = [
        data["rest_length"],
        *([morph["full"]] if morph else []),
        *(x for each in keys.values() for x in each[:, 1]),
    ]
    if not all(float(length) > 0 for length in lengths):
        raise ValueError
    return BakedTool(
        name=str(data["name"]),
        anchors=anchors,
        rest_length=float(data["rest_length"]),
        morph=None if morph is None else (str(morph["name"]), float(morph["full"])),
        keys=keys,
        lag=_read_lag(data["lag"]) if "lag" in data else None,
        strengths={clip: float(factor) for clip, factor in data.get("strengths", {}).items()},
        targets=targets,
        rows=rows,
        table=table,
        curve=curve,
    )


def _read_fold(data: Json) -> BakedFold:
    targets, angles = tuple(str(name) for name in data["targets"]), _rising(data["angles"])
    parent = data.get("parent")
    rest, axis = (np.array(data[key], np.float64).reshape(size) for key, size in (("rest", 4), ("axis", 3)))
    if not rest.any():
        raise ValueError
    turn = affine_rows(np.zeros((3, 1)), unit_quaternions(rest)[:, None], np.ones((3, 1)))[:, :3, 0]
    return BakedFold(
        joint=str(data["joint"]),
        parent=None if parent is None else str(parent),
        rest=turn,
        axis=axis,
        targets=targets,
        own=tuple(str(name) for name in data.get("own", ())),
        angles=angles,
        table=np.array(data["weights"], np.float64).reshape(len(angles), len(targets)),
    )


def _read_lag(data: Json) -> Lag:
    lag = Lag(float(data["frequency"]), float(data["damping"]))
    if not (0 < lag.frequency < _FASTEST and 0 < lag.damping < _FASTEST):
        raise ValueError
    return lag


def _read_curve(data: Json, targets: int) -> CurveTable:
    bumps = tuple(float(count) for count in data["bumps"])
    distances = _rising(data["distances"]) if "distances" in data else np.zeros(0)
    parts = _rising(data["parts"])
    rises = np.array(data["rises"], np.float64).reshape(len(parts), -1)
    intervals = int(data["intervals"])
    if intervals < 1 or min(bumps) <= 0 or max(intervals, *bumps) > _MOST_INTERVALS:
        raise ValueError
    return CurveTable(
        taut=float(data["taut"]),
        compressible=float(data.get("compressible", 0.0)),
        intervals=intervals,
        bumps=bumps,
        distances=distances,
        capacities=np.array(data.get("capacities", []), np.float64).reshape(len(distances)),
        parts=parts,
        rises=rises,
        mix=np.array(data["mix"], np.float64).reshape(targets, len(bumps) * rises.shape[1]),
        positive=bool(data.get("positive", False)),
        least=float(data.get("least", 0.0)),
    )


def _rising(values: object) -> Floats:
    """(rows,) of a table.

    Raises:
        ValueError: There are none, or they do not rise.
    """
    rows = np.array(values, np.float64)
    if rows.ndim != 1 or not len(rows) or not (np.diff(rows) > 0).all():
        raise ValueError
    return rows


def _read_anchor(data: Json) -> BakedAnchor:
    count = len(data["joints"])
    scales = np.array(data["scales"], np.float64).reshape(count)
    if not (scales > 0).all():
        raise ValueError
    return BakedAnchor(
        joints=tuple(str(joint) for joint in data["joints"]),
        weights=np.array(data["weights"], np.float64).reshape(count),
        positions=np.array(data["positions"], np.float64).reshape(count, 3),
        scales=scales,
        morphs={name: np.array(moves, np.float64).reshape(count, 3) for name, moves in data.get("morphs", {}).items()},
    )


def count_named(document: Document, name: str) -> int:
    """How many nodes and scenes have a name."""
    return sum(each.get("name") == name for kind in ("nodes", "scenes") for each in document.items(kind))
