"""Golden tests: every kind of change is found and named, and what means the same is the same."""

import copy
import json
import re
import shutil
import subprocess
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kit import hostile
from kit.asset import Asset, attribute, stored
from kit.command import Wrinkle, make_samples
from kit.limb import limb_asset, tool, write_tools
from kit.places import SAMPLES
from kit.variants import PICTURE, SMALL, rich
from wrinklecli import bake
from wrinklecli.errors import AssetError, WrinkleError
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edit import EditedDocument
from wrinklecli.gltf.writer import write
from wrinklecli.review.diff.diff import Comparison, diff
from wrinklecli.tools.records import Length

Json = dict[str, Any]


def node(asset: Asset, name: str) -> Json:
    found: Json = next(each for each in asset.gltf["nodes"] if each.get("name") == name)
    return found


def compared(folder: Path, a: Asset, b: Asset, **options: Any) -> Comparison:
    return diff(a.write(folder / "a.glb"), b.write(folder / "b.glb"), **options)


def fold(asset: Asset) -> Json:
    found: Json = asset.gltf["animations"][0]
    assert found["name"] == "fold"
    return found


# Changes


def moved_vertex(asset: Asset) -> None:
    attribute(asset, 0, "POSITION")[17, 1] += 0.01


def bent_normal(asset: Asset) -> None:
    attribute(asset, 0, "NORMAL")[5] = [0.0, 0.0, 1.0]


def other_uv(asset: Asset) -> None:
    attribute(asset, 0, "TEXCOORD_0")[6, 0] += 0.001


def other_id(asset: Asset) -> None:
    attribute(asset, 1, "_ID")[2] += 1


def other_colour(asset: Asset) -> None:
    attribute(asset, 0, "COLOR_0")[3, 1] += 1


def flipped_triangle(asset: Asset) -> None:
    indices = stored(asset, asset.gltf["meshes"][1]["primitives"][0]["indices"])
    indices[1:3] = indices[2:0:-1].copy()


def other_weight(asset: Asset) -> None:
    weights = attribute(asset, 0, "WEIGHTS_0")
    blended = int(np.argmin(np.abs(weights[:, 0] - 0.6)))
    weights[blended, :2] += [-0.01, 0.01]


def other_delta(asset: Asset) -> None:
    stored(asset, asset.gltf["meshes"][0]["primitives"][0]["targets"][1]["POSITION"])[40, 2] += 0.01


def renamed_target(asset: Asset) -> None:
    asset.gltf["meshes"][0]["extras"]["targetNames"][1] = "frown"


def dropped_target(asset: Asset) -> None:
    asset.gltf["meshes"][0]["primitives"][0]["targets"].pop()
    asset.gltf["meshes"][0]["weights"].pop()
    animation = fold(asset)
    animation["channels"] = [each for each in animation["channels"] if each["target"]["path"] != "weights"]


def stored_weight(asset: Asset) -> None:
    asset.gltf["meshes"][0]["weights"][1] += 0.1


def renamed_node(asset: Asset) -> None:
    node(asset, "joint_1")["name"] = "elbow"


def moved_node(asset: Asset) -> None:
    node(asset, "hat")["translation"] = [0.0, 0.5, 0.0]


def turned_node(asset: Asset) -> None:
    node(asset, "hat")["rotation"] = [0.0, 0.6, 0.0, 0.8]


def reparented_node(asset: Asset) -> None:
    asset.gltf["scenes"][0]["nodes"].pop()
    joint = node(asset, "joint_0")
    joint["children"] = [*joint["children"], asset.gltf["nodes"].index(node(asset, "hat"))]


def added_node(asset: Asset) -> None:
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "marker"}))


def without_camera(asset: Asset) -> None:
    del node(asset, "hat")["camera"]


def hidden_in_scene(asset: Asset) -> None:
    asset.gltf["scenes"][0]["nodes"].pop()


