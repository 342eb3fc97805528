"""`wrinkle maps`: images that show what a bake would raise, and what is said where they cannot."""

import io
import json
import os
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from kit.asset import Asset
from kit.bakes import bake_config, place
from kit.command import Wrinkle, files
from kit.fields import bake_field, sleeve_and_field
from kit.limb import RADIUS, limb_asset, tool, write_tools
from kit.places import ROOT
from kit.samples import Editor, edited, sample
from kit.small_maps import on_one_place, small_maps
from kit.variants import PNG
from wrinklecli import maps
from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.character.contacts import Neighbours
from wrinklecli.effects.effect import SamplingOptions, targets_of
from wrinklecli.effects.plan import plan_mesh
from wrinklecli.effects.sampling import sample_effects
from wrinklecli.effects.shapes import turn_to
from wrinklecli.errors import BakeError
from wrinklecli.gltf.document import read_document
from wrinklecli.numeric.arrays import unit
from wrinklecli.numeric.guard import log_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.texture.layout import TexCoords, layouts_of
from wrinklecli.texture.relief import Relief, plan_finely
from wrinklecli.texture.texels import covered

CONFIGS = ROOT / "configs"


def pixels(path: Path) -> Any:
    return np.asarray(Image.open(io.BytesIO(path.read_bytes())))


def made(folder: Path, name: str = "wrist", **options: Any) -> Any:
    return maps(sample(name), CONFIGS / f"{name}.yaml", folder, **{"size": 160, **options})


def small(folder: Path, change: Callable[[Asset], None] | None = None, **options: Any) -> tuple[Path, Path]:
    """A limb with a material, which a fifth of the texels' work of a sample serves, and a tool for it."""
    asset = limb_asset(rings=11, sides=8, **options)
    asset.gltf["materials"] = [{}]
    asset.gltf["meshes"][0]["primitives"][0]["material"] = 0
    if change is not None:
        change(asset)
    return asset.write(folder / "limb.glb"), write_tools(folder / "tools.yaml", tool(bumps=2))


@pytest.mark.slow
@pytest.mark.long
def test_each_file_is_there_and_its_values_are_sound(tmp_path: Path) -> None:
    size = 160
    found = made(tmp_path / "maps", size=size, supersample=1)
    assert sorted(map(str, (tmp_path / "maps").iterdir())) == sorted(found.paths)
    data = json.loads((tmp_path / "maps" / "maps.json").read_text())
    assert data == found.data
    (material,) = data["materials"]
    (one,) = material["sets"]
    assert [each["target"] for each in one["weights"]] == [
        f"wrinkle_{each}" for each in ("palm_side_1", "back_side_1", "back_side_2", "back_side_3")
    ]
    normals = pixels(tmp_path / "maps" / one["normal"]) / 127.5 - 1.0
    assert np.abs(np.linalg.norm(normals, axis=2) - 1.0).max() < 0.02
    assert normals[..., 2].min() > 0.0
    flat = (np.abs(normals[..., :2]) < 0.01).all(axis=2)
    assert 0.5 < flat.mean() < 0.95
    seen = pixels(tmp_path / "maps" / one["ao"])
    assert seen.max() == 255
    assert 60 < seen.min() < 220
    masks = pixels(tmp_path / "maps" / one["weights"][0]["mask"])
    assert masks.shape == (size, size, 4)
    assert masks.astype(int).sum(axis=2).max() <= 256
    heights = pixels(tmp_path / "maps" / one["height"]["file"]) / 65535 - one["height"]["zero"]
    assert (masks.max(axis=2)[np.abs(heights) > 0.1] > 0).all()


