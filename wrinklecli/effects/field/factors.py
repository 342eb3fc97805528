"""Few shapes for the heights of many poses: heights ≈ weights of each turn's angle × shapes, none of them negative.

Each turn gets its own shapes, from its own sweep, with weights that are tables of its angle: other shapes one way than
the other, as what is compressed one way is stretched the other, and others in the far half of a bend than in the near
half, as a deep bend has no room for some. Heights of several turns do not add up, since they go with the root of the
compression: so the shapes are fitted again to mixtures of turns.

Source: D. D. Lee, H. S. Seung, *Algorithms for Non-negative Matrix Factorization*, NIPS 2000: multiplicative updates.
Differs: weights stay as they are.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.effects.field.turns import Sweeps
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints

# Rounds of updates of all shapes: further ones change no digit seen.
_ROUNDS = 80
# Error of one shape, root mean square over the heights, from which on a side gets one for each half of its bend: a
# deep bend folds other places, and hides some. Three would halve that error, at half as many targets again.
_ROUGH = 0.1
# Part of the greatest height of all below which a turn folds nothing.
_LEAST = 0.05
# Stands for 0 where numbers divide and grow by factors.
_TINY = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """Shapes of turns, and their weights.

    Attributes:
        turns: (shapes,) the number of the turn that drives each.
        shapes: (shapes, vertices) heights at weight 1, scene units, not negative.
        tables: For each shape (angles of its turn,) weights from 0 to 1.
        error: Root mean square of what the shapes miss in all poses, over that of the heights,
        best: and of what they would miss with the best weights.
        products: (shapes, shapes) integrals of their products over the surface.
        left_out: Numbers of turns that fold the surface, but for which there are too many.
    """

    turns: Ints
    shapes: Floats
    tables: tuple[Floats, ...]
    error: float
    best: float
    products: Floats
    left_out: tuple[int, ...] = ()

    def fewer(self, sweeps: Sweeps, most: int) -> "tuple[Factors, Floats]":
        """At most so many shapes, for the turns that fold most, and (shapes, old shapes) factors that make them.

        Two shapes of a turn to one side become the one that is nearest to both.
        """
        sides, columns = [], {}
        for turn in np.unique(self.turns).tolist():
            angles = sweeps.turns[turn].angles
            for sign in (-1.0, 1.0):
                own = [k for k in np.flatnonzero(self.turns == turn) if self.tables[k][sign * angles > 0].any()]
                if own:
                    table = np.stack([self.tables[k] for k in own], axis=1)
                    products = self.products[np.ix_(own, own)]
                    merged = _merged(table, products)
                    volume = float(np.einsum("ak,kl,al->a", table, products, table).max()) ** 0.5
                    error = _size(table - np.outer(*merged), products) / _size(table, products)
                    sides.append(_Side(turn, np.flatnonzero(sign * angles > 0), volume, error))
                    columns[id(sides[-1])] = own, merged
        mixes, turns, tables = [], [], []
        for side, count in _chosen(_ranked(sweeps, sides), most):
            own, (table, shares) = columns[id(side)]
            alone = [(self.tables[k], np.eye(len(self.turns))[k]) for k in own]
            together = [(table, np.bincount(own, shares, len(self.turns)))]
            for made, parts in alone if count >= len(own) else together:
                turns.append(side.turn)
                tables.append(made)
                mixes.append(parts)
        owners = np.array(turns, np.intp)
        mix: Floats = np.array(mixes)
        before, after = (weights_of(sweeps, *each) for each in ((self.turns, self.tables), (owners, tables)))
        lost = _size(before - after @ mix, self.products) / _size(before, self.products)
        gone = dict.fromkeys(turn for turn in self.turns.tolist() if turn not in turns)
        found = Factors(
            turns=owners,
            shapes=mix @ self.shapes,
            tables=tuple(tables),
            error=float(np.hypot(self.error, lost)),
            best=self.best,
            products=mix @ self.products @ mix.T,
            left_out=(*gone, *self.left_out),
        )
        return found, mix


def factors_of(sweeps: Sweeps, heights: Floats, areas: Floats, most: int) -> Factors:
    """Find at most so many shapes for (poses, vertices) heights, with (vertices,) areas by which they count."""
    scale = float(heights.max(initial=0.0))
    sizes = np.sqrt(areas / areas.sum())
    turns, shapes, tables = [], [], []
    sides = _folding(sweeps, heights, sizes, scale)
    for side, count in _chosen(sides, most):
        for poses in _stretches(sweeps, side, count):
            weights, shape = _main_shape(heights[poses] * sizes)
            turns.append(side.turn)
            shapes.append(shape / sizes)
            tables.append(_table(sweeps.turns[side.turn].angles, sweeps.angles[poses, side.turn], weights))
    if not turns:
        return Factors(np.zeros(0, np.intp), np.zeros((0, heights.shape[1])), (), 0.0, 0.0, np.zeros((0, 0)))
    owners = np.array(turns)
    weights = weights_of(sweeps, owners, tables)
    fitted = _refitted(weights, np.stack(shapes) * sizes, heights * sizes) / sizes
    gaps = (heights - weights @ fitted) * sizes
    whole = np.linalg.norm(heights * sizes)
    return Factors(
        turns=owners,
        shapes=fitted,
        tables=tuple(tables),
        error=float(np.linalg.norm(gaps) / whole),
        best=_best(fitted * sizes, heights * sizes),
        products=(fitted * sizes**2) @ fitted.T,
        left_out=tuple(side.turn for side in sides if side.turn not in turns),
    )


def weights_of(sweeps: Sweeps, owners: Ints, tables: Sequence[Floats]) -> Floats:
    """(poses, shapes) weights in all poses of shapes with (shapes,) owners, the numbers of turns, and tables."""
    columns = [
        np.interp(sweeps.angles[:, turn], sweeps.turns[turn].angles, table)
        for turn, table in zip(owners.tolist(), tables, strict=True)
    ]
    return np.stack(columns, axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """A turn one way or the other.

    Attributes:
        turn: Its number.
        poses: (poses,) those of its sweep to that side.
        volume: The greatest heights there, root mean square,
        error: and what one shape misses of them all, relative.
    """

    turn: int
    poses: Ints
    volume: float
    error: float


def _folding(sweeps: Sweeps, heights: Floats, sizes: Floats, scale: float) -> list[_Side]:
    """The turns' sides that fold the surface, ranked."""
    sides = []
    for turn in range(len(sweeps.turns)):
        for sign in (-1.0, 1.0):
            poses = np.flatnonzero((sweeps.owners == turn) & (sign * sweeps.angles[:, turn] > 0))
            own = heights[poses] * sizes
            if heights[poses].max(initial=0.0) > _LEAST * scale:
                gap = np.linalg.norm(own - np.outer(*_main_shape(own))) / np.linalg.norm(own)
                sides.append(_Side(turn, poses, float(np.linalg.norm(own, axis=1).max()), float(gap)))
    return _ranked(sweeps, sides)


