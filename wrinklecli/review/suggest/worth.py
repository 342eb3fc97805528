"""Suggested tools that are worth keeping: each is tried on the refined mesh, looked at, and scored.

A tool is looked at once, where it is tallest, or a little before, if the fold hides it then.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import field, replace
from functools import partial
from itertools import islice

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
from wrinklecli.review.suggest.look import Sight, look_at
from wrinklecli.review.suggest.score import REASONS, Merits, Score
from wrinklecli.review.suggest.stage import Stage, StagedTool
from wrinklecli.review.suggest.trial import Placement, TriedAsset, names_of, try_on_refined_meshes
from wrinklecli.tools.records import Contact, RefinementSettings

# Height over the size of a place below which a tool is not raised: a hair on a hand.
_RAISED = 1e-3
# Height of a twin over that of the tool above which both must be seen.
_AS_TALL = 0.5
# Edges that begin to cross, over the square root of the place's edges, which is how many a line across it meets, from
# which a fold has a slit, which contact closes: a tenth of a line across the place.
_SLIT = 0.1
# Joints whose folds contact closes, as each bends one limb: hips and shoulders over one trunk are in each other's way.
_OF_CONTACT: tuple[Part, ...] = ("lower arm", "lower leg")
# Shortening from which a fold is closed so far that contact finds no room for it.
_DEEPEST = 0.9
# Parts of a body whose joints fold what is around them; around other joints it slides, bulges or is stiff.
_FOLDING: tuple[Part | None, ...] = (
    None,
    "lower arm",
    "lower leg",
    "upper leg",
    "hand",
    "palm",
    "finger",
    "toes",
    "hips",
    "spine",
)
# Contrast that one does not notice, root mean square over the lightness: one notices 0.01 to 0.02 in the laboratory, on
# a plain field and at leisure, and twice as much on a textured figure in motion.
_UNNOTICED = 0.035
# Suggestions that are looked at for each that may be kept. The next best ones fold ever less.
_LOOKS = 3


@dataclass(frozen=True, slots=True)
class Dropped:
    """A suggestion that is not worth keeping.

    Attributes:
        name: Of the tool.
        mesh: Name of the node.
        reason: A word for why.
        value: The number that decided.
        warning: The line of `check`, or of a bake that refuses it, if that is the reason.
        keep: The probability that an artist keeps it; None if nobody looked.
    """

    name: str
    mesh: str
    reason: str
    value: float
    warning: str = ""
    keep: float | None = None

    @property
    def line(self) -> str:
        """The reason in words, for people."""
        value = self.warning.removeprefix(f"{self.name}: ") if self.warning else f"{100 * self.value:.0f} %"
        return f"{self.mesh}: left out {self.name}: {_SENTENCES[self.reason].format(value)}"


_SENTENCES = {
    "not raised": "no clip raises it",
    "warned": "`check` would warn: {}",
    "refused": "{}",
    **dict(REASONS.values()),
}


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
        everything: Keep all that can be baked, with their scores.
        joined: Clips in which suggestions may be tallest, besides those of the asset.
    """
    stage = Stage(asset.scene, (*joined, *asset.clips))
    found = Worthwhile([], refinement, [], [])
    remaining = islice(suggestions, count if everything else _LOOKS * count)
    while batch := list(islice(remaining, count - len(found.tools))):
        trial = try_on_refined_meshes(asset, batch, found.refinement)
        found = replace(found, refinement=trial.refinement)
        found.notes.extend(trial.notes)
        judge = partial(_judged, stage, trial.placed, everything)
        for each in in_processes(judge, trial.tools, asset.jobs):
            if isinstance(each, Dropped):
                found.dropped.append(each)
            else:
                found.tools.append(each)
                # Refined meshes are large, and those of dropped tools are needed no more.
                found.placed.update({name: trial.placed[name] for name in names_of(each, trial.placed)})
        stage.let_go()
    return found


