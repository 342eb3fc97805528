"""Cards: no word on one is written over another."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from wrinklecli.review.preview.cards import Card, CardSheet, Picture
from wrinklecli.review.preview.peaks import Fact

LONG = "a name that goes on and on " * 9


class Pen:
    """Keeps where words are written: left, top and right ends, pixels."""

    def __init__(self) -> None:
        self.words: list[tuple[float, float, float]] = []

    def text(self, place: tuple[float, float], text: str, *, font: Any, **_: Any) -> None:
        self.words.append((*place, place[0] + font.getlength(text)))

    def rectangle(self, box: tuple[float, ...], **_: Any) -> None:
        self.words.append((box[0], box[1] - 3, box[2]))


@pytest.mark.quick(2, 6)
@pytest.mark.parametrize("colour", [None, (1.0, 0.0, 0.0)])
@pytest.mark.parametrize("aside", ["", "1.25 s of walk, from the left", LONG])
@pytest.mark.parametrize("name", ["knee", LONG])
def test_words_of_a_card_stand_beside_each_other(name: str, aside: str, colour: Any) -> None:
    sheet, pen, width = CardSheet(1, 1, (160, 120), 2, "title"), Pen(), 300
    facts = [[Fact("tall"), Fact(LONG, alarming=True)], [Fact("short"), Fact("wide")]]
    pixels = np.zeros((120, 160, 3), np.uint8)
    sheet._write(pen, 10, 20, width, Card(name, colour, aside, facts, [Picture(pixels, "a"), Picture(pixels, "b")]))
    for top in {int(line + 2) // 4 for _, line, _ in pen.words}:
        row = sorted((left, right) for left, line, right in pen.words if int(line + 2) // 4 == top)
        assert row[0][0] >= 10
        assert row[-1][1] <= 10 + width + 1
        assert all(right <= left + 1 for (_, right), (left, _) in pairwise(row))
