"""A whole body, stocky and bare, for what swings: it jumps, walks, and shakes its head."""

import math

import numpy as np

from _gltf import Character, Clip, Joint
from _shapes import Bools, Field, Floats, Mesh, capsule, ellipsoid, relax, smoothstep, spline, union

STEP = 0.0165  # metres between vertices
LOW, HIGH = (-0.66, -0.02, -0.30), (0.66, 1.80, 0.36)  # metres: the grid round the body
KEYS = 30  # a second
_SIDES = (("L", 1.0), ("R", -1.0))

# Places of joints, metres; the body faces +z, and its left is +x.
PLACES: dict[str, tuple[str | None, tuple[float, float, float]]] = {
    "hips": (None, (0.0, 0.96, -0.01)),
    "spine": ("hips", (0.0, 1.08, -0.02)),
    "chest": ("spine", (0.0, 1.24, -0.02)),
    "neck": ("chest", (0.0, 1.47, -0.02)),
    "head": ("neck", (0.0, 1.56, -0.01)),
    **{
        f"{name}.{side}": (parent if parent == "hips" or parent == "chest" else f"{parent}.{side}", (sign * x, y, z))
        for side, sign in _SIDES
        for name, parent, (x, y, z) in (
            ("upper_arm", "chest", (0.19, 1.40, -0.02)),
            ("forearm", "upper_arm", (0.37, 1.20, -0.03)),
            ("hand", "forearm", (0.53, 1.02, 0.0)),
            ("thigh", "hips", (0.10, 0.90, 0.0)),
            ("shin", "thigh", (0.12, 0.48, 0.01)),
            ("foot", "shin", (0.13, 0.08, -0.02)),
        )
    },
}
_TIPS = {"head": (0.0, 1.74, 0.0), "hand": (0.60, 0.94, 0.02), "foot": (0.15, 0.03, 0.15)}


def body_field(points: Floats) -> Floats:
    """Signed distance to the body."""
    mirrored = np.abs(points) * [1.0, 0.0, 0.0] + points * [0.0, 1.0, 1.0]
    trunk = ellipsoid(mirrored, [0.0, 1.27, -0.02], [0.185, 0.22, 0.125])
    trunk = union(trunk, ellipsoid(mirrored, [0.0, 1.0, -0.01], [0.175, 0.17, 0.13]), 0.10)
    trunk = union(trunk, ellipsoid(mirrored, [0.0, 1.03, 0.055], [0.14, 0.13, 0.125]), 0.06)
    chest = ellipsoid(mirrored, [0.085, 1.29, 0.075], [0.085, 0.075, 0.06])
    trunk = union(trunk, chest, 0.05)
    buttock = ellipsoid(mirrored, [0.085, 0.91, -0.075], [0.088, 0.105, 0.09])
    trunk = union(trunk, buttock, 0.05)
    leg = union(
        capsule(mirrored, [0.105, 0.86, 0.0], [0.12, 0.50, 0.01], 0.098, 0.060),
        capsule(mirrored, [0.12, 0.48, 0.0], [0.13, 0.10, -0.02], 0.060, 0.040),
        0.05,
    )
    leg = union(leg, ellipsoid(mirrored, [0.125, 0.35, -0.03], [0.052, 0.11, 0.055]), 0.05)
    leg = union(leg, ellipsoid(mirrored, [0.14, 0.035, 0.05], [0.048, 0.045, 0.13]), 0.04)
    whole = union(trunk, leg, 0.05)
    arm = capsule(mirrored, [0.17, 1.41, -0.02], [0.37, 1.20, -0.03], 0.062, 0.044)
    arm = union(arm, ellipsoid(mirrored, [0.275, 1.285, -0.045], [0.075, 0.085, 0.06]), 0.04)
    arm = union(arm, capsule(mirrored, [0.37, 1.20, -0.03], [0.53, 1.02, 0.0], 0.045, 0.029), 0.04)
    arm = union(arm, ellipsoid(mirrored, [0.565, 0.98, 0.01], [0.045, 0.06, 0.03]), 0.03)
    whole = union(whole, arm, 0.05)
    neck = capsule(mirrored, [0.0, 1.42, -0.025], [0.0, 1.56, -0.01], 0.062, 0.058)
    whole = union(whole, neck, 0.06)
    head = ellipsoid(mirrored, [0.0, 1.655, 0.0], [0.078, 0.105, 0.098])
    head = union(head, ellipsoid(mirrored, [0.0, 1.595, 0.035], [0.062, 0.058, 0.065]), 0.04)
    head = union(head, ellipsoid(mirrored, [0.045, 1.605, 0.06], [0.036, 0.042, 0.038]), 0.02)
    head = union(head, ellipsoid(mirrored, [0.0, 1.625, 0.105], [0.016, 0.022, 0.02]), 0.02)
    return union(whole, head, 0.03)


