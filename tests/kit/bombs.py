"""Small files that ask for gigabytes, one for each way that glTF and its compressions have of asking."""

import json
import os
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

from kit.asset import Asset, Json, pack_glb, read_glb
from kit.bakes import bake_once
from kit.limb import limb_asset, tool
from wrinklecli.gltf.shape import DRACO, MESHOPT

SMALL: Json = {"rings": 7, "sides": 6}
MUCH = 4 * 10**9  # bytes


def _numbers(count: int) -> bytes:
    """A number in Draco's varint: seven bits a byte, the lowest first."""
    found = b""
    while count > 127:
        found, count = found + bytes([count & 127 | 128]), count >> 7
    return found + bytes([count])


def _packed(stream: bytes, count: int) -> Asset:
    """A limb whose geometry is said to be in a Draco stream."""
    asset = limb_asset(**SMALL)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    for index in (*primitive["attributes"].values(), primitive["indices"]):
        accessor = asset.gltf["accessors"][index]
        del accessor["bufferView"]
        accessor["count"] = count
    names = {name: number for number, name in enumerate(primitive["attributes"])}
    primitive["extensions"] = {DRACO: {"bufferView": asset.view(stream), "attributes": names}}
    asset.gltf["extensionsRequired"] = asset.gltf["extensionsUsed"] = [DRACO]
    return asset


def edgebreaker(folder: Path) -> Path:
    """A Draco stream of 2.8 kB whose header promises 300 million triangles."""
    head = b"DRACO" + bytes([2, 2, 1, 1, 0, 0, 0]) + 2 * _numbers(300_000_000) + b"\1" + _numbers(299_999_000) + b"\0"
    return _packed(head + bytes(2800), 2**26).write(folder / "edgebreaker.glb")


def sequential(folder: Path) -> Path:
    """The same by Draco's other method."""
    head = b"DRACO" + bytes([2, 2, 1, 0, 0, 0]) + 2 * _numbers(300_000_000) + b"\1"
    return _packed(head + bytes(2800), 2**26).write(folder / "sequential.glb")


def unstored(folder: Path) -> Path:
    """Positions of a large file that are zeros of no view."""
    asset = limb_asset(**SMALL)
    asset.view(bytes(1_100_000))
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    for index in primitive["attributes"].values():
        asset.gltf["accessors"][index]["count"] = 2**26
        del asset.gltf["accessors"][index]["bufferView"]
    return asset.write(folder / "unstored.glb")


def sparse(folder: Path) -> Path:
    """As many, one of which is stored."""
    asset = limb_asset(**SMALL)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    index, value = asset.view(bytes(4)), asset.view(bytes(16))
    parts = {"indices": {"bufferView": index, "componentType": 5125}, "values": {"bufferView": value}}
    asset.view(bytes(1_100_000))
    for number in primitive["attributes"].values():
        asset.gltf["accessors"][number] |= {"count": 2**26, "sparse": {"count": 1, **parts}}
        del asset.gltf["accessors"][number]["bufferView"]
    return asset.write(folder / "sparse.glb")


def overlapping(folder: Path) -> Path:
    """A thousand morph targets of one view of a megabyte, each by an accessor of its own."""
    asset = Asset()
    count = 100_000
    view = asset.view(bytes(12 * count))
    described = {"bufferView": view, "componentType": 5126, "count": count, "type": "VEC3"}
    first = [asset.append("accessors", dict(described)) for _ in range(1001)]
    targets = [{"POSITION": index} for index in first[1:]]
    indices = asset.accessor(np.arange(3), "u2")
    primitive = {"attributes": {"POSITION": first[0]}, "indices": indices, "targets": targets}
    asset.append("meshes", {"primitives": [primitive]})
    asset.append("nodes", {"mesh": 0, "name": "limb"})
    return asset.write(folder / "overlapping.glb")


