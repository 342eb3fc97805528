"""What contact does in a bake: morph targets for each fold, beside those of the tools, and each clip's weights."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.baking.left import Left, left_in
from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.remix import summed, with_times
from wrinklecli.baking.sample import Motion, sample_clips, takes_of
from wrinklecli.baking.targets import AnySet, CreaseSet, Lift, TargetSet, named_targets, of_tools
from wrinklecli.character.clip import KEY_GAP, KEY_STEP, Clip, clip_grid
from wrinklecli.character.pose import pose_at
from wrinklecli.choices import Mode
from wrinklecli.effects.wrinkle.activity import further_activities
from wrinklecli.effects.wrinkle.shapes import Sample, Shape, make_shapes
from wrinklecli.effects.wrinkle.weights import weights_of
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values, interpolated
from wrinklecli.numeric.guard import Progress, one_thread
from wrinklecli.numeric.memory import Memory
from wrinklecli.numeric.piecewise import key_points
from wrinklecli.tools.records import identifier

if TYPE_CHECKING:
    from wrinklecli.effects.contact.crease import Crease, Followed
    from wrinklecli.effects.contact.fold import Fold

# Shapes of a fold at most, whatever their error: with the one that lifts their weights eight morph targets.
_MOST_SHAPES = 7
# Those of one clip alone: who asks for them has no crossing rather than few targets.
_MOST_OWN = 11
# Greatest error of a vertex, of the greatest move. It is hidden in the fold: where something touches, shapes are right.
_SHAPE_ERROR = 0.35
# Share of the error bound for keys of contact that are left out.
_KEYS_SHARE = 0.25


def sample_with_creases(
    plan: MeshPlan, clips: Sequence[Clip], *, fps: float, mode: Mode, memory: Memory, progress: Progress
) -> tuple[list[AnySet], list[Motion]]:
    """As `sample_clips`, with the folds whose contact is resolved behind the tools.

    Frames are marched at their own times, tracks at as many as they need.
    """
    target_sets, motions = sample_clips(plan, clips, fps=fps, mode=mode, memory=memory, progress=progress)
    return _add_creases(plan, target_sets, motions, fps=fps, marched=mode == "morph", progress=progress)


def _add_creases(
    plan: MeshPlan,
    target_sets: Sequence[TargetSet],
    motions: Sequence[Motion],
    *,
    fps: float,
    marched: bool,
    progress: Progress,
) -> tuple[list[AnySet], list[Motion]]:
    """Resolve the folds of a mesh, and follow each clip.

    Args:
        plan: The tools.
        target_sets: Of the tools.
        motions: The clips as tools sampled them.
        fps: Of the grid that clips are marched on.
        marched: Whether times may be added to the clips' own, as tracks need them.
        progress: Called with a stage's name, steps done and steps in all.

    Returns:
        The target sets with those of folds in which anything ever crosses, and motions with their weights.
    """
    if not plan.folds:
        return list(target_sets), list(motions)
    # Imported here, as other bakes need none of it.
    import scipy.linalg  # noqa: F401  # has a BLAS of its own, which is to run one thread

    from wrinklecli.effects.contact.crease import resolve

    made: list[AnySet] = list(target_sets)
    with one_thread():
        for number, fold in enumerate(plan.folds, start=1):
            crease = resolve(fold, share=_SHAPE_ERROR, most=_MOST_SHAPES)
            progress("contact", number, len(plan.folds))
            if crease is not None:
                found, motions = _followed(plan, crease, made, motions, fps=fps, marched=marched)
                made += found
    return made, list(motions)


@dataclass(frozen=True, slots=True)
class _Marched:
    """A clip, marched.

    Attributes:
        times: (frames,) seconds.
        followed: How shapes follow it: those of all clips, or its own.
        own: Shapes for it alone, where those of all clips leave crossings and a tool asks for that.
        left: What crosses with them, if anything does.
    """

    times: Floats
    followed: "Followed"
    own: "Crease | None" = None
    left: Left | None = None


def _followed(
    plan: MeshPlan,
    crease: "Crease",
    target_sets: Sequence[AnySet],
    motions: Sequence[Motion],
    *,
    fps: float,
    marched: bool,
) -> tuple[list[CreaseSet], list[Motion]]:
    """A fold's targets, and their weights in each clip."""
    takes = takes_of(plan, [motion.clip for motion in motions])
    marches = {
        take: _march(plan, crease, motions[take], _march_times(crease, motions[take], fps) if marched else None)
        for take in sorted(set(takes))
    }
    sets = [_crease_set(plan, crease, target_sets, [each for each in marches.values() if each.own is None])]
    acting = dict.fromkeys(marches, 0)
    for take, each in marches.items():
        if each.own is not None:
            acting[take] = len(sets)
            sets.append(_crease_set(plan, each.own, target_sets, [each], clip=motions[take].clip.name))
    followed: list[Motion] = []
    for motion, take in zip(motions, takes, strict=True):
        if take < len(followed):
            # The same as a clip before it.
            followed.append(replace(followed[take], clip=motion.clip))
            continue
        times, found = marches[take].times, marches[take].followed.weights
        weights = [
            found if number == acting[take] else np.zeros((len(times), len(each.crease.shapes)))
            for number, each in enumerate(sets)
        ]
        followed.append(_with_weights(plan, sets, target_sets, motion, times, weights, marched=marched))
    return sets, followed


