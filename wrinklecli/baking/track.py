"""Weight tracks for clips in other files: one file has the body with its wrinkles, and others have the clips.

A bake writes into a node's extras all that is needed: anchors by the names of joints, and a table of weights.

Source: the extras of `extras.encode_extras`. Differs from a bake: weights are linear between the rows of a table,
right to 1/2048 of the greatest.
"""

import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import field, replace
from functools import partial
from typing import Any

import numpy as np

from wrinklecli.baking.baked_body import BakedBody, count_named, read_bodies, wrinkle_targets
from wrinklecli.baking.driven_body import (
    DrivenBody,
    joints_of,
    node_for_tracks,
    present_drives,
    targets_there,
    with_own_weights,
)
from wrinklecli.baking.morphs import encode_track
from wrinklecli.character.anims import NamedNodes, matched_without_prefixes
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.rig import TRANSFORM_DEFAULTS
from wrinklecli.character.weight_track import by_names, pad, widen
from wrinklecli.choices import FPS
from wrinklecli.drive.drive import StoredDrive
from wrinklecli.drive.table import TABLE_ERROR
from wrinklecli.errors import AssetError, BakeError, TooMuchError, counted, listed, log_findings, refuse_warnings
from wrinklecli.files.outputs import Outputs, part_of
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import Channels, forget_pointers
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.files import files_named
from wrinklecli.gltf.writer import write
from wrinklecli.numeric.guard import guarded
from wrinklecli.numeric.memory import MAX_MEMORY, Memory

# Nodes of a clip that a warning names: as many as fit into a line.
_SHOWN = 3


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """Options of `track`.

    Attributes:
        fps: Frames per second of the grid, which is refined where weights bend.
        max_error: Greatest error of a weight as a ratio of the greatest weight: above 1/2048, the error of the table.
        allow_external: Read buffers and images outside the files' folders too.
        max_memory: Most bytes that reading all files may take.
        strict: Refuse to write if there are warnings.
    """

    fps: float = FPS
    max_error: float = 0.01
    allow_external: bool = False
    max_memory: int = MAX_MEMORY
    strict: bool = False

    @property
    def tolerance(self) -> float:
        """Greatest error of a weight between keys, as a ratio of the greatest weight.

        Raises:
            ValueError: `max_error` leaves nothing.
        """
        if not self.max_error > TABLE_ERROR:
            raise ValueError(f"max_error is {self.max_error}; the table of weights is right to 1/2048")
        return self.max_error - TABLE_ERROR


@dataclass(frozen=True, slots=True)
class Tracked:
    """One file that `track` has made.

    Attributes:
        path: The file written.
        clips: Names of the clips that got weights.
        tools: A line for each tool: its name, node and targets.
        warnings: A line each.
        notes: A line for each clip that moves anchors of a body, and raises no wrinkle of it.
        flat: A line for each tool that stays flat in a clip, and why.
    """

    path: str
    clips: tuple[str, ...]
    tools: tuple[str, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...] = ()
    flat: tuple[str, ...] = ()


def track(
    baked: str | os.PathLike[str],
    anims: Sequence[str | os.PathLike[str]],
    folder: str | os.PathLike[str],
    options: TrackOptions | None = None,
    *,
    outputs: Outputs | None = None,
    **named: Any,
) -> list[Tracked]:
    """Add weight tracks for a baked body to the clips of other files, which share its joints by name.

    Each file is written into the folder under its own name. If it has a mesh on a node of the body's name, this mesh
    gets the tracks, and empty targets in place of those of the body that it lacks. Weights of its own go to targets of
    the same names, as in a bake; its further targets come behind those of the body. If it has no such mesh, it gets a
    stub of the same names, three vertices in one point, for players that bind tracks by name.

    Args:
        baked: A file that `bake` has written.
        anims: Files with clips.
        folder: The folder to write to; it is made if it is missing.
        options: The defaults of `TrackOptions` if None.
        outputs: The files to write are added to these. If None, they are committed before returning.
        named: Single options by their names in `TrackOptions`, in place of those in `options`.

    Returns:
        What was made of each file, in order.

    Raises:
        RefusedError: There are warnings, and `strict` is set; nothing was written.
        ValueError: `max_error` is not above 1/2048.
        AssetError: A file is malformed, the body carries no wrinkles, or no joint of any anchor is in an ANIM.
        BakeError: An output would overwrite an input, or cannot be written. All are computed before any is written.
        TypeError: `TrackOptions` lacks a name of `named`.

    Examples:
        >>> from wrinklecli import bake, track
        >>> report = bake("samples/wrist.glb", "configs/wrist.yaml", "body.glb", clips=["flex"])
        >>> [(made.path, made.clips) for made in track("body.glb", ["samples/wrist.glb"], "tracked", fps=24)]
        [('tracked/wrist.glb', ('flex', 'extend'))]
    """
    options = replace(options or TrackOptions(), **named)
    tolerance = options.tolerance
    memory = Memory(options.max_memory)
    with part_of(outputs) as written:
        paths = [os.path.join(os.fspath(folder), os.path.basename(os.fspath(path))) for path in anims]
        for number, path in enumerate(paths):
            if path in paths[:number]:
                raise BakeError("is the output of two inputs of one name", where=path)
        written.protect(files_named([baked, *anims]))
        written.make_folders(folder)
        for path in paths:
            written.claim(path)
        read = partial(read_document, allow_external=options.allow_external, memory=memory)
        with guarded(os.fspath(baked)):
            bodies = read_bodies(read(baked))
        edited, results = [], []
        for anim, path in zip(anims, paths, strict=True):
            with guarded(os.fspath(anim)):
                edited.append(EditedDocument(read(anim)))
                results.append(_track_file(edited[-1], bodies, path, fps=options.fps, tolerance=tolerance))
        warnings = [line for result in results for line in result.warnings]
        log_findings(warnings, [line for result in results for line in result.notes], where=os.fspath(baked))
        if options.strict:
            refuse_warnings(warnings, where=os.fspath(baked))
        for each, path in zip(edited, paths, strict=True):
            write(each, path, outputs=written)
        return results


