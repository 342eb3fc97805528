"""The weights of the score are those of places.csv, and hold on characters that they were not fitted to."""

import json

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


def test_the_score_is_right_on_characters_left_out() -> None:
    table = places.read_places()
    counted = table.characters != places.BUILT
    chances, table = places.left_out(table)[counted], table.only(counted)
    commonest = np.bincount(table.verdicts).max() / len(table.verdicts)
    assert places.right(table, chances) >= commonest + 0.15
    proposed = chances[:, 1] >= 0.5
    assert np.mean(table.verdicts[proposed] == 2) >= 0.8
    assert proposed[table.verdicts == 2].mean() >= 0.7
