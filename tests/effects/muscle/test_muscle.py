"""Muscles thicken as they shorten, in bakes, in players and under wrinkles."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import wrinklecli
from kit.asset import Json
from kit.bakes import UNREFINED, bake_once, folding_limb, place, report_of
from kit.clients import assert_valid, drive
from kit.command import Wrinkle
from kit.limb import RADIUS, limb_asset, sleeved_limb, tool, write_tools
from kit.muscles import arm, muscle
from kit.player import Gltf, anchor_distances
from wrinklecli.baking.track import track
from wrinklecli.drive.table import TABLE_ERROR
from wrinklecli.effects.muscle.volume import ACTIVATION, FULLEST, LONGEST, SHORTEST, ConstantVolume
from wrinklecli.errors import BakeError
from wrinklecli.tools.body import THICKNESS

ARM = cache(arm)
FLEXED = {"keys": {"fold": [[0.0, 0.0], [1.0, 1.0], [2.0, 0.0]]}}
# A tool across the joint, whose anchors lie on the belly.
CREASE = tool(origin=[-0.3, 0.25, 0.0], target=[0.3, 0.25, 0.0], bumps=2)


ENDS = {"origin": "joint_0", "insertion": "joint_1"}
BICEPS = {key: muscle()[key] for key in ENDS}
# The other side of the limb, which its bend stretches.
TRICEPS = {key: {"joint": joint, "offset": [0.15, -0.1, 0.0]} for key, joint in ENDS.items()}


def flexed(*tools: Json, engine: str | None = None, **keys: Any) -> Gltf:
    return bake_once(ARM(), *tools, top={"muscles": [muscle(**keys)]}, details=True, engine=engine)


def drive_of(file: Gltf) -> Json:
    (found,) = file.json["nodes"][file.node("limb")]["extras"]["wrinkle"]["muscles"]
    return found


def test_a_part_of_the_travel_above_no_vertex_is_left_out() -> None:
    """Its target goes with its weights, and the others keep their names."""
    file = bake_once(arm(rings=4, sides=5), top={"muscles": [muscle(travel=True)]}, max_levels=0)
    found = drive_of(file)
    assert found["targets"] == ["wrinkle_biceps_1", "wrinkle_biceps_2", "wrinkle_biceps_4"]
    assert [len(found["lows"]), len(found["weights"][0])] == [2, 2]
    assert file.json["meshes"][0]["extras"]["targetNames"] == found["targets"]
    with pytest.raises(BakeError, match="no vertex lies above it"):
        bake_once(arm(rings=3, sides=4), top={"muscles": [muscle(travel=True)]}, max_levels=0)


@pytest.mark.parametrize("tendons", [0.0, 0.2, 0.7])
def test_the_volume_of_a_muscle_is_constant(tendons: float) -> None:
    response = ConstantVolume(1.0, tendons, np.ones(1), np.array([FULLEST - 1.0]), np.ones((1, 1)))
    shares = np.linspace(SHORTEST, LONGEST, 101)
    thicknesses = response.thicknesses(tendons + shares * (1.0 - tendons))
    assert np.abs(shares * thicknesses**2 - 1.0).max() < 1e-9


def test_weights_are_right_at_keys() -> None:
    """The places of the ends, as the extras have them, and the formula of constant volume give the weights."""
    file = flexed(activation=FLEXED, travel=False)
    name, _ = drive_of(file)["targets"]
    times, _ = file.keys("fold", "limb")
    distances = anchor_distances(file, drive_of(file), "limb", "fold", times)
    rest = drive_of(file)["rest_length"]
    tendons = 0.4 * rest
    activation = 1.0 - np.abs(times - 1.0)
    shares = np.maximum((distances - tendons) / (rest - tendons) - ACTIVATION * activation, SHORTEST)
    column = file.mesh("limb")["extras"]["targetNames"].index(name)
    weights = file.weights("limb", "fold", times)[:, column]
    assert weights.max() > 0.3
    assert weights == pytest.approx((shares**-0.5 - 1.0) / (FULLEST - 1.0), abs=TABLE_ERROR)
    assert not weights[[0, -1]].any()


@pytest.mark.slow
def test_a_relaxed_muscle_is_thinner_than_a_flexed_one() -> None:
    relaxed, strong = (
        report_of(flexed(**keys)).data["clips"][0]["muscles"][0] for keys in ({}, {"activation": FLEXED})
    )
    assert 0.0 < relaxed["bulge"][1] < strong["bulge"][1] < 0.2


def test_the_other_side_gets_thinner() -> None:
    """The muscle behind a joint that bends is stretched."""
    low, high = report_of(flexed(**TRICEPS)).data["clips"][0]["muscles"][0]["bulge"]
    assert low < 0.0
    assert high == pytest.approx(0.0, abs=0.01)


def test_the_bulge_ends_smoothly() -> None:
    """No edge of the mesh has a step, and the tendons, the joint's far side and the back stay."""
    file = flexed(travel=False)
    deltas, _ = file.deltas("limb")
    places = file.attribute("limb", "POSITION")
    heights = np.linalg.norm(deltas, axis=1)
    edges = file.triangles("limb")[:, [0, 1]]
    steps = np.abs(np.diff(heights[edges], axis=1))[:, 0]
    lengths = np.linalg.norm(np.diff(places[edges], axis=1), axis=2)[:, 0]
    # A bell that rises over half of the limb's thickness is no steeper.
    assert (steps < heights.max() * lengths / 0.1).all()
    assert heights[places[:, 1] < 0.0].max() == 0.0
    assert heights[(places[:, 0] < -0.75) | (places[:, 0] > 0.05)].max() == 0.0
    assert (deltas[heights > 0.2 * heights.max(), 1] > 0.0).all()


