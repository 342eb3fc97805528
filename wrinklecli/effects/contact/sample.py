"""Contact over clips: each fold is solved once for its joint's own motion, then every clip is marched and followed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import KEY_GAP, clip_grid
from wrinklecli.character.pose import pose_at
from wrinklecli.effects.contact.effect import ContactEffect, FoldWithoutContact, NonNegativeBasis
from wrinklecli.effects.contact.given_up import TORN, GivenUp, UnresolvedError, degenerate_given_up
from wrinklecli.effects.contact.hinge import Hinge
from wrinklecli.effects.contact.remaining import Remaining, remaining_in
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, SamplingOptions, named_targets
from wrinklecli.effects.sampling import duplicates_of, joined
from wrinklecli.effects.shapes import Sample, Shape, make_shapes, summed
from wrinklecli.numeric.arrays import Floats, distinct_values, interpolated, matches
from wrinklecli.numeric.guard import one_thread

if TYPE_CHECKING:
    from wrinklecli.effects.contact.crease import Crease, Followed, MarchedClip, Moves, SolvedPose
    from wrinklecli.effects.contact.fold import Fold

# Most shapes of a fold, whatever their error: with the shape that `NonNegativeBasis` adds, eight morph targets.
_MOST_SHAPES = 7
# Most shapes of a fold whose clips still cross with those: twelve morph targets.
_MOST_SHAPES_OF_CLIPS = 11
# Poses of a clip, evenly spread, that such shapes are made of, beside some of those that still cross.
_CLIP_POSES = 12
# Rounds in which poses that cross with such shapes are added to those that they are made of.
_ROUNDS = 3
# Bytes of solutions that are kept while the shapes are made; clips beyond that are solved again.
_KEPT_BYTES = 1e9
# Greatest error of a vertex over the greatest move. Errors are hidden in the fold; shapes are right at contacts.
_SHAPE_ERROR = 0.35


def sample_contact(
    folds: "Sequence[Fold]", plan: MeshPlan, effects: Sequence[Effect], motions: Sequence[Motion], how: SamplingOptions
) -> tuple[list[Effect], list[Motion]]:
    """Resolve folds and follow each clip, as `Layer.sample` does.

    Frames are marched at their own times. For tracks, times are added where the fold needs them. A fold that cannot be
    resolved in every pose is given up, and the others go on.
    """
    # Imported here, as other bakes need none of it.
    import scipy.linalg  # noqa: F401  # has a BLAS of its own, which is to run one thread

    from wrinklecli.effects.contact.crease import resolve

    made = list(effects)
    with one_thread():
        for number, fold in enumerate(folds, start=1):
            try:
                with degenerate_given_up():
                    crease = resolve(fold, share=_SHAPE_ERROR, most=_MOST_SHAPES)
                    how.progress("contact", number, len(folds))
                    if crease is not None:
                        found, motions = _followed(plan, crease, made, motions, how)
                        made.append(found)
            except UnresolvedError as error:
                made.append(_given_up(plan, fold, folds, made, error.given_up))
                motions = [
                    replace(each, states=(*each.states, None), weights=(*each.weights, np.zeros((len(each.times), 0))))
                    for each in motions
                ]
    return made, list(motions)


def _given_up(
    plan: MeshPlan, fold: "Fold", folds: "Sequence[Fold]", effects: Sequence[Effect], given_up: GivenUp
) -> FoldWithoutContact:
    """The effect in place of that of a fold, of several, whose contact cannot be resolved."""
    joint = plan.rig.names[fold.hinge.signal.node] if isinstance(fold.hinge, Hinge) else None
    tools, *shared = (
        tuple(patch.tool.name for patch in each.patches)
        for each in (fold, *folds)
        if each is fold or np.isin(each.vertices, fold.vertices).any()
    )
    beside = tuple(name for each in shared for name in each if name not in tools)
    return FoldWithoutContact(_identifier(plan, fold, effects), (), tools, joint, given_up, beside)


@dataclass(frozen=True, slots=True)
class _Marched:
    """A clip, solved and followed.

    Attributes:
        motion: The clip as earlier effects have sampled it.
        times: (frames,) seconds.
        poses: Some of its poses, of which shapes are made.
        solved: All of its solutions; None if they are not kept.
        followed: The weights of the shapes.
    """

    motion: Motion
    times: Floats
    poses: "tuple[SolvedPose, ...]"
    solved: "MarchedClip | None"
    followed: "Followed"


def _followed(
    plan: MeshPlan, crease: "Crease", effects: Sequence[Effect], motions: Sequence[Motion], how: SamplingOptions
) -> tuple[ContactEffect, list[Motion]]:
    """A fold's effect, and motions with its weights in each clip."""
    marched = how.mode == "morph"
    firsts = duplicates_of(plan, [motion.clip for motion in motions])
    times = {
        first: _march_times(crease, motions[first], how.fps) if marched else motions[first].times
        for first in sorted(set(firsts))
    }
    crease, marches = _spanned(crease, {first: (motions[first], each) for first, each in times.items()})
    remaining = []
    for first, each in marches.items():
        before = _moves_of(crease.fold, effects, motions[first], each.times)
        torn = crease.torn_frames(each.motion.clip, each.times, each.followed.weights, before)
        if torn:
            raise UnresolvedError(GivenUp(TORN, len(torn), each.motion.clip.name, float(each.times[torn[0]])))
        remaining.append(remaining_in(crease, each.motion.clip, each.times, each.followed))
    effect = _effect(plan, crease, effects, [each.followed for each in marches.values()], remaining)
    sizes = plan.scale * crease.sizes
    followed: list[Motion] = []
    for motion, first in zip(motions, firsts, strict=True):
        if first < len(followed):
            followed.append(replace(followed[first], clip=motion.clip))
            continue
        weights = [marches[first].followed.weights]
        followed.append(joined(plan, effects, motion, marches[first].times, weights, sizes, at_once=not marched))
    return effect, followed


