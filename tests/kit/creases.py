"""Folds whose own motion is solved, as a bake does it, in this process."""

from wrinklecli.effects.contact.crease import Crease, Surface, distances_from_crossings, poses_of_sweeps, resolve
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.numeric.arrays import Ints


def resolved(fold: Fold, *, most: int, further: Ints | None = None) -> Crease:
    """The fold with at most so many shapes of its sweeps; `further` are fine vertices that cross in clips."""
    apart = distances_from_crossings(fold, further)
    assert apart is not None
    surface = Surface.of(fold, apart)
    poses = poses_of_sweeps([surface.sweep(0, end) for end in fold.hinge.ends])
    leaning = [pose for each in surface.leaning_sweeps for pose in surface.sweep(*each).poses]
    return resolve(surface, [*poses, *leaning], share=0.35, most=most)
