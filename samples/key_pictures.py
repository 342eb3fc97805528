"""Draws the pictures of keys in the pages of configs: `python samples/key_pictures.py [DIR [KEY…]]`.

A picture shows what one key of the tools file does: its panels differ in that key alone. The program itself wrinkles
and draws them, on a sheet that this script makes or on a sample. Needs the extra `preview`.
"""

import io
import json
import math
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from _characters import Character, Clip, Joint, to_glb
from _shapes import Builder, Floats
from wrinklecli import PreviewOptions, Style, preview

HERE = Path(__file__).resolve().parent
SHEET = (0.10, 0.05)  # metres: half the length along the segment, half the depth
CORNER = (0.05, 0.04)  # metres, x and z: where `pinch` pulls to
MOST = 40  # per cent by which `press` shortens the sheet
WIDE = 964  # pixels of a picture, as of those that `wrinkle preview` draws of two assets
CUT = 26  # pixels at the top of what the program draws, with its own label
CAPTION, GUTTER = 22, 4  # pixels above a panel, and between panels
FONT = 15.0  # pixels, as in those pictures
QUALITY = 80  # per cent, of the webp: with less, letters blur


@dataclass(frozen=True, slots=True)
class Look:
    """What the panels of a picture have in common.

    Attributes:
        asset: Name of a sample, or of a sheet of `write_sheets`.
        clip: Name of the clip that is shown.
        view: Azimuth and elevation of the camera, degrees.
        focus: The point in the middle of a panel, metres, in the stored pose.
        radius: The distance around the focus that a panel shows, metres.
        tool: Keys of the tool.
        refinement: Keys of `refinement`.
        section: The list of the tools file in which the tool stands.
    """

    asset: str
    clip: str
    view: str
    focus: tuple[float, float, float]
    radius: float
    tool: Mapping[str, Any]
    refinement: Mapping[str, Any] = field(default_factory=lambda: {"edges_per_interval": 4})
    section: str = "tools"


@dataclass(frozen=True, slots=True)
class Panel:
    """One panel of a picture.

    Attributes:
        caption: The line above the panel.
        keys: More keys of the tool.
        time: Seconds in the clip.
        refinement: More keys of `refinement`.
        wire: Draw the edges of the triangles.
    """

    caption: str
    keys: Mapping[str, Any]
    time: float = 0.75
    refinement: Mapping[str, Any] = field(default_factory=dict)
    wire: bool = False


CLOTH = (0.33, 0.44, 0.60)  # linear RGB
RAKING = (-0.8, 0.5, 0.33)  # light that grazes what faces the camera, so that one sees low relief

# The tool lies on the front edge of the sheet, so the edge shows a section through the middle of the wrinkles.
CUT_OPEN = Look(
    "sheet",
    "press",
    "0:24",
    (0.0, 0.006, 0.025),
    0.046,
    {"origin": [-0.07, 0.0, 0.05], "target": [0.07, 0.0, 0.05], "width": 0.14, "stops": "none"},
)
# The tool lies in the middle of the sheet, and is seen from above.
ENDS = {"origin": [-0.07, 0.0, 0.0], "target": [0.07, 0.0, 0.0]}
WHOLE = Look("sheet", "press", "0:56", (0.0, 0.0, 0.004), 0.042, {**ENDS, "width": 0.08})
ASIDE = replace(WHOLE, view="62:22", tool={**ENDS, "width": 0.08, "bumps": 2, "variation": 0})
# A quarter of a circle about the corner to which `pinch` pulls.
ARC = [
    [CORNER[0] - 0.06 * math.cos(angle), 0.0, CORNER[1] - 0.06 * math.sin(angle)] for angle in np.linspace(0.0, 1.7, 5)
]
PINCHED = Look("sheet", "pinch", "0:80", (0.012, 0.0, 0.004), 0.05, {"width": 0.045, "bumps": 5, "variation": 0})
COARSE = Look("coarse", "press", "0:40", (0.0, 0.0, 0.02), 0.038, {**CUT_OPEN.tool, "variation": 0}, {})
FOREHEAD = Look(
    "head",
    "raise_brows",
    "0:10",
    (0.0, 0.258, 0.07),
    0.05,
    {
        "name": "brow.L",
        "origin": [0.033, 0.2402, 0.083],
        "target": [0.027, 0.2881, 0.0639],
        "width": 0.06,
        "bumps": 5,
        "profile": "skin",
        "max_height": "4%",
        "compressible": "35%",
    },
)
# One tool across the forehead.
ACROSS: Mapping[str, Any] = {
    "name": "brow",
    "origin": [0.0, 0.2395, 0.089],
    "target": [0.0, 0.2875, 0.0717],
    "width": 0.2,
}
BICEPS = Look(
    "body",
    "curl",
    "90:0",
    (0.27, 1.31, 0.05),
    0.135,
    {"origin": [0.205, 1.368, -0.012], "insertion": [0.382, 1.180, -0.005]},
    section="muscles",
)
RULED: Mapping[str, Any] = {"variation": 0, "max_height": "30%", "bumps": 3}
PRESETS = ("jeans_knee", "cotton_sleeve", "leather_boot", "forehead_old", "wrist", "neck")
LOW: Mapping[str, Any] = {"variation": 0, "bumps": 4}
LAG = {"frequency": 2, "damping": 0.15}


