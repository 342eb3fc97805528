"""Assets that meshopt or Draco compressed: read, baked, and left compressed where no tool reaches.

data/README.md says how the files were made, all from samples/wrist.glb.
"""

import hashlib
import json
import random
import struct
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import wrinklecli
from kit.bakes import bake_once
from kit.clients import assert_valid, pose, validate
from kit.compressed import DECODED, EVERY, MESHOPT, compressed_sample
from kit.limb import write_tools
from kit.places import ROOT
from kit.player import Floats, Gltf, Json
from kit.samples import BACK, PALM, Editor, shared_mesh
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.draco import _promised

DRACO = "KHR_draco_mesh_compression"

# Metres. A bake follows its input, which is off by up to half a step of the weights, 1/255, of the way of the hand,
# of 0.25 m about 70 degrees, and of positions (14 bits of 0.4 m); measured: 0.11 mm.
TOLERANCE = 2e-4
TOOLS = (PALM, BACK)
TIMES = (0.0, 0.5, 1.0)


def mesh_node(document: Document) -> int:
    return next(index for index, node in enumerate(document.items("nodes")) if "mesh" in node)


def compressed_views(gltf: Json) -> list[int]:
    return [index for index, view in enumerate(gltf["bufferViews"]) if "extensions" in view]


def elements(document: Document, index: int) -> NDArray[Any]:
    return document.accessor(index)


@pytest.mark.parametrize("name", MESHOPT)
def test_views_decode_to_the_same_bytes(name: str) -> None:
    document = read_document(compressed_sample(name))
    views = compressed_views(document.gltf)
    found = [hashlib.sha256(document.view(index)).hexdigest() for index in views]
    assert found == DECODED[name]


@pytest.mark.parametrize("name", EVERY)
def test_the_surface_is_that_of_the_original(name: str) -> None:
    plain, packed = (read_document(path) for path in (ROOT / "samples" / "wrist.glb", compressed_sample(name)))
    rigs = [read_rig(document, mesh_node(document)) for document in (plain, packed)]
    surfaces = [read_surface(document, rig) for document, rig in zip((plain, packed), rigs, strict=True)]
    assert len(surfaces[0].positions) == len(surfaces[1].positions)
    assert len(surfaces[0].triangles) == len(surfaces[1].triangles)
    # Bind positions to the space of the first joint: quantisation changes bind space.
    places = [
        surface.positions @ rig.inverse_binds[0, :3, :3].T + rig.inverse_binds[0, :3, 3]
        for surface, rig in zip(surfaces, rigs, strict=True)
    ]
    distances, twins = cKDTree(places[0]).query(places[1])
    assert distances.max() < 0.4 / 2**14 * np.sqrt(3)
    assert len(np.unique(twins)) == len(twins)


@pytest.mark.slow
@pytest.mark.parametrize("name", EVERY)
def test_bakes_are_valid_and_pose_as_the_original_does(name: str) -> None:
    out = bake_once(compressed_sample(name), *TOOLS).path
    assert_valid(out)
    expected = bake_once("wrist", *TOOLS)
    node = mesh_node(read_document(out))
    for clip in ("flex", "extend"):
        found = pose(out, node=node, clip=clip, times=TIMES)
        wanted = pose(expected.path, node="wrist", clip=clip, times=TIMES)
        for one, other in zip(found, wanted, strict=True):
            assert cKDTree(one).query(other)[0].max() < TOLERANCE
            assert cKDTree(other).query(one)[0].max() < TOLERANCE


