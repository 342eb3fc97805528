"""The thickness of a muscle of constant volume, and the weights of its morph targets that follow from it.

A belly of length L and thickness r has a volume proportional to L r², so r is √(L₀ / L) times that at rest. Tendons do
not shorten: L is the distance of the ends less the tendons' length, and an activation takes a part of L₀ more, as
tendons give way to a muscle that pulls against a held joint.

Source: C. Larboulette, M.-P. Cani, B. Arnaldi, *Dynamic Skinning*, SCCG 2005, on muscles of constant volume. Differs:
the activation takes a part of the belly's length, not of the tendons', which may be short.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.drive.segment import Lengths
from wrinklecli.drive.table import ROWS, BellyTable, Table
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, distinct_values, interpolated

ACTIVATION = 0.2
"""Part of the belly's rest length by which a full activation shortens it while its ends stay. Measured in men who pull
against a held joint: 0.15 to 0.35, for instance by M. Narici and others, J. Physiol. 496 (1996)."""

SHORTEST, LONGEST = 0.5, 1.6
"""Belly lengths over that at rest between which a muscle keeps its volume: the filaments of its fibres slide no
further. Beyond, its thickness stays."""


@dataclass(frozen=True, slots=True, eq=False)
class ConstantVolume:
    """The response of a muscle: weights of its targets by the length of its segment.

    Attributes:
        rest_length: Distance of the ends at rest, scene units.
        tendons: Length of both tendons, scene units.
        knots: (knots,) sorted thicknesses over that at rest, from 1 on, that the distance of the ends alone gives.
        gains: (knots,) thicknesses that are gained over that at rest.
        mix: (knots, targets) weights where so much is gained. They are proportional to the gain, and linear between
            the knots: the shape follows the distance of the ends, and the activation makes it higher.
    """

    rest_length: float
    tendons: float
    knots: Floats
    gains: Floats
    mix: Floats

    @property
    def belly(self) -> float:
        """Length of the belly at rest, scene units."""
        return self.rest_length - self.tendons

    @property
    def thinnest(self) -> Floats:
        """(targets,) weights of the muscle that is stretched furthest, below 0."""
        return np.asarray((THINNEST - 1.0) / self.gains[0] * self.mix[0])

    @property
    def lows(self) -> Floats:
        """(targets,) sizes of the weights below 0: see `split`. Some engines take none such."""
        return np.maximum(-self.thinnest, 0.0)

    def of_targets(self, kept: Bools) -> "ConstantVolume":
        """The response of some of its (targets,) alone."""
        return replace(self, mix=self.mix[:, kept])

    def shares(self, distances: Floats) -> Floats:
        """(frames,) belly lengths over that at rest, at (frames,) distances of the ends, activation taken off."""
        return np.clip((distances - self.tendons) / self.belly, SHORTEST, LONGEST)

    def thicknesses(self, distances: Floats) -> Floats:
        """(frames,) thicknesses over that at rest, which keep the volume of the belly."""
        return np.asarray(self.shares(distances) ** -0.5)

    def weights(self, reading: Lengths) -> Floats:
        """(frames, targets) weights at the measurements of the segment; 0 while the character is hidden."""
        gains = self.thicknesses(np.where(reading.active, reading.distances, self.rest_length)) - 1.0
        ends = np.where(reading.active, reading.ends.distances, self.rest_length)
        return np.asarray(gains[:, None] * self._unit_weights(self.thicknesses(ends)))

    def _unit_weights(self, thicknesses: Floats) -> Floats:
        """(frames, targets) weights for one more thickness, at (frames,) ones that the distance of the ends gives."""
        return interpolated(thicknesses, self.knots, self.mix / self.gains[:, None])

    def table(self) -> Table | BellyTable:
        """A table of the weights by shortenings."""
        # At rest nothing bulges, not by the error of a table either.
        lengths = distinct_values(
            np.concatenate([np.linspace(SHORTEST, LONGEST, ROWS), [1.0], self.knots[1:-1] ** -2])
        )[::-1]
        rows = 1.0 - (self.tendons + lengths * self.belly) / self.rest_length
        thicknesses = lengths**-0.5
        gains, weights = thicknesses - 1.0, self._unit_weights(thicknesses)
        if len(self.knots) > 1:
            return BellyTable(rows, weights, gains)
        return Table("shortenings", rows, gains[:, None] * weights)


def flexed(thicknesses: Floats) -> Floats:
    """(…,) thicknesses at full activation over those at rest, at (…,) ones that the distance of the ends gives."""
    return np.asarray(np.maximum(thicknesses**-2 - ACTIVATION, SHORTEST) ** -0.5)


FULLEST, THINNEST = SHORTEST**-0.5, LONGEST**-0.5
"""The greatest and the least thickness over that at rest."""
