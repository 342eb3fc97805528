"""Anchors: the two ends of a tool on the surface at rest, and where joints and morph targets take them.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on origin and target of a wrinkling tool.
Differs: they lie anywhere on the surface, where the paper takes vertices (`snap: vertex`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import morph_weights, node_rows
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.errors import BakeError
from wrinklecli.numeric.arrays import Floats, Ints, determinants, distinct_values, singular, unit
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import Marker, WrinkleTool, in_axes

# An anchor further from the mesh than this part of its segment is a mistake.
_ANCHOR_REACH = 0.25


@dataclass(frozen=True, slots=True)
class Anchor:
    """A point that the skin carries, as a weighted mean of points each of which one joint carries rigidly.

    Its world position is the sum over k of world(joints[k]) @ (points[0] + sum over m of w_m points[m])[k].

    Attributes:
        joints: (influences,) into the rig's joints.
        weights: (influences,) of its joints, summing to 1.
        points: (1 + morph targets, influences, 4) homogeneous points times their weights, in the joints' own
            spaces; the fourth number is the weight itself, 0 in morph deltas.
        vertices: (corners,) the welded vertices around it: three, two on an edge, one at a vertex.
        barycentrics: (corners,) their shares, summing to 1.
        triangles: The coarse triangles that the anchor lies on.
        position: (3,) at rest, world space.
        normal: (3,) of the surface there.
        distance: From the point asked for, scene units.
    """

    joints: Ints
    weights: Floats
    points: Floats
    vertices: Ints
    barycentrics: Floats
    triangles: Ints
    position: Floats
    normal: Floats
    distance: float


def anchor_at(
    tool: WrinkleTool, number: int, asked: Floats, *, surface: Surface, rest: Rest, rig: Rig, up: str
) -> Anchor:
    """The point of the surface that is nearest to one asked for.

    Args:
        tool: Whose anchor it is.
        number: Which of its points.
        asked: (points, 3) all of them as asked for, world space at rest.
        surface: The coarse mesh.
        rest: Its rest pose.
        rig: Its joints.
        up: Axis of the tools file, for messages.

    Raises:
        BakeError: The surface is too far from the point, or singular there.
    """
    point, segment = asked[number], segment_at(asked, number)
    triangle, barycentrics, place = rest.blocks.closest_point(point)
    if tool.snap == "vertex":
        used = distinct_values(surface.triangles)
        vertex = int(used[np.argmin(np.sum((rest.positions[used] - point) ** 2, axis=1))])
        vertices, barycentrics, place = np.array([vertex]), np.ones(1), rest.positions[vertex]
    else:
        vertices = surface.triangles[triangle][barycentrics > 0]
        barycentrics = barycentrics[barycentrics > 0]
    distance = float(np.linalg.norm(place - point))
    if is_far(distance, segment):
        hint = "" if isinstance(tool.points[number], Marker) else _other_axis(point, segment, rest, up)
        at = ", ".join(f"{x:.4g}" for x in in_axes(place.tolist(), up))
        raise BakeError(
            f"is {distance:.4g} from the mesh, more than a quarter of its segment of {segment:.4g};"
            f" the nearest point is [{at}]{hint}",
            where=tool.place_of(number),
        )
    if singular(rest.blended[vertices]).any():
        raise BakeError("the joints here are singular at rest", where=tool.place_of(number))
    around = rest.around.faces_of(vertices)
    on_all = np.isin(surface.triangles[around], vertices).sum(axis=1) >= len(distinct_values(vertices))
    joints, points = _joint_points(vertices, barycentrics, surface)
    return Anchor(
        joints=joints,
        weights=points[0, :, 3],
        points=np.einsum("kab,mkb->mka", rig.inverse_binds[joints], points),
        vertices=vertices,
        barycentrics=barycentrics,
        triangles=around[on_all],
        position=place,
        normal=unit(barycentrics @ rest.normals_at(vertices)),
        distance=distance,
    )


def segment_at(asked: Floats, number: int) -> float:
    """Distance of one of (points, 3) to its nearer neighbour, scene units."""
    neighbours = asked[[each for each in (number - 1, number + 1) if 0 <= each < len(asked)]]
    return min(float(np.linalg.norm(each - asked[number])) for each in neighbours)


def is_far(distance: float, segment: float) -> bool:
    """Whether a point is further from the mesh than an anchor of a segment may be, scene units."""
    return distance > _ANCHOR_REACH * segment


def _other_axis(point: Floats, segment: float, rest: Rest, up: str) -> str:
    """A hint where the point would lie on the mesh, had the file said the other up axis."""
    x, y, z = point
    other, turned = ("y", np.array([x, -z, y])) if up == "z" else ("z", np.array([x, z, -y]))
    found = rest.blocks.closest_point(turned)[2]
    near = np.linalg.norm(found - turned) <= _ANCHOR_REACH * segment
    return f"; with `up: {other}` it would lie on it" if near else ""


def _joint_points(vertices: Ints, barycentrics: Floats, surface: Surface) -> tuple[Ints, Floats]:
    """(influences,) joints that move a point, and (1 + morph targets, influences, 4) its share of each, bind space."""
    joints, inverse = np.unique(surface.joints[vertices], return_inverse=True)
    shares = barycentrics[:, None] * surface.weights[vertices]
    bind = np.concatenate([surface.positions[None, vertices], surface.morph_deltas[:, vertices]])
    homogeneous = np.zeros((*bind.shape[:2], 4))
    homogeneous[:, :, :3], homogeneous[0, :, 3] = bind, 1.0
    points = np.zeros((len(bind), len(joints), 4))
    for of_joints, corners in zip(points, homogeneous, strict=True):
        np.add.at(of_joints, inverse.reshape(shares.shape), shares[..., None] * corners[:, None])
    acting = points[0, :, 3] > 0
    return joints[acting], points[:, acting]


@dataclass(frozen=True, slots=True)
class AnchorPoses:
    """What moves the anchors of several tools, at a few times of a clip.

    Attributes:
        joints: (joints,) into the rig's, rising: those that move any of the anchors.
        rows: For each (3, 4, frames) of its world matrix; one frame where nothing moves it.
        scales: For each (frames,) the cube root of its determinant against rest; as many frames.
        weights: (frames, morph targets).
    """

    joints: Ints
    rows: Sequence[Floats]
    scales: Sequence[Floats]
    weights: Floats


def anchor_poses(joints: Ints, rig: Rig, rest: Rest, clip: Clip | None, times: Floats) -> AnchorPoses:
    """Pose (joints,) of a rig at (frames,) seconds; in the stored pose where there is no clip."""
    rows = node_rows(rig, clip, times, [int(rig.joints[joint]) for joint in joints])
    bound = np.abs(determinants(rig.inverse_binds[joints, :3, :3]))
    before = np.abs(determinants(rest.matrices[joints, :3, :3]))
    shares = bound / np.where(before > 0, before, 1.0)
    scales = [
        np.cbrt(share * np.abs(determinants(each[:, :3].transpose(2, 0, 1))))
        for each, share in zip(rows, shares, strict=True)
    ]
    return AnchorPoses(joints, rows, scales, morph_weights(rig, clip, times))


def posed_anchor(anchor: Anchor, poses: AnchorPoses, count: int) -> tuple[Floats, Floats]:
    """(3, frames) where `count` poses take an anchor, world space, and (frames,) how they scale it against rest."""
    acting = np.flatnonzero(anchor.points[1:].any(axis=(1, 2)))
    weights, points = poses.weights[:, acting], anchor.points[np.append(0, 1 + acting)]
    place, scale = np.zeros((3, count)), np.zeros(count)
    # What all joints that nothing moves make together: a point, and what each morph target adds to it.
    still = np.zeros((1 + len(acting), 3))
    numbers = np.searchsorted(poses.joints, anchor.joints)
    for number, weight, point in zip(numbers, anchor.weights, points.transpose(1, 0, 2), strict=True):
        rows = poses.rows[number]
        scale += weight * poses.scales[number]
        if rows.shape[2] == 1:
            still += np.einsum("mc,rc->mr", point, rows[:, :, 0])
            continue
        morphed = point[0, :, None]
        if len(acting):
            morphed = morphed + np.einsum("mc,fm->cf", point[1:], weights)
        for column in range(4):
            place += rows[:, column] * morphed[column]
    if len(acting):
        place += np.einsum("mr,fm->rf", still[1:], weights)
    place += still[0, :, None]
    return place, scale
