"""Makes the sample characters: wrist.glb, head.glb, trousers.glb, body.glb and touch.glb, and figure.glb of the demo.

Usage: python samples/make_samples.py [DIR]

Each is a quad mesh laid out by hand, as a modeller would (those of bodies come from a grid), and relaxed onto a signed
distance field. Y is up, units are metres, nothing is random.
"""

import math
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from _body import make_body
from _characters import Character, Clip, Joint, to_glb
from _figure import make_figure
from _head import face_density, head_field
from _shapes import (
    Builder,
    Floats,
    Ints,
    Mesh,
    capsule,
    ellipsoid,
    norm,
    project,
    relax,
    smoothstep,
    spline,
    union,
)
from _touch import make_touch

HERE = Path(__file__).resolve().parent
SKIN = (0.78, 0.50, 0.38)
DENIM = (0.12, 0.19, 0.34)


def turn(axis: tuple[float, float, float], degrees: Floats) -> Floats:
    """Quaternions (keys, 4) that turn about an axis of unit length."""
    half = [math.radians(angle) / 2.0 for angle in degrees.tolist()]
    return np.array([[*(math.sin(h) * component for component in axis), math.cos(h)] for h in half])


def swing(times: Floats, *, start: float, peak: float, back: float, end: float) -> Floats:
    """Rise from 0 at `start` to 1 at `peak`, stay until `back`, and return to 0 at `end` (all seconds)."""
    return smoothstep(start, peak, times) * smoothstep(end, back, times)


def frames(seconds: float) -> Floats:
    """Key times, 15 a second."""
    return np.arange(round(seconds * 15) + 1) / 15.0


def twins(half: Mesh) -> Ints:
    """Numbers (vertices,) of the mirror images of a half mesh's vertices; the middle's are their own."""
    middle = half.held[:, 0]
    return np.where(middle, np.arange(len(middle)), len(middle) + np.cumsum(~middle) - 1)


def mirrored(half: Mesh) -> Mesh:
    """Join the half of a mesh at x >= 0 with its mirror image; u becomes 1 - u there."""
    doubled = ~half.held[:, 0]
    single = (half.quads[:, 2] == half.quads[:, 3])[:, None]
    order = np.where(single, [2, 1, 0, 0], [3, 2, 1, 0])
    rows = np.arange(len(half.quads))[:, None]
    return Mesh(
        positions=np.concatenate([half.positions, half.positions[doubled] * [-1.0, 1.0, 1.0]]),
        quads=np.concatenate([half.quads, twins(half)[half.quads[rows, order]]]),
        uvs=np.concatenate([half.uvs, half.uvs[rows, order] * [-1, 1] + [1, 0]]),
        held=np.concatenate([half.held, half.held[doubled]]),
        border=np.concatenate([half.border, half.border[doubled]]),
    )


# The wrist: a left forearm along +x, palm down, thumb towards +z. The wrist joint is the origin.

FINGERS = (  # knuckle and tip (x, y, z), radius at both, little finger to index, metres
    ((0.083, 0.001, -0.0335), (0.140, -0.013, -0.0545), 0.0090, 0.0072),
    ((0.092, 0.003, -0.0115), (0.170, -0.014, -0.0195), 0.0098, 0.0079),
    ((0.096, 0.004, 0.0112), (0.180, -0.013, 0.0170), 0.0101, 0.0082),
    ((0.092, 0.002, 0.0335), (0.168, -0.014, 0.0520), 0.0098, 0.0079),
)
THUMB = ((0.020, -0.007, 0.024), (0.056, -0.012, 0.052), (0.098, -0.014, 0.069))


