"""The skin of a neck, and the turn of the head that folds it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from wrinklecli.character.bones import read_bones
from wrinklecli.character.clip import Clip
from wrinklecli.character.motion import motion_clip, turning
from wrinklecli.character.pose import node_matrices
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, face_normals, unit, unit_quaternions
from wrinklecli.review.suggest.face_parts import Face, cropped, read_skin
from wrinklecli.review.suggest.measure import ground_of
from wrinklecli.surface.sites import spread_sites
from wrinklecli.surface.strain import principal, strain

# Degrees by which neck and head turn together, each joint by as much: most people reach 70°.
_TURN = 60.0
# Least loss of a triangle that the turn folds.
_LEAST_LOSS = 0.05
# Least cosine of the normal of neck skin and where the face looks: the nape is under hair.
_IN_FRONT = -0.3


def read_neck(document: Document, nodes: Mapping[int, str | None], face: Face) -> tuple[Face, tuple[Clip, Clip]] | None:
    """Find the skin that folds where a head turns, in the frame of its face, and the turns to the left and the right.

    Returns:
        The face with the neck's skin in place of its own; None if no joint turns the head, or nothing folds.
    """
    best: tuple[float, Face, tuple[Clip, Clip]] | None = None
    for node, name in nodes.items():
        rig = read_rig(document, node)
        turns = _turns(document, rig, face.up)
        gauge = None if turns is None else read_skin(document, rig)
        if turns is None or gauge is None:
            continue
        crosses = gauge.rest.way * face_normals(gauge.rest.positions, gauge.triangles)
        normals = unit(crosses)
        losses, _ = principal(strain(gauge, turns[0], np.array([1.0]))[0], normals)
        folded = (losses > _LEAST_LOSS) & (normals @ face.ahead > _IN_FRONT)
        area = float(np.sqrt(np.sum(crosses[folded] ** 2, axis=1)).sum())
        if area > 0 and (best is None or area > best[0]):
            skin = cropped(gauge, folded)
            mesh = replace(face.mesh, ground=ground_of(document, skin), sites=spread_sites(skin), node=name)
            best = area, replace(face, mesh=mesh, targets=(), moved={}), turns
    return None if best is None else best[1:]


def _turns(document: Document, rig: Rig, up: Floats) -> tuple[Clip, Clip] | None:
    """The turns of neck and head to the left and to the right about a (3,) axis; None if no joint turns them."""
    parts = read_bones(document).parts
    joints = [
        node
        for node in sorted({int(joint) for joint in rig.joints})
        if parts[node] in ("neck", "head") and "rotation" in rig.locals[node]
    ]
    if not joints:
        return None
    name = " + ".join(rig.names[node] for node in joints)
    angle = np.radians(_TURN) / len(joints)

    def turned(sign: float, side: str) -> Clip:
        channels = []
        for node in joints:
            parent = int(rig.parents[node])
            linear = node_matrices(rig, None, np.zeros(1), [parent])[0, 0, :3, :3] if parent >= 0 else np.eye(3)
            axis = unit(np.linalg.pinv(linear) @ up)
            channels.append(turning(node, unit_quaternions(rig.locals[node]["rotation"]), axis, sign * angle))
        return motion_clip(f"{name} turned {side}", channels)

    return turned(1.0, "left"), turned(-1.0, "right")
