"""Whole bakes with fields: right in other people's programs, the same bytes each time, and in time and memory."""

import json
import os
import subprocess
import sys
import tracemalloc
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from kit.asset import Json, attribute
from kit.bakes import bake_once, place, report_of
from kit.clients import assert_valid, compare_with_three, drive
from kit.garments import attached, many_joints, renumbered, tools_file, tube, with_attribute
from kit.limb import sleeved_limb, tool
from kit.places import ROOT
from kit.player import Floats, Gltf, wrinkle_columns
from wrinklecli.baking.track import track
from wrinklecli.review.check import check

TIMES = np.linspace(0.0, 2.0, 9)
TUBE = cache(lambda: place(tube()))
TWO_BENDS = cache(lambda: place(tube(joints=3, rings=31)))
ONE: Json = {"fields": [{"name": "folds"}]}
# No edge is halved: what a field is asked here does not hang on it.
FLAT: Json = {"max_levels": 0}


def extras_of(file: Gltf) -> list[Json]:
    found: list[Json] = file.json["nodes"][file.node("limb")]["extras"]["wrinkle"]["fields"]
    return found


def weights_of(file: Gltf, times: Floats = TIMES) -> Floats:
    return file.weights("limb", "fold", times)[:, wrinkle_columns(file, "limb")]


@pytest.mark.slow
@pytest.mark.parametrize("made", [TUBE, TWO_BENDS], ids=["one bend", "two bends"])
def test_a_bake_is_valid_and_other_programs_show_it_as_it_is(made: object) -> None:
    file = bake_once(made(), top=ONE)
    assert_valid(file.path)
    compare_with_three(file.path, "limb", "fold", TIMES, file.pose("limb", "fold", TIMES))


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("options", [{"engine": "unity"}, {"split": True}, {"accessors": "dense"}, {"fps": 12}])
def test_forms_of_a_bake_are_valid(options: Json) -> None:
    file = bake_once(TWO_BENDS(), top=ONE, **options)
    assert_valid(file.path)


@cache
def _many_turns() -> Path:
    """A tube with links that are longer than it is thick: in a crease of shorter ones, tall folds are lowered."""
    asset = many_joints(10, rings=40)
    return place(with_attribute(asset, "POSITION", attribute(asset, 0, "POSITION") * [1.0, 0.2, 0.2]))


@pytest.mark.slow
@pytest.mark.long
def test_an_engine_gets_the_main_shapes_of_a_field() -> None:
    """A limit is held by fewer shapes, not refused; joints without any are named."""
    whole, held = (bake_once(_many_turns(), top=ONE, **FLAT, **each) for each in ({}, {"engine": "vtk"}))
    every, few = (wrinkle_columns(each, "limb") for each in (whole, held))
    assert len(every) > 4
    assert len(few) == 4
    report = report_of(held).data
    (change,) = report["engine"]["meshes"][0]["reduced"]
    assert (change["from"], change["to"]) == (len(every), 4)
    (entry,) = report["fields"]
    assert len(entry["targets"]) == 4
    assert all(1 <= each["shapes"] <= 4 for each in entry["turns"])
    assert entry["error"] > report_of(whole).data["fields"][0]["error"]
    shown = {each["joint"] for each in entry["turns"]}
    hidden = {each["joint"] for each in report_of(whole).data["fields"][0]["turns"]} - shown
    said = " ".join(report["warnings"])
    assert hidden
    assert all(f"'{name}'" in said for name in hidden)
    # What is left moves the surface as far as the whole did.
    deltas = [np.linalg.norm(each.deltas("limb")[columns], axis=2) for each, columns in ((whole, every), (held, few))]
    assert deltas[1].max() > 0.5 * deltas[0].max()


@pytest.mark.slow
def test_a_bake_is_within_its_error() -> None:
    file = bake_once(TWO_BENDS(), top=ONE)
    report = report_of(file).data
    for clip in report["clips"]:
        assert clip["residual"]["position"] <= report["meshes"][0]["max_error"]


def test_weights_are_0_at_rest_and_never_above_1() -> None:
    weights = weights_of(bake_once(TUBE(), top=ONE), np.linspace(0.0, 1.0, 21))
    assert not weights[0].any()
    assert weights[-1].max() > 0.9
    assert (weights >= 0).all()
    assert weights.max() <= 1.0 + 1e-6


@pytest.mark.quick(1)
@pytest.mark.parametrize("seed", [1, 2])
def test_folds_rise_with_the_bend_until_a_crease_hides_some(seed: int) -> None:
    file = bake_once(place(tube(angle=40.0)), top={"fields": [{"name": "folds", "seed": seed}]})
    deltas = file.deltas("limb")[wrinkle_columns(file, "limb")]
    weights = weights_of(file, np.linspace(0.0, 1.0, 21))
    moves = np.linalg.norm(np.tensordot(weights, deltas, axes=1), axis=(1, 2))
    assert (np.diff(moves) > 0.0).all()


