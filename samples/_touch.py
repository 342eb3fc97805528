"""A hand on whose back a finger of another hand draws: the sample of touches."""

import math
from dataclasses import replace

import numpy as np

from _characters import Character, Clip, Joint
from _shapes import Builder, Floats, smoothstep

AT = (0.042, 0.0178, 0.0)  # on the hand's back, metres
RADIUS = 0.0065  # metres, of the finger's tip
HIGH = 0.03  # metres, of the tip above the skin at rest
PRESSED = 0.0012  # metres, of the tip below the skin
SECONDS = 3.0


def make_touch(hand: Character) -> Character:
    """The hand of `wrist` with a finger of another hand, which the clip `drag` lets drag the skin of its back."""
    builder, columns = Builder(), 14
    axis, length = np.array([0.6, 0.8, -0.35]), 0.07
    axis = axis / np.sqrt(axis @ axis)
    side = np.cross(axis, [0.0, 0.0, 1.0])
    side = side / np.sqrt(side @ side)
    other = np.cross(axis, side)
    top = np.array([AT[0], AT[1] + HIGH + RADIUS, AT[2]])
    angles = [k * (2.0 * math.pi / columns) for k in range(columns)]
    circle = np.array([math.cos(a) * side + math.sin(a) * other for a in angles])
    # Rings of half a sphere, from beside its pole, then of a tube that gets a little wider.
    rows = [(-math.cos(b) * RADIUS, math.sin(b) * RADIUS) for b in np.linspace(0.4, math.pi / 2.0, 5).tolist()]
    rows += [(t * length, RADIUS * (1.0 + 0.15 * t)) for t in np.linspace(0.1, 1.0, 10).tolist()]
    ids = builder.add(np.array([top + along * axis + wide * circle for along, wide in rows]))
    pole = int(builder.add((top - RADIUS * axis)[None])[0])
    builder.grid(np.concatenate([ids, ids[:, :1]], axis=1), (0.0, 0.01), (0.05, 0.05))
    for k in range(columns):
        u, v = 0.05 * k / columns, 0.05 * (k + 1) / columns
        builder.triangle([pole, int(ids[0, (k + 1) % columns]), int(ids[0, k])], [(u, 0.0), (v, 0.01), (u, 0.01)])
    own = builder.mesh(border=ids[-1], border_axis=0)
    mesh, count = hand.mesh, len(hand.mesh.positions)
    joined = replace(
        mesh,
        positions=np.concatenate([mesh.positions, own.positions]),
        quads=np.concatenate([mesh.quads, own.quads + count]),
        uvs=np.concatenate([mesh.uvs, own.uvs]),
        held=np.concatenate([mesh.held, own.held]),
        border=np.concatenate([mesh.border, own.border]),
    )
    weights = np.zeros((len(joined.positions), hand.weights.shape[1] + 3))
    weights[:count, 1:-2] = hand.weights
    weights[count:, -1] = 1.0
    x, y, z = (round(float(each), 6) for each in top + 0.9 * length * axis)
    # glTF wants joints to have a common root.
    own_joints = [each if each.parent else replace(each, parent="bodies") for each in hand.joints]
    joints = (
        Joint("bodies", None, (0.0, 0.0, 0.0)),
        *own_joints,
        Joint("other_hand", "bodies", (x, y, z)),
        Joint("other_index", "other_hand", (top[0], top[1], top[2])),
    )
    clip = Clip("drag", *drag())
    return replace(hand, name="touch", mesh=joined, weights=weights, joints=joints, clips=(clip,))


def drag() -> tuple[Floats, dict[str, Floats], dict[str, Floats]]:
    """(keys,) seconds, no rotations, and the offsets of the finger."""
    times = np.arange(round(SECONDS * 30) + 1) / 30.0
    down = smoothstep(0.1, 0.5, times) * smoothstep(2.55, 2.2, times)
    forward = smoothstep(0.6, 1.1, times) - smoothstep(1.25, 1.9, times)
    sideways = smoothstep(1.25, 1.9, times)
    moves = np.stack([-0.009 * forward, -(HIGH + PRESSED) * down, 0.008 * sideways], axis=1)
    return times, {}, {"other_index": moves}
