"""Touch from the tools file to the player: slide, rings, proof, and what is refused."""

from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import wrinklecli
from kit.asset import Json
from kit.bakes import bake_once, place, report_of
from kit.clients import assert_valid, compare_with_three, drive
from kit.places import ROOT
from kit.player import Gltf
from kit.touch import GRIP, PAD, SECONDS, plate, stroked, touch
from wrinklecli.baking.baked_body import read_bodies
from wrinklecli.baking.track import track
from wrinklecli.character.clip import read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.drive.touch import EVERY
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.closest import Tree


@pytest.fixture(scope="module")
def skin() -> Path:
    return place(plate())


def baked(asset: Path | str, *touches: Json, levels: int = 1, **options: Any) -> Gltf:
    return bake_once(asset, top={"touches": list(touches), "refinement": {"max_levels": levels}}, **options)


def warned(file: Gltf) -> list[str]:
    """The warnings about the touch."""
    return [line for line in report_of(file).data["warnings"] if line.startswith("spot: ")]


def moves(file: Gltf, contact: tuple[float, float, float], node: str = "skin") -> tuple[np.ndarray, np.ndarray]:
    """(vertices, 3) places at rest, and moves under a slide forward and sideways and a depth."""
    (stored,) = read_bodies(read_document(file.path))[0].drives
    nodes = {each["name"]: number for number, each in enumerate(file.json["nodes"])}
    weights = stored.on(nodes, []).weights_of_contacts(np.array([contact]))
    return file.attribute(node, "POSITION"), np.einsum("t,tvx->vx", weights[0], file.deltas(node))


@pytest.mark.slow
@pytest.mark.long
def test_the_skin_slides_with_the_pad_and_fades(skin: Path) -> None:
    """The mean slide under the pad is the asked one; it falls to the sides, and nothing moves far away or at rest."""
    file = baked(skin, touch(), levels=3)
    names = file.mesh("skin")["extras"]["targetNames"]
    assert names == [f"wrinkle_spot_{number}" for number in range(1, 14)]
    positions, moved = moves(file, (GRIP, 0.0, 0.0))
    away = np.linalg.norm(positions, axis=1)
    assert moved[away < 0.5 * PAD, 0].min() > GRIP
    assert moved[away < PAD, 0].mean() == pytest.approx(GRIP, rel=0.03)
    assert np.abs(moved[away > PAD + 0.018 * 5]).max() < 0.02 * GRIP
    values = file.weights("skin", "drag", np.linspace(0.0, SECONDS, 100))
    assert values.min() >= 0.0
    assert values.max() <= 1.0
    assert not values[0].any()
    assert_valid(file.path)


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize(("part", "aslant"), [(1.0, 0.05), (0.5, 0.0), (1.0, 0.0), (0.5, -0.03)])
def test_the_skin_stays_on_a_curved_surface(part: float, aslant: float) -> None:
    """On a cylinder of 40 mm, slides of any direction leave it by 1/20 of the greatest slide; straight ones by 1/6.

    Whatever direction is forward: the targets slide along its main curvatures.
    """
    spot = touch(towards=[0.05, 0.0, aslant])
    file = baked(place(plate(bend=25.0, cells=48)), {**spot, "wrinkles": "none"}, levels=2)
    for angle in np.arange(8) * np.pi / 4:
        slide = part * GRIP * np.array([np.cos(angle), np.sin(angle)])
        positions, moved = moves(file, (slide[0], slide[1], 0.0))
        moving = np.linalg.norm(moved, axis=1) > 0.01 * GRIP
        before, after = (np.hypot(each[moving, 0], each[moving, 1] + 0.04) for each in (positions, positions + moved))
        assert np.percentile(np.abs(after - before), 99) < 0.05 * GRIP
        assert np.linalg.norm(moved, axis=1).max() > part * GRIP


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("aslant", [0.0, 0.042, -0.1])
def test_the_skin_stays_on_the_back_of_a_hand(aslant: float) -> None:
    """Slides of up to 10 mm leave it by half a millimetre, of what moves 99 %, whatever direction is forward."""
    spot = touch(at=[0.042, 0.0178, 0.0], towards=[0.0, 0.0178, aslant], keys={})
    file = baked("wrist", {**spot, "wrinkles": "none"}, levels=3)
    triangles = file.triangles("wrist")
    for angle, part in product(np.arange(8) * np.pi / 4, (0.5, 1.0)):
        slide = part * GRIP * np.array([np.cos(angle), np.sin(angle)])
        positions, moved = moves(file, (slide[0], slide[1], 0.0), "wrist")
        moving = np.flatnonzero(np.linalg.norm(moved, axis=1) > 0.01 * part * GRIP)[::3]
        assert len(moving) > 300
        ends = positions[moving] + moved[moving]
        _, _, places = Tree.of(positions, triangles).closest_points(ends)
        off = np.linalg.norm(places - ends, axis=1)
        assert np.percentile(off, 99) < 0.0005


