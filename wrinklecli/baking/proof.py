"""The proof: the written file is played as an engine would, and compared with the method's own result."""

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property, partial

import numpy as np

from wrinklecli.baking.apart import Frames, Pair
from wrinklecli.baking.refined_mesh import RefinedPrimitive, primitives_of, shared_vertices
from wrinklecli.character.clip import KEY_GAP, Clip, read_clips
from wrinklecli.character.pose import Pose, joint_matrices, morph_weights, poses_at
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.character.skin import Influences, prepare
from wrinklecli.character.sparse_targets import SparseDeltas, Targets, read_sparse_deltas
from wrinklecli.character.surface import read_vertices
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, targets_of
from wrinklecli.effects.sampling import duplicates_of, read
from wrinklecli.effects.shapes import DisplacedNormals, Shape, summed_middles, turn_to
from wrinklecli.errors import RefusedError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, matches, unit
from wrinklecli.numeric.guard import Progress
from wrinklecli.numeric.portions import portions
from wrinklecli.surface.refine import Refinement

# Frames of a clip at which all vertices are compared, besides those at which an error would show most.
_FRAMES = 64
# Frames of a clip besides at which the weights of all targets together are furthest off.
_WORST = 16
# Frames of all clips at which normals are compared, which takes several times as long,
_NORMAL_FRAMES = 96
# and those of each clip, at least.
_LEAST_NORMAL_FRAMES = 4


@dataclass(frozen=True, slots=True)
class Residual:
    """The distance of the file from the method in one clip.

    Attributes:
        position: A bound on the distance of each vertex, scene units.
        time: The time at which it is largest, seconds.
        weights: Largest move of a vertex by the errors of an effect's weights, scene units, at all frames sampled and
            between them, unless two are too close for another one (see `KEY_GAP`).
        normal: 99th percentile of the angle between the file's and the true normals, degrees; None without normals.
    """

    position: float
    time: float
    weights: float
    normal: float | None


@dataclass(frozen=True, slots=True)
class Proof:
    """The two sides of the comparison, at the vertices to compare: the method, and the file as an engine loads it.

    Attributes:
        rig: The file's.
        clips: The file's.
        vertices: (vertices,) fine welded vertex of each.
        joints: (joints,) the joints on which the vertices hang, on either side; both rigs have the same.
        blocks: The vertices, some after the other: what all frames that are compared take stays in a core's cache.
        normals: None without NORMAL.
    """

    rig: Rig
    clips: tuple[Clip, ...]
    vertices: Ints
    joints: Ints
    blocks: "tuple[_Block, ...]"
    normals: "_Normals | None"

    def largest_moves(self, weights: Floats) -> Floats:
        """(frames,) the largest move of a vertex by (frames, targets) weights of the effects' targets."""
        squares = [np.sum(each.exact.added(weights) ** 2, axis=1).max(axis=1) for each in self.blocks]
        return np.asarray(np.sqrt(np.max([np.zeros(len(weights)), *squares], axis=0)))


@dataclass(frozen=True, slots=True)
class _Block:
    """Some of the vertices to compare.

    Attributes:
        rows: Which they are.
        bodies: The method's, whose weights are not pruned, and the file's as stored, with normalised weights and the
            asset's own targets.
        exact: The new targets, as the effects have them.
        added: The new targets, as stored.
        errors: (vertices,) errors of effects that have fewer shapes than the method, scene units.
    """

    rows: slice
    bodies: Pair
    exact: Targets
    added: Targets
    errors: Floats


@dataclass(frozen=True)
class _Normals:
    """The normals of the file, and those that they should be.

    Attributes:
        fine: The refined surface.
        vertices: (vertices,) fine welded vertex of each compared one.
        stored: (vertices, 3) as stored.
        added: NORMAL deltas of each new target.
        shapes: The new targets' shapes, which say what is between the vertices.
    """

    fine: Refinement
    vertices: Ints
    stored: Floats
    added: Targets
    shapes: Sequence[Shape]

    @cached_property
    def _firsts(self) -> tuple[Ints, Ints]:
        """(welded,) the sorted welded vertices, and a compared vertex of each."""
        return np.unique(self.vertices, return_index=True)

    @cached_property
    def _displaced(self) -> DisplacedNormals:
        return DisplacedNormals.of(self.fine, self._firsts[0])

    def angles(self, moved: Floats, played: Floats, poses: Sequence[Pose]) -> Floats:
        """(angles,) degrees between the file's normals and the true ones of each pose, where these change.

        Only new targets count: turns of normals by the source's own morph targets are not compared.

        Args:
            moved: (frames, 3, vertices) the method's displacements, bind space.
            played: (frames, targets) weights of the new targets.
            poses: (frames,).
        """
        turned = self.added.added(played).transpose(0, 2, 1)
        moved = moved.transpose(0, 2, 1)
        middles = summed_middles(self.shapes, played)
        true = self._displaced.in_poses(moved[:, self._firsts[1]], poses, middles=middles)
        rows = np.searchsorted(self._displaced.touched, self.vertices)
        authored, base = unit(self.stored), self._displaced.base[rows]
        angles = []
        for frame in range(len(moved)):
            wanted = turn_to(base, authored, true[frame, rows])
            got = unit(self.stored + turned[frame])
            changed = moved[frame].any(axis=1)
            cosine = np.clip(np.sum(wanted * got, axis=1)[changed], -1.0, 1.0)
            angles.append(np.degrees(np.arccos(cosine)))
        return np.concatenate(angles)


