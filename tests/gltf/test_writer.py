"""Written files: what is not set is kept, data moves but is the same, images follow, nothing half-written is left."""

import base64
import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.asset import Asset, Json, pack_glb
from kit.documents import arrays, same_bits, written
from kit.drawn import CHARACTERS
from kit.limb import limb, limb_asset
from wrinklecli.errors import AssetError, BakeError
from wrinklecli.files.outputs import Outputs
from wrinklecli.gltf import writer
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edited_document import VERTEX_DATA, EditedDocument
from wrinklecli.gltf.images import image_files
from wrinklecli.gltf.writer import write

PNG = b"\x89PNG\r\n\x1a\n" + bytes(9)
JPEG = b"\xff\xd8\xff\xe0" + bytes(7)

json_scalars = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(CHARACTERS, max_size=9)
)
json_values = st.recursive(
    json_scalars,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(CHARACTERS, max_size=5), inner, max_size=3),
)


@given(extras=json_values, unknown=json_values, name=st.text(CHARACTERS, max_size=9))
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


@pytest.mark.parametrize("depth", [50, 255, 256, 900, 100_000])
def test_deep_json_is_read_and_written_or_refused(tmp_path: Path, depth: int) -> None:
    text = b'{"asset": {"version": "2.0"}, "extras": ' + b"[" * depth + b"]" * depth + b"}"
    (tmp_path / "a.gltf").write_bytes(text)
    faults = []
    try:
        edited = EditedDocument(read_document(tmp_path / "a.gltf"))
        write(edited, tmp_path / "b.glb")
    except AssetError as error:
        faults.append(str(error))
    assert bool(faults) == (depth > 255), "with the document itself there may be 256 levels"
    if faults:
        assert "nested" in faults[0]
    else:
        assert read_document(tmp_path / "b.glb").gltf["extras"] == edited.source.gltf["extras"]


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
    edited = EditedDocument(source)
    fresh = np.arange(12, dtype=np.float32).reshape(4, 3)
    added = edited.add(fresh, target=VERTEX_DATA, bounds=True)
    write(edited, tmp_path / name)
    result = read_document(tmp_path / name)
    assert len(result.items("buffers")) == (1 if name.endswith(".glb") else 4)
    for index, expected in enumerate(arrays(source)):
        assert np.array_equal(result.accessor(index), expected)
    assert np.array_equal(result.accessor(added), fresh)
    assert all(view["name"] == "v" for view in result.items("bufferViews")[:4])
    assert all(Path(file).parent == (tmp_path / name).parent for file in result.files)


def test_gltf_beside_its_source_shares_its_buffers(tmp_path: Path) -> None:
    edited = EditedDocument(read_document(_three_buffers(tmp_path)))
    edited.add(np.arange(3, dtype=np.float32))
    before = set(os.listdir(tmp_path))
    write(edited, tmp_path / "out.gltf")
    fresh = set(os.listdir(tmp_path)) - before - {"out.gltf"}
    assert len(fresh) == 1
    assert next(iter(fresh)).startswith("out-")
    uris = [buffer["uri"] for buffer in json.loads((tmp_path / "out.gltf").read_text())["buffers"]]
    assert uris[:2] == ["b0.bin", "b1.bin"]


def test_gltf_out_of_a_name_with_reserved_characters(tmp_path: Path) -> None:
    edited = EditedDocument(read_document(limb(tmp_path / "a.glb", rings=4, sides=4)))
    write(edited, tmp_path / "ä #1%20.gltf")
    result = read_document(tmp_path / "ä #1%20.gltf")
    assert quote("ä #1%20") in result.items("buffers")[0]["uri"]
    assert all(np.array_equal(a, b) for a, b in zip(arrays(result), arrays(edited.source), strict=True))


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
    edited = EditedDocument(written(asset, inside, "a.gltf"))
    read = image_files(edited.source, out / f"o.{ending}")
    write(edited, out / f"o.{ending}")
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
    edited = EditedDocument(written(asset, tmp_path, "a.gltf"))
    with pytest.raises(AssetError, match=r"#/images/0: cannot be read"):
        write(edited, tmp_path / "out" / "o.glb")
    assert os.listdir(tmp_path / "out") == []


