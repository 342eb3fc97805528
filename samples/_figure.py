"""A dressed figure, for a first bake: the body in a striped shirt, jeans and shoes, on one textured mesh."""

import math
import struct
import zlib
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from _body import HEAD, KEYS, PLACES, arm_field, leg_field, skin_weights, surface, trunk_field, turned
from _characters import Character, Clip, Joint
from _head import head_field
from _shapes import Bools, Floats, Ints, Mesh, capsule, cut, ellipsoid, on_one_side, smoothstep, union, within

IMAGE = 1024  # pixels of the sides of the base colour
_FINER = 2  # of them are painted a side for each, whose mean is taken, so that edges are smooth
# The front of the head is larger in the image than the rest, below the arms: its least height, metres, the image's
# parts for a metre, and the place of x = 0 at this height.
_FACE, _FACE_SIZE, _FACE_AT = 1.52, 1.4, (0.5, 0.01)
# Heights of the garments' ends, metres.
_COLLAR, _HEM, _BELT, _TURN_UP, _SOLE = 1.475, 0.925, 0.965, 0.105, 0.022
# How far cloth stands off the body, metres.
_SHIRT, _JEANS, _LOOSE, _SHOE = 0.009, 0.008, 0.010, 0.010
_FADE = 0.016  # metres over which a garment's end rises, about a cell of the grid
_STRIPE = 0.034  # metres from stripe to stripe
_PIECE = 8  # pixels of a thread that are alike
_CELL = 0.003  # metres between places where the head's depth is known
_CROWN = (0.0, 0.335, -0.045)  # metres from the neck's end: from here hair goes round the head
_STRANDS = ((11, 0.5), (23, 1.9), (47, 4.1), (71, 0.8))  # waves round the crown, and their phases
# sRGB of 255.
_WHITE, _NAVY, _DENIM, _FADED = (232, 226, 214), (42, 56, 100), (86, 118, 166), (140, 168, 204)
_SKIN, _LIPS, _HAIR, _CANVAS, _RUBBER = (208, 150, 120), (184, 110, 96), (58, 40, 30), (126, 44, 40), (222, 216, 204)

_SHOULDER, _ELBOW, _WRIST = (np.array(PLACES[f"{name}.L"][1]) for name in ("upper_arm", "forearm", "hand"))


def figure_field(points: Floats) -> Floats:
    """Signed distance to the dressed figure."""
    at = on_one_side(points)
    x, y, _ = at.T
    shape = union(within(y > 0.7, _trunk, at), within(y < 1.1, _leg, at), 0.05)
    shape = union(shape, within(x > 0.05, _arm, at), 0.045)
    return union(shape, within(y > 1.3, _head, points), 0.03)


def _trunk(at: Floats) -> Floats:
    y = at[:, 1]
    upper = smoothstep(_HEM, _HEM + _FADE, y) * smoothstep(_COLLAR + _FADE, _COLLAR, y)
    return trunk_field(at) - _SHIRT * upper


def _arm(at: Floats) -> Floats:
    sleeve = _SHIRT * smoothstep(0.985, 0.955, _along_arm(at))
    return arm_field(at) - sleeve


def _leg(at: Floats) -> Floats:
    """Legs of jeans hang straight from the knees."""
    y = at[:, 1]
    lower = smoothstep(_TURN_UP - _FADE, _TURN_UP, y)
    leg = leg_field(at) - (_JEANS + _LOOSE * smoothstep(0.62, 0.30, y)) * lower - _SHOE * (1.0 - lower)
    return cut(leg, y + 0.002, 0.012)


def _head(points: Floats) -> Floats:
    local = points - HEAD
    return cut(union(head_field(local), _hair(local), 0.008), local[:, 1] + 0.04, 0.02)


def _hair(local: Floats) -> Floats:
    """Short hair: a cap with a quiff, which leaves the face and the ears free."""
    at = on_one_side(local)
    cap = ellipsoid(at, [0.0, 0.258, -0.024], [0.0865, 0.097, 0.104])
    cap = union(cap, ellipsoid(at, [0.012, 0.325, 0.040], [0.050, 0.032, 0.048]), 0.03)
    cap = cut(cap, ellipsoid(at, [0.0, 0.178, 0.100], [0.073, 0.104, 0.085]), 0.010)
    cap = cut(cap, ellipsoid(at, [0.080, 0.185, 0.004], [0.030, 0.046, 0.044]), 0.010)
    return cut(cap, ellipsoid(at, [0.0, 0.040, -0.09], [0.200, 0.095, 0.120]), 0.010)