def _spanned(crease: "Crease", clips: Mapping[int, tuple[Motion, Floats]]) -> "tuple[Crease, dict[int, _Marched]]":
    """Solve and follow motions at (frames,) seconds; if the shapes leave crossings, with the fewest others that do not.

    Raises:
        UnresolvedError: The fold cannot be resolved in a clip.
    """
    marches, room = dict[int, _Marched](), _KEPT_BYTES
    for first, (motion, times) in clips.items():
        solved = _solved(crease, motion, times)
        followed = crease.follow(solved)
        frames = {*_some(solved.touching), *_some(followed.unspanned)}
        room -= solved.size
        poses = tuple(solved.poses(sorted(frames)))
        marches[first] = _Marched(motion, times, poses, solved if room > 0 else None, followed)
    chosen = [pose for each in marches.values() for pose in each.poses]
    best, least = (crease, marches), _unspanned(marches)
    for _ in range(_ROUNDS if crease.fold.per_clip else 0):
        if not any(least):
            break
        wider = crease.spanning(chosen, share=_SHAPE_ERROR, most=_MOST_SHAPES_OF_CLIPS)
        again = {}
        for first, each in marches.items():
            solved = each.solved or _solved(crease, each.motion, each.times)
            followed = wider.follow(solved)
            again[first] = replace(each, followed=followed)
            chosen += solved.poses(_some(followed.unspanned))
        if _unspanned(again) < least:
            best, least = (wider, again), _unspanned(again)
    return best


def _solved(crease: "Crease", motion: Motion, times: Floats) -> "MarchedClip":
    """Solve a motion, and name its clip if it cannot be solved."""
    try:
        with degenerate_given_up():
            return crease.march(motion.clip, times)
    except UnresolvedError as error:
        raise UnresolvedError(replace(error.given_up, clip=motion.clip.name)) from error


def _unspanned(marches: Mapping[int, _Marched]) -> tuple[int, int]:
    """Number of frames in which shapes leave crossings, and of those in which they also take volume away."""
    followed = [each.followed for each in marches.values()]
    return sum(len(each.crossing) for each in followed), sum(len(each.unspanned) for each in followed)


def _some(frames: Sequence[int]) -> list[int]:
    """A few of some frames, evenly spread."""
    return (
        [frames[k] for k in distinct_values(np.linspace(0, len(frames) - 1, _CLIP_POSES).astype(int))] if frames else []
    )


