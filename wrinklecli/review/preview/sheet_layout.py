"""Lay out labelled pictures in rows and columns above a legend, and encode sheets and animations with Pillow."""

import io
import math
from collections.abc import Sequence
from functools import cache
from itertools import pairwise, product
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from wrinklecli.character.paints import Colour
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.pixels import Bytes
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.preview.overlay import INK, Placed
from wrinklecli.review.preview.preview_options import MOST_SIDE

# The greatest number of pixels of a sheet, or of all frames of an animation, which are in memory until the end.
MOST_PIXELS = 2**28
# Distance between a place and its word, pixels.
_ASIDE = 7
# Lines by which a word may stand below its place, in the order in which they are tried.
_STEPS = (0.0, 0.9, -0.9, 1.8, -1.8)
# Pixels between pictures.
_GUTTER = 4
# Quality of a lossy WebP, 0 to 100: at 75, of half the bytes, smooth cloth shows dark rectangles while it moves.
_WEBP_QUALITY = 90
# Frames of an animation from which its palette is made.
_PALETTE_FRAMES = 8
# The greatest number of letters of a line.
_MOST_LETTERS = 200


@dataclass(frozen=True, slots=True)
class Legend:
    """Explains the colours of a sheet by names, and by a ramp of (colours, 3) sRGB with numbers at places, 0 to 1."""

    title: str = ""
    ramp: Floats | None = None
    ticks: tuple[tuple[float, str], ...] = ()
    names: tuple[tuple[str, Colour], ...] = ()


@dataclass(frozen=True, slots=True)
class Drawn:
    """One sheet, or the frames of an animation, which follow each other after so many seconds.

    `shown` is the number of moments, or of tools, in words. In `views`, `facing` has become azimuth:elevation.
    """

    images: tuple[Image.Image, ...]
    shown: str
    views: tuple[str, ...]
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()


