"""Fits the fewest shapes to the solutions of a fold, and weights of these shapes, so that nothing crosses.

Shapes with the least mean error may still cross where surfaces touch, as a small error closes a gap there. So errors
there get more weight, and the shapes are fitted again. Touching vertices may be opened further, hidden in the fold.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wrinklecli.effects.contact.solution import Solution
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.reduction import project, weighted_basis

MOST_WEIGHT = 1.5
"""Greatest weight of a shape in any clip; in the sweeps it is 1."""
MOST_LOST = 0.01
"""Volume that shapes may take away, relative to that of a limb as long as it is thick."""
# Loss of volume in a fit that counts as much as an error of a solver's unit everywhere: well below the most.
_UNIT_LOSS = MOST_LOST / 4.0
# Fits of shapes and weights, each with more weight on the errors of the one before.
_TRIES = 8
# Tries in a row that leave no fewer crossings, after which a pose, or the greatest number of shapes, is tried no more.
_STALLED = 3
# Factor on the weight of such an error.
_MORE = 3.0
# A number of shapes is given up if more than this fraction of the poses that were wrong is still wrong after a fit.
_HOPELESS = 0.7


def fit_poses(solved: Sequence[Solution], *, share: float, most: int, fewest: int = 1) -> tuple[Floats, Floats, int]:
    """Fit the fewest shapes that are right enough, keep the volume and leave no crossing in any pose.

    Args:
        solved: The solutions, at least one.
        share: Greatest error of a vertex, relative to the greatest move.
        most: Greatest number of shapes. If even these leave crossings, the fit with the fewest counts, and of several
            the one that keeps the most volume.
        fewest: Least number of shapes, where fewer are known to fail.

    Returns:
        (poses, shapes) weights in [-1, 1]; (shapes, free, 3); and the number of poses in which they leave crossings.
    """
    bound = share * max(each.greatest_move for each in solved)
    # No shapes give back the volume that contact itself takes away.
    allowed = max(MOST_LOST, *(abs(each.volume_change(each.moved)) for each in solved))
    most = min(most, len(solved))
    enough, found, known = most, None, _Known.of(solved)
    fewest = min(fewest, most)
    # More shapes hardly ever do worse, so the range in which the fewest lie is halved.
    while found is None or fewest < enough:
        count = (fewest + enough) // 2
        fit = _fitted(solved, count, known, bound=bound, allowed=allowed, last=count == most)
        if fit is None:
            fewest = count + 1
        else:
            found, enough = fit, count
    return found


@dataclass(slots=True)
class _Known:
    """A fit begins from this: the weights and the poses that fits of other numbers of shapes have found.

    Attributes:
        shares: (poses, free) weights of squared errors: those at vertices that crossed, or were far off, have grown.
        limit: (poses, free) their greatest values.
        crossed: Numbers of the poses with such vertices; none before the first fit.
    """

    shares: Floats
    limit: Floats
    crossed: set[int]

    @classmethod
    def of(cls, solved: Sequence[Solution]) -> "_Known":
        """Know nothing."""
        shares = np.stack([each.error_weights for each in solved])
        return cls(shares, _MORE**_TRIES * shares, set())

    def add(self, found: Mapping[int, Bools]) -> None:
        """Let (free,) vertices of some poses count more."""
        self.crossed |= found.keys()
        for number, marked in found.items():
            raised = _MORE * self.shares[number, marked]
            self.shares[number, marked] = np.minimum(raised, self.limit[number, marked])


def _fitted(
    solved: Sequence[Solution], count: int, known: _Known, *, bound: float, allowed: float, last: bool
) -> tuple[Floats, Floats, int] | None:
    """Fit a `count` of shapes; None if they are not right in every pose.

    Errors may reach a `bound`, solver's units, and losses of volume be as great as `allowed`. If this is the `last`
    count that may be tried, the best fit counts. The rest is as in `fit_poses`.
    """
    wanted, every = np.stack([each.moved for each in solved]), np.arange(len(solved))
    tries: list[tuple[int, float, Floats, Floats]] = []
    # The other poses are checked only if all may be right or, in the end, if no try was better.
    suspects = np.array(sorted(known.crossed) or every, np.intp)
    before, stalled = len(every), 0
    for _ in range(_TRIES):
        weights, shapes = weighted_basis(wanted, known.shares, count)
        made = [combined(row, shapes) for row in weights]
        wrong = {} if last else _wrong(solved, made, bound)
        crossing = _crossing(solved, made, suspects)
        best = min((crossings for crossings, *_ in tries), default=len(every) if last else 0)
        if len(crossing) <= best and not wrong:
            crossing |= _crossing(solved, made, np.setdiff1d(every, suspects))
            lost = max(abs(each.volume_change(moved)) for each, moved in zip(solved, made, strict=True))
            if not crossing and lost <= allowed:
                return weights, shapes, 0
            if last:
                tries.append((len(crossing), max(lost, allowed), weights, shapes))
        bad = len(crossing.keys() | wrong.keys())
        known.add(crossing)
        known.add(wrong)
        hopeless = not last and bad > _HOPELESS * before
        stalled, before = (0, bad) if bad < before else (stalled + 1, before)
        if not bad or hopeless or stalled == _STALLED:
            break
        suspects = np.array(sorted(crossing), np.intp)
        wanted = np.stack([each.opened(moved) for each, moved in zip(solved, made, strict=True)])
    if not tries:
        return None
    crossings, _, weights, shapes = min(tries, key=lambda each: each[:2])
    return weights, shapes, crossings


def _wrong(solved: Sequence[Solution], made: Sequence[Floats], bound: float) -> dict[int, Bools]:
    """The poses in which a fit is further off than a bound, solver's units, and the (free,) vertices.

    Neighbouring vertices count too; otherwise the shapes become jagged.
    """
    further = {
        number: each.errors(moved) > bound for number, (each, moved) in enumerate(zip(solved, made, strict=True))
    }
    return {number: solved[number].with_neighbours(marked) for number, marked in further.items() if marked.any()}


def _crossing(solved: Sequence[Solution], made: Sequence[Floats], numbers: Ints) -> dict[int, Bools]:
    """The poses, among some, in which a fit crosses, and the (free,) vertices that do."""
    every = {number: solved[number].crossing(made[number]) for number in numbers.tolist()}
    return {number: marked for number, marked in every.items() if marked.any()}


def fit_pose(found: Solution, shapes: Floats) -> tuple[Floats, bool]:
    """Fit (shapes, free, 3) to a solution.

    The fit depends on the pose alone, and not on the frames before it, so that players can look it up.

    Returns:
        (shapes,) weights that leave the fewest crossings, and True if crossings remain.
    """
    shares, wanted = found.error_weights.copy(), found.moved
    gradient, kept = found.held_volume
    tries: list[tuple[int, Floats]] = []
    for number in range(_TRIES):
        # Nothing may cross, even if that takes volume away: this counts less with each try.
        factor = np.sqrt(shares.sum()) / _MORE**number / _UNIT_LOSS
        held = factor * gradient[None], np.array([factor * kept])
        (weights,) = np.clip(project(wanted[None], shares[None], shapes, held), -MOST_WEIGHT, MOST_WEIGHT)
        moved = combined(weights, shapes)
        marked = found.crossing(moved)
        if not marked.any():
            return weights, False
        tries.append((int(marked.sum()), weights))
        counts = [count for count, _ in tries]
        if len(counts) > _STALLED and min(counts[-_STALLED:]) >= min(counts[:-_STALLED]):
            break
        shares[marked] *= _MORE
        wanted = found.opened(moved)
    return min(tries, key=lambda each: each[0])[1], True


def combined(weights: Floats, shapes: Floats) -> Floats:
    """(free, 3) sum of (shapes, free, 3) by (shapes,) weights."""
    return np.asarray(np.tensordot(weights, shapes, axes=1))
