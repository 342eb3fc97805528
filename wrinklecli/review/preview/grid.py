"""Draw a grid, a ruler, axes and the names of joints over a picture, to read coordinates off it.

Coordinates are those of a tools file: world space in scene units, with the file's up axis.
"""

import math
from collections.abc import Iterator
from itertools import product
from typing import get_args

import numpy as np

from wrinklecli.character.paints import Colour
from wrinklecli.character.pose import node_matrices
from wrinklecli.choices import Up
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.preview.camera import Camera
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.overlay import INK, RULE, Dot, Overlay, Placed, Stroke, Word
from wrinklecli.review.preview.shown import ShownAsset
from wrinklecli.tools.records import in_axes

# The axes x, y and z of a tools file as rows in glTF's axes, by the file's up axis.
_AXES = {up: np.array([in_axes(row, up) for row in np.eye(3).tolist()]).T for up in get_args(Up)}
_NAMES = "xyz"
# Colours of the x, y and z axes, sRGB.
_INKS: tuple[Colour, ...] = ((0.80, 0.16, 0.16), (0.16, 0.55, 0.16), (0.16, 0.33, 0.88))
# Colour of joints and their names, sRGB.
_BONE = (0.36, 0.12, 0.55)
# Half the greatest number of labels of a ruler.
_STEPS = 8
# Least distance between two labels, pixels.
_SPACE = 64
# Greatest number of steps on the longer side of a box's floor.
_FLOOR_STEPS = 6
# Number of parts into which ticks divide a step, by the step's first digit.
_PARTS = {1: 5, 2: 4, 5: 5}
# Length of a small tick, pixels.
_TICK = 5
# Depth of the grid in camera space: behind everything.
_DEEP = -1e3
# Widths of the line of coordinate 0, which is an axis, and of the others, pixels.
_AXIS_WIDTH = 1.3
_LINE_WIDTH = 0.9
# Greatest component by which a view direction may be off an axis and still be turned along it.
_SNAP = 0.005
# Relative error up to which numbers count as whole.
_ROUNDING = 1e-9


def draw_grid(asset: ShownAsset, moment: Moment, camera: Camera, size: tuple[int, int], *, up: str) -> Overlay:
    """A grid for a camera with parallel rays: rulers at the borders if it looks along an axis, else a ruled box.

    `size` is the picture's, in pixels; `up` is the up axis of the tools file.
    """
    across, upright = (_axis_along(camera.axes[k], up) for k in (0, 1))
    if across is not None and upright is not None:
        ruled = _ruled(camera, size, _AXES[up], 0, *across).joined(_ruled(camera, size, _AXES[up], 1, *upright))
    else:
        ruled = _boxed(asset, moment, camera, size, up)
    return ruled.joined(_joints(asset, moment))


def snapped(camera: Camera) -> Camera:
    """The camera with parallel rays, turned along an axis if it looks almost along it."""
    near = np.round(camera.axes)
    axes = near if np.abs(near - camera.axes).max() < _SNAP else camera.axes
    return Camera(camera.centre, axes, camera.reach, 0.0)


def ruler_step(span: float, count: int) -> float:
    """The least step of 1, 2 or 5 times a power of ten of which at most `count` fit into a span."""
    power = 10.0 ** math.floor(math.log10(span / count))
    return next(digit * power for digit in (1, 2, 5, 10) if digit * power * count >= span * (1 - _ROUNDING))


def _axis_along(direction: Floats, up: str) -> tuple[int, float] | None:
    """Number of the tools file's axis along which a direction points, and 1 or -1; None if it points along none."""
    along = _AXES[up] @ direction
    number = int(np.argmax(np.abs(along)))
    return (number, float(np.sign(along[number]))) if abs(along[number]) > 1 - _ROUNDING else None


def _ticks(low: float, high: float, step: float) -> Iterator[float]:
    """The multiples of a step from low to high."""
    first, last = math.ceil(low / step - _ROUNDING), math.floor(high / step + _ROUNDING)
    yield from (number * step for number in range(first, last + 1))


def _label(value: float, step: float) -> str:
    """A multiple of a step, with no more digits than the step needs."""
    digits = max(0, -math.floor(math.log10(step) + _ROUNDING))
    return f"{value + 0.0:.{digits}f}" if digits < 7 and abs(value) < 1e7 else f"{value:g}"


