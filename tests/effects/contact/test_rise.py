"""Folds that no joint bends: a morph target raises the wrinkles, or keys of the rest length do."""

import numpy as np
import pytest

from kit.carried import carry_patch
from kit.limb import limb_asset, nose, tool
from kit.prepared import prepare
from wrinklecli.effects.contact.fold import find_folds
from wrinklecli.effects.contact.rise import rise_of
from wrinklecli.effects.wrinkle.bending import bent_node

BRIDGE = {"name": "bridge", "node": "skin", "origin": [-0.5, 0, 0], "target": [0.5, 0, 0], "width": 0.8, "bumps": 4}
KEYS = {"sneer": [[0.0, "100%"], [1.0, "112%"], [2.0, "100%"]]}


@pytest.mark.parametrize("keys", [{}, {"rest_length": {"keys": KEYS}}], ids=["morph", "keyed"])
def test_wrinkles_rise_evenly_to_their_tallest(keys: dict[str, object]) -> None:
    prepared = prepare(nose(), BRIDGE | keys | {"max_height": "none"})
    patch, rig = prepared.patch, prepared.rig
    assert bent_node(patch, rig) is None
    rise = rise_of(patch, rig)
    assert rise is not None
    ((motion, times),) = rise.sweeps
    rows = rise.reading(rig, motion, times).rows
    assert rows[0] == pytest.approx(0.0, abs=1e-6)
    assert (np.diff(rows) > 0).all()
    amplitudes, _ = patch.curve.follow(*rise.patch.segment.lengths(rig, motion, times)[:2])
    heights = patch.curve.heights(amplitudes).max(axis=1)
    # Heights follow the square root of the shortening, of which the first sixteenth would give a quarter of the height.
    assert np.diff(heights) == pytest.approx(heights[-1] / 16, rel=0.1)
    # The clip itself raises them as far, in as many strides.
    strides = rise.strides(rig, prepared.clip, np.array([0.0, 1.0]))
    assert strides[1] - strides[0] == pytest.approx(16.0, rel=0.01)


def test_what_nothing_shortens_does_not_rise() -> None:
    stiff = tool(origin=[-0.9, 0.25, 0.0], target=[-0.6, 0.25, 0.0])
    prepared = prepare(limb_asset(rings=12, sides=8), stiff)
    assert bent_node(prepared.patch, prepared.rig) is None
    assert rise_of(prepared.patch, prepared.rig) is None


@pytest.mark.parametrize("shortened", [True, False])
def test_a_tool_is_in_a_fold_if_anything_shortens_it(shortened: bool) -> None:
    stiff = tool(origin=[-0.9, 0.25, 0.0], target=[-0.6, 0.25, 0.0])
    prepared = prepare(nose(), BRIDGE) if shortened else prepare(limb_asset(rings=12, sides=8), stiff)
    carried, fine = carry_patch(prepared)
    parts = [None] * len(prepared.rig.names)
    folds, without = find_folds([carried], [0], fine, prepared.rest, prepared.rig, parts)
    assert (len(folds), without) == ((1, []) if shortened else (0, [0]))
