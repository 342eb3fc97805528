"""Documents: what is read is what was stored, what is not set is kept, and nothing half-written is left behind."""

import base64
import copy
import itertools
import json
import os
import struct
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.asset import ARRAY_BUFFER, Asset, pack_glb, read_glb
from kit.limb import limb, limb_asset
from wrinklecli.character.clip import read_clips
from wrinklecli.character.rig import read_rig
from wrinklecli.character.surface import read_surface
from wrinklecli.errors import AssetError, BakeError, WrinkleError
from wrinklecli.gltf import edit, writer
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.edit import VERTEX_DATA, EditedDocument, index_type
from wrinklecli.gltf.files import replace_bytes, replace_file
from wrinklecli.gltf.images import image_files
from wrinklecli.gltf.writer import write

Json = dict[str, Any]
PNG = b"\x89PNG\r\n\x1a\n" + bytes(9)
JPEG = b"\xff\xd8\xff\xe0" + bytes(7)

json_scalars = (
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=9)
)
json_values = st.recursive(
    json_scalars, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
)


def written(asset: Asset, folder: Path, name: str = "in.glb", **options: Any) -> Document:
    return read_document(asset.write(folder / name, **options))


def same_bits(one: Any, other: Any) -> bool:
    """Equal JSON, with equal types and orders of keys: True is not 1, and 1 is not 1.0."""
    return json.dumps(one) == json.dumps(other)


def arrays(document: Document) -> list[Any]:
    return [document.accessor(k) for k in range(len(document.items("accessors")))]


def assert_tight(path: Path, *, replaced: int) -> None:
    """Check that a .glb's bytes belong to views, but for what alignment to 4 takes.

    That is up to 3 bytes in front of each view, and for each one taken out up to 3 in front and 3 of its own,
    as data behind it moves by multiples of 4 only.
    """
    gltf, data = read_glb(path.read_bytes())
    owned = np.zeros(len(data), bool)
    for view in gltf["bufferViews"]:
        start = view.get("byteOffset", 0)
        owned[start : start + view["byteLength"]] = True
    assert (~owned).sum() <= 3 * (len(gltf["bufferViews"]) + 2 * replaced)


# --- Round trips ---


@given(extras=json_values, unknown=json_values, name=st.text(max_size=9))
def test_unpatched_json_survives_with_order_types_and_unknown_keys(
    tmp_path_factory: pytest.TempPathFactory, extras: Any, unknown: Any, name: str
) -> None:
    folder = tmp_path_factory.mktemp("json")
    asset = Asset({"zebra": unknown, "asset": {"extras": extras, "version": "2.0"}, "nodes": [{"name": name}]})
    asset.gltf |= {"extras": None, "meshes": []}
    source = written(asset, folder)
    write(EditedDocument(source), folder / "out.glb")
    assert same_bits(read_document(folder / "out.glb").gltf, asset.gltf)
    write(EditedDocument(source), folder / "out.gltf")
    assert same_bits(json.loads((folder / "out.gltf").read_bytes()), asset.gltf)


@pytest.mark.parametrize("ending", ["glb", "gltf"])
@pytest.mark.parametrize(("name", "buffer"), [("a.glb", "file"), ("a.gltf", "file"), ("b.gltf", "data")])
@pytest.mark.parametrize(
    "options", [{"morphs": 2, "morph_clip": "CUBICSPLINE", "weights_at": "node"}, {"sparse": "base"}]
)
def test_limb_survives_unpatched(tmp_path: Path, ending: str, name: str, buffer: Any, options: Any) -> None:
    source = read_document(limb(tmp_path / name, buffer=buffer, rings=5, sides=4, **options))
    write(EditedDocument(source), tmp_path / f"out.{ending}")
    result = read_document(tmp_path / f"out.{ending}")
    assert all(np.array_equal(a, b) for a, b in zip(arrays(source), arrays(result), strict=True))
    keys = [key for key in source.gltf if key != "buffers"]
    assert same_bits({k: source.gltf[k] for k in keys}, {k: result.gltf[k] for k in keys})


