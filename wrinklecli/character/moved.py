"""What moves an asset besides its own clips: clips of other files, and the range of motion of its joints."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

from wrinklecli.character.anims import read_anims
from wrinklecli.character.clip import read_clips
from wrinklecli.character.joined import with_clips, with_free_nodes
from wrinklecli.character.range_of_motion import range_of_motion
from wrinklecli.character.rig import read_hierarchy, read_rig
from wrinklecli.gltf.document import Document


@dataclass(frozen=True, slots=True)
class Motions:
    """What is to move an asset besides its own clips.

    Attributes:
        anims: Files with clips, for nodes of the same names.
        range_of_motion: Turn its joints and raise its morph targets, one at a time. None: where there are no clips.
    """

    anims: Sequence[str | os.PathLike[str]] = ()
    range_of_motion: bool | None = None


@dataclass(frozen=True, slots=True)
class Moved:
    """An asset with what moves it.

    Attributes:
        document: With all clips.
        notes: What was made, a line each.
        warnings: What of the anims is left out, a line each.
        beside: The files that the anims consist of, read or not: nothing may be written over them.
    """

    document: Document
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    beside: tuple[str, ...]


def moved(document: Document, nodes: Sequence[int], motions: Motions) -> Moved:
    """Join an asset with what is to move it.

    Args:
        document: As it was read.
        nodes: Whose meshes are looked at.
        motions: What is to move them.

    Raises:
        AssetError: An anim, a mesh, a skin or the hierarchy is malformed, or an anim has no joint of the asset.
    """
    anims = read_anims(document, motions.anims)
    if anims.read:
        moving = {channel.node for clip in anims.clips for channel in clip.channels}
        document = with_clips(with_free_nodes(document, moving), anims.clips)
        document = document.extended(document.gltf, document.buffers, anims.read)
    clips, notes = read_clips(document), []
    if nodes and (motions.range_of_motion or (motions.range_of_motion is None and not clips)):
        document = with_free_nodes(document, _joints(document, nodes))
        found = range_of_motion(document, nodes, clips)
        document = with_clips(document, found.clips)
        notes.append(f"{document.path}: {'' if clips else 'has no clip; '}looked at in {found.summary}")
    return Moved(document, tuple(notes), anims.warnings, anims.beside)


def _joints(document: Document, nodes: Sequence[int]) -> set[int]:
    """The joints of the meshes of some nodes."""
    hierarchy = read_hierarchy(document)
    return {int(joint) for node in nodes for joint in read_rig(document, node, hierarchy).joints}
