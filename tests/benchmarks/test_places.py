"""The weights of the score are those of places.csv, and hold on characters that they were not fitted to."""

import csv
import json
from pathlib import Path

import numpy as np
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


def test_measured_merits_of_fields_come_into_the_tables(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = dict.fromkeys(places.read_places().names, np.nan)
    shown, hidden = ({**nothing, "seen": seen, "crests": 0.5, "smooth": 1 / 3} for seen in (0.9, 0.1))
    rows = {
        place: {**dict.fromkeys(places.read_rows(places.PLACES)[0], ""), "character": place[0], "tool": place[1]}
        for place in (("a", "field coat_L + coat_R"), ("b", "field coat"), ("c", "field coat"), ("a", "elbow.L"))
    }
    for row in rows.values():
        row.update(smooth="0.25", limb="1")
    for name in ("PLACES", "UNSEEN"):
        monkeypatch.setattr(places, name, tmp_path / f"{name}.csv")
    places.write_rows(places.PLACES, list(rows.values()))
    places.write_rows(places.UNSEEN, [rows["a", "elbow.L"]])
    done = tmp_path / "done.jsonl"
    done.write_text(f"{json.dumps(['a', {'coat_L': shown, 'coat_R': hidden}])}\n{json.dumps(['b', {}])}\n")
    places.measure_fields({}, done)
    pair, level, unknown, tool = places.read_rows(places.PLACES)
    assert [pair[name] for name in ("seen", "smooth", "closed", "limb")] == ["0.1", "0.333", "", "1"]
    assert level == {**rows["b", "field coat"], "limb": "0"}
    assert [unknown, tool] == [rows["c", "field coat"], rows["a", "elbow.L"]]
