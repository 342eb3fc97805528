"""Lengths and what tools say."""

import pytest

from wrinklecli.tools.records import Length, parse_length


def test_lengths_resolve():
    assert Length(0.5).resolve(4.0) == 0.5
    assert Length(80.0, percent=True).resolve(4.0) == pytest.approx(3.2)


@pytest.mark.parametrize(
    ("written", "length"),
    [
        (2, Length(2.0)),
        (0.02, Length(0.02)),
        ("0.02", Length(0.02)),
        ("1e-3", Length(1e-3)),
        ("80%", Length(80.0, percent=True)),
        ("80 %", Length(80.0, percent=True)),
    ],
)
def test_a_length_is_read_as_people_write_it(written, length):
    assert parse_length(written) == length


@pytest.mark.parametrize("written", [0, -1, "0%", "-2", "nan", "inf", "inf%", float("nan"), "", "%", "5%%", "tall"])
def test_what_is_no_length_is_refused(written):
    with pytest.raises(ValueError, match=r"no length|could not convert"):
        parse_length(written)
