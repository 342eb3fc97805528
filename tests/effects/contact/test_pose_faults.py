"""Poses in which contact does not count, with one line; wrinkles there are as without contact, or lower."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
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
from wrinklecli.character.clip import Clip
from wrinklecli.effects.contact import march, solution, tearing
from wrinklecli.effects.contact.crease import Crease
from wrinklecli.effects.contact.hinge import STRIDE
from wrinklecli.effects.contact.remaining import FADE as STRIDES
from wrinklecli.effects.contact.tissue import SkinnedPose, SolverState, Tissue
from wrinklecli.errors import RefusedError
from wrinklecli.review.crossings import crossings

TOOL: Json = {"bumps": 2, "max_height": "10%"}
NOISE = 0.08
# Seconds over which contact fades in a limb that is bent by 100° in a second, or by 75° as `folding_limb`.
FADE, SLOWER = (STRIDES * float(np.degrees(STRIDE)) / angle for angle in (100.0, 75.0))
# Seconds between two frames, from the first of which on a fade may begin.
FRAME = 1.0 / 30.0


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


def assert_no_higher(folder: Path, off: bytes, without: bytes, line: str, fold: Json) -> None:
    """The file has no contact; its wrinkles are lower where these crossed more than the skin, and a line says so."""
    (left,) = fold["left"]
    assert line.startswith("crease: contact ")
    assert "): it is left out of this fold" in line
    if left["height"] == 1.0:
        assert without == off
        return
    assert f", and wrinkles are lowered to {100 * left['height']:.0f} %, to cross no more than the skin does" in line
    bodies = [Gltf(folder / f"{name}.glb") for name in ("off", "resolve")]
    assert bodies[0].mesh("limb")["extras"] == bodies[1].mesh("limb")["extras"]
    assert np.array_equal(*(each.deltas("limb") for each in bodies))
    assert_lower(*(each.weights("limb", "fold", np.linspace(0.0, 2.0, 81)) for each in bodies), left["height"])
    totals = [crossings(folder / f"{name}.glb").data["clips"][0]["totals"] for name in ("off", "resolve")]
    assert totals[1][-1] < totals[0][-1]


def assert_lower(off: np.ndarray, lowered: np.ndarray, height: float) -> None:
    """(frames, targets) weights are the same, or lower down to a part of them, and are lower somewhere."""
    slack = 0.01 * off.max()  # either is within a hundredth
    assert (lowered <= off + slack).all()
    assert (lowered >= height * off - slack).all()
    assert (lowered < off - slack).any()


@pytest.mark.slow
def test_a_fold_that_does_not_settle_gets_no_contact(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(march, "_STEPS", 1)
    bytes_of, report = baked(tmp_path, "resolve")
    (line,) = (line for line in report.warnings if "contact" in line)
    assert line.startswith("crease: contact did not settle in 'fold' at ")
    assert ", where joint_1 turns by -" in line
    (fold,) = report.data["folds"]
    assert (fold["tools"], fold["joint"], fold["targets"]) == (["crease"], "joint_1", [])
    assert fold["unsettled_frames"] > 0
    assert "0 of contact in 1 fold" in report.summary
    assert_no_higher(tmp_path, baked(tmp_path, "off")[0], bytes_of, line, fold)
    # Nothing is there for other clips either.
    (tracked,) = track(tmp_path / "resolve.glb", [folding_limb()], tmp_path / "tracks")
    assert not any("contact" in line for line in tracked.warnings)


def never_settles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no fold settle."""
    monkeypatch.setattr(march, "_STEPS", 1)


@pytest.mark.slow
@pytest.mark.long
def test_strict_refuses_it_and_what_shows_it_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    never_settles(monkeypatch)
    limb = folding_limb()
    tools = write_tools(tmp_path / "tools.yaml", tool(**TOOL, contact="resolve"), **UNREFINED)
    with pytest.raises(RefusedError, match="it is left out of this fold"):
        wrinklecli.bake(limb, tools, tmp_path / "out.glb", strict=True)
    assert not (tmp_path / "out.glb").exists()
    assert any("it is left out of this fold" in line for line in crossings(limb, tools).warnings)