def _track_file(
    edited: EditedDocument, bodies: Sequence[BakedBody], output: str, *, fps: float, tolerance: float
) -> Tracked:
    """Add the tracks of all bodies to a file with clips, which will be written to `output`.

    Raises:
        AssetError: No tool's joints are in the file, or a body's node has another mesh there.
    """
    document = edited.source
    clips = read_clips(document)
    names = [node["name"] for node in document.items("nodes") if node.get("name")]
    warnings = [
        f"{document.path}: a scene or another node is named {body.node!r} too, here or in the body's file:"
        " three.js renames all but the first, and tracks then miss the body"
        for body in bodies
        if body.ambiguous or count_named(document, body.node) > int(body.node in names)
    ]
    warnings += [
        f"{document.path}: the body {body.node!r} is of `bake --draft`: neither proven nor fully refined"
        for body in bodies
        if body.draft
    ]
    for body in bodies:
        others = [name for name in targets_there(document, body.node) or () if name not in body.targets]
        if others:
            warnings.append(
                f"{document.path}: the body {body.node!r} has no morph targets {listed(others)}, which this file has:"
                " their weights move nothing of it"
            )
    present: list[tuple[BakedBody, list[StoredDrive]]] = []
    for body in bodies:
        drives, missed = present_drives(body, document.gltf)
        present.append((body, drives))
        warnings += [f"{document.path}: {line}" for line in missed]
    if not any(drives for _, drives in present):
        segments = (each for body in bodies for each in body.drives if each.acts_alone)
        wanted = dict.fromkeys(joint for each in segments for joint in each.joints)
        unnamed = len(document.items("nodes")) - len(names)
        raise AssetError(
            f"has no tool's joints; the anchors are on {listed(wanted)}, its nodes are {listed(names)}"
            + (f"; {counted(unnamed, 'more node')} without a name, and tracks find joints by name" if unnamed else ""),
            where=document.path,
        )
    if not clips:
        warnings.append(f"{document.path}: has no clip")
    warnings += [
        f"{document.path}: {clip.name} has keys before 0 s, where players begin: its weights are written from 0 s on"
        for clip in clips
        if clip.early
    ]
    tracked: dict[str, None] = {}
    alike: dict[str, str] = {}
    for body, drives in present:
        found = joints_of(body, document.gltf).alike(joint for each in drives for joint in each.joints)
        alike |= {there: joint for joint, there in found.items()}
    notes = [f"{document.path}: {line}" for line in matched_without_prefixes(alike)]
    flat: list[str] = []
    for body, drives in present:
        if drives:
            made = track_body(edited, body, drives, clips, fps=fps, tolerance=tolerance)
            tracked |= dict.fromkeys(made.moved)
            warnings += [
                f"{document.path}: {clip}: moves no anchor of {body.node!r}: {why}" for clip, why in made.still
            ]
            notes += [f"{document.path}: {name}: raises no wrinkle of {body.node!r}: {why}" for name, why in made.idle]
            flat += [f"{document.path}: {name}: {why}" for name, why in made.flat]
    lines = (
        f"{each.name} on {body.node}: targets {', '.join(each.targets)}"
        for body, drives in present
        for each in drives
        if each.acts_alone
    )
    return Tracked(output, tuple(tracked), tuple(lines), tuple(warnings), tuple(notes), tuple(flat))


