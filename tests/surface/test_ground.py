"""Which meshes lie over a mesh as clothes do."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from kit.asset import Array
from kit.touch import plate
from wrinklecli.gltf.document import read_document
from wrinklecli.surface.ground import Ground, read_ground
from wrinklecli.tools.records import ToolsFile

CELL, REACH = 0.01, 0.02  # metres


def grid(cells: int, height: float, x: float = 0.0, size: float = 0.1) -> tuple[Array, Array]:
    """A square of cloth at a height over the plate."""
    line = np.linspace(-size / 2, size / 2, cells + 1)
    places = np.stack([*np.meshgrid(line + x, [height], line, indexing="ij")], axis=-1).reshape(-1, 3)
    ids = np.arange(len(places)).reshape(cells + 1, cells + 1)
    a, b, c, d = ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]
    return places, np.stack([a, c, b, a, d, c], axis=-1).reshape(-1, 3)


def skin_below(folder: Path, places: Array, triangles: Array) -> Ground:
    """A plate of skin, 24 cells of a centimetre wide, below another mesh."""
    asset = plate(clips=False)
    primitive: Any = {"attributes": {"POSITION": asset.accessor(places, bounds=True)}}
    primitive["indices"] = asset.accessor(triangles.reshape(-1), "u2")
    mesh = asset.append("meshes", {"primitives": [primitive]})
    asset.gltf["scenes"][0]["nodes"].append(asset.append("nodes", {"name": "cloth", "mesh": mesh}))
    document = read_document(asset.write(folder / "plate.glb"))
    node = next(k for k, each in enumerate(document.items("nodes")) if each.get("name") == "skin")
    return read_ground(document, node, (), ToolsFile(path=""), ())


CLOTHS = {
    "near": (grid(10, 0.9 * REACH), True),
    "far": (grid(10, 1.1 * REACH), False),
    "below": (grid(10, -0.1 * REACH), False),
    "beside": (grid(10, 0.5 * REACH, x=0.3), False),
    "a few vertices, and more of the skin below": (grid(1, 0.5 * REACH), True),
    "so small that four vertices are over one": (grid(1, 0.5 * REACH, x=CELL / 3, size=0.1 * CELL), True),
    "as small, and of three vertices": (
        (grid(1, 0.5 * REACH, x=CELL / 3, size=0.1 * CELL)[0][:3], np.array([[0, 1, 2]])),
        False,
    ),
}


@pytest.mark.parametrize("name", CLOTHS)
def test_what_lies_within_reach_over_the_skin_is_over_it(name: str, tmp_path: Path) -> None:
    cloth, over = CLOTHS[name]
    ground = skin_below(tmp_path, *cloth)
    reaches = np.where(np.abs(ground.rest.positions[:, 0]) < 0.08, REACH, 0.0)
    assert ground.meshes_over(reaches) == (("cloth",) if over else ())
    assert ground.meshes_over(0.0 * reaches) == ()


@pytest.mark.parametrize(("x", "over"), [(-0.03, False), (0.03, True)])
def test_between_vertices_the_reach_is_in_between(x: float, over: bool, tmp_path: Path) -> None:
    """Four vertices of cloth lie over one triangle."""
    ground = skin_below(tmp_path, *grid(1, 0.5 * REACH, x=x + CELL / 3, size=0.1 * CELL))
    reaches = REACH * np.clip(0.5 + ground.rest.positions[:, 0] / 0.1, 0.0, 1.0)
    assert ground.meshes_over(reaches) == (("cloth",) if over else ())
