"""Settings of every test: floating-point faults raise, property tests repeat the same examples."""

import numpy as np
from hypothesis import settings

np.seterr(all="raise", under="ignore")
settings.register_profile("same", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("same")
