"""Draws pictures/contact.png: an elbow with and without contact, each beside a section through its fold.

`python samples/contact_picture.py [FILE]`. The program itself wrinkles, bakes and draws an arm that this script makes.
Where the skin passes through itself, the section is red. Needs the extras `preview` and `contact`.
"""

import json
import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from _characters import Character, Clip, Joint, to_glb
from _shapes import Builder, Floats, Ints, smoothstep, spline
from touch_picture import skin, textured
from wrinklecli import BakeOptions, PreviewOptions, Style, bake, preview
from wrinklecli.character.clip import read_clips
from wrinklecli.character.scene_surface import read_scene_surface
from wrinklecli.gltf.document import read_document

HERE = Path(__file__).resolve().parent
ANGLE = 118.0  # degrees by which the elbow folds
RINGS, SIDES = 60, 36  # of the arm
BLEND = 0.11  # metres along the arm over which skin weights change
ELBOW = {"name": "elbow", "origin": [-0.1, 0.043, 0.0], "target": [0.1, 0.041, 0.0], "width": 0.09, "bumps": 4,
         "material": "skin", "max_height": "7%", "compressible": "70%", "rest_length": "90%"}  # fmt: skip
PANEL = (480, 400)  # pixels
CUT = 26  # pixels at the top of what the program draws, with its own label
GUTTER, CAPTION = 4, 26  # pixels between panels, and above
FINE = 4  # samples of the section in a pixel's width
FOCUS, RADIUS = (-0.03, 0.045), 0.115  # metres: what the section shows, in the plane of the fold
SKIN, RED, INK, GROUND = (232, 196, 176), (206, 38, 38), (72, 40, 30), (236, 240, 243)
COLOURS = 128  # in the picture's palette


def arm() -> Character:
    """An arm along x that folds about z, towards y."""
    xs = np.linspace(-0.24, 0.24, RINGS)
    radii = spline([-0.24, -0.12, 0.0, 0.07, 0.24], [0.050, 0.050, 0.041, 0.043, 0.029], xs)
    turns = 2.0 * math.pi * np.arange(SIDES) / SIDES
    around = np.stack([0.0 * turns, np.cos(turns), np.sin(turns)], axis=1)
    builder = Builder()
    ids = builder.add(radii[:, None, None] * around + xs[:, None, None] * [1.0, 0.0, 0.0])
    builder.grid(np.column_stack([ids, ids[:, :1]]), (0.0, 0.0), (1.0, 1.0))
    for ring, sign in ((ids[0], -1.0), (ids[-1], 1.0)):
        tip = int(builder.add(np.array([sign * 0.255, 0.0, 0.0])))
        for k in range(SIDES):
            corners = [int(ring[k]), int(ring[(k + 1) % SIDES]), tip]
            builder.triangle(corners if sign > 0 else [corners[1], corners[0], tip], [(0.0, 0.0)] * 3)
    mesh = builder.mesh(border=np.zeros(0, np.intp), border_axis=0)
    lower = smoothstep(-BLEND / 2, BLEND / 2, mesh.positions[:, 0])
    halves = np.radians(np.linspace(0.0, ANGLE, 31)) / 2.0
    turned = np.stack([0.0 * halves, 0.0 * halves, np.sin(halves), np.cos(halves)], axis=1)
    return Character(
        name="arm",
        mesh=mesh,
        joints=(Joint("upper_arm", None, (-0.24, 0.0, 0.0)), Joint("lower_arm", "upper_arm", (0.0, 0.0, 0.0))),
        weights=np.stack([1.0 - lower, lower], axis=1),
        clips=(Clip("fold", np.linspace(0.0, 1.0, 31), {"lower_arm": turned}),),
        colour=(0.80, 0.52, 0.41),
        material="skin",
        roughness=0.9,
    )


def shaded(baked: Path, folder: Path) -> Image.Image:
    """The fold as the program draws it."""
    out = folder / "panel.png"
    options = PreviewOptions(
        clips=("fold",),
        times=(1.0,),
        views=("-32:34",),
        focus=(FOCUS[0], FOCUS[1], 0.0),
        radius=RADIUS,
        size=(PANEL[0], PANEL[1] + 2 * CUT),
        style=Style(key=(0.62, 0.62, 0.48)),
    )
    preview([baked], out, options)
    with Image.open(out) as picture:
        return picture.convert("RGB").crop((0, CUT, PANEL[0], CUT + PANEL[1]))