@dataclass(frozen=True, slots=True)
class _Tracks:
    """The clips of a file, by what they do with a body.

    Attributes:
        moved: Names of the clips that move its anchors, and have got tracks.
        still: Names of the others, and what they move.
        idle: Names of clips that raise no wrinkle, and why the first of its tools stays flat there.
        flat: Names of clips, and for each tool that stays flat there why it does.
    """

    moved: list[str] = field(default_factory=list)
    still: list[tuple[str, str]] = field(default_factory=list)
    idle: list[tuple[str, str]] = field(default_factory=list)
    flat: list[tuple[str, str]] = field(default_factory=list)


def track_body(
    edited: EditedDocument,
    body: BakedBody,
    drives: Sequence[StoredDrive],
    clips: Sequence[Clip],
    *,
    fps: float,
    tolerance: float,
) -> _Tracks:
    """Add one body's tracks to clips."""
    ambiguous = body.ambiguous
    there = targets_there(edited.source, body.node)
    body = body.with_targets(there or ())
    node = node_for_tracks(edited, body.parts[0], ambiguous=ambiguous)
    # A part without a skin has to move as the node does.
    follow = not body.skinned and any(clip.channel(node, path) for clip in clips for path in TRANSFORM_DEFAULTS)
    others = [
        (part, node_for_tracks(edited, part, ambiguous=ambiguous)) for part in body.parts[1:] if part.targets or follow
    ]
    driven = DrivenBody.of(edited.document(), node, body, drives)
    every = [*body.kept, *body.driven]
    tracks = _Tracks()
    for source in clips:
        clip = with_own_weights(source, node, body, there)
        channel = clip.channel(node, "weights")
        if driven.moved_by(clip):
            tracks.moved.append(clip.name)
            times = driven.key_times(clip, fps=fps, tolerance=tolerance)
            weights = driven.weights_in(clip)(times)
            made = widen(channel, driven.rig.own, clip, times, weights)
            flat = list(driven.flat(clip, times, weights))
            tracks.flat.extend((clip.name, why) for why in flat)
            if not weights.any():
                tracks.idle.extend((clip.name, why) for why in flat[:1])
        else:
            nodes = list(dict.fromkeys(driven.rig.names[each.node] for each in source.channels))
            more = f" and {counted(len(nodes) - _SHOWN, 'more node')}" if len(nodes) > _SHOWN else ""
            tracks.still.append((clip.name, f"it moves only {listed(nodes[:_SHOWN])}{more}"))
            if channel is None:
                continue
            made = pad(channel, driven.stored)
        for part, place in ((body.parts[0], node), *others):
            if part.targets:
                values = by_names(made.values, every, part.targets, part.stored)
                encode_track(edited, source, place, replace(made, values=values))
    for clip in clips if follow else ():
        for _, place in others:
            _follow(edited, clip, node, place)
    forget_pointers(edited.gltf)
    return tracks


def _follow(edited: EditedDocument, clip: Clip, node: int, part: int) -> None:
    """Let a part's node move as another node in a clip, in so far as the clip does not move it already."""
    channels, moves = edited.gltf["animations"][clip.index]["channels"], Channels(edited.gltf)
    moved = [(channel, each) for channel in channels if (each := moves.moved(channel)) is not None]
    for path in TRANSFORM_DEFAULTS:
        own = [channel["sampler"] for channel, each in moved if each.path == path and node in each.nodes]
        if own and clip.channel(part, path) is None:
            channels.append({"sampler": own[-1], "target": {"node": part, "path": path}})


def with_driven_weights(document: Document, clips: Collection[str]) -> tuple[Document, list[str]]:
    """Let the drives of baked bodies set their weights in the clips of these names, unless a clip sets these itself.

    Returns:
        The document, and a line for each fault of the extras.
    """
    chosen = [clip for clip in read_clips(document) if clip.name in clips]
    if not chosen or not any(wrinkle_targets(document).values()):
        return document, []
    try:
        bodies = read_bodies(document)
    except (AssetError, TooMuchError) as error:
        return document, [f"{line}: its wrinkles stay as stored" for line in error.lines]
    edited, warnings, defaults = EditedDocument(document), [], TrackOptions()
    nodes = NamedNodes.of(document.items("nodes"))
    for body in bodies:
        drives, missed = present_drives(body, document.gltf)
        warnings += [f"{document.path}: {line}" for line in missed]
        undriven = [clip for clip in chosen if not _sets_weights(clip, nodes.meshes, body)]
        if drives:
            track_body(edited, body, drives, undriven, fps=defaults.fps, tolerance=defaults.tolerance)
    return edited.document(), warnings


def _sets_weights(clip: Clip, nodes: Mapping[str, int], body: BakedBody) -> bool:
    """True if a clip moves a driven morph target of the body itself, as clips do that `track` has written."""
    for part in body.parts:
        channel = clip.channel(nodes[part.node], "weights")
        driven = set(body.driven)
        columns = [number for number, name in enumerate(part.targets) if name in driven]
        if channel is not None and not np.allclose(channel.points[:, columns], part.stored[columns], atol=1e-6):
            return True
    return False
