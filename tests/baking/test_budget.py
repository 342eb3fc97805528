"""Engine budgets: a bake within the limits does not change, one beyond changes little or is refused."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import wrinklecli
from kit.bakes import bake_once, place
from kit.fields import bake_field, sleeve, sleeve_and_field
from kit.limb import limb_asset, tool, write_tools
from kit.player import Gltf, Json, anchor_distances, described, wrinkle_columns
from kit.samples import BACK, BROW, PALM, Editor, edited, sample
from wrinklecli.baking import morphs as encode
from wrinklecli.baking import proof
from wrinklecli.baking.budget import BUDGETS, mesh_texture_bytes, storage
from wrinklecli.character import weight_track
from wrinklecli.choices import STORAGES, Engine, Storage
from wrinklecli.cli import main
from wrinklecli.effects.effect import Target
from wrinklecli.effects.shapes import Shape
from wrinklecli.effects.wrinkle.remix import unit_weights
from wrinklecli.errors import RefusedError

# Twelve targets, as many at a time.
ROUGH: Json = {**PALM, "profile": "polyline", "details": [0.2, 0.1], "strategy": "origin", "bumps": 3}
TIMES = np.linspace(0.0, 2.0, 97)
SLOW = pytest.mark.slow


def active(file: Gltf, node: str) -> int:
    """Most targets of a weight other than 0 at and between keys, in any clip."""
    most = 0
    for clip in file.json["animations"]:
        _, values = file.keys(clip["name"], node)
        shown = values != 0
        most = max(most, int((shown[:-1] | shown[1:]).sum(axis=1).max()))
    return most


def report_of(tmp_path: Path, asset: Path, *tools: Json, **options: Any) -> Json:
    made = wrinklecli.bake(asset, write_tools(tmp_path / "tools.yaml", *tools), tmp_path / "out.glb", **options)
    return made.data


@pytest.mark.quick(1, 2)
# Others have the limits of these: blender those of unity, and filament, godot3, unreal parts of three and vtk.
@pytest.mark.parametrize("engine", ["cesium", "unity", "spec8", "three", "vtk"])
def test_what_is_within_a_budget_stays_as_it_is(engine: Engine) -> None:
    plain = bake_once("wrist", PALM, BACK, accessors=storage(engine, "sparse"))
    held = bake_once("wrist", PALM, BACK, engine=engine)
    assert plain.path.read_bytes() == held.path.read_bytes()


@pytest.mark.parametrize(
    ("engine", "stored"),
    [
        (None, ("sparse", "based", "dense")),
        ("three", ("sparse", "based", "dense")),
        ("filament", ("based", "based", "dense")),
        ("cesium", ("dense", "dense", "dense")),
    ],
)
def test_targets_are_stored_as_wanted_where_the_engine_reads_that(
    engine: Engine | None, stored: tuple[Storage, ...]
) -> None:
    assert tuple(storage(engine, wanted) for wanted in STORAGES) == stored


def test_a_weight_that_is_written_as_one_is_within_the_limits_of_unity() -> None:
    """Processors round sums differently: a weight may be 1 and a little, which the file holds as 1."""
    vertex = np.zeros(1, np.intp)
    target = Target("bump", Shape(vertex, np.ones((1, 3)), 1.0, vertex, np.zeros((1, 3))))
    above = np.nextafter(np.float32(1.0), np.float32(2.0))
    for peak, changes in ((1.0, False), (1.0 + 2.0**-50, False), (float(above), True)):
        assert (unit_weights([target], np.array([[0.0], [peak]])) is not None) == changes


@pytest.mark.slow
@pytest.mark.long
def test_spec8_reduces_to_eight_at_a_time(tmp_path: Path) -> None:
    plain, held = bake_once("wrist", ROUGH), bake_once("wrist", ROUGH, engine="spec8")
    assert active(plain, "wrist") > 8
    assert active(held, "wrist") <= 8
    tallest = report_of(tmp_path, sample("wrist"), ROUGH)["tallest_wrinkle"]
    for clip in ("flex", "extend"):
        apart = np.linalg.norm(plain.pose("wrist", clip, TIMES) - held.pose("wrist", clip, TIMES), axis=2)
        assert apart.max() < 0.01 * tallest
    assert np.abs(held.keys("flex", "wrist")[1]).max() <= 1 + 1e-6


@pytest.mark.slow
def test_the_report_says_what_was_reduced(tmp_path: Path) -> None:
    data = report_of(tmp_path, sample("wrist"), ROUGH, engine="spec8")
    (mesh,) = data["engine"]["meshes"]
    (reduced,) = mesh["reduced"]
    out = Gltf(tmp_path / "out.glb")
    assert data["engine"]["name"] == "spec8"
    assert data["engine"]["limits"]["active"] == 8
    assert reduced["tool"] == "palm"
    assert reduced["from"] == len(bake_once("wrist", ROUGH).deltas("wrist"))
    assert reduced["to"] == mesh["targets"] == len(out.deltas("wrist")) == len(data["tools"][0]["targets"])
    assert 0 < reduced["error"] <= 0.25 * data["meshes"][0]["max_error"]
    assert mesh["active"] == active(out, "wrist")


@pytest.mark.slow
@pytest.mark.long
def test_reduced_targets_do_not_depend_on_the_clips() -> None:
    """Whether a tool is reduced does: `extend` alone needs few at a time. How it is, does not."""
    both, one = bake_once("wrist", ROUGH, engine="spec8"), bake_once("wrist", ROUGH, engine="spec8", clips=["flex"])
    assert np.array_equal(both.deltas("wrist"), one.deltas("wrist"))
    assert described(both) == described(one)


@pytest.mark.slow
def test_extras_play_reduced_targets() -> None:
    held = bake_once("wrist", ROUGH, engine="spec8")
    (tool,) = held.json["nodes"][0]["extras"]["wrinkle"]["tools"]
    names = held.mesh("wrist")["extras"]["targetNames"]
    assert tool["targets"] == names
    times, values = held.keys("flex", "wrist")
    shortenings = 1 - anchor_distances(held, tool, "wrist", "flex", times) / tool["rest_length"]
    table = np.array(tool["weights"])
    for column in range(len(names)):
        replayed = np.interp(shortenings, tool["shortenings"], table[:, column])
        assert np.abs(values[:, column] - replayed).max() < 0.02


IN_TURN: Json = {**BROW, "strategy": "origin", "bumps": 5, "mirror": "x", "name": "brow.L"}


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("asset", "tools"),
    [
        ("wrist", [{**PALM, "strategy": "origin", "bumps": 12, "max_height": "2%", "rest_length": "85%"}]),
        ("wrist", [{**PALM, "strategy": "origin", "bumps": 12, "max_height": "2%"}, {**BACK, "bumps": 3}]),
        ("head", [{**BROW, "strategy": "origin", "bumps": 9}]),
        ("head", [IN_TURN]),
        ("head", [{**BROW, "strategy": "both_ends", "bumps": 20, "clips": {"raise_brows": 0.4}}]),
        ("head", [{**BROW, "strategy": "origin", "bumps": 9, "clips": {"raise_brows": -0.5}}]),
    ],
)
def test_bumps_that_rise_in_turn_take_two_targets_at_a_time(asset: str, tools: list[Json]) -> None:
    """Exactly as before, at and between keys, by as many targets."""
    plain, held = bake_once(asset, *tools), bake_once(asset, *tools, engine="spec8")
    assert active(plain, asset) > 8 >= active(held, asset)
    assert held.mesh(asset)["extras"]["targetNames"] == plain.mesh(asset)["extras"]["targetNames"]
    # Vertices that no target moves are the same, and many.
    for name in ("POSITION", "NORMAL"):
        assert np.array_equal(plain.attribute(asset, name), held.attribute(asset, name))
    moved = np.any(
        [file.deltas(asset, name) for file in (plain, held) for name in ("POSITION", "NORMAL")], axis=(0, 1, 3)
    )
    for clip in (each["name"] for each in plain.json["animations"]):
        times, values = held.keys(clip, asset)
        assert values.min() > -1 - 1e-6
        assert values.max() < 1 + 1e-6
        tallest = np.linalg.norm(plain.deltas(asset), axis=2).max()
        # Each is within 1 % of the method; at the keys of both they are the same, but for weights that are left out.
        every = np.union1d(times[:: 1 + len(times) // 100], np.linspace(times[0], times[-1], 43))
        every = every[promised(every, times) & promised(every, plain.keys(clip, asset)[0])]
        both = np.intersect1d(times, plain.keys(clip, asset)[0])
        for at, share in ((every, 2e-2), (both[:: 1 + len(both) // 60], 1e-3)):
            apart = np.linalg.norm(plain.pose(asset, clip, at, moved) - held.pose(asset, clip, at, moved), axis=2)
            assert apart.max() < share * tallest
        normals = [file.normals(asset, clip, every[::8], moved) for file in (plain, held)]
        turned = np.sum(normals[0] * normals[1], axis=2)
        assert turned.min() > np.cos(np.radians(0.5))


def promised(at: NDArray[np.float64], keys: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which times are keys, or between two that are more than a millisecond or two apart."""
    after = np.clip(np.searchsorted(keys, at), 1, len(keys) - 1)
    return np.isin(at, keys) | (keys[after] - keys[after - 1] >= 0.002)


