"""Weight tracks for clips that lie in other files: the body with its wrinkles in one, each clip in another.

What a bake writes into a node's extras is enough: anchors by the names of joints, and a table of weights.

Source: the extras of `extras.encode_extras`. Differs from a bake: weights are straight between the rows of a table,
right to 1/256 of the greatest.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.baking.job import refuse_overwriting
from wrinklecli.baking.morphs import encode_track, own_mesh
from wrinklecli.character.clip import Clip, clip_grid, read_clips
from wrinklecli.character.pose import LEAST_SCALE, morph_weights, node_matrices
from wrinklecli.character.rig import Rig, morph_target_names, moving_nodes, read_rig
from wrinklecli.character.weight_track import Track, pad, widen
from wrinklecli.errors import AssetError, BakeError, RefusedError, listed, nearest
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.edit import EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.gltf.writer import write
from wrinklecli.method.lookup import TABLE_ERROR, CurveTable
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import guarded
from wrinklecli.numeric.piecewise import Signal, key_times

# Of what the error bound leaves beside the table's own error, the part of the samples and that of dropped keys.
_SAMPLING_SHARE = 2 / 3
_KEYS_SHARE = 1 / 3
# Of a control curve: 64 bumps with gaps of 64, the most of a tools file, have 4,160.
_MOST_INTERVALS = 10_000


@dataclass(frozen=True, slots=True)
class Tracked:
    """What was made of one file.

    Attributes:
        path: The file written.
        clips: Names of the clips that got weights.
        tools: A line for each tool: its name, node and targets.
        warnings: A line each.
    """

    path: str
    clips: tuple[str, ...]
    tools: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Pace:
    """How close keys are.

    Attributes:
        fps: Frames per second of the grid.
        tolerance: Greatest error of a weight between keys, a share of the greatest weight.
    """

    fps: float
    tolerance: float


@dataclass(frozen=True, slots=True)
class _End:
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
class _Tool:
    """A tool as the extras have it.

    Attributes:
        name: Of the tool.
        ends: Origin and target.
        rest_length: Scene units.
        morph: The morph target that drives the rest length, and the length at weight 1.
        keys: By clip, (keys, 2) seconds and rest lengths.
        strengths: By clip, factors on the weights.
        targets: Names of its morph targets.
        rows: (rows,) 1 - distance / rest length, rising; none where there is a curve.
        table: (rows, targets) weights.
        curve: In place of these, where the rest length changes.
    """

    name: str
    ends: tuple[_End, _End]
    rest_length: float
    morph: tuple[str, float] | None
    keys: dict[str, Floats]
    strengths: dict[str, float]
    targets: tuple[str, ...]
    rows: Floats
    table: Floats
    curve: CurveTable | None

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of all joints of both anchors."""
        return tuple(dict.fromkeys(self.ends[0].joints + self.ends[1].joints))


@dataclass(frozen=True, slots=True)
class _Body:
    """A node that carries wrinkles.

    Attributes:
        node: Its name.
        mesh: Of its mesh; none where it has no name.
        primitives: How many the mesh has.
        targets: The names of all morph targets.
        stored: (targets,) weights in the stored pose.
        tools: Those that the extras can drive.
        ambiguous: Whether a scene or another node has the node's name too.
    """

    node: str
    mesh: str | None
    primitives: int
    targets: tuple[str, ...]
    stored: Floats
    tools: tuple[_Tool, ...]
    ambiguous: bool

    @property
    def own(self) -> tuple[str, ...]:
        """Names of the morph targets that are not driven."""
        driven = {name for tool in self.tools for name in tool.targets}
        return tuple(name for name in self.targets if name not in driven)


