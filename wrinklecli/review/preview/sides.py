"""The side from which wrinkles are looked at, and the light that shows their relief, for reviews and for `suggest`.

Both are chosen among a few by what the wrinkles do to the surface there. The caller says what is hidden.
"""

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, face_normals, unit
from wrinklecli.review.preview.camera import camera_axes

# Azimuths and elevations of the sides, degrees; from higher up one cannot tell which part of the body it is.
ANGLES = [(azimuth, elevation) for elevation in range(-60, 61, 15) for azimuth in range(-165, 181, 15)]
# Cosine between normal and view above which a point counts fully.
FACES = 0.7
# Factor of a side's score, by its elevation: a view from straight above or below loses a quarter.
LEVELS = 1 - 0.25 + 0.25 * np.cos(np.radians([elevation for _, elevation in ANGLES]))

# (sides, 3) directions to the eye.
_BACKS = np.array([camera_axes(*angles)[2] for angles in ANGLES])
# Every second azimuth and elevation: the sides around the best of them are looked at then.
_COARSE = np.array([k for k, angles in enumerate(ANGLES) if not any(angle % 30 for angle in angles)])
# Cosine of the angle between sides that are beside each other.
_BESIDE = np.cos(np.radians(22.0))
# Triangles of a place by which sides and lights are judged.
_JUDGED = 400
# Displacement, as a part of the greatest one, from which a triangle is on the place of wrinkles.
LEAST_WRINKLE = 0.05
# Sides or lights that are looked at together, the most promising first: the best is often among the first few.
_AT_ONCE = 2
# Angles between the key light and the view, degrees: light that comes from the side shows relief, and light from
# farther behind leaves most of a limb in the shade.
_SLANTS = (50.0, 70.0)
# Directions of the light around the view.
_AROUND = 16
# Greatest elevation of a side above a place, degrees: at 90 an azimuth would have no meaning.
_STEEPEST = 89
# Part of its score that light from straight below loses: people take light to come from above, and see bumps as
# hollows otherwise.
_FROM_BELOW = 0.3
# Worth of light over that of its change by wrinkles: of two lights that show them alike, the one that leaves less
# in the shade is better.
_LIT = 0.2
# A place is hidden if less than this part of its wrinkles is visible. It is then shown earlier,
_HIDDEN = 0.6
# at the first of these parts of the time to its peak
_EARLIER = (0.85, 0.7, 0.55, 0.4)
# at which this part of its wrinkles is visible,
_PLAIN = 0.7
# or else at the one at which the most of them is visible.

Seen = TypeVar("Seen")

Free = Callable[[Floats], Bools]
"""(directions, points) True if nothing lies between points of a place and a far eye, in unit (directions, 3)."""