def wrist_field(points: Floats) -> Floats:
    """Signed distance to forearm and hand."""
    x, y, z = points.T
    half_height = spline([-0.24, -0.16, -0.05, 0.0, 0.03], [0.039, 0.037, 0.0235, 0.0195, 0.0185], x)
    half_width = spline([-0.24, -0.16, -0.05, 0.0, 0.03], [0.044, 0.043, 0.0310, 0.0285, 0.0300], x)
    arm = (np.sqrt((y / half_height) ** 2 + (z / half_width) ** 2) - 1.0) * half_height
    arm = -union(-arm, 0.02 - x, 0.02)
    palm = ellipsoid(points, [0.050, 0.001, 0.0], [0.060, 0.0165, 0.045])
    palm = union(palm, ellipsoid(points, [0.040, -0.008, 0.020], [0.032, 0.014, 0.018]), 0.012)
    palm = union(palm, ellipsoid(points, [0.040, -0.007, -0.021], [0.034, 0.013, 0.016]), 0.012)
    for knuckle, _, radius, _ in FINGERS:
        root = [0.35 * knuckle[0], 0.002, 0.55 * knuckle[2]]
        palm = union(palm, capsule(points, root, list(knuckle), radius, radius * 1.04), 0.010)
    thumb = union(
        capsule(points, list(THUMB[0]), list(THUMB[1]), 0.0150, 0.0118),
        capsule(points, list(THUMB[1]), list(THUMB[2]), 0.0118, 0.0090),
        0.004,
    )
    fingers = np.full(len(points), 1.0)
    for knuckle, tip, radius, tip_radius in FINGERS:
        bend = [0.5 * (k + t) for k, t in zip(knuckle, tip, strict=True)]
        bend[1] += 0.004
        fingers = union(fingers, capsule(points, list(knuckle), bend, radius, 0.95 * radius), 0.009)
        fingers = union(fingers, capsule(points, bend, list(tip), 0.95 * radius, tip_radius), 0.006)
    return union(union(union(arm, palm, 0.025), thumb, 0.012), fingers, 0.006)


def digit(
    builder: Builder,
    base: Ints,
    ends: tuple[tuple[float, ...], tuple[float, ...]],
    radii: tuple[float, float],
    *,
    rows: int,
    across: int,
    low: tuple[float, float],
    high: tuple[float, float],
) -> None:
    """Grow a finger from a ring of vertices.

    Args:
        builder: The mesh to which the quads are added.
        base: (columns,) the ring; the first `across` + 1 are its upper side, and they go round clockwise as
            seen from the finger's tip.
        ends: Middle of the ring and of the tip, metres.
        radii: Radii at both ends, metres.
        rows: Number of rings to add.
        across: Number of edges on the upper side.
        low: (u, v) of one corner of the finger's chart, the tip's cap included.
        high: (u, v) of the opposite corner.
    """
    columns = len(base)
    start, tip = np.array(ends[0]), np.array(ends[1])
    axis = (tip - start) / math.dist(*ends)
    side = np.array([-axis[2], 0.0, axis[0]]) / math.hypot(axis[0], axis[2])
    up = np.cross(side, axis)
    angles = [(k - across / 2) * 2.0 * math.pi / columns for k in range(columns)]
    circle = np.array([math.cos(a) * up + math.sin(a) * side for a in angles])
    rings = [base]
    for row in range(1, rows + 1):
        t = min(row / (rows - 1), 1.0)
        radius = radii[0] + t * (radii[1] - radii[0])
        # The last ring lies on the round end, half-way up.
        end = 0.7 * radii[1] if row == rows else 0.0
        rings.append(builder.add(start + t * (tip - start) + end * axis + circle * (radius - 0.4 * end)))
    ids = np.roll(np.array(rings), 1, axis=1)
    neck = low[1] + 0.8 * (high[1] - low[1])
    builder.grid(np.column_stack([ids, ids[:, :1]]), low, (high[0], neck))

    last = rings[-1]
    depth = columns // 2 - across
    cap = np.zeros((depth + 1, across + 1), dtype=np.intp)
    cap[0] = last[: across + 1]
    cap[-1] = last[across + depth : 2 * across + depth + 1][::-1]
    for row in range(1, depth):
        cap[row, -1] = last[across + row]
        cap[row, 0] = last[columns - row]
        for column in range(1, across):
            offset = (0.5 - row / depth) * up + (column / across - 0.5) * side + axis
            cap[row, column] = builder.add(tip + radii[1] * offset)
    builder.grid(cap, (low[0], neck + 0.01), high)


