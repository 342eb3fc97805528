"""Settings of every test: floating-point faults raise, property tests repeat the same examples."""

import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

from kit.clients import install
from kit.command import Wrinkle

np.seterr(all="raise", under="ignore")
settings.register_profile("same", derandomize=True, deadline=None, max_examples=60)
settings.load_profile("same")


def pytest_configure(config: pytest.Config) -> None:
    """Node's packages are installed before workers start, which would get in each other's way."""
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        install()


@pytest.fixture
def wrinkle(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Wrinkle]:
    """The command, run in this process and in a folder of its own."""
    handler = signal.getsignal(signal.SIGTERM)
    monkeypatch.chdir(tmp_path)
    yield Wrinkle(capfd, monkeypatch)
    signal.signal(signal.SIGTERM, handler)
