"""Touches that clips make: fingertips that come to skin which is not of their own arm."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

import wrinklecli
from kit.asset import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, Array, Asset
from kit.command import Wrinkle
from kit.touch import SECONDS, plate
from wrinklecli.numeric.arrays import vertex_normals

LENGTH, RADIUS, SIDES, RINGS = 0.03, 0.008, 16, 12
HAND = np.array([0.0, 0.2, 0.0])
# The joint of the finger: it comes down to the skin, drags it along x, and leaves.
WAY = np.array([[0, 0.08, 0], [0, LENGTH - 0.001, 0], [0.006, LENGTH - 0.001, 0], [0.006, LENGTH, 0], [0, 0.08, 0]])


def pointing(way: Array = WAY, *, names: tuple[str, str] = ("hand.R", "index.R")) -> Asset:
    """A plate of skin, and a finger that a clip brings to it."""
    asset = plate(tip=way)
    hand, index = names
    asset.gltf["nodes"][1]["children"] = [3]
    asset.gltf["nodes"][2] = {"name": index, "translation": (way[0] - HAND).tolist()}
    asset.append("nodes", {"name": hand, "translation": HAND.tolist(), "children": [2]})
    asset.gltf["animations"][0]["channels"] = [
        each for each in asset.gltf["animations"][0]["channels"] if each["target"]["node"] != 2
    ]
    asset.channel(asset.gltf["animations"][0], 2, "translation", np.linspace(0.0, SECONDS, len(way)), way - HAND)
    # Half a sphere at the end of a tube.
    bent = np.clip(np.arange(RINGS + 1) / (RINGS - 4), 0.0, 1.0) * np.pi / 2.0
    up = RADIUS * (1.0 - np.cos(bent)) + np.clip(np.arange(RINGS + 1) - RINGS + 4, 0, None) / 4.0 * (LENGTH - RADIUS)
    wide = np.maximum(RADIUS * np.sin(bent), 1e-5)
    angles = np.arange(SIDES) * 2.0 * np.pi / SIDES
    rings = [
        np.stack([w * np.cos(angles), np.full(SIDES, u - LENGTH), -w * np.sin(angles)], axis=1)
        for u, w in zip(up, wide, strict=True)
    ]
    positions = np.concatenate(rings) + way[0]
    ids = np.arange(len(positions)).reshape(RINGS + 1, SIDES)
    a, b = ids[:-1], np.roll(ids, -1, axis=1)[:-1]
    c, d = np.roll(ids, -1, axis=1)[1:], ids[1:]
    quads = [np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]
    triangles = np.concatenate([each.reshape(-1, 3) for each in quads])
    count = len(positions)
    attributes = {
        "POSITION": asset.accessor(positions, bounds=True, target=ARRAY_BUFFER),
        "NORMAL": asset.accessor(vertex_normals(positions, triangles), target=ARRAY_BUFFER),
        "JOINTS_0": asset.accessor(np.zeros((count, 4)), "u1", target=ARRAY_BUFFER),
        "WEIGHTS_0": asset.accessor(np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), target=ARRAY_BUFFER),
    }
    indices = asset.accessor(triangles.reshape(-1), "u2", target=ELEMENT_ARRAY_BUFFER)
    asset.append("meshes", {"primitives": [{"attributes": attributes, "indices": indices}]})
    inverse = np.eye(4)
    inverse[3, :3] = -way[0]
    asset.append("skins", {"joints": [2], "inverseBindMatrices": asset.accessor(inverse[None])})
    asset.append("nodes", {"name": "finger", "mesh": 1, "skin": 1})
    asset.gltf["scenes"][0]["nodes"].append(4)
    return asset


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return pointing().write(tmp_path_factory.mktemp("pointing") / "pointing.glb")


@pytest.mark.slow
@pytest.mark.long
def test_a_finger_that_drags_skin_gives_a_touch_that_checks_strictly(
    drawn: Path, wrinkle: Wrinkle, tmp_path: Path
) -> None:
    found = wrinklecli.suggest(drawn, touch=True)
    (touch,) = (each.effect for each in found.guesses)
    assert np.linalg.norm(touch.at) < RADIUS / 4
    assert touch.pad == pytest.approx(RADIUS, rel=0.1)
    assert touch.by is not None
    assert touch.by.joint == "index.R"
    assert touch.by.offset == pytest.approx((0.0, -LENGTH, 0.0), abs=RADIUS / 4)
    (each,) = found.guesses
    assert each.facts["clip"] == "drag"
    assert each.facts["time"] == pytest.approx(SECONDS / 4, abs=1 / 30)  # a quarter of the clip brings it down
    assert each.facts["slide"] == pytest.approx(0.6 * touch.pad, rel=0.05)  # it slips beyond its grip
    (tmp_path / "touches.yaml").write_text(found.text)
    ran = wrinkle("check", drawn, "touches.yaml", "--strict", "-v")
    assert (ran.code, [line for line in ran.lines if "warning" in line]) == (0, [])
    assert "touch bone on skin" in ran.out


@pytest.mark.slow
@pytest.mark.long
def test_a_finger_that_presses_or_hovers(tmp_path: Path) -> None:
    """Skin that a tip presses does not slide; where an animator leaves a gap, the tip touches earlier."""
    pressing = np.array([[0, 0.08, 0], [0, LENGTH - 0.001, 0], [0, LENGTH - 0.001, 0], [0, 0.08, 0]])
    for gap, touches in ((0.0, 1), (0.2, 1), (0.5, 0)):
        asset = pointing(pressing + np.array([0, gap * RADIUS, 0])).write(tmp_path / f"{gap}.glb")
        found = wrinklecli.suggest(asset, touch=True)
        assert len(found.guesses) == touches
        for each in found.guesses:
            assert each.facts["slide"] < 0.05 * RADIUS
            assert each.effect.press.value >= 100 * (gap - 1 / 8)


@pytest.mark.parametrize(
    ("asset", "reason"),
    [
        (pointing(names=("thing", "tip")), "no joints are named as fingers, with skin round their ends"),
        (pointing(WAY + np.array([0, 0.05, 0])), "in no clip does a fingertip come to the skin of another limb"),
        (plate(), "no joints are named as fingers, with skin round their ends"),
    ],
)
def test_nothing_to_suggest_is_one_line(asset: Asset, reason: str, wrinkle: Wrinkle, tmp_path: Path) -> None:
    ran = wrinkle("suggest", asset.write(tmp_path / "a.glb"), "--touch", "-o", "t.yaml")
    line, _, instead = ran.lines[-1].partition("; ")
    assert (ran.code, line) == (1, f"{tmp_path / 'a.glb'}: nothing to suggest: {reason}")
    assert "`wrinkle edit`" in instead
    assert not Path("t.yaml").exists()


def test_a_finger_does_not_touch_its_own_arm(tmp_path: Path) -> None:
    asset = pointing()
    asset.gltf["nodes"][1]["name"] = "forearm.R"
    found = wrinklecli.suggest(asset.write(tmp_path / "own.glb"), touch=True)
    assert found.guesses == ()


@pytest.mark.slow
@pytest.mark.long
def test_the_command_prints_a_file_and_json(drawn: Path, wrinkle: Wrinkle) -> None:
    ran = wrinkle("suggest", drawn, "--touch")
    listed = yaml.safe_load(ran.out)["touches"]
    data = json.loads(wrinkle("suggest", drawn, "--touch", "--json", "-q").out)["touches"]
    assert [each["name"] for each in data] == [each["name"] for each in listed] == ["touch bone"]
    assert data[0]["by"]["joint"] == listed[0]["by"]["joint"] == "index.R"
    head, row = ran.lines
    assert head.split() == ["touch", "tip", "clip", "time", "slide"]
    assert row.split()[:3] == ["touch", "bone", "index.R"]
    ran = wrinkle("suggest", drawn, "--touch", "--flesh")
    assert (ran.code, "one or the other" in ran.lines[-1]) == (2, True)