@pytest.mark.quick(1)
@pytest.mark.parametrize("name", EVERY)
def test_the_touched_mesh_is_plain_and_the_rest_as_it_was(name: str) -> None:
    out = bake_once(compressed_sample(name), *TOOLS).path
    before, after = read_document(compressed_sample(name)), read_document(out)
    (primitive,) = after.items("meshes")[after.items("nodes")[mesh_node(after)]["mesh"]]["primitives"]
    for index in (*primitive["attributes"].values(), primitive["indices"]):
        view = after.items("bufferViews")[after.items("accessors")[index]["bufferView"]]
        assert "extensions" not in view
    assert DRACO not in after.gltf.get("extensionsUsed", [])
    assert DRACO not in after.gltf.get("extensionsRequired", [])
    assert bool(compressed_views(after.gltf)) == (name in MESHOPT)
    for index, old in enumerate(before.items("animations")):
        for channel in old["channels"]:
            sampler = old["samplers"][channel["sampler"]]
            new = after.items("animations")[index]["samplers"][channel["sampler"]]
            for key in ("input", "output"):
                assert (elements(before, sampler[key]) == elements(after, new[key])).all()
    matrices = [document.items("skins")[0]["inverseBindMatrices"] for document in (before, after)]
    assert (elements(before, matrices[0]) == elements(after, matrices[1])).all()


@pytest.mark.quick(0, 3)
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("levels", [0, 4])
def test_no_warnings_that_plain_files_lack(name: str, levels: int) -> None:
    """Draco rounds weights to 0 and leaves the joints, which the validator warns of."""
    before, after = validate(
        [compressed_sample(name), bake_once(compressed_sample(name), *TOOLS, max_levels=levels).path]
    )
    known = {message["code"] for message in before.messages}
    fresh = [each for each in after.messages if each["severity"] <= 1 and each["code"] not in known]
    assert not fresh, after.lines()


@pytest.mark.slow
@pytest.mark.parametrize("levels", [0, 4])
def test_a_strip_in_draco_is_read_as_its_triangles(levels: int, tmp_path: Path) -> None:
    """Its decoder gives triangles; the mode is what they were before."""
    editor = Editor(Gltf(compressed_sample("gltf_transform_draco")))
    (primitive,) = editor.json["meshes"][0]["primitives"]
    assert primitive.get("mode", 4) == 4
    primitive["mode"] = 5
    strip = bake_once(editor.save(tmp_path / "strip.glb"), *TOOLS, max_levels=levels)
    listed = bake_once(compressed_sample("gltf_transform_draco"), *TOOLS, max_levels=levels)
    (primitive,) = strip.json["meshes"][0]["primitives"]
    assert primitive.get("mode", 4) == 4
    assert np.array_equal(strip.triangles(0), listed.triangles(0))
    for name in ("POSITION", "JOINTS_0", "WEIGHTS_0"):
        assert np.array_equal(strip.attribute(0, name), listed.attribute(0, name))
    assert np.array_equal(strip.deltas(0), listed.deltas(0))
    assert_valid(strip.path)


def twin(name: str, path: Path, change: Callable[[Json], None] = lambda _: None) -> Path:
    """A compressed_sample with an unskinned second mesh over the same accessors, 5 m aside."""
    editor = Editor(Gltf(compressed_sample(name)))
    gltf = editor.json
    gltf["meshes"].append(json.loads(json.dumps(gltf["meshes"][0])))
    attributes = gltf["meshes"][1]["primitives"][0]["attributes"]
    for key in ("JOINTS_0", "WEIGHTS_0"):
        del attributes[key]
    gltf["nodes"].append({"name": "twin", "mesh": 1, "translation": [5.0, 0.0, 0.0]})
    gltf["scenes"][0]["nodes"].append(len(gltf["nodes"]) - 1)
    change(gltf)
    return editor.save(path)


@pytest.mark.quick(1)
@pytest.mark.parametrize("ending", [".glb", ".gltf"])
@pytest.mark.parametrize("name", ["gltf_transform_meshopt", "gltf_transform_draco"])
def test_an_untouched_mesh_stays_compressed(name: str, ending: str, tmp_path: Path) -> None:
    asset, out = twin(name, tmp_path / "in.glb"), tmp_path / f"out{ending}"
    tools = write_tools(tmp_path / "tools.yaml", *({**each, "node": "wrist"} for each in TOOLS))
    wrinklecli.bake(asset, tools, out)
    assert_valid(out)
    before, after = read_document(asset), read_document(out)
    primitives = [document.items("meshes")[1]["primitives"][0] for document in (before, after)]
    assert primitives[0] == primitives[1]
    extension = DRACO if name.endswith("draco") else "EXT_meshopt_compression"
    assert extension in after.gltf["extensionsUsed"]
    assert extension in after.gltf["extensionsRequired"]
    users = [*primitives[0]["attributes"].values(), primitives[0]["indices"]]
    for index in users:
        assert before.items("accessors")[index] == after.items("accessors")[index]
        assert (elements(before, index) == elements(after, index)).all()
    if name.endswith("draco"):
        assert all("bufferView" not in after.items("accessors")[index] for index in users)
    else:
        assert {after.items("accessors")[index]["bufferView"] for index in users} <= set(compressed_views(after.gltf))


