"""What moves an asset besides its own clips: the range of motion of its joints and morph targets."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import read_clips
from wrinklecli.character.joined import with_clips, with_free_nodes
from wrinklecli.character.range_of_motion import range_of_motion
from wrinklecli.character.rig import read_hierarchy, read_rig
from wrinklecli.gltf.document import Document


@dataclass(frozen=True, slots=True)
class Motions:
    """What is to move an asset besides its own clips.

    Attributes:
        range_of_motion: Turn its joints and raise its morph targets, one at a time, though it has clips. Without any,
            they do that anyway.
    """

    range_of_motion: bool = False


@dataclass(frozen=True, slots=True)
class Moved:
    """An asset with what moves it.

    Attributes:
        document: With all clips.
        notes: What was made, a line each.
    """

    document: Document
    notes: tuple[str, ...]


def moved(document: Document, nodes: Sequence[int], motions: Motions) -> Moved:
    """Join an asset with what is to move it.

    Args:
        document: As it was read.
        nodes: Whose meshes are looked at.
        motions: What is to move them.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
    """
    clips = read_clips(document)
    if not nodes or (clips and not motions.range_of_motion):
        return Moved(document, ())
    hierarchy = read_hierarchy(document)
    joints = np.concatenate([read_rig(document, node, hierarchy).joints for node in nodes])
    document = with_free_nodes(document, {int(joint) for joint in joints})
    found = range_of_motion(document, nodes, clips)
    why = "" if clips else "has no clip; "
    return Moved(with_clips(document, found.clips), (f"{document.path}: {why}looked at in {found.summary}",))
