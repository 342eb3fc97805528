"""`maps --unwrap`: an asset gets a further set of texture coordinates, and nothing else of it changes."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset
from kit.clients import assert_valid
from kit.command import Wrinkle, files
from kit.compressed import EVERY, compressed_sample
from kit.garments import split_materials, tube
from kit.limb import limb_asset, tool, write_tools
from kit.places import ROOT
from kit.player import Floats
from kit.samples import Editor, edited
from kit.small_maps import on_one_place
from kit.variants import rich
from wrinklecli import maps
from wrinklecli.character.surface import read_triangles
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.texture.texels import charted

SMALL: dict[str, Any] = {"size": 64, "kinds": ["normal"], "supersample": 1}
# Limbs in all forms that differ in what follows a vertex, and how it is stored.
FORMS: dict[str, dict[str, Any]] = {
    "plain": {},
    "morphs": {"morphs": 2, "morph_normals": True, "colors": True, "weights_at": "both"},
    "sparse": {"sparse": "zeros", "morphs": 1, "interleave": True},
    "parts": {"primitives": 3, "tangents": True, "weight_dtype": "u1"},
    "strip": {"mode": "strip", "influences": 8},
    "no indices": {"indices": None},
    "no coordinates": {"uvs": False},
    "no normals": {"normals": False},
}


def limb_of(folder: Path, change: Callable[[Asset], None] | None = None, **options: Any) -> tuple[Path, Path]:
    asset = limb_asset(**{"rings": 11, "sides": 8, **options})
    if change is not None:
        change(asset)
    return asset.write(folder / "limb.glb"), write_tools(folder / "tools.yaml", tool(bumps=2))


def corner_values(document: Document, mesh: int, number: int) -> dict[str, Floats]:
    """Give the values of each triangle's corners in a primitive, by attribute, and by target and attribute."""
    primitive = document.items("meshes")[mesh]["primitives"][number]
    count = len(document.accessor(primitive["attributes"]["POSITION"]))
    triangles = read_triangles(document, primitive, count, "")
    held = dict(primitive["attributes"])
    for target, each in enumerate(primitive.get("targets", [])):
        held |= {f"{target} {name}": index for name, index in each.items()}
    return {name: document.stored(index)[triangles] for name, index in held.items()}


def assert_same_but(before: Document, after: Document, added: set[str]) -> None:
    """All of the JSON but primitives, accessors and bytes is the same, and so are the triangles but for some keys."""
    told = [dict(each.gltf) for each in (before, after)]
    for each in told:
        for key in ("accessors", "bufferViews", "buffers", "extensionsUsed", "extensionsRequired"):
            each.pop(key, None)
        each["meshes"] = [{key: kept for key, kept in mesh.items() if key != "primitives"} for mesh in each["meshes"]]
    assert json.dumps(told[0]) == json.dumps(told[1])
    for index, accessor in enumerate(before.items("accessors")):
        if not any(index in used for used in _used_by_meshes(before)):
            np.testing.assert_array_equal(before.accessor(index), after.accessor(index), str(accessor))
    for mesh, described in enumerate(before.items("meshes")):
        for number, primitive in enumerate(described["primitives"]):
            new = after.items("meshes")[mesh]["primitives"][number]
            kept = {"attributes", "targets", "indices", "mode", "extensions"}
            assert {key: new[key] for key in new.keys() - kept} == {
                key: primitive[key] for key in primitive.keys() - kept
            }
            one, other = (corner_values(each, mesh, number) for each in (before, after))
            assert other.keys() - one.keys() <= added
            for name, values in one.items():
                np.testing.assert_array_equal(values, other[name], name)