def track(
    baked: str | os.PathLike[str],
    anims: Sequence[str | os.PathLike[str]],
    folder: str | os.PathLike[str],
    *,
    fps: float = 30.0,
    max_error: float = 0.01,
    allow_external: bool = False,
    strict: bool = False,
) -> list[Tracked]:
    """Add weight tracks for a baked body to the clips of other files, which share its joints by name.

    Each file is written into the folder under its own name. Where it has a mesh on a node of the body's name, with
    the body's targets or with those that the body had before, that mesh gets the tracks (and targets that do
    nothing); otherwise a stub of the same names, three vertices in one point, takes its place in players that bind
    tracks by name.

    Args:
        baked: A file that `bake` has written.
        anims: Files with clips.
        folder: Where to write; made where it is missing.
        fps: Frames per second of the grid, which is refined where weights bend.
        max_error: Greatest error of a weight, a share of the greatest: above 1/256, which is the table's own.
        allow_external: Read buffers and images outside the files' folders too.
        strict: Refuse where there are warnings.

    Returns:
        What was made of each file, in order.

    Raises:
        RefusedError: There are warnings, if `strict`; nothing was written.
        ValueError: `max_error` is not above 1/256.
        AssetError: A file is malformed, the body carries no wrinkles, or no joint of any anchor is in an ANIM.
        BakeError: An output would overwrite an input, or cannot be written. All are computed before any is written.
    """
    if not max_error > TABLE_ERROR:
        raise ValueError(f"max_error is {max_error}; the table of weights is right to 1/256")
    pace = _Pace(fps, max_error - TABLE_ERROR)
    body_file = read_document(baked, allow_external=allow_external)
    bodies = _read_bodies(body_file)
    outputs = [os.path.join(os.fspath(folder), os.path.basename(os.fspath(path))) for path in anims]
    for number, path in enumerate(outputs):
        if path in outputs[:number]:
            raise BakeError("is the output of two inputs of one name", where=path)
    drafts, inputs, results = [], list(body_file.files), []
    for anim, output in zip(anims, outputs, strict=True):
        document = read_document(anim, allow_external=allow_external)
        inputs += document.files
        draft = EditedDocument(document)
        with guarded(document.path):
            results.append(_track_file(draft, bodies, pace, output))
        drafts.append(draft)
    warnings = [line for result in results for line in result.warnings]
    if strict and warnings:
        raise RefusedError.of_all(RefusedError(line) for line in warnings)
    refuse_overwriting(inputs, outputs)
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise BakeError(f"cannot be made: {error.strerror or error}", where=os.fspath(folder)) from error
    for draft, output in zip(drafts, outputs, strict=True):
        write(draft, output)
    return results


def _track_file(draft: EditedDocument, bodies: Sequence[_Body], pace: _Pace, output: str) -> Tracked:
    """Add the tracks of all bodies."""
    document = draft.source
    clips = read_clips(document)
    nodes = document.items("nodes")
    names = [str(node.get("name", "")) for node in nodes]
    warnings: list[str] = []
    tracked: dict[str, None] = {}
    for body in bodies:
        if body.ambiguous or _count_named(document, body.node) > int(body.node in names):
            warnings.append(
                f"{document.path}: a scene or another node is named {body.node!r} too, here or in the body's file:"
                " three.js renames all but the first, and tracks then miss the body"
            )
    found = [(body, _matching(body, nodes, document.path, warnings)) for body in bodies]
    if not any(tools for _, tools in found):
        wanted = dict.fromkeys(joint for body in bodies for tool in body.tools for joint in tool.joints)
        raise AssetError(
            f"has no tool's joints; the anchors are on {listed(wanted)}, its nodes are {listed(names[:12])}"
            f"{' …' if len(names) > 12 else ''}",
            where=document.path,
        )
    if not clips:
        warnings.append(f"{document.path}: has no clip")
    for body, tools in found:
        if tools:
            tracked |= dict.fromkeys(_track_body(draft, body, tools, clips, pace, warnings))
    lines = (
        f"{tool.name} on {body.node}: targets {', '.join(tool.targets)}" for body, tools in found for tool in tools
    )
    return Tracked(output, tuple(tracked), tuple(lines), tuple(warnings))


def _count_named(document: Document, name: str) -> int:
    """How many nodes and scenes have a name."""
    return sum(each.get("name") == name for kind in ("nodes", "scenes") for each in document.items(kind))


