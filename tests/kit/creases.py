"""Folds whose own motion is solved, as a bake does it, in this process."""

from dataclasses import replace

from wrinklecli.effects.contact.crease import Crease, march_clip, resolve
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.effects.contact.system import crossing_in_sweeps
from wrinklecli.numeric.arrays import Ints


def crossing(fold: Fold, further: Ints | None = None) -> Fold:
    """The fold with what crosses in its own motion; `further` are fine vertices that cross in clips."""
    found = replace(fold, crossed=crossing_in_sweeps(fold))
    return found if further is None else found.crossing_also(further)


def resolved(fold: Fold, *, most: int, further: Ints | None = None) -> Crease:
    """The fold with at most so many shapes of its sweeps; `further` are fine vertices that cross in clips."""
    found = crossing(fold, further)
    assert found.crosses
    sweeps = [march_clip(found, *each, sweep=True) for each in found.hinge.sweeps]
    assert all(each.touching for each in sweeps if each.faults)
    poses = [pose for each in sweeps for pose in each.poses(each.touching)]
    return resolve(found, poses, sweeps, most=most)
