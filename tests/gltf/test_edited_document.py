"""Edited documents: replaced data leaves the file, indices keep their meaning, what is added is read back."""

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit.asset import ARRAY_BUFFER, Array, Asset, Json
from kit.clients import assert_valid
from kit.documents import arrays, assert_tight, same_bits, written
from kit.limb import limb_asset
from wrinklecli.choices import Storage
from wrinklecli.errors import BakeError
from wrinklecli.gltf import new_data
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.edited_document import VERTEX_DATA, EditedDocument, index_type
from wrinklecli.gltf.writer import write


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
    edited = EditedDocument(source)
    fresh = {index: np.full((3, 3), 10 + index, np.float32) for index in replaced}
    for index, values in fresh.items():
        assert edited.add(values, replaces=index) == index
    write(edited, tmp_path / "out.glb")
    result = read_document(tmp_path / "out.glb")
    assert len(result.items("bufferViews")) == 4
    for index in range(4):
        assert np.array_equal(result.accessor(index), fresh.get(index, source.accessor(index)))
        assert result.items("accessors")[index]["extras"] == {"k": index}
    assert_tight(tmp_path / "out.glb", replaced=len(replaced))
    write(edited, tmp_path / "out.gltf")
    sizes = sum(file.stat().st_size for file in tmp_path.glob("out-*.bin"))
    # 36 bytes for each new one, 15 for each that is kept, and alignment as in `assert_tight`.
    assert sizes <= 36 * len(replaced) + 15 * (4 - len(replaced)) + 3 * (4 + 2 * len(replaced))
    assert all(
        np.array_equal(a, b) for a, b in zip(arrays(read_document(tmp_path / "out.gltf")), arrays(result), strict=True)
    )


def test_shared_accessor_is_replaced_only_with_its_last_reference(tmp_path: Path) -> None:
    source = _two_meshes(tmp_path)
    edited = EditedDocument(source)
    first = edited.add(np.ones((3, 3), np.float32), replaces=1)
    second = edited.add(np.ones((4, 3), np.float32), replaces=1)
    assert first == 4
    assert second == 1
    write(edited, tmp_path / "out.glb")
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
    edited = EditedDocument(source)
    assert edited.add(np.ones((3, 3), np.float32), replaces=0) == 1
    write(edited, tmp_path / "out.glb")
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
    edited = EditedDocument(written(asset, tmp_path))
    assert edited.add(np.ones((3, 3), np.float32), replaces=0) == 0
    write(edited, tmp_path / "out.glb")
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
        edited = EditedDocument(source)
        for index in dead:
            edited.add(np.ones(2, np.float32), replaces=index)
        write(edited, tmp_path / f"out.{ending}")
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
    edited = EditedDocument(source)
    edited.add(rows.astype(np.float32)[:2], replaces=position)
    write(edited, tmp_path / "half.glb")
    assert np.array_equal(read_document(tmp_path / "half.glb").accessor(normal), -rows)
    edited.add(rows.astype(np.float32)[:2], replaces=normal)
    write(edited, tmp_path / "out.glb")
    assert read_document(tmp_path / "out.glb").accessor(position).shape == (2, 3)
    assert_tight(tmp_path / "out.glb", replaced=1)


@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_sparse_accessor_replaced_by_a_dense_one_leaves_valid_views(tmp_path: Path, ending: str) -> None:
    """Of the three views of a sparse accessor two have no successor: whatever they become must lie in a buffer."""
    asset = Asset()
    asset.sparse(np.ones((400, 3)), base=True)
    asset.append("meshes", {"primitives": [{"attributes": {"POSITION": 0}}]})
    edited = EditedDocument(written(asset, tmp_path))
    assert edited.add(np.ones((2, 3), np.float32), replaces=0) == 0
    write(edited, tmp_path / f"out.{ending}")
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
    edited = EditedDocument(written(asset, tmp_path))
    edited.add(np.zeros((1, 3), np.float32), replaces=0)
    write(edited, tmp_path / "out.glb")
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
    edited = EditedDocument(written(asset, folder))
    added = []
    for dtype, size, count, vertex_data in shapes:
        values = (np.arange(count * size).reshape(count, size) * 3 % 200).astype(f"<{dtype}")
        added.append((edited.add(values, target=VERTEX_DATA if vertex_data else None, bounds=True), values))
    write(edited, folder / "out.glb")
    for document in (edited.document(), read_document(folder / "out.glb")):
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


