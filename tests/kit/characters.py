"""Characters as others make them: a knight, a robot, low-poly, dressed, layered and cartoon figures, with textures.

Each builder gives an `Asset`. They are rough, but a viewer sees what they are; no name says of what a part is made. The
command `python tests/kit/characters.py FOLDER` writes all of them as .glb.
"""

import struct
import sys
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from kit.asset import Array, Asset, Json
from wrinklecli.numeric.arrays import cross

Weights = dict[str, float]
Rotation = tuple[str, Sequence[float]]
# For each joint its parent, "" for a root, and its place in metres.
Skeleton = Mapping[str, tuple[str, tuple[float, float, float]]]

# The joints of a person of 1.75 m who stands as a T and looks along z: parent and place in metres; x > 0 is left.
_TRUNK: Skeleton = {
    "hips": ("", (0.0, 0.95, 0.0)),
    "spine": ("hips", (0.0, 1.08, 0.0)),
    "chest": ("spine", (0.0, 1.24, 0.0)),
    "neck": ("chest", (0.0, 1.46, -0.01)),
    "head": ("neck", (0.0, 1.55, 0.0)),
}
_SIDE: Skeleton = {
    "shoulder": ("chest", (0.05, 1.39, 0.0)),
    "upper_arm": ("shoulder", (0.19, 1.39, 0.0)),
    "forearm": ("upper_arm", (0.45, 1.39, 0.0)),
    "hand": ("forearm", (0.69, 1.39, 0.0)),
    "thigh": ("hips", (0.1, 0.9, 0.0)),
    "shin": ("thigh", (0.1, 0.49, 0.01)),
    "foot": ("shin", (0.1, 0.09, -0.02)),
    "toe": ("foot", (0.1, 0.03, 0.11)),
}
MIXAMO = {
    "hips": "Hips", "spine": "Spine", "chest": "Spine2", "neck": "Neck", "head": "Head", "shoulder": "Shoulder",
    "upper_arm": "Arm", "forearm": "ForeArm", "hand": "Hand", "thigh": "UpLeg", "shin": "Leg", "foot": "Foot",
    "toe": "ToeBase", "upper_twist": "ArmTwist", "fore_twist": "ForeArmTwist",
}  # fmt: skip

# Pictures


def png(pixels: Array) -> bytes:
    """Encode (height, width, 3) colours from 0 to 1, sRGB, or 4 with alpha, as a PNG."""
    rows = np.round(np.clip(pixels, 0.0, 1.0) * 255.0).astype(np.uint8)
    height, width, channels = rows.shape
    data = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">2I5B", width, height, 8, 6 if channels == 4 else 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data)) + chunk(b"IEND", b"")


def _noise(size: int, cell: int, seed: int) -> Array:
    """(size, size) smooth noise of deviation 1 whose spots are about `cell` pixels wide; it repeats at the borders."""
    frequencies = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size)))
    white = np.fft.fft2(np.random.default_rng(seed).standard_normal((size, size)))
    found = np.fft.ifft2(white * np.exp(-((frequencies * cell) ** 2))).real
    return (found - found.mean()) / found.std()


def _shaded(colour: Sequence[float], shade: Array) -> Array:
    return np.array(colour) * (1.0 + shade[..., None])


def skin(size: int, colour: Sequence[float] = (0.85, 0.64, 0.53)) -> Array:
    """Skin, with blotches that are redder, and pores."""
    return _shaded(colour, 0.02 * _noise(size, 2, 1)) + 0.02 * _noise(size, 60, 2)[..., None] * [1.0, -0.4, -0.4]


def denim(size: int, colour: Sequence[float] = (0.22, 0.31, 0.48)) -> Array:
    """Twill of blue warp and pale weft, faded in places."""
    y, x = np.mgrid[:size, :size]
    twill = 0.16 * np.where((x + y) % 4 < 2, 1.0, -1.0)
    return _shaded(colour, twill + 0.12 * _noise(size, 2, 3) + 0.1 * _noise(size, 80, 4))