def surface(shape: Field, low: tuple[float, float, float], high: tuple[float, float, float], step: float) -> Mesh:
    """Quads on the zero of a distance field: a vertex in each cell of a grid that the zero passes (surface nets)."""
    sides = [np.arange(a, b, step) for a, b in zip(low, high, strict=True)]
    counts = [len(each) for each in sides]
    points = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
    values = shape(points.reshape(-1, 3)).reshape(counts)
    inner = values < 0
    number = np.full(counts, -1)
    cell = np.zeros([each - 1 for each in counts], np.intp)
    for i in (0, 1):
        for j in (0, 1):
            for k in (0, 1):
                cell += inner[i : counts[0] - 1 + i, j : counts[1] - 1 + j, k : counts[2] - 1 + k]
    passed = np.argwhere((cell > 0) & (cell < 8))
    number[tuple(passed.T)] = np.arange(len(passed))
    quads = []
    for axis in range(3):
        one, two = np.eye(3, dtype=np.intp)[(axis + 1) % 3], np.eye(3, dtype=np.intp)[(axis + 2) % 3]
        along = np.eye(3, dtype=np.intp)[axis]
        ends = inner[tuple(slice(0, n - a) for n, a in zip(counts, along, strict=True))]
        after = inner[tuple(slice(a, n) for n, a in zip(counts, along, strict=True))]
        crossed = np.argwhere(ends != after)
        around = [number[tuple((crossed - back).T)] for back in (0 * one, one, one + two, two)]
        corners = np.stack(around, axis=1)
        turned = ~ends[tuple(crossed.T)]
        corners[turned] = corners[turned, ::-1]
        quads.append(corners)
    faces = np.concatenate(quads)
    positions = np.array(low) + step * (passed + 0.5)
    flat = np.stack([positions[:, 0] * 0.5 + 0.5, positions[:, 1] * 0.5], axis=1)
    held: Bools = np.zeros(positions.shape, np.bool_)
    mesh = Mesh(positions, faces, flat[faces], held, np.zeros(len(positions), np.bool_))
    return relax(mesh, shape, steps=20)