def test_shapes_of_a_set_share_out_its_masks(tmp_path: Path) -> None:
    """A set with more shapes than an image has channels."""
    asset, _ = small(tmp_path)
    keys = {"bumps": 4, "strategy": "origin", "width": 0.15}
    beside = {"name": "beside", "origin": [-0.4, 0.0, RADIUS], "target": [0.4, 0.0, RADIUS]}
    tools = write_tools(tmp_path / "tools.yaml", tool(**keys), tool(**keys, **beside))
    found = maps(asset, tools, tmp_path / "maps", size=128, kinds=["height"], supersample=1)
    sets = found.data["materials"][0]["sets"]
    assert max(len(each["weights"]) for each in sets) > 4
    for each in sets:
        images = {weight["mask"]: pixels(tmp_path / "maps" / weight["mask"]) for weight in each["weights"]}
        masks = [images[weight["mask"]][..., "rgba".index(weight["channel"])] for weight in each["weights"]]
        heights = pixels(tmp_path / "maps" / each["height"]["file"]) / 65535 - each["height"]["zero"]
        assert all(mask.any() for mask in masks)
        shares = np.sum(masks, axis=0, dtype=int)
        assert shares.max() <= 255 + len(masks)
        assert (shares[np.abs(heights) > 0.1] > 0).all()


@pytest.mark.slow
def test_names_and_files_may_hold_what_is_no_character(tmp_path: Path) -> None:
    """Half a surrogate pair, which some exporters cut from a name, and a file's name that is not UTF-8."""
    asset = limb_asset(rings=8, sides=8)
    asset.gltf["nodes"][0]["name"] = "li\ud800mb"
    path = asset.write(tmp_path / os.fsdecode(b"a\xff.glb"))
    maps(path, write_tools(tmp_path / "tools.yaml", tool()), tmp_path / "made", size=64, kinds=["height"])
    data = json.loads((tmp_path / "made" / "maps.json").read_bytes())
    assert (data["asset"], data["materials"][0]["node"]) == (path.name, "li\ud800mb")


@pytest.mark.slow
@pytest.mark.long
def test_heights_and_drives_are_those_of_a_bake(tmp_path: Path) -> None:
    found = made(tmp_path / "maps", size=256, kinds=["height"])
    (node,) = [each for each in bake_config("wrist", "wrist").json["nodes"] if "wrinkle" in each.get("extras", {})]
    said = node["extras"]["wrinkle"]
    assert found.data["nodes"][0]["wrinkle"] == {key: said[key] for key in ("layout", "method", "tools")}
    (one,) = found.data["materials"][0]["sets"]
    heights = one["height"]["scale"] * (
        pixels(tmp_path / "maps" / one["height"]["file"]) / 65535 - one["height"]["zero"]
    )
    (plan,) = plan_meshes(read_job(sample("wrist"), CONFIGS / "wrist.yaml", BakeOptions()))
    how = SamplingOptions(30.0, "morph", Memory(), log_progress)
    tallest = max(each.shape.tallest for each in targets_of(sample_effects(plan, [], how)[0]))
    assert 0.98 * tallest < heights.max() < 1.02 * tallest


@pytest.mark.slow
def test_maps_of_a_field_have_its_turns_and_its_folds(tmp_path: Path) -> None:
    asset, tools = sleeve_and_field(tmp_path)
    made = maps(asset, tools, tmp_path / "maps", size=128, kinds=["height", "normal"], supersample=1)
    baked = bake_field()
    (drive,) = baked.json["nodes"][baked.node("limb")]["extras"]["wrinkle"]["fields"]
    ((node,), (material,)) = made.data["nodes"], made.data["materials"]
    assert node["wrinkle"]["fields"] == [drive]
    assert node["wrinkle"]["tools"] == []
    weights = [weight["target"] for each in material["sets"] for weight in each["weights"]]
    assert sorted(weights) == sorted(drive["targets"])
    for each in material["sets"]:
        heights = pixels(tmp_path / "maps" / each["height"]["file"])
        assert np.ptp(heights) > 0.2 * 65535


