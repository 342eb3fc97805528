"""The lines that `check` prints for a wrinkling tool."""

import math
from typing import Any

from wrinklecli.errors import aligned
from wrinklecli.gltf.shape import Json


def lines_of(tool: Json) -> list[str]:
    """The lines of a tool's table."""
    overlaps = ", ".join(f"{each['tool']} ({each['vertices']} vertices)" for each in tool["overlaps"])
    overlaps += ", and more" if tool.get("more_overlaps") else ""
    length = f"{tool['distance']:.4g} at rest"
    if tool["rest_length"] != tool["distance"]:
        length += f", shortening counts from {tool['rest_length']:.4g}"
    rows = [
        f"origin   {_anchor(tool['origin'])}",
        *(f"path[{k}]  {_anchor(each)}" for k, each in enumerate(tool.get("between", []), start=1)),
        f"target   {_anchor(tool['target'])}",
        f"length   {length}; width {tool['width']:.4g}",
        f"laid     {_pose(tool['laid'])}",
        f"bumps    {tool['bumps']}, {tool['strategy']}, at most {tool['height_limit']:.3g} tall",
        f"tissue   {_tissue(tool)}",
        f"mesh     {tool['triangles']} triangles, {tool['edges_split']} edges to split;"
        f" {tool['moved_vertices']} vertices move",
        *(
            [f"stops    at features, which leave {_percent(100 * tool['left_by_features'])} % of the wrinkles"]
            if "left_by_features" in tool
            else []
        ),
        *([f"mask     leaves {_percent(100 * tool['mask'])} % of the patch"] if "mask" in tool else []),
        f"at rest  {_rounding(tool)}",
        f"overlaps {overlaps or 'none'}",
    ]
    return [*rows, *(_clip_table(tool["clips"]) if tool["clips"] else ["clips    none that moves the mesh"])]


def _pose(laid: Any) -> str:
    """The pose in which crests are straight."""
    if laid == "stored":
        return "at rest"
    if "clip" in laid:
        return f"{laid['clip']} at {laid['time']:.4g} s"
    return ", ".join(f"{name} at {weight:.3g}" for name, weight in laid["raised"].items())


def _rounding(tool: Json) -> str:
    """The change of the surface at rest that refinement makes."""
    departure, hard = _percent(100 * tool["departure"]), _percent(100 * tool["hard_edges"])
    rounded = f"rounded by up to {departure} % of the tallest wrinkle" if tool["departure"] else "as it was"
    return f"{rounded}; {hard} % of the edges are hard" if tool["hard_edges"] else rounded


def _tissue(tool: Json) -> str:
    """The share of each shortening that makes no wrinkles, and the share at which bumps become as tall as they may."""
    fitting = math.ceil(100 * tool["fitting_compressible"])
    if not tool["clips"]:
        would = ""
    elif fitting:
        would = f"; with compressible: {fitting}% all bumps reach their greatest height at the greatest shortening"
    else:
        would = "; in no clip do all bumps reach their greatest height"
    material = "" if tool["material"] == "none" else f"{tool['material']}, "
    lag = tool["lag"]
    late = f"; lags, {lag['frequency']:g} swings a second, damping {lag['damping']:g}" if lag else ""
    return f"{material}takes {100 * tool['compressible']:.3g} % of each shortening{would}{late}"


def _clip_table(clips: list[Json]) -> list[str]:
    """An aligned table with a heading and a line for each clip."""
    table = [["clip", "shortening", "at", "height", "unabsorbed"]]
    for clip in clips:
        if clip["shortening"] is None:
            table.append([clip["name"], "hidden", "", "", ""])
            continue
        low, high = (100 * each for each in clip["shortening"])
        table.append(
            [
                clip["name"],
                f"{_percent(low)} to {_percent(high)} %",
                f"{clip['time']:.3g} s",
                f"{clip['height']:.3g}" if clip["height"] else "-",
                f"{_percent(100 * clip['unabsorbed'])} %" if clip["unabsorbed"] else "-",
            ]
        )
    return aligned(table, texts=1)


def _percent(value: float) -> str:
    """Two digits at least, and no more than matter."""
    return "0" if abs(value) < 0.005 else f"{value:.0f}" if abs(value) >= 9.95 else f"{value:.2g}"


def _anchor(anchor: Json) -> str:
    at = ", ".join(f"{x:.4g}" for x in anchor["position"])
    primitive = f" of primitive {anchor['primitive']}" if anchor["primitive"] else ""
    return f"[{at}], {anchor['off']:.2g} from the point asked for, by vertex {anchor['vertex']}{primitive}"