def prove(
    edited: EditedDocument,
    plan: MeshPlan,
    effects: Sequence[Effect],
    motions: Sequence[Motion],
    *,
    details: bool,
    progress: Progress,
) -> dict[str, Residual]:
    """Play the edited document as an engine would and compare it with the method, clip by clip.

    Raises:
        RefusedError: A vertex is further off than the plan's bound.
    """
    proof = read_back(edited, plan, effects)
    written = {clip.index: clip for clip in proof.clips}
    residuals: dict[str, Residual] = {}
    proven: dict[int, tuple[Clip, Residual]] = {}
    firsts = duplicates_of(plan, [motion.clip for motion in motions])
    normal_frames = max(_NORMAL_FRAMES // max(len(set(firsts)), 1), _LEAST_NORMAL_FRAMES) if details else 0
    for done, (motion, first) in enumerate(zip(motions, firsts, strict=True), start=1):
        clip = written[motion.clip.index]
        # A clip with the motion of an earlier one, in the source and in the file, has the same residual.
        if first not in proven or not clip.moves_as(proven[first][0]):
            proven[first] = clip, measure_residual(proof, plan, effects, motion, clip, normal_frames=normal_frames)
        residual = proven[first][1]
        _refuse_beyond_bound(plan, effects, motion, residual)
        residuals[motion.clip.name] = residual
        progress("proof", done, len(motions))
    return residuals


def _refuse_beyond_bound(plan: MeshPlan, effects: Sequence[Effect], motion: Motion, residual: Residual) -> None:
    worst = max(residual.position, residual.weights)
    # A region that may be further off than all else moves vertices that others move too.
    if worst > max(plan.max_error, *(each.max_error or 0.0 for each in effects), 0.0):
        share = 100 * worst / plan.tallest
        when = f" at {residual.time:.3g} s" if worst == residual.position else ""
        raise RefusedError(
            f"the file would be off by {worst:.3g} ({share:.2g} % of the tallest wrinkle){when};"
            f" --max-error allows {plan.max_error:.3g}",
            where=motion.clip.name,
        )


def read_back(edited: EditedDocument, plan: MeshPlan, effects: Sequence[Effect]) -> Proof:
    """Load the vertices of the file that effects or refinement touch, beside those of the method."""
    fine = plan.fine
    refined_primitives = primitives_of(fine, shared_vertices(edited.source, plan.rig.mesh, fine))
    written = edited.document()
    rig = read_rig(written, plan.rig.node)
    primitives, old = written.items("meshes")[rig.mesh]["primitives"], len(plan.rig.own.morph_names)
    distinct = _distinct(primitives, refined_primitives)
    of_primitives = [refined_primitives[number].weld for number in distinct]
    starts, welds = np.cumsum([0, *map(len, of_primitives)]), np.concatenate(of_primitives)

    def new_deltas(name: str) -> list[SparseDeltas]:
        where = written.where("meshes", rig.mesh)
        chosen = [primitives[number] for number in distinct]
        return read_sparse_deltas(written, chosen, starts, name, first=old, where=where)

    touched = np.zeros(len(fine.positions), bool)
    touched[len(fine.surface.positions) :] = True
    for vertices in (part.vertices for part in plan.parts):
        touched[vertices] = True
    compared = touched[welds]
    moving = new_deltas("POSITION")
    # A vertex that a new target moves is compared even if no tool asked for it.
    for target in moving:
        compared[target.vertices] = True
    chosen = np.flatnonzero(compared)
    rows = np.where(compared, np.cumsum(compared) - 1, -1)
    of_each = [np.flatnonzero(part) for part in np.split(compared, starts[1:-1])]
    stored = read_vertices(written, rig, dict(zip(distinct, of_each, strict=True)), targets=old)
    stored_weights = Influences(stored.joints.T, stored.weights.T, len(rig.joints))
    vertices, normals = welds[chosen], None
    if stored.normals is not None:
        turning = [target.of_rows(rows) for target in new_deltas("NORMAL")]
        bent = [each.shape for each in targets_of(effects)]
        normals = _Normals(fine, vertices, stored.normals, Targets(tuple(turning), len(chosen)), bent)
    shapes, errors = [], np.zeros(len(chosen))
    for each in effects:
        for shape in (target.shape for target in each.targets):
            own, numbers = matches(vertices, shape.vertices)
            shapes.append(SparseDeltas(own, shape.deltas[numbers]))
            if each.projected is None:
                errors[own] = np.maximum(errors[own], each.error)
    exact = fine.influences(len(plan.rig.joints), vertices)
    joints = distinct_values(np.concatenate([exact.acting, stored_weights.acting]))
    bodies = (
        prepare(exact.among(joints), fine.positions[vertices], fine.morph_deltas[:old, vertices]),
        prepare(stored_weights.among(joints), stored.positions, stored.morph_deltas),
    )
    parts = [*portions(len(chosen), 4 * (_FRAMES + _WORST))]
    ends = [min(part.stop, len(chosen)) for part in parts]
    new = [shapes, [target.of_rows(rows) for target in moving]]
    exactly, as_stored = (Targets(tuple(each), len(chosen)).parts(ends) for each in new)
    blocks = tuple(
        _Block(part, Pair(*(each.of(np.arange(len(chosen))[part]) for each in bodies)), own, added, errors[part])
        for part, own, added in zip(parts, exactly, as_stored, strict=True)
    )
    return Proof(rig, read_clips(written), vertices, joints, blocks, normals)


def _distinct(primitives: Sequence[Json], refined_primitives: Sequence[RefinedPrimitive]) -> list[int]:
    """Numbers of the primitives without those that share all accessors, and so all vertices, with an earlier one."""
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
    effects: Sequence[Effect],
    motion: Motion,
    written: Clip,
    *,
    normal_frames: int,
) -> Residual:
    """Compare the file with the method in one clip, at and between its keys.

    Args:
        proof: The two sides.
        plan: The mesh.
        effects: The effects on the mesh.
        motion: The clip as it was in the source, and the times at which it was sampled.
        written: The clip as it is in the file.
        normal_frames: Most frames in which normals are compared too.
    """
    times = _all_times(motion.times)
    readings = read(plan, effects, motion.clip, times)
    parts = [each.weights(motion.clip, found, exact=True) for each, found in zip(effects, readings, strict=True)]
    exact = np.concatenate([np.zeros((len(times), 0)), *parts], axis=1)
    # By place, not by name, as a mesh whose extras are no object stores no names.
    played = morph_weights(proof.rig, written, times)[:, len(proof.rig.morph_names) - exact.shape[1] :]
    off = np.abs(played - exact) * np.array([target.shape.tallest for target in targets_of(effects)])
    chosen = _chosen_times(exact, off)
    acting = np.flatnonzero(exact[chosen].any(axis=1))
    shaded = acting[distinct_values(np.linspace(0, len(acting) - 1, min(normal_frames, len(acting))).astype(int))]
    projected, first = [], 0
    for each in effects:
        columns = slice(first, first + len(each.targets))
        if each.projected is not None:
            vertices, moved_at = each.projected
            projected.append((*matches(proof.vertices, vertices), partial(moved_at, motion.clip), columns))
        first = columns.stop
    moved = _Moved(motion.clip, times[chosen], exact[chosen], projected)
    position, time, angles = _vertex_errors(proof, plan, moved, written, shaded)
    normal = None
    if normal_frames and proof.normals is not None:
        normal = float(np.percentile(angles, 99)) if len(angles) else 0.0
    owners = np.repeat(np.arange(len(effects)), [len(each.targets) for each in effects])
    weights = max(
        (_largest_move(proof, effects, (played - exact) * (owners == number)) for number in range(len(effects))),
        default=0.0,
    )
    return Residual(position, time, weights, normal)


