"""Settings of every test: floating-point faults raise, property tests repeat the same examples."""

import gc
import os
import signal
import sys
import threading
from collections import Counter
from collections.abc import Generator, Iterator
from pathlib import Path

# Each core has a worker. Threads of BLAS would wait for each other, for a tenth of the time of all tests.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import hypothesis.internal.conjecture.providers as hypothesis_providers
import numpy as np
import pytest
from hypothesis import settings

from kit.clients import install
from kit.command import Wrinkle
from kit.golden import Golden
from kit.places import ROOT

_BUILT = ("build", "dist")  # by the build of a release
_HANDLERS = {each: signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}

# Workers, and the hundreds of commands that they start, would else compile all modules anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# No test pulls the plug. Where a disk takes milliseconds to write a file, thousands of files take seconds.
os.fsync = lambda _: None
np.seterr(all="raise", under="ignore")
# `.ci/run --all` asks for more.
_EXAMPLES = int(os.environ.get("WRINKLE_TESTS_EXAMPLES", "10"))
settings.register_profile("wrinkle", derandomize=True, deadline=None, max_examples=_EXAMPLES)
settings.load_profile("wrinkle")
# Else Hypothesis also draws the constants of all modules that this process has imported by then: other examples in each
# worker, after seconds in which it reads the modules.
hypothesis_providers._get_local_constants = hypothesis_providers.Constants  # type: ignore[attr-defined,assignment]
gc.disable()  # until all tests are collected: what collection makes stays to the end


def pytest_configure(config: pytest.Config) -> None:
    """Node's packages are installed while workers collect tests; those that need them wait."""
    if getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput"):
        threading.Thread(target=install).start()


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Every other worker reads the tests from the last one on.

    In a new clone pytest rewrites all modules of tests, for 16 s of a processor. Two workers so do half of them each.
    """
    report = yield
    if isinstance(collector, pytest.Directory) and int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:]) % 2:
        report.result.reverse()
    return report


@pytest.hookimpl(tryfirst=True)  # before pytest looks at `-m`
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Cases of a test marked `quick(n, m)` are slow after the first n, long after the first m; long tests come first.

    Begun last, one of these would keep all workers but its own waiting. Those of a module stay in its order.
    """
    seen: Counter[str] = Counter()
    for item in items:
        marker = item.get_closest_marker("quick")
        if marker is not None:
            name = item.nodeid.partition("[")[0]
            seen[name] += 1
            for most, mark in zip(marker.args, ("slow", "long"), strict=False):
                if seen[name] > most:
                    item.add_marker(mark)
    items.sort(key=lambda item: (item.get_closest_marker("long") is None, item.path))


def pytest_collection_finish() -> None:
    """From here on rubbish is searched for, but not among the tests themselves.

    A search for every 100,000 new objects in place of 700 takes a tenth of the tests' time less, and 20 MB more.
    """
    gc.freeze()
    gc.set_threshold(100_000)
    gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_sessionfinish() -> None:
    """Searches for garbage once where all tests have ended; otherwise pytest does so twice, and Python when it ends."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def signals_as_before() -> Iterator[None]:
    """Commands that run in this process say what signals do; the programs that a later test starts would inherit it.

    A command may have run for a fixture of many tests, before this one is set up.
    """
    _reset_signals()
    yield
    _reset_signals()


def _reset_signals() -> None:
    for each, handler in _HANDLERS.items():
        signal.signal(each, handler)


def _in_root() -> set[str]:
    """Names in the root of the repository, but for those that git ignores and other programs may make meanwhile."""
    return {
        name for name in os.listdir(ROOT) if name[0] != "." and name not in _BUILT and not name.endswith(".egg-info")
    }


@pytest.fixture(autouse=True)
def nothing_left_in_the_root() -> Iterator[None]:
    """A relative path in a test without a folder of its own leads into the repository, where it would be committed."""
    before = _in_root()
    yield
    assert _in_root() == before


@pytest.fixture
def wrinkle(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Wrinkle:
    """The command, run in this process and in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return Wrinkle(capfd, monkeypatch)


@pytest.fixture
def golden(request: pytest.FixtureRequest) -> Golden:
    """Compares with the files in tests/data/goldens; `--wrinkle-update` replaces those that differ."""
    return Golden(update=bool(request.config.getoption("--wrinkle-update")))
