"""Adds motions to an asset: clips of other files, a pose, the range of motion of its joints."""

import os
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.rig import read_hierarchy, read_rig
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document

if TYPE_CHECKING:
    from wrinklecli.character.posing import JointTurn, MorphWeight


@dataclass(frozen=True, slots=True)
class Motions:
    """The motions to add to an asset.

    Attributes:
        anims: Files with clips for nodes of the same names.
        range_of_motion: Turn joints and raise morph targets, one at a time. None means only if no clip moves anything
            and there is no pose.
        pose: Joints to turn in one pose.
        morphs: Weights of morph targets in this pose.
    """

    anims: Sequence[str | os.PathLike[str]] = ()
    range_of_motion: bool | None = None
    pose: Sequence["JointTurn"] = ()
    morphs: Sequence["MorphWeight"] = ()


@dataclass(frozen=True, slots=True)
class Moved:
    """An asset with added motions.

    Attributes:
        document: The asset with all clips, its own first.
        clips: All clips.
        pose: Name of the pose's clip, if any.
        range: Names of the clips of the range of motion.
        telling: A few of these, which together show how the asset moves.
        further: Names of all added clips.
        notes: Lines on motions that were made, and on parts of the anims that were left out or renamed.
        warnings: A line for each anim without clips.
        beside: All files that the anims consist of, which must not be overwritten.
    """

    document: Document
    clips: tuple[Clip, ...]
    pose: str | None
    range: tuple[str, ...]
    telling: tuple[str, ...]
    further: tuple[str, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    beside: tuple[str, ...]

    def added(self, clips: Sequence[str] = ()) -> set[str]:
        """The names of the added clips, or of those among `clips` if there are any."""
        return {name for name in self.further if not clips or name in clips}

    def chosen(self, clips: Sequence[str]) -> Sequence[str]:
        """The names of the clips to look at: the pose if there is one, or else `clips`."""
        return clips if self.pose is None else (self.pose,)


def moved(
    document: Document,
    nodes: Sequence[int],
    motions: Motions,
    *,
    driven: Mapping[int, Collection[str]] | None = None,
) -> Moved:
    """Add motions to an asset.

    The range of motion covers the meshes of `nodes`, except morph targets that tools drive, whose names `driven` has by
    node.

    Raises:
        AssetError: An anim, a mesh, a skin or the hierarchy is malformed; an anim has no joint of the asset, or the
            asset has no joint or morph target of the pose.
    """
    own = len(document.items("animations"))
    clips, pose = read_clips(document), None
    made: tuple[str, ...] = ()
    telling: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    notes: list[str] = []
    # Most bakes need none of the modules that are imported below.
    if motions.anims:
        from wrinklecli.character.anims import read_anims
        from wrinklecli.character.joined import with_clips, with_free_nodes

        anims = read_anims(document, motions.anims)
        moving = {channel.node for clip in anims.clips for channel in clip.channels}
        document = with_clips(with_free_nodes(document, moving), anims.clips)
        document = document.extended(document.gltf, document.buffers, anims.read)
        clips, warnings, beside = read_clips(document), anims.warnings, anims.beside
        notes += anims.notes
    if motions.pose or motions.morphs:
        from wrinklecli.character.anims import matched_without_prefixes
        from wrinklecli.character.posing import joints_alike, with_pose

        document = with_pose(document, motions.pose, motions.morphs)
        clips = read_clips(document)
        pose = clips[-1].name
        notes += [f"{document.path}: {line}" for line in matched_without_prefixes(joints_alike(document, motions.pose))]
    in_range = motions.range_of_motion
    if in_range is None and pose is None:
        in_range = not any(clip.moves for clip in clips)
    if nodes and in_range:
        from wrinklecli.character.joined import with_clips, with_free_nodes
        from wrinklecli.character.range_of_motion import range_of_motion

        document = with_free_nodes(document, _joints(document, nodes))
        found = range_of_motion(document, nodes, clips, driven=driven)
        why = "" if motions.range_of_motion else "its clips hold still; " if clips else "has no clip; "
        notes.append(f"{document.path}: {why}looked at in {found.summary}")
        document = with_clips(document, found.clips)
        clips, made, telling = read_clips(document), tuple(clip.name for clip in found.clips), found.telling
    further = tuple(clip.name for clip in clips if clip.index >= own)
    return Moved(document, tuple(clips), pose, made, telling, further, tuple(notes), warnings, beside)


def _joints(document: Document, nodes: Sequence[int]) -> set[int]:
    """The joints of the meshes of some nodes."""
    hierarchy = read_hierarchy(document)
    return {int(joint) for node in nodes for joint in read_rig(document, node, hierarchy).joints}
