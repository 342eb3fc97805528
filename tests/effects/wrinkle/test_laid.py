"""The pose in which a tool is laid: crests are straight there, and all else is as at rest."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from kit.asset import Asset, Json
from kit.carried import carry_patch
from kit.command import Wrinkle
from kit.forehead import BROWS, forehead
from kit.limb import limb_asset, tool, write_tools
from kit.prepared import Prepared, prepare
from wrinklecli import bake
from wrinklecli.effects.wrinkle.activity import activity
from wrinklecli.errors import WrinkleError

Floats = NDArray[np.float64]

MIDDLE: Json = {**BROWS, "origin": [0.0, -0.6, 0.0], "target": [0.0, 0.6, 0.0]}
ACROSS: Json = {"name": "glabella", "origin": [-0.4, -0.5, 0.0], "target": [0.4, -0.5, 0.0], "width": 0.5, "bumps": 2}
SIDES = ("browUpLeft", "browUpRight")


def weights_of(prepared: Prepared) -> dict[str, float]:
    """The morph targets that are raised where the only tool is laid."""
    weights = prepared.patch.pose.morph_weights
    return {prepared.rig.morph_names[k]: float(weights[k]) for k in np.flatnonzero(weights)}


def crest(prepared: Prepared, weight: float) -> Floats:
    """(columns,) y of the skin where u is 1/2, with the first morph target raised to a weight."""
    carried, fine = carry_patch(prepared)
    x = np.round(fine.rest_positions[carried.vertices, 0], 6)
    y = (fine.positions + weight * fine.morph_deltas[0])[carried.vertices, 1]
    found = []
    for column in np.unique(x):
        own = np.flatnonzero(x == column)
        order = own[np.argsort(carried.us[own])]
        if len(order) > 8:
            found.append(np.interp(0.5, carried.us[order], y[order]))
    assert len(found) > 8
    return np.array(found)


def test_crests_are_straight_in_the_pose() -> None:
    """The target raises the brow in an arch, and with it the line where u is 1/2."""
    bends = {}
    for laid in ("stored", "raised"):
        prepared = prepare(forehead(count=17), {**BROWS, "laid": laid})
        bends[laid] = [float(np.ptp(crest(prepared, weight))) for weight in (0.0, 0.75, 1.0)]
    assert bends["stored"][0] < 0.005 < 0.05 < bends["raised"][0]
    assert bends["raised"][1] < 0.005 < 0.05 < bends["stored"][1]
    assert bends["raised"][2] < 0.4 * bends["stored"][2]


@pytest.mark.parametrize("laid", ["raised", {"clip": "raise", "time": 0.4}], ids=str)
def test_ends_are_at_0_and_1_and_the_signal_is_that_at_rest(laid: Any) -> None:
    stored = prepare(forehead(), {**BROWS, "laid": "stored"})
    other = prepare(forehead(), {**BROWS, "laid": laid})
    patch = other.patch
    places = np.stack([each.barycentrics @ patch.pose.positions[each.vertices] for each in patch.anchors])
    u, v = patch.coordinates(places)
    assert u == pytest.approx([0.0, 1.0], abs=1e-9)
    assert v == pytest.approx([0.0, 0.0], abs=1e-9)
    assert (patch.span, patch.half_width) == (stored.patch.span, stored.patch.half_width)
    times = np.linspace(0.0, 2.0, 41)
    one, two = (activity(each.patch, each.rig, each.clip, times) for each in (stored, other))
    assert np.array_equal(one.amplitudes, two.amplitudes)
    assert one.amplitudes.max() > 0
    lengths = [each.patch.curve.lengths(one.amplitudes, one.distances) for each in (stored, other)]
    assert np.array_equal(*lengths)


def test_a_vertex_moves_along_its_normal_at_rest() -> None:
    carried, _ = carry_patch(prepare(forehead(), BROWS))
    assert not carried.directions[:, :2].any()
    assert carried.directions[:, 2].max() > 0.9


@pytest.mark.slow
def test_a_pose_equal_to_rest_gives_the_same_bytes(tmp_path: Path) -> None:
    """At the start of the clip the brows are as at rest; the middle of it is another pose."""
    asset, baked = forehead().write(tmp_path / "forehead.glb"), {}
    for name, laid in {
        "stored": "stored",
        "start": {"clip": "raise", "time": 0},
        "peak": {"clip": "raise", "time": 1},
    }.items():
        bake(asset, write_tools(tmp_path / "tools.yaml", {**BROWS, "laid": laid}), tmp_path / f"{name}.glb")
        baked[name] = (tmp_path / f"{name}.glb").read_bytes()
    assert baked["stored"] == baked["start"] != baked["peak"]


def test_raised_is_the_clip_at_three_quarters() -> None:
    one, two = (
        carry_patch(prepare(forehead(), {**BROWS, "laid": laid}))[0]
        for laid in ("raised", {"clip": "raise", "time": 0.75})
    )
    assert np.array_equal(one.vertices, two.vertices)
    assert one.us == pytest.approx(two.us, abs=1e-9)
    assert one.magnitudes == pytest.approx(two.magnitudes, abs=1e-9)


def with_clip(asset: Asset, name: str, path: str, values: Any) -> Asset:
    animation: Json = {"name": name}
    asset.channel(animation, 0 if path == "weights" else 1, path, [0.0, 1.0], np.array(values, np.float64))
    asset.append("animations", animation)
    return asset


@pytest.mark.quick(1)
@pytest.mark.parametrize("targets", [("browsUp", "blink"), SIDES])
def test_clips_change_no_geometry(targets: tuple[str, ...]) -> None:
    """Not even one that raises another target, or none at all."""
    made = [
        forehead(targets=targets),
        forehead(targets=targets, clip=None),
        with_clip(forehead(targets=targets), "other", "weights", [[0.0, 0.0], [0.0, 1.0]]),
    ]
    patches = [carry_patch(prepare(each, BROWS)) for each in made]
    for carried, fine in patches[1:]:
        assert np.array_equal(carried.us, patches[0][0].us)
        assert np.array_equal(carried.magnitudes, patches[0][0].magnitudes)
        assert np.array_equal(fine.positions, patches[0][1].positions)
        assert np.array_equal(fine.morph_deltas, patches[0][1].morph_deltas)


def test_an_animated_scale_is_taken_out() -> None:
    """A head that is twice as large in a clip has no narrower patch."""
    asset = with_clip(forehead(), "grow", "scale", [[1.0, 1.0, 1.0], [2.0, 2.0, 2.0]])
    grown = carry_patch(prepare(asset, {**BROWS, "laid": {"clip": "grow", "time": 1}}))[0]
    stored = carry_patch(prepare(forehead(), {**BROWS, "laid": "stored"}))[0]
    assert np.array_equal(grown.vertices, stored.vertices)
    assert grown.us == pytest.approx(stored.us, abs=1e-6)
    assert grown.magnitudes == pytest.approx(stored.magnitudes, abs=1e-6)


@pytest.mark.parametrize(
    ("targets", "keys", "raised"),
    [
        (("browsUp",), BROWS, {"browsUp": 0.75}),
        # Of several the one that brings the ends together; not one that makes all of the head small.
        (("blink", "small", "browsUp"), BROWS, {"browsUp": 0.75}),
        (("small",), BROWS, {}),
        (("blink",), BROWS, {}),
        ((), BROWS, {}),
        # In the middle both sides count alike.
        (SIDES, MIDDLE, {"browUpLeft": 0.75, "browUpRight": 0.75}),
        (("left", "right"), MIDDLE, {"left": 0.75, "right": 0.75}),
        # The target that drives the rest length, whatever it moves.
        (("browsUp", "blink"), {**BROWS, "rest_length": {"morph": "blink", "full": "120%"}}, {"blink": 0.75}),
        (("browsUp",), {**BROWS, "rest_length": {"keys": {"raise": [[0, "120%"]]}}}, {}),
        (("browsUp",), {**BROWS, "attachment": "patch"}, {}),
        (("browsUp",), {**BROWS, "laid": "stored"}, {}),
    ],
)  # fmt: skip
def test_the_target_that_drives_a_tool_is_found(targets: tuple[str, ...], keys: Json, raised: Json) -> None:
    assert weights_of(prepare(forehead(targets=targets, clip=None if not targets else "raise"), keys)) == pytest.approx(
        raised
    )


def test_a_twin_is_raised_by_what_it_does() -> None:
    left = weights_of(prepare(forehead(targets=SIDES), BROWS))
    assert left["browUpLeft"] == 0.75
    assert 0.0 < left["browUpRight"] < 0.6
    right = weights_of(
        prepare(
            forehead(targets=SIDES),
            {**BROWS, "mirror": "x", "name": "brow.R", "origin": [-0.3, -0.6, 0], "target": [-0.3, 0.6, 0]},
        )
    )
    assert [right[name] for name in SIDES] == pytest.approx([left[name] for name in reversed(SIDES)])


def test_a_mirrored_tool_is_laid_as_its_twin() -> None:
    prepared = prepare(forehead(targets=SIDES), {**BROWS, "name": "brow.L", "mirror": "x", "seed": 1, "variation": 0.3})
    one, two = (each.pose.morph_weights for each in prepared.patches)
    assert one == pytest.approx(two[::-1])


@pytest.mark.parametrize("degrees", [0.0, 12.0])
def test_weights_at_rest_count(degrees: float) -> None:
    """Brows that are raised at rest are raised further, and a target that is up is no other pose."""
    asset = forehead()
    asset.gltf["meshes"][0]["weights"] = [degrees / 12.0]
    assert prepare(asset, BROWS).patch.pose.morph_weights == pytest.approx([0.75 if not degrees else 1.0])


def test_a_joint_that_bends_a_tool_has_it_laid_at_rest() -> None:
    """The targets of the limb bulge it, as correctives do."""
    prepared = prepare(limb_asset(morphs=2, clip=None), tool(origin=[-0.2, 0.25, 0.0], target=[0.2, 0.25, 0.0]))
    assert prepared.patch.pose is prepared.rest
    assert prepared.patch.laid is prepared.patch.path
    assert prepared.patch.at_rest is prepared.patch


def test_a_tool_is_laid_at_rest_if_the_raised_pose_leaves_no_room() -> None:
    assert weights_of(prepare(forehead(targets=("meet",)), BROWS)) == {}
    with pytest.raises(WrinkleError, match=r"tools\[0\].laid: origin and target are one point in the pose"):
        prepare(forehead(targets=("meet",)), {**BROWS, "laid": "raised"})


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"laid": "raised", "origin": [0.0, 0.3, 0.0], "target": [0.0, 0.9, 0.0]},
         "tools[0].laid: no morph target brings the ends together; laid can be stored or a clip's"),
        ({"laid": "raised", "attachment": "patch"},
         "tools[0].laid: attachment: patch is laid anew in each frame; laid can be auto or stored"),
        ({"laid": {"clip": "walk"}}, "tools[0].laid.clip: the asset has no clip 'walk'"),
        ({"laid": "rest"}, "tools[0].laid: found 'rest', expected auto, stored, raised or {clip: NAME, time: 0}"),
        ({"laid": {"clip": "raise", "time": -1}}, "tools[0].laid.time: found -1"),
    ],
)  # fmt: skip
def test_what_cannot_be_laid_is_said_in_one_line(wrinkle: Wrinkle, tmp_path: Path, keys: Json, message: str) -> None:
    asset = forehead(targets=("blink",)).write(tmp_path / "forehead.glb")
    tools = write_tools(tmp_path / "tools.yaml", {**BROWS, **keys})
    result = wrinkle("bake", asset, tools, "-o", tmp_path / "out.glb")
    assert result.code == 1
    (line,) = result.lines
    assert message in line
    assert not (tmp_path / "out.glb").exists()


def test_an_optional_tool_without_its_clip_is_laid_as_by_default(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = forehead().write(tmp_path / "forehead.glb")
    tools = write_tools(tmp_path / "tools.yaml", {**BROWS, "optional": True, "laid": {"clip": "walk"}})
    result = wrinkle("check", asset, tools, "--json")
    assert result.code == 0
    assert any("brow: the asset has no clip 'walk'" in line for line in json.loads(result.out)["warnings"])
    assert json.loads(result.out)["tools"][0]["laid"] == "stored"


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("laid", "data", "line"),
    [
        ("auto", {"raised": {"browsUp": 0.75}}, "laid     browsUp at 0.75"),
        ("stored", "stored", "laid     at rest"),
        ({"clip": "raise", "time": 0.5}, {"clip": "raise", "time": 0.5}, "laid     raise at 0.5 s"),
    ],
)
def test_check_says_the_pose(wrinkle: Wrinkle, tmp_path: Path, laid: Any, data: Any, line: str) -> None:
    asset = forehead().write(tmp_path / "forehead.glb")
    tools = write_tools(tmp_path / "tools.yaml", {**BROWS, "laid": laid})
    assert line in wrinkle("check", "-v", asset, tools).out
    assert json.loads(wrinkle("check", asset, tools, "--json").out)["tools"][0]["laid"] == data