def skin_weights(points: Floats, names: list[str]) -> Floats:
    """(vertices, joints) weights by the distance to each joint's bone; at most four of a vertex are above 0."""
    weights = np.zeros((len(points), len(names)))
    for column, name in enumerate(names):
        ends = [place for child, (parent, place) in PLACES.items() if parent == name] or [_tip(name)]
        away = np.min([capsule(points, list(PLACES[name][1]), list(end), 0.0, 0.0) for end in ends], axis=0)
        weights[:, column] = 1.0 / np.maximum(away, 0.01) ** 4
        # A raised thigh takes none of the belly along, and a raised arm none of the trunk.
        if name.startswith(("thigh", "shin", "foot")):
            weights[:, column] *= smoothstep(0.99, 0.84, points[:, 1])
        if name.startswith(("upper_arm", "forearm", "hand")):
            weights[:, column] *= smoothstep(0.13, 0.24, np.abs(points[:, 0]))
    least = np.sort(weights, axis=1)[:, -4, None]
    weights = np.where(weights >= least, weights, 0.0)
    weights /= weights.sum(axis=1, keepdims=True)
    weights = np.where(weights > 0.02, weights, 0.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _tip(name: str) -> tuple[float, float, float]:
    part, _, side = name.partition(".")
    x, y, z = _TIPS[part]
    return (-x if side == "R" else x, y, z)


def make_body() -> Character:
    """The body with its clips."""
    mesh = surface(body_field, LOW, HIGH, STEP)
    names = list(PLACES)
    return Character(
        name="body",
        mesh=mesh,
        joints=tuple(Joint(name, parent, place) for name, (parent, place) in PLACES.items()),
        weights=skin_weights(mesh.positions, names),
        clips=(jump(), walk(), shake()),
        colour=(0.80, 0.52, 0.41),
        material="skin",
        roughness=0.7,
    )


def turned(axis: tuple[float, float, float], degrees: Floats) -> Floats:
    """(keys, 4) quaternions."""
    halves = np.radians(degrees)[:, None] / 2.0
    return np.concatenate([np.sin(halves) * axis, np.cos(halves)], axis=1)


def jump() -> Clip:
    """Crouch, jump by a foot, land, and stand up again."""
    times = np.arange(round(2.4 * KEYS) + 1) / KEYS
    crouch = spline([0.0, 0.35, 0.55, 0.95, 1.12, 1.5, 2.4], [0.0, 1.0, 0.0, 0.05, 1.0, 0.15, 0.0], times)
    # In the air the body flies as a stone does: 0.4 s, 20 cm high.
    flight = np.clip((times - 0.55) / 0.4, 0.0, 1.0)
    height = 0.2 * 4.0 * flight * (1.0 - flight)
    thigh, shin = -62.0 * crouch, 100.0 * crouch
    fall = 0.42 * (np.cos(np.radians(thigh)) - 1.0) + 0.40 * (np.cos(np.radians(shin + thigh)) - 1.0)
    sink = np.stack([0.0 * times, fall + height, -0.10 * crouch], axis=1)
    x = (1.0, 0.0, 0.0)
    moves = {"spine": turned(x, 10.0 * crouch), "chest": turned(x, 8.0 * crouch), "neck": turned(x, -14.0 * crouch)}
    reach = smoothstep(0.35, 0.7, times) * (1.0 - smoothstep(0.9, 1.4, times))
    for side, sign in _SIDES:
        moves[f"thigh.{side}"], moves[f"shin.{side}"] = turned(x, thigh), turned(x, shin)
        moves[f"foot.{side}"] = turned(x, -shin - thigh)
        moves[f"upper_arm.{side}"] = turned(x, 40.0 * crouch - 75.0 * reach)
        moves[f"forearm.{side}"] = turned((0.0, sign, 0.0), -30.0 * crouch)
    return Clip("jump", times, moves, {"hips": sink})


def walk() -> Clip:
    """Two steps of a walk, in one second, 1.3 m ahead; a loop."""
    times = np.arange(KEYS + 1) / KEYS
    phase = 2.0 * math.pi * times
    x, y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    moves = {"spine": turned(y, 5.0 * np.sin(phase)), "chest": turned(y, -9.0 * np.sin(phase))}
    for side, sign in _SIDES:
        swing = sign * np.sin(phase)
        moves[f"thigh.{side}"] = turned(x, -24.0 * swing)
        moves[f"shin.{side}"] = turned(x, 18.0 + 22.0 * np.maximum(sign * np.cos(phase), 0.0) ** 2)
        moves[f"upper_arm.{side}"] = turned(x, 22.0 * swing)
        moves[f"forearm.{side}"] = turned(x, -12.0 + 6.0 * swing)
    bob = 0.02 * np.cos(2.0 * phase)
    sway = 0.015 * np.cos(phase)
    return Clip("walk", times, moves, {"hips": np.stack([sway, bob - 0.02, 1.3 * times], axis=1)})


def shake() -> Clip:
    """The head shakes, and the arms are shaken out."""
    times = np.arange(round(2.4 * KEYS) + 1) / KEYS
    swing = smoothstep(0.1, 0.5, times) * (1.0 - smoothstep(0.9, 1.3, times)) * np.sin(2.0 * math.pi * 2.2 * times)
    moves = {"neck": turned((0.0, 1.0, 0.0), 14.0 * swing), "head": turned((0.0, 1.0, 0.0), 24.0 * swing)}
    for side, sign in _SIDES:
        moves[f"upper_arm.{side}"] = turned((0.0, 0.0, 1.0), sign * (25.0 + 16.0 * swing))
    return Clip("shake", times, moves)
