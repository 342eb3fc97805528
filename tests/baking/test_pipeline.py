"""The whole bake, from files to a file: its dependencies, and the options of the tools file."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

import wrinklecli
from kit.bakes import COARSE, bake_config, bake_once, place
from kit.clients import assert_valid
from kit.limb import limb_asset, write_tools
from kit.limb import tool as limb_tool
from kit.places import ROOT
from kit.player import Gltf, Json, anchor_distances, described, wrinkle_columns
from kit.samples import BACK, BROW, PALM, Editor, edited, sample, without_animations
from wrinklecli.drive.table import TABLE_ERROR
from wrinklecli.errors import WrinkleError

STRATEGIES = {"everywhere": 1, "both_ends": 3, "origin": 5}


def geometry(file: Gltf, node: str) -> list[tuple[str, bytes]]:
    """Every accessor of a mesh, decoded, with what it is for."""
    found = []
    for number, primitive in enumerate(file.mesh(node)["primitives"]):
        named = {**primitive["attributes"], "indices": primitive["indices"]}
        for index, target in enumerate(primitive.get("targets", [])):
            named |= {f"target {index} {name}": accessor for name, accessor in target.items()}
        found += [(f"{number} {name}", file.stored(accessor).tobytes()) for name, accessor in named.items()]
    return found


# Morph targets


@pytest.mark.quick(1)
@pytest.mark.parametrize("details", [[], [0.15, 0.2]])
@pytest.mark.parametrize(("strategy", "count"), STRATEGIES.items())
def test_targets_of_five_bumps(strategy: str, count: int, details: list[float]) -> None:
    tool = {**PALM, "bumps": 5, "strategy": strategy, "details": details, "max_height": "4%"}
    after = bake_once("wrist", tool)
    assert after.mesh("wrist")["extras"]["targetNames"] == [f"wrinkle_palm_{k + 1}" for k in range(count)]
    assert all(np.abs(delta).max() > 1e-4 for delta in after.deltas("wrist"))
    assert (after.weights("wrist", "flex", np.linspace(0, 2, 41)).max(axis=0) > 0.9).all()


def test_bumps_that_never_rise_get_no_target() -> None:
    after = bake_once("wrist", {**PALM, "bumps": 5, "strategy": "origin", "max_height": "none"})
    assert after.mesh("wrist")["extras"]["targetNames"] == ["wrinkle_palm_1"]


@pytest.mark.slow
def test_bumps_rise_in_the_order_of_their_strategy() -> None:
    times = np.linspace(0, 1, 61)
    options: Json = {"bumps": 5, "max_height": "4%"}
    for strategy, count in (("origin", 5), ("both_ends", 3)):
        after = bake_once("wrist", {**PALM, **options, "strategy": strategy})
        weights = after.weights("wrist", "flex", times)
        begins = [times[np.argmax(column > 0)] for column in weights.T]
        assert begins == sorted(begins)
        assert len(set(begins)) == count
        # A later bump rises only when the one before is full.
        for first, second in zip(weights.T[:-1], weights.T[1:], strict=True):
            assert (first[second > 0.02] > 0.98).all()


@pytest.mark.quick(1)
@pytest.mark.parametrize(("asset", "config"), [("wrist", "wrist"), ("head", "head")])
def test_geometry_does_not_depend_on_clips(asset: str, config: str) -> None:
    whole = bake_config(asset, config)
    clips = [animation["name"] for animation in whole.json["animations"]]
    variants = [bake_config(asset, config, clips=[clip]) for clip in clips]
    variants.append(bake_config(asset, config, tracks="none"))
    for variant in variants:
        assert geometry(variant, asset) == geometry(whole, asset)
        assert variant.mesh(asset)["extras"] == whole.mesh(asset)["extras"]
        assert described(variant) == described(whole)


@pytest.mark.slow
def test_geometry_without_any_clip() -> None:
    tools = ({**PALM, "strategy": "origin"}, BACK)
    whole, bare = bake_once("wrist", *tools), bake_once(edited("wrist", without_animations), *tools)
    assert "animations" not in bare.json
    assert geometry(bare, "wrist") == geometry(whole, "wrist")
    assert bare.mesh("wrist")["extras"] == whole.mesh("wrist")["extras"]
    assert described(bare) == described(whole)


def test_only_the_clips_asked_for_get_tracks() -> None:
    part, whole = bake_config("wrist", "wrist", clips=["extend"]), bake_config("wrist", "wrist")
    before = Gltf(sample("wrist"))
    assert part.json["animations"][0] == before.json["animations"][0]
    for one, other in zip(part.keys("extend", "wrist"), whole.keys("extend", "wrist"), strict=True):
        assert np.array_equal(one, other)


def test_only_the_tools_asked_for() -> None:
    part = bake_once("wrist", PALM, BACK, only=["back"])
    assert part.path.read_bytes() == bake_once("wrist", BACK).path.read_bytes()


def test_without_tracks_animations_are_as_they_were() -> None:
    before, after = Gltf(sample("wrist")), bake_once("wrist", PALM, tracks="none")
    assert after.json["animations"] == before.json["animations"]
    for animation in before.json["animations"]:
        for sampler in animation["samplers"]:
            for index in (sampler["input"], sampler["output"]):
                assert before.stored(index).tobytes() == after.stored(index).tobytes()
    assert wrinkle_columns(after, "wrist")


@pytest.mark.slow
@pytest.mark.parametrize("options", [{"tracks": "none"}, {"clips": ["think"]}], ids=["tracks", "clips"])
def test_weights_of_a_clip_that_was_not_baked_fit_the_new_targets(options: Json) -> None:
    """A weights channel holds a value for each target: the new ones get zeros."""
    before, after = Gltf(sample("head")), bake_once("head", BROW, **options)
    times = np.linspace(0, 2, 201)
    played = after.weights("head", "raise_brows", times)
    assert played.shape == (len(times), 3)
    assert np.abs(played[:, :2] - before.weights("head", "raise_brows", times)).max() < 1e-6
    assert not played[:, 2].any()
    assert_valid(after.path)


# Same input, same bytes


RUN = """
import sys, json, wrinklecli
for asset, tools, out in json.loads(sys.argv[1]):
    wrinklecli.bake(asset, tools, out, max_levels=1)