def fingertips(points: Floats) -> Floats:
    """Density of the hand's vertices: the round ends of the fingers need more."""
    density = np.ones(len(points))
    for _, tip, _, radius in FINGERS:
        density = density + 0.9 * smoothstep(2.2 * radius, 0.8 * radius, norm(points - tip - [0.7 * radius, 0.0, 0.0]))
    return density


def make_wrist() -> Character:
    """Forearm and hand: 28 columns around, four fingers of 10 columns, a thumb of 12, open at the elbow."""
    rows, columns = 30, 28
    builder = Builder()
    angles = [(k - 6) * 2.0 * math.pi / columns for k in range(columns)]
    ring = np.array([[0.0, math.cos(angle), math.sin(angle)] for angle in angles])
    xs = np.concatenate([np.linspace(-0.22, -0.05, 14), np.linspace(-0.05, 0.088, 18)[1:]])
    sizes = [(0.042, 0.036) if x < 0.0 else (0.045, 0.02) for x in xs.tolist()]
    ids = builder.add(
        np.array([ring * [0.0, high, wide] + [x, 0.0, 0.0] for x, (wide, high) in zip(xs, sizes, strict=True)])
    )
    r, c = 22, 12
    skip = np.zeros((rows, columns), dtype=bool)
    skip[r : r + 3, c : c + 3] = True
    wrapped = np.column_stack([ids[:, -1], ids])
    builder.grid(wrapped, (0.02, 0.30), (0.98, 0.98), skip=np.roll(skip, 1, axis=1))

    webs = builder.add(np.array([[0.090, 0.0, (a[0][2] + b[0][2]) / 2.0] for a, b in pairwise(FINGERS)]))
    upper, lower = ids[-1, :13], ids[-1, 26:13:-1]
    between = np.array([ids[-1, 27], *webs, ids[-1, 13]])
    for i, (knuckle, tip, *radii) in enumerate(FINGERS):
        k = 3 * i
        base = np.array([*upper[k : k + 4], between[i + 1], *lower[k : k + 4][::-1], between[i]])
        left = 0.02 + 0.13 * i
        digit(
            builder,
            base,
            (knuckle, tip),
            (radii[0], radii[1]),
            rows=7,
            across=3,
            low=(left, 0.02),
            high=(left + 0.11, 0.27),
        )
    hole = [
        *ids[r : r + 4, c][::-1],
        *ids[r, c + 1 : c + 3],
        *ids[r : r + 4, c + 3],
        *ids[r + 3, c + 1 : c + 3][::-1],
    ]
    digit(
        builder,
        np.array(hole),
        (THUMB[1], THUMB[2]),
        (0.0118, 0.009),
        rows=8,
        across=3,
        low=(0.56, 0.02),
        high=(0.69, 0.27),
    )
    mesh = relax(builder.mesh(border=ids[0], border_axis=0), wrist_field, steps=40, density=fingertips)
    points = mesh.positions
    x = points[:, 0]

    hand = smoothstep(-0.044, 0.036, x)
    fingers = smoothstep(0.072, 0.102, x)
    to_thumb = norm(np.cross(points - THUMB[0], _direction(THUMB[0], THUMB[2])))
    thumb = smoothstep(0.034, 0.060, x * 0.35 + points[:, 2]) * smoothstep(0.040, 0.018, to_thumb)
    thumb = thumb * smoothstep(0.015, 0.03, x)
    weights = np.stack([1.0 - hand, hand * (1.0 - fingers), hand * fingers, np.zeros(len(x))], axis=1)
    weights = weights * (1.0 - thumb)[:, None]
    weights[:, 3] = thumb

    times = frames(2.0)
    bend = swing(times, start=0.0, peak=0.9, back=1.1, end=2.0)
    sideways = (0.0, 0.0, 1.0)
    return Character(
        name="wrist",
        mesh=mesh,
        joints=(
            Joint("forearm", None, (-0.22, 0.0, 0.0)),
            Joint("hand", "forearm", (0.0, 0.0, 0.0)),
            Joint("fingers", "hand", (0.088, 0.002, 0.0)),
            Joint("thumb", "hand", (0.030, -0.008, 0.032)),
        ),
        weights=weights,
        clips=(
            Clip(
                "flex",
                times,
                rotations={
                    "hand": turn(sideways, -70.0 * bend),
                    "fingers": turn(sideways, -20.0 * bend),
                    "thumb": turn((0.0, 1.0, 0.0), 8.0 * bend),
                },
            ),
            Clip(
                "extend",
                times,
                rotations={"hand": turn(sideways, 60.0 * bend), "fingers": turn(sideways, -12.0 * bend)},
            ),
        ),
        colour=SKIN,
        material="skin",
        roughness=0.6,
        double_sided=True,
    )