def material_factor(asset: Asset) -> None:
    asset.gltf["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][1] = 0.6


def material_extension(asset: Asset) -> None:
    asset.gltf["materials"][1]["extensions"]["KHR_materials_clearcoat"]["clearcoatFactor"] = 0.3


def texture_transform(asset: Asset) -> None:
    info = asset.gltf["materials"][1]["pbrMetallicRoughness"]["baseColorTexture"]
    info["extensions"]["KHR_texture_transform"]["scale"][1] = 3


def double_sided(asset: Asset) -> None:
    asset.gltf["materials"][1]["doubleSided"] = True


def other_material(asset: Asset) -> None:
    asset.gltf["meshes"][0]["primitives"][0]["material"] = 2


def image_byte(asset: Asset) -> None:
    view = asset.gltf["bufferViews"][asset.gltf["images"][0]["bufferView"]]
    asset.data[view["byteOffset"] + 100] ^= 1


def swapped_images(asset: Asset) -> None:
    asset.gltf["textures"][0]["source"], asset.gltf["textures"][1]["source"] = 1, 0


def sampler_filter(asset: Asset) -> None:
    asset.gltf["samplers"][0]["magFilter"] = 9728


def spare_material(asset: Asset) -> None:
    asset.gltf["materials"][2]["alphaMode"] = "BLEND"


def dropped_clip(asset: Asset) -> None:
    asset.gltf["animations"].pop()


def renamed_clip(asset: Asset) -> None:
    asset.gltf["animations"][1]["name"] = "shake"


def changed_key(asset: Asset) -> None:
    stored(asset, fold(asset)["samplers"][0]["output"])[1] = [0.0, 0.0, 0.6, 0.8]


def moved_key(asset: Asset) -> None:
    stored(asset, fold(asset)["samplers"][0]["input"])[1] += 0.01


def longer_clip(asset: Asset) -> None:
    stored(asset, asset.gltf["animations"][1]["samplers"][0]["input"])[2] = 3.0


def weight_key(asset: Asset) -> None:
    sampler = next(each for each in fold(asset)["channels"] if each["target"]["path"] == "weights")["sampler"]
    stored(asset, fold(asset)["samplers"][sampler]["output"])[3] += 0.125


def stepped(asset: Asset) -> None:
    fold(asset)["samplers"][0]["interpolation"] = "STEP"


def dropped_channel(asset: Asset) -> None:
    fold(asset)["channels"].pop(0)


def swapped_joints(asset: Asset) -> None:
    joints = asset.gltf["skins"][0]["joints"]
    joints[1], joints[2] = joints[2], joints[1]


def moved_bind(asset: Asset) -> None:
    stored(asset, asset.gltf["skins"][0]["inverseBindMatrices"])[1, 12] += 0.01


def extras_number(asset: Asset) -> None:
    node(asset, "hat")["extras"]["price"] = 3.6


def extras_item(asset: Asset) -> None:
    node(asset, "hat")["extras"]["tags"].append("new")


def extras_key(asset: Asset) -> None:
    asset.gltf["extras"]["more"] = None


def copyright_line(asset: Asset) -> None:
    asset.gltf["asset"]["copyright"] = "no one"


def lens(asset: Asset) -> None:
    asset.gltf["cameras"][0]["perspective"]["yfov"] = 0.9


def future_key(asset: Asset) -> None:
    asset.gltf["futureKey"] = {"deep": [1]}


def extension_used(asset: Asset) -> None:
    asset.gltf["extensionsUsed"].append("VENDOR_unheard_of")


def pointer_channel(asset: Asset) -> None:
    pointed = {"path": "pointer", "extensions": {"KHR_animation_pointer": {"pointer": "/materials/0/alphaCutoff"}}}
    fold(asset)["channels"].append({"sampler": 0, "target": pointed})


def spare_skin(asset: Asset) -> None:
    asset.append("skins", {"name": "spare", "joints": [2]})


def other_skeleton(asset: Asset) -> None:
    asset.gltf["skins"][0]["skeleton"] = 2


PRIMITIVE = "/meshes/0/primitives/0"
# What is changed, where it is said to differ, and what is said of it.
CHANGES: list[tuple[Callable[[Asset], None], str, str]] = [
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


@given(st.integers(0, 10_000), st.floats(0.01, 100.0), st.sampled_from([0.5, 2.0]))
def test_a_vertex_may_move_by_the_tolerance_and_no_further(
    tmp_path_factory: pytest.TempPathFactory, seed: int, scale: float, factor: float
) -> None:
    rng = np.random.default_rng(seed)
    tolerance = 1e-3 * scale
    root = {"scale": [scale] * 3}
    before, after = (limb_asset(**SMALL, root=root, clip=None) for _ in range(2))
    positions = attribute(after, 0, "POSITION")
    vertex, direction = int(rng.integers(len(positions))), rng.normal(size=3)
    # Bind units: the root scales the limb into the scene.
    positions[vertex] += (factor * tolerance / scale * direction / np.linalg.norm(direction)).astype(np.float32)
    found = compared(tmp_path_factory.mktemp("moved"), before, after, tolerance=Length(tolerance))
    assert found.same == (factor < 1)
    assert found.worst is not None
    assert found.worst.vertex == vertex
    assert found.worst.distance == pytest.approx(factor * tolerance, rel=1e-2)
    if not found.same:
        assert {each.kind for each in found.differences} == {"geometry", "pose"}
        assert all(each.distance == pytest.approx(factor * tolerance, rel=1e-2) for each in found.differences)
        assert all(f"vertex {vertex} is" in each.message for each in found.differences)


@pytest.mark.parametrize("fps", [0.5, 30.0])
def test_the_worst_moment_is_named(tmp_path: Path, fps: float) -> None:
    before, after = rich(), rich()
    weight_key(after)
    # Keys are looked at however coarse the grid is.
    found = compared(tmp_path, before, after, fps=fps)
    assert found.worst is not None
    # The key at 0.3 s has the number 3: the second target's weight, which the joints then carry along.
    assert (found.worst.clip, found.worst.name, found.worst.place) == ("fold", "limb", PRIMITIVE)
    assert found.worst.time == pytest.approx(0.3, abs=1e-6)
    posed = [each for each in found.differences if each.kind == "pose"]
    assert [each.place for each in posed] == [PRIMITIVE]
    assert "clip 'fold' at 0.3 s" in posed[0].message


def test_progress_reaches_the_end(tmp_path: Path) -> None:
    before, after = rich(), rich()
    moved_vertex(after)
    renamed_clip(after)
    strip = rich(mode="strip", indices="u2")
    for other in (before, after, strip):
        steps: list[tuple[str, int, int]] = []
        found = compared(tmp_path, before, other, progress=lambda *step, to=steps: to.append(step))
        assert [done for _, done, _ in steps] == sorted(done for _, done, _ in steps)
        assert steps[-1] == ("compare", found.times, found.times)


# Harmless changes


def through_draft(folder: Path, path: Path, *, suffix: str = ".glb") -> Path:
    """The same document, laid out anew."""
    made = folder / "draft" / f"out{suffix}"
    made.parent.mkdir()
    write(EditedDocument(read_document(path)), made)
    return made


def mixed_accessors(asset: Asset) -> None:
    """All accessors and buffer views in another order, and in the buffer too."""
    gltf, data = asset.gltf, bytes(asset.data)
    rng = np.random.default_rng(3)
    accessors, views = (rng.permutation(len(gltf[kind])) for kind in ("accessors", "bufferViews"))
    old_views = gltf["bufferViews"]
    gltf["bufferViews"] = []
    asset.data[:] = b"junk"
    for index in views:
        view = old_views[index]
        chunk = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        asset.view(chunk, stride=view.get("byteStride"))
    new_view = {int(old): new for new, old in enumerate(views)}
    new_accessor = {int(old): new for new, old in enumerate(accessors)}
    gltf["accessors"] = [gltf["accessors"][index] for index in accessors]
    for accessor in gltf["accessors"]:
        accessor["bufferView"] = new_view[accessor["bufferView"]]
    for image in gltf["images"]:
        image["bufferView"] = new_view[image["bufferView"]]
    for mesh in gltf["meshes"]:
        for primitive in mesh["primitives"]:
            for holder in (primitive["attributes"], *primitive.get("targets", [])):
                holder.update({name: new_accessor[index] for name, index in holder.items()})
            primitive["indices"] = new_accessor[primitive["indices"]]
    skin = gltf["skins"][0]
    skin["inverseBindMatrices"] = new_accessor[skin["inverseBindMatrices"]]
    for animation in gltf["animations"]:
        for sampler in animation["samplers"]:
            sampler.update({key: new_accessor[sampler[key]] for key in ("input", "output")})


def mixed_nodes(asset: Asset) -> None:
    """Nodes in another order."""
    gltf = asset.gltf
    order = np.random.default_rng(4).permutation(len(gltf["nodes"]))
    new = {int(old): number for number, old in enumerate(order)}
    gltf["nodes"] = [gltf["nodes"][index] for index in order]
    for each in [*gltf["nodes"], *gltf["scenes"]]:
        for key in ("children", "nodes"):
            if key in each:
                each[key] = [new[index] for index in each[key]]
    for skin in gltf["skins"]:
        skin["joints"] = [new[index] for index in skin["joints"]]
        skin["skeleton"] = new[skin["skeleton"]]
    for animation in gltf["animations"]:
        for channel in animation["channels"]:
            channel["target"]["node"] = new[channel["target"]["node"]]


def mixed_joints(asset: Asset) -> None:
    """Joints in another order, each with its matrix, and vertices that refer to them so."""
    skin = asset.gltf["skins"][0]
    order = [2, 0, 1]
    skin["joints"] = [skin["joints"][index] for index in order]
    matrices = stored(asset, skin["inverseBindMatrices"])
    matrices[:] = matrices[order].copy()
    joints = attribute(asset, 0, "JOINTS_0")
    joints[:] = np.argsort(order)[joints]
    # Influences in another order too, and a joint without weight.
    weights = attribute(asset, 0, "WEIGHTS_0")
    for each in (joints, weights):
        each[:] = each[:, ::-1].copy()
    joints[weights == 0] = 1


def mixed_kinds(asset: Asset) -> None:
    """Meshes, materials, textures, images, clips and channels in another order."""
    gltf = asset.gltf
    for kind in ("meshes", "materials", "textures", "images", "animations"):
        gltf[kind].reverse()
    last = len(gltf["materials"]) - 1
    for each in gltf["nodes"]:
        if "mesh" in each:
            each["mesh"] = 1 - each["mesh"]
    for mesh in gltf["meshes"]:
        mesh["primitives"][0]["material"] = last - mesh["primitives"][0]["material"]
    felt = next(each for each in gltf["materials"] if each["name"] == "felt")
    felt["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 1
    felt["extensions"]["KHR_materials_clearcoat"]["clearcoatTexture"]["index"] = 0
    for texture in gltf["textures"]:
        texture["source"] = 1 - texture["source"]
    gltf["animations"][1]["channels"].reverse()


def other_generator(asset: Asset) -> None:
    asset.gltf["asset"]["generator"] = "another"


def defaults_written_out(asset: Asset) -> None:
    hat = node(asset, "hat")
    hat |= {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    asset.gltf["meshes"][1]["primitives"][0]["mode"] = 4
    asset.gltf["materials"][0] |= {"alphaMode": "OPAQUE", "doubleSided": False, "emissiveFactor": [0, 0, 0]}
    asset.gltf["materials"][0]["pbrMetallicRoughness"] |= {"metallicFactor": 1, "roughnessFactor": 1.0}
    asset.gltf["samplers"][0]["wrapT"] = 10497
    for animation in asset.gltf["animations"]:
        for sampler in animation["samplers"]:
            if sampler["interpolation"] == "LINEAR":
                del sampler["interpolation"]


def matrix_for_transform(asset: Asset) -> None:
    joint = node(asset, "joint_0")
    x, y, z = joint.pop("translation")
    joint["matrix"] = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1]


def opposite_quaternions(asset: Asset) -> None:
    stored(asset, fold(asset)["samplers"][0]["output"])[:] *= -1


def redundant_keys(asset: Asset) -> None:
    sampler = asset.gltf["animations"][1]["samplers"][0]
    sampler["input"] = asset.accessor([0, 0.5, 1, 2], bounds=True)
    sampler["output"] = asset.accessor([[0, 0, 0], [0, 0.05, 0], [0, 0.1, 0], [0, 0, 0]])


def weights_on_the_node(asset: Asset) -> None:
    node(asset, "limb")["weights"] = asset.gltf["meshes"][0].pop("weights")


def idle_target(asset: Asset) -> None:
    """A NORMAL that a target leaves alone."""
    primitive = asset.gltf["meshes"][0]["primitives"][0]
    count = asset.gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
    zeros = {"componentType": 5126, "count": count, "type": "VEC3"}
    primitive["targets"][0]["NORMAL"] = asset.append("accessors", zeros)


HARMLESS = [
    mixed_accessors,
    mixed_nodes,
    mixed_joints,
    mixed_kinds,
    other_generator,
    defaults_written_out,
    matrix_for_transform,
    opposite_quaternions,
    redundant_keys,
    weights_on_the_node,
    idle_target,
]


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
def test_a_draft_of_a_document_is_the_same(tmp_path: Path, suffix: str) -> None:
    path = rich().write(tmp_path / "a.glb")
    assert diff(path, through_draft(tmp_path, path, suffix=suffix)).same


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
    draft = EditedDocument(document)
    for mesh in draft.gltf["meshes"]:
        for primitive in mesh["primitives"]:
            draft.unpack(primitive)
    made = tmp_path / name
    write(draft, made)
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


def test_the_tolerance_is_a_share_of_the_size_or_scene_units(tmp_path: Path) -> None:
    before, after = limb_asset(**SMALL), limb_asset(**SMALL)
    attribute(after, 0, "POSITION")[3] += np.float32([0.0, 0.0, 0.003])
    found = compared(tmp_path, before, after)
    assert found.size == pytest.approx(np.sqrt(2.0**2 + 0.5**2 + 0.5**2))
    assert found.tolerance == pytest.approx(1e-6 * found.size)
    assert not found.same
    assert not compared(tmp_path, before, after, tolerance=Length(0.0029)).same
    assert compared(tmp_path, before, after, tolerance=Length(0.0031)).same
    assert compared(tmp_path, before, after, tolerance=Length(100 * 0.0031 / found.size, percent=True)).same


def test_far_from_the_origin_the_default_tolerance_is_that_of_float32(tmp_path: Path) -> None:
    before, after = (limb_asset(**SMALL, root={"translation": [1000.0, 0.0, 0.0]}) for _ in range(2))
    after.gltf["nodes"][-1]["translation"][0] = float(np.nextafter(np.float32(1000.0), np.float32(2000.0)))
    found = compared(tmp_path, before, after, posed=True)
    assert found.worst is not None
    assert found.worst.distance > 1e-6 * found.size
    assert found.same


# Posed


def test_posed_looks_at_positions_alone(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for change in (renamed_node, material_factor, image_byte, renamed_target, bent_normal, lens, extras_key, other_uv):
        change(after)
    found = compared(tmp_path, before, after, posed=True)
    assert found.same
    assert found.normal is not None
    assert found.normal > 10.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (dropped_clip, "only in A"),
        (longer_clip, "0 to 2 s -> 0 to 3 s"),
        (changed_key, "clip 'fold'"),
        (swapped_joints, "vertex"),
        (moved_vertex, "stored pose: vertex 17 is 0.01 off"),
        (hidden_in_scene, "stored pose: only in A"),
        (stored_weight, "stored pose: vertex"),
        (other_delta, "stored pose: vertex 40"),
        (other_weight, "clip 'fold'"),
        (moved_node, "stored pose: vertex"),
        (moved_bind, "stored pose: vertex"),
        (stepped, "clip 'fold'"),
    ],
    ids=lambda each: getattr(each, "__name__", ""),
)
def test_posed_sees_what_moves_otherwise(tmp_path: Path, change: Callable[[Asset], None], words: str) -> None:
    before, after = rich(), rich()
    change(after)
    found = compared(tmp_path, before, after, posed=True)
    assert any(words in each.message for each in found.differences), found.differences


def test_only_the_clips_asked_for_are_compared(tmp_path: Path) -> None:
    before, after = rich(), rich()
    changed_key(after)
    assert not compared(tmp_path, before, after, clips=["fold"]).same
    assert compared(tmp_path, before, after, clips=["nod"]).same
    assert compared(tmp_path, before, after, clips=["nod"], posed=True).same
    dropped_clip(after)
    assert not compared(tmp_path, before, after, clips=["nod"]).same
    with pytest.raises(AssetError, match="no clip 'fild'; did you mean 'fold'"):
        compared(tmp_path, before, after, clips=["fild"])


def test_the_stored_pose_is_not_compared_where_clips_are_asked_for(tmp_path: Path) -> None:
    before, after = rich(), rich()
    # In the clip, keys take its place.
    stored_weight(after)
    assert not compared(tmp_path, before, after, posed=True).same
    assert compared(tmp_path, before, after, posed=True, clips=["fold"]).same


def test_a_vertex_of_no_triangle_is_not_seen(tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset, place in ((before, 5.0), (after, 6.0)):
        corners = [[0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0.5], [0, 0, place]]
        attributes = {"POSITION": asset.accessor(corners, bounds=True)}
        asset.gltf["meshes"][1]["primitives"][0]["attributes"] = attributes
    assert compared(tmp_path, before, after, posed=True).same
    places = [each.place for each in compared(tmp_path, before, after).differences]
    assert places == ["/meshes/1/primitives/0/attributes/POSITION"]


def test_angles_are_those_between_normals_that_are_there(tmp_path: Path) -> None:
    before, after = limb_asset(**SMALL), limb_asset(**SMALL)
    angle = np.radians(2.0)
    for asset, vertex in ((before, 30), (after, 31)):
        attribute(asset, 0, "NORMAL")[vertex] = 0.0
        attribute(asset, 0, "NORMAL")[5] = [0.0, 1.0, 0.0]
    attribute(after, 0, "NORMAL")[5] = [np.sin(angle), np.cos(angle), 0.0]
    found = compared(tmp_path, before, after, posed=True)
    assert found.same
    assert found.normal == pytest.approx(2.0, rel=1e-4)


def test_twins_are_told_apart_by_where_they_are(tmp_path: Path) -> None:
    def shoes(*places: tuple[str, float]) -> Asset:
        asset = rich()
        for name, place in places:
            shoe = asset.append("nodes", {"name": name, "mesh": 1, "translation": [place, 0, 0]})
            asset.gltf["scenes"][0]["nodes"].append(shoe)
        return asset

    pair = shoes(("left", -3.0), ("right", 3.0))
    for other in (shoes(("right", 3.0), ("left", -3.0)), pair):
        assert compared(tmp_path, pair, other).same
    for other in (shoes(("right", -3.0), ("left", 3.0)), shoes(("left", 3.0), ("right", -3.0))):
        assert compared(tmp_path, pair, other, posed=True).same
        assert not compared(tmp_path, pair, other).same
    for other in (rich(), shoes(("left", -3.0)), shoes(("left", -3.0), ("right", 4.0))):
        assert not compared(tmp_path, pair, other, posed=True).same


def test_points_and_lines_are_compared_by_their_vertices(tmp_path: Path) -> None:
    def dots(count: int, off: float = 0.0) -> Asset:
        asset = rich()
        places = np.zeros((count, 3))
        places[:, 0] = np.linspace(0, 1, count)
        places[-1, 1] = off
        primitive = {"attributes": {"POSITION": asset.accessor(places, bounds=True)}, "mode": 0}
        asset.append("meshes", {"primitives": [primitive]})
        asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "dots", "mesh": 2}))
        return asset

    assert compared(tmp_path, dots(5), dots(5), posed=True).same
    found = compared(tmp_path, dots(5), dots(5, 0.2), posed=True)
    assert found.worst is not None
    assert found.worst.distance == pytest.approx(0.2)
    # Every one of the few dots lies on one of the many, of which every other is a quarter away.
    for a, b, side in ((3, 5, "B"), (5, 3, "A")):
        found = compared(tmp_path, dots(a), dots(b), posed=True)
        assert found.worst is not None
        assert found.worst.distance == pytest.approx(0.25)
        assert found.worst.side == side