def _march(plan: MeshPlan, crease: "Crease", motion: Motion, times: Floats | None) -> _Marched:
    """March a clip, at times of its own where there are any."""
    clip, times = motion.clip, motion.times if times is None else times
    settings = [plan.carried_patches[number].patch.tool.contact for number in crease.fold.tools]
    marched = crease.marched(clip, times)
    per_clip = any(each is not None and each.per_clip for each in settings)
    kept = list(marched) if per_clip else []  # it may be followed twice
    followed, own = crease.follow(clip, times, kept or marched), None
    if per_clip and followed.crossing:
        own, followed = crease.for_clip(clip, times, kept, share=_SHAPE_ERROR, most=_MOST_OWN)
    return _Marched(times, followed, own, left_in(own or crease, clip, times, followed))


def _crease_set(
    plan: MeshPlan,
    crease: "Crease",
    target_sets: Sequence[AnySet],
    acting: Sequence[_Marched],
    clip: str | None = None,
) -> CreaseSet:
    """The targets of a fold for all clips, or for one, and what they leave in those that they act in."""
    from wrinklecli.effects.contact.fitting import MOST_WEIGHT

    lift = Lift(len(crease.shapes), MOST_WEIGHT)
    shapes = make_shapes(
        plan.fine,
        crease.vertices,
        crease.shapes,
        tallest=plan.scale * crease.sizes,
        samples=_samples(plan, crease, of_tools(target_sets)) if plan.has_normals else [],
    )
    name = _identifier(plan, crease.fold, clip)
    return CreaseSet(
        crease,
        name,
        lift,
        named_targets(name, _lifted(lift, shapes)),
        tuple(each.followed for each in acting),
        tuple(each.left for each in acting if each.left is not None),
        clip,
    )


def _lifted(lift: Lift, shapes: Sequence[Shape | None]) -> list[Shape | None]:
    """The lift's shapes: sums of a fold's, and of the normals that fit these. Fitted themselves, normals are worse."""
    lifted: list[Shape | None] = []
    for row in lift.unmix:
        parts = [(shape, factor) for shape, factor in zip(shapes, row, strict=True) if shape is not None and factor]
        lifted.append(summed([shape for shape, _ in parts], np.array([each for _, each in parts])) if parts else None)
    return lifted


def _samples(plan: MeshPlan, crease: "Crease", tools: Sequence[TargetSet]) -> list[Sample]:
    """Where the normals of a fold are to be right: on the wrinkles of tools that stay on the skin."""
    samples = []
    for weights, clip, time in crease.samples:
        beneath = []
        for each in tools:
            if each.from_skin:
                patch = each.carried.patch
                lengths = patch.segment.lengths(plan.rig, clip, np.array([time]))
                amplitudes, _ = patch.curve.follow(*lengths)
                acting = patch.clip_strength(clip) * weights_of(patch.curve, amplitudes).reshape(-1)
                beneath += [
                    (target.shape, float(weight))
                    for target, weight in zip(each.targets, acting, strict=True)
                    if target is not None and weight
                ]
        samples.append(Sample(weights, pose_at(plan.rig, clip, time), beneath=beneath))
    return samples