def _judged(
    stage: Stage, placed: dict[str, Placement], everything: bool, suggestion: Suggestion
) -> Suggestion | Dropped:
    """A suggestion that is worth keeping, or the reason why it is not."""
    moments = [(suggestion.clip, suggestion.time), suggestion.twin_moment]
    looks = []
    for name, moment in zip(names_of(suggestion, placed), moments, strict=False):
        look = None if moment is None else _look(stage, placed[name], *moment)
        if look is not None:
            looks.append(look)
        elif name == suggestion.tool.name:
            return suggestion if everything else Dropped(name, suggestion.mesh, "not raised", 0.0)
    limb = suggestion.part in _OF_CONTACT and not suggestion.by_morph
    touches = limb and suggestion.shortening < _DEEPEST and any(_has_slit(look.tallest) for look in looks)
    resolved = touches and kind_of("folds").is_installed
    # Tools of a face lie where people have lines, whatever joint moves them.
    folding = suggestion.substance is None or suggestion.by_morph or suggestion.part in _FOLDING
    # A twin that a clip hardly raises is hardly seen either; one that rises as far must look as good.
    tallest = max((look.best.height for look in looks), default=0.0)
    sides = [each.scored(resolved=resolved, folding=folding) for each in looks if each.best.height > _AS_TALL * tallest]
    if sides:
        score = min(sides, key=lambda each: each.keep)
        if not (score.is_kept or everything):
            return Dropped(suggestion.tool.name, suggestion.mesh, *score.reason, keep=score.keep)
        suggestion = replace(suggestion, judgement=score)
    if touches and not everything:
        tool = replace(suggestion.tool, contact=Contact()) if resolved else suggestion.tool
        suggestion = replace(suggestion, tool=tool, crossings=max(look.tallest.crossings[1] for look in looks))
    return replace(suggestion, one_sided=suggestion.twin_moment is not None and len(looks) == 1)


def fault_of(stage: Stage, placement: Placement, clip: str, time: float) -> tuple[str, float] | None:
    """Why a field is not worth it where it is tallest, with the number that says so; None if it is."""
    look = _look(stage, placement, clip, time)
    if look is None:
        return "not raised", 0.0
    score = look.scored(resolved=False, folding=True)
    return None if score.is_kept else score.reason


@dataclass(frozen=True, slots=True)
class _Look:
    """A look at a tool.

    Attributes:
        placement: The tool on the refined mesh.
        best: The tool where one sees it best, with what may hide it then, and the side from which.
        tallest: The tool at its peak, where a fold may hide it.
        teeth: Part of it at its peak that is turned over.
    """

    placement: Placement
    best: StagedTool
    sight: Sight
    side: Side
    tallest: StagedTool
    teeth: float

    def scored(self, *, resolved: bool, folding: bool) -> Score:
        """Measure and weigh the tool; contact keeps apart what is `resolved`, and a limb may be `folding` there."""
        seen, staged = look_at(self.best, self.sight, self.side), self.tallest
        before, after = (0, 0) if resolved else staged.crossings
        hard = float(self.placement.plan.fine.hard_shares[self.placement.part.region])
        light = seen.crests.contrast + _UNNOTICED
        return Score.of(
            Merits(
                seen=seen.side.visible,
                crests=seen.crests.contrast * seen.crests.share / light,
                smooth=1.0 - hard,
                whole=1.0 - (self.teeth + staged.bared() + max(after - before, 0) / max(staged.edge_count, 1)),
                limb=float(folding),
            )
        )


def _look(stage: Stage, placement: Placement, name: str, peak: float) -> _Look | None:
    """Look at a tool in a clip at its peak, or before if a fold hides it then; None if the clip does not raise it."""
    clip = stage.clip(name)
    first = stage.staged(placement.plan, placement.part, name, peak)
    if first.height <= _RAISED * first.size:
        return None

    def look(time: float) -> tuple[tuple[StagedTool, Sight] | None, Side]:
        staged = first if time == peak else stage.staged(placement.plan, placement.part, name, time)
        if staged.height <= _RAISED * staged.size:
            return None, UNSEEN
        sight = Sight.of(staged)
        return (staged, sight), sight.best_side

    start = clip.start if clip.start < peak else clip.end
    best, side = best_moment(start, peak, look)
    assert best is not None
    teeth = count_teeth(placement.plan, placement.part, clip, peak) / max(int(first.place.sum()), 1)
    return _Look(placement, *best, side, first, teeth)


def _has_slit(staged: StagedTool) -> bool:
    """True if a fold crosses along so much of its length that contact should close it."""
    return staged.crossings[1] > _SLIT * float(np.sqrt(staged.edge_count))
