"""Suggested tools that are worth keeping: each is tried on the refined mesh, looked at, and left out with a reason.

A tool is looked at where it is tallest, or a little before, if the fold hides it then.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import field, replace
from functools import partial
from itertools import chain, islice

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.choices import Part
from wrinklecli.effects.faults import count_teeth
from wrinklecli.effects.order import kind_of
from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.processes import in_processes
from wrinklecli.review.preview.sides import UNSEEN, Side, best_moment
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.look import Seen, Sight, look_at
from wrinklecli.review.suggest.stage import Stage, StagedTool
from wrinklecli.review.suggest.trial import Placement, TrialResult, TriedAsset, names_of, try_on_refined_meshes
from wrinklecli.tools.records import Contact, RefinementSettings, WrinkleTool

# Part of a tool's wrinkles below which other parts hide it: of wrinkles round a limb, half and more are visible, and of
# those that one sees only at a slant of 75°, between two layers, 0.43.
_HIDDEN = 0.45
# Height over the size of a place below which a tool is not raised: a hair on a hand.
_RAISED = 1e-3
# Height of a twin over that of the tool above which both must be seen.
_AS_TALL = 0.5
# Least contrast of crests, root mean square over the lightness: light and dark flanks then differ by 0.1. One notices
# 0.01 to 0.02 in the laboratory, on a plain field and at leisure; several times as much on a textured figure in motion.
# Lines of faces and hands are looked at from nearer.
_LEAST_CONTRAST = {"near": 0.015, "body": 0.035}
_LOOKED_AT_NEAR: tuple[Part, ...] = ("neck", "head", "hand", "palm", "finger")
# Least contrast of crests over the change of light that refinement makes by itself: below, one sees a rounder limb in
# place of wrinkles. Elbows of low-poly arms have 0.3 to 0.4 and look so, tools that one sees have 0.45 and more.
_LEAST_BESIDE_ROUNDING = 0.4
# Least part of the change of light that follows the crests: those of wrists, elbows and brows have 0.75 and more, folds
# that wander, join and cross 0.56 and more, and dents, dirt and specks 0.3 to 0.52.
_LEAST_CRESTS = 0.55
# Edges that begin to cross, over the square root of the place's edges, which is how many a line across it meets. The
# sides of a fold that closes cross along one line, and each side has its edges there; wrinkles that come through
# clothes, or through each other, cross all over the place.
_MOST_CROSSING = 3.0
# The same from which a fold has a slit, which contact closes: a tenth of a line across the place.
_SLIT = 0.1
# Joints whose folds contact closes, as each bends one limb: hips and shoulders over one trunk are in each other's way.
_OF_CONTACT: tuple[Part, ...] = ("lower arm", "lower leg")
# Shortening from which a fold is closed so far that contact finds no room for it.
_DEEPEST = 0.9
# Part of what is seen of a place that shows triangles turned over: on a picture of a place, a dark tile of 16 pixels.
_MOST_TURNED = 0.01
# Part of a place through which skin may come, or another layer: a spot of a seventh of its length and width. In a fold
# refined clothes sink below what they cover, which is not refined.
_MOST_BARED = 0.02
# Greatest departure of the refined surface from the coarse one in the pose, over the height of the wrinkles: of facets,
# as much as refinement may round a surface at rest; where shading is smooth, so much that one sees a rounder bend in
# place of wrinkles.
_MOST_DEPARTURE = {"facets": 0.15, "smooth": 2.0}
# Part of a place's edges that are hard above which it is made of facets: a third of the edges of quads are diagonals,
# and those along a straight limb lie between facets of one plane.
_FACETED = 0.25
# Part of new vertices that stay below that departure.
_MOST_VERTICES = 0.9
# Suggestions that are looked at for each that may be kept. The next best ones fold ever less.
_LOOKS = 3
# Seeds that are tried where one side of a pair alone harms the surface; each takes a refinement of the mesh.
_SEEDS = (1, 2)


@dataclass(frozen=True, slots=True)
class Dropped:
    """A suggestion that is not worth keeping.

    Attributes:
        name: Of the tool.
        mesh: Name of the node.
        reason: A word of `REASONS`.
        value: The number that decided.
        warning: The line of `check`, if that is the reason.
        on_one_side: True if its mirror image is worth keeping, or if it is and the mirror image is not.
    """

    name: str
    mesh: str
    reason: str
    value: float
    warning: str = ""
    on_one_side: bool = False

    @property
    def line(self) -> str:
        """The reason in words, for people."""
        value = f"{100 * self.value:.0f} %" if self.reason != "crosses" else f"{self.value:g}"
        value = self.warning.removeprefix(f"{self.name}: ") if self.warning else value
        return f"{self.mesh}: left out {self.name}: {REASONS[self.reason].format(value)}"


REASONS = {
    "not raised": "no clip raises it",
    "bends": "refinement alone would move the surface by {} of the wrinkles' height",
    "hidden": "other parts hide it: at most {} of its wrinkles can be seen from any side",
    "crosses": "it would make the surface pass through itself at {} more edges",
    "turns": "it would turn triangles over, which show as teeth on {} of the place",
    "bared": "what lies beneath would come through on {} of the place",
    "unseen": "its wrinkles are hardly seen: they change the light by {}",
    "rounded": "one sees how refinement rounds the surface, not its wrinkles: these change the light by {} of that",
    "no crests": "what one sees of it is lumps or specks: {} of the change of light follows its crests",
    "warned": "`check` would warn: {}",
    "refused": "{}",
}
"""Reasons to leave out a tool, in words with a place for the value; the first one that holds is said."""


@dataclass(frozen=True, slots=True)
class Worthwhile:
    """Suggestions that are worth keeping.

    Attributes:
        tools: Best first.
        refinement: Fine enough for the tools.
        dropped: Those that are not worth it.
        notes: A line for each tool that no refinement shows.
        placed: Those of the tools that were looked at, and their twins, on refined meshes, by name.
    """

    tools: list[Suggestion]
    refinement: RefinementSettings
    dropped: list[Dropped]
    notes: list[str]
    placed: dict[str, Placement] = field(default_factory=dict)

    @property
    def summary(self) -> list[str]:
        """A line for each mesh that counts what is dropped, by reason."""
        lines = []
        for mesh in dict.fromkeys(each.mesh for each in self.dropped):
            reasons = Counter(each.reason for each in self.dropped if each.mesh == mesh)
            why = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
            lines.append(f"{mesh}: left out {counted(reasons.total(), 'tool')} not worth it: {why}; -v says more")
        return lines


def worthwhile(
    asset: TriedAsset,
    suggestions: Iterable[Suggestion],
    refinement: RefinementSettings,
    *,
    count: int,
    everything: bool,
    joined: Sequence[Clip] = (),
) -> Worthwhile:
    """Try and look at suggestions, best first, until some are worth keeping.

    Args:
        asset: With all clips.
        suggestions: Best first; so many are taken as are needed.
        refinement: What the tools file has at least.
        count: Most tools to keep.
        everything: Keep all that can be baked, without a look.
        joined: Clips in which suggestions may be tallest, besides those of the asset.
    """
    stage: Stage | None = None
    found = Worthwhile([], refinement, [], [])
    remaining = islice(suggestions, count if everything else _LOOKS * count)
    while batch := list(islice(remaining, count - len(found.tools))):
        trial = try_on_refined_meshes(asset, batch, found.refinement)
        found = replace(found, refinement=trial.refinement)
        found.notes.extend(trial.notes)
        if everything:
            found.tools.extend(trial.tools)
            continue
        stage = stage or Stage(asset.scene, (*joined, *asset.clips))
        judge = partial(_judged, stage, trial, asset)
        for each in in_processes(judge, trial.tools, asset.jobs):
            if isinstance(each, Dropped):
                found.dropped.append(each)
            else:
                found.tools.append(each)
                # Refined meshes are large, and those of dropped tools are needed no more.
                found.placed.update({name: trial.placed[name] for name in names_of(each, trial.placed)})
        stage.let_go()
    return found


def _judged(stage: Stage, trial: TrialResult, asset: TriedAsset, suggestion: Suggestion) -> Suggestion | Dropped:
    """A suggestion of a trial, lower if it must be, or the reason why it is dropped."""
    judged = _judge(stage, suggestion, trial.placed)
    if isinstance(judged, Dropped):
        for other in _others(suggestion, judged):
            again = try_on_refined_meshes(asset, [other], trial.refinement, variants=True)
            found = next((_judge(stage, one, again.placed) for one in again.tools), judged)
            if isinstance(found, Suggestion):
                return found
    return judged


def _others(suggestion: Suggestion, dropped: Dropped) -> Iterator[Suggestion]:
    """Give variants of a suggestion that harms the surface, which may harm less."""
    tool = suggestion.tool
    if dropped.on_one_side and tool.variation > 0 and dropped.reason != "bared":
        # A pair has two irregularities, by its names. With a seed, both sides are irregular alike.
        yield from (replace(suggestion, tool=replace(tool, seed=seed), lower=None) for seed in _SEEDS)
    lowered = suggestion.lowered
    if dropped.reason in ("crosses", "turns") and lowered is not None:
        # A lower wrinkle that is seen is worth more than none.
        yield lowered
    smoothed = suggestion.smoothed
    if dropped.reason == "turns" and smoothed is not None:
        yield smoothed


def _judge(stage: Stage, suggestion: Suggestion, placed: dict[str, Placement]) -> Suggestion | Dropped:
    """A suggestion that is worth keeping, or the reason why it is not."""
    moments = [(suggestion.clip, suggestion.time), suggestion.twin_moment]
    looks = []
    for name, moment in zip(names_of(suggestion, placed), moments, strict=False):
        look = None if moment is None else _look(stage, placed[name], *moment)
        if isinstance(look, float):
            return Dropped(suggestion.tool.name, suggestion.mesh, "bends", look)
        if look is not None:
            looks.append(look)
        elif name == suggestion.tool.name:
            return Dropped(name, suggestion.mesh, "not raised", 0.0)
    limb = suggestion.part in _OF_CONTACT and not suggestion.by_morph
    touches = limb and suggestion.shortening < _DEEPEST and any(_has_slit(look.tallest) for look in looks)
    resolved = touches and kind_of("folds").is_installed
    # A twin that a clip hardly raises is hardly seen either; one that rises as far must look as good.
    tallest = max((look.staged.height for look in looks), default=0.0)
    near = suggestion.by_morph or suggestion.part in _LOOKED_AT_NEAR
    contrast = _LEAST_CONTRAST["near" if near else "body"]
    harms = [list(_faults(look, resolved=resolved)) for look in looks]
    # What harms the surface is dropped from whatever side one looks.
    looks = [look if harm else look.from_beside() for look, harm in zip(looks, harms, strict=True)]
    sides = [
        [*harm, *(_sight(look.seen, contrast) if look.staged.height > _AS_TALL * tallest else ())]
        for look, harm in zip(looks, harms, strict=True)
    ]
    faults = sorted((fault for side in sides for fault in side), key=lambda fault: list(REASONS).index(fault[0]))
    # A pair is kept for the side on which one sees its wrinkles better. Morph targets bend no limb that becomes round.
    seen = [] if faults or suggestion.by_morph else [look.seen for look in looks]
    if seen and all(each.crests.contrast < _LEAST_BESIDE_ROUNDING * each.rounding for each in seen):
        faults = [("rounded", max(each.crests.contrast / each.rounding for each in seen))]
    if faults:
        reason, value = faults[0]
        on_one_side = sum(map(bool, sides)) < len(looks)
        return Dropped(suggestion.tool.name, suggestion.mesh, reason, value, on_one_side=on_one_side)
    if touches:
        tool = replace(suggestion.tool, contact=Contact()) if resolved else suggestion.tool
        suggestion = replace(suggestion, tool=tool, crossings=max(look.tallest.crossings[1] for look in looks))
    return replace(suggestion, one_sided=suggestion.twin_moment is not None and len(looks) == 1)


def fault_of(stage: Stage, placement: Placement, clip: str, time: float) -> tuple[str, float] | None:
    """Why a field is not worth it where it is tallest, with the number that says so; None if it is."""
    look = _look(stage, placement, clip, time)
    if look is None or isinstance(look, float):
        return ("not raised", 0.0) if look is None else ("bends", look)
    return next(chain(_faults(look, resolved=False), _sight(look.seen, _LEAST_CONTRAST["body"])), None)


@dataclass(frozen=True, slots=True)
class _Look:
    """A look at a tool.

    Attributes:
        tool: What is looked at.
        staged: The tool where one sees it best.
        sight: What may hide it then.
        seen: What one sees of it then.
        tallest: The tool at its peak, where a fold may hide it.
        turned: Part of it at its peak that is turned over: of what is seen of it, or of all if `check` would warn.
    """

    tool: WrinkleTool
    staged: StagedTool
    sight: Sight
    seen: Seen
    tallest: StagedTool
    turned: float

    def from_beside(self) -> "_Look":
        """The look from a side next to the best one, if more of what one sees there follows the crests.

        The best side shows most of the wrinkles, and may look along some of them: people turn the view.
        """
        if self.seen.crests.share >= _LEAST_CRESTS:
            return self
        others = [look_at(self.staged, self.sight, each) for each in self.seen.side.beside]
        seen = max(
            [self.seen, *(each for each in others if each.crests.contrast >= self.seen.crests.contrast)],
            key=lambda each: each.crests.share,
        )
        return replace(self, seen=seen)


def _look(stage: Stage, placement: Placement, name: str, peak: float) -> _Look | float | None:
    """Look at a tool in a clip at its peak, or before if a fold hides it then.

    None if the clip does not raise it; how far refinement bends the surface if that is too far, as no look is needed.
    """
    clip = stage.clip(name)
    first = stage.staged(placement.plan, placement.part, name, peak)
    if first.height <= _RAISED * first.size:
        return None
    bent = _bent(placement, first)
    if bent is not None:
        return bent

    def look(time: float) -> tuple[tuple[StagedTool, Sight] | None, Side]:
        staged = first if time == peak else stage.staged(placement.plan, placement.part, name, time)
        if staged.height <= _RAISED * staged.size:
            return None, UNSEEN
        sight = Sight.of(staged)
        return (staged, sight), sight.best_side

    tallest, side_then = look(peak)
    assert tallest is not None
    start = clip.start if clip.start < peak else clip.end
    best, side = best_moment(start, peak, lambda time: (tallest, side_then) if time == peak else look(time))
    best = best or tallest
    seen = look_at(*best, side)
    over = tallest[0].turned_over()
    if over.any():
        at_peak = seen if best is tallest else look_at(*tallest, side_then)
        over = over[at_peak.shown]
    shown = float(over.mean()) if len(over) else 0.0
    teeth = count_teeth(placement.plan, placement.part, clip, peak) / max(int(tallest[0].place.sum()), 1)
    return _Look(placement.part.attached.tool, *best, seen, tallest[0], max(shown, teeth))


def _has_slit(staged: StagedTool) -> bool:
    """True if a fold crosses along so much of its length that contact should close it."""
    return staged.crossings[1] > _SLIT * float(np.sqrt(staged.edge_count))


def _sight(seen: Seen, contrast: float) -> Iterator[tuple[str, float]]:
    """Give why crests of at least this contrast are not seen of a tool, with the number that says so."""
    if seen.side.visible < _HIDDEN:
        yield "hidden", seen.side.visible
    elif seen.crests.contrast < contrast:
        yield "unseen", seen.crests.contrast
    elif seen.crests.share < _LEAST_CRESTS:
        yield "no crests", seen.crests.share


def _faults(look: _Look, *, resolved: bool) -> Iterator[tuple[str, float]]:
    """Give the harms that a tool does to the surface, each with a number; contact keeps apart what is `resolved`."""
    staged = look.staged
    before, after = (0, 0) if resolved else staged.crossings
    if after - before > _MOST_CROSSING * np.sqrt(staged.edge_count):
        yield "crosses", after - before
    if look.turned > _MOST_TURNED:
        yield "turns", look.turned
    bared = look.tallest.bared()
    if bared > _MOST_BARED:
        yield "bared", bared


def _bent(placement: Placement, staged: StagedTool) -> float | None:
    """The distance by which refinement alone moves the surface, over the tool's height; None if that is not too far."""
    departures = staged.departures()
    if not len(departures):
        return None
    faceted = staged.shaded_flat or placement.plan.fine.hard_shares[placement.part.region] > _FACETED
    departure = float(np.quantile(departures, _MOST_VERTICES))
    return departure if departure > _MOST_DEPARTURE["facets" if faceted else "smooth"] else None