def _direction(start: tuple[float, ...], end: tuple[float, ...]) -> Floats:
    offset: Floats = np.array(end) - np.array(start)
    return offset / math.dist(start, end)


# The trousers, standing at y = 0 and facing +z. Their left half (x >= 0) is modelled, the right one mirrored.

HEM = (0.06, -0.022)  # y and z of the legs' lower ends, metres


def trousers_field(points: Floats) -> Floats:
    """Signed distance to a pair of trousers, x >= 0."""
    x, y, z = points.T
    heights = [0.06, 0.30, 0.50, 0.66, 0.80]
    leg_x = spline(heights, [0.112, 0.108, 0.104, 0.098, 0.090], y)
    leg_z = z - spline(heights, [-0.022, -0.016, 0.000, 0.000, -0.004], y)
    wide = spline(heights, [0.062, 0.066, 0.070, 0.082, 0.090], y)
    deep = spline(heights, [0.068, 0.073, 0.077, 0.094, 0.106], y)
    # With the other leg, the crotch is a saddle and not a slit.
    left, right = (
        (np.sqrt((offset / wide) ** 2 + (leg_z / deep) ** 2) - 1.0) * wide for offset in (x - leg_x, x + leg_x)
    )
    leg = -union(-union(left, right, 0.035), 0.90 - y, 0.08)
    heights = [0.74, 0.82, 0.88, 0.96, 1.04]
    hip_z = z - spline(heights, [-0.010, -0.010, -0.006, 0.000, 0.004], y)
    wide = spline(heights, [0.172, 0.182, 0.180, 0.168, 0.160], y)
    deep = spline(heights, [0.112, 0.120, 0.119, 0.112, 0.108], y)
    hips = (np.sqrt((x / wide) ** 2 + (hip_z / deep) ** 2) - 1.0) * deep
    hips = -union(-hips, y - 0.765, 0.06)
    hips = union(hips, ellipsoid(points, [0.078, 0.850, -0.056], [0.082, 0.082, 0.084]), 0.05)
    return union(hips, leg, 0.05)