def test_other_triangles_of_one_surface_are_the_same_as_posed(tmp_path: Path) -> None:
    before, after = limb_asset(**SMALL), limb_asset(**SMALL, mode="strip")
    assert not compared(tmp_path, before, after).same
    found = compared(tmp_path, before, after, posed=True)
    assert found.same
    attribute(after, 0, "POSITION")[3] *= np.float32([1.0, 1.1, 1.1])
    found = compared(tmp_path, before, after, posed=True)
    assert found.worst is not None
    # The seam's first vertex leaves the surface by a tenth of the radius, in every pose.
    assert found.worst.distance == pytest.approx(0.025, rel=0.05)
    assert {each.place for each in found.differences} <= {f"/meshes/0/primitives/{k}" for k in range(8)}


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("gltfpack_c.glb", "gltfpack_cc.glb"),
        ("gltfpack_c.glb", "gltfpack_c_float.glb"),
        ("gltf_transform_draco.glb", "gltf_transform_meshopt.glb"),
    ],
)
def test_what_optimisers_have_rewritten_looks_the_same(first: str, second: str) -> None:
    folder = Path(__file__).parents[1] / "data"
    # Vertices in other orders, quantised, with keys left out; each to a thousandth of the asset's size.
    tolerance = Length(0.1, percent=True)
    assert diff(folder / first, folder / second, posed=True, tolerance=tolerance).same
    assert not diff(folder / first, folder / second, tolerance=tolerance).same


