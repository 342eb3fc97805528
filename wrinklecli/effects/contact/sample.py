"""Contact over clips: each fold is solved once for its joint's own motion, then every clip is marched and followed."""

from collections.abc import Sequence
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
from wrinklecli.tools.records import identifier

if TYPE_CHECKING:
    from wrinklecli.effects.contact.crease import Crease, Followed, Moves
    from wrinklecli.effects.contact.fold import Fold

# Most shapes of a fold, whatever their error: with the shape that `NonNegativeBasis` adds, eight morph targets.
_MOST_SHAPES = 7
# Most shapes of one clip alone: users who ask for these want no intersections rather than few targets.
_MOST_OWN = 11
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
                        made += found
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
    """A clip, marched.

    Attributes:
        times: (frames,) seconds.
        followed: The weights of the shapes: those of all clips, or the clip's own.
        own: Shapes for the clip alone, if those of all clips leave intersections and a tool asks for own ones.
        remaining: The intersections that remain, if there are any.
    """

    times: Floats
    followed: "Followed"
    own: "Crease | None" = None
    remaining: Remaining | None = None


def _followed(
    plan: MeshPlan, crease: "Crease", effects: Sequence[Effect], motions: Sequence[Motion], how: SamplingOptions
) -> tuple[list[ContactEffect], list[Motion]]:
    """A fold's effects, and motions with their weights in each clip."""
    marched = how.mode == "morph"
    firsts = duplicates_of(plan, [motion.clip for motion in motions])
    marches = {
        first: _march(
            crease,
            motions[first],
            _march_times(crease, motions[first], how.fps) if marched else None,
            [
                (each, weights)
                for each, weights in zip(effects, motions[first].weights, strict=True)
                if isinstance(each, ContactEffect)
            ],
        )
        for first in sorted(set(firsts))
    }
    made = [_effect(plan, crease, effects, [each for each in marches.values() if each.own is None])]
    acting = dict.fromkeys(marches, 0)
    for first, each in marches.items():
        if each.own is not None:
            acting[first] = len(made)
            made.append(_effect(plan, each.own, effects, [each], clip=motions[first].clip.name))
    made[0] = replace(made[0], own=tuple(name for each in made[1:] for name in each.target_names))
    sizes = np.concatenate([plan.scale * each.crease.sizes for each in made])
    followed: list[Motion] = []
    for motion, first in zip(motions, firsts, strict=True):
        if first < len(followed):
            followed.append(replace(followed[first], clip=motion.clip))
            continue
        times, found = marches[first].times, marches[first].followed.weights
        weights = [
            found if number == acting[first] else np.zeros((len(times), len(each.crease.shapes)))
            for number, each in enumerate(made)
        ]
        followed.append(joined(plan, effects, motion, times, weights, sizes, at_once=not marched))
    return made, followed


def _march(
    crease: "Crease", motion: Motion, times: Floats | None, before: "Sequence[tuple[ContactEffect, Floats]]"
) -> _Marched:
    """March a clip, at times of its own if there are any; `before` are earlier folds with their weights in it.

    Raises:
        UnresolvedError: The fold cannot be resolved in the clip.
    """
    clip, times = motion.clip, motion.times if times is None else times
    try:
        with degenerate_given_up():
            marched = crease.marched(clip, times)
            kept = list(marched) if crease.fold.per_clip else []  # it may be followed twice
            followed, own = crease.follow(clip, times, kept or marched), None
            if crease.fold.per_clip and followed.crossing:
                own, followed = crease.for_clip(clip, times, kept, share=_SHAPE_ERROR, most=_MOST_OWN)
            others = _moves_of(crease.fold, before, motion.times, times)
            torn = (own or crease).torn_frames(clip, times, followed.weights, others)
            if torn:
                raise UnresolvedError(GivenUp(TORN, len(torn), time=float(times[torn[0]])))
    except UnresolvedError as error:
        raise UnresolvedError(replace(error.given_up, clip=clip.name)) from error
    return _Marched(times, followed, own, remaining_in(own or crease, clip, times, followed))


def _moves_of(
    fold: "Fold", effects: "Sequence[tuple[ContactEffect, Floats]]", sampled: Floats, times: Floats
) -> "list[Moves]":
    """The moves of other folds at (times,) seconds of a clip, from their weights at the (sampled,) ones."""
    from wrinklecli.effects.contact.crease import Moves

    found = []
    for effect, weights in effects:
        rows, columns = matches(fold.vertices, effect.crease.vertices)
        if len(rows):
            found.append(Moves(rows, interpolated(times, sampled, weights), effect.crease.shapes[:, columns]))
    return found


def _effect(
    plan: MeshPlan, crease: "Crease", effects: Sequence[Effect], acting: Sequence[_Marched], clip: str | None = None
) -> ContactEffect:
    """The effect of a fold in all clips, or in one, with the intersections that remain in those."""
    from wrinklecli.effects.contact.fitting import MOST_WEIGHT

    basis = NonNegativeBasis(len(crease.shapes), MOST_WEIGHT)
    shapes = make_shapes(
        plan.fine,
        crease.vertices,
        crease.shapes,
        tallest=plan.scale * crease.sizes,
        samples=_samples(plan, crease, effects) if plan.has_normals else [],
    )
    name = _identifier(plan, crease.fold, effects, clip)
    return ContactEffect(
        identifier=name,
        targets=named_targets(name, _in_basis(basis, shapes)),
        crease=crease,
        patch=crease.fold.patches[0],
        tools=tuple(each.tool.name for each in crease.fold.patches),
        basis=basis,
        followed=tuple(each.followed for each in acting),
        remaining=tuple(each.remaining for each in acting if each.remaining is not None),
        clip=clip,
        own=(),
        per_clip=crease.fold.per_clip,
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


def _identifier(plan: MeshPlan, fold: "Fold", effects: Sequence[Effect], clip: str | None = None) -> str:
    """The part of target names that is the fold's own, from its first tool; no other target of the mesh has it."""
    name = f"{fold.patches[0].tool.identifier}_contact"
    taken = {each.identifier for each in effects if not isinstance(each, ContactEffect)}
    while name in taken or any(own.startswith(f"wrinkle_{name}_") for own in plan.rig.morph_names):
        name += "_"
    # No other name has two such parts before a clip's.
    return name if clip is None else f"{name}_in_{identifier(clip)}"


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
