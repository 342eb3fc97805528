"""Wrinkles by the paper's text alone: plain numpy, a frame at a time, without any code of wrinkle's.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, Computer Graphics International 2004. A wrinkling tool
is a segment between two vertices of the mesh. Its control curve is as long as the segment at rest, so it bulges where
the segment gets shorter. A vertex of the posed mesh that projects onto the tool's rectangle moves along its normal by
the height of the curve there, attenuated towards both sides.

`Ours` has what wrinkle does otherwise, whatever the keys of a tool are, as its page says.
"""

from dataclasses import dataclass
from functools import cached_property
from math import inf, sqrt

import numpy as np
from numpy.typing import NDArray

from kit.player import Floats, Gltf

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Place = tuple[float, float, float]


@dataclass(frozen=True)
class Ours:
    """The ways in which our method differs from the paper.

    Attributes:
        fade: Heights fade where the surface turns away from the patch, between cosines of 0.6 and 0.2.
        members: Only triangles move that face the patch at rest, meet it, and hang together with an end of the tool.
        skin: A vertex keeps its place on the patch, and the skin carries its normal.
    """

    fade: bool = True
    members: bool = True
    skin: bool = True


AS_BAKED = Ours()
PROJECTED = Ours(skin=False)
"""The departures that are left with `attachment: patch`."""


@dataclass(frozen=True)
class Tool:
    """A wrinkling tool; lengths are scene units."""

    origin: Place
    target: Place
    width: float
    bumps: int = 4
    strategy: str = "everywhere"
    attenuation: str = "bell"
    max_height: float = inf


@dataclass(frozen=True)
class Frame:
    """A mesh in a pose, without wrinkles, and the tool on it; vertices are welded.

    Attributes:
        normals: (vertices, 3) unit; of the triangles around, by area.
        facing: (triangles,) cosines of the triangles' normals and the patch's.
        u: (vertices,) from 0 at the origin to 1 at the target.
        v: (vertices,) from -1 to 1 across.
        cosines: (vertices,) of their normals and the patch's.
        length: Of the segment.
    """

    normals: Floats
    facing: Floats
    u: Floats
    v: Floats
    cosines: Floats
    length: float


class Wrinkles:
    """A mesh with one wrinkling tool."""

    def __init__(self, file: Gltf, node: int, tool: Tool, ours: Ours) -> None:
        self.file, self.node, self.tool, self.ours = file, node, tool, ours
        names = sorted(file.mesh(node)["primitives"][0]["attributes"])
        moving = [name for name in names if name == "POSITION" or name.startswith(("JOINTS_", "WEIGHTS_"))]
        rows = np.hstack([file.attribute(node, name) for name in moving] + list(file.deltas(node)))
        # A vertex that seams of textures or shading part is one vertex of the mesh.
        _, self.firsts, weld = np.unique(rows, axis=0, return_index=True, return_inverse=True)
        self.weld: Ints = weld.reshape(-1)
        self.triangles = self.weld[file.triangles(node)]
        rest = file.pose(node, None, [0.0])[0][self.firsts]
        self.ends = [int(np.argmin(np.linalg.norm(rest - place, axis=1))) for place in (tool.origin, tool.target)]

    def moved(self, clip: str, time: float) -> Floats:
        """(glTF vertices, 3) displacements at a time of a clip, world space."""
        frame = self.frame(clip, time)
        at = self.rest if self.ours.skin else frame
        heights = curve_heights(self.tool, self.rest.length, frame.length, at.u) * attenuation(self.tool, at.v)
        heights *= (at.u >= 0) & (at.u <= 1) & (np.abs(at.v) <= 1)
        if self.ours.fade:
            t = np.clip((at.cosines - 0.2) / 0.4, 0.0, 1.0)
            heights *= t * t * (3.0 - 2.0 * t)
        if self.ours.members:
            heights *= self.members
        directions = frame.normals
        if self.ours.skin:
            rest, posed = (self.file.blended(self.node, name, [time])[:, :3, 0, self.firsts] for name in (None, clip))
            turns = np.einsum("abv,vbc->vac", posed, np.linalg.inv(np.moveaxis(rest, 2, 0)))
            directions = np.einsum("vab,vb->va", turns, self.rest.normals)
        return (heights[:, None] * directions)[self.weld]

    @cached_property
    def rest(self) -> Frame:
        """The mesh as the file has it."""
        return self.frame(None, 0.0)

    def frame(self, clip: str | None, time: float) -> Frame:
        """The mesh at a time of a clip, as engines show it."""
        positions = self.file.pose(self.node, clip, [time])[0][self.firsts]
        a, b, c = (positions[self.triangles[:, corner]] for corner in range(3))
        faces = np.cross(b - a, c - a)
        normals = np.zeros_like(positions)
        for corner in range(3):
            np.add.at(normals, self.triangles[:, corner], faces)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        origin, target = positions[self.ends]
        length = float(np.linalg.norm(target - origin))
        along = (target - origin) / length
        up = normals[self.ends].sum(axis=0)
        up -= (up @ along) * along
        up /= np.linalg.norm(up)
        relative = positions - origin
        return Frame(
            normals=normals,
            facing=faces @ up,
            u=relative @ along / length,
            v=relative @ np.cross(along, up) / (self.tool.width / 2.0),
            cosines=normals @ up,
            length=length,
        )

    @cached_property
    def members(self) -> Bools:
        """(vertices,) of triangles that face the patch at rest, meet it, and hang together with an end."""
        places = np.stack([self.rest.u, self.rest.v], axis=1)[self.triangles]
        chosen = (self.rest.facing > 0) & _meet(places, np.array([0.0, -1.0]), np.array([1.0, 1.0]))
        found = np.zeros(len(self.rest.u), bool)
        edges = [np.sort(self.triangles[:, pair], axis=1) @ [len(found), 1] for pair in ([0, 1], [1, 2], [2, 0])]
        reached = chosen & np.isin(self.triangles, self.ends).any(axis=1)
        while True:
            on = np.concatenate([each[reached] for each in edges])
            more = chosen & np.any([np.isin(each, on) for each in edges], axis=0)
            if (more == reached).all():
                break
            reached = more
        found[self.triangles[reached]] = True
        return found


