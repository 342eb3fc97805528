"""Few shapes for the heights of many poses: heights ≈ weights by the angles of all turns × shapes, not negative.

Lost lengths of several joints add up, with signs: what one compresses, another one stretches. Heights go with the root
of what is lost. So a shape belongs to no turn. It has a table of each turn that reaches it, and its weight is the root
of the sum of their squares, less those of turns that stretch it. Two thighs fold a belly higher than one does, and less
than twice as high; an arm that is raised pulls flat what the chest folds.

A second shape for a deep bend would show better what folds in a slight bend alone, but would move all places that fold
in both again, which is half of a file. So the second one is a crease: it takes back what has no room beyond half of a
bend, which is little, and folds stand there until the joint closes.

Source: A. Cichocki, R. Zdunek, S. Amari, *Hierarchical ALS Algorithms for Nonnegative Matrix and 3D Tensor
Factorization*, ICA 2007: one row after the other takes its best values beside all others. Differs: the weights in poses
are roots of what is looked up in tables, and these are what is fitted, by steps of Gauss and Newton; and what is too
low to be seen is cut off in each round, so that the others make up for it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.drive.turned import squares_of, together
from wrinklecli.effects.field.turns import Sweeps
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Bools, Floats, Ints, interpolated

# Rounds in which all shapes and tables are fitted, and steps of each shape's tables in a round.
_ROUNDS, _STEPS = 20, 2
# Part of the greatest height below which nothing is seen: there shapes end, without a step. As they are not negative,
# they fade slowly, and would else be all over a garment: a third of what they move lies below.
UNSEEN = 0.05
# Part of the greatest height of all below which a turn folds nothing.
_LEAST = 0.05
# Part of a shape, by the squares of its heights, that a turn has to fold, in any way, for a table of its own. With
# tables of all turns, errors are a twentieth lower, and a sixth higher in mixtures of another seed.
_REACHED = 0.1
# What it costs, beside errors of weights, that squares in tables bend at steps: strain goes smoothly with an angle.
# Without, errors are a tenth higher in clips that are left out.
_SMOOTH = 0.3
# Least weight by which roots are divided.
_FAINT = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Factors:
    """Shapes, and their weights by the angles of turns.

    Attributes:
        shapes: (shapes, vertices) heights at weight 1, scene units, not negative.
        tables: For each turn (angles, shapes) parts of the weights, as `together` adds them.
        error: Root mean square of what is seen of the shapes misses in all poses, over that of the heights,
        best: and of what that would miss with the best weights.
        products: (shapes, shapes) integrals of their products over the surface.
        creases: (shapes,) whether each, in place of folding the surface, takes back what the one before it raises where
            a deep bend has no room; level until that is known.
        left_out: Numbers of turns that fold the surface, but raise no shape, as there are too many.
    """

    shapes: Floats
    tables: tuple[Floats, ...]
    error: float
    best: float
    products: Floats
    creases: Bools
    left_out: tuple[int, ...] = ()

    def some(self, kept: Ints) -> "Factors":
        """The factors with the shapes of sorted numbers alone; the error stays that of all."""
        tables = tuple(table[:, kept] for table in self.tables)
        gone = [k for k, table in enumerate(tables) if self.tables[k].any() and not table.any()]
        return replace(
            self,
            shapes=self.shapes[kept],
            tables=tables,
            products=self.products[np.ix_(kept, kept)],
            creases=self.creases[kept],
            left_out=(*gone, *self.left_out),
        )

    def fewer(self, sweeps: Sweeps, most: int) -> "tuple[Factors, Ints]":
        """The shapes that fold most, then their creases, at most so many, and (shapes,) their old numbers."""
        volumes = np.diag(self.products)[~self.creases]
        own = np.argsort(np.argsort(-volumes, kind="stable"))[np.cumsum(~self.creases) - 1]
        order = np.lexsort((own, self.creases))
        kept, gone = np.sort(order[:most]), np.sort(order[most:])
        weights = weights_of(sweeps, self.tables)
        lost = _size(weights[:, gone], self.products[np.ix_(gone, gone)]) / _size(weights, self.products)
        return replace(self.some(kept), error=float(np.hypot(self.error, lost))), kept

    def creased(self, sweeps: Sweeps, most: int) -> "Factors":
        """Add creases to the shapes, of which there are then at most so many: those that fold most get one.

        What is stretched counts in full for a crease, so that none takes back more than is there.
        """
        order = np.repeat(np.arange(len(self.shapes)), 2)
        creases = np.arange(len(order)) % 2 > 0
        tables = [
            table * np.where((table > 0.0) & creases, _late(turn.angles)[:, None], 1.0)
            for turn, table in zip(sweeps.turns, (each[:, order] for each in self.tables), strict=True)
        ]
        found = replace(
            self,
            shapes=np.where(creases[:, None], 0.0, self.shapes[order]),
            tables=tuple(tables),
            products=np.where(np.logical_or.outer(creases, creases), 0.0, self.products[np.ix_(order, order)]),
            creases=creases,
        )
        return found.fewer(sweeps, most)[0]


def factors_of(sweeps: Sweeps, heights: Floats, areas: Floats, most: int) -> Factors:
    """Find at most so many shapes for (poses, vertices) heights, with (vertices,) areas by which they count."""
    parts = areas / areas.sum()
    least = _LEAST * float(heights.max(initial=0.0))
    sides = [side for side in _sides(sweeps, heights) if side.tops.max() > least]
    if not sides:
        none = tuple(np.zeros((len(turn.angles), 0)) for turn in sweeps.turns)
        return Factors(np.zeros((0, heights.shape[1])), none, 0.0, 0.0, np.zeros((0, 0)), np.zeros(0, np.bool_))
    acting = np.zeros((len(sweeps.turns), heights.shape[1]), np.bool_)
    for side in sides:
        acting[side.turn] |= side.tops > least
    chosen = _ranked(sweeps, sorted(sides, key=lambda side: -float(side.tops**2 @ parts)))[:most]
    steps = _Steps.of(sweeps)
    whole, squares = _fitted(steps, chosen, acting, heights, parts)
    tables = steps.tables(squares)
    seen, size = seen_of(whole), np.linalg.norm(heights * np.sqrt(parts))
    gaps = heights - weights_of(sweeps, tables) @ seen
    factors = Factors(
        shapes=whole,
        tables=tables,
        error=float(np.linalg.norm(gaps * np.sqrt(parts)) / size),
        best=_best(seen * np.sqrt(parts), heights * np.sqrt(parts)),
        products=(whole * parts) @ whole.T,
        creases=np.zeros(len(whole), np.bool_),
    )
    found = factors.some(np.flatnonzero(seen.any(axis=1) & steps.weights(squares).any(axis=0)))
    absent = {side.turn for side in sides} - {k for k, table in enumerate(found.tables) if table.any()}
    return replace(found, left_out=tuple(sorted(absent)))


@dataclass(frozen=True, slots=True, eq=False)
class _Side:
    """The folds of a turn one way.

    Attributes:
        turn: The number of the turn.
        poses: (own,) those of its sweep that way,
        shares: (own,) and the parts of the farthest angle there.
        tops: (vertices,) the greatest heights that it makes alone.
    """

    turn: int
    poses: Ints
    shares: Floats
    tops: Floats


def _sides(sweeps: Sweeps, heights: Floats) -> Iterator[_Side]:
    """The sides of all turns that (poses, vertices) heights show."""
    for number in range(len(sweeps.turns)):
        for sign in (-1.0, 1.0):
            poses = np.flatnonzero((sweeps.owners == number) & (sign * sweeps.angles[:, number] > 0))
            if len(poses):
                own = np.abs(sweeps.angles[poses, number])
                yield _Side(number, poses, own / own.max(), heights[poses].max(axis=0))


def _ranked(sweeps: Sweeps, sides: Sequence[_Side]) -> list[_Side]:
    """Sorted sides: of each joint that which folds most, then the second of each, so that none is left out for another.

    A trunk folds more cloth than an elbow does, but one looks at both.
    """
    nodes = [sweeps.turns[side.turn].signal.node for side in sides]
    ranks = [nodes[:place].count(node) for place, node in enumerate(nodes)]
    return [side for _, side in sorted(zip(ranks, sides, strict=True), key=lambda pair: pair[0])]


def seen_of(heights: Floats, greatest: float | None = None) -> Floats:
    """(…,) heights of which nothing is left where they are below `UNSEEN`, and where they are tall hardly less.

    They are compared with the greatest of all shapes, which is among them if it is not given. To take as much from all
    of them as from the lowest would lower a garment's folds by a fifth.

    Source: L. Breiman, *Better Subset Regression Using the Nonnegative Garrote*, Technometrics 37, 1995.
    """
    least = UNSEEN * (heights.max(initial=0.0) if greatest is None else greatest)
    return np.asarray(np.maximum(heights - least * (least / np.maximum(heights, max(least, TINY))), 0.0))


def weights_of(sweeps: Sweeps, tables: Sequence[Floats]) -> Floats:
    """(poses, shapes) weights in all poses, by (angles, shapes) tables of all turns."""
    return together(
        [
            interpolated(angles, turn.angles, table)
            for angles, turn, table in zip(sweeps.angles.T, sweeps.turns, tables, strict=True)
        ]
    )


def _late(angles: Floats) -> Floats:
    """(angles,) from 0, up to half of the way to either end, to 1, from three quarters on."""
    ends = np.where(angles < 0, angles.min(), angles.max())
    return np.clip(4.0 * angles / np.where(ends != 0, ends, 1.0) - 2.0, 0.0, 1.0)


def _size(rows: Floats, products: Floats) -> float:
    """The root of the integrals of the squares of (rows, shapes) sums of shapes."""
    return float(np.sqrt(max(np.einsum("rk,kl,rl->", rows, products, rows), 0.0)))


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """The steps of all turns, one after the other, whose squares with signs are fitted.

    Attributes:
        owners: (steps,) the number of the turn of each,
        firsts: (turns,) and each one's first.
        rest: (steps,) flags of those at which a turn is at rest, where tables are 0.
        shares: (poses, steps) parts that each has in what is looked up.
        costs: (steps, steps) the form of what squares cost.
    """

    owners: Ints
    firsts: Ints
    rest: Bools
    shares: Floats
    costs: Floats

    @classmethod
    def of(cls, sweeps: Sweeps) -> "_Steps":
        """The steps of turns in the poses of sweeps."""
        counts = np.array([len(turn.angles) for turn in sweeps.turns])
        owners, rest = np.repeat(np.arange(len(counts)), counts), np.concatenate([t.angles == 0 for t in sweeps.turns])
        shares = np.hstack(
            [
                interpolated(angles, turn.angles, np.eye(len(turn.angles)))
                for angles, turn in zip(sweeps.angles.T, sweeps.turns, strict=True)
            ]
        )
        bends = np.zeros((len(owners), len(owners)))
        at = np.concatenate([turn.angles for turn in sweeps.turns])
        inner = np.flatnonzero(owners[2:] == owners[:-2]) + 1
        before, after = at[inner] - at[inner - 1], at[inner + 1] - at[inner]
        bends[inner, inner - 1], bends[inner, inner + 1] = after / (before + after), before / (before + after)
        bends[inner, inner] = -1.0
        return cls(owners, np.cumsum(counts) - counts, rest, shares, _SMOOTH * bends.T @ bends)

    def looked_up(self, squares: Floats) -> Floats:
        """(turns, poses, …) parts that tables with (steps, …) squares give."""
        roots = _roots(squares)
        ends = np.append(self.firsts[1:], len(roots))
        return np.stack([self.shares[:, a:b] @ roots[a:b] for a, b in zip(self.firsts, ends, strict=True)])

    def weights(self, squares: Floats) -> Floats:
        """(poses, …) weights by tables with (steps, …) squares, which are not limited yet."""
        return np.asarray(np.sqrt(np.maximum(squares_of(self.looked_up(squares)), 0.0)))

    def nearer(self, squares: Floats, wanted: Floats, own: Bools) -> Floats:
        """(steps,) squares, of own ones alone, by which a shape's weights are nearer to (poses,) wanted ones.

        A weight w is off by (w² - u) / (w + √u) where u is the sum of squares, which is all but linear in these.
        """
        looked_up = self.looked_up(squares)
        sums = squares_of(looked_up)
        roots = np.sqrt(np.maximum(sums, 0.0))
        slopes = self.shares * (np.abs(looked_up).T[:, self.owners] + _FAINT) / (np.abs(_roots(squares)) + _FAINT)
        slopes = slopes[:, own]
        gaps = wanted**2 - sums
        # What is pulled flat is off by no more than its weight is.
        off = (wanted - roots) ** 2
        counted = slopes.T * (off / (gaps**2 + _FAINT**2 * off + _FAINT**4))
        costs = self.costs[np.ix_(own, own)]
        found = np.where(own, squares, 0.0)
        # What a step costs by itself keeps squares near 0 of which poses tell little.
        forms = counted @ slopes + costs + np.eye(len(costs))
        found[own] += np.linalg.solve(forms, counted @ gaps - costs @ squares[own])
        return found

    def tables(self, squares: Floats) -> tuple[Floats, ...]:
        """For each turn (angles, shapes) parts of weights, from (steps, shapes) squares."""
        return tuple(np.split(_roots(squares), self.firsts[1:]))


def _roots(squares: Floats) -> Floats:
    """Roots of squares with signs, with their signs."""
    return np.asarray(np.sign(squares) * np.sqrt(np.abs(squares)))


def _fitted(
    steps: _Steps, sides: Sequence[_Side], acting: Bools, heights: Floats, parts: Floats
) -> tuple[Floats, Floats]:
    """A shape for each side, (shapes, vertices), and (steps, shapes) squares, so that the greatest weight is 1.

    What is seen of the shapes fits (poses, vertices) heights, which count by (vertices,) parts of the area: other
    shapes make up for what is cut off one. Tables are those of turns that act on a shape, by (turns, vertices) flags.
    """
    whole = np.stack([side.shares @ heights[side.poses] / side.shares.sum() for side in sides])
    squares = np.zeros((len(steps.owners), len(sides)))
    for column, side in zip(squares.T, sides, strict=True):
        column[steps.shares[side.poses].argmax(axis=1)] = side.shares
    # A shape may be higher than its side's folds where these are seen, as other turns raise it there, too.
    least = UNSEEN * float(heights.max())
    limits = np.stack([side.tops / np.maximum(1.0 - side.tops / least, TINY) for side in sides])
    seen = seen_of(whole)
    for _ in range(_ROUNDS):
        products, wanted = (seen * parts) @ seen.T, (heights * parts) @ seen.T
        reached = (seen**2 * parts) @ acting.T > _REACHED * np.diag(products)[:, None]
        weights = steps.weights(squares)
        for k in np.flatnonzero(np.diag(products)).tolist():
            own = reached[k][steps.owners] & ~steps.rest
            best = weights[:, k] + (wanted[:, k] - weights @ products[k]) / products[k, k]
            for _ in range(_STEPS):
                squares[:, k] = steps.nearer(squares[:, k], np.maximum(best, 0.0), own)
            weights[:, k] = steps.weights(squares[:, k])
        tops = np.where(weights.any(axis=0), weights.max(axis=0), 1.0)
        squares, weights = squares / tops**2, weights / tops
        seen, whole = tops[:, None] * seen, tops[:, None] * whole
        wanted, products = weights.T @ heights, weights.T @ weights
        for k, row in enumerate(products):
            nearest = seen[k] + (wanted[k] - row @ seen) / max(row[k], TINY)
            whole[k] = np.clip(nearest, 0.0, limits[k])
            seen[k] = seen_of(whole[k], float(whole.max()))
    return whole, squares


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