def _deltas(document: EditedDocument, vertices: list[int], count: int, **options: Any) -> tuple[int, Array]:
    """Deltas added at some of so many vertices: the accessor, and what it should hold."""
    deltas = np.arange(1.0, 3.0 * len(vertices) + 1).reshape(-1, 3) - 1000
    wanted = np.zeros((count, 3), np.float32)
    wanted[vertices] = deltas
    return document.add_deltas(np.array(vertices, np.intp), deltas, count=count, bounds=True, **options), wanted


@pytest.mark.quick(12)
@pytest.mark.parametrize("storage", ["sparse", "dense", "based"])
@pytest.mark.parametrize("count", [4, 300, 70_000])
@pytest.mark.parametrize("changed", [[0], [1, -1], [0, 1, 2, -1], []])
def test_added_deltas(tmp_path: Path, count: int, changed: list[int], storage: Storage) -> None:
    document = EditedDocument(written(limb_asset(rings=3, sides=4), tmp_path), storage=storage)
    vertices = [vertex % count for vertex in changed]
    index, wanted = _deltas(document, vertices, count)
    write(document, tmp_path / "out.glb")
    read = read_document(tmp_path / "out.glb")
    accessor = read.items("accessors")[index]
    assert np.array_equal(read.accessor(index), wanted)
    assert accessor["min"] == wanted.min(axis=0).tolist()
    assert accessor["max"] == wanted.max(axis=0).tolist()
    few = changed != [] and count > 4
    assert ("sparse" in accessor) == ((few and storage != "dense") or (changed == [] and storage == "sparse"))
    assert ("bufferView" in accessor) == (storage != "sparse" or "sparse" not in accessor)
    if few and "sparse" in accessor:
        widest = {1: 5121, 300: 5123, 70_000: 5125}[count if changed[-1] else 1]
        assert accessor["sparse"]["indices"]["componentType"] == widest
    assert_valid(tmp_path / "out.glb")


@pytest.mark.parametrize(("changed", "sparse"), [(10, True), (215, True), (228, False), (250, False)])
def test_deltas_are_stored_as_takes_less(tmp_path: Path, changed: int, sparse: bool) -> None:
    """Twelve bytes each, and one for an index below 255; as in the file, JSON counted."""
    sizes = {}
    for storage in ("sparse", "dense"):
        document = EditedDocument(written(limb_asset(rings=3, sides=4), tmp_path), storage=storage)
        index, _ = _deltas(document, list(range(changed)), 250)
        sizes[storage] = write(document, tmp_path / "out.glb")
        if storage == "sparse":
            assert ("sparse" in document.gltf["accessors"][index]) == sparse
    assert (sizes["sparse"] < sizes["dense"]) == sparse


def test_deltas_of_zero_are_not_stored(tmp_path: Path) -> None:
    document = EditedDocument(written(limb_asset(rings=3, sides=4), tmp_path))
    deltas = np.zeros((300, 3))
    deltas[[7, 9], 1] = 1.0
    index = document.add_deltas(np.arange(300), deltas, count=300)
    assert document.gltf["accessors"][index]["sparse"]["count"] == 2