def curve_heights(tool: Tool, rest_length: float, length: float, u: Floats) -> Floats:
    """(…,) heights of the control curve at (…,) u, for a segment that was `rest_length` long.

    Control points are as far from each other as the segment's length has it. A bump is one of them, raised between two
    neighbours: the two sides of it are together longer than their chord by the part of the loss that it takes.
    """
    interval, loss = length / (2 * tool.bumps), max(rest_length - length, 0.0)
    numbers = list(range(tool.bumps))
    turns = {
        "everywhere": [numbers],
        "origin": [[number] for number in numbers],
        "both_ends": [sorted({number, tool.bumps - 1 - number}) for number in numbers[: (tool.bumps + 1) // 2]],
    }[tool.strategy]
    points = np.zeros(2 * tool.bumps + 1)
    full = 2.0 * (sqrt(interval**2 + tool.max_height**2) - interval)
    for turn in turns:
        taken = min(loss / len(turn), full)
        loss -= taken * len(turn)
        # Two sides of length interval + taken / 2 above a chord of two intervals.
        points[[2 * number + 1 for number in turn]] = sqrt((interval + taken / 2.0) ** 2 - interval**2)
    heights: Floats = np.interp(u, np.linspace(0.0, 1.0, len(points)), points)
    return heights


def attenuation(tool: Tool, v: Floats) -> Floats:
    """(…,) the part of the height that is left at (…,) v."""
    if tool.attenuation == "linear":
        return 1.0 - np.abs(v)
    # G. Wyvill et al., Data Structure for Soft Objects, 1986.
    return 1.0 - 22.0 / 9.0 * v**2 + 17.0 / 9.0 * v**4 - 4.0 / 9.0 * v**6


def _meet(triangles: Floats, low: Floats, high: Floats) -> Bools:
    """(triangles,) of (triangles, 3, 2): which meet a box, as no line parts the two."""
    corners = np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
    meet = (triangles.max(axis=1) >= low).all(axis=1) & (triangles.min(axis=1) <= high).all(axis=1)
    for corner in range(3):
        side = triangles[:, (corner + 1) % 3] - triangles[:, corner]
        across = np.stack([-side[:, 1], side[:, 0]], axis=1)
        own, others = np.einsum("tkx,tx->tk", triangles, across), across @ corners.T
        meet &= (own.max(axis=1) >= others.min(axis=1)) & (own.min(axis=1) <= others.max(axis=1))
    return meet
