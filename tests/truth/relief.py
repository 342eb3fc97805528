"""Folds on the side of a tube that a bend compresses, in one frame: which way their crests run, and where they are.

On the other side simulated cloth is pulled flat onto the limb, 10 to 20 mm below where skinning has it; that is no
fold.
"""

from dataclasses import dataclass

import numpy as np
from measure import line_normals
from scenes import Array, Scene
from scipy.ndimage import gaussian_filter1d, label

# Wavelength above which heights are taken off, metres, and how sharply: how a tube hangs, bridges its bend and keeps
# its girth is no fold, and is several times as high. Folds were up to 14 cm apart; once round the sleeve is 39 cm.
_HANG, _SHARPNESS = 0.15, 4
# Standard deviation of the averages of slopes and of squared heights, metres: half of most simulated distances of
# crests, so that single crests even out.
_NEAR = 0.05
# That of the averages of slopes over many crests, in wavelengths: half as wide as it is high, it is 2.4 of them long.
_FAR = 1.0
# That of the averages of slopes along single crests, metres.
_CREST = 0.02
# Vertices of a crest: fewer have no direction.
_FEWEST = 3


@dataclass(frozen=True)
class Relief:
    """Folds on a tube.

    Attributes:
        places: (rings, sides, 2) along the tube and around it, m; 0 around is the middle of the fold.
        areas: (vertices,) at rest, m²; 0 on the stretched side.
        heights: (vertices,) of folds alone, m.
        squares: (vertices,) squared heights, averaged nearby, m².
        slopes: (vertices, 2, 2) products of slopes along the tube and around it, averaged nearby: crests run across the
            direction of the greatest.
        own_slopes: (vertices, 2, 2) those of single crests.
        far_slopes: (vertices, 2, 2) those averaged over about two wavelengths.
    """

    places: Array
    areas: Array
    heights: Array
    squares: Array
    slopes: Array
    own_slopes: Array
    far_slopes: Array

    @classmethod
    def of(cls, scene: Scene, posed: Array, smooth: Array, wavelength: float) -> "Relief":
        """Find the folds of (vertices, 3) positions over those that skinning alone gives; `wavelength` is simulated."""
        rings = scene.cloth.positions.reshape(-1, scene.sides, 3)
        along = float(rings[1, 0, 0] - rings[0, 0, 0])
        around = 2.0 * np.pi * np.linalg.norm(rings[:, 0, 1:], axis=1) / scene.sides
        middle = float(around.mean())
        count = len(rings)
        # Mirrored at the tube's ends, so that its two ends do not meet.
        frequencies = np.hypot(np.fft.fftfreq(2 * count, along)[:, None], np.fft.rfftfreq(scene.sides, middle)[None])
        kept = 1.0 / (1.0 + (1.0 / np.maximum(_HANG * frequencies, 1e-9)) ** (2 * _SHARPNESS))

        def averaged(values: Array, deviation: float) -> Array:
            ends = gaussian_filter1d(values, deviation / along, axis=0, mode="nearest")
            return gaussian_filter1d(ends, deviation / middle, axis=1, mode="wrap")

        everywhere = np.arange(len(posed))[None]
        normals = line_normals(smooth, scene.cloth.quads, everywhere)[0]
        heights = np.einsum("va,va->v", posed - smooth, normals).reshape(-1, scene.sides)
        heights = np.fft.irfft2(
            np.fft.rfft2(np.concatenate([heights, heights[::-1]])) * kept, (2 * count, scene.sides)
        )[:count]
        one = np.gradient(heights, along, axis=0)
        other = (np.roll(heights, -1, axis=1) - np.roll(heights, 1, axis=1)) / (2.0 * around[:, None])
        slopes = np.stack([one * one, one * other, one * other, other * other], axis=2)
        angles = np.arange(scene.sides) - scene.sides * (np.arange(scene.sides) > scene.sides // 2)
        places = np.stack(np.broadcast_arrays(along * np.arange(count)[:, None], middle * angles), axis=2)
        return cls(
            places=places,
            areas=np.repeat(along * around, scene.sides) * (scene.cloth.positions[:, 1] > 0),
            heights=heights.ravel(),
            squares=averaged(heights**2, _NEAR).ravel(),
            slopes=averaged(slopes, _NEAR).reshape(-1, 2, 2),
            own_slopes=averaged(slopes, _CREST).reshape(-1, 2, 2),
            far_slopes=averaged(slopes, _FAR * wavelength).reshape(-1, 2, 2),
        )

    @property
    def densest(self) -> Array:
        """(vertices,) True on the smallest part of the tube that has half of the squared heights."""
        order = np.argsort(-self.squares, kind="stable")
        sums = np.cumsum((self.squares * self.areas)[order])
        found = np.zeros(len(order), bool)
        found[order[: int(np.searchsorted(sums, sums[-1] / 2.0)) + 1]] = True
        return found

    @property
    def crest(self) -> tuple[float, float]:
        """Length and width of crests, m: of connected parts higher than the root mean square, by their heights."""
        order = np.argsort(self.places[0, :, 1])
        places, areas = self.places[:, order], self.areas.reshape(self.places.shape[:2])[:, order]
        heights = self.heights.reshape(areas.shape)[:, order]
        parts, count = label((areas > 0) & (heights > np.sqrt(np.average(heights**2, weights=areas))))
        sizes, weights = [], []
        for part in range(1, count + 1):
            inside = parts == part
            if np.count_nonzero(inside) >= _FEWEST:
                # A rod's variance is a twelfth of its squared length.
                variances = np.linalg.eigvalsh(np.cov(places[inside].T))
                sizes.append(np.sqrt(12.0 * np.maximum(variances, 0.0)))
                weights.append(heights[inside].sum())
        width, length = np.average(sizes, axis=0, weights=weights)
        return float(length), float(width)

    @property
    def aslant(self) -> float:
        """Degrees from a ring round the tube to a crest, to either side, in the mean."""
        ways, clear = _steepest(self.own_slopes)
        return float(np.average(np.degrees(np.arctan2(*np.abs(ways.T[::-1]))), weights=clear * self.areas))

    @property
    def rms(self) -> float:
        """The root mean square of the heights, m."""
        return float(np.sqrt(np.average(self.heights**2, weights=self.areas)))

    @property
    def reach(self) -> float:
        """The distance from the bend along the limb, m: the mean by squared heights."""
        along, _ = self._from_bend
        return float(np.average(np.abs(along), weights=self.heights**2 * self.areas))

    @property
    def lean(self) -> float:
        """Degrees by which crests turn towards the bend on their way to the neutral sides, in the mean."""
        ways, clear = _steepest(self.own_slopes)
        steep, aside = (ways * np.where(ways[:, :1] < 0, -1.0, 1.0)).T
        along, around = self._from_bend
        return float(
            np.average(np.degrees(np.arctan2(aside, steep)) * np.sign(along * around), weights=clear * self.areas)
        )

    @property
    def _from_bend(self) -> Array:
        """(2, vertices) distances along the limb from its bend, and round it from the middle of the fold, m."""
        along, around = self.places.reshape(-1, 2).T
        return np.stack([along - along.mean(), around])

    def overlap(self, other: "Relief") -> float:
        """The area that the densest parts share, over the mean of both areas."""
        one, two = self.densest, other.densest
        return float(2.0 * self.areas[one & two].sum() / (self.areas[one].sum() + self.areas[two].sum()))

    def turned(self, other: "Relief") -> tuple[float, float]:
        """Degrees between the crests of both, place by place, and between their mean directions over two wavelengths.

        Each is the mean over where these folds are steep in one direction only.
        """
        near, far = (self.slopes, other.slopes), (self.far_slopes, other.far_slopes)
        return self._apart(*near), self._apart(*far)

    def _apart(self, one: Array, other: Array) -> float:
        """Degrees between the steepest directions of (vertices, 2, 2) slopes, in the mean."""
        (lines, clear), (others, _) = _steepest(one), _steepest(other)
        apart = np.degrees(np.arccos(np.clip(np.abs(np.sum(lines * others, axis=1)), 0.0, 1.0)))
        return float(np.average(apart, weights=clear * self.areas))


def _steepest(slopes: Array) -> tuple[Array, Array]:
    """(vertices, 2) unit directions of the steepest slope, and (vertices,) by how much it is the steeper one."""
    values, vectors = np.linalg.eigh(slopes)
    return vectors[:, :, 1], values[:, 1] - values[:, 0]