@pytest.mark.slow
def test_a_bake_writes_maps_too_or_nothing(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset, tools = small(tmp_path)
    with small_maps(32):
        ran = wrinkle("bake", asset, tools, "-o", "out.glb", "--maps-dir", "maps", "--max-levels", "0", "--draft")
    assert ran.code == 0
    assert re.fullmatch(r"maps: \d images of 1 material, 1 weight in 1 set", ran.lines[-1])
    assert wrinkle("maps", asset, tools, "-o", "alone", "--size", "32", "-q").code == 0
    assert files(tmp_path / "maps") == files(tmp_path / "alone")
    Path("taken").write_text("mine")
    ran = wrinkle("bake", asset, tools, "-o", "new.glb", "--maps-dir", "taken", "--max-levels", "0", "--draft")
    assert (ran.code, len(ran.lines)) == (1, 1)
    assert not Path("new.glb").exists()
    assert wrinkle("bake", "out.glb", tools, "-o", "new.glb", "--maps-dir", "more", "--replace").code == 2


@pytest.mark.parametrize("command", ["bake", "maps"])
def test_a_folder_that_has_an_input_is_refused_before_any_work(
    command: str, wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def begun(*_: Any, **__: Any) -> Any:
        raise AssertionError("work has begun")

    for module in ("baking.pipeline", "texture.maps"):
        monkeypatch.setattr(f"wrinklecli.{module}.plan_meshes", begun)
    asset = limb_asset(rings=7, sides=6)
    asset.gltf["images"] = [{"uri": "made/skin_1_normal.png"}]
    asset.write(tmp_path / "limb.gltf")
    write_tools(tmp_path / "tools.yaml", tool(bumps=1))
    for folder in ("made", "linked", "named", "listed"):
        (tmp_path / folder).mkdir()
    (tmp_path / "made" / "skin_1_normal.png").write_bytes(PNG)
    (tmp_path / "linked" / "cloth_2_mask_1.png").symlink_to("../made/skin_1_normal.png")
    (tmp_path / "named" / "skin_1_ao.png").hardlink_to(tmp_path / "limb.bin")
    (tmp_path / "listed" / "maps.json").symlink_to("../tools.yaml")
    before = files(tmp_path)
    over = "is an input too and would be overwritten"
    for folder, line in {
        "made": f"made/skin_1_normal.png: {over}",
        "linked": f"linked/cloth_2_mask_1.png: {over}",
        "named": f"named/skin_1_ao.png: {over}",
        "listed": f"listed/maps.json: {over}",
        "limb.gltf": "limb.gltf: cannot be written: File exists",
        "tools.yaml/maps": "tools.yaml: cannot be written: File exists",
    }.items():
        last = ("-o", folder) if command == "maps" else ("-o", "out.glb", "--maps-dir", folder)
        ran = wrinkle(command, "limb.gltf", "tools.yaml", *last)
        assert (ran.code, ran.lines) == (1, [line])
        assert files(tmp_path) == before
    # Other images of the asset may stand beside maps.
    (tmp_path / "made" / "skin_1_normal.png").rename(tmp_path / "made" / "skin_01_normal.png")
    asset.gltf["images"] = [{"uri": "made/skin_01_normal.png"}]
    asset.write(tmp_path / "limb.gltf")
    last = ("-o", "made") if command == "maps" else ("-o", "out.glb", "--maps-dir", "made")
    ran = wrinkle(command, "limb.gltf", "tools.yaml", *last)
    assert (ran.code, ran.lines[-2]) == (70, "AssertionError: work has begun")


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    for folder in ("one", "two"):
        maps(*small(tmp_path), tmp_path / folder, size=64)
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


@pytest.mark.slow
def test_separate_maps_have_no_masks(tmp_path: Path) -> None:
    asset, _ = small(tmp_path)
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=3, strategy="origin"))  # two of its bumps share a set else
    found = maps(asset, tools, tmp_path / "maps", size=64, kinds=["normal"], separate=True)
    sets = found.data["materials"][0]["sets"]
    assert [len(each["weights"]) for each in sets] == [1, 1, 1]
    assert not any("mask" in each["weights"][0] for each in sets)
    assert len(found.paths) == 4


@pytest.mark.slow
def test_a_material_that_is_not_there_counts_as_none(wrinkle: Wrinkle, tmp_path: Path) -> None:
    def lost(asset: Asset) -> None:
        asset.gltf["meshes"][0]["primitives"][0]["material"] = 7

    asset, tools = small(tmp_path, lost)
    assert wrinkle("maps", asset, tools, "-o", tmp_path / "maps", "--size", "32", "-q").code == 0
    assert json.loads((tmp_path / "maps" / "maps.json").read_text())["materials"][0]["material"] is None


