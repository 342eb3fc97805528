"""Tubes, spheres and planes of any fineness, along y around the origin, that two joints bend in the middle."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from kit.asset import Array, Asset, Json

LENGTH, RADIUS = 2.0, 0.25  # of a tube, scene units


@dataclass(frozen=True)
class Shape:
    """A shape that bends towards `inside`, or away from it, as a hinge at the origin.

    Attributes:
        kind: A tube, open at its ends, of radius 0.25; a sphere of radius 1; or a plane, 1 wide.
        sides: Quads around, or across a plane.
        rings: Rings of vertices along y.
        capped: Close the ends of a tube.
        seam: Split the vertices along one line, as texture coordinates do.
        normals: Write NORMAL.
        turn: (3, 3) rotation of the whole.
        place: The origin of the whole.
        angle: Degrees of the bend, after one second; back after two.
        blend: Length over which skin weights change from one joint to the other, scene units.
        inside: The direction before the turn, along x or z, to which the inner side looks.
    """

    kind: Literal["tube", "sphere", "plane"] = "tube"
    sides: int = 16
    rings: int = 24
    capped: bool = False
    seam: bool = False
    normals: bool = True
    turn: Array | None = None
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    angle: float = 110.0
    blend: float = 0.5
    inside: Literal["x", "z"] = "z"

    def rotation(self) -> Array:
        """(3, 3)."""
        return np.eye(3) if self.turn is None else self.turn

    def asset(self) -> Asset:
        """The shape as node `body`, with a clip `bend`."""
        places, normals, faces = self._plane() if self.kind == "plane" else self._round()
        rotation, (x, y, z) = self.rotation(), self.place
        share = np.clip(places[:, 1] / self.blend + 0.5, 0.0, 1.0)
        share = share * share * (3.0 - 2.0 * share)
        asset = Asset()
        attributes: Json = {"POSITION": asset.accessor(places @ rotation.T + self.place, bounds=True)}
        if self.normals:
            attributes["NORMAL"] = asset.accessor(normals @ rotation.T)
        attributes["JOINTS_0"] = asset.accessor(np.tile([0, 1, 0, 0], (len(places), 1)), "u1")
        attributes["WEIGHTS_0"] = asset.accessor(np.stack([1.0 - share, share, 0.0 * share, 0.0 * share], axis=1))
        primitive = {"attributes": attributes, "indices": asset.accessor(faces.ravel(), "u4")}
        asset.append("meshes", {"primitives": [primitive]})
        asset.append("nodes", {"name": "body", "mesh": 0, "skin": 0})
        asset.append("nodes", {"name": "lower", "children": [2], "translation": [x, y, z]})
        asset.append("nodes", {"name": "upper"})
        binds = np.tile(np.eye(4), (2, 1, 1))
        binds[:, 3, :3] = -np.array(self.place)
        asset.append("skins", {"joints": [1, 2], "inverseBindMatrices": asset.accessor(binds.reshape(2, 16))})
        asset.append("scenes", {"nodes": [0, 1]})
        asset.gltf["scene"] = 0
        half = np.radians(self.angle) / 2.0 * np.array([0.0, 1.0, 0.0])
        axis = rotation @ ([1.0, 0.0, 0.0] if self.inside == "z" else [0.0, 0.0, -1.0])
        animation: Json = {"name": "bend"}
        turns = np.concatenate([np.sin(half)[:, None] * axis, np.cos(half)[:, None]], axis=1)
        asset.channel(animation, 2, "rotation", [0.0, 1.0, 2.0], turns)
        asset.append("animations", animation)
        return asset

    def _round(self) -> tuple[Array, Array, Array]:
        """Positions, normals and triangles of a tube or a sphere; the first and the last side are at +z."""
        columns = self.sides + self.seam
        around = 2.0 * np.pi * (np.arange(columns) % self.sides) / self.sides
        out = np.stack([np.sin(around), 0.0 * around, np.cos(around)], axis=1)
        along = np.linspace(-1.0, 1.0, self.rings)[:, None, None]
        if self.kind == "tube":
            normals = out + 0.0 * along
            places = RADIUS * normals + LENGTH / 2.0 * along * [0.0, 1.0, 0.0]
        else:
            up = np.pi / 2.0 * along
            normals = places = np.cos(up) * out + np.sin(up) * [0.0, 1.0, 0.0]
        faces = _quads(self.rings, self.sides, columns, closed=not self.seam)
        places, normals = places.reshape(-1, 3), normals.reshape(-1, 3)
        if self.kind == "tube" and self.capped:
            first, last = len(places), len(places) + 1
            ring, up = np.arange(self.sides), np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
            following = (ring + 1) % columns
            top = columns * (self.rings - 1)
            bottoms = np.stack([following, ring, np.full_like(ring, first)], axis=1)
            tops = np.stack([top + ring, top + following, np.full_like(ring, last)], axis=1)
            places, normals = np.concatenate([places, LENGTH / 2.0 * up]), np.concatenate([normals, up])
            faces = np.concatenate([faces, bottoms, tops])
        return places, normals, faces

    def _plane(self) -> tuple[Array, Array, Array]:
        across, along = np.linspace(-0.5, 0.5, self.sides + 1), np.linspace(-1.0, 1.0, self.rings)
        y, x = (each.ravel() for each in np.meshgrid(along, across, indexing="ij"))
        normals = np.tile([0.0, 0.0, 1.0], (len(x), 1))
        return np.stack([x, y, 0.0 * x], axis=1), normals, _quads(self.rings, self.sides, self.sides + 1, closed=False)


def _quads(rings: int, sides: int, columns: int, *, closed: bool) -> Array:
    """(triangles, 3), two for each quad between rings of so many columns of vertices."""
    ring, side = (each.ravel() for each in np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij"))
    following = (side + 1) % sides if closed else side + 1
    a, b = ring * columns + side, ring * columns + following
    return np.stack([a, b, a + columns, b, b + columns, a + columns], axis=1).reshape(-1, 3)
