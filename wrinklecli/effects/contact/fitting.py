"""Fits the fewest shapes to the solutions of a fold, and weights of these shapes, so that nothing crosses.

Shapes with the least mean error may still cross where surfaces touch, as a small error closes a gap there. So errors
there get more weight, and the shapes are fitted again. Touching vertices may be opened further, hidden in the fold.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from wrinklecli.effects.contact.solution import Solution
from wrinklecli.numeric.arrays import Bools, Floats
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
    enough = most = min(most, len(solved))
    fewest, found = min(fewest, most), None
    # Each fit begins with the weights of errors that others have led to.
    shares = np.stack([each.error_weights for each in solved])
    limit = _MORE**_TRIES * shares
    # More shapes hardly ever do worse, so the range in which the fewest lie is halved.
    while found is None or fewest < enough:
        count = (fewest + enough) // 2
        best = _fitted(solved, count, shares, limit, bound=np.inf if count == most else bound, allowed=allowed)
        if count == most or best.bad == 0:
            found, enough = best, count
        else:
            fewest = count + 1
    return found.weights, found.shapes, found.bad


class _Fit(NamedTuple):
    """Shapes with weights; fits are the better, the fewer poses are bad, and the less volume they lose.

    Attributes:
        bad: Number of poses that cross, or are further off than a bound.
        lost: Greatest volume that is lost beyond what may be.
        weights: (poses, shapes).
        shapes: (shapes, free, 3).
    """

    bad: int
    lost: float
    weights: Floats
    shapes: Floats


def _fitted(
    solved: Sequence[Solution], count: int, shares: Floats, limit: Floats, *, bound: float, allowed: float
) -> _Fit:
    """The best of some fits of a `count` of shapes; the next has more weight on the errors of the one before.

    Errors may reach a `bound`, solver's units, and losses of volume be as great as `allowed`. `shares` are the (poses,
    free) weights of squared errors, which grow up to a `limit`.
    """
    wanted, tries = np.stack([each.moved for each in solved]), list[_Fit]()
    while len(tries) < _TRIES and not _stalled([each.bad for each in tries]):
        weights, shapes = weighted_basis(wanted, shares, count)
        made = [combined(row, shapes) for row in weights]
        marks = np.stack([_marked(each, moved, bound) for each, moved in zip(solved, made, strict=True)])
        lost = max(abs(each.volume_change(moved)) for each, moved in zip(solved, made, strict=True))
        tries.append(_Fit(int(marks.any(axis=1).sum()) or int(lost > allowed), max(lost, allowed), weights, shapes))
        if not marks.any():
            break
        shares[marks] = np.minimum(_MORE * shares, limit)[marks]
        wanted = np.stack([each.opened(moved) for each, moved in zip(solved, made, strict=True)])
    return min(tries, key=lambda each: each[:2])


def _stalled(counts: Sequence[int]) -> bool:
    """True if the last tries leave no fewer crossings than those before."""
    return len(counts) > _STALLED and min(counts[-_STALLED:]) >= min(counts[:-_STALLED])


def _marked(found: Solution, moved: Floats, bound: float) -> Bools:
    """(free,) vertices of a pose that cross in a fit, or are further off than a bound, solver's units.

    Neighbours of the latter count too; otherwise the shapes become jagged.
    """
    far = found.errors(moved) > bound
    return found.crossing(moved) | (found.with_neighbours(far) if far.any() else far)


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
        if _stalled([count for count, _ in tries]):
            break
        shares[marked] *= _MORE
        wanted = found.opened(moved)
    return min(tries, key=lambda each: each[0])[1], True


def combined(weights: Floats, shapes: Floats) -> Floats:
    """(free, 3) sum of (shapes, free, 3) by (shapes,) weights."""
    return np.asarray(np.tensordot(weights, shapes, axes=1))