@pytest.mark.slow
def test_a_preview_of_tools_resolves_no_contact(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("wrinklecli.effects.contact.sample.resolve_folds", None)
    tools = write_tools(tmp_path / "tools.yaml", tool(**TOOL, contact="resolve"), **UNREFINED)
    shown = wrinklecli.preview([folding_limb()], tmp_path / "sheet.png", tools=tools, size=(80, 60))
    line = "crease: contact is left out, as a preview of tools is a quick look; a bake has it"
    assert (shown.notes[-1:], shown.warnings) == ((line,), ())


@pytest.mark.slow
def test_what_takes_too_many_steps_is_solved_no_further(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The poses up to there stay, and what moves nothing stays as well."""
    monkeypatch.setattr(solution.March, "goes_on", property(lambda self: self.spare < 8))
    _, report = baked(tmp_path, "resolve")
    (line, *_) = (line for line in report.warnings if "contact" in line)
    (fold,) = report.data["folds"]
    assert (
        "crease: contact takes most steps in poses that do not settle, and is solved no further, in 'fold' at" in line
    )
    (left,) = fold["left"]
    assert 0 < fold["unsettled_frames"] == left["poses"]
    assert_ends_as_without(tmp_path)
    assert_no_worse(tmp_path)


def test_steps_in_vain_may_be_as_many_as_others_and_those_of_a_few_poses() -> None:
    nothing: Any = None
    assert [solution.March(nothing, nothing, spare=each).goes_on for each in (100, 0, -128, -129)] == [1, 1, 1, 0]


def assert_ends_as_without(folder: Path) -> None:
    """At rest, at both ends of the clip, contact moves nothing."""
    baked(folder, "off")
    ends = [Gltf(folder / f"{name}.glb").pose("limb", "fold", [0.0, 2.0]) for name in ("off", "resolve")]
    assert np.array_equal(*ends)


def assert_no_worse(folder: Path) -> None:
    """There are no more crossings than without contact."""
    totals = [crossings(folder / f"{name}.glb", fps=15.0).data["clips"][0]["totals"][1] for name in ("off", "resolve")]
    assert totals[1] <= totals[0]


FARTHEST = 95.0


def settles_up_to_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let no pose settle in which a fold is bent further."""
    solve = solution.march

    def solved(tissue: Tissue, poses: Iterable[SkinnedPose], *how: Any) -> Iterator[SolverState]:
        for posed in poses:
            one, other = (posed.matrices[end(tissue.rest[:, 0])] for end in (np.argmin, np.argmax))
            turned = np.degrees(np.arccos((np.trace(other @ one.T) - 1.0) / 2.0))
            (state,) = solve(tissue, [posed], *how)
            yield replace(state, converged=state.converged and turned <= FARTHEST)

    monkeypatch.setattr(solution, "march", solved)


@pytest.mark.slow
@pytest.mark.long
def test_poses_that_settle_are_kept_beside_others(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A limb whose contact does not settle at its deepest bend had none at all, in any clip."""
    settles_up_to_there(monkeypatch)
    limb = limb_asset(angle=100.0, rings=16, sides=10).write(tmp_path / "limb.glb")
    _, report = baked(tmp_path, "resolve", asset=limb)
    (fold,) = report.data["folds"]
    (left,) = fold["left"]
    least, greatest = left["degrees"]
    assert least == pytest.approx(-100.0, abs=0.1)
    assert -FARTHEST - 3.0 < greatest < -FARTHEST
    line = next(line for line in report.warnings if "contact" in line)
    beginning = f"crease: contact did not settle in 'fold' at {left['begin']:.3g} to {left['end']:.3g} s"
    assert line.startswith(f"{beginning}, where joint_1 turns by -100 to {greatest:.0f}° ({left['poses']} poses): it ")
    # Poses that settle cross nothing, but for a few beside the others, while contact fades.
    (clip,) = crossings(tmp_path / "resolve.glb", fps=30.0).data["clips"]
    times, counts = np.array(clip["times"]), np.array(clip["counts"])
    apart = np.minimum(np.abs(times - left["begin"]), np.abs(times - left["end"]))
    outside = (times < left["begin"]) | (times > left["end"])
    settled = outside & (apart > 2.0 * FADE)
    baked(tmp_path, "off", asset=limb)
    without = np.array(crossings(tmp_path / "off.glb", fps=30.0).data["clips"][0]["counts"][1])
    assert without[settled].any()
    assert (counts[1, ~outside] <= without[~outside]).all()
    assert not counts[1, settled].any()
    assert counts[1].sum() < 0.8 * sum(clip["level"])


@pytest.mark.slow
@pytest.mark.long
def test_wrinkles_are_lowered_only_where_contact_fades(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    settles_up_to_there(monkeypatch)
    limb = limb_asset(angle=100.0, rings=16, sides=10).write(tmp_path / "limb.glb")
    files = []
    for contact in ("off", "resolve"):
        _, report = baked(tmp_path, contact, asset=limb, like={"bumps": 3, "max_height": "25%"})
        files.append(Gltf(tmp_path / f"{contact}.glb"))
    (left,) = report.data["folds"][0]["left"]
    assert left["faded"]
    assert left["height"] < 1.0
    assert any(
        f"wrinkles are lowered to {100 * left['height']:.0f} %, to cross no more than the skin does" in line
        for line in report.warnings
    )
    times = np.linspace(0.0, 2.0, 81)
    names = [name for name in files[0].mesh("limb")["extras"]["targetNames"] if "contact" not in name]
    heights = []
    for file in files:
        columns = [file.mesh("limb")["extras"]["targetNames"].index(name) for name in names]
        heights.append(file.weights("limb", "fold", times)[:, columns])
    inside = (times >= left["begin"]) & (times <= left["end"])
    outside = (times < left["begin"] - FADE - FRAME) | (times > left["end"] + FADE + FRAME)
    slack = 0.01 * heights[0].max()  # either is within a hundredth
    assert heights[1][outside] == pytest.approx(heights[0][outside], abs=slack)
    assert heights[1][inside] == pytest.approx(left["height"] * heights[0][inside], abs=slack)
    # Nothing jumps: a frame changes a weight by no more than a fade does, and the bend itself.
    steps = [float(np.abs(np.diff(each, axis=0)).max()) for each in heights]
    assert steps[1] <= steps[0] + heights[0].max() * (times[1] - times[0]) / FADE + slack


@pytest.mark.slow
@pytest.mark.long
def test_wrinkles_are_lowered_beside_effects_that_act_before_them(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    never_settles(monkeypatch)
    tools = write_tools(tmp_path / "tools.yaml", tool(**TOOL, contact="resolve"), **UNREFINED, muscles=[muscle()])
    report = wrinklecli.bake(folding_limb(), tools, tmp_path / "out.glb")
    (fold,) = report.data["folds"]
    assert 0.0 < fold["left"][0]["height"] < 1.0


@pytest.mark.slow
@pytest.mark.long
def test_wrinkles_that_are_projected_in_each_frame_are_lowered_too(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    never_settles(monkeypatch)
    whole = {"bumps": 3, "max_height": "25%", "name": "whole", "attachment": "patch"}
    _, report = baked(tmp_path, "resolve", like=whole)
    baked(tmp_path, "off", like=whole)
    (fold,) = report.data["folds"]
    assert 0.0 < fold["left"][0]["height"] < 1.0
    files = [Gltf(tmp_path / f"{name}.glb") for name in ("off", "resolve")]
    times = np.linspace(0.0, 2.0, 41)
    # What both files displace over time, in bind space.
    off, lowered = (np.tensordot(each.weights("limb", "fold", times), each.deltas("limb"), axes=1) for each in files)
    sizes, lower = np.linalg.norm(off, axis=2), np.linalg.norm(lowered, axis=2)
    slack = 0.02 * sizes.max()  # both are within a hundredth of the method
    assert (lower <= sizes + slack).all()
    # A displacement points the same way, and all are lower by the same factor at a time.
    assert np.sum(off * lowered, axis=2) == pytest.approx(sizes * lower, abs=slack * sizes.max())
    tall = sizes.max(axis=1) > 0.3 * sizes.max()
    factors = (sizes * lower).sum(axis=1)[tall] / (sizes**2).sum(axis=1)[tall]
    assert tall.any()
    assert np.abs(lower[tall] - factors[:, None] * sizes[tall]).max() < slack
    assert factors.min() < 0.9
    totals = [crossings(tmp_path / f"{name}.glb").data["clips"][0]["totals"] for name in ("off", "resolve")]
    assert totals[1][-1] < totals[0][-1]


@pytest.mark.slow
def test_a_fold_that_tears_at_once_gets_no_contact(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(tearing, "_LONGEST", 1.0)
    bytes_of, report = baked(tmp_path, "resolve", levels=1)  # shorter edges tear sooner
    (line,) = (line for line in report.warnings if "contact" in line)
    (fold,) = report.data["folds"]
    assert line.startswith("crease: contact would tear the surface in 'fold' at ")
    assert_no_higher(tmp_path, baked(tmp_path, "off", levels=1)[0], bytes_of, line, fold)


@pytest.mark.slow
@pytest.mark.long
def test_contact_fades_where_its_shapes_tear_the_surface_in_a_clip(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    torn = Crease.torn_frames

    def torn_at_one(self: Crease, clip: Clip, times: np.ndarray, *more: Any) -> set[int]:
        return torn(self, clip, times, *more) | {int(np.argmin(np.abs(times - 1.0)))}

    monkeypatch.setattr(Crease, "torn_frames", torn_at_one)
    _, report = baked(tmp_path, "resolve")
    (fold,) = report.data["folds"]
    assert any("crease: contact would tear the surface in 'fold' at 1 s" in line for line in report.warnings)
    baked(tmp_path, "off")
    assert_no_worse(tmp_path)
    moves = moves_by_contact(tmp_path / "resolve.glb", fold)
    monkeypatch.undo()
    whole = moves_by_contact(tmp_path / "resolve.glb", baked(tmp_path, "resolve")[1].data["folds"][0])
    assert moves[1] < 0.01 * whole[1]
    assert moves[[0, 2]] == pytest.approx(whole[[0, 2]], rel=0.05)


def moves_by_contact(path: Path, fold: Json) -> np.ndarray:
    """(3,) greatest moves at 1 s, when the limb is bent most, and before and after a fade."""
    file = Gltf(path)
    names = file.mesh("limb")["extras"]["targetNames"]
    columns = [names.index(name) for name in fold["targets"]]
    times = 1.0 + (SLOWER + FRAME) * np.array([-1.0, 0.0, 1.0])
    weights = file.weights("limb", "fold", times)[:, columns]
    return np.asarray(np.linalg.norm(np.tensordot(weights, file.deltas("limb")[columns], axes=1), axis=2).max(axis=1))


FAULTS = ["doubled", "sliver", "coincident", "noise"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_degenerate_geometry_ends_no_bake(fault: str, tmp_path: Path) -> None:
    """Each fold has contact, or a reason why not."""
    asset = damaged_limb(fault, 0.5, 1).write(tmp_path / "limb.glb")
    _, report = baked(tmp_path, "resolve", asset=asset)
    for fold in report.data["folds"]:
        assert fold["targets"] or fold["left"]


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
    ).ready()
    assert tissue.colliding.tolist() == [False] * 4 + [True] * 4
    assert tissue.gaps == pytest.approx((0.7, 0.3))
    assert np.array_equal(tissue.ready().colliding, tissue.colliding)


@pytest.mark.slow
def test_a_surface_without_an_answer_gets_no_contact(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def degenerate(_: Tissue) -> Tissue:
        raise np.linalg.LinAlgError

    monkeypatch.setattr(Tissue, "ready", degenerate)
    bytes_of, report = baked(tmp_path, "resolve")
    (line,) = (line for line in report.warnings if "contact" in line)
    (fold,) = report.data["folds"]
    assert (fold["moved_vertices"], fold["targets"]) == (0, [])
    assert "; contact leaves crossings in 'fold': " in line
    assert line.endswith("the surface is degenerate, or touches itself everywhere at rest: mend the mesh there")
    assert_no_higher(tmp_path, baked(tmp_path, "off")[0], bytes_of, line, fold)
