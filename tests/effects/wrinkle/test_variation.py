"""Irregular wrinkles: a strict warp of the patch, similar bumps of exact length, the same on every machine."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import chebyshev, legendre

from kit.carried import carry_patch
from kit.drawn import CHARACTERS
from kit.limb import limb_asset, tool
from kit.prepared import prepare
from wrinklecli.drive.stored import TAUT
from wrinklecli.effects.wrinkle.curve import plan_curve
from wrinklecli.effects.wrinkle.lookup import group_starts
from wrinklecli.effects.wrinkle.variation import Variation, attenuation, plan_variation
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.drawn import drawn

NODES, WEIGHTS = legendre.leggauss(200)
# Matrix from values at Chebyshev points to slopes, at the nodes, of the polynomial through them.
POINTS = chebyshev.chebpts2(65)
SLOPES = chebyshev.chebval(NODES, chebyshev.chebder(np.linalg.inv(chebyshev.chebvander(POINTS, 64)))).T


@dataclass(frozen=True)
class Case:
    """A variation and the arguments that it was drawn for."""

    variation: Variation
    amount: float
    gap: int


@st.composite
def cases(draw, *, branching: bool = True) -> Case:
    amount, gap = draw(st.floats(0.01, 1.0)), draw(st.integers(0, 2))
    variation = plan_variation(
        draw(st.text(CHARACTERS, max_size=5)),
        amount,
        draw(st.floats(0.0, 1.0)) if branching else 0.0,
        draw(st.sampled_from([0.0, 0.5, 1.0])) if branching else 0.0,
        bumps=draw(st.integers(1, 12)),
        gap=gap,
        aspect=draw(st.floats(0.05, 4.0)),
        kind=draw(st.sampled_from(["bell", "linear"])),
        strategy=draw(st.sampled_from(["everywhere", "origin", "both_ends"])),
        mirrored=draw(st.booleans()),
    )
    return Case(variation, amount, gap)


def lattice(variation: Variation) -> tuple[Floats, Floats]:
    """(us, lines) u and v all over a patch, its ends and middle among them."""
    us = np.union1d(np.linspace(0.0, 1.0, 301), [*variation.bumps.starts, *variation.bumps.ends])
    return np.meshgrid(us, np.linspace(-1.0, 1.0, 41), indexing="ij")


@given(cases())
def test_no_two_crests_cross_and_borders_stay(case: Case) -> None:
    u, v = lattice(case.variation)
    found, turned = case.variation.places(u, v)
    places, factors = found.us, found.factors
    assert (np.diff(places, axis=0) > 0).all()
    assert (places[[0, -1]] == u[[0, -1]]).all()
    middle = v == 0
    assert (places[middle] == u[middle]).all()
    assert not turned[middle].any()
    edges = zip(case.variation.bumps.starts, case.variation.bumps.ends, strict=True)
    on_bumps = np.any([(u > start) & (u < end) for start, end in edges], axis=0)
    assert (factors[on_bumps & middle] == 1).all()
    assert (factors >= 0).all()
    assert not factors[np.abs(v) == 1].any()
    outside = np.array([-0.5, 1.5])
    assert (case.variation.places(outside, np.ones(2))[0].us == outside).all()


@given(cases(branching=False))
def test_wandering_is_bounded(case: Case) -> None:
    variation = case.variation
    starts, ends = variation.furrows(variation.turned * np.linspace(-1.0, 1.0, 129))
    assert np.abs(starts - variation.bumps.starts[:, None]).max() <= 0.45 * case.amount / len(starts) * (1 + 1e-12)
    assert (ends - starts >= 0.39 * (variation.bumps.ends - variation.bumps.starts)[:, None]).all()
    assert variation.bumps.widths.mean() == pytest.approx(1.0)
    assert np.ptp(variation.bumps.widths) <= 0.71 * case.amount * variation.bumps.widths.max()


@given(
    cases(),
    st.sampled_from(["everywhere", "origin", "both_ends"]),
    st.sampled_from(["smooth", "skin", "cloth"]),
    st.floats(0.01, 0.6),
)
def test_the_line_from_end_to_end_keeps_its_length(case: Case, strategy: Any, profile: Any, shortening: float) -> None:
    """Lengths of the curve as drawn, from a polynomial through it on each half of a bump."""
    variation = case.variation
    curve = plan_curve(
        bumps=len(variation.bumps.widths),
        gap=case.gap,
        strategy=strategy,
        details=(),
        profile=profile,
        max_height=0.3 / len(variation.bumps.widths),
        rest_length=1.0,
        widths=variation.bumps.widths,
        peaks=variation.peaks,
    )
    (amplitudes,), (unabsorbed,) = curve.follow(np.array([1.0 - shortening]), np.ones(1))
    chord = 1.0 - shortening
    starts, ends = variation.bumps.starts, variation.bumps.ends
    length = chord * (1.0 - np.sum(ends - starts))
    middles = (starts + ends) / 2
    for low, high in [*zip(starts, middles, strict=True), *zip(middles, ends, strict=True)]:
        us = np.clip((low + high + (high - low) * POINTS) / 2, low, high)
        heights = np.einsum("gm,gmu->u", amplitudes, curve.shapes(us))
        length += np.sum(WEIGHTS * np.hypot((high - low) * chord / 2, SLOPES @ heights))
    assert length == pytest.approx(TAUT - unabsorbed, abs=1e-9)
    # Shortenings are spread, and some lie close behind the start of a group of bumps.
    shortenings = np.unique(np.clip(group_starts(curve)[:, None] + [0.0, 1e-9, 1e-4, 0.01, 0.1], 0.0, 1.0))
    amplitudes, unabsorbed = curve.follow(1.0 - shortenings, np.ones(len(shortenings)))
    lengths = curve.lengths(amplitudes, np.minimum(1.0 - shortenings, TAUT))
    assert lengths == pytest.approx(TAUT - unabsorbed, abs=1e-9)


@given(cases(), st.sampled_from(["everywhere", "origin", "both_ends"]), st.sampled_from([(), (0.2,), (0.1, 0.3)]))
def test_polylines_keep_their_length_too(case: Case, strategy: Any, details: tuple[float, ...]) -> None:
    """Lengths are exact up to rounding if one mode describes all, and up to the modes' error with details."""
    curve = plan_curve(
        bumps=len(case.variation.bumps.widths),
        gap=case.gap,
        strategy=strategy,
        details=details,
        profile="polyline",
        max_height=0.3 / len(case.variation.bumps.widths),
        rest_length=1.0,
        widths=case.variation.bumps.widths,
    )
    shortenings = np.linspace(0.0, 1.0, 41)
    amplitudes, unabsorbed = curve.follow(1.0 - shortenings, np.ones(41))
    lengths = curve.lengths(amplitudes, np.minimum(1.0 - shortenings, TAUT))
    assert lengths == pytest.approx(TAUT - unabsorbed, abs=1e-3 if details else 1e-12)


