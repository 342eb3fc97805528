"""Intersections that contact leaves in a clip: numbers as of `check --crossings`, and a line with a hint."""

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

import wrinklecli
from kit.bakes import place
from kit.characters import CHARACTERS
from kit.creases import resolved
from kit.limb import limb, tool, write_tools
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.drive.drive import Drive
from wrinklecli.effects.contact.crease import PlayerError, march_clip
from wrinklecli.effects.contact.effect import ContactWords, contact_effect
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.contact.pose_faults import TORN, WORSE
from wrinklecli.effects.contact.remaining import FADE, _state, nearness, shown_in
from wrinklecli.review.crossings import crossings

# So low that the wrinkles cross no more than the skin.
TOOL = tool(bumps=3, max_height="0.1%")
TIMES = np.linspace(0.0, 1.0, 16)


@pytest.mark.slow
@pytest.mark.long
def test_contact_fades_in_frames_in_which_it_would_cross_more(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb", angle=80.0, rings=16, sides=10)
    files = [
        write_tools(tmp_path / f"{name}.yaml", {**TOOL, "contact": contact}, refinement={"max_levels": 0})
        for name, contact in (("shared", {"per_clip": False}), ("off", "off"))
    ]
    job = read_job(str(asset), str(files[0]), BakeOptions())
    (plan,) = plan_meshes(job)
    contact, (clip,) = plan.layer(ContactLayer), job.clips
    assert contact is not None
    (fold,) = contact.folds
    crease = resolved(fold, most=7)
    followed = crease.follow(march_clip(crease.fold, clip, TIMES))
    assert not followed.faults
    shown = shown_in([crease], [followed], [], [crease.fold])
    assert shown.remaining == (None,)
    assert (shown.heights.weights == 1.0).all()
    assert np.array_equal(shown.followed[0].weights, followed.weights)
    error = crease.player_error(followed, scale=1.0)
    assert error.share < 0.1
    assert not error.silent
    # Where other joints keep the sides apart, players are nearer to the bake without contact.
    apart = replace(followed, weights=np.zeros_like(followed.weights))
    assert crease.player_error(apart, scale=1.0) == PlayerError(0.0, 0.0, silent=True)

    # A fit that presses what touches further in.
    pressed = shown_in([crease], [replace(followed, weights=-followed.weights)], [], [crease.fold])
    (own,), (left,) = pressed.followed, pressed.remaining
    assert left is not None
    assert own.faults
    assert set(own.faults.values()) <= {WORSE, TORN}
    assert left.faded
    assert not own.weights[sorted(own.faults)].any()
    entry = crossings(asset, files[1], fps=15.0).data["clips"][0]
    before, wrinkled = entry["counts"]
    moment = round(15.0 * left.time)
    # Wrinkles of 0.1 % stand for the skin alone: where it is exactly symmetric, its sides touch by chance.
    assert left.time == moment / 15.0
    assert left.resolved == left.wrinkled == left.before == wrinkled[moment] >= before[moment] > 0

    silent = PlayerError(0.0, 0.0, silent=True)
    words = ContactWords(crease, ("crease",), {"fold": own}, (left,), {"fold": silent})
    found = contact_effect(words, "crease_contact", [], ())
    assert isinstance(found.drive, Drive)
    assert found.drive.strengths == {"fold": 0.0}
    lines = words.warnings(plan, [], "y")
    assert left.degrees is not None
    beginning = f"crease: contact {left.reason} in 'fold' at {left.begin:.3g}"
    assert re.match(rf"{beginning}.* s, where joint_1 turns by {left.degrees[0]:.0f}.*: it fades out there; ", lines[0])
    assert lines[0].endswith(
        f"; contact leaves crossings in 'fold': {left.resolved} edges pass through"
        f" triangles at {left.time:.3g} s, {left.before} on the skin alone ({left.frames} frames in all), and"
        " without `per_clip: false` the targets follow it better"
    )


def test_what_fades_is_gone_in_a_pose_and_whole_a_few_strides_away() -> None:
    """The joint that is furthest away decides, whenever a clip gets there."""
    bends = np.array([0.0, 2.0, 4.0, 5.0, 4.0, 2.0, 0.0])
    near = nearness(bends[None], np.array([3]))
    assert near == pytest.approx(np.maximum(1.0 - (5.0 - bends) / FADE, 0.0))
    assert near[3] == 1.0
    both = nearness(np.stack([bends, 2.0 * bends]), np.array([3]))
    assert both == pytest.approx(np.maximum(1.0 - 2.0 * (5.0 - bends) / FADE, 0.0))
    assert not nearness(bends[None], np.zeros(0, np.intp)).any()


@pytest.mark.parametrize(
    ("limits", "keep", "state"),
    [((0.5, 0.5), True, (1.0, 0.5)), ((0.5, 0.5), False, (0.0, 0.5)), ((1.0, 0.5), True, (0.0, 1.0))],
)
def test_the_tallest_wrinkles_are_kept_with_contact_if_they_can(
    limits: tuple[float, float], *, keep: bool, state: tuple[float, float]
) -> None:
    """Poses cross more than the skin where wrinkles are higher than a limit, without contact and with it."""
    skin = np.array([4, 4])

    def found(_frames: np.ndarray, contact: float, height: float) -> np.ndarray:
        return skin + np.array([2, -1]) * (height > limits[int(contact)])

    look: Any = SimpleNamespace(crossings=found, skin=lambda _frames: skin)
    assert _state([look], np.array([0, 1]), keep=keep) == state


@pytest.mark.slow
def test_crossings_in_which_contact_does_nothing_have_a_line(tmp_path: Path) -> None:
    """Triangles of a stylised hand pass through others that lie on them at rest, and so never collide."""
    elbow = {"name": "elbow", "node": "Character", "origin": [0.36, 1.39, 0.045], "target": [0.54, 1.39, 0.042],
             "width": 0.1, "bumps": 3, "max_height": "10%", "contact": "resolve"}  # fmt: skip
    tools = write_tools(tmp_path / "tools.yaml", elbow, refinement={"max_levels": 1})
    report = wrinklecli.bake(place(CHARACTERS["low_poly_smooth"]()), tools, tmp_path / "out.glb", clips=["squat"])
    (fold,) = report.data["folds"]
    (left,) = fold["left"]
    assert left["resolved"] == left["before"] > 0
    assert any(line.startswith("elbow: contact leaves crossings in 'squat'") for line in report.data["warnings"])
