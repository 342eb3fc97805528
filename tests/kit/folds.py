"""Folds of other kinds than a hinged tube's, small and built by code: what contact is to resolve, or to give up.

Each builder gives a `Fold`: an asset with the clip `bend`, and tools over its folds. Lengths are metres.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from kit.asset import Array, Asset, Json
from kit.bakes import UNREFINED, bake_once, place
from kit.characters import Rotation, Skeleton, Stuff, Surface, Weights, Writer, chain_weights, person, plain
from kit.limb import waving_limb, write_tools
from kit.player import Gltf

SKIN = plain("skin", (0.72, 0.44, 0.33))
CLIP = "bend"
_TIMES = (0.0, 1.0, 2.0)
# Other keys of a tools file for `waving`.
WAVED: Json = {**UNREFINED, "sampling": {"fps": 15}}


@dataclass(frozen=True)
class Fold:
    """An asset whose node `limb` has tools over its folds, and the radius of what folds there."""

    asset: Asset
    tools: tuple[Json, ...]
    radius: float

    def write(self, folder: Path, **keys: object) -> tuple[Path, Path]:
        """Write the asset, and its tools file with further keys for each tool."""
        tools = write_tools(folder / "tools.yaml", *({**tool, **keys} for tool in self.tools), **UNREFINED)
        return self.asset.write(folder / "limb.glb"), tools

    def baked(self, contact: str = "resolve") -> Gltf:
        """The bake of the asset with its tools, which is made only once."""
        return bake_once(place(self.asset), *({**tool, "contact": contact} for tool in self.tools), top=UNREFINED)


def _written(
    surface: Surface,
    skeleton: Skeleton | None,
    moves: dict[str, Rotation],
    *,
    twist: bool = False,
    slab: Surface | None = None,
) -> Asset:
    writer = Writer(skeleton=skeleton, twist=twist)
    writer.mesh("limb", surface, {"": SKIN})
    if slab is not None:
        writer.mesh("slab", slab, {"": Stuff(SKIN.material)})
    writer.clip(CLIP, _TIMES, moves)
    return writer.finish()


def _there(degrees: float) -> list[float]:
    """From 0 to some degrees, and back."""
    return [0.0, degrees, 0.0]


def _limb(
    xs: Array, weights: Sequence[Weights], *, radius: float, sides: int, z: float = 0.0, surface: Surface | None = None
) -> Surface:
    """A tube along x, closed at its ends."""
    surface = surface or Surface()
    middles = np.stack([xs, 0 * xs, 0 * xs + z], axis=1)
    surface.tube(middles, radius, weights, "limb", sides=sides, across=(0.0, 0.0, 1.0))
    return surface


def _tool(name: str, origin: Sequence[float], target: Sequence[float], width: float, **keys: object) -> Json:
    return {
        "name": name, "origin": list(origin), "target": list(target), "width": width, "bumps": 2, "max_height": "10%",
        "node": "limb", **keys,
    }  # fmt: skip


def elbow(*, angle: float = 115.0, twist: float = 60.0, radius: float = 0.045, sides: int = 10) -> Fold:
    """An elbow whose forearm has a twist joint, which takes up to 0.7 of the weights and turns with the clip."""
    joints: Skeleton = {
        "upper_arm": ("", (0.0, 0.0, 0.0)),
        "forearm": ("upper_arm", (0.25, 0.0, 0.0)),
        "fore_twist": ("forearm", (0.35, 0.0, 0.0)),
    }
    xs = np.linspace(0.0, 0.5, 19)
    weights = []
    for x in xs:
        row = chain_weights(x / 0.25, ["upper_arm", "forearm"], 0.5)
        share = 0.7 * float(np.clip((x - 0.25) / 0.25, 0.0, 1.0))
        if share:
            row["fore_twist"] = share * row["forearm"]
            row["forearm"] *= 1.0 - share
        weights.append(row)
    moves = {"forearm": ("z", _there(angle)), "fore_twist": ("x", _there(twist))}
    tools = (_tool("elbow", (0.17, radius, 0.0), (0.33, radius, 0.0), 0.06),)
    return Fold(_written(_limb(xs, weights, radius=radius, sides=sides), joints, moves), tools, radius)


def finger(*, angle: float = 75.0, apart: float = 1.5, radius: float = 0.009, sides: int = 10) -> Fold:
    """A finger with two joints in one fold, `apart` radii from each other; each bends by the angle."""
    second = 0.05 + apart * radius
    joints: Skeleton = {
        "base": ("", (0.0, 0.0, 0.0)),
        "middle": ("base", (0.05, 0.0, 0.0)),
        "tip": ("middle", (second, 0.0, 0.0)),
    }
    xs = np.linspace(0.01, 0.1, 22)
    blend = 1.2 * radius
    weights = []
    for x in xs:
        first, last = (float(np.clip((x - at) / blend + 0.5, 0.0, 1.0)) for at in (0.05, second))
        weights.append({"base": 1.0 - first, "middle": first * (1.0 - last), "tip": first * last})
    moves = {"middle": ("z", _there(angle)), "tip": ("z", _there(angle))}
    tools = (_tool("finger", (0.034, radius, 0.0), (second + 0.016, radius, 0.0), 0.012),)
    return Fold(_written(_limb(xs, weights, radius=radius, sides=sides), joints, moves), tools, radius)


def hip(*, angle: float = 105.0, twist: float = 25.0, radius: float = 0.08, sides: int = 12) -> Fold:
    """A hip whose thigh has a twist joint at the same place: both turn what lies below, each by its half."""
    joints: Skeleton = {
        "pelvis": ("", (0.0, 0.0, 0.0)),
        "thigh": ("pelvis", (0.25, 0.0, 0.0)),
        "thigh_twist": ("thigh", (0.25, 0.0, 0.0)),
    }
    xs = np.linspace(0.0, 0.55, 19)
    weights = []
    for x in xs:
        row = chain_weights(x / 0.25, ["pelvis", "thigh"], 0.7)
        if "thigh" in row:
            row = {**row, "thigh": 0.5 * row["thigh"], "thigh_twist": 0.5 * row["thigh"]}
        weights.append(row)
    moves = {"thigh": ("z", _there(angle)), "thigh_twist": ("x", _there(twist))}
    tools = (_tool("hip", (0.13, radius, 0.0), (0.37, radius, 0.0), 0.1),)
    return Fold(_written(_limb(xs, weights, radius=radius, sides=sides), joints, moves), tools, radius)


def rigid(*, angle: float = 95.0, radius: float = 0.05, sides: int = 10, rings: int = 18) -> Fold:
    """A fold of which each side is moved by one joint alone: weights change over one edge."""
    joints: Skeleton = {"upper": ("", (0.0, 0.0, 0.0)), "lower": ("upper", (0.25, 0.0, 0.0))}
    xs = np.linspace(0.0, 0.5, rings)
    weights = [{"upper": 1.0} if x < 0.25 else {"lower": 1.0} for x in xs]
    tools = (_tool("fold", (0.17, radius, 0.0), (0.33, radius, 0.0), 0.07),)
    return Fold(
        _written(_limb(xs, weights, radius=radius, sides=sides), joints, {"lower": ("z", _there(angle))}), tools, radius
    )


def one_sided(*, angle: float = 110.0, radius: float = 0.05, sides: int = 10, shift: float = 0.06) -> Fold:
    """A fold whose both sides the same joint moves most: weights change `shift` metres above the joint."""
    joints: Skeleton = {"upper": ("", (0.0, 0.0, 0.0)), "lower": ("upper", (0.25, 0.0, 0.0))}
    xs = np.linspace(0.0, 0.5, 19)
    weights = [chain_weights((x + shift) / 0.25, ["upper", "lower"], 0.6) for x in xs]
    tools = (_tool("fold", (0.14, radius, 0.0), (0.32, radius, 0.0), 0.07),)
    return Fold(
        _written(_limb(xs, weights, radius=radius, sides=sides), joints, {"lower": ("z", _there(angle))}), tools, radius
    )


def low_poly(*, angle: float = 130.0, radius: float = 0.06, sides: int = 5) -> Fold:
    """A fold whose edges are as long as the limb is thick: the joint has one ring of vertices, and its neighbours."""
    joints: Skeleton = {"upper": ("", (0.0, 0.0, 0.0)), "lower": ("upper", (0.36, 0.0, 0.0))}
    xs = np.arange(7) * 2.0 * radius
    weights = [chain_weights(x / 0.36, ["upper", "lower"], 0.5) for x in xs]
    tools = (_tool("fold", (0.25, radius * 0.9, 0.0), (0.47, radius * 0.9, 0.0), 0.08),)
    return Fold(
        _written(_limb(xs, weights, radius=radius, sides=sides), joints, {"lower": ("z", _there(angle))}), tools, radius
    )


def armpit(*, angle: float = 80.0, rows: int = 5) -> Fold:
    """A trunk with an arm that is lowered against it, from a T; the shoulder's joint is 0.087 m from the fold."""
    body = person(columns=16, rows=rows)
    regions = ("belly", "chest", "sleeve")
    body = body.kept(
        [
            region in regions and np.mean([body.points[k][0] for k in ids]) > -0.1
            for region, ids in zip(body.regions, body.faces, strict=True)
        ]
    )
    tools = (_tool("armpit", (0.16, 1.28, 0.0), (0.28, 1.34, 0.0), 0.08),)
    return Fold(_written(body, None, {"upper_arm.L": ("z", _there(-angle))}), tools, 0.087)


