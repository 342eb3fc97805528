"""What is measured of folds, alike of simulated cloth and of baked wrinkles: lines across them, in one frame."""

from dataclasses import dataclass

import numpy as np
from scenes import Array
from scipy.signal import find_peaks

# Share of a line's whole height by which a crest stands above what is beside it.
_PROMINENCE = 0.25
# Degree of the polynomial that is taken off a line: how the whole cloth hangs is no fold.
_HANG = 2


@dataclass(frozen=True)
class Folds:
    """What lines across folds look like in one frame.

    Attributes:
        arc: Their length over that at rest, the mean.
        wavelength: Distance of neighbouring crests, metres along the cloth at rest, the median.
        rms: Root mean square of the height, metres, what hangs taken off.
        spacing_spread: Standard deviation of the distances of crests, over their mean.
        height_spread: The same of the crests' heights above what is beside them.
        crests: How many crests a line has, the mean.
    """

    arc: float
    wavelength: float
    rms: float
    spacing_spread: float
    height_spread: float
    crests: float


def measure(posed: Array, smooth: Array, normals: Array, rest: Array) -> Folds:
    """Measure lines, each (lines, points, 3).

    Args:
        posed: In the frame.
        smooth: Of the moving mesh without any fold, in the frame.
        normals: Of that mesh there.
        rest: At rest.
    """
    along = np.concatenate(
        [np.zeros((len(rest), 1)), np.cumsum(np.linalg.norm(np.diff(rest, axis=1), axis=2), axis=1)], axis=1
    )
    heights = np.einsum("lpa,lpa->lp", posed - smooth, normals)
    spacings, tall, counts, squares = [], [], [], []
    for u, h in zip(along, heights, strict=True):
        level = h - np.polynomial.Polynomial.fit(u, h, _HANG)(u)
        squares.append(np.mean(level**2))
        # Bumps at the line's ends have their feet outside it.
        padded = np.concatenate([[level.min()], level, [level.min()]])
        peaks, found = find_peaks(padded, prominence=_PROMINENCE * np.ptp(level))
        counts.append(len(peaks))
        spacings += np.diff(u[peaks - 1]).tolist()
        tall += found["prominences"].tolist()
    arcs = [np.linalg.norm(np.diff(each, axis=1), axis=2).sum(axis=1) for each in (posed, rest)]
    return Folds(
        arc=float(np.mean(arcs[0] / arcs[1])),
        wavelength=float(np.median(spacings)) if spacings else float("nan"),
        rms=float(np.sqrt(np.mean(squares))),
        spacing_spread=_spread(spacings),
        height_spread=_spread(tall),
        crests=float(np.mean(counts)),
    )


def _spread(values: list[float]) -> float:
    return float(np.std(values) / np.mean(values)) if len(values) > 1 else float("nan")


def arc_lengths(posed: Array, rest: Array, lines: Array) -> tuple[float, ...]:
    """Of a refined mesh, how long each line is over what it was at rest, new vertices on it counted too.

    Args:
        posed: (vertices, 3).
        rest: (vertices, 3); new vertices lie on the middles of old edges.
        lines: (lines, points) old vertices.
    """
    shares = []
    for line in lines:
        starts, steps = rest[line[:-1]], np.diff(rest[line], axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        apart = rest[:, None] - starts
        t = np.clip(np.einsum("vsa,sa->vs", apart, steps) / lengths**2, 0.0, 1.0)
        off = np.linalg.norm(apart - t[..., None] * steps, axis=2)
        nearest = off.argmin(axis=1)
        rows = np.arange(len(rest))
        on = np.flatnonzero(off[rows, nearest] < 1e-6)
        along = (np.concatenate([[0.0], np.cumsum(lengths)])[nearest] + (t * lengths)[rows, nearest])[on]
        points = on[np.argsort(along, kind="stable")]
        shares.append(float(np.linalg.norm(np.diff(posed[points], axis=0), axis=1).sum() / lengths.sum()))
    return tuple(shares)


def line_normals(positions: Array, quads: Array, lines: Array) -> Array:
    """(lines, points, 3) unit vertex normals of a mesh along some lines."""
    corners = positions[quads]
    faces = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normals = np.zeros(positions.shape)
    for corner in quads.T:
        np.add.at(normals, corner, faces)
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True))[lines]