@pytest.mark.slow
@pytest.mark.parametrize("ending", [".glb", ".gltf"])
@pytest.mark.parametrize("name", ["gltf_transform_meshopt", "gltf_transform_draco"])
def test_a_mesh_of_two_nodes_stays_compressed_for_the_other(name: str, ending: str, tmp_path: Path) -> None:
    editor = Editor(Gltf(compressed_sample(name)))
    shared_mesh(editor)
    asset, out = editor.save(tmp_path / "in.glb"), tmp_path / f"out{ending}"
    wrinklecli.bake(asset, write_tools(tmp_path / "tools.yaml", {**PALM, "node": "wrist"}), out)
    assert_valid(out)
    before, after = read_document(asset), read_document(out)
    old, new = (document.items("meshes")[0]["primitives"][0] for document in (before, after))
    assert old == new
    for index in (*old["attributes"].values(), old["indices"]):
        assert (elements(before, index) == elements(after, index)).all()
    clone = after.items("meshes")[after.items("nodes")[0]["mesh"]]["primitives"][0]
    for index in (*clone["attributes"].values(), clone["indices"]):
        view = after.items("bufferViews")[after.items("accessors")[index]["bufferView"]]
        assert "extensions" not in view


@pytest.mark.quick(1)
@pytest.mark.parametrize("out", ["out.glb", "out.gltf", "beside/out.gltf"])
def test_placeholders_may_come_first(out: str, tmp_path: Path) -> None:
    source = Gltf(twin("gltf_transform_meshopt", tmp_path / "in.glb"))
    gltf = source.json
    (tmp_path / "data.bin").write_bytes(source.buffers[0])
    gltf["buffers"] = [gltf["buffers"][1], {**gltf["buffers"][0], "uri": "data.bin"}]
    for view in gltf["bufferViews"]:
        for part in (view, *view.get("extensions", {}).values()):
            part["buffer"] = 1 - part["buffer"]
    path, target = tmp_path / "in.gltf", tmp_path / out
    path.write_text(json.dumps(gltf))
    target.parent.mkdir(exist_ok=True)
    wrinklecli.bake(path, write_tools(tmp_path / "tools.yaml", {**PALM, "node": "wrist"}), target)
    assert_valid(target)
    before, after = read_document(path), read_document(target)
    for index in before.items("meshes")[1]["primitives"][0]["attributes"].values():
        assert (elements(before, index) == elements(after, index)).all()


@pytest.mark.slow
def test_nothing_compressed_is_left_where_every_view_is_replaced(tmp_path: Path) -> None:
    """The placeholder and the names of the extension go with the last view that needs them."""
    editor = Editor(Gltf(compressed_sample("gltf_transform_meshopt")))
    document = read_document(compressed_sample("gltf_transform_meshopt"))
    mesh = editor.json["meshes"][0]["primitives"][0]
    kept = {mesh["indices"], *mesh["attributes"].values()}
    for index, accessor in enumerate(editor.json["accessors"]):
        if index not in kept:
            editor.accessor(document.stored(index))
            plain = editor.json["accessors"].pop()
            accessor.update({"bufferView": plain["bufferView"], "byteOffset": 0})
    used = {accessor["bufferView"] for accessor in editor.json["accessors"]}
    views = editor.json["bufferViews"]
    for index in sorted(set(range(len(views))) - used, reverse=True):
        views[index] = views[-1]
        for accessor in editor.json["accessors"]:
            if accessor["bufferView"] == len(views) - 1:
                accessor["bufferView"] = index
        views.pop()
    asset = editor.save(tmp_path / "in.glb")
    for ending in (".glb", ".gltf"):
        out = tmp_path / f"out{ending}"
        wrinklecli.bake(asset, write_tools(tmp_path / "tools.yaml", PALM), out)
        assert_valid(out)
        gltf = read_document(out).gltf
        assert "meshopt" not in json.dumps(gltf)
        assert all(buffer.get("uri") for buffer in gltf["buffers"][ending == ".glb" :])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gltfpack_cc", "gltf_transform_draco"])
