"""A head with a face that ARKit's morph targets move, of any proportions, in any axes, and with names of other rigs.

The skin is a grid of rows and columns round the head, cut open at the lids and lips, whose rims are turned in. Left is
towards +x, and the head looks along +z.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator

from kit.asset import Array, Asset, Json

Deltas = dict[str, Array]

# Heights of the features above the foot of the neck, metres.
CHIN, MOUTH, NOSE, EYES, BROWS, HAIR, CROWN = 0.094, 0.124, 0.152, 0.196, 0.219, 0.268, 0.312
# Distances of eyes' middles, mouth's corners and brows' middles from the middle plane, metres.
EYE, CORNER, BROW = 0.032, 0.026, 0.030
FACS = {
    "browInnerUp": "AU01",
    "browOuterUp": "AU02",
    "browDown": "AU04",
    "cheekSquint": "AU06",
    "eyeSquint": "AU07",
    "noseSneer": "AU09",
    "mouthSmile": "AU12",
    "mouthShrugLower": "AU17",
    "jawOpen": "AU26",
    "eyeBlink": "AU45",
    "mouthFrown": "AU15",
    "mouthPucker": "AU18",
}
MUSCLES = {
    "browInnerUp": "BrowRaiser_Inner",
    "browOuterUp": "BrowRaiser_Outer",
    "browDown": "BrowLowerer",
    "cheekSquint": "CheekRaiser",
    "eyeSquint": "LidTightener",
    "noseSneer": "NoseWrinkler",
    "mouthSmile": "LipCornerPuller",
    "mouthShrugLower": "ChinRaiser",
    "jawOpen": "JawDrop",
    "eyeBlink": "EyesClosed",
}
# Expressions of VRM 1 as weights of ARKit's targets, sides left out.
EXPRESSIONS: Mapping[str, Mapping[str, float]] = {
    "happy": {"mouthSmile": 0.9, "cheekSquint": 0.8, "eyeSquint": 0.5},
    "angry": {"browDown": 1.0, "eyeSquint": 0.3},
    "surprised": {"browInnerUp": 0.9, "browOuterUp": 0.9, "jawOpen": 0.3},
    "blink": {"eyeBlink": 1.0},
    "aa": {"jawOpen": 0.7},
    "ou": {"mouthPucker": 0.8},
}
VROID = {
    "happy": ("Fcl_EYE_Joy", "Fcl_MTH_Joy"),
    "angry": ("Fcl_BRW_Angry",),
    "surprised": ("Fcl_BRW_Surprised",),
    "blink": ("Fcl_EYE_Close",),
    "aa": ("Fcl_MTH_A",),
    "ou": ("Fcl_MTH_U",),
}


@dataclass(frozen=True)
class Face:
    """A head.

    Attributes:
        big_eyes: Factor on the size of the eyes, as of drawn characters.
        scale: Factor on all lengths.
        z_up: Store the mesh with z up, below a node that turns it.
        turn: Degrees by which the stored pose turns the head about the upright axis.
        place: The foot of the neck.
        material: Name of the skin's material.
        whole: Have all 52 targets of ARKit, with those that say nothing of a face's lines.
    """

    big_eyes: float = 1.0
    scale: float = 1.0
    z_up: bool = False
    turn: float = 0.0
    place: tuple[float, float, float] = (0.0, 0.0, 0.0)
    material: str = "skin"
    whole: bool = False

    # The surface.

    @cached_property
    def _angles(self) -> Array:
        """(columns,) round the head, 0 in front, dense there; each with its mirror image."""
        steps = np.concatenate([np.full(22, 1.0), np.linspace(1.3, 3.4, 7)])
        half = np.pi * np.append(0.0, np.cumsum(steps)) / steps.sum()
        return np.concatenate([half, -half[-2:0:-1]])

    @cached_property
    def _heights(self) -> Array:
        """(rows,) from the foot of the neck to near the crown; one row each at the lids and the lips."""
        parts = [
            np.linspace(0.0, 0.085, 7)[:-1],
            np.linspace(0.085, MOUTH, 9)[:-1],
            np.linspace(MOUTH, EYES, 15)[:-1],
            np.linspace(EYES, HAIR, 14)[:-1],
            np.linspace(HAIR, CROWN - 0.002, 7),
        ]
        return np.concatenate(parts)

    def _place(self, angles: Array, heights: Array) -> Array:
        """(…, 3) points of the head."""
        y = np.clip(heights, 0.0, CROWN - 1e-4)
        at = [0.0, 0.04, 0.075, 0.088, CHIN, MOUTH, 0.165, EYES, 0.225, HAIR, 0.295, CROWN]
        wide = PchipInterpolator(at, [0.056, 0.051, 0.050, 0.051, 0.053, 0.061, 0.071, 0.076, 0.078, 0.073, 0.054, 0.0])
        front = PchipInterpolator(at, [0.046, 0.042, 0.046, 0.064, 0.078, 0.083, 0.085, 0.085, 0.087, 0.075, 0.051, 0])
        back = PchipInterpolator(at, [0.062, 0.060, 0.063, 0.067, 0.070, 0.077, 0.087, 0.093, 0.095, 0.082, 0.053, 0.0])
        x = wide(y) * np.sin(angles)
        c = np.cos(angles)
        z = np.where(c > 0, front(y), back(y)) * np.sign(c) * np.abs(c) ** 0.85
        ahead = np.clip(c, 0.0, 1.0) ** 0.5

        def hill(height: float, ax: float, ay: float, sx: float, sy: float) -> Array:
            return height * np.exp(-(((np.abs(x) - ax) / sx) ** 2) - ((y - ay) / sy) ** 2)

        big = self.big_eyes
        z = z + ahead * (
            hill(0.005, 0.026, BROWS, 0.026, 0.008)
            + hill(-0.007, EYE, EYES, 0.015 * big, 0.011 * big)
            + hill(0.006, 0.042, 0.163, 0.018, 0.014)
            + hill(0.004, 0.0, MOUTH + 0.006, 0.020, 0.006)
            + hill(0.004, 0.0, MOUTH - 0.006, 0.018, 0.006)
            + hill(-0.002, 0.0, 0.112, 0.020, 0.004)
            + hill(0.007, 0.0, 0.099, 0.018, 0.010)
            + hill(0.006, 0.011, NOSE, 0.006, 0.006)
            + 0.024
            * np.exp(-((x / 0.0095) ** 2))
            * np.interp(y, [0.142, 0.150, 0.155, 0.19, 0.215], [0, 0.75, 1, 0.35, 0])
        )
        return np.stack([x, y, z], axis=-1)

    @cached_property
    def _skin(self) -> tuple[Array, Array, dict[str, list[int]]]:
        """Positions, triangles, and the vertices of each rim's lower and upper side, from corner to corner."""
        angles, heights = self._angles, self._heights
        rows, columns = len(heights), len(angles)
        grid_angle = np.tile(angles, rows)
        grid_height = np.repeat(heights, columns)
        number = np.arange(rows * columns).reshape(rows, columns)
        upper = {(r, c): int(number[r, c]) for r in range(rows) for c in range(columns)}
        x = self._place(angles, np.full(columns, EYES))[:, 0]
        mouth_x = self._place(angles, np.full(columns, MOUTH))[:, 0]
        front = np.cos(angles) > 0.2
        size = 0.0155 * self.big_eyes
        holes = {
            "eye.L": (EYES, np.flatnonzero(front & (np.abs(x - EYE) <= size)), 0.0056 * self.big_eyes),
            "eye.R": (EYES, np.flatnonzero(front & (np.abs(x + EYE) <= size)), 0.0056 * self.big_eyes),
            "mouth": (MOUTH, np.flatnonzero(front & (np.abs(mouth_x) <= CORNER)), 0.0002),
        }
        extra_angle, extra_height = [], []
        rims: dict[str, tuple[list[int], list[int]]] = {}
        shifts = np.zeros(rows * columns)
        for name, (height, chosen, opening) in holes.items():
            row = int(np.argmin(np.abs(heights - height)))
            chosen = chosen[np.argsort(np.sin(angles[chosen]))]
            along = np.linspace(-1.0, 1.0, len(chosen))
            shapes = opening * np.sqrt(np.maximum(1.0 - along**2, 0.0))
            low, high = [], []
            for column, shape in zip(chosen.tolist(), shapes.tolist(), strict=True):
                low.append(int(number[row, column]))
                if shape > 0:
                    upper[row, column] = rows * columns + len(extra_angle)
                    extra_angle.append(angles[column])
                    extra_height.append(heights[row] + shape)
                    shifts[number[row, column]] -= shape
                    for k, part in ((1, 0.62), (2, 0.33), (3, 0.12)):
                        shifts[number[row + k, column]] += part * shape
                        shifts[number[row - k, column]] -= part * shape
                high.append(upper[row, column])
            rims[name] = low, high
        every_angle = np.append(grid_angle, extra_angle)
        every_height = np.append(grid_height + shifts, extra_height)
        places = self._place(every_angle, every_height)
        faces = []
        for r in range(rows - 1):
            for c in range(columns):
                d = (c + 1) % columns
                a, b, e, f = upper[r, c], upper[r, d], int(number[r + 1, c]), int(number[r + 1, d])
                # The diagonals of the two halves are mirror images.
                split = (
                    [[a, b, f], [a, f, e]] if np.sin(angles[c]) >= 0 and c < columns // 2 else [[a, b, e], [b, f, e]]
                )
                faces += split
        top = len(places)
        places = np.concatenate([places, self._place(np.zeros(1), np.array([CROWN])) * [0, 1, 0]])
        faces += [[int(number[-1, c]), int(number[-1, (c + 1) % columns]), top] for c in range(columns)]
        for name, (low, high) in rims.items():
            loop = [*low, *high[-2:0:-1]]
            middle = places[loop].mean(axis=0)
            for depth, inward in ((0.003, 0.04), (0.009, 0.0)):
                start = len(places)
                ring = places[loop] + inward * (middle - places[loop]) * [1.0, 0.0 if name == "mouth" else 1.0, 0.0]
                places = np.concatenate([places, ring - [0.0, 0.0, depth]])
                new = [start + k for k in range(len(loop))]
                for k in range(len(loop)):
                    j = (k + 1) % len(loop)
                    faces += [[loop[k], new[j], loop[j]], [loop[k], new[k], new[j]]]
                loop = new
        sides = {f"{name} low": low for name, (low, _) in rims.items()}
        sides |= {f"{name} high": high for name, (_, high) in rims.items()}
        return places, np.array(faces), sides

    @property
    def rims(self) -> dict[str, Array]:
        """(points, 3) of the outlines of `eye.L`, `eye.R` and `mouth`, as written, scene units."""
        places, _, sides = self._skin
        found = {name.split()[0]: [] for name in sides}
        for name, vertices in sides.items():
            found[name.split()[0]] += [places[v] for v in vertices]
        return {name: self._moved(np.array(points)) for name, points in found.items()}

    @property
    def height(self) -> float:
        """From chin to crown, scene units."""
        return (CROWN - CHIN) * self.scale

    def _moved(self, places: Array) -> Array:
        turn = np.radians(self.turn)
        c, s = np.cos(turn), np.sin(turn)
        pivot = np.array([0.0, 0.0, -0.01])
        turned = (places - pivot) @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + pivot
        return np.asarray(turned * self.scale + self.place)

    # What moves it.

    def deltas(self) -> Deltas:
        """Displacements of ARKit's targets, metres, by name with Left and Right."""
        places, _, sides = self._skin
        x, y, z = places.T
        front = np.clip((z - 0.01) / 0.02, 0.0, 1.0)
        lids = {side: self._lids(sides, side) for side in "LR"}
        jaw = np.clip((MOUTH + 0.0002 - y) / 0.004, 0.0, 1.0) * np.clip((y - 0.055) / 0.03, 0.0, 1.0) * front
        upper_lip = self._of_mouth(sides, "high")
        lower_lip = self._of_mouth(sides, "low")
        jaw = np.where(upper_lip, 0.0, np.where(lower_lip, np.maximum(jaw, 0.9), jaw))

        def field(ax: float, ay: float, sx: float, sy: float) -> Array:
            return np.exp(-(((x - ax) / sx) ** 2) - ((y - ay) / sy) ** 2) * front

        def vector(amount: Array, dx: float, dy: float, dz: float) -> Array:
            return 0.001 * amount[:, None] * np.array([dx, dy, dz])

        found: Deltas = {
            "browInnerUp": vector(field(0.014, BROWS, 0.019, 0.017), 1, 9, -1)
            + vector(field(-0.014, BROWS, 0.019, 0.017), -1, 9, -1),
            "jawOpen": vector(jaw, 0, -16, -5),
            "cheekPuff": vector(field(0.042, 0.13, 0.02, 0.02), 6, 0, 5)
            + vector(field(-0.042, 0.13, 0.02, 0.02), -6, 0, 5),
            "mouthPucker": np.concatenate(
                [-0.35 * (x * field(0, MOUTH, 0.03, 0.018))[:, None], np.zeros((len(x), 2))], axis=1
            )
            + vector(field(0, MOUTH, 0.018, 0.012), 0, 0, 5),
            "mouthFunnel": vector(field(0, MOUTH + 0.006, 0.018, 0.006), 0, 3, 5)
            + vector(field(0, MOUTH - 0.008, 0.018, 0.006), 0, -4, 5),
            "mouthShrugLower": vector(field(0, 0.099, 0.017, 0.010), 0, 6, 2)
            + vector(field(0, MOUTH - 0.006, 0.018, 0.005) * ~upper_lip, 0, 2, 2),
            "mouthShrugUpper": vector(field(0, MOUTH + 0.006, 0.018, 0.006), 0, 3, 2),
        }
        for side, sign, word in (("L", 1.0, "Left"), ("R", -1.0, "Right")):
            lid = lids[side]
            corner = field(sign * CORNER, MOUTH, 0.017, 0.015)
            cheek = field(sign * 0.040, 0.158, 0.022, 0.019)
            temple = field(sign * (EYE + 0.020 * self.big_eyes), EYES, 0.014, 0.016)
            of_side: Deltas = {
                "browDown": vector(field(sign * 0.018, BROWS, 0.016, 0.014), -sign * 4.5, -5, 0),
                "browOuterUp": vector(field(sign * 0.042, BROWS, 0.018, 0.017), 0, 9, -1),
                "eyeBlink": lid,
                "eyeSquint": -0.35 * ((y - EYES) * temple)[:, None] * [0, 1, 0]
                + vector(temple, -sign * 1.5, 0, 0)
                + 0.3 * lid,
                "eyeWide": -0.3 * lid,
                "cheekSquint": vector(cheek, 0, 6, 1.5) + vector(temple * (y < EYES), 0, 3, 0),
                "noseSneer": vector(field(sign * 0.012, NOSE + 0.008, 0.010, 0.012), 0, 5, 0),
                "mouthSmile": vector(corner, sign * 8, 6, -4) + vector(cheek, sign * 1, 3, 2),
                "mouthFrown": vector(corner, 0, -6, -1),
                "mouthStretch": vector(corner, sign * 7, -2, -3),
                "mouthUpperUp": vector(field(sign * 0.012, MOUTH + 0.006, 0.012, 0.008) * ~lower_lip, 0, 5, 0),
                "mouthLowerDown": vector(field(sign * 0.012, MOUTH - 0.006, 0.012, 0.008) * ~upper_lip, 0, -5, 0),
                "mouthDimple": vector(corner, sign * 3, 0, -4),
                "mouthPress": vector(field(sign * 0.014, MOUTH, 0.012, 0.008), 0, 0, -1.5),
            }
            if self.whole:
                # The eyeballs turn by bones here, and lids follow a look.
                of_side |= {"eyeLookDown": 0.4 * lid, "eyeLookUp": -0.2 * lid}
                of_side |= {"eyeLookIn": vector(lid[:, 1] / 0.01, -sign, 0, 0)}
                of_side |= {"eyeLookOut": vector(lid[:, 1] / 0.01, sign, 0, 0)}
            found |= {f"{name}{word}": each for name, each in of_side.items()}
        if self.whole:
            lips = field(0, MOUTH, 0.024, 0.012)
            found |= {
                "jawForward": vector(jaw, 0, 0, 6),
                "jawLeft": vector(jaw, 6, 0, 0),
                "jawRight": vector(jaw, -6, 0, 0),
                "mouthClose": vector(jaw * lower_lip, 0, 12, 3),
                "mouthLeft": vector(lips, 6, 0, 0),
                "mouthRight": vector(lips, -6, 0, 0),
                "mouthRollLower": vector(lips * lower_lip, 0, 2, -4),
                "mouthRollUpper": vector(lips * upper_lip, 0, -2, -4),
                "tongueOut": np.zeros((len(x), 3)),
            }
        return found

    def _lids(self, sides: dict[str, list[int]], side: str) -> Array:
        """(vertices, 3) displacement that closes the lids of a side."""
        places, _, _ = self._skin
        low, high = places[sides[f"eye.{side} low"]], places[sides[f"eye.{side} high"]]
        order = np.argsort(low[:, 0])
        gap = np.interp(places[:, 0], low[order, 0], (high - low)[order, 1], left=0.0, right=0.0)
        middle = np.interp(places[:, 0], low[order, 0], (0.25 * high + 0.75 * low)[order, 1])
        above = places[:, 1] - middle
        down = np.where(above > 0, np.exp(-((np.maximum(above - gap, 0.0) / 0.006) ** 2)), 0.0) * 0.75
        up = np.where(above <= 0, np.exp(-((np.maximum(-above - gap, 0.0) / 0.006) ** 2)), 0.0) * 0.25
        amount = np.where(places[:, 2] > 0.01, gap * (up - down), 0.0)
        return amount[:, None] * np.array([0.0, 1.0, 0.0])

    def _of_mouth(self, sides: dict[str, list[int]], which: str) -> Array:
        """(vertices,) True at the upper or the lower lip's rim, but not its corners, and turned in behind it."""
        places, _, _ = self._skin
        own = sides[f"mouth {which}"][1:-1]
        # Vertices behind a rim are at its x and height, further back.
        found = np.zeros(len(places), bool)
        found[own] = True
        rows, columns = len(self._heights), len(self._angles)
        added = np.arange(len(places)) > rows * columns
        for vertex in own:
            same = added & (np.abs(places[:, 0] - places[vertex, 0]) < 2e-3)
            found |= (
                same & (np.abs(places[:, 1] - places[vertex, 1]) < 1e-4) & (places[:, 2] < places[vertex, 2] - 1e-3)
            )
        return found

    # What is written.

    def asset(self, targets: Mapping[str, Array] | None = None) -> Asset:
        """The head, skinned to `neck` and `head`, with morph targets; ARKit's if none are given."""
        places, faces, _ = self._skin
        targets = self.deltas() if targets is None else targets
        asset = Asset()
        eyeballs, balls = self._eyeballs()
        turned = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if self.z_up else np.eye(3)
        spin = np.radians(self.turn)
        spun = np.array([[np.cos(spin), 0, np.sin(spin)], [0, 1, 0], [-np.sin(spin), 0, np.cos(spin)]])

        def stored(points: Array) -> Array:
            return np.asarray((self._moved(points)) @ turned.T)

        def stored_deltas(values: Array) -> Array:
            return np.asarray(self.scale * values @ spun.T @ turned.T)

        primitives = []
        for points, triangles, deltas, material in (
            (places, faces, list(targets.values()), 0),
            (eyeballs, balls, [np.zeros_like(eyeballs)] * len(targets), 1),
        ):
            carried = np.clip((points[:, 1] - 0.03) / 0.055, 0.0, 1.0) if material == 0 else np.ones(len(points))
            carried = carried * carried * (3.0 - 2.0 * carried)
            attributes = {
                "POSITION": asset.accessor(stored(points), bounds=True),
                "NORMAL": asset.accessor(_normals(points, triangles) @ spun.T @ turned.T),
                "JOINTS_0": asset.accessor(np.tile([0, 1, 0, 0], (len(points), 1)), "u1"),
                "WEIGHTS_0": asset.accessor(np.stack([1 - carried, carried, 0 * carried, 0 * carried], axis=1)),
            }
            primitives.append(
                {
                    "attributes": attributes,
                    "indices": asset.accessor(triangles.ravel(), "u2"),
                    "targets": [{"POSITION": asset.accessor(stored_deltas(each), bounds=True)} for each in deltas],
                    "material": material,
                }
            )
        for name, colour in ((self.material, [0.8, 0.6, 0.5, 1.0]), ("eye", [0.9, 0.9, 0.9, 1.0])):
            looks = {"baseColorFactor": colour, "metallicFactor": 0.0, "roughnessFactor": 0.6}
            asset.append("materials", {"name": name, "pbrMetallicRoughness": looks})
        asset.append("meshes", {"primitives": primitives, "extras": {"targetNames": list(targets)}})
        joints = stored(np.array([[0.0, 0.03, -0.01], [0.0, 0.085, -0.005]]))
        root: Json = {"name": "root", "children": [2]}
        if self.z_up:
            root["rotation"] = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]
        asset.append("nodes", {"name": "face", "mesh": 0, "skin": 0})
        asset.append("nodes", root)
        asset.append("nodes", {"name": "neck", "translation": joints[0].tolist(), "children": [3]})
        asset.append("nodes", {"name": "head", "translation": (joints[1] - joints[0]).tolist()})
        binds = np.tile(np.eye(4), (2, 1, 1))
        binds[:, 3, :3] = -joints
        asset.append("skins", {"joints": [2, 3], "inverseBindMatrices": asset.accessor(binds.reshape(2, 16))})
        asset.append("scenes", {"nodes": [0, 1]})
        asset.gltf["scene"] = 0
        return asset

    def _eyeballs(self) -> tuple[Array, Array]:
        """Positions and triangles of two spheres behind the lids."""
        rings, sides = 9, 12
        up, round_ = np.meshgrid(
            np.linspace(-1, 1, rings) * np.pi / 2, 2 * np.pi * np.arange(sides) / sides, indexing="ij"
        )
        ball = np.stack([np.cos(up) * np.sin(round_), np.sin(up), np.cos(up) * np.cos(round_)], axis=-1).reshape(-1, 3)
        faces = []
        for r in range(rings - 1):
            for c in range(sides):
                a, b = r * sides + c, r * sides + (c + 1) % sides
                faces += [[a, b, a + sides], [b, b + sides, a + sides]]
        places, _, sides_of = self._skin
        found, triangles = [], []
        for side in "LR":
            rim = places[sides_of[f"eye.{side} low"] + sides_of[f"eye.{side} high"]]
            middle, radius = rim.mean(axis=0), 0.47 * np.ptp(rim[:, 0])
            triangles.append(np.array(faces) + sum(map(len, found)))
            found.append(radius * ball + middle - [0.0, 0.0, 0.93 * radius])
        return np.concatenate(found), np.concatenate(triangles)

    def named(self, rename: Callable[[str], str | None]) -> Asset:
        """The head with targets named anew; those without a name are left out."""
        every = self.deltas()
        return self.asset({new: each for name, each in every.items() if (new := rename(name)) is not None})

    def facs(self) -> Asset:
        """The head with FACS units by number: `AU01`, `AU02_L`."""
        return self.named(lambda name: _sided(name, FACS, "_L", "_R"))

    def vroid(self) -> Asset:
        """The head with the morph targets of VRoid Studio, for both sides at once."""
        return self.asset({name: self._mixed(each) for each, names in VROID.items() for name in names})

    def vrm(self, version: int = 1) -> Asset:
        """The head with targets that no name describes, and a VRM's expressions that do."""
        mixed = {f"shape_{number}": self._mixed(each) for number, each in enumerate(EXPRESSIONS)}
        asset = self.asset(mixed)
        if version == 1:
            preset = {
                name: {"morphTargetBinds": [{"node": 0, "index": number, "weight": 1.0}]}
                for number, name in enumerate(EXPRESSIONS)
            }
            asset.gltf["extensions"] = {"VRMC_vrm": {"specVersion": "1.0", "expressions": {"preset": preset}}}
        else:
            old = {"happy": "joy", "aa": "a", "ou": "u", "surprised": "unknown"}
            groups = [
                {
                    "name": name.title(),
                    "presetName": old.get(name, name),
                    "binds": [{"mesh": 0, "index": k, "weight": 100}],
                }
                for k, name in enumerate(EXPRESSIONS)
            ]
            asset.gltf["extensions"] = {"VRM": {"blendShapeMaster": {"blendShapeGroups": groups}}}
        asset.gltf["extensionsUsed"] = list(asset.gltf["extensions"])
        return asset

    def _mixed(self, expression: str) -> Array:
        """(vertices, 3) displacement of an expression."""
        every = self.deltas()
        found = np.zeros_like(next(iter(every.values())))
        for name, weight in EXPRESSIONS[expression].items():
            for each in (name, f"{name}Left", f"{name}Right"):
                if each in every:
                    found += weight * every[each]
        return found


def _sided(name: str, names: Mapping[str, str], left: str, right: str) -> str | None:
    for word, mark in (("Left", left), ("Right", right), ("", "")):
        if name.endswith(word):
            stem = name.removesuffix(word)
            return names[stem] + mark if stem in names else None
    return None


def _normals(points: Array, triangles: Array) -> Array:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = np.zeros_like(points)
    crosses = np.cross(b - a, c - a)
    for k in range(3):
        np.add.at(normals, triangles[:, k], crosses)
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None])
