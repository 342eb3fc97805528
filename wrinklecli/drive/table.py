"""The response of a drive: weights are looked up in tables of numbers, so that players need not run the method.

Module `effects.wrinkle.lookup` makes those of a control curve.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal, Protocol, Self

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.angle import Angles
from wrinklecli.drive.segment import Lengths
from wrinklecli.drive.stored import Json, read_numbers, stored
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, interpolated
from wrinklecli.numeric.piecewise import Signal

TABLE_ERROR = 1 / 2048
"""Greatest error of a weight that is looked up, as a ratio of the greatest weight: a twentieth of the default
`--max-error`, at 1 to 12 kB a file."""

ROWS = 65
"""Rows of a table before others are added where it needs them: straight lines between them are right to 1/3000 of the
greatest weight of a muscle, and to 1/256 where heights start like a square root."""

# Significant digits of tabulated weights, of which about four are right.
_TABLE_DIGITS = 5
# Significant digits of a muscle's table: two factors make a weight.
_BELLY_DIGITS = 6
# Sine of half of 10°: turns that are further than this from those of a clip are not like them.
_NEAR = 0.0872
# Squared distance of turns below which they are the same: rounding of float32 rotations.
_SAME = 1e-10
# The key of rows of clips, by the numbers of a turn: those of one joint, or of two, which players of one must not read.
_PATHS = {3: "paths", 6: "paths_with_other"}


class Reading(Protocol):
    """The measurements of a signal over time."""

    @property
    def rows(self) -> Floats:
        """(frames,) numbers by which a table is looked up."""

    @property
    def active(self) -> Bools:
        """(frames,) False where the weights are 0, whatever the table has."""

    @property
    def factors(self) -> Floats | float:
        """(frames,) factors on what is looked up."""


class Weights(Protocol):
    """A function from the measurements of a signal to the weights of some targets."""

    def weights(self, reading: Any) -> Floats:
        """(frames, targets) weights at the measurements of a signal."""


class BaseDrive(ABC):
    """A drive whose measurements are the weights of its targets, unless it says otherwise."""

    @property
    def own(self) -> tuple[str, ...]:
        """Names of further targets, each of one clip alone, that replace its targets there."""
        return ()

    @property
    def measures(self) -> bool:
        """True if it sets weights in clips of other files, too."""
        return True

    @abstractmethod
    def of_targets(self, kept: Bools) -> Self:
        """The drive without those of its (targets,) that move nothing, which go with their weights."""

    @abstractmethod
    def reader(self, rig: Rig, clip: Clip | None) -> Callable[[Floats, dict[int, Floats]], Any]:
        """A function from (frames,) seconds of a clip, and rows known there as in `node_rows`, to measurements."""

    def weights(self, _clip: Clip | None, reading: Any, _response: Weights | None = None) -> Floats:
        """(frames, targets) weights at measurements in a clip, by another response than its own if there is one."""
        return np.asarray(reading)

    def weights_in(self, rig: Rig, clip: Clip | None) -> Signal:
        """A function from (frames,) seconds of a clip to (frames, targets) weights; None is the stored pose."""
        read = self.reader(rig, clip)
        return lambda times: self.weights(clip, read(times, {}))

    def breaks(self, _clip: Clip) -> Floats:
        """(times,) seconds of a clip at which the weights may have corners, besides the clip's own keys."""
        return np.zeros(0)

    def why_flat(self, _rig: Rig, _clip: Clip, _times: Floats) -> str | None:
        """Why a tool makes no wrinkle at (frames,) seconds of a clip; None for what makes none."""
        return None


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Weights along the turns of a joint in a clip, linear between rows.

    Attributes:
        turns: (rows, 3 or 6) turns as `Angles` has them, at least two.
        weights: (rows, targets).
    """

    turns: Floats
    weights: Floats

    def near(self, turns: Floats) -> tuple[Floats, Floats]:
        """(frames, rows - 1) shares of the straight parts at (frames, …) turns, and (frames, targets) sums by these.

        A share is greatest on the part itself, and 0 where it is 10° away.
        """
        along, squares = self.projected(turns)
        shares = np.maximum(_NEAR**2 / np.maximum(squares, _SAME) - 1.0, 0.0)
        there = (shares * (1.0 - along)) @ self.weights[:-1] + (shares * along) @ self.weights[1:]
        return shares, there

    def projected(self, turns: Floats) -> tuple[Floats, Floats]:
        """(frames, rows - 1) places from 0 to 1 on the straight parts next to (frames, …) turns, and squared distances.

        Distances are sines of half of angles.
        """
        starts, ways = self.turns[:-1], np.diff(self.turns, axis=0)
        squares = np.sum(ways**2, axis=1)
        apart = turns[:, None] - starts
        along = np.clip(np.sum(apart * ways, axis=2) / np.where(squares > 0, squares, 1.0), 0.0, 1.0)
        return along, np.asarray(np.sum((apart - along[:, :, None] * ways) ** 2, axis=2))


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """Weights against one number.

    Attributes:
        by: The kind of number: 1 - distance / rest length, or an angle in radians.
        rows: (rows,) numbers, sorted.
        table: (rows, targets) weights, linear between rows, constant beyond.
        paths: Weights in clips by a joint's whole turn; these count the more, the nearer a turn is to one there.
    """

    by: Literal["shortenings", "angles"]
    rows: Floats
    table: Floats
    paths: tuple[Path, ...] = ()

    def weights(self, reading: Reading) -> Floats:
        """(frames, targets) weights at the measurements of a signal."""
        found: Floats = (interpolated(reading.rows, self.rows, self.table).T * reading.factors).T
        whole = np.ones(len(reading.rows))
        for path in self.paths:
            assert isinstance(reading, Angles)
            shares, there = path.near(reading.turns)
            found, whole = found + there, whole + shares.sum(axis=1)
        return np.where(reading.active[:, None], found / whole[:, None], 0.0)

    def mapped(self, change: Callable[[Floats], Floats]) -> "Table":
        """The table with other weights: `change` maps (rows, …) weights to those of other targets."""
        paths = tuple(replace(each, weights=change(each.weights)) for each in self.paths)
        return replace(self, table=change(self.table), paths=paths)

    def to_json(self) -> Json:
        """The rows as extras store them."""
        paths = [{"turns": stored(p.turns), "weights": stored(p.weights, _TABLE_DIGITS)} for p in self.paths]
        key = _PATHS[max((each.turns.shape[1] for each in self.paths), default=3)]
        return {
            self.by: stored(self.rows),
            "weights": stored(self.table, _TABLE_DIGITS),
            **({key: paths} if paths else {}),
        }


@dataclass(frozen=True, slots=True, eq=False)
class BellyTable:
    """Weights of a muscle whose belly moves as its ends come nearer, and stays where it is as it is activated.

    Attributes:
        rows: (rows,) shortenings, sorted.
        table: (rows, targets) weights for one more thickness, by the shortening without activation.
        gains: (rows,) thicknesses that are gained over that at rest, by the shortening with activation.
    """

    rows: Floats
    table: Floats
    gains: Floats

    def weights(self, reading: Lengths) -> Floats:
        """(frames, targets) weights at the measurements of a muscle."""
        gains = np.where(reading.active, np.interp(reading.rows, self.rows, self.gains), 0.0)
        return np.asarray(gains[:, None] * interpolated(reading.ends.rows, self.rows, self.table))

    def mapped(self, change: Callable[[Floats], Floats]) -> "BellyTable":
        """The table with other weights: `change` maps (rows, …) weights to those of other targets."""
        return replace(self, table=change(self.table))

    def to_json(self) -> Json:
        """The rows as extras store them."""
        table, gains = stored(self.table, _BELLY_DIGITS), stored(self.gains, _BELLY_DIGITS)
        return {"shortenings": stored(self.rows), "weights": table, "gains": gains}


def split(weights: Floats, lows: Floats | None) -> Floats:
    """(frames, targets) weights, with those below 0 on further targets that take their place.

    Args:
        weights: (frames, targets).
        lows: (targets,) the sizes of weights below 0 at which the further targets have weight 1; 0 for targets without
            one. None to let all weights be.
    """
    if lows is None:
        return weights
    negative = np.flatnonzero(lows)
    below = np.maximum(-weights[:, negative], 0.0) / lows[negative]
    return np.concatenate([np.where(lows > 0, np.maximum(weights, 0.0), weights), below], axis=1)


def read_table(data: Json, targets: int) -> Table | BellyTable:
    """Read the table of so many targets in extras.

    Raises:
        KeyError, TypeError, ValueError: The extras are not what `bake` writes.
    """
    by: Literal["shortenings", "angles"] = "angles" if "angles" in data else "shortenings"
    rows = _sorted_rows(data[by])
    if "gains" in data:
        if "joint" in data:
            raise ValueError
        gains = read_numbers(data["gains"], len(rows))
        return BellyTable(rows, _read_weights(data, len(rows), targets), gains)
    numbers = 6 if "other" in data else 3
    paths = tuple(_read_path(each, numbers, targets) for each in data.get(_PATHS[numbers], ()))
    if paths and by != "angles":
        raise ValueError
    return Table(by, rows, _read_weights(data, len(rows), targets), paths)


def _read_path(data: Json, numbers: int, targets: int) -> Path:
    turns = read_numbers(data["turns"], -1, numbers)
    if len(turns) < 2:
        raise ValueError
    return Path(turns, _read_weights(data, len(turns), targets))


def _read_weights(data: Json, rows: int, targets: int) -> Floats:
    """(rows, targets) weights of a table."""
    return read_numbers(data["weights"], rows, targets)


def _sorted_rows(values: object) -> Floats:
    """(rows,) numbers of a table; ValueError if there are none, or if they are not sorted."""
    rows = read_numbers(values, -1)
    if not len(rows) or not (np.diff(rows) > 0).all():
        raise ValueError
    return rows
