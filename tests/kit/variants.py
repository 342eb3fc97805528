"""Limbs in files that hold much else: extensions, images, cameras, unknown keys, buffers in several places."""

import json
from base64 import b64encode
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from kit.asset import Asset, Json
from kit.limb import limb_asset

PICTURE = b"\x89PNG\r\n\x1a\n" + bytes(range(200))
SMALL: Json = {"rings": 9, "sides": 8}


def rich(**options: Any) -> Asset:
    """A folding limb with a hat on a node of its own: all kinds of things to differ in."""
    settings: Json = {"joints": 3, "morphs": 2, "morph_clip": "LINEAR", "weights_at": "mesh", "colors": True}
    asset = limb_asset(**{**SMALL, **settings, **options})
    gltf = asset.gltf
    gltf["asset"] |= {"generator": "a test", "copyright": "someone"}
    corners = [[0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0.5]]
    hat: Json = {
        "attributes": {"POSITION": asset.accessor(corners, bounds=True), "_ID": asset.accessor([1, 2, 3, 4], "u2")},
        "indices": asset.accessor([0, 1, 2, 1, 3, 2], "u2"),
        "material": 1,
    }
    asset.append("meshes", {"name": "hat", "primitives": [hat]})
    node = asset.append("nodes", {"name": "hat", "mesh": 1, "camera": 0, "extras": {"price": 3.5, "tags": ["red"]}})
    gltf["scenes"][0]["nodes"].append(node)
    gltf["meshes"][0]["name"] = "limb"
    gltf["meshes"][0]["primitives"][0]["material"] = 0
    skin = {"name": "skin", "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.5, 0.4, 1.0]}}
    felt = {
        "name": "felt",
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
        },
        "normalTexture": {"index": 1},
        "occlusionTexture": {"index": 1},
        "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 0.25, "clearcoatTexture": {"index": 1}}},
    }
    gltf["materials"] = [skin, felt, {"name": "spare"}]
    gltf["textures"] = [{"source": 0, "sampler": 0}, {"source": 1, "sampler": 1}]
    gltf["samplers"] = [{"magFilter": 9729, "wrapS": 33071}, {"magFilter": 9729}]
    gltf["images"] = [
        {"name": "felt", "mimeType": "image/png", "bufferView": asset.view(PICTURE)},
        {"name": "coat", "mimeType": "image/png", "bufferView": asset.view(PICTURE[::-1])},
    ]
    gltf["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01}}]
    gltf["extensionsUsed"] = ["KHR_texture_transform", "KHR_materials_clearcoat"]
    gltf["extras"] = {"level": 3, "note": "kept"}
    nod: Json = {"name": "nod"}
    asset.channel(nod, node, "translation", [0, 1, 2], [[0, 0, 0], [0, 0.1, 0], [0, 0, 0]])
    asset.append("animations", nod)
    return asset


def crowd(asset: Asset) -> None:
    """Extensions, extras, unknown keys, odd names and objects that nobody uses, at every level of the document."""
    gltf = asset.gltf
    gltf["asset"] |= {"generator": "by hand", "minVersion": "2.0", "extras": None}
    gltf["extensionsUsed"] = ["KHR_lights_punctual", "EXT_nobody_knows", "KHR_materials_unlit"]
    gltf["extensions"] = {
        "EXT_nobody_knows": {"b": 1, "a": [None, {"deep": [1.50, 1e-7, 12345678901234567890]}]},
        "KHR_lights_punctual": {"lights": [{"type": "point", "name": "lamp"}]},
    }
    gltf["unknown"] = {"z": 1, "a": {}}
    gltf["extras"] = [None, {}, [], "", 0, 0.0, False, "\u2603 \u00e4"]
    gltf["cameras"] = [{"type": "orthographic", "orthographic": {"xmag": 1.0, "ymag": 2, "zfar": 3, "znear": 0}}]
    gltf["samplers"] = [{"name": "", "magFilter": 9728}, {}]
    gltf["materials"] = [{"extensions": {"KHR_materials_unlit": {}}, "name": "unused"}, {"alphaCutoff": 0.25}]
    gltf["materials"][1] |= {"alphaMode": "MASK", "unknown": 1}
    gltf["scenes"].append({"name": "empty", "extras": {"x": 1}})
    gltf["nodes"].append({"name": "unused", "camera": 0, "unknown": [], "extras": {"wrinkle": "not ours"}})
    gltf["nodes"][0] |= {"extras": {"rigger": {"z": 1, "a": 2}}, "extensions": {"EXT_nobody_knows": {"node": 0}}}
    mesh = gltf["meshes"][0]
    mesh |= {"name": 'limb "mesh"', "unknown": True, "extensions": {"EXT_nobody_knows": {}}}
    mesh["primitives"][0] |= {"extras": {"part": 1}, "unknown": {"key": 1}, "material": 1}
    mesh.setdefault("extras", {})["owner"] = "me"
    stray = asset.accessor([[0, 0, 0], [1, 0, 0], [0, 1, 0]], bounds=True, name="stray", extras={"kept": True})
    gltf["meshes"].append({"primitives": [{"attributes": {"POSITION": stray}}], "name": "unused"})
    asset.accessor(np.arange(5), "u2", name="used by nobody")
    asset.view(bytes(range(99)))
    gltf["bufferViews"][-1] |= {"name": "used by nobody", "unknown": 1}
    gltf["skins"][0] |= {"name": "skin", "extras": 1}
    gltf["animations"][0] |= {"extras": {"loop": True}, "unknown": 0}
    gltf["animations"][0]["samplers"][0]["extras"] = {"eased": True}
    gltf["animations"][0]["channels"][0]["extras"] = 7
    # Unusual orders of keys, at the top and below.
    for each in (gltf, gltf["nodes"][1], gltf["animations"][0]):
        for key in sorted(each, reverse=True):
            each[key] = each.pop(key)


PNG = b"\x89PNG\r\n\x1a\n" + bytes(range(50))


def scattered(folder: Path) -> Path:
    """A .gltf with a buffer beside it, one of an encoded name in a folder below and one in a data URI; images alike."""
    asset = limb_asset(rings=13, morphs=1, morph_clip="LINEAR")
    asset.gltf["images"] = [
        {"uri": "skin.png"},
        {"uri": "my%20pictures/%C3%A4%231.png", "name": "ä"},
        {"uri": "data:image/png;base64,iVBORw0KGgo="},
        {"bufferView": asset.view(PNG + b"view"), "mimeType": "image/png"},
    ]
    text = json.loads(asset.write(folder / "whole.gltf").read_text())
    (folder / "whole.gltf").unlink()
    (folder / "whole.bin").unlink()
    data = bytes(asset.data)
    ends = [0, len(data) // 3, 2 * len(data) // 3, len(data)]
    starts = sorted(view["byteOffset"] for view in text["bufferViews"])
    cuts = [min(start for start in [*starts, len(data)] if start >= end) for end in ends]
    parts = [data[low:high] for low, high in pairwise(cuts)]
    for view in text["bufferViews"]:
        number = max(k for k in range(3) if cuts[k] <= view["byteOffset"])
        view |= {"buffer": number, "byteOffset": view["byteOffset"] - cuts[number]}
    (folder / "my pictures").mkdir()
    (folder / "skin.png").write_bytes(PNG)
    (folder / "my pictures" / "ä#1.png").write_bytes(PNG + b"ae")
    (folder / "plain.bin").write_bytes(parts[0])
    (folder / "my pictures" / "b%.bin").write_bytes(parts[1])
    uris = [
        "plain.bin",
        "my%20pictures/b%25.bin",
        "data:application/octet-stream;base64," + b64encode(parts[2]).decode(),
    ]
    text["buffers"] = [{"uri": uri, "byteLength": len(part)} for uri, part in zip(uris, parts, strict=True)]
    (folder / "a.gltf").write_text(json.dumps(text))
    return folder / "a.gltf"
