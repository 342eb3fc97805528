"""Weight tracks for clips that lie in other files: the body with its wrinkles in one, each clip in another.

What a bake writes into a node's extras is enough: anchors by the names of joints, and a table of weights.

Source: the extras of `extras.encode_extras`. Differs from a bake: weights are straight between the rows of a table,
right to 1/256 of the greatest.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.baking.baked_body import BakedBody, BakedTool, count_named, read_bodies
from wrinklecli.baking.job import refuse_overwriting
from wrinklecli.baking.morphs import encode_track
from wrinklecli.baking.track_node import node_for_tracks
from wrinklecli.character.clip import Clip, clip_grid, read_clips
from wrinklecli.character.pose import LEAST_SCALE, morph_weights, node_matrices
from wrinklecli.character.rig import Rig, moving_nodes, read_rig
from wrinklecli.character.weight_track import Track, pad, widen
from wrinklecli.errors import AssetError, BakeError, RefusedError, listed, nearest
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edit import EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.gltf.writer import write
from wrinklecli.method.lookup import TABLE_ERROR
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import guarded
from wrinklecli.numeric.piecewise import Signal, key_times

# Of what the error bound leaves beside the table's own error, the part of the samples and that of dropped keys.
_SAMPLING_SHARE = 2 / 3
_KEYS_SHARE = 1 / 3


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
    bodies = read_bodies(body_file)
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


def _track_file(draft: EditedDocument, bodies: Sequence[BakedBody], pace: _Pace, output: str) -> Tracked:
    """Add the tracks of all bodies."""
    document = draft.source
    clips = read_clips(document)
    nodes = document.items("nodes")
    names = [str(node.get("name", "")) for node in nodes]
    warnings: list[str] = []
    tracked: dict[str, None] = {}
    for body in bodies:
        if body.ambiguous or count_named(document, body.node) > int(body.node in names):
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


def _joint(nodes: Sequence[Json], name: str) -> int:
    """The node of a name; among several the first without a mesh, as bodies are often named like a joint."""
    found = [index for index, node in enumerate(nodes) if node.get("name") == name]
    return next((index for index in found if "mesh" not in nodes[index]), found[0])


def _matching(body: BakedBody, nodes: Sequence[Json], where: str, warnings: list[str]) -> list[BakedTool]:
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
    draft: EditedDocument,
    body: BakedBody,
    tools: Sequence[BakedTool],
    clips: Sequence[Clip],
    pace: _Pace,
    warnings: list[str],
) -> list[str]:
    """Add one body's tracks; the names of clips that got some."""
    node = node_for_tracks(draft, body)
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


def _weights(tool: BakedTool, rig: Rig, joints: dict[str, int], clip: Clip, times: Floats) -> Floats:
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
