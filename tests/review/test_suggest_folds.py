"""Suggested tools lie across the folds of tubes, samples and real characters, and shorten as they say."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.limb import LENGTH, RADIUS, limb
from kit.samples import sample
from kit.suggested import along, ends, in_assets, middle, suggest_once
from wrinklecli import bake
from wrinklecli.character.clip import read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.effects.wrinkle.attach import attach_tools
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.split_mesh import Part, split_node
from wrinklecli.gltf.writer import write
from wrinklecli.numeric.arrays import unit
from wrinklecli.review.check import check
from wrinklecli.review.suggest.fitted_tools import Suggestion
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.surface.rest import rest_pose
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.read import load_tools, parse_tools
from wrinklecli.tools.records import Length, RestLengthMorph

Json = dict[str, Any]


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(
    "options", [{}, {"rings": 40, "sides": 28}, {"rings": 11, "sides": 8}, {"normals": False, "indices": None}]
)
def test_a_bent_tube_folds_on_its_inner_side_along_the_tube(tmp_path: Path, options: Json) -> None:
    # Facets of a limb without normals bend, and would leave the tool out.
    everything = not options.get("normals", True)
    found = suggest_once(limb(tmp_path / "limb.glb", **options), **({"everything": True} if everything else {}))
    best = found.tools[0]
    x, y, z = middle(best.tool)
    assert abs(x) < 0.15 * best.span
    assert y > 0.7 * RADIUS
    assert abs(z) < 0.3 * RADIUS
    assert abs(along(best.tool)[0]) > 0.99
    assert best.shortening > 0.4
    assert (best.driver, best.by_morph, best.clip, best.mirrored) == ("joint_1", False, "fold", False)
    assert best.time == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
def test_an_asset_gets_the_same_tools_again(tmp_path: Path) -> None:
    asset = limb(tmp_path / "limb.glb")
    assert suggest_once(asset).text == suggest(asset).text


@pytest.mark.slow
@pytest.mark.long
def test_two_bends_are_one_mirrored_tool(tmp_path: Path) -> None:
    found = suggest_once(limb(tmp_path / "limb.glb", joints=3, angle=200.0))
    best, *_ = found.tools
    assert best.mirrored
    assert best.tool.name.endswith(".L")
    assert abs(middle(best.tool)[0]) == pytest.approx(LENGTH / 6, abs=0.2)
    assert middle(best.tool)[1] > 0.7 * RADIUS
    left, right, *_ = parse_tools(found.text).tools
    assert (right.name, ends(right)[0].tolist()) == (f"{left.name[:-1]}R", (ends(left)[0] * [-1, 1, 1]).tolist())


@pytest.mark.slow
@pytest.mark.parametrize("scale", [[1, 1, -1], [-1, 1, 1]])
def test_suggestions_on_a_mirrored_skin_are_its_mirror_image(tmp_path: Path, scale: list[float]) -> None:
    plain = suggest_once(limb(tmp_path / "limb.glb")).tools[0]
    mirrored = suggest(limb(tmp_path / "mirrored.glb", root={"scale": scale}), count=1).tools[0]
    # What is a tool's origin there is its target here, and folds come in halves.
    found, wanted = (sorted(np.abs(ends(each.tool)).tolist()) for each in (mirrored, plain))
    assert np.abs(np.array(found) - np.array(wanted)).max() < 0.1 * plain.span
    assert middle(mirrored.tool)[1] > 0.7 * RADIUS
    assert mirrored.shortening == pytest.approx(plain.shortening, abs=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.001, 100.0])
def test_suggestions_scale_with_the_asset(tmp_path: Path, scale: float) -> None:
    plain = suggest_once(limb(tmp_path / "limb.glb")).tools[0]
    scaled = suggest(limb(tmp_path / "scaled.glb", root={"scale": [scale] * 3}), count=1).tools[0]
    assert np.abs(np.array(ends(scaled.tool)) / scale - np.array(ends(plain.tool))).max() < 0.02 * plain.span
    assert scaled.tool.width.value / scale == pytest.approx(plain.tool.width.value)
    assert scaled.tool.bumps == plain.tool.bumps
    assert scaled.shortening == pytest.approx(plain.shortening, abs=0.02)


@pytest.mark.slow
@pytest.mark.long
def test_suggestions_turn_with_the_asset(tmp_path: Path) -> None:
    turned = suggest(limb(tmp_path / "turned.glb", root={"rotation": [0.0, 0.0, 0.6, 0.8]}), count=1).tools[0]
    rotation = np.array([[0.28, -0.96, 0.0], [0.96, 0.28, 0.0], [0.0, 0.0, 1.0]])
    assert abs(along(turned.tool) @ rotation @ [1.0, 0.0, 0.0]) > 0.99
    assert middle(turned.tool) @ rotation @ [0.0, 1.0, 0.0] > 0.7 * RADIUS
    assert abs(middle(turned.tool) @ rotation @ [1.0, 0.0, 0.0]) < 0.2 * turned.span


@pytest.mark.slow
def test_a_morph_target_that_squashes_is_named(tmp_path: Path) -> None:
    path = limb(tmp_path / "limb.glb", skinned=False, clip=None, morphs=2, morph_clip="LINEAR")
    best = suggest(path).tools[0]
    assert (best.driver, best.by_morph) == ("morph_0", True)
    assert best.tool.name == "morph_0"
    assert abs(along(best.tool)[0]) > 0.99


# The samples and real assets


def measured(path: Path, found: Suggestions) -> None:
    """Compare the numbers of suggestions with the tools of their file, attached as in a bake."""
    document = read_document(path)
    clips = read_clips(document)
    settings = parse_tools(found.text)
    tools = {tool.name: tool for tool in settings.tools}
    mesh_nodes = [index for index, node in enumerate(document.items("nodes")) if "mesh" in node]
    assert len(tools) == len(found.tools) + sum(each.mirrored for each in found.tools)
    for each in found.tools:
        (rig,) = [
            rig for rig in (read_rig(document, index) for index in mesh_nodes) if rig.names[rig.node] == each.mesh
        ]
        surface = read_surface(document, rig)
        rest = rest_pose(surface, rig, settings, clips, [])
        pair = [tools[each.tool.name]]
        if each.mirrored:
            pair.append(tools[exchange_sides(each.tool.name)])
        patches = attach_tools(pair, surface, rest, rig, up=settings.up)
        assert patches[0].span == pytest.approx(each.span)
        assert max(patch.origin.distance for patch in patches) < 0.05 * each.span
        clip = next(clip for clip in clips if clip.name == each.clip)
        distances, *_ = patches[0].segment.lengths(rig, clip, np.array([each.time]))
        assert distances[0] == pytest.approx(each.clips[each.clip])
        assert min(each.clips.values()) == each.clips[each.clip]
        assert each.shortening > 0.05
        # The twin of what a clip folds may rest.
        assert each.shortening == pytest.approx(
            max(
                (1.0 - np.divide(*patches[0].segment.lengths(rig, clip, times)[:2]).min())
                for clip in clips
                for times in [np.linspace(clip.start, clip.end, 61)]
            ),
            abs=0.06,
        )


def nearest_to(found: Suggestions, place: tuple[float, float, float]) -> Suggestion:
    return min(found.tools, key=lambda each: float(np.linalg.norm(middle(each.tool) - place)))


def off(suggestion: Suggestion, place: tuple[float, float, float]) -> float:
    return float(np.linalg.norm(middle(suggestion.tool) - place))


@pytest.mark.slow
@pytest.mark.long
def test_the_sample_wrist_folds_on_both_sides() -> None:
    found = suggest_once(sample("wrist"))
    for place, clip in (((-0.002, -0.021, 0.0), "flex"), ((0.0, 0.0208, 0.0), "extend")):
        side = nearest_to(found, place)
        assert side in found.tools[:2]
        assert off(side, place) < 0.012
        assert side.clip == clip
        assert abs(along(side.tool)[0]) > 0.95
        assert not side.mirrored
    measured(sample("wrist"), found)


@pytest.mark.slow
@pytest.mark.long
def test_the_sample_head_folds_on_its_forehead() -> None:
    found = suggest(sample("head"), clips=["raise_brows"])
    brow = nearest_to(found, (0.0, 0.264, 0.078))
    assert off(brow, (0.0, 0.264, 0.078)) < 0.025
    assert not brow.mirrored
    assert 0.1 < brow.tool.width.value < 0.2, "one tool across all of it"
    assert (brow.driver, brow.by_morph) == ("browsUp", True)
    assert abs(along(brow.tool)[1]) > 0.9
    assert {each.clip for each in found.tools} == {"raise_brows"}
    measured(sample("head"), found)


@pytest.mark.slow
@pytest.mark.long
def test_a_real_wrist_folds_on_both_sides() -> None:
    """Both are proposed, though the palm's crease hides a third of the wrinkles in it."""
    path = in_assets("hand.glb")
    found = suggest_once(path, everything=True)
    palm = nearest_to(found, (-0.4730, 0.24655, 0.1938))
    assert off(palm, (-0.4730, 0.24655, 0.1938)) < 0.012
    assert abs(along(palm.tool) @ unit(np.array([-0.0216, -0.0221, 0.0376]))) > 0.9
    assert (palm.driver, palm.clip, palm.tool.name[:5]) == ("wrist.R", "bend", "wrist")
    back = [each for each in found.tools if each.driver == "wrist.R" and each is not palm]
    assert back
    assert back[0].clip == "bend"
    assert abs(back[0].time - palm.time) > 0.5
    measured(path, found)
    proposed = {each.tool.name for each in suggest_once(path).tools}
    assert {back[0].tool.name, palm.tool.name} <= proposed


