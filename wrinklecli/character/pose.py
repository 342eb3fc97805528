"""Poses of a mesh over time: node hierarchy, clips, joint matrices, morph weights, linear blend skinning.

An unskinned mesh is treated as skinned to its own node with weight 1, so that all later stages know one case.

Source: glTF 2.0 specification, §3.5 (nodes), §3.7.3 (skins), §3.11 and appendix C (animation).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import Document, Json
from wrinklecli.numeric.arrays import Floats, Ints

# Of nodes, one below the other, and of joints in a skin: time and memory grow with them, and nothing real has as many.
_MOST_LEVELS = 4096
_MOST_JOINTS = 4096

# Of a transform: no real one comes near, and products of a dozen of these are still numbers.
MOST = 1e15

_DEFAULTS = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}


@dataclass(frozen=True, slots=True)
class Channel:
    """One animated property.

    Attributes:
        index: Of the channel in its animation.
        node: The animated node.
        path: translation, rotation, scale or weights.
        times: (keys,) seconds, strictly rising.
        values: (keys, components), or (keys, 3, components) for CUBICSPLINE: in-tangent, value, out-tangent.
        interpolation: LINEAR, STEP or CUBICSPLINE.
    """

    index: int
    node: int
    path: str
    times: Floats
    values: Floats
    interpolation: str


@dataclass(frozen=True, slots=True)
class Clip:
    """An animation: the channels that move nodes and morph weights.

    Attributes:
        index: Of the animation in the document.
        name: Its name; `animation_0` by index where it has none.
        channels: Those with a node and a core path.
        start: Time of the first key, seconds.
        end: Time of the last key, seconds.
    """

    index: int
    name: str
    channels: tuple[Channel, ...]
    start: float
    end: float

    def key_times(self) -> Floats:
        """(keys,) the rising, distinct key times of all channels, seconds."""
        return np.unique(np.concatenate([channel.times for channel in self.channels]))

    def moves_as(self, other: "Clip") -> bool:
        """Whether another clip has the same keys to the bit, by the same numbers of nodes; names may differ."""
        if len(self.channels) != len(other.channels):
            return False
        return all(
            (a.node, a.path, a.interpolation) == (b.node, b.path, b.interpolation)
            and np.array_equal(a.times, b.times)
            and np.array_equal(a.values, b.values)
            for a, b in zip(self.channels, other.channels, strict=True)
        )

    def channel(self, node: int, path: str) -> Channel | None:
        """The channel of a node's property."""
        return next((c for c in self.channels if c.node == node and c.path == path), None)


@dataclass(frozen=True, slots=True)
class Rig:
    """What moves the mesh of one node.

    Attributes:
        node: The node that carries the mesh.
        mesh: Its mesh.
        skinned: Whether the node has a skin.
        joints: (joints,) nodes; the mesh's own node where there is no skin.
        inverse_binds: (joints, 4, 4) bind space to joint space.
        parents: (nodes,) each node's parent, -1 for roots.
        locals: Per node: stored translation, rotation (x, y, z, w) and scale, or the stored 4×4 matrix.
        rows: (3, 4, nodes) of the stored poses' local matrices.
        names: Per node.
        morph_names: Per morph target, from the mesh's `extras.targetNames`.
        morph_weights: (morph targets,) stored weights, those of the node before those of the mesh.
    """

    node: int
    mesh: int
    skinned: bool
    joints: Ints
    inverse_binds: Floats
    parents: Ints
    locals: tuple[dict[str, Floats], ...]
    rows: Floats
    names: tuple[str, ...]
    morph_names: tuple[str, ...]
    morph_weights: Floats


def read_clips(document: Document) -> tuple[Clip, ...]:
    """The document's animations, those without any readable channel left out.

    Two animations of one name are told apart by `#` and their index.

    Raises:
        AssetError: A sampler is malformed.
    """
    clips: list[Clip] = []
    for index, animation in enumerate(document.items("animations")):
        where = document.where("animations", index)
        channels = tuple(_read_channels(document, animation, index, where))
        if not channels:
            continue
        name = animation.get("name")
        name = name if isinstance(name, str) and name else f"animation_{index}"
        if any(clip.name == name for clip in clips):
            name = f"{name}#{index}"
        start = min(float(channel.times[0]) for channel in channels)
        end = max(float(channel.times[-1]) for channel in channels)
        clips.append(Clip(index, name, channels, start, end))
    return tuple(clips)


