"""What an engine can play: morph targets, weights and joints held to its limits, or the bake refused.

Only what wrinkles add is changed, and only where a limit is exceeded; what the asset itself exceeds is refused
or, where it is not ours to judge, reported.

Sources:
    spec8: glTF 2.0 §3.7.2.2, "client implementations SHOULD support at least eight morphed attributes"; more
        targets may be stored, as long as no more than eight have a weight other than 0 at a time. Read as
        targets, as engines count them (each takes a POSITION, and a NORMAL where there is one).
    three: three.js r187, `WebGLMorphtargets`: one layer of a float RGBA texture array for each target, of which
        OpenGL ES 3.0 (and so WebGL 2) promises 256 (MAX_ARRAY_TEXTURE_LAYERS); `GLTFLoader` reads JOINTS_0 alone
        (issue 26137), `SkinnedMesh.normalizeSkinWeights` makes its weights sum to 1.
    unity: weights of blend shapes go from 0 to 100 and are clamped there, unless a project turns that off (Player
        settings, *Clamp BlendShapes*). Their number is not limited.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from wrinklecli.deform import Shape, weight_table
from wrinklecli.document import Document
from wrinklecli.errors import RefusedError
from wrinklecli.plan import Basis, Motion, Plan, Target, poses_of, targets_of
from wrinklecli.pose import Clip, blend, morph_weights, transform
from wrinklecli.surface import dense_influences, read_vertices
from wrinklecli.tracks import widen

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Json = dict[str, Any]
Engine = Literal["three", "unity", "spec8"]

# Share of the error bound that fewer shapes may take, as for `attachment: patch`.
_REDUCTION_SHARE = 0.25
# Bytes of a texel of four floats, of which three.js keeps one for each vertex, target and attribute.
_TEXEL_BYTES = 16


@dataclass(frozen=True, slots=True)
class Budget:
    """Limits of an engine; None for none.

    Attributes:
        targets: Morph targets of a mesh, the asset's own among them.
        active: Those of a weight other than 0 at a time.
        influences: Joints of a vertex, all in JOINTS_0.
        unit_weights: Whether weights must be from 0 to 1.
    """

    targets: int | None = None
    active: int | None = None
    influences: int | None = None
    unit_weights: bool = False


BUDGETS: dict[Engine, Budget] = {
    "three": Budget(targets=256, influences=4),
    "unity": Budget(unit_weights=True),
    "spec8": Budget(active=8),
}


def texture_bytes(plan: Plan, targets: int) -> int:
    """GPU memory that three.js takes for a mesh's targets, old and new, sparse or not.

    It is targets x vertices x attributes (POSITION, and NORMAL where there is one) x 16 bytes, a texture row's
    padding left out. Source: three.js r187, `WebGLMorphtargets`.
    """
    attributes = 2 if plan.has_normals else 1
    return targets * len(plan.fine.weld) * attributes * _TEXEL_BYTES


def fit_budget(
    document: Document, plan: Plan, bases: list[Basis], motions: list[Motion], clips: Sequence[Clip], engine: Engine
) -> tuple[list[Basis], list[Motion], Json]:
    """Hold a mesh's morph targets to what an engine plays.

    Weights outside 0 to 1 cost nothing: a shape that is scaled, and one that goes on with its negative, play
    the same at all times. Too many targets are reduced, tool by tool, to the fewest that give all heights over the
    tool's whole range of shortenings within a quarter of the error bound, whatever the clips do.

    Args:
        document: The source.
        plan: The tools on a mesh.
        bases: Their targets.
        motions: Clips that are baked.
        clips: All clips, whose poses judge joints.
        engine: Whose limits.

    Returns:
        What to write in place of the bases and motions, and what was found, for the report.

    Raises:
        RefusedError: A limit cannot be held within the error bound.
    """
    budget = BUDGETS[engine]
    name = str(plan.rig.names[plan.rig.node])
    found: Json = {"node": name, "reduced": []}
    if budget.influences is not None:
        found.update(_judge_influences(document, plan, clips, budget.influences, engine))
    if budget.unit_weights:
        bases = [_positive(basis) for basis in bases]
        motions = _remade(bases, motions)
        found["least_weight"] = min((float(each.weights.min(initial=0.0)) for each in motions), default=0.0)
        found["greatest_weight"] = max((float(each.weights.max(initial=0.0)) for each in motions), default=0.0)
        found["least_weight_of_asset"] = min(
            (float(morph_weights(plan.rig, each.clip, each.times).min(initial=0.0)) for each in motions), default=0.0
        )
    if _excess(plan, bases, motions, budget):
        fewer = [_reduced(basis, _REDUCTION_SHARE * plan.max_error) for basis in bases]
        for old, (basis, error) in zip(bases, fewer, strict=True):
            if basis is not old:
                before, after = len(targets_of([old])), len(targets_of([basis]))
                tool = basis.carrier.patch.tool.name
                found["reduced"].append({"tool": tool, "from": before, "to": after, "error": float(f"{error:.3e}")})
        bases = [basis for basis, _ in fewer]
        motions = _remade(bases, motions)
    excess = _excess(plan, bases, motions, budget)
    if excess:
        raise RefusedError(
            f"{excess}; --engine {engine} allows {budget.targets or budget.active}. Fewer bumps,"
            " `strategy: everywhere`, fewer tools on this mesh or a larger --max-error would help",
            where=name,
        )
    found["targets"] = len(plan.rig.morph_names) + len(targets_of(bases))
    found["active"] = max((_active(plan, motion)[0] for motion in motions), default=0)
    return bases, motions, found


def _excess(plan: Plan, bases: Sequence[Basis], motions: Sequence[Motion], budget: Budget) -> str:
    """What exceeds the limits on targets; empty where they hold."""
    own = len(plan.rig.morph_names)
    count = own + len(targets_of(bases))
    if budget.targets is not None and count > budget.targets:
        return f"has {count} morph targets, {own} of them the asset's own"
    if budget.active is not None:
        for motion in motions:
            active, time = _active(plan, motion)
            if active > budget.active:
                return f"needs {active} morph targets at once in {motion.clip.name} at {time:.3g} s"
    return ""


def _active(plan: Plan, motion: Motion) -> tuple[int, float]:
    """Most targets with a weight other than 0 at a time, at and between keys, and that time in seconds."""
    channel = motion.clip.channel(plan.rig.node, "weights")
    track = widen(channel, plan.rig, motion.clip, motion.times[motion.keys], motion.weights[motion.keys])
    values = track.values.astype(np.float32).reshape(len(track.times), -1, track.values.shape[-1])
    shown: Bools = np.any(values != 0, axis=1)
    # Between two keys, whatever either shows.
    counts = np.sum(shown[:-1] | shown[1:] if len(shown) > 1 else shown, axis=1)
    worst = int(np.argmax(counts))
    return int(counts[worst]), float(track.times[worst : worst + 2].mean())


def _judge_influences(document: Document, plan: Plan, clips: Sequence[Clip], limit: int, engine: Engine) -> Json:
    """How many of the asset's own vertices lose joints beyond JOINTS_0, and how far off that puts them.

    Raises:
        RefusedError: Further than the error bound: the asset's own weights are kept as they are.
    """
    rig = plan.rig
    if not rig.skinned:
        return {"vertices_over_influences": 0, "influence_error": 0.0}
    stored = read_vertices(document, rig)
    whole = dense_influences(stored.joints, stored.weights, len(rig.joints))
    first = np.zeros_like(whole)
    start = 0
    for primitive in document.items("meshes")[rig.mesh]["primitives"]:
        joints, weights = (document.accessor(primitive["attributes"][key]) for key in ("JOINTS_0", "WEIGHTS_0"))
        rows = start + np.arange(len(joints))
        for column in range(joints.shape[1]):
            first[rows, joints[:, column].astype(np.intp)] += weights[:, column]
        start += len(joints)
    kept = first.sum(axis=1, keepdims=True)
    over = np.flatnonzero(((whole > 0) & (first == 0)).any(axis=1))
    first /= np.where(kept > 0, kept, 1.0)
    error = 0.0
    for pose in poses_of(rig, clips) if len(over) else []:
        want, got = (transform(blend(each[over], pose[None]), stored.positions[over]) for each in (whole, first))
        error = max(error, float(np.sqrt(np.sum((got - want) ** 2, axis=2)).max()))
    if error > plan.max_error:
        raise RefusedError(
            f"has {len(over)} vertices of more than {limit} joints, which --engine {engine} would put off by"
            f" {error:.3g}; --max-error allows {plan.max_error:.3g}. Limit the asset to {limit} joints a vertex",
            where=str(rig.names[rig.node]),
        )
    return {"vertices_over_influences": len(over), "influence_error": float(f"{error:.3e}")}


def _remade(bases: Sequence[Basis], motions: Sequence[Motion]) -> list[Motion]:
    made = []
    for index, motion in enumerate(motions):
        columns = [basis.written(basis.weights[index]) for basis in bases]
        made.append(replace(motion, weights=np.concatenate(columns, axis=1)))
    return made


def _path(basis: Basis) -> Floats:
    """(rows, shapes) weights that a tool's targets take: over all shortenings, or as sampled where it has no curve."""
    if not basis.from_skin:
        return np.concatenate(basis.weights) if basis.weights else np.zeros((0, len(basis.targets)))
    table = basis.of_curve(weight_table(basis.carrier.patch.curve)[1])
    tool, strength = basis.carrier.patch.tool, basis.carrier.patch.shape_strength
    factors = [1.0, *(each / strength for each in tool.clips.values())] if strength else [1.0]
    return np.concatenate([factor * table for factor in factors])


