"""Sheets: labelled pictures in rows and columns above a legend, written as a picture or an animation. Uses Pillow."""

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from wrinklecli.errors import WrinkleError
from wrinklecli.review.preview.overlay import Placed
from wrinklecli.review.preview.preview_options import MOST_SIDE

Bytes = NDArray[np.uint8]
Colour = tuple[float, float, float]

# Pixels of a sheet, or of all frames of an animation: they are held in memory until the file is written.
MOST_PIXELS = 2**28
# Of a word: pixels beside its place, and lines below it, one after the other.
_ASIDE, _STEPS = 7, (0.0, 0.9, -0.9, 1.8, -1.8)
_GUTTER = 4  # pixels between pictures
_DARK, _PALE = (60, 66, 74), (255, 255, 255)
_WEBP_QUALITY = 90
_PALETTE_FRAMES = 8  # of an animation, that its palette is made from


@dataclass(frozen=True, slots=True)
class Legend:
    """What explains the colours of a sheet: a ramp with numbers, and names of colours.

    Attributes:
        title: Of the ramp; empty for none.
        ramp: (colours, 3) sRGB, 0 to 1.
        ticks: Numbers along the ramp: where, 0 to 1, and what.
        names: Each with its colour.
    """

    title: str = ""
    ramp: NDArray[np.float64] | None = None
    ticks: tuple[tuple[float, str], ...] = ()
    names: tuple[tuple[str, Colour], ...] = ()


@dataclass(frozen=True, slots=True)
class Drawn:
    """What was drawn.

    Attributes:
        images: A sheet, or the frames of an animation.
        shown: What there is to see: how many moments, or tools.
        views: As used; `facing` as the angles that it came to.
        seconds: From one frame to the next.
        warnings: A line each.
    """

    images: tuple[Image.Image, ...]
    shown: str
    views: tuple[str, ...]
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()


