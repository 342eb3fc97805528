"""Control curves as tables, which give the curve's weights at all distances and rest lengths."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from wrinklecli.choices import Profile, Strategy
from wrinklecli.drive.table import TABLE_ERROR
from wrinklecli.effects.wrinkle.curve import ControlCurve, plan_curve
from wrinklecli.effects.wrinkle.lookup import tabulate_curve, tabulate_weights, weights_of

Floats = NDArray[np.float64]

LENGTH = 0.05


def planned(
    strategy: Strategy,
    profile: Profile = "smooth",
    details: tuple[float, ...] = (),
    height: float = 0.05,
    longest: float = 1.2,
    bumps: int = 5,
    gap: int = 0,
    compressible: float = 0.0,
) -> ControlCurve:
    """A curve of a rest length of 5 cm; `height` and `longest` are shares of it."""
    return plan_curve(
        bumps=bumps,
        gap=gap,
        strategy=strategy,
        details=details,
        profile=profile,
        max_height=height * LENGTH,
        compressible=compressible,
        rest_length=LENGTH,
        greatest_rest_length=longest * LENGTH,
    )


def everywhere(curve: ControlCurve, shares: Sequence[float]) -> tuple[Floats, Floats]:
    """(points,) distances and rest lengths, many of them where a group of bumps starts."""
    rng = np.random.default_rng(1)
    lengths = LENGTH * rng.uniform(*shares, 4000)
    distances = np.concatenate([lengths[:1000] * rng.uniform(0, 1.1, 1000), lengths[1000:] * rng.uniform(0, 1, 3000)])
    # Towards the nearest multiple of a full bump, where the next one starts.
    for _ in range(12 if 0 < curve.max_height < np.inf else 0):
        share = 1 - curve.compressible
        shortenings = curve.shortening(distances, lengths)
        capacities = curve.profile.capacity(curve.intervals(lengths, shortenings), curve.max_height)
        full = np.rint(shortenings / capacities)
        distances[1000:] = np.maximum(lengths * (1 - 1e-5) - full * capacities / share, 0.0)[1000:]
    distances[2000:] *= 1 - 10.0 ** rng.uniform(-9, -2, 2000)
    return distances, lengths


@pytest.mark.quick(4)
@pytest.mark.parametrize("strategy", ["everywhere", "origin", "both_ends"])
@pytest.mark.parametrize(
    ("profile", "details"), [("smooth", ()), ("smooth", (0.3, 0.2)), ("polyline", ()), ("polyline", (0.2,))]
)
@pytest.mark.parametrize("height", [0.02, 0.05, 0.4, np.inf])
def test_weights_that_are_looked_up_are_right_to_the_stated_error(
    strategy: Strategy, profile: Profile, details: tuple[float, ...], height: float
) -> None:
    curve = planned(strategy, profile, details, height)
    table = tabulate_curve(curve, 0.9 * LENGTH, 1.2 * LENGTH)
    distances, lengths = everywhere(curve, (0.9, 1.2))
    wanted = weights_of(curve, curve.follow(distances, lengths)[0]).reshape(len(lengths), -1)
    assert np.abs(table.at(distances, lengths) - wanted).max() <= TABLE_ERROR * np.abs(wanted).max()


@pytest.mark.parametrize("compressible", [0.3, 0.95])
@pytest.mark.parametrize("strategy", ["everywhere", "both_ends"])
def test_compressible_tissue_is_looked_up_too(strategy: Strategy, compressible: float) -> None:
    curve = planned(strategy, compressible=compressible)
    distances, lengths = everywhere(curve, (0.9, 1.2))
    wanted = weights_of(curve, curve.follow(distances, lengths)[0]).reshape(len(lengths), -1)
    table = tabulate_curve(curve, 0.9 * LENGTH, 1.2 * LENGTH)
    assert np.abs(table.at(distances, lengths) - wanted).max() <= TABLE_ERROR * np.abs(wanted).max()
    rows, weights = tabulate_weights(curve, lambda each: each.reshape(len(each), -1))
    nominal = np.full(len(distances), LENGTH)
    wanted = weights_of(curve, curve.follow(np.minimum(distances, LENGTH), nominal)[0]).reshape(len(nominal), -1)
    shares = 1 - np.minimum(distances, LENGTH) / LENGTH
    found = np.stack([np.interp(shares, rows, column) for column in weights.T], axis=1)
    assert np.abs(found - wanted).max() <= TABLE_ERROR * np.abs(wanted).max()


@pytest.mark.parametrize(("bumps", "gap"), [(1, 0), (64, 1)])
def test_any_number_of_bumps(bumps: int, gap: int) -> None:
    curve = planned("origin", bumps=bumps, gap=gap, height=0.25 / bumps)
    table = tabulate_curve(curve, LENGTH, 1.2 * LENGTH)
    distances, lengths = everywhere(curve, (1.0, 1.2))
    wanted = weights_of(curve, curve.follow(distances, lengths)[0]).reshape(len(lengths), -1)
    assert np.abs(table.at(distances, lengths) - wanted).max() <= TABLE_ERROR
    assert len(table.distances) < 8000


@pytest.mark.quick(14)
@pytest.mark.parametrize("strategy", ["everywhere", "origin", "both_ends"])
@pytest.mark.parametrize(
    ("profile", "details"), [("smooth", ()), ("smooth", (0.3, 0.2)), ("polyline", ()), ("polyline", (0.2,))]
)
@pytest.mark.parametrize("height", [0.02, 0.05, 0.4, np.inf])
def test_one_table_is_right_between_its_rows_and_has_few(
    strategy: Strategy, profile: Profile, details: tuple[float, ...], height: float
) -> None:
    curve = planned(strategy, profile, details, height, longest=1.0)
    rows, table = tabulate_weights(curve, lambda weights: weights.reshape(len(weights), -1))
    assert (rows[0], rows[-1]) == (0.0, 1.0)
    assert len(rows) <= 4 + 20 * len(curve.groups) * (1 + len(details))
    # Between all rows, and close behind each: that is where roots start.
    gaps = np.diff(rows)[:, None] * np.concatenate([np.geomspace(1e-9, 0.5, 60), np.linspace(0.5, 1.0, 20)])
    shortenings = (rows[:-1, None] + gaps).reshape(-1)
    lengths = np.full(len(shortenings), LENGTH)
    wanted = weights_of(curve, curve.follow((1 - shortenings) * lengths, lengths)[0]).reshape(len(lengths), -1)
    found = np.stack([np.interp(shortenings, rows, column) for column in table.T], axis=1)
    assert np.abs(found - wanted).max() <= TABLE_ERROR * np.abs(wanted).max()


def test_targets_may_be_mixtures_and_positive_only() -> None:
    curve = planned("both_ends")
    mix = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, -2.0], [0.0, -1.0, 2.0]])
    table = tabulate_curve(curve, LENGTH, 1.2 * LENGTH, mix=mix, positive=True)
    distances, lengths = everywhere(curve, (1.0, 1.2))
    own = weights_of(curve, curve.follow(distances, lengths)[0]).reshape(len(lengths), -1)
    wanted = np.maximum(own @ mix.T, 0.0)
    assert np.abs(table.at(distances, lengths) - wanted).max() <= TABLE_ERROR * wanted.max()
    assert table.at(distances, lengths).min() == 0.0


def test_bumps_without_height_stay_flat() -> None:
    curve = planned("origin", height=0.0)
    table = tabulate_curve(curve, LENGTH, 1.2 * LENGTH)
    assert not table.at(np.linspace(0.0, LENGTH, 9), np.full(9, LENGTH)).any()


def test_a_stretched_segment_has_no_weights() -> None:
    table = tabulate_curve(planned("both_ends"), LENGTH, 1.2 * LENGTH)
    assert not table.at(np.array([1.2, 1.3, 5.0]) * LENGTH, np.full(3, 1.2 * LENGTH)).any()