@pytest.mark.slow
@pytest.mark.long
def test_a_forehead_of_three_tools_plays_with_eight_targets(tmp_path: Path) -> None:
    side = {"name": "brow.L", "mirror": "x", "origin": [0.033, 0.2402, 0.083], "target": [0.027, 0.2881, 0.0639]}
    middle = {"name": "brow_middle", "origin": [0.0, 0.2395, 0.089], "target": [0.0, 0.2875, 0.0717]}
    # The five bumps of each rise one after the other until the brows are up.
    rise = {"strategy": "origin", "bumps": 5, "max_height": "3.5%", "rest_length": "92%", "compressible": "35%"}
    look = {"width": 0.06, "profile": "skin", "seed": 2}
    tools = write_tools(tmp_path / "tools.yaml", side, middle, defaults={**rise, **look})
    made = wrinklecli.bake(sample("head"), tools, tmp_path / "out.glb", engine="spec8", details=True)
    out = Gltf(tmp_path / "out.glb")
    (mesh,) = made.data["engine"]["meshes"]
    assert mesh["active"] == active(out, "head") <= 8
    # POSITION and NORMAL of each.
    assert mesh["active_attributes"] == 2 * mesh["active"]
    assert [each["error"] for each in mesh["reduced"]] == [0, 0, 0]
    assert max(each["at_once"] for each in mesh["reduced"]) == 2
    raised = next(each for each in made.data["clips"] if each["name"] == "raise_brows")
    assert 0 < raised["residual"]["weights"] <= made.data["meshes"][0]["max_error"]