def test_the_asset_itself_stays_as_it_is() -> None:
    """Its vertices keep their numbers, and at rest nothing of it moves."""
    before, after = Gltf(TUBE()), bake_once(TUBE(), top=ONE)
    one, other = (each.attribute("limb", "POSITION") for each in (before, after))
    assert (other[: len(one)] == one).all()
    at_rest = after.pose("limb", "fold", [0.0])[0]
    assert at_rest[: len(one)] == pytest.approx(before.pose("limb", "fold", [0.0])[0], abs=1e-6)


@pytest.mark.slow
def test_drivers_and_tracks_play_a_field_as_its_bake_does(tmp_path: Path) -> None:
    file = bake_once(TWO_BENDS(), top=ONE, **FLAT)
    names = file.mesh("limb")["extras"]["targetNames"]
    played, driven = (
        drive(file.path, node="limb", clip="fold", times=TIMES, driver=driver) for driver in (False, True)
    )
    for name in names:
        assert driven[name] == pytest.approx(played[name], abs=0.01)
    body = bake_once(TWO_BENDS(), top=ONE, tracks="none", **FLAT)
    (made,) = track(body.path, [TWO_BENDS()], tmp_path)
    found = Gltf(Path(made.path)).weights("limb", "fold", TIMES)
    assert found == pytest.approx(file.weights("limb", "fold", TIMES), abs=0.01)


@pytest.mark.slow
def test_clips_have_strengths_of_their_own() -> None:
    whole = bake_once(TUBE(), top=ONE, **FLAT)
    plain, columns = weights_of(whole), wrinkle_columns(whole, "limb")
    with_, without = (whole.pose("limb", "fold", [1.0], without=each)[0] for each in ((), columns))
    (field,) = report_of(whole).data["fields"]
    # Keys of each file may be off by 1 % of the tallest wrinkle; on so coarse a mesh no vertex rises as far.
    allowed = 0.01 * field["height_limit"] / np.linalg.norm(with_ - without, axis=1).max()
    for keys, factor in (({"strength": 0.5}, 0.5), ({"clips": {"fold": 0.25}}, 0.25)):
        file = bake_once(TUBE(), top={"fields": [{"name": "folds", **keys}]}, **FLAT)
        assert weights_of(file) == pytest.approx(factor * plain, abs=allowed * (1.0 + factor))
    (drive_,) = extras_of(file)
    assert drive_["strengths"] == {"fold": 0.25}


@pytest.mark.slow
def test_a_clip_in_which_a_field_has_no_strength_stays_smooth() -> None:
    file = bake_once(TUBE(), top={"fields": [{"name": "folds", "clips": {"fold": 0}}]}, **FLAT)
    assert not weights_of(file).any()


@pytest.mark.slow
def test_a_report_tells_of_turns_and_errors() -> None:
    (field,) = report_of(bake_once(TWO_BENDS(), top=ONE)).data["fields"]
    assert {each["joint"] for each in field["turns"]} == {"joint_1", "joint_2"}
    assert 0 <= field["least_error"] <= field["error"] + 1e-9 < 0.5
    # Turns share shapes, so each says how many it raises.
    assert all(1 <= each["shapes"] <= len(field["targets"]) <= 4 for each in field["turns"])


@pytest.mark.slow
def test_check_counts_the_shapes_that_a_bake_writes(tmp_path: Path) -> None:
    """A crease takes nothing back in a slight bend, so it is no target."""
    asset = place(tube(angle=40.0))
    (written,) = report_of(bake_once(asset, top=ONE, **FLAT)).data["fields"]
    (checked,) = check(asset, tools_file(tmp_path / asset.name, *ONE["fields"]), max_levels=0).data["fields"]
    assert checked["turns"] == written["turns"]
    assert checked["targets"] == written["targets"]
    assert [each["shapes"] for each in checked["turns"]] == [1]


@pytest.mark.parametrize("angle", [90.0, pytest.param(140.0, marks=pytest.mark.slow)])
def test_wrinkles_turn_no_triangle_over(angle: float) -> None:
    """Against the skin alone, at any moment; where that alone leaves hardly any area of a triangle, it is turning."""
    file = bake_once(place(tube(angle=angle)), top=ONE, **({"max_levels": 2} if angle > 100 else {}))
    columns, triangles = wrinkle_columns(file, "limb"), file.triangles("limb")
    times = np.linspace(0.0, 1.0, 11)
    faces = []
    for without in (columns, ()):
        a, b, c = (file.pose("limb", "fold", times, without=without)[:, triangles[:, k]] for k in range(3))
        faces.append(np.cross(b - a, c - a))
    sizes = np.linalg.norm(faces[0], axis=2)
    assert not ((np.sum(faces[0] * faces[1], axis=2) < 0) & (sizes > 0.1 * sizes[0])).any()


