"""Contact over clips: each fold is solved once for its joint's own motion, then every clip is marched and followed."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from operator import call
from typing import TypeVar

import numpy as np

from wrinklecli.character.clip import KEY_GAP, Clip, clip_grid
from wrinklecli.character.pose import poses_at
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.play import Playing
from wrinklecli.drive.swing import signed
from wrinklecli.drive.turned import TurnDrive
from wrinklecli.effects.contact.crease import Crease, Followed, MarchedClip, march_clip, resolve
from wrinklecli.effects.contact.effect import MOST_APART, SECTION, ContactWords, contact_effect
from wrinklecli.effects.contact.fitting import MOST_WEIGHT
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.effects.contact.kept import MOST_BYTES, Spanned, read, solution_key, written
from wrinklecli.effects.contact.remaining import Shown, shown_in
from wrinklecli.effects.contact.system import System, near_each_other, with_crossings
from wrinklecli.effects.effect import Effect, MeshPlan, SamplingOptions, Target, named_targets
from wrinklecli.effects.kept import is_kept, keep, kept_solution
from wrinklecli.effects.sampling import duplicates_of
from wrinklecli.effects.shapes import Sample, Shape, make_shapes, summed
from wrinklecli.effects.wrinkle.effect import WrinkleWords, lowered_in_clips
from wrinklecli.errors import listed
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, distinct_values
from wrinklecli.numeric.guard import one_thread
from wrinklecli.numeric.memory import leave_room, start_blas
from wrinklecli.numeric.processes import in_processes

_Value = TypeVar("_Value")

# Poses of a clip, evenly spread, that shapes are made of.
_CLIP_POSES = 16
# Times that shapes are made, at most: each further time, as many poses that still cross are added. With two, a knee of
# real trousers kept 126 crossings.
_ROUNDS = 3
# Part of the memory for solutions that are kept while the shapes are made; clips beyond that are solved again.
_KEPT = 0.5
# Bytes of a vertex, and of one that is free to move, in a solution: a position, and a matrix. A solution takes about
# twice as much, and contact acts in about half of the frames.
_VERTEX_BYTES, _FREE_BYTES = 24, 72
# Bytes that the smallest fold takes, below which libraries end the process rather than raise an error.
_ROOM = 32 * 10**6


def resolve_folds(
    folds: Sequence[Fold], plan: MeshPlan, effects: Sequence[Effect], clips: Sequence[Clip], how: SamplingOptions
) -> list[Effect]:
    """Resolve folds and follow each clip, as `Layer.effects` does."""
    made, done = list(effects), 0
    start_blas()
    leave_room(_ROOM)
    with one_thread():
        systems = _systems(folds, clips)
        at_once = max(1, min(how.jobs, len(systems)))
        solved_parts = [[fold.solved_part for fold in members] for members in systems]
        _refuse_large(solved_parts, clips, how, at_once, where=plan.rig.node_name)
        kept = _KEPT * how.memory.left / at_once
        chosen = _Clips(clips, duplicates_of(plan, clips), how.fps, kept)
        for members, solved in zip(systems, _solved_systems(solved_parts, chosen, how.jobs), strict=True):
            made += _followed(plan, members, solved, chosen, made, how.jobs)
            done += len(members)
            how.progress("contact", done, len(folds))
    numbers = {each.name: number for number, each in enumerate(made) if isinstance(each.words, WrinkleWords)}
    for words in [each.words for each in made if isinstance(each.words, ContactWords)]:
        for name in words.tools if words.heights else ():
            made[numbers[name]] = lowered_in_clips(made[numbers[name]], words.heights)
    return made


def _refuse_large(
    systems: Sequence[list[Fold]], clips: Sequence[Clip], how: SamplingOptions, at_once: int, *, where: str
) -> None:
    """Check that memory holds what so many systems of folds solve at once: their sweeps, and a clip of each.

    Raises:
        TooMuchError: It would take more memory than there may be; to solve it takes minutes.
    """
    longest = max((1 + int((clip.end - clip.start) * how.fps) for clip in clips), default=0)
    needs = []
    for members in systems:
        folds = [fold for fold in members if fold.crosses]
        frames = longest + sum(len(times) for fold in folds for _, times in fold.hinge.sweeps)
        vertices = sum(len(fold.vertices) for fold in folds)
        needs.append((frames * (_VERTEX_BYTES * vertices + _FREE_BYTES * _free_count(members)), frames, folds))
    largest = sorted(needs, key=lambda each: -each[0])[:at_once]
    names = listed(name for _, _, folds in largest for fold in folds for name in fold.tools)
    what = f"{sum(frames for _, frames, _ in largest):,} poses of the folds {names}, solved for contact,"
    how.memory.check(sum(size for size, _, _ in largest), what, where=where)


@dataclass(frozen=True, slots=True)
class _Clips:
    """The clips, of which some move a mesh alike.

    Attributes:
        every: All clips.
        firsts: For each of them the number of the first with the same motion.
        fps: Frames a second of a grid.
        kept: Bytes of solutions that a system may keep.
    """

    every: Sequence[Clip]
    firsts: list[int]
    fps: float
    kept: float

    @property
    def moving(self) -> dict[int, Clip]:
        """The first clips with each motion, by their numbers."""
        return {number: self.every[number] for number in sorted(set(self.firsts))}

    def by_name(self, found: Mapping[int, _Value]) -> dict[str, _Value]:
        """The values of some first clips, by the names of all clips with their motions."""
        return {clip.name: found[first] for clip, first in zip(self.every, self.firsts, strict=True) if first in found}

    def times_for(self, folds: Sequence[Fold], clip: Clip) -> Floats:
        """(frames,) seconds of a clip's grid at which folds are solved together, with more where one folds fast."""
        grid = clip_grid(clip, folds[0].rig, fps=self.fps)
        if len(grid) < 2:
            return grid
        strides = np.concatenate([each.strides(clip, grid) for each in folds], axis=1)
        parts = np.ceil(np.abs(np.diff(strides, axis=0)).max(axis=1)).astype(int)
        # No player distinguishes closer times.
        parts = np.clip(parts, 1, np.maximum((np.diff(grid) / (2.0 * KEY_GAP)).astype(int), 1))
        steps = zip(grid[:-1], grid[1:], parts, strict=True)
        dense = np.concatenate([*(np.linspace(low, high, count + 1)[:-1] for low, high, count in steps), grid[-1:]])
        return distinct_values(dense.astype(np.float32).astype(np.float64))