def of_key(key: str, values: Sequence[Any], more: Mapping[str, Any], time: float = 0.75) -> list[Panel]:
    """A panel for each value of a key of the tool."""
    return [Panel(f"{key}: {written(value)}", {**more, key: value}, time) for value in values]


def shortened(key: str, values: Sequence[Any], shares: Sequence[int], more: Mapping[str, Any]) -> list[Panel]:
    """A row for each value of a key; its panels show the sheet shorter by some per cents."""
    return [
        replace(panel, caption=f"{panel.caption}, {share} % shorter" if share else f"{panel.caption}, at rest")
        for value in values
        for share in shares
        for panel in of_key(key, [value], more, share / MOST)
    ]


def refined(key: str, values: Sequence[Any], bumps: int) -> list[Panel]:
    """A panel for each value of a key of `refinement`, with the triangles' edges."""
    return [Panel(f"{key}: {written(value)}", {"bumps": bumps}, 0.75, {key: value}, wire=True) for value in values]


def written(value: Any) -> str:
    """A value as the tools file has it."""
    return value if isinstance(value, str) else json.dumps(value).replace('"', "")


PICTURES: dict[str, tuple[Look, list[Panel]]] = {
    "path": (
        PINCHED,
        [
            Panel("origin and target", {"origin": ARC[0], "target": ARC[-1]}),
            Panel("path of five points", {"path": ARC}),
        ],
    ),
    "width": (WHOLE, of_key("width", (0.02, 0.05, 0.09), RULED)),
    "laid": (
        replace(WHOLE, asset="brow", clip="lift"),
        [
            panel
            for value in ("stored", "raised")
            for time, words in ((0.5, "half"), (1.0, "full"))
            for panel in [Panel(f"laid: {value}, brow raised {words}", {**LOW, "laid": value}, time)]
        ],
    ),
    "mirror": (FOREHEAD, of_key("mirror", ("none", "x"), {})),
    "bumps": (CUT_OPEN, of_key("bumps", (2, 4, 8), {"variation": 0})),
    "gap": (CUT_OPEN, of_key("gap", (0, 1, 3), RULED)),
    "max_height": (CUT_OPEN, of_key("max_height", ("3%", "auto", "none"), LOW, 1.0)),
    "strength": (CUT_OPEN, of_key("strength", (0.5, 1, -1), LOW)),
    "attenuation": (ASIDE, of_key("attenuation", ("bell", "linear"), {})),
    "stops": (replace(CUT_OPEN, view="0:40"), of_key("stops", ("features", "none"), {"variation": 0})),
    "mask": (WHOLE, of_key("mask", ("none", {"image": "spot.png"}), {"bumps": 5})),
    "material": (CUT_OPEN, of_key("material", ("none", "skin", "cloth", "leather"), {})),
    "presets": (WHOLE, of_key("material", PRESETS, {"compressible": "70%"})),
    "profile": (CUT_OPEN, of_key("profile", ("smooth", "skin", "cloth", "polyline"), RULED)),
    "details": (CUT_OPEN, of_key("details", ([], [0.1], [0.4]), RULED)),
    "strategy": (
        CUT_OPEN,
        shortened("strategy", ("everywhere", "origin", "both_ends"), (5, 10, 16), {**LOW, "max_height": "8%"}),
    ),
    "compressible": (CUT_OPEN, shortened("compressible", ("0%", "70%"), (5, 15, 35), LOW)),
    "rest_length": (CUT_OPEN, shortened("rest_length", ("110%", "auto", "85%"), (0, 8, 24), LOW)),
    "lag": (
        replace(CUT_OPEN, clip="tap"),
        [
            Panel(f"{words}, at {time} s", {**LOW, "max_height": "none", "compressible": "70%", "lag": lag}, time)
            for words, lag in (("lag: none", "none"), ("lag: {damping: 0.15, …}", LAG))
            for time in (0.2, 0.42, 0.66)
        ],
    ),
    "variation": (WHOLE, of_key("variation", (0, 0.3, 1), {"bumps": 5})),
    "seed": (WHOLE, of_key("seed", (1, 2, 3), {"bumps": 5, "variation": 0.7})),
    "branch": (WHOLE, of_key("branch", (0, 1), {"bumps": 6, "seed": 3, "variation": 0.5})),
    "broken": (FOREHEAD, of_key("broken", (0, 0.5, 1), {**ACROSS, "seed": 5, "variation": 0.5, "branch": 0})),
    "bow": (WHOLE, of_key("bow", (-1, 0, 1), {"variation": 0})),
    "max_levels": (COARSE, refined("max_levels", (0, 1, 4), 6)),
    "edges_per_interval": (COARSE, refined("edges_per_interval", (1, 2, 4), 3)),
    "thickness": (BICEPS, of_key("thickness", ("40%", "auto", "190%"), {"travel": False}, 1.0)),
}


