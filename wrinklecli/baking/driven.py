"""Wrinkles of a baked asset in clips that its bake has not seen, set by its extras, in memory."""

from collections.abc import Collection

import numpy as np

from wrinklecli.baking.baked_body import BakedBody, read_bodies, wrinkle_targets
from wrinklecli.baking.track import MAX_ERROR, present_tools, track_body
from wrinklecli.character.anims import NamedNodes
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.effects.wrinkle.lookup import TABLE_ERROR
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import EditedDocument

_FPS = 30.0  # of the grid of times, as `track` has it


def with_driven_wrinkles(document: Document, clips: Collection[str]) -> tuple[Document, list[str]]:
    """Let the extras of baked bodies set their weights in some clips, but where a clip sets these itself.

    Args:
        document: With the clips.
        clips: Their names.

    Returns:
        The document, and what is wrong with the extras, a line each.
    """
    chosen = [clip for clip in read_clips(document) if clip.name in clips]
    if not chosen or not any(wrinkle_targets(document).values()):
        return document, []
    try:
        bodies = read_bodies(document)
    except AssetError as error:
        return document, [f"{line}: its wrinkles stay as stored" for line in error.lines]
    edited, warnings = EditedDocument(document), []
    nodes = NamedNodes.of(document.items("nodes"))
    for body in bodies:
        tools, missed = present_tools(body, document.items("nodes"))
        warnings += [f"{document.path}: {line}" for line in missed]
        undriven = [clip for clip in chosen if not _drives(clip, nodes.meshes, body)]
        if tools:
            track_body(edited, body, tools, undriven, fps=_FPS, tolerance=MAX_ERROR - TABLE_ERROR)
    return edited.document(), warnings


def _drives(clip: Clip, nodes: dict[str, int], body: BakedBody) -> bool:
    """Whether a clip moves a morph target of the body's tools itself, as one does that `track` has been over."""
    for part in body.parts:
        channel = clip.channel(nodes[part.node], "weights")
        columns = [number for number, name in enumerate(part.targets) if name in body.driven]
        if channel is not None and not np.allclose(channel.points[:, columns], part.stored[columns], atol=1e-6):
            return True
    return False
