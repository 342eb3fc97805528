"""Scenes that are simulated as cloth and baked as wrinkles: meshes of rings with joints, in numpy alone.

Both Blender's Python and ours read this module. Lengths are metres, x runs along the limb or strip, which folds on its
+y side.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

FPS = 30
MOVING, HELD = 45, 8  # frames: a second and a half of movement, then a quarter to settle
FRAMES = MOVING + HELD + 1


@dataclass(frozen=True)
class Surface:
    """A mesh of rings.

    Attributes:
        positions: (vertices, 3) at rest.
        quads: (faces, 4).
        weights: (vertices, 2) of the two joints.
    """

    positions: Array
    quads: Array
    weights: Array


@dataclass(frozen=True)
class Scene:
    """What is simulated.

    Attributes:
        name: Of the scene.
        cloth: The mesh that wrinkles.
        held: (vertices,) how firmly the cloth is held to the moving mesh: 1 is fast.
        body: What the cloth lies on; none where nothing is below.
        gravity: (3,) m/s².
        turn: Degrees that the second joint turns about z, at the end.
        slide: Metres that it slides along x.
        lines: Vertices of the lines across the folds, (lines, vertices), from one side of the fold to the other.
        origin: Where the wrinkles begin, at rest.
        target: Where they end.
        width: Full width of the tool: such that it has hardly faded on the lines.
        sides: Vertices of a ring of the cloth, if it is a tube; else 0.
    """

    name: str
    cloth: Surface
    held: Array
    body: Surface | None
    gravity: tuple[float, float, float]
    turn: float
    slide: float
    lines: Array
    origin: tuple[float, float, float]
    target: tuple[float, float, float]
    width: float
    sides: int

    def matrices(self, share: float) -> Array:
        """(2, 4, 4) from rest to world space of both joints, at a share of the movement from 0 to 1."""
        angle = np.radians(self.turn * share)
        second = np.eye(4)
        second[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
        second[0, 3] = self.slide * share
        return np.stack([np.eye(4), second])

    def posed(self, surface: Surface, share: float) -> Array:
        """(vertices, 3) by linear blend skinning."""
        points = np.concatenate([surface.positions, np.ones((len(surface.positions), 1))], axis=1)
        moved = np.einsum("jab,vb->vja", self.matrices(share)[:, :3], points)
        return np.einsum("vj,vja->va", surface.weights, moved)


def share_of(frame: int) -> float:
    """The share of the movement at a frame: it starts and stops softly."""
    t = min(frame / MOVING, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _tube(length: float, radii: Callable[[Array], Array], rings: int, sides: int, blend: float) -> Surface:
    """A tube along x around 0 that bends at its middle."""
    x = np.linspace(-length / 2, length / 2, rings)
    angle = 2.0 * np.pi * np.arange(sides) / sides
    radius = radii(x)[:, None]
    rows = [np.broadcast_to(x[:, None], (rings, sides)), radius * np.cos(angle), radius * np.sin(angle)]
    positions = np.stack(rows, axis=2).reshape(-1, 3)
    ring, side = (each.ravel() for each in np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij"))
    a, b = ring * sides + side, ring * sides + (side + 1) % sides
    second = np.clip(positions[:, 0] / blend + 0.5, 0.0, 1.0)
    return Surface(positions, np.stack([a, b, b + sides, a + sides], axis=1), np.stack([1 - second, second], axis=1))


def _lines_on_tube(surface: Surface, sides: int, near: float, degrees: float) -> Array:
    """Lines along a tube within so many metres of the bend and degrees of +y."""
    rings = np.arange(len(surface.positions) // sides)
    chosen = rings[np.abs(surface.positions[rings * sides, 0]) <= near]
    reach = int(degrees / 360.0 * sides)
    return np.stack([chosen * sides + side % sides for side in range(-reach, reach + 1)])


def sleeve() -> Scene:
    """A sleeve 12 mm off an arm whose elbow bends by 60°: it clings to the arm, and is held at both ends."""
    rings, sides, blend = 69, 32, 0.18
    cloth = _tube(0.46, lambda x: 0.062 + 0 * x, rings, sides, blend)
    body = _tube(0.60, lambda x: 0.050 + 0 * x, 49, 32, blend)
    return Scene(
        name="sleeve",
        cloth=cloth,
        held=np.where(np.abs(cloth.positions[:, 0]) > 0.225, 1.0, CLINGING),
        body=body,
        gravity=(0.0, 0.0, -9.81),
        turn=60.0,
        slide=0.0,
        lines=_lines_on_tube(cloth, sides, 0.105, 22.0),
        origin=(-0.10, 0.062, 0.0),
        target=(0.10, 0.062, 0.0),
        width=0.30,
        sides=sides,
    )


def trousers() -> Scene:
    """A trouser leg behind a knee that bends by 80°: wider above, with gravity down the leg."""
    rings, sides, blend = 77, 34, 0.26
    cloth = _tube(0.66, lambda x: 0.082 - 0.02 * (x / 0.66 + 0.5), rings, sides, blend)
    body = _tube(0.80, lambda x: 0.068 - 0.018 * (x / 0.80 + 0.5), 57, 36, blend)
    return Scene(
        name="trousers",
        cloth=cloth,
        held=np.where(np.abs(cloth.positions[:, 0]) > 0.32, 1.0, CLINGING),
        body=body,
        gravity=(9.81, 0.0, 0.0),
        turn=80.0,
        slide=0.0,
        lines=_lines_on_tube(cloth, sides, 0.15, 20.0),
        origin=(-0.14, 0.0762, 0.0),
        target=(0.14, 0.0678, 0.0),
        width=0.39,
        sides=sides,
    )


def strip() -> Scene:
    """A flat strip on a soft ground whose ends approach by 30 %."""
    columns, rows = 81, 17
    length, width = 0.40, 0.16
    x, z = np.meshgrid(np.linspace(0, length, columns), np.linspace(-width / 2, width / 2, rows), indexing="ij")
    # Nothing is quite flat: without a tenth of a millimetre to begin with, it buckles late and at once.
    uneven = 1e-4 * np.random.default_rng(0).standard_normal(x.shape)
    uneven[[0, -1]] = 0.0
    positions = np.stack([x, uneven, z], axis=2).reshape(-1, 3)
    column, row = (each.ravel() for each in np.meshgrid(np.arange(columns - 1), np.arange(rows - 1), indexing="ij"))
    a = column * rows + row
    second = positions[:, 0] / length
    cloth = Surface(
        positions, np.stack([a, a + 1, a + rows + 1, a + rows], axis=1), np.stack([1 - second, second], axis=1)
    )
    fast = (positions[:, 0] < 1e-6) | (positions[:, 0] > length - 1e-6)
    lines = np.stack([np.arange(columns) * rows + each for each in range(rows // 2 - 4, rows // 2 + 5)])
    return Scene(
        name="strip",
        cloth=cloth,
        held=np.where(fast, 1.0, SOFT_GROUND),
        body=None,
        gravity=(0.0, 0.0, 0.0),
        turn=0.0,
        slide=-0.3 * length,
        lines=lines,
        origin=(0.0, 0.0, 0.0),
        target=(length, 0.0, 0.0),
        width=1.6,  # folds run across all of it
        sides=0,
    )


# How firmly fitted clothes cling to the limb. Without it a sleeve stands off, straight across the elbow, and breaks at
# either end of the bend, which no wrinkle on the skin is like.
CLINGING = 0.1
# How firmly the strip is held to the ground, which gets shorter evenly, as flesh or a lining does.
SOFT_GROUND = 0.1

SCENES: dict[str, Callable[[], Scene]] = {"sleeve": sleeve, "trousers": trousers, "strip": strip}
