"""Wrinkles in clips that a bake has not seen: they equal those of a bake, unless a clip sets weights itself."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.asset import bare_skeleton
from kit.bakes import bake_once
from kit.limb import limb, limb_asset, tool
from kit.player import Gltf, wrinkle_columns
from wrinklecli.baking.track import track, with_driven_weights
from wrinklecli.character.clip import read_clips
from wrinklecli.character.moved import Motions, moved
from wrinklecli.character.pose import morph_weights
from wrinklecli.character.rig import read_rig
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.numeric.arrays import Floats

LIMB: dict[str, Any] = {"rings": 9, "sides": 6}


@pytest.fixture
def body(tmp_path: Path) -> Gltf:
    """A baked limb without clips."""
    return bake_once(limb(tmp_path / "body.glb", **LIMB, clip=None), tool())


def weights(document: Document, clip: str, times: Floats) -> Floats:
    (found,) = (each for each in read_clips(document) if each.name == clip)
    return morph_weights(read_rig(document, 0), found, times)


def test_a_pose_and_the_clips_of_other_files_have_the_weights_that_a_bake_gives(body: Gltf, tmp_path: Path) -> None:
    whole = bake_once(limb(tmp_path / "whole.glb", **LIMB), tool())
    times = np.linspace(0.0, 2.0, 41)
    expected = whole.weights("limb", "fold", times)
    assert expected[:, wrinkle_columns(whole, "limb")].max() > 0.1
    anim = limb_asset(**LIMB)
    bare_skeleton(anim.gltf)
    joined = moved(
        read_document(body.path),
        [],
        Motions(anims=[anim.write(tmp_path / "anim.glb")], pose=[("joint_1", "z", 100.0)]),
    )
    document, warnings = with_driven_weights(joined.document, joined.further)
    assert not warnings
    assert weights(document, "fold", times) == pytest.approx(expected, abs=0.02 * expected.max())
    # The clip folds by 100° after a second.
    assert weights(document, "joint_1=z:100", np.zeros(1))[0] == pytest.approx(expected[20], abs=0.02 * expected.max())
    untouched, _ = with_driven_weights(joined.document, [])
    assert untouched is joined.document


def test_what_a_tracked_clip_sets_itself_stays(body: Gltf, tmp_path: Path) -> None:
    anim = limb_asset(**LIMB)
    bare_skeleton(anim.gltf)
    (tracked,) = track(body.path, [anim.write(tmp_path / "anim.glb")], tmp_path / "tracked", max_error=0.05)
    joined = moved(read_document(body.path), [], Motions(anims=[tracked.path]))
    document, _ = with_driven_weights(joined.document, joined.further)
    (before,), (after,) = (read_clips(each) for each in (joined.document, document))
    assert not joined.warnings
    assert after.moves_as(before)
    assert weights(document, "fold", np.ones(1)).max() > 0.1


def test_a_range_of_motion_raises_no_wrinkles_by_hand(body: Gltf) -> None:
    document = read_document(body.path)
    driven = {0: set(body.mesh("limb")["extras"]["targetNames"])}
    names = moved(document, [0], Motions(), driven=driven).range
    assert len(names) == 6
    assert all(name.startswith("joint_1 about") for name in names)
