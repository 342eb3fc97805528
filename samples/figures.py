"""Draws the figures of wrinklecli/README.md from the program itself: `python samples/figures.py [DIR [NAME…]]`.

Every curve, triangle and number in them comes from the code that bakes, run on the samples. Needs the extra `plot`.
"""

import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("svg")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from wrinklecli.baking.job import BakeOptions, read_job
from wrinklecli.baking.plan import plan_meshes
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.wrinkle.curve import ControlCurve, plan_curve
from wrinklecli.effects.wrinkle.layer import carried_patches_of
from wrinklecli.numeric.arrays import Bools, Floats, Ints

HERE = Path(__file__).resolve().parent
PACKAGE = HERE.parent / "wrinklecli"
INK, FAINT, RED, GREEN, BLUE = "#1b2733", "#9aa7b4", "#d9694f", "#5aa469", "#3f6fb5"
STYLE = {
    "svg.hashsalt": "wrinkle",  # the same bytes each time
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "text.color": INK,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "axes.titlesize": 10,
    "figure.facecolor": "white",
}


def draw_curves() -> None:
    """Control curves: what each strategy does with the same shortening, and what the profiles look like."""
    _, rows = plt.subplots(2, 3, figsize=(9.6, 3.9), gridspec_kw={"height_ratios": [2.2, 1], "hspace": 0.1})
    for axes, strategy in zip(rows[0], ("everywhere", "origin", "both_ends"), strict=True):
        curve = plan_curve(
            bumps=5, gap=0, strategy=strategy, details=(), profile="smooth", max_height=0.09, rest_length=1.0
        )
        axes.set_title(f"strategy: {strategy}")
        for row, shortening in enumerate((0.0, 0.08, 0.2, 0.32)):
            xs, ys = curve_points(curve, 1.0 - shortening)
            axes.plot(xs, ys - 0.17 * row, color=BLUE, lw=1.6)
            axes.plot(xs[[0, -1]], np.full(2, -0.17 * row), "o", color=INK, ms=3)
            axes.text(1.02, -0.17 * row, f"{shortening:.0%}", va="center", color=FAINT)
    profiles = (("skin", ()), ("cloth", ()), ("polyline", (0.2,)))
    for axes, (profile, details) in zip(rows[1], profiles, strict=True):
        curve = plan_curve(
            bumps=2, gap=0, strategy="everywhere", details=details, profile=profile, max_height=np.inf, rest_length=1.0
        )
        axes.set_title(f"profile: {profile}" + (f", details: {list(details)}" if details else ""))
        for shortening in (0.03, 0.1, 0.2):
            axes.plot(*curve_points(curve, 1.0 - shortening), color=BLUE, lw=1.4)
    for axes in rows.flat:
        axes.set_aspect("equal")
        axes.axis("off")


def curve_points(curve: ControlCurve, distance: float) -> tuple[Floats, Floats]:
    """(points,) places along the segment and (points,) heights of a curve whose ends have this distance."""
    us = np.linspace(0.0, 1.0, 1025)
    amplitudes, _ = curve.follow(np.array([distance]), np.array([curve.rest_length]))
    return us * distance, np.einsum("gm,gmu->u", amplitudes[0], curve.shapes(us))


def plans_of(sample: str, max_levels: int | None = None, tools: str = "") -> MeshPlan:
    """A sample with its tools attached, or with those of another file, and the mesh under them refined."""
    path = HERE.parent / "configs" / f"{tools or sample}.yaml"
    return plan_meshes(read_job(HERE / f"{sample}.glb", path, BakeOptions(max_levels=max_levels)))[0]