def test_glb_written_twice_is_the_same_bytes(tmp_path: Path) -> None:
    source = read_document(limb(tmp_path / "a.glb", rings=5, sides=4))
    write(EditedDocument(source), tmp_path / "b.glb")
    write(EditedDocument(read_document(tmp_path / "b.glb")), tmp_path / "c.glb")
    assert (tmp_path / "b.glb").read_bytes() == (tmp_path / "c.glb").read_bytes()


def test_lone_surrogate_in_a_name_survives(tmp_path: Path) -> None:
    # Legal JSON: an escape of half a pair. Python's strings can hold it, UTF-8 cannot.
    text = b'{"asset": {"version": "2.0"}, "nodes": [{"name": "\\ud83d"}]}'
    (tmp_path / "a.glb").write_bytes(pack_glb(text))
    for name in ("out.glb", "out.gltf"):
        write(EditedDocument(read_document(tmp_path / "a.glb")), tmp_path / name)
        assert read_document(tmp_path / name).gltf["nodes"][0]["name"] == "\ud83d"


@pytest.mark.parametrize("depth", [50, 200, 400, 900, 100_000])
def test_deep_json_is_read_and_written_or_refused(tmp_path: Path, depth: int) -> None:
    text = b'{"asset": {"version": "2.0"}, "extras": ' + b"[" * depth + b"]" * depth + b"}"
    (tmp_path / "a.gltf").write_bytes(text)
    faults = []
    try:
        draft = EditedDocument(read_document(tmp_path / "a.gltf"))
        write(draft, tmp_path / "b.glb")
    except AssetError as error:
        faults.append(str(error))
    if faults:
        assert depth > 200, "no real asset is that deep, but those of 200 are read"
        assert "nested" in faults[0]
    else:
        assert read_document(tmp_path / "b.glb").gltf["extras"] == draft.source.gltf["extras"]


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


# --- Several buffers, and where they go ---


def _three_buffers(folder: Path) -> Path:
    """Numbers 0 … 29 as bytes in three buffers of sizes that are not multiples of 4, views in mixed order."""
    sizes, start = (7, 13, 10), 0
    gltf: Json = {"asset": {"version": "2.0"}, "buffers": [], "bufferViews": [], "accessors": []}
    for k, size in enumerate(sizes):
        data = bytes(range(start, start + size))
        (folder / f"b{k}.bin").write_bytes(data)
        uri = f"b{k}.bin" if k < 2 else "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        gltf["buffers"].append({"uri": uri, "byteLength": size, "name": f"buffer {k}"})
        start += size
    for buffer, offset, length in ((2, 0, 10), (0, 0, 7), (1, 4, 9), (1, 0, 4)):
        view = {"buffer": buffer, "byteLength": length, "name": "v"}
        gltf["bufferViews"].append(view | ({"byteOffset": offset} if offset else {}))
        gltf["accessors"].append(
            {
                "bufferView": len(gltf["bufferViews"]) - 1,
                "componentType": 5121,
                "count": length,
                "type": "SCALAR",
            }
        )
    (folder / "many.gltf").write_text(json.dumps(gltf))
    return folder / "many.gltf"


@pytest.mark.parametrize("name", ["out.glb", "out.gltf", "other/out.glb", "other/out.gltf"])
def test_several_buffers(tmp_path: Path, name: str) -> None:
    (tmp_path / "other").mkdir()
    source = read_document(_three_buffers(tmp_path))
    draft = EditedDocument(source)
    fresh = np.arange(12, dtype=np.float32).reshape(4, 3)
    added = draft.add(fresh, target=VERTEX_DATA, bounds=True)
    write(draft, tmp_path / name)
    result = read_document(tmp_path / name)
    assert len(result.items("buffers")) == (1 if name.endswith(".glb") else 4)
    for index, expected in enumerate(arrays(source)):
        assert np.array_equal(result.accessor(index), expected)
    assert np.array_equal(result.accessor(added), fresh)
    assert all(view["name"] == "v" for view in result.items("bufferViews")[:4])
    assert all(Path(file).parent == (tmp_path / name).parent for file in result.files)