def _ruled(camera: Camera, size: tuple[int, int], axes: Floats, across: int, number: int, sign: float) -> Overlay:
    """Lines across the picture at even coordinates, with ticks and labels along one border.

    Args:
        camera: Looks along an axis.
        size: Width and height of the picture, pixels.
        axes: (3, 3) axes of the tools file, rows.
        across: 0 for the lower border, 1 for the left one.
        number: Number of the axis along that border.
        sign: -1 if that axis points left, or down.
    """
    width, height = size
    reach = camera.reach * (width / height if across == 0 else 1.0)
    middle = float(axes[number] @ camera.centre)
    step = ruler_step(2 * reach, max(min(size[across] // _SPACE, 2 * _STEPS), 2))
    pixels = height / 2 / camera.reach  # of a scene unit
    other = np.array((0.0, 0.0, _DEEP))
    strokes, labels = [], []

    def line(value: float, low: float, high: float, colour: Colour, weight: float, behind: float) -> Stroke:
        ends = np.tile(other, (2, 1))
        ends[:, across] = sign * (value - middle) / camera.reach
        ends[:, 1 - across] = (low, high)
        return Stroke(camera.centre + camera.reach * (ends @ camera.axes), colour, weight, behind)

    far = (1.0 if across == 0 else width / height) * 1.01
    tick = 2 * _TICK / height
    digit = round(step / 10 ** math.floor(math.log10(step) + _ROUNDING))
    for value in _ticks(middle - reach, middle + reach, step / _PARTS[digit]):
        strokes.append(line(value, -far, -far + tick, INK, 1.0, 1.0))
    # The line of coordinate 0 is the other axis.
    beside = next(k for k in range(3) if abs(axes[k] @ camera.axes[1 - across]) > 0.5)
    for value in _ticks(middle - reach, middle + reach, step):
        zero = abs(value) < step / 2
        colour, weight = (_INKS[beside], _AXIS_WIDTH) if zero else (RULE, _LINE_WIDTH)
        strokes.append(line(value, -far, far, colour, weight, 0.45))
        strokes.append(line(value, -far, -far + 2 * tick, INK, 1.2, 1.0))
        at = size[across] / 2 + (1, -1)[across] * sign * (value - middle) * pixels
        # Half a space beyond where the name of an axis may stand, at either end.
        if 0.75 * _SPACE < (at if across == 0 else height - at) < size[across] - 0.75 * _SPACE:
            labels.append(_beside(across, at, height, _label(value, step), INK))
    # At the end to which the axis points stands its name, and no number.
    end = size[across] - _SPACE / 4 if (sign > 0) == (across == 0) else _SPACE / 4
    labels.append(_beside(across, end, height, f"+{_NAMES[number]}", _INKS[number]))
    return Overlay(strokes, labels=labels)


def _beside(across: int, at: float, height: int, text: str, colour: Colour) -> Placed:
    """A label of the ruler at the lower border (`across` 0) or the left one."""
    if across == 0:
        return Placed((at, height - 2 * _TICK - 3), text, colour, "ms")
    return Placed((2 * _TICK + 4, at), text, colour, "lm")


def _boxed(asset: ShownAsset, moment: Moment, camera: Camera, size: tuple[int, int], up: str) -> Overlay:
    """The ruled floor of a box around the asset, with coordinates along two of its edges and one upright edge."""
    axes = _AXES[up]
    positions = np.concatenate([posed.positions[0] for _, posed in asset.posed(moment)]) @ axes.T
    low, high = positions.min(axis=0), positions.max(axis=0)
    upright = next(k for k in range(3) if axes[k, 1] > 0.5)
    first, second = (k for k in range(3) if k != upright)
    # The floor of an asset that is an upright line has no extent.
    widest = max(float((high - low)[[first, second]].max()), 1e-3 * camera.reach)
    step = ruler_step(widest, _FLOOR_STEPS)
    # The two edges begin at the corner of the floor that is nearest to the eye.
    eye = axes @ camera.axes[2]
    near = np.where(eye > 0, high, low)
    near[upright] = low[upright]
    strokes, words = [], []
    for along, across in ((first, second), (second, first)):
        for value in _ticks(low[along], high[along], step):
            ends = np.tile(near, (2, 1))
            ends[:, along] = value
            ends[:, across] = low[across], high[across]
            zero = abs(value) < step / 2
            colour, weight = (_INKS[across], _AXIS_WIDTH) if zero else (RULE, _LINE_WIDTH)
            strokes.append(Stroke(ends @ axes, colour, weight, 0.25))
            words.append(Word(np.where(np.arange(3) == along, value, near) @ axes, _label(value, step), _INKS[along]))
    post = near.copy()
    leftmost = min(
        product((low[first], high[first]), (low[second], high[second])),
        key=lambda corner: float((corner[0] * axes[first] + corner[1] * axes[second]) @ camera.axes[0]),
    )
    post[[first, second]] = leftmost
    ends = np.tile(post, (2, 1))
    ends[:, upright] = low[upright], high[upright]
    strokes.append(Stroke(ends @ axes, _INKS[upright], _AXIS_WIDTH, 0.25))
    for value in _ticks(low[upright], high[upright], ruler_step(2 * camera.reach, max(size[1] // _SPACE, 2))):
        place = np.where(np.arange(3) == upright, value, post) @ axes
        words.append(Word(place, f"{value:.6g}", _INKS[upright]))
    for k, corner in ((first, near), (second, near), (upright, post)):
        end = np.where(np.arange(3) == k, high[k] + 0.3 * step, corner)
        words.append(Word(end @ axes, f"+{_NAMES[k]}", _INKS[k]))
    return Overlay(strokes, words=words)


def _joints(asset: ShownAsset, moment: Moment) -> Overlay:
    """The joints of all skins with their names, and lines from each to its parent joint."""
    skinned = [shown.source.rig for shown in asset.primitives if shown.source.rig.skinned]
    nodes = sorted({int(joint) for rig in skinned for joint in rig.joints})
    if not nodes:
        return Overlay()
    rig = skinned[0]
    matrices = node_matrices(rig, asset.clip(moment.clip), np.array([moment.time]), nodes)[0]
    places = dict(zip(nodes, matrices[:, :3, 3], strict=True))
    strokes = []
    for node in nodes:
        parent = rig.next_above(node, places)
        if parent >= 0:
            strokes.append(Stroke(np.array([places[parent], places[node]]), _BONE, 1.3, 0.6))
    dots = [Dot(places[node], _BONE, 2.2) for node in nodes]
    # A prefix with a colon that all names share, as converters write it, is left out to save room.
    head, colon, _ = rig.names[nodes[0]].rpartition(":")
    shared = len(head + colon) if all(rig.names[node].startswith(head + colon) for node in nodes) else 0
    words = [Word(places[node], rig.names[node][shared:], _BONE) for node in nodes]
    return Overlay(strokes, dots, words)
