"""Intersections that contact leaves in a clip: numbers as of `check --crossings`, and a line with a hint."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ipctk", reason="needs the extra `contact`")

from kit.creases import resolved
from kit.limb import limb, tool, write_tools
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.drive.drive import Drive
from wrinklecli.effects.contact.crease import PlayerError
from wrinklecli.effects.contact.effect import ContactWords, NonNegativeBasis, contact_effect
from wrinklecli.effects.contact.fitting import fit_pose
from wrinklecli.effects.contact.given_up import UnresolvedError
from wrinklecli.effects.contact.layer import ContactLayer
from wrinklecli.effects.contact.remaining import remaining_in
from wrinklecli.effects.contact.solution import Solution
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.crossings import crossings

# So low that the wrinkles cross no more than the skin: else such a fold is given up.
TOOL = tool(bumps=3, max_height="0.1%")
TIMES = np.linspace(0.0, 1.0, 16)


@pytest.mark.slow
def test_a_clip_that_would_cross_more_with_contact_is_left_without_and_a_line_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    followed = crease.follow(crease.march(clip, TIMES))
    assert not followed.given_up
    assert remaining_in(crease, clip, TIMES, followed) is None
    shown = crease.player_error(clip, TIMES, followed, scale=1.0)
    assert shown.share < 0.1
    assert not shown.silent
    # Where other joints keep the sides apart, players are nearer to the bake without contact.
    apart = replace(followed, weights=np.zeros_like(followed.weights))
    assert crease.player_error(clip, TIMES, apart, scale=1.0) == PlayerError(0.0, 0.0, silent=True)

    # A fit that presses what touches further in.
    worse = replace(crease, response=crease.response.mapped(lambda weights: 0.0 * weights))

    def pressed(
        found: Solution, shapes: Floats, urgent: Floats | None = None, **known: Any
    ) -> tuple[Floats, Floats, bool]:
        weights, urgent, _ = fit_pose(found, shapes, urgent, **known)
        return -weights, urgent, True

    monkeypatch.setattr("wrinklecli.effects.contact.crease.fit_pose", pressed)
    given_up = worse.follow(worse.march(clip, TIMES))
    assert given_up.given_up
    assert not given_up.weights.any()

    with pytest.raises(UnresolvedError, match="would leave more crossings than the skin alone"):
        remaining_in(worse, clip, TIMES, replace(followed, weights=-followed.weights))

    left = remaining_in(worse, clip, TIMES, given_up)
    assert left is not None
    entry = crossings(asset, files[1], fps=15.0).data["clips"][0]
    before, wrinkled = entry["counts"]
    moment = round(15.0 * left.time)
    assert (left.time, left.before, left.wrinkled) == (moment / 15.0, before[moment], wrinkled[moment])
    assert left.resolved == left.wrinkled > 0
    words = ContactWords(
        crease=worse,
        tools=("crease",),
        followed={"fold": (TIMES, given_up)},
        remaining=(left,),
        player_errors={"fold": PlayerError(0.0, 0.0, silent=True)},
    )
    found = contact_effect(words, "crease_contact", NonNegativeBasis(len(worse.shapes), 1.5), [], ())
    assert isinstance(found.drive, Drive)
    assert found.drive.strengths == {"fold": 0.0}
    (line,) = words.warnings(plan, [], up="y")
    assert line == (
        f"crease: contact is left out of 'fold', where it would leave more: {left.wrinkled} edges pass through"
        f" triangles at {left.time:.3g} s, {left.before} before the bake ({left.frames} frames in all);"
        " without `per_clip: false` the targets follow it better"
    )
