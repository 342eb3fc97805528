"""Documents: what is read is what was stored, and what is malformed is refused."""

import copy
import itertools
import json
import os
import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.asset import Asset, Json, pack_glb
from kit.documents import arrays, written
from kit.limb import limb, limb_asset
from wrinklecli.character.clip import read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.writer import write

# --- Where bytes come from ---


@pytest.mark.parametrize("buffer", ["file", "data", "percent", "folder"])
def test_gltf_buffer_is_found(tmp_path: Path, buffer: Any) -> None:
    asset = limb_asset(rings=4, sides=4)
    source = written(asset, tmp_path, "a.gltf", buffer=buffer)
    expected = written(asset, tmp_path, "a.glb")
    assert all(np.array_equal(a, b) for a, b in zip(arrays(source), arrays(expected), strict=True))
    assert len(source.files) == (1 if buffer == "data" else 2)
    assert all(os.path.isfile(file) for file in source.files)


def test_gltf_is_told_from_glb_by_its_bytes(tmp_path: Path) -> None:
    asset = limb_asset(rings=4, sides=4)
    (tmp_path / "a.gltf").write_bytes(asset.glb())
    asset.write(tmp_path / "b.gltf", buffer="data").rename(tmp_path / "b.glb")
    for name in ("a.gltf", "b.glb"):
        assert len(read_document(tmp_path / name).items("accessors")) == len(asset.gltf["accessors"])


def test_byte_order_mark_is_skipped(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_bytes(b'\xef\xbb\xbf{"asset": {"version": "2.0"}}')
    assert read_document(tmp_path / "a.gltf").gltf == {"asset": {"version": "2.0"}}


@pytest.mark.parametrize(
    "uri",
    [
        "../secret.bin",
        "%2e%2e/secret.bin",
        "data/../../secret.bin",
        "link/secret.bin",
        "link.bin",
        "http://example.org/a.bin",
        "https://example.org/a.bin",
        "file:///etc/passwd",
        "file:secret.bin",
        "C:/a.bin",
        "a%00.bin",
    ],
)
@pytest.mark.parametrize("kind", ["buffers", "images"])
def test_uri_outside_the_folder_is_refused(tmp_path: Path, uri: str, kind: str) -> None:
    inside, out = tmp_path / "inside", tmp_path / "out"
    (inside / "data").mkdir(parents=True)
    out.mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(4))
    (inside / "link").symlink_to(tmp_path)
    (inside / "link.bin").symlink_to(tmp_path / "secret.bin")
    gltf = {"asset": {"version": "2.0"}, kind: [{"uri": uri, "byteLength": 4}]}
    (inside / "a.gltf").write_text(json.dumps(gltf))
    with pytest.raises(AssetError, match=rf"a\.gltf#/{kind}/0: .*not a file below the asset's folder"):
        write(EditedDocument(read_document(inside / "a.gltf")), out / "b.glb")
    assert list(out.iterdir()) == []


def test_absolute_uri_is_refused(tmp_path: Path) -> None:
    (tmp_path / "secret.bin").write_bytes(bytes(4))
    (tmp_path / "in").mkdir()
    gltf = {"asset": {"version": "2.0"}, "buffers": [{"uri": str(tmp_path / "secret.bin"), "byteLength": 4}]}
    (tmp_path / "in" / "a.gltf").write_text(json.dumps(gltf))
    with pytest.raises(AssetError, match=r"#/buffers/0: .*not a file below"):
        read_document(tmp_path / "in" / "a.gltf")