def _identifier(plan: MeshPlan, fold: "Fold", clip: str | None = None) -> str:
    """What a fold's targets are named by: its first tool's name, so that no other target of the mesh is named so."""
    name = f"{plan.carried_patches[fold.tools[0]].patch.tool.identifier}_contact"
    taken = {each.patch.tool.identifier for each in plan.carried_patches}
    while name in taken or any(own.startswith(f"wrinkle_{name}_") for own in plan.rig.morph_names):
        name += "_"
    # No other name has two of these before a clip's.
    return name if clip is None else f"{name}_in_{identifier(clip)}"


def _march_times(crease: "Crease", motion: Motion, fps: float) -> Floats:
    """(frames,) seconds of a clip's grid, with more where it folds fast."""
    fold = crease.fold
    grid = clip_grid(motion.clip, fold.rig, fps=fps)
    if len(grid) < 2:
        return grid
    parts = np.ceil(np.abs(np.diff(fold.hinge.strides(fold.rig, motion.clip, grid)))).astype(int)
    # No two times may be as close as no player tells apart.
    parts = np.clip(parts, 1, np.maximum((np.diff(grid) / (2.0 * KEY_GAP)).astype(int), 1))
    steps = zip(grid[:-1], grid[1:], parts, strict=True)
    dense = np.concatenate([*(np.linspace(low, high, count + 1)[:-1] for low, high, count in steps), grid[-1:]])
    return distinct_values(dense.astype(np.float32).astype(np.float64))


def _with_weights(
    plan: MeshPlan,
    sets: Sequence[CreaseSet],
    target_sets: Sequence[AnySet],
    motion: Motion,
    times: Floats,
    weights: Sequence[Floats],
    *,
    marched: bool,
) -> Motion:
    """A motion with (frames, shapes) weights of a fold's sets at (frames,) times, and keys where they bend."""
    if not marched:
        return replace(motion, weights=(*motion.weights, *weights))
    # All of them, not the keys alone: the proof is to see what is between keys.
    joined = _with_times(plan, target_sets, motion, np.setdiff1d(times, motion.times))
    of_sets = [interpolated(joined.times, times, each) for each in weights]
    keys = np.searchsorted(joined.times, times[_keys(plan, sets, times, weights)])
    return replace(joined, keys=np.union1d(joined.keys, keys), weights=(*joined.weights, *of_sets))


def _keys(plan: MeshPlan, sets: Sequence[CreaseSet], times: Floats, weights: Sequence[Floats]) -> Ints:
    """(keys,) the times that straight lines need to give (times, shapes) weights of sets."""
    sizes = np.concatenate([plan.scale * each.crease.sizes for each in sets])
    together = np.concatenate(weights, axis=1) * sizes

    def moves(at: Floats) -> Floats:
        return interpolated(at, times, together)

    bound = _KEYS_SHARE * plan.max_error
    points, keys = key_points(times, moves, tolerance=np.inf, thinning=bound, gap=KEY_GAP, step=KEY_STEP)
    return np.searchsorted(times, points[keys])


def _with_times(plan: MeshPlan, target_sets: Sequence[AnySet], motion: Motion, fresh: Floats) -> Motion:
    """A motion sampled at more times, (fresh,) seconds, rising; none is a key yet."""
    if not len(fresh):
        return motion
    clip = motion.clip
    times, weights = with_times(plan, target_sets, clip, motion.times, motion.weights, fresh)
    patches = [each.patch for each in plan.carried_patches]
    seen = further_activities(patches, plan.rig, clip, times, known=motion.seen, known_at=motion.times)
    keys = np.searchsorted(times, motion.times[motion.keys])
    return Motion(clip, times, keys, tuple(seen), weights)
