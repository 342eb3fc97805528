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
from wrinklecli.tools.records import EffectTool, Marker, in_words

# An anchor further from the mesh than this part of its segment is a mistake.
_ANCHOR_REACH = 0.25
# Distance of a tool's middle from the mesh, over the tool's size, beyond which the point is meant for something else.
_FAR = 0.5
# Parts of a body, by their names in messages.
_PARTS = {"half": 0.5, "a quarter": 0.25}
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
        most = f"a quarter of its segment of {segment:.4g}"
        raise BakeError(_off_the_mesh(distance, most, place, up) + hint, where=tool.place_of(number))
    if singular(rest.blended[vertices]).any():
        raise BakeError("the joints here are singular at rest", where=tool.place_of(number))
    around = rest.around.faces_of(vertices)
    on_all = np.isin(surface.triangles[around], vertices).sum(axis=1) >= len(distinct_values(vertices))
    joints, points = _joint_points(vertices, barycentrics, surface)
    return Anchor(
        joints=joints,
        carried=carried_by_joints(rig, rest, joints, points),
        vertices=vertices,
        barycentrics=barycentrics,
        triangles=around[on_all],
        position=place,
        normal=unit(barycentrics @ rest.normals_at(vertices)),
        distance=distance,
    )


def carried_by_joints(rig: Rig, rest: Rest, joints: Ints, points: Floats) -> CarriedPoint:
    """The point of which (joints,) joints carry (1 + morph targets, joints, 4) shares, which are in bind space."""
    bound = np.abs(determinants(rig.inverse_binds[joints, :3, :3]))
    before = np.abs(determinants(rest.matrices[joints, :3, :3]))
    return CarriedPoint(
        nodes=rig.joints[joints],
        weights=points[0, :, 3],
        points=np.einsum("kab,mkb->mka", rig.inverse_binds[joints], points),
        shares=bound / np.where(before > 0, before, 1.0),
    )


def foot_of(tool: EffectTool, number: int, asked: Floats, rest: Rest, size: tuple[str, float], up: str) -> Floats:
    """(3,) the point of the surface that is nearest to a (3,) point asked for, for a tool of some size.

    Args:
        tool: Whose point it is.
        number: Which of its points.
        asked: (3,) as asked for, world space at rest.
        rest: The rest pose.
        size: The tool's key that says how wide it is, and that width, scene units.
        up: Axis of the tools file, for messages.

    Raises:
        BakeError: The surface is farther from the point than half of the size.
    """
    key, width = size
    place, _ = rest.foot(asked)
    distance = float(np.linalg.norm(place - asked))
    if distance > _FAR * width:
        most = f"half of its {key} of {width:.4g}"
        raise BakeError(_off_the_mesh(distance, most, place, up), where=tool.place_of(number))
    return place


def check_size(tool: EffectTool, size: tuple[str, float], rest: Rest, part: str) -> None:
    """Refuse a size, as in `foot_of`, that is more than a part of the body: `half` or `a quarter`.

    Raises:
        BakeError: It is.
    """
    (key, width), whole = size, float(np.ptp(rest.positions, axis=0).max())
    if width > _PARTS[part] * whole:
        raise BakeError(
            f"is {width:.4g}, larger than the body allows: it measures {whole:.4g} from end to end, and a {key} may be"
            f" {part} of that",
            where=tool.place(key),
        )


def _off_the_mesh(distance: float, most: str, place: Floats, up: str) -> str:
    """The fault of a point that is too far from the mesh, whose nearest point is a (3,) place."""
    return f"is {distance:.4g} from the mesh, more than {most}; the nearest point is {in_words(place.tolist(), up)}"


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