"""


@pytest.mark.slow
@pytest.mark.long
def test_same_bytes_from_another_process_and_folder(tmp_path: Path) -> None:
    """With another hash seed and two BLAS threads, which change the last bits of what BLAS computes."""
    patch = limb_tool(attachment="patch", bumps=2)
    polyline = limb_tool(profile="polyline", details=[0.2], strategy="origin")
    jobs, expected = [], []
    asset = place(limb_asset())
    for number, chosen in enumerate((patch, polyline)):
        tools = write_tools(tmp_path / f"elsewhere {number}.yaml", chosen)
        relative = os.path.relpath(asset, tmp_path)
        jobs.append((relative, tools.name, f"{number}.glb"))
        expected.append(bake_once(asset, chosen).path.read_bytes())
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "2")
    subprocess.run(
        [sys.executable, "-W", "error", "-c", RUN, json.dumps(jobs)],
        cwd=tmp_path,
        env={**os.environ, **threads, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "1"},
        check=True,
    )
    for (_, _, out), wanted in zip(jobs, expected, strict=True):
        made = (tmp_path / out).read_bytes()
        assert hashlib.sha256(made).digest() == hashlib.sha256(wanted).digest(), out


def test_same_bytes_twice_in_one_process(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", PALM)
    for name in ("a.gltf", "b.gltf"):
        (tmp_path / name[0]).mkdir()
        wrinklecli.bake(sample("wrist"), tools, tmp_path / name[0] / "out.gltf", **COARSE)
    first, second = (sorted((tmp_path / name).iterdir()) for name in "ab")
    assert [path.name for path in first] == [path.name for path in second]
    assert [path.read_bytes() for path in first] == [path.read_bytes() for path in second]


def test_no_path_or_time_is_in_the_file(tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "secret_place.yaml", PALM)
    wrinklecli.bake(sample("wrist"), tools, tmp_path / "hidden_name.glb", **COARSE)
    content = (tmp_path / "hidden_name.glb").read_bytes()
    for word in (b"secret_place", b"hidden_name", str(tmp_path).encode(), b"samples/"):
        assert word not in content


# Refinement


def test_without_refinement_the_vertices_are_those_of_the_source() -> None:
    before, after = Gltf(sample("head")), bake_config("head", "head", max_levels=0)
    old, new = (file.mesh("head")["primitives"][0] for file in (before, after))
    assert old["attributes"] == new["attributes"]
    assert old["indices"] == new["indices"]
    for index in [*old["attributes"].values(), old["indices"]]:
        assert before.stored(index).tobytes() == after.stored(index).tobytes()
    assert wrinkle_columns(after, "head")


@pytest.mark.slow
def test_finer_settings_make_more_vertices() -> None:
    counts = [
        len(bake_once("wrist", PALM, top={"refinement": {"edges_per_interval": edges}}).attribute("wrist", "POSITION"))
        for edges in (1, 2, 4)
    ]
    assert counts[0] < counts[1] < counts[2]


def test_midpoint_keeps_the_coarse_shape() -> None:
    after = bake_once("wrist", PALM, top={"refinement": {"scheme": "midpoint"}})
    before = Gltf(sample("wrist"))
    positions = after.attribute("wrist", "POSITION")
    coarse, faces = before.attribute("wrist", "POSITION"), before.triangles("wrist")
    a, b, c = (coarse[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for point in positions[len(coarse) :: 7]:
        near = np.abs(np.sum((point - a) * normals, axis=1)) < 1e-7
        inside = near.copy()
        for p, q in ((a, b), (b, c), (c, a)):
            inside &= np.sum(np.cross(q - p, point - p) * normals, axis=1) > -1e-9
        assert inside.any(), point


# Motion


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("asset", "config", "clip"),
    [("wrist", "wrist", "flex"), ("head", "head", "think"), ("trousers", "trousers", "walk")],
)
def test_flat_skin_is_where_it_was(asset: str, config: str, clip: str) -> None:
    """At keys where no tool acts, original vertices are exactly where the source has them."""
    before, after = Gltf(sample(asset)), bake_config(asset, config)
    times, values = after.keys(clip, asset)
    flat = times[~values[:, wrinkle_columns(after, asset)].any(axis=1)][:40]
    assert len(flat)
    was, now = before.pose(asset, clip, flat), after.pose(asset, clip, flat)
    size = np.ptp(was.reshape(-1, 3), axis=0).max()
    assert np.abs(now[:, : was.shape[1]] - was).max() < 1e-6 * size


def test_what_is_beside_the_patches_never_moves() -> None:
    before, after = Gltf(sample("trousers")), bake_config("trousers", "trousers")
    times = np.linspace(0, 2.4, 25)
    was, now = before.pose("trousers", "squat", times), after.pose("trousers", "squat", times)
    still = ~after.deltas("trousers")[:, : was.shape[1]].any(axis=(0, 2))
    assert 0.3 < still.mean() < 1
    assert np.abs(now[:, : was.shape[1]] - was)[:, still].max() < 1e-6
    # All that is below the knees by more than the patches reach, and the waist.
    heights = before.attribute("trousers", "POSITION")[:, 1]
    assert still[(heights < 0.3) | (heights > 0.75)].all()


def test_stretching_makes_no_wrinkle() -> None:
    after = bake_once("wrist", PALM)
    assert not after.keys("extend", "wrist")[1].any()


def test_the_shortening_is_that_of_the_anchors() -> None:
    """Weights rise exactly where the anchors come closer, by the extras' places."""
    after = bake_config("wrist", "wrist")
    tools = after.json["nodes"][0]["extras"]["wrinkle"]["tools"]
    for clip, acting in (("flex", 0), ("extend", 1)):
        times, values = after.keys(clip, "wrist")
        for column, tool in enumerate(tools):
            shorter = anchor_distances(after, tool, "wrist", clip, times) < tool["rest_length"] * (1 - 2e-5)
            assert np.array_equal(values[:, column] > 0, shorter)
            assert shorter.any() == (column == acting)


