"""Draws pictures/touch.webp: a finger drags the skin of a hand's back, with a checked texture and without.

`python samples/touch_picture.py [FILE]`. The hand is the sample `wrist` with a finger more, which a clip of its own
moves. The program itself bakes and draws it. A second argument is a folder that keeps what was baked. Needs the extra
`preview`.
"""

import io
import json
import struct
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from _panels import frames_of, run, save_panels
from make_samples import make_wrist
from wrinklecli import BakeOptions, PreviewOptions, bake
from wrinklecli.example.characters import Character, Clip, Joint, to_glb
from wrinklecli.example.shapes import Builder, Floats, smoothstep

HERE = Path(__file__).resolve().parent
AT = (0.042, 0.0178, 0.0)
RADIUS = 0.0065  # metres, of the finger's tip
HIGH = 0.03  # metres, of the tip above the skin at rest
PRESSED = 0.0012  # metres, of the tip below the skin
SECONDS = 3.0
TOUCH = {
    "name": "back",
    "at": AT,
    "towards": [0.0, 0.0178, 0.0],
    "pad": 0.009,
    "reach": 0.013,
    "grip": 0.008,
    "by": {"joint": "tip", "offset": [0.0, -RADIUS, 0.0]},
    "wrinkles": {"bumps": 4, "directions": 12},
}
VIEWS = ("-35:50", "40:22")
SIZE = (260, 200)  # pixels of each picture
FPS = 12


def finger(hand: Character) -> Character:
    """The hand with a finger that a clip `drag` lets touch its back, drag it round, and leave."""
    builder, rows, columns = Builder(), 14, 20
    axis, length = np.array([0.6, 0.8, -0.35]), 0.07
    axis = axis / np.sqrt(axis @ axis)
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side = side / np.sqrt(side @ side)
    other = np.cross(axis, side)
    top = np.array([AT[0], AT[1] + HIGH + RADIUS, AT[2]])
    rings = []
    for row in range(rows + 1):
        # Half a sphere, then a tube that gets a little wider.
        bent = min(row / (rows - 4), 1.0) * np.pi / 2.0
        along = -RADIUS * np.cos(bent) + max(row - rows + 4, 0) / 4.0 * length
        wide = RADIUS * (np.sin(bent) + 0.15 * max(row - rows + 4, 0) / 4.0)
        angles = np.arange(columns + 1) % columns * (2.0 * np.pi / columns)
        ring = np.cos(angles)[:, None] * side + np.sin(angles)[:, None] * other
        rings.append(top + along * axis + wide * ring)
    ids = builder.add(np.array(rings)[:, :columns])
    builder.grid(np.concatenate([ids, ids[:, :1]], axis=1), (0.0, 0.0), (0.05, 0.05))
    own = builder.mesh(border=ids[-1], border_axis=0)
    mesh, count = hand.mesh, len(hand.mesh.positions)
    joined = replace(
        mesh,
        positions=np.concatenate([mesh.positions, own.positions]),
        quads=np.concatenate([mesh.quads, own.quads + count]),
        uvs=np.concatenate([mesh.uvs, own.uvs]),
        held=np.concatenate([mesh.held, own.held]),
        border=np.concatenate([mesh.border, own.border]),
    )
    weights = np.zeros((len(joined.positions), hand.weights.shape[1] + 1))
    weights[:count, :-1] = hand.weights
    weights[count:, -1] = 1.0
    joints = (*hand.joints, Joint("tip", None, (top[0], top[1], top[2])))
    clip = Clip("drag", *drag())
    return replace(hand, mesh=joined, weights=weights, joints=joints, clips=(clip,))


def drag() -> tuple[Floats, dict[str, Floats], dict[str, Floats]]:
    """(keys,) seconds, no rotations, and the offsets of the finger."""
    times = np.arange(round(SECONDS * 30) + 1) / 30.0
    down = smoothstep(0.1, 0.5, times) * smoothstep(2.55, 2.2, times)
    forward = smoothstep(0.6, 1.1, times) - smoothstep(1.25, 1.9, times)
    sideways = smoothstep(1.25, 1.9, times)
    moves = np.stack([-0.009 * forward, -(HIGH + PRESSED) * down, 0.008 * sideways], axis=1)
    return times, {}, {"tip": moves}


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


def checks() -> Image.Image:
    """A checked texture in two colours of skin."""
    cells = np.add.outer(np.arange(128), np.arange(128)) % 2
    colours = np.array([[214, 160, 134], [158, 104, 84]], np.uint8)[cells]
    return Image.fromarray(colours).resize((1024, 1024), Image.Resampling.NEAREST)


def main(out: Path, folder: Path) -> None:
    """Draw the picture."""
    hand = to_glb(finger(make_wrist()))
    tools, panels = folder / "touch.yaml", []
    tools.write_text(json.dumps({"version": 1, "touches": [TOUCH]}), encoding="utf-8")
    for name, glb in (("skin", hand), ("checked", textured(hand, checks()))):
        asset, baked = folder / f"{name}.glb", folder / f"{name}_baked.glb"
        asset.write_bytes(glb)
        for warning in bake(asset, tools, baked, BakeOptions()).warnings:
            print(warning)
        for number, view in enumerate(VIEWS):
            options = PreviewOptions(
                clips=("drag",), fps=FPS, views=(view,), focus=(0.045, 0.015, 0.0), radius=0.034, size=SIZE
            )
            panels.append(frames_of([baked], folder / f"{name}_{number}.webp", options))
    save_panels(panels, out, fps=FPS, quality=70)


if __name__ == "__main__":
    run(main, sys.argv[1:], HERE / "pictures" / "touch.webp")