def baked(folder: Path, name: str, asset: Path, *, scheme: str = "midpoint", **options: Any) -> Path:
    tools = write_tools(folder / f"{name}.yaml", tool(), refinement={"scheme": scheme})
    bake(asset, tools, folder / f"{name}.glb", **options)
    return folder / f"{name}.glb"


def test_refined_flat_triangles_are_the_same_surface(tmp_path: Path) -> None:
    # At rest no wrinkle shows, and the midpoint scheme keeps the coarse shape.
    asset = limb_asset(rings=13, sides=12, clip=None).write(tmp_path / "limb.glb")
    coarse, fine = (baked(tmp_path, f"levels{levels}", asset, max_levels=levels) for levels in (0, 1))
    counts = [len(read_document(path).accessor(0)) for path in (coarse, fine)]
    assert counts[0] < counts[1]
    found = diff(coarse, fine, posed=True)
    assert found.same
    assert found.worst is not None
    assert found.worst.distance <= 1e-7
    round_ = baked(tmp_path, "butterfly", asset, scheme="butterfly", max_levels=1)
    found = diff(coarse, round_, posed=True)
    assert not found.same
    assert found.worst is not None
    # A chord of a twelfth of the circle is this far from it: what the smooth scheme fills.
    sagitta = 0.25 * (1 - np.cos(np.pi / 12))
    assert 0.5 * sagitta < found.worst.distance < 1.1 * sagitta
    assert found.worst.side == "B"


