"""Contact in clips and poses of any kind: one key, steps, loops, folds that begin closed, clips of other files."""

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.asset import Asset, Interpolation
from kit.bakes import UNREFINED, bake_once, place, report_of
from kit.limb import limb_asset, nose, tool, write_tools
from kit.player import Gltf
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.contact.crease import MarchedClip, march_clip
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.contact.system import with_crossings
from wrinklecli.effects.effect import SamplingOptions
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.numeric.guard import log_progress
from wrinklecli.review.crossings import crossings

CLOSED = 75.0
TOOL = tool(bumps=3, max_height="10%", contact="resolve")
# By clip: seconds, degrees and interpolation.
CLIPS: dict[str, tuple[Sequence[float], Sequence[float], Interpolation]] = {
    "one key": ([0.5], [CLOSED], "LINEAR"),
    "one key at 0": ([0.0], [CLOSED], "LINEAR"),
    "two float32 steps": ([0.5, float(np.nextafter(np.float32(0.5), np.float32(1.0)))], [0.0, CLOSED], "LINEAR"),
    "never moves": ([0.0, 1.0], [0.0, 0.0], "LINEAR"),
    "held closed": ([0.0, 1.0], [CLOSED, CLOSED], "LINEAR"),
    "closed at 0": ([0.0, 0.5, 1.0], [CLOSED, 0.0, CLOSED], "LINEAR"),
    "steps": ([0.0, 0.5, 1.0, 1.5], [0.0, CLOSED, 0.0, CLOSED], "STEP"),
    "deeper at once": ([0.0, 0.5, 1.0], [60.0, 100.0, 0.0], "STEP"),
    "deep at 0": ([0.0, 1.0], [100.0, 0.0], "LINEAR"),
    "in 4 ms": ([0.0, 0.004], [0.0, CLOSED], "LINEAR"),
    "stays open": ([0.0, 0.1, 1.0], [0.0, 40.0, 0.0], "LINEAR"),
}
OPEN = {"never moves", "stays open"}


def turned(degrees: float) -> list[float]:
    half = np.radians(degrees) / 2.0
    return [0.0, 0.0, float(np.sin(half)), float(np.cos(half))]


def with_clips(*names: str) -> Asset:
    asset = limb_asset(clip=None, rings=12, sides=8)
    for name in names:
        times, degrees, interpolation = CLIPS[name]
        animation: dict[str, Any] = {"name": name}
        asset.channel(animation, 2, "rotation", times, [turned(each) for each in degrees], interpolation)
        asset.append("animations", animation)
    return asset


@cache
def still_limb() -> Path:
    return place(with_clips("never moves"))


@cache
def baked() -> Gltf:
    return bake_once(place(with_clips(*CLIPS)), TOOL, top={**UNREFINED, "sampling": {"fps": 15}})


@pytest.mark.slow
@pytest.mark.long
def test_no_clip_crosses_whatever_its_keys_are() -> None:
    clips = crossings(baked().path).data["clips"]
    found = {clip["name"]: clip["totals"] for clip in clips}
    assert set(found) == set(CLIPS)
    # No player shows a moment between two float32 steps.
    (stepping,) = (clip for clip in clips if clip["name"] == "two float32 steps")
    found["two float32 steps"] = [each[-1] for each in stepping["counts"]]
    assert all(after == 0 for _, after in found.values()), found
    assert {name for name, (before, _) in found.items() if not before} == OPEN
    (fold,) = report_of(baked()).data["folds"]
    assert not fold["left"]
    names = baked().mesh("limb")["extras"]["targetNames"]
    for clip in OPEN:
        weights = baked().weights("limb", clip, np.linspace(0.0, 1.0, 21))
        assert not weights[:, [names.index(name) for name in fold["targets"]]].any()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("motions", [{"pose": [("joint_1", "z", CLOSED)]}, {"range_of_motion": True}, {"anims": True}])
def test_a_baked_file_plays_contact_in_motions_that_are_added(motions: dict[str, Any], tmp_path: Path) -> None:
    body = bake_once(still_limb(), TOOL, top=UNREFINED)
    if "anims" in motions:
        motions = {"anims": [with_clips("one key", "closed at 0").write(tmp_path / "anim.glb")]}
    motions = {**motions, "fps": 8.0}  # `test_no_clip_crosses_whatever_its_keys_are` looks at the moments between
    found = crossings(body.path, **motions).data["clips"]
    folding = [clip for clip in found if clip["totals"][0] > 0]
    assert folding
    asset = crossings(still_limb(), **motions).data["clips"]
    assert [clip["counts"][0] for clip in found] == [clip["counts"][0] for clip in asset]
    about = [clip for clip in folding if "range_of_motion" not in motions or clip["name"] == "joint_1 about z, +90°"]
    assert about
    assert all(clip["totals"][1] == 0 for clip in about), about
    # What is told of tools is the same for all motions: contact is solved anew in the shortest alone.
    entry = {**TOOL, "contact": "resolve" if "pose" in motions else "off"}
    tools = write_tools(tmp_path / "tools.yaml", entry, **UNREFINED)
    wrinkled = crossings(still_limb(), tools, **motions).data["clips"]
    assert [clip["name"] for clip in wrinkled] == [clip["name"] for clip in found]