def test_glb_beyond_4_gib_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(writer, "GLB_LIMIT", 500)
    edited = EditedDocument(written(Asset(), tmp_path))
    edited.add(np.zeros(200, np.float32))
    with pytest.raises(BakeError, match="--frames-dir"):
        write(edited, tmp_path / "out.glb")
    assert not (tmp_path / "out.glb").exists()


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize("before", [None, 0, 1])
def test_bakes_to_one_gltf_at_once_leave_one_of_them_whole(
    tmp_path: Path, order: tuple[int, int], before: int | None
) -> None:
    """Whichever ends first, and whichever OUT is from before."""
    source = limb(tmp_path / "a.glb", rings=3, sides=4)

    def edited(number: int) -> EditedDocument:
        made = EditedDocument(read_document(source))
        made.add(np.full(3, number, np.float32))
        return made

    out = tmp_path / "out.gltf"
    if before is not None:
        write(edited(before), out)
    runs = [Outputs(), Outputs()]
    for number, outputs in enumerate(runs):
        write(edited(number), out, outputs=outputs)
    for number in order:
        with runs[number]:
            pass
        found, wanted = read_document(out), edited(number)
        assert found.buffers[-1][: wanted.new_size] == b"".join(wanted.new_data())
    named = {each["uri"] for each in json.loads(out.read_text())["buffers"]}
    assert named == {path.name for path in tmp_path.glob("*.bin")}


@pytest.mark.parametrize("same", [True, False])
def test_an_image_that_another_bake_has_put_meanwhile_stays(tmp_path: Path, same: bool) -> None:
    """Its name is taken then, as if that bake had ended before this one began."""
    (tmp_path / "out").mkdir()
    runs = [Outputs(), Outputs()]
    for number, outputs in enumerate(runs):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "skin.png").write_bytes(PNG + bytes([0 if same else number]))
        asset = limb_asset(rings=4, sides=4)
        asset.gltf["images"] = [{"uri": "skin.png"}]
        edited = EditedDocument(written(asset, tmp_path / str(number), "a.gltf"))
        write(edited, tmp_path / "out" / f"{number}.gltf", outputs=outputs)
    with runs[0]:
        pass
    before = {*os.listdir(tmp_path / "out")}
    if same:
        with runs[1]:
            pass
        return
    with pytest.raises(BakeError, match=r"skin\.png: is there already and is another image"), runs[1]:
        pass
    assert {*os.listdir(tmp_path / "out")} < before, "the folder of the second run is gone"
    assert (tmp_path / "out" / "skin.png").read_bytes() == PNG + b"\0"


@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_failed_bake_keeps_the_old_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str) -> None:
    edited = EditedDocument(read_document(limb(tmp_path / "a.glb", rings=3, sides=4)))
    write(edited, tmp_path / f"out.{ending}")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    edited.add(np.ones(3, np.float32))

    def fail(*_: object) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(BakeError, match="Input/output error"):
        write(edited, tmp_path / f"out.{ending}")
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_the_binary_chunk_keeps_its_buffer_s_extensions_beside_a_fallback(tmp_path: Path) -> None:
    """Only a fallback of compressed views becomes a plain buffer when it is the chunk itself."""
    (tmp_path / "a.bin").write_bytes(bytes(8))
    known, fallback = {"VENDOR_key": {"number": 1}}, {"EXT_meshopt_compression": {"fallback": True}}
    buffers = [
        {"uri": "a.bin", "byteLength": 8, "extensions": known},
        {"uri": "a.bin", "byteLength": 8, "extensions": fallback},
    ]
    (tmp_path / "in.gltf").write_text(json.dumps({"asset": {"version": "2.0"}, "buffers": buffers}))
    write(EditedDocument(read_document(tmp_path / "in.gltf")), tmp_path / "out.glb")
    found = read_document(tmp_path / "out.glb").gltf["buffers"]
    assert found[0]["extensions"] == known
