"""Folds whose own motion is solved, as a bake does it, in this process."""

from collections.abc import Sequence

from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact.crease import Crease, march_clip, resolve
from wrinklecli.effects.contact.fold import Fold
from wrinklecli.effects.contact.system import with_crossings


def resolved(fold: Fold, *, most: int, clips: Sequence[Clip] = ()) -> Crease:
    """The fold with at most so many shapes of its sweeps; it may move what crosses in these and in clips."""
    found = with_crossings(fold, clips)
    assert found.crosses
    sweeps = [march_clip(found, *each, sweep=True) for each in found.hinge.sweeps]
    assert all(each.touching for each in sweeps if each.faults)
    poses = [pose for each in sweeps for pose in each.poses(each.touching, len(each.times))]
    return resolve(found, poses, sweeps, most=most)
