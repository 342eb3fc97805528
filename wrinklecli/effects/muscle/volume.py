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

# Rows of the table for players: straight lines between them are right to 1/3000 of the greatest weight.
_ROWS = 65


@dataclass(frozen=True, slots=True, eq=False)
class ConstantVolume:
    """The response of a muscle: weights of its targets by the length of its segment.

    Attributes:
        rest_length: Distance of the ends at rest, scene units.
        tendons: Length of both tendons, scene units.
        knots: (knots,) sorted thicknesses over that at rest, without 1, at which weights are given.
        mix: (knots, targets) weights there. They are 0 at rest and straight in between; see `weights_of`.
        lows: (targets,) the size of the most negative weights; if any is above 0, further targets stand for these, so
            that no weight is below 0.
    """

    rest_length: float
    tendons: float
    knots: Floats
    mix: Floats
    lows: Floats | None = None

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
        return self.split(weights_of(self.thicknesses(distances), self.knots, self.mix))

    def split(self, weights: Floats) -> Floats:
        """(frames, targets) weights with those below 0 on targets of their own, if there are such targets."""
        if self.lows is None:
            return weights
        negative = np.flatnonzero(self.lows)
        below = np.maximum(-weights[:, negative], 0.0) / self.lows[negative]
        return np.concatenate([np.where(self.lows > 0, np.maximum(weights, 0.0), weights), below], axis=1)

    def to_json(self) -> Json:
        """A table of weights by shortenings, as extras store it."""
        lengths = np.linspace(LONGEST, SHORTEST, _ROWS)
        distances = self.tendons + lengths * self.belly
        table = self.split(weights_of(lengths**-0.5, self.knots, self.mix))
        return {"shortenings": stored(1.0 - distances / self.rest_length), "weights": stored(table, 6)}


def weights_of(thicknesses: Floats, knots: Floats, mix: Floats) -> Floats:
    """(frames, targets) weights for (frames,) thicknesses over rest, from (knots, targets) weights at (knots,) ones.

    They are straight between the knots and rest. Without a knot below 1, those of the first go on straight there.
    """
    places, columns = np.append(knots, 1.0), np.vstack([mix, np.zeros((1, mix.shape[1]))])
    order = np.argsort(places)
    weights = np.stack([np.interp(thicknesses, places[order], column[order]) for column in columns.T], axis=1)
    if knots[0] > 1.0:
        thin = thicknesses < 1.0
        weights[thin] = np.multiply.outer((thicknesses[thin] - 1.0) / (knots[0] - 1.0), mix[0])
    return weights


FULLEST, THINNEST = SHORTEST**-0.5, LONGEST**-0.5
"""The greatest and the least thickness over that at rest."""
