"""A small picture of a whole asset in the corner of one from near, with a frame around what that one sees."""

from dataclasses import replace

import numpy as np

from wrinklecli.review.preview.camera import Camera
from wrinklecli.review.preview.preview_options import Style
from wrinklecli.review.preview.render import Bytes, Snapshot, render

# Its sides at most, as a part of the picture's shorter one; and the least that is worth drawing, pixels.
_PART, _SMALLEST = 0.36, 32
# So many times as much as the picture must the whole be: of less, one sees where one is.
_LEAST = 2.0
_FRAME, _EDGE = (200, 30, 30), (150, 156, 165)  # sRGB
_MARGIN = 3  # pixels around what is seen, and from the middle of the frame to its sides at least


def with_inset(pixels: Bytes, snapshot: Snapshot, camera: Camera, style: Style) -> Bytes:
    """A picture with the whole asset in its lower left corner; as it is, where it shows most of that.

    Args:
        pixels: (height, width, 3) sRGB.
        snapshot: What the picture shows.
        camera: From where it does.
        style: How.
    """
    height, width = pixels.shape[:2]
    side = round(_PART * min(height, width))
    far = Camera.framing(snapshot.corners.reshape(-1, 3), camera.axes, aspect=1.0, margin=1.05)
    if far.reach < _LEAST * camera.reach * max(1.0, width / height) or side < _SMALLEST:
        return pixels
    small = render(replace(snapshot, marks=()), far, size=(side, side), style=style)
    seen = np.flatnonzero((small != small[0, 0]).any(axis=(0, 2)))
    corners = (
        camera.centre + camera.reach * np.array([[-width / height, 1.0], [width / height, -1.0]]) @ camera.axes[:2]
    )
    middle, reach = np.mean(ends := far.project(corners, (side, side)), axis=0), np.ptp(ends, axis=0) / 2.0
    low, high = (
        np.clip(np.round(middle + sign * np.maximum(reach, _MARGIN)), 0, side - 1).astype(int) for sign in (-1.0, 1.0)
    )
    _outline(small[low[1] : high[1] + 1, low[0] : high[0] + 1], _FRAME)
    first = max(min(int(seen.min(initial=side)), low[0]) - _MARGIN, 0)
    last = min(max(int(seen.max(initial=0)), high[0]) + _MARGIN + 1, side)
    small = small[:, first:last]
    _outline(small, _EDGE)
    joined = pixels.copy()
    joined[height - side :, : small.shape[1]] = small
    return joined


def _outline(pixels: Bytes, colour: tuple[int, int, int]) -> None:
    """Draw the outermost pixels of a picture."""
    for edge in (pixels[:1], pixels[-1:], pixels[:, :1], pixels[:, -1:]):
        edge[:] = colour