@pytest.mark.slow
def test_targets_in_turn_do_not_depend_on_the_clips() -> None:
    every, none = (
        bake_once("head", IN_TURN, engine="spec8"),
        bake_once("head", IN_TURN, engine="spec8", clips=["think"]),
    )
    assert active(none, "head") <= 8
    plain = bake_once("head", IN_TURN)
    # Whether it is asked for depends on them; what comes of it does not.
    assert np.array_equal(none.deltas("head"), plain.deltas("head"))
    assert not np.array_equal(every.deltas("head"), plain.deltas("head"))
    assert every.json["nodes"][0]["extras"]["wrinkle"]["tools"][0]["targets"] == [
        f"wrinkle_brow_L_{k}" for k in range(1, 6)
    ]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("tool", [ROUGH, {**BROW, "strategy": "origin", "bumps": 9}])
def test_heights_of_other_shapes_are_proven_at_all_times(
    tool: Json, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A single key that is wrong, at a time at which no positions are compared."""
    widen = weight_track.widen
    asset, clip = ("wrist", "flex") if tool is ROUGH else ("head", "raise_brows")

    def no_positions(*_: Any) -> Any:
        return np.zeros(1, np.intp)

    def wrong(channel: Any, rig: Any, clip: Any, times: Any, weights: Any) -> Any:
        changed = weights.copy()
        changed[len(weights) // 2] *= 0.97
        return widen(channel, rig, clip, times, changed)

    monkeypatch.setattr(proof, "_chosen_times", no_positions)
    report_of(tmp_path, sample(asset), tool, engine="spec8", clips=[clip])
    monkeypatch.setattr(encode, "widen", wrong)
    with pytest.raises(RefusedError, match="the file would be off by"):
        report_of(tmp_path, sample(asset), tool, engine="spec8", clips=[clip])


MANY = [{**PALM, "name": f"palm{number}"} for number in range(9)]


@pytest.mark.slow
def test_what_cannot_be_held_is_refused_and_nothing_written(tmp_path: Path) -> None:
    """Nine tools, of which each needs a target of its own."""
    with pytest.raises(RefusedError) as caught:
        report_of(tmp_path, sample("wrist"), *MANY, engine="spec8")
    assert caught.value.exit_code == 3
    assert "wrist: needs 9 morph targets at once in flex" in str(caught.value)
    assert "1 of palm0, 1 of palm1" in str(caught.value)
    assert "--engine spec8 allows 8" in str(caught.value)
    assert "fewer tools on this mesh" in str(caught.value)
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.slow
def test_a_field_with_too_many_targets_is_named_with_its_remedy(tmp_path: Path) -> None:
    """Nothing is said of bumps, which it has none of. One target is its least, and the asset's own are four."""
    path = place(sleeve(morphs=4))
    _, tools = sleeve_and_field(tmp_path)
    with pytest.raises(RefusedError, match=r"allows 4\. Fewer `joints` of 'folds' would help$"):
        wrinklecli.bake(path, tools, tmp_path / "out.glb", engine="vtk")
    asset, _ = sleeve_and_field(tmp_path)
    wrinklecli.bake(asset, tools, tmp_path / "out.glb", engine="vtk")


@pytest.mark.slow
def test_unity_gets_no_weights_of_a_field_above_1() -> None:
    """The shapes are larger in their place where a strength is above 1."""
    plain, held = (bake_field({"strength": 0.5, "clips": {"fold": 2.0}}, engine=engine) for engine in (None, "unity"))
    for clip in ("fold", "wave"):
        times, _ = plain.keys(clip, "limb")
        weights, other = (each.weights("limb", clip, times) for each in (plain, held))
        assert other.max() <= 1.0
        moves, others = (
            np.tensordot(rows, each.deltas("limb"), axes=1) for rows, each in ((weights, plain), (other, held))
        )
        assert np.abs(moves - others).max() < 1e-6
    assert plain.keys("fold", "limb")[1].max() == pytest.approx(2.0, rel=1e-3)
    (drive,) = held.json["nodes"][held.node("limb")]["extras"]["wrinkle"]["fields"]
    assert (drive["strength"], drive.get("strengths", {}).get("fold", 1.0)) == (0.25, 1.0)


@pytest.mark.slow
def test_more_targets_than_three_takes_are_refused(tmp_path: Path) -> None:
    def many_targets(editor: Editor) -> None:
        for primitive in editor.json["meshes"][0]["primitives"]:
            index = primitive["attributes"]["POSITION"]
            count = editor.json["accessors"][index]["count"]
            zeros = {"componentType": 5126, "count": count, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0]}
            editor.json["accessors"].append(zeros)
            primitive["targets"] = [{"POSITION": len(editor.json["accessors"]) - 1}] * 256

    with pytest.raises(RefusedError, match=r"has 257 morph targets, 256 of them the asset's own.*allows 256"):
        report_of(tmp_path, edited("wrist", many_targets), PALM, engine="three")


