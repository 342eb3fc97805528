"""A checker on skin that slides."""

import numpy as np

from wrinklecli.character.paints import Texture, look_up
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.preview.render import Snapshot, checked


def strip(slides: Floats) -> Snapshot:
    """Triangles side by side along x, each slid by a length."""
    count = len(slides)
    triangle = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    corners = triangle + np.stack([np.arange(count) + slides, *np.zeros((2, count))], axis=1)[:, None]
    normals = np.broadcast_to([0.0, 0.0, 1.0], corners.shape)
    own = Texture(np.zeros((1, 1, 3), np.uint8))
    return Snapshot(corners, normals, np.ones_like(corners), np.zeros((count, 3, 2)), np.zeros(count, np.intp), (own,))


def test_a_checker_lies_straight_before_and_slides_with_the_skin() -> None:
    still, slid = strip(np.zeros(8)), strip(np.array([0.0, 0.001, 0.5, 1.0, 1.5, 1.0, 0.5, 0.0]))
    before, after = checked(still, slid, np.eye(3))
    assert np.array_equal(before.coordinates, after.coordinates)
    for each, plain in ((before, still), (after, slid)):
        assert each.texture_numbers.tolist() == [0, 0, 1, 1, 1, 1, 1, 0], "skin that stays keeps its own texture"
        assert np.array_equal(each.corners, plain.corners)
    # Two cells, a light and a dark one, are as wide as two thirds of the greatest slide.
    steps = np.diff(before.coordinates[2:7, 0], axis=0)
    assert np.allclose(steps, [1.0 / (2.0 * 1.5 / 3.0), 0.0])
    colours = look_up(after.textures[1], np.array([[0.25, 0.25], [0.75, 0.25], [1.25, 0.25], [0.75, 0.75]]))
    tones = colours[:, 0]
    assert np.array_equal(colours, np.repeat(tones[:, None], 3, axis=1)), "grey, without opacity"
    assert tones[0] == tones[2] == tones[3] > tones[1] + 0.3


def test_skin_that_does_not_slide_gets_no_checker() -> None:
    still = strip(np.zeros(8))
    assert checked(still, still, np.eye(3)) == (still, still)