def outward(file: Gltf, moves: Any) -> Any:
    """(vertices,) parts of (vertices, 3) moves away from the limb's bone."""
    places = file.attribute("limb", "POSITION")
    return np.sum(moves * places * [0.0, 1.0, 1.0], axis=1) / np.maximum(np.linalg.norm(places[:, 1:], axis=1), 1e-9)


def test_a_furrow_parts_a_belly_from_its_neighbour() -> None:
    """Round the limb, skin sinks beside the bulge by a tenth of it; and along it, the crest is nearer to the origin."""
    file = flexed(travel=False)
    places, heights = file.attribute("limb", "POSITION"), outward(file, file.deltas("limb")[0])
    assert -0.12 < heights.min() / heights.max() < -0.05
    assert (np.abs(places[heights < -0.01 * heights.max(), 2]) > 0.5 * RADIUS).all()
    entry = drive_of(file)
    ends = [entry[end]["positions"][0][0] + x for end, x in (("origin", -1.0), ("target", 0.0))]
    assert 0.4 < (places[heights.argmax(), 0] - ends[0]) / (ends[1] - ends[0]) < 0.5


def test_a_belly_that_travels_bulges_nearer_to_its_origin() -> None:
    """It has four targets, and players drive them."""
    still, moving = flexed(activation=FLEXED, travel=False), flexed(activation=FLEXED)
    assert [len(drive_of(each)["targets"]) for each in (still, moving)] == [2, 4]
    x = still.attribute("limb", "POSITION")[:, 0]
    middles = []
    for file in (still, moving):
        weights = file.weights("limb", "fold", [1.0])[0]
        heights = np.linalg.norm(np.tensordot(weights, file.deltas("limb"), axes=1), axis=1)
        middles.append(float(heights @ x / heights.sum()))
    assert middles[1] < middles[0] - 0.1
    times = np.linspace(0.0, 2.0, 9)
    played, driven = (drive(moving.path, node="limb", clip="fold", times=times, driver=each) for each in (False, True))
    names = moving.mesh("limb")["extras"]["targetNames"]
    weights = [np.hstack([each[name] for name in names]) for each in (played, driven)]
    moves = [np.tensordot(each, moving.deltas("limb"), axes=1) for each in weights]
    assert np.abs(moves[1] - moves[0]).max() < 0.02 * np.abs(moves[0]).max()


def moved_by(file: Gltf, weights: Any) -> Any:
    """(times, vertices, 3) displacements by (times, targets) weights."""
    return np.tensordot(weights, file.deltas("limb"), axes=1)