def _read_channels(document: Document, animation: Json, index: int, where: str) -> Iterable[Channel]:
    samplers = animation.get("samplers", [])
    for number, channel in enumerate(animation.get("channels", [])):
        target = channel.get("target", {}) if isinstance(channel, dict) else {}
        node, path = target.get("node"), target.get("path")
        if node is None or path not in (*_DEFAULTS, "weights"):
            continue
        document.item("nodes", node, user=where)
        at = document.where("animations", index, "channels", number)
        try:
            sampler = samplers[channel["sampler"]]
            times, values = (document.accessor(sampler[key], user=at) for key in ("input", "output"))
            interpolation = sampler.get("interpolation", "LINEAR")
        except (KeyError, IndexError, TypeError) as error:
            raise AssetError("has no sampler with input and output", where=at) from error
        if interpolation not in ("LINEAR", "STEP", "CUBICSPLINE"):
            raise AssetError(f"interpolation {interpolation!r} is not of glTF 2.0", where=at)
        groups = 3 if interpolation == "CUBICSPLINE" else 1
        if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0).any():
            raise AssetError("key times must rise", where=at)
        if values.size == 0 or values.size % (len(times) * groups):
            raise AssetError(f"{len(times)} key times do not fit {values.size} values", where=at)
        if not in_range(values):
            raise AssetError(f"a key value is not a finite number, or above {MOST:g}", where=at)
        shape = (len(times), 3, -1) if groups == 3 else (len(times), -1)
        values = values.reshape(shape)
        wanted = len(_DEFAULTS[path]) if path != "weights" else _target_count(document, node)
        if values.shape[-1] != wanted:
            raise AssetError(f"a key of {path} has {values.shape[-1]} numbers, not {wanted}", where=at)
        yield Channel(number, node, path, times, values.astype(np.float64), interpolation)


def _target_count(document: Document, node: int) -> int:
    carrier = document.items("nodes")[node]
    if "mesh" not in carrier:
        return 0
    mesh = document.item("meshes", carrier["mesh"], user=document.where("nodes", node))
    return len(morph_target_names(mesh))


def read_rig(document: Document, node: int) -> Rig:
    """The joints, hierarchy and stored pose that move the mesh of a node.

    Raises:
        AssetError: The hierarchy has a cycle, or skin or nodes are malformed.
    """
    nodes = document.items("nodes")
    parents = np.full(len(nodes), -1, np.intp)
    for index, each in enumerate(nodes):
        for child in each.get("children", []):
            document.item("nodes", child, user=document.where("nodes", index, "children"))
            parents[child] = index
    _refuse_cycles(parents, document)
    carrier = nodes[node]
    mesh = document.item("meshes", carrier.get("mesh"), user=document.where("nodes", node))
    joints, inverse_binds = np.array([node], np.intp), np.eye(4)[None]
    if "skin" in carrier:
        joints, inverse_binds = _read_skin(document, carrier["skin"], document.where("nodes", node))
    primitives = mesh.get("primitives") or [{}]
    count = len(primitives[0].get("targets", []))
    weights = np.zeros(count)
    try:
        stored = np.array(carrier.get("weights", mesh.get("weights", [])), np.float64).reshape(-1)[:count]
        weights[: len(stored)] = stored
        locals_ = tuple(_stored_local(each) for each in nodes)
    except (TypeError, ValueError) as error:
        raise AssetError("a node's transform or weights are not numbers", where=document.where("nodes")) from error
    for index, parts in enumerate(locals_):
        if not all(in_range(part) for part in parts.values()):
            message = f"is moved by a number that is not finite, or above {MOST:g}"
            raise AssetError(message, where=document.where("nodes", index))
    names = tuple(str(each.get("name", f"node_{index}")) for index, each in enumerate(nodes))
    return Rig(
        node=node,
        mesh=carrier["mesh"],
        skinned="skin" in carrier,
        joints=joints,
        inverse_binds=inverse_binds,
        parents=parents,
        locals=locals_,
        rows=_stored_rows(locals_),
        names=names,
        morph_names=tuple(morph_target_names(mesh)),
        morph_weights=weights,
    )


def morph_target_names(mesh: Json) -> list[str]:
    """A name for each morph target of a mesh: that of `extras.targetNames`, else `target_0` by index."""
    extras = mesh.get("extras")
    names = extras.get("targetNames") if isinstance(extras, dict) else None
    names = names if isinstance(names, list) else []
    count = len((mesh.get("primitives") or [{}])[0].get("targets", []))
    return [str(names[k]) if k < len(names) else f"target_{k}" for k in range(count)]


