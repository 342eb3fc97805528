"""Folds that are given up: contact is left out whole, with one line, and wrinkles are as without it, or lower."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.asset import Asset, Json, attribute
from kit.bakes import UNREFINED, folding_limb
from kit.limb import limb_asset, tool, write_tools
from kit.muscles import muscle
from kit.player import Gltf
from wrinklecli.baking.report import Report
from wrinklecli.baking.track import track
from wrinklecli.effects.contact import crease, march, tearing
from wrinklecli.effects.contact.solution import Solution
from wrinklecli.effects.contact.tissue import Tissue
from wrinklecli.errors import RefusedError
from wrinklecli.review.crossings import crossings

TOOL: Json = {"bumps": 2, "max_height": "10%"}
NOISE = 0.08


def noisy_limb(size: float = NOISE, seed: int = 3, **options: Any) -> Asset:
    """A limb whose vertices are moved at random, by some scene units in the mean."""
    asset = limb_asset(**{"rings": 14, "sides": 10, "seam": False, "angle": 90.0, **options})
    positions = attribute(asset, 0, "POSITION")
    positions += np.random.default_rng(seed).normal(0.0, size, positions.shape).astype(positions.dtype)
    return asset


def baked(
    folder: Path, contact: str, *, like: Json | None = None, asset: Path | None = None, levels: int = 0
) -> tuple[bytes, Report]:
    entry = tool(**(like or TOOL), contact=contact)
    tools = write_tools(folder / f"{contact}.yaml", entry, refinement={"max_levels": levels})
    report = wrinklecli.bake(asset or folding_limb(), tools, folder / f"{contact}.glb")
    return (folder / f"{contact}.glb").read_bytes(), report


def assert_no_higher(folder: Path, off: bytes, given_up: bytes, line: str, fold: Json) -> None:
    """The file is that of `contact: off`, or its wrinkles are lower, cross less, and a line says so."""
    if not fold["heights"]:
        assert given_up == off
        assert "`contact: off` is the same without this line" in line
        return
    (height,) = fold["heights"].values()
    assert (
        f"; its wrinkles are lowered to {100 * height:.0f} % in the mean, to cross no more than the skin does" in line
    )
    bodies = [Gltf(folder / f"{name}.glb") for name in ("off", "resolve")]
    assert bodies[0].mesh("limb")["extras"] == bodies[1].mesh("limb")["extras"]
    before, after = (each.deltas("limb") for each in bodies)
    sizes, lower = np.linalg.norm(before, axis=2), np.linalg.norm(after, axis=2)
    assert (lower <= sizes + 1e-7).all()
    assert lower.sum() == pytest.approx(height * sizes.sum(), rel=0.2)
    # They are lower, and point the same way.
    assert np.sum(before * after, axis=2) == pytest.approx(sizes * lower, abs=1e-6)
    totals = [crossings(folder / f"{name}.glb").data["clips"][0]["totals"] for name in ("off", "resolve")]
    assert totals[1][-1] < totals[0][-1]


@pytest.mark.slow
def test_a_fold_that_does_not_settle_is_given_up_whole(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(march, "_STEPS", 1)
    given_up, report = baked(tmp_path, "resolve")
    (line,) = (line for line in report.warnings if "contact" in line)
    beginning = "crease: contact is left out of this fold at joint_1: it did not settle where joint_1 turns by -"
    assert line.startswith(beginning)
    assert "; lower or fewer bumps leave more room; " in line
    (fold,) = report.data["folds"]
    assert (fold["tools"], fold["joint"], fold["targets"]) == (["crease"], "joint_1", [])
    assert fold["given_up"]["poses"] > 0
    assert "contact given up in 1 fold" in report.summary
    assert_no_higher(tmp_path, baked(tmp_path, "off")[0], given_up, line, fold)
    # Nothing is left for other clips either.
    (tracked,) = track(tmp_path / "resolve.glb", [folding_limb()], tmp_path / "tracks")
    assert not any("contact" in line for line in tracked.warnings)


def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a fold that settles take too many steps."""
    monkeypatch.setattr(crease, "_MOST_STEPS", 4)
    monkeypatch.setattr(crease, "_MOST_STEPS_PER_POSE", 1)


@pytest.mark.slow
def test_strict_refuses_it_and_what_shows_it_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    few_steps(monkeypatch)
    limb = folding_limb()
    tools = write_tools(tmp_path / "tools.yaml", tool(**TOOL, contact="resolve"), **UNREFINED)
    with pytest.raises(RefusedError, match="contact is left out of this fold"):
        wrinklecli.bake(limb, tools, tmp_path / "out.glb", strict=True)
    assert not (tmp_path / "out.glb").exists()
    assert any("contact is left out" in line for line in crossings(limb, tools).warnings)


