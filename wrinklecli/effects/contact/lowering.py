"""Lowers the wrinkles of folds without contact until they cross no more than the skin alone.

A fold that is given up plays as skinned. Its skin may pass through itself, but wrinkles are to add nothing to it. Where
they do, they are halved, again and again, and rise to their full height over half a bump to either side, as in the
creases of a bend (module `creases`). Not in the paper.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.effect import ContactWords, GivenUpWords
from wrinklecli.effects.contact.fold import FAINT, Fold
from wrinklecli.effects.effect import Effect, MeshPlan, SamplingOptions
from wrinklecli.effects.sampling import duplicates_of
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.creases import faded
from wrinklecli.effects.wrinkle.effect import WrinkleWords, lowered_in_clips, wrinkle_effect
from wrinklecli.numeric.arrays import Bools, Floats, Ints, distinct_values

# Moments of a clip at which crossings are counted, evenly spread, at most.
_MOMENTS = 25


def with_lowered_wrinkles(
    plan: MeshPlan, effects: Sequence[Effect], clips: Sequence[Clip], how: SamplingOptions
) -> list[Effect]:
    """Effects in which the tools of folds without contact are lowered, by their motions in all clips.

    Those of other folds are lower where contact does not settle.
    """
    made = list(effects)
    moving = [clips[first] for first in sorted(set(duplicates_of(plan, clips)))]
    numbers = {each.name: number for number, each in enumerate(made) if isinstance(each.words, WrinkleWords)}
    for number, effect in enumerate(made):
        if isinstance(effect.words, ContactWords) and effect.words.heights:
            for name in effect.words.tools:
                made[numbers[name]] = lowered_in_clips(made[numbers[name]], effect.words.heights)
        if not isinstance(effect.words, GivenUpWords):
            continue
        heights = {}
        for carried in lowered(effect.words.fold, moving).values():
            tool = numbers[carried.patch.tool.name]
            words = made[tool].words
            assert isinstance(words, WrinkleWords)
            before = words.carried
            heights[made[tool].name] = float(np.abs(carried.magnitudes).sum() / np.abs(before.magnitudes).sum())
            same = replace(before, places=carried.places, directions=carried.directions, ring=carried.ring)
            made[tool] = wrinkle_effect(plan, same, words.region, clips, how)
        made[number] = replace(effect, words=replace(effect.words, heights=heights))
    return made


def lowered(fold: Fold, clips: Sequence[Clip]) -> Mapping[int, CarriedPatch]:
    """Lower the tools of a fold until they cross no more than its skin alone does, in all looked-at moments together.

    Returns:
        The tools that had to be lowered, by their numbers among those of the mesh.
    """
    chosen, counting = fold.own_tools, fold.raised
    looks = [(clip, np.array([time])) for clip in clips for time in _moments(clip)]
    faint = fold.at_height(FAINT)
    skin = [_pairs(faint, counting, *look) for look in looks]
    found: dict[int, CarriedPatch] = {}
    height = 1.0
    while height >= FAINT:
        wrinkled = [_pairs(fold, counting, *look) for look in looks]
        if sum(map(len, wrinkled)) <= sum(map(len, skin)):
            return found
        crossing = _corners(fold, [pair for each, plain in zip(wrinkled, skin, strict=True) for pair in each - plain])
        fold = replace(fold, carried=_halved(fold, crossing))
        found = {number: fold.carried[number] for number in chosen}
        height /= 2.0
        # Elsewhere the wrinkles that stay as they are crossed no more than the skin.
        worse = [k for k, (each, plain) in enumerate(zip(wrinkled, skin, strict=True)) if len(each) > len(plain)]
        looks, skin = [looks[k] for k in worse], [skin[k] for k in worse]
    flat = fold.at_height(0.0).carried
    return {number: flat[number] for number in chosen}


def _moments(clip: Clip) -> list[float]:
    """Seconds of a clip, evenly spread."""
    return [float(time) for time in distinct_values(np.linspace(clip.start, clip.end, _MOMENTS))]


def _pairs(fold: Fold, counting: Bools, clip: Clip, times: Floats) -> set[tuple[int, int]]:
    """Edges and triangles that cross at a moment, of which a corner is among the (vertices,) that count."""
    return fold.crossings.pairs_at(fold.posed(clip, times)[0][0], counting)


def _corners(fold: Fold, pairs: Sequence[tuple[int, int]]) -> Ints:
    """The fine vertices of some edges and triangles."""
    corners = fold.crossings.corners_of(pairs)
    return fold.vertices[np.unique(corners[corners < len(fold.vertices)])]


def _halved(fold: Fold, crossing: Ints) -> tuple[CarriedPatch, ...]:
    """All tools of the mesh, of which the fold's own are lower round the (crossing,) fine vertices."""
    every = list(fold.carried)
    for number in fold.own_tools:
        carried = every[number]
        losses = np.where(np.isin(carried.vertices, crossing), 0.5, 0.0)
        places = carried.patch.coordinates(fold.fine.rest_positions[carried.vertices])
        every[number] = faded(carried, losses, np.stack(places, axis=1))
    return tuple(every)
