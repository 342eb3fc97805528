"""Suggested tools without the warnings of `check`: each is made to fit where a key can do so, else left out.

A file that `suggest` writes then passes `check --strict`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.rig import Rig
from wrinklecli.effects.faults import departure_warnings, turned_warnings
from wrinklecli.effects.sampling import seen_at
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.processes import in_processes
from wrinklecli.review.suggest.anatomy import JOINED
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.shortening import MOST_COMPRESSIBLE
from wrinklecli.review.suggest.trial import Placement, Trial, TriedAsset, names_of
from wrinklecli.review.suggest.worth import Dropped, Worthwhile
from wrinklecli.tools.records import Sampling

# Most times that tools are made to fit: once each by its compressible, its height, and what those change beside it.
_ROUNDS = 4
# Clips in which a tool is looked at frame by frame: those that shorten it most, as measured in fewer poses.
_MOST_CLIPS = 6
# Frames of a clip that are looked at: eleven minutes.
_MOST_FRAMES = 20_000


def unwarned(asset: TriedAsset, found: Worthwhile, clips: Sequence[Clip]) -> Worthwhile:
    """Remove what `check` would warn of from tools, or the tools.

    Args:
        asset: With all clips.
        found: Tools that are worth keeping.
        clips: Those that `check` looks at.
    """
    placed = found.placed
    for _ in range(_ROUNDS):
        # A placement holds for the tool as it was placed: refining anew takes as long as measuring the mesh.
        changed = [each for each in found.tools if not _is_placed(each, placed)]
        if changed:
            trial = Trial(asset, found.refinement)
            known = all(each.tool.name in placed for each in changed)
            placed = trial.placed_again(found.tools, changed, placed) if known else trial.placements(found.tools)
        kept: list[Suggestion] = []
        for mended in in_processes(partial(_mended, placed, clips), found.tools, asset.jobs):
            if isinstance(mended, Dropped):
                found.dropped.append(mended)
            else:
                kept.append(mended)
        if kept == found.tools:
            break
        found = replace(found, tools=kept)
    return found


def _is_placed(suggestion: Suggestion, placed: Mapping[str, Placement]) -> bool:
    """True if a tool was placed as it is; its contact is proposed later, and changes no place."""
    there = placed.get(suggestion.tool.name)
    alone = replace(suggestion.tool, where="", contact=None)
    return there is not None and replace(there.part.attached.tool, where="", contact=None) == alone


def _mended(placed: Mapping[str, Placement], clips: Sequence[Clip], suggestion: Suggestion) -> Suggestion | Dropped:
    """A suggestion, placed with its mirror image, that needs no warning, or less of one; or why there is none."""
    warnings, needed = list[str](), suggestion.tool.compressible
    clips = _shortest_clips(suggestion, clips)
    for name in names_of(suggestion, placed):
        placement = placed[name]
        plan, part = placement.plan, placement.part
        seen = [seen_at(part, plan.rig, clip, _frames_of(clip, plan.rig)) for clip in clips]
        lines = part.words(plan).warnings(plan, seen, up="y") + departure_warnings(plan.fine, [part])
        lines += turned_warnings(plan, part, seen)
        if lines:
            lengths = ((each.reading.distances, each.reading.rest_lengths) for each in seen)
            needed = max(needed, math.ceil(100.0 * part.attached.fitting_compressible(lengths)) / 100.0)
        warnings += lines
    if not warnings:
        return suggestion
    if suggestion.tool.compressible < needed <= MOST_COMPRESSIBLE / 100.0:
        return replace(suggestion, tool=replace(suggestion.tool, compressible=needed), lower=None)
    return (
        suggestion.lowered
        or suggestion.smoothed
        or Dropped(suggestion.tool.name, suggestion.mesh, "warned", 0.0, warnings[0])
    )


def _shortest_clips(suggestion: Suggestion, clips: Sequence[Clip]) -> list[Clip]:
    """The clips that shorten a tool most, and the one that shortens its mirror image most."""
    by_name = {clip.name: clip for clip in clips}
    # Suggestions are measured where morph targets of both sides are raised together.
    parts = {
        name: [name] if name in by_name else [part for part in name.split(JOINED) if part in by_name]
        for name in suggestion.clips
    }
    names = sorted((name for name in parts if parts[name]), key=suggestion.clips.__getitem__)[:_MOST_CLIPS]
    twin = [] if suggestion.twin_moment is None else [suggestion.twin_moment[0]]
    wanted = [part for name in (*names, *twin) for part in parts.get(name, [name])]
    return [by_name[name] for name in dict.fromkeys(wanted) if name in by_name]


def _frames_of(clip: Clip, rig: Rig) -> Floats:
    """(frames,) seconds at which a clip is looked at: its frames, or some of a very long one."""
    frames = (clip.end - clip.start) * Sampling().fps
    long = frames > _MOST_FRAMES
    return np.linspace(clip.start, clip.end, _MOST_FRAMES) if long else clip_grid(clip, rig, fps=Sampling().fps)
