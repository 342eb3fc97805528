"""Guesses of muscles and flesh become entries of a file: two that are mirror images one, with what clips do to them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.plan import moved_by, plan_on
from wrinklecli.effects.sampling import moving_clips, seen_at
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.suggest.text import Entry
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.mirror import exchange_sides, split_side
from wrinklecli.tools.records import ONE_PERCENT, EffectTool, JointPoint, ToolsFile
from wrinklecli.tools.yaml_tree import printable

# Difference of mirrored places over the size of their mesh below which they are mirror images about x = 0.
_SYMMETRIC = 0.01


# Digits of a place over the body's size, or of an offset over its length: a tenth of a millimetre of a human.
_DIGITS = 4


@dataclass(frozen=True, slots=True)
class Guess:
    """A muscle or a region of flesh that is guessed.

    Attributes:
        effect: Its record.
        ground: Its mesh at rest.
        attached: The effect on that mesh.
        places: (places, 3) that it was guessed from, world space at rest.
        facts: What was measured.
    """

    effect: Any
    ground: Ground
    attached: AnyAttached
    places: Floats
    facts: Mapping[str, Any]


def rounded(place: Floats, size: float) -> tuple[float, float, float]:
    """A (3,) place as a file writes it, by the size of what it lies on."""
    x, y, z = (round(float(each), _DIGITS - int(np.floor(np.log10(size or 1.0)))) + 0.0 for each in place)
    return x, y, z


def entries_of(guesses: Sequence[Guess], clips: Sequence[Clip], *, fps: float) -> list[Entry]:
    """The entries of guesses of one kind, left ones for those that have a mirror image, with their greatest moves.

    A move is that of the side that the clips move more. Its fact `clip` is missing if no clip moves either.
    """
    moves, by_name = _greatest_moves(guesses, clips, fps), {each.effect.name: each for each in guesses}
    found = []
    for each in guesses:
        name = each.effect.name
        twin = by_name.get(exchange_sides(name))
        paired = twin is not None and _are_mirrored(each, twin)
        if paired and split_side(name)[1] == "R":
            continue
        names = {name, exchange_sides(name)} if paired else {name}
        move = max((moves[one] for one in sorted(names) if one in moves), key=lambda move: move["height"], default={})
        remarks = [f"A guess: skin and bone are {each.facts['depth']:.3g} apart"]
        if move:
            remarks.append(
                f"{printable(move['clip'], 40)}, {move['time']:.2f} s: moves the skin by {move['height']:.2g}"
            )
        if move.get("shortening"):
            change = "shorter" if move["shortening"] > 0 else "longer, so that the skin sinks"
            remarks[-1] += f", as it is {100 * abs(move['shortening']):.0f} % {change}"
        found.append(Entry(each.effect, paired, remarks, {**each.facts, **move}))
    return found


def _are_mirrored(one: Guess, other: Guess) -> bool:
    """True if two guesses are mirror images about x = 0, on nodes that have each other's names.

    A number at the end of a name, as of an export from Sketchfab, has no other side.
    """
    if one is other or [exchange_sides(name) for name in _names(one.effect)] != _names(other.effect):
        return False
    size = float(np.ptp(one.ground.rest.positions, axis=0).max())
    return bool(np.abs(one.places * [-1.0, 1.0, 1.0] - other.places).max() < _SYMMETRIC * size)


def _names(effect: EffectTool) -> list[str]:
    """The names of nodes that an effect has, in the order of its keys; empty ones where it leaves them out."""
    points = [point.joint for point in effect.points if isinstance(point, JointPoint)]
    return [effect.node or "", getattr(effect, "joint", None) or "", *points]


def _greatest_moves(guesses: Sequence[Guess], clips: Sequence[Clip], fps: float) -> dict[str, dict[str, Any]]:
    """The moment at which clips move the skin most by an effect, by the names of effects.

    Its `shortening` is the part of its length by which a muscle is shorter then, below 0 if it is stretched.
    """
    found: dict[str, dict[str, Any]] = {}
    for ground in dict.fromkeys(each.ground for each in guesses):
        own = [each.attached for each in guesses if each.ground is ground]
        plan = plan_on(moved_by(ground, own), own, ToolsFile(path=ground.document.path), ONE_PERCENT)
        for clip in moving_clips(plan, clips):
            times = clip_grid(clip, plan.rig, fps=fps)
            for part in plan.parts:
                name, facts = part.attached.tool.name, part.facts_in(plan, seen_at(part, plan.rig, clip, times))
                if facts["height"] > found.get(name, {"height": 0.0})["height"]:
                    found[name] = {"clip": clip.name, "time": facts["time"], "height": facts["height"]}
                    if part.attached.segment is not None:
                        lengths = part.attached.segment.lengths(plan.rig, clip, np.array([facts["time"]]))
                        found[name]["shortening"] = 1.0 - float(lengths.distances[0] / lengths.rest_lengths[0])
    return found
