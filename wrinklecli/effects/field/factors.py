"""Few shapes for the heights of many poses: heights ≈ weights of each turn's angle × shapes, none of them negative.

Each turn gets one shape each way, with weights that are a table of its angle: another one the other way, as what is
compressed one way is stretched the other. A second shape one way would show better what folds in a slight bend alone,
but would move all places that fold in both again, which is half of a file. So the second one is a crease: it takes
back what has no room beyond half of the bend, which is little, and folds stand there until the joint closes. Heights of
several turns do not add up, since they go with the root of the compression: so shapes and tables are fitted to mixtures
of turns, too. Two joints have a shape between them, for what one of them folds higher alone than both together.

Source: A. Cichocki, R. Zdunek, S. Amari, *Hierarchical ALS Algorithms for Nonnegative Matrix and 3D Tensor
Factorization*, ICA 2007: one row after the other takes its best values beside all others. Differs: the weights in poses
are looked up in tables, and these are what is fitted; a shape is only where its turn alone folds the surface, so each
stays near its joint; and what is too low to be seen is cut off in each round, so that the others make up for it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.effects.field.turns import Sweeps
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, Ints

# Rounds in which all shapes and tables are fitted: twice as many change the error by a five-hundredth of it.
_ROUNDS = 20
# Part of the greatest height below which nothing is seen: there shapes end, without a step. As they are not negative,
# they fade slowly, and would else be all over a garment: a third of what they move lies below.
UNSEEN = 0.05
# Part of the greatest height of all below which a turn folds nothing.
_LEAST = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """Shapes of turns, and their weights.

    Attributes:
        turns: (shapes,) the number of the turn that drives each.
        shapes: (shapes, vertices) heights at weight 1, scene units, not negative.
        tables: For each shape (angles of its turn,) weights from 0 to 1.
        error: Root mean square of what is seen of the shapes misses in all poses, over that of the heights,
        best: and of what that would miss with the best weights.
        products: (shapes, shapes) integrals of their products over the surface.
        creases: (shapes,) whether each, in place of folding the surface, takes back what the one before it, of the same
            turn, raises where a deep bend has no room; level until that is known.
        left_out: Numbers of turns that fold the surface, but for which there are too many.
    """

    turns: Ints
    shapes: Floats
    tables: tuple[Floats, ...]
    error: float
    best: float
    products: Floats
    creases: Bools
    left_out: tuple[int, ...] = ()

    def some(self, kept: Ints) -> "Factors":
        """The factors with the shapes of sorted numbers alone; the error stays that of all."""
        return replace(
            self,
            turns=self.turns[kept],
            shapes=self.shapes[kept],
            tables=tuple(self.tables[k] for k in kept),
            products=self.products[np.ix_(kept, kept)],
            creases=self.creases[kept],
        )

    def fewer(self, sweeps: Sweeps, most: int) -> "tuple[Factors, Ints]":
        """The shapes of turns that fold most, then their creases, at most so many, and (shapes,) their old numbers."""
        every, volumes = np.arange(len(self.turns)), np.sqrt(np.diag(self.products))
        ranks = np.argsort(_ranked(sweeps, self.turns[~self.creases].tolist(), volumes[~self.creases]))
        own = ranks[np.cumsum(~self.creases) - 1]
        kept = np.sort(np.lexsort((own, self.creases))[:most])
        gone, weights = np.setdiff1d(every, kept), weights_of(sweeps, self.turns, self.tables)
        lost = _size(weights[:, gone], self.products[np.ix_(gone, gone)]) / _size(weights, self.products)
        absent = np.setdiff1d(self.turns, self.turns[kept]).tolist()
        found = replace(self.some(kept), error=float(np.hypot(self.error, lost)), left_out=(*absent, *self.left_out))
        return found, kept

    def creased(self, sweeps: Sweeps, most: int) -> "Factors":
        """Add creases to the shapes, of which there are then at most so many: the turns that fold most get one.

        What is between two joints has no bend of its own, at whose end there is no room.
        """
        own = [len(sweeps.turns[turn].joints) > 0 for turn in self.turns]
        order = np.repeat(np.arange(len(self.turns)), 1 + np.array(own, np.intp))
        creases = np.append(False, order[1:] == order[:-1])
        tables = [
            self.tables[k] * (_late(sweeps.turns[self.turns[k]].angles) if crease else 1.0)
            for k, crease in zip(order.tolist(), creases, strict=True)
        ]
        found = replace(
            self,
            turns=self.turns[order],
            shapes=np.where(creases[:, None], 0.0, self.shapes[order]),
            tables=tuple(tables),
            products=np.where(np.logical_or.outer(creases, creases), 0.0, self.products[np.ix_(order, order)]),
            creases=creases,
        )
        return found.fewer(sweeps, most)[0]


def factors_of(sweeps: Sweeps, heights: Floats, areas: Floats, most: int) -> Factors:
    """Find at most so many shapes for (poses, vertices) heights, with (vertices,) areas by which they count."""
    scale = float(heights.max(initial=0.0))
    parts = areas / areas.sum()
    sides = [side for side in _sides(sweeps, heights) if side.tops.max() > _LEAST * scale]
    volumes = [float(np.sqrt(side.tops**2 @ parts)) for side in sides]
    ranked = _ranked(sweeps, [side.turn for side in sides], volumes)
    chosen = [sides[k] for k in sorted(ranked[:most])]
    if not chosen:
        none = np.zeros(0, np.intp)
        return Factors(none, np.zeros((0, heights.shape[1])), (), 0.0, 0.0, np.zeros((0, 0)), none > 0)
    owners = np.array([side.turn for side in chosen])
    # A shape may be higher than these where its turn alone folds what is seen.
    limits = [side.tops / np.maximum(1.0 - side.tops / (UNSEEN * scale), TINY) for side in chosen]
    drafts, tables = np.stack([side.draft for side in chosen]), [side.table for side in chosen]
    whole, tables = _fitted(sweeps, owners, tables, drafts, np.stack(limits), heights, parts)
    seen, size = seen_of(whole), np.linalg.norm(heights * np.sqrt(parts))
    gaps = heights - weights_of(sweeps, owners, tables) @ seen
    factors = Factors(
        turns=owners,
        shapes=whole,
        tables=tuple(tables),
        error=float(np.linalg.norm(gaps * np.sqrt(parts)) / size),
        best=_best(seen * np.sqrt(parts), heights * np.sqrt(parts)),
        products=(whole * parts) @ whole.T,
        creases=np.zeros(len(owners), np.bool_),
        left_out=tuple(sides[k].turn for k in ranked if sides[k].turn not in owners),
    )
    return factors.some(np.flatnonzero(seen.any(axis=1)))


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """The folds of a turn one way, or those between two joints.

    Attributes:
        turn: The number of the turn.
        tops: (vertices,) the greatest heights that it makes alone.
        draft: (vertices,) a first shape.
        table: (angles,) its first weights.
    """

    turn: int
    tops: Floats
    draft: Floats
    table: Floats


def _sides(sweeps: Sweeps, heights: Floats) -> Iterator[_Side]:
    """The sides of all turns that (poses, vertices) heights show."""
    nodes = np.array([turn.signal.node for turn in sweeps.turns])
    for number, turn in enumerate(sweeps.turns):
        if not turn.joints:
            # Between two joints is what both fold.
            pair = turn.signal.node, turn.signal.parent
            alone = [heights[(sweeps.owners >= 0) & (nodes[sweeps.owners] == node)].max(axis=0) for node in pair]
            sizes = np.abs(turn.angles)
            yield _Side(number, np.minimum(*alone), np.zeros(heights.shape[1]), sizes / sizes.max())
            continue
        for sign in (-1.0, 1.0):
            poses = np.flatnonzero((sweeps.owners == number) & (sign * sweeps.angles[:, number] > 0))
            if len(poses):
                own = np.abs(sweeps.angles[poses, number])
                draft = own @ heights[poses] / own.sum()
                yield _Side(number, heights[poses].max(axis=0), draft, np.maximum(sign * turn.angles / own.max(), 0.0))


def seen_of(heights: Floats, greatest: float | None = None) -> Floats:
    """(…,) heights of which nothing is left where they are below `UNSEEN`, and where they are tall hardly less.

    They are compared with the greatest of all shapes, which is among them if it is not given. To take as much from all
    of them as from the lowest would lower a garment's folds by a fifth.

    Source: L. Breiman, *Better Subset Regression Using the Nonnegative Garrote*, Technometrics 37, 1995.
    """
    least = UNSEEN * (heights.max(initial=0.0) if greatest is None else greatest)
    return np.asarray(np.maximum(heights - least * (least / np.maximum(heights, max(least, TINY))), 0.0))


def weights_of(sweeps: Sweeps, owners: Ints, tables: Sequence[Floats]) -> Floats:
    """(poses, shapes) weights in all poses of shapes with (shapes,) owners, the numbers of turns, and tables."""
    columns = [
        np.interp(sweeps.angles[:, turn], sweeps.turns[turn].angles, table)
        for turn, table in zip(owners.tolist(), tables, strict=True)
    ]
    return np.stack(columns, axis=1)


def _late(angles: Floats) -> Floats:
    """(angles,) from 0, up to half of the way to either end, to 1, from three quarters on."""
    ends = np.where(angles < 0, angles.min(), angles.max())
    return np.clip(4.0 * angles / np.where(ends != 0, ends, 1.0) - 2.0, 0.0, 1.0)


def _ranked(sweeps: Sweeps, turns: Sequence[int], volumes: Sequence[float] | Floats) -> list[int]:
    """The numbers of sides, by their turns and volumes: of each joint that which folds most, then the second of each.

    A trunk folds more cloth than an elbow does, but one looks at both.
    """
    ranks: dict[int, int] = {}
    ranked = []
    for side in sorted(range(len(turns)), key=lambda side: -volumes[side]):
        node = sweeps.turns[turns[side]].signal.node
        ranks[node] = ranks.get(node, -1) + 1
        ranked.append((ranks[node], side))
    return [side for _, side in sorted(ranked, key=lambda pair: pair[0])]


def _size(rows: Floats, products: Floats) -> float:
    """The root of the integrals of the squares of (rows, shapes) sums of shapes."""
    return float(np.sqrt(max(np.einsum("rk,kl,rl->", rows, products, rows), 0.0)))


def _fitted(
    sweeps: Sweeps,
    owners: Ints,
    tables: Sequence[Floats],
    shapes: Floats,
    limits: Floats,
    heights: Floats,
    parts: Floats,
) -> tuple[Floats, list[Floats]]:
    """(shapes, vertices) shapes and their tables, of which the greatest weight is 1.

    What is seen of the shapes fits (poses, vertices) heights, which count by (vertices,) parts of the area: other
    shapes make up for what is cut off one. None is above its (shapes, vertices) limits.
    """
    shares = [
        weights_of(sweeps, np.full(len(table), owner), list(np.eye(len(table))))
        for owner, table in zip(owners, tables, strict=True)
    ]
    found, whole = [table.copy() for table in tables], shapes.copy()
    seen = seen_of(whole)
    for _ in range(_ROUNDS):
        weights, products = (
            np.stack([share @ table for share, table in zip(shares, found, strict=True)], axis=1),
            (seen * parts) @ seen.T,
        )
        gaps = (heights * parts) @ seen.T - weights @ products
        for k, (share, table) in enumerate(zip(shares, found, strict=True)):
            for angle in np.flatnonzero(table).tolist():
                own = share[:, angle]
                step = own @ gaps[:, k] / max(own @ own * products[k, k], TINY)
                # No weight loses more than half at once, so none becomes 0.
                step = max(step, -table[angle] / 2.0)
                table[angle] += step
                gaps -= step * np.outer(own, products[k])
        tops = np.array([table.max() for table in found])
        found, seen = [table / top for table, top in zip(found, tops, strict=True)], tops[:, None] * seen
        weights = np.stack([share @ table for share, table in zip(shares, found, strict=True)], axis=1)
        wanted, products = weights.T @ heights, weights.T @ weights
        for k, row in enumerate(products):
            nearest = seen[k] + (wanted[k] - row @ seen) / max(row[k], TINY)
            whole[k] = np.clip(nearest, 0.0, limits[k])
            seen[k] = seen_of(whole[k], float(whole.max()))
    return whole, found


def _nearer(values: Floats, wanted: Floats, products: Floats) -> Floats:
    """(rows, n) values, not negative, each row the best beside the others: products · values ≈ (rows, n) wanted."""
    found = values.copy()
    for k, row in enumerate(products):
        found[k] = np.maximum(found[k] + (wanted[k] - row @ found) / max(row[k], TINY), 0.0)
    return found


def _best(shapes: Floats, heights: Floats) -> float:
    """The part of the heights that shapes miss with the best weights, each pose by itself."""
    weights, wanted, products = np.zeros((len(shapes), len(heights))), shapes @ heights.T, shapes @ shapes.T
    # These rounds cost little.
    for _ in range(_ROUNDS**2):
        weights = _nearer(weights, wanted, products)
    return float(np.linalg.norm(heights - weights.T @ shapes) / np.linalg.norm(heights))