def test_gltf_beside_its_source_shares_its_buffers(tmp_path: Path) -> None:
    draft = EditedDocument(read_document(_three_buffers(tmp_path)))
    draft.add(np.arange(3, dtype=np.float32))
    before = set(os.listdir(tmp_path))
    write(draft, tmp_path / "out.gltf")
    fresh = set(os.listdir(tmp_path)) - before - {"out.gltf"}
    assert len(fresh) == 1
    assert next(iter(fresh)).startswith("out-")
    uris = [buffer["uri"] for buffer in json.loads((tmp_path / "out.gltf").read_text())["buffers"]]
    assert uris[:2] == ["b0.bin", "b1.bin"]


def test_gltf_out_of_a_name_with_reserved_characters(tmp_path: Path) -> None:
    draft = EditedDocument(read_document(limb(tmp_path / "a.glb", rings=4, sides=4)))
    write(draft, tmp_path / "ä #1%20.gltf")
    result = read_document(tmp_path / "ä #1%20.gltf")
    assert quote("ä #1%20") in result.items("buffers")[0]["uri"]
    assert all(np.array_equal(a, b) for a, b in zip(arrays(result), arrays(draft.source), strict=True))


@pytest.mark.parametrize("beside", [True, False])
@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_images_follow_an_out_in_another_folder(tmp_path: Path, beside: bool, ending: str) -> None:
    inside, out = tmp_path / "in", tmp_path / ("in" if beside else "out")
    (inside / "tex").mkdir(parents=True)
    out.mkdir(exist_ok=True)
    (inside / "tex" / "skin 1.png").write_bytes(PNG)
    (inside / "b.jpg").write_bytes(JPEG)
    asset = limb_asset(rings=4, sides=4)
    embedded = asset.view(PNG + b"embedded")
    data_uri = "data:image/png;base64," + base64.b64encode(PNG).decode()
    asset.gltf["images"] = [
        {"uri": "tex/skin%201.png", "name": "skin"},
        {"uri": "b.jpg"},
        {"bufferView": embedded, "mimeType": "image/png"},
        {"uri": data_uri},
    ]
    draft = EditedDocument(written(asset, inside, "a.gltf"))
    read = image_files(draft, out / f"o.{ending}")
    write(draft, out / f"o.{ending}")
    result = read_document(out / f"o.{ending}")
    images = result.items("images")
    assert images[3] == {"uri": data_uri}
    assert read == ([] if beside else [str(inside / "tex" / "skin 1.png"), str(inside / "b.jpg")])

    def content(image: Json) -> bytes:
        if "uri" in image:
            return (out / {"tex/skin%201.png": "tex/skin 1.png"}.get(image["uri"], image["uri"])).read_bytes()
        view = result.items("bufferViews")[image["bufferView"]]
        start = view.get("byteOffset", 0)
        return bytes(result.buffers[view["buffer"]][start : start + view["byteLength"]])

    assert [content(image) for image in images[:3]] == [PNG, JPEG, PNG + b"embedded"]
    if ending == "glb" and not beside:
        assert [image["mimeType"] for image in images[:2]] == ["image/png", "image/jpeg"]
        assert images[0]["name"] == "skin"
    else:
        assert [image.get("uri") for image in images[:2]] == ["tex/skin%201.png", "b.jpg"]


