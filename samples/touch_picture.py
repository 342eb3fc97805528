"""Draws pictures/touch.webp: a finger drags the skin of a hand's back, as skin and as a checker.

`python samples/touch_picture.py [FILE]`. The program bakes and draws the sample `touch`. Needs the extra `preview`.
"""

import io
import json
import struct
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from _characters import to_glb
from _touch import make_touch
from make_samples import make_wrist
from wrinklecli import BakeOptions, PreviewOptions, bake, preview

HERE = Path(__file__).resolve().parent
TOOLS = HERE.parent / "configs" / "touch.yaml"


def textured(glb: bytes, image: Image.Image) -> bytes:
    """A binary with a texture on its one material."""
    (size,) = struct.unpack_from("<I", glb, 12)
    gltf: dict[str, Any] = json.loads(glb[20 : 20 + size])
    data = bytearray(glb[28 + size :])
    file = io.BytesIO()
    image.save(file, "PNG")
    data.extend(b"\0" * (-len(data) % 4))
    gltf["bufferViews"].append({"buffer": 0, "byteOffset": len(data), "byteLength": len(file.getvalue())})
    data.extend(file.getvalue() + b"\0" * (-len(file.getvalue()) % 4))
    gltf["buffers"][0]["byteLength"] = len(data)
    gltf["images"] = [{"bufferView": len(gltf["bufferViews"]) - 1, "mimeType": "image/png"}]
    gltf["textures"] = [{"source": 0}]
    gltf["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = {"index": 0}
    gltf["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1.0, 1.0, 1.0, 1.0]
    text = json.dumps(gltf).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sII", b"glTF", 2, 28 + len(text) + len(data))
    return head + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data


def skin() -> Image.Image:
    """A texture of skin: blotches, pores and freckles, so that one sees it slide."""
    rng, size = np.random.default_rng(7), 1024
    shade = np.ones((size, size))
    for cells, depth in ((16, 0.05), (64, 0.05), (256, 0.07), (1024, 0.06)):
        noise = Image.fromarray(rng.random((cells, cells)).astype(np.float32))
        shade += depth * (np.asarray(noise.resize((size, size), Image.Resampling.BICUBIC)) - 0.5)
    freckles = np.zeros((size // 2, size // 2), np.float32)
    freckles[tuple(rng.integers(0, size // 2, (2, 900)))] = rng.random(900)
    shade -= 0.5 * np.asarray(Image.fromarray(freckles).resize((size, size), Image.Resampling.BICUBIC))
    colours = np.array([224.0, 172.0, 146.0]) * np.clip(shade, 0.6, 1.1)[..., None] ** [0.9, 1.1, 1.2]
    return Image.fromarray(np.clip(colours, 0, 255).astype(np.uint8))


def checks() -> Image.Image:
    """A checked texture in two colours of skin."""
    cells = np.add.outer(np.arange(128), np.arange(128)) % 2
    colours = np.array([[214, 160, 134], [158, 104, 84]], np.uint8)[cells]
    return Image.fromarray(colours).resize((1024, 1024), Image.Resampling.NEAREST)


def main(out: Path) -> None:
    """Draw the picture."""
    hand, drawn = to_glb(make_touch(make_wrist())), []
    with tempfile.TemporaryDirectory() as folder:
        for name, image in (("skin", skin()), ("checker", checks())):
            asset, baked = Path(folder) / f"{name}.glb", Path(folder) / f"{name}_baked.glb"
            asset.write_bytes(textured(hand, image))
            for warning in bake(asset, TOOLS, baked, BakeOptions()).warnings:
                print(warning)
            drawn.append(baked)
        options = PreviewOptions(
            fps=12,
            views=("-35:50",),
            focus=(0.045, 0.015, 0.0),
            radius=0.034,
            size=(480, 400),
            labels=("skin", "checker"),
        )
        preview(drawn, out, options)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures" / "touch.webp")
