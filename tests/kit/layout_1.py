"""Extras of layout 1, which `wrinkle` 1.0.0 wrote: a tool whose rest length changes has a control curve in them."""

from functools import cache

from kit.asset import Json
from kit.bakes import bake_once
from kit.places import FOLDER
from kit.player import Gltf
from kit.samples import BROW, Editor

CURVE: Json = {
    "taut": 0.99999,
    "compressible": 0.1,
    "intervals": 8,
    "bumps": [2.0630833, 1.9369167],
    "distances": [0.0, 0.0077392, 0.015478, 0.023217, 0.030957, 0.038696, 0.046435, 0.054174, 0.061913],
    "capacities": [0.006542, 0.0050183, 0.0039876, 0.0032561, 0.0027226, 0.0023234, 0.0020174, 0.0017776, 0.0015856],
    "parts": [0.0, 0.25, 0.5, 0.75, 1.0],
    "rises": [[0.63662], [0.61394], [0.58534], [0.54917], [0.5]],
    "mix": [[305.72, 0.0], [-152.86, 305.72]],
    "least": 0.05,
}
"""The curve of the sample head's brow, with fewer rows, soft tissue, one weight below 0 and a least weight."""

SHORTENINGS = (-0.1, 0.001, 0.04, 0.1, 0.2, 1.0)

DUE = {
    0.04: [[0, 0], [0.080907, 0], [0.51771, -0.25886], [0.8272, -0.4136], [1.0022, 0.054025], [1.0085, 0.50425]],
    0.05: [[0, 0], [0.10113, -0.050567], [0.64714, -0.32357], [1, -0.25792], [1.0012, 0.50059], [1.0081, 0.50407]],
    0.065: [[0, 0], [0.13147, -0.065737], [0.84128, -0.42064], [1.0004, 0.36445], [0.9997, 0.49985], [1.0057, 0.50283]],
}
"""The weights that 1.0.0 makes of the curve at these shortenings, by the rest length."""


@cache
def baked_in_layout_1() -> Gltf:
    """The sample head without tracks, with a tool that has the curve, and a fold that no joint bends."""
    keys = {"think": [[0.0, "100%"], [1.4, "118%"], [3.0, "100%"]], "raise_brows": [[0, "110%"]]}
    brow = {**BROW, "rest_length": {"keys": keys}, "strategy": "both_ends", "bumps": 6}
    editor = Editor(bake_once("head", brow, tracks="none"))
    (entry,) = (node["extras"]["wrinkle"] for node in editor.json["nodes"] if "extras" in node)
    (tool,) = entry["tools"]
    *targets, last = tool["targets"]
    segment = {key: tool[key] for key in ("name", "origin", "target", "rest_length", "rest_length_keys")}
    rows = {"shortenings": [0.0, 0.1], "weights": [[0.0], [1.0]]}
    entry |= {"tools": [{**segment, "targets": targets, "curve": CURVE}]}
    entry |= {"folds": [{**segment, "targets": [last], **rows}]}
    del entry["layout"]
    return Gltf(editor.save(FOLDER / "layout_1.glb"))