def test_frames_of_a_compressed_mesh(name: str, tmp_path: Path) -> None:
    tools = write_tools(tmp_path / "tools.yaml", *TOOLS, sampling={"fps": 2})
    out = tmp_path / "frames.glb"
    wrinklecli.bake(compressed_sample(name), tools, out, mode="frames")
    assert_valid(out)
    assert DRACO not in read_document(out).gltf.get("extensionsUsed", [])


@pytest.mark.slow
def test_a_fallback_of_its_own_is_kept_too(tmp_path: Path) -> None:
    """Uncompressed data for players without the extension, as `gltfpack -cf` writes it."""
    path = twin("gltf_transform_meshopt", tmp_path / "in.glb")
    document, editor = read_document(path), Editor(Gltf(path))
    fallback = bytearray(document.items("buffers")[1]["byteLength"])
    for index in compressed_views(document.gltf):
        view = document.items("bufferViews")[index]
        start = view.get("byteOffset", 0)
        fallback[start : start + view["byteLength"]] = bytes(document.view(index))
    (tmp_path / "fallback.bin").write_bytes(fallback)
    editor.json["buffers"][1]["uri"] = "fallback.bin"
    editor.json["extensionsRequired"].remove("EXT_meshopt_compression")
    editor.save(path)
    tools = write_tools(tmp_path / "tools.yaml", *({**each, "node": "wrist"} for each in TOOLS))
    for ending in (".glb", ".gltf"):
        out = tmp_path / f"out{ending}"
        wrinklecli.bake(path, tools, out)
        assert_valid(out)
        # Without the extension the file reads the same.
        after = read_document(out)
        plain = json.loads(json.dumps(after.gltf))
        for view in plain["bufferViews"]:
            view.pop("extensions", None)
        bare = Document(str(out), plain, after.buffers, ())
        for index in after.items("meshes")[1]["primitives"][0]["attributes"].values():
            assert (elements(bare, index) == elements(after, index)).all()


def weights_of(path: Path) -> Floats:
    document = read_document(path)
    attributes = document.items("meshes")[0]["primitives"][0]["attributes"]
    return document.accessor(attributes["WEIGHTS_0"])


def test_rounded_weights_add_up_to_one_again() -> None:
    assert np.abs(weights_of(compressed_sample("gltf_transform_draco")).sum(axis=1) - 1.0).max() < 1e-6


@given(st.binary(max_size=14), st.integers(0, 1))
def test_a_stream_that_ends_early_says_as_much_as_there_is(data: bytes, method: int) -> None:
    """Numbers have seven bits in each byte, and five bytes at most; the highest bit says that more follow."""
    promised = _promised(memoryview(b"DRACO\x02\x02\x01" + bytes([method, 0, 0]) + data))
    left, found = list(data[method:]), []
    for _ in range(2):
        length = next((k + 1 for k, byte in enumerate(left[:5]) if byte < 128), min(len(left), 5))
        found.append(sum((byte % 128) * 128**k for k, byte in enumerate(left[:length])))
        del left[:length]
    assert list(promised) == (found[::-1] if method and data else found)