def _joint(nodes: Sequence[Json], name: str) -> int:
    """The node of a name; among several the first without a mesh, as bodies are often named like a joint."""
    found = [index for index, node in enumerate(nodes) if node.get("name") == name]
    return next((index for index in found if "mesh" not in nodes[index]), found[0])


def _matching(body: _Body, nodes: Sequence[Json], where: str, warnings: list[str]) -> list[_Tool]:
    """The tools whose joints are all there."""
    names = [str(node.get("name", "")) for node in nodes]
    bare = [str(node.get("name", "")) for node in nodes if "mesh" not in node]
    matching = []
    for tool in body.tools:
        missing = [joint for joint in tool.joints if joint not in names]
        if missing:
            hint = nearest(missing[0], names) if len(missing) == 1 else ""
            warnings.append(f"{where}: {tool.name}: left out, as there is no joint {listed(missing)}{hint}")
            continue
        several = [joint for joint in tool.joints if bare.count(joint) > 1]
        if several:
            warnings.append(f"{where}: {tool.name}: several nodes are named {listed(several)}; the first is taken")
        matching.append(tool)
    return matching


def _track_body(
    draft: EditedDocument, body: _Body, tools: Sequence[_Tool], clips: Sequence[Clip], pace: _Pace, warnings: list[str]
) -> list[str]:
    """Add one body's tracks; the names of clips that got some."""
    node = _carrier(draft, body)
    whole = read_rig(draft.document(), node)
    own = [body.targets.index(name) for name in body.own]
    joints = {joint: _joint(draft.gltf["nodes"], joint) for tool in tools for joint in tool.joints}
    rig = replace(
        whole,
        joints=np.array(list(joints.values()), np.intp),
        inverse_binds=np.tile(np.eye(4), (len(joints), 1, 1)),
        morph_names=body.own,
        morph_weights=whole.morph_weights[own],
    )
    driven = [name for tool in body.tools for name in tool.targets]
    order = [[*body.own, *driven].index(name) for name in body.targets]
    stored = body.stored[[body.targets.index(name) for name in driven]]
    columns = [[driven.index(name) for name in tool.targets] for tool in tools]
    moving = moving_nodes(rig)
    tracked = []
    for source in clips:
        clip = _with_own_weights(source, node, len(body.targets), own)
        channel = clip.channel(node, "weights")
        if any(c.node in moving for c in clip.channels) or any(clip.name in tool.keys for tool in tools):

            def signal(times: Floats, clip: Clip = clip) -> Floats:
                weights = np.tile(stored, (len(times), 1))
                for tool, its in zip(tools, columns, strict=True):
                    weights[:, its] = _weights(tool, rig, joints, clip, times)
                return weights

            def signal_on(_: Floats, signal: Signal = signal) -> Signal:
                return signal

            times, keys = key_times(
                clip_grid(clip, rig, fps=pace.fps),
                signal_on,
                tolerance=_SAMPLING_SHARE * pace.tolerance,
                thinning=_KEYS_SHARE * pace.tolerance,
            )
            times = times[keys]
            made = widen(channel, rig, clip, times, signal(times))
            tracked.append(clip.name)
        else:
            warnings.append(f"{draft.source.path}: {clip.name}: moves no anchor of {body.node!r}")
            if channel is None:
                continue
            made = pad(channel, stored)
        encode_track(draft, source, node, Track(made.times, made.values[..., order], made.interpolation))
    return tracked


def _with_own_weights(clip: Clip, node: int, targets: int, own: list[int]) -> Clip:
    """The clip with a weights channel over the targets alone that are not driven; without one where there are none."""
    channel = clip.channel(node, "weights")
    if channel is None:
        return clip
    kept = () if not own else (channel,)
    if own and channel.values.shape[-1] == targets:
        kept = (replace(channel, values=channel.values[..., own]),)
    return replace(clip, channels=tuple(c for c in clip.channels if c is not channel) + kept)