@pytest.mark.parametrize(
    ("buffer", "message"),
    [
        ({"byteLength": 4}, "has no data"),
        ({"byteLength": 4, "uri": 7}, "is 7"),
        ({"byteLength": 4, "uri": "missing.bin"}, "cannot be read: No such file"),
        ({"byteLength": 4, "uri": "."}, "cannot be read: Is a directory"),
        ({"byteLength": 4, "uri": "data:application/octet-stream;base64,AAAA"}, "has 3 bytes of 4"),
        ({"byteLength": 4, "uri": "data:application/octet-stream,AAAA"}, "data URI is malformed"),
        ({"byteLength": 4, "uri": "data:application/octet-stream;base64,A*AA"}, "data URI is malformed"),
        ({"byteLength": 4, "uri": "data:"}, "data URI is malformed"),
        ({"uri": "data:application/octet-stream;base64,AAAA"}, "byteLength is None"),
        ({"byteLength": 0, "uri": "data:application/octet-stream;base64,AAAA"}, "byteLength is 0"),
        ({"byteLength": -1, "uri": "data:application/octet-stream;base64,AAAA"}, "is -1"),
        ({"byteLength": True, "uri": "data:application/octet-stream;base64,AAAA"}, "is True"),
    ],
)
def test_buffer_without_its_bytes_is_refused(tmp_path: Path, buffer: Json, message: str) -> None:
    (tmp_path / "a.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "buffers": [buffer]}))
    with pytest.raises(AssetError, match=f"#/buffers/0.*{message}"):
        read_document(tmp_path / "a.gltf")


# --- Decoding ---


@pytest.mark.parametrize("dtype", ["i1", "u1", "i2", "u2", "u4", "f4"])
@pytest.mark.parametrize("size", [1, 2, 3, 4, 16])
@pytest.mark.parametrize("strided", [False, True])
def test_stored_numbers_are_read(tmp_path: Path, dtype: str, size: int, strided: bool) -> None:
    asset = Asset()
    values = np.arange(5 * size).reshape(5, size) % 100 - (50 if dtype in ("i1", "i2", "f4") else 0)
    stored = values.astype(f"<{dtype}")
    if strided:
        # 7 bytes in front, 5 behind each element: components may not be aligned.
        rows = [b"\xaa" * 3 + row.tobytes() + b"\xbb" * 5 for row in stored]
        view = asset.view(b"\xcc" * 4 + b"".join(rows), stride=len(rows[0]))
        index = asset._describe(stored, dtype, view, 7, normalized=False, bounds=False)
    else:
        index = asset.accessor(stored, dtype)
    document = written(asset, tmp_path)
    read = document.accessor(index)
    assert read.shape == ((5,) if size == 1 else (5, size))
    assert np.array_equal(read.reshape(5, size), stored)
    assert read.dtype == (np.float64 if dtype == "f4" else stored.dtype)
    assert document.stored_dtype(index) == stored.dtype


@pytest.mark.parametrize(
    ("dtype", "stored", "wanted"),
    [
        # glTF 2.0 §3.11: f = c / 255, max(c / 127, -1), c / 65535, max(c / 32767, -1)
        ("u1", [0, 51, 255], [0.0, 0.2, 1.0]),
        ("i1", [-128, -127, 0, 127], [-1.0, -1.0, 0.0, 1.0]),
        ("u2", [0, 13107, 65535], [0.0, 0.2, 1.0]),
        ("i2", [-32768, -32767, 0, 32767], [-1.0, -1.0, 0.0, 1.0]),
    ],
)
def test_normalised_integers(tmp_path: Path, dtype: str, stored: list[int], wanted: list[float]) -> None:
    asset = Asset()
    asset.accessor(stored, dtype, normalized=True)
    assert written(asset, tmp_path).accessor(0).tolist() == wanted


@pytest.mark.parametrize("index_dtype", ["u1", "u2", "u4"])
@pytest.mark.parametrize("base", [True, False])
def test_sparse_accessor(tmp_path: Path, index_dtype: str, base: bool) -> None:
    asset = Asset()
    wanted = np.zeros((9, 3))
    wanted[[0, 4, 8]] = [[1, 2, 3], [4, 5, 6], [7, 8, 9.5]]
    asset.sparse(wanted, base=base, index_dtype=index_dtype)
    assert np.array_equal(written(asset, tmp_path).accessor(0), wanted)


def test_a_sparse_accessor_changes_what_it_substitutes_and_what_its_base_has(tmp_path: Path) -> None:
    asset, values = Asset(), np.zeros((9, 3))
    values[[0, 4, 8]] = 5.0
    base, over = asset.accessor(np.eye(9)[:, :3]), asset.sparse(values, base=False)
    asset.gltf["accessors"][base]["sparse"] = asset.gltf["accessors"][over]["sparse"]
    document = written(asset, tmp_path)
    for index, changed in ((base, [0, 1, 2, 4, 8]), (over, [0, 4, 8])):
        indices, found = document.changes(index)
        assert indices.tolist() == changed
        assert np.array_equal(found, document.accessor(index)[changed])


def test_accessor_without_view_is_zero(tmp_path: Path) -> None:
    asset = Asset()
    asset.append("accessors", {"componentType": 5126, "count": 4, "type": "VEC3"})
    assert np.array_equal(written(asset, tmp_path).accessor(0), np.zeros((4, 3)))


def test_reading_an_accessor_never_changes_the_buffer(tmp_path: Path) -> None:
    asset = Asset()
    asset.sparse(np.eye(3), base=True)
    asset.accessor(np.arange(3.0))
    document = written(asset, tmp_path)
    before = bytes(document.buffers[0])
    document.accessor(0)
    assert bytes(document.buffers[0]) == before
    for index in range(2):
        with pytest.raises(ValueError, match="read-only"):
            document.accessor(index)[0] = 5.0


# --- Malformed documents ---


def test_truncated_at_any_length_is_refused(tmp_path: Path) -> None:
    data = limb_asset(rings=4, sides=4).glb()
    rng = np.random.default_rng(1)
    for length in [*range(30), *rng.integers(30, len(data), 60).tolist(), len(data) - 1]:
        (tmp_path / "a.glb").write_bytes(data[:length])
        with pytest.raises(AssetError, match=r"a\.glb"):
            read_document(tmp_path / "a.glb")


def test_truncated_gltf_and_its_buffer_are_refused(tmp_path: Path) -> None:
    text = limb(tmp_path / "a.gltf", rings=4, sides=4).read_bytes()
    for length in range(0, len(text) - 1, 97):
        (tmp_path / "b.gltf").write_bytes(text[:length])
        with pytest.raises(AssetError, match=r"neither a \.glb nor JSON"):
            read_document(tmp_path / "b.gltf")
    (tmp_path / "a.bin").write_bytes((tmp_path / "a.bin").read_bytes()[:-1])
    with pytest.raises(AssetError, match=r"#/buffers/0: .*truncated"):
        read_document(tmp_path / "a.gltf")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "neither a .glb nor JSON"),
        (b"[]", "no object"),
        (b"null", "no object"),
        (b'{"asset": {"version": "2.0"}, "extras": NaN}', "NaN is no JSON number"),
        (b'{"asset": {"version": "2.0"}, "extras": [Infinity]}', "Infinity is no JSON number"),
        (b'{"asset": {"version": "2.0"}, "extras": -Infinity}', "-Infinity is no JSON number"),
        (b'{"asset": {"version": "2.0"}, "extras": 1e999}', "1e999"),
        (b'{"asset": {"version": "2.0"}, "extras": "\xff"}', "neither a .glb nor JSON"),
        (b'{"asset": {"version": "2.0"}, "nodes": ' + b"9" * 5000 + b"}", "neither a .glb nor JSON"),
        (b"{}", "asset.version is None"),
        (b'{"asset": {"version": "1.0"}}', "asset.version is '1.0'"),
        (b'{"asset": {"version": "1.0"}, "meshes": {"body": {}}, "scene": "all"}', "asset.version is '1.0'"),
        (b'{"asset": {"version": 2.0}}', "#/asset/version: is 2.0"),
        (b'{"asset": []}', "#/asset: is []"),
        (b'{"asset": {"version": "2.0"}, "buffers": {}}', "#/buffers: is {}"),
        (b'{"asset": {"version": "2.0"}, "buffers": [1]}', "#/buffers/0: is 1"),
    ],
)
@pytest.mark.parametrize("container", ["glb", "gltf"])
def test_malformed_json_is_refused(tmp_path: Path, text: bytes, message: str, container: str) -> None:
    (tmp_path / "a").write_bytes(text if container == "gltf" else pack_glb(text or b" "))
    with pytest.raises(AssetError) as caught:
        read_document(tmp_path / "a")
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / "a"))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (struct.pack("<4sII", b"glTF", 1, 12), "version 1"),
        (struct.pack("<4sII", b"glTF", 2, 12), "no JSON chunk"),
        (struct.pack("<4sIII4s", b"glTF", 2, 20, 400, b"JSON"), "chunk at byte 12 ends after the file"),
        (pack_glb(b'{"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4}]}'), "#/buffers/0: has no data"),
    ],
)
def test_malformed_container_is_refused(tmp_path: Path, data: bytes, message: str) -> None:
    (tmp_path / "a.glb").write_bytes(data)
    with pytest.raises(AssetError, match=message):
        read_document(tmp_path / "a.glb")