def _used_by_meshes(document: Document) -> list[set[int]]:
    return [
        {*primitive["attributes"].values(), primitive.get("indices", -1)}
        | {index for target in primitive.get("targets", []) for index in target.values()}
        for mesh in document.items("meshes")
        for primitive in mesh["primitives"]
    ]


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("form", FORMS)
def test_everything_follows_the_vertices_that_are_repeated(form: str, tmp_path: Path) -> None:
    asset, tools = limb_of(tmp_path, **FORMS[form])
    made = maps(asset, tools, tmp_path / "maps", unwrap=tmp_path / "out.glb", **SMALL)
    before, after = read_document(asset), read_document(tmp_path / "out.glb")
    number = 0 if form == "no coordinates" else 1
    assert [each["texCoord"] for each in made.data["materials"]] == [number]
    assert made.data["asset"] == "out.glb"
    tangents = {"TANGENT"} if form not in ("parts", "no normals") else set[str]()
    assert_same_but(before, after, {f"TEXCOORD_{number}", *tangents})
    for primitive in after.items("meshes")[0]["primitives"]:
        assert {f"TEXCOORD_{number}", *tangents} <= primitive["attributes"].keys()
    assert_valid(tmp_path / "out.glb")


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("name", EVERY[::3])
def test_compressed_meshes_are_written_plainly(name: str, tmp_path: Path) -> None:
    asset = compressed_sample(name)
    maps(
        asset, ROOT / "configs" / "wrist.yaml", tmp_path / "maps", unwrap=tmp_path / "out.glb", **SMALL | {"size": 128}
    )
    assert_same_but(read_document(asset), read_document(tmp_path / "out.glb"), {"TEXCOORD_0", "TEXCOORD_1", "TANGENT"})
    assert_valid(tmp_path / "out.glb")


@pytest.mark.slow
@pytest.mark.long
def test_no_place_of_the_texture_belongs_to_two_and_all_that_is_flat_is_one_point(tmp_path: Path) -> None:
    """On the wrist both sides of which have the same texels: a fault of the layout that `maps` warns of."""
    asset, size = edited("wrist", on_one_place), 128
    made = maps(asset, ROOT / "configs" / "wrist.yaml", tmp_path / "maps", unwrap=tmp_path / "out.glb", size=size)
    assert not any("two places" in line for line in made.warnings)
    found = corner_values(read_document(tmp_path / "out.glb"), 0, 0)
    uvs = found["TEXCOORD_1"].astype(float)
    flat = (uvs == uvs.max(axis=(0, 1))).all(axis=(1, 2))
    assert 0.2 < flat.mean() < 0.9
    _, pairs = charted(uvs, 4 * size, ~flat)
    assert len(pairs) < 0.001 * (4 * size) ** 2
    # Its texel is beyond what charts reach with their gutter.
    assert (uvs[flat] == 1.0 - 0.5 / size).all()
    assert uvs[~flat].max() <= 1.0 - 10.0 / size
    lengths = np.linalg.norm(found["TANGENT"][..., :3], axis=2)
    assert np.abs(lengths - 1.0).max() < 1e-5


@pytest.mark.slow
def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    asset, tools = limb_of(tmp_path)
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        maps(asset, tools, tmp_path / folder, unwrap=tmp_path / folder / "limb.gltf", **SMALL)
    one, two = (files(tmp_path / folder) for folder in ("one", "two"))
    assert one == two
    assert {"limb.gltf", "maps.json", "limb_1_normal.png"} < one.keys()


@pytest.mark.slow
def test_meshes_that_are_one_surface_share_an_atlas(tmp_path: Path) -> None:
    asset = split_materials(tube(primitives=2), [1.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    other = asset.gltf["meshes"][0]["primitives"].pop()
    other["material"] = asset.gltf["meshes"][0]["primitives"][0]["material"]
    asset.append("meshes", {"primitives": [other]})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "cuff", "mesh": 1, "skin": 0}))
    path, tools = asset.write(tmp_path / "in.glb"), tmp_path / "tools.yaml"
    tools.write_text(
        json.dumps({"version": 1, "refinement": {"max_levels": 0}, "fields": [{"name": "a", "node": ["limb", "cuff"]}]})
    )
    made = maps(path, tools, tmp_path / "maps", unwrap=tmp_path / "out.glb", **SMALL | {"size": 256})
    assert len(made.data["materials"]) == 1
    after = read_document(tmp_path / "out.glb")
    assert_same_but(read_document(path), after, {"TEXCOORD_0", "TEXCOORD_1", "TANGENT"})
    uvs = np.concatenate([corner_values(after, mesh, 0)["TEXCOORD_1"] for mesh in (0, 1)]).astype(float)
    assert not len(charted(uvs, 512, np.ones(len(uvs), bool))[1])
    assert_valid(tmp_path / "out.glb")


