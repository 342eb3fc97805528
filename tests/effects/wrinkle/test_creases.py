"""Wrinkles are low in creases that a fold makes, by the geometry of the fold alone, and as high as ever elsewhere."""

from typing import Any

import numpy as np
import pytest

from kit.asset import Asset, attribute, stored
from kit.carried import ROOTS, carry_patch, placed
from kit.limb import limb_asset, tool
from kit.prepared import prepare
from wrinklecli.effects.faults import count_turned_over
from wrinklecli.effects.wrinkle import creases
from wrinklecli.effects.wrinkle.bending import turns_of
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.creases import creased
from wrinklecli.effects.wrinkle.layer import WrinklePart
from wrinklecli.surface.refine import Refinement

# Scene units along the limb, whose radius is 0.25, over which skin weights change: a cut for a robot, and for skin.
SHARP, SOFT = 0.04, 1.2
TALL = {"bumps": 4, "width": 0.4, "max_height": "8%", "variation": 0}


def limb_with(blend: float, **options: Any) -> Asset:
    asset = limb_asset(**{"rings": 61, "sides": 24, **options})
    weights, positions = attribute(asset, 0, "WEIGHTS_0"), attribute(asset, 0, "POSITION")
    share = np.clip(positions[:, 0] / blend + 0.5, 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    attribute(asset, 0, "JOINTS_0")[:] = [0, 1, 0, 0]
    weights[:] = np.stack([1.0 - share, share, 0.0 * share, 0.0 * share], axis=1)
    return asset


def lowered(asset: Asset, asked: Any, **header: Any) -> tuple[Any, Refinement, CarriedPatch, CarriedPatch]:
    made = prepare(asset, asked, **header)
    carried, fine = carry_patch(made)
    return made, fine, carried, creased(carried, fine, made.rest, made.rig)


def factors(before: CarriedPatch, after: CarriedPatch) -> Any:
    assert np.array_equal(before.vertices, after.vertices)
    moving = np.abs(before.magnitudes) > 1e-9
    ratios = after.magnitudes[moving] / before.magnitudes[moving]
    assert np.allclose(after.directions[moving], before.directions[moving] * ratios[:, None])
    return before.us[moving], ratios


def test_wrinkles_are_low_in_a_sharp_fold_and_whole_beside_it() -> None:
    made, _, before, after = lowered(limb_with(SHARP), tool(**TALL))
    us, ratios = factors(before, after)
    fold = made.patch.path.locate(np.zeros(3)).u
    near = np.abs(us - fold) < 0.02
    assert ratios[near].max() < 0.4
    assert ratios.min() > 0.15, "low, but there"
    bump = 2.0 / made.patch.curve.interval_count
    assert ratios[np.abs(us - fold) > bump].min() > 0.97


def test_no_triangle_turns_over_where_skinning_turns_none() -> None:
    made, fine, before, after = lowered(limb_with(0.5, angle=60.0), tool(bumps=3, width=0.4, max_height="none"))
    assert [
        count_turned_over(WrinklePart(each, 0), fine, made.rig, made.clip, 1.0) > 0 for each in (before, after)
    ] == [True, False]


def test_factors_change_smoothly() -> None:
    _, fine, before, after = lowered(limb_with(SHARP), tool(**TALL))
    us, ratios = factors(before, after)
    order = np.argsort(us, kind="stable")
    middle = np.abs(before.patch.coordinates(fine.rest_positions[before.vertices])[1]) < 0.2
    middle = middle[np.abs(before.magnitudes) > 1e-9][order]
    steps = np.abs(np.diff(ratios[order][middle])) / np.maximum(np.diff(us[order][middle]), 0.01)
    assert steps.max() < 2.0 * before.patch.curve.interval_count


def test_wrinkles_of_a_soft_fold_stay_as_they_are() -> None:
    _, _, before, after = lowered(limb_with(SOFT), tool(**{**TALL, "max_height": "1.5%"}))
    assert after is before


def test_wrinkles_keep_their_height_if_the_tool_says_so() -> None:
    _, _, before, after = lowered(limb_with(SHARP), tool(**TALL, creases="keep"))
    assert after is before


def test_clips_have_nothing_to_do_with_it() -> None:
    _, _, _, with_clip = lowered(limb_with(SHARP), tool(**TALL))
    _, _, _, without = lowered(limb_with(SHARP, clip=None), tool(**TALL))
    assert np.array_equal(with_clip.directions, without.directions)


@pytest.mark.quick(1)
@pytest.mark.parametrize("root", ROOTS, ids=str)
def test_a_limb_that_is_moved_scaled_or_mirrored_has_the_same_creases(root: Any) -> None:
    plain, moved = (
        lowered(limb_with(SHARP, root=each, rings=31, sides=16), placed(each, **{**TALL, "width": "40%"}))
        for each in ({}, root)
    )
    uneven = root.get("scale", [1])[0] != root.get("scale", [1])[-1] or len({*map(abs, root.get("scale", [1]))}) > 1
    (us, ratios), (others, found) = factors(*plain[2:]), factors(*moved[2:])
    assert len(us) == len(others) or uneven
    if uneven:
        assert found.min() < 0.5
    else:
        assert found == pytest.approx(ratios, abs=1e-6)


@pytest.mark.parametrize("keys", [{"strength": -2}, {"rest_length": {"keys": {"fold": [[0, "100%"], [1, "120%"]]}}}])
def test_strengths_and_keys_have_nothing_to_do_with_it(keys: Any) -> None:
    wanted = factors(*lowered(limb_with(SHARP), tool(**TALL))[2:])[1]
    assert factors(*lowered(limb_with(SHARP), tool(**TALL, **keys))[2:])[1] == pytest.approx(wanted, abs=1e-9)


def test_vertices_that_are_projected_in_each_frame_keep_as_much() -> None:
    _, _, before, after = lowered(limb_with(SHARP), tool(**TALL, attachment="patch"))
    assert before.ring is not None
    assert after.ring is not None
    moving = np.abs(before.magnitudes) > 1e-9
    ratios = after.magnitudes[moving] / before.magnitudes[moving]
    assert ratios.min() < 0.4
    assert after.ring.kept[moving] == pytest.approx(ratios)


def test_a_morph_target_that_only_squeezes_the_skin_makes_no_crease() -> None:
    """Wrinkles rise side by side then, along normals that it does not turn."""
    _, _, before, after = lowered(limb_asset(morphs=1, skinned=False, clip=None), tool(**TALL))
    assert after is before


def test_two_joints_that_share_a_tool_lower_its_wrinkles_in_the_folds_of_both() -> None:
    """Each of them carries half of the tool's lower end, and the skin on its own side, as thighs do below a skirt."""
    asset = limb_with(SHARP, joints=3)
    nodes = asset.gltf["nodes"]
    nodes[2].pop("children")
    nodes[1]["children"].append(3)
    nodes[3]["translation"] = nodes[2]["translation"]
    attribute(asset, 0, "JOINTS_0")[:] = [0, 1, 2, 0]
    binds = stored(asset, asset.gltf["skins"][0]["inverseBindMatrices"])
    binds[2] = binds[1]
    weights, positions = attribute(asset, 0, "WEIGHTS_0"), attribute(asset, 0, "POSITION")
    side = np.clip(0.5 + positions[:, 2] / SHARP, 0.0, 1.0)
    weights[:, 1:3] = weights[:, 1:2] * np.stack([1.0 - side, side], axis=1)
    made, fine, before, after = lowered(asset, tool(**TALL))
    us, ratios = factors(before, after)
    (moving,) = np.nonzero(np.abs(before.magnitudes) > 1e-9)
    v = before.patch.coordinates(fine.rest_positions[before.vertices[moving]])[1]
    near = np.abs(us - made.patch.path.locate(np.zeros(3)).u) < 0.02
    for place in (-v, v):
        assert ratios[near & (place > 0.2) & (place < 0.7)].max() < 0.4
    # Where wrinkles are tall, too, both have turned.
    assert [{channel.node for channel in each.channels} for each in turns_of(made.patch, made.rig)] == [{2, 3}] * 2


def test_a_loss_spreads_evenly_to_all_sides_up_to_the_margin() -> None:
    """It is felt most where it is, also at the edge of the map."""
    patch = lowered(limb_with(SOFT), tool(**TALL))[2].patch
    ends = np.array([creases._MARGIN, 1.0 + creases._MARGIN])
    us, vs = np.linspace(-ends[0], 1.0 + ends[0], 13), np.linspace(-ends[1], ends[1], 13)
    places = np.stack(np.meshgrid(us, vs, indexing="ij"), axis=2).reshape(-1, 2)
    middle, corner = 84, 168
    for lone in (middle, corner, 0):
        spread = creases._spread(np.eye(169)[lone], places, patch)
        assert spread[lone] == spread.max() > 0.5
        assert (spread[np.linalg.norm(places - places[lone], axis=1) > 1.0] < 0.01).all()
        if lone == middle:
            assert spread == pytest.approx(spread[::-1], abs=0.15), "about as far to one side as to the other"
    beyond = creases._spread(np.eye(1)[0], np.array([[9.0, 9.0]]), patch)
    assert beyond == pytest.approx(creases._spread(np.eye(1)[0], 1.0 * ends[None] + [[1.0, 0.0]], patch), abs=0.05)
    assert creases._spread(np.full(169, 0.4), places, patch) == pytest.approx(np.full(169, 0.4))