def test_unreadable_file_is_refused(tmp_path: Path) -> None:
    for name in ("missing.glb", "."):
        with pytest.raises(AssetError, match="cannot be read"):
            read_document(tmp_path / name)


@pytest.mark.parametrize(
    ("place", "key", "value", "message"),
    [
        ("accessors", "componentType", 5124, "#/accessors/0: .*componentType 5124"),
        ("accessors", "type", "VEC5", "#/accessors/0: 'VEC5'"),
        ("accessors", "count", 10, "#/accessors/0: 10 elements of 12 bytes from byte 0 do not fit"),
        ("accessors", "count", 0, "#/accessors/0: count is 0"),
        ("accessors", "count", -1, "#/accessors/0/count: is -1"),
        ("accessors", "count", 9.5, "#/accessors/0/count: is 9.5"),
        ("accessors", "count", True, "#/accessors/0/count: is True"),
        ("accessors", "count", 2**40, "#/accessors/0: count is"),
        ("accessors", "byteOffset", 4, "#/accessors/0: 9 elements .* do not fit"),
        ("accessors", "byteOffset", -4, "#/accessors/0/byteOffset: is -4"),
        ("accessors", "bufferView", 7, "#/accessors/0: refers to bufferViews.7., but there are 1"),
        ("accessors", "bufferView", -1, "#/accessors/0/bufferView: is -1"),
        ("accessors", "bufferView", None, "#/accessors/0/bufferView: is None"),
        ("accessors", "sparse", [], "#/accessors/0/sparse: is "),
        ("accessors", "sparse", {"count": 1}, "#/accessors/0: sparse needs indices and values"),
        ("bufferViews", "buffer", 1, "#/bufferViews/0: refers to buffers.1., but there are 1"),
        ("bufferViews", "byteLength", 10**6, "#/bufferViews/0: .*truncated"),
        ("bufferViews", "byteOffset", 200, "#/bufferViews/0: .*truncated"),
        ("bufferViews", "byteStride", 4, "#/bufferViews/0: byteStride is 4"),
        ("bufferViews", "byteStride", 16, "#/accessors/0: 9 elements of 16 bytes"),
    ],
)
def test_malformed_accessor_is_refused(tmp_path: Path, place: str, key: str, value: Any, message: str) -> None:
    asset = Asset()
    asset.accessor(np.zeros((9, 3)))
    asset.gltf[place][0][key] = value
    with pytest.raises(AssetError, match=message):
        written(asset, tmp_path).accessor(0)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("count",), 10, "count is 10"),
        (("indices", "componentType"), 5126, "unsigned integers"),
        (("indices", "bufferView"), 99, "refers to bufferViews.99."),
        (("values", "byteOffset"), 4, "do not fit"),
    ],
)
def test_malformed_sparse_accessor_is_refused(tmp_path: Path, path: tuple[str, ...], value: Any, message: str) -> None:
    asset = Asset()
    asset.sparse(np.eye(9)[:, :3], base=False)
    place = asset.gltf["accessors"][0]["sparse"]
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    with pytest.raises(AssetError, match=f"#/accessors/0.*: .*{message}"):
        written(asset, tmp_path).accessor(0)