def on_patch(plan: MeshPlan, number: int, positions: Floats, triangles: Ints) -> tuple[Floats, Ints]:
    """(vertices, 2) (u, v) on a tool's patch, and which triangles are near it and face it."""
    patch = carried_patches_of(plan)[number].patch
    u, v = patch.coordinates(positions)
    corners = positions[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    near = (np.abs(u - 0.5) < 0.85) & (np.abs(v) < 1.5)
    return np.stack([u, v], axis=1), np.flatnonzero(near[triangles].all(axis=1) & (normals @ patch.normal > 0))


def draw_patch() -> None:
    """A patch: u along the segment, v across it, member triangles, and how much of a height is left where."""
    _, (left, right) = plt.subplots(1, 2, figsize=(9.6, 4.2), gridspec_kw={"width_ratios": [1.5, 1]})
    plan = plans_of("wrist", 0)
    patch = carried_patches_of(plan)[0].patch
    places, near = on_patch(plan, 0, plan.rest.positions, plan.rest.triangles)
    members = np.isin(near, patch.members)
    add_triangles(left, places[plan.rest.triangles[near[~members]]], "white")
    add_triangles(left, places[plan.rest.triangles[near[members]]], "#e3ecf7")
    us, vs = np.meshgrid(np.linspace(0, 1, 101), np.linspace(-1, 1, 101))
    shares = patch.factors(us, vs, np.ones(us.shape))
    lines = left.contour(us, vs, shares, levels=[0.25, 0.5, 0.75], colors=RED, linewidths=0.9)
    left.clabel(lines, fmt=lambda share: f"{share:.0%}", fontsize=7)
    left.plot([0, 1, 1, 0, 0], [-1, -1, 1, 1, -1], color=BLUE, lw=1.6)
    left.plot([0, 1], [0, 0], color=INK, lw=2)
    left.plot(0, 0, "o", color=INK, ms=6)
    left.plot(1, 0, "o", color=INK, ms=6, mfc="white", mew=2)
    for text, place in {
        "origin, u = 0": (0, 0.1),
        "target, u = 1": (1, 0.1),
        "v = 1": (0.5, 1.06),
        "v = −1": (0.5, -1.2),
    }.items():
        left.text(*place, text, ha="center", bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0})
    left.set(xlim=(-0.3, 1.3), ylim=(-1.35, 1.35))
    left.set_title("samples/wrist.glb, tool palm_side: member triangles are shaded")
    left.axis("off")
    line = np.linspace(-1, 1, 201)
    bell = 1.0 + (-4.0 * line**6 + 17.0 * line**4 - 22.0 * line**2) / 9.0
    assert np.allclose(bell, patch.factors(np.full(201, 0.5), line, np.ones(201)) / patch.shape_strength)
    right.plot(line, bell, color=RED, label="attenuation: bell")
    right.plot(line, 1.0 - np.abs(line), color=FAINT, label="attenuation: linear")
    right.set(xlabel="v", ylabel="share of the height", xticks=[-1, 0, 1], yticks=[0, 0.5, 1])
    right.legend(loc="lower center", frameon=False)
    right.spines[["top", "right"]].set_visible(False)


def draw_refinement() -> None:
    """Red-green refinement at a corner of a patch: triangles split in four are red, those that close gaps green."""
    _, panels = plt.subplots(1, 3, figsize=(9.6, 3.4), gridspec_kw={"wspace": 0.05})
    window = ((0.45, 1.25), (0.0, 1.3))
    for levels, axes in enumerate(panels):
        plan = plans_of("wrist", levels)
        fine = plan.fine
        places, near = on_patch(plan, 0, fine.rest_positions, fine.triangles)
        near = near[shown(places[fine.triangles[near]], window)]
        # The area of a red triangle is a quarter of a quarter of … of its coarse triangle; all others close gaps.
        halvings = np.round(-np.log2(np.abs(np.linalg.det(fine.subdivision.barycentrics[near])))).astype(int)
        kinds = np.where(halvings == 0, 0, 1 + halvings % 2)
        for kind, colour in enumerate(("white", "#f3c6bb", "#cfe6d3")):
            add_triangles(axes, places[fine.triangles[near[kinds == kind]]], colour)
        axes.plot([0, 1, 1, 0, 0], [-1, -1, 1, 1, -1], color=BLUE, lw=1.6)
        axes.set(xlim=window[0], ylim=window[1], title=("the mesh as it is", "one level", "two levels")[levels])
        axes.axis("off")


def shown(corners: Floats, window: tuple[tuple[float, float], tuple[float, float]]) -> Bools:
    """(triangles,) True for (triangles, 3, 2) triangles that have a corner in a window."""
    lows, highs = np.transpose(window)
    inside: Bools = ((corners > lows) & (corners < highs)).all(axis=2).any(axis=1)
    return inside


def add_triangles(axes: Axes, corners: Floats, colour: str) -> None:
    """Draw (triangles, 3, 2) triangles."""
    axes.add_collection(PolyCollection(list(corners), facecolor=colour, edgecolor="#7d8b99", linewidth=0.5))


# The input and the output of each room.
FLOW = {
    "files": ("paths", "bytes"),
    "numeric": ("arrays", "arrays"),
    "tools": ("tools.yaml", "WrinkleTool"),
    "gltf": ("character.glb", "Document"),
    "character": ("Document", "Rig, Clip, Surface"),
    "surface": ("Surface, points", "patches, finer mesh"),
    "drive": ("Rig, Clip", "numbers over time"),
    "effects": ("surface, tool, drive", "shapes and weights"),
    "baking": ("asset and tools", "out.glb, report"),
    "texture": ("asset, tools", "wrinkle maps"),
    "review": ("assets, tools", "text, tables, pictures"),
    "batching": ("manifest", "many bakes"),
    "editor": ("asset, tools", "tools, edited"),
    "example": ("code", "a figure, baked"),
    "cli": ("options", "exit code"),
}


