"""Suggested tools: where surfaces are compressed, along which direction, and a file that bakes as it is."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from kit import hostile
from kit.asset import Asset, stored
from kit.limb import LENGTH, RADIUS, limb, limb_asset
from kit.samples import edited, sample, shared_mesh, two_meshes
from wrinklecli import bake
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.cli import cli
from wrinklecli.errors import AssetError, BakeError, WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.method.activity import lengths_over_time
from wrinklecli.method.patch import attach_tools
from wrinklecli.method.rest import rest_pose
from wrinklecli.numeric.arrays import unit
from wrinklecli.review.suggest.fitting import Suggestion
from wrinklecli.review.suggest.sites import at_sites, scan, spread_sites
from wrinklecli.review.suggest.strain import Gauge, along_directions, principal, read_gauge, strain
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.tools.read import load_tools, parse_tools
from wrinklecli.tools.records import ToolsFile, WrinkleTool

Json = dict[str, Any]
Floats = NDArray[np.float64]

ASSETS = Path(__file__).parents[3] / "shared" / "assets"
KEYS = [
    "name",
    "node",
    "origin",
    "target",
    "mirror",
    "width",
    "strategy",
    "bumps",
    "rest_length",
    "mesh",
    "driver",
    "driver_kind",
    "clip",
    "time",
    "span",
    "shortest",
    "shortening",
    "clips",
    "score",
]


def in_assets(name: str) -> Path:
    path = ASSETS / name
    if not path.exists():
        pytest.skip(f"{path} is not here")
    return path


def gauge_of(path: Path, node: int = 0) -> tuple[Gauge, tuple[Clip, ...]]:
    document = read_document(path)
    rig, clips = read_rig(document, node), read_clips(document)
    surface = read_surface(document, rig)
    return read_gauge(surface, rest_pose(surface, rig, ToolsFile(path="", tools=()), clips, []), rig), clips


def middle(tool: WrinkleTool) -> Floats:
    return (ends(tool)[0] + ends(tool)[1]) / 2.0


def ends(tool: WrinkleTool) -> tuple[Floats, Floats]:
    assert isinstance(tool.origin, tuple)
    assert isinstance(tool.target, tuple)
    return np.array(tool.origin), np.array(tool.target)


def along(tool: WrinkleTool) -> Floats:
    origin, target = ends(tool)
    return unit(target - origin)


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, ["suggest", *map(str, arguments)])


# Strain


@given(st.lists(st.floats(-1, 1), min_size=6, max_size=6), st.floats(0, 3), st.floats(0, 6))
def test_principal_loss_is_the_greatest_of_all_directions_in_the_plane(
    components: list[float], height: float, turn: float
) -> None:
    normal = unit(np.array([[np.cos(turn), np.sin(turn), height - 1.5]]))
    tensor = np.array([components])
    loss, direction = principal(tensor, normal)
    xx, yy, zz, xy, yz, zx = components
    full = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]])
    first = unit(np.cross(normal[0], [0.3, -0.5, 0.8]))
    second = np.cross(normal[0], first)
    angles = np.linspace(0.0, np.pi, 2001)[:, None]
    every = np.cos(angles) * first + np.sin(angles) * second
    losses = np.einsum("ai,ij,aj->a", every, full, every)
    assert loss[0] >= losses.max() - 1e-12
    assert loss[0] <= losses.max() + 1e-5
    assert abs(direction[0] @ normal[0]) < 1e-12
    assert abs(direction[0] @ full @ direction[0] - loss[0]) < 1e-12
    assert abs(along_directions(tensor, normal, direction[0])[0] - loss[0]) < 1e-12


def test_squashing_loses_what_it_takes_away(tmp_path: Path) -> None:
    # The morph target moves x by -0.3 x exp(-(x / 0.6)²): at the middle, lengths along x become 0.7 of what they were.
    gauge, (clip,) = gauge_of(
        limb(tmp_path / "limb.glb", skinned=False, clip=None, morphs=1, morph_clip="LINEAR", rings=81)
    )
    sites = spread_sites(gauge)
    tensors = at_sites(gauge, sites, clip, np.array([0.3]))[0]
    losses, directions = principal(tensors, sites.normals)
    near = np.abs(sites.positions[:, 0]) < 0.03
    assert losses[near] == pytest.approx(0.3, abs=0.01)
    assert np.abs(directions[near, 0]).min() > 0.99
    x = sites.positions[:, 0]
    wanted = 0.3 * np.exp(-((x / 0.6) ** 2)) * (1.0 - 2.0 * (x / 0.6) ** 2)
    assert np.abs(losses - np.maximum(wanted, 0.0)).max() < 0.04


@pytest.mark.parametrize("root", [{}, {"scale": [1.0, 1.0, -1.0]}, {"scale": [30.0] * 3, "rotation": [0, 0, 0.6, 0.8]}])
def test_rigid_motion_and_scale_lose_nothing(tmp_path: Path, root: Json) -> None:
    asset = limb_asset(clip="grow", root=root)
    gauge, (clip,) = gauge_of(asset.write(tmp_path / "limb.glb"))
    assert np.abs(strain(gauge, clip, np.linspace(0.0, 1.0, 4))).max() < 1e-6
    assert not suggest(tmp_path / "limb.glb").tools


def test_sites_cover_the_surface_whatever_its_triangles(tmp_path: Path) -> None:
    areas = []
    for rings, sides in ((7, 6), (24, 16), (120, 90)):
        gauge, _ = gauge_of(limb(tmp_path / "limb.glb", rings=rings, sides=sides))
        sites = spread_sites(gauge)
        corners = gauge.rest.positions[gauge.triangles]
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
        assert sites.areas.sum() == pytest.approx(area)
        for shares in (sites.gather, sites.smooth):
            assert np.abs(shares.sum(axis=1) - 1.0).max() < 1e-12
        areas.append(sites.areas.sum())
    assert areas[-1] == pytest.approx(2 * np.pi * RADIUS * LENGTH, rel=0.01)


def test_slivers_and_degenerate_triangles_change_little(tmp_path: Path) -> None:
    sound, _ = gauge_of(limb(tmp_path / "sound.glb"))
    surface = sound.surface
    flat = np.array([[0, 0, 1], [5, 5, 5], [0, 1, 0]])
    triangles = np.concatenate([surface.triangles, flat])
    gauge = read_gauge(replace(surface, triangles=triangles), sound.rest, sound.rig)
    assert len(gauge.triangles) == len(sound.triangles)


def test_the_greatest_loss_is_found_in_whatever_chunks_poses_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gauge, clips = gauge_of(limb(tmp_path / "limb.glb"))
    sites = spread_sites(gauge)
    times = [np.linspace(0.0, 2.0, 23)]
    whole = scan(gauge, sites, clips, times)
    monkeypatch.setattr("wrinklecli.review.suggest.sites._CHUNK", 1)
    single = scan(gauge, sites, clips, times)
    assert (whole.poses == single.poses).all()
    assert np.abs(whole.losses - single.losses).max() < 1e-12
    assert whole.losses.max() > 0.5


# Folds of a tube


@pytest.mark.parametrize(
    "options", [{}, {"rings": 60, "sides": 40}, {"rings": 11, "sides": 8}, {"normals": False, "indices": None}]
)
def test_a_bent_tube_folds_on_its_inner_side_along_the_tube(tmp_path: Path, options: Json) -> None:
    found = suggest(limb(tmp_path / "limb.glb", **options))
    best = found.tools[0]
    x, y, z = middle(best.tool)
    assert abs(x) < 0.15 * best.span
    assert y > 0.7 * RADIUS
    assert abs(z) < 0.3 * RADIUS
    assert abs(along(best.tool)[0]) > 0.99
    assert 0.4 < best.shortening < 0.8
    assert (best.driver, best.by_morph, best.clip, best.mirrored) == ("joint_1", False, "fold", False)
    assert best.time == pytest.approx(1.0, abs=0.1)
    assert found.text == suggest(tmp_path / "limb.glb").text


def test_two_bends_are_one_mirrored_tool(tmp_path: Path) -> None:
    found = suggest(limb(tmp_path / "limb.glb", joints=3, angle=200.0), count=1)
    (best,) = found.tools
    assert best.mirrored
    assert best.tool.name.endswith(".L")
    assert abs(middle(best.tool)[0]) == pytest.approx(LENGTH / 6, abs=0.2)
    assert middle(best.tool)[1] > 0.7 * RADIUS
    left, right = parse_tools(found.text).tools
    assert (right.name, ends(right)[0].tolist()) == (f"{left.name[:-1]}R", (ends(left)[0] * [-1, 1, 1]).tolist())


@pytest.mark.parametrize("scale", [0.001, 100.0])
def test_suggestions_scale_with_the_asset(tmp_path: Path, scale: float) -> None:
    plain = suggest(limb(tmp_path / "plain.glb"), count=1).tools[0]
    scaled = suggest(limb(tmp_path / "scaled.glb", root={"scale": [scale] * 3}), count=1).tools[0]
    assert np.abs(np.array(ends(scaled.tool)) / scale - np.array(ends(plain.tool))).max() < 0.02 * plain.span
    assert scaled.tool.width.value / scale == pytest.approx(plain.tool.width.value)
    assert scaled.tool.bumps == plain.tool.bumps
    assert scaled.shortening == pytest.approx(plain.shortening, abs=0.02)


def test_suggestions_turn_with_the_asset(tmp_path: Path) -> None:
    turned = suggest(limb(tmp_path / "turned.glb", root={"rotation": [0.0, 0.0, 0.6, 0.8]}), count=1).tools[0]
    rotation = np.array([[0.28, -0.96, 0.0], [0.96, 0.28, 0.0], [0.0, 0.0, 1.0]])
    assert abs(along(turned.tool) @ rotation @ [1.0, 0.0, 0.0]) > 0.99
    assert middle(turned.tool) @ rotation @ [0.0, 1.0, 0.0] > 0.7 * RADIUS
    assert abs(middle(turned.tool) @ rotation @ [1.0, 0.0, 0.0]) < 0.2 * turned.span


def test_a_morph_target_that_squashes_is_named(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", skinned=False, clip=None, morphs=2, morph_clip="LINEAR")
    best = suggest(path).tools[0]
    assert (best.driver, best.by_morph) == ("morph_0", True)
    assert best.tool.name == "morph_0"
    assert abs(along(best.tool)[0]) > 0.99


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"skinned": False, "clip": None}, "no mesh deforms"),
        ({"skinned": False, "clip": "grow"}, "no mesh deforms"),
        ({"clip": None}, "no clip"),
        ({"clip": "grow"}, "compresses"),
        ({"angle": 2.0}, "compresses"),
    ],
)
def test_nothing_is_suggested_where_nothing_is_compressed(tmp_path: Path, options: Json, reason: str) -> None:
    path = limb(tmp_path / "limb.glb", **options)
    found = suggest(path)
    assert not found.tools
    assert not found.text
    assert reason in found.reason
    result = run(path, "-o", tmp_path / "tools.yaml")
    assert isinstance(result.exception, AssetError)
    assert reason in str(result.exception)
    assert not (tmp_path / "tools.yaml").exists()


def test_a_clip_that_moves_another_node_is_not_looked_at(tmp_path: Path) -> None:
    asset = limb_asset(clip=None)
    aside = asset.append("nodes", {"name": "prop"})
    animation: Json = {"name": "spin"}
    asset.channel(animation, aside, "rotation", [0.0, 1.0], [[0, 0, 0, 1], [0, 0, 1, 0]])
    asset.append("animations", animation)
    assert "no clip moves" in suggest(asset.write(tmp_path / "limb.glb")).reason


# The samples and real assets


def measured(path: Path, found: Suggestions) -> None:
    """Check what suggestions say against the tools that the file makes, as a bake attaches them."""
    document = read_document(path)
    clips = read_clips(document)
    settings = parse_tools(found.text)
    tools = {tool.name: tool for tool in settings.tools}
    carriers = [index for index, node in enumerate(document.items("nodes")) if "mesh" in node]
    assert len(tools) == len(found.tools) + sum(each.mirrored for each in found.tools)
    for each in found.tools:
        (rig,) = [rig for rig in (read_rig(document, index) for index in carriers) if rig.names[rig.node] == each.mesh]
        surface = read_surface(document, rig)
        rest = rest_pose(surface, rig, settings, clips, [])
        pair = [tools[each.tool.name]]
        if each.mirrored:
            pair.append(tools[f"{each.tool.name[:-1]}R"])
        patches = attach_tools(pair, surface, rest, rig, up=settings.up)
        assert patches[0].span == pytest.approx(each.span)
        assert max(patch.origin.distance for patch in patches) < 0.05 * each.span
        clip = next(clip for clip in clips if clip.name == each.clip)
        distances, _ = lengths_over_time(patches[0], rig, rest, clip, np.array([each.time]))
        assert distances[0] == pytest.approx(each.clips[each.clip])
        assert min(each.clips.values()) == each.clips[each.clip]
        assert each.shortening > 0.1
        for patch in patches:
            shortest = min(
                lengths_over_time(patch, rig, rest, clip, np.linspace(clip.start, clip.end, 61))[0].min()
                for clip in clips
            )
            assert shortest < 0.95 * patch.span


def nearest_to(found: Suggestions, place: tuple[float, float, float]) -> Suggestion:
    return min(found.tools, key=lambda each: float(np.linalg.norm(middle(each.tool) - place)))


def off(suggestion: Suggestion, place: tuple[float, float, float]) -> float:
    return float(np.linalg.norm(middle(suggestion.tool) - place))


@pytest.mark.slow
def test_the_sample_trousers_fold_behind_the_knees() -> None:
    found = suggest(sample("trousers"))
    knee = nearest_to(found, (0.104, 0.50, -0.0875))
    assert off(knee, (0.104, 0.50, -0.0875)) < 0.05
    assert knee.mirrored
    assert abs(along(knee.tool)[1]) > 0.95
    assert knee.clip == "squat"
    assert knee.shortening > 0.5
    measured(sample("trousers"), found)


def test_the_sample_wrist_folds_on_both_sides() -> None:
    found = suggest(sample("wrist"))
    for place, clip in (((-0.002, -0.021, 0.0), "flex"), ((0.0, 0.0208, 0.0), "extend")):
        side = nearest_to(found, place)
        assert side in found.tools[:2]
        assert off(side, place) < 0.012
        assert side.clip == clip
        assert abs(along(side.tool)[0]) > 0.95
        assert not side.mirrored
    measured(sample("wrist"), found)


def test_the_sample_head_folds_on_its_forehead() -> None:
    found = suggest(sample("head"), clips=["raise_brows"])
    brow = nearest_to(found, (0.030, 0.264, 0.073))
    assert off(brow, (0.030, 0.264, 0.073)) < 0.025
    assert brow.mirrored
    assert (brow.driver, brow.by_morph) == ("browsUp", True)
    assert abs(along(brow.tool)[1]) > 0.9
    assert {each.clip for each in found.tools} == {"raise_brows"}
    measured(sample("head"), found)


@pytest.mark.slow
def test_real_trousers_fold_behind_the_knees() -> None:
    path = in_assets("trousers.glb")
    found = suggest(path)
    knee = nearest_to(found, (0.098, -0.311, -0.023))
    behind = [each for each in found.tools[:3] if each.driver.startswith("lowerleg") and middle(each.tool)[2] < -0.02]
    assert behind
    assert all(each.mirrored and each.clip == "squat" and abs(along(each.tool)[1]) > 0.85 for each in behind)
    assert off(behind[0], (0.098, -0.311, -0.023)) < 0.09
    assert knee.mirrored
    measured(path, found)


@pytest.mark.slow
def test_a_real_wrist_folds_on_both_sides() -> None:
    path = in_assets("hand.glb")
    found = suggest(path)
    palm = nearest_to(found, (-0.4730, 0.24655, 0.1938))
    assert off(palm, (-0.4730, 0.24655, 0.1938)) < 0.012
    assert abs(along(palm.tool) @ unit(np.array([-0.0216, -0.0221, 0.0376]))) > 0.9
    assert (palm.driver, palm.clip, palm.tool.name[:5]) == ("wrist.R", "bend", "wrist")
    back = [each for each in found.tools if each.driver == "wrist.R" and each is not palm]
    assert back
    assert back[0].clip == "bend"
    assert abs(back[0].time - palm.time) > 0.5
    measured(path, found)


@pytest.mark.slow
def test_a_real_forehead_folds_above_each_brow() -> None:
    path = in_assets("head_male.glb")
    found = suggest(path)
    brow = found.tools[0]
    assert (brow.driver, brow.by_morph, brow.mirrored, brow.clip) == ("browsUp", True, True, "frown")
    assert brow.time == pytest.approx(0.5, abs=0.05)
    assert off(brow, (0.035, 0.875, 0.1375)) < 0.035
    assert abs(along(brow.tool)[1]) > 0.8
    measured(path, found)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cesium_man.glb", "fox.glb", "simple_skin.gltf"])
def test_other_real_assets_fold_at_joints(name: str) -> None:
    path = in_assets(name)
    found = suggest(path)
    rig = read_rig(
        read_document(path), next(i for i, n in enumerate(read_document(path).items("nodes")) if "mesh" in n)
    )
    assert found.tools
    assert {each.driver for each in found.tools} <= {rig.names[joint] for joint in rig.joints}
    measured(path, found)


@pytest.mark.parametrize(
    "name", ["wrist", *(pytest.param(name, marks=pytest.mark.slow) for name in ("trousers", "head"))]
)
def test_suggestions_bake_as_they_are(tmp_path: Path, name: str) -> None:
    found = suggest(sample(name), count=2)
    (tmp_path / "tools.yaml").write_text(found.text)
    report = bake(sample(name), tmp_path / "tools.yaml", tmp_path / "out.glb")
    assert [tool["name"] for tool in report.data["tools"]] == [
        tool.name for tool in load_tools(tmp_path / "tools.yaml").tools
    ]
    assert all(tool["targets"] for tool in report.data["tools"])
    assert not any("edges are still too long" in line for line in report.warnings)
    with pytest.raises(AssetError, match="already carries wrinkles"):
        suggest(tmp_path / "out.glb")


@pytest.mark.slow
def test_suggestions_do_not_lie_on_one_another() -> None:
    found = suggest(sample("trousers"), count=20)
    document = read_document(sample("trousers"))
    settings = parse_tools(found.text)
    node = next(index for index, each in enumerate(document.items("nodes")) if "mesh" in each)
    rig, clips = read_rig(document, node), read_clips(document)
    surface = read_surface(document, rig)
    rest = rest_pose(surface, rig, settings, clips, [])
    patches = attach_tools(list(settings.tools), surface, rest, rig, up=settings.up)
    for first in patches:
        for second in patches:
            if first is not second and first.normal @ second.normal > 0.7:
                place = (second.origin.position + second.target.position) / 2
                u, v = first.coordinates(place)
                height = abs((place - first.origin.position) @ first.normal)
                assert not (0.1 < u < 0.9 and abs(v) < 0.5 and height < 0.25 * first.span)


# Several meshes


def two_limbs() -> Asset:
    """A folding limb, and further off a twin with a mesh of its own and the same joints."""
    asset = limb_asset()
    asset.append("meshes", json.loads(json.dumps(asset.gltf["meshes"][0])))
    (skin,) = asset.gltf["skins"]
    inverse = stored(asset, skin["inverseBindMatrices"]).copy()
    inverse[:, 14] += 5.0
    asset.append("skins", {**skin, "inverseBindMatrices": asset.accessor(inverse)})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "twin", "mesh": 1, "skin": 1}))
    return asset


def test_tools_name_their_node_where_several_meshes_deform(tmp_path: Path) -> None:
    path = two_limbs().write(tmp_path / "limbs.glb")
    found = suggest(path, count=4)
    assert {each.tool.node for each in found.tools} == {"limb", "twin"}
    (tmp_path / "tools.yaml").write_text(found.text)
    bake(path, tmp_path / "tools.yaml", tmp_path / "out.glb")
    alone = suggest(path, count=4, node="twin")
    assert {each.tool.node for each in alone.tools} == {"twin"}


@pytest.mark.parametrize("name", ['a"b', "a\\b: #", "new\nline\x07", "日本 \u2028", "- [x", " "])
def test_a_node_of_any_name_can_be_named(tmp_path: Path, name: str) -> None:
    asset = two_limbs()
    asset.gltf["nodes"][-1]["name"] = name
    path = asset.write(tmp_path / "limbs.glb")
    found = suggest(path, count=1, node=name)
    assert parse_tools(found.text).tools[0].node == name
    (tmp_path / "tools.yaml").write_text(found.text, encoding="utf-8")
    bake(path, tmp_path / "tools.yaml", tmp_path / "out.glb")
    assert run(path, "--node", name, "--count", 1).exit_code == 0


@pytest.mark.parametrize("name", [None, "", "wrist", "\ud800"])
def test_a_node_that_no_tool_could_name_is_left_out_with_a_note(name: str | None) -> None:
    def renamed(editor: Any) -> None:
        two_meshes(editor)
        for node in editor.json["nodes"]:
            if node.get("name") in ("twin", "wrist") and "mesh" in node:
                node["name"] = name
                if name is None:
                    del node["name"]

    found = suggest(edited("wrist", renamed))
    assert not found.tools
    assert len(found.notes) == 2
    assert all("no name" in note for note in found.notes)


def test_a_mesh_without_normals_keeps_its_flat_faces(tmp_path: Path) -> None:
    flat = suggest(limb(tmp_path / "flat.glb", normals=False))
    assert parse_tools(flat.text).refinement.scheme == "midpoint"
    assert parse_tools(suggest(limb(tmp_path / "smooth.glb")).text).refinement.scheme == "butterfly"


# The command


def test_the_file_says_what_the_record_says(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", joints=3, angle=200.0)
    found = suggest(path)
    read = {tool.name: tool for tool in parse_tools(found.text).tools}
    for each in found.tools:
        tool = read[each.tool.name]
        assert (tool.origin, tool.target, tool.width, tool.bumps) == (
            each.tool.origin,
            each.tool.target,
            each.tool.width,
            each.tool.bumps,
        )
        assert all(len(f"{x:g}") <= 7 for end in ends(tool) for x in end)
    assert found.text.endswith("\n")
    assert max(map(len, found.text.splitlines())) <= 120


def test_command_writes_the_file_and_a_table(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb")
    result = run(path, "-o", tmp_path / "tools.yaml", "--count", 1)
    assert result.exit_code == 0
    assert result.stdout == ""
    assert (tmp_path / "tools.yaml").read_text() == suggest(path, count=1).text
    head, row = result.stderr.splitlines()
    assert head.split() == ["tool", "by", "clip", "at", "shortens", "from", "to"]
    assert row.split()[:4] == ["joint_1", "joint_1", "fold", "1.00"]
    for arguments in ([path, "--count", 1], [path, "--count", 1, "-o", "-"]):
        result = run(*arguments)
        assert result.stdout == (tmp_path / "tools.yaml").read_text()
    result = run(path, "-q")
    assert result.stderr == ""
    assert result.stdout


def test_json_has_these_keys(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb")
    result = run(path, "--json", "-q")
    assert result.exit_code == 0
    data = json.loads(result.stdout)
    assert list(data) == ["suggest", "asset", "reason", "notes", "tools"]
    assert data["suggest"] == 1
    assert data["reason"] is None
    assert all(list(tool) == KEYS for tool in data["tools"])
    best = data["tools"][0]
    assert best["clips"] == {"fold": best["shortest"]}
    assert best["shortening"] == pytest.approx(1.0 - best["shortest"] / best["span"])
    result = run(path, "--json", "-o", tmp_path / "tools.yaml")
    assert json.loads(result.stdout) == data
    assert load_tools(tmp_path / "tools.yaml").tools
    rigid = limb(tmp_path / "rigid.glb", skinned=False, clip=None)
    result = run(rigid, "--json")
    assert isinstance(result.exception, AssetError)
    assert json.loads(result.stdout)["tools"] == []
    assert "no mesh deforms" in json.loads(result.stdout)["reason"]


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (["--clip", "flod"], AssetError, "did you mean 'fold'"),
        (["--node", "limp"], AssetError, "did you mean 'limb'"),
        (["-o", "limb.glb"], BakeError, "is an input"),
        (["-o", "missing/tools.yaml"], WrinkleError, "missing"),
    ],
)
def test_faults_are_said_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], error: type[WrinkleError], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    limb(Path("limb.glb"))
    before = Path("limb.glb").read_bytes()
    result = run("limb.glb", *arguments)
    assert isinstance(result.exception, error)
    assert message in str(result.exception)
    assert os.listdir(".") == ["limb.glb"]
    assert Path("limb.glb").read_bytes() == before


@pytest.mark.parametrize("arguments", [["--count", "0"], ["--fps", "nan"], ["--json", "-o", "-"], []])
def test_wrong_usage_is_code_2(arguments: list[str]) -> None:
    assert run(*(["limb.glb", *arguments] if arguments else [])).exit_code == 2


def test_same_bytes_in_another_folder_and_process(tmp_path: Path) -> None:
    for folder, seed in (("a", "1"), ("b", "2")):
        (tmp_path / folder).mkdir()
        limb(tmp_path / folder / "limb.glb", joints=3, morphs=1, morph_clip="LINEAR")
        program = "import sys; from wrinklecli.cli import main; main()"
        arguments = ["suggest", "limb.glb", "-o", "tools.yaml"]
        subprocess.run(
            [sys.executable, "-c", program, *arguments],
            check=True,
            cwd=tmp_path / folder,
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
        )
    assert (tmp_path / "a/tools.yaml").read_bytes() == (tmp_path / "b/tools.yaml").read_bytes()


# Limits and damage


def test_long_clips_are_sampled_sparsely(tmp_path: Path) -> None:
    asset = limb_asset()
    animation: Json = {"name": "long"}
    turns: Floats = np.array([[0, 0, 0, 1], [0, 0, 0.6, 0.8], [0, 0, 0, 1]])
    asset.channel(animation, 2, "rotation", [0.0, 40000.0, 80000.0], turns)
    asset.append("animations", animation)
    seen: list[int] = []
    found = suggest(
        asset.write(tmp_path / "limb.glb"),
        progress=lambda stage, _done, total: seen.append(total) if stage == "posing" else None,
    )
    assert max(seen) <= 2 * 200
    assert "long" in found.tools[0].clips


def test_too_much_work_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wrinklecli.review.suggest.measure._TOO_MUCH_WORK", 100)
    with pytest.raises(BakeError, match="use --clip or --node"):
        suggest(limb(tmp_path / "limb.glb"))


@pytest.mark.parametrize("scale", [1e15, 1e25, 1e200])
def test_lengths_beyond_what_a_tools_file_takes_are_said(tmp_path: Path, scale: float) -> None:
    with pytest.raises(AssetError):
        suggest(limb(tmp_path / "limb.glb", root={"scale": [scale] * 3}))


@pytest.mark.parametrize("scale", [1e-12, 1e-30])
def test_where_no_tool_attaches_none_is_suggested(tmp_path: Path, scale: float) -> None:
    assert not suggest(limb(tmp_path / "limb.glb", root={"scale": [scale] * 3})).tools


def flat_mesh() -> Asset:
    asset = limb_asset()
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["mode"] = 1
    return asset


def hidden() -> Asset:
    asset = limb_asset(root={})
    animation: Json = {"name": "vanish"}
    asset.channel(animation, 3, "scale", [0.0, 1.0], [[1.0] * 3, [0.0] * 3])
    asset.append("animations", animation)
    return asset


@pytest.mark.parametrize(("make", "message"), [(flat_mesh, "no triangles")])
def test_malformed_assets_are_a_line(tmp_path: Path, make: Callable[[], Asset], message: str) -> None:
    with pytest.raises(AssetError, match=message):
        suggest(make().write(tmp_path / "limb.glb"))


def test_a_character_scaled_to_nothing_is_not_compressed(tmp_path: Path) -> None:
    found = suggest(hidden().write(tmp_path / "limb.glb"), clips=["vanish"])
    assert "compresses" in found.reason


def test_clips_that_hide_the_character_are_null_in_json(tmp_path: Path) -> None:
    asset = limb_asset()
    animation: Json = {"name": "hidden"}
    asset.channel(animation, 1, "scale", [0.0, 1.0], [[0.0] * 3, [0.0] * 3])
    asset.append("animations", animation)
    result = run(asset.write(tmp_path / "limb.glb"), "--json", "-q")
    assert result.exit_code == 0
    clips = json.loads(result.stdout)["tools"][0]["clips"]
    assert clips["hidden"] is None
    assert clips["fold"] > 0


@pytest.mark.parametrize("first", range(0, 60, 20))
def test_damaged_assets_are_measured_or_refused(tmp_path: Path, first: int) -> None:
    outcomes = []
    for number in range(first, first + 20):
        case = hostile.make_case(number)
        path = tmp_path / f"case_{number}{case.suffix}"
        path.write_bytes(case.asset)
        with hostile.bounded(seconds=hostile.SECONDS, megabytes=hostile.MEGABYTES):
            try:
                found = suggest(path)
                outcomes.append(bool(found.text) == bool(found.tools) != bool(found.reason))
            except WrinkleError as error:
                outcomes.append(bool(error.lines))
    assert all(outcomes)


def test_shared_meshes_are_looked_at_for_each_node() -> None:
    found = suggest(edited("wrist", shared_mesh), count=4)
    assert {each.mesh for each in found.tools} == {"wrist", "twin"}