def morph_targets(folder: Path) -> Path:
    """Half a megabyte of morph targets, all of one accessor."""
    asset = limb_asset(rings=60, sides=60, morphs=1)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    primitive["targets"] *= 30_000
    return asset.write(folder / "morph_targets.glb")


def attributes(folder: Path) -> Path:
    """265 kB of meshopt that are 270 MB of positions."""
    stride, blocks = 12, 88_000
    stream = b"\xa1" + b"\xaa" * (blocks * stride // 4) + bytes(24)
    asset = limb_asset(**SMALL)
    (primitive,) = asset.gltf["meshes"][0]["primitives"]
    count = 256 * blocks
    packed = {"buffer": 0, "count": count, "byteStride": stride, "mode": "ATTRIBUTES", "filter": "NONE"}
    view = asset.gltf["bufferViews"][asset.view(stream)]
    packed |= {"byteOffset": view["byteOffset"], "byteLength": view["byteLength"]}
    view |= {"byteLength": count * stride, "extensions": {MESHOPT[0]: packed}}
    position = asset.gltf["accessors"][primitive["attributes"]["POSITION"]]
    position |= {"bufferView": len(asset.gltf["bufferViews"]) - 1, "byteOffset": 0, "count": count}
    asset.gltf["extensionsRequired"] = asset.gltf["extensionsUsed"] = [MESHOPT[0]]
    return asset.write(folder / "attributes.glb")


def record(folder: Path) -> Path:
    """An earlier bake whose record says that it unpacks to 4 GB, and does."""
    limb = limb_asset(**SMALL).write(folder / "limb.glb")
    gltf, data = read_glb(bake_once(limb, tool()).path.read_bytes())
    view = gltf["bufferViews"][-1]
    old = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
    (count,) = struct.unpack_from("<I", old, 32)
    block = 2**17
    # RFC 8878: a frame of one segment that says its size, in blocks of one byte repeated.
    frame = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", MUCH // block * block)
    kind = [(block << 3 | 1 << 1 | (k == MUCH // block - 1)) for k in range(MUCH // block)]
    frame += b"".join(struct.pack("<I", each)[:3] + b" " for each in kind)
    forged = old[: 36 + 16 * count] + frame
    gltf["buffers"][0]["byteLength"] = view["byteOffset"] + len(forged)
    view["byteLength"] = len(forged)
    path = folder / "record.glb"
    path.write_bytes(pack_glb(json.dumps(gltf).encode(), data[: view["byteOffset"]] + forged))
    return path


def values(folder: Path, count: int = 10_000_000) -> Path:
    """Many values of three bytes of JSON each."""
    path = folder / "values.gltf"
    path.write_text('{"asset": {"version": "2.0"}, "extras": [' + "{}," * count + "0]}")
    return path


def hole(folder: Path) -> Path:
    """3 GB of which none is on the disk."""
    path = folder / "hole.glb"
    path.write_bytes(limb_asset(**SMALL).glb())
    os.truncate(path, 3 * 10**9)
    return path


BOMBS: dict[str, Callable[[Path], Path]] = {
    each.__name__: each
    for each in (
        edgebreaker,
        sequential,
        unstored,
        sparse,
        overlapping,
        morph_targets,
        attributes,
        record,
        values,
        hole,
    )
}


def many_buffers(folder: Path, *, count: int = 4000) -> Path:
    """A limb with so many buffers, all of which are one file of a megabyte."""
    asset = limb_asset(**SMALL)
    asset.data += bytes(10**6 - len(asset.data))
    path = asset.write(folder / "buffers.gltf")
    gltf = json.loads(path.read_text())
    gltf["buffers"] *= count
    path.write_text(json.dumps(gltf))
    return path


def many_images(folder: Path, *, count: int = 4000) -> Path:
    """A limb with so many images, all of which are one file of a megabyte."""
    asset = limb_asset(**SMALL)
    asset.gltf["images"] = [{"uri": "image.png"} for _ in range(count)]
    (folder / "image.png").write_bytes(b"\x89PNG" + bytes(10**6))
    return asset.write(folder / "images.gltf")