# Options of a tool


@pytest.mark.slow
def test_strength_per_clip() -> None:
    plain = bake_once("wrist", PALM, BACK)
    half = bake_once("wrist", {**PALM, "clips": {"flex": 0.3, "extend": 0}}, {**BACK, "clips": {"extend": 0}})
    assert geometry(plain, "wrist") == geometry(half, "wrist")
    times = np.linspace(0, 2, 61)
    full, weak = (file.weights("wrist", "flex", times) for file in (plain, half))
    assert full[:, 0].max() > 0.9
    assert np.abs(weak[:, 0] - 0.3 * full[:, 0]).max() < 0.006
    assert not half.weights("wrist", "extend", times).any()


@pytest.mark.quick(1)
@pytest.mark.parametrize("strength", [2.0, 0.5, -1.0])
def test_strength_of_a_clip_stands_in_place_of_the_tools(strength: float) -> None:
    time = np.array([0.8])
    source = bake_once("wrist", {**PALM, "clips": {"flex": 0}})
    flat, plain = source.pose("wrist", "flex", time), bake_once("wrist", PALM).pose("wrist", "flex", time)
    other = bake_once("wrist", {**PALM, "strength": strength, "clips": {"flex": 0.4}}).pose("wrist", "flex", time)
    assert np.abs(plain - flat).max() > 0.003
    assert np.abs((other - flat) - 0.4 * (plain - flat)).max() < 3e-5


