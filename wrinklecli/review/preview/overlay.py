"""Draw strokes, dots and words at places of the world over a picture of a surface."""

from collections.abc import Sequence
from dataclasses import fields
from typing import Literal

import numpy as np

from wrinklecli.character.paints import Colour
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Array, Floats
from wrinklecli.review.preview.camera import Camera, project
from wrinklecli.review.preview.rays import TracedSurface, in_sight

# Colours of pictures and of what is drawn on them, sRGB: the background, words and rulers, thin lines and frames, and
# what is wrong or looked at.
PAPER = (0.93, 0.94, 0.95)
INK = (0.16, 0.19, 0.23)
RULE = (0.74, 0.78, 0.83)
RED = (0.89, 0.0, 0.0)
# Points of a stroke for each pixel of its length, so that it has no gaps.
_POINTS = 2.0
# The greatest number of points of a stroke, because one that leaves the picture may be very long.
_MOST_POINTS = 4096
# Half the width of the line of a ring or a cross, pixels.
_SIGN = 0.9
# Coordinates of a dot beyond which it is not drawn, pixels: it is far outside any picture.
_OUTSIDE = 1e6


@dataclass(frozen=True, slots=True)
class Stroke:
    """A straight line between (2, 3) world-space ends, in sRGB; lengths are pixels.

    It is less opaque (`behind`) where the surface hides it, and dashed unless `dash` is 0.
    """

    ends: Floats
    colour: Colour
    width: float
    behind: float
    dash: float = 0.0


@dataclass(frozen=True, slots=True)
class Dot:
    """A small sign at a (3,) world-space place, in sRGB, that shows through the surface; its radius is in pixels."""

    place: Floats
    colour: Colour
    radius: float
    kind: Literal["disc", "ring", "cross"] = "disc"


@dataclass(frozen=True, slots=True)
class Word:
    """A name in sRGB at a (3,) world-space place; with `always`, one outside the picture is written at its border."""

    place: Floats
    text: str
    colour: Colour
    always: bool = False


@dataclass(frozen=True, slots=True)
class Overlay:
    """Strokes and dots for `draw_overlay`, and words and labels that the sheet's layout writes."""

    strokes: Sequence[Stroke] = ()
    dots: Sequence[Dot] = ()
    words: Sequence[Word] = ()
    labels: Sequence["Placed"] = ()

    def joined(self, other: "Overlay") -> "Overlay":
        """This overlay, and the other one on top of it."""
        pairs = ((getattr(self, each.name), getattr(other, each.name)) for each in fields(self))
        return Overlay(*((*one, *two) for one, two in pairs))


NOTHING = Overlay()


@dataclass(frozen=True, slots=True)
class Placed:
    """A word in sRGB in a picture.

    It names the place `at`, in pixels from the left and the top. Pillow's `anchor` says which point of the word lies
    there; if empty, the word stands beside the place.
    """

    at: tuple[float, float]
    text: str
    colour: Colour
    anchor: str = ""


def placed_words(overlay: Overlay, camera: Camera, size: tuple[int, int]) -> list[Placed]:
    """The labels of an overlay, and its words that lie in a picture of a size in pixels."""
    placed = list(overlay.labels)
    for word in overlay.words:
        x, y = (float(each) for each in camera.project(word.place, size))
        if word.always or (0 <= x <= size[0] and 0 <= y <= size[1]):
            placed.append(Placed((min(max(x, 0.0), size[0]), min(max(y, 0.0), size[1])), word.text, word.colour))
    return placed


def draw_overlay(picture: Array, overlay: Overlay, camera: Camera, surface: TracedSurface) -> None:
    """Draw strokes, then dots, over a (height, width, 3) picture of 8-bit sRGB, in place.

    The camera sees the picture; the surface, in camera space, may hide strokes.
    """
    size = (picture.shape[1], picture.shape[0])
    for stroke in overlay.strokes:
        ends = camera.project(stroke.ends, size)
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if not np.isfinite(length):
            continue
        ts = np.linspace(0, 1, int(min(max(_POINTS * length, 2), _MOST_POINTS)))
        local = camera.local(stroke.ends[0] + ts[:, None] * (stroke.ends[1] - stroke.ends[0]))
        places = project(local, size, camera.tangent)
        inside = ((places > -2) & (places < np.array(size) + 2)).all(axis=1)
        if stroke.dash:
            inside &= (ts * length) % (2 * stroke.dash) < stroke.dash
        opacities = np.where(in_sight(surface, local), 1.0, stroke.behind)
        _splat(picture, places[inside], opacities[inside], stroke.width / 2, stroke.colour)
    for dot in overlay.dots:
        _draw_dot(picture, dot, camera.project(dot.place, size))


def _draw_dot(picture: Array, dot: Dot, place: Floats) -> None:
    if not (np.isfinite(place).all() and (np.abs(place) < _OUTSIDE).all()):
        return
    offsets, radius = np.zeros((1, 2)), dot.radius
    if dot.kind == "ring":
        angles = np.linspace(0, 2 * np.pi, int(8 * dot.radius) + 8)
        offsets, radius = dot.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), _SIGN
    elif dot.kind == "cross":
        ts = np.linspace(-dot.radius, dot.radius, int(4 * dot.radius) + 4)
        offsets, radius = np.concatenate([np.stack([ts, ts], axis=1), np.stack([ts, -ts], axis=1)]), _SIGN
    _splat(picture, place + offsets, np.ones(len(offsets)), radius, dot.colour)


def _splat(picture: Array, places: Floats, opacities: Floats, radius: float, colour: Colour) -> None:
    """Draw discs of a radius at (points, 2) pixels, in place; where discs overlap, the most opaque one counts."""
    height, width = picture.shape[:2]
    reach = int(np.ceil(radius + 1))
    corners = np.floor(places).astype(np.intp)
    offsets = np.stack(np.meshgrid(*(np.arange(-reach, reach + 1),) * 2), axis=-1).reshape(-1, 2)
    pixels = corners[:, None] + offsets
    distances = np.sqrt(np.sum((pixels + 0.5 - places[:, None]) ** 2, axis=2))
    covered = np.clip(radius + 0.5 - distances, 0, 1) * opacities[:, None]
    known = (covered > 0) & (pixels >= 0).all(axis=2) & (pixels < (width, height)).all(axis=2)
    numbers = pixels[known][:, 1] * width + pixels[known][:, 0]
    most = np.zeros(height * width)
    np.maximum.at(most, numbers, covered[known])
    touched = np.flatnonzero(most)
    flat = picture.reshape(-1, 3)
    ink = 255 * np.array(colour)
    flat[touched] = np.round(flat[touched] + most[touched, None] * (ink - flat[touched])).astype(np.uint8)