@dataclass(frozen=True, slots=True)
class Place:
    """Some triangles that wrinkles move.

    Attributes:
        points: (triangles, 3) their middles with wrinkles, world space.
        plain_normals: (triangles, 3) unit, without wrinkles.
        normals: (triangles, 3) unit, with them.
        areas: (triangles,) with wrinkles, each for those that are left out too; scene units squared.
        heights: (triangles,) mean displacement, scene units.
    """

    points: Floats
    plain_normals: Floats
    normals: Floats
    areas: Floats
    heights: Floats

    @property
    def centre(self) -> Floats:
        """(3,) middle of the wrinkles, world space."""
        weights = self.areas * self.heights
        return np.asarray(weights @ self.points / weights.sum())

    @property
    def shown(self) -> Floats:
        """(sides, triangles) displacement times area that each side shows of each, if nothing hides it."""
        return np.asarray(self.areas * self.heights * np.clip(_BACKS @ self.normals.T, 0.0, FACES))

    @classmethod
    def of(cls, plain: Floats, wrinkled: Floats) -> "Place":
        """Choose some of the triangles that wrinkles move, from (triangles, 3, 3) corners without and with them."""
        heights = np.linalg.norm(wrinkled - plain, axis=2).mean(axis=1)
        members = np.flatnonzero(heights > LEAST_WRINKLE * heights.max(initial=0.0))
        stride = max(-(-len(members) // _JUDGED), 1)
        members = members[::stride]
        before, after = (_crossed(each[members]) for each in (plain, wrinkled))
        return cls(
            points=wrinkled[members].mean(axis=1),
            plain_normals=unit(before),
            normals=unit(after),
            areas=stride * np.linalg.norm(after, axis=1) / 2.0,
            heights=heights[members],
        )


def _crossed(corners: Floats) -> Floats:
    """(triangles, 3) normals, as long as twice the area."""
    return face_normals(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


@dataclass(frozen=True, slots=True)
class Side:
    """A side from which a place is seen.

    Attributes:
        angles: Azimuth and elevation, degrees.
        score: Sum of the visible displacements, each times the area; scene units cubed.
        visible: Ratio of that score to the score of wrinkles that nothing hides and that all face the view.
    """

    angles: tuple[float, float]
    score: float
    visible: float

    @property
    def name(self) -> str:
        """The side as azimuth:elevation."""
        return f"{self.angles[0]}:{self.angles[1]}"

    @property
    def axes(self) -> Floats:
        """(3, 3) rows: right, up and backwards."""
        return camera_axes(*self.angles)


UNSEEN = Side((0.0, 0.0), 0.0, 0.0)
"""A side that shows no wrinkles."""


def best_side(place: Place, free: Free) -> Side:
    """Choose the side from which most of the wrinkles of a place are visible."""
    shares = place.shown
    scores = np.zeros(len(ANGLES))
    some = _COARSE
    for _ in range(2):  # the coarse sides, then those beside the best
        floor = float(np.max(LEVELS * scores))
        scores[some] = _seen(shares[some], LEVELS[some], _BACKS[some], free, floor=floor)
        best = int(np.argmax(LEVELS * scores))
        some = np.flatnonzero((_BACKS @ _BACKS[best] > _BESIDE) & (scores == 0.0))
    whole = FACES * float(np.sum(place.areas * place.heights))
    return Side(ANGLES[best], float(scores[best]), min(float(scores[best]) / whole, 1.0) if whole > 0 else 0.0)


def part_not_hidden(place: Place, side: Side) -> float:
    """The score of a side over the greatest that any side would have if nothing hid the wrinkles.

    One side shows at most a half of what lies all round a limb.
    """
    most = float(place.shown.sum(axis=1).max(initial=0.0))
    return min(side.score / most, 1.0) if most > 0 else 0.0


def side_above(place: Place, free: Free) -> Side:
    """Choose the side straight above a place, as wrinkles lie on it; where much is hidden from there, the best side."""
    weights = place.areas * place.heights
    back = unit(weights @ place.plain_normals)
    azimuth, elevation = np.degrees([np.arctan2(back[0], back[2]), np.arcsin(np.clip(back[1], -1.0, 1.0))])
    angles = (round(float(azimuth)), round(float(np.clip(elevation, -_STEEPEST, _STEEPEST))))
    back = camera_axes(*angles)[2:]
    shares = weights * np.clip(place.normals @ back[0], 0.0, FACES)
    score, whole = float(shares @ free(back)[0]), FACES * float(weights.sum())
    if score < _HIDDEN * whole:
        return best_side(place, free)
    return Side(angles, score, min(score / whole, 1.0))


def best_light(place: Place, axes: Floats, free: Free) -> Floats:
    """Choose the (3,) unit direction to the key light, in camera axes, in which wrinkles change what is lit the most.

    What lies in the shade, of the place itself or of other parts, does not count.

    Args:
        place: What is looked at.
        axes: (3, 3) rows of the camera: right, up and backwards.
        free: As for the side.
    """
    slants, around = np.meshgrid(np.radians(_SLANTS), 2 * np.pi * np.arange(_AROUND) / _AROUND, indexing="ij")
    lights = np.stack([np.sin(slants) * np.sin(around), np.sin(slants) * np.cos(around), np.cos(slants)], axis=2)
    lights = lights.reshape(-1, 3)
    factors = 1.0 + _FROM_BELOW * np.minimum(lights[:, 1], 0.0)
    seen = place.areas * np.clip(place.normals @ axes[2], 0.0, FACES)
    directions = lights @ axes
    before, after = (directions @ each.T for each in (place.plain_normals, place.normals))
    shares = seen * (np.abs(np.maximum(after, 0.0) - before) + _LIT * before) * (before > 0)
    scores = _seen(shares, factors, directions, free, floor=0.0)
    return np.asarray(lights[np.argmax(factors * scores)])


def _seen(shares: Floats, factors: Floats, directions: Floats, free: Free, *, floor: float) -> Floats:
    """(directions,) sums of (directions, points) shares that nothing hides; 0 where the sum is not the greatest.

    The sums are compared times (directions,) factors. Those that are at most the floor are not needed.
    """
    seen = np.zeros(len(directions))
    bounds = factors * shares.sum(axis=1)
    order = np.argsort(-bounds, kind="stable")
    for first in range(0, len(order), _AT_ONCE):
        some = order[first : first + _AT_ONCE]
        if bounds[some[0]] <= max(floor, float(np.max(factors * seen))):
            break
        seen[some] = np.sum(shares[some] * free(directions[some]), axis=1)
    return seen


def best_moment(start: float, peak: float, look: Callable[[float], tuple[Seen, Side]]) -> tuple[Seen, Side]:
    """Look at a peak, and before it if a fold hides the wrinkles then; give what the best time shows, and its side.

    Args:
        start: Time at which the wrinkles begin to rise, seconds.
        peak: Time at which they are tallest.
        look: Gives what there is at a time, and its best side.
    """
    best = look(peak)
    if best[1].visible >= _HIDDEN:
        return best
    for part in _EARLIER:
        found = look(start + part * (peak - start))
        if found[1].score > best[1].score:
            best = found
            if found[1].visible >= _PLAIN:
                break
    return best