@pytest.mark.slow
def test_the_palm_stays_where_it_is() -> None:
    """Skin of the other side moves by 1 % of a slide on the hand's back at most, in any direction, pressed or not."""
    spot = touch(at=[0.042, 0.0178, 0.0], towards=[0.0, 0.0178, 0.0], keys={})
    file = baked("wrist", spot, levels=1)
    normals = file.attribute("wrist", "NORMAL")
    for angle in np.arange(8) * np.pi / 4:
        positions, moved = moves(file, (GRIP * np.cos(angle), GRIP * np.sin(angle), 0.003), "wrist")
        palm = (positions[:, 1] < 0) & (normals[:, 1] < -0.3)
        assert palm.sum() > 200
        assert np.linalg.norm(moved[palm], axis=1).max() < 0.01 * GRIP
        assert np.linalg.norm(moved, axis=1).max() > GRIP
    assert not np.any(file.json["nodes"][file.node("wrist")].get("weights", file.mesh("wrist")["weights"]))


@pytest.mark.slow
@pytest.mark.parametrize("aslant", [0.04, -0.03])
def test_a_turned_touch_slides_where_it_is_asked(aslant: float) -> None:
    """Forward is where `towards` says, though the targets slide along the curvature of a cylinder, which is along x."""
    spot = touch(towards=[0.05, 0.0, aslant])
    file = baked(place(plate(bend=25.0, cells=48)), {**spot, "wrinkles": "none"}, levels=2)
    (stored,) = read_bodies(read_document(file.path))[0].drives
    assert stored.data["turn"] == pytest.approx(np.arctan2(aslant, 0.05), abs=0.02)
    forward = np.array([0.05, 0.0, aslant]) / np.hypot(0.05, aslant)
    for slide, way in (((GRIP, 0.0), forward), ((0.0, GRIP), np.cross([0.0, 1.0, 0.0], forward))):
        positions, moved = moves(file, (*slide, 0.0))
        mean = moved[np.linalg.norm(positions, axis=1) < PAD].mean(axis=0)
        assert mean @ way == pytest.approx(GRIP, rel=0.06)
        assert abs(mean @ np.cross(way, [0.0, 1.0, 0.0])) < 0.06 * GRIP


@pytest.mark.slow
@pytest.mark.long
def test_rings_stand_in_front_and_thin_out_to_the_sides(skin: Path) -> None:
    """Heights along y: in front rings, a cosine of them to the sides, and none behind."""
    file = baked(skin, touch(wrinkles={"bumps": 3, "directions": 16}), levels=3)
    for angle in (0.0, 2.0):
        positions, moved = moves(file, (GRIP * np.cos(angle), GRIP * np.sin(angle), 0.0))
        # Sideways is forward turned by 90° about the normal, to -z.
        apart = np.arctan2(-positions[:, 2], positions[:, 0]) - angle
        near = np.hypot(positions[:, 0], positions[:, 2]) > PAD
        tallest = moved[:, 1].max()
        assert tallest > 0.0005
        front = near & (np.cos(apart) > 0.97)
        assert moved[front, 1].max() == pytest.approx(tallest, rel=0.05)
        assert moved[near & (np.abs(np.cos(apart) - 0.5) < 0.05), 1].max() == pytest.approx(tallest / 2, rel=0.15)
        assert np.abs(moved[near & (np.cos(apart) < -0.2), 1]).max() < 0.02 * tallest


@pytest.mark.slow
def test_a_touch_plays_in_three(skin: Path) -> None:
    file, times = baked(skin, touch()), np.linspace(0.0, SECONDS, 7)
    compare_with_three(file.path, "skin", "drag", times.tolist(), file.pose("skin", "drag", times))