def cotton(size: int, colour: Sequence[float] = (0.80, 0.80, 0.76)) -> Array:
    """A plain weave with soft shadows."""
    y, x = np.mgrid[:size, :size]
    weave = 0.05 * np.where((x // 2 + y // 2) % 2 == 0, 1.0, -1.0)
    return _shaded(colour, weave + 0.03 * _noise(size, 2, 5) + 0.04 * _noise(size, 70, 6))


def leather(size: int, colour: Sequence[float] = (0.25, 0.15, 0.09)) -> Array:
    """Dark, with the lines between grains."""
    return _shaded(colour, 0.1 * _noise(size, 4, 7) - 0.2 * (np.abs(_noise(size, 9, 8)) < 0.12))


def steel(size: int, colour: Sequence[float] = (0.62, 0.63, 0.66)) -> Array:
    """Brushed, with dents."""
    return _shaded(colour, 0.05 * _noise(size, 40, 9) + 0.03 * _noise(size, 3, 10).mean(axis=0) * np.ones((size, 1)))


def face(size: int, colour: Sequence[float] = (0.85, 0.64, 0.53)) -> Array:
    """A head around its axis, with the face in the middle and the crown at the bottom: hair, eyes and a mouth."""
    found = skin(size, colour)
    y, x = np.mgrid[:size, :size] / size
    hair = (y > 0.82) | ((np.abs(x - 0.5) > 0.22) & (y > 0.45))
    found[hair] = _shaded((0.2, 0.13, 0.08), 0.2 * _noise(size, 3, 11))[hair]
    for left in (0.44, 0.56):
        found[np.hypot((x - left) * 2.2, y - 0.6) < 0.05] = (0.95, 0.95, 0.93)
        found[np.hypot((x - left) * 2.2, y - 0.6) < 0.025] = (0.1, 0.1, 0.12)
    found[np.hypot((x - 0.5), (y - 0.34) * 2.5) < 0.05] = (0.62, 0.3, 0.28)
    return found


# Surfaces


@dataclass
class Surface:
    """Welded points with weights, and faces with texture coordinates and the name of their region."""

    points: list[Array] = field(default_factory=list)
    weights: list[Weights] = field(default_factory=list)
    faces: list[list[int]] = field(default_factory=list)
    corners: list[list[tuple[float, float]]] = field(default_factory=list)
    regions: list[str] = field(default_factory=list)

    def ring(self, points: Array, weights: Weights) -> list[int]:
        """Add points that move alike."""
        self.points += list(points)
        self.weights += [weights] * len(points)
        return list(range(len(self.points) - len(points), len(self.points)))

    def band(self, rings: Sequence[Sequence[int]], regions: Sequence[str], skip: Any = ()) -> None:
        """Join rings of equally many points by quads, all of a region between two rings, that look outwards."""
        count = len(rings[0])
        middles = [np.mean([self.points[k] for k in ring], axis=0) for ring in rings]
        for row, (low, high) in enumerate(pairwise(rings)):
            v = [row / (len(rings) - 1), (row + 1) / (len(rings) - 1)]
            for column in range(count):
                if (row, column) not in skip:
                    u, following = [column / count, (column + 1) / count], (column + 1) % count
                    ids = [low[column], low[following], high[following], high[column]]
                    corners = [(u[0], v[0]), (u[1], v[0]), (u[1], v[1]), (u[0], v[1])]
                    self.face(ids, corners, regions[row], (middles[row] + middles[row + 1]) / 2.0)

    def face(self, ids: list[int], corners: list[tuple[float, float]], region: str, inside: Array) -> None:
        """Add a polygon that looks away from a place."""
        places = np.array([self.points[k] for k in ids])
        normal = _area(places)
        turn = -1 if normal @ (places.mean(axis=0) - inside) < 0 else 1
        self.faces.append(ids[::turn])
        self.corners.append(corners[::turn])
        self.regions.append(region)

    def cap(self, ring: Sequence[int], region: str, inside: Array, bulge: float = 0.0) -> None:
        """Close a ring by triangles that meet in a point, which stands out from the middle."""
        middle = np.mean([self.points[k] for k in ring], axis=0)
        out = middle - inside
        tip = self.ring((middle + bulge * out / np.linalg.norm(out))[None], self.weights[ring[0]])[0]
        for k, at in enumerate(ring):
            around = [(k / len(ring), 0.96), ((k + 1) / len(ring), 0.96), ((k + 0.5) / len(ring), 1.0)]
            self.face([at, ring[(k + 1) % len(ring)], tip], around, region, inside)

    def tube(
        self,
        middles: Any,
        radii: Any,
        weights: Sequence[Weights],
        region: str | Sequence[str],
        *,
        sides: int,
        capped: bool = True,
        across: tuple[float, float, float] = (1.0, 0.0, 0.0),
        phase: float = 0.0,
        bulge: float = 0.0,
    ) -> list[list[int]]:
        """Add a tube along (rings, 3) middles with (rings, 2) radii, the second one along `across`."""
        middles, radii = np.asarray(middles, float), np.broadcast_to(radii, (len(middles), 2))
        first = np.cross(across, np.gradient(middles, axis=0))
        first /= np.linalg.norm(first, axis=1)[:, None]
        turns = 2.0 * np.pi * (np.arange(sides) + phase) / sides
        rings = [
            self.ring(m + r[0] * np.outer(np.cos(turns), f) + r[1] * np.outer(np.sin(turns), across), w)
            for m, r, f, w in zip(middles, radii, first, weights, strict=True)
        ]
        self.band(rings, [region] * len(rings) if isinstance(region, str) else region)
        if capped:
            whole = middles.mean(axis=0)
            self.cap(rings[0], region if isinstance(region, str) else region[0], whole, bulge)
            self.cap(rings[-1], region if isinstance(region, str) else region[-1], whole, bulge)
        return rings

    def box(self, low: Any, high: Any, joint: str, region: str) -> None:
        """Add a box that one joint moves."""
        low, high = np.array(low), np.array(high)
        middle, half = (low + high) / 2.0, (high - low) / 2.0
        radii = (half[2] * 2**0.5, half[0] * 2**0.5)
        ends = [[middle[0], low[1], middle[2]], [middle[0], high[1], middle[2]]]
        self.tube(ends, radii, [{joint: 1.0}] * 2, region, sides=4, phase=0.5)

    def inflated(self, regions: Sequence[str], by: float) -> "Surface":
        """The faces of some regions, as a layer that lies outside of this surface by a distance."""
        normals = np.zeros((len(self.points), 3))
        for ids in self.faces:
            normals[ids] += _area(np.array([self.points[k] for k in ids[:3]]))
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
        moved = list(np.array(self.points) + by * normals)
        whole = Surface(moved, self.weights, self.faces, self.corners, self.regions)
        return whole.kept([region in regions for region in self.regions])

    def kept(self, chosen: Sequence[bool]) -> "Surface":
        """The chosen faces."""
        faces, corners, regions = (
            [item for item, keep in zip(items, chosen, strict=True) if keep]
            for items in (self.faces, self.corners, self.regions)
        )
        return Surface(self.points, self.weights, faces, corners, regions)


def chain_weights(at: float, joints: Sequence[str], blend: float) -> Weights:
    """Weights at a place along a chain whose joint k begins to turn at k, over a length of `blend`."""
    steps = np.clip((at - np.arange(len(joints) + 1)) / blend + 0.5, 0.0, 1.0)
    steps = steps * steps * (3.0 - 2.0 * steps)
    steps[0], steps[-1] = 1.0, 0.0
    shares = steps[:-1] - steps[1:]
    return {joint: float(share) for joint, share in zip(joints, shares, strict=True) if share > 1e-6}


def _along(at: Array, stations: Sequence[Sequence[float]]) -> Array:
    """Rows of numbers at places between stations, whose first number is the place."""
    known = np.array(stations)
    return np.stack([np.interp(at, known[:, 0], column) for column in known.T[1:]], axis=1)


def _join(surface: Surface, hole: list[int], rings: list[list[int]], regions: Sequence[str]) -> None:
    """Join the border of a hole to a tube of as many sides, turned so that the edges between are short."""
    places = np.array([surface.points[k] for k in rings[0]])
    border = np.array([surface.points[k] for k in hole])
    turned = [np.roll(np.arange(len(hole))[::way], by) for way in (1, -1) for by in range(len(hole))]
    away = [np.sum((border[order] - places) ** 2) for order in turned]
    surface.band([[hole[k] for k in turned[int(np.argmin(away))]], *rings], regions)


def person(
    *,
    columns: int = 12,
    rows: int = 5,
    fingers: int = 4,
    thick: float = 1.0,
    head: float = 1.0,
    twist: bool = False,
    blend: float = 0.6,
) -> Surface:
    """A closed body of regions hips, belly, chest, neck, head; sleeve, forearm, hand; thigh, shin, foot.

    Args:
        columns: Points around the trunk, a multiple of 4; the legs have half as many and two more.
        rows: Rings between two joints of a limb.
        fingers: Besides the thumb, all turned by the hand.
        thick: Factor of the limbs' radii.
        head: Factor of the head's size.
        twist: Let twist joints take half of the arms' weights.
        blend: Length over which joints turn, in lengths of a bone.
    """
    surface = Surface()
    hole = max(2, columns // 12 * 2)
    # Height, half a width, half a depth, and the place along the chain of joints.
    heights = [0.92, 0.97, 1.04, 1.11, 1.18, 1.25, *np.linspace(1.32, 1.45, hole + 1), 1.47, 1.5]
    trunk = _along(
        np.array(heights),
        [(0.92, 0.165, 0.11, 0), (1.04, 0.15, 0.1, 0.6), (1.13, 0.135, 0.092, 1.3), (1.25, 0.16, 0.11, 2.1),
         (1.32, 0.17, 0.115, 2.4), (1.385, 0.165, 0.1, 2.6), (1.45, 0.12, 0.075, 2.8), (1.47, 0.07, 0.06, 3),
         (1.5, 0.052, 0.055, 3.4)],
    )  # fmt: skip
    turns = 2.0 * np.pi * np.arange(columns) / columns
    joints = ["hips", "spine", "chest", "neck", "head"]
    rings = []
    for height, (wide, deep, at) in zip(heights, trunk, strict=True):
        outline = np.stack([wide * np.sin(turns), np.full(columns, height), -deep * np.cos(turns)], axis=1)
        rings.append(surface.ring(outline, chain_weights(at, joints, 0.9)))
    first, quarter = 6, columns // 4
    left = [(first + r, quarter - hole // 2 + c) for r in range(hole) for c in range(hole)]
    right = [(first + r, 3 * quarter - hole // 2 + c) for r in range(hole) for c in range(hole)]
    regions = ["hips", "hips", "belly", "belly", *["chest"] * (len(rings) - 6), "neck"]
    surface.band(rings, regions, skip=[*left, *right])
    # The head ends the neck.
    skull = np.array(
        [(1.53, 0.055, 0.06, 0), (1.55, 0.07, 0.09, 0.02), (1.59, 0.078, 0.105, 0.02), (1.64, 0.082, 0.105, 0.01),
         (1.69, 0.08, 0.1, 0), (1.73, 0.062, 0.078, -0.005), (1.75, 0.03, 0.04, -0.008)]
    )  # fmt: skip
    skull[1:, 0], skull[1:, 1:] = 1.53 + head * (skull[1:, 0] - 1.53), head * skull[1:, 1:]
    above = [
        surface.ring(np.stack([w * np.sin(turns), np.full(columns, y), z - d * np.cos(turns)], axis=1), {"head": 1.0})
        for y, w, d, z in skull
    ]
    surface.band([rings[-1], *above], ["neck", *["head"] * len(above)])
    surface.cap(above[-1], "head", np.array([0.0, 1.6, 0.0]), 0.006)
    for side, sign, corner in (("L", 1.0, quarter), ("R", -1.0, 3 * quarter)):
        low, high = corner - hole // 2, corner + hole // 2
        armhole = [
            *(rings[first][c] for c in range(low, high)),
            *(rings[first + r][high % columns] for r in range(hole)),
            *(rings[first + hole][c % columns] for c in range(high, low, -1)),
            *(rings[first + r][low] for r in range(hole, 0, -1)),
        ]
        _arm(surface, armhole, side, sign, rows=rows, fingers=fingers, thick=thick, twist=twist, blend=blend)
    _legs(surface, rings[0], rows=rows, thick=thick, blend=blend)
    return surface


def _arm(
    surface: Surface,
    hole: list[int],
    side: str,
    sign: float,
    *,
    rows: int,
    fingers: int,
    thick: float,
    twist: bool,
    blend: float,
) -> None:
    at = np.concatenate([np.linspace(0.0, 1.0, rows + 1)[:-1] + 0.1, np.linspace(1.0, 2.0, rows + 1), [2.2, 2.5, 2.9]])
    # Place, x, radius up, radius to the front.
    limb = _along(
        at,
        [(0, 0.19, 0.058, 0.055), (0.5, 0.32, 0.05, 0.048), (1, 0.45, 0.04, 0.04), (1.35, 0.53, 0.042, 0.04),
         (2, 0.69, 0.025, 0.03), (2.2, 0.71, 0.024, 0.036), (2.6, 0.75, 0.02, 0.045), (3, 0.785, 0.015, 0.043)],
    )  # fmt: skip
    joints = [f"{name}.{side}" for name in ("upper_arm", "forearm", "hand")]
    weights = [chain_weights(max(place, 0.3), joints, blend) for place in at]
    for place, row in zip(at, weights, strict=True):
        for bone, name in enumerate(("upper_twist", "fore_twist") if twist else ()):
            if joints[bone] in row:
                part = float(np.clip(place - bone, 0.0, 1.0)) if bone else float(np.clip(1.0 - place, 0.0, 1.0))
                row[f"{name}.{side}"] = 0.7 * part * row[joints[bone]]
                row[joints[bone]] *= 1.0 - 0.7 * part
    middles = np.stack([sign * limb[:, 0], np.full(len(at), 1.39), np.zeros(len(at))], axis=1)
    regions = ["sleeve" if x < 0.85 else "forearm" if x < 2.0 else "hand" for x in at]
    radii = limb[:, 1:] * np.where(at < 2.1, thick, 1.0)[:, None]
    tube = surface.tube(middles, radii, weights, regions[1:], sides=len(hole), capped=False, across=(0.0, 0.0, sign))
    _join(surface, hole, tube[:1], ["sleeve"])
    palm = {f"hand.{side}": 1.0}
    surface.cap(tube[-1], "hand", middles[-2], 0.004)
    for k, z in enumerate(np.linspace(0.034, -0.034, fingers)):
        ends = [[sign * x, 1.39, z] for x in (0.77, 0.80, 0.83, 0.865 - 0.008 * abs(k - 1))]
        sizes = np.array([[0.0105], [0.01], [0.009], [0.007]]) * (4.6 / (fingers + 0.6))
        surface.tube(ends, sizes, [palm] * 4, "hand", sides=6, bulge=0.004, across=(0.0, 0.0, sign))
    thumb = [[sign * 0.715, 1.385, 0.03], [sign * 0.74, 1.382, 0.058], [sign * 0.775, 1.38, 0.07]]
    surface.tube(thumb, [[0.013], [0.012], [0.009]], [palm] * 3, "hand", sides=6, bulge=0.004, across=(0.0, 0.0, sign))


def _legs(surface: Surface, waist: list[int], *, rows: int, thick: float, blend: float) -> None:
    """Join both legs to the lowest ring of the trunk, with a strip between them from the back to the front."""
    count = len(waist)
    between = max(1, count // 8)
    back, front = surface.points[waist[0]], surface.points[waist[count // 2]]
    shares = np.linspace(0.0, 1.0, between + 2)[1:-1, None]
    strip = surface.ring((1 - shares) * back + shares * front - [0.0, 0.06, 0.0], {"hips": 1.0})
    for side, sign, ring in (
        ("L", 1.0, [*waist[: count // 2 + 1], *strip[::-1]]),
        ("R", -1.0, [*waist[count // 2 :], waist[0], *strip]),
    ):
        at = np.concatenate([np.linspace(0.15, 1.0, rows + 1)[:-1], np.linspace(1.0, 2.0, rows + 1)])
        # Place, height, depth, radius to the back, radius aside.
        limb = _along(
            at,
            [(0, 0.9, 0.0, 0.1, 0.085), (0.5, 0.69, 0.0, 0.075, 0.07), (1, 0.49, 0.01, 0.056, 0.055),
             (1.35, 0.36, -0.01, 0.056, 0.053), (2, 0.09, -0.02, 0.04, 0.035)],
        )  # fmt: skip
        middles = np.stack([np.full(len(at), sign * 0.1), limb[:, 0], limb[:, 1]], axis=1)
        joints = [f"{name}.{side}" for name in ("thigh", "shin", "foot", "toe")]
        weights = [chain_weights(float(place), joints, blend) for place in at]
        weights[0] = {"hips": 0.5, joints[0]: 0.5}
        # The heel, the instep, the ball and the tip of a foot.
        middles = np.concatenate([middles, [[sign * 0.1, y, z] for y, z in ((0.055, 0.0), (0.045, 0.06))]])
        middles = np.concatenate([middles, [[sign * 0.1, y, z] for y, z in ((0.036, 0.11), (0.025, 0.17))]])
        radii = np.concatenate([limb[:, 2:] * thick, [(0.066, 0.036), (0.046, 0.04), (0.034, 0.044), (0.022, 0.03)]])
        feet = [{joints[2]: 1.0}, {joints[2]: 1.0}, {joints[2]: 0.5, joints[3]: 0.5}, {joints[3]: 1.0}]
        regions = ["thigh" if x < 0.95 else "shin" if x < 1.7 else "foot" for x in at] + ["foot"] * 4
        tube = surface.tube(middles, radii, weights + feet, regions[1:], sides=len(ring), capped=False)
        _join(surface, ring, tube[:1], ["thigh"])
        surface.cap(tube[-1], "foot", middles[-2], 0.008)


# Files


@dataclass(frozen=True)
class Stuff:
    """The material of regions: factors, and textures with the rectangle of theirs that a region fills."""

    material: Json
    rectangle: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)
    flat: bool = False


def plain(
    name: str, colour: Sequence[float], *, metallic: float = 0.0, roughness: float = 0.8, flat: bool = False
) -> Stuff:
    """A material without a texture; the colour is linear."""
    looks = {"baseColorFactor": [*colour, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness}
    return Stuff({"name": name, "pbrMetallicRoughness": looks}, flat=flat)


def _person_joints(*, twist: bool) -> Skeleton:
    found, side = dict(_TRUNK), dict(_SIDE)
    if twist:
        side["upper_twist"] = ("upper_arm", (0.2, 1.39, 0.0))
        side["fore_twist"] = ("forearm", (0.6, 1.39, 0.0))
    for letter, sign in (("L", 1.0), ("R", -1.0)):
        for name, (parent, (x, y, z)) in side.items():
            above = parent if parent in _TRUNK else f"{parent}.{letter}"
            found[f"{name}.{letter}"] = (above, (sign * x, y, z))
    return found


class Writer:
    """A character under construction: a skeleton (a person's if none is given), meshes and clips."""

    def __init__(
        self, *, twist: bool = False, names: Mapping[str, str] | None = None, skeleton: Skeleton | None = None
    ) -> None:
        self.asset = Asset()
        self.names = names
        self.meshes: list[tuple[str, Surface, Mapping[str, Stuff]]] = []
        self.clips: list[tuple[str, Sequence[float], Mapping[str, Rotation], Array | None]] = []
        self.places = dict(_person_joints(twist=twist) if skeleton is None else skeleton)

    def joint(self, name: str, parent: str, place: tuple[float, float, float]) -> str:
        """Add a joint, and give its name."""
        self.places[name] = (parent, place)
        return name

    def texture(self, pixels: Array) -> int:
        """Add a texture, and give its index."""
        view = self.asset.view(png(pixels))
        image = self.asset.append("images", {"bufferView": view, "mimeType": "image/png"})
        return self.asset.append("textures", {"source": image})

    def textured(self, name: str, pixels: Array, *, roughness: float = 0.8, rough: Array | None = None) -> Json:
        """A material with a base colour, and with (height, width, 3) metallic-roughness where given."""
        looks: Json = {"baseColorTexture": {"index": self.texture(pixels)}}
        if rough is None:
            looks |= {"metallicFactor": 0.0, "roughnessFactor": roughness}
        else:
            looks["metallicRoughnessTexture"] = {"index": self.texture(rough)}
        return {"name": name, "pbrMetallicRoughness": looks}

    def mesh(self, name: str, surface: Surface, stuffs: Mapping[str, Stuff]) -> None:
        """Add a mesh whose regions have materials; "" is the material of all other regions."""
        self.meshes.append((name, surface, stuffs))

    def clip(
        self, name: str, times: Sequence[float], rotations: Mapping[str, Rotation], sinks: Array | None = None
    ) -> None:
        """Add a clip: for a joint its axis and degrees at the times; `sinks` is how far the hips go down."""
        self.clips.append((name, times, rotations, sinks))

    def finish(self) -> Asset:
        """Write all that was added."""
        asset, numbers = self.asset, {name: k for k, name in enumerate(self.places)}
        for name, (parent, place) in self.places.items():
            at = np.array(place) - (self.places[parent][1] if parent else 0.0)
            asset.append("nodes", {"name": self._named(name), "translation": at.tolist()})
            if parent:
                asset.gltf["nodes"][numbers[parent]].setdefault("children", []).append(numbers[name])
        binds = np.tile(np.eye(4), (len(numbers), 1, 1))
        binds[:, 3, :3] = -np.array([place for _, place in self.places.values()])
        joints = list(range(len(numbers)))
        matrices = asset.accessor(binds.reshape(-1, 16))
        skin_index = asset.append("skins", {"joints": joints, "inverseBindMatrices": matrices})
        roots = [numbers[name] for name, (parent, _) in self.places.items() if not parent]
        for name, surface, stuffs in self.meshes:
            mesh = asset.append("meshes", {"name": name, "primitives": self._primitives(surface, stuffs, numbers)})
            roots.append(asset.append("nodes", {"name": name, "mesh": mesh, "skin": skin_index}))
        asset.append("scenes", {"nodes": roots})
        asset.gltf["scene"] = 0
        for clip_name, times, rotations, sinks in self.clips:
            animation: Json = {"name": clip_name}
            for joint, (axis, degrees) in rotations.items():
                half = np.radians(np.array(degrees, float)) / 2.0
                turns = np.zeros((len(times), 4))
                turns[:, "xyz".index(axis)], turns[:, 3] = np.sin(half), np.cos(half)
                asset.channel(animation, numbers[joint], "rotation", times, turns)
            if sinks is not None:
                height = np.array(self.places["hips"][1]) - np.outer(sinks, [0.0, 1.0, 0.0])
                asset.channel(animation, numbers["hips"], "translation", times, height)
            asset.append("animations", animation)
        return asset

    def _named(self, joint: str) -> str:
        stem, _, side = joint.partition(".")
        if self.names is None:
            return joint
        where = {"L": "Left", "R": "Right"}.get(side, "")
        return f"mixamorig:{where}{self.names.get(stem, stem)}"

    def _primitives(self, surface: Surface, stuffs: Mapping[str, Stuff], numbers: Mapping[str, int]) -> list[Json]:
        """The primitives of a mesh: the regions of a material each, cut into vertices where coordinates differ."""
        points = np.array(surface.points)
        normals = np.zeros_like(points)
        flat_normals = []
        for ids in surface.faces:
            normal = _area(points[ids])
            flat_normals.append(normal / np.linalg.norm(normal))
            normals[ids] += normal
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
        materials: dict[int, tuple[Json, list[tuple[int, Stuff]]]] = {}
        for number, region in enumerate(surface.regions):
            stuff = stuffs.get(region) or stuffs[""]
            materials.setdefault(id(stuff.material), (stuff.material, []))[1].append((number, stuff))
        primitives = []
        for material, chosen in materials.values():
            vertices: dict[tuple[Any, ...], int] = {}
            triangles = []
            for number, stuff in chosen:
                ids, (x, y, wide, high) = surface.faces[number], stuff.rectangle
                corners = []
                for k, (u, v) in zip(ids, surface.corners[number], strict=True):
                    key = (k, x + wide * u, y + high * v, number if stuff.flat else -1)
                    corners.append(vertices.setdefault(key, len(vertices)))
                triangles += [(corners[0], corners[b], corners[c]) for b, c in _places(len(ids))]
            rows = list(vertices)
            of_vertex = [flat_normals[row[3]] if row[3] >= 0 else normals[row[0]] for row in rows]
            shares = [sorted(surface.weights[row[0]].items(), key=lambda item: -item[1])[:4] for row in rows]
            joints, weights = np.zeros((len(rows), 4)), np.zeros((len(rows), 4))
            for k, share in enumerate(shares):
                joints[k, : len(share)] = [numbers[name] for name, _ in share]
                weights[k, : len(share)] = np.array([w for _, w in share]) / sum(w for _, w in share)
            attributes = {
                "POSITION": self.asset.accessor(points[[row[0] for row in rows]], bounds=True),
                "NORMAL": self.asset.accessor(of_vertex),
                "TEXCOORD_0": self.asset.accessor([row[1:3] for row in rows]),
                "JOINTS_0": self.asset.accessor(joints, "u1"),
                "WEIGHTS_0": self.asset.accessor(weights),
            }
            known = self.asset.gltf.get("materials", [])
            index = known.index(material) if material in known else self.asset.append("materials", material)
            indices = self.asset.accessor(np.ravel(triangles), "u2")
            primitives.append({"attributes": attributes, "indices": indices, "material": index})
        return primitives


def _places(count: int) -> list[tuple[int, int]]:
    return [(k, k + 1) for k in range(1, count - 1)]


def _area(corners: Array) -> Array:
    """Twice the area of a polygon of (corners, 3), along its normal; `np.cross` takes ten times as long for so few."""
    steps = (corners[1:] - corners[0]).T
    return np.array([each.sum() for each in cross(steps[:, :-1], steps[:, 1:])])


# Clips

_BEND = (0.0, 0.5, 1.0, 1.5, 2.0)


def _squat(writer: Writer) -> None:
    """Let a character squat, with its arms ahead, elbows and wrists bent."""
    there = np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    moves: dict[str, Rotation] = {"spine": ("x", 25 * there), "neck": ("x", -15 * there)}
    for side, sign in (("L", 1.0), ("R", -1.0)):
        moves[f"thigh.{side}"] = ("x", -95 * there)
        moves[f"shin.{side}"] = ("x", 100 * there)
        moves[f"foot.{side}"] = ("x", -25 * there)
        moves[f"toe.{side}"] = ("x", -15 * there)
        moves[f"upper_arm.{side}"] = ("y", -60 * sign * there)
        moves[f"forearm.{side}"] = ("y", -100 * sign * there)
        moves[f"hand.{side}"] = ("z", 60 * sign * there)
    writer.clip("squat", _BEND, moves, 0.35 * there)


def _wave(writer: Writer) -> None:
    """Let a character raise and bend its right arm only."""
    moves: dict[str, Rotation] = {
        "upper_arm.R": ("z", [50, 30, 0, 30, 50]),
        "forearm.R": ("z", [0, -90, -120, -60, 0]),
        "hand.R": ("z", [0, 40, -50, 40, 0]),
    }
    writer.clip("wave", _BEND, moves)


# Characters


def _atlas(
    pictures: Mapping[str, Array], size: int = 512
) -> tuple[Array, dict[str, tuple[float, float, float, float]]]:
    """A picture of tiles, and the rectangle of each, a little within its tile."""
    side = int(np.ceil(len(pictures) ** 0.5))
    tile = size // side
    found, rectangles = np.full((size, size, 3), 0.5), {}
    for k, (name, picture) in enumerate(pictures.items()):
        x, y = k % side * tile, k // side * tile
        found[y : y + tile, x : x + tile] = picture[:tile, :tile]
        margin = min(3, tile // 4)
        inner = (tile - 2 * margin) / size
        rectangles[name] = ((x + margin) / size, (y + margin) / size, inner, inner)
    return found, rectangles


_SKINS = {"pale": (0.94, 0.79, 0.71), "tan": (0.80, 0.58, 0.44), "dark": (0.36, 0.22, 0.16), "green": (0.45, 0.62, 0.3),
          "pink": (0.92, 0.58, 0.66), "black": (0.05, 0.05, 0.05)}  # fmt: skip


def dressed(
    tone: str = "tan",
    shirt: Sequence[float] = (0.80, 0.80, 0.76),
    *,
    trousers: Sequence[float] | None = None,
    boots: Sequence[float] = (0.25, 0.15, 0.09),
) -> Asset:
    """A figure in a shirt, trousers (jeans if they have no colour) and boots on one atlas and one mesh; it squats."""
    writer = Writer()
    colour = _SKINS[tone]
    tile = 170
    worn = denim(tile) if trousers is None else cotton(tile, trousers)
    pictures = {
        "head": face(tile, colour), "skin": skin(tile, colour), "denim": worn, "cotton": cotton(tile, shirt),
        "leather": leather(tile, boots),
    }  # fmt: skip
    atlas, rectangles = _atlas(pictures)
    material = writer.textured("Material.001", atlas)
    of = {
        "head": "head", "neck": "skin", "forearm": "skin", "hand": "skin", "sleeve": "cotton", "chest": "cotton",
        "belly": "cotton", "hips": "denim", "thigh": "denim", "shin": "denim", "foot": "leather",
    }  # fmt: skip
    stuffs = {region: Stuff(material, rectangles[name]) for region, name in of.items()}
    writer.mesh("Mesh_0", person(columns=24, rows=8), stuffs)
    _squat(writer)
    return writer.finish()


def low_poly(*, flat: bool = True) -> Asset:
    """About 700 triangles in jeans, a shirt and bare arms, all colours from one palette; it squats."""
    writer = Writer()
    swatches = {
        "skin": (0.87, 0.66, 0.52), "denim": (0.20, 0.32, 0.55), "shirt": (0.78, 0.24, 0.20), "shoe": (0.22, 0.15, 0.1),
        "hair": (0.3, 0.2, 0.1), "grey": (0.5, 0.5, 0.5), "green": (0.3, 0.6, 0.3), "white": (1.0, 1.0, 1.0),
    }  # fmt: skip
    palette = np.zeros((8, 8, 3))
    for k, colour in enumerate(swatches.values()):
        palette[:, k] = colour
    material = writer.textured("palette", palette)
    of = {"sleeve": "shirt", "chest": "shirt", "belly": "shirt", "hips": "denim", "thigh": "denim", "shin": "denim",
          "foot": "shoe", "": "skin"}  # fmt: skip
    numbers = {name: k for k, name in enumerate(swatches)}
    stuffs = {region: Stuff(material, ((numbers[name] + 0.5) / 8, 0.5, 0.0, 0.0), flat) for region, name in of.items()}
    writer.mesh("Character", person(columns=8, rows=3, fingers=1), stuffs)
    _squat(writer)
    return writer.finish()


def avatar() -> Asset:
    """A body below trousers and a jacket, with eyes and teeth, twist joints and Mixamo's names; no clips."""
    writer = Writer(twist=True, names=MIXAMO)
    body = person(columns=16, rows=6, twist=True)
    bare = Stuff(writer.textured("M_01", skin(256, _SKINS["dark"])))
    head = Stuff(writer.textured("M_02", face(256, _SKINS["dark"])))
    writer.mesh("mesh_0", body, {"head": head, "": bare})
    twill = Stuff(writer.textured("M_03", denim(256)))
    writer.mesh("mesh_1", body.inflated(("hips", "thigh", "shin"), 0.012), {"": twill})
    wool = Stuff(writer.textured("M_04", cotton(256, (0.30, 0.33, 0.30))))
    writer.mesh("mesh_2", body.inflated(("belly", "chest", "sleeve", "forearm"), 0.018), {"": wool})
    for name, height, size, colour, places in (
        ("mesh_3", 1.665, 0.014, (0.9, 0.9, 0.88), (-0.03, 0.03)),
        ("mesh_4", 1.61, 0.012, (0.85, 0.82, 0.75), (-0.015, 0.0, 0.015)),
    ):
        balls = Surface()
        for x in places:
            ends = [[x, height + size * y, 0.098] for y in (-0.9, -0.4, 0.4, 0.9)]
            radii = size * np.array([[0.45], [0.9], [0.9], [0.45]])
            balls.tube(ends, radii, [{"head": 1.0}] * 4, "ball", sides=10, bulge=0.1 * size)
        writer.mesh(name, balls, {"": plain(f"M_{name}", colour, roughness=0.2)})
    return writer.finish()


def cartoon() -> Asset:
    """A big head, thin limbs and hands of four fingers in plain colours; the right arm waves."""
    writer = Writer()
    materials = {
        "skin": plain("Material", (0.95, 0.55, 0.30)), "shirt": plain("Material.002", (0.05, 0.35, 0.65)),
        "pants": plain("Material.003", (0.55, 0.08, 0.10)), "shoe": plain("Material.004", (0.06, 0.03, 0.02)),
    }  # fmt: skip
    of = {"": "skin", "sleeve": "shirt", "chest": "shirt", "belly": "shirt", "hips": "pants", "thigh": "pants",
          "shin": "skin", "foot": "shoe"}  # fmt: skip
    body = person(columns=16, rows=6, fingers=3, thick=0.75, head=1.8)
    writer.mesh("Toon", body, {region: materials[name] for region, name in of.items()})
    eyes = Surface()
    for x in (-0.05, 0.05):
        ends = [[x, 1.74 + y, 0.185] for y in (-0.035, -0.02, 0.02, 0.035)]
        eyes.tube(ends, [[0.01], [0.026], [0.026], [0.01]], [{"head": 1.0}] * 4, "ball", sides=12)
    writer.mesh("Sphere", eyes, {"": plain("Material.005", (0.9, 0.9, 0.9), roughness=0.1)})
    _wave(writer)
    return writer.finish()


def knight(*, tabard: bool = False) -> Asset:
    """Plates that follow one joint each and gauntlets that bend, all of metal; with a tabard of cloth, if wanted."""
    writer = Writer()
    rough = np.tile([0.0, 0.35, 1.0], (16, 16, 1))
    metal = Stuff(writer.textured("Material", steel(256), rough=rough))
    plates, body = Surface(), person(columns=16, rows=6)
    for joint, start, end, wide, narrow in _plates():
        at = np.linspace(0.0, 1.0, 5)[:, None]
        middles = (1 - at) * np.array(start) + at * np.array(end)
        radii = (1 - at) * np.array(wide) + at * np.array(narrow)
        level = abs(end[0] - start[0]) > abs(end[1] - start[1])
        across = (0.0, 0.0, 1.0) if level else (1.0, 0.0, 0.0)
        plates.tube(middles, radii, [{joint: 1.0}] * 5, "plate", sides=16, across=across)
    writer.mesh("body", plates, {"": metal})
    for side, sign in (("L", 1.0), ("R", -1.0)):
        glove = body.inflated(("hand", "forearm"), 0.006)
        writer.mesh(
            f"Hand.{side}", glove.kept([sign * glove.points[ids[0]][0] > 0.6 for ids in glove.faces]), {"": metal}
        )
    if tabard:
        red = Stuff(writer.textured("Material.001", cotton(256, (0.55, 0.10, 0.10))))
        cloth = Surface()
        at = np.linspace(1.2, 0.62, 12)
        middles = np.stack([0 * at, at, 0 * at], axis=1)
        radii = np.stack([0.15 + 0.08 * (1.2 - at), 0.205 + 0.06 * (1.2 - at)], axis=1)
        cloth.tube(middles, radii, [{"hips": 1.0}] * len(at), "cloth", sides=28, capped=False)
        _skirt(cloth)
        writer.mesh("Object.012", cloth, {"": red})
    _squat(writer)
    return writer.finish()


def _skirt(cloth: Surface) -> None:
    """Let the points of a skirt follow the spine, and below the hips the thigh on their side."""
    for k, (x, y, _) in enumerate(cloth.points):
        if y > 1.0:
            share = float(np.clip((y - 1.0) / 0.18, 1e-9, 1.0))
            cloth.weights[k] = {"hips": 1.0 - share, "spine": share}
        else:
            share = float(np.clip((1.0 - y) / 0.2, 0.0, 1.0))
            left = float(np.clip(0.5 + x / 0.12, 0.0, 1.0))
            cloth.weights[k] = {"hips": 1 - share + 1e-9, "thigh.L": share * left, "thigh.R": share * (1 - left)}


def _plates() -> list[tuple[str, Any, Any, Any, Any]]:
    """Joint, start, end and two radii at both, of each plate."""
    found: list[tuple[str, Any, Any, Any, Any]] = [
        ("chest", (0, 1.16, 0), (0, 1.46, 0), (0.135, 0.165), (0.09, 0.12)),
        ("spine", (0, 1.05, 0), (0, 1.2, 0), (0.115, 0.15), (0.12, 0.15)),
        ("hips", (0, 0.84, 0), (0, 1.07, 0), (0.15, 0.2), (0.12, 0.155)),
        ("neck", (0, 1.45, 0), (0, 1.56, 0), (0.075, 0.075), (0.08, 0.08)),
        ("head", (0, 1.53, 0), (0, 1.7, 0), (0.12, 0.1), (0.12, 0.105)),
        ("head", (0, 1.69, 0), (0, 1.8, 0), (0.125, 0.11), (0.03, 0.03)),
    ]
    for side, sign in (("L", 1.0), ("R", -1.0)):
        found += [
            (f"upper_arm.{side}", (sign * 0.17, 1.4, 0), (sign * 0.3, 1.38, 0), (0.085, 0.085), (0.06, 0.06)),
            (f"upper_arm.{side}", (sign * 0.27, 1.39, 0), (sign * 0.43, 1.39, 0), (0.055, 0.055), (0.05, 0.05)),
            (f"forearm.{side}", (sign * 0.41, 1.39, 0), (sign * 0.5, 1.39, 0), (0.058, 0.058), (0.055, 0.055)),
            (f"forearm.{side}", (sign * 0.49, 1.39, 0), (sign * 0.68, 1.39, 0), (0.053, 0.053), (0.035, 0.035)),
            (f"thigh.{side}", (sign * 0.1, 0.88, 0), (sign * 0.1, 0.52, 0.01), (0.1, 0.092), (0.066, 0.064)),
            (f"shin.{side}", (sign * 0.1, 0.54, 0.015), (sign * 0.1, 0.43, 0.01), (0.07, 0.066), (0.066, 0.064)),
            (f"shin.{side}", (sign * 0.1, 0.44, 0.0), (sign * 0.1, 0.08, -0.02), (0.064, 0.062), (0.05, 0.046)),
            (f"foot.{side}", (sign * 0.1, 0.05, -0.06), (sign * 0.1, 0.045, 0.1), (0.05, 0.045), (0.045, 0.05)),
            (f"toe.{side}", (sign * 0.1, 0.04, 0.08), (sign * 0.1, 0.02, 0.2), (0.042, 0.05), (0.018, 0.02)),
        ]
    return found


def robot() -> Asset:
    """Boxes with hard edges whose knees, elbows and fingers bend smoothly; one plain grey."""
    writer = Writer()
    body = Surface()
    body.box((-0.17, 1.1, -0.11), (0.17, 1.46, 0.11), "chest", "box")
    body.box((-0.13, 0.88, -0.09), (0.13, 1.08, 0.09), "hips", "box")
    body.box((-0.05, 1.44, -0.05), (0.05, 1.56, 0.05), "neck", "box")
    body.box((-0.1, 1.54, -0.1), (0.1, 1.76, 0.1), "head", "box")
    moves: dict[str, Rotation] = {}
    there = np.array([0.0, 0.5, 1.0, 0.5, 0.0])
    for side, sign in (("L", 1.0), ("R", -1.0)):
        x = sign * np.array([0.18, 0.35, 0.41, 0.45, 0.49, 0.55, 0.66])
        chain = [f"{name}.{side}" for name in ("upper_arm", "forearm", "hand")]
        weights = [chain_weights(at, chain, 0.4) for at in (0.5, 0.6, 0.85, 1.0, 1.15, 1.4, 1.7)]
        _limb(body, np.stack([x, 0 * x + 1.39, 0 * x], axis=1), 0.05, weights, (0.0, 0.0, 1.0))
        body.tube([[sign * 0.66, 1.39, 0], [sign * 0.75, 1.39, 0]], (0.03, 0.06), [{chain[2]: 1.0}] * 2, "box", sides=4,
                  phase=0.5, across=(0.0, 0.0, 1.0))  # fmt: skip
        for k, z in enumerate((-0.03, -0.01, 0.012, 0.034)):
            first = writer.joint(f"finger{k}_a.{side}", chain[2], (sign * 0.75, 1.39, z))
            second = writer.joint(f"finger{k}_b.{side}", first, (sign * 0.79, 1.39, z))
            x = sign * np.array([0.745, 0.76, 0.78, 0.79, 0.80, 0.83])
            weights = [{first: 1.0}, {first: 1.0}, {first: 0.8, second: 0.2}, {first: 0.5, second: 0.5},
                       {first: 0.2, second: 0.8}, {second: 1.0}]  # fmt: skip
            _limb(body, np.stack([x, 0 * x + 1.39, 0 * x + z], axis=1), 0.011, weights, (0.0, 0.0, 1.0))
            moves |= {first: ("z", -60 * sign * there), second: ("z", -80 * sign * there)}
        y = np.array([0.88, 0.65, 0.55, 0.49, 0.43, 0.33, 0.1])
        chain = [f"{name}.{side}" for name in ("thigh", "shin", "foot")]
        weights = [chain_weights(at, chain, 0.4) for at in (0.3, 0.6, 0.85, 1.0, 1.15, 1.4, 1.7)]
        _limb(body, np.stack([0 * y + sign * 0.09, y, 0 * y], axis=1), 0.065, weights, (1.0, 0.0, 0.0))
        body.box((sign * 0.09 - 0.05, 0.0, -0.07), (sign * 0.09 + 0.05, 0.1, 0.17), chain[2], "box")
    writer.mesh("Cube.007", body, {"": plain("Material", (0.45, 0.45, 0.47), roughness=0.6, flat=True)})
    _squat(writer)
    writer.clip("grip", _BEND, moves)
    return writer.finish()


def _limb(body: Surface, middles: Array, radius: float, weights: list[Weights], across: Any) -> None:
    body.tube(middles, radius, weights, "box", sides=4, phase=0.5, across=across)


def tubes() -> Asset:
    """A grey person without textures or clothes whose clip bends the right arm only."""
    writer = Writer()
    writer.mesh("Figure", person(columns=16, rows=8, fingers=2), {"": plain("Grey", (0.5, 0.5, 0.5))})
    _wave(writer)
    return writer.finish()


CHARACTERS: dict[str, Callable[[], Asset]] = {
    "knight": knight,
    "knight_tabard": lambda: knight(tabard=True),
    "robot": robot,
    "low_poly_flat": low_poly,
    "low_poly_smooth": lambda: low_poly(flat=False),
    "dressed": dressed,
    "dressed_dark": lambda: dressed("dark", (0.15, 0.15, 0.17)),
    "dressed_pale": lambda: dressed("pale", (0.75, 0.35, 0.30)),
    "dressed_brown": lambda: dressed(trousers=(0.44, 0.31, 0.22), boots=(0.54, 0.35, 0.17)),
    "dressed_black": lambda: dressed("pale", (0.12, 0.12, 0.13), trousers=(0.1, 0.1, 0.1), boots=(0.06, 0.06, 0.06)),
    "avatar": avatar,
    "cartoon": cartoon,
    "tubes": tubes,
}


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, build in CHARACTERS.items():
        print(build().write(folder / f"{name}.glb"))