def _refuse_cycles(parents: Ints, document: Document) -> None:
    above, depths = parents.copy(), (parents >= 0).astype(np.intp)
    # Each round doubles the generations that are looked up: a chain of 100,000 nodes takes 17.
    for _ in range(len(parents).bit_length()):
        depths = depths + np.where(above >= 0, depths[above], 0)
        above = np.where(above >= 0, above[above], -1)
    if (above >= 0).any():
        raise AssetError("is its own ancestor", where=document.where("nodes", int(above.argmax())))
    if depths.max(initial=0) >= _MOST_LEVELS:
        raise AssetError(
            f"lies {depths.max()} levels deep; at most {_MOST_LEVELS} are read",
            where=document.where("nodes", int(depths.argmax())),
        )


def _read_skin(document: Document, index: object, user: str) -> tuple[Ints, Floats]:
    skin = document.item("skins", index, user=user)
    where = document.where("skins", str(index))
    joints = skin.get("joints", [])
    for joint in joints:
        document.item("nodes", joint, user=where)
    if not joints:
        raise AssetError("has no joints", where=where)
    if len(joints) > _MOST_JOINTS:
        raise AssetError(f"has {len(joints)} joints; at most {_MOST_JOINTS} are read", where=where)
    if "inverseBindMatrices" not in skin:
        return np.array(joints, np.intp), np.tile(np.eye(4), (len(joints), 1, 1))
    stored = document.accessor(skin["inverseBindMatrices"], user=where)
    if stored.shape[1:] != (16,) or len(stored) < len(joints):
        raise AssetError(f"needs {len(joints)} inverse bind matrices, has {len(stored)}", where=where)
    if not in_range(stored[: len(joints)]):
        accessor = document.where("accessors", str(skin["inverseBindMatrices"]))
        raise AssetError(
            f"holds inverse bind matrices with a number that is not finite, or above {MOST:g}", where=accessor
        )
    # glTF stores matrices column by column.
    return np.array(joints, np.intp), stored[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)


def in_range(values: Floats) -> bool:
    """Whether all numbers are finite and no larger than `MOST`."""
    with np.errstate(invalid="ignore"):
        return bool((np.abs(values) <= MOST).all())


def _stored_local(node: Json) -> dict[str, Floats]:
    if "matrix" in node:
        return {"matrix": np.array(node["matrix"], np.float64).reshape(4, 4).T}
    local = {}
    for path, default in _DEFAULTS.items():
        value = np.array(node.get(path, default), np.float64)
        if value.shape != (len(default),) or not np.isfinite(value).all():
            raise ValueError(path)
        local[path] = value
    return local


def _stored_rows(local: Sequence[dict[str, Floats]]) -> Floats:
    """(3, 4, nodes) of the nodes' local matrices."""
    rows = np.zeros((3, 4, len(local)))
    free = [index for index, parts in enumerate(local) if "matrix" not in parts]
    if free:
        translations, rotations, scales = (np.array([local[index][path] for index in free]) for path in _DEFAULTS)
        rows[:, :, free] = _rows(translations.T, _normalised(rotations.T), scales.T)
    for index, parts in enumerate(local):
        if "matrix" in parts:
            rows[:, :, index] = parts["matrix"][:3]
    return rows


def joint_matrices(rig: Rig, clip: Clip | None, times: Floats, joints: Ints | None = None) -> Floats:
    """Matrices that take bind positions to world space.

    Args:
        rig: Of the mesh.
        clip: The animation; none for the stored pose.
        times: (frames,) seconds; before the first and after the last key a channel holds.
        joints: Which of the rig's joints; all where left out.

    Returns:
        (frames, joints, 4, 4).

    Source: glTF 2.0 §3.7.3.1; a skinned node's own transform is ignored (§3.7.3.3).
    """
    chosen = np.arange(len(rig.joints)) if joints is None else joints
    globals_ = node_matrices(rig, clip, times, [int(rig.joints[joint]) for joint in chosen])
    matrices: Floats = np.matmul(globals_, rig.inverse_binds[chosen])
    return matrices


