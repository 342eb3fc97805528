"""Garments get a field in place of tools: by their pictures or names, as far as they look like cloth."""

import json
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from kit import characters
from kit.asset import Asset, attribute
from kit.limb import RADIUS, limb_asset
from kit.samples import sample
from kit.suggested import in_assets, run, suggest_once
from wrinklecli import bake
from wrinklecli.review.check import check
from wrinklecli.review.suggest.garments import Garment, SuggestedField, _name_of, suggest_fields
from wrinklecli.review.suggest.suggest import Suggestions, suggest
from wrinklecli.review.suggest.worth import Dropped, Judge, Worthwhile
from wrinklecli.tools.fields import Field
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import RefinementSettings

SIZE: dict[str, Any] = {"rings": 24, "sides": 16, "angle": 60.0}


def dressed(asset: Asset, *, image: Any = None, **material: Any) -> Asset:
    """An asset with one material, which may have a picture, on all primitives."""
    if image is not None:
        view = asset.view(characters.png(image))
        number = asset.append("images", {"bufferView": view, "mimeType": "image/png"})
        texture = {"index": asset.append("textures", {"source": number})}
        material["pbrMetallicRoughness"] = {"baseColorTexture": texture}
    number = asset.append("materials", material)
    for primitive in asset.gltf["meshes"][0]["primitives"]:
        primitive["material"] = number
    return asset


def named(asset: Asset, *joints: str) -> Asset:
    for node, name in zip(asset.gltf["skins"][0]["joints"], joints, strict=False):
        asset.gltf["nodes"][node]["name"] = name
    return asset


@pytest.fixture(scope="module")
def jeans(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Suggestions]:
    path = dressed(limb_asset(**SIZE), name="Jeans").write(tmp_path_factory.mktemp("jeans") / "limb.glb")
    return path, suggest(path)


@pytest.mark.slow
@pytest.mark.long
def test_a_garment_gets_a_field_and_no_tools(jeans: tuple[Path, Suggestions], tmp_path: Path) -> None:
    path, found = jeans
    assert not found.tools
    (each,) = found.fields
    (read,) = parse_tools(found.text).effects
    assert (read.name, read.node, read.substance, read.material, read.joints) == ("clothes", None, None, "cloth", "all")
    assert each.clip == "fold"
    assert 0.0 < each.height < each.wavelength
    (tmp_path / "tools.yaml").write_text(found.text)
    assert not check(path, tmp_path / "tools.yaml").warnings
    report = bake(path, tmp_path / "tools.yaml", tmp_path / "out.glb", draft=True)
    assert report.data["fields"][0]["wavelength"] == pytest.approx(each.wavelength, rel=1e-3)
    assert not report.warnings
    assert max(map(len, found.text.splitlines())) <= 120


@pytest.mark.slow
@pytest.mark.long
def test_a_garment_of_long_triangles_is_refined_as_finely_as_its_field_asks(tmp_path: Path) -> None:
    path = dressed(limb_asset(rings=3, sides=8, angle=60.0), name="Jeans").write(tmp_path / "limb.glb")
    found = suggest(path)
    assert found.fields
    assert parse_tools(found.text).refinement.max_levels > RefinementSettings().max_levels
    (tmp_path / "tools.yaml").write_text(found.text)
    assert not check(path, tmp_path / "tools.yaml").warnings


@pytest.mark.slow
@pytest.mark.long
def test_a_field_for_an_asset_without_clips_passes_check(tmp_path: Path) -> None:
    path = dressed(limb_asset(**{**SIZE, "clip": None}), name="Jeans").write(tmp_path / "limb.glb")
    found = suggest(path)
    assert found.fields
    (tmp_path / "tools.yaml").write_text(found.text)
    assert not check(path, tmp_path / "tools.yaml").warnings


@pytest.mark.slow
@pytest.mark.long
def test_a_skirt_over_both_legs_gets_a_field(tmp_path: Path) -> None:
    asset = characters.CHARACTERS["knight_tabard"]().write(tmp_path / "knight.glb")
    assert [each.mesh for each in suggest(asset).fields] == ["Object.012"]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", ["sample", "real"])
def test_trousers_get_a_field_that_a_squat_folds(name: str) -> None:
    found = suggest_once(sample("trousers") if name == "sample" else in_assets("trousers.glb"))
    assert not found.tools
    (each,) = found.fields
    assert each.field.name == "trousers"
    assert each.field.substance is None