@pytest.mark.slow
def test_a_tool_of_strength_0_acts_where_a_clip_says_so() -> None:
    after = bake_once("wrist", {**PALM, "strength": 0, "clips": {"flex": 0.4}})
    reference = bake_once("wrist", {**PALM, "strength": 1, "clips": {"flex": 0.4}})
    time = np.array([0.8])
    difference = after.pose("wrist", "flex", time) - reference.pose("wrist", "flex", time)
    assert np.abs(difference).max() < 3e-5


def test_negative_strength_is_inward() -> None:
    out, inward = bake_once("wrist", PALM), bake_once("wrist", {**PALM, "strength": -0.5})
    vertices = len(out.attribute("wrist", "POSITION"))
    assert vertices == len(inward.attribute("wrist", "POSITION"))
    normals, names = out.attribute("wrist", "NORMAL"), ("flex", np.array([0.8]))
    along = []
    for file in (out, inward):
        moved = np.tensordot(file.weights("wrist", *names)[0], file.deltas("wrist"), axes=1)
        along.append(np.sum(moved * normals, axis=1))
    big = np.abs(along[0]) > 1e-4
    assert (along[0][big] > 0).all()
    assert (along[1][big] < 0).all()
    assert np.abs(along[1] + 0.5 * along[0]).max() < 2e-5


@pytest.mark.slow
def test_tools_that_overlap_add_up() -> None:
    wide = {**PALM, "name": "wide", "bumps": 2}
    both, one, other = bake_once("wrist", PALM, wide), bake_once("wrist", PALM), bake_once("wrist", wide)
    old = len(Gltf(sample("wrist")).attribute("wrist", "POSITION"))
    assert np.allclose(both.deltas("wrist")[0, :old], one.deltas("wrist")[0, :old], atol=2e-4)
    overlap = both.deltas("wrist").any(axis=2).all(axis=0)
    assert overlap.sum() > 100
    assert other.deltas("wrist")[0].any()


def test_a_disabled_tool_is_not_there() -> None:
    assert (
        bake_once("wrist", PALM, {**BACK, "enabled": False}).path.read_bytes()
        == bake_once("wrist", PALM).path.read_bytes()
    )


