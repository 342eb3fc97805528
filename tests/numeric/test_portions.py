"""Portions cover all rows once, in order, and none is larger than it may be."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrinklecli.numeric.portions import portions, portions_of


@given(count=st.integers(0, 40), width=st.integers(0, 30), at_once=st.integers(1, 100))
def test_portions_cover_rows_of_one_width(count: int, width: int, at_once: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wrinklecli.numeric.portions.AT_ONCE", at_once)
        found = [np.arange(count)[part] for part in portions(count, width)]
    assert np.concatenate([np.zeros(0, int), *found]).tolist() == list(range(count))
    assert all(1 <= len(each) <= max(at_once // max(width, 1), 1) for each in found)


@given(widths=st.lists(st.integers(0, 30), max_size=40), at_once=st.integers(1, 100))
def test_portions_cover_rows_of_several_widths(widths: list[int], at_once: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wrinklecli.numeric.portions.AT_ONCE", at_once)
        found = [np.arange(len(widths))[part] for part in portions_of(np.array(widths, np.intp))]
    assert np.concatenate([np.zeros(0, int), *found]).tolist() == list(range(len(widths)))
    for each in found:
        wide = [widths[k] for k in each if widths[k]]  # rows without numbers may follow the last of these
        assert len(each)
        assert sum(wide[:-1]) < at_once
