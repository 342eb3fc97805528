"""Clips of a second that no file has."""

from types import SimpleNamespace

import numpy as np
import pytest

from kit.limb import limb_asset
from kit.prepared import as_document
from wrinklecli.character.clip import read_clips
from wrinklecli.character.motion import approach
from wrinklecli.character.pose import morph_weights
from wrinklecli.character.rig import read_rig


def test_an_approach_moves_the_assets_own_morph_targets() -> None:
    """A clip keys those alone, though effects such as flesh have given the rig more."""
    document = as_document(limb_asset(rings=3, sides=4, morphs=2, morph_clip="LINEAR", weights_at="node"))
    rig, (clip, *_) = read_rig(document, 0), read_clips(document)
    driven = rig.driven_by([SimpleNamespace(targets=("flesh_1", "flesh_2"))])  # type: ignore[list-item]
    way = approach(clip, clip.end / 3.0, driven)
    found = morph_weights(rig, way, np.array([0.0, 1.0]))
    assert found[0] == pytest.approx(rig.morph_weights)
    assert found[1] == pytest.approx(morph_weights(rig, clip, np.array([clip.end / 3.0]))[0])
