"""Tables of control curves: weights that are looked up are those of the curve at all distances and rest lengths."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from wrinklecli.choices import Profile, Strategy
from wrinklecli.drive.segment import Lengths
from wrinklecli.drive.table import TABLE_ERROR
from wrinklecli.effects.effect import Target
from wrinklecli.effects.shapes import Shape
from wrinklecli.effects.wrinkle.curve import ControlCurve, plan_curve
from wrinklecli.effects.wrinkle.lookup import CurveResponse, curve_table, looked_up, weight_path
from wrinklecli.effects.wrinkle.remix import fewest, in_turn, unit_weights

Floats = NDArray[np.float64]

LENGTH = 0.05
STRATEGIES: tuple[Strategy, ...] = ("everywhere", "origin", "both_ends")
PROFILES: tuple[tuple[Profile, tuple[float, ...]], ...] = (
    ("smooth", ()),
    ("cloth", (0.2,)),
    ("smooth", (0.3, 0.2)),
    ("polyline", ()),
    ("polyline", (0.2,)),
)


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


def exactly(curve: ControlCurve, mix: Floats | None = None) -> CurveResponse:
    return CurveResponse(curve, np.arange(curve.greatest_amplitudes.size), mix)


def everywhere(curve: ControlCurve, shortest: float = 0.9, longest: float = 1.2) -> Lengths:
    """Distances at rest lengths between shares of the nominal one, many of them where a group of bumps starts."""
    rng = np.random.default_rng(1)
    shares = np.concatenate([rng.uniform(0, 1.1, 1000), rng.uniform(0, 1, 3000)])
    # Towards the nearest multiple of a full bump, where the next one starts.
    for _ in range(12 if 0 < curve.max_height < np.inf else 0):
        nominal = np.full(len(shares), LENGTH)
        shortenings = curve.shortening(shares * LENGTH, nominal)
        capacities = curve.profile.capacity(curve.intervals(nominal, shortenings), curve.max_height)
        full = np.rint(shortenings / capacities)
        gone = full * capacities / (1 - curve.compressible) / LENGTH
        shares[1000:] = np.maximum(1 - 1e-5 - gone, 0.0)[1000:]
    shares[2000:] *= 1 - 10.0 ** rng.uniform(-9, -2, 2000)
    lengths = LENGTH * rng.uniform(shortest, longest, len(shares))
    return Lengths(shares * lengths, lengths, LENGTH)


def between_rows(rows: Floats) -> Lengths:
    """Distances between rows of a table, all if they are 400, and close behind each: roots start there."""
    some = np.unique(np.linspace(0, len(rows) - 2, 400).astype(int))
    gaps = np.diff(rows)[some, None] * np.concatenate([np.geomspace(1e-9, 0.5, 60), np.linspace(0.5, 1.0, 20)])
    shares = 1.0 - (rows[some, None] + gaps).reshape(-1)
    return Lengths(shares * LENGTH, np.full(len(shares), LENGTH), LENGTH)


def assert_right(response: CurveResponse, lengths: Lengths, error: float = TABLE_ERROR) -> None:
    """The table is off by no more than a ratio of the greatest weight there is, at the same rest length.

    No two rows are nearer than a ten-millionth of the rest length, so what lies as near counts too, where roots start.
    Errors are measured at three points between rows, so that they are 1 % larger at most.
    """
    found = response.table(error).weights(lengths)
    near = [lengths._replace(distances=lengths.distances + off * lengths.rest_lengths) for off in (-1e-7, 0.0, 1e-7)]
    wanted = np.stack([response.weights(each) for each in near])
    greatest = np.abs(response.at(np.linspace(0.0, 1.0, 2001))).max()
    assert wanted.any()
    off = np.maximum(found - wanted.max(axis=0), wanted.min(axis=0) - found).max(axis=1)
    assert (off / lengths.factors).max() <= 1.01 * error * greatest


@pytest.mark.quick(2, 4)
@pytest.mark.parametrize(
    ("height", "kind", "strategy"),
    # Any two of these meet, in a third of all cases.
    [
        (height, kind, STRATEGIES[(row + column) % 3])
        for column, height in enumerate([0.02, 0.4, np.inf])
        for row, kind in enumerate(PROFILES)
    ],
)
def test_weights_that_are_looked_up_are_right_to_the_stated_error_by_few_rows(
    height: float, kind: tuple[Profile, tuple[float, ...]], strategy: Strategy
) -> None:
    response = exactly(planned(strategy, *kind, height))
    rows = response.table().rows
    assert (rows[0], rows[-1]) == (0.0, 1.0)
    assert len(rows) <= 20 + 50 * len(response.curve.groups) * (1 + len(kind[1]))
    assert_right(response, everywhere(response.curve))
    assert_right(response, between_rows(rows))


@pytest.mark.parametrize("compressible", [0.3, 0.95])
@pytest.mark.parametrize("strategy", ["everywhere", "both_ends"])
def test_compressible_tissue_is_looked_up_too(strategy: Strategy, compressible: float) -> None:
    response = exactly(planned(strategy, compressible=compressible))
    assert_right(response, everywhere(response.curve))
    assert_right(response, between_rows(response.table().rows))


@pytest.mark.parametrize(("bumps", "gap"), [(1, 0), pytest.param(64, 1, marks=pytest.mark.slow), (5, 1), (3, 12)])
def test_any_number_of_bumps_with_any_gap(bumps: int, gap: int) -> None:
    response = exactly(planned("origin", bumps=bumps, gap=gap, height=0.25 / bumps))
    assert_right(response, everywhere(response.curve))
    assert_right(response, between_rows(response.table().rows))
    assert len(response.table().rows) < 20 + 50 * bumps


@pytest.mark.slow
@given(
    strategy=st.sampled_from(STRATEGIES),
    kind=st.sampled_from(PROFILES),
    height=st.one_of(st.floats(0.005, 0.5), st.just(np.inf)),
    bumps=st.integers(1, 9),
    gap=st.integers(0, 4),
    compressible=st.floats(0.0, 0.95),
    error=st.sampled_from([TABLE_ERROR, TABLE_ERROR / 10]),
    shares=st.lists(st.floats(0.0, 1.1), min_size=1, max_size=40),
)
def test_any_curve_is_looked_up_as_finely_as_asked(
    strategy: Strategy,
    kind: Any,
    height: float,
    bumps: int,
    gap: int,
    compressible: float,
    error: float,
    shares: list[float],
) -> None:
    curve = planned(strategy, *kind, height, bumps=bumps, gap=gap, compressible=compressible)
    distances = np.array(shares) * LENGTH
    lengths = Lengths(np.append(distances, 0.0), np.full(len(shares) + 1, LENGTH), LENGTH)
    assert_right(exactly(curve), lengths, error)


def sided(response: CurveResponse) -> list[Target]:
    """A target for each shape of the curve, which moves a vertex of its own group, and one that all groups move."""
    count, modes = response.curve.greatest_amplitudes.size, response.curve.greatest_amplitudes.shape[1]
    none = np.zeros(0, np.intp), np.zeros((0, 3))
    shapes = [
        Shape(np.array([number // modes, count]), np.array([[0, 0, 1.0 + number], [0, 0.1, 0]]), 1.0 + number, *none)
        for number in range(count)
    ]
    return [Target(f"wrinkle_{number}", shape) for number, shape in enumerate(shapes)]


def made_fewest(response: CurveResponse, targets: list[Target]) -> Any:
    path, modes = response.mixed(weight_path(response.curve)), response.curve.greatest_amplitudes.shape[1]
    tolerance = 0.2 * max(each.shape.tallest for each in targets)
    found = fewest(targets, path, np.arange(len(targets)) // modes, tolerance)
    return found and found[0]


def made_unit(response: CurveResponse, targets: list[Target]) -> Any:
    """Weights of a strength of -2, the largest of which is 2 otherwise."""
    found = unit_weights(targets, -2.0 * response.mixed(weight_path(response.curve)))
    assert found is not None
    return found[0]


REMIXES: dict[str, Callable[[CurveResponse, list[Target]], Any]] = {
    "unit weights": made_unit,
    "fewest": made_fewest,
    "in turn": lambda response, targets: in_turn(targets, response.columns, response.curve.greatest_amplitudes),
}


# Curves of a polyline with details take five times as long as others, and have most columns with both ends.
@pytest.mark.quick(1, 6)
@pytest.mark.parametrize(
    ("strategy", "kind"),
    [
        *zip(["origin", "both_ends", "both_ends", "origin"], PROFILES[:4], strict=True),
        pytest.param("both_ends", PROFILES[4], marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("name", REMIXES)
def test_other_targets_that_play_the_same_are_looked_up_too(name: str, strategy: Strategy, kind: Any) -> None:
    response = exactly(planned(strategy, *kind, longest=1.0))
    remixed = REMIXES[name](response, sided(response))
    if remixed is None:
        assert name != "in turn"
        return
    mixed = replace(response, mix=remixed[1])
    assert_right(mixed, everywhere(response.curve))
    assert_right(mixed, between_rows(mixed.table().rows))
    if name == "unit weights":
        assert np.abs(2.0 * mixed.table().table).max() <= 1.0 + TABLE_ERROR


def test_targets_may_be_mixtures() -> None:
    curve = planned("both_ends")
    mix = np.array([[1.0, 0.5, 0.0], [0.0, 1.0, -2.0], [0.0, -1.0, 2.0]])
    response, lengths = exactly(curve, mix), everywhere(curve)
    assert response.weights(lengths) == pytest.approx(exactly(curve).weights(lengths) @ mix, abs=1e-12)
    assert_right(response, lengths)


def test_only_shapes_that_move_a_vertex_have_a_column() -> None:
    curve = planned("both_ends")
    whole, lengths = exactly(curve), everywhere(curve)
    some = CurveResponse(curve, np.array([2, 0]))
    assert (some.weights(lengths) == whole.weights(lengths)[:, [2, 0]]).all()
    assert_right(some, lengths)


@pytest.mark.parametrize("longest", [1.0, 1.2])
def test_the_path_of_weights_is_that_of_the_greatest_rest_length(longest: float) -> None:
    """Engines get as many targets, of weights up to 1, as the highest wrinkles need."""
    curve = planned("both_ends", longest=longest)
    path = weight_path(curve)
    shares = np.linspace(0.0, 1.0, 2001)
    lengths = Lengths((1.0 - shares) * longest * LENGTH, np.full(2001, longest * LENGTH), LENGTH)
    assert path.max() == pytest.approx(1.0, abs=1e-9)
    wanted = exactly(curve).weights(lengths)
    assert path.reshape(len(path), -1).max(axis=0) == pytest.approx(wanted.max(axis=0), abs=1e-6)


@pytest.mark.slow
def test_amplitudes_that_are_looked_up_are_those_of_the_curve() -> None:
    curve = planned("both_ends", "polyline", (0.2,))
    lengths = everywhere(curve)
    wanted, _ = curve.follow(lengths.distances, lengths.rest_lengths)
    apart = np.abs(looked_up(curve, lengths) - wanted) / curve.greatest_amplitudes
    assert apart.max() <= 1.2 * TABLE_ERROR
    assert curve_table(curve) is curve_table(curve)


def test_bumps_without_height_stay_flat() -> None:
    curve = planned("origin", height=0.0)
    lengths = Lengths(np.linspace(0.0, LENGTH, 9), np.full(9, LENGTH), LENGTH)
    for response in (exactly(curve), exactly(curve).table()):
        assert not response.weights(lengths).any()


def test_a_stretched_segment_and_one_that_is_hidden_have_no_weights() -> None:
    response = exactly(planned("both_ends"))
    lengths = Lengths(np.array([1.2, 1.3, 5.0, np.inf]) * LENGTH, np.full(4, 1.2 * LENGTH), LENGTH)
    for each in (response, response.table()):
        assert not each.weights(lengths).any()