def _weights(tool: _Tool, rig: Rig, joints: dict[str, int], clip: Clip, times: Floats) -> Floats:
    """(frames, targets) a tool's weights in a clip; `joints` are nodes by name."""
    own = morph_weights(rig, clip, times)
    places, scales = [], []
    for end in tool.ends:
        matrices = node_matrices(rig, clip, times, [joints[joint] for joint in end.joints])
        positions = np.tile(end.positions, (len(times), 1, 1))
        for name, deltas in end.morphs.items():
            if name in rig.morph_names:
                positions += own[:, rig.morph_names.index(name), None, None] * deltas
        moved = np.einsum("fkab,fkb->fka", matrices[:, :, :3, :3], positions) + matrices[:, :, :3, 3]
        places.append(np.einsum("k,fka->fa", end.weights, moved))
        now = np.cbrt(np.abs(np.linalg.det(matrices[:, :, :3, :3])))
        scales.append((now / end.scales) @ end.weights)
    scale = (scales[0] + scales[1]) / 2.0
    hidden = scale < LEAST_SCALE
    distances = np.linalg.norm(places[1] - places[0], axis=1) / np.where(hidden, 1.0, scale)
    rest_lengths = np.full(len(times), tool.rest_length)
    if clip.name in tool.keys:
        rest_lengths = np.interp(times, *tool.keys[clip.name].T)
    elif tool.morph is not None and tool.morph[0] in rig.morph_names:
        share = np.clip(own[:, rig.morph_names.index(tool.morph[0])], 0.0, 1.0)
        rest_lengths += share * (tool.morph[1] - tool.rest_length)
    if tool.curve is None:
        shortenings = 1.0 - distances / rest_lengths
        weights = np.stack([np.interp(shortenings, tool.rows, column) for column in tool.table.T], axis=1)
    else:
        weights = tool.curve.weights(distances, rest_lengths)
    made: Floats = tool.strengths.get(clip.name, 1.0) * np.where(hidden[:, None], 0.0, weights)
    return made


def _carrier(draft: EditedDocument, body: _Body) -> int:
    """The node that gets the body's tracks: the file's own of that name, or a stub.

    Raises:
        AssetError: The file has a mesh on a node of that name, with other morph targets.
    """
    nodes = draft.gltf.setdefault("nodes", [])
    found = [index for index, node in enumerate(nodes) if node.get("name") == body.node and "mesh" in node]
    if not found:
        return _add_stub(draft, body)
    node = nodes[found[0]]
    names = tuple(morph_target_names(draft.gltf["meshes"][node["mesh"]]))
    if names not in (body.targets, body.own):
        raise AssetError(
            f"the mesh of {body.node!r} has other morph targets than the body: {listed(names)};"
            " take it out of the file, or bake this file itself",
            where=draft.source.where("nodes", found[0]),
        )
    if names != body.targets:
        _add_idle_targets(draft, node, body)
    return found[0]


def _add_stub(draft: EditedDocument, body: _Body) -> int:
    """Append a node with a mesh of the body's names and targets, three vertices in one point, and give its index."""
    point = draft.add_sparse(np.zeros(0, np.intp), np.zeros((0, 3), np.float32), count=3, bounds=True)
    primitive: Json = {"attributes": {"POSITION": point}, "targets": [{"POSITION": point} for _ in body.targets]}
    mesh: Json = {} if body.mesh is None else {"name": body.mesh}
    # Players name the parts of a mesh by their number, and tracks by the part.
    mesh["primitives"] = [primitive for _ in range(body.primitives)]
    mesh["extras"] = {"targetNames": list(body.targets)}
    meshes = draft.gltf.setdefault("meshes", [])
    meshes.append(mesh)
    node: Json = {"name": body.node, "mesh": len(meshes) - 1}
    if body.stored.any():
        node["weights"] = body.stored.tolist()
    nodes = draft.gltf["nodes"]
    nodes.append(node)
    for scene in draft.gltf.get("scenes", [])[draft.gltf.get("scene", 0) :][:1]:
        scene.setdefault("nodes", []).append(len(nodes) - 1)
    return len(nodes) - 1