def _solved_systems(systems: Sequence[list[Fold]], clips: _Clips, jobs: int) -> Iterator[Spanned]:
    """Find the systems that are kept, and resolve the others in so many processes."""
    keys, known = list[str](), dict[int, Spanned]()
    for number, members in enumerate(systems if is_kept() else ()):
        times = partial(clips.times_for, members)
        keys.append(solution_key(members, clips.moving, times, [clips.fps]))
        reading = partial(read, members=members, clips=clips.moving)
        solved = kept_solution(keys[-1], reading, what="a solution of these folds", most=MOST_BYTES)
        if solved is not None:
            known[number] = solved
    unknown = [members for number, members in enumerate(systems) if number not in known]
    # Processes beyond one for each system solve its folds, their sweeps and its clips.
    work = partial(_solved_system, clips=clips, jobs=max(1, jobs // max(1, len(unknown))))
    shared = [*(fold for members in unknown for fold in members), *clips.moving.values()]
    fresh = in_processes(work, unknown, jobs, shared=shared, size=_free_count)
    for number, members in enumerate(systems):
        if number in known:
            yield known[number]
        else:
            solved = next(fresh)
            if keys:
                keep(keys[number], partial(written, solved, members, clips.moving))
            yield solved


def _solved_system(members: list[Fold], *, clips: _Clips, jobs: int) -> Spanned:
    """Solve the motions of a system's folds, and the clips; find shapes, and follow all of these."""
    folds, spanned = tuple(fold for fold in members if fold.crosses), list[tuple[Crease, dict[int, Followed]]]()
    if not folds:
        return spanned
    system = System(folds, {n: (clip, clips.times_for(folds, clip)) for n, clip in clips.moving.items()})
    size = sum(_VERTEX_BYTES * len(each.vertices) + _FREE_BYTES * len(each.free_vertices) for each in folds)
    frames = np.cumsum([len(times) for _, times in system.clips.values()])
    # Clips beyond these are solved again whenever they are asked for.
    kept = [*system.clips][: int(np.count_nonzero(frames * size <= clips.kept))]
    motions = [partial(march_clip, fold, *each, sweep=True) for fold in folds for each in fold.hinge.sweeps]
    # Clips take longest, so they are begun first.
    work = [*(partial(march_clip, system.fold, *system.clips[number]) for number in kept), *motions]
    solved = [*in_processes(call, work, jobs, shared=system.shared)]
    system.kept.update(zip(kept, solved, strict=False))
    sweeps = iter(solved[len(kept) :])
    for fold in folds:
        spanned.append(_spanned(fold, [next(sweeps) for _ in fold.hinge.sweeps], spanned, system))
    return spanned


def _free_count(members: Sequence[Fold]) -> int:
    """Number of vertices that contact may move in the folds of a system: about what it costs."""
    return sum(int(np.count_nonzero(fold.near)) for fold in members if fold.crosses)


def _systems(folds: Sequence[Fold], clips: Sequence[Clip]) -> list[list[Fold]]:
    """The folds that are solved together, with all that crosses in them.

    They are two at most, such as limbs that meet, or share a trunk. In a fist each finger meets all others; a union of
    three of them takes minutes, and tears.
    """
    clips = clips if all(fold.per_clip for fold in folds) else []
    whole, systems = [with_crossings(fold, clips) for fold in folds], list[list[Fold]]()
    while whole:
        first, *whole = whole
        other = next((each for each in whole if near_each_other(first, each)), first)
        whole = [each for each in whole if each is not other]
        # Both count as equally thick.
        radius = (first.radius + other.radius) / 2.0
        members = [first] if other is first else [first, other]
        systems.append([replace(each, radius=radius) for each in members])
    return systems


def _followed(
    plan: MeshPlan, members: Sequence[Fold], spanned: Spanned, clips: _Clips, effects: Sequence[Effect], jobs: int
) -> list[Effect]:
    """The effects of folds that are solved together, on top of earlier ones."""
    counted = [fold.counted_part for fold in members if fold.crosses]
    creases, firsts = [crease for crease, _ in spanned], [*spanned[0][1]] if spanned else []
    before = [each.words for each in effects if isinstance(each.words, ContactWords)]
    work = list[Callable[[], Shown]]()
    for first in firsts:
        followed = [each[first] for _, each in spanned]
        beside = [each.crease.moves(each.followed[followed[0].clip.name]) for each in before]
        work.append(partial(shown_in, creases, followed, beside, counted))
    shown = dict(zip(firsts, in_processes(call, work, jobs, shared=clips.every), strict=True))
    made: list[Effect] = []
    heights = clips.by_name({k: each.heights for k, each in shown.items() if (each.heights.weights < 1.0).any()})
    for number, crease in enumerate(creases):
        own = {first: each.followed[number] for first, each in shown.items()}
        crease = crease.looked_up([*own.values()], scale=plan.scale, allowed=MOST_APART)
        errors = {first: crease.player_error(each, scale=plan.scale) for first, each in own.items()}
        remaining = (each.remaining[number] for each in shown.values())
        words = ContactWords(
            crease=crease,
            tools=crease.fold.tools,
            followed=clips.by_name(own),
            remaining=tuple(each for each in remaining if each is not None),
            player_errors=clips.by_name(errors),
            heights=heights,
        )
        # Nothing touches where a fold that clips alone cross has no shapes.
        if len(crease.shapes) or words.remaining:
            made.append(_effect(plan, words, [*effects, *made]))
    return made


def _spanned(
    fold: Fold, sweeps: Sequence[MarchedClip], before: Spanned, system: System
) -> tuple[Crease, dict[int, Followed]]:
    """Find the fewest shapes for solved sweeps and clips, and the weights that follow the clips."""

    def divided(number: int) -> MarchedClip:
        return system.part(number, [(crease, marches[number].weights) for crease, marches in before])

    every = {number: divided(number) for number in system.kept}

    def part(number: int) -> MarchedClip:
        return every.get(number) or divided(number)

    chosen = [pose for each in sweeps for pose in each.poses(each.touching, _CLIP_POSES)]
    for number in system.clips if fold.per_clip else ():
        solved = part(number)
        chosen += solved.poses(solved.touching, _CLIP_POSES)
    found: list[tuple[Crease, dict[int, Followed], tuple[int, int]]] = []
    for _ in range(_ROUNDS):
        # More poses hardly ever need fewer shapes, and those of a fit may be too few for weights of each pose alone.
        fewest = max((1 + len(each.shapes) for each, *_ in found), default=1)
        crease = resolve(fold, chosen, sweeps, fewest=fewest)
        chosen += [
            pose
            for each, solved in zip(crease.swept, sweeps, strict=True)
            for pose in solved.poses(each.unspanned, _CLIP_POSES)
        ]
        followed: dict[int, Followed] = {}
        for number in system.clips:
            solved = part(number)
            followed[number] = crease.follow(solved)
            if fold.per_clip:
                chosen += solved.poses(followed[number].unspanned, _CLIP_POSES)
        fitted = [*crease.swept, *(followed.values() if fold.per_clip else ())]
        # The frames in which shapes leave crossings, and those in which they also take volume away.
        wrong = sum(len(each.crossing) for each in fitted), sum(len(each.unspanned) for each in fitted)
        found.append((crease, followed, wrong))
        if not any(wrong):
            break
    return min(found, key=lambda each: each[2])[:2]


def _effect(plan: MeshPlan, words: ContactWords, effects: Sequence[Effect]) -> Effect:
    """The effect of a fold."""
    crease = words.crease
    name = _identifier(plan, crease.fold, effects)
    if not len(crease.shapes):
        return Effect(name, SECTION, name, (), None, words)
    shapes = make_shapes(
        plan.fine,
        crease.fold.free_vertices,
        crease.shapes,
        tallest=plan.scale * np.sqrt(np.sum(crease.shapes**2, axis=2)).max(axis=1),
        samples=_samples(plan, crease, effects) if plan.has_normals else [],
        folded=True,
    )
    mixed = _nonnegative(shapes)
    columns = [number for number, shape in enumerate(mixed) if shape is not None]
    return contact_effect(words, name, columns, named_targets(name, mixed))


def _nonnegative(shapes: Sequence[Shape | None]) -> list[Shape | None]:
    """The shapes whose weights are in [0, 1]: sums of others with their fitted normals, as a fit of sums is worse."""
    made: list[Shape | None] = []
    for row in MOST_WEIGHT * signed(np.eye(len(shapes) + 1)):
        parts = [(shape, factor) for shape, factor in zip(shapes, row, strict=True) if shape is not None and factor]
        made.append(summed([shape for shape, _ in parts], np.array([each for _, each in parts])) if parts else None)
    return made


def _samples(plan: MeshPlan, crease: Crease, effects: Sequence[Effect]) -> list[Sample]:
    """States in which the normals of a fold are to be right, on top of the shapes of earlier effects.

    These are tools and fields, which act there without a spring, as some of the motions are in no file.
    """
    # Effects without a vertex in the fold change no normal that contact changes.
    near = [each for each in effects if any(map(partial(_touches, crease.fold), each.targets))]
    wrinkles = [(each.targets, each.drive) for each in near if isinstance(each.words, WrinkleWords)]
    tools = [(each, replace(drive, lag=None)) for each, drive in wrinkles if isinstance(drive, Drive) and drive.signal]
    acting = tools + [(each.targets, each.drive) for each in near if isinstance(each.drive, TurnDrive)]
    shapes = [target.shape for targets, _ in acting for target in targets]
    samples = list[Sample]()
    for _, poses in groupby(crease.samples, key=lambda each: id(each[1])):
        rows, (clip, *_), moments = zip(*poses, strict=True)
        times = np.array(moments)
        beneath = Playing([drive for _, drive in acting], plan.rig, clip).at(times).tolist()
        for row, pose, weights in zip(rows, poses_at(plan.rig, clip, times), beneath, strict=True):
            pairs = [(shape, weight) for shape, weight in zip(shapes, weights, strict=True) if weight]
            samples.append(Sample(row, pose, beneath=pairs))
    return samples


def _touches(fold: Fold, target: Target) -> bool:
    """True if a target moves a vertex of a fold, or turns its normal."""
    shape = target.shape
    return any(len(fold.shared_with(each)[0]) for each in (shape.vertices, shape.normal_vertices))


def _identifier(plan: MeshPlan, fold: Fold, effects: Sequence[Effect]) -> str:
    """The part of target names that is the fold's own, from its first tool; no other target of the mesh has it."""
    name = f"{fold.patches[0].tool.identifier}_contact"
    taken = {each.identifier for each in effects}
    while name in taken or any(own.startswith(f"wrinkle_{name}_") for own in plan.rig.morph_names):
        name += "_"
    return name