def make_trousers() -> Character:
    """Waist of 60 columns, legs of 36, a path of six edges through the crotch; open at waist and hems."""
    builder = Builder()
    half_columns, hip_rows, leg_rows = 30, 11, 35
    angles = [math.pi * k / half_columns for k in range(half_columns + 1)]
    around = np.array([[math.sin(a), 0.0, -math.cos(a)] for a in angles])
    around[-1, 0] = 0.0
    heights = np.linspace(1.03, 0.77, hip_rows + 1)
    hips = builder.add(np.array([around * [0.17, 0.0, 0.12] + [0.0, y, 0.0] for y in heights]))
    hips_middle = np.concatenate([hips[:, 0], hips[:, -1]])
    builder.grid(hips, (1.0, 0.98), (0.5, 0.74))

    depths = np.linspace(0.09, -0.09, 7)[1:-1]
    crotch = builder.add(np.column_stack([np.zeros(5), np.full(5, 0.75), depths]))
    # From the inner seam to the back, the side, the front, and along the crotch to the inner seam again.
    ring = np.roll(np.array([*hips[-1], *crotch]), 3)
    angles = [math.pi + 2.0 * math.pi * (k + 0.5) / 36 - math.pi / 36 for k in range(36)]
    circle = np.array([[math.cos(a), 0.0, math.sin(a)] for a in angles])
    heights = np.linspace(0.73, 0.06, leg_rows)
    rings = [circle * [0.07, 0.0, 0.08] + [0.10, y, 0.0] for y in heights]
    # One vertex of the hem sits higher: a triangle below it makes the count what it has to be.
    rings[-1][18, 1] += 0.01
    legs = np.concatenate([ring[None], builder.add(np.array(rings))])
    low, high = (0.54, 0.70), (0.96, 0.02)
    builder.grid(np.column_stack([legs, legs[:, :1]]), low, high)
    corners = [(low[0] + (high[0] - low[0]) * k / 36, high[1]) for k in (17, 18, 19)]
    builder.triangle(legs[-1, 17:20].tolist(), corners)

    hem = np.delete(legs[-1], 18)
    half = builder.mesh(
        border=np.concatenate([hips[0], hem]), border_axis=1, middle=np.concatenate([hips_middle, crotch])
    )
    mesh = mirrored(relax(half, trousers_field, steps=60))

    x, y, z = mesh.positions.T
    # The fly stays with the pelvis.
    fly = smoothstep(0.07, 0.0, np.abs(x)) * smoothstep(-0.03, 0.05, z)
    thigh = smoothstep(0.95, 0.75, y + 0.25 * (z + 0.01) + 0.06 * fly)
    shin = smoothstep(0.58, 0.42, y)
    width = 0.002 + 0.03 * smoothstep(0.60, 0.74, y)
    left = 0.5 + np.where(x < 0.0, -0.5, 0.5) * smoothstep(0.0, 1.0, np.abs(x) / width)
    weights = np.stack(
        [
            1.0 - thigh,
            thigh * (1.0 - shin) * left,
            thigh * (1.0 - shin) * (1.0 - left),
            shin * left,
            shin * (1.0 - left),
        ],
        axis=1,
    )
    hip, knee = (0.090, 0.88, 0.0), (0.104, 0.50, -0.045)
    return Character(
        name="trousers",
        mesh=mesh,
        joints=(
            Joint("pelvis", None, (0.0, 0.95, 0.0)),
            Joint("thigh.L", "pelvis", hip),
            Joint("shin.L", "thigh.L", knee),
            Joint("thigh.R", "pelvis", (-hip[0], *hip[1:])),
            Joint("shin.R", "thigh.R", (-knee[0], *knee[1:])),
        ),
        weights=weights[:, [0, 1, 3, 2, 4]],
        clips=(squat(hip, knee), walk()),
        colour=DENIM,
        material="cloth",
        roughness=0.9,
        double_sided=True,
    )


def squat(hip: tuple[float, ...], knee: tuple[float, ...]) -> Clip:
    """Down to knees at 100° and up again; the hems keep their height."""
    times = frames(2.4)
    bend = swing(times, start=0.0, peak=1.0, back=1.4, end=2.4)
    outward = math.radians(12.0)
    c, s = math.cos(outward), math.sin(outward)
    lifts = np.zeros((len(times), 3))
    for lift, amount in zip(lifts, bend.tolist(), strict=True):
        for (start_y, start_z), (end_y, end_z), degrees in (
            (hip[1:], knee[1:], 72.0),
            (knee[1:], HEM, -28.0),
        ):
            cos, sin = math.cos(math.radians(degrees * amount)), math.sin(math.radians(degrees * amount))
            y, z = end_y - start_y, end_z - start_z
            lift[1:] += y - (y * cos + z * sin), z - (z * cos - y * sin) * c
    return Clip(
        "squat",
        times,
        rotations={
            "pelvis": turn((1.0, 0.0, 0.0), 14.0 * bend),
            "thigh.L": turn((-c, 0.0, s), 86.0 * bend),
            "shin.L": turn((c, 0.0, -s), 100.0 * bend),
            "thigh.R": turn((-c, 0.0, -s), 86.0 * bend),
            "shin.R": turn((c, 0.0, s), 100.0 * bend),
        },
        translations={"pelvis": lifts},
    )


