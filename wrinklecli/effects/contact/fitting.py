"""The fewest shapes that follow what contact does in a fold, and weights of them, so that nothing crosses.

What is nearest in the mean may cross where it is off by less than a gap: there errors count more, and shapes are fitted
again. Where something touches it may be opened further, hidden in the fold.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.effects.contact.folding import Found
from wrinklecli.numeric.arrays import Bools, Floats, Ints
from wrinklecli.numeric.reduction import project, weighted_basis

# How often shapes and weights are fitted again where they leave crossings, and by how much these then count more.
_TRIES, _MORE = 8, 3.0
MOST_WEIGHT = 1.5
"""Greatest weight of a shape in any clip; in the sweeps it is 1."""

# Share of the poses that were not right before above which fitting again is given up, and more shapes are needed.
_HOPELESS = 0.7
# Volume that shapes may take away, of a limb's as long as it is thick.
_LOST = 0.01


def fewest(solved: Sequence[Found], *, share: float, most: int) -> tuple[Floats, Floats, int]:
    """The fewest shapes that are right enough, keep the volume and leave no crossing in any sweep.

    Args:
        solved: What was found, at least one pose.
        share: Greatest error of a vertex, of the greatest move.
        most: Shapes at most: of those the ones that leave the fewest crossings, and then the most volume.

    Returns:
        (poses, shapes) weights in [-1, 1], (shapes, free, 3), and the number of poses in which they leave crossings.
    """
    fields = np.stack([each.moved for each in solved])
    bound = share * max(each.length for each in solved)
    # What contact itself takes away, no shapes give back.
    allowed = max(_LOST, *(each.squeezed(each.moved) for each in solved))
    most = min(most, len(solved))
    tries: list[tuple[int, float, Floats, Floats]] = []
    for count in range(1, most + 1):
        shares, wanted = np.stack([each.shares for each in solved]), fields
        suspects, before = np.arange(len(solved)), len(solved)
        for _ in range(_TRIES):
            weights, shapes = weighted_basis(wanted, shares, count)
            made = [made_of(row, shapes) for row in weights]
            wrong = _wrong(solved, made, bound) if count < most else {}
            hopeless = _HOPELESS * before if count < most else np.inf
            if len(wrong) > hopeless or _more_cross(solved, made, suspects, hopeless):
                break
            crossing = _crossing(solved, made, suspects)
            # The rest are looked at where all may be right, or at last where no try was better.
            best = min((left for left, *_ in tries), default=len(solved) if count == most else 0)
            looked = len(crossing) <= best and not wrong
            if looked and len(suspects) < len(solved):
                crossing |= _crossing(solved, made, np.setdiff1d(np.arange(len(solved)), suspects))
            lost = max(each.squeezed(moved) for each, moved in zip(solved, made, strict=True))
            if not crossing and not wrong and lost <= allowed:
                return weights, shapes, 0
            if count == most and looked:
                tries.append((len(crossing), max(lost, allowed), weights, shapes))
            bad = len(crossing.keys() | wrong.keys())
            if not bad or bad > hopeless:
                break
            for number, marked in (*crossing.items(), *wrong.items()):
                shares[number, marked] *= _MORE
            suspects, before = np.array(sorted(crossing), np.intp), bad
            wanted = np.stack([each.opened(moved) for each, moved in zip(solved, made, strict=True)])
    left, _, weights, shapes = min(tries, key=lambda each: each[:2])
    return weights, shapes, left


def _wrong(solved: Sequence[Found], made: Sequence[Floats], bound: float) -> dict[int, Bools]:
    """Poses in which what shapes made is further off than a bound, solver's units, and (free,) where.

    With a vertex those count that are beside it: else shapes are rough there.
    """
    further = [each.off(moved) > bound for each, moved in zip(solved, made, strict=True)]
    return {
        k: each.beside(marked) for k, (each, marked) in enumerate(zip(solved, further, strict=True)) if marked.any()
    }


def _more_cross(solved: Sequence[Found], made: Sequence[Floats], numbers: Ints, most: float) -> bool:
    """Whether what shapes made crosses in more of some poses than in a number of them: found by a part of the work."""
    if most >= len(numbers):
        return False
    crossing = 0
    for number in numbers.tolist():
        crossing += solved[number].crosses(made[number])
        if crossing > most:
            return True
    return False


def _crossing(solved: Sequence[Found], made: Sequence[Floats], numbers: Ints) -> dict[int, Bools]:
    """Of some poses those in which what shapes made crosses, and (free,) which vertices do."""
    found = {}
    for number in numbers.tolist():
        marked = solved[number].crossing(made[number])
        if marked is not None:
            found[number] = marked
    return found


def fitted(found: Found, shapes: Floats, urgent: Floats | None = None) -> tuple[Floats, Floats, bool]:
    """Fit shapes to what was found.

    Args:
        found: In a pose.
        shapes: (shapes, free, 3).
        urgent: (free,) by how much more the error of each counts, as it had to in a pose like this one.

    Returns:
        (shapes,) weights that leave the fewest crossings, (free,) what is urgent with them, and whether they leave any.
    """
    urgent = np.ones(len(found.shares)) if urgent is None else urgent
    wanted = found.moved
    tries: list[tuple[int, Floats, Floats]] = []
    for _ in range(_TRIES):
        shares = found.shares * urgent
        (weights,) = np.clip(project(wanted[None], shares[None], shapes), -MOST_WEIGHT, MOST_WEIGHT)
        moved = made_of(weights, shapes)
        marked = found.crossing(moved)
        if marked is None:
            return weights, urgent, False
        tries.append((int(marked.sum()), weights, urgent))
        urgent, wanted = np.where(marked, _MORE * urgent, urgent), found.opened(moved)
    _, weights, urgent = min(tries, key=lambda each: each[0])
    return weights, urgent, True


def made_of(weights: Floats, shapes: Floats) -> Floats:
    """(free, 3) what (shapes,) weights make of (shapes, free, 3)."""
    return np.asarray(np.tensordot(weights, shapes, axes=1))