def groin(*, angle: float = 105.0, bow: float = 20.0, rows: int = 5) -> Fold:
    """Both hips over one pelvis: the thighs come up to the belly, in two folds that have vertices in common."""
    body = person(columns=16, rows=rows)
    body = body.kept([region in ("hips", "belly", "thigh") for region in body.regions])
    tools = tuple(
        _tool(f"hip_{side}", (sign * 0.09, 1.0, 0.09), (sign * 0.105, 0.77, 0.08), 0.1)
        for side, sign in (("L", 1.0), ("R", -1.0))
    )
    moves: dict[str, Rotation] = {f"thigh.{side}": ("x", _there(-angle)) for side in "LR"}
    return Fold(_written(body, None, moves | {"spine": ("x", _there(bow))}), tools, 0.09)


def knees(*, angle: float = 110.0, inwards: float = 7.0, radius: float = 0.055, sides: int = 10) -> Fold:
    """Two legs side by side that bend, while their thighs turn inwards until the knees meet."""
    joints: dict[str, tuple[str, tuple[float, float, float]]] = {"hips": ("", (0.0, 0.0, 0.0))}
    surface, tools = Surface(), []
    moves: dict[str, Rotation] = {}
    for side, sign in (("L", 1.0), ("R", -1.0)):
        z = sign * 0.08
        joints[f"thigh.{side}"] = ("hips", (0.0, 0.0, z))
        joints[f"shin.{side}"] = (f"thigh.{side}", (0.3, 0.0, z))
        xs = np.linspace(0.0, 0.6, 19)
        weights = [chain_weights(x / 0.3, [f"thigh.{side}", f"shin.{side}"], 0.5) for x in xs]
        _limb(xs, weights, radius=radius, sides=sides, z=z, surface=surface)
        moves[f"thigh.{side}"] = ("y", _there(sign * inwards))
        moves[f"shin.{side}"] = ("z", _there(angle))
        tools.append(_tool(f"knee_{side}", (0.2, radius, z), (0.4, radius, z), 0.07))
    return Fold(_written(surface, joints, moves), tuple(tools), radius)