def walk() -> Clip:
    """A cycle of two steps in place; the last key equals the first."""
    times = np.arange(19) / 15.0
    rotations = {}
    for side, shift in (("L", 0.0), ("R", 0.5)):
        phase = np.arange(19) / 18.0 + shift
        phase = phase - np.floor(phase)
        forward = np.array([4.0 + 24.0 * math.cos(2.0 * math.pi * p) for p in phase.tolist()])
        bent = 8.0 + 54.0 * smoothstep(0.42, 0.70, phase) * smoothstep(1.0, 0.70, phase)
        rotations[f"thigh.{side}"] = turn((-1.0, 0.0, 0.0), forward)
        rotations[f"shin.{side}"] = turn((1.0, 0.0, 0.0), bent)
    bob = np.array([-0.012 * (1.0 + math.cos(4.0 * math.pi * i / 18.0)) for i in range(19)])
    return Clip("walk", times, rotations=rotations, translations={"pelvis": bob[:, None] * [0.0, 1.0, 0.0]})


# The head, facing +z, its neck open at y = 0. Its left half (x >= 0) is modelled, the right one mirrored.


def make_head() -> Character:
    """A cube's top of 36 x 35 quads, its sides going down the neck in 66 rows, three corners cut there."""
    wide, deep, rows, head_rows = 18, 35, 66, 46
    builder = Builder()
    # Columns run from the middle of the back over the left side to the middle of the face.
    edge = [(k / wide, -1.0) for k in range(wide)]
    edge += [(1.0, -1.0 + 2.0 * k / deep) for k in range(deep)]
    edge += [(1.0 - k / wide, 1.0) for k in range(wide + 1)]
    sides = []
    for row in range(rows + 1):
        down = min(row / head_rows, 1.0)
        if row <= head_rows:
            ring = np.array([[x, 1.0 - 2.1 * down, z] for x, z in edge])
            ring = ring / norm(ring)[:, None] * [0.075, 0.10, 0.095] + [0.0, 0.225, 0.0]
        else:
            ring = np.array([[x, 0.0, z] for x, z in edge])
            ring = ring / norm(ring)[:, None] * [0.055, 1.0, 0.055]
            ring = ring + np.array([0.0, 0.13 * (rows - row) / (rows - head_rows), -0.025])
        sides.append(ring)
    # A vertex of each half sits higher at the neck's end, and one in the middle will: triangles below these
    # three make the count what it has to be.
    sides[-1][22, 1] += 0.004
    strip = builder.add(np.array(sides))
    builder.grid(strip, (1.0, 0.70), (0.5, 0.02))

    top = np.zeros((deep + 1, wide + 1), dtype=np.intp)
    top[0] = strip[0, : wide + 1]
    top[:, -1] = strip[0, wide : wide + deep + 1]
    top[-1] = strip[0, wide + deep :][::-1]
    for i in range(1, deep):
        inner = np.array([[k / wide, 1.0, -1.0 + 2.0 * i / deep] for k in range(wide)])
        inner = inner / norm(inner)[:, None] * [0.075, 0.10, 0.095] + [0.0, 0.225, 0.0]
        top[i, :-1] = builder.add(inner)
    # Seen from above, columns go to the left (+x) and rows to the face: their cross product points down.
    builder.grid(top[::-1], (0.5, 0.74), (0.64, 0.98))

    step, v = 0.5 / (2 * wide + deep), 0.02
    builder.triangle(strip[-1, 21:24].tolist(), [(1.0 - step * k, v) for k in (21, 22, 23)])
    middle = np.concatenate([strip[:, 0], strip[:, -1], top[:, 0]])
    half = builder.mesh(border=np.delete(strip[-1], 22), border_axis=1, middle=middle)
    half = grow(half)
    above, (beside, centre) = strip[-2, -1], strip[-1, -2:]
    positions = half.positions.copy()
    positions[centre, 1] = (positions[centre, 1] + positions[above, 1]) / 2.0
    half = replace(half, positions=project(head_field, positions, half.held, steps=4)[0])
    mesh = mirrored(half)
    mesh = replace(
        mesh,
        quads=np.concatenate([mesh.quads, [[beside, centre, *[twins(half)[beside]] * 2]]]),
        uvs=np.concatenate([mesh.uvs, [[(0.5 + step, v), (0.5, v), (0.5 - step, v), (0.5 - step, v)]]]),
    )
    _, y, z = mesh.positions.T
    head = smoothstep(0.075, 0.140, y + 0.35 * (z + 0.02))
    times = frames(2.0)
    raised = swing(times, start=0.0, peak=0.8, back=1.2, end=2.0)
    long_times = frames(3.0)
    turned = swing(long_times, start=0.0, peak=1.0, back=2.0, end=3.0)
    return Character(
        name="head",
        mesh=mesh,
        joints=(Joint("neck", None, (0.0, 0.06, -0.030)), Joint("skull", "neck", (0.0, 0.130, -0.018))),
        weights=np.stack([1.0 - head, head], axis=1),
        clips=(
            Clip("raise_brows", times, weights=np.stack([raised, 0.0 * raised], axis=1)),
            Clip(
                "think",
                long_times,
                rotations={
                    "neck": turn((0.0, 1.0, 0.0), 9.0 * turned),
                    "skull": turn((-0.36, 0.80, -0.48), 26.0 * turned),
                },
                weights=np.zeros((len(long_times), 2)),
            ),
        ),
        colour=SKIN,
        material="skin",
        roughness=0.55,
        morphs={"browsUp": brow_offsets(mesh, 0.012), "browsDown": brow_offsets(mesh, -0.006)},
    )