@pytest.mark.slow
def test_a_belly_that_is_activated_while_its_ends_stay_does_not_travel() -> None:
    held = {"insertion": {"joint": "joint_0", "offset": [1.15, 0.4 * RADIUS, 0.0]}, "activation": FLEXED}
    still, travelling = (
        moved_by(file, file.weights("limb", "fold", [0.5, 1.0]))
        for file in (flexed(travel=travel, **held) for travel in (False, True))
    )
    assert np.abs(still).max() > 0.005
    assert np.abs(travelling - still).max() < 0.01 * np.abs(still).max()


@pytest.mark.slow
@pytest.mark.parametrize(("engine", "ends"), [(None, BICEPS), ("unity", TRICEPS)])
def test_tracks_and_players_activate_a_belly_that_travels_as_the_bake_does(
    engine: str | None, ends: Json, tmp_path: Path
) -> None:
    keys = {**ends, "travel": True, "activation": FLEXED}
    file = flexed(**keys, engine=engine)
    body = bake_once(ARM(), top={"muscles": [muscle(**keys)]}, engine=engine, tracks="none")
    (made,) = track(body.path, [ARM()], tmp_path)
    times = np.linspace(0.0, 2.0, 9)
    baked, tracked = (each.weights("limb", "fold", times) for each in (file, Gltf(Path(made.path))))
    driven = drive(file.path, node="limb", clip="fold", times=times, driver=True)
    played = np.hstack([driven[name] for name in file.mesh("limb")["extras"]["targetNames"]])
    assert engine is None or ("lows" in drive_of(file) and min(each.min() for each in (baked, tracked, played)) >= 0.0)
    moves = moved_by(file, baked)
    for other in (tracked, played):
        assert np.abs(moved_by(file, other) - moves).max() < 0.02 * np.abs(moves).max()


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("travel", "ends", "activation"),
    [(False, BICEPS, None), (True, TRICEPS, None), (True, BICEPS, FLEXED), (False, TRICEPS, FLEXED)],
    ids=["pressed", "travels, stretched", "travels, pressed, flexed", "stretched, flexed"],
)
def test_weights_are_from_0_to_1_in_any_engine(travel: bool, ends: Json, activation: Json | None) -> None:
    """A muscle that is stretched gets thinner by a target of its own."""
    file = flexed(travel=travel, **ends, **({} if activation is None else {"activation": activation}))
    weights = file.weights("limb", "fold", np.linspace(0.0, 2.0, 41))
    assert weights.min() >= 0.0
    assert weights.max() <= 1.0
    moved = outward(file, np.tensordot(weights[10], file.deltas("limb"), axes=1))
    rises = ends == BICEPS or activation is not None
    assert (moved.max() > 0.004, moved.min() < -0.004) == (rises, not rises)


def test_a_percentage_of_the_thickness_is_of_the_way_from_bone_to_skin() -> None:
    (described,) = report_of(flexed(thickness="60%")).data["muscles"]
    assert described["thickness"] == pytest.approx(0.6 * described["depth"])


@pytest.mark.slow
def test_players_drive_muscles_as_the_bake_does() -> None:
    file = flexed(CREASE, activation=FLEXED)
    assert_valid(file.path)
    times = np.linspace(0.0, 2.0, 21)
    driven = drive(file.path, node="limb", clip="fold", times=times, driver=True)
    found = drive(file.path, node="limb", clip="fold", times=times)
    assert sorted(each.max() > 0.2 for each in found.values()) == [False, True, True, True, True]
    for name, played in found.items():
        assert driven[name] == pytest.approx(played, abs=0.02 * max(played.max(), 1e-6))


@pytest.mark.slow
def test_wrinkles_follow_the_skin_that_a_muscle_moves() -> None:
    """The anchors' distance is that of the moved skin, and the file's wrinkles are right for it."""
    file = flexed(CREASE, activation=FLEXED, travel=False)
    entry = file.json["nodes"][file.node("limb")]["extras"]["wrinkle"]["tools"][0]
    assert [*entry["origin"]["morphs"]] == drive_of(file)["targets"]
    times = np.array([0.0, 0.5, 1.0])
    still = anchor_distances(file, {**entry, "origin": {**entry["origin"], "morphs": {}}}, "limb", "fold", times)
    moved = anchor_distances(file, entry, "limb", "fold", times)
    assert moved[0] == pytest.approx(entry["rest_length"])
    assert abs(moved[2] - still[2]) > 0.01
    residual = report_of(file).data["clips"][0]["residual"]
    assert residual["position"] < report_of(file).data["meshes"][0]["max_error"]