def test_the_skin_springs_back_when_the_tip_lets_go(skin: Path) -> None:
    """After the last key the slide swings past its place, and comes to rest."""
    file = baked(skin, touch(release={"frequency": 2, "damping": 0.3}))
    times = np.linspace(1.0, SECONDS, 61)
    weights = file.weights("skin", "drag", times)
    sideways = weights[:, 1] - weights[:, 3]
    assert sideways[0] == pytest.approx(1.0, abs=0.01)
    assert -0.5 < sideways.min() < -0.2
    assert abs(sideways[-1]) < 0.1


def test_a_clip_of_another_file_is_tracked(skin: Path, tmp_path: Path) -> None:
    whole = baked(skin, touch())
    bare = place(plate())
    (made,) = track(whole.path, [bare], tmp_path)
    times, values = Gltf(Path(made.path)).keys("drag", "skin")
    assert np.abs(values - whole.weights("skin", "drag", times)).max() < 0.01


def drawn(*ways: tuple[float, float, float]) -> Path:
    """The plate with a tip that goes along these places, evenly over the clip."""
    return place(plate(tip=np.array(ways, np.float64)))


@pytest.mark.slow
def test_a_node_that_comes_near_drags_the_skin_and_slips() -> None:
    """It comes down at 0.4 s, sticks, slips at the grip, and goes at 1.2 s: then the skin springs back."""
    far, near = 0.03, 0.0
    asset = drawn(
        (-0.005, far, 0), (-0.005, near, 0), (0.001, near, 0), (0.013, near, 0), (0.013, far, 0), (0.013, far, 0)
    )
    file = baked(asset, touch(by="tip", keys={}, press=0.003))
    # The tip passes 3 mm above the skin 9/10 of the way down, and moves by 0.5 mm a tenth of a second.
    times = np.array([0.0, 0.35, 0.5, 0.8, 1.1, 1.2, 1.9])
    weights = file.weights("skin", "drag", times)
    forward = GRIP * (weights[:, 0] - weights[:, 2])
    assert forward[:2] == pytest.approx([0.0, 0.0], abs=1e-5)
    assert forward[2:4] == pytest.approx([0.0015, 0.006], abs=2e-4)
    assert forward[4:6] == pytest.approx([GRIP, GRIP], rel=0.01)
    assert abs(forward[6]) < 0.1 * GRIP
    assert warned(file) == []


@pytest.mark.slow
def test_a_tip_lets_go_of_skin_that_is_hidden() -> None:
    """Scale hides the body at both ends of a loop, as where a character comes and goes."""
    sizes = {0.0: 0.0, 0.5: 1.0, 1.5: 0.0}
    file = baked(
        place(plate(tip=np.array([(-0.005, -0.001, 0), (0.004, -0.001, 0)]), sizes=sizes, turns=False)),
        touch(by="tip", keys={}, release={"frequency": 8, "damping": 1}),
        levels=0,
    )
    hidden, shown, late = file.weights("skin", "drag", np.array([0.0, 1.4, 2.0]))
    assert [hidden[0], shown[0], late[0]] == pytest.approx([0.0, 0.405, 0.0], abs=0.005)


@pytest.mark.slow
def test_the_distance_is_that_of_the_posed_skin() -> None:
    """On a bent plate that turns, the tip's height is right to a part of a millimetre within the pad."""
    angles = np.array([-0.25, 0.0, 0.2])
    above = 0.042 * np.stack([np.sin(angles), np.cos(angles), 0 * angles], axis=1) - [0.0, 0.04, 0.0]
    file = baked(place(plate(bend=25.0, cells=40, size=0.2, tip=above)), touch(by="tip", keys={}))
    document = read_document(file.path)
    (stored,) = read_bodies(document)[0].drives
    tips = stored.on({"bone": 1, "tip": 2}, []).tip_in(
        read_rig(document, 0), read_clips(document)[0], np.linspace(0.0, SECONDS, len(angles))
    )
    assert tips[:, 2] == pytest.approx(0.002, abs=3e-4)
    assert tips[:, 0] == pytest.approx(above[:, 0], abs=1e-4)


