"""Players show what the bake shows of contact, from the extras alone: poses, loops, and clips without contact."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.bakes import bake_fold, bake_once, place, report_of
from kit.characters import CHARACTERS
from kit.folds import CLIP, FOLDS, WAVED, waving
from kit.limb import sleeved_limb, tool, write_tools
from kit.looked_up import lookup_gaps
from kit.player import Gltf
from kit.samples import config
from wrinklecli.effects.contact.crease import PlayerError
from wrinklecli.effects.contact.effect import ContactWords

# Greatest difference, as a part of contact's greatest move in the clip.
CLOSE = 0.1
TOOL = tool(bumps=3, max_height="10%", contact="resolve")


def test_a_fold_about_its_axis_looks_alike_in_player_and_bake() -> None:
    (gap,) = lookup_gaps(bake_fold(), "fold").values()
    assert gap.share < CLOSE
    (fold,) = report_of(bake_fold()).data["folds"]
    assert fold["player_error"] == pytest.approx(gap.share, abs=0.03)  # at the times of the bake alone


@pytest.mark.slow
@pytest.mark.long
def test_a_fold_of_two_joints_looks_alike_in_player_and_bake(tmp_path: Path) -> None:
    """A bent elbow presses the cartoon figure's arm where the joint of the armpit is as stored."""
    armpit = {"name": "armpit", "node": "Toon", "origin": [-0.16, 1.28, 0.0], "target": [-0.28, 1.34, 0.0],
              "width": 0.08, "contact": "resolve"}  # fmt: skip
    tools = write_tools(tmp_path / "tools.yaml", armpit, refinement={"max_levels": 1})
    report = wrinklecli.bake(place(CHARACTERS["cartoon"]()), tools, tmp_path / "out.glb", clips=["wave"])
    (gap,), (fold,) = lookup_gaps(Gltf(tmp_path / "out.glb"), "wave").values(), report.data["folds"]
    assert gap.share < 0.05
    assert fold["player_error"] == pytest.approx(gap.share, abs=0.03)
    assert not any("players" in each for each in report.warnings)
    baked = Gltf(tmp_path / "out.glb")
    (stored,) = baked.json["nodes"][baked.node("Toon")]["extras"]["wrinkle"]["folds"]
    assert (stored["joint"], stored["other"]["joint"]) == ("upper_arm.R", "forearm.R")


def test_a_line_says_where_players_cannot_show_what_the_bake_shows() -> None:
    crease: Any = SimpleNamespace(fold=SimpleNamespace(meshes_crossing_themselves=lambda *_: set()))
    errors = {"walk": PlayerError(0.01, 0.2), "wave": PlayerError(0.08, 0.2), "run": PlayerError(0.05, 0.2)}
    words, nothing = ContactWords(crease, ("armpit",), {}, (), errors), cast("Any", None)
    (line,) = words.warnings(nothing, [], "y")
    assert "in 'wave', " in line
    assert line.endswith("are up to 40 % of its greatest move off, by 0.08")
    assert not replace(words, player_errors={"walk": errors["walk"]}).warnings(nothing, [], "y")


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", ["one_sided", "elbow", "finger"])
def test_a_clip_that_was_baked_looks_in_players_as_it_was_baked(name: str) -> None:
    """Rows of the clip bring them within the default of `--max-error`.

    Several joints bend an elbow; a fold whose sides are of one joint turns beyond where its sweep ends.
    """
    gaps = lookup_gaps(FOLDS[name]().baked(), CLIP)
    assert max(each.share for each in gaps.values()) < 0.015, "between frames too"


def test_a_pose_looks_alike_however_the_clip_gets_there() -> None:
    """A closing fold and an opening one differ where skin has slid; loops would jump."""
    body = bake_fold()
    names = body.mesh("limb")["extras"]["targetNames"]
    (fold,) = report_of(body).data["folds"]
    columns = [names.index(name) for name in fold["targets"]]
    times = np.linspace(0.0, 1.0, 21)
    closing, opening = (body.weights("limb", "fold", each)[:, columns] for each in (times, 2.0 - times))
    moved = np.tensordot(closing, body.deltas("limb")[columns], axes=1)
    apart = np.tensordot(closing - opening, body.deltas("limb")[columns], axes=1)
    assert np.linalg.norm(apart, axis=2).max() < CLOSE * np.linalg.norm(moved, axis=2).max()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("kind", ["armpit", "sleeve"])
def test_skin_that_slides_looks_alike_in_player_and_bake(kind: str) -> None:
    """It opens otherwise than it closes: solutions differ by a fifth of contact's greatest move, or by most of it."""
    if kind == "sleeve":
        asset = sleeved_limb(gap=0.05, rings=24, sides=16, angle=45.0)
        even = tool(node="limb", bumps=3, max_height="8%", variation=0.0, contact="resolve")
        body, clip = bake_once(place(asset), even), "fold"
    else:
        body, clip = FOLDS[kind]().baked(), "bend"
    (gap,) = lookup_gaps(body, clip).values()
    assert gap.share < CLOSE


@pytest.mark.slow
@pytest.mark.long
def test_an_elbow_that_comes_back_looks_alike_in_player_and_bake() -> None:
    """The clips of a dressed figure ask for targets of their own, and leave few ways for the skin to open."""
    elbow = {"name": "elbow", "node": "Mesh_0", "origin": [0.36, 1.39, 0.045], "target": [0.54, 1.39, 0.042],
             "width": 0.1, "bumps": 3, "max_height": "10%", "contact": "resolve"}  # fmt: skip
    body = bake_once(place(CHARACTERS["dressed"]()), elbow, max_levels=1, clips=["squat"])
    (gap,) = lookup_gaps(body, "squat").values()
    assert gap.share < CLOSE


@pytest.mark.slow
@pytest.mark.long
def test_the_knee_of_the_sample_looks_alike_in_player_and_bake() -> None:
    """The thigh turns, too, and the knee leans by 12°."""
    tools = config("trousers")
    tools["defaults"]["contact"] = "resolve"
    body = bake_once("trousers", top=tools, only=["knee_out.L", "knee_in.L"], clips=["squat"], max_levels=1)
    (gap,) = lookup_gaps(body, "squat").values()
    assert gap.share < CLOSE


@pytest.mark.slow
@pytest.mark.long
def test_clips_about_leaning_axes_look_alike_in_player_and_bake() -> None:
    body = bake_once(waving(), TOOL, top=WAVED)
    (fold,) = report_of(body).data["folds"]
    gaps = {clip: gap for clip in (f"wave_{k}" for k in range(8)) for gap in lookup_gaps(body, clip).values()}
    assert len(gaps) >= 4
    # Of small moves the keys of a track are off by as much as of large ones.
    assert max(gap.share * gap.largest for gap in gaps.values()) < 0.01 * fold["largest_move"], gaps