@pytest.mark.quick(1, 2)
@pytest.mark.parametrize(
    ("base", "strengths"),
    [
        (PALM, {"flex": -0.5}),
        (PALM, {"flex": 2.0}),
        pytest.param(ROUGH, {"flex": -1.5, "extend": 0.5}, marks=SLOW),
    ],
)
def test_unity_gets_weights_from_0_to_1_and_the_same_motion(base: Json, strengths: Json) -> None:
    """And so does Blender."""
    assert BUDGETS["blender"] == BUDGETS["unity"]
    rough = {**base, "clips": strengths}
    plain, held = bake_once("wrist", rough), bake_once("wrist", rough, engine="unity")
    columns = wrinkle_columns(held, "wrist")
    for clip in ("flex", "extend"):
        values = held.keys(clip, "wrist")[1][:, columns]
        assert values.min() >= 0
        assert values.max() <= 1
        apart = plain.pose("wrist", clip, TIMES) - held.pose("wrist", clip, TIMES)
        assert np.abs(apart).max() < 1e-7
        turned = np.sum(plain.normals("wrist", clip, TIMES[::8]) * held.normals("wrist", clip, TIMES[::8]), axis=2)
        assert turned.min() > 1 - 1e-6
    names = held.mesh("wrist")["extras"]["targetNames"]
    assert names == [f"wrinkle_palm_{number}" for number in range(1, len(names) + 1)]


