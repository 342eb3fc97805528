"""Suggested tools that are worth keeping: each is tried on the refined mesh, looked at, scored and checked.

A tool is looked at once, where it is tallest, or a little before, if the fold hides it then. One of which `check`
would warn gives way to others that fit the same place, so that the file passes `check --strict`.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np

from wrinklecli.baking.split import grown_bytes, planned_bytes
from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.rig import Rig
from wrinklecli.choices import Part
from wrinklecli.effects.faults import departure_warnings, turned_warnings
from wrinklecli.effects.plan import kind_of
from wrinklecli.effects.sampling import seen_at
from wrinklecli.errors import BakeError, counted, listed
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, face_normals, unit
from wrinklecli.numeric.guard import Progress, log_progress
from wrinklecli.numeric.processes import in_processes
from wrinklecli.review.preview.sides import UNSEEN, Side, best_moment, part_not_hidden
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.look import Sight, look_at
from wrinklecli.review.suggest.score import REASONS, Merits, Score
from wrinklecli.review.suggest.shortening import MOST_COMPRESSIBLE
from wrinklecli.review.suggest.stage import Placement, StagedTool
from wrinklecli.review.suggest.trial import Trial, TriedAsset
from wrinklecli.tools.records import Contact, RefinementSettings, Sampling

# Height over the size of a place below which a tool is not raised: a hair on a hand.
_RAISED = 1e-3
# Edges that begin to cross, over the square root of the place's edges, which is how many a line across it meets, from
# which a fold has a slit, which contact closes: a tenth of a line across the place.
_SLIT = 0.1
# Joints whose folds contact closes, as each bends one limb: hips and shoulders over one trunk are in each other's way.
_OF_CONTACT: tuple[Part, ...] = ("lower arm", "lower leg")
# Shapes of contact, each over all of the place: the median of the folds in contact.csv.
_SHAPES_OF_CONTACT = 7
# Contrast that one does not notice, root mean square over the lightness: one notices 0.01 to 0.02 in the laboratory, on
# a plain field and at leisure, and twice as much on a textured figure in motion.
_UNNOTICED = 0.035
# Part of a tool's length that is an end of it.
_ENDS = 0.3
# Suggestions that are looked at for each that may be kept. The next best ones fold ever less.
_LOOKS = 3
# Clips in which a tool is checked frame by frame: those that shorten it most, as measured in fewer poses.
_MOST_CLIPS = 6
# Frames of a clip that are checked: eleven minutes.
_MOST_FRAMES = 20_000


@dataclass(frozen=True, slots=True)
class Dropped:
    """A suggestion that is not worth keeping.

    Attributes:
        name: Of the tool.
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
    def costly(cls, name: str, mesh: str, size: int) -> "Dropped":
        """A suggestion that is over the budget, with its bytes on a GPU."""
        return cls(name, mesh, "costly", float(size), f"{size / 1e6:.1f} MB")

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
class Worthwhile:
    """Suggestions that are worth keeping.

    Attributes:
        tools: Best first.
        refinement: Fine enough for the tools.
        dropped: Those that are not worth it.
    """

    tools: list[Suggestion]
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


def worthwhile(
    asset: TriedAsset,
    suggestions: Iterable[Suggestion],
    refinement: RefinementSettings,
    *,
    count: int,
    budget: float = math.inf,
    everything: bool,
    checked: Sequence[Clip] = (),
    progress: Progress = log_progress,
) -> Worthwhile:
    """Try and look at suggestions, best first, until some are worth keeping.

    Args:
        asset: With all clips.
        suggestions: Best first; so many are taken as are needed.
        refinement: What the tools file has at least.
        count: Most tools to keep.
        budget: Most bytes on a GPU that they may take; the best that fit are kept.
        everything: Keep all that can be baked, as they are, with their scores.
        checked: Clips that `check` looks at.
        progress: Called with a stage's name, the tools found or left out so far, and those with the ones looked at.
    """
    tried = partial(_tried, asset, refinement, None if everything else checked)
    found = Worthwhile([], refinement, [])
    remaining = islice(suggestions, count if everything else _LOOKS * count)
    while batch := list(islice(remaining, count - len(found.tools))):
        known = len(found.tools) + len(found.dropped)
        for step, (each, needed) in enumerate(in_processes(tried, batch, asset.jobs), 1):
            progress("looking", known + step, known + len(batch))
            if isinstance(each, Dropped):
                found.dropped.append(each)
            elif each.gpu_bytes > budget:
                found.dropped.append(Dropped.costly(each.tool.name, each.mesh, each.gpu_bytes))
            else:
                budget -= each.gpu_bytes
                found.tools.append(each)
                found = replace(found, refinement=_joined(found.refinement, needed))
    return found


