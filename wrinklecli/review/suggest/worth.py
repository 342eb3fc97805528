"""Tools and fields that are worth keeping: each is tried on the refined mesh, looked at, scored and checked.

Each is looked at once, where it is tallest, or a little before, if the fold hides it then. One of which `check` would
warn gives way to others that fit the same place, so that the file passes `check --strict`.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import islice
from types import MappingProxyType
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from wrinklecli.baking.split import grown_bytes, planned_bytes
from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.rig import Rig
from wrinklecli.choices import Part
from wrinklecli.effects.effect import Seen
from wrinklecli.effects.faults import departure_warnings, turned_warnings
from wrinklecli.effects.sampling import seen_at
from wrinklecli.errors import BakeError, counted, listed
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, face_normals, unit
from wrinklecli.numeric.guard import Progress, log_progress
from wrinklecli.numeric.processes import in_processes
from wrinklecli.review.preview.sides import UNSEEN, Side, best_moment, part_not_hidden
from wrinklecli.review.suggest.look import Sight, look_at
from wrinklecli.review.suggest.score import REASONS, Merits, Score
from wrinklecli.review.suggest.stage import Placement, StagedTool
from wrinklecli.review.suggest.trial import Suggested, Trial, TriedAsset
from wrinklecli.tools.records import EffectTool, RefinementSettings, Sampling

# Height over the size of a place below which a tool is not raised: a hair on a hand.
_RAISED = 1e-3
# Joints whose folds contact closes, as each bends one limb: hips and shoulders over one trunk are in each other's way.
_OF_CONTACT: tuple[Part, ...] = ("lower arm", "lower leg")
# Shapes of contact, each over all of the place: the median of the folds in contact.csv.
_SHAPES_OF_CONTACT = 7
# Contrast that one does not notice, root mean square over the lightness: one notices 0.01 to 0.02 in the laboratory, on
# a plain field and at leisure, and twice as much on a textured figure in motion.
_UNNOTICED = 0.035
# Part of a place's length that is an end of it, and of its width that is a side.
_ENDS = 0.3
# Greatest angle beyond half a turn by which sides have passed each other where a fold is shut, radians.
_PASSED = math.radians(45.0)
# Suggestions that are looked at for each that may be kept. The next best ones fold ever less.
_LOOKS = 3
# Frames of a clip that are checked: eleven minutes.
_MOST_FRAMES = 20_000

AnySuggested = TypeVar("AnySuggested", bound=Suggested)


@dataclass(frozen=True, slots=True)
class Dropped:
    """A suggestion that is not worth keeping.

    Attributes:
        name: Of the tool or the field.
        mesh: Name of the node.
        reason: A word for why.
        value: The number that decided.
        warning: The line of `check`, or of a bake that refuses it, or the memory, if that is the reason.
    """

    name: str
    mesh: str
    reason: str
    value: float
    warning: str = ""

    @classmethod
    def costly(cls, suggestion: Suggested, size: int) -> "Dropped":
        """A suggestion that is over the budget, with its bytes on a GPU."""
        return cls(suggestion.effect.name, suggestion.mesh, "costly", float(size), f"{size / 1e6:.1f} MB")

    @classmethod
    def refused(cls, suggestion: Suggested, error: BakeError) -> "Dropped":
        """A suggestion that a bake refuses, without the place in the file, which nobody has."""
        why = error.lines[0].removeprefix(f"{error.places[0]}: ")
        return cls(suggestion.effect.name, suggestion.mesh, "refused", 0.0, why)

    @property
    def line(self) -> str:
        """The reason in words, for people."""
        value = self.warning.removeprefix(f"{self.name}: ") if self.warning else f"{100 * self.value:.0f} %"
        return f"{self.mesh}: left out {self.name}: {_SENTENCES[self.reason].format(value)}"


_SENTENCES = {
    "not raised": "no clip raises it",
    "coarse": "its triangles are too long to show wrinkles there",
    "warned": "`check` would warn: {}",
    "refused": "{}",
    "costly": "it takes {} on a GPU, more than --budget leaves",
    **dict(REASONS.values()),
}


@dataclass(frozen=True, slots=True)
class Worthwhile(Generic[AnySuggested]):
    """Suggestions that are worth keeping.

    Attributes:
        kept: Best first.
        refinement: Fine enough for them.
        dropped: Those that are not worth it.
    """

    kept: list[AnySuggested]
    refinement: RefinementSettings
    dropped: list[Dropped]

    @property
    def summary(self) -> list[str]:
        """A line that counts what is dropped, by reason; none without any."""
        reasons = Counter(each.reason for each in self.dropped)
        why = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
        meshes = listed(dict.fromkeys(each.mesh for each in self.dropped))
        line = f"{meshes}: left out {counted(reasons.total(), 'tool')} not worth it: {why}; -v says more"
        return [line] if reasons else []


class Draft(NamedTuple):
    """A suggestion on the refined mesh, before that carries a field, which takes long.

    Attributes:
        needed: The refinement that it needs.
        placed: It and its twin, by name.
        cost: What they take on a GPU at most, bytes.
        limb: True if a limb folds there.
        merits: Makes its merits of those that a look finds; the others are known.
    """

    needed: RefinementSettings
    placed: dict[str, Placement]
    cost: int
    limb: bool
    merits: Callable[..., Merits]


@dataclass(frozen=True, slots=True)
class Judge:
    """Tries, looks at, scores and checks suggestions.

    Attributes:
        asset: With all clips.
        everything: Keep all that can be baked, as they are, with their scores and whatever they take.
        checked: Clips that `check` looks at.
        progress: Called with a stage's name, those found or left out so far, and those with the ones looked at.
    """

    asset: TriedAsset
    everything: bool
    checked: Sequence[Clip] = ()
    progress: Progress = log_progress

    def worthwhile(
        self,
        suggestions: Iterable[AnySuggested],
        least: RefinementSettings,
        *,
        count: int,
        budget: float = math.inf,
        drafts: Mapping[str, Dropped | Draft] = MappingProxyType({}),
    ) -> Worthwhile[AnySuggested]:
        """Try and look at suggestions, best first, until some are worth keeping.

        Args:
            suggestions: Best first; so many are taken as are needed.
            least: What the tools file has at least.
            count: Most to keep.
            budget: Most bytes on a GPU that they may take; the best that fit are kept.
            drafts: Those that are known already, by name.
        """
        budget = math.inf if self.everything else budget
        found = Worthwhile[AnySuggested]([], least, [])
        remaining = islice(suggestions, count if self.everything else _LOOKS * count)
        while batch := list(islice(remaining, count - len(found.kept))):
            known = len(found.kept) + len(found.dropped)
            tried = in_processes(partial(self._tried, least, budget, drafts), batch, self.asset.jobs)
            for step, (each, needed) in enumerate(tried, 1):
                self.progress("looking", known + step, known + len(batch))
                if isinstance(each, Dropped):
                    found.dropped.append(each)
                elif each.gpu_bytes > budget:
                    found.dropped.append(Dropped.costly(each, each.gpu_bytes))
                else:
                    budget -= each.gpu_bytes
                    found.kept.append(each)
                    levels = max(found.refinement.max_levels, needed.max_levels)
                    scheme = "midpoint" if "midpoint" in (found.refinement.scheme, needed.scheme) else least.scheme
                    found = replace(found, refinement=replace(least, max_levels=levels, scheme=scheme))
        return found

    def drafted(self, least: RefinementSettings, suggestion: Suggested) -> Dropped | Draft:
        """Attach a suggestion, and refine the mesh for it; facets, which are cheap to know, count before that."""
        dropped = partial(Dropped, suggestion.effect.name, suggestion.mesh)
        needed, placed = least, dict[str, Placement]()
        try:
            trials = Trial.of(self.asset, suggestion)
            limb = not suggestion.by_morph and trials[0].attached[0].segment is not None
            smooth = min(each.smooth for each in trials)
            bend = 1.0 if limb else math.nan
            fine = min(each.fine for each in trials) if limb else math.nan
            merits = partial(Merits, smooth=smooth, uniform=suggestion.uniform, fine=fine, grown=suggestion.grown)
            best = Score.of(merits(seen=1.0, crests=1.0, closed=bend, around=bend))
            if not (self.everything or best.is_kept):
                return dropped(*best.reason)
            for trial in trials:
                needed, more = trial.placed(needed)
                placed |= more
        except BakeError as error:
            return Dropped.refused(suggestion, error)
        coarse = any(each.coarse for each in placed.values())
        return dropped("coarse", 0.0) if coarse else Draft(needed, placed, _cost(placed), limb, merits)

    def _tried(
        self,
        least: RefinementSettings,
        budget: float,
        drafts: Mapping[str, Dropped | Draft],
        suggestion: AnySuggested,
    ) -> tuple[AnySuggested | Dropped, RefinementSettings]:
        """A suggestion that is worth keeping, or one that fits the same place, with the refinement that it needs."""
        dropped = partial(Dropped, suggestion.effect.name, suggestion.mesh)
        draft = drafts.get(suggestion.effect.name) or self.drafted(least, suggestion)
        if isinstance(draft, Dropped):
            return draft, least
        needed, placed, cost, limb = draft.needed, draft.placed, draft.cost, draft.limb
        if cost > budget:
            return Dropped.costly(suggestion, cost), least
        try:
            placement = placed[suggestion.effect.name]
            seen = cache(lambda name: _seen(placed[name], suggestion.clips_among(self.checked, placed[name].part)))
            if not suggestion.clip:
                if not seen(suggestion.effect.name):
                    return dropped("not raised", 0.0), needed
                clip, time = _tallest(placement, seen(suggestion.effect.name))
                suggestion = replace(suggestion, clip=clip, time=time)
            tallest = StagedTool.of(placement, self.asset.layers, self.asset.clip(suggestion.clip), suggestion.time)
            raised = tallest.height > _RAISED * tallest.size
            judged = replace(
                suggestion,
                height=tallest.height if raised else 0.0,
                wavelength=placement.attached.bump_width,
                targets=sum(len(each.part.drive.targets) for each in placed.values()),
                gpu_bytes=cost,
                own_bytes=sum(map(grown_bytes, {id(each.plan): each.plan for each in placed.values()}.values())),
                judgement=Score.of(self._merits(draft, suggestion, tallest)) if raised else None,
            )
        except BakeError as error:
            return Dropped.refused(suggestion, error), least
        if self.everything:
            return judged, needed
        if judged.judgement is None:
            return dropped("not raised", 0.0), needed
        if not judged.judgement.is_kept:
            return dropped(*judged.judgement.reason), needed
        if limb and suggestion.part in _OF_CONTACT and tallest.has_slit:
            judged = judged.crossing(tallest.crossings)
            judged = replace(judged, gpu_bytes=_cost(placed, judged.effect))
        warning, compressible = _checked(placed, seen)
        if not warning:
            return judged, needed
        other = suggestion.mended(compressible)
        return self._tried(least, budget, {}, other) if other else (dropped("warned", 0.0, warning), needed)

    def _merits(self, draft: Draft, suggestion: Suggested, tallest: StagedTool) -> Merits:
        """The merits of a suggestion where one sees it best: where it is tallest, or before if a fold hides it then.

        Its twin is not looked at, as it is the same in a mirror. If not `everything` is looked at, a fold that is too
        open where it is tallest has the best merits that it could get.
        """
        placement, limb = draft.placed[suggestion.effect.name], draft.limb
        clip, peak = self.asset.clip(suggestion.clip), suggestion.time
        best_merits = draft.merits(seen=1.0, crests=1.0, **_bends(tallest, limb=limb))
        if not (self.everything or Score.of(best_merits).is_kept):
            return best_merits

        def look(time: float) -> tuple[tuple[StagedTool, Sight] | None, Side]:
            staged = tallest if time == peak else StagedTool.of(placement, self.asset.layers, clip, time)
            if staged.height <= _RAISED * staged.size:
                return None, UNSEEN
            sight = Sight.of(staged)
            return (staged, sight), sight.best_side

        best, side = best_moment(clip.start if clip.start < peak else clip.end, peak, look)
        assert best is not None
        staged, sight = best
        side, crests = look_at(staged, sight, side)
        return draft.merits(
            seen=side.visible if limb else part_not_hidden(sight.place, side),
            crests=crests.contrast * crests.share / (crests.contrast + _UNNOTICED),
            **_bends(staged, limb=limb),
        )


def _cost(placed: dict[str, Placement], effect: EffectTool | None = None) -> int:
    """Bytes on a GPU of a suggestion and its twin, with contact where its record asks for it."""
    shapes = _SHAPES_OF_CONTACT if effect and "folds" in effect.sections else 0
    return sum(
        planned_bytes(each.plan, [*each.targets, *(each.part.vertices for _ in range(shapes))])
        for each in placed.values()
    )


def _seen(placement: Placement, clips: Sequence[Clip]) -> list[Seen]:
    """It in clips, frame by frame."""
    part, rig = placement.part, placement.plan.rig
    return [seen_at(part, rig, clip, _frames_of(clip, rig)) for clip in clips]


def _checked(placed: dict[str, Placement], seen: Callable[[str], list[Seen]]) -> tuple[str, float]:
    """The first warning of `check`, or an empty string, and the `compressible` that a tool needs."""
    warnings, needed = list[str](), 0.0
    for name, placement in placed.items():
        plan, part, own = placement.plan, placement.part, seen(name)
        lines = part.words(plan).warnings(plan, own, "y")
        if part.attached.segment is not None:
            lines += departure_warnings(plan.fine, [part]) + turned_warnings(plan, part, own)
        if lines:
            lengths = ((each.reading.distances, each.reading.rest_lengths) for each in own)
            needed = max(needed, math.ceil(100.0 * part.attached.fitting_compressible(lengths)) / 100.0)
        warnings += lines
    return (warnings or [""])[0], needed


def _tallest(placement: Placement, seen: Sequence[Seen]) -> tuple[str, float]:
    """The clip and the second in which a shape of a suggestion is taller than any other one ever is."""
    sizes = placement.part.sizes(placement.plan.fine)
    most = max(seen, key=lambda each: (each.weights * sizes).max())
    return most.motion.clip.name, float(most.motion.times[int((most.weights * sizes).max(axis=1).argmax())])


def _bends(staged: StagedTool, *, limb: bool) -> dict[str, float]:
    """The merits `closed` and `around` of a tool; NaN if no limb folds there."""
    us, vs = staged.places.T
    found = (_turned(staged, us, inwards=True), _turned(staged, (1.0 + vs) / 2.0, inwards=False))
    return dict(zip(("closed", "around"), found if limb else (math.nan, math.nan), strict=True))


def _turned(staged: StagedTool, parts: Floats, *, inwards: bool) -> float:
    """Measure how far two sides of a place are turned to each other, or away: 1 by half a turn, 0.5 on a plane.

    The sides are where (vertices,) `parts` of the way across the place are least and greatest.
    """
    triangles = staged.triangles[staged.place]
    corners, parts, areas = staged.plain[triangles], parts[triangles], face_normals(staged.plain, triangles)
    # Ways across, from how parts grow: positions of the sides pass each other in a fold that is all but shut.
    edges = np.roll(corners, 1, axis=1) - np.roll(corners, -1, axis=1)
    ways, middles = np.cross(unit(areas), np.einsum("tc,tca->ta", parts, edges)), parts.mean(axis=1)
    sides = [middles < _ENDS, middles > 1.0 - _ENDS]
    if not all(side.any() for side in sides):
        return 0.5
    (first, way), (last, way_last) = ((unit(areas[side].sum(axis=0)), unit(ways[side].sum(axis=0))) for side in sides)
    turn = math.atan2(first @ way_last - last @ way, first @ last + way @ way_last) * (1 if inwards else -1)
    return (1.0 + math.sin((turn + math.tau if turn < _PASSED - math.pi else turn) / 2.0)) / 2.0


def _frames_of(clip: Clip, rig: Rig) -> Floats:
    """(frames,) seconds at which a clip is looked at: its frames, or some of a very long one."""
    long = (clip.end - clip.start) * Sampling().fps > _MOST_FRAMES
    return np.linspace(clip.start, clip.end, _MOST_FRAMES) if long else clip_grid(clip, rig, fps=Sampling().fps)
