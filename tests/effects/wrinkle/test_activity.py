"""Activities of tools in clips: lengths without scale, and the curve's heights for them, independent of other times."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from kit.carried import carry_patch
from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import posed_surface, prepare
from wrinklecli.character.clip import Clip
from wrinklecli.drive.table import TABLE_ERROR
from wrinklecli.effects.wrinkle.activity import activities, activity
from wrinklecli.effects.wrinkle.lookup import weights_of
from wrinklecli.effects.wrinkle.report import describe_activity
from wrinklecli.numeric.arrays import Floats


def test_activities_of_several_tools_are_those_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    tools = [tool(), tool(name="far", origin=[0.5, RADIUS, 0.0], target=[0.9, RADIUS, 0.0])]
    prepared = prepare(limb_asset(rings=9, sides=8, joints=4, morphs=1, morph_clip="STEP"), *tools)
    times = np.linspace(0.0, 2.0, 12)
    clip = prepared.clip
    single = [activity(patch, prepared.rig, clip, times) for patch in prepared.patches]
    for at_once in (1, 5, 4096):
        monkeypatch.setattr("wrinklecli.numeric.portions.AT_ONCE", 32 * at_once)
        found = activities(prepared.patches, prepared.rig, clip, times)
        for one, other in zip(found, single, strict=True):
            assert one.distances == pytest.approx(other.distances, abs=1e-12)
            assert one.amplitudes == pytest.approx(other.amplitudes, abs=1e-9)


def test_activity_is_the_curve_s_answer_to_the_anchors() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), tool(max_height="2%"))
    seen = activity(prepared.patch, prepared.rig, prepared.clip, np.linspace(0, 2, 9))
    assert seen.shortenings == pytest.approx(np.maximum(seen.rest_lengths * (1 - 1e-5) - seen.distances, 0))
    assert (seen.unabsorbed <= seen.shortenings).all()
    assert seen.unabsorbed[4] > 0.1
    wanted, unabsorbed = prepared.patch.curve.follow(seen.distances, seen.rest_lengths)
    greatest = prepared.patch.curve.greatest_amplitudes
    assert (np.abs(seen.amplitudes - wanted) <= TABLE_ERROR * greatest).all()
    assert (seen.unabsorbed == unabsorbed).all()
    heights = prepared.patch.curve.heights(seen.amplitudes)
    assert heights.max() == pytest.approx(0.02 * prepared.patch.span, rel=1e-6)
    weights = weights_of(prepared.patch.curve, seen.amplitudes)
    assert weights.min() == 0
    assert weights.max() == pytest.approx(1.0, abs=1e-9)


def test_distance_is_that_of_the_posed_anchors() -> None:
    prepared = prepare(limb_asset(rings=17, sides=9, morphs=1, morph_clip="STEP"), tool())
    times = np.linspace(0, 2, 21)
    moved = posed_surface(prepared, prepared.clip, times)
    ends = [
        np.einsum("c,fcx->fx", anchor.barycentrics, moved[:, anchor.vertices])
        for anchor in (prepared.patch.origin, prepared.patch.target)
    ]
    distances, lengths, *_ = prepared.patch.segment.lengths(prepared.rig, prepared.clip, times)
    assert distances == pytest.approx(np.linalg.norm(ends[1] - ends[0], axis=1), abs=1e-12)
    assert distances.min() < 0.7 * prepared.patch.span
    assert lengths == pytest.approx(prepared.patch.span, abs=0)


def test_nothing_shortens_at_rest() -> None:
    for asset in (limb_asset(rings=9, sides=8), limb_asset(rings=9, sides=8, clip=None)):
        prepared = prepare(asset)
        clip = prepared.clips[0] if prepared.clips else None
        distances, lengths, *_ = prepared.patch.segment.lengths(prepared.rig, clip, np.zeros(1))
        assert distances == pytest.approx(prepared.patch.span, rel=1e-12)
        assert prepared.patch.curve.shortening(distances, lengths).tolist() == [0.0]


@pytest.mark.parametrize("skinned", [True, False])
@pytest.mark.parametrize("factor", [0.01, 0.5, 3.0])
def test_animated_uniform_scale_is_no_shortening(skinned: bool, factor: float) -> None:
    asset = limb_asset(rings=9, sides=8, skinned=skinned, morphs=1, clip=None, root={"scale": [2, 2, 2]})
    animation: dict[str, Any] = {"name": "grow"}
    asset.channel(animation, len(asset.gltf["nodes"]) - 1, "scale", [0, 1], [[2.0] * 3, [2.0 * factor] * 3])
    asset.append("animations", animation)
    prepared = prepare(asset, tool(origin=[-0.8, 2 * RADIUS, 0], target=[0.8, 2 * RADIUS, 0]))
    distances, *_ = prepared.patch.segment.lengths(prepared.rig, prepared.clip, np.linspace(0, 1, 9))
    assert distances == pytest.approx(prepared.patch.span, rel=1e-12)


def test_character_hidden_by_scale_makes_no_wrinkles() -> None:
    asset = limb_asset(rings=9, sides=8, clip=None, root={})
    animation: dict[str, Any] = {"name": "hide"}
    asset.channel(animation, 3, "scale", [0, 1, 2], [[1.0] * 3, [0.0] * 3, [1e-7] * 3])
    asset.append("animations", animation)
    prepared = prepare(asset)
    distances, lengths, *_ = prepared.patch.segment.lengths(prepared.rig, prepared.clip, np.array([0.0, 1.0, 2.0]))
    assert np.isinf(distances).tolist() == [False, True, True]
    assert prepared.patch.curve.shortening(distances, lengths).tolist() == [0.0, 0.0, 0.0]


def test_keyed_rest_length_runs_straight_between_keys_in_its_clip_alone() -> None:
    keys = {"fold": [[0.5, 0.6], [1.0, "100%"], [2.0, 1.0]]}
    prepared = prepare(limb_asset(rings=9, sides=8), tool(rest_length={"keys": keys}))
    assert prepared.patch.keyed_clips == {"fold"}
    times = np.array([0.0, 0.5, 0.75, 1.0, 1.5, 3.0])
    other = replace(prepared.clip, name="other")

    def lengths(clip: Clip | None) -> Floats:
        return prepared.patch.segment.lengths(prepared.rig, clip, times)[1]

    assert lengths(prepared.clip) == pytest.approx([0.6, 0.6, 0.7, 0.8, 0.9, 1.0], abs=1e-7)
    assert lengths(other) == pytest.approx([0.8] * 6, abs=1e-7)
    assert lengths(None) == pytest.approx([0.8] * 6, abs=1e-7)


def test_rest_length_follows_a_morph_target_from_0_to_1_and_no_further() -> None:
    asset = limb_asset(rings=9, sides=8, morphs=2, clip=None)
    animation: dict[str, Any] = {"name": "smile"}
    asset.channel(animation, 0, "weights", [0, 1, 2, 3], [[0.7, 0], [0.7, 0.5], [0.7, 2], [0.7, -1]])
    asset.append("animations", animation)
    prepared = prepare(asset, tool(rest_length={"morph": "morph_1", "full": "125%"}))
    _, lengths, *_ = prepared.patch.segment.lengths(prepared.rig, prepared.clip, np.array([0.0, 1.0, 2.0, 3.0]))
    assert lengths == pytest.approx([0.8, 0.9, 1.0, 0.8], abs=1e-7)


@pytest.mark.parametrize("keys", [{}, {"compressible": "30%"}, {"max_height": "2%", "compressible": "60%"}], ids=str)
def test_a_report_shows_that_the_curve_keeps_its_length(keys: dict[str, Any]) -> None:
    """Tissue takes a part of each shortening, which is no error of the bumps."""
    prepared = prepare(limb_asset(rings=9, sides=8), tool(**keys))
    carried, _ = carry_patch(prepared)
    seen = activity(prepared.patch, prepared.rig, prepared.clip, np.arange(3.0))
    told = describe_activity(carried, seen, prepared.clip)
    assert max(told["shortening"]) > 0.1
    assert max(told["curve_length_error"]) < 1e-9 * max(told["rest_length"])
    lines = told["line_length_errors"]
    assert abs(lines["errors"][lines["v"].index(0.0)]) < 1e-3