@pytest.mark.slow
@pytest.mark.long
def test_a_clip_without_contact_is_sampled_as_ever(tmp_path: Path) -> None:
    """At further times the proof finds what it has not looked at otherwise, and crossing tools were refused there."""
    times = []
    for contact in ("resolve", "off"):
        asset = with_clips("stays open").write(tmp_path / "limb.glb")
        tools = write_tools(tmp_path / f"{contact}.yaml", {**TOOL, "contact": contact}, **UNREFINED)
        job = read_job(asset, tools, BakeOptions())
        (plan,) = plan_meshes(job)
        how = SamplingOptions(30.0, "morph", job.document.memory, log_progress)
        effects, (motion,) = sample_effects(plan, job.clips, how)
        assert len(effects) == (2 if contact == "resolve" else 1)
        times.append(motion.times)
    assert np.array_equal(*times)


@pytest.mark.slow
@pytest.mark.long
def test_a_file_of_frames_has_contact_in_a_clip_of_one_key(tmp_path: Path) -> None:
    asset = with_clips("one key", "steps").write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", TOOL, **UNREFINED)
    wrinklecli.bake(asset, tools, tmp_path / "out.glb", mode="frames")
    assert all(clip["totals"] == [0] for clip in crossings(tmp_path / "out.glb").data["clips"])


@pytest.mark.slow
@pytest.mark.long
def test_a_morph_target_may_raise_a_fold_in_clips_of_any_kind() -> None:
    asset = nose()
    for name, times, weights, interpolation in (
        ("one key", [0.3], [1.0], "LINEAR"),
        ("raised at 0", [0.0, 1.0], [1.0, 0.0], "LINEAR"),
        ("steps", [0.0, 0.5, 1.0], [0.0, 1.0, 0.0], "STEP"),
        ("still", [0.0, 1.0], [0.0, 0.0], "LINEAR"),
    ):
        animation: dict[str, Any] = {"name": name}
        asset.channel(animation, 0, "weights", times, np.array(weights)[:, None], interpolation)
        asset.append("animations", animation)
    bridge = {"name": "bridge", "node": "skin", "origin": [-0.5, 0, 0], "target": [0.5, 0, 0], "width": 0.8, "bumps": 4}
    top = {**UNREFINED, "sampling": {"fps": 15}}
    body, off = (bake_once(place(asset), {**bridge, "contact": each}, top=top) for each in ("resolve", "off"))
    counts = [{clip["name"]: clip["totals"][1] for clip in crossings(each.path).data["clips"]} for each in (body, off)]
    assert set(counts[0].values()) == {0}, counts
    assert {name for name, count in counts[1].items() if count} == {"sneer", "one key", "raised at 0", "steps"}
    posed = crossings(body.path, morphs=[("squeeze", 1.0)]).data["clips"]
    assert posed[0]["totals"][1] == 0


@pytest.mark.slow
def test_poses_between_solved_ones_are_not_solved_and_cross_nothing(tmp_path: Path) -> None:
    """A clip folds the limb slowly, and back through the same poses."""
    marched = _marched(tmp_path, [0.0, 2.0, 4.0], [turned(each) for each in (0.0, 100.0, 0.0)])
    touching = [marched.solutions[frame] for frame in marched.touching]
    solved = [each for each in touching if each.between is None]
    assert not any(each.crosses_itself for each in touching)
    assert len(touching) > 30
    # On the way back there are none, but where it ends to touch.
    assert len(solved) < len(touching) / 2


@pytest.mark.slow
def test_poses_that_are_alike_share_a_solution(tmp_path: Path) -> None:
    """A clip holds the limb bent, and shakes it a little about all axes."""
    shaken = np.random.default_rng(1).normal(0.0, 0.002, (60, 4)) + turned(90.0)
    times = [0.0, *np.linspace(1.0, 4.0, 60).tolist()]
    marched = _marched(tmp_path, times, [turned(0.0), *(each / np.linalg.norm(each) for each in shaken)])
    shared = [found for frame, found in marched.solutions.items() if marched.times[frame] >= 1.0]
    assert len(shared) == 91
    assert not any(each.crosses_itself for each in shared)
    assert sum(each.between is None for each in shared) < 10
    between = [each.between for each in shared if each.between is not None]
    assert any(one == two for one, two, _ in between)
    moves = np.array([each.moved for each in shared])
    # Nothing pops from frame to frame.
    apart = np.sqrt(np.sum(np.diff(moves, axis=0) ** 2, axis=2)).max()
    assert apart < 0.1 * np.sqrt(np.sum(moves**2, axis=2)).max()


def _marched(folder: Path, times: Sequence[float], rotations: Sequence[Any]) -> MarchedClip:
    """A clip of 4 s that turns the limb's joint, solved at 30 frames a second."""
    asset, clip = limb_asset(clip=None, rings=12, sides=8), dict[str, Any](name="slow")
    asset.channel(clip, 2, "rotation", times, np.array(rotations), "LINEAR")
    asset.append("animations", clip)
    tools = write_tools(folder / "tools.yaml", TOOL, **UNREFINED)
    job = read_job(asset.write(folder / "limb.glb"), tools, BakeOptions())
    (plan,) = plan_meshes(job)
    contact = plan.layer(ContactLayer)
    assert contact is not None
    return march_clip(with_crossings(contact.folds[0], []), job.clips[0], np.linspace(0.0, 4.0, 121))