def node_matrices(rig: Rig, clip: Clip | None, times: Floats, nodes: Iterable[int]) -> Floats:
    """(frames, nodes, 4, 4) world matrices of nodes; only their ancestors are evaluated."""
    found = node_rows(rig, clip, times, nodes)
    matrices = np.zeros((len(times), len(found), 4, 4))
    for index, rows in enumerate(found):
        matrices[:, index, :3] = rows.transpose(2, 0, 1)
    matrices[:, :, 3, 3] = 1.0
    return matrices


def node_rows(rig: Rig, clip: Clip | None, times: Floats, nodes: Iterable[int]) -> list[Floats]:
    """The first three rows of nodes' world matrices over time; only their ancestors are evaluated.

    Products of 4×4 matrices one by one take five times as long as these, which run along time.

    Returns:
        For each node (3, 4, frames), or (3, 4, 1) where nothing moves it.
    """
    known: dict[int, Floats] = {}
    channels = {(channel.node, channel.path): channel for channel in (clip.channels if clip else ())}

    def world(node: int) -> Floats:
        chain = []
        while node >= 0 and node not in known:
            chain.append(node)
            node = int(rig.parents[node])
        matrix = known.get(node)
        for each in reversed(chain):
            local = _local_rows(rig, channels, times, each)
            matrix = local if matrix is None else _composed(matrix, local)
            known[each] = matrix
        assert matrix is not None
        return matrix

    return [world(node) for node in nodes]


def _composed(outer: Floats, inner: Floats) -> Floats:
    """(3, 4, frames) product of affine matrices."""
    product: Floats = outer[:, 0, None] * inner[0]
    product = product + outer[:, 1, None] * inner[1]
    product += outer[:, 2, None] * inner[2]
    product[:, 3] += outer[:, 3]
    return product


def _local_rows(rig: Rig, channels: dict[tuple[int, str], Channel], times: Floats, node: int) -> Floats:
    """(3, 4, frames), or (3, 4, 1) where no channel, by node and path, moves the node."""
    stored = rig.locals[node]
    moved = [path for path in _DEFAULTS if (node, path) in channels and path in stored]
    if not moved:
        return rig.rows[:, :, node, None]
    parts = {path: value[:, None] for path, value in stored.items()}
    parts["rotation"] = _normalised(stored["rotation"])[:, None]
    return _rows(*(sample(channels[node, path], times).T if path in moved else parts[path] for path in _DEFAULTS))


def _rows(translations: Floats, rotations: Floats, scales: Floats) -> Floats:
    """(3, 4, frames) of (components, frames), rotations of unit length; any may have one frame for all."""
    x, y, z, w = rotations
    sx, sy, sz = scales
    (xx, xy, xz), (yy, yz, zz), (xw, yw, zw) = (x * x, x * y, x * z), (y * y, y * z, z * z), (x * w, y * w, z * w)
    rows = (
        ((1 - 2 * (yy + zz)) * sx, 2 * (xy - zw) * sy, 2 * (xz + yw) * sz),
        (2 * (xy + zw) * sx, (1 - 2 * (xx + zz)) * sy, 2 * (yz - xw) * sz),
        (2 * (xz - yw) * sx, 2 * (yz + xw) * sy, (1 - 2 * (xx + yy)) * sz),
    )
    matrices = np.zeros((3, 4, max(each.shape[1] for each in (translations, rotations, scales))))
    for row, translation, into in zip(rows, translations, matrices, strict=True):
        into[0], into[1], into[2], into[3] = *row, translation
    return matrices


def morph_weights(rig: Rig, clip: Clip | None, times: Floats) -> Floats:
    """(frames, morph targets) weights: those of the clip's channel, else the stored ones."""
    channel = clip.channel(rig.node, "weights") if clip else None
    if channel is None:
        return np.tile(rig.morph_weights, (len(times), 1))
    return sample(channel, times)


