"""Where compression concentrates: the summits of the loss over a surface, and the basin of sites around each.

A slope that leads up to a deeper fold, such as the upper arm beside a bent elbow, is part of that fold: flesh bulges
there. So is a summit that hardly rises above its saddle.

Source: watersheds merged by persistence, such as in H. Edelsbrunner, J. Harer, *Computational Topology*, 2010, §VII.
"""

import numpy as np
from scipy.sparse import csr_array

from wrinklecli.numeric.arrays import Floats, Ints

# Part of its height by which a summit rises above the saddle to a higher one, or it is none.
_PROMINENCE = 0.3


def basins(losses: Floats, near: csr_array, least: float) -> Ints:
    """(sites,) the summit up to which each site's slope leads, itself a site; -1 below the least loss.

    Args:
        losses: (sites,) of each.
        near: (sites, sites) which are neighbours.
        least: Loss below which a site belongs to no basin.
    """
    order = np.argsort(-losses, kind="stable")
    order = order[losses[order] >= least]
    summits = np.full(len(losses), -1, np.intp)
    merged: dict[int, int] = {}  # of each summit, the one that took it over

    def top(summit: int) -> int:
        while merged[summit] != summit:
            merged[summit] = merged[merged[summit]]
            summit = merged[summit]
        return summit

    for site in order.tolist():
        around = summits[near.indices[near.indptr[site] : near.indptr[site + 1]]]
        known = {top(int(summit)) for summit in np.unique(around[around >= 0])}
        if not known:
            merged[site] = site
            summits[site] = site
            continue
        # Of equal ones the first.
        highest = min(known, key=lambda summit: (-losses[summit], summit))
        summits[site] = highest
        for other in known:
            if losses[other] - losses[site] < _PROMINENCE * losses[other]:
                merged[other] = highest
    return np.array([top(int(summit)) if summit >= 0 else -1 for summit in summits], np.intp)