def test_tracks_are_those_of_the_bake(tmp_path: Path) -> None:
    whole = flexed(CREASE, activation=FLEXED)
    body = bake_once(ARM(), CREASE, top={"muscles": [muscle(activation=FLEXED)]}, tracks="none")
    (made,) = track(body.path, [ARM()], tmp_path)
    times = np.linspace(0.0, 2.0, 41)
    expected, found = (each.weights("limb", "fold", times) for each in (whole, Gltf(Path(made.path))))
    assert np.abs(found - expected).max() < 0.021


def test_an_arm_without_clips_gets_its_targets() -> None:
    """A line says that only a driver raises them, but not of a muscle that nothing can ever shorten."""
    idle = muscle(name="idle", insertion=[-0.2, 0.1, 0.0])
    file = bake_once(arm(clip=None), top={"muscles": [muscle(), idle]})
    drives = file.json["nodes"][file.node("limb")]["extras"]["wrinkle"]["muscles"]
    assert [name for each in drives for name in each["targets"]] == file.mesh("limb")["extras"]["targetNames"]
    said = report_of(file).data["warnings"]
    line = "biceps: there is no clip that moves the body: muscles swell only in a player with a driver"
    assert [each for each in said if "there is no clip" in each] == [line]


def test_a_morph_target_activates_a_muscle() -> None:
    flex = arm(morphs=2, morph_clip="LINEAR")
    file = bake_once(flex, top={"muscles": [muscle(activation={"morph": "morph_1"})]})
    times = np.linspace(0.0, 2.0, 9)
    played = drive(file.path, node="limb", clip="fold", times=times)
    driven = drive(file.path, node="limb", clip="fold", times=times, driver=True)
    assert np.ptp(played["morph_1"]) > 0.1
    name = "wrinkle_biceps_1"
    assert driven[name] == pytest.approx(played[name], abs=0.02 * played[name].max())


@pytest.mark.parametrize(
    ("keys", "line"),
    [
        ({"tendon": "120%"}, "muscles[0].tendon: its tendons are 1.2 long together, and the whole muscle is 1:"),
        ({"origin": [-0.8, 0.0, 0.0], "insertion": [0.1, 0.0, 0.0]}, "its middle lies in the bone of 'joint_0'"),
        ({"thickness": 3.0}, "muscles[0].thickness: is 3 thick, where bone and skin are 0.25"),
        ({"insertion": {"joint": "joint_9"}}, "muscles[0].insertion.joint: no node is named 'joint_9'; did you mean"),
        ({"activation": {"morph": "smile"}}, "activation.morph: the mesh has no morph target 'smile'"),
        ({"activation": {"keys": {"curl": [[0, 1]]}}}, "activation.keys.curl: the asset has no clip 'curl'"),
        (
            {"origin": [-0.5, 9.0, 0.0], "insertion": [0.5, 9.0, 0.0]},
            "there is no skin near it: its middle is 9 from the bone of 'joint_0', and skin",
        ),
    ],
)
def test_a_muscle_that_does_not_fit_gets_one_line(wrinkle: Wrinkle, tmp_path: Path, keys: Json, line: str) -> None:
    tools = tmp_path / "tools.yaml"
    write_tools(tools, tool(), muscles=[muscle(**keys)])
    ran = wrinkle("bake", ARM(), tools, "-o", tmp_path / "out.glb")
    assert ran.code == 1
    assert [line in each for each in ran.lines] == [True], ran.lines
    assert not (tmp_path / "out.glb").exists()


