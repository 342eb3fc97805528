"""Converts images to pixels and back, by Pillow, and sRGB to linear light and back."""

import io
import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from wrinklecli.choices import Channel
from wrinklecli.numeric.arrays import Array

if TYPE_CHECKING:
    from PIL import Image

Bytes = NDArray[np.uint8]

# Pixels of a texture's longer side: more than a preview shows. Larger textures are reduced.
_SIDE = 1024
# The curve of sRGB (IEC 61966-2-1) is straight up to this linear value, with this slope,
_STRAIGHT, _SLOPE = 0.0031308, 12.92
# and beyond it a power with an offset.
_POWER, _OFFSET = 2.4, 0.055
# Quality of a JPEG, per cent.
_QUALITY = 90


def read_pixels(data: bytes | memoryview) -> Bytes:
    """(height, width, 3) sRGB of a PNG, JPEG or WebP image, reduced if large; ValueError if it is none or damaged."""
    with _opened(data) as image:
        image.draft("RGB", (_SIDE, _SIDE))
        converted = image.convert("RGB")
        factor = math.ceil(max(converted.size) / _SIDE)
        return np.asarray(converted.reduce(factor) if factor > 1 else converted)


def read_alpha(data: bytes | memoryview) -> Bytes | None:
    """(height, width, 1) alpha of an image, reduced if large; None if it is opaque, ValueError as for `read_pixels`."""
    with _opened(data) as image:
        if not image.has_transparency_data:
            return None
        alpha = image.convert("RGBA").getchannel("A")
        factor = math.ceil(max(alpha.size) / _SIDE)
        return np.asarray(alpha.reduce(factor) if factor > 1 else alpha)[..., None]


def read_channel(data: bytes | memoryview, channel: Channel) -> Array:
    """(height, width) stored values of one channel, 0 to 1, as float32; ValueError if it cannot be read.

    Grey images have their value in r, g and b.
    """
    with _opened(data) as image:
        if channel == "a":
            if not image.has_transparency_data:
                raise ValueError("has no channel a: it is opaque")
            stored = np.asarray(image.convert("RGBA").getchannel("A"))
        elif image.mode.startswith("I"):
            # 16 bits of grey; colours of 16 bits are read as 8.
            stored = np.clip(np.asarray(image), 0, 2**16 - 1) * (255.0 / (2**16 - 1))
        else:
            stored = np.asarray(image.convert("RGB").getchannel("rgb".index(channel)))
        return (stored / 255.0).astype(np.float32)


@contextmanager
def _opened(data: bytes | memoryview) -> "Iterator[Image.Image]":
    """Open a PNG, JPEG or WebP image, and turn the errors of Pillow into ValueError while the block runs."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data), formats=("PNG", "JPEG", "WEBP")) as image:
                yield image
    except UnidentifiedImageError as error:
        raise ValueError("cannot be read: it is no PNG, JPEG or WebP") from error
    except (OSError, SyntaxError, EOFError, OverflowError) as error:
        raise ValueError(f"cannot be read: {error}") from error
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        # A few bytes that claim to be a huge image could fill memory.
        raise ValueError(f"is too large: it has more than {Image.MAX_IMAGE_PIXELS:,} pixels") from error


def linear_rgb(colours: Array) -> Array:
    """Convert sRGB to linear RGB, both 0 to 1."""
    curved = ((colours + _OFFSET) / (1.0 + _OFFSET)) ** _POWER
    return np.where(colours < _STRAIGHT * _SLOPE, colours / _SLOPE, curved)


def srgb(colours: Array) -> Array:
    """Convert linear RGB to sRGB, both 0 to 1."""
    curved = (1.0 + _OFFSET) * colours ** (1.0 / _POWER) - _OFFSET
    return np.where(colours < _STRAIGHT, _SLOPE * colours, curved)


def jpeg_of(pixels: Bytes) -> bytes:
    """Encode (height, width, 3) sRGB as a JPEG, which has a tenth of a PNG's size and looks almost the same."""
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=_QUALITY)
    return file.getvalue()


def png_of(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Encode (height, width) of 8 or 16 bits, or (height, width, 3 or 4) of 8 bits, as a PNG.

    Raises:
        ImportError: Pillow is not installed.
    """
    from PIL import Image

    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()