@pytest.mark.quick(1)
@pytest.mark.parametrize("texture", ["x", ["x"], {"texCoord": {}}, {"rotation": "x"}, {"scale": [1]}, {"offset": None}])
def test_a_malformed_texture_is_one_line(wrinkle: Wrinkle, tmp_path: Path, texture: Any) -> None:
    def broken(asset: Asset) -> None:
        moved = texture if isinstance(texture, dict) else {}
        info = {"index": 0, "extensions": {"KHR_texture_transform": moved}} if moved else texture
        asset.gltf["materials"][0]["normalTexture"] = info

    ran = wrinkle("maps", *small(tmp_path, broken), "-o", tmp_path / "maps", "--size", "16")
    assert (ran.code, len(ran.lines)) == (1, 1), ran.lines
    assert not (tmp_path / "maps").exists()


@pytest.mark.slow
def test_joints_without_a_name_are_a_warning(wrinkle: Wrinkle, tmp_path: Path) -> None:
    def unnamed(asset: Asset) -> None:
        for node in asset.gltf["nodes"][1:]:
            del node["name"]

    ran = wrinkle("maps", *small(tmp_path, unnamed), "-o", tmp_path / "maps", "--size", "32")
    assert ran.code == 0
    (line,) = (each for each in ran.lines if "no name" in each)
    assert line.startswith("warning: ")
    assert "2 joints of tools have no name, and players look joints up by name" in line


def test_a_mesh_without_texture_coordinates_gets_one_line(wrinkle: Wrinkle, tmp_path: Path) -> None:
    bare, tools = small(tmp_path, uvs=False)
    ran = wrinkle("maps", bare, tools, "-o", tmp_path / "maps", "--size", "32")
    assert ran.code == 1
    line = "its wrinkles lie on no texture coordinates: `wrinkle maps --unwrap FILE` gives it texels of its own"
    assert ran.lines == [f"{bare}: crease: {line}"]
    assert not (tmp_path / "maps").exists()


@pytest.mark.slow
def test_tools_that_move_the_body_are_left_out_and_named(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset, _ = small(tmp_path)
    flesh = {"name": "belly", "at": [0.3, 0.1, 0.0], "radius": 0.4}
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=1), flesh=[flesh])
    ran = wrinkle("maps", asset, tools, "-o", tmp_path / "maps", "--size", "32")
    assert "note: belly: left out, as it moves the body; maps hold wrinkles alone" in ran.lines


def test_maps_that_take_too_much_memory_are_refused(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset, tools, options = (
        sample("wrist"),
        CONFIGS / "wrist.yaml",
        ("--size", "8192", "--supersample", "1", "--max-memory", "1GB"),
    )
    ran = wrinkle("maps", asset, tools, "-o", tmp_path / "maps", *options)
    assert (ran.code, len(ran.lines)) == (1, 1)
    assert "maps of 8192 by 8192 texels would take 9.73 GB" in ran.lines[0]
    assert not (tmp_path / "maps").exists()


def laid_elsewhere(transform: dict[str, Any], tile: float) -> Any:
    """A change of the wrist: its coordinates lie elsewhere, and the transform takes them to where they were."""

    def change(editor: Editor) -> None:
        (primitive,) = editor.json["meshes"][0]["primitives"]
        stored = read_document(sample("wrist")).accessor(primitive["attributes"]["TEXCOORD_0"])
        offset, scale, turn = (
            transform.get(key, plain) for key, plain in (("offset", 0), ("scale", 1), ("rotation", 0))
        )
        c, s = np.cos(turn), np.sin(turn)
        laid = (stored - offset) @ np.array([[c, s], [-s, c]]) / scale + tile
        primitive["attributes"]["TEXCOORD_0"] = editor.accessor(laid.astype(np.float32))
        if transform:
            info = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
            editor.json["materials"][0]["normalTexture"] = info

    return change


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Maps of the wrist's normals."""
    folder = tmp_path_factory.mktemp("maps")
    found = made(folder / "here", kinds=["normal"])
    assert not any("two places" in each for each in found.warnings)
    return folder / "here"


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("transform", "tile"),
    [({}, 3.0), ({"offset": [0.1, 0.3], "rotation": 0.4, "scale": [2.0, 0.5]}, 0.0)],
    ids=["a tile", "a transform"],
)
def test_tiles_and_transforms_of_a_texture_lead_to_the_same_texels(
    transform: dict[str, Any], tile: float, here: Path, tmp_path: Path
) -> None:
    """A tile of UDIM has a material of its own in glTF, with coordinates beyond 1."""
    asset = edited("wrist", laid_elsewhere(transform, tile))
    found = maps(asset, CONFIGS / "wrist.yaml", tmp_path / "there", size=160, kinds=["normal"])
    assert found.data["materials"][0].get("KHR_texture_transform", {}) == transform
    assert {path.name for path in here.glob("*.png")} == {path.name for path in (tmp_path / "there").glob("*.png")}
    for path in sorted(here.glob("*.png")):
        apart = np.abs(pixels(path).astype(int) - pixels(tmp_path / "there" / path.name))
        # Rounded coordinates put the middle of a texel on the other side of a border here and there.
        assert (apart > 1).mean() < 0.001
        assert pixels(path).std() > 1


