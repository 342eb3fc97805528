"""Images to pixels."""

import io
import zlib

import pytest
from PIL import Image

from wrinklecli.gltf.pixels import read_alpha, read_pixels


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


@pytest.mark.parametrize(("width", "shape"), [(900, (6, 900, 1)), (3000, (2, 1000, 1))])
def test_alpha_has_the_size_of_the_pixels(width: int, shape: tuple[int, int, int]) -> None:
    image = Image.new("RGBA", (width, 6), (10, 20, 30, 40))
    file = io.BytesIO()
    image.save(file, "PNG")
    alpha = read_alpha(file.getvalue())
    assert alpha is not None
    assert (alpha.shape, alpha.min(), alpha.max()) == (shape, 40, 40)
    image.convert("RGB").save(file := io.BytesIO(), "PNG")
    assert read_alpha(file.getvalue()) is None


def test_what_is_no_image_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^cannot be read: it is no PNG, JPEG or WebP$"):
        read_pixels(b"GIF89a" + bytes(64))
