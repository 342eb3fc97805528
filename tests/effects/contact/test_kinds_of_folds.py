"""Folds of many kinds, baked with contact and without: resolved and whole, or left out with a line that says so."""

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.bakes import report_of
from kit.folds import CLIP, FOLDS, RANGES, Fold
from kit.torn import faults

KINDS = ["low_poly", "one_sided", "elbow", "finger", "hip", "armpit", "groin", "rigid", "no_room"]
ANY_OF = ["elbow", "finger", "hip"]


def faults_of(fold: Fold) -> list[str]:
    """The faults of the fold's bake with contact, beside the same bake without."""
    resolved = fold.baked()
    return faults(resolved.path, fold.baked("off").path, report_of(resolved), "limb", CLIP, fold.radius)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_fold_is_resolved_and_whole_or_a_line_says_that_it_is_left_out(kind: str) -> None:
    assert faults_of(FOLDS[kind]()) == []


@pytest.mark.slow
@settings(max_examples=3, phases=[Phase.explicit, Phase.generate], suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_no_fold_ends_worse_than_without_contact(data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(ANY_OF))
    options = {name: data.draw(st.floats(*ends), label=name) for name, ends in RANGES[kind].items()}
    assert faults_of(FOLDS[kind](**options)) == []