def _along_arm(at: Floats) -> Floats:
    """(n,) 0 at the shoulder, less above, 0.5 at the elbow and 1 at the wrist, by the places along the arm's bones."""
    lengths = []
    for start, end in ((_SHOULDER, _ELBOW), (_ELBOW, _WRIST)):
        bone = end - start
        offset = at - start
        lengths.append(
            (offset[:, 0] * bone[0] + offset[:, 1] * bone[1] + offset[:, 2] * bone[2])
            / float(bone[0] * bone[0] + bone[1] * bone[1] + bone[2] * bone[2])
        )
    first, second = lengths
    # The bones are nearly in line.
    return np.asarray(0.5 * np.clip(first, -0.5, 1.0) + 0.5 * np.clip(second, 0.0, 1.3))


def base_colour(size: int = IMAGE) -> bytes:
    """The figure's texture as PNG, square, for its charts: the front is left, the back is right, and the face below."""
    rows = np.array_split(np.arange(size), max(size // 64, 1))
    painted, cloth = zip(*(_painted(some, size) for some in rows), strict=True)
    return encode_png(_woven(np.concatenate(painted), size, cloth=np.concatenate(cloth)))


def _painted(rows: Ints, size: int) -> tuple[Floats, Bools]:
    """(pixels, 3) colours of some rows of an image of a size, sRGB of 255, and which of these pixels are cloth."""
    fine = _FINER * size
    u, v = (
        each.ravel()
        for each in np.meshgrid(
            (np.arange(fine) + 0.5) / fine, 1.0 - (_FINER * rows[0] + np.arange(_FINER * len(rows)) + 0.5) / fine
        )
    )
    front = u < 0.5
    x, y = np.abs(np.where(front, u - 0.25, 0.75 - u) / 0.36), (v - 0.02) / 0.52
    near_x, near_y = np.abs(u - _FACE_AT[0]) / _FACE_SIZE, _FACE + (v - _FACE_AT[1]) / _FACE_SIZE
    face = (near_x < 0.115) & (near_y < 1.835)
    x, y, front = np.where(face, near_x, x), np.where(face, near_y, y), front | face
    at = np.column_stack([x, y, np.zeros(len(x))])
    colours: Floats = np.tile(np.array(_SKIN, np.float64), (len(x), 1))
    arm = (capsule(at, [0.215, 1.37, 0.0], [0.37, 1.20, 0.0], 0.085, 0.075) < 0) | (
        capsule(at, [0.37, 1.20, 0.0], [0.60, 0.93, 0.0], 0.075, 0.080) < 0
    )
    arm &= (x > 0.165) & ~face
    along = _along_arm(np.column_stack([x, y, np.full(len(x), -0.02)]))
    _paint_shirt(colours, at, arm, along)
    _paint_jeans(colours, at, ~arm & (y < _HEM + 0.006), front)
    head = y > 1.48
    if head.any():
        own = colours[head]
        _paint_head(own, at[head], front[head])
        colours[head] = own
    cloth = (y < 1.47) & ~(arm & (along > 0.97))
    blocks = colours.reshape(len(rows), _FINER, size, _FINER, 3).mean(axis=(1, 3))
    return blocks.reshape(-1, 3), cloth.reshape(len(rows), _FINER, size, _FINER)[:, 0, :, 0].ravel()


def _paint_shirt(colours: Floats, at: Floats, arm: Bools, along: Floats) -> None:
    """Stripes round trunk and sleeves, up to the seams between them; collar, cuffs and hem are plain."""
    x, y, _ = at.T
    trunk = ~arm & (y > _HEM) & (y < _COLLAR + 0.05 * smoothstep(0.03, 0.10, x))
    sleeve = arm & (along < 0.97)
    # Sleeves are two bones of about 0.25 m each.
    phase = np.where(arm, along * 0.51, y - _HEM) / _STRIPE
    dark = phase - np.floor(phase) < 0.36
    plain = np.where(
        arm, (along > 0.925) | (along < 0.0), (y < _HEM + 0.022) | (y > _COLLAR - 0.02) | ((x > 0.165) & (y > 1.2))
    )
    shirt = trunk | sleeve
    colours[shirt] = _WHITE
    colours[shirt & dark & ~plain] = _NAVY
    seam = shirt & (np.abs(np.where(arm, (along - 0.925) * 0.51, y - _HEM - 0.022)) < 0.0015)
    seam |= shirt & (y > 1.2) & (np.abs(x - 0.165) < 0.0015)
    colours[seam] = np.array(_WHITE) * 0.72


def _paint_jeans(colours: Floats, at: Floats, jeans: Bools, front: Bools) -> None:
    """Denim, faded on the thighs and knees, with a fly, pockets, seams and turn-ups; shoes below."""
    x, y, _ = at.T
    faded = 0.85 * np.exp(-(((x - 0.115) / 0.05) ** 2)) * smoothstep(0.25, 0.5, y) * smoothstep(0.93, 0.78, y)
    faded = np.maximum(faded * np.where(front, 1.0, 0.6), 0.25 * np.exp(-(((y - 0.49) / 0.05) ** 2)))
    denim = np.array(_DENIM) + faded[:, None] * (np.array(_FADED) - np.array(_DENIM))
    turned_up = (y < _TURN_UP + 0.035) & (y > _TURN_UP - 0.006)
    denim[turned_up] = np.array(_FADED) * 1.12
    pocket = np.where(
        front,
        np.abs(np.hypot(x - 0.175, y - 0.955) - 0.085),
        np.minimum(
            np.where(np.abs(y - 0.86) < 0.062, np.abs(np.abs(x - 0.088) - 0.052), 1.0),
            np.where(
                np.abs(x - 0.088) < 0.052,
                np.minimum(np.abs(y - 0.922), np.abs(y - 0.798 - 0.2 * np.abs(x - 0.088))),
                1.0,
            ),
        ),
    )
    fly = np.where(front & (y > 0.86), np.abs(x - 0.018), 1.0)
    stitches = np.minimum(np.minimum(pocket, fly), np.abs(y - _TURN_UP - 0.035))
    denim[(stitches < 0.0028) & (y > 0.1)] = np.array([150.0, 112.0, 62.0])
    colours[jeans] = denim[jeans]
    shoe = jeans & (y < _TURN_UP - 0.006)
    colours[shoe] = _CANVAS
    colours[shoe & (y < _SOLE)] = _RUBBER


def _paint_head(colours: Floats, at: Floats, front: Bools) -> None:
    """Hair where the head's shape has it, brows, eyes, cheeks and lips."""
    x, y = at[:, 0], at[:, 1] - HEAD[1]
    place = _on_head(x, y, front)
    hair = (y > np.where(front, 0.215, 0.09)) & (_hair(place) < head_field(place) + 0.0008)
    around = np.arctan2(place[:, 0] - _CROWN[0], place[:, 2] - _CROWN[2])
    strands = sum(np.sin(waves * around + phase + 9.0 * place[:, 1]) for waves, phase in _STRANDS)
    colours[hair] = np.array(_HAIR) * (1.1 + 0.16 * strands[hair])[:, None]
    face = front & ~hair & (y > 0.03)
    cheek = np.exp(-(((x - 0.043) / 0.017) ** 2) - ((y - 0.178) / 0.016) ** 2)
    colours[face] += cheek[face, None] * np.array([9.0, -14.0, -11.0])
    arch = 0.2370 + 0.13 * (x - 0.012) - 6.0 * np.maximum(x - 0.028, 0.0) ** 2
    brow = face & (np.abs(y - arch) < 0.0042 - 0.05 * np.maximum(x - 0.02, 0.0)) & (x > 0.014) & (x < 0.054)
    colours[brow] = np.array(_HAIR) * 1.15
    lid = 0.2116 + 0.16 * (x - 0.0315)  # outer corners of the eyes are higher
    eye = np.hypot((x - 0.0315) / 0.0142, (y - lid) / 0.0070)
    colours[face & (eye < 1.0)] = (240, 237, 232)
    iris = np.hypot(x - 0.0310, y - 0.2118)
    colours[face & (eye < 1.0) & (iris < 0.0072)] = (58, 84, 74)
    colours[face & (eye < 1.0) & (iris < 0.0060)] = (96, 132, 112)
    colours[face & (eye < 1.0) & (iris < 0.0034)] = (22, 20, 20)
    colours[face & (np.hypot(x - 0.0330, y - 0.2143) < 0.0014)] = (250, 250, 250)
    lashes = (eye > 0.93) & (eye < 1.22) & (y > lid + 0.001)
    colours[face & lashes] = np.array(_HAIR) * 0.9
    corner = 0.1480 + 0.10 * np.maximum(x - 0.010, 0.0)  # a slight smile
    lips = np.hypot(x / 0.0245, (y - corner) / (0.0098 - 0.16 * x))
    colours[face & (lips < 1.0) & (x < 0.0245)] = _LIPS
    colours[face & (np.abs(y - corner - 0.0004) < 0.0011) & (x < 0.0235)] = np.array(_LIPS) * 0.6


@cache
def _depths() -> Floats:
    """(2, columns, rows) z of the head's surface from the neck's end, seen from behind and from ahead.

    Columns and rows are `_CELL` apart, from x = 0 and the neck's end on. Where nothing is seen, it is the place nearest
    to the head on the way.
    """
    columns, rows = np.meshgrid(_CELL * np.arange(44), _CELL * np.arange(132), indexing="ij")
    found = []
    for way in (-1.0, 1.0):
        place = np.column_stack([columns.ravel(), rows.ravel(), np.full(columns.size, 0.15 * way)])
        nearest, least = place[:, 2].copy(), np.full(len(place), np.inf)
        for _ in range(24):  # steps of sphere tracing: a few tenths of a millimetre are left
            away = _head(place + HEAD)
            closer = away < least
            nearest[closer], least[closer] = place[closer, 2], away[closer]
            place[:, 2] -= 0.9 * way * np.maximum(away, 0.0)
        found.append(nearest.reshape(columns.shape))
    return np.array(found)


def _on_head(x: Floats, y: Floats, front: Bools) -> Floats:
    """(n, 3) places of the head's surface, from the neck's end, that are seen at x and y from ahead or behind."""
    depths, side = _depths(), front.astype(np.intp)
    column, row = (
        np.clip(each / _CELL, 0.0, most - 1.001) for each, most in zip((x, y), depths.shape[1:], strict=True)
    )
    i, j = column.astype(np.intp), row.astype(np.intp)
    s, t = column - i, row - j
    low = (1.0 - s) * depths[side, i, j] + s * depths[side, i + 1, j]
    high = (1.0 - s) * depths[side, i, j + 1] + s * depths[side, i + 1, j + 1]
    return np.column_stack([x, y, (1.0 - t) * low + t * high])


def _woven(colours: Floats, size: int, *, cloth: Bools) -> NDArray[np.uint8]:
    """Bytes of an image, with the small unevenness of yarn on cloth."""
    # A hash of the number of the thread's piece: random to the eye, the same on every machine, and soon compressed.
    row, column = np.divmod(np.arange(size * size, dtype=np.int64), size)
    number = column + (row + 5 * column) // _PIECE * size
    mixed = (number * 2654435761 + (number // size) * 40503) % 4294967296
    mixed = (mixed ^ (mixed >> 13)) * 1274126177 % 4294967296
    level = ((mixed >> 24) % 5 - 2).astype(np.float64)
    shade = 1.0 + np.where(cloth, 0.018, 0.006) * level
    rounded = np.clip(np.rint(colours * shade[:, None]), 0, 255).astype(np.uint8)
    return rounded.reshape(size, size, 3)


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Encode an image.

    Args:
        pixels: (rows, columns, 3), sRGB, the uppermost row first.

    Source: PNG specification, third edition, §5. Each row has the filter "up", which suits pictures of cloth.
    """
    rows, columns, _ = pixels.shape
    above = np.concatenate([np.zeros_like(pixels[:1]), pixels[:-1]])
    # Differences modulo 256, as bytes wrap.
    filtered = np.concatenate([np.full((rows, 1), 2, np.uint8), (pixels - above).reshape(rows, -1)], axis=1)
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(filtered.tobytes(), 9)),
        (b"IEND", b""),
    )
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )


def _with_face(mesh: Mesh) -> Mesh:
    """The mesh with texture coordinates of its own for the front of the head."""
    corners = mesh.positions[mesh.quads]
    face = (mesh.uvs[:, :, 0].max(axis=1) < 0.5) & (corners[:, :, 1].min(axis=1) > _FACE)
    uvs = mesh.uvs.copy()
    uvs[face] = np.array(_FACE_AT) + _FACE_SIZE * (corners[face, :, :2] - [0.0, _FACE])
    return replace(mesh, uvs=uvs)


def make_figure() -> Character:
    """The figure with its clips."""
    mesh = _with_face(surface(figure_field))
    return Character(
        name="figure",
        mesh=mesh,
        joints=tuple(Joint(name, parent, place) for name, (parent, place) in PLACES.items()),
        weights=skin_weights(mesh.positions, list(PLACES)),
        clips=(squat(), walk()),
        colour=(1.0, 1.0, 1.0),
        material="clothes and skin",
        roughness=0.85,
        image=base_colour(),
    )


def squat() -> Clip:
    """A squat with both arms raised before the chest, and back: a loop of 2.4 s."""
    times = np.arange(round(2.4 * KEYS) + 1) / KEYS
    down = smoothstep(0.1, 0.9, times) * smoothstep(2.2, 1.4, times)
    x = (1.0, 0.0, 0.0)
    thigh, shin = -62.0 * down, 84.0 * down
    fall = 0.42 * (_cosine(thigh) - 1.0) + 0.40 * (_cosine(shin + thigh) - 1.0)
    back = -0.42 * _sine(-thigh) + 0.40 * _sine(shin + thigh)
    moves = {
        "spine": turned(x, 22.0 * down),
        "chest": turned(x, 18.0 * down),
        "neck": turned(x, -16.0 * down),
        "head": turned(x, -12.0 * down),
    }
    for side, sign in (("L", 1.0), ("R", -1.0)):
        moves[f"thigh.{side}"], moves[f"shin.{side}"] = turned(x, thigh), turned(x, shin)
        moves[f"foot.{side}"] = turned(x, -shin - thigh)
        moves[f"upper_arm.{side}"] = turned((-0.743, -0.669 * sign, 0.0), 30.0 * down)
        moves[f"forearm.{side}"] = turned((-0.743, -0.669 * sign, 0.0), 92.0 * down)
    sink = np.stack([0.0 * times, fall, back], axis=1)
    return Clip("squat", times, moves, {"hips": sink})


def walk() -> Clip:
    """Two steps in place, in 1.2 s; a loop."""
    times = np.arange(round(1.2 * KEYS) + 1) / KEYS
    x = (1.0, 0.0, 0.0)
    moves = {}
    for side, shift in (("L", 0.0), ("R", 0.5)):
        phase = times / times[-1] + shift
        phase = phase - np.floor(phase)
        swing = _cosine(360.0 * phase)
        thigh = -4.0 - 24.0 * swing
        shin = 8.0 + 54.0 * smoothstep(0.42, 0.70, phase) * smoothstep(1.0, 0.70, phase)
        moves[f"thigh.{side}"], moves[f"shin.{side}"] = turned(x, thigh), turned(x, shin)
        moves[f"foot.{side}"] = turned(x, -0.6 * (shin + thigh))
        moves[f"upper_arm.{side}"] = _hanging(20.0 * swing, -24.0 if side == "L" else 24.0)
        elbow = (-0.743, -0.669 if side == "L" else 0.669, 0.0)
        moves[f"forearm.{side}"] = turned(elbow, 30.0 - 14.0 * swing)
    bob = -0.012 * (1.0 + _cosine(720.0 * times / times[-1]))
    return Clip("walk", times, moves, {"hips": bob[:, None] * [0.0, 1.0, 0.0]})


def _hanging(swing: Floats, lowered: float) -> Floats:
    """(keys, 4) quaternions of turns about z, then about x."""
    z, w = math.sin(math.radians(lowered) / 2.0), math.cos(math.radians(lowered) / 2.0)
    return np.array([[x * w, -x * z, y * z, y * w] for x, _, _, y in turned((1.0, 0.0, 0.0), swing).tolist()])


def _cosine(degrees: Floats) -> Floats:
    return np.array([math.cos(math.radians(each)) for each in degrees.tolist()])


def _sine(degrees: Floats) -> Floats:
    return np.array([math.sin(math.radians(each)) for each in degrees.tolist()])
