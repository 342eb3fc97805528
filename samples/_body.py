"""A whole body, stocky and bare, for muscles and flesh: it jumps, walks and curls its arms."""

import math
from dataclasses import replace

import numpy as np

from _characters import Character, Clip, Joint
from _head import head_field
from _shapes import (
    Bools,
    Field,
    Floats,
    Mesh,
    capsule,
    cut,
    ellipsoid,
    on_one_side,
    project,
    relax,
    smoothstep,
    spline,
    union,
    within,
)

STEP = 0.0185  # metres between vertices
LOW, HIGH = (-37, -2, -18), (37, 124, 20)  # steps: the grid round the body, whose left and right are alike
HEAD = np.array([0.0, 1.455, -0.005])  # place of the neck's end
# The grid is finer about the head: its length there, over that elsewhere, which it reaches between these heights.
FINE, COARSE_BELOW, FINE_ABOVE = 0.5, 1.42, 1.56
KEYS = 30  # a second
_SIDES = (("L", 1.0), ("R", -1.0))

# Places of joints, metres; the body faces +z, and its left is +x.
PLACES: dict[str, tuple[str | None, tuple[float, float, float]]] = {
    "hips": (None, (0.0, 0.96, -0.01)),
    "spine": ("hips", (0.0, 1.08, -0.02)),
    "chest": ("spine", (0.0, 1.24, -0.02)),
    "neck": ("chest", (0.0, 1.48, -0.035)),
    "head": ("neck", (0.0, 1.585, -0.023)),
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
    at = on_one_side(points)
    x, y, _ = at.T
    shape = union(within(y > 0.7, trunk_field, at), within(y < 1.1, leg_field, at), 0.05)
    shape = union(shape, within(x > 0.05, arm_field, at), 0.045)
    return union(shape, within(y > 1.3, _head_and_neck, points), 0.05)


def _head_and_neck(points: Floats) -> Floats:
    local = points - HEAD
    # The field of the head has a neck without an end.
    return cut(head_field(local), local[:, 1] + 0.04, 0.02)


def trunk_field(at: Floats) -> Floats:
    """Ribs, shoulders, breast, belly and hips."""
    shape = ellipsoid(at, [0.0, 1.28, -0.02], [0.158, 0.20, 0.115])
    shape = union(shape, capsule(at, [0.0, 1.37, -0.03], [0.155, 1.395, -0.025], 0.085, 0.062), 0.06)
    shape = union(shape, capsule(at, [0.02, 1.50, -0.035], [0.16, 1.425, -0.03], 0.042, 0.028), 0.06)
    shape = union(shape, ellipsoid(at, [0.0, 1.14, -0.015], [0.148, 0.14, 0.108]), 0.08)
    shape = union(shape, ellipsoid(at, [0.0, 0.99, -0.01], [0.165, 0.15, 0.115]), 0.12)
    shape = union(shape, ellipsoid(at, [0.11, 1.03, -0.005], [0.065, 0.065, 0.085]), 0.06)
    shape = union(shape, ellipsoid(at, [0.0, 1.035, 0.05], [0.145, 0.12, 0.125]), 0.05)
    shape = union(shape, ellipsoid(at, [0.078, 1.29, 0.062], [0.085, 0.062, 0.052]), 0.05)
    return union(shape, ellipsoid(at, [0.082, 0.915, -0.068], [0.085, 0.10, 0.088]), 0.045)


def leg_field(at: Floats) -> Floats:
    """The left leg, with its foot."""
    shape = capsule(at, [0.098, 0.86, 0.0], [0.12, 0.50, 0.005], 0.098, 0.056)
    shape = union(shape, capsule(at, [0.108, 0.74, 0.03], [0.118, 0.58, 0.025], 0.062, 0.045), 0.05)
    shape = union(shape, ellipsoid(at, [0.12, 0.49, 0.022], [0.044, 0.05, 0.044]), 0.03)
    shape = union(shape, capsule(at, [0.12, 0.48, 0.0], [0.13, 0.11, -0.022], 0.054, 0.033), 0.04)
    shape = union(shape, capsule(at, [0.128, 0.40, -0.022], [0.128, 0.30, -0.024], 0.045, 0.034), 0.05)
    shape = union(shape, ellipsoid(at, [0.131, 0.045, -0.035], [0.036, 0.045, 0.042]), 0.03)
    shape = union(shape, capsule(at, [0.132, 0.055, -0.01], [0.148, 0.024, 0.115], 0.038, 0.021), 0.03)
    shape = union(shape, ellipsoid(at, [0.15, 0.022, 0.09], [0.047, 0.022, 0.075]), 0.025)
    return cut(shape, at[:, 1] + 0.002, 0.012)  # soles are flat


def arm_field(at: Floats) -> Floats:
    """The left arm, with its hand."""
    shape = ellipsoid(at, [0.186, 1.385, -0.026], [0.062, 0.07, 0.06])
    shape = union(shape, capsule(at, [0.185, 1.385, -0.025], [0.37, 1.20, -0.03], 0.053, 0.040), 0.05)
    shape = union(shape, capsule(at, [0.245, 1.33, -0.002], [0.315, 1.258, -0.008], 0.034, 0.03), 0.035)
    shape = union(shape, capsule(at, [0.235, 1.318, -0.048], [0.315, 1.24, -0.052], 0.038, 0.034), 0.035)
    shape = union(shape, capsule(at, [0.37, 1.20, -0.03], [0.53, 1.02, 0.0], 0.040, 0.024), 0.035)
    shape = union(shape, capsule(at, [0.40, 1.168, -0.022], [0.44, 1.122, -0.014], 0.038, 0.032), 0.04)
    # The hand hangs loosely, its palm towards the thigh.
    along, thick = np.array([0.60, -0.77, 0.22]), np.array([0.77, 0.63, 0.10])
    along, thick = along / math.sqrt(float(along @ along)), thick - (thick @ along) / (along @ along) * along
    thick = thick / math.sqrt(float(thick @ thick))
    wide = np.cross(along, thick)
    frame = np.stack([along, wide, thick])

    def local(point: list[float]) -> list[float]:
        return [float(row @ np.array(point)) for row in frame]

    x, y, z = at.T
    turned = np.stack([x * row[0] + y * row[1] + z * row[2] for row in frame], axis=1)
    shape = union(shape, ellipsoid(turned, local([0.555, 0.988, 0.008]), [0.056, 0.040, 0.021]), 0.03)
    shape = union(shape, ellipsoid(turned, local([0.592, 0.94, 0.022]), [0.056, 0.035, 0.0165]), 0.02)
    return union(shape, capsule(at, [0.545, 1.0, 0.022], [0.567, 0.958, 0.062], 0.015, 0.011), 0.014)


def surface(shape: Field) -> Mesh:
    """Quads on the zero of a distance field: a vertex in each cell of a grid that the zero passes (surface nets)."""
    sides = [STEP * np.arange(a, b + 1, dtype=np.float64) for a, b in zip(LOW, HIGH, strict=True)]
    counts = [len(each) for each in sides]
    # Shapes are alike on both sides, so the left half is the right one in reverse.
    points = np.stack(np.meshgrid(sides[0][: HIGH[0] + 1], *sides[1:], indexing="ij"), axis=-1)
    right = shape(_placed(points.reshape(-1, 3))).reshape(-1, *counts[1:]) < 0
    inner = np.concatenate([right, right[-2::-1]])
    for _ in range(2):
        # Single points that stick out or lie in a pit would make quads meet in an edge by four.
        around = np.zeros(counts, np.intp)
        for axis in range(3):
            for step in (-1, 1):
                around += np.roll(inner, step, axis)
        inner = np.where(inner, around >= 3, around >= 4)
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
        cells = [number[tuple((crossed - back).T)] for back in (0 * one, one, one + two, two)]
        corners = np.stack(cells, axis=1)
        turned = ~ends[tuple(crossed.T)]
        corners[turned] = corners[turned, ::-1]
        quads.append(corners)
    faces = np.concatenate(quads)
    positions = _placed(STEP * np.asarray(np.array(LOW) + passed + 0.5, np.float64))
    held: Bools = np.zeros(positions.shape, np.bool_)
    mesh = Mesh(positions, faces, np.zeros((len(faces), 4, 2)), held, np.zeros(len(positions), np.bool_))
    mesh = relax(mesh, shape, steps=16, density=_density)
    return replace(mesh, uvs=_charts(shape, mesh))


def _placed(points: Floats) -> Floats:
    """Places of (n, 3) points of the grid: the head's cells are smaller than those of the body."""
    x, y, z = points.T
    size = 1.0 - (1.0 - FINE) * smoothstep(COARSE_BELOW, FINE_ABOVE, y)
    # The height is the integral of the size, in small steps.
    heights = 1e-3 * np.arange(round(1e3 * STEP * LOW[1]), round(1e3 * STEP * HIGH[1]) + 2, dtype=np.float64)
    sizes = 1.0 - (1.0 - FINE) * smoothstep(COARSE_BELOW, FINE_ABOVE, heights)
    risen = heights[0] + np.concatenate([np.zeros(1), np.cumsum((sizes[1:] + sizes[:-1]) / 2.0 * 1e-3)])
    return np.stack([x * size, np.interp(y, heights, risen), z * size], axis=1)


def _density(points: Floats) -> Floats:
    """Pull of places on vertices, so that the head keeps its own."""
    return np.asarray(1.0 + (1.0 / (FINE * FINE * FINE) - 1.0) * smoothstep(1.44, 1.54, points[:, 1]))


def _charts(shape: Field, mesh: Mesh) -> Floats:
    """(quads, 4, 2) texture coordinates: the front on the left half of the image, the back on its right half."""
    middles = mesh.positions[mesh.quads].mean(axis=1)
    _, normals = project(shape, middles, np.zeros(middles.shape, np.bool_))
    x, y, _ = mesh.positions.T
    flat = np.stack([0.25 + 0.36 * x, 0.02 + 0.52 * y], axis=1)[mesh.quads]
    back = normals[:, 2] < 0
    flat[back] = [0.75, 0.0] + [-1.0, 1.0] * (flat[back] - [0.25, 0.0])
    return flat


def skin_weights(points: Floats, names: list[str]) -> Floats:
    """(vertices, joints) weights by the distance to each joint's bone; at most four of a vertex are above 0."""
    weights = np.zeros((len(names), len(points)))
    for row, name in enumerate(names):
        ends = [place for child, (parent, place) in PLACES.items() if parent == name] or [_tip(name)]
        away = np.min([capsule(points, list(PLACES[name][1]), list(end), 0.0, 0.0) for end in ends], axis=0)
        near = 1.0 / np.maximum(away, 0.01)
        near = near * near
        weights[row] = near * near
        # A raised thigh takes none of the belly along, and a raised arm none of the trunk.
        if name.startswith(("thigh", "shin", "foot")):
            weights[row] *= smoothstep(0.99, 0.84, points[:, 1])
        if name.startswith(("upper_arm", "forearm", "hand")):
            weights[row] *= smoothstep(0.13, 0.24, np.abs(points[:, 0]))
    # Of equal weights to the left and to the right, both stay or neither.
    weights = np.where(weights > np.sort(weights, axis=0)[-5], weights, 0.0)
    weights = weights / weights.sum(axis=0)  # rows are added one after another, so that every machine rounds alike
    weights = np.where(weights > 0.02, weights, 0.0)
    return np.ascontiguousarray((weights / weights.sum(axis=0)).T)


def _tip(name: str) -> tuple[float, float, float]:
    part, _, side = name.partition(".")
    x, y, z = _TIPS[part]
    return (-x if side == "R" else x, y, z)


def make_body() -> Character:
    """The body with its clips."""
    mesh = surface(body_field)
    names = list(PLACES)
    return Character(
        name="body",
        mesh=mesh,
        joints=tuple(Joint(name, parent, place) for name, (parent, place) in PLACES.items()),
        weights=skin_weights(mesh.positions, names),
        clips=(jump(), walk(), curl()),
        colour=(0.80, 0.52, 0.41),
        material="skin",
        roughness=0.7,
    )


def turned(axis: tuple[float, float, float], degrees: Floats) -> Floats:
    """(keys, 4) quaternions."""
    halves = [math.radians(each) / 2.0 for each in degrees.tolist()]
    return np.array([[*(math.sin(half) * each for each in axis), math.cos(half)] for half in halves])


def wave(phases: Floats) -> Floats:
    """The sines of angles, by the function that `turned` calls."""
    return np.array([math.sin(each) for each in phases.tolist()])


def jump() -> Clip:
    """Crouch, jump by 20 cm, land, and stand up again."""
    times = np.arange(round(2.4 * KEYS) + 1) / KEYS
    crouch = spline([0.0, 0.35, 0.55, 0.95, 1.12, 1.5, 2.4], [0.0, 1.0, 0.0, 0.05, 1.0, 0.15, 0.0], times)
    # In the air the body flies as a stone does, for 0.4 s.
    flight = np.clip((times - 0.55) / 0.4, 0.0, 1.0)
    height = 0.2 * 4.0 * flight * (1.0 - flight)
    thigh, shin = -48.0 * crouch, 84.0 * crouch
    fall = 0.42 * (_cosine(thigh) - 1.0) + 0.40 * (_cosine(shin + thigh) - 1.0)
    sink = np.stack([0.0 * times, fall + height, -0.10 * crouch], axis=1)
    x = (1.0, 0.0, 0.0)
    moves = {"spine": turned(x, 14.0 * crouch), "chest": turned(x, 10.0 * crouch), "neck": turned(x, -18.0 * crouch)}
    reach = smoothstep(0.35, 0.7, times) * (1.0 - smoothstep(0.9, 1.4, times))
    for side, sign in _SIDES:
        moves[f"thigh.{side}"], moves[f"shin.{side}"] = turned(x, thigh), turned(x, shin)
        moves[f"foot.{side}"] = turned(x, -shin - thigh)
        moves[f"upper_arm.{side}"] = turned(x, 40.0 * crouch - 75.0 * reach)
        moves[f"forearm.{side}"] = turned((-0.743, -0.669 * sign, 0.0), 25.0 * crouch)
    return Clip("jump", times, moves, {"hips": sink})


def walk() -> Clip:
    """Two steps of a walk, in one second, 1.3 m ahead; a loop."""
    times = np.arange(KEYS + 1) / KEYS
    phase = 2.0 * math.pi * times
    x, y = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
    beat, quarter = wave(phase), wave(phase + math.pi / 2.0)
    moves = {"spine": turned(y, 5.0 * beat), "chest": turned(y, -9.0 * beat)}
    for side, sign in _SIDES:
        lifted = np.maximum(sign * quarter, 0.0)
        moves[f"thigh.{side}"] = turned(x, -24.0 * sign * beat)
        moves[f"shin.{side}"] = turned(x, 18.0 + 22.0 * lifted * lifted)
        moves[f"upper_arm.{side}"] = turned(x, 22.0 * sign * beat)
        moves[f"forearm.{side}"] = turned(x, -12.0 + 6.0 * sign * beat)
    bob = 0.014 * wave(2.0 * phase + math.pi / 2.0)
    return Clip("walk", times, moves, {"hips": np.stack([0.015 * quarter, bob - 0.014, 1.3 * times], axis=1)})


def curl() -> Clip:
    """The elbows bend by 105 degrees, one arm after the other, and the body sways a little."""
    times = np.arange(round(2.4 * KEYS) + 1) / KEYS
    moves = {}
    for (side, sign), late in zip(_SIDES, (0.0, 0.35), strict=True):
        bent = smoothstep(0.1 + late, 0.85 + late, times) * (1.0 - smoothstep(1.15 + late, 1.9 + late, times))
        # Square to the arm and to the body's front, so that the hand comes up before the shoulder.
        moves[f"forearm.{side}"] = turned((-0.743, -0.669 * sign, 0.0), 105.0 * bent)
        moves[f"hand.{side}"] = turned((-0.743, -0.669 * sign, 0.0), 20.0 * bent)
        moves[f"upper_arm.{side}"] = turned((-0.743, -0.669 * sign, 0.0), 12.0 * bent)
    moves["chest"] = turned((1.0, 0.0, 0.0), -3.0 * smoothstep(0.1, 0.9, times) * (1.0 - smoothstep(1.3, 2.3, times)))
    return Clip("curl", times, moves)


def _cosine(degrees: Floats) -> Floats:
    return np.array([math.cos(math.radians(each)) for each in degrees.tolist()])