@pytest.mark.slow
def test_keyed_rest_lengths() -> None:
    keys = {"think": [[0, "100%"], [0.8, "100%"], [1.4, "125%"], [2.0, "125%"], [2.8, "100%"]]}
    after = bake_once("head", {**BROW, "strategy": "both_ends", "rest_length": {"keys": keys}})
    (tool,) = after.json["nodes"][0]["extras"]["wrinkle"]["tools"]
    times = np.linspace(0, 3, 601)
    assert np.ptp(anchor_distances(after, tool, "head", "think", times)) < 1e-6
    names = after.mesh("head")["extras"]["targetNames"]
    weights = after.weights("head", "think", times)[:, [names.index(each) for each in tool["targets"]]]
    acting = weights.any(axis=1)
    assert acting[(times > 0.81) & (times < 2.79)].all()
    assert not acting[(times < 0.79) | (times > 2.81)].any()
    assert np.ptp(weights[(times > 1.4) & (times < 2.0)], axis=0).max() < 1e-6
    first, second = (times[np.argmax(column > 0.01)] for column in weights.T)
    assert 0.8 < first < second < 1.4, "the outer bumps come first"
    # The clip without keys follows the anchors, by shapes that are as much higher as the greatest rest length is.
    plain = bake_once("head", {**BROW, "strategy": "both_ends"})
    (other,) = plain.json["nodes"][0]["extras"]["wrinkle"]["tools"]
    rows = np.union1d(tool["shortenings"], other["shortenings"])
    looked_up, lower = (
        np.stack([np.interp(rows, each["shortenings"], column) for column in np.transpose(each["weights"])])
        for each in (other, tool)
    )
    assert np.abs(looked_up - 1.25 * lower).max() < 2 * TABLE_ERROR
    one, other = (
        each.weights("head", "raise_brows", times)[:, wrinkle_columns(each, "head")] for each in (plain, after)
    )
    assert one.max() > 0.5
    # Each track is off by as much as its keys may be.
    assert np.abs(one - 1.25 * other).max() < 0.01


@pytest.mark.slow
def test_the_bundled_keyed_head() -> None:
    after = bake_config("head", "head_keyed")
    columns = wrinkle_columns(after, "head")
    weights = after.weights("head", "think", np.linspace(0, 3, 61))[:, columns]
    assert not weights[[0, -1]].any()
    assert weights.max() > 0.5
    assert after.weights("head", "raise_brows", [0.9])[0, columns].max() > 0.5


@pytest.mark.slow
def test_keys_make_the_height_of_an_equal_shortening() -> None:
    """One bump on a straight segment: keys of 125 % and a fold by a fifth give the same curve."""
    tool = {**BROW, "bumps": 1, "max_height": "none"}
    keyed = bake_once("head", {**tool, "rest_length": {"keys": {"think": [[0, "100%"], [3, "150%"]]}}})
    fixed = bake_once("head", {**tool, "rest_length": "125%"})
    height = [
        np.abs(np.tensordot(file.weights("head", "think", [1.5])[0, 2:], file.deltas("head")[2:], axes=1)).max()
        for file in (keyed, fixed)
    ]
    # 1 % of the tallest, which for the keyed tool is that of 150 %.
    assert abs(height[0] - height[1]) < 0.02 * height[1]


def test_rest_length_of_a_morph_target() -> None:
    tool = {**BROW, "rest_length": {"morph": "browsUp", "full": "130%"}}
    after, plain = bake_once("head", tool), bake_once("head", BROW)
    times, values = after.keys("raise_brows", "head")
    brows = values[:, 0]
    wrinkles = values[:, 2:].max(axis=1)
    assert (wrinkles[brows > 0.01] > 0).all()
    assert not wrinkles[brows <= 0].any()
    low = times[(brows > 0.01) & (brows < 0.2)]
    assert (after.weights("head", "raise_brows", low)[:, 2] > plain.weights("head", "raise_brows", low)[:, 2]).all()