@pytest.mark.slow
@pytest.mark.long
def test_the_driver_plays_keys_and_tips_as_the_bake_does() -> None:
    """1 % of the greatest weight off at most, slides 0.3 %, at 30 and 144 frames a second."""
    ways = (
        (-0.005, 0.03, 0),
        (-0.005, 0.0, 0),
        (0.0, -0.001, 0.003),
        (0.009, -0.001, 0.005),
        (0.009, 0.03, 0),
        (0, 0.03, 0),
    )
    asset = place(plate(tip=np.array(ways)))
    for keys, fps in ((touch()["keys"], 30), ({}, 144)):
        bare, whole = (baked(asset, touch(by="tip", keys=keys), tracks=tracks) for tracks in ("none", "all"))
        times = np.arange(int(SECONDS * fps)) / fps
        elapsed = np.full(len(times), 1 / fps)
        played = drive(bare.path, node="skin", clip="drag", times=times.tolist(), elapsed=elapsed.tolist(), driver=True)
        wanted = whole.weights("skin", "drag", times)
        assert wanted.max() > 0.9
        found = np.stack([played[name][:, 0] for name in whole.mesh("skin")["extras"]["targetNames"]], axis=1)
        assert np.abs(found - wanted).max() < 0.01
        assert np.abs(found - wanted)[:, : len(EVERY) - 1].max() < 0.003


@pytest.mark.slow
@pytest.mark.parametrize(("fps", "begins"), [(24, 0.125), (30, 0.0), (60, 0.75), (144, 0.375)])
def test_the_driver_follows_the_sample_s_finger_as_the_bake_does(fps: int, begins: float) -> None:
    """Weights are 0.2 % off the method's, and 1 % off the bake's, of grip, deepest dent and tallest ring."""
    tools = yaml.safe_load((ROOT / "configs" / "touch.yaml").read_text())
    top = {"touches": tools["touches"], "refinement": {"max_levels": 0}}
    bare, whole = (bake_once("touch", top=top, tracks=tracks) for tracks in ("none", "all"))
    times = (np.arange(int(3 * fps)) + begins) / fps
    elapsed = np.full(len(times), 1 / fps)
    played = drive(bare.path, node="touch", clip="drag", times=times.tolist(), elapsed=elapsed.tolist(), driver=True)
    found = np.stack([played[name][:, 0] for name in whole.mesh("touch")["extras"]["targetNames"]], axis=1)
    document = read_document(whole.path)
    (stored,) = read_bodies(document)[0].drives
    nodes = {each["name"]: number for number, each in enumerate(whole.json["nodes"])}
    exact = stored.on(nodes, []).weights_in(read_rig(document, 0), read_clips(document)[0])(times)
    assert exact.max() > 0.9
    assert np.abs(found - exact).max() < 0.002
    sizes = np.linalg.norm(whole.deltas("touch"), axis=2).max(axis=1)
    dent = len(EVERY) - 1
    for some in (slice(dent), slice(dent, dent + 1), slice(dent + 1, None)):
        off = np.abs(found - whole.weights("touch", "drag", times))[:, some] * sizes[some]
        assert off.max() < 0.01 * sizes[some].max()


def test_one_direction_takes_one_target(skin: Path) -> None:
    file = baked(skin, touch(wrinkles={"directions": 1}))
    assert len(file.mesh("skin")["extras"]["targetNames"]) == 6


def test_a_slide_without_rings(skin: Path) -> None:
    file = baked(skin, {**touch(), "wrinkles": "none"})
    assert len(file.mesh("skin")["extras"]["targetNames"]) == 5
    positions, moved = moves(file, (0.0, GRIP, 0.0))
    assert moved[np.linalg.norm(positions, axis=1) < PAD, 2].mean() == pytest.approx(-GRIP, rel=0.05)
    assert not moved[:, 1].any()


def test_windows_beyond_the_border_have_no_target() -> None:
    """At the border of a plate rings rise to three sides alone; the drive knows the targets that there are."""
    asset = place(plate(size=0.12, cells=12))
    file = baked(asset, touch(at=[0.056, 0.0, 0.0], towards=[0.0, 0.0, 0.0], wrinkles={"directions": 16}))
    names = file.mesh("skin")["extras"]["targetNames"]
    assert 10 < len(names) < 21
    (stored,) = read_bodies(read_document(file.path))[0].drives
    assert list(stored.targets) == names
    _, moved = moves(file, (GRIP, 0.0, 0.0))
    assert moved[:, 1].max() > 3e-4


