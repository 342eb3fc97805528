"""Extras of a baked node: its tools' anchors and tables of weights as JSON, for players of clips never baked."""

from collections.abc import Sequence

import numpy as np

from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.targets import AnySet, CreaseSet, TargetSet, of_folds, of_tools, targets_of
from wrinklecli.drive.lag import TAUT
from wrinklecli.effects.contact.hinge import Hinge
from wrinklecli.effects.wrinkle.lookup import tabulate_curve, tabulate_weights
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.surface.anchor import Anchor
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph

# Raised only when the geometry that the same asset and tools give changes.
METHOD = 3

# Decimal digits of numbers in extras: float32's own.
_DIGITS = 8
# Decimal digits of tabulated weights, whose rows are right to about three.
_TABLE_DIGITS = 5


def encode_extras(
    edited: EditedDocument, plan: MeshPlan, target_sets: Sequence[AnySet], *, draft: bool = False
) -> None:
    """Write the tools into the node's extras, enough to play wrinkles for a clip that was never baked.

    An engine poses the anchors, `origin` and `target` or all `anchors` of a path (the sum over joints of weight ·
    matrix · position, where the matrix is the joint's own, to world space: optimisers that quantise positions change
    bind space and inverse bind matrices, but not the joints), adds the distances of neighbours up, takes the animated
    scale out (divides by the mean over anchors of the sum over joints of weight · cbrt(det matrix) / scale), and finds
    the targets' `weights` at 1 - distance / rest_length, straight between the rows of `shortenings`, times the clip's
    factor in `strengths`, if it is there. Where the rest length changes, `curve` takes the place of these rows: see
    `CurveTable`. Where there is a `lag`, the distance is that which a damped
    spring follows: with d = max(`taut` - distance / rest_length, 0), x'' = ω² (d - x) - 2 ζ ω x', ω = 2π `frequency`
    and ζ = `damping`, it is (`taut` - max(x, 0)) · rest_length. A fold's targets, of `folds`, have the `weights` at the
    joint's angle, straight between the rows of `angles`, but 0 where any of `own` is not: these are targets of one
    clip alone, which solves the fold itself. The angle: the joint's turn against its parent, both by their matrices
    with scale taken out, from that of `rest` (x, y, z, w) is a matrix D, and with
    s = (D₃₂ - D₂₃, D₁₃ - D₃₁, D₂₁ - D₁₂) the angle is 2 atan2(`axis` · s, 1 + trace D). `vertices` counts those of
    each primitive before refinement; new ones follow them. `undriven` are targets of tools that anchors alone do not
    drive, and those that contact has for one clip alone; a fold that no joint bends stands in `folds` as a tool would,
    whose shortening its targets follow. `draft` is there if it was one: not proven, and less refined.
    `parts` is there where the mesh was split: the names of the nodes with the rest of it, of whose morph targets those
    of one name must have the same weight.
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
    shared = [each for each in of_folds(target_sets) if each.clip is None]
    hinged = [(each, each.crease.fold.hinge) for each in shared]
    folds = [
        _fold_json(each, hinge, target_sets, plan) if isinstance(hinge, Hinge) else _rise_json(each, plan)
        for each, hinge in hinged
    ]
    node["extras"]["wrinkle"] = {
        "method": METHOD,
        **({"draft": True} if draft else {}),
        "tools": [
            _tool_json(
                patch,
                plan,
                patch.tool.name,
                [target.name for target in targets_of([target_set])],
                _table_json(target_set) if _is_constant(patch) else _curve_json(target_set),
            )
            for target_set in of_tools(target_sets)
            if target_set.from_skin
            for patch in (target_set.carried.patch,)
        ],
        **({"folds": folds} if folds else {}),
        **({"undriven": undriven} if undriven else {}),
    }


def _is_constant(patch: Patch) -> bool:
    return not isinstance(patch.tool.rest_length, RestLengthKeys | RestLengthMorph)


def _driven_json(patch: Patch) -> Json:
    """What drives the rest length, where it is not constant; lengths in scene units, times in seconds."""
    wanted = patch.tool.rest_length
    if isinstance(wanted, RestLengthMorph):
        return {"rest_length_morph": {"name": wanted.morph, "full": _digits(wanted.full.resolve(patch.span))}}
    if isinstance(wanted, RestLengthKeys):
        keys = {
            clip: [[_digits(time), _digits(length.resolve(patch.span))] for time, length in keys]
            for clip, keys in wanted.keys.items()
        }
        return {"rest_length_keys": keys}
    return {}


def _tool_json(patch: Patch, plan: MeshPlan, name: str, targets: Sequence[str], table: Json) -> Json:
    """Some targets that follow a tool's segment, by a table."""
    return {
        "name": name,
        **_anchors_json(patch, plan),
        "rest_length": _digits(patch.rest_length),
        **_driven_json(patch),
        **_lag_json(patch),
        **_strengths_json(patch),
        "targets": list(targets),
        **table,
    }


def _rise_json(found: CreaseSet, plan: MeshPlan) -> Json:
    """A fold that no joint makes: its targets follow a tool's shortening, as those of the tool do."""
    # The tool as it was baked: for its sweep the fold has one whose rest length has other keys.
    patch = plan.carried_patches[found.crease.fold.tools[0]].patch
    table = _rows_json("shortenings", found)
    return _tool_json(patch, plan, patch.tool.name, [each.name for each in targets_of([found])], table)


