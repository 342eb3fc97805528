"""Suggested tools are looked at, and those that are not worth it are left out, each for its reason."""

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from kit import characters
from kit.limb import limb
from kit.samples import sample
from kit.sheet import line
from kit.sheet import sheet as sheet_of
from kit.suggested import run, squeezed, suggest_once
from wrinklecli.character.clip import read_clips
from wrinklecli.gltf.document import read_document
from wrinklecli.review.check import check
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.stage import StagedTool
from wrinklecli.review.suggest.suggest import suggest
from wrinklecli.review.suggest.text import file_text
from wrinklecli.review.suggest.trial import TriedAsset
from wrinklecli.review.suggest.worth import Judge, Worthwhile, _bends
from wrinklecli.tools.records import Length, RefinementSettings, WrinkleTool

sheet = partial(sheet_of, smooth=True)
FLAT = line(-0.5, 0.5)
# Longer than the ribbon, as a view from the side would look under it.
ROOF = line(-3.0, 3.0, 0.05)


def suggestion(name: str = "fold", *, start: float = -0.4, stop: float = 0.4, height: float = 4.0) -> Suggestion:
    """A tool on a sheet, of a height in per cent of its length."""
    tool = WrinkleTool(
        name=name,
        origin=(start, 0.0, 0.0),
        target=(stop, 0.0, 0.0),
        width=Length(0.5),
        bumps=4,
        strategy="everywhere",
        max_height=Length(height, percent=True),
    )
    return squeezed(tool, stop - start)


def judged(path: Path, *tools: Suggestion, count: int = 8, everything: bool = False) -> Worthwhile:
    document = read_document(path)
    refinement = RefinementSettings(scheme="midpoint")
    return Judge(TriedAsset(document, read_clips(document)), everything).worthwhile(tools, refinement, count=count)