@pytest.mark.slow
def test_a_real_forehead_folds_across_its_middle() -> None:
    path = in_assets("head_male.glb")
    found = suggest_once(path)
    brow = found.tools[0]
    assert (brow.driver, brow.by_morph, brow.mirrored, brow.clip) == ("browsUp", True, False, "frown")
    assert brow.time == pytest.approx(0.5, abs=0.05)
    assert off(brow, (0.0, 0.86, 0.16)) < 0.02
    assert brow.tool.rest_length == RestLengthMorph("browsUp", Length(105.0, percent=True))
    assert abs(along(brow.tool)[1]) > 0.8
    measured(path, found)


@pytest.mark.slow
@pytest.mark.long
def test_a_real_textured_man_folds_at_joints() -> None:
    path = in_assets("cesium_man.glb")
    assert suggest_once(path).fields  # where nothing is wanted beside it
    found = suggest_once(path, everything=True)
    rig = read_rig(
        read_document(path), next(i for i, n in enumerate(read_document(path).items("nodes")) if "mesh" in n)
    )
    assert found.tools
    assert {each.driver for each in found.tools} <= {rig.names[joint] for joint in rig.joints}
    measured(path, found)


@pytest.mark.slow
@pytest.mark.long
def test_nothing_is_worth_it_on_a_real_fox_of_facets() -> None:
    assert suggest(in_assets("fox.glb")).reason.startswith("fox is fur; ")
    found = suggest(in_assets("fox.glb"), materials={"fox": "skin"})
    assert not found.tools
    assert found.reason == "what its motions fold is left out, as the notes say"
    every = suggest(in_assets("fox.glb"), materials={"fox": "skin"}, everything=True).tools
    assert {each.judgement.reason[0] for each in every if each.judgement} == {"faceted"}