@pytest.mark.slow
def test_mirrored_touches_are_mirror_images(skin: Path) -> None:
    """Keys that slide the left one inwards slide the right one inwards too."""
    left = touch(name="spot.L", at=[0.06, 0.0, 0.0], towards=[0.06, 0.0, 0.05], mirror="x", wrinkles={"directions": 6})
    file = baked(skin, left)
    weights = file.weights("skin", "drag", np.array([1.0]))[0]
    names = file.mesh("skin")["extras"]["targetNames"]
    means = [
        sum(
            weight * delta.sum(axis=0)
            for name, weight, delta in zip(names, weights, file.deltas("skin"), strict=True)
            if f"_{side}_" in name
        )
        for side in "LR"
    ]
    assert abs(means[0][0]) > 0.1
    assert means[1] == pytest.approx(means[0] * [-1.0, 1.0, 1.0], rel=0.05, abs=0.01)


@pytest.mark.slow
def test_a_tool_behind_the_tip_sees_the_stretched_skin(skin: Path) -> None:
    """A tool whose ends lie before and in front of the pad is shortened by the slide."""
    tool = {"name": "fold", "origin": [0.02, 0, 0], "target": [0.06, 0, 0], "width": 0.03, "bumps": 2}
    file = bake_once(skin, tool, top={"touches": [touch(wrinkles={"bumps": 3})]})
    names = file.mesh("skin")["extras"]["targetNames"]
    values = file.weights("skin", "drag", np.array([0.0, 0.6]))[:, names.index("wrinkle_fold_1")]
    assert values[0] == 0.0
    assert values[1] > 0.05


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pad": 0.02, "reach": 0.01}, "the reach must be at least the pad"),
        ({"pad": 0.2, "reach": 0.3}, "larger than the body allows"),
        ({"at": [0.0, 0.05, 0.0]}, "from the mesh, more than half of its pad"),
        ({"grip": 0}, "found 0, expected a length"),
        ({"grip": 0.05}, "would fold the skin over"),
        ({"pad": float("nan")}, "expected a length"),
        ({"keys": {"walk": [[0, 0, 0]]}}, "has no clip 'walk'"),
        ({"keys": {"drag": [[1, 0, 0], [0, 0, 0]]}}, "expected times that rise"),
        ({"keys": {"drag": [[0, 0]]}}, "expected [seconds, forward, sideways]"),
        ({"towards": [0.0, 0.05, 0.0]}, "gives no direction"),
        ({"wrinkles": {"directions": 3}}, "found 3, expected 1, 6, 8, 12 or 16"),
        ({"mask": {"attribute": "_SKIN"}}, "has no _SKIN"),
        ({"by": "finger"}, "no node is named 'finger'"),
        ({"by": {"joint": "bone", "offset": [0, 0]}}, "expected [x, y, z]"),
    ],
    ids=str,
)
def test_what_does_not_fit_is_one_line(skin: Path, tmp_path: Path, changes: Json, message: str) -> None:
    path = tmp_path / "tools.yaml"
    path.write_text(yaml.safe_dump({"version": 1, "touches": [touch(**changes)]}))
    with pytest.raises(WrinkleError) as refused:
        wrinklecli.bake(skin, path, tmp_path / "out.glb")
    (line,) = str(refused.value).splitlines()
    assert message in line
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"along": []}, "expected a list of 1 to 64 points"),
        ({"along": [[-0.04, 0.0, 0.0]]}, "touches[0].along[0]: same as the point before it, expected another"),
        ({"along": [[0.0, 0.0, 0.0], [0.005, 0.0, 0.0]]}, "is 0.005 from the point before it, less than half"),
        ({"along": [[0.0, 0.0, 0.0], [0.0, 0.05, 0.0]]}, "touches[0].along[1]: is 0.05 from the mesh, more than half"),
        ({"pad": 0.004, "along": [[0.1, 0.0, 0.0]]}, "would take 19 places, 2 pads of 0.004 apart, of 8"),
        ({"towards": [0.05, 0.0, 0.0]}, "expected none beside along"),
        ({"keys": {"drag": [[0, 0, 0]]}}, "expected none beside along"),
    ],
    ids=str,
)  # fmt: skip
def test_a_path_that_does_not_fit_is_one_line(tmp_path: Path, changes: Json, message: str) -> None:
    path = tmp_path / "tools.yaml"
    path.write_text(yaml.safe_dump({"version": 1, "touches": [stroked(**changes)]}))
    with pytest.raises(WrinkleError) as refused:
        wrinklecli.bake(a_stroke(), path, tmp_path / "out.glb")
    (line,) = str(refused.value).splitlines()
    assert message in line
    assert not (tmp_path / "out.glb").exists()


