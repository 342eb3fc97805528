"""Weight tracks for clips that lie in other files: the body with its wrinkles in one, each clip in another.

What a bake writes into a node's extras is enough: anchors by the names of joints, and a table of weights.

Source: the extras of `encode.encode_extras`. Differs from a bake: weights are straight between the rows of the table,
right to 1/256 of the greatest.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from wrinklecli.document import Document, Json, read_document
from wrinklecli.draft import Draft
from wrinklecli.encode import encode_track, own_mesh
from wrinklecli.errors import AssetError, BakeError, listed, nearest
from wrinklecli.pipeline import faults_reported, refuse_overwriting
from wrinklecli.pose import Clip, Rig, morph_target_names, morph_weights, node_matrices, read_clips, read_rig
from wrinklecli.tracks import Track, moving_nodes, pad, sample_times, widen

Floats = NDArray[np.float64]

# Greatest error of a weight between two keys: half of what a bake allows by default, as shares of the tallest.
_TOLERANCE = 0.005
# Below this scale against rest (a hidden character, say) a tool makes no wrinkles.
_LEAST_SCALE = 1e-6


@dataclass(frozen=True, slots=True)
class Tracked:
    """What was made of one file.

    Attributes:
        path: The file written.
        clips: Names of the clips that got weights.
        warnings: A line each.
    """

    path: str
    clips: tuple[str, ...]
    warnings: tuple[str, ...]


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
        rows: (rows,) 1 - distance / rest length, rising.
        table: (rows, targets) weights.
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

    Returns:
        What was made of each file, in order.

    Raises:
        AssetError: A file is malformed, the body carries no wrinkles, or no joint of any anchor is in an ANIM.
        BakeError: An output would overwrite an input, or cannot be written. All are computed before any is written.
    """
    body_file = read_document(baked)
    bodies = _read_bodies(body_file)
    outputs = [os.path.join(os.fspath(folder), os.path.basename(os.fspath(path))) for path in anims]
    for number, path in enumerate(outputs):
        if path in outputs[:number]:
            raise BakeError("is the output of two inputs of one name", where=path)
    drafts, inputs, results = [], list(body_file.files), []
    for anim, output in zip(anims, outputs, strict=True):
        document = read_document(anim)
        inputs += document.files
        draft = Draft(document)
        with faults_reported(document.path):
            results.append(Tracked(output, *_track_file(draft, bodies, fps)))
        drafts.append(draft)
    refuse_overwriting(inputs, outputs)
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as error:
        raise BakeError(f"cannot be made: {error.strerror or error}", where=os.fspath(folder)) from error
    for draft, output in zip(drafts, outputs, strict=True):
        draft.write(output)
    return results


def _track_file(draft: Draft, bodies: Sequence[_Body], fps: float) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Add the tracks of all bodies; the names of clips that got some, and warnings."""
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
            tracked |= dict.fromkeys(_track_body(draft, body, tools, clips, fps, warnings))
    return tuple(tracked), tuple(warnings)


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
        if len(tool.targets) > 1 and (tool.morph or tool.keys):
            warnings.append(
                f"{where}: {tool.name}: while its rest length changes, weights are approximate, as its bumps do not"
                " rise together; a bake has them exactly"
            )
        several = [joint for joint in tool.joints if bare.count(joint) > 1]
        if several:
            warnings.append(f"{where}: {tool.name}: several nodes are named {listed(several)}; the first is taken")
        matching.append(tool)
    return matching


def _track_body(
    draft: Draft, body: _Body, tools: Sequence[_Tool], clips: Sequence[Clip], fps: float, warnings: list[str]
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

            times = sample_times(clip, rig, signal, fps=fps, tolerance=_TOLERANCE)
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
    hidden = scale < _LEAST_SCALE
    distances = np.linalg.norm(places[1] - places[0], axis=1) / np.where(hidden, 1.0, scale)
    rest_lengths = np.full(len(times), tool.rest_length)
    if clip.name in tool.keys:
        rest_lengths = np.interp(times, *tool.keys[clip.name].T)
    elif tool.morph is not None and tool.morph[0] in rig.morph_names:
        share = np.clip(own[:, rig.morph_names.index(tool.morph[0])], 0.0, 1.0)
        rest_lengths += share * (tool.morph[1] - tool.rest_length)
    shortenings = np.where(hidden, 0.0, 1.0 - distances / rest_lengths)
    weights = np.stack([np.interp(shortenings, tool.rows, column) for column in tool.table.T], axis=1)
    # A longer curve has higher bumps, up to the same greatest height: exact where all bumps rise together.
    ratios = (rest_lengths / tool.rest_length)[:, None]
    weights = np.where(ratios == 1.0, weights, np.clip(ratios * weights, -1.0, 1.0))
    made: Floats = tool.strengths.get(clip.name, 1.0) * weights
    return made


def _carrier(draft: Draft, body: _Body) -> int:
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


def _add_stub(draft: Draft, body: _Body) -> int:
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


def _add_idle_targets(draft: Draft, node: Json, body: _Body) -> None:
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
            tools = tuple(_read_tool(tool) for tool in extras["wrinkle"]["tools"])
        except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
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
    rows = np.array(data["shortenings"], np.float64)
    targets = tuple(str(name) for name in data["targets"])
    table = np.array(data["weights"], np.float64).reshape(len(rows), len(targets))
    ends = (_read_end(data["origin"]), _read_end(data["target"]))
    morph = data.get("rest_length_morph")
    if not len(rows) or (np.diff(rows) <= 0).any() or not float(data["rest_length"]) > 0:
        raise ValueError
    return _Tool(
        name=str(data["name"]),
        ends=ends,
        rest_length=float(data["rest_length"]),
        morph=None if morph is None else (str(morph["name"]), float(morph["full"])),
        keys={
            clip: np.array(keys, np.float64).reshape(-1, 2) for clip, keys in data.get("rest_length_keys", {}).items()
        },
        strengths={clip: float(factor) for clip, factor in data.get("strengths", {}).items()},
        targets=targets,
        rows=rows,
        table=table,
    )


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