def _rows_json(name: str, found: CreaseSet) -> Json:
    """Weights of contact, straight between rows of a name."""
    weights = found.written(found.shape_weights(found.crease.table))
    return {
        name: [_digits(each) for each in found.crease.rows],
        "weights": [[_digits(value, _TABLE_DIGITS) for value in row] for row in weights],
    }


def _fold_json(found: CreaseSet, hinge: Hinge, target_sets: Sequence[AnySet], plan: MeshPlan) -> Json:
    """Where contact moves a fold's targets: its joint, and weights by the angle of that."""
    crease, rig = found.crease, plan.rig
    parent = int(rig.parents[hinge.node])
    of_clips = [each for each in of_folds(target_sets) if each.clip is not None and each.crease.fold is crease.fold]
    own = [target.name for target in targets_of(of_clips)]
    return {
        "joint": rig.names[hinge.node],
        **({"parent": rig.names[parent]} if parent >= 0 else {}),
        "rest": [_digits(each) for each in hinge.rest],
        "axis": [_digits(each) for each in hinge.axis],
        "targets": [target.name for target in targets_of([found])],
        **({"own": own} if own else {}),
        **_rows_json("angles", found),
    }


def _lag_json(patch: Patch) -> Json:
    """The spring that the shortening passes, swings per second and the share of the damping that stops them."""
    lag = patch.tool.lag
    return {} if lag is None else {"lag": {"frequency": lag.frequency, "damping": lag.damping, "taut": TAUT}}


def _strengths_json(patch: Patch) -> Json:
    """Factors on the weights in the clips where the tool has a strength of its own."""
    factors = {name: _digits(strength / patch.shape_strength) for name, strength in patch.tool.clips.items()}
    return {"strengths": factors} if factors else {}


def _table_json(target_set: TargetSet) -> Json:
    rows, weights = tabulate_weights(
        target_set.carried.patch.curve, lambda each: target_set.written(target_set.shape_weights(each))
    )
    return {
        "shortenings": [_digits(value) for value in rows],
        "weights": [[_digits(value, _TABLE_DIGITS) for value in row] for row in weights],
    }


def _curve_json(target_set: TargetSet) -> Json:
    """The control curve for all rest lengths that keys or a morph target give it."""
    patch = target_set.carried.patch
    wanted = patch.tool.rest_length
    lengths = [patch.span]
    if isinstance(wanted, RestLengthMorph):
        lengths.append(wanted.full.resolve(patch.span))
    if isinstance(wanted, RestLengthKeys):
        lengths += [length.resolve(patch.span) for keys in wanted.keys.values() for _, length in keys]
    remix = target_set.remix
    mix = np.eye(patch.curve.greatest_amplitudes.size) if remix is None else remix.signed_mix
    positive = remix is not None and bool(remix.split)
    table = tabulate_curve(patch.curve, min(lengths), max(lengths), mix=target_set.written(mix).T, positive=positive)
    limited = {"distances": table.distances, "capacities": table.capacities} if len(table.distances) else {}
    return {
        "curve": {
            "taut": table.taut,
            **({"compressible": table.compressible} if table.compressible else {}),
            "intervals": table.intervals,
            "bumps": [_count(size) for size in table.bumps],
            **{key: [_digits(value) for value in values] for key, values in limited.items()},
            "parts": [_digits(value) for value in table.parts],
            "rises": [[_digits(value) for value in row] for row in table.rises],
            "mix": [[_digits(value) for value in row] for row in table.mix],
            **({"positive": True} if table.positive else {}),
            **({"least": _digits(remix.least)} if remix is not None and remix.least else {}),
        }
    }


def _anchors_json(patch: Patch, plan: MeshPlan) -> Json:
    """The anchors of a tool; those of a path under a key that a player of two does not look for."""
    anchors = [_anchor_json(anchor, plan) for anchor in patch.anchors]
    return dict(zip(("origin", "target"), anchors, strict=True)) if len(anchors) == 2 else {"anchors": anchors}


def _anchor_json(anchor: Anchor, plan: MeshPlan) -> Json:
    """An anchor in the spaces of its joints; `scales` are those of the joints at rest."""
    rig = plan.rig
    points = anchor.points[..., :3] / anchor.weights[:, None]
    binds, rest = rig.inverse_binds[anchor.joints, :3, :3], plan.rest.matrices[anchor.joints, :3, :3]
    before, bound = np.abs(np.linalg.det(rest)), np.abs(np.linalg.det(binds))
    scales = np.cbrt(np.where((before > 0) & (bound > 0), before, 1.0) / np.where(bound > 0, bound, 1.0))
    anchored: Json = {
        "joints": [rig.names[int(rig.joints[joint])] for joint in anchor.joints],
        "weights": [_digits(weight) for weight in anchor.weights],
        "positions": [[_digits(x) for x in point] for point in points[0]],
        "scales": [_digits(scale) for scale in scales],
    }
    if points[1:].any():
        anchored["morphs"] = {
            name: [[_digits(x) for x in point] for point in deltas]
            for name, deltas in zip(rig.morph_names, points[1:], strict=True)
            if deltas.any()
        }
    return anchored


def _count(size: float) -> float:
    """A number of bumps: whole where all are equally wide."""
    return int(size) if size.is_integer() else _digits(size)


def _digits(value: float, digits: int = _DIGITS) -> float:
    return float(f"{value:.{digits}g}")