def _ranked(sweeps: Sweeps, sides: Sequence[_Side]) -> list[_Side]:
    """Of each joint the side that folds the surface most first, then the second of each.

    A trunk folds more cloth than an elbow does, but one looks at both.
    """
    ranks: dict[int, int] = {}
    ranked = []
    for side in sorted(sides, key=lambda side: -side.volume):
        node = sweeps.turns[side.turn].signal.node
        ranks[node] = ranks.get(node, -1) + 1
        ranked.append((ranks[node], side))
    return [side for _, side in sorted(ranked, key=lambda pair: pair[0])]


def _chosen(sides: Sequence[_Side], most: int) -> list[tuple[_Side, int]]:
    """The sides that get shapes, turn by turn, with the number of these: one each, and a second for the roughest."""
    kept = sides[:most]
    rough = sorted((side for side in kept if side.error > _ROUGH), key=lambda side: -side.volume * side.error)
    twice = rough[: most - len(kept)]
    return [(side, 2 if side in twice else 1) for side in sorted(kept, key=lambda side: side.turn)]


def _stretches(sweeps: Sweeps, side: "_Side", count: int) -> list[Ints]:
    """The poses of a side, all together or those of its near half and of its far half."""
    if count == 1:
        return [side.poses]
    bends = np.abs(sweeps.angles[side.poses, side.turn])
    near = bends <= bends.max() / 2.0
    return [side.poses[near], side.poses[~near]]


def _main_shape(heights: Floats) -> tuple[Floats, Floats]:
    """(poses,) weights, 1 at most, and a (vertices,) shape whose products are nearest to (poses, vertices) heights.

    They are the first singular vectors, which have no negative numbers where nothing else has.
    """
    poses, sizes, shapes = np.linalg.svd(heights, full_matrices=False)
    weights = np.abs(poses[:, 0])
    return weights / weights.max(), np.abs(shapes[0]) * sizes[0] * weights.max()


def _merged(table: Floats, products: Floats) -> tuple[Floats, Floats]:
    """(rows,) weights of one shape, 1 at most, and (shapes,) the parts of it, nearest to (rows, shapes) of them."""
    values, vectors = np.linalg.eigh(products)
    weights, _ = _main_shape(table @ (vectors * np.sqrt(np.maximum(values, 0.0))))
    weights = np.where(table.any(axis=1), weights, 0.0)  # exactly, so that the shape is of their side alone
    return weights, weights @ table / (weights @ weights)


def _size(rows: Floats, products: Floats) -> float:
    """The root of the integrals of the squares of (rows, shapes) sums of shapes."""
    return float(np.sqrt(max(np.einsum("rk,kl,rl->", rows, products, rows), 0.0)))


def _table(angles: Floats, at: Floats, weights: Floats) -> Floats:
    """(angles,) weights at all angles of a turn, 0 at rest."""
    table = np.zeros(len(angles))
    table[np.searchsorted(angles, at)] = weights
    return table


def _refitted(weights: Floats, shapes: Floats, heights: Floats) -> Floats:
    """(shapes, vertices) shapes that fit (poses, vertices) heights with (poses, shapes) weights as they are."""
    shapes = np.maximum(shapes, _TINY * heights.max())
    wanted, square = weights.T @ heights, weights.T @ weights
    for _ in range(_ROUNDS):
        shapes = shapes * wanted / np.maximum(square @ shapes, _TINY * heights.max())
    return shapes


def _best(shapes: Floats, heights: Floats) -> float:
    """What shapes miss of heights with the best weights, each pose by itself."""
    from scipy.optimize import nnls

    # In the span of the shapes, which is small, least squares are the same.
    basis, triangle = np.linalg.qr(shapes.T)
    inside = heights @ basis
    beyond = np.sum(heights**2, axis=1) - np.sum(inside**2, axis=1)
    gaps = np.array([nnls(triangle, row)[1] ** 2 for row in inside]) + np.maximum(beyond, 0.0)
    return float(np.sqrt(gaps.sum()) / np.linalg.norm(heights))