class Sheet:
    """Pictures of one size in rows and columns, each with a label, above a legend."""

    def __init__(self, columns: int, rows: int, size: tuple[int, int], legend: Legend) -> None:
        self._size = size
        self._legend = legend
        width, height = sheet_size(columns, rows, size, legend)
        self.image = Image.new("RGB", (width, height), "white")
        if height > rows * (size[1] + _GUTTER) - _GUTTER:
            self._draw_legend(height - _legend_height(size))

    def put(self, column: int, row: int, picture: Bytes, label: str, words: Sequence[Placed] = ()) -> None:
        """Place a picture with its label, and words beside the places that they name."""
        width, height = self._size
        cell = labelled(picture, label, font_of(_font_size(self._size)), words)
        self.image.paste(cell, (column * (width + _GUTTER), row * (height + _GUTTER)))

    def _draw_legend(self, top: int) -> None:
        font, pen = font_of(_font_size(self._size)), ImageDraw.Draw(self.image)
        step = int(font.size)
        left, line = step // 2 + 3, top + step // 2
        if self._legend.ramp is not None:
            pen.text((left, line), self._legend.title, fill=rgb_bytes(INK), font=font)
            left += int(pen.textlength(self._legend.title, font=font)) + step
            width = min(16 * step, self.image.width - left - 2 * step)
            if width > 4 * step:
                for x in range(width):
                    colour = self._legend.ramp[x * len(self._legend.ramp) // width]
                    pen.line((left + x, line + 1, left + x, line + step), fill=rgb_bytes(colour))
                for place, text in self._legend.ticks:
                    x = left + round(place * width)
                    pen.line((x, line + step, x, line + step + 3), fill=rgb_bytes(INK))
                    pen.text((x, line + step + 4), text, fill=rgb_bytes(INK), font=font, anchor="ma")
                left += width + 2 * step
        for name, colour in self._legend.names:
            text = cut_to(16 * step, name, font)
            room = 2 * step + int(pen.textlength(text, font=font))
            if left + room > self.image.width:
                break
            pen.rectangle((left, line + 2, left + step - 2, line + step), fill=rgb_bytes(colour))
            pen.text((left + step + 3, line), text, fill=rgb_bytes(INK), font=font)
            left += room + step // 2


def sheet_size(columns: int, rows: int, size: tuple[int, int], legend: Legend) -> tuple[int, int]:
    """Width and height of a whole sheet, pixels."""
    wanted = legend.ramp is not None or legend.names
    width, height = columns * (size[0] + _GUTTER) - _GUTTER, rows * (size[1] + _GUTTER) - _GUTTER
    return width, height + (_legend_height(size) if wanted else 0)


def refuse_large(size: tuple[int, int], count: int, path: str) -> None:
    """Check that `count` pictures of a size can be written, and held in memory."""
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
    """Pillow's own font, of a size in pixels."""
    return ImageFont.load_default(float(size))


def labelled(picture: Bytes, label: str, font: Any, words: Sequence[Placed] = ()) -> Image.Image:
    """A picture with a label in its top left corner, if it fits, and words beside the places that they name."""
    cell = Image.fromarray(picture)
    if words:
        _write_words(cell, words, font)
    edge = font.size // 2
    text = cut_to(cell.width - 4 * edge, label, font)
    if text and font.size + 2 * edge < cell.height:
        pen = ImageDraw.Draw(cell)
        left, top, right, bottom = pen.textbbox((edge + 3, edge), text, font=font)
        pen.rectangle((left - 4, top - 3, right + 4, bottom + 3), fill="white")
        pen.text((edge + 3, edge), text, fill=rgb_bytes(INK), font=font)
    return cell


def _write_words(cell: Image.Image, words: Sequence[Placed], font: Any) -> None:
    """Write words right or left of their places, or a little above or below, so that none covers another."""
    pen, taken = ImageDraw.Draw(cell), np.zeros((cell.height, cell.width), bool)
    for word in words:
        if word.anchor:
            left, top, right, bottom = pen.textbbox(word.at, word.text, font=font, anchor=word.anchor)
            taken[max(int(top), 0) : int(bottom) + 1, max(int(left), 0) : int(right) + 1] = True
            _write(pen, word.at, word.text, word.colour, font, word.anchor)
            continue
        text = cut_to(cell.width / 2, word.text, font)
        width, height = math.ceil(font.getlength(text)), round(1.1 * font.size)
        for side, down in product((_ASIDE, -_ASIDE - width), _STEPS):
            left, top = round(word.at[0] + side), round(word.at[1] + height * (down - 0.5))
            within = left >= 0 and left + width <= cell.width and top >= 0 and top + height <= cell.height
            if within and not taken[top : top + height, left : left + width].any():
                taken[top : top + height, left : left + width] = True
                _write(pen, (left, top), text, word.colour, font, "la")
                break


def _write(pen: Any, at: tuple[float, float], text: str, colour: Colour, font: Any, anchor: str) -> None:
    """Write a word that can be read on any ground."""
    pen.text(at, text, fill=rgb_bytes(colour), font=font, anchor=anchor, stroke_width=2, stroke_fill="white")


def cut_to(width: float, text: str, font: Any) -> str:
    """A line of text, cut to a width in pixels."""
    text = "".join(c if c.isprintable() else "?" for c in text[:_MOST_LETTERS])
    if font.getlength(text) <= width:
        return text
    while text and font.getlength(text + "…") > width:
        text = text[:-1]
    return text + "…" if text else ""


def rgb_bytes(colour: Any) -> tuple[int, int, int]:
    """An sRGB colour of 0 to 1 as 8-bit numbers."""
    red, green, blue = (round(255 * float(c)) for c in colour)
    return red, green, blue


def encode_picture(image: Image.Image) -> bytes:
    """Encode a PNG."""
    file = io.BytesIO()
    image.save(file, "PNG")
    return file.getvalue()


def encode_animation(images: Sequence[Image.Image], kind: str, *, seconds: float) -> bytes:
    """Encode an endless animation, a webp or a gif, of images that follow each other after these seconds."""
    file = io.BytesIO()
    # Milliseconds; GIF counts hundredths of a second. Ends are rounded, not durations, so that errors do not add up.
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
    """Make one palette for all images, so that colours do not flicker."""
    chosen = images[:: math.ceil(len(images) / _PALETTE_FRAMES)]
    width, height = chosen[0].size
    together = Image.new("RGB", (width, height * len(chosen)))
    for number, each in enumerate(chosen):
        together.paste(each, (0, number * height))
    return together.quantize(256, Image.Quantize.MEDIANCUT)