@pytest.mark.slow
def test_all_of_a_rich_file_stays(tmp_path: Path) -> None:
    asset = rich().write(tmp_path / "in.gltf")
    tools = write_tools(tmp_path / "tools.yaml", tool(bumps=2))
    maps(asset, tools, tmp_path / "maps", unwrap=tmp_path / "out.gltf", **SMALL)
    assert_same_but(read_document(asset), read_document(tmp_path / "out.gltf"), {"TEXCOORD_1", "TANGENT"})


@pytest.mark.slow
@pytest.mark.long
def test_charts_end_where_frames_of_the_assets_own_normal_map_jump(tmp_path: Path) -> None:
    """Its two sides are mirrored. Its tangents are those of its own coordinates, and so are the slopes of the maps."""

    def change(editor: Editor) -> None:
        on_one_place(editor)
        editor.json["materials"][0]["normalTexture"] = {"index": 0}
        editor.json["textures"] = [{}]

    asset = edited("wrist", change)
    maps(
        asset, ROOT / "configs" / "wrist.yaml", tmp_path / "maps", unwrap=tmp_path / "out.glb", **SMALL | {"size": 128}
    )
    after = read_document(tmp_path / "out.glb")
    assert_same_but(read_document(asset), after, {"TEXCOORD_1"})
    found = corner_values(after, 0, 0)
    own, new = (found[f"TEXCOORD_{number}"].astype(float) for number in (0, 1))
    mirrored = np.linalg.det(own[:, 1:] - own[:, :1]) > 0.0
    ends = {}
    for positions, uvs, side in zip(found["POSITION"], new, mirrored, strict=True):
        for corner in range(3):
            pair = sorted((positions[k].tobytes(), uvs[k].tobytes()) for k in (corner, (corner + 1) % 3))
            ends.setdefault(tuple(place for place, _ in pair), []).append((side, [uv for _, uv in pair]))
    jumps = [two for two in ends.values() if len(two) == 2 and two[0][0] != two[1][0]]
    flat = np.full(2, 1.0 - 0.5 / 128)
    charted_jumps = [two for two in jumps if any(each[1] != [flat.tobytes()] * 2 for each in two)]
    assert len(charted_jumps) > 5
    assert not any(two[0][1] == two[1][1] for two in charted_jumps)


def test_without_xatlas_one_line_says_what_to_install(
    wrinkle: Wrinkle, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xatlas", None)
    asset, tools = limb_of(tmp_path)
    before = files(tmp_path)
    ran = wrinkle("maps", asset, tools, "-o", tmp_path / "maps", "--unwrap", tmp_path / "out.glb")
    assert (ran.code, len(ran.lines)) == (1, 1)
    assert ran.lines[0].startswith("--unwrap needs xatlas (")
    assert ran.lines[0].endswith("): pip install 'wrinklecli[unwrap]'")
    assert files(tmp_path) == before


def test_the_file_has_a_name_of_a_model(wrinkle: Wrinkle, tmp_path: Path) -> None:
    ran = wrinkle("maps", *limb_of(tmp_path), "-o", tmp_path / "maps", "--unwrap", tmp_path / "out.png")
    assert ran.code == 2
    assert ran.lines[-1].endswith("out.png' does not end in '.glb', '.gltf', '.vrm'")


def test_bumps_that_are_few_texels_wide_all_the_same_are_refused(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset, tools = limb_of(tmp_path)
    line = ("maps", asset, tools, "-o", tmp_path / "maps", "--size", "16", "--unwrap", tmp_path / "out.glb")
    ran = wrinkle(*line)
    assert (ran.code, len(ran.lines)) == (1, 1)
    assert ran.lines[0].endswith("one sees texels in its place: --size 128 is enough")
    assert not (tmp_path / "out.glb").exists()