def test_morph_and_frames_show_the_same_surface(tmp_path: Path) -> None:
    asset = limb_asset(rings=13, sides=12).write(tmp_path / "limb.glb")
    tools = write_tools(tmp_path / "tools.yaml", tool(), sampling={"fps": 10})
    report = bake(asset, tools, tmp_path / "morph.glb")
    bake(asset, tools, tmp_path / "frames.glb", mode="frames")
    paths = [tmp_path / "morph.glb", tmp_path / "frames.glb"]
    limit = Length(report.data["meshes"][0]["max_error"])
    frames = [each for each in read_document(paths[1]).items("nodes") if "_fold_" in each["name"]]
    for a, b in (paths, paths[::-1]):
        found = diff(a, b, posed=True, tolerance=limit)
        assert found.same, found.differences
        # The frames' own times, none between them.
        assert found.times == len(frames)
    assert not diff(*paths, tolerance=limit).same
    # The wrinkles are there to be missed.
    assert not diff(asset, paths[1], posed=True, tolerance=limit).same
    bake(asset, tools, tmp_path / "fewer.glb", mode="frames", fps=5)
    assert diff(paths[0], tmp_path / "fewer.glb", posed=True, tolerance=limit).same


def test_a_dense_bake_is_the_same_as_a_sparse_one(tmp_path: Path) -> None:
    asset = limb_asset(rings=13, sides=12).write(tmp_path / "limb.glb")
    sparse = baked(tmp_path, "sparse", asset)
    dense = baked(tmp_path, "dense", asset, accessors="dense")
    assert sparse.read_bytes() != dense.read_bytes()
    assert diff(sparse, dense).same