def write_sheets(folder: Path) -> None:
    """Write the sheets as assets, and an image for a mask: a dark spot with soft borders, left of the middle."""
    xs, ys = np.meshgrid(np.linspace(-1.0, 1.0, 256), np.linspace(-0.5, 0.5, 128))
    spot = np.clip((np.hypot(xs + 0.12, ys + 0.05) - 0.12) / 0.1, 0.0, 1.0)
    Image.fromarray((255 * spot).astype(np.uint8)).save(folder / "spot.png")
    for each in (sheet("sheet", 50, 26), sheet("coarse", 10, 5)):
        (folder / f"{each.name}.glb").write_bytes(to_glb(each))
    plain = sheet("brow", 50, 26)
    x, _, z = plain.mesh.positions.T
    # A brow at one end of the sheet rises in two arches, least in the middle.
    arch = 0.6 + 0.4 * np.sin(np.pi * z / SHEET[1]) ** 2
    lifted = np.stack([0.05 * (0.5 - 0.5 * x / SHEET[0]) * arch, 0.0 * x, 0.0 * x], axis=1)
    times = np.linspace(0.0, 1.0, 31)
    brow = replace(plain, clips=(Clip("lift", times, weights=times[:, None]),), morphs={"lift": lifted})
    (folder / "brow.glb").write_bytes(to_glb(brow))