def section(baked: Path) -> Image.Image:
    """The plane z = 0 of the folded arm: what is inside of the skin, and in red what is so twice, or inside out."""
    document = read_document(baked)
    surface = read_scene_surface(document, wholes={})
    places = surface.posed(read_clips(document)[0], np.array([1.0]))[0]
    lines = cut(places[surface.crossings.triangles])
    wide, high = FINE * PANEL[0], FINE * PANEL[1]
    scale = min(wide, high) / (2.0 * RADIUS)
    drawn = (lines - FOCUS) * [scale, -scale] + [wide / 2, high / 2]
    counts = windings(drawn, wide, high)
    pixels = np.empty((high, wide, 3), np.uint8)
    pixels[:] = GROUND
    pixels[counts == 1] = SKIN
    pixels[(counts > 1) | (counts < 0)] = RED
    picture = Image.fromarray(pixels)
    pen = ImageDraw.Draw(picture)
    for line in drawn:
        pen.line([tuple(end) for end in line.tolist()], fill=INK, width=2 * FINE)
    return picture.resize(PANEL, Image.Resampling.BOX)


def cut(corners: Floats) -> Floats:
    """(lines, 2, 2) where (triangles, 3, 3) corners pass through the plane z = 0, each with the inside to its left."""
    above = corners[:, :, 2] > 0.0
    through = above.any(axis=1) & ~above.all(axis=1)
    corners, above = corners[through], above[through]
    # Two sides pass through the plane: those from the corner that is alone on its side.
    lone = above == (above.sum(axis=1) == 1)[:, None]
    alone = np.argmax(lone, axis=1)
    rows = np.arange(len(corners))
    a, b, c = (corners[rows, (alone + k) % 3] for k in range(3))
    ends = np.stack([a + (a[:, 2] / (a - each)[:, 2])[:, None] * (each - a) for each in (b, c)], axis=1)[:, :, :2]
    swapped = a[:, 2] < 0.0
    ends[swapped] = ends[swapped, ::-1]
    return ends


def windings(lines: Floats, wide: int, high: int) -> Ints:
    """(high, wide) how often (lines, 2, 2) closed lines, in pixels, go round each pixel."""
    steps = np.zeros((high, wide + 1), np.intp)
    for (x0, y0), (x1, y1) in lines.tolist():
        low, top = sorted((y0, y1))
        rows = np.arange(max(math.ceil(low - 0.5), 0), min(math.ceil(top - 0.5), high))
        if len(rows):
            at = x0 + (rows + 0.5 - y0) / (y1 - y0) * (x1 - x0)
            columns = np.clip(np.ceil(at - 0.5), 0, wide).astype(int)
            np.add.at(steps, (rows, columns), 1 if y1 > y0 else -1)
    return np.cumsum(steps, axis=1)[:, :wide]


def main(out: Path) -> None:
    """Draw the picture."""
    wide, high = 2 * PANEL[0] + GUTTER, 2 * (PANEL[1] + CAPTION)
    picture = Image.new("RGB", (wide, high), "white")
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(15.0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        asset, tools, baked = folder / "arm.glb", folder / "tools.yaml", folder / "baked.glb"
        asset.write_bytes(textured(to_glb(arm()), skin()))
        for number, contact in enumerate(("off", "resolve")):
            settings = {"version": 1, "refinement": {"max_levels": 2}, "tools": [{**ELBOW, "contact": contact}]}
            tools.write_text(json.dumps(settings), encoding="utf-8")
            for warning in bake(asset, tools, baked, BakeOptions()).warnings:
                print(f"contact: {contact}: {warning}")
            top = number * (PANEL[1] + CAPTION)
            pen.text((4, top + 4), f"contact: {contact}, and a section through the fold", fill=(60, 66, 74), font=font)
            picture.paste(shaded(baked, folder), (0, top + CAPTION))
            picture.paste(section(baked), (PANEL[0] + GUTTER, top + CAPTION))
    out.parent.mkdir(parents=True, exist_ok=True)
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(out, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures" / "contact.png")