def test_missing_image_leaves_nothing_behind(tmp_path: Path) -> None:
    asset = limb_asset(rings=4, sides=4)
    asset.gltf["images"] = [{"uri": "missing.png"}]
    (tmp_path / "out").mkdir()
    draft = EditedDocument(written(asset, tmp_path, "a.gltf"))
    with pytest.raises(AssetError, match=r"#/images/0: cannot be read"):
        write(draft, tmp_path / "out" / "o.glb")
    assert os.listdir(tmp_path / "out") == []


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
        ("accessors", "count", 1e3, "#/accessors/0/count: is 1000.0"),
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
    document = written(asset, tmp_path)
    with pytest.raises(AssetError, match=f"#/accessors/0: .*{message}"):
        document.accessor(0)


def test_sparse_index_out_of_range_is_refused(tmp_path: Path) -> None:
    asset = Asset()
    asset.sparse(np.eye(9)[:, :3], base=False)
    asset.gltf["accessors"][0]["count"] = 2
    asset.gltf["accessors"][0]["sparse"]["count"] = 2
    asset.data[: 2 * 2] = struct.pack("<2H", 0, 2)
    document = written(asset, tmp_path)
    with pytest.raises(AssetError, match="#/accessors/0: sparse index 2, but the count is 2"):
        document.accessor(0)


@pytest.mark.parametrize("index", [2, -1, 1.0, "0", None])
def test_index_out_of_range_names_its_user(tmp_path: Path, index: Any) -> None:
    document = written(Asset({"asset": {"version": "2.0"}, "nodes": [{}, {}]}), tmp_path)
    with pytest.raises(AssetError, match=r"in\.glb#/x/3: refers to nodes.*there are 2"):
        document.item("nodes", index, user=document.where("x", 3))


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *itertools.chain.from_iterable(_places(child, (*path, key)) for key, child in children)]


JUNK: list[Any] = [None, True, -1, 10**6, 0.5, "x", [], [0], {}, {"0": 0}]


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


# --- Patching ---


def _two_meshes(folder: Path) -> Document:
    """Two primitives that share indices and normals, in views of odd lengths."""
    asset = Asset()
    names = ["a", "shared", "b", "c"]
    for k, name in enumerate(names):
        asset.accessor(np.full((5, 3), k, np.uint8), "u1", target=None, name=name, extras={"k": k})
    primitives = [{"attributes": {"POSITION": p, "NORMAL": 1}} for p in (0, 2)]
    asset.append("meshes", {"primitives": primitives})
    asset.append("meshes", {"primitives": [{"attributes": {"POSITION": 3}}]})
    return written(asset, folder)


@pytest.mark.parametrize("replaced", [[0], [2], [0, 2], [2, 0], [0, 2, 3], [3]])
def test_replaced_accessor_keeps_its_index_and_leaves_no_bytes(tmp_path: Path, replaced: list[int]) -> None:
    source = _two_meshes(tmp_path)
    draft = EditedDocument(source)
    fresh = {index: np.full((3, 3), 10 + index, np.float32) for index in replaced}
    for index, values in fresh.items():
        assert draft.add(values, replaces=index) == index
    write(draft, tmp_path / "out.glb")
    result = read_document(tmp_path / "out.glb")
    assert len(result.items("bufferViews")) == 4
    for index in range(4):
        assert np.array_equal(result.accessor(index), fresh.get(index, source.accessor(index)))
        assert result.items("accessors")[index]["extras"] == {"k": index}
    assert_tight(tmp_path / "out.glb", replaced=len(replaced))
    write(draft, tmp_path / "out.gltf")
    sizes = sum(file.stat().st_size for file in tmp_path.glob("out-*.bin"))
    # 36 bytes for each new one, 15 for each that is kept, and alignment as in `assert_tight`.
    assert sizes <= 36 * len(replaced) + 15 * (4 - len(replaced)) + 3 * (4 + 2 * len(replaced))
    assert all(
        np.array_equal(a, b) for a, b in zip(arrays(read_document(tmp_path / "out.gltf")), arrays(result), strict=True)
    )