@pytest.mark.quick(1)
@pytest.mark.parametrize(("length", "at_rest"), [("110%", True), ("90%", False)])
def test_a_fixed_rest_length_shows_at_rest_or_has_slack(length: str, at_rest: bool) -> None:
    after, plain = bake_once("wrist", {**PALM, "rest_length": length}), bake_once("wrist", PALM)
    times = np.linspace(0, 1, 101)
    weights = after.weights("wrist", "flex", times)[:, 0]
    assert (weights[0] > 0.1) == at_rest
    assert (after.weights("wrist", None, [0.0])[0, 0] > 0.1) == at_rest
    if not at_rest:
        assert times[np.argmax(weights > 0)] > times[np.argmax(plain.weights("wrist", "flex", times)[:, 0] > 0)] + 0.1


# The rest pose


def hand_bent(editor: Editor) -> None:
    """Stored in the pose that flex has at its most, which is not the one it was bound in."""
    gltf = Gltf(sample("wrist"))
    for index in (2, 3, 4):
        played = gltf.played("flex", index, "rotation", [1.0])
        assert played is not None
        editor.json["nodes"][index]["rotation"] = played[0].tolist()


def test_rest_in_the_pose_of_binding() -> None:
    """The forearm is stored as it was bound, so tools attach as in the straight sample."""
    bent = edited("wrist", hand_bent)
    after, straight = bake_once(bent, PALM, top={"rest": "bind"}), bake_once("wrist", PALM)
    assert np.array_equal(after.attribute("wrist", "POSITION"), straight.attribute("wrist", "POSITION"))
    assert np.abs(after.deltas("wrist") - straight.deltas("wrist")).max() < 1e-9
    times = np.linspace(0, 2, 41)
    difference = after.weights("wrist", "flex", times) - straight.weights("wrist", "flex", times)
    assert np.abs(difference).max() < 1e-6
    # As stored it is folded already, and shows it.
    assert after.weights("wrist", None, [0.0])[0, 0] > 0.9


def test_rest_in_a_clip() -> None:
    rest = {"clip": "flex", "time": 0.3}
    source = Gltf(sample("wrist"))
    world = source.matrices("flex", [0.3])[0]
    still = source.matrices(None, [0.0])[0]
    place = world[2] @ np.linalg.inv(still[2]) @ [*PALM["target"], 1.0]
    after = bake_once("wrist", {**PALM, "target": place[:3].tolist()}, top={"rest": rest})
    (tool,) = after.json["nodes"][0]["extras"]["wrinkle"]["tools"]
    distance = anchor_distances(after, tool, "wrist", "flex", np.array([0.3]))[0]
    assert tool["rest_length"] == pytest.approx(distance, rel=3e-5)
    weights = after.weights("wrist", "flex", np.array([0.0, 0.3, 0.5, 1.0]))[:, 0]
    assert weights[0] == 0
    assert weights[1] < 0.01
    assert 0.1 < weights[2] <= weights[3]
    assert not after.weights("wrist", None, [0.0]).any()


# The paper's wording


@pytest.mark.slow
def test_patch_attachment_agrees_with_skin_where_little_moves() -> None:
    """Near rest the patch projected anew is the patch at rest."""
    source = bake_once("wrist", {**PALM, "bumps": 2, "clips": {"flex": 0}})
    skin, patch = (
        bake_once("wrist", {**PALM, "bumps": 2}),
        bake_once("wrist", {**PALM, "attachment": "patch", "bumps": 2, "clips": {"extend": 0}}),
    )
    # Beside a patch that moves, more is refined: what all have are the vertices of the source.
    times, old = np.linspace(0.03, 0.21, 10), len(Gltf(sample("wrist")).pose("wrist", None, [0.0])[0])
    flat, one, other = (file.pose("wrist", "flex", times)[:, :old] for file in (source, skin, patch))
    one, other = one - flat, other - flat
    heights = np.linalg.norm(one, axis=2).max(axis=1)
    assert (heights > 2e-4).all()
    gaps = np.linalg.norm(one - other, axis=2).max(axis=1) / heights
    assert gaps[0] < 0.1
    assert gaps[0] < gaps[-1], "the two methods part as the hand bends"