class Sheet:
    """Pictures of one size in rows and columns, each with a label, and a legend below."""

    def __init__(self, columns: int, rows: int, size: tuple[int, int], legend: Legend) -> None:
        self._size = size
        self._legend = legend
        width, height = sheet_size(columns, rows, size, legend)
        self.image = Image.new("RGB", (width, height), _PALE)
        if height > rows * (size[1] + _GUTTER) - _GUTTER:
            self._draw_legend(height - _legend_height(size))

    def put(self, column: int, row: int, picture: Bytes, label: str, words: Sequence[Placed] = ()) -> None:
        """Place a picture, its label in the top left corner, and words beside what they name."""
        width, height = self._size
        cell = tagged(picture, label, font_of(_font_size(self._size)), words)
        self.image.paste(cell, (column * (width + _GUTTER), row * (height + _GUTTER)))

    def _draw_legend(self, top: int) -> None:
        font, pen = font_of(_font_size(self._size)), ImageDraw.Draw(self.image)
        step = int(font.size)
        left, line = step // 2 + 3, top + step // 2
        if self._legend.ramp is not None:
            pen.text((left, line), self._legend.title, fill=_DARK, font=font)
            left += int(pen.textlength(self._legend.title, font=font)) + step
            width = min(16 * step, self.image.width - left - 2 * step)
            if width > 4 * step:
                for x in range(width):
                    colour = self._legend.ramp[x * len(self._legend.ramp) // width]
                    pen.line((left + x, line + 1, left + x, line + step), fill=code(colour))
                for place, text in self._legend.ticks:
                    x = left + round(place * width)
                    pen.line((x, line + step, x, line + step + 3), fill=_DARK)
                    pen.text((x, line + step + 4), text, fill=_DARK, font=font, anchor="ma")
                left += width + 2 * step
        for name, colour in self._legend.names:
            text = fitting(name, font, 16 * step)
            room = 2 * step + int(pen.textlength(text, font=font))
            if left + room > self.image.width:
                break
            pen.rectangle((left, line + 2, left + step - 2, line + step), fill=code(colour))
            pen.text((left + step + 3, line), text, fill=_DARK, font=font)
            left += room + step // 2


def sheet_size(columns: int, rows: int, size: tuple[int, int], legend: Legend) -> tuple[int, int]:
    """Width and height of a whole sheet, pixels."""
    wanted = legend.ramp is not None or legend.names
    width, height = columns * (size[0] + _GUTTER) - _GUTTER, rows * (size[1] + _GUTTER) - _GUTTER
    return width, height + (_legend_height(size) if wanted else 0)


def refuse_large(size: tuple[int, int], count: int, path: str) -> None:
    """Check that a picture, or an animation of so many, can be written and held in memory."""
    if max(size) > MOST_SIDE:
        raise WrinkleError(f"would have {size[0]} × {size[1]} pixels; at most {MOST_SIDE} each way", where=path)
    if size[0] * size[1] * count > MOST_PIXELS:
        most = MOST_PIXELS // (size[0] * size[1])
        raise WrinkleError(f"would have {count} frames; of {size[0]} × {size[1]} pixels, at most {most}", where=path)


def _legend_height(size: tuple[int, int]) -> int:
    return 3 * _font_size(size)


def _font_size(size: tuple[int, int]) -> int:
    return max(12, size[1] // 36)


@cache
def font_of(size: int) -> Any:
    """A font that Pillow brings along, pixels."""
    return ImageFont.load_default(float(size))


def tagged(picture: Bytes, label: str, font: Any, words: Sequence[Placed] = ()) -> Image.Image:
    """A picture with a label in its top left corner, where it fits, and words beside what they name."""
    cell = Image.fromarray(picture)
    if words:
        _write_words(cell, words, font)
    edge = font.size // 2
    text = fitting(label, font, cell.width - 4 * edge)
    if text and font.size + 2 * edge < cell.height:
        pen = ImageDraw.Draw(cell)
        left, top, right, bottom = pen.textbbox((edge + 3, edge), text, font=font)
        pen.rectangle((left - 4, top - 3, right + 4, bottom + 3), fill=_PALE)
        pen.text((edge + 3, edge), text, fill=_DARK, font=font)
    return cell


def _write_words(cell: Image.Image, words: Sequence[Placed], font: Any) -> None:
    """Write words right or left of their places, or a little above or below: where none has been written yet."""
    pen, taken = ImageDraw.Draw(cell), np.zeros((cell.height, cell.width), bool)
    for word in words:
        if word.anchor:
            left, top, right, bottom = pen.textbbox(word.at, word.text, font=font, anchor=word.anchor)
            taken[max(int(top), 0) : int(bottom) + 1, max(int(left), 0) : int(right) + 1] = True
            _write(pen, word.at, word.text, word.colour, font, word.anchor)
            continue
        text = fitting(word.text, font, cell.width / 2)
        width, height = math.ceil(font.getlength(text)), round(1.1 * font.size)
        for side, down in product((_ASIDE, -_ASIDE - width), _STEPS):
            left, top = round(word.at[0] + side), round(word.at[1] + height * (down - 0.5))
            within = left >= 0 and left + width <= cell.width and top >= 0 and top + height <= cell.height
            if within and not taken[top : top + height, left : left + width].any():
                taken[top : top + height, left : left + width] = True
                _write(pen, (left, top), text, word.colour, font, "la")
                break


def _write(pen: Any, at: tuple[float, float], text: str, colour: Colour, font: Any, anchor: str) -> None:
    """A word that can be read on any ground."""
    pen.text(at, text, fill=code(colour), font=font, anchor=anchor, stroke_width=2, stroke_fill=_PALE)


def fitting(text: str, font: Any, width: float) -> str:
    """A line of text, cut where it is wider than there is room."""
    text = "".join(c if c.isprintable() else "?" for c in text[:200])
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[:-1]
    return text + "…" if text else ""


def code(colour: Any) -> tuple[int, int, int]:
    """An sRGB colour of 0 to 1 in whole numbers of 255."""
    red, green, blue = (round(255 * float(c)) for c in colour)
    return red, green, blue


def encode_picture(image: Image.Image) -> bytes:
    """A PNG."""
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


def encode_animation(images: Sequence[Image.Image], kind: str, *, seconds: float) -> bytes:
    """An endless animation.

    Args:
        images: Of one size.
        kind: webp or gif.
        seconds: From one image to the next.
    """
    file = io.BytesIO()
    # Of hundredths of a second for GIF; each image ends at the nearest one, so that rounding does not add up.
    unit = 10 if kind == "gif" else 1
    ends = [round(1000 * seconds * number / unit) * unit for number in range(len(images) + 1)]
    durations = [max(stop - start, unit) for start, stop in pairwise(ends)]
    if kind == "webp":
        first, *others = images
        options: dict[str, Any] = {"quality": _WEBP_QUALITY, "method": 4}
    else:
        palette = _palette(images)
        first, *others = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in images]
        options = {"optimize": False}
    first.save(file, kind, save_all=True, append_images=others, duration=durations, loop=0, **options)
    return file.getvalue()


def _palette(images: Sequence[Image.Image]) -> Image.Image:
    """One palette for all images, so that colours do not flicker."""
    chosen = images[:: math.ceil(len(images) / _PALETTE_FRAMES)]
    width, height = chosen[0].size
    together = Image.new("RGB", (width, height * len(chosen)))
    for number, each in enumerate(chosen):
        together.paste(each, (0, number * height))
    return together.quantize(256, Image.Quantize.MEDIANCUT)