def sample(channel: Channel, times: Floats) -> Floats:
    """(frames, components) of a channel at times in seconds, held before the first and after the last key.

    Rotations are of unit length.

    Source: glTF 2.0, appendix C (LINEAR, with slerp for rotations; STEP; CUBICSPLINE).
    """
    keys, values = channel.times, channel.values
    # Components first, so that all that follows runs along time.
    points = (values[:, 1] if channel.interpolation == "CUBICSPLINE" else values).T
    turning = channel.path == "rotation"
    if len(keys) == 1:
        return np.tile((_normalised(points) if turning else points).T, (len(times), 1))
    before = np.clip(np.searchsorted(keys, times, side="right") - 1, 0, len(keys) - 2)
    # Of a long clip, at a few times, only the keys around them.
    part = slice(int(before.min(initial=len(keys) - 2)), int(before.max(initial=0)) + 2)
    keys, values, points, before = keys[part], values[part], points[:, part], before - part.start
    if turning and channel.interpolation != "CUBICSPLINE":
        points = _normalised(points)
    spans = np.diff(keys)
    t = np.clip((times - _at(keys, before)) / _at(spans, before), 0.0, 1.0)
    if channel.interpolation == "STEP":
        return _at(points, before + (t >= 1.0)).T
    if channel.interpolation == "CUBICSPLINE":
        leaving, arriving = values[:-1, 2].T * spans, values[1:, 0].T * spans
        start, stop = points[:, :-1], points[:, 1:]
        # Horner's scheme, with the polynomial of each interval prepared.
        squares = -3 * start + 3 * stop - 2 * leaving - arriving
        cubes = 2 * start - 2 * stop + leaving + arriving
        blended = ((_at(cubes, before) * t + _at(squares, before)) * t + _at(leaving, before)) * t + _at(start, before)
        return (_normalised(blended) if turning else blended).T
    if turning:
        return _slerp(points, before, t).T
    return (_at(points, before) + _at(np.diff(points), before) * t).T


def _at(values: Floats, places: Ints) -> Floats:
    """(…, frames) of (…, keys). Clipped, since what has to be able to fail takes longer, and indexing longer still."""
    return values.take(places, axis=-1, mode="clip")


def _slerp(points: Floats, before: Ints, t: Floats) -> Floats:
    """(4, frames) rotations at shares t (frames,) of the intervals `before` (frames,) between (4, keys) unit ones."""
    start, stop = points[:, :-1], points[:, 1:]
    cosine = np.einsum("cf,cf->f", start, stop)
    stop = np.where(cosine < 0, -stop, stop)
    # Halves of sum and difference: the arc cosine of the product loses half the digits of a small angle.
    angle = 2.0 * np.arctan2(*(np.sqrt(np.einsum("cf,cf->f", each, each)) for each in (stop - start, stop + start)))
    sine = np.sin(angle)
    # Below this angle the division loses more digits than a straight line does.
    near = sine < 1e-6
    inverse = np.where(near, 0.0, 1.0 / np.where(near, 1.0, sine))
    whole, inverse = _at(angle, before), _at(inverse, before)
    turned = t * whole
    first, second = np.sin(whole - turned) * inverse, np.sin(turned) * inverse
    if near.any():
        straight = _at(near, before)
        first, second = np.where(straight, 1.0 - t, first), np.where(straight, t, second)
    between: Floats = first * _at(start, before) + second * _at(stop, before)
    return _normalised(between) if near.any() else between


def _normalised(quaternions: Floats) -> Floats:
    """(4, …) of unit length; no turn where all are 0."""
    lengths = np.sqrt(np.einsum("c...,c...->...", quaternions, quaternions))
    unturned = np.array([0.0, 0.0, 0.0, 1.0]).reshape(4, *[1] * (quaternions.ndim - 1))
    return np.where(lengths > 0, quaternions / np.where(lengths > 0, lengths, 1.0), unturned)


def blend(weights: Floats, matrices: Floats) -> Floats:
    """Blended matrices of linear blend skinning.

    Args:
        weights: (vertices, joints), rows summing to 1.
        matrices: (frames, joints, 4, 4) bind to world.

    Returns:
        (frames, vertices, 3, 4).
    """
    frames, joints = matrices.shape[:2]
    rows = matrices[:, :, :3, :].reshape(frames, joints, 12)
    blended: Floats = np.matmul(weights, rows)
    return blended.reshape(frames, len(weights), 3, 4)


def transform(blended: Floats, positions: Floats) -> Floats:
    """Move bind positions by blended matrices.

    Args:
        blended: (frames, vertices, 3, 4).
        positions: (vertices, 3), or (frames, vertices, 3) where morph targets act, bind space.

    Returns:
        (frames, vertices, 3) world space, scene units.
    """
    turned: Floats = (
        np.einsum("fvab,...vb->fva", blended[..., :3], positions)
        if positions.ndim == 2
        else (np.einsum("fvab,fvb->fva", blended[..., :3], positions))
    )
    return turned + blended[..., 3]
