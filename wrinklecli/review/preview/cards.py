"""Cards: two pictures side by side with a name and a few words below, in rows and columns below a title."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from PIL import Image, ImageDraw

from wrinklecli.review.preview.overlay import Placed
from wrinklecli.review.preview.peaks import Fact
from wrinklecli.review.preview.sheet_layout import Bytes, Colour, code, fitting, font_of, tagged

_PAGE, _CARD, _RULE = (238, 240, 243), (255, 255, 255), (214, 219, 226)
_DARK, _GREY, _ALARM = (34, 40, 48), (92, 100, 112), (176, 70, 0)
_GAP = 12  # pixels between cards, and around them
_SLIT = 2  # between the two pictures of a card
_BETWEEN = "  ·  "


@dataclass(frozen=True, slots=True)
class Picture:
    """One of the pictures of a card.

    Attributes:
        pixels: (height, width, 3) sRGB.
        tag: What it shows, in a word.
        words: Names of places in it.
    """

    pixels: Bytes
    tag: str
    words: Sequence[Placed] = ()


@dataclass(frozen=True, slots=True)
class Card:
    """One tool, seen from one side.

    Attributes:
        name: Of the tool.
        colour: That it is drawn in; None where it is not.
        aside: When it is seen, and from where.
        facts: Rows of what is to be said of it.
        pictures: Two, of the picture size.
    """

    name: str
    colour: Colour | None
    aside: str
    facts: Sequence[Sequence[Fact]]
    pictures: Sequence[Picture]


class CardSheet:
    """Cards of one size in rows and columns below a title."""

    def __init__(self, columns: int, rows: int, size: tuple[int, int], facts: int, title: str) -> None:
        self._columns = columns
        self._rows = facts
        self._size = size
        self._text = text_size(size)
        self.image = Image.new("RGB", cards_size(columns, rows, size, facts), _PAGE)
        pen, font = ImageDraw.Draw(self.image), font_of(self._text + 1)
        pen.text((_GAP + 2, _GAP), fitting(title, font, self.image.width - 2 * _GAP), fill=_DARK, font=font)

    def put(self, number: int, card: Card) -> None:
        """Place a card, by its number in rows."""
        row, column = divmod(number, self._columns)
        width, height = card_size(self._size, self._rows)
        left = _GAP + column * (width + _GAP)
        top = _title_height(self._size) + row * (height + _GAP)
        pen = ImageDraw.Draw(self.image)
        pen.rectangle((left - 1, top - 1, left + width, top + height), fill=_CARD, outline=_RULE)
        for place, each in enumerate(card.pictures):
            cell = tagged(each.pixels, each.tag, font_of(self._text), each.words)
            self.image.paste(cell, (left + place * (self._size[0] + _SLIT), top))
        self._write(pen, left + _GAP // 2 + 2, top + self._size[1] + self._text // 2, width - _GAP - 4, card)

    def _write(self, pen: Any, left: int, top: int, width: int, card: Card) -> None:
        """The words below a card's pictures."""
        small, large = font_of(self._text), font_of(self._text + 1)
        aside = fitting(card.aside, small, width - min(large.getlength(card.name[:200]) + 3 * self._text, 0.4 * width))
        pen.text((left + width - small.getlength(aside), top), aside, fill=_GREY, font=small)
        start = left
        if card.colour is not None:
            side = self._text - 3
            pen.rectangle((left, top + 3, left + side, top + 3 + side), fill=code(card.colour))
            start += side + self._text // 2
        name = fitting(card.name, large, left + width - start - small.getlength(aside) - self._text)
        # A stroke around the letters makes them bold: the font that Pillow brings along has one weight.
        pen.text((start, top - 1), name, fill=_DARK, font=large, stroke_width=0.4)
        for number, row in enumerate(card.facts[: self._rows]):
            line = top + (number + 1) * _line_height(self._size) + 2
            at = float(left)
            for fact in row:
                lead = _BETWEEN if at > left else ""
                text = fitting(lead + fact.text, small, left + width - at)
                if fact.alarming and text != "…":
                    pen.text((at, line), lead, fill=_GREY, font=small)
                    pen.text((at + small.getlength(lead), line), text[len(lead) :], fill=_ALARM, font=small)
                else:
                    pen.text((at, line), text, fill=_GREY, font=small)
                at += small.getlength(text)


def card_size(size: tuple[int, int], facts: int) -> tuple[int, int]:
    """Width and height of a card whose pictures have a size, with so many rows of facts, pixels."""
    return 2 * size[0] + _SLIT, size[1] + (1 + facts) * _line_height(size) + text_size(size)


def cards_size(columns: int, rows: int, size: tuple[int, int], facts: int) -> tuple[int, int]:
    """Width and height of a whole sheet, pixels."""
    width, height = card_size(size, facts)
    return _GAP + columns * (width + _GAP), _title_height(size) + rows * (height + _GAP)


def text_size(size: tuple[int, int]) -> int:
    """Of the words below pictures of a size, pixels."""
    return min(max(13, size[1] // 24), 20)


def _line_height(size: tuple[int, int]) -> int:
    return round(1.45 * text_size(size))


def _title_height(size: tuple[int, int]) -> int:
    return 2 * _GAP + round(1.4 * text_size(size))