@pytest.mark.parametrize("kind", ["bell", "linear"])
@pytest.mark.parametrize("height", ["auto", "5%"])
def test_no_wrinkle_is_higher_than_its_greatest_height(kind: str, height: str) -> None:
    keys = {"attenuation": kind, "max_height": height, "strategy": "origin", "rest_length": "200%"}
    prepared = prepare(limb_asset(rings=15, sides=12), tool(variation=1, seed=3, bumps=4, **keys))
    carried, _ = carry_patch(prepared)
    curve = prepared.patch.curve
    heights = np.einsum("gm,gmv->v", curve.greatest_amplitudes, carried.shapes) * carried.magnitudes
    assert 0.8 * curve.max_height < heights.max() <= curve.max_height * (1 + 1e-3)  # peaks are sampled on lines


def test_a_seed_has_the_mirror_image_on_the_other_side() -> None:
    options = {"bumps": 5, "gap": 1, "aspect": 0.7, "kind": "bell"}
    left = plan_variation("7", 0.8, 0.5, **options)
    right = plan_variation("7", 0.8, 0.5, **options, mirrored=True)
    u, v = lattice(left)
    (one, turned), (other, turned_other) = left.places(u, v), right.places(u, -v)
    assert (turned == turned_other).all()
    assert (one.us == other.us).all()
    assert (one.factors == other.factors).all()
    assert one.joined is not None
    assert other.joined is not None
    assert (one.joined == other.joined).all()
    other = plan_variation("8", 0.8, 0.5, **options)
    assert not np.array_equal(other.bumps.widths, left.bumps.widths)