def _joined(first: RefinementSettings, second: RefinementSettings) -> RefinementSettings:
    """The settings that are enough for two tools."""
    scheme = "midpoint" if "midpoint" in (first.scheme, second.scheme) else first.scheme
    return replace(first, max_levels=max(first.max_levels, second.max_levels), scheme=scheme)


def _tried(
    asset: TriedAsset,
    refinement: RefinementSettings,
    checked: Sequence[Clip] | None,
    suggestion: Suggestion,
) -> tuple[Suggestion | Dropped, RefinementSettings]:
    """A suggestion that is worth keeping, or one that fits the same place, with the refinement that it needs.

    It is kept as it is if nothing is `checked`. What is cheap to know counts first: facets do before any refinement.
    """
    dropped = partial(Dropped, suggestion.tool.name, suggestion.mesh)
    try:
        trials = Trial.of(asset, suggestion)
        best = Score.of(Merits(seen=1.0, crests=1.0, smooth=min(each.smooth for each in trials), closed=1.0))
        if checked is not None and not best.is_kept:
            return dropped(*best.reason), refinement
        needed, placed = refinement, dict[str, Placement]()
        for trial in trials:
            needed, more = trial.placed(needed)
            placed |= more
    except BakeError as error:
        return dropped("refused", 0.0, error.lines[0]), refinement
    if any(each.coarse for each in placed.values()):
        return dropped("coarse", 0.0), refinement
    found = _judged(asset, placed, checked, suggestion)
    if isinstance(found, Dropped) or found.is_judged:
        return found, needed
    return _tried(asset, refinement, checked, found)


def _judged(
    asset: TriedAsset, placed: dict[str, Placement], checked: Sequence[Clip] | None, suggestion: Suggestion
) -> Suggestion | Dropped:
    """A suggestion that is worth keeping, another one to try in its place, or the reason why there is none.

    It is kept as it is if nothing is `checked`. Its twin is not looked at, as it is the same in a mirror.
    """
    placement, limb = placed[suggestion.tool.name], not suggestion.by_morph
    everything = checked is None
    look = look_in(asset, placement, suggestion.clip, suggestion.time, limb=limb, everything=everything)
    score, tallest = look or (None, None)
    judged = replace(
        suggestion,
        judgement=score,
        height=0.0 if tallest is None else tallest.height,
        gpu_bytes=_cost(placed),
        own_bytes=sum(map(grown_bytes, {id(each.plan): each.plan for each in placed.values()}.values())),
        is_judged=True,
    )
    if checked is None:
        return judged
    dropped = partial(Dropped, suggestion.tool.name, suggestion.mesh)
    if score is None or tallest is None:
        return dropped("not raised", 0.0)
    if not score.is_kept:
        return dropped(*score.reason)
    if suggestion.part in _OF_CONTACT and not suggestion.by_morph and _has_slit(tallest):
        tool = replace(suggestion.tool, contact=Contact()) if kind_of("folds").is_installed else suggestion.tool
        judged = replace(judged, tool=tool, crossings=tallest.crossings, gpu_bytes=_cost(placed, tool.contact))
    warning, needed = _checked(suggestion, placed, checked)
    if not warning:
        return judged
    if suggestion.tool.compressible < needed <= MOST_COMPRESSIBLE / 100.0:
        return replace(suggestion, tool=replace(suggestion.tool, compressible=needed), is_judged=False)
    return suggestion.next or dropped("warned", 0.0, warning)


def _cost(placed: dict[str, Placement], contact: Contact | None = None) -> int:
    """Bytes on a GPU of a tool and its twin."""
    shapes = 0 if contact is None else _SHAPES_OF_CONTACT
    parts = [(each.plan, each.part) for each in placed.values()]
    return sum(planned_bytes(plan, [*part.target_vertices, *[part.vertices] * shapes]) for plan, part in parts)