# Faults


def test_damaged_files_are_compared_or_refused(tmp_path: Path) -> None:
    outcomes: Counter[str] = Counter()
    for number in range(60):
        case = hostile.make_case(number)
        path = tmp_path / f"bad{case.suffix}"
        path.write_bytes(case.asset)
        source = hostile.corpus()[number % len(hostile.corpus())]
        sound = tmp_path / f"sound{source.suffix}"
        sound.write_bytes(hostile.packed(source.gltf, source.data, source.suffix))
        outcome = "refused"
        with hostile.bounded(), suppress(WrinkleError):
            diff(sound, path)
            assert diff(path, path).same
            outcome = "compared"
        outcomes[outcome] += 1
    assert min(outcomes["compared"], outcomes["refused"]) > 10


# The command


def test_exit_codes_say_same_different_or_neither(wrinkle: Wrinkle, tmp_path: Path) -> None:
    a = rich().write(tmp_path / "a.glb")
    after = rich()
    moved_vertex(after)
    b = after.write(tmp_path / "b.glb")
    shutil.copy(a, tmp_path / "c.glb")
    (tmp_path / "bad.glb").write_bytes(a.read_bytes()[:1000])

    ran = wrinkle("diff", a, "c.glb")
    assert (ran.code, ran.lines) == (0, [])
    assert ran.out.startswith("same: at most 0 apart; tolerance ")
    assert len(ran.out.splitlines()) == 1

    ran = wrinkle("diff", a, b)
    assert (ran.code, ran.lines) == (1, [])
    *lines, last = ran.out.splitlines()
    assert lines[0] == "/meshes/0/primitives/0/attributes/POSITION (limb): vertex 17 is 0.01 off"
    assert last.startswith("different: at most ")
    assert "'limb' in A, vertex 17" in last
    assert wrinkle("diff", a, b, "--tolerance", "1%").code == 0
    assert wrinkle("diff", a, b, "--tolerance", "0.02", "--posed", "--clip", "fold", "--fps", "5").code == 0

    for arguments in (("missing.glb",), ("bad.glb",), (b, "--clip", "nothing")):
        ran = wrinkle("diff", a, *arguments)
        assert (ran.code, ran.out) == (2, "")
        assert len(ran.lines) == 1
    for arguments in ((), (b, "--tolerance", "0"), (b, "--tolerance", "nan"), (b, "--fps", "nan"), (b, "extra")):
        assert wrinkle("diff", a, *arguments).code == 2

    for other, code in ((b, 1), ("c.glb", 0)):
        ran = wrinkle("diff", a, other, "-q")
        assert (ran.code, ran.out, ran.lines) == (code, "", [])


