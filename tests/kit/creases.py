"""Folds whose own motion is solved, as a bake does it, in this process."""

from wrinklecli.effects.contact.crease import Crease, Surface, distances_from_crossings, resolve
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.numeric.arrays import Ints


def resolved(fold: Fold, *, most: int, further: Ints | None = None) -> Crease:
    """The fold with at most so many shapes of its sweeps; `further` are fine vertices that cross in clips."""
    apart = distances_from_crossings(fold, further)
    assert apart is not None
    surface = Surface.of(fold, apart)
    sweeps = [surface.sweep(each) for each in (*fold.hinge.straight, *fold.hinge.leaning)]
    assert surface.given_up(sweeps[: len(fold.hinge.straight)]) is None
    poses = [pose for each in sweeps for pose in each.poses(each.touching)]
    return resolve(surface, poses, sweeps, share=0.35, most=most)