@cache
def a_stroke() -> Path:
    """A tip that comes down before the path, strokes along it at 60 mm a second, and goes up behind it."""
    ways = np.linspace(-0.05, 0.055, 22)
    line = np.stack([ways, np.full(len(ways), -0.0005), 0.0 * ways], axis=1)
    above = line[[0, -1], None] + np.array([0.0, 0.03, 0.0])
    return place(plate(tip=np.concatenate([above[0], line, above[1]]), turns=False))


@pytest.mark.slow
@pytest.mark.long
def test_places_of_a_row_hand_over() -> None:
    """Two neighbours share a slide that is whole, once the tip slips, from the first place to the last."""
    file = baked(a_stroke(), stroked(), levels=0)
    names = file.mesh("skin")["extras"]["targetNames"]
    assert names == [f"wrinkle_spot_{number}" for number in range(1, 13)]
    weights = file.weights("skin", "drag", np.linspace(0.4, 1.85, 30))
    slides, rings = weights[:, 0::3], weights[:, 2::3]
    assert slides.sum(axis=1) == pytest.approx(1.0, abs=0.01)
    assert rings.sum(axis=1).min() > 0.98, "half of a slide raises more than half of the height"
    for some in (slides, rings):
        assert (np.diff(some @ np.arange(4) / some.sum(axis=1)) > -0.01).all()
        assert ((some > 0.01).sum(axis=1) <= 2).all()
    assert weights[0, 0] == pytest.approx(1.0, abs=0.02)
    assert weights[-1, 9] > 0.95
    assert not weights[:, 1::3].any(), "nothing slides back"
    whole = file.weights("skin", "drag", np.linspace(0.0, SECONDS, 100))
    assert whole.min() >= 0.0
    assert whole.max() <= 1.0


@pytest.mark.slow
@pytest.mark.long
def test_a_stroke_has_rings_ahead_all_the_way_and_none_behind() -> None:
    file = baked(a_stroke(), stroked(), levels=2)
    assert_valid(file.path)
    times = np.linspace(0.4, 1.75, 28)
    tips = np.interp(times, np.linspace(0.0, SECONDS, 24)[1:-1], np.linspace(-0.05, 0.055, 22))
    rest = file.attribute("skin", "POSITION")
    posed = file.pose("skin", "drag", times)
    line = np.abs(rest[:, 2]) < 0.5 * PAD
    tallest = posed[:, :, 1].max()
    assert tallest > 0.0005
    for tip, positions in zip(tips.tolist(), posed, strict=True):
        ahead, heights = positions[:, 0] - tip, positions[:, 1]
        assert heights[line & (ahead > 0.5 * PAD) & (ahead < 3 * PAD)].max() > 0.4 * tallest
        assert np.abs(heights[line & (ahead < -PAD)]).max() < 0.02 * tallest
        assert np.abs(heights[ahead < -PAD]).max() < 0.1 * tallest, "to the sides"


def test_a_stroke_of_another_file_is_tracked(tmp_path: Path) -> None:
    whole = baked(a_stroke(), stroked(), levels=0)
    (made,) = track(whole.path, [a_stroke()], tmp_path)
    times, values = Gltf(Path(made.path)).keys("drag", "skin")
    off = np.abs(values - whole.weights("skin", "drag", times)).max(axis=0)
    assert off.reshape(-1, 3)[:, :2].max() < 0.01
    # Rings start like a square root, and keys of both lie elsewhere.
    assert off.max() < 0.02


@pytest.mark.slow
def test_warnings_say_what_looks_folded_and_what_never_acts(skin: Path) -> None:
    def said(**keys: Any) -> str:
        return "\n".join(warned(baked(skin, touch(**keys))))

    assert said() == ""
    assert "below -0.7 it looks folded" in said(grip=0.0195)
    assert "no clip keys it" in said(keys={})
    (away,) = warned(baked(drawn((0, 0.05, 0), (0.2, 0.02, 0)), touch(by="tip", keys={})))
    assert "'tip' comes no nearer to the place than" in away
