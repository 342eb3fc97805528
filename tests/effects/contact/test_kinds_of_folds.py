"""Folds of many kinds, baked with contact and without: resolved and whole, or left out with a line that says so."""

import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.bakes import report_of
from kit.folds import CLIP, FOLDS
from kit.torn import faults

KINDS = ["low_poly", "one_sided", "elbow", "finger", "hip", "armpit", "groin", "rigid", "no_room"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_a_fold_is_resolved_and_whole_or_a_line_says_that_it_is_left_out(kind: str) -> None:
    """Beside the same bake without contact."""
    fold = FOLDS[kind]()
    resolved, off = fold.baked(), fold.baked("off")
    assert faults(resolved.path, off.path, report_of(resolved), "limb", CLIP, fold.radius) == []