def _checked(suggestion: Suggestion, placed: dict[str, Placement], clips: Sequence[Clip]) -> tuple[str, float]:
    """The first warning of `check`, or an empty string, and the `compressible` that the tool needs."""
    warnings, needed = list[str](), 0.0
    clips = _shortest_clips(suggestion, clips)
    for placement in placed.values():
        plan, part = placement.plan, placement.part
        seen = [seen_at(part, plan.rig, clip, frames_of(clip, plan.rig)) for clip in clips]
        lines = part.words(plan).warnings(plan, seen, up="y") + departure_warnings(plan.fine, [part])
        lines += turned_warnings(plan, part, seen)
        if lines:
            lengths = ((each.reading.distances, each.reading.rest_lengths) for each in seen)
            needed = max(needed, math.ceil(100.0 * part.attached.fitting_compressible(lengths)) / 100.0)
        warnings += lines
    return (warnings or [""])[0], needed


def look_in(
    asset: TriedAsset, placement: Placement, name: str, peak: float, *, limb: bool, everything: bool = True
) -> tuple[Score, StagedTool] | None:
    """Look at a tool in a clip at its peak, or before if a fold hides it then; None if the clip does not raise it.

    `limb` is True if a limb folds there. If not `everything` is looked at, a fold that is too open where it is tallest
    has the best score that it could get.

    Returns:
        Its score where one sees it best, and the tool at its peak, where a fold may hide it.
    """
    clip = asset.clip(name)
    first = StagedTool.of(placement, asset.layers, clip, peak)
    if first.height <= _RAISED * first.size:
        return None
    smooth = 1.0 - float(placement.plan.fine.hard_shares[placement.part.region])
    best_score = Score.of(Merits(seen=1.0, crests=1.0, smooth=smooth, closed=_closed(first) if limb else math.nan))
    if not (everything or best_score.is_kept):
        return best_score, first

    def look(time: float) -> tuple[tuple[StagedTool, Sight] | None, Side]:
        staged = first if time == peak else StagedTool.of(placement, asset.layers, clip, time)
        if staged.height <= _RAISED * staged.size:
            return None, UNSEEN
        sight = Sight.of(staged)
        return (staged, sight), sight.best_side

    start = clip.start if clip.start < peak else clip.end
    best, side = best_moment(start, peak, look)
    assert best is not None
    staged, sight = best
    side, crests = look_at(staged, sight, side)
    merits = Merits(
        seen=side.visible if limb else part_not_hidden(sight.place, side),
        crests=crests.contrast * crests.share / (crests.contrast + _UNNOTICED),
        smooth=smooth,
        closed=_closed(staged) if limb else math.nan,
    )
    return Score.of(merits), first


def _closed(staged: StagedTool) -> float:
    """A number from 0 to 1 that says how far the ends of a tool lean to each other; 0 if one of them is not there."""
    triangles = staged.triangles[staged.place]
    us, areas = staged.places[triangles, 0].mean(axis=1), face_normals(staged.plain, triangles)
    ends = [us < _ENDS, us > 1.0 - _ENDS]
    if not all(end.any() for end in ends):
        return 0.0
    first, last = (staged.plain[triangles[end]].mean(axis=(0, 1)) for end in ends)
    leans = [unit(areas[end].sum(axis=0)) @ unit(last - first) for end in ends]
    return float(2.0 + leans[0] - leans[1]) / 4.0


def _has_slit(staged: StagedTool) -> bool:
    """True if a fold crosses along so much of its length that contact should close it."""
    return staged.crossings > _SLIT * float(np.sqrt(staged.edge_count))


def _shortest_clips(suggestion: Suggestion, clips: Sequence[Clip]) -> list[Clip]:
    """The clips that shorten a tool most, and the one that shortens its mirror image most."""
    by_name = {clip.name: clip for clip in clips}
    names = sorted(by_name.keys() & suggestion.clips.keys(), key=lambda name: (suggestion.clips[name], name))
    wanted = dict.fromkeys((*names[:_MOST_CLIPS], suggestion.twin_clip))
    return [by_name[name] for name in wanted if name in by_name]


def frames_of(clip: Clip, rig: Rig) -> Floats:
    """(frames,) seconds at which a clip is looked at: its frames, or some of a very long one."""
    frames = (clip.end - clip.start) * Sampling().fps
    long = frames > _MOST_FRAMES
    return np.linspace(clip.start, clip.end, _MOST_FRAMES) if long else clip_grid(clip, rig, fps=Sampling().fps)