@pytest.mark.slow
def test_heights_in_a_file_are_those_that_are_measured() -> None:
    """At the deepest moment the folds of the file are as high as what was measured for that pose.

    The bend is one in which the skin does not pass through itself: in a crease that does, tall folds are lowered.
    """
    asset = tube(angle=60.0)
    file = bake_once(place(asset), top={"fields": [{"name": "folds", "variation": 0}]}, fine=True)
    _, field = attached(asset, variation=0)
    columns = wrinkle_columns(file, "limb")
    with_, without = (file.pose("limb", "fold", [1.0], without=each)[0] for each in ((), columns))
    moved = np.linalg.norm(with_ - without, axis=1)
    assert 0.5 * field.greatest_height < moved.max() < 1.1 * field.greatest_height


def baked_bytes(asset: Path, file: Path, out: Path, threads: int) -> bytes:
    environment = os.environ | dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), str(threads)
    )
    command = [sys.executable, "-m", "wrinklecli", "bake", asset, file, "-q", "-o", out]
    subprocess.run([str(each) for each in command], env=environment | {"PYTHONPATH": str(ROOT)}, check=True)
    return out.read_bytes()


@pytest.mark.slow
@pytest.mark.long
def test_the_same_bytes_whatever_the_threads(tmp_path: Path) -> None:
    file = tools_file(TWO_BENDS(), {"name": "folds"})
    one, two, again = (
        baked_bytes(TWO_BENDS(), file, tmp_path / f"{number}.glb", threads) for number, threads in enumerate((1, 2, 1))
    )
    assert one == two == again


@pytest.mark.slow
def test_vertices_with_other_numbers_give_the_same_surface() -> None:
    asset, order = renumbered(tube())
    plain, mixed = (bake_once(each, top=ONE) for each in (TUBE(), place(asset)))
    error = report_of(plain).data["meshes"][0]["max_error"]
    count = len(order)
    one, other = (each.pose("limb", "fold", [0.5, 1.0]) for each in (plain, mixed))
    # Each is off by the error at most.
    assert np.abs(one[:, :count] - other[:, order]).max() < 2.0 * error


@pytest.mark.slow
@pytest.mark.long
def test_memory_grows_no_faster_than_the_mesh() -> None:
    peaks = []
    for rings in (21, 81):
        asset = tube(rings=rings, sides=2 * rings)
        tracemalloc.start()
        attached(asset)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * (81 / 21) ** 2 * peaks[0]


@pytest.mark.slow
@pytest.mark.long
def test_very_many_joints_take_seconds(tmp_path: Path) -> None:
    asset = place(many_joints(500))
    file = bake_once(asset, top=ONE)
    assert 0 < len(wrinkle_columns(file, "limb")) <= 24
    assert not any(tmp_path.iterdir())


def test_a_sleeve_over_a_limb_gets_the_field_that_names_it() -> None:
    asset = place(sleeved_limb(rings=21, sides=16, angle=90.0))
    file = bake_once(asset, top={"fields": [{"name": "folds", "node": "sleeve"}]}, **FLAT)
    assert wrinkle_columns(file, "sleeve")
    assert not file.mesh("limb").get("extras", {}).get("targetNames")


@pytest.mark.slow
def test_a_body_without_clips_gets_its_targets() -> None:
    file = bake_once(place(tube(clip=None)), top=ONE, **FLAT)
    assert wrinkle_columns(file, "limb")
    assert any("there is no clip, so nothing folds yet" in warning for warning in report_of(file).data["warnings"])


@pytest.mark.slow
def test_a_clip_that_turns_no_joint_leaves_it_flat() -> None:
    file = bake_once(place(tube(clip="grow")), top=ONE, **FLAT)
    assert "folds: no clip turns its joints: it stays flat" in report_of(file).data["warnings"]


@pytest.mark.slow
def test_two_fields_and_a_tool_are_on_one_mesh() -> None:
    fields = [{"name": "one", "joints": ["joint_1"]}, {"name": "two", "joints": ["joint_2"]}]
    file = bake_once(TWO_BENDS(), tool(name="hand", bumps=2), top={"fields": fields}, **FLAT)
    assert_valid(file.path)
    assert [each["name"] for each in extras_of(file)] == ["one", "two"]
    names = file.mesh("limb")["extras"]["targetNames"]
    assert len(names) == len(set(names))
    assert {name.split("_")[1] for name in names} == {"hand", "one", "two"}
    assert json.dumps(extras_of(file))