def heights_of_two(drawn_so: Variation, u: Floats, v: Floats, *, profile: Any, gap: int) -> Floats:
    """The heights of two irregular bumps at places (lines, points) of u and v."""
    curve = plan_curve(
        bumps=2,
        gap=gap,
        strategy="everywhere",
        details=(),
        profile=profile,
        max_height=0.1,
        rest_length=1.0,
        widths=drawn_so.bumps.widths,
        peaks=drawn_so.peaks,
    )
    places = drawn_so.places(u.reshape(-1), v.reshape(-1))[0]
    return np.asarray((places.factors * places.shapes(curve)[0, 0]).reshape(u.shape))


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize(
    ("profile", "gap"),
    [("smooth", 0), ("cloth", 0), ("polyline", 0), ("skin", 1)],
)
def test_the_crests_of_bumps_that_merge_come_together_and_are_one_from_there_on(profile: Any, gap: int) -> None:
    from scipy.signal import find_peaks  # here, as collecting tests would take a second longer

    drawn_so = plan_variation("seven", 0.6, 1.0, bumps=2, gap=gap, aspect=1.0, kind="bell")
    (merger,) = drawn_so.mergers
    lines = np.linspace(0.0, 0.95, 200)
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 801), merger.side * lines)
    heights = heights_of_two(drawn_so, u, v, profile=profile, gap=gap)
    crests = [find_peaks(row, prominence=0.02 * row.max())[0] for row in heights]
    counts = np.array([len(each) for each in crests])
    assert (counts[lines <= merger.start] == 2).all()
    assert (counts[lines >= merger.start + merger.over] == 1).all()
    met = int(np.argmax(counts == 1))
    assert (counts[:met] == 2).all()
    apart = np.array([np.ptp(each) for each in crests[:met]])
    assert apart[-1] < 0.7 * apart[0]
    # Nothing jumps, from line to line or along a line.
    assert np.abs(np.diff(heights, axis=0)).max() < 0.05 * heights.max()
    assert np.abs(np.diff(heights, axis=1)).max() < 0.05 * heights.max()


@given(cases())
def test_joined_bumps_end_as_one_where_the_surface_turns_away(case: Case) -> None:
    u, v = lattice(case.variation)
    _, turned = case.variation.places(u, v)
    lines = case.variation.turned * v
    starts, ends = (each.reshape(-1, *u.shape) for each in case.variation.furrows(lines.reshape(-1)))
    for merger in case.variation.mergers:
        on_both = (merger.share(lines) > 0) & (u > starts[merger.left]) & (u < ends[merger.left + 1])
        both_ways = on_both[1:] & on_both[:-1]
        assert both_ways.any()
        assert not np.diff(turned, axis=0)[both_ways].any()


@pytest.mark.quick(1)
@pytest.mark.parametrize("profile", ["skin", "cloth", "polyline"])
def test_a_furrow_that_fills_up_is_nowhere_steeper_than_an_open_one(profile: Any) -> None:
    """The furrow between two merging crests of nearly ruled bumps ends softly, not like a cut."""
    drawn_so = plan_variation("soft", 1e-6, 1.0, bumps=2, gap=0, aspect=4.0, kind="bell")
    (merger,) = drawn_so.mergers
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 2001), merger.side * np.linspace(merger.start, 0.99, 80))
    heights = heights_of_two(drawn_so, u, v, profile=profile, gap=0)
    open_before, *filling = np.abs(np.diff(heights, axis=1)).max(axis=1)
    assert max(filling) < 1.01 * open_before