@pytest.mark.slow
def test_nothing_is_worth_it_on_a_real_strip_of_facets() -> None:
    found = suggest_once(in_assets("simple_skin.gltf"))
    assert not found.tools
    assert {each.reason for each in found.dropped} == {"faceted"}


@pytest.mark.slow
def test_a_leg_of_either_side_as_a_mesh_of_its_own_makes_a_pair(tmp_path: Path) -> None:
    asset = tmp_path / "legs.glb"
    document = read_document(sample("trousers"))
    edited = EditedDocument(document)
    mesh = document.items("meshes")[0]["primitives"][0]
    positions, triangles = document.accessor(mesh["attributes"]["POSITION"]), document.accessor(mesh["indices"])
    triangles = triangles.reshape(-1, 3).astype(np.intp)
    left = positions[triangles, 0].mean(axis=1) > 0
    nodes = split_node(edited, 0, [Part((triangles[left],), ()), Part((triangles[~left],), ())])
    for number, name in zip(nodes, ("LegLeft", "LegRight"), strict=True):
        edited.gltf["nodes"][number]["name"] = name
    write(edited, asset)
    found = suggest(asset, materials={"LegLeft": "skin", "LegRight": "skin"}, count=2)
    assert all(each.mirrored for each in found.tools)
    (tmp_path / "tools.yaml").write_text(found.text)
    tools = load_tools(tmp_path / "tools.yaml").tools
    assert {each.node for each in tools} == {"LegLeft", "LegRight"}
    assert not check(asset, tmp_path / "tools.yaml").warnings


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", ["wrist", "trousers", "head"])
def test_suggestions_bake_as_they_are(tmp_path: Path, name: str) -> None:
    found = suggest_once(sample(name))
    # To resolve the contact of the knee takes 40 s; `test_suggest_limbs` resolves that of a smaller knee.
    (tmp_path / "tools.yaml").write_text(found.text.replace("contact: resolve\n", "contact: off\n"))
    report = bake(sample(name), tmp_path / "tools.yaml", tmp_path / "out.glb")
    assert [tool["name"] for tool in report.data["tools"]] == [
        tool.name for tool in load_tools(tmp_path / "tools.yaml").tools
    ]
    effects = [*report.data["tools"], *report.data.get("fields", [])]
    assert effects
    assert all(each["targets"] for each in effects)
    assert not any("edges are still too long" in line for line in report.warnings)
    with pytest.raises(AssetError, match="already carries wrinkles"):
        suggest(tmp_path / "out.glb")


@pytest.mark.slow
def test_suggestions_do_not_lie_on_one_another() -> None:
    found = suggest_once(sample("wrist"))
    document = read_document(sample("wrist"))
    settings = parse_tools(found.text)
    node = next(index for index, each in enumerate(document.items("nodes")) if "mesh" in each)
    rig, clips = read_rig(document, node), read_clips(document)
    surface = read_surface(document, rig)
    rest = rest_pose(surface, rig, settings, clips, [])
    patches = attach_tools(list(settings.tools), surface, rest, rig, up=settings.up)
    for first in patches:
        for second in patches:
            crossing = abs(first.path.directions(np.array(0.5)) @ second.path.directions(np.array(0.5))) < 0.8
            if first is not second and first.normal @ second.normal > 0.7 and not crossing:
                place = (second.origin.position + second.target.position) / 2
                u, v = first.coordinates(place)
                height = abs((place - first.origin.position) @ first.normal)
                assert not (0.1 < u < 0.9 and abs(v) < 0.5 and height < 0.25 * first.span)
