"""Images: what type their bytes are."""

import io

import pytest
from PIL import Image

from wrinklecli.gltf.images import image_type


@pytest.mark.parametrize("kind", ["png", "jpeg", "webp"])
def test_type_of_an_image(kind: str) -> None:
    file = io.BytesIO()
    Image.new("RGB", (2, 2)).save(file, kind)
    assert image_type(file.getvalue()[:16]) == f"image/{kind}"


def test_type_of_a_texture_for_graphics_cards() -> None:
    assert image_type(b"\xabKTX 20\xbb\r\n\x1a\n") == "image/ktx2"
