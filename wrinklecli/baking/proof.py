"""The written file, evaluated again as an engine would, against the method's own result."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.refined_mesh import RefinedPrimitive, primitives_of, shared_vertices
from wrinklecli.baking.sample import Motion, takes_of
from wrinklecli.baking.targets import AnySet, CreaseSet, of_folds, of_tools, targets_of
from wrinklecli.character.clip import KEY_GAP, Clip, read_clips
from wrinklecli.character.pose import Pose, joint_matrices, morph_weights, pose_at
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.character.skin import pose, prepare
from wrinklecli.character.sparse_targets import SparseDeltas, Targets, read_sparse_deltas
from wrinklecli.character.surface import dense_influences, read_vertices
from wrinklecli.effects.wrinkle.activity import Activity, further_activities
from wrinklecli.effects.wrinkle.carry import CarriedPatch, displacements
from wrinklecli.effects.wrinkle.shapes import displaced_normals, turn_to
from wrinklecli.errors import RefusedError
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, interpolated, runs, unit
from wrinklecli.numeric.guard import Progress
from wrinklecli.surface.refine import Refinement

# Frames of a clip at which whole members are compared, besides its tallest and most folded.
_FRAMES = 64
# Frames at which normals are compared, which takes several times as long: of all clips together, and of each at least.
_NORMAL_FRAMES = 128
_LEAST_NORMAL_FRAMES = 4
# The keys of each tool at which its track bends most.
_BENDS = 4
# Frames posed at once: more where they have fewer vertices than the one, fewer where they have more than the other.
_CHUNK = 16
_FEW_VERTICES = 2**15
_MOST_VERTICES = 2**20


@dataclass(frozen=True, slots=True)
class Residual:
    """How far the file is from the method in one clip.

    Attributes:
        position: Largest distance of a vertex, scene units.
        time: When that is, seconds.
        weights: Largest error of a tool's height, or of what a shape of contact moves, at all frames sampled and
            between them, scene units; not where two are too close for another one (see `KEY_GAP`).
        normal: 99th percentile of the angle between the file's and the true normals, degrees; None where
            the mesh has none.
    """

    position: float
    time: float
    weights: float
    normal: float | None


@dataclass(frozen=True, slots=True)
class Proof:
    """The file's side of the comparison: what an engine loads for one mesh, at the vertices to compare.

    Attributes:
        rig: Of the written node.
        clips: Of the written file.
        vertices: (vertices,) fine welded vertex of each.
        method: What the bumps of all skin-attached tools add to the vertices, group by group and mode by mode.
        creases: What the shapes of all folds add to the vertices.
        moved: Of each tool, the vertices here that it moves, and the number of each among those of the tool.
        positions: (vertices, 3) as stored.
        deltas: (old targets, vertices, 3) as stored.
        added: Of each new target, as stored.
        weights: (vertices, joints) as stored, normalised.
        normals: (vertices, 3) as stored, and NORMAL deltas of each new target; None without NORMAL.
    """

    rig: Rig
    clips: tuple[Clip, ...]
    vertices: Ints
    method: Targets
    creases: Targets
    moved: list[tuple[Ints, Ints]]
    positions: Floats
    deltas: Floats
    added: Targets
    weights: Floats
    normals: tuple[Floats, Targets] | None


def prove(
    edited: EditedDocument,
    plan: MeshPlan,
    target_sets: Sequence[AnySet],
    motions: Sequence[Motion],
    *,
    details: bool,
    progress: Progress,
) -> dict[str, Residual]:
    """Play the edited document as an engine would and compare it with the method, clip by clip.

    Raises:
        RefusedError: A vertex is further off than the plan's bound.
    """
    proof = read_back(edited, plan, of_folds(target_sets))
    written = {clip.index: clip for clip in proof.clips}
    residuals: dict[str, Residual] = {}
    proven: dict[int, tuple[Clip, Residual]] = {}
    takes = takes_of(plan, [motion.clip for motion in motions])
    normal_frames = max(_NORMAL_FRAMES // max(len(set(takes)), 1), _LEAST_NORMAL_FRAMES) if details else 0
    for done, (motion, take) in enumerate(zip(motions, takes, strict=True), start=1):
        clip = written[motion.clip.index]
        # The same in the source and in the file as a clip before it.
        if take not in proven or not clip.moves_as(proven[take][0]):
            proven[take] = clip, measure_residual(proof, plan, target_sets, motion, clip, normal_frames=normal_frames)
        residual = proven[take][1]
        _refuse_beyond_bound(plan, motion, residual)
        residuals[motion.clip.name] = residual
        progress("proof", done, len(motions))
    return residuals


def _refuse_beyond_bound(plan: MeshPlan, motion: Motion, residual: Residual) -> None:
    worst = max(residual.position, residual.weights)
    if worst > plan.max_error:
        share = 100 * worst / plan.tallest
        when = f" at {residual.time:.3g} s" if worst == residual.position else ""
        raise RefusedError(
            f"the file would be off by {worst:.3g} ({share:.2g} % of the tallest wrinkle){when};"
            f" --max-error allows {plan.max_error:.3g}",
            where=motion.clip.name,
        )


def read_back(edited: EditedDocument, plan: MeshPlan, folds: Sequence[CreaseSet] = ()) -> Proof:
    """Load what the file says of the vertices that wrinkles or refinement touch."""
    fine = plan.fine
    refined_primitives = primitives_of(fine, shared_vertices(edited.source, plan.rig.mesh, fine))
    written = edited.document()
    rig = read_rig(written, plan.rig.node)
    primitives, old = written.items("meshes")[rig.mesh]["primitives"], len(fine.morph_deltas)
    distinct = _distinct(primitives, refined_primitives)
    stored = read_vertices(written, rig, distinct, targets=old)

    def new_deltas(name: str) -> list[SparseDeltas]:
        where = written.where("meshes", rig.mesh)
        chosen = [primitives[number] for number in distinct]
        return read_sparse_deltas(written, chosen, stored.starts, name, first=old, where=where)

    welds = np.concatenate([refined_primitives[number].weld for number in distinct])
    touched = np.zeros(len(fine.positions), bool)
    touched[len(fine.surface.positions) :] = True
    for carried in plan.carried_patches:
        touched[carried.vertices] = True
    compared = touched[welds]
    moving = new_deltas("POSITION")
    # A vertex that a new target moves is compared even if no tool asked for it.
    for target in moving:
        compared[target.vertices] = True
    chosen = np.flatnonzero(compared)
    rows = np.where(compared, np.cumsum(compared) - 1, -1)
    dense = dense_influences(stored.joints[chosen], stored.weights[chosen], len(rig.joints))
    normals = None
    if stored.normals is not None:
        turning = [target.of_rows(rows) for target in new_deltas("NORMAL")]
        normals = stored.normals[chosen], Targets(tuple(turning), len(chosen))
    moved = [_found_in(welds[chosen], carried.vertices) for carried in plan.carried_patches]
    shapes = [shape for each, at in zip(plan.carried_patches, moved, strict=True) for shape in _shapes(each, *at)]
    return Proof(
        rig,
        read_clips(written),
        welds[chosen],
        Targets(tuple(shapes), len(chosen)),
        Targets(tuple(shape for each in folds for shape in _crease_shapes(each, welds[chosen])), len(chosen)),
        moved,
        stored.positions[chosen],
        stored.morph_deltas[:, chosen],
        Targets(tuple(target.of_rows(rows) for target in moving), len(chosen)),
        dense,
        normals,
    )


def _found_in(vertices: Ints, wanted: Ints) -> tuple[Ints, Ints]:
    """(n,) which of (vertices,) are any of (wanted,) rising ones, and (n,) which of these each is."""
    order = np.argsort(vertices, kind="stable")
    firsts, ends = (np.searchsorted(vertices, wanted, side, order) for side in ("left", "right"))
    return order[runs(firsts, ends - firsts)], np.repeat(np.arange(len(wanted)), ends - firsts)


def _shapes(carried: CarriedPatch, rows: Ints, numbers: Ints) -> Iterator[SparseDeltas]:
    """What each mode of each group of a tool adds, at amplitude 1, to (n,) rows: its vertices of (n,) numbers."""
    if carried.ring is None:
        curves = carried.shapes(numbers)
        for heights in curves.reshape(-1, len(numbers)):
            yield SparseDeltas(rows, heights[:, None] * carried.directions[numbers])


def _crease_shapes(found: CreaseSet, vertices: Ints) -> Iterator[SparseDeltas]:
    """What each shape of a fold adds, at weight 1, to those of (vertices,) that it moves."""
    rows, numbers = _found_in(vertices, found.crease.vertices)
    for shape in found.crease.shapes:
        yield SparseDeltas(rows, shape[numbers])


def _distinct(primitives: Sequence[Json], refined_primitives: Sequence[RefinedPrimitive]) -> list[int]:
    """The primitives without those that have the accessors of one before, and so the same vertices."""
    seen: dict[str, Ints] = {}
    distinct = []
    for number, (primitive, refined) in enumerate(zip(primitives, refined_primitives, strict=True)):
        key = repr([sorted(primitive["attributes"].items()), primitive.get("targets")])
        if key not in seen or not np.array_equal(seen[key], refined.weld):
            distinct.append(number)
        seen.setdefault(key, refined.weld)
    return distinct


def measure_residual(
    proof: Proof,
    plan: MeshPlan,
    target_sets: Sequence[AnySet],
    motion: Motion,
    written: Clip,
    *,
    normal_frames: int,
) -> Residual:
    """Compare the file with the method in one clip, at and between its keys.

    Args:
        proof: The file's side.
        plan: The method's; skin weights of its refined surface are not pruned.
        target_sets: All tools.
        motion: The clip as it was in the source, and the times at which it was sampled.
        written: The clip as it is in the file.
        normal_frames: At most so many frames in which a tool acts have their normals compared too.
    """
    patches = [carried.patch for carried in plan.carried_patches]
    times = _all_times(motion.times)
    seen = further_activities(patches, plan.rig, motion.clip, times, known=motion.seen, known_at=motion.times)
    creased = _crease_weights(target_sets, motion, times)
    chosen = _chosen_times(times, seen, creased)
    amplitudes = [each.amplitudes[chosen] for each in seen]
    acting = np.flatnonzero(np.any([each.any(axis=(1, 2)) for each in amplitudes], axis=0))
    shaded = acting[distinct_values(np.linspace(0, len(acting) - 1, min(normal_frames, len(acting))).astype(int))]
    position, time, angles = _vertex_errors(
        proof, plan, motion.clip, written, times[chosen], amplitudes, creased[chosen], shaded
    )
    normal = None
    if normal_frames and proof.normals is not None:
        normal = float(np.percentile(angles, 99)) if len(angles) else 0.0
    weights = _height_error(proof, written, motion.clip, times, target_sets, seen)
    weights = max(weights, _crease_error(proof, plan, written, times, target_sets, creased))
    return Residual(position, time, weights, normal)


def _crease_weights(target_sets: Sequence[AnySet], motion: Motion, times: Floats) -> Floats:
    """(times, shapes) weights of the shapes of all folds, which are straight between those sampled."""
    sampled = [
        weights for each, weights in zip(target_sets, motion.weights, strict=True) if isinstance(each, CreaseSet)
    ]
    return interpolated(times, motion.times, np.concatenate([np.zeros((len(motion.times), 0)), *sampled], axis=1))


def _vertex_errors(
    proof: Proof,
    plan: MeshPlan,
    clip: Clip,
    written: Clip,
    times: Floats,
    amplitudes: Sequence[Floats],
    creased: Floats,
    shaded: Ints,
) -> tuple[float, float, Floats]:
    """The largest distance of a vertex, when that is, and the angles of normals in degrees at the times `shaded`."""
    rig, fine = plan.rig, plan.fine
    weights = fine.dense_weights(proof.vertices, len(rig.joints))
    acting, stored = np.flatnonzero(weights.any(axis=0)), np.flatnonzero(proof.weights.any(axis=0))
    method = prepare(weights[:, acting], fine.positions[proof.vertices], fine.morph_deltas[:, proof.vertices])
    file = prepare(proof.weights[:, stored], proof.positions, proof.deltas)
    count = max(len(proof.vertices), 1)
    chunk = min(max(_FEW_VERTICES // count, _CHUNK), max(_MOST_VERTICES // count, 1))
    worst, worst_time, angles = 0.0, float(times[0]), [np.zeros(0)]
    for frames in (slice(k, k + chunk) for k in range(0, len(times), chunk)):
        now = times[frames]
        moved = _method_displacements(proof, plan, clip, now, [each[frames] for each in amplitudes])
        moved += proof.creases.added(creased[frames])
        matrices = joint_matrices(rig, clip, now, acting)
        wanted, _ = pose(method, matrices, morph_weights(rig, clip, now), moved)
        played = morph_weights(proof.rig, written, now)
        new = proof.added.added(played[:, len(proof.deltas) :])
        got, _ = pose(file, joint_matrices(proof.rig, written, now, stored), played[:, : len(proof.deltas)], new)
        distances = np.sqrt(np.sum((got - wanted) ** 2, axis=1)).max(axis=1, initial=0.0)
        frame = int(distances.argmax())
        if distances[frame] > worst:
            worst, worst_time = float(distances[frame]), float(now[frame])
        at = shaded[(shaded >= frames.start) & (shaded < frames.stop)] - frames.start
        if len(at) and proof.normals is not None:
            poses = [pose_at(rig, clip, time) for time in now[at].tolist()]
            angles.append(_normal_angles(proof.normals, proof.vertices, fine, moved[at], played[at], poses))
    return worst, worst_time, np.concatenate(angles)


def _all_times(times: Floats) -> Floats:
    """(times,) every frame and two points between each two, seconds, as an engine's float32 clock shows them.

    None between frames that are too close for another one (see `KEY_GAP`): no player shows what is there.
    """
    gaps = np.diff(times)
    wide = gaps >= 2.0 * KEY_GAP
    between = (times[:-1][wide, None] + np.array([0.25, 0.5]) * gaps[wide, None]).reshape(-1)
    return distinct_values(np.concatenate([times, between.astype(np.float32).astype(np.float64)]))


def _height_error(
    proof: Proof,
    written: Clip,
    clip: Clip,
    times: Floats,
    target_sets: Sequence[AnySet],
    seen: Sequence[Activity],
) -> float:
    """Largest error of an amplitude that the played weights stand for, scene units; skin-attached tools only."""
    played = morph_weights(proof.rig, written, times)
    # By place, not by name: a mesh whose extras are no object stores none.
    after = len(proof.rig.morph_names) - len(targets_of(target_sets))
    worst = 0.0
    for target_set, what in zip(of_tools(target_sets), seen, strict=True):
        patch = target_set.carried.patch
        columns = target_set.columns
        got = played[:, after : after + len(columns)]
        after += len(columns)
        if not target_set.from_skin:
            continue
        shown = columns
        if target_set.remix is not None:
            # An engine's budget asked for other shapes: what they are of the curve's.
            share = target_set.remix.unmix[columns]
            shown = np.flatnonzero(share.any(axis=0))
            got = got @ share[:, shown]
        greatest, wanted = patch.curve.greatest_amplitudes.reshape(-1), what.amplitudes.reshape(len(times), -1)
        for column, number in zip(got.T, shown, strict=True):
            error = column * greatest[number] - patch.clip_strength(clip) * wanted[:, number]
            worst = max(worst, float(np.abs(error).max(initial=0.0)) * abs(patch.shape_strength))
    return worst


def _crease_error(
    proof: Proof, plan: MeshPlan, written: Clip, times: Floats, target_sets: Sequence[AnySet], creased: Floats
) -> float:
    """Largest error of what the played weights of a fold's shape move, of (times, shapes) of all folds, scene units."""
    played = morph_weights(proof.rig, written, times)
    after = len(proof.rig.morph_names) - len(targets_of(of_folds(target_sets)))
    first, worst = 0, 0.0
    for found in of_folds(target_sets):
        columns, shapes = found.columns, len(found.crease.shapes)
        made = played[:, after : after + len(columns)] @ found.lift.unmix[columns]
        errors = np.abs(made - creased[:, first : first + shapes]) * (plan.scale * found.crease.sizes)
        worst = max(worst, float(errors.max(initial=0.0)))
        after, first = after + len(columns), first + shapes
    return worst


