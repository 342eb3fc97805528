"""Tools suggested for an asset: segments across the folds that its clips make, in a file that bakes as it is."""

import os
from collections.abc import Sequence
from dataclasses import dataclass

from wrinklecli.character.bones import read_bones
from wrinklecli.character.clip import Clip, chosen_clips
from wrinklecli.character.moved import Motions, moved
from wrinklecli.character.rig import read_rig
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.images import files_of
from wrinklecli.numeric.guard import Progress, guarded, no_progress
from wrinklecli.numeric.memory import MAX_MEMORY, Memory
from wrinklecli.review.suggest.anatomy import believable
from wrinklecli.review.suggest.choice import choose_folds
from wrinklecli.review.suggest.fitting import Suggestion, fit_tools
from wrinklecli.review.suggest.folds import LEAST_LOSS, Fold, find_folds
from wrinklecli.review.suggest.measure import MeasuredMesh, MeshNode, find_mesh_nodes, measure_meshes
from wrinklecli.review.suggest.text import refuse_unwritable, tools_text
from wrinklecli.review.suggest.trial import tried


@dataclass(frozen=True, slots=True)
class Suggestions:
    """What was found in an asset.

    Attributes:
        tools: Best first; may be none.
        text: A tools file of them; empty where there are none.
        reason: Why there are none; empty where there are some.
        notes: What meshes are made of and what was left out, a line each.
        inputs: Every file that was read, and the asset's images.
    """

    tools: tuple[Suggestion, ...]
    text: str
    reason: str
    notes: tuple[str, ...]
    inputs: tuple[str, ...]


def suggest(
    asset: str | os.PathLike[str],
    *,
    clips: Sequence[str] = (),
    count: int = 8,
    node: str | None = None,
    everything: bool = False,
    fps: float = 30.0,
    anims: Sequence[str | os.PathLike[str]] = (),
    range_of_motion: bool = False,
    allow_external: bool = False,
    max_memory: int = MAX_MEMORY,
    progress: Progress = no_progress,
) -> Suggestions:
    """Find where clips compress an asset's surfaces, and lay tools there.

    An asset without clips is looked at in its range of motion: joints and morph targets, one at a time.

    Args:
        asset: The .gltf or .glb to read.
        clips: Names of the clips to look at; all where left out.
        count: Suggestions at most; a pair counts as one.
        node: Name of the node whose mesh to look at; all that deform where left out.
        everything: Leave out none: neither hard parts nor what another layer hides.
        fps: Poses a second; of a clip at most 200, evenly spaced, and fewer where mesh and clips are large.
        anims: Files with more clips, for joints of the same names.
        range_of_motion: Look at that too, though the asset has clips.
        allow_external: Read buffers outside the asset's folder too.
        max_memory: Bytes that it may take.
        progress: Called with a stage's name, steps done and steps in all.

    Raises:
        AssetError: The asset or an anim is at fault, or the asset has wrinkles; it has no such clip or node.
        BakeError: Mesh and clips are too large to measure.

    Example:
        >>> from pathlib import Path
        >>> from wrinklecli import suggest
        >>> found = suggest("samples/wrist.glb", count=1)
        >>> [(each.tool.name, each.clip) for each in found.tools]
        [('hand', 'extend')]
        >>> _ = Path("tools.yaml").write_text(found.text)
    """
    with guarded(os.fspath(asset)):
        document = read_document(asset, allow_external=allow_external, memory=Memory(max_memory))
        nodes, notes = find_mesh_nodes(document, node)
        motions = Motions(anims=anims, range_of_motion=range_of_motion or None)
        joined = moved(document, [each.index for each in nodes], motions)
        document, notes = joined.document, [*notes, *joined.warnings, *joined.notes]
        chosen = chosen_clips(joined.clips, clips, where=document.path)
        made: list[Clip] = []
        if joined.range and not clips:
            made = [clip for clip in chosen if clip.name in joined.range]
            others = (clip for clip in chosen if clip.name not in joined.range)
            chosen = (*others, *believable(made, read_rig(document, nodes[0].index), read_bones(document)))
        meshes = measure_meshes(document, nodes, chosen, fps, progress) if chosen else []
        folds = _folds_of(meshes, progress)
        choice = choose_folds(document, folds, everything=everything)
        flat = all(fold.mesh.flat for fold in choice.folds)
        laid = tried(document, fit_tools(choice.folds, count, made), joined.clips, midpoint=flat)
        notes += [*choice.notes, *laid.notes]
        text = reason = ""
        if laid.tools:
            text = tools_text(laid.tools, os.path.basename(document.path), laid.refinement)
            refuse_unwritable(text, document, laid.tools)
        elif (folds and not choice.folds) or laid.notes:
            reason = "what its motions fold is left out, as the notes say"
        else:
            reason = _why_none(nodes, chosen, meshes)
        return Suggestions(tuple(laid.tools), text, reason, tuple(notes), (*files_of(document), *joined.beside))


def _folds_of(meshes: Sequence[MeasuredMesh], progress: Progress) -> list[Fold]:
    """The folds of all meshes, one mesh after another."""
    folds: list[Fold] = []
    for number, mesh in enumerate(meshes):

        def looked(share: float, number: int = number) -> None:
            progress("laying", round(100 * (number + share)), 100 * len(meshes))

        folds += find_folds(mesh, looked)
    return folds


def _why_none(nodes: Sequence[MeshNode], clips: Sequence[Clip], meshes: Sequence[MeasuredMesh]) -> str:
    """Why there is nothing to suggest."""
    if not nodes:
        return "no mesh deforms: none has a skin or morph targets"
    if not clips:
        return "it has no clip, no joint that bends a mesh and no morph target: nothing moves"
    if not meshes:
        return "no clip moves a mesh that deforms"
    return f"no clip compresses the surface by more than {100 * LEAST_LOSS:g} % anywhere that a tool fits"