def _add_idle_targets(draft: EditedDocument, node: Json, body: _Body) -> None:
    """Give a mesh the body's targets that it lacks: they do nothing here, but tracks have a weight for each."""
    mesh = own_mesh(draft, node, node["mesh"])
    own = list(body.own)
    for primitive in mesh["primitives"]:
        old = primitive.get("targets", [])
        count = draft.gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
        # three.js takes the base's normals for a target that lacks them where another has them.
        kinds = [kind for kind in ("NORMAL", "TANGENT") if any(kind in each for each in old)]
        idle = {}
        for kind in ("POSITION", *kinds):
            nothing = np.zeros((0, 3), np.float32)
            idle[kind] = draft.add_sparse(np.zeros(0, np.intp), nothing, count=count, bounds=kind == "POSITION")
        primitive["targets"] = [old[own.index(name)] if name in own else dict(idle) for name in body.targets]
    if isinstance(mesh.setdefault("extras", {}), dict):
        mesh["extras"]["targetNames"] = list(body.targets)
    for carrier in (mesh, node):
        if "weights" in carrier:
            carrier["weights"] = [carrier["weights"][own.index(name)] if name in own else 0.0 for name in body.targets]


def _read_bodies(document: Document) -> list[_Body]:
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
        rig = read_rig(document, index)
        mesh = document.items("meshes")[rig.mesh]
        try:
            tools = tuple(_read_tool(tool) for tool in extras["wrinkle"]["tools"] if tool["targets"])
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise AssetError("is not what `wrinkle bake` writes", where=where) from error
        gone = [name for tool in tools for name in tool.targets if name not in rig.morph_names]
        if gone:
            raise AssetError(f"the mesh has lost its morph targets {listed(gone)}", where=where)
        name = mesh.get("name")
        bodies.append(
            _Body(
                node=node["name"],
                mesh=name if isinstance(name, str) else None,
                primitives=len(mesh["primitives"]),
                targets=rig.morph_names,
                stored=rig.morph_weights,
                tools=tools,
                ambiguous=_count_named(document, node["name"]) > 1,
            )
        )
    if not any(body.tools for body in bodies):
        raise AssetError("carries no wrinkles of `wrinkle bake` that anchors drive", where=document.path)
    return bodies


def _read_tool(data: Json) -> _Tool:
    targets = tuple(str(name) for name in data["targets"])
    ends = (_read_end(data["origin"]), _read_end(data["target"]))
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
    return _Tool(
        name=str(data["name"]),
        ends=ends,
        rest_length=float(data["rest_length"]),
        morph=None if morph is None else (str(morph["name"]), float(morph["full"])),
        keys=keys,
        strengths={clip: float(factor) for clip, factor in data.get("strengths", {}).items()},
        targets=targets,
        rows=rows,
        table=table,
        curve=curve,
    )


def _read_curve(data: Json, targets: int) -> CurveTable:
    bumps = tuple(int(count) for count in data["bumps"])
    distances = _rising(data["distances"]) if "distances" in data else np.zeros(0)
    parts = _rising(data["parts"])
    rises = np.array(data["rises"], np.float64).reshape(len(parts), -1)
    intervals = int(data["intervals"])
    if min(intervals, *bumps) < 1 or max(intervals, *bumps) > _MOST_INTERVALS:
        raise ValueError
    return CurveTable(
        taut=float(data["taut"]),
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


def _read_end(data: Json) -> _End:
    count = len(data["joints"])
    scales = np.array(data["scales"], np.float64).reshape(count)
    if not (scales > 0).all():
        raise ValueError
    return _End(
        joints=tuple(str(joint) for joint in data["joints"]),
        weights=np.array(data["weights"], np.float64).reshape(count),
        positions=np.array(data["positions"], np.float64).reshape(count, 3),
        scales=scales,
        morphs={name: np.array(moves, np.float64).reshape(count, 3) for name, moves in data.get("morphs", {}).items()},
    )