def test_json_keeps_its_keys(wrinkle: Wrinkle, tmp_path: Path) -> None:
    a = rich().write(tmp_path / "a.glb")
    after = rich()
    moved_vertex(after)
    attribute(after, 0, "TEXCOORD_0")[0] = np.nan
    b = after.write(tmp_path / "b.glb")
    ran = wrinkle("diff", a, b, "--json")
    assert (ran.code, ran.lines) == (1, [])
    data = json.loads(ran.out, parse_constant=pytest.fail)
    assert list(data) == [
        *("diff", "same", "a", "b", "posed", "tolerance", "size", "times", "worst", "normal", "differences")
    ]
    assert data["diff"] == 1
    assert (data["same"], data["posed"], data["a"], data["b"]) == (False, False, str(a), str(b))
    assert list(data["worst"]) == ["distance", "side", "place", "name", "vertex", "clip", "time"]
    assert all(list(each) == ["kind", "place", "name", "message", "distance"] for each in data["differences"])
    assert {each["kind"] for each in data["differences"]} == {"geometry", "pose"}
    ran = wrinkle("diff", a, a, "--json", "--posed")
    data = json.loads(ran.out)
    assert (ran.code, data["same"], data["posed"], data["differences"]) == (0, True, True, [])


def test_many_differences_of_a_kind_are_counted(wrinkle: Wrinkle, tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset, value in ((before, 1), (after, 2)):
        asset.gltf["extras"] |= {f"key_{k}": value for k in range(30)}
    image_byte(after)
    paths = before.write(tmp_path / "a.glb"), after.write(tmp_path / "b.glb")
    lines = wrinkle("diff", *paths).out.splitlines()
    assert len([line for line in lines if line.startswith("/extras/key_")]) == 10
    assert "... and 20 more of kind value" in lines
    assert any(line.startswith("/images/0 (felt): other bytes") for line in lines)
    lines = wrinkle("diff", *paths, "-v").out.splitlines()
    assert len([line for line in lines if line.startswith("/extras/key_")]) == 30


def test_names_cannot_command_a_terminal(wrinkle: Wrinkle, tmp_path: Path) -> None:
    before, after = rich(), rich()
    for asset in (before, after):
        asset.gltf["nodes"][-1]["name"] = "hat\n\x1b[31m"
    moved = copy.deepcopy(after)
    moved.gltf["nodes"][-1]["translation"] = [1.0, 0.0, 0.0]
    ran = wrinkle("diff", before.write(tmp_path / "a.glb"), moved.write(tmp_path / "b.glb"))
    assert ran.code == 1
    assert "\x1b" not in ran.out
    assert all(line.startswith(("/", "different:")) for line in ran.out.splitlines())


def test_a_file_without_anything_to_see_is_compared_too(wrinkle: Wrinkle, tmp_path: Path) -> None:
    asset = Asset()
    animation: Json = {"name": "wave"}
    asset.append("nodes", {"name": "arm"})
    asset.channel(animation, 0, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]])
    asset.append("animations", animation)
    a = asset.write(tmp_path / "a.glb")
    stored(asset, animation["samplers"][0]["output"])[1, 0] = 1.001
    b = asset.write(tmp_path / "b.glb")
    ran = wrinkle("diff", a, a)
    assert (ran.code, ran.out.strip()) == (0, "same: no positions to compare")
    ran = wrinkle("diff", a, b)
    assert ran.code == 1
    assert "/animations/0/channels/0 (wave): translation of 'arm' differs by 0.001 at 1 s" in ran.out