@pytest.mark.slow
@pytest.mark.long
def test_mirrored_charts_are_found_and_refused_if_strict(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset, options = edited("wrist", on_one_place), ("--size", "256", "--maps", "normal", "--tool", "palm_side")
    line = ("maps", asset, CONFIGS / "wrist.yaml", "-o", tmp_path / "maps", *options)
    ran = wrinkle(*line, "--strict")
    assert (ran.code, len(ran.lines)) == (3, 2)
    assert not (tmp_path / "maps").exists()
    ran = wrinkle(*line)
    assert ran.code == 0
    assert sum("belong to two places, laid mirrored on each other" in each for each in ran.lines) == 1


@pytest.mark.slow
@pytest.mark.long
def test_bumps_of_few_texels_are_a_warning_or_refused_with_the_size_that_is_enough(tmp_path: Path) -> None:
    with pytest.raises(BakeError) as refused:
        made(tmp_path / "few", size=64, kinds=["normal"])
    lines = str(refused.value).splitlines()
    assert [line.split(": ")[1] for line in lines] == ["palm_side", "back_side"]
    assert all("a bump is 2.9 texels wide" in line for line in lines)
    assert all("--size 256 is enough, or `wrinkle maps --unwrap FILE` gives" in line for line in lines)
    assert not (tmp_path / "few").exists()
    few = made(tmp_path / "some", size=160, kinds=["normal"]).warnings
    assert [line.split(": ")[0] for line in few] == ["palm_side", "back_side"]
    assert all(re.search("a bump is 7.[23] texels wide", line) and "--size 256 is enough" in line for line in few)
    assert made(tmp_path / "enough", size=256, kinds=["normal"]).warnings == ()


def drawn_normals(
    asset: Path, tools: Path, tool: str, edges: int, side: int, texcoords: TexCoords
) -> tuple[Any, Any, Any]:
    """Texels that one triangle of a refined mesh covers, and there heights at full height and normals of an engine."""
    job = read_job(asset, tools, BakeOptions(mode="weights", only=[tool], max_memory=4 * 10**9))
    ((node, own),) = job.by_node.items()
    refinement = replace(job.settings.refinement, edges_per_interval=edges, max_levels=8)
    settings = replace(job.settings, refinement=refinement)
    limits = {"max_vertices": 10**6, "stored": False}
    plan = plan_mesh(job.document, node, own, settings, job.every_clip, job.options.max_error, **limits)
    how = SamplingOptions(30.0, "morph", job.document.memory, log_progress)
    (effect,), _ = sample_effects(plan, [], how)
    (layout,) = layouts_of(job.document, plan, texcoords)
    moved, turned = np.zeros(len(plan.fine.positions)), np.zeros((len(plan.fine.positions), 3))
    for target in effect.targets:
        moved[target.shape.vertices] += np.linalg.norm(target.shape.deltas, axis=1)
        turned[target.shape.normal_vertices] += target.shape.normal_deltas
    triangles = plan.fine.triangles[layout.faces]
    on = np.flatnonzero(moved[triangles].any(axis=1))
    texels, faces, shares = map(np.concatenate, zip(*covered(layout.uvs[on], side), strict=True))
    texels, first, counts = np.unique(texels, return_index=True, return_counts=True)
    texels, faces, shares = texels[counts == 1], on[faces[first[counts == 1]]], shares[first[counts == 1]]
    authored = unit(layout.normals[faces].reshape(-1, 3))
    corners = triangles[faces].reshape(-1)
    turns = turn_to(plan.fine.normals_at(corners), authored, turned[corners])
    shown = unit(authored + turns).reshape(-1, 3, 3)
    heights = np.einsum("tk,tk->t", shares, moved[triangles[faces]])
    return texels, heights, unit(np.einsum("tk,tkx->tx", shares, shown))


def mapped_normals(asset: Path, tools: Path, tool: str, folder: Path, size: int, texcoords: TexCoords) -> Any:
    """(size², 3) bind normals, at full height, of the maps of a tool, on the asset's own normals and tangents."""
    data = json.loads((folder / "maps.json").read_text())
    slopes = np.zeros((size**2, 2))
    for part in data["materials"][0]["sets"]:
        x, y, z = (pixels(folder / part["normal"]).reshape(-1, 3) / 127.5 - 1.0).T
        slopes += np.column_stack([x, y]) / z[:, None]
    (plan,) = plan_meshes(read_job(asset, tools, BakeOptions(mode="weights", only=[tool])))
    (layout,) = layouts_of(read_document(asset), plan, texcoords)
    normals = np.zeros((size**2, 3))
    for texels, faces, shares in covered(layout.uvs, size):
        base, along = (unit(np.einsum("tk,tkx->tx", shares, each[faces])) for each in (layout.normals, layout.tangents))
        across = unit(layout.hands[faces][:, None] * np.cross(base, along))
        normals[texels] = unit(base + slopes[texels, :1] * along + slopes[texels, 1:] * across)
    return normals


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "tool", "edges", "size", "unwrap"),
    [
        # Their folds are few texels wide in smaller images.
        ("head", "brow", 8, 512, False),
        ("wrist", "back_side", 8, 512, False),
        ("wrist", "back_side", 8, 256, True),
        # Its triangles are as long as a fold, and turn away from the segment where it fades.
        ("trousers", "knee_out.L", 12, 256, False),
    ],
)
def test_normals_are_those_of_a_finely_refined_mesh(
    name: str, tool: str, edges: int, size: int, unwrap: bool, tmp_path: Path
) -> None:
    """At 95 % of the texels with wrinkles within 2°, at full height, from the images to a mesh finer than theirs."""
    asset, tools, folder = sample(name), CONFIGS / f"{name}.yaml", tmp_path / "maps"
    shown, texcoords = (tmp_path / "out.glb", {(0, 0): 1}) if unwrap else (asset, {})
    maps(
        asset,
        tools,
        folder,
        only=[tool],
        size=size,
        kinds=["normal"],
        max_memory=4 * 10**9,
        unwrap=shown if unwrap else None,
    )
    texels, heights, drawn = drawn_normals(shown, tools, tool, edges, size, texcoords)
    mapped = mapped_normals(shown, tools, tool, folder, size, texcoords)[texels]
    angles = np.degrees(np.arccos(np.clip(np.sum(mapped * drawn, axis=1), -1.0, 1.0)))
    high = heights > 0.02 * heights.max()
    assert high.sum() > 2500 * (size / 512) ** 2
    assert np.percentile(angles[high], 95) < 2.0


@pytest.mark.slow
def test_a_bump_that_the_mesh_cannot_show_takes_no_other_bumps_place(tmp_path: Path) -> None:
    """A finer mesh has shapes of bumps between whose vertices the bake's own mesh has none."""
    file = write_tools(tmp_path / "t.yaml", tool(bumps=5, strategy="origin"), refinement={"max_levels": 0})
    job = read_job(place(limb_asset(rings=9, sides=8)), file, BakeOptions())
    how = SamplingOptions(30.0, "morph", Memory(), log_progress)
    (plan,) = plan_meshes(job)
    (effect,), _ = sample_effects(plan, [], how)
    fine, own = plan_finely(job, 0, job.settings.tools[0], Neighbours(job.document), how, most_edges=12.0)
    relief = Relief.of(own, fine.fine)
    assert len(effect.targets) < len(relief.numbers) == 5
    for target in effect.targets:
        row = relief.numbers.index(target.number)
        # Old vertices keep their numbers, and this bump is the highest at its own.
        at = np.searchsorted(relief.vertices, target.shape.vertices)
        assert (relief.vertices[at] == target.shape.vertices).all()
        assert (np.abs(relief.heights[:, at]).argmax(axis=0) == row).all()