def test_a_preview_of_tools_resolves_no_contact(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("wrinklecli.effects.contact.sample.resolve_folds", None)
    tools = write_tools(tmp_path / "tools.yaml", tool(**TOOL, contact="resolve"), **UNREFINED)
    shown = wrinklecli.preview([folding_limb()], tmp_path / "sheet.png", tools=tools, size=(80, 60))
    line = "crease: contact is left out, as a preview of tools is a quick look; a bake has it"
    assert (shown.notes[-1:], shown.warnings) == ((line,), ())


@pytest.mark.slow
def test_a_fold_that_takes_too_many_steps_ends_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    few_steps(monkeypatch)
    bytes_of, report = baked(tmp_path, "resolve")
    (line,) = (line for line in report.warnings if "contact" in line)
    (fold,) = report.data["folds"]
    assert "it took more steps than any fold that settles in 'fold' at " in line
    assert_no_higher(tmp_path, baked(tmp_path, "off")[0], bytes_of, line, fold)


@pytest.mark.slow
def test_wrinkles_are_lowered_beside_effects_that_act_before_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    few_steps(monkeypatch)
    tools = write_tools(tmp_path / "tools.yaml", tool(**TOOL, contact="resolve"), **UNREFINED, muscles=[muscle()])
    report = wrinklecli.bake(folding_limb(), tools, tmp_path / "out.glb")
    (fold,) = report.data["folds"]
    assert 0.0 < fold["heights"]["crease"] < 1.0


@pytest.mark.slow
def test_wrinkles_that_are_projected_in_each_frame_are_lowered_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    few_steps(monkeypatch)
    whole = {"bumps": 3, "max_height": "25%", "name": "whole", "attachment": "patch"}
    _, report = baked(tmp_path, "resolve", like=whole)
    baked(tmp_path, "off", like=whole)
    (fold,) = report.data["folds"]
    assert 0.0 < fold["heights"]["whole"] < 1.0
    files = [Gltf(tmp_path / f"{name}.glb") for name in ("off", "resolve")]
    times = np.linspace(0.0, 2.0, 41)
    # What both files displace over time, in bind space.
    off, lowered = (np.tensordot(each.weights("limb", "fold", times), each.deltas("limb"), axes=1) for each in files)
    sizes, lower = np.linalg.norm(off, axis=2), np.linalg.norm(lowered, axis=2)
    slack = 0.02 * sizes.max()  # both are within a hundredth of the method
    assert (lower <= sizes + slack).all()
    # A displacement points the same way, and is lower by the same factor at a vertex at all times.
    assert np.sum(off * lowered, axis=2) == pytest.approx(sizes * lower, abs=slack * sizes.max())
    tall = sizes.max(axis=0) > 0.3 * sizes.max()
    factors = (sizes * lower).sum(axis=0)[tall] / (sizes**2).sum(axis=0)[tall]
    assert tall.any()
    assert np.abs(lower[:, tall] - factors * sizes[:, tall]).max() < slack
    assert factors.min() < 0.9
    totals = [crossings(tmp_path / f"{name}.glb").data["clips"][0]["totals"] for name in ("off", "resolve")]
    assert totals[1][-1] < totals[0][-1]


@pytest.mark.slow
@pytest.mark.parametrize("in_clip", [True, False])
def test_a_fold_that_tears_is_given_up_in_its_own_motion_or_in_a_clip(
    in_clip: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(tearing, "_LONGEST", 1.001)
    if in_clip:
        monkeypatch.setattr(Solution, "tears", lambda *_: False)
    levels = 0 if in_clip else 1  # shorter edges tear sooner
    bytes_of, report = baked(tmp_path, "resolve", levels=levels)
    (line,) = (line for line in report.warnings if "contact" in line)
    (fold,) = report.data["folds"]
    assert "it would tear the surface " + ("in 'fold' at " if in_clip else "where joint_1 turns by ") in line
    assert_no_higher(tmp_path, baked(tmp_path, "off", levels=levels)[0], bytes_of, line, fold)


FAULTS = ["doubled", "sliver", "coincident", "noise"]


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_degenerate_geometry_ends_no_bake(fault: str, tmp_path: Path) -> None:
    """Each fold has contact, or a reason why not."""
    asset = damaged_limb(fault, 0.5, 1).write(tmp_path / "limb.glb")
    _, report = baked(tmp_path, "resolve", asset=asset)
    for fold in report.data["folds"]:
        assert fold["targets"] or fold["given_up"]["reason"]


def damaged_limb(fault: str, size: float, seed: int) -> Asset:
    """A limb of noise, or some of whose vertices lie on others, or on edges; `size` is a share, or scene units."""
    asset = noisy_limb(size if fault == "noise" else 0.0, seed, angle=120.0, rings=10, sides=8)
    positions, numbers = attribute(asset, 0, "POSITION"), np.random.default_rng(seed)
    chosen = numbers.random(len(positions)) < size
    others = numbers.permutation(len(positions))
    if fault == "coincident":
        positions[chosen] = np.roll(positions, 1, axis=0)[chosen]
    if fault == "doubled":
        positions[chosen] = positions[others][chosen]
    if fault == "sliver":
        middles = (np.roll(positions, 1, axis=0) + np.roll(positions, -1, axis=0)) / 2.0
        positions[chosen] = middles[chosen]
    return asset


def test_triangles_that_touch_at_rest_never_collide() -> None:
    """Two squares, one in the plane of the other, whose edges cross; and two far from them, one above the other."""
    square = np.array([[0.0, 0.0, 0.0], [9.0, 0.0, 0.0], [9.0, 9.0, 0.0], [0.0, 9.0, 0.0]])
    shifts = [0.0, 0.0, 0.0], [4.0, 4.0, 0.0], [0.0, 0.0, 90.0], [0.0, 0.0, 95.0]
    places = np.concatenate([square + shift for shift in shifts])
    triangles = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(4)])
    count = len(places)
    tissue = Tissue(
        places, triangles, np.ones(8, bool), np.ones(count, bool), np.ones(count, bool), np.zeros(count)
    ).without_touching()
    assert tissue.colliding.tolist() == [False] * 4 + [True] * 4
    assert tissue.gaps == pytest.approx((0.7, 0.3))
    assert tissue.without_touching() is tissue