@pytest.mark.parametrize("storage", ["sparse", "dense", "based"])
def test_zero_accessors_are_shared_by_count_and_type(tmp_path: Path, storage: Storage) -> None:
    document = EditedDocument(written(Asset(), tmp_path), storage=storage)
    nothing = np.zeros(0, np.intp), np.zeros((0, 3))
    first, second, longer = (document.add_deltas(*nothing, count=count, bounds=True) for count in (5, 5, 6))
    assert first == second != longer
    write(document, tmp_path / "out.glb")
    read = read_document(tmp_path / "out.glb")
    accessor = read.items("accessors")[first]
    assert ("bufferView" in accessor) == (storage != "sparse")
    assert ("sparse" in accessor) == (storage == "sparse")
    assert accessor["min"] == accessor["max"] == [0.0, 0.0, 0.0]
    assert np.array_equal(read.accessor(longer), np.zeros((6, 3)))


@pytest.mark.parametrize("storage", ["sparse", "dense", "based"])
def test_accessors_that_zeros_replace_leave_no_data(tmp_path: Path, storage: Storage) -> None:
    """Their numbers go to what is added next; what is left over is zeros too."""
    asset = Asset()
    old = [asset.accessor(np.full((9, 3), float(number + 1))) for number in range(4)]
    document = EditedDocument(written(asset, tmp_path), storage=storage)
    shared = [document.add_deltas(np.arange(9), np.zeros((9, 3)), count=9, replaces=number) for number in old]
    assert len(set(shared)) == 1
    added = document.add(np.ones((2, 3), np.float32))
    write(document, tmp_path / "out.glb")
    read = read_document(tmp_path / "out.glb")
    assert len(read.items("accessors")) == 4
    for index in range(4):
        assert read.accessor(index).any() == (index == added)
    assert len(read.buffers[0]) < 9 * 12 + 2 * 12 + 4 * len(read.items("bufferViews"))
    assert_valid(tmp_path / "out.glb")


def test_zeros_below_deltas_grow_with_the_longest_and_stay_behind_all_data(tmp_path: Path) -> None:
    document = EditedDocument(written(Asset(), tmp_path), storage="based")
    added = [_deltas(document, [3, 7], count) for count in (100, 400, 200)]
    for read in (document.document(), document.document()):
        for index, wanted in added:
            assert np.array_equal(read.accessor(index), wanted)
    write(document, tmp_path / "out.glb")
    read = read_document(tmp_path / "out.glb")
    assert {each["bufferView"] for each in read.items("accessors")} == {0}
    assert (read.items("bufferViews")[0]["byteLength"], read.items("bufferViews")[0]["byteStride"]) == (4800, 12)
    for index, wanted in added:
        assert np.array_equal(read.accessor(index), wanted)
    assert_valid(tmp_path / "out.glb")


def test_cloned_mesh_shares_accessors_until_one_is_replaced(tmp_path: Path) -> None:
    edited = EditedDocument(_two_meshes(tmp_path))
    clone = edited.clone_mesh(1)
    assert edited.gltf["meshes"][clone] == edited.gltf["meshes"][1]
    assert edited.gltf["meshes"][clone] is not edited.gltf["meshes"][1]
    assert edited.add(np.ones((2, 3), np.float32), replaces=3) == 4
    assert edited.add(np.ones((2, 3), np.float32), replaces=3) == 3


def test_edited_document_never_writes_to_its_source(tmp_path: Path) -> None:
    source = _two_meshes(tmp_path)
    before = copy.deepcopy(source.gltf)
    edited = EditedDocument(source)
    edited.add(np.ones((2, 3), np.float32), replaces=0)
    edited.clone_mesh(0)
    edited.gltf["meshes"][0]["primitives"].clear()
    write(edited, tmp_path / "out.glb")
    write(edited, tmp_path / "out.gltf")
    assert same_bits(source.gltf, before)


def test_large_data_goes_through_the_disk_unchanged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(new_data, "_SPOOL_BYTES", 64)
    edited = EditedDocument(written(Asset(), tmp_path))
    values = np.arange(300, dtype=np.float32)
    index = edited.add(values)
    edited.add(-values)
    write(edited, tmp_path / "out.glb")
    assert np.array_equal(read_document(tmp_path / "out.glb").accessor(index), values)


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