def _positive(basis: Basis) -> Basis:
    """The same motion with weights from 0 to 1: shapes scaled, and those of negative weights gone on with."""
    path = _path(basis)
    peaks = np.maximum(np.abs(path).max(axis=0, initial=0.0), 1.0)
    negative: Bools = np.any(path < 0, axis=0)
    split = tuple(column for column, target in enumerate(basis.targets) if target is not None and negative[column])
    if not split and (peaks == 1.0).all():
        return basis
    shapes = [
        None if each is None else _sum([each.shape], np.array([peak]))
        for each, peak in zip(basis.targets, peaks, strict=True)
    ]
    negated = [_sum([shape], np.array([-1.0])) for shape in (shapes[column] for column in split) if shape is not None]
    return _rebased(basis, [*shapes, *negated], np.diag(1.0 / peaks), split)


def _reduced(basis: Basis, tolerance: float) -> tuple[Basis, float]:
    """A tool's fewest targets that give all heights within a tolerance, and their error; scene units.

    All shapes of a tool together: full bumps of a polyline with details still change a little, all alike. (Each
    group of bumps by itself: 19 targets at once instead of 12 for five bumps from the origin.)

    Source: C. Eckart, G. Young, *The approximation of one matrix by another of lower rank*, 1936. Differs: the
    error is the greatest over bumps, which lie side by side, and rows of the table, of the sum over modes.
    """
    written = [column for column, target in enumerate(basis.targets) if target is not None]
    if not basis.from_skin or len(written) < 2:
        return basis, 0.0
    old = [target.shape for target in basis.targets if target is not None]
    heights = np.array([shape.tallest for shape in old])
    path = _path(basis)[:, written] * heights
    groups = np.array(written) // basis.carrier.patch.curve.greatest_amplitudes.shape[1]
    starts = np.flatnonzero(np.diff(groups, prepend=-1))
    _, _, right = np.linalg.svd(path, full_matrices=False)
    for rank in range(1, len(written)):
        axes = right[:rank]
        missed = np.abs(path - path @ axes.T @ axes)
        error = float(np.add.reduceat(missed, starts, axis=1).max())
        if error > tolerance:
            continue
        weights = path @ axes.T
        peaks = weights[np.argmax(np.abs(weights), axis=0), np.arange(rank)]
        mix = np.zeros((len(basis.targets), rank))
        mix[written] = heights[:, None] * axes.T / peaks
        return _rebased(basis, [_sum(old, row) for row in axes * peaks[:, None] / heights], mix, ()), error
    return basis, 0.0


