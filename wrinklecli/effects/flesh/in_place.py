"""Clips in place, in which a body walks or runs and does not get anywhere."""

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import node_rows
from wrinklecli.character.rig import Rig

# Body heights per second at which the ground runs below a clip in place: a slow walk has 0.4, a shifted foot 0.05. And
# the part of the ground's way within which such a body keeps its place: one that goes ahead gets as far as its feet do.
_RUNS, _SWAYS = 0.15, 0.25
# Samples per second, and at most, by which that is measured: a foot is down for a quarter of a second in a run.
_SAMPLED, _MOST_SAMPLES = 30.0, 300


def in_place(rig: Rig, clip: Clip) -> bool:
    """True if a body walks or runs in a clip, but keeps its place.

    The lowest joint is that of the foot which stands. Where the clip moves the body ahead, the foot keeps its place;
    in place, it slides backwards again and again. A leg that swings to and fro does not get anywhere.
    """
    count = int(np.clip(_SAMPLED * (clip.end - clip.start), 2, _MOST_SAMPLES)) + 1
    times = np.linspace(clip.start, clip.end, count)
    # A root joint may lie on the ground and stay there; toes, fingers and the like have no joint below them.
    ends = np.setdiff1d(rig.joints, rig.parents)
    rows = node_rows(rig, clip, times, ends.tolist())
    places = np.stack([np.broadcast_to(each[:, 3], (3, count)).T for each in rows])
    size = float(np.ptp(places[:, 0], axis=0).max())
    if not size > 0 or not clip.end > clip.start:
        return False
    lowest = (places[:, 1:, 1] + places[:, :-1, 1]).argmin(axis=0)
    steps = np.diff(places[:, :, [0, 2]], axis=1)
    run = float(np.linalg.norm(steps[lowest, np.arange(count - 1)].sum(axis=0)))
    way = float(np.ptp(places[:, :, [0, 2]].mean(axis=0), axis=0).max())
    return run > _RUNS * size * (clip.end - clip.start) and way < _SWAYS * run