@pytest.mark.slow
def test_patch_attachment_needs_more_targets() -> None:
    patch = bake_once("wrist", {**PALM, "attachment": "patch", "bumps": 2, "clips": {"extend": 0}})
    assert len(wrinkle_columns(patch, "wrist")) > 1
    assert np.abs(patch.keys("flex", "wrist")[1]).max() <= 1.0
    assert not patch.json["nodes"][0].get("extras", {}).get("wrinkle", {}).get("tools")


# Faults


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"origin": [0.5, 0.5, 0.5]}, ["tools[0].origin", "from the mesh"]),
        ({"origin": PALM["target"]}, ["tools[0]", "origin"]),
        ({"node": "wirst"}, ["tools[0].node", "did you mean 'wrist'"]),
        ({"node": "hand"}, ["tools[0].node", "no node with a mesh"]),
        ({"rest_length": {"morph": "smile", "full": "110%"}}, ["tools[0].rest_length.morph", "smile"]),
        ({"origin": {"marker": "handd"}}, ["tools[0]", "handd", "'hand'"]),
        ({"target": [-0.032, 0.022, 0.0]}, ["tools[0]"]),
    ],
)
def test_a_tool_that_does_not_fit(change: Json, words: list[str], tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", {**PALM, **change})
    with pytest.raises(WrinkleError) as caught:
        wrinklecli.bake(sample("wrist"), tools, tmp_path / "out.glb")
    (line,) = caught.value.lines
    assert line.startswith(f"{tools}:")
    assert all(word in line for word in words), line
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tools.yaml"]


def test_all_tools_that_do_not_fit_are_named(tmp_path: Path) -> None:
    lost = [{**PALM, "name": f"t{k}", "origin": [9, 9, 9]} for k in range(3)]
    tools = write_tools(tmp_path / "tools.yaml", *lost, PALM)
    with pytest.raises(WrinkleError) as caught:
        wrinklecli.bake(sample("wrist"), tools, tmp_path / "out.glb")
    assert len(caught.value.lines) == 3


def test_an_optional_tool_may_be_absent() -> None:
    after = bake_once("wrist", PALM, {**BACK, "node": "foot", "optional": True})
    assert after.path.read_bytes() == bake_once("wrist", PALM).path.read_bytes()


def test_markers(tmp_path: Path) -> None:
    def with_markers(editor: Editor) -> None:
        for end in ("origin", "target"):
            editor.json["nodes"].append({"name": f"palm_{end}", "translation": PALM[end]})

    marked = {**PALM, "origin": {"marker": "palm_origin"}, "target": {"marker": "palm_target"}}
    after, plain = bake_once(edited("wrist", with_markers), marked), bake_once("wrist", PALM)
    assert geometry(after, "wrist") == geometry(plain, "wrist")
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.long
def test_mirrored_tools_make_mirrored_wrinkles() -> None:
    """Where they have a seed: without one, those of a name differ from those of another."""
    config = yaml.safe_load((ROOT / "configs" / "trousers.yaml").read_text())
    config["defaults"]["seed"] = 7
    after = bake_once("trousers", *config.pop("tools"), top=config)
    names = after.mesh("trousers")["extras"]["targetNames"]
    positions, deltas = after.attribute("trousers", "POSITION"), after.deltas("trousers")
    pairs = [(name, name.replace("_L_", "_R_")) for name in names if "_L_" in name]
    assert len(pairs) == len(names) / 2
    for pair in pairs:
        extents = []
        for name, sign in zip(pair, (1, -1), strict=True):
            delta = deltas[names.index(name)]
            moved = np.abs(delta).max(axis=1) > 1e-5
            rows = np.hstack([positions[moved], delta[moved]]) * [sign, 1, 1, sign, 1, 1]
            extents.append((rows.min(axis=0), rows.max(axis=0)))
        assert np.allclose(*extents, atol=1e-5)