def _rebased(basis: Basis, shapes: Sequence[Shape | None], mix: Floats, split: tuple[int, ...]) -> Basis:
    """A tool on other shapes: its old weights times `mix`, the negative ones of some columns apart."""
    identifier = basis.carrier.patch.tool.identifier
    numbers = np.cumsum([shape is not None for shape in shapes])
    targets = tuple(
        None if shape is None else Target(f"wrinkle_{identifier}_{number}", shape)
        for shape, number in zip(shapes, numbers, strict=True)
    )
    whole = mix if basis.mix is None else basis.mix @ mix
    made = replace(basis, targets=targets, mix=whole, split=split)
    return replace(made, weights=tuple(made.parted(weights @ mix) for weights in basis.weights))


def _sum(shapes: Sequence[Shape], factors: Floats) -> Shape:
    """A weighted sum of shapes."""
    summed = []
    for each in ([(s.vertices, s.deltas) for s in shapes], [(s.normal_vertices, s.normal_deltas) for s in shapes]):
        vertices = np.unique(np.concatenate([where for where, _ in each]))
        deltas = np.zeros((len(vertices), 3))
        for factor, (where, values) in zip(factors, each, strict=True):
            deltas[np.searchsorted(vertices, where)] += factor * values
        summed.append((vertices, deltas))
    (vertices, deltas), (normal_vertices, normal_deltas) = summed
    scale = max(shape.tallest / _longest(shape.deltas) for shape in shapes)
    tallest = scale * _longest(deltas)
    return Shape(vertices, deltas, tallest, normal_vertices, normal_deltas)


def _longest(deltas: Floats) -> float:
    return float(np.sqrt(np.sum(deltas**2, axis=1)).max())
