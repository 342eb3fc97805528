"""Extras of a baked node: the drives of its effects as JSON, for players of clips that were never baked."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.targets import AnySet, CreaseSet, TargetSet, of_folds, of_tools, targets_of
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.table import CurveTable, Table
from wrinklecli.effects.contact.hinge import Hinge
from wrinklecli.effects.wrinkle.lookup import tabulate_curve, tabulate_weights
from wrinklecli.gltf.edited_document import EditedDocument

# Raised only when the geometry that the same asset and tools give changes.
METHOD = 3


def encode_extras(
    edited: EditedDocument, plan: MeshPlan, target_sets: Sequence[AnySet], *, draft: bool = False
) -> None:
    """Write the drives into the node's extras, enough to play the effects in a clip that was never baked.

    `tools` and `folds` hold drives, as module `drive.drive` describes them. `undriven` are targets that no drive sets:
    those that are projected in each frame, and those that contact has for one clip alone. `draft` is there if it was
    one: not proven, and less refined. `parts` is there if the mesh was split: the names of the nodes with the rest of
    it, of whose morph targets those of one name must have the same weight.
    """
    rig = plan.rig
    node = edited.gltf["nodes"][rig.node]
    if not isinstance(node.setdefault("extras", {}), dict):
        return
    undriven = [
        target.name
        for target in targets_of(
            [
                *(each for each in of_tools(target_sets) if not each.from_skin),
                *(each for each in of_folds(target_sets) if each.clip is not None),
            ]
        )
    ]
    tools = [_tool_drive(each) for each in of_tools(target_sets) if each.from_skin]
    folds = [_fold_drive(each, target_sets, plan) for each in of_folds(target_sets) if each.clip is None]
    node["extras"]["wrinkle"] = {
        "method": METHOD,
        **({"draft": True} if draft else {}),
        "tools": [each.to_json(rig.names, rig.morph_names) for each in tools],
        **({"folds": [each.to_json(rig.names, rig.morph_names) for each in folds]} if folds else {}),
        **({"undriven": undriven} if undriven else {}),
    }


def _names(target_sets: Sequence[AnySet]) -> tuple[str, ...]:
    return tuple(target.name for target in targets_of(target_sets))


def _tool_drive(target_set: TargetSet) -> Drive:
    patch = target_set.carried.patch
    rest = patch.segment.rest_length
    response = _curve_table(target_set) if rest.keys or rest.morph else _table(target_set)
    strengths = {clip: each / patch.shape_strength for clip, each in patch.tool.clips.items()}
    return Drive(patch.tool.name, patch.segment, _names([target_set]), response, patch.tool.lag, strengths)


def _fold_drive(found: CreaseSet, target_sets: Sequence[AnySet], plan: MeshPlan) -> Drive:
    """Weights of contact by its joint's angle; of a fold that no joint bends, by its tool's shortening."""
    crease, hinge = found.crease, found.crease.fold.hinge
    weights = found.written(found.shape_weights(crease.table))
    if isinstance(hinge, Hinge):
        same = [each for each in of_folds(target_sets) if each.clip is not None and each.crease.fold is crease.fold]
        return Drive("", hinge.signal, _names([found]), Table("angles", crease.rows, weights), own=_names(same))
    # The tool as it was baked: for its sweep the fold has one whose rest length has other keys.
    patch = plan.carried_patches[crease.fold.tools[0]].patch
    strengths = {clip: each / patch.shape_strength for clip, each in patch.tool.clips.items()}
    table = Table("shortenings", crease.rows, weights)
    return Drive(patch.tool.name, patch.segment, _names([found]), table, patch.tool.lag, strengths)


def _table(target_set: TargetSet) -> Table:
    rows, weights = tabulate_weights(
        target_set.carried.patch.curve, lambda each: target_set.written(target_set.shape_weights(each))
    )
    return Table("shortenings", rows, weights)


def _curve_table(target_set: TargetSet) -> CurveTable:
    """The control curve for all rest lengths that keys or a morph target give it."""
    patch, remix = target_set.carried.patch, target_set.remix
    rest = patch.segment.rest_length
    keyed = [length for keys in rest.keys.values() for length in keys[:, 1].tolist()]
    lengths = [patch.span, *keyed, *([rest.morph[1]] if rest.morph else [])]
    mix = np.eye(patch.curve.greatest_amplitudes.size) if remix is None else remix.signed_mix
    positive = remix is not None and bool(remix.split)
    table = tabulate_curve(patch.curve, min(lengths), max(lengths), mix=target_set.written(mix).T, positive=positive)
    return replace(table, least=remix.least if remix is not None else 0.0)