@pytest.mark.parametrize(("strategy", "pairs"), [("everywhere", {0, 2}), ("origin", set()), ("both_ends", {1})])
def test_only_bumps_that_rise_together_merge(strategy: Any, pairs: set[int]) -> None:
    made = plan_variation("any", 0.5, 1.0, bumps=4, gap=0, aspect=1.0, kind="bell", strategy=strategy)
    assert {merger.left for merger in made.mergers} == pairs


def test_numbers_hang_on_the_seed_alone() -> None:
    """Numbers are these, whatever the machine and the version of numpy."""
    assert drawn("brow.L", "widths", 2).tolist() == [-0.9309475801023188, 0.5465316222986099]
    spread = drawn("", "any", 10_000)
    assert np.abs(np.histogram(spread, 10, (-1.0, 1.0))[0] - 1000).max() < 120
    assert -1 <= spread.min() < spread.max() < 1


def test_attenuation_is_all_on_the_centre_line_and_nothing_outside() -> None:
    lines = np.array([0.0, 1.0, -1.0, 2.0])
    for kind in ("bell", "linear"):
        assert attenuation(kind, lines).tolist() == [1, 0, 0, 0]


def broken(seed: str, amount: float, *, bumps: int = 5) -> Variation:
    """A variation whose furrows break, and no crests merge for good."""
    return plan_variation(seed, 0.5, 0.0, amount, bumps=bumps, gap=0, aspect=2.0, kind="bell")


def test_the_outer_lines_of_a_broken_tool_end_first_and_none_with_another() -> None:
    plain = np.array([broken(str(seed), 0.0).reaches for seed in range(30)])
    reaches = np.array([broken(str(seed), 1.0).reaches for seed in range(30)])
    middle, outer = reaches[..., 2], reaches[..., [0, -1]]
    assert (reaches <= plain.max()).all()
    assert (middle[..., None] > outer).mean() > 0.9
    assert outer.mean() < 0.7 * middle.mean()
    spread = np.std(reaches, axis=2)
    assert spread.mean() > 1.5 * np.std(plain, axis=2).mean()


def test_a_furrow_breaks_for_a_stretch_and_is_open_on_both_sides_of_it() -> None:
    drawn_so = next(made for seed in range(50) if (made := broken(str(seed), 1.0, bumps=2)).mergers)
    (merger,) = drawn_so.mergers
    middle = (merger.start + merger.over + merger.until) / 2.0
    lines = merger.side * np.array([0.0, merger.start, middle, merger.until + merger.over, 0.99])
    assert merger.share(lines) == pytest.approx([0, 0, 1, 0, 0], abs=1e-12)
    # Between the two crests the skin is nearly as high there as on them.
    us = np.linspace(0.05, 0.95, 181)
    places, _ = drawn_so.places(us, np.full(181, merger.side * middle))
    assert np.allclose(places.joined, 1.0)
    assert np.count_nonzero(np.diff(np.sign(np.diff(places.joined_us)))) == 0


def test_breaks_follow_the_chance_and_leave_other_numbers_as_they_are() -> None:
    whole, half = ([len(broken(str(seed), chance).mergers) for seed in range(60)] for chance in (1.0, 0.5))
    assert set(whole) == {2}, "two of four furrows between five bumps: no bump is in two pairs"
    assert 0.5 < np.mean(half) < 1.9
    narrow = plan_variation("0", 0.5, 0.0, 1.0, bumps=2, gap=0, aspect=0.3, kind="bell")
    assert not narrow.mergers, "no room to merge and part again"
    merging = {"bumps": 5, "gap": 0, "aspect": 1.5, "kind": "bell"}
    plain, some = plan_variation("a", 0.5, 0.6, **merging), plan_variation("a", 0.5, 0.6, 0.0, **merging)
    assert np.array_equal(plain.reaches, some.reaches)
    assert plain.mergers == some.mergers
