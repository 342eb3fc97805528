"""Images to pixels."""

import io
import zlib

import pytest
from PIL import Image

from wrinklecli.gltf.pixels import read_pixels


def test_large_textures_are_reduced_and_huge_ones_refused() -> None:
    file = io.BytesIO()
    Image.new("RGB", (3000, 10), (10, 20, 30)).save(file, "PNG")
    assert read_pixels(file.getvalue()).shape == (4, 1000, 3)
    header = bytearray(file.getvalue())
    for most in (12_000, 60_000):
        header[16:24] = most.to_bytes(4) + most.to_bytes(4)
        header[29:33] = zlib.crc32(bytes(header[12:29])).to_bytes(4)
        with pytest.raises(ValueError, match=r"^is too large: it has more than [\d,]+ pixels$"):
            read_pixels(bytes(header))


def test_what_is_no_image_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^cannot be read: it is no PNG, JPEG or WebP$"):
        read_pixels(b"GIF89a" + bytes(64))