@pytest.mark.slow
def test_unity_gets_weights_up_to_1_where_a_longer_rest_length_makes_wrinkles_higher() -> None:
    tool = {**PALM, "clips": {"flex": 2.0}, "rest_length": {"keys": {"flex": [[0, "100%"], [1, "125%"]]}}}
    plain, held = bake_once("wrist", tool), bake_once("wrist", tool, engine="unity")
    peaks = [file.keys("flex", "wrist")[1][:, wrinkle_columns(file, "wrist")].max() for file in (plain, held)]
    assert peaks == pytest.approx([2.0, 1.0], abs=1e-3)
    assert peaks[1] <= 1
    apart = plain.pose("wrist", "flex", TIMES) - held.pose("wrist", "flex", TIMES)
    assert np.abs(apart).max() < 1e-7


def test_unity_splits_targets_of_posed_displacements() -> None:
    limb, posed = place(limb_asset(rings=9, sides=8)), tool(attachment="patch", bumps=2)
    plain, held = (bake_once(limb, posed, engine=engine, fps=5) for engine in (None, "unity"))
    assert plain.keys("fold", "limb")[1].min() < 0
    assert held.keys("fold", "limb")[1].min() >= 0
    assert np.abs(plain.pose("limb", "fold", TIMES) - held.pose("limb", "fold", TIMES)).max() < 1e-6


