"""Tools suggested for an asset: segments across the folds that its clips make, in a file that bakes as it is."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from wrinklecli.character.bones import read_bones
from wrinklecli.character.clip import chosen_clips, read_clips
from wrinklecli.character.contacts import Neighbours
from wrinklecli.character.joined import with_clips
from wrinklecli.character.moved import Motions, Moved, moved
from wrinklecli.character.scene import none_deforms
from wrinklecli.choices import Scheme
from wrinklecli.errors import log_findings
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.images import files_of
from wrinklecli.numeric.guard import Progress, guarded, log_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.review.suggest.candidates import LEAST_LOSS, find_candidates
from wrinklecli.review.suggest.choice import choose_candidates, folding
from wrinklecli.review.suggest.faces import suggest_face
from wrinklecli.review.suggest.fitted_tools import Suggestion, fit_tools
from wrinklecli.review.suggest.flesh import suggest_flesh
from wrinklecli.review.suggest.garments import (
    SuggestedField,
    beside_garments,
    find_garments,
    suggest_fields,
)
from wrinklecli.review.suggest.measure import find_mesh_nodes, measure_meshes
from wrinklecli.review.suggest.muscles import suggest_muscles
from wrinklecli.review.suggest.suggest_options import SuggestOptions
from wrinklecli.review.suggest.text import Entry, file_text, refuse_unwritable
from wrinklecli.review.suggest.touches import refinement_for, suggest_touches
from wrinklecli.review.suggest.trial import TriedAsset
from wrinklecli.review.suggest.worth import Dropped, Judge, Worthwhile
from wrinklecli.surface.ground import read_ground
from wrinklecli.surface.substance import is_rigid
from wrinklecli.tools.records import RefinementSettings, ToolsFile

# Most meshes that a reason names.
_MOST_NAMED = 6


@dataclass(frozen=True, slots=True)
class Suggestions:
    """The fields and tools suggested for an asset.

    Attributes:
        tools: Best first; may be empty.
        text: A tools file with them and the fields; empty if there are none.
        reason: Why there are none; empty if there are some.
        notes: A line for each material that meshes are made of, and for each reason to leave out folds.
        inputs: All files that were read, and the asset's images.
        dropped: Fields and tools that are left out, each with the reason.
        fields: A field for each garment.
        guesses: With the option `muscles`, `flesh` or `touch`, such effects in place of tools.
    """

    tools: tuple[Suggestion, ...]
    text: str
    reason: str
    notes: tuple[str, ...]
    inputs: tuple[str, ...]
    dropped: tuple[Dropped, ...] = ()
    fields: tuple[SuggestedField, ...] = ()
    guesses: tuple[Entry, ...] = ()


def suggest(
    asset: str | os.PathLike[str],
    options: SuggestOptions | None = None,
    *,
    progress: Progress = log_progress,
    **named: Any,
) -> Suggestions:
    """Find where clips compress an asset's surfaces, and suggest fields for garments, and tools for skin.

    Without clips, the asset's range of motion is measured: joints and morph targets, one at a time. With `face`, clips
    are ignored, and the morph targets of the face are measured. With `muscles` or `flesh`, these are guessed by the
    names of bones. With `touch`, clips are searched for fingertips that come to skin.

    Args:
        asset: The .gltf or .glb to read.
        options: What to look at; the defaults of `SuggestOptions` if None.
        progress: Called with a stage's name, steps done and steps in all.
        named: Single options by their names in `SuggestOptions`, in place of those in `options`.

    Raises:
        AssetError: The asset or an anim is at fault, or the asset has wrinkles; it has no such clip or node.
        BakeError: Mesh and clips are too large to measure.
        TypeError: `SuggestOptions` lacks a name of `named`.

    Examples:
        >>> from pathlib import Path
        >>> from wrinklecli import suggest
        >>> found = suggest("samples/wrist.glb", count=1)
        >>> [(each.tool.name, each.clip) for each in found.tools]
        [('wrist_top', 'extend')]
        >>> _ = Path("tools.yaml").write_text(found.text)
    """
    found = _suggest(asset, replace(options or SuggestOptions(), **named), progress)
    log_findings((), found.notes, where=os.fspath(asset))
    return found


def _suggest(asset: str | os.PathLike[str], options: SuggestOptions, progress: Progress) -> Suggestions:
    """Suggest as `suggest` does."""
    with guarded(os.fspath(asset)):
        memory = Memory(options.max_memory)
        document = read_document(asset, allow_external=options.allow_external, memory=memory)
        nodes, notes = find_mesh_nodes(document, options)
        # What swings and what is touched does so in whole motions alone.
        in_range = False if options.touch or options.flesh else options.range_of_motion or None
        motions = Motions(options.anims, in_range, options.pose, options.morphs)
        joined = moved(document, list(nodes), motions)
        read = _Read(joined, nodes, (*notes, *joined.warnings, *([] if options.face else joined.notes)))
        if options.muscles or options.flesh or options.touch:
            return _below_skin(read, options)
        if options.face:
            return _of_face(read, options, progress)
        return _of_clips(read, options, progress)


@dataclass(frozen=True, slots=True)
class _Read:
    """An asset with its motions, the nodes to look at with the names that a file must give, and notes so far."""

    joined: Moved
    nodes: Mapping[int, str | None]
    notes: Sequence[str]


def _below_skin(read: _Read, options: SuggestOptions) -> Suggestions:
    """Suggest muscles, flesh or touches."""
    joined, nodes, document = read.joined, read.nodes, read.joined.document
    played = chosen_clips(joined.clips, joined.chosen(options.clips), where=document.path)
    below = suggest_touches if options.touch else suggest_flesh if options.flesh else suggest_muscles
    settings, neighbours = ToolsFile(path=document.path), Neighbours(document)
    grounds = [read_ground(document, node, [], settings, played, neighbours=neighbours) for node in nodes]
    found, left_out, reason = below(document, grounds, nodes, played, fps=options.fps)
    found = found[: options.count]
    refinement = refinement_for(found, document) if found and options.touch else RefinementSettings()
    text = file_text(found, document.path, refinement) if found else ""
    inputs = (*files_of(document), *joined.beside)
    return Suggestions((), text, reason, (*read.notes, *left_out), inputs, guesses=tuple(found))


def _of_face(read: _Read, options: SuggestOptions, progress: Progress) -> Suggestions:
    """Suggest tools where the morph targets of a face compress the skin."""
    joined = read.joined
    of_face = suggest_face(joined.document, read.nodes, joined.clips)
    raised = with_clips(joined.document, of_face.motions)
    clips = tuple(read_clips(raised))
    judge = Judge(TriedAsset(raised, clips, jobs=options.jobs), options.everything, clips, progress)
    count = len(of_face.tools)
    found = judge.worthwhile(of_face.tools, RefinementSettings(), count=count, budget=options.budget)
    return _written(raised, joined.beside, found, [*read.notes, *of_face.notes], of_face.reason, [])


def _of_clips(read: _Read, options: SuggestOptions, progress: Progress) -> Suggestions:
    """Suggest fields for garments, and tools where clips compress what they leave bare."""
    joined, nodes, document = read.joined, read.nodes, read.joined.document
    clips = checked = chosen_clips(joined.clips, joined.chosen(options.clips), where=document.path)
    if joined.range and not options.clips:
        generated = [clip for clip in clips if clip.name in joined.range]
        others = (clip for clip in clips if clip.name not in joined.range)
        clips = (*others, *(generated if options.everything else folding(document, generated)))
    meshes = measure_meshes(document, nodes, clips, options, progress) if clips else []
    tried = TriedAsset(document, joined.clips, jobs=options.jobs)
    garments = find_garments(tried, [mesh for mesh, _ in meshes], options)
    judge = Judge(tried, options.everything, checked, progress)
    fields = suggest_fields(judge, garments, options.budget)
    budget = options.budget - sum(each.gpu_bytes for each in fields.kept)
    folded = {each.field.name for each in fields.kept}
    bare = beside_garments(meshes, [each for each in garments if each.suggestion.field.name in folded])
    candidates = find_candidates(bare, read_bones(document).parts, progress, jobs=options.jobs)
    chosen, reasons, hard = choose_candidates(tried, candidates, options)
    flat = bool(chosen) and all(candidate.mesh.flat for candidate in chosen)
    scheme: Scheme = "midpoint" if flat else "butterfly"
    refinement = replace(fields.refinement, scheme=scheme)
    found = judge.worthwhile(fit_tools(chosen), refinement, count=options.count, budget=budget)
    found.dropped[:0] = fields.dropped
    rigid = {mesh.rig.node_name: None for mesh, _ in meshes if is_rigid(mesh.gauge)}
    hard = [*(f"{name} is rigid" for name in rigid), *hard]
    if candidates and not chosen:
        reason = _joined([*hard, "what its motions fold is left out, as the notes say"])
    elif not nodes:
        reason = f"no mesh deforms: {none_deforms(document)}"
    elif not checked:
        reason = "it has no clip, no morph target and no joint to turn: nothing moves"
    elif not clips:
        reason = "none of its motions folds a limb"
    elif not meshes:
        reason = "no clip moves a mesh that deforms"
    else:
        least = f"no clip compresses the surface by more than {100 * LEAST_LOSS:g} % anywhere that a tool fits"
        reason = _joined([*hard, least])
    beside = [*joined.beside, *(os.fspath(path) for path in options.presets)]
    return _written(document, beside, found, [*read.notes, *reasons], reason, options.written_presets, fields.kept)


def _joined(clauses: Sequence[str]) -> str:
    """Join clauses of a reason, the last of which is always there; of many others the first ones."""
    *others, last = clauses
    more = [f"{len(others) - _MOST_NAMED} more are hard"] if len(others) > _MOST_NAMED else []
    return "; ".join([", ".join([*others[:_MOST_NAMED], *more]), last]) if others else last


def _written(
    document: Document,
    beside: Sequence[str],
    found: Worthwhile[Suggestion],
    notes: Sequence[str],
    reason: str,
    presets: Sequence[str],
    fields: Sequence[SuggestedField] = (),
) -> Suggestions:
    """Write tools; `reason` says why there are none, unless they were tried and left out.

    `beside` are files that were read besides the asset's, `presets` those of presets as the text names them.
    """
    text = ""
    entries = [*(each.entry for each in fields), *(each.entry for each in found.kept)]
    if entries:
        text = file_text(entries, document.path, found.refinement, presets)
        refuse_unwritable(text, document, entries)
        reason = ""
    elif found.dropped:
        reason = "nothing is worth it, as the notes say; `wrinkle edit` draws tools by hand"
    inputs, notes = (*files_of(document), *beside), (*notes, *found.summary)
    grown = round((sum(each.own_bytes for each in fields) + sum(each.own_bytes for each in found.kept)) / 1e6, 1)
    if grown:
        why = f"{grown} MB more on a GPU for the new vertices, which --budget does not count"
        notes = (*notes, f"the asset's own morph targets take {why}")
    return Suggestions(tuple(found.kept), text, reason, notes, inputs, tuple(found.dropped), tuple(fields))
