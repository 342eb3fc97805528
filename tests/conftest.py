"""Settings of every test: floating-point faults raise, property tests repeat the same examples."""

import numpy as np
import pytest
from hypothesis import settings

from kit.clients import install

np.seterr(all="raise", under="ignore")
settings.register_profile("same", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("same")


def pytest_configure(config: pytest.Config) -> None:
    """Node's packages are installed before workers start, which would get in each other's way."""
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        install()
