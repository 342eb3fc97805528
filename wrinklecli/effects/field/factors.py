"""Few shapes for the heights of many poses: heights ≈ weights of each turn's angle × shapes, none of them negative.

Each turn gets its own shapes, with weights that are tables of its angle: other shapes one way than the other, as what
is compressed one way is stretched the other. Those of one side take turns as it bends: each begins where the one before
it ends, so that what has no room in a deep bend is lowered there alone. Heights of several turns do not add up, since
they go with the root of the compression: so shapes and tables are fitted to mixtures of turns, too.

Source: A. Cichocki, R. Zdunek, S. Amari, *Hierarchical ALS Algorithms for Nonnegative Matrix and 3D Tensor
Factorization*, ICA 2007: one row after the other takes its best values beside all others. Differs: the weights in poses
are looked up in tables, and these are what is fitted; shapes are limited by what their turn alone folds, so each stays
near its joint.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from wrinklecli.effects.field.turns import Sweeps
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints

# Rounds in which all shapes and tables are fitted: twice as many change the error by a five-hundredth of it.
_ROUNDS = 20
# Most shapes of a side: a deep bend folds other places than a slight one, and hides some.
_MOST_OF_SIDE = 2
# Part of the greatest height of all below which a turn folds nothing, and part of a side's heights, root mean square,
# that its shapes may miss.
_LEAST = 0.05
# Replaces a divisor of 0.
_TINY = 1e-300


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

        Neighbouring shapes of a turn to one side become the one that is nearest to them.
        """
        sides = []
        for turn in np.unique(self.turns).tolist():
            angles = sweeps.turns[turn].angles
            for sign in (-1.0, 1.0):
                own = [k for k in np.flatnonzero(self.turns == turn) if self.tables[k][sign * angles > 0].any()]
                if own:
                    rows = np.stack([self.tables[k] for k in own], axis=1) @ _root(self.products[np.ix_(own, own)])
                    sides.append(_Side.of(turn, np.array(own), rows))
        mixes, turns, tables = [], [], []
        for side, count in _chosen(_ranked(sweeps, sides), most):
            for group in np.array_split(side.numbers, min(count, len(side.numbers))):
                made, shares = _merged([self.tables[k] for k in group], self.products[np.ix_(group, group)])
                turns.append(side.turn)
                tables.append(made)
                mixes.append(np.bincount(group, shares, len(self.turns)))
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
    turns, shapes, limits, tables = [], [], [], []
    sides = _folding(sweeps, heights, sizes, scale)
    for side, count in _chosen(sides, most):
        for table in _tables(sweeps, side, count):
            weights = np.interp(sweeps.angles[side.numbers, side.turn], sweeps.turns[side.turn].angles, table)
            turns.append(side.turn)
            tables.append(table)
            shapes.append(weights @ heights[side.numbers] / weights.sum())
            limits.append(heights[side.numbers[weights > 0]].max(axis=0))
    if not turns:
        return Factors(np.zeros(0, np.intp), np.zeros((0, heights.shape[1])), (), 0.0, 0.0, np.zeros((0, 0)))
    owners = np.array(turns)
    draft, limit = np.stack([shapes, limits]) * sizes
    fitted, tables = _fitted(sweeps, owners, tables, draft, limit, heights * sizes)
    fitted = fitted / sizes
    weights = weights_of(sweeps, owners, tables)
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
        numbers: Those of the poses of its sweep to that side, or of its shapes.
        volume: The greatest heights there, root mean square,
        misses: and what one shape, two and so on miss of them all with the best weights, relative.
    """

    turn: int
    numbers: Ints
    volume: float
    misses: tuple[float, ...]

    @classmethod
    def of(cls, turn: int, numbers: Ints, rows: Floats) -> "_Side":
        """Look at (poses, n) heights whose products are those of the surface."""
        squares = np.linalg.svd(rows, compute_uv=False) ** 2
        beyond = np.sqrt(np.cumsum(squares[::-1])[::-1] / squares.sum())
        return cls(turn, numbers, float(np.linalg.norm(rows, axis=1).max()), tuple(beyond[1:_MOST_OF_SIDE].tolist()))


def _folding(sweeps: Sweeps, heights: Floats, sizes: Floats, scale: float) -> list[_Side]:
    """The turns' sides that fold the surface, ranked."""
    sides = []
    for turn in range(len(sweeps.turns)):
        for sign in (-1.0, 1.0):
            poses = np.flatnonzero((sweeps.owners == turn) & (sign * sweeps.angles[:, turn] > 0))
            if heights[poses].max(initial=0.0) > _LEAST * scale:
                sides.append(_Side.of(turn, poses, heights[poses] * sizes))
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
    """The sides that get shapes, turn by turn, with the number of these: one each, and more for the roughest."""
    kept = sides[:most]
    rough = [(-side.volume * miss, k) for k, side in enumerate(kept) for miss in side.misses if miss > _LEAST]
    more = [k for _, k in sorted(rough)[: most - len(kept)]]
    found = [(side, 1 + more.count(k)) for k, side in enumerate(kept)]
    return sorted(found, key=lambda pair: pair[0].turn)


