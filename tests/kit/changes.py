"""Changes of the asset `rich`: those that make a difference, and those that mean the same."""

from pathlib import Path
from typing import Any

import numpy as np

from kit.asset import Asset, attribute, stored
from wrinklecli.gltf.document import read_document
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.writer import write
from wrinklecli.review.diff.diff import Comparison, diff

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


# Differences


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


def further_joint(asset: Asset) -> None:
    asset.gltf["skins"][0]["joints"].append(0)


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


# What means the same


def rewritten(folder: Path, path: Path, *, suffix: str = ".glb") -> Path:
    """The same document, laid out anew."""
    made = folder / "rewritten" / f"out{suffix}"
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
    for info in (felt["extensions"]["KHR_materials_clearcoat"]["clearcoatTexture"], felt["normalTexture"]):
        info["index"] = 0
    felt["occlusionTexture"]["index"] = 0
    for texture in gltf["textures"]:
        texture["source"] = 1 - texture["source"]
    gltf["animations"][1]["channels"].reverse()


def other_generator(asset: Asset) -> None:
    asset.gltf["asset"]["generator"] = "another"


def defaults_written_out(asset: Asset) -> None:
    hat = node(asset, "hat")
    hat |= {"translation": [0, 0, 0], "rotation": [0, 0, 0, 1], "scale": [1, 1, 1]}
    asset.gltf["meshes"][1]["primitives"][0]["mode"] = 4
    skin, felt, spare = asset.gltf["materials"]
    skin |= {"alphaMode": "OPAQUE", "alphaCutoff": 0.5, "doubleSided": False, "emissiveFactor": [0, 0, 0]}
    skin["pbrMetallicRoughness"] |= {"metallicFactor": 1, "roughnessFactor": 1.0}
    felt["pbrMetallicRoughness"] |= {"baseColorFactor": [1, 1, 1, 1]}
    felt["pbrMetallicRoughness"]["baseColorTexture"]["texCoord"] = 0
    felt["normalTexture"]["scale"] = 1
    felt["occlusionTexture"]["strength"] = 1.0
    spare["pbrMetallicRoughness"] = {}
    asset.gltf["samplers"] = [each | {"wrapT": 10497} for each in asset.gltf["samplers"]]
    asset.gltf["samplers"][1]["wrapS"] = 10497
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