def test_primitives_that_draco_rounds_apart_weld(tmp_path: Path) -> None:
    """Positions of the second primitive are a few steps of float32 off, as another grid leaves them."""

    def split(gltf: Json) -> None:
        (primitive,) = gltf["meshes"][0]["primitives"]
        gltf["accessors"].append(dict(gltf["accessors"][primitive["attributes"]["POSITION"]]))
        other = json.loads(json.dumps(primitive))
        other["attributes"]["POSITION"] = len(gltf["accessors"]) - 1
        gltf["meshes"][0]["primitives"].append(other)

    document = read_document(twin("gltf_transform_draco", tmp_path / "in.glb", split))
    primitives = document.items("meshes")[0]["primitives"]
    first, second = (primitive["attributes"]["POSITION"] for primitive in primitives)
    moved = document.accessor(first) + np.float32(1e-7)
    document._decoded[second] = moved
    assert not (moved == document.accessor(first)).all()
    once = read_document(compressed_sample("gltf_transform_draco"))
    surfaces = [read_surface(each, read_rig(each, mesh_node(each))) for each in (once, document)]
    assert len(surfaces[0].positions) == len(surfaces[1].positions)


def test_a_missing_decoder_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(AssetError) as caught:
        wrinklecli.bake(
            compressed_sample("gltf_transform_draco"), write_tools(tmp_path / "t.yaml", *TOOLS), tmp_path / "o.glb"
        )
    (line,) = caught.value.lines
    assert DRACO in line
    assert "pip install 'wrinklecli[draco]'" in line
    assert "npx @gltf-transform/cli copy" in line


@pytest.mark.parametrize("name", ["ACME_mesh_folding", "EXT_mesh_gpu_instancing", "KHR_gaussian_splatting"])
def test_geometry_that_is_not_understood_is_refused_by_name(name: str, tmp_path: Path) -> None:
    def require(gltf: Json) -> None:
        gltf["extensionsRequired"].append(name)
        gltf["extensionsUsed"].append(name)

    with pytest.raises(AssetError, match=f"#/extensionsRequired/2: {name} "):
        read_document(twin("gltf_transform_meshopt", tmp_path / "in.glb", require))


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    "name", ["KHR_texture_transform", "KHR_materials_unlit", "ACME_sound", "ACME_texture_compression"]
)
def test_what_does_not_concern_geometry_is_kept(name: str, tmp_path: Path) -> None:
    def require(gltf: Json) -> None:
        gltf["extensionsRequired"].append(name)
        gltf["extensionsUsed"].append(name)

    path = twin("gltf_transform_meshopt", tmp_path / "in.glb", require)
    tools = write_tools(tmp_path / "tools.yaml", {**PALM, "node": "wrist"})
    wrinklecli.bake(path, tools, tmp_path / "out.glb")
    assert name in read_document(tmp_path / "out.glb").gltf["extensionsRequired"]


def test_a_buffer_without_data_must_be_all_compressed(tmp_path: Path) -> None:
    def expose(gltf: Json) -> None:
        del gltf["bufferViews"][0]["extensions"]

    with pytest.raises(AssetError, match="#/buffers/1: has no data"):
        read_document(twin("gltf_transform_meshopt", tmp_path / "in.glb", expose))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 7}, "byteLength is"),
        ({"byteOffset": 10**6}, "truncated"),
        ({"buffer": 9}, "buffers.9."),
        ({"buffer": 1}, "has no data"),
        ({"mode": "LINES"}, "mode is 'LINES'"),
        ({"byteLength": 3}, "malformed"),
        ({"filter": 4}, "not text"),
    ],
)
def test_malformed_extensions_are_refused(change: Json, message: str, tmp_path: Path) -> None:
    def spoil(gltf: Json) -> None:
        gltf["bufferViews"][2]["extensions"]["EXT_meshopt_compression"].update(change)

    with pytest.raises(AssetError, match=message):
        read_document(twin("gltf_transform_meshopt", tmp_path / "in.glb", spoil)).accessor(6)


@pytest.mark.quick(1, 2)
@pytest.mark.parametrize("name", EVERY)
def test_damaged_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    whole = compressed_sample(name).read_bytes()
    (size,) = struct.unpack_from("<I", whole, 12)
    generator = random.Random(1)
    path = tmp_path / "damaged.glb"
    for _ in range(25):
        data = bytearray(whole)
        for _ in range(generator.randrange(1, 6)):
            data[generator.randrange(28 + size, len(data))] = generator.randrange(256)
        path.write_bytes(data)
        document = read_document(path)
        for index in range(len(document.items("accessors"))):
            with suppress(AssetError):
                document.accessor(index)
