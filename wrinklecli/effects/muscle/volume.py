"""The thickness of a muscle of constant volume, and the weights of its morph targets that follow from it.

A belly of length L and thickness r has a volume proportional to L r², so r is √(L₀ / L) times that at rest. Tendons do
not shorten: L is the distance of the ends less the tendons' length, and an activation takes a part of L₀ more, as
tendons give way to a muscle that pulls against a held joint.

Source: C. Larboulette, M.-P. Cani, B. Arnaldi, *Dynamic Skinning*, SCCG 2005, on muscles of constant volume. Differs:
the activation takes a part of the belly's length, not of the tendons', which may be short.
"""

from dataclasses import dataclass

import numpy as np

from wrinklecli.drive.segment import Lengths
from wrinklecli.drive.table import Json, stored
from wrinklecli.numeric.arrays import Floats

ACTIVATION = 0.2
"""Part of the belly's rest length by which a full activation shortens it while its ends stay. Measured in men who pull
against a held joint: 0.15 to 0.35, for instance by M. Narici and others, J. Physiol. 496 (1996)."""

SHORTEST, LONGEST = 0.5, 1.6
"""Belly lengths over that at rest between which a muscle keeps its volume: the filaments of its fibres slide no
further. Beyond, its thickness stays."""

# Rows of the table for players: straight lines between them are right to 1/800 of the greatest weight.
_ROWS = 33


@dataclass(frozen=True, slots=True, eq=False)
class ConstantVolume:
    """The response of a muscle: weights of its targets by the length of its segment.

    Attributes:
        rest_length: Distance of the ends at rest, scene units.
        tendons: Length of both tendons, scene units.
        knots: (targets,) sorted thicknesses over that at rest, above 1, at which one target alone has weight 1; weights
            are straight between them, and go on straight below 1, where a stretched muscle is thinner.
    """

    rest_length: float
    tendons: float
    knots: Floats

    @property
    def belly(self) -> float:
        """Length of the belly at rest, scene units."""
        return self.rest_length - self.tendons

    def shares(self, distances: Floats) -> Floats:
        """(frames,) belly lengths over that at rest, at (frames,) distances of the ends, activation taken off."""
        return np.clip((distances - self.tendons) / self.belly, SHORTEST, LONGEST)

    def thicknesses(self, distances: Floats) -> Floats:
        """(frames,) thicknesses over that at rest, which keep the volume of the belly."""
        return np.asarray(self.shares(distances) ** -0.5)

    def weights(self, reading: Lengths) -> Floats:
        """(frames, targets) weights at the measurements of the segment; 0 while the character is hidden."""
        distances = np.where(reading.active, reading.distances, self.rest_length)
        return weights_of(self.thicknesses(distances), self.knots)

    def to_json(self) -> Json:
        """A table of weights by shortenings, as extras store it."""
        lengths = np.linspace(LONGEST, SHORTEST, _ROWS)
        distances = self.tendons + lengths * self.belly
        table = weights_of(lengths**-0.5, self.knots)
        return {"shortenings": stored(1.0 - distances / self.rest_length), "weights": stored(table, 6)}


def weights_of(thicknesses: Floats, knots: Floats) -> Floats:
    """(frames, targets) weights of targets that are shapes at (targets,) knots, for (frames,) thicknesses over rest."""
    places = np.append(1.0, knots)
    columns = np.vstack([np.zeros(len(knots)), np.eye(len(knots))])
    weights = np.stack([np.interp(thicknesses, places, column) for column in columns.T], axis=1)
    thin = thicknesses < 1.0
    weights[thin, 0] = (thicknesses[thin] - 1.0) / (knots[0] - 1.0)
    return weights


FULLEST = SHORTEST**-0.5
"""The greatest thickness over that at rest."""