def _largest_move(proof: Proof, effects: Sequence[Effect], gaps: Floats) -> float:
    """The largest move of a vertex by (times, targets) errors of weights, scene units.

    Shapes of one effect may overlap, so that errors add up, or make up for each other. Times are looked at as long as
    their errors without their signs may give a larger move.
    """
    shapes = [target.shape for target in targets_of(effects)]
    sizes = np.array([each.tallest for each in shapes])
    bounds = np.abs(gaps) @ sizes
    order = np.argsort(-bounds, kind="stable")
    if not bounds.any():
        return 0.0
    own = np.flatnonzero(gaps.any(axis=0))
    longest = np.array([np.sqrt((shapes[number].deltas ** 2).sum(axis=1)).max() for number in own.tolist()])
    scale = float((sizes[own] / longest).max())
    worst = 0.0
    for rows in (order[first : first + _FRAMES] for first in range(0, len(order), _FRAMES)):
        if bounds[rows[0]] <= worst:
            break
        worst = max(worst, scale * float(proof.largest_moves(gaps[rows]).max()))
    return worst


@dataclass(frozen=True, slots=True)
class _Moved:
    """The method's side of the comparison in one clip.

    Attributes:
        clip: The clip as it was in the source.
        times: (times,) seconds.
        exact: (times, targets) the method's weights of all effects.
        projected: For each effect that projects vertices in each frame, rows of the compared vertices, their numbers
            among the effect's, the displacements of the effect's vertices at some times, and its columns of `exact`,
            which these replace.
    """

    clip: Clip
    times: Floats
    exact: Floats
    projected: Sequence[tuple[Ints, Ints, Callable[[Floats], Floats], slice]]

    def displacements(self, proof: Proof, frames: Ints) -> Iterator[Floats]:
        """(frames, 3, vertices) sums of all effects, bind space, for block after block of the vertices compared."""
        weights = self.exact[frames].copy()
        projected = []
        for rows, numbers, moved, columns in self.projected:
            weights[:, columns] = 0.0
            projected.append((rows, moved(self.times[frames]).transpose(0, 2, 1)[:, :, numbers]))
        for block in proof.blocks:
            total = block.exact.added(weights)
            for rows, moves in projected:
                here = (rows >= block.rows.start) & (rows < block.rows.stop)
                total[:, :, rows[here] - block.rows.start] += moves[:, :, here]
            yield total