def test_check_tells_of_muscles(wrinkle: Wrinkle, tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", tool(), muscles=[muscle()])
    ran = wrinkle("check", "-v", ARM(), tools)
    assert ran.code == 0
    assert "ends     joint_0 to joint_1, along joint_0" in ran.out
    assert "% long, bulges by up to" in ran.out


def test_a_muscle_that_no_joint_shortens_is_warned_of(wrinkle: Wrinkle, tmp_path: Path) -> None:
    text = {"version": 1, "muscles": [muscle(insertion=[-0.2, 0.1, 0.0])]}
    tools = tmp_path / "tools.yaml"
    tools.write_text(json.dumps(text))
    ran = wrinkle("check", "-v", ARM(), tools)
    assert "both ends are on 'joint_0', so no joint shortens it" in ran.out
    assert "bulges by up to 0, skin gains 0 of volume" in ran.out


@pytest.mark.slow
@pytest.mark.long
def test_contact_keeps_apart_what_muscles_press_together() -> None:
    """The fold is solved on the skin that the muscle has moved, or left out with its wrinkles lowered."""
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    crease = tool(bumps=3, max_height="10%", contact="resolve")
    for thickness in ("5%", "20%"):
        file = bake_once(folding_limb(), crease, top={"muscles": [muscle(thickness=thickness)]})
        data = report_of(file).data
        assert [fold["tools"] for fold in data["folds"]] == [["crease"]]
        assert data["clips"][0]["residual"]["position"] < data["meshes"][0]["max_error"]


@pytest.mark.slow
@pytest.mark.long
def test_a_fold_over_a_muscle_that_gets_no_contact_has_lower_wrinkles(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The muscle stands before the tools among the effects, and stays as it is."""
    pytest.importorskip("ipctk", reason="needs the extra `contact`")
    from wrinklecli.effects.contact.tissue import Tissue

    def degenerate(_: Tissue) -> Tissue:
        raise FloatingPointError

    monkeypatch.setattr(Tissue, "ready", degenerate)
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=3, contact="resolve"), muscles=[muscle(travel=False)])
    report = wrinklecli.bake(folding_limb(), tools, tmp_path / "out.glb")
    (fold,) = report.data["folds"]
    assert fold["targets"] == []
    assert fold["left"][0]["height"] < 1.0
    assert report.data["muscles"][0]["targets"] == ["wrinkle_biceps_1", "wrinkle_biceps_2"]


@pytest.mark.slow
def test_a_marker_and_a_position_are_carried_by_their_bones() -> None:
    """A marker below a joint and a place near a bone move as the same ends given by joints do."""
    asset = limb_asset(rings=41, sides=24, angle=90.0)
    asset.gltf["nodes"].append({"name": "tip", "translation": [0.15, 0.1, 0.0]})
    asset.gltf["nodes"][2]["children"] = [len(asset.gltf["nodes"]) - 1]
    ends = {"origin": [-0.85, 0.1, 0.0], "insertion": {"marker": "tip"}}
    bakes = ((place(asset), ends), (ARM(), {}))
    marked, plain = (bake_once(each, top={"muscles": [muscle(**keys)]}) for each, keys in bakes)
    assert [drive_of(marked)[key]["joints"] for key in ("origin", "target")] == [["joint_0"], ["joint_1"]]
    assert marked.weights("limb", "fold", [1.0]) == pytest.approx(plain.weights("limb", "fold", [1.0]), abs=1e-5)


@pytest.mark.slow
def test_a_coarse_limb_is_split_where_the_bulge_curves() -> None:
    """On eight faces the bulge is as high and as round as on many, and a fine limb stays as it is."""
    found = {}
    for rings, sides in ((9, 8), (61, 48)):
        asset = ARM(rings=rings, sides=sides, seam=False)
        report = report_of(bake_once(asset, top={"muscles": [muscle()]}, fine=True)).data
        (described,), (mesh,) = report["muscles"], report["meshes"]
        found[sides] = (
            described["height_limit"],
            described["moved_vertices"],
            mesh["vertices"] - mesh["coarse_vertices"],
        )
    assert found[8][0] == pytest.approx(found[48][0], rel=0.15)
    assert found[8][1] > 40
    assert found[8][2] > 0
    assert found[48][2] == 0


@pytest.mark.parametrize(("angle", "warned"), [(125.0, True), (25.0, False)])
def test_a_bulge_that_passes_through_the_other_limb_is_warned_of(angle: float, warned: bool) -> None:
    """A limb that folds onto itself: the line names the clip, the moment and the depth."""
    file = bake_once(ARM(angle=angle, rings=31, sides=16), top={"muscles": [muscle(thickness="30%")]})
    lines = [line for line in report_of(file).data["warnings"] if "passes through other skin" in line]
    assert bool(lines) == warned
    start = "biceps: passes through other skin in 'fold' at 1 s, which it lifts by up to 0."
    assert all(line.startswith(start) for line in lines)


@pytest.mark.quick(1)
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("gap", "share"), [(0.1, RADIUS / (RADIUS + 0.1)), (0.65, 1.0)])
def test_a_muscle_below_clothes_is_as_thick_as_the_body_leaves_room(gap: float, share: float, turned: bool) -> None:
    """A bone in the limb, far below its skin, takes no room. The other mesh counts as `rest` has turned it."""
    asset = place(sleeved_limb(gap=gap, rings=41, sides=24, angle=90.0))
    offsets = [[-0.4 * RADIUS, x, 0.0] if turned else [x, 0.4 * RADIUS, 0.0] for x in (0.45, 1.4)]
    origin, insertion = ({"joint": "joint_1", "offset": offset} for offset in offsets)
    rest = {"rest": {"clip": "fold", "time": 1.0}} if turned else {}
    described = {}
    for node in ("limb", "sleeve"):
        top = {"muscles": [muscle(node=node, origin=origin, insertion=insertion)], **rest}
        (described[node],) = report_of(bake_once(asset, top=top)).data["muscles"]
    assert described["limb"]["thickness"] == pytest.approx(THICKNESS * described["limb"]["depth"])
    assert described["sleeve"]["thickness"] == pytest.approx(THICKNESS * share * described["sleeve"]["depth"], rel=0.02)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("gap", "every", "nodes", "warned"),
    [
        (0.02, 1, ["limb"], True),
        (0.02, 20, ["limb"], True),
        (0.65, 1, ["limb"], False),
        (0.02, 1, ["sleeve"], False),
        (0.02, 1, ["limb", "sleeve"], False),
    ],
)
def test_clothes_that_a_muscle_reaches_and_that_do_not_swell_are_warned_of(
    gap: float, every: int, nodes: list[str], warned: bool
) -> None:
    """A sleeve near the skin of a biceps, even of three rings; not a wide one, nor the body below the sleeve's own."""
    asset = place(sleeved_limb(gap=gap, every=every, rings=41, sides=24, angle=90.0))
    muscles = [muscle(name=node, node=node) for node in nodes]
    said = report_of(bake_once(asset, top={"muscles": muscles})).data["warnings"]
    assert [line for line in said if " over it " in line] == warned * [
        "limb: 'sleeve' over it stays as at rest: the skin may come through; a copy of the muscle with `node: sleeve`"
        " lets clothes swell too"
    ]


@pytest.mark.quick(1)
@pytest.mark.parametrize("depth", [0.045, 0.05])
def test_a_biceps_at_a_right_angle_bulges_as_much_as_that_of_a_human(depth: float) -> None:
    """8 to 14 mm, on an arm of which bone and skin are 45 or 50 mm apart."""
    (bent,) = report_of(flexed()).data["clips"][0]["muscles"]
    assert 0.008 < bent["bulge"][1] * depth / RADIUS < 0.014


@pytest.mark.slow
def test_a_touch_beside_a_joint_that_a_muscle_bulges_is_baked() -> None:
    """The places of a touch know fewer morph targets than the joint that bends its skin: it was an error of numpy's."""
    touch = {"name": "spot", "at": [-0.25, 0.25, 0.0], "pad": 0.12, "keys": {"fold": [[0.2, 0, 0], [0.8, 0.05, 0.02]]}}
    file = bake_once(folding_limb(), top={**UNREFINED, "muscles": [muscle()], "touches": [touch]})
    targets = [each["targets"] for key in ("muscles", "touches") for each in report_of(file).data[key]]
    assert all(targets)