def sheet(name: str, columns: int, rows: int) -> Character:
    """A level sheet. Clip `press` shortens it along x in 1 s, `tap` in 0.2 s, and `pinch` pulls all to one corner."""
    wide, deep = SHEET
    xs, zs = np.meshgrid(np.linspace(-wide, wide, columns + 1), np.linspace(deep, -deep, rows + 1))
    builder = Builder()
    ids = builder.add(np.stack([xs, 0.0 * xs, zs], axis=-1))
    builder.grid(ids, (0.0, 0.0), (1.0, 1.0))
    mesh = builder.mesh(border=ids[0], border_axis=2)
    pressed: Floats = mesh.positions * [-MOST / 100, 0.0, 0.0]
    pinched: Floats = (mesh.positions - [CORNER[0], 0.0, CORNER[1]]) * -0.4
    times = np.linspace(0.0, 1.0, 31)
    nothing, tapped = 0.0 * times, 0.6 * np.minimum(times / 0.2, 1.0)
    return Character(
        name=name,
        mesh=mesh,
        joints=(Joint("root", None, (0.0, 0.0, 0.0)),),
        weights=np.ones((len(mesh.positions), 1)),
        clips=(
            Clip("press", times, weights=np.stack([times, nothing], axis=1)),
            Clip("pinch", times, weights=np.stack([nothing, times], axis=1)),
            Clip("tap", times, weights=np.stack([tapped, nothing], axis=1)),
        ),
        colour=CLOTH,
        material="cloth",
        roughness=1.0,
        double_sided=True,
        morphs={"press": pressed, "pinch": pinched},
    )


def draw(look: Look, panel: Panel, folder: Path, size: tuple[int, int]) -> Image.Image:
    """One panel of a size, without its caption."""
    tool = {"name": "tool", **look.tool, **panel.keys}
    tools, out = folder / "tools.yaml", folder / "panel.png"
    refinement = {**look.refinement, **panel.refinement}
    tools.write_text(json.dumps({"version": 1, "refinement": refinement, look.section: [tool]}))
    asset = next(path for path in (folder / f"{look.asset}.glb", HERE / f"{look.asset}.glb") if path.exists())
    options = PreviewOptions(
        tools=tools,
        hide_tools=True,
        clips=(look.clip,),
        times=(panel.time,),
        views=(look.view,),
        focus=look.focus,
        radius=look.radius,
        follow=True,
        size=(size[0], size[1] + 2 * CUT),
        style=Style(wire=panel.wire, key=RAKING),
    )
    made = preview([asset], out, options)
    for warning in made.warnings:
        print(f"{panel.caption}: {warning}")
    with Image.open(out) as picture:
        return picture.convert("RGB").crop((0, CUT, size[0], CUT + size[1]))


def places(count: int) -> tuple[list[tuple[int, int]], tuple[int, int]]:
    """The corners of so many panels, of which two or four stand in one row, others in rows of three; and their size."""
    columns = count if count in (2, 4) else 3
    wide = (WIDE + GUTTER) // columns - GUTTER
    size = wide, wide // 2
    cells = (divmod(number, columns) for number in range(count))
    return [(c * (wide + GUTTER), r * (size[1] + CAPTION + GUTTER) + CAPTION) for r, c in cells], size


def captioned(panels: list[Panel]) -> Image.Image:
    """A picture that has the captions of its panels alone."""
    corners, size = places(len(panels))
    picture = Image.new("RGB", (WIDE, corners[-1][1] + size[1]), "white")
    pen, font = ImageDraw.Draw(picture), ImageFont.load_default(FONT)
    for panel, (x, y) in zip(panels, corners, strict=True):
        pen.text((x + 4, y - CAPTION + 2), panel.caption, fill=(60, 66, 74), font=font)
    return picture


def packed(picture: Image.Image) -> bytes:
    """A picture as it is kept."""
    data = io.BytesIO()
    picture.save(data, "webp", quality=QUALITY, method=6)
    return data.getvalue()


def table(look: Look, panels: list[Panel], folder: Path) -> bytes:
    """All panels, each below its caption, as they are kept."""
    picture, (corners, size) = captioned(panels), places(len(panels))
    for panel, corner in zip(panels, corners, strict=True):
        picture.paste(draw(look, panel, folder, size), corner)
    return packed(picture)


def main(out: Path, keys: list[str]) -> None:
    """Draw all pictures, or those of some keys, into a folder."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        write_sheets(Path(folder))
        for key in keys or PICTURES:
            (out / f"key_{key}.webp").write_bytes(table(*PICTURES[key], Path(folder)))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures", sys.argv[2:])
