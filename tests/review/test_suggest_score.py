"""The score of a place falls with each of its merits, and says which one it wants most."""

import math
from dataclasses import asdict, fields, replace

import pytest

from wrinklecli.review.suggest.score import REASONS, Merits, Score

GOOD = Merits(seen=0.9, crests=0.5, smooth=1.0, closed=0.8, around=0.8, uniform=1.0, fine=1.0, grown=math.nan)
FIELD = replace(GOOD, **dict.fromkeys(("closed", "around", "uniform", "fine"), math.nan), grown=1.0)
NAMES = [each.name for each in fields(Merits)]


def good(name: str) -> Merits:
    """A good place of which a merit of some name is known."""
    return FIELD if math.isnan(asdict(GOOD)[name]) else GOOD


@pytest.mark.parametrize("place", [GOOD, FIELD])
def test_a_good_place_is_kept(place: Merits) -> None:
    assert Score.of(place).is_kept


@pytest.mark.parametrize("name", NAMES)
def test_the_score_falls_with_each_merit(name: str) -> None:
    values = [asdict(good(name))[name] * part for part in (1.0, 0.5, 0.1, 0.0)]
    found = [Score.of(replace(good(name), **{name: value})) for value in values]
    assert [each.keep for each in found] == sorted((each.keep for each in found), reverse=True)
    assert found[0].keep > found[-1].keep
    assert found[-1].worst == name
    assert found[-1].reason == (REASONS[name][0], 0.0)


@pytest.mark.parametrize("name", NAMES)
def test_no_merit_makes_up_for_one_that_is_missing(name: str) -> None:
    best = Merits(**{each: value if math.isnan(value) else 1.0 for each, value in asdict(good(name)).items()})
    assert not Score.of(replace(best, **{name: 0.0})).is_kept


def test_the_sentence_has_the_merit() -> None:
    assert Score.of(replace(GOOD, smooth=0.3)).sentence == "it lies on facets: 30 % of the edges there are smooth"


@pytest.mark.parametrize("place", [GOOD, FIELD])
def test_what_a_place_wants_most_is_known(place: Merits) -> None:
    best = Merits(**{name: value if math.isnan(value) else 1.0 for name, value in asdict(place).items()})
    assert not math.isnan(Score.of(best).reason[1])
