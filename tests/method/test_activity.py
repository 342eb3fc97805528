"""What a clip makes of a tool is the curve's answer to its anchors, for each tool and time alone."""

from collections.abc import Sequence
from dataclasses import fields

import numpy as np
import pytest

from kit.limb import RADIUS, limb_asset, tool
from kit.prepared import prepare
from wrinklecli.method.activity import Activity, activities, activity, further_activities
from wrinklecli.method.curve import weights_of


def test_activities_of_several_tools_are_those_of_each(monkeypatch: pytest.MonkeyPatch) -> None:
    tools = [tool(), tool(name="far", origin=[0.5, RADIUS, 0.0], target=[0.9, RADIUS, 0.0])]
    prepared = prepare(limb_asset(rings=9, sides=8, joints=4, morphs=1, morph_clip="STEP"), *tools)
    times = np.linspace(0.0, 2.0, 12)
    clip = prepared.clip
    single = [activity(patch, prepared.rig, prepared.rest, clip, times) for patch in prepared.patches]
    for at_once in (1, 2**17):
        monkeypatch.setattr("wrinklecli.method.activity._ANCHORS_AT_ONCE", at_once)
        found = activities(prepared.patches, prepared.rig, prepared.rest, clip, times)
        for one, other in zip(found, single, strict=True):
            assert one.distances == pytest.approx(other.distances, abs=1e-12)
            assert one.amplitudes == pytest.approx(other.amplitudes, abs=1e-9)


@pytest.mark.parametrize("known", [[3], [0, 1, 5, 11], range(12)])
def test_further_activities_go_between_those_that_are_known(known: Sequence[int]) -> None:
    prepared = prepare(limb_asset(rings=9, sides=8, joints=4), tool(), tool(name="other", strategy="origin"))
    patches, rig, rest, clip = prepared.patches, prepared.rig, prepared.rest, prepared.clip
    times = np.linspace(0.0, 2.0, 12)
    at = times[list(known)]
    some = activities(patches, rig, rest, clip, at)
    found = further_activities(patches, rig, rest, clip, times, known=some, known_at=at)
    for one, other in zip(found, activities(patches, rig, rest, clip, times), strict=True):
        for field in fields(Activity):
            assert getattr(one, field.name) == pytest.approx(getattr(other, field.name), abs=1e-9)


def test_activity_is_the_curve_s_answer_to_the_anchors() -> None:
    prepared = prepare(limb_asset(rings=9, sides=8), tool(max_height="2%"))
    seen = activity(prepared.patch, prepared.rig, prepared.rest, prepared.clip, np.linspace(0, 2, 9))
    assert seen.shortenings == pytest.approx(np.maximum(seen.rest_lengths * (1 - 1e-5) - seen.distances, 0))
    assert (seen.unabsorbed <= seen.shortenings).all()
    assert seen.unabsorbed[4] > 0.1
    heights = prepared.patch.curve.heights(seen.amplitudes)
    assert heights.max() == pytest.approx(0.02 * prepared.patch.span, rel=1e-6)
    weights = weights_of(prepared.patch.curve, seen.amplitudes)
    assert weights.min() == 0
    assert weights.max() == pytest.approx(1.0, abs=1e-9)