def _second_joints(editor: Editor, share: float) -> None:
    """A share of each vertex's heaviest weight moves to JOINTS_1, on the first joint."""
    for primitive in editor.json["meshes"][0]["primitives"]:
        attributes = primitive["attributes"]
        accessor = editor.json["accessors"][attributes["WEIGHTS_0"]]
        count, view = accessor["count"], editor.json["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        weights = np.frombuffer(bytes(editor.data), "<f4", 4 * count, start).reshape(-1, 4).copy()
        second = np.zeros((count, 4), np.float32)
        second[:, 0] = share * weights[:, 0]
        weights[:, 0] -= second[:, 0]
        attributes["WEIGHTS_0"] = editor.accessor(weights)
        attributes["WEIGHTS_1"] = editor.accessor(second)
        attributes["JOINTS_1"] = editor.accessor(np.zeros((count, 4), np.uint8))


def empty_second_set(editor: Editor) -> None:
    _second_joints(editor, 0.0)


def full_second_set(editor: Editor) -> None:
    _second_joints(editor, 0.5)


def test_three_gets_four_joints_for_new_vertices() -> None:
    asset = edited("wrist", empty_second_set)
    held = bake_once(asset, PALM, engine="three")
    old = len(Gltf(asset).attribute("wrist", "POSITION"))
    new = held.attribute("wrist", "WEIGHTS_1")[old:]
    assert len(new)
    assert not new.any()
    assert held.attribute("wrist", "WEIGHTS_0")[old:].sum(axis=1) == pytest.approx(1, abs=1e-6)


@pytest.mark.quick(1)
@pytest.mark.parametrize("engine", ["three", "filament", "unreal"])
def test_vertices_of_more_joints_than_an_engine_reads_are_refused(engine: Engine, tmp_path: Path) -> None:
    with pytest.raises(RefusedError, match=f"vertices of more than 4 joints, which --engine {engine} would put off by"):
        report_of(tmp_path, edited("wrist", full_second_set), PALM, engine=engine)
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize(
    ("targets", "attributes"),
    [([], 0), ([{"POSITION": 0}], 1), ([{}, {"POSITION": 0}], 2), ([{"POSITION": 0}, {"NORMAL": 0}], 4)],
)
def test_gpu_bytes_of_a_document_are_those_of_its_targets(targets: list[Json], attributes: int) -> None:
    """Each target takes normals if one has them, in each primitive by itself."""
    gltf = {"accessors": [{"count": 5}, {"count": 7}]}
    parts: list[Json] = [{"attributes": {"POSITION": number}} for number in (0, 1)]
    parts[1]["targets"] = [{"POSITION": 0}]
    parts[0] |= {"targets": targets} if targets else {}
    assert mesh_texture_bytes(gltf, {"primitives": parts}) == (5 * attributes + 7) * 16


@pytest.mark.slow
def test_gpu_bytes_are_those_of_float_textures(tmp_path: Path) -> None:
    """targets x vertices x (POSITION, NORMAL) x 16 bytes, however sparse the file."""
    made = wrinklecli.bake(sample("head"), write_tools(tmp_path / "tools.yaml", BROW), tmp_path / "out.glb")
    out = Gltf(tmp_path / "out.glb")
    targets, vertices, _ = out.deltas("head").shape
    assert made.data["meshes"][0]["gpu_bytes"] == targets * vertices * 2 * 16
    assert f"{targets * vertices * 32 / 1e6:.1f} MB of targets on a GPU" in made.summary


@pytest.mark.slow
def test_the_command_line_refuses_with_its_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tools = write_tools(tmp_path / "tools.yaml", *MANY)
    arguments = [
        "wrinkle",
        "bake",
        str(sample("wrist")),
        str(tools),
        "-o",
        str(tmp_path / "out.glb"),
        "--engine",
        "spec8",
    ]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 3
    assert "--engine spec8 allows 8" in capsys.readouterr().err
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.quick(1)
@pytest.mark.parametrize("engine", ["godot3", "vtk", "filament"])
@pytest.mark.parametrize("accessors", ["sparse", "dense"])
def test_engines_that_need_a_base_get_one(engine: str, accessors: str) -> None:
    after = bake_once("wrist", PALM, engine=engine, accessors=accessors)
    sparse = [accessor for accessor in after.json["accessors"] if "sparse" in accessor]
    assert bool(sparse) == (accessors == "sparse")
    assert all("bufferView" in accessor for accessor in sparse)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("made", "options", "most"),
    [
        ({}, {}, 5),
        ({"uvs": False}, {}, 6),
        ({"morphs": 2}, {}, 5),
        ({"tangents": True}, {"morph_tangents": True}, 3),
        ({"tangents": True}, {}, 5),
        ({"colors": True, "influences": 8, "primitives": 2}, {}, 4),
    ],
)
def test_cesium_gets_as_many_targets_as_its_vertex_attributes_hold(made: Json, options: Json, most: int) -> None:
    """A vertex has sixteen attributes there, the mesh's own among them."""
    path = place(limb_asset(rings=12, sides=8, **made))
    own = len(Gltf(path).json["meshes"][0]["primitives"][0].get("targets", []))

    def held(targets: int) -> Gltf:
        return bake_once(path, tool(strategy="origin", bumps=targets - own), engine="cesium", **options)

    file = held(most)
    taken = [
        len(primitive["attributes"]) + sum(map(len, primitive["targets"]))
        for primitive in file.mesh("limb")["primitives"]
    ]
    each = taken[0] - len(file.mesh("limb")["primitives"][0]["attributes"])
    assert max(taken) <= 16 < max(taken) + each // most
    assert not [accessor for accessor in file.json["accessors"] if "sparse" in accessor]
    with pytest.raises(
        RefusedError,
        match=f"limb: has {most + 1} morph targets, {own} of them the asset's own; --engine cesium allows {most}, as a"
        " vertex has 16 attributes there. Fewer bumps",
    ):
        held(most + 1)


@pytest.mark.slow
@pytest.mark.long
def test_targets_are_reduced_to_what_cesium_holds() -> None:
    rough = {**ROUGH, "bumps": 2}
    plain, held = bake_once("wrist", rough), bake_once("wrist", rough, engine="cesium")
    assert (len(plain.deltas("wrist")), len(held.deltas("wrist"))) == (8, 5)
    tallest = np.linalg.norm(plain.deltas("wrist"), axis=2).max()
    apart = np.linalg.norm(plain.pose("wrist", "flex", TIMES) - held.pose("wrist", "flex", TIMES), axis=2)
    assert 0 < apart.max() < 0.01 * tallest


@pytest.mark.slow
def test_vtk_gets_at_most_four_targets(tmp_path: Path) -> None:
    many = {**PALM, "strategy": "origin", "bumps": 6}
    assert len(bake_once("wrist", many).deltas("wrist")) == 6
    tools = write_tools(tmp_path / "tools.yaml", many)
    with pytest.raises(RefusedError, match="--engine vtk allows 4"):
        wrinklecli.bake(sample("wrist"), tools, tmp_path / "out.glb", engine="vtk")
