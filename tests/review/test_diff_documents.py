"""Golden tests: every kind of change of a document is found and named, and what means the same is the same."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from kit.asset import Asset, attribute, stored
from kit.changes import (
    PRIMITIVE,
    added_node,
    bent_normal,
    changed_key,
    compared,
    copyright_line,
    defaults_written_out,
    double_sided,
    dropped_channel,
    dropped_clip,
    dropped_target,
    extension_used,
    extras_item,
    extras_key,
    extras_number,
    flipped_triangle,
    fold,
    further_joint,
    future_key,
    hidden_in_scene,
    idle_target,
    image_byte,
    lens,
    longer_clip,
    material_extension,
    material_factor,
    matrix_for_transform,
    mixed_accessors,
    mixed_joints,
    mixed_kinds,
    mixed_nodes,
    moved_bind,
    moved_key,
    moved_node,
    moved_vertex,
    node,
    opposite_quaternions,
    other_colour,
    other_delta,
    other_generator,
    other_id,
    other_material,
    other_skeleton,
    other_uv,
    other_weight,
    pointer_channel,
    redundant_keys,
    renamed_clip,
    renamed_node,
    renamed_target,
    reparented_node,
    rewritten,
    sampler_filter,
    spare_material,
    spare_skin,
    stepped,
    stored_weight,
    swapped_images,
    swapped_joints,
    texture_transform,
    turned_node,
    weight_key,
    weights_on_the_node,
    without_camera,
)
from kit.variants import PICTURE, rich
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.writer import write
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.diff.diff import diff
from wrinklecli.review.diff.difference import Limits
from wrinklecli.review.diff.nodes import pair_nodes
from wrinklecli.tools.records import Length

Json = dict[str, Any]


# What is changed, where it is said to differ, and what is said of it.
CHANGES: list[tuple[Callable[[Asset], None], str, str]] = [
    (further_joint, "/skins/0/joints/3", "none -> "),
    (moved_vertex, f"{PRIMITIVE}/attributes/POSITION", "vertex 17 is 0.01 off"),
    (bent_normal, f"{PRIMITIVE}/attributes/NORMAL", "vertex 5"),
    (other_uv, f"{PRIMITIVE}/attributes/TEXCOORD_0", "vertex 6 differs by 0.001"),
    (other_id, "/meshes/1/primitives/0/attributes/_ID", "vertex 2 differs by 1"),
    (other_colour, f"{PRIMITIVE}/attributes/COLOR_0", "vertex 3 differs by 0.00392"),
    (flipped_triangle, "/meshes/1/primitives/0/indices", "index 1: 1 -> 2"),
    (other_weight, f"{PRIMITIVE}/attributes/WEIGHTS_0", "differs by 0.01"),
    (other_delta, f"{PRIMITIVE}/targets/1/POSITION", "vertex 40 is 0.01 off"),
    (renamed_target, "/meshes/0/extras/targetNames/1", "'morph_1' -> 'frown'"),
    (dropped_target, f"{PRIMITIVE}/targets", "2 -> 1 morph targets"),
    (stored_weight, "/nodes/0/weights", "[0.25, 0.25] -> [0.25, 0.35]"),
    (renamed_node, "/nodes/2/name", "'joint_1' -> 'elbow'"),
    (moved_node, "/nodes/4/translation", "[0.0, 0.0, 0.0] -> [0.0, 0.5, 0.0]"),
    (turned_node, "/nodes/4/rotation", "[0.0, 0.6, 0.0, 0.8]"),
    (reparented_node, "/nodes/4", "parent none -> 'joint_0'"),
    (added_node, "/nodes/5", "only in B"),
    (without_camera, "/nodes/4/camera", "only in A"),
    (hidden_in_scene, "/scenes/0/nodes", "'hat' only in A"),
    (
        material_factor,
        "/materials/0/pbrMetallicRoughness/baseColorFactor",
        "[0.8, 0.5, 0.4, 1.0] -> [0.8, 0.6, 0.4, 1.0]",
    ),
    (material_extension, "/materials/1/extensions/KHR_materials_clearcoat/clearcoatFactor", "0.25 -> 0.3"),
    (
        texture_transform,
        "/materials/1/pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform/scale",
        "[2, 2] -> [2, 3]",
    ),
    (double_sided, "/materials/1/doubleSided", "False -> True"),
    (other_material, "/materials/0/name", "'skin' -> 'spare'"),
    (image_byte, "/images/0", "other bytes (208 -> 208)"),
    (swapped_images, "/images/0", "other bytes"),
    (sampler_filter, "/samplers/0/magFilter", "9729 -> 9728"),
    (spare_material, "/materials/2/alphaMode", "'OPAQUE' -> 'BLEND'"),
    (dropped_clip, "/animations/1", "only in A"),
    (renamed_clip, "/animations/1/name", "'nod' -> 'shake'"),
    (changed_key, "/animations/0/channels/0", "rotation of 'joint_1' differs by"),
    (moved_key, "/animations/0/channels/0", "rotation of 'joint_1' differs by"),
    (longer_clip, "/animations/1", "0 to 2 s -> 0 to 3 s"),
    (weight_key, "/animations/0/channels/2", "weights of 'limb' (number 1) differs by 0.125"),
    (stepped, "/animations/0/channels/0", "rotation of 'joint_1' differs by"),
    (dropped_channel, "/animations/0/channels/0", "rotation of 'joint_1': only in A"),
    (swapped_joints, "/skins/0/joints/1", "'joint_1' -> 'joint_2'"),
    (moved_bind, "/skins/0/inverseBindMatrices/1", "joint 'joint_1' differs by up to 0.01"),
    (spare_skin, "/skins/1", "only in B"),
    (other_skeleton, "/skins/0/skeleton", "another node"),
    (extras_number, "/nodes/4/extras/price", "3.5 -> 3.6"),
    (extras_item, "/nodes/4/extras/tags", "1 -> 2 items"),
    (extras_key, "/extras/more", "None only in B"),
    (copyright_line, "/asset/copyright", "'someone' -> 'no one'"),
    (lens, "/cameras/0/perspective/yfov", "0.8 -> 0.9"),
    (future_key, "/futureKey", "only in B"),
    (extension_used, "/extensionsUsed", "'VENDOR_unheard_of' only in B"),
    (pointer_channel, "/animations/0/channels", "0 -> 1 channels that move no node"),
]


@pytest.mark.quick(5, 13)
@pytest.mark.parametrize(("change", "place", "message"), CHANGES, ids=lambda each: getattr(each, "__name__", ""))
def test_every_change_is_found_and_named(
    tmp_path: Path, change: Callable[[Asset], None], place: str, message: str
) -> None:
    before, after = rich(), rich()
    change(after)
    found = compared(tmp_path, before, after)
    assert not found.same
    documents = [each for each in found.differences if each.kind != "pose"]
    assert [each.place for each in documents].count(place) >= 1, documents
    assert any(each.place == place and message in each.message for each in documents), documents
    # What follows from the change may be said too, but not a flood of it.
    assert len(documents) <= 5
    assert len(set(found.differences)) == len(found.differences)
    back = compared(tmp_path, after, before)
    assert not back.same


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("change", "place", "message"),
    [
        (dropped_clip, "/animations/1", "only in B"),
        (dropped_channel, "/animations/0/channels/0", "rotation of 'joint_1': only in B"),
        (hidden_in_scene, "/scenes/0/nodes", "'hat' only in B"),
        (without_camera, "/nodes/4/camera", "only in B"),
        (added_node, "/nodes/5", "only in A"),
        (spare_skin, "/skins/1", "only in A"),
        (double_sided, "/materials/1/doubleSided", "True -> False"),
    ],
    ids=lambda each: getattr(each, "__name__", ""),
)
def test_what_only_the_second_has_is_said_of_it(
    tmp_path: Path, change: Callable[[Asset], None], place: str, message: str
) -> None:
    before, after = rich(), rich()
    change(before)
    found = [each for each in compared(tmp_path, before, after).differences if each.kind != "pose"]
    assert [(each.place, each.message) for each in found] == [(place, message)]


def test_a_branch_that_only_one_has_is_said_once(tmp_path: Path) -> None:
    before, after = rich(), rich()
    leaf = after.append("nodes", {"name": "leaf"})
    twig = after.append("nodes", {"name": "twig", "children": [leaf]})
    node(after, "joint_0")["children"].append(twig)
    (found,) = compared(tmp_path, before, after).differences
    assert (found.place, found.name, found.message) == (f"/nodes/{twig}", "twig", "only in B")


def test_what_nothing_refers_to_is_compared_too(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset, joint in ((before, 2), (after, 3)):
        asset.append("skins", {"name": "spare", "joints": [joint]})
        asset.append("cameras", {"type": "perspective", "perspective": {"yfov": joint, "znear": 1}})
    found = {each.place for each in compared(tmp_path, before, after).differences}
    assert found == {"/skins/1/joints/0", "/cameras/1/perspective/yfov"}


def test_a_change_is_said_of_the_thing_by_its_name(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for change in (moved_vertex, material_factor, image_byte, changed_key, renamed_node, other_delta):
        change(after)
    names = {each.place: each.name for each in compared(tmp_path, before, after).differences if each.kind != "pose"}
    assert names == {
        f"{PRIMITIVE}/attributes/POSITION": "limb",
        f"{PRIMITIVE}/targets/1/POSITION": "limb, morph_1",
        "/materials/0/pbrMetallicRoughness/baseColorFactor": "skin",
        "/images/0": "felt",
        "/animations/0/channels/0": "fold",
        "/nodes/2/name": "joint_1",
    }


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("first", ["leaf", "twig"])
def test_a_node_that_was_renamed_is_not_one_that_was_moved(tmp_path: Path, first: str, back: bool) -> None:
    """Of two alike, one moves below another and one gets a new name: each is found again, in whatever order."""
    before, after = rich(), rich()
    for asset, names in ((before, ("leaf", "twig")), (after, ("leaf", "bough"))):
        order = names if first == "leaf" else names[::-1]
        asset.gltf["scenes"][0]["nodes"] += [asset.append("nodes", {"name": name}) for name in order]
    leaf = after.gltf["nodes"].index(node(after, "leaf"))
    after.gltf["scenes"][0]["nodes"].remove(leaf)
    node(after, "joint_2")["children"] = [leaf]
    said = {each.message for each in compared(tmp_path, *((after, before) if back else (before, after))).differences}
    changes = ("'joint_2'", "none"), ("'bough'", "'twig'")
    parent, name = (" -> ".join(pair if back else pair[::-1]) for pair in changes)
    assert {f"parent {parent}", name} <= said
    assert not [message for message in said if message.startswith("only in")]


# Harmless changes


HARMLESS = [
    matrix_for_transform,
    mixed_accessors,
    mixed_nodes,
    mixed_joints,
    mixed_kinds,
    other_generator,
    defaults_written_out,
    opposite_quaternions,
    redundant_keys,
    weights_on_the_node,
    idle_target,
]


@pytest.mark.quick(2)
@pytest.mark.parametrize("change", HARMLESS, ids=lambda each: each.__name__)
def test_what_means_the_same_is_the_same(tmp_path: Path, change: Callable[[Asset], None]) -> None:
    before, after = rich(), rich()
    change(after)
    assert before.glb() != after.glb()
    found = compared(tmp_path, before, after)
    assert found.same, found.differences
    assert found.worst is not None
    assert found.worst.distance <= found.tolerance
    assert compared(tmp_path, after, before).same


@pytest.mark.parametrize(
    "options",
    [
        {"sparse": "base"},
        {"sparse": "zeros"},
        {"interleave": True},
        {"indices": "u4"},
        {"influences": 8},
        {"indices": "u1", "rings": 7, "sides": 6},
    ],
    ids=str,
)
def test_how_numbers_are_stored_makes_no_difference(tmp_path: Path, options: Json) -> None:
    plain = {key: value for key, value in options.items() if key in ("rings", "sides")}
    before, after = rich(**plain), rich(**options)
    assert before.glb() != after.glb()
    assert compared(tmp_path, before, after).same


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
def test_a_document_written_again_is_the_same(tmp_path: Path, suffix: str) -> None:
    path = rich().write(tmp_path / "a.glb")
    assert diff(path, rewritten(tmp_path, path, suffix=suffix)).same


@pytest.mark.parametrize("buffer", ["file", "data", "percent", "folder"])
def test_a_gltf_is_the_same_as_its_glb(tmp_path: Path, buffer: Any) -> None:
    asset = rich()
    path, other = asset.write(tmp_path / "a.glb"), asset.write(tmp_path / "b.gltf", buffer=buffer)
    assert diff(path, other).same


def test_an_image_in_a_file_is_the_same_as_one_in_a_view(tmp_path: Path) -> None:
    before, after = rich(), rich()
    (tmp_path / "felt.png").write_bytes(PICTURE)
    after.gltf["images"][0] = {"name": "felt", "uri": "felt.png"}
    assert compared(tmp_path, before, after).same
    (tmp_path / "felt.png").write_bytes(PICTURE[:-1])
    (difference,) = compared(tmp_path, before, after).differences
    assert (difference.kind, difference.place) == ("image", "/images/0")


@pytest.mark.parametrize("name", ["gltfpack_c.glb", "gltf_transform_draco.glb"])
def test_a_compressed_file_is_the_same_as_itself_decompressed(tmp_path: Path, name: str) -> None:
    path = Path(__file__).parents[1] / "data" / name
    document = read_document(path)
    edited = EditedDocument(document)
    for mesh in edited.gltf["meshes"]:
        for primitive in mesh["primitives"]:
            edited.unpack(primitive)
    made = tmp_path / name
    write(edited, made)
    assert diff(path, made).same


def test_extensions_that_store_data_are_not_compared(tmp_path: Path) -> None:
    before, after = rich(), rich()
    after.gltf["extensionsUsed"] += ["EXT_meshopt_compression"]
    after.gltf["bufferViews"][0]["extensions"] = {}
    assert compared(tmp_path, before, after).same


def test_no_number_at_all_is_the_same_as_itself(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset in (before, after):
        attribute(asset, 0, "TEXCOORD_0")[0] = np.nan
    assert compared(tmp_path, before, after).same
    attribute(after, 0, "TEXCOORD_0")[0] = 0.0
    (difference,) = compared(tmp_path, before, after).differences
    assert difference.place == f"{PRIMITIVE}/attributes/TEXCOORD_0"


# Tolerance


@given(
    st.floats(1e-9, 10.0),
    st.floats(1e-9, 1e-2),
    arrays(np.float64, st.integers(0, 4), elements=st.floats(-1e3, 1e3)),
)
def test_numbers_have_the_slack_of_their_size_and_lengths_that_of_the_asset(
    length: float, ratio: float, values: Floats
) -> None:
    limits, most = Limits(length, ratio), float(np.abs(values).max(initial=1.0))
    assert limits.slack(values) == pytest.approx(ratio * most)
    assert limits.slack(values, lengths=True) == pytest.approx(max(length, ratio * most))


@given(st.floats(-1e6, 1e6), st.floats(1e-9, 1e-2), st.integers(-(10**6), 10**6))
def test_numbers_are_apart_by_more_than_a_ratio_of_their_size_and_counts_by_one(
    number: float, ratio: float, count: int
) -> None:
    limits, slack = Limits(1.0, ratio), ratio * max(1.0, abs(number))
    assert not limits.are_apart(number, number + 0.9 * slack)
    assert limits.are_apart(number, number + 1.1 * slack)
    assert limits.are_apart(count, count + 1)
    assert not limits.are_apart(count, count)


def test_numbers_that_are_no_lengths_may_differ_by_the_same_share(tmp_path: Path) -> None:
    before, after = rich(), rich()
    after.gltf["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][0] += 0.009
    node(after, "hat")["extras"]["price"] += 0.03
    stored(after, fold(after)["samplers"][0]["output"])[1, 2] += 0.009
    attribute(after, 0, "TEXCOORD_0")[7] += np.float32(0.009)
    assert compared(tmp_path, before, after, tolerance=Length(1.0, percent=True), clips=["nod"]).same
    places = {each.place for each in compared(tmp_path, before, after, tolerance=Length(0.5, percent=True)).differences}
    assert places >= {
        "/materials/0/pbrMetallicRoughness/baseColorFactor",
        "/nodes/4/extras/price",
        "/animations/0/channels/0",
        f"{PRIMITIVE}/attributes/TEXCOORD_0",
    }


@pytest.mark.parametrize("change", [other_id, flipped_triangle, sampler_filter, texture_transform, image_byte])
def test_whole_numbers_are_the_same_or_not(tmp_path: Path, change: Callable[[Asset], None]) -> None:
    before, after = rich(), rich()
    change(after)
    assert not compared(tmp_path, before, after, tolerance=Length(100.0, percent=True)).same


def joint_twice(asset: Asset) -> None:
    skin = asset.gltf["skins"][0]
    skin["joints"].append(skin["joints"][0])
    del skin["inverseBindMatrices"]


def channel_twice(asset: Asset) -> None:
    animation = fold(asset)
    animation["channels"].append(animation["channels"][0])


def texture_of_nothing(asset: Asset) -> None:
    asset.gltf["textures"][0] |= {"source": 9, "sampler": -1}
    asset.gltf["meshes"][1]["primitives"][0]["material"] = 9
    asset.gltf["skins"][0]["skeleton"] = 99


def index_of_nothing(asset: Asset) -> None:
    stored(asset, asset.gltf["meshes"][1]["primitives"][0]["indices"])[0] = 99


def joint_of_nothing(asset: Asset) -> None:
    attribute(asset, 0, "JOINTS_0")[:] = 99


def unreadable(*pointer: str | int) -> Callable[[Asset], None]:
    """A change to an accessor that a pointer into the JSON leads to: no reader knows its type."""

    def change(asset: Asset) -> None:
        index: Any = asset.gltf
        for key in pointer:
            index = index[key]
        asset.gltf["accessors"][index]["componentType"] = 5124

    change.__name__ = f"unreadable_{pointer[-1]}"
    return change


UNREADABLE = [
    unreadable("meshes", 0, "primitives", 0, "attributes", "POSITION"),
    unreadable("meshes", 0, "primitives", 0, "attributes", "TEXCOORD_0"),
    unreadable("meshes", 0, "primitives", 0, "attributes", "JOINTS_0"),
    unreadable("meshes", 0, "primitives", 0, "targets", 0, "POSITION"),
    unreadable("meshes", 0, "primitives", 0, "indices"),
    unreadable("skins", 0, "inverseBindMatrices"),
]


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "change",
    [joint_twice, channel_twice, texture_of_nothing, index_of_nothing, joint_of_nothing, *UNREADABLE],
)
def test_what_no_valid_file_has_is_the_same_as_itself(change: Callable[[Asset], None], tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset in (before, after):
        change(asset)
    assert list(compared(tmp_path, before, after).lines()) == ["same: to the byte"]
    after.gltf["asset"]["generator"] = "another"
    assert compared(tmp_path, before, after).same


def test_images_that_are_missing_are_compared_by_name(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset in (before, after):
        asset.gltf["images"][0] = {"uri": "gone.png"}
    after.gltf["asset"]["generator"] = "another"
    assert compared(tmp_path, before, after).same
    after.gltf["images"][0]["uri"] = "lost.png"
    (found,) = compared(tmp_path, before, after).differences
    assert (found.place, found.message) == ("/images/0", "other files, which cannot be read")


def test_a_reference_to_nothing_is_a_difference(tmp_path: Path) -> None:
    after = rich()
    after.gltf["meshes"][1]["primitives"][0]["material"] = 9
    (found,) = compared(tmp_path, rich(), after).differences
    assert (found.place, found.message) == ("/meshes/1/primitives/0/material", "leads somewhere only in A")


def test_the_same_content_needs_no_measuring(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("poses the scene")

    monkeypatch.setattr("wrinklecli.review.diff.diff.read_scene", refuse)
    a = rich().write(tmp_path / "a.gltf")
    b, c = (rich().write(tmp_path / name) for name in ("b.glb", "c.glb"))
    for pair in ((a, a), (b, c)):
        found = diff(*pair)
        assert (found.same, found.size, found.tolerance, found.times) == (True, None, None, 0)


@pytest.mark.parametrize("change", [index_of_nothing, joint_of_nothing])
def test_malformed_meshes_are_compared_as_they_are_stored(change: Callable[[Asset], None], tmp_path: Path) -> None:
    after = rich()
    change(after)
    assert compared(tmp_path, rich(), after).differences[0].kind == "geometry"


def test_a_hierarchy_without_end_is_refused(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset in (before, after):
        asset.gltf["nodes"][2]["children"] = [2]
    after.gltf["asset"]["generator"] = "another"
    with pytest.raises(AssetError, match="is its own ancestor"):
        compared(tmp_path, before, after)


@pytest.mark.quick(1)
@pytest.mark.parametrize("change", UNREADABLE)
def test_what_cannot_be_decoded_is_compared_as_it_is_stored(change: Callable[[Asset], None], tmp_path: Path) -> None:
    before, after = rich(), rich()
    change(after)
    assert "cannot be decoded in B" in " ".join(compared(tmp_path, before, after).lines())
    change(before)
    for view in after.gltf["bufferViews"]:
        after.data[view["byteOffset"]] ^= 1
    assert "cannot be decoded, and is stored otherwise" in " ".join(compared(tmp_path, before, after).lines())


@pytest.mark.parametrize("unnamed", [{}, {"name": ""}], ids=str)
def test_a_node_that_gets_a_name_is_the_same_node(unnamed: Json, tmp_path: Path) -> None:
    """Several nodes without a name are alike but for their place, and only one gets a name."""
    paths = []
    for names in (unnamed, {"name": "node_2"}):
        asset = Asset()
        for index in range(4):
            asset.append("nodes", {"translation": [float(index), 0.0, 0.0], **(names if index == 2 else unnamed)})
        asset.append("scenes", {"nodes": [0, 1, 2, 3]})
        paths.append(asset.write(tmp_path / f"{len(paths)}.glb"))
    for one, other in (paths, paths[::-1]):
        assert [each.place for each in diff(one, other).differences] == ["/nodes/2/name"]


def test_nodes_are_paired_below_their_parents(tmp_path: Path) -> None:
    """Two hands with thumbs of one name, in the other order."""
    documents = []
    for names in (("left", "right"), ("right", "left")):
        nodes: list[Json] = []
        for name in names:
            nodes += [{"name": name, "children": [len(nodes) + 1]}, {"name": "thumb"}]
        path = tmp_path / f"{names[0]}.gltf"
        path.write_text(json.dumps({"asset": {"version": "2.0"}, "nodes": nodes}))
        documents.append(read_document(path))
    assert pair_nodes(*documents) == ({0: 2, 1: 3, 2: 0, 3: 1}, [])