def test_sparse_index_out_of_range_is_refused(tmp_path: Path) -> None:
    asset = Asset()
    asset.sparse(np.eye(9)[:, :3], base=False)
    asset.gltf["accessors"][0]["count"] = 2
    asset.gltf["accessors"][0]["sparse"]["count"] = 2
    asset.data[: 2 * 2] = struct.pack("<2H", 0, 2)
    document = written(asset, tmp_path)
    with pytest.raises(AssetError, match="#/accessors/0: sparse index 2, but the count is 2"):
        document.accessor(0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"materials": 5}, "#/materials: is 5, not an array"),
        ({"materials": ["red"]}, "#/materials/0: is 'red', not an object"),
        ({"cameras": {}}, "#/cameras: is {}, not an array"),
        ({"samplers": [[]]}, "#/samplers/0: is [], not an object"),
        ({"textures": [{"name": 5}]}, "#/textures/0/name: is 5, not text"),
        ({"skins": [{"skeleton": []}]}, "#/skins/0/skeleton: is [], not a whole number of 0 or more"),
        ({"scene": "0"}, "#/scene: is '0', not a whole number of 0 or more"),
        ({"scene": 1, "scenes": [{}]}, "#/: refers to scenes[1], but there are 1"),
        ({"scenes": [{"nodes": [0]}]}, "#/scenes/0/nodes: refers to nodes[0], but there are 0"),
        ({"images": [{"bufferView": 3}]}, "#/images/0: refers to bufferViews[3], but there are 0"),
        ({"nodes": [{"matrix": [1.0] * 15}]}, "#/nodes/0/matrix: has 15 numbers, not 16"),
        ({"buffers": [{"uri": "\ud800.bin"}]}, "#/buffers/0: uri '\\ud800.bin' is not a file"),
        ({"images": [{"uri": "a\0b"}]}, "#/images/0: uri 'a\\x00b' is not a file"),
        (
            {"nodes": [{}], "animations": [{"channels": [{"sampler": 0, "target": {"node": 0, "path": "scale"}}]}]},
            "#/animations/0/channels/0: has no sampler with input and output",
        ),
    ],
)
def test_what_is_read_has_its_type_and_refers_to_something(tmp_path: Path, changes: Any, message: str) -> None:
    with pytest.raises(AssetError, match=re.escape(message)):
        written(Asset({"asset": {"version": "2.0"}, **changes}), tmp_path)