@pytest.mark.slow
@pytest.mark.long
def test_the_command_says_what_a_field_costs(jeans: tuple[Path, Suggestions], tmp_path: Path) -> None:
    path, found = jeans
    result = run(path, "--json", "-o", tmp_path / "tools.yaml")
    (field,) = json.loads(result.stdout)["fields"]
    assert field["targets"] == found.fields[0].targets
    assert field["gpu_bytes"] == found.fields[0].gpu_bytes > 0
    assert "MB" in run(path).stderr.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.long
def test_folds_are_wider_where_a_budget_asks_for_it(jeans: tuple[Path, Suggestions], tmp_path: Path) -> None:
    path, found = jeans
    budget = 0.7 * found.fields[0].gpu_bytes
    frugal = suggest(path, budget=budget)
    (each,) = frugal.fields
    assert each.gpu_bytes <= 0.9 * budget  # the rest is left to tools
    assert 1.0 / 0.7**0.5 < each.wavelength / found.fields[0].wavelength <= 1.5 + 1e-6
    (tmp_path / "tools.yaml").write_text(frugal.text)
    assert not check(path, tmp_path / "tools.yaml").warnings


@pytest.mark.slow
@pytest.mark.long
def test_a_garment_without_a_field_gets_tools(tmp_path: Path) -> None:
    # On a coarse mesh, a field takes less than a tool.
    path = dressed(limb_asset(**{**SIZE, "rings": 64, "sides": 32}), name="Jeans").write(tmp_path / "limb.glb")
    found = suggest(path)
    # Even folds as wide as they may be take more.
    poor = suggest(path, budget=0.5 * found.fields[0].gpu_bytes)
    assert not poor.fields
    assert [each.reason for each in poor.dropped][:1] == ["costly"]
    assert poor.tools
    assert {each.substance.kind for each in poor.tools if each.substance} == {"cloth"}
    assert sum(each.gpu_bytes for each in poor.tools) < found.fields[0].gpu_bytes


@pytest.mark.slow
@pytest.mark.long
def test_where_a_mesh_is_cloth_in_part_its_field_is_kept_to_that(tmp_path: Path) -> None:
    picture = np.concatenate([characters.skin(64), characters.denim(64)], axis=1)
    asset = dressed(limb_asset(**SIZE), image=picture)
    places, positions = attribute(asset, 0, "TEXCOORD_0"), attribute(asset, 0, "POSITION")
    places[:, 0] = np.where(positions[:, 1] > 0, 0.7, 0.2) + 0.1 * (places[:, 0] % 1.0)
    found = suggest(asset.write(tmp_path / "limb.glb"))
    (each,) = found.fields
    assert each.field.substance == ("cloth",)
    assert "substance: [cloth]" in found.text