def _moves_of(fold: "Fold", effects: Sequence[Effect], motion: Motion, times: Floats) -> "list[Moves]":
    """The moves of other folds at (times,) seconds of a clip, from their weights in its motion."""
    from wrinklecli.effects.contact.crease import Moves

    found = []
    for effect, weights in zip(effects, motion.weights, strict=True):
        if isinstance(effect, ContactEffect):
            rows, columns = matches(fold.vertices, effect.crease.vertices)
            if len(rows):
                found.append(Moves(rows, interpolated(times, motion.times, weights), effect.crease.shapes[:, columns]))
    return found


def _effect(
    plan: MeshPlan,
    crease: "Crease",
    effects: Sequence[Effect],
    followed: "Sequence[Followed]",
    remaining: Sequence[Remaining | None],
) -> ContactEffect:
    """The effect of a fold, with the intersections that remain in each clip."""
    from wrinklecli.effects.contact.fitting import MOST_WEIGHT

    basis = NonNegativeBasis(len(crease.shapes), MOST_WEIGHT)
    shapes = make_shapes(
        plan.fine,
        crease.vertices,
        crease.shapes,
        tallest=plan.scale * crease.sizes,
        samples=_samples(plan, crease, effects) if plan.has_normals else [],
    )
    name = _identifier(plan, crease.fold, effects)
    return ContactEffect(
        identifier=name,
        targets=named_targets(name, _in_basis(basis, shapes)),
        crease=crease,
        patch=crease.fold.patches[0],
        tools=tuple(each.tool.name for each in crease.fold.patches),
        basis=basis,
        followed=tuple(followed),
        remaining=tuple(each for each in remaining if each is not None),
        scale=plan.scale,
    )


def _in_basis(basis: NonNegativeBasis, shapes: Sequence[Shape | None]) -> list[Shape | None]:
    """The shapes of a basis: sums of a fold's shapes with their fitted normals, as a fit of the sums is worse."""
    made: list[Shape | None] = []
    for row in basis.unmix:
        parts = [(shape, factor) for shape, factor in zip(shapes, row, strict=True) if shape is not None and factor]
        made.append(summed([shape for shape, _ in parts], np.array([each for _, each in parts])) if parts else None)
    return made


def _samples(plan: MeshPlan, crease: "Crease", effects: Sequence[Effect]) -> list[Sample]:
    """States in which the normals of a fold are to be right, on top of the shapes of earlier effects."""
    return [
        Sample(
            weights,
            pose_at(plan.rig, clip, time),
            beneath=[pair for each in effects for pair in each.acting(plan.rig, clip, time)],
        )
        for weights, clip, time in crease.samples
    ]


def _identifier(plan: MeshPlan, fold: "Fold", effects: Sequence[Effect]) -> str:
    """The part of target names that is the fold's own, from its first tool; no other target of the mesh has it."""
    name = f"{fold.patches[0].tool.identifier}_contact"
    taken = {each.identifier for each in effects if not isinstance(each, ContactEffect)}
    while name in taken or any(own.startswith(f"wrinkle_{name}_") for own in plan.rig.morph_names):
        name += "_"
    return name


def _march_times(crease: "Crease", motion: Motion, fps: float) -> Floats:
    """(frames,) seconds of a clip's grid, with more where it folds fast."""
    fold = crease.fold
    grid = clip_grid(motion.clip, fold.rig, fps=fps)
    if len(grid) < 2:
        return grid
    parts = np.ceil(np.abs(np.diff(fold.hinge.strides(fold.rig, motion.clip, grid)))).astype(int)
    # No player distinguishes closer times.
    parts = np.clip(parts, 1, np.maximum((np.diff(grid) / (2.0 * KEY_GAP)).astype(int), 1))
    steps = zip(grid[:-1], grid[1:], parts, strict=True)
    dense = np.concatenate([*(np.linspace(low, high, count + 1)[:-1] for low, high, count in steps), grid[-1:]])
    return distinct_values(dense.astype(np.float32).astype(np.float64))