def reasons(found: Worthwhile) -> list[tuple[str, str]]:
    return [(each.name, each.reason) for each in found.dropped]


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("reason", "profiles", "tool"),
    [
        ("hardly seen", [FLAT], suggestion(height=0.3)),
        ("hardly seen", [FLAT, ROOF], suggestion(height=2.0)),
        ("hardly seen", [FLAT, line(-0.5, 0.5, 0.02)], suggestion(height=2.0)),
        ("not raised", [FLAT], replace(suggestion(), time=0.0)),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_what_is_not_worth_it_is_left_out_for_its_reason(
    tmp_path: Path, reason: str, profiles: Sequence[np.ndarray], tool: Suggestion
) -> None:
    path = sheet(tmp_path / "a.glb", *profiles)
    found = judged(path, tool)
    assert not found.kept
    assert reasons(found) == [("fold", reason)]
    (summary,) = found.summary
    assert summary == f"'sheet': left out 1 tool not worth it: 1 {reason}; -v says more"
    assert [each.tool for each in judged(path, tool, everything=True).kept] == [tool.tool]


def staged(profile: Sequence[tuple[float, float]], *, radius: float = math.inf) -> StagedTool:
    """A tool along a profile of x and z with equal parts of u, drawn out along y, or around a limb of a radius."""
    us, vs = (each.ravel() for each in np.meshgrid(np.linspace(0.0, 1.0, 21), np.linspace(-1.0, 1.0, 21)))
    places = np.linspace(0.0, 1.0, len(profile))
    xs, zs = (np.interp(us, places, each) for each in np.transpose(profile))
    points = np.stack([xs, 0.4 * vs, zs], axis=1)
    if radius < math.inf:
        points = np.stack([xs, radius * np.sin(0.4 * vs / radius), zs + radius * np.cos(0.4 * vs / radius)], axis=1)
    firsts = 21 * np.arange(20)[:, None] + np.arange(20)
    triangles = (firsts[..., None, None] + np.array([(0, 1, 21), (1, 22, 21)])).reshape(-1, 3)
    on = np.ones(len(triangles), np.bool_)
    return StagedTool(points, points, points, points, triangles, on, False, np.stack([us, vs], axis=1), 4)


SHUT = [(-0.02, 1.2), (0.03, 0.85), (0.08, 0.5), (-0.3, 0.0)]


@pytest.mark.parametrize(
    ("profile", "radius", "closed", "around"),
    [
        ([(0.0, 0.0), (1.0, 0.0)], math.inf, 0.5, 0.5),
        ([(0.0, 0.0), (1.0, 0.0)], 0.3, 0.5, 0.91),
        ([(0.0, 1.0), (0.5, 0.5), (1.0, 1.0)], math.inf, 0.85, 0.5),
        # Its ends, which face each other, have passed each other.
        ([*SHUT, *((-x, z) for x, z in SHUT[::-1])], math.inf, 1.0, 0.5),
        ([(0.17, 1.0), (0.0, 0.0), (0.3, 0.0), (0.13, 1.0)], math.inf, 0.99, 0.5),
    ],
    ids=["plane", "limb", "valley", "shut", "by more than half a turn"],
)
def test_a_fold_closes_and_reaches_around_a_limb(
    profile: Sequence[tuple[float, float]], radius: float, closed: float, around: float
) -> None:
    found = _bends(staged(profile, radius=radius), limb=True)
    assert found["closed"] == pytest.approx(closed, abs=0.02)
    assert found["around"] == pytest.approx(around, abs=0.02)
    assert all(math.isnan(each) for each in _bends(staged(profile), limb=False).values())


def test_what_is_seen_and_harms_nothing_is_kept(tmp_path: Path) -> None:
    """A layer under the wrinkles hides nothing and is not crossed."""
    found = judged(sheet(tmp_path / "a.glb", FLAT, line(-0.5, 0.5, -0.3)), suggestion())
    assert [each.tool for each in found.kept] == [suggestion().tool]
    assert not found.dropped
    assert not found.summary


@pytest.mark.slow
def test_furrows_of_skin_may_become_wide_ones(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", rings=24, sides=16)
    (found,) = suggest(path, everything=True, count=1).tools
    assert found.tool.profile == "skin"
    smoother = found.others[-1]
    assert smoother.tool.profile == "smooth"
    (tmp_path / "tools.yaml").write_text(file_text([smoother.entry]))
    assert not check(path, tmp_path / "tools.yaml").warnings


@pytest.mark.slow
def test_the_next_best_take_the_place_of_what_is_left_out(tmp_path: Path) -> None:
    path = sheet(tmp_path / "a.glb", FLAT)
    flat = suggestion("flat", start=-0.4, stop=-0.05, height=0.2)
    tall, taller = (suggestion(name, start=0.05, stop=0.4, height=8.0) for name in ("tall", "taller"))
    found = judged(path, flat, tall, taller, count=1)
    assert reasons(found) == [("flat", "hardly seen")]
    assert [each.tool.name for each in found.kept] == ["tall"]


@pytest.mark.slow
@pytest.mark.parametrize("one_sided", [True, False])
def test_the_twin_of_a_one_sided_clip_stays_and_the_file_says_so(tmp_path: Path, one_sided: bool) -> None:
    pair = replace(suggestion("fold.L", start=0.05, stop=0.4, height=8.0), mirrored=True, one_sided=one_sided)
    (kept,) = judged(sheet(tmp_path / "a.glb", FLAT), pair).kept
    assert (
        "# fold.R, which mirror makes, is there for other clips: none here raises it" in file_text([kept.entry])
    ) is one_sided


@pytest.mark.slow
@pytest.mark.long
def test_facets_leave_a_tool_out_and_the_command_says_why(tmp_path: Path) -> None:
    flat, smooth = (
        limb(tmp_path / f"{normals}.glb", rings=16, sides=10, angle=50.0, normals=normals) for normals in (False, True)
    )
    assert suggest(smooth, count=1).tools
    result = run(flat, "--json")
    assert result.exit_code == 1
    (dropped,) = json.loads(result.stdout)["dropped"]
    assert list(dropped) == ["name", "reason", "value"]
    assert (dropped["name"], dropped["reason"]) == ("joint_1", "faceted")
    assert dropped["value"] < 0.5
    assert "left out joint_1: it lies on facets: " in run(flat, "-v").stderr
    assert "left out joint_1" not in run(flat).stderr
    assert "  # Left out without --all: it lies on facets: " in run(flat, "--all", "-q").stdout


@pytest.mark.slow
@pytest.mark.long
def test_a_limb_of_few_faces_scores_less_than_one_of_many(tmp_path: Path) -> None:
    coarse, fine = (
        suggest(limb(tmp_path / f"{sides}.glb", rings=rings, sides=sides, angle=110.0), count=1, everything=True).tools
        for rings, sides in ((7, 8), (60, 24))
    )
    assert coarse[0].judgement is not None
    assert fine[0].judgement is not None
    assert coarse[0].judgement.keep < fine[0].judgement.keep
    assert fine[0].judgement.is_kept


@pytest.mark.slow
@pytest.mark.long
def test_several_processes_propose_the_same(tmp_path: Path) -> None:
    asset = characters.tubes().write(tmp_path / "tubes.glb")
    one, two = (suggest(asset, jobs=jobs) for jobs in (1, 2))
    assert (one.text, one.dropped, one.notes) == (two.text, two.dropped, two.notes)
    assert one.tools


@pytest.mark.slow
def test_a_note_says_what_the_assets_own_targets_take_for_new_vertices() -> None:
    found = suggest_once(sample("head"))
    own = sum(each.own_bytes for each in found.tools)
    assert own > 0
    (note,) = (note for note in found.notes if "own morph targets" in note)
    assert f"{own / 1e6:.1f} MB more" in note