def _tables(sweeps: Sweeps, side: _Side, count: int) -> Floats:
    """(shapes, angles) tables of a side, each rising from where the one before it ends, and 0 from its own end on."""
    angles, own = sweeps.turns[side.turn].angles, sweeps.angles[side.numbers, side.turn]
    steps = np.where(angles * own[0] > 0, np.abs(np.arange(len(angles)) - np.searchsorted(angles, 0.0)), 0)
    ends = np.ceil(np.linspace(0, len(own), count + 1))
    acting = [(steps > 0) & (steps >= start) & (steps <= end) for start, end in pairwise(ends)]
    return np.stack([np.where(each, steps - start + 0.5, 0.0) for each, start in zip(acting, ends[:-1], strict=True)])


def _merged(tables: Sequence[Floats], products: Floats) -> tuple[Floats, Floats]:
    """The table of one shape, 1 at most, and (shapes,) the parts of it, nearest to several of them.

    Its weights are the first singular vector, which has no negative numbers where nothing else has.
    """
    table = np.stack(tables, axis=1)
    weights = np.abs(np.linalg.svd(table @ _root(products), full_matrices=False)[0][:, 0])
    weights = np.where(table.any(axis=1), weights / weights.max(), 0.0)  # exactly, so that it is of their side alone
    return weights, weights @ table / (weights @ weights)


def _root(products: Floats) -> Floats:
    """(shapes, shapes) rows with (shapes, shapes) products."""
    values, vectors = np.linalg.eigh(products)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _size(rows: Floats, products: Floats) -> float:
    """The root of the integrals of the squares of (rows, shapes) sums of shapes."""
    return float(np.sqrt(max(np.einsum("rk,kl,rl->", rows, products, rows), 0.0)))


def _fitted(
    sweeps: Sweeps, owners: Ints, tables: Sequence[Floats], shapes: Floats, limits: Floats, heights: Floats
) -> tuple[Floats, list[Floats]]:
    """(shapes, vertices) shapes within limits and their tables, 1 at most, that fit (poses, vertices) heights."""
    shares = [
        weights_of(sweeps, np.full(len(table), owner), list(np.eye(len(table))))
        for owner, table in zip(owners, tables, strict=True)
    ]
    found = [table.copy() for table in tables]
    for _ in range(_ROUNDS):
        weights = np.stack([share @ table for share, table in zip(shares, found, strict=True)], axis=1)
        shapes = np.minimum(_nearer(shapes, weights.T @ heights, weights.T @ weights), limits)
        products = shapes @ shapes.T
        gaps = heights @ shapes.T - weights @ products
        for k, (share, table) in enumerate(zip(shares, found, strict=True)):
            for angle in np.flatnonzero(table).tolist():
                own = share[:, angle]
                step = own @ gaps[:, k] / max(own @ own * products[k, k], _TINY)
                # No weight loses more than half at once, so none becomes 0.
                step = max(step, -table[angle] / 2.0)
                table[angle] += step
                gaps -= step * np.outer(own, products[k])
    tops = np.array([table.max() for table in found])
    return shapes * tops[:, None], [table / top for table, top in zip(found, tops, strict=True)]


def _nearer(values: Floats, wanted: Floats, products: Floats) -> Floats:
    """(rows, n) values, not negative, each row the best beside the others: products · values ≈ (rows, n) wanted."""
    found = values.copy()
    for k, row in enumerate(products):
        found[k] = np.maximum(found[k] + (wanted[k] - row @ found) / max(row[k], _TINY), 0.0)
    return found


def _best(shapes: Floats, heights: Floats) -> float:
    """The part of the heights that shapes miss with the best weights, each pose by itself."""
    weights, wanted, products = np.zeros((len(shapes), len(heights))), shapes @ heights.T, shapes @ shapes.T
    # These rounds cost little.
    for _ in range(_ROUNDS**2):
        weights = _nearer(weights, wanted, products)
    return float(np.linalg.norm(heights - weights.T @ shapes) / np.linalg.norm(heights))
