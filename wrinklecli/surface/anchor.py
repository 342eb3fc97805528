"""Anchors: points of the surface at rest that a tool is attached to, and the joints that carry them.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004, on origin and target of a wrinkling tool.
Differs: they lie anywhere on the surface, where the paper takes vertices (`snap: vertex`).
"""

import numpy as np

from wrinklecli.character.carried import CarriedPoint
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.choices import Snap
from wrinklecli.errors import BakeError
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, determinants, distinct_values, singular, unit
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import EffectTool, Marker, in_axes

# An anchor further from the mesh than this part of its segment is a mistake.
_ANCHOR_REACH = 0.25
LEAST_SPAN = 1e-9
"""Distance of two anchors over the mesh's size, or in a pose over that at rest, below which they are one point."""


@dataclass(frozen=True, slots=True)
class Anchor:
    """A point of the surface, and what carries it.

    Attributes:
        joints: (influences,) into the rig's joints.
        carried: The point, in the spaces of these joints.
        vertices: (corners,) the welded vertices around it: three, two on an edge, one at a vertex.
        barycentrics: (corners,) their shares, summing to 1.
        triangles: The coarse triangles that the anchor lies on.
        position: (3,) at rest, world space.
        normal: (3,) of the surface there.
        distance: From the point asked for, scene units.
    """

    joints: Ints
    carried: CarriedPoint
    vertices: Ints
    barycentrics: Floats
    triangles: Ints
    position: Floats
    normal: Floats
    distance: float


def anchor_at(
    tool: EffectTool,
    number: int,
    asked: Floats,
    *,
    surface: Surface,
    rest: Rest,
    rig: Rig,
    up: str,
    snap: Snap = "surface",
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
        snap: `vertex` takes the nearest vertex, as the paper does.

    Raises:
        BakeError: The surface is too far from the point, or singular there.
    """
    point, segment = asked[number], segment_at(asked, number)
    triangle, barycentrics, place = rest.closest_point(point)
    if snap == "vertex":
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
    bound = np.abs(determinants(rig.inverse_binds[joints, :3, :3]))
    before = np.abs(determinants(rest.matrices[joints, :3, :3]))
    return Anchor(
        joints=joints,
        carried=CarriedPoint(
            nodes=rig.joints[joints],
            weights=points[0, :, 3],
            points=np.einsum("kab,mkb->mka", rig.inverse_binds[joints], points),
            shares=bound / np.where(before > 0, before, 1.0),
        ),
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
    """True if a point is further from the mesh than an anchor of a segment may be, scene units."""
    return distance > _ANCHOR_REACH * segment


def _other_axis(point: Floats, segment: float, rest: Rest, up: str) -> str:
    """A hint where the point would lie on the mesh, had the file said the other up axis."""
    x, y, z = point
    other, turned = ("y", np.array([x, -z, y])) if up == "z" else ("z", np.array([x, z, -y]))
    found = rest.closest_point(turned)[2]
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