@pytest.mark.slow
def test_a_field_on_a_whole_mesh_leaves_no_tools_where_a_seam_looks_like_skin(tmp_path: Path) -> None:
    picture = np.concatenate([characters.denim(64), characters.skin(64)], axis=1)
    asset = dressed(limb_asset(**SIZE), image=picture)
    places, positions = attribute(asset, 0, "TEXCOORD_0"), attribute(asset, 0, "POSITION")
    beside = np.argsort(np.linalg.norm(positions - [0.0, RADIUS, 0.0], axis=1))[: len(positions) // 40]
    places[:, 0] = 0.2 + 0.1 * (places[:, 0] % 1.0)
    places[beside, 0] = 0.7
    found = suggest(asset.write(tmp_path / "limb.glb"), everything=True)
    assert [each.field.substance for each in found.fields] == [None]
    assert not found.tools


@pytest.mark.quick(0, 2)
@pytest.mark.parametrize(
    ("asset", "why"),
    [
        (dressed(limb_asset(**SIZE), pbrMetallicRoughness={"baseColorFactor": [0.1, 0.2, 0.6, 1]}), "a plain colour"),
        (named(dressed(limb_asset(**SIZE), name="Jeans"), "LeftFoot", "LeftToes"), "a shoe"),
        (
            dressed(limb_asset(**SIZE), name="Backpack", image=characters.denim(64)),
            "a bag, though it is as blue as jeans",
        ),
        (dressed(limb_asset(**SIZE, normals=False), name="Jeans"), "faceted"),
        (dressed(limb_asset(**SIZE), name="Steel"), "metal"),
        (named(dressed(limb_asset(**SIZE), name="Jeans"), "Head", "Lock"), "hair, which moves with the head"),
    ],
    ids=lambda each: each if isinstance(each, str) else "",
)
def test_what_is_no_garment_gets_no_field(tmp_path: Path, asset: Asset, why: str) -> None:
    assert not suggest(asset.write(tmp_path / "limb.glb"), everything=True).fields, why


@pytest.mark.parametrize(("part", "wanted"), [(4, ["trousers", "tie"]), (40, ["trousers"])])
def test_what_is_a_tenth_of_the_largest_mesh_is_a_garment_and_less_is_trim(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: int, wanted: list[str]
) -> None:
    """A second mesh has the middle triangles of the first."""
    asset = dressed(limb_asset(**SIZE), name="Jeans")
    gltf = asset.gltf
    primitive = gltf["meshes"][0]["primitives"][0]
    whole = gltf["accessors"][primitive["indices"]]
    size, count = {5123: 2, 5125: 4}[whole["componentType"]], whole["count"] // 3 // part * 3
    start = whole.get("byteOffset", 0) + size * ((whole["count"] - count) // 6 * 3)
    indices = asset.append("accessors", {**whole, "byteOffset": start, "count": count})
    mesh = asset.append("meshes", {"primitives": [{**primitive, "indices": indices}]})
    next(node for node in gltf["nodes"] if "mesh" in node)["name"] = "Trousers"
    gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "Tie", "mesh": mesh, "skin": 0}))
    found: list[str] = []

    def seen(_judge: Judge, garments: Sequence[Garment], _budget: float) -> None:
        found.extend(each.suggestion.field.name for each in garments)
        raise StopIteration

    monkeypatch.setattr("wrinklecli.review.suggest.suggest.suggest_fields", seen)
    with pytest.raises(StopIteration):
        suggest(asset.write(tmp_path / "limb.glb"))
    assert found == wanted


@pytest.mark.slow
def test_a_garment_of_facets_gets_neither_a_field_nor_tools(tmp_path: Path) -> None:
    found = suggest(dressed(limb_asset(**SIZE, normals=False), name="Jeans").write(tmp_path / "limb.glb"))
    assert not found.text
    assert [(each.name, each.reason) for each in found.dropped] == [("clothes", "refused"), ("joint_1", "faceted")]
    assert "is faceted" in found.dropped[0].line


def test_left_and_right_garments_are_left_out_together() -> None:
    def field(name: str, mesh: str) -> SuggestedField:
        return SuggestedField(field=Field(name=name), mesh=mesh, why="all of it looks like cloth")

    left, coat = field("sleeve", "Arm.L"), field("coat", "Body")
    hidden = Dropped("sleeve_2", "Arm.R", "hidden", 0.2)
    found = Worthwhile([left, coat], RefinementSettings(), [hidden])
    asset = SimpleNamespace(jobs=1, shared=[])
    judge: Any = SimpleNamespace(worthwhile=lambda *_, **__: found, everything=False, drafted=list, asset=asset)
    given = suggest_fields(judge, [], 1.0)
    assert given.kept == [coat]
    assert [(each.name, each.mesh, each.reason) for each in given.dropped] == [
        ("sleeve_2", "Arm.R", "hidden"),
        ("sleeve", "Arm.L", "hidden"),
    ]


@pytest.mark.slow
@pytest.mark.long
def test_two_processes_try_two_garments_as_one_does(tmp_path: Path) -> None:
    asset = dressed(limb_asset(**SIZE), name="Jeans")
    mesh = asset.append("meshes", dict(asset.gltf["meshes"][0]))
    node = next(each for each in asset.gltf["nodes"] if "mesh" in each)
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {**node, "name": "other", "mesh": mesh}))
    path = asset.write(tmp_path / "limb.glb")
    one, two = (suggest(path, jobs=jobs) for jobs in (1, 2))
    assert one.text == two.text
    assert len(one.fields) == 2


@pytest.mark.parametrize(
    ("names", "word"),
    [
        (["Body_Trousers_01"], "trousers"),
        (["rig_shirt_sleeve"], "sleeve"),
        (["skirt", "node_3"], "skirt"),
        (["Red_Coat", "skirt"], "coat"),
        (["mesh", "node_3"], "clothes"),
        ([], "clothes"),
    ],
)
def test_a_field_is_named_for_the_last_garment_in_the_name_of_its_node(names: list[str], word: str) -> None:
    assert _name_of(names) == word