def draw_flow() -> None:
    """The rooms in the order in which they may import, their modules, and what comes in and goes out."""
    _, axes = plt.subplots(figsize=(9.6, 9.0))
    for row, (room, (given, made)) in enumerate(FLOW.items()):
        folder = PACKAGE / room
        modules = sorted(
            each.stem for each in folder.iterdir() if each.stem[0] not in "_." and each.name != "README.md"
        )
        axes.add_patch(plt.Rectangle((2.6, -row - 0.44), 6.2, 0.88, facecolor="#eef3f9", edgecolor=BLUE))
        axes.text(2.7, -row + 0.25, room, weight="bold", va="center")
        axes.text(
            2.7, -row + 0.12, "\n".join(textwrap.wrap(" · ".join(modules), 108)), va="top", size=5.2, color="#54616e"
        )
        axes.annotate("", (2.58, -row), (2.3, -row), arrowprops={"arrowstyle": "->", "color": INK})
        axes.annotate("", (9.12, -row), (8.82, -row), arrowprops={"arrowstyle": "->", "color": INK})
        axes.text(2.25, -row, given, ha="right", va="center")
        axes.text(9.17, -row, made, va="center")
    axes.set(xlim=(0, 11.2), ylim=(-len(FLOW) + 0.4, 0.6))
    axes.axis("off")


def draw_index_spaces() -> None:
    """One place of a mesh on a seam, as its vertices are numbered before and after welding and refinement."""
    plan = plans_of("head", 1, "head_keyed")
    fine, surface = plan.fine, plan.fine.surface
    _, panels = plt.subplots(1, 4, figsize=(9.6, 3.2), gridspec_kw={"wspace": 0.05})
    number, corner = seam_on_patch(plan)
    coarse = [k for k in range(len(surface.triangles)) if corner in surface.triangles[k]]
    children = np.flatnonzero(np.isin(fine.subdivision.parents, coarse))
    patch = carried_patches_of(plan)[number].patch
    place = np.stack(patch.coordinates(fine.rest_positions), axis=1)
    spaces = (
        ("glTF vertices", surface.corners[coarse], surface.triangles[coarse]),
        ("welded vertices", surface.triangles[coarse], surface.triangles[coarse]),
        ("fine vertices", fine.triangles[children], fine.triangles[children]),
        ("glTF vertices of the output", fine.corners[children], fine.triangles[children]),
    )
    for axes, (title, named, welded) in zip(panels, spaces, strict=True):
        axes.set_title(title)
        labels: dict[int, list[Floats]] = {}
        for names, corners in zip(named, welded, strict=True):
            middle = place[corners].mean(axis=0)
            shown = middle + 0.9 * (place[corners] - middle)
            add_triangles(axes, shown[None], "#eef3f9")
            for name, point in zip(names, middle + 0.72 * (place[corners] - middle), strict=True):
                labels.setdefault(int(name), []).append(point)
        for name, points in labels.items():
            axes.text(*np.mean(points, axis=0), str(name), ha="center", va="center", size=6)
        axes.autoscale_view()
        axes.axis("off")


def seam_on_patch(plan: MeshPlan) -> tuple[int, int]:
    """A tool, and a welded vertex in the middle of its patch that stands for two glTF vertices or more."""
    surface = plan.fine.surface
    for number, carried in enumerate(carried_patches_of(plan)):
        patch = carried.patch
        for vertex in np.unique(surface.triangles[patch.members]):
            fan = (surface.triangles == vertex).any(axis=1)
            names = surface.corners[fan][surface.triangles[fan] == vertex]
            if np.isin(np.flatnonzero(fan), patch.members).all() and len(np.unique(names)) > 1:
                return number, int(vertex)
    raise LookupError("no seam crosses a patch")


FIGURES = {
    "flow": draw_flow,
    "curve": draw_curves,
    "patch": draw_patch,
    "refinement": draw_refinement,
    "index_spaces": draw_index_spaces,
}


def main(folder: Path, names: Sequence[str]) -> None:
    """Write figures of some names as SVG."""
    with plt.rc_context(STYLE):
        for name in names:
            FIGURES[name]()
            plt.savefig(folder / f"method_{name}.svg", bbox_inches="tight", metadata={"Date": None})
            plt.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "pictures", sys.argv[2:] or list(FIGURES))