def grow(half: Mesh) -> Mesh:
    """Relax half a head while its nose and ears grow, so that these get vertices of their own."""
    for step in range(1, 13):
        growth = step / 12

        def shape(points: Floats, growth: float = growth) -> Floats:
            return head_field(points, growth=growth)

        half = relax(half, shape, steps=10, density=face_density)
    return relax(half, head_field, steps=20, density=face_density)


def brow_offsets(mesh: Mesh, rise: float) -> Floats:
    """Offsets (vertices, 3) that slide the brows `rise` metres up over the skull; hairline and eyes stay."""
    x, y, z = mesh.positions.T
    amount = smoothstep(0.194, 0.230, y) * smoothstep(0.292, 0.238, y)
    amount = amount * smoothstep(0.082, 0.050, np.abs(x)) * smoothstep(0.0, 0.04, z)

    def shape(points: Floats) -> Floats:
        return head_field(points, brows=rise)

    moved = mesh.positions + amount[:, None] * [0.0, rise, 0.0]
    moved, _ = project(shape, moved, mesh.held, steps=4)
    # The factor removes rounding noise where nothing moves.
    return (moved - mesh.positions) * smoothstep(0.0, 0.1, amount)[:, None]


def main(folder: Path | None) -> None:
    """Write the samples into a folder; None means the places where they are kept."""
    wrist = make_wrist()
    for character in (wrist, make_head(), make_trousers(), make_body(), make_touch(wrist), make_figure()):
        kept = HERE.parent / "wrinklecli" / "example" if character.name == "figure" else HERE
        place = folder or kept
        place.mkdir(parents=True, exist_ok=True)
        (place / f"{character.name}.glb").write_bytes(to_glb(character))


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