# The samples' pipeline


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_the_samples_are_checked_and_compared_with_their_golden(tmp_path: Path) -> None:
    samples = tmp_path / "samples"
    shutil.copytree(SAMPLES, samples, ignore=shutil.ignore_patterns("out", "pictures", "__pycache__"))
    (tmp_path / "configs").mkdir()
    shutil.copy(SAMPLES.parent / "configs" / "wrist.yaml", tmp_path / "configs")
    golden = samples / "goldens" / "wrist.glb"
    kept = golden.read_bytes()
    assert len(kept) < 200_000
    ran = make_samples(samples, "test", "-j2")
    assert "same: at most" in ran.stdout

    draft = EditedDocument(read_document(golden))
    draft.gltf["nodes"][0]["extras"]["wrinkle"]["tools"][0]["rest_length"] *= 1.01
    write(draft, golden)
    with pytest.raises(subprocess.CalledProcessError) as caught:
        make_samples(samples, "golden-check")
    assert "/nodes/0/extras/wrinkle/tools/0/rest_length" in caught.value.stdout

    make_samples(samples, "goldens")
    assert diff(golden, samples / "out" / "golden" / "wrist.glb").same
    make_samples(samples, "golden-check")

    config = tmp_path / "configs" / "wrist.yaml"
    wider, count = re.subn(r"width: [0-9.]+", "width: 0.08", config.read_text())
    assert count
    config.write_text(wider)
    with pytest.raises(subprocess.CalledProcessError) as caught:
        make_samples(samples, "golden-check")
    assert "different: at most" in caught.value.stdout