@pytest.mark.parametrize(
    "changes",
    [
        {"textures": [{"source": 9, "sampler": "x"}], "materials": [{"pbrMetallicRoughness": 3}]},
        {"meshes": [{"primitives": [{"material": 9, "unknown": {}}]}], "nodes": [{"camera": 9}]},
        {"skins": [{"skeleton": 9}], "unknown": 5, "extensions": [], "nodes": [{"extras": [], "extensions": {"A": 5}}]},
        {"nodes": [{}], "animations": [{"channels": [{"sampler": 9, "target": {"node": 0, "path": "pointer"}}]}]},
    ],
)
def test_what_is_not_read_may_be_anything(tmp_path: Path, changes: Any) -> None:
    gltf = {"asset": {"version": "2.0"}, **changes}
    assert written(Asset(gltf), tmp_path).gltf == gltf


@pytest.mark.parametrize("index", [2, -1, 1.0, "0", None])
def test_index_out_of_range_names_its_user(tmp_path: Path, index: Any) -> None:
    document = written(Asset({"asset": {"version": "2.0"}, "nodes": [{}, {}]}), tmp_path)
    with pytest.raises(AssetError, match=r"in\.glb#/x/3: refers to nodes.*there are 2"):
        document.item("nodes", index, user=document.where("x", 3))


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *itertools.chain.from_iterable(_places(child, (*path, key)) for key, child in children)]


JUNK: list[Any] = [None, True, -1, 10**6, 0.5, "x", [], [0], {}, {"0": 0}]