def _chosen_times(every: Floats, seen: Sequence[Activity], creased: Floats) -> Ints:
    """Which times to compare at, rising: an even choice, each tool's tallest and shortest, and where tracks bend.

    Of the shapes of folds, whose weights are (times, shapes), those at which each is greatest.
    """
    picked = set(np.linspace(0, len(every) - 1, min(_FRAMES, len(every))).astype(int).tolist())
    picked.update(np.argmax(np.abs(creased), axis=0).tolist())
    for each in seen:
        sizes = np.abs(each.amplitudes)
        picked.add(int(np.argmax(sizes)) // sizes[0].size)
        picked.add(int(np.argmax(each.shortenings)))
        # The straight line through the neighbours misses most here.
        tall = np.einsum("fgm->f", sizes)
        bend = np.abs(tall[2:] - 2 * tall[1:-1] + tall[:-2])
        picked.update((1 + np.argsort(-bend, kind="stable")[:_BENDS]).tolist())
    return np.array(sorted(picked), np.intp)


def _method_displacements(
    proof: Proof, plan: MeshPlan, clip: Clip, times: Floats, amplitudes: Sequence[Floats]
) -> Floats:
    """(frames, 3, vertices) sum of all tools, at the vertices compared, bind space."""
    weights = [np.zeros((len(times), 0))]
    for carried, each in zip(plan.carried_patches, amplitudes, strict=True):
        if carried.ring is None:
            weights.append(carried.patch.clip_strength(clip) * each.reshape(len(times), -1))
    total = proof.method.added(np.concatenate(weights, axis=1))
    for carried, each, (rows, numbers) in zip(plan.carried_patches, amplitudes, proof.moved, strict=True):
        if carried.ring is not None:
            moved = displacements(carried, plan.fine, plan.rig, clip, times, each)
            total[:, :, rows] += moved.transpose(0, 2, 1)[:, :, numbers]
    return total


def _normal_angles(
    normals: tuple[Floats, Targets],
    compared: Ints,
    fine: Refinement,
    moved: Floats,
    played: Floats,
    poses: Sequence[Pose],
) -> Floats:
    """(frames · vertices,) degrees between the file's normals and those that each pose asks for, where they change.

    Those of the wrinkles alone: what the source's own morph targets do to normals is theirs.
    """
    base, deltas = normals
    turned = deltas.added(played[:, len(fine.morph_deltas) :]).transpose(0, 2, 1)
    moved = moved.transpose(0, 2, 1)
    vertices, first = np.unique(compared, return_index=True)
    touched, true = displaced_normals(fine, vertices, moved[:, first], poses)
    rows = np.searchsorted(touched, compared)
    angles = []
    for frame in range(len(moved)):
        wanted = turn_to(fine.normals[compared], unit(base), true[frame, rows])
        got = unit(base + turned[frame])
        changed = moved[frame].any(axis=1)
        cosine = np.clip(np.sum(wanted * got, axis=1)[changed], -1.0, 1.0)
        angles.append(np.degrees(np.arccos(cosine)))
    return np.concatenate(angles)