def test_shared_accessor_is_replaced_only_with_its_last_reference(tmp_path: Path) -> None:
    source = _two_meshes(tmp_path)
    draft = EditedDocument(source)
    first = draft.add(np.ones((3, 3), np.float32), replaces=1)
    second = draft.add(np.ones((4, 3), np.float32), replaces=1)
    assert first == 4
    assert second == 1
    write(draft, tmp_path / "out.glb")
    assert read_document(tmp_path / "out.glb").accessor(1).shape == (4, 3)
    assert_tight(tmp_path / "out.glb", replaced=1)


@pytest.mark.parametrize(
    "user",
    [
        {"extensions": {"FOO_bar": {"accessor": 0}}},
        {"extensions": {"FOO_bar": [[{"view": 0}]]}},
        {"nodes": [{"extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 0}}}}]},
    ],
)
def test_what_an_unknown_extension_may_mean_is_kept(tmp_path: Path, user: Json) -> None:
    asset = Asset()
    asset.accessor(np.arange(6.0).reshape(2, 3))
    asset.append("meshes", {"primitives": [{"attributes": {"POSITION": 0}}]})
    asset.gltf |= user
    source = written(asset, tmp_path)
    draft = EditedDocument(source)
    assert draft.add(np.ones((3, 3), np.float32), replaces=0) == 1
    write(draft, tmp_path / "out.glb")
    result = read_document(tmp_path / "out.glb")
    assert np.array_equal(result.accessor(0), source.accessor(0))
    view = result.items("bufferViews")[0]
    assert view["byteLength"] == 24


def test_view_that_only_an_extension_may_mean_is_kept(tmp_path: Path) -> None:
    asset = Asset()
    for k in range(3):
        asset.view(bytes([k] * 8))
    asset.accessor(np.arange(6.0).reshape(2, 3))  # accessor 0 in view 3
    asset.append("meshes", {"primitives": [{"attributes": {"POSITION": 0}}]})
    asset.gltf["extensions"] = {"FOO_bar": {"view": 3}}
    draft = EditedDocument(written(asset, tmp_path))
    assert draft.add(np.ones((3, 3), np.float32), replaces=0) == 0
    write(draft, tmp_path / "out.glb")
    result = read_document(tmp_path / "out.glb")
    view = result.items("bufferViews")[3]
    data = bytes(result.buffers[0][view["byteOffset"] : view["byteOffset"] + view["byteLength"]])
    assert data == np.arange(6, dtype="<f4").tobytes()


@pytest.mark.parametrize("lengths", [(15, 12), (2, 14, 12), (6, 7, 3, 12), (2, 6, 8, 4)])
def test_what_moves_up_stays_aligned(tmp_path: Path, lengths: tuple[int, ...]) -> None:
    """Views of bytes without gaps between them; all but the first and the last are replaced."""
    asset = Asset()
    data = bytes(range(sum(lengths)))
    starts = np.cumsum([0, *lengths[:-1]]).tolist()
    asset.view(data)
    asset.gltf["bufferViews"] = [
        {"buffer": 0, "byteOffset": start, "byteLength": length} for start, length in zip(starts, lengths, strict=True)
    ]
    for k, length in enumerate(lengths):
        asset.append("accessors", {"bufferView": k, "componentType": 5121, "count": length, "type": "SCALAR"})
    attributes = {f"_{k}": k for k in range(len(lengths))}
    asset.append("meshes", {"primitives": [{"attributes": attributes}]})
    source = written(asset, tmp_path)
    dead = range(0 if len(lengths) == 2 else 1, len(lengths) - 1)
    for ending in ("glb", "gltf"):
        draft = EditedDocument(source)
        for index in dead:
            draft.add(np.ones(2, np.float32), replaces=index)
        write(draft, tmp_path / f"out.{ending}")
        result = read_document(tmp_path / f"out.{ending}")
        for index in set(range(len(lengths))) - set(dead):
            assert np.array_equal(result.accessor(index), source.accessor(index))
            assert (result.items("bufferViews")[index].get("byteOffset", 0) - starts[index]) % 4 == 0


def test_interleaved_view_dies_with_its_last_accessor(tmp_path: Path) -> None:
    asset = Asset()
    rows = np.arange(12.0).reshape(4, 3)
    position, normal = asset.interleaved((rows, "f4", False), (-rows, "f4", False))
    asset.append("meshes", {"primitives": [{"attributes": {"POSITION": position, "NORMAL": normal}}]})
    source = written(asset, tmp_path)
    draft = EditedDocument(source)
    draft.add(rows.astype(np.float32)[:2], replaces=position)
    write(draft, tmp_path / "half.glb")
    assert np.array_equal(read_document(tmp_path / "half.glb").accessor(normal), -rows)
    draft.add(rows.astype(np.float32)[:2], replaces=normal)
    write(draft, tmp_path / "out.glb")
    assert read_document(tmp_path / "out.glb").accessor(position).shape == (2, 3)
    assert_tight(tmp_path / "out.glb", replaced=1)


@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_sparse_accessor_replaced_by_a_dense_one_leaves_valid_views(tmp_path: Path, ending: str) -> None:
    """Of the three views of a sparse accessor two have no successor: whatever they become must lie in a buffer."""
    asset = Asset()
    asset.sparse(np.ones((400, 3)), base=True)
    asset.append("meshes", {"primitives": [{"attributes": {"POSITION": 0}}]})
    draft = EditedDocument(written(asset, tmp_path))
    assert draft.add(np.ones((2, 3), np.float32), replaces=0) == 0
    write(draft, tmp_path / f"out.{ending}")
    result = read_document(tmp_path / f"out.{ending}")
    assert np.array_equal(result.accessor(0), np.ones((2, 3)))
    for view in result.items("bufferViews"):
        assert view.get("byteOffset", 0) + view["byteLength"] <= len(result.buffers[view["buffer"]])
    assert sum(len(buffer) for buffer in result.buffers) < 100, "24 bytes are used"


def test_views_that_overlap_a_dead_one_keep_their_data(tmp_path: Path) -> None:
    asset = Asset()
    asset.accessor(np.arange(16), "u1")
    asset.gltf["bufferViews"].append({"buffer": 0, "byteOffset": 8, "byteLength": 8})
    asset.append("accessors", {"bufferView": 1, "componentType": 5121, "count": 8, "type": "SCALAR"})
    asset.append("meshes", {"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]})
    draft = EditedDocument(written(asset, tmp_path))
    draft.add(np.zeros((1, 3), np.float32), replaces=0)
    write(draft, tmp_path / "out.glb")
    assert read_document(tmp_path / "out.glb").accessor(1).tolist() == list(range(8, 16))


@given(
    shapes=st.lists(
        st.tuples(st.sampled_from(["u1", "u2", "u4", "f4"]), st.integers(1, 4), st.integers(1, 9), st.booleans()),
        min_size=1,
        max_size=6,
    )
)
def test_added_accessors_are_aligned_and_read_back(
    tmp_path_factory: pytest.TempPathFactory, shapes: list[tuple[str, int, int, bool]]
) -> None:
    folder = tmp_path_factory.mktemp("add")
    asset = Asset()
    asset.accessor(np.arange(5), "u1")
    draft = EditedDocument(written(asset, folder))
    added = []
    for dtype, size, count, vertex_data in shapes:
        values = (np.arange(count * size).reshape(count, size) * 3 % 200).astype(f"<{dtype}")
        added.append((draft.add(values, target=VERTEX_DATA if vertex_data else None, bounds=True), values))
    write(draft, folder / "out.glb")
    for document in (draft.document(), read_document(folder / "out.glb")):
        for index, values in added:
            accessor = document.items("accessors")[index]
            view = document.items("bufferViews")[accessor["bufferView"]]
            assert np.array_equal(document.accessor(index).reshape(values.shape), values)
            assert accessor["min"] == values.min(axis=0).tolist()
            assert accessor["max"] == values.max(axis=0).tolist()
            # glTF 2.0 §3.6.2.4: to the component's size; vertex attributes to 4 bytes, strides too.
            assert (view.get("byteOffset", 0) + accessor.get("byteOffset", 0)) % values.itemsize == 0
            if view.get("target") == VERTEX_DATA:
                stride = view.get("byteStride", values.itemsize * values.shape[1])
                assert stride % 4 == 0
                assert view.get("byteOffset", 0) % 4 == 0


@pytest.mark.parametrize("count", [4, 300, 70_000])
@pytest.mark.parametrize("changed", [[0], [1, 3], [0, 1, 2, 3]])
def test_added_sparse_accessor(tmp_path: Path, count: int, changed: list[int]) -> None:
    draft = EditedDocument(written(limb_asset(rings=3, sides=4), tmp_path))
    indices = np.array([*changed[:-1], count - 1 if changed[-1] != 0 else 0])
    values = np.arange(3.0 * len(indices)).reshape(-1, 3).astype(np.float32) - 4
    index = draft.add_sparse(indices, values, count=count, bounds=True)
    write(draft, tmp_path / "out.glb")
    document = read_document(tmp_path / "out.glb")
    wanted = np.zeros((count, 3), np.float32)
    wanted[indices] = values
    accessor = document.items("accessors")[index]
    assert np.array_equal(document.accessor(index), wanted)
    assert accessor["min"] == wanted.min(axis=0).tolist()
    assert accessor["max"] == wanted.max(axis=0).tolist()
    assert "byteOffset" not in accessor
    widest = {4: 5121, 300: 5123, 70_000: 5125}[count if indices[-1] else 4]
    assert accessor["sparse"]["indices"]["componentType"] == widest


@pytest.mark.parametrize("stored", [False, True])
def test_zero_accessors_are_shared_by_count_and_type(tmp_path: Path, stored: bool) -> None:
    draft = EditedDocument(written(Asset(), tmp_path))
    nothing = np.zeros(0, np.intp), np.zeros((0, 3), np.float32)
    first, second, longer = (draft.add_sparse(*nothing, count=n, bounds=True, stored=stored) for n in (5, 5, 6))
    assert first == second != longer
    write(draft, tmp_path / "out.glb")
    document = read_document(tmp_path / "out.glb")
    accessor = document.items("accessors")[first]
    assert ("bufferView" in accessor) == stored
    assert "sparse" not in accessor
    assert accessor["min"] == accessor["max"] == [0.0, 0.0, 0.0]
    assert np.array_equal(document.accessor(longer), np.zeros((6, 3)))


def test_cloned_mesh_shares_accessors_until_one_is_replaced(tmp_path: Path) -> None:
    draft = EditedDocument(_two_meshes(tmp_path))
    clone = draft.clone_mesh(1)
    assert draft.gltf["meshes"][clone] == draft.gltf["meshes"][1]
    assert draft.gltf["meshes"][clone] is not draft.gltf["meshes"][1]
    assert draft.add(np.ones((2, 3), np.float32), replaces=3) == 4
    assert draft.add(np.ones((2, 3), np.float32), replaces=3) == 3


def test_draft_never_writes_to_its_source(tmp_path: Path) -> None:
    source = _two_meshes(tmp_path)
    before = copy.deepcopy(source.gltf)
    draft = EditedDocument(source)
    draft.add(np.ones((2, 3), np.float32), replaces=0)
    draft.clone_mesh(0)
    draft.gltf["meshes"][0]["primitives"].clear()
    write(draft, tmp_path / "out.glb")
    write(draft, tmp_path / "out.gltf")
    assert same_bits(source.gltf, before)


def test_large_data_goes_through_the_disk_unchanged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(edit, "_SPOOL_BYTES", 64)
    draft = EditedDocument(written(Asset(), tmp_path))
    values = np.arange(300, dtype=np.float32)
    index = draft.add(values)
    draft.add(-values)
    write(draft, tmp_path / "out.glb")
    assert np.array_equal(read_document(tmp_path / "out.glb").accessor(index), values)


def test_glb_beyond_4_gib_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "_GLB_LIMIT", 500)
    draft = EditedDocument(written(Asset(), tmp_path))
    draft.add(np.zeros(200, np.float32))
    with pytest.raises(BakeError, match="--frames-dir"):
        write(draft, tmp_path / "out.glb")
    assert not (tmp_path / "out.glb").exists()


# --- Replacing files ---


@pytest.mark.parametrize("fault", ["write", "fsync", "chmod", "replace", "interrupt"])
@pytest.mark.parametrize("existing", [True, False])
def test_failed_write_leaves_the_old_file_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str, existing: bool
) -> None:
    target = tmp_path / "out.glb"
    if existing:
        target.write_bytes(b"old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    def write(file: Any) -> None:
        file.write(b"new")
        if fault == "write":
            fail()
        if fault == "interrupt":
            raise KeyboardInterrupt

    if fault in ("fsync", "chmod", "replace"):
        monkeypatch.setattr(os, fault, fail)
    expected = KeyboardInterrupt if fault == "interrupt" else BakeError
    with pytest.raises(expected) as caught:
        replace_file(str(target), write)
    if fault != "interrupt":
        assert str(caught.value) == f"{target}: cannot be written: No space left on device"
    assert [path.name for path in tmp_path.iterdir()] == (["out.glb"] if existing else [])
    assert not existing or target.read_bytes() == b"old"


@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_failed_bake_keeps_the_old_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    draft = EditedDocument(read_document(limb(tmp_path / "a.glb", rings=3, sides=4)))
    write(draft, tmp_path / f"out.{ending}")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    draft.add(np.ones(3, np.float32))

    def fail(*_: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(BakeError, match="Input/output error"):
        write(draft, tmp_path / f"out.{ending}")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_out_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "folder.glb").mkdir()
    for name in ("missing/out.glb", "folder.glb"):
        with pytest.raises(BakeError, match="cannot be written"):
            replace_bytes(str(tmp_path / name), b"new")
    assert os.listdir(tmp_path) == ["folder.glb"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes into read-only folders")
def test_read_only_folder(tmp_path: Path) -> None:
    (tmp_path / "out.glb").write_bytes(b"old")
    tmp_path.chmod(0o500)
    try:
        with pytest.raises(BakeError, match="cannot be written: Permission denied"):
            replace_bytes(str(tmp_path / "out.glb"), b"new")
    finally:
        tmp_path.chmod(0o700)
    assert (tmp_path / "out.glb").read_bytes() == b"old"


def test_replaced_file_is_as_readable_as_any_other(tmp_path: Path) -> None:
    (tmp_path / "plain").write_bytes(b"")
    assert replace_bytes(str(tmp_path / "new"), b"12345") == 5
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_link_to_an_out_stays_a_link(tmp_path: Path) -> None:
    (tmp_path / "real").write_bytes(b"old")
    (tmp_path / "link").symlink_to("real")
    replace_bytes(str(tmp_path / "link"), b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_bytes() == b"new"


@pytest.mark.parametrize(("count", "dtype"), [(1, "u2"), (65_535, "u2"), (65_536, "u4"), (2**32 - 1, "u4")])
def test_index_type_leaves_out_primitive_restart(count: int, dtype: str) -> None:
    assert index_type(count) == np.dtype(f"<{dtype}")


@pytest.mark.parametrize(("count", "dtype"), [(255, "u1"), (256, "u2"), (65_536, "u4")])
def test_index_type_of_bytes(count: int, dtype: str) -> None:
    assert index_type(count, smallest=np.uint8) == np.dtype(f"<{dtype}")


def test_too_many_vertices_for_indices() -> None:
    with pytest.raises(BakeError, match="4294967296 vertices"):
        index_type(2**32)


def test_vertex_data_constant_is_the_format_s() -> None:
    assert VERTEX_DATA == ARRAY_BUFFER