@pytest.mark.quick(0, 1)
@pytest.mark.parametrize("junk", JUNK, ids=repr)
def test_any_value_replaced_by_junk_is_read_or_refused(tmp_path: Path, junk: Any) -> None:
    """Whatever stands in the JSON, a reader says so in a `WrinkleError`, or can do with it."""
    asset = limb_asset(rings=3, sides=4, morphs=1, morph_clip="LINEAR", weights_at="both", sparse="base", root={})
    gltf = {**asset.gltf, "buffers": [{"byteLength": len(asset.data)}]}
    faults = []
    for place in _places(gltf)[1:]:
        changed = copy.deepcopy(gltf)
        holder: Any = changed
        for key in place[:-1]:
            holder = holder[key]
        holder[place[-1]] = junk
        (tmp_path / "a.glb").write_bytes(pack_glb(json.dumps(changed).encode(), bytes(asset.data)))
        try:
            document = read_document(tmp_path / "a.glb")
            EditedDocument(document)
            read_clips(document)
            read_surface(document, read_rig(document, 0))
        except WrinkleError as error:
            if not str(error).startswith(f"{tmp_path / 'a.glb'}#/"):
                faults.append(f"/{'/'.join(map(str, place))}: says no place: {error}")
        except Exception as error:
            faults.append(f"/{'/'.join(map(str, place))}: {error!r}")
    assert not faults, f"{len(faults)} tracebacks:\n" + "\n".join(faults)


def test_a_pointer_of_git_lfs_in_place_of_a_buffer_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n")
    gltf = {"asset": {"version": "2.0"}, "buffers": [{"uri": "a.bin", "byteLength": 400}]}
    (tmp_path / "a.gltf").write_text(json.dumps(gltf))
    with pytest.raises(AssetError, match="#/buffers/0: is a pointer of Git LFS, not the file itself"):
        read_document(tmp_path / "a.gltf")


def with_floats(value: Any) -> Any:
    """JSON whose integers are written as 1.0."""
    if isinstance(value, dict):
        return {key: with_floats(each) for key, each in value.items()}
    if isinstance(value, list):
        return [with_floats(each) for each in value]
    return float(value) if type(value) is int else value


def kinds(value: Any) -> Any:
    """JSON with the types of its numbers in their place."""
    if isinstance(value, dict):
        return {key: kinds(each) for key, each in value.items()}
    return [kinds(each) for each in value] if isinstance(value, list) else type(value)


def test_integers_written_as_floats_are_integers(tmp_path: Path) -> None:
    asset = limb_asset(rings=5, sides=4, morphs=2, morph_clip="LINEAR", sparse="base", indices="u2", uvs=True)
    info = {"index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": {"texCoord": 0}}}
    asset.append("materials", {"pbrMetallicRoughness": {"baseColorTexture": info}, "extras": {"size": 2}})
    asset.append("textures", {"source": 0, "sampler": 0, "extensions": {"EXT_texture_webp": {"source": 0}}})
    asset.append("images", {"bufferView": 0, "mimeType": "image/png"})
    asset.append("samplers", {"wrapS": 33071, "wrapT": 33648})
    asset.gltf["meshes"][0]["primitives"][0]["material"] = 0
    asset.gltf["nodes"][0]["extensions"] = {"MSFT_lod": {"ids": [1]}}
    asset.gltf["extensions"] = {"VRM": {"humanoid": {"humanBones": [{"bone": "hips", "node": 1}]}}}
    asset.gltf["buffers"] = [{"byteLength": len(asset.data)}]
    wanted = read_document(asset.write(tmp_path / "a.glb")).gltf
    text = json.dumps(with_floats({**asset.gltf, "buffers": [{"byteLength": len(asset.data)}]})).encode()
    (tmp_path / "b.glb").write_bytes(pack_glb(text, bytes(asset.data)))
    read = read_document(tmp_path / "b.glb")
    assert read.gltf == wanted
    for kind in ("nodes", "accessors"):  # numbers of which stay as they are
        for entries in (wanted, read.gltf):
            for each in entries[kind]:
                for key in ("min", "max", "translation", "weights"):
                    each.pop(key, None)
    del wanted["materials"][0]["extras"], read.gltf["materials"][0]["extras"]
    for entries in (wanted, read.gltf):
        entries["meshes"][0].pop("weights", None)
    assert kinds(read.gltf) == kinds(wanted)
    assert np.array_equal(read.accessor(0), read_document(tmp_path / "a.glb").accessor(0))


def test_numbers_with_a_fraction_are_no_integers(tmp_path: Path) -> None:
    asset = limb_asset(rings=3, sides=4)
    asset.gltf["accessors"][0]["count"] = 2.5
    with pytest.raises(AssetError, match=r"#/accessors/0/count: is 2.5, not a whole number"):
        written(asset, tmp_path)
