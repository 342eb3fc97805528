"""Compare skins of two documents: their joints, inverse bind matrices, and the weights of vertices."""

from collections.abc import Iterator, Mapping

import numpy as np

from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import dense_influences, read_primitive
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats
from wrinklecli.review.diff.difference import (
    Difference,
    Findings,
    Link,
    Place,
    Sides,
    differ,
    pairs_by_key,
)
from wrinklecli.review.diff.values import count_that_differ, decoded, dict_differences, gaps, unreadable_differences


def joint_pairs(sides: Sides, i: int, j: int) -> dict[int, int]:
    """Pair joint numbers of two skins; joints that are the same node several times are paired in their order."""
    first, second = (skin.get("joints", []) for skin in sides.items("skins", i, j))
    wanted = [sides.nodes.get(node, -1) for node in first]
    pairs = {number: number for number, both in enumerate(zip(wanted, second, strict=False)) if both[0] == both[1]}
    return pairs_by_key(dict(enumerate(wanted)), dict(enumerate(second)), pairs)


def skin_differences(sides: Sides, i: int, j: int) -> Findings:
    """Compare two skins by their joints, and the inverse bind matrices of these."""
    first, second = sides.items("skins", i, j)
    place, name = ("skins", i), first.get("name")
    joints_a, joints_b = first.get("joints", []), second.get("joints", [])
    pairs = joint_pairs(sides, i, j)
    complete = len(pairs) == len(joints_a) == len(joints_b)
    binds_a, binds_b = _inverse_binds(sides.a, first), _inverse_binds(sides.b, second)
    in_order = all(k == number for k, number in pairs.items())
    apart = [
        number
        for number, other in pairs.items()
        if gaps(binds_a[number], binds_b[other]).max() > sides.limits.slack(binds_a[number], lengths=True)
    ]
    if not sides.have_same_node(first.get("skeleton"), second.get("skeleton")):
        yield differ("structure", (*place, "skeleton"), "another node", name=name)
    skip = {"joints", "skeleton", "inverseBindMatrices"}
    yield from dict_differences(first, second, place, "skins", sides.limits, skip=skip)
    stored = first.get("inverseBindMatrices"), second.get("inverseBindMatrices")
    yield from unreadable_differences(sides, *stored, (*place, "inverseBindMatrices"), name=name)
    names_a, names_b = sides.names
    if not complete or (apart and not in_order):
        # The order of joints means nothing if each keeps its own matrix.
        for number in range(max(len(joints_a), len(joints_b))):
            shown = [
                repr(names[joints[number]]) if number < len(joints) else "none"
                for names, joints in ((names_a, joints_a), (names_b, joints_b))
            ]
            if pairs.get(number) != number:
                yield differ("structure", (*place, "joints", number), " -> ".join(shown), name=name)
    for number in apart:
        gap = gaps(binds_a[number], binds_b[pairs[number]]).max()
        message = f"the matrix of joint {names_a[joints_a[number]]!r} differs by up to {gap:.3g}"
        yield differ("geometry", (*place, "inverseBindMatrices", number), message, name=name)


def _inverse_binds(document: Document, skin: Json) -> Floats:
    """(joints, 4, 4) as stored, transposed; zeros for matrices that cannot be decoded."""
    count = len(skin.get("joints", []))
    if "inverseBindMatrices" not in skin:
        return np.tile(np.eye(4), (count, 1, 1))
    matrices = np.zeros((count, 4, 4))
    stored = decoded(document, skin["inverseBindMatrices"])
    if stored is not None and stored.shape[1:] == (16,):
        matrices[: len(stored)] = stored[:count].reshape(-1, 4, 4)
    return matrices


def influence_differences(sides: Sides, rig_a: Rig, rig_b: Rig, joints: Mapping[int, int]) -> Iterator[Difference]:
    """Compare the skin weights of two nodes' meshes, joint by joint; `joints` are the pairs of `joint_pairs`."""
    each_side = (sides.a, rig_a), (sides.b, rig_b)
    first, second = (document.items("meshes")[rig.mesh].get("primitives", []) for document, rig in each_side)
    names, _ = sides.names
    # Joints that only the second file has get columns of their own.
    columns = len(rig_a.joints)
    into = np.arange(columns, columns + len(rig_b.joints))
    into[list(joints.values())] = list(joints)
    total = columns + len(rig_b.joints)
    for number, pair in enumerate(zip(first, second, strict=False)):
        one, other = (
            read_primitive(document, primitive, rig, document.where("meshes", rig.mesh, "primitives", number))
            for primitive, (document, rig) in zip(pair, each_side, strict=True)
        )
        if len(one.positions) != len(other.positions):
            continue
        apart = np.abs(
            dense_influences(one.joints, one.weights, total)
            - dense_influences(into[other.joints], other.weights, total)
        )
        off = (apart > sides.limits.ratio).any(axis=1)
        if off.any():
            vertex, column = np.unravel_index(int(apart.argmax()), apart.shape)
            joint = f" of joint {names[int(rig_a.joints[column])]!r}" if column < columns else ""
            message = f"vertex {vertex}: the weight{joint} differs by {apart[vertex, column]:.3g}"
            message += count_that_differ(int(off.sum()), len(one.positions))
            place = ("meshes", rig_a.mesh, "primitives", number, "attributes", "WEIGHTS_0")
            yield differ("geometry", place, message, name=names[rig_a.node])


def stored_influences(sides: Sides, i: int, j: int) -> Iterator[Link]:
    """Links to the accessors of the joints and weights of two meshes."""
    first, second = (mesh.get("primitives", []) for mesh in sides.items("meshes", i, j))
    for number, (one, other) in enumerate(zip(first, second, strict=False)):
        attributes_a, attributes_b = one.get("attributes", {}), other.get("attributes", {})
        for key in attributes_a:
            if key.startswith(("JOINTS_", "WEIGHTS_")) and key in attributes_b:
                place: Place = ("meshes", i, "primitives", number, "attributes", key)
                yield Link("accessors", attributes_a[key], attributes_b[key], place)
