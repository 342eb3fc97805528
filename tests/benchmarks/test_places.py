"""The weights of the score are those of places.csv, and hold on characters that they were not fitted to."""

import csv
import json

import pytest

from benchmarks import places


def test_the_program_reads_the_fitted_weights() -> None:
    """If it fails: `python tests/benchmarks/places.py --write`."""
    found, kept = places.weights_of(places.read_places()), json.loads(places.WEIGHTS.read_text())
    assert found.keys() == kept.keys()
    for name, value in found.items():
        # The minimum is flat: other processors stop beside it.
        assert value == pytest.approx(kept[name], abs=0.02), name


@pytest.mark.parametrize(("tools", "fields"), [(True, False), (True, True)])
def test_the_score_is_right_on_characters_left_out(tools: bool, fields: bool) -> None:
    table = places.read_places()
    chances = places.left_out(table)
    least = places.least_of(table, chances)
    chosen = (tools & table.counted & ~table.fields) | (fields & table.fields)
    chances, table = chances[chosen], table.only(chosen)
    assert places.right(table, chances) >= places.commonest(table) + 0.15
    assert places.agreed(table).mean() >= 0.8
    (keep, weak, delete), found = places.proposed(table, chances, least)
    assert keep >= places.ASKED * (keep + weak + delete)
    assert found >= 0.7


def test_fields_that_artists_keep_are_proposed_and_armour_mostly_not() -> None:
    table = places.read_places()
    chances = places.left_out(table)
    least, chances, table = places.least_of(table, chances), chances[table.fields], table.only(table.fields)
    agreed = places.agreed(table)
    (keep, weak, delete), found = places.proposed(table.only(agreed), chances[agreed], least)
    assert found == 1.0
    assert keep >= 0.7 * (keep + weak + delete)
    deleted = (table.verdicts[agreed] == places.VERDICTS.index("delete")).all(axis=1).sum()
    assert delete <= 0.2 * deleted


def test_unseen_places_have_the_merits_of_the_fit_and_a_public_source() -> None:
    table = places.read_places()
    unseen = places.read_places(places.UNSEEN, places.usual_of(table))
    assert unseen.names == table.names
    assert not set(unseen.characters) & set(table.characters)
    with (places.HERE / "sources.csv").open(encoding="utf-8", newline="") as file:
        sources = {row["character"]: row["repository"] for row in csv.DictReader(file)}
    assert all(sources[each].startswith("https://") for each in unseen.characters)