def twins(*, angle: float = 110.0, inwards: float = 7.0, radius: float = 0.055, sides: int = 10) -> Fold:
    """Knees that meet, of which the right one is the mirror image of the left one in each triangle; so is its tool."""
    joints: dict[str, tuple[str, tuple[float, float, float]]] = {"hips": ("", (0.0, 0.0, 0.0))}
    moves: dict[str, Rotation] = {}
    for side, sign in (("L", 1.0), ("R", -1.0)):
        joints[f"thigh.{side}"] = ("hips", (0.0, 0.0, sign * 0.08))
        joints[f"shin.{side}"] = (f"thigh.{side}", (0.3, 0.0, sign * 0.08))
        moves |= {f"thigh.{side}": ("y", _there(sign * inwards)), f"shin.{side}": ("z", _there(angle))}
    xs = np.linspace(0.0, 0.6, 19)
    weights = [chain_weights(x / 0.3, ["thigh.L", "shin.L"], 0.5) for x in xs]
    surface = _limb(xs, weights, radius=radius, sides=sides, z=0.08)
    count, faces = len(surface.points), len(surface.faces)
    surface.points += [point * (1.0, 1.0, -1.0) for point in surface.points]
    surface.weights += [{name.replace(".L", ".R"): each for name, each in row.items()} for row in surface.weights]
    # Each face begins at the same corner, so that it is cut along the same diagonal.
    surface.faces += [[count + ids[0], *(count + k for k in ids[:0:-1])] for ids in surface.faces]
    surface.corners += [[each[0], *each[:0:-1]] for each in surface.corners[:faces]]
    surface.regions += surface.regions[:faces]
    tool = _tool("knee.L", (0.2, radius, 0.08), (0.4, radius, 0.08), 0.07, mirror="z")
    return Fold(_written(surface, joints, moves), (tool,), radius)


def no_room(*, angle: float = 110.0, gap: float = 0.016, radius: float = 0.05, sides: int = 10) -> Fold:
    """A limb that folds onto a slab, which lies on its other side and leaves it no room."""
    joints: Skeleton = {"upper": ("", (0.0, 0.0, 0.0)), "lower": ("upper", (0.25, 0.0, 0.0))}
    xs = np.linspace(0.0, 0.5, 18)
    weights = [chain_weights(x / 0.25, ["upper", "lower"], 0.5) for x in xs]
    slab = Surface()
    slab.box((0.0, radius + gap, -0.08), (0.24, radius + gap + 0.03, 0.08), "upper", "slab")
    tools = (_tool("fold", (0.17, radius, 0.0), (0.33, radius, 0.0), 0.07),)
    surface = _limb(xs, weights, radius=radius, sides=sides)
    return Fold(_written(surface, joints, {"lower": ("z", _there(angle))}, slab=slab), tools, radius)


@cache
def waving() -> Path:
    """A limb with eight clips that fold it about axes of their own."""
    return place(waving_limb(8, rings=12, sides=8))


FOLDS: dict[str, Callable[..., Fold]] = {
    "elbow": elbow, "finger": finger, "hip": hip, "rigid": rigid, "one_sided": one_sided, "low_poly": low_poly,
    "armpit": armpit, "groin": groin, "knees": knees, "no_room": no_room,
}  # fmt: skip
