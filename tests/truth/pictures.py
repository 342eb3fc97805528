"""Draw simulated cloth beside bakes: `python pictures.py FOLDER [SCENE]…` makes pictures/SCENE.png."""

import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

HERE = Path(__file__).resolve().parent
sys.path += [str(HERE), str(HERE.parent), str(HERE.parent.parent)]
mpl.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
from bake import bake, played  # noqa: E402
from compare import LOOKS, field_of, tool_of  # noqa: E402
from matplotlib.axes import Axes  # noqa: E402
from matplotlib.collections import PolyCollection  # noqa: E402
from scenes import SCENES, Array, Scene, share_of  # noqa: E402

FRAMES = (15, 30, 45)


def draw(axes: Axes, scene: Scene, points: Array, triangles: Array, frame: int) -> None:
    """A surface seen into its fold, lit from the side."""
    half = np.radians(scene.turn * share_of(frame) / 2.0)
    toward = np.array([-np.sin(half), np.cos(half), 0.7 if scene.turn else 1.0])
    toward /= np.linalg.norm(toward)
    right = np.cross([0.0, 0.0, -1.0], toward)
    right /= np.linalg.norm(right)
    up = np.cross(toward, right)
    light = -0.75 * right + 0.25 * up + 0.45 * toward
    corners = points[triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-20
    order = np.argsort(corners.mean(axis=1) @ toward)
    order = order[normals[order] @ toward > 0]
    shades = 0.12 + 0.85 * np.clip(normals[order] @ light / np.linalg.norm(light), 0.0, 1.0)
    flat = np.stack([corners[order] @ right, corners[order] @ up], axis=2)
    axes.add_collection(PolyCollection(flat, facecolors=np.repeat(shades[:, None], 3, axis=1), edgecolors="face"))
    axes.autoscale()
    axes.set_aspect("equal")
    axes.axis("off")


def main() -> None:
    folder = Path(sys.argv[1])
    (HERE / "pictures").mkdir(exist_ok=True)
    for name in sys.argv[2:] or SCENES:
        scene = SCENES[name]()
        triangles = scene.cloth.quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        kinds = ("tool", "field") if scene.sides else ("tool",)
        height = len(LOOKS) * (1 + len(kinds))
        figure, grid = plt.subplots(height, len(FRAMES), figsize=(12, 3.2 * height), squeeze=False)
        rows = iter(grid)
        for cloth in LOOKS:
            with np.load(folder / f"{name}_{cloth}.npz") as stored:
                simulated = stored["positions"].astype(float)
            for axes, frame in zip(next(rows), FRAMES, strict=True):
                draw(axes, scene, simulated[frame], triangles, frame)
                axes.set_title(f"{cloth}, simulated, {100 * share_of(frame):.0f} %")
            for kind in kinds:
                listed = field_of(cloth) if kind == "field" else tool_of(scene, cloth, "default")
                file, _ = bake(scene, listed, folder / f"{name}_{cloth}_{kind}")
                ours, _ = played(file, np.array(FRAMES))
                for axes, points, frame in zip(next(rows), ours, FRAMES, strict=True):
                    draw(axes, scene, points, file.triangles("cloth"), frame)
                    axes.set_title(f"{cloth}, baked, a {kind}")
        figure.tight_layout()
        figure.savefig(HERE / "pictures" / f"{name}.png", dpi=60)
        plt.close(figure)


if __name__ == "__main__":
    main()
