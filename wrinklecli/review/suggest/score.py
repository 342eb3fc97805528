"""The score of a suggested tool or field: from a few merits that a person would name, one number and a sentence.

`tests/benchmarks/places.py` fits the weights to verdicts by eye on places of characters: keep, weak or delete.
"""

import json
import math
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from wrinklecli.frozen import dataclass

# A merit that is smaller counts as this one: nobody tells a hundredth from nothing.
LEAST = 0.01
# The fitted weights.
_WEIGHTS = Path(__file__).with_name("score.json")


@dataclass(frozen=True, slots=True)
class Merits:
    """Merits of a place, 0 to 1, where its wrinkles are tallest, seen from the best side.

    Attributes:
        seen: Part of the wrinkles that is visible; where no limb folds, of those that would be if nothing hid them.
        crests: Part of what changes the light that is crests; the rest is lumps, specks and what one does not notice.
        smooth: Part of the edges inside the place that are not hard; at its border wrinkles have faded.
        closed: How far the ends of the fold are turned to each other: 1 where it is shut, 0.5 on a plane.
        around: How far the sides of the place are turned away from each other: 1 around a thin limb, 0.5 on a plane.
        uniform: Part of the place that is of one substance: a fold of skin ends at a sleeve, and lace has holes.
        fine: Part of the triangles that its wrinkles need, in the asset: on fewer they are bars with kinks.
        grown: Height in heads, of the four of a newborn at most: smooth toys look wrong in the folds of real clothes.

    Four are NaN for what is no fold of a limb: lines of a face, and fields; the last one for all but fields. Then they
    count as they do at places that artists keep.
    """

    seen: float
    crests: float
    smooth: float
    closed: float
    around: float
    uniform: float
    fine: float
    grown: float


REASONS = {
    "seen": ("hidden", "other parts hide it: {} of its wrinkles can be seen from the best side"),
    "crests": ("hardly seen", "its crests are hardly seen: they are {} of what changes the light"),
    "smooth": ("faceted", "it lies on facets: {} of the edges there are smooth"),
    "closed": ("hardly folded", "it hardly folds: {} shut, where flat is 50 % and a closed fold 100 %"),
    "around": ("around no limb", "it reaches around no limb: {}, where a plane has 50 % and a thin limb 100 %"),
    "uniform": ("across a border", "it lies across the border of what it is made of: {} of it is of one substance"),
    "fine": ("few triangles", "the mesh is coarse there: it has {} of the triangles that its wrinkles need"),
    "grown": ("toy-like", "its head is a toy's: it has {} of the height that a person has with such a head"),
}
"""For each merit a word for the want of it, and that in a sentence with a place for the value."""


@dataclass(frozen=True, slots=True)
class Score:
    """A place that was looked at.

    Attributes:
        merits: What was seen.
        keep: The probability that an artist keeps the tool.
        worst: The merit by which it falls most behind those that artists keep.
    """

    merits: Merits
    keep: float
    worst: str

    @classmethod
    def of(cls, merits: Merits) -> "Score":
        """Weigh merits: odds are a product of their powers, so that nothing makes up for one that is missing.

        What is no fold of a limb has a bias of its own, and a weight of `grown`.
        """
        fitted = _fitted()
        own = fitted["others"] if math.isnan(merits.closed) else {"bias": fitted["bias"]}
        weights = {name: fitted["weights"].get(name, 0.0) + own.get(name, 0.0) for name in fitted["kept"]}
        known = {name: value for name, value in asdict(merits).items() if not math.isnan(value)}
        logs = fitted["kept"] | {name: math.log2(min(max(value, LEAST), 1.0)) for name, value in known.items()}
        behind = {name: weight * (logs[name] - fitted["kept"][name]) for name, weight in weights.items()}
        log_odds = own["bias"] + sum(weight * logs[name] for name, weight in weights.items())
        return cls(merits, 1.0 / (1.0 + math.exp(-log_odds)), min(known, key=behind.__getitem__))

    @property
    def is_kept(self) -> bool:
        """True if artists keep the tool with at least the probability that makes them keep most of what is proposed."""
        return bool(self.keep >= _fitted()["least"])

    @property
    def sentence(self) -> str:
        """The greatest want of the place, in a sentence."""
        return REASONS[self.worst][1].format(f"{100 * self.reason[1]:.0f} %")

    @property
    def reason(self) -> tuple[str, float]:
        """A word for what the place wants most, and that merit."""
        return REASONS[self.worst][0], getattr(self.merits, self.worst)


def left_out_without_all(judgement: Score | None, fault: str = "") -> list[str]:
    """A remark that says why a suggestion is there with `--all` alone; none if it is there without."""
    why = fault or (judgement.sentence if judgement and not judgement.is_kept else "")
    return [f"Left out without --all: {why}"] if why else []


@cache
def _fitted() -> dict[str, Any]:
    """The least probability, weights by merit, biases, and the mean logarithms of the merits of kept places."""
    found: dict[str, Any] = json.loads(_WEIGHTS.read_text(encoding="utf-8"))
    return found
