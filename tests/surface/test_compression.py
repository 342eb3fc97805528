"""Basins of the compression over a surface."""

import numpy as np
from scipy.sparse import csr_array

from wrinklecli.surface.compression import basins


def test_a_slope_belongs_to_the_fold_above_it() -> None:
    losses = np.array([0.1, 0.3, 0.5, 0.45, 0.48, 0.9, 0.3, 0.05, 0.2, 0.6])
    count = len(losses)
    chain = np.eye(count, k=1) + np.eye(count, k=-1)
    found = basins(losses, csr_array(chain), least=0.1)
    assert found.tolist() == [5, 5, 5, 5, 5, 5, 5, -1, 9, 9]
