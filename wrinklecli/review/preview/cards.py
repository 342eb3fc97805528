"""Lay out cards, each with two pictures above a name and a few words, in rows and columns below a title."""

from collections.abc import Sequence
from typing import Any

from PIL import Image, ImageDraw

from wrinklecli.character.paints import Colour
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.pixels import Bytes
from wrinklecli.review.preview.overlay import INK, PAPER, RED, RULE, Placed
from wrinklecli.review.preview.peaks import Fact
from wrinklecli.review.preview.sheet_layout import cut_to, font_of, labelled, rgb_bytes

# Colours of names and of facts, 8-bit sRGB.
_DARK, _GREY = rgb_bytes(INK), (92, 100, 112)
# Pixels between cards, and around them.
_GAP = 12
# Pixels between the two pictures of a card.
_SLIT = 2
# Text between two facts.
_BETWEEN = "  ·  "


@dataclass(frozen=True, slots=True)
class Picture:
    """One of the pictures of a card: (height, width, 3) sRGB pixels, a label, and names of places."""

    pixels: Bytes
    label: str
    words: Sequence[Placed] = ()


@dataclass(frozen=True, slots=True)
class Card:
    """A tool, seen from one side: its name, the moment and the view in words (`aside`), rows of facts, two pictures.

    `colour` is the one in which the tool is drawn, if it is.
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
        self.image = Image.new("RGB", cards_size(columns, rows, size, facts), rgb_bytes(PAPER))
        pen, font = ImageDraw.Draw(self.image), font_of(self._text + 1)
        pen.text((_GAP + 2, _GAP), cut_to(self.image.width - 2 * _GAP, title, font), fill=_DARK, font=font)

    def put(self, number: int, card: Card) -> None:
        """Place a card; numbers go row by row."""
        row, column = divmod(number, self._columns)
        width, height = card_size(self._size, self._rows)
        left = _GAP + column * (width + _GAP)
        top = _title_height(self._size) + row * (height + _GAP)
        pen = ImageDraw.Draw(self.image)
        pen.rectangle((left - 1, top - 1, left + width, top + height), fill="white", outline=rgb_bytes(RULE))
        for place, each in enumerate(card.pictures):
            cell = labelled(each.pixels, each.label, font_of(self._text), each.words)
            self.image.paste(cell, (left + place * (self._size[0] + _SLIT), top))
        self._write(pen, left + _GAP // 2 + 2, top + self._size[1] + self._text // 2, width - _GAP - 4, card)

    def _write(self, pen: Any, left: int, top: int, width: int, card: Card) -> None:
        """Write the words below a card's pictures."""
        small, large = font_of(self._text), font_of(self._text + 1)
        named = min(large.getlength(card.name[:200]) + 3 * self._text, 0.4 * width)
        aside = cut_to(width - named, card.aside, small)
        pen.text((left + width - small.getlength(aside), top), aside, fill=_GREY, font=small)
        start = left
        if card.colour is not None:
            side = self._text - 3
            pen.rectangle((left, top + 3, left + side, top + 3 + side), fill=rgb_bytes(card.colour))
            start += side + self._text // 2
        name = cut_to(left + width - start - small.getlength(aside) - self._text, card.name, large)
        # A stroke around the letters makes them bold, because Pillow's own font has one weight.
        pen.text((start, top - 1), name, fill=_DARK, font=large, stroke_width=0.4)
        for number, row in enumerate(card.facts[: self._rows]):
            line = top + (number + 1) * _line_height(self._size) + 2
            at = float(left)
            for fact in row:
                lead = _BETWEEN if at > left else ""
                text = cut_to(left + width - at, lead + fact.text, small)
                if fact.alarming and text != "…":
                    pen.text((at, line), lead, fill=_GREY, font=small)
                    pen.text((at + small.getlength(lead), line), text[len(lead) :], fill=rgb_bytes(RED), font=small)
                else:
                    pen.text((at, line), text, fill=_GREY, font=small)
                at += small.getlength(text)


def card_size(size: tuple[int, int], facts: int) -> tuple[int, int]:
    """Width and height of a card with pictures of a size and rows of facts, pixels."""
    return 2 * size[0] + _SLIT, size[1] + (1 + facts) * _line_height(size) + text_size(size)


def cards_size(columns: int, rows: int, size: tuple[int, int], facts: int) -> tuple[int, int]:
    """Width and height of a whole sheet, pixels."""
    width, height = card_size(size, facts)
    return _GAP + columns * (width + _GAP), _title_height(size) + rows * (height + _GAP)


def text_size(size: tuple[int, int]) -> int:
    """Size of the words below pictures of a size, pixels."""
    return min(max(13, size[1] // 24), 20)


def _line_height(size: tuple[int, int]) -> int:
    return round(1.45 * text_size(size))


def _title_height(size: tuple[int, int]) -> int:
    return 2 * _GAP + round(1.4 * text_size(size))