def _vertex_errors(
    proof: Proof, plan: MeshPlan, moved: _Moved, written: Clip, shaded: Ints
) -> tuple[float, float, Floats]:
    """A bound on the distances of vertices, its time, and the angles of normals in degrees at the times `shaded`."""
    rig, clip, times, own = plan.rig.own, moved.clip, moved.times, len(plan.rig.own.morph_names)
    matrices, stored = (joint_matrices(*side, times, proof.joints) for side in ((rig, clip), (proof.rig, written)))
    weights, played = morph_weights(rig, clip, times), morph_weights(proof.rig, written, times)
    worst, worst_time, angles = 0.0, float(times[0]), np.zeros(0)
    for block, displaced in zip(proof.blocks, moved.displacements(proof, np.arange(len(times))), strict=True):
        method = Frames(matrices, weights, displaced)
        file = Frames(stored, played[:, :own], block.added.added(played[:, own:]))
        bounds = block.bodies.bounds(method, file) + block.errors
        if bounds.max(initial=0.0) > worst:
            worst = float(bounds.max())
            worst_time = float(times[int(bounds.max(axis=1).argmax())])
    if len(shaded) and proof.normals is not None:
        whole = np.concatenate([*moved.displacements(proof, shaded)], axis=2)
        poses = poses_at(rig, clip, times[shaded])
        angles = proof.normals.angles(whole, played[shaded, own:], poses)
    return worst, worst_time, angles


def _all_times(times: Floats) -> Floats:
    """(times,) every frame and two points between each two, seconds, as an engine's float32 clock shows them.

    There are none between frames that are too close for another one (see `KEY_GAP`), as no player shows these.
    """
    gaps = np.diff(times)
    wide = gaps >= 2.0 * KEY_GAP
    between = (times[:-1][wide, None] + np.array([0.25, 0.5]) * gaps[wide, None]).reshape(-1)
    return distinct_values(np.concatenate([times, between.astype(np.float32).astype(np.float64)]))


def _chosen_times(exact: Floats, off: Floats) -> Ints:
    """Sorted numbers of times to compare at: an even choice, and those at which an error would show most.

    There a target acts most, by its (times, targets) exact weights, or the (times, targets) moves that weights are off
    are largest.
    """
    even = np.linspace(0, len(exact) - 1, min(_FRAMES, len(exact))).astype(int)
    tallest = np.argmax(np.abs(exact), axis=0) if exact.shape[1] else even[:0]
    worst = np.argsort(-off.sum(axis=1), kind="stable")[:_WORST]
    return distinct_values(np.concatenate([even, tallest, worst]))
