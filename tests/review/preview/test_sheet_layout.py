"""Labelled sheets and animations."""

import io

import numpy as np
import pytest
from PIL import Image

from kit.pictures import SIZE
from wrinklecli.review.preview.heat import heat_colours
from wrinklecli.review.preview.sheet_layout import Legend, Sheet, encode_animation, sheet_size


@pytest.mark.parametrize("label", ["", "x" * 500, "名前 ‮ \x1b[31m\n", "a"])
def test_any_label_fits_its_picture(label: str) -> None:
    sheet = Sheet(2, 1, SIZE, Legend())
    grey = np.full((*SIZE[::-1], 3), 90, np.uint8)
    sheet.put(0, 0, grey, label)
    shown = np.asarray(sheet.image)
    assert np.array_equal(shown[30:, :80], grey[30:])
    assert (shown[:, 80:] == 255).all(), "nothing beyond it"


def test_a_legend_with_more_names_than_there_is_room_for_stays_in_its_place() -> None:
    legend = Legend("compressed by", heat_colours(np.linspace(0, 0.8, 9)), ((0.0, "0%"),), (("tool", (1, 0, 0)),) * 99)
    size = sheet_size(1, 1, SIZE, legend)
    sheet = Sheet(1, 1, SIZE, legend)
    assert sheet.image.size == size
    assert size[1] > SIZE[1]


def test_an_animation_keeps_flat_colours() -> None:
    images = [Image.new("RGB", (16, 16), colour) for colour in ((200, 40, 40), (40, 200, 40))]
    for kind in ("gif", "webp"):
        with Image.open(io.BytesIO(encode_animation(images, kind, seconds=0.1))) as image:
            for number, expected in enumerate(images):
                image.seek(number)
                ours, theirs = (np.asarray(each.convert("RGB")).astype(int) for each in (image, expected))
                assert np.abs(ours - theirs).max() < 12
