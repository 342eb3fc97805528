"""Refined meshes, shapes and weights into a draft document, as sparse morph targets and weight tracks.

Source: glTF 2.0 §3.7.2.2 (morph targets), §3.6.2.3 (sparse accessors), §3.11 (animation).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.sample import Motion, skin_weights
from wrinklecli.baking.targets import Target, TargetSet, targets_of
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.rig import Rig, morph_target_names
from wrinklecli.character.weight_track import Track, pad, widen
from wrinklecli.errors import AssetError
from wrinklecli.gltf.document import TRIANGLES, Document
from wrinklecli.gltf.draco import EXTENSION
from wrinklecli.gltf.shape import Json
from wrinklecli.gltf.writer import INDEX_DATA, VERTEX_DATA, Draft, index_type, used_joints
from wrinklecli.method.lookup import tabulate_curve, tabulate_weights
from wrinklecli.method.patch import Anchor, Patch
from wrinklecli.method.refine import Refinement
from wrinklecli.method.shapes import Shape, turn_to
from wrinklecli.numeric.arrays import Array, Floats, Ints, distinct_values, unit
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph

# Raised only when the geometry that the same asset and tools give changes.
METHOD = 1

# Decimal digits of numbers in extras: float32's own.
_DIGITS = 8
_VECTORS = ("POSITION", "NORMAL", "TANGENT")
# Decimal digits of tabulated weights, whose rows are right to about three.
_TABLE_DIGITS = 5


@dataclass(frozen=True, slots=True)
class Part:
    """The vertices of one primitive after refinement.

    Attributes:
        index: Of the primitive.
        group: The first primitive that reads the same vertices; the new ones are those of the whole group.
        old: (old vertices,) glTF vertices of the surface, in file order.
        new: (new vertices,) into the refinement's new glTF vertices.
        sources: (new vertices, 3) vertices of this primitive that each is mixed from.
        shares: (new vertices, 3).
        weld: (vertices,) fine welded vertex of each, old ones first.
        triangles: (triangles, 3) of this primitive, local vertices.
        changed: Whether any triangle was split.
    """

    index: int
    group: int
    old: Ints
    new: Ints
    sources: Ints
    shares: Floats
    weld: Ints
    triangles: Ints
    changed: bool

    def mix(self, values: Floats) -> Floats:
        """(new vertices, …) of (old vertices, …) values."""
        mixed: Floats = np.einsum("vk,vk...->v...", self.shares, values[self.sources])
        return mixed

    def mix_tangents(self, tangents: Floats) -> Floats:
        """(new vertices, 4) of (old vertices, 4): the fourth number is a handedness, which cannot be mixed."""
        return np.concatenate([unit(self.mix(tangents[:, :3])), tangents[self.heaviest(), 3:]], axis=1)

    def heaviest(self) -> Ints:
        """(new vertices,) the old vertex that each is nearest to; the first among equals."""
        nearest: Ints = self.sources[np.arange(len(self.sources)), np.argmax(self.shares, axis=1)]
        return nearest


def shared_vertices(source: Document, mesh: int, fine: Refinement) -> list[int]:
    """For each primitive of a mesh the first that reads the same vertices, as exporters write them for materials."""
    starts = fine.surface.vertex_starts
    firsts: dict[Any, int] = {}
    groups = []
    for index, primitive in enumerate(source.items("meshes")[mesh]["primitives"]):
        key: Any = primitive["attributes"]["POSITION"], fine.weld[starts[index] : starts[index + 1]].tobytes()
        if primitive.get("mode", TRIANGLES) < TRIANGLES or EXTENSION in primitive.get("extensions", {}):
            key = index  # more points would show; each Draco stream has vertices of its own
        groups.append(firsts.setdefault(key, index))
    return groups


def parts_of(fine: Refinement, groups: Sequence[int] | None = None) -> list[Part]:
    """The vertices of each primitive after refinement; `groups` from `shared_vertices`, or each by itself."""
    starts = fine.surface.vertex_starts
    old_count = int(starts[-1])
    owners = np.arange(len(starts) - 1) if groups is None else np.array(groups)
    parts = []
    for index, group in enumerate(owners):
        old = np.arange(starts[index], starts[index + 1])
        new = np.flatnonzero(owners[fine.primitives] == group)
        local = np.zeros(old_count + len(fine.primitives), np.intp)
        local[old] = np.arange(len(old))
        local[old_count + new] = len(old) + np.arange(len(new))
        faces = fine.triangle_primitives == index
        parts.append(
            Part(
                index=index,
                group=int(group),
                old=old,
                new=new,
                # Shares of 0 may have any source.
                sources=np.where(fine.shares[new] != 0, fine.sources[new] - starts[fine.primitives[new], None], 0),
                shares=fine.shares[new],
                weld=np.concatenate([fine.weld[old], fine.weld[old_count + new]]),
                triangles=local[fine.corners[faces]],
                changed=int(faces.sum()) != int((fine.surface.primitives == index).sum()),
            )
        )
    return parts


def encode_morphs(
    draft: Draft,
    plan: MeshPlan,
    target_sets: list[TargetSet],
    motions: Sequence[Motion],
    *,
    sparse: bool,
    tangents: bool = False,
) -> None:
    """Put meshes, targets, tracks and extras into the draft."""
    rig = plan.rig
    targets = targets_of(target_sets)
    # In the stored pose nothing is wrinkled, unless the tools file names another pose as rest.
    known = np.zeros(len(targets))
    if all(each.from_skin for each in target_sets):
        stored = [
            each.written(each.shape_weights(skin_weights(plan, each.carried, None, np.zeros(1))))
            for each in target_sets
        ]
        known = np.concatenate(stored, axis=1)[0]
    groups = shared_vertices(draft.source, rig.mesh, plan.fine)
    encode_mesh(draft, rig, plan.fine, targets, sparse=sparse, stored=known, tangents=tangents, groups=groups)
    encode_extras(draft, plan, target_sets)
    baked = {motion.clip.index for motion in motions}
    for clip in read_clips(draft.source):
        channel = clip.channel(rig.node, "weights")
        if channel is not None and clip.index not in baked:
            # A channel drives all targets of its mesh, so a clip that is not baked is widened too.
            encode_track(draft, clip, rig.node, pad(channel, known))
    # Without a target, as where no vertex lies under a bump, a track would have no values.
    for motion in motions if targets else ():
        channel = motion.clip.channel(rig.node, "weights")
        times, weights = motion.times[motion.keys], motion.weights[motion.keys]
        encode_track(draft, motion.clip, rig.node, widen(channel, rig, motion.clip, times, weights))


def encode_mesh(
    draft: Draft,
    rig: Rig,
    fine: Refinement,
    targets: Sequence[Target],
    *,
    sparse: bool,
    stored: Floats,
    tangents: bool = False,
    groups: Sequence[int] | None = None,
) -> None:
    """Write the refined primitives and the new morph targets of a node's mesh.

    Only this node changes: a mesh that others show too is cloned. Every primitive gets every target; those
    that it leaves alone share one accessor of zeros. A base without NORMAL gets no NORMAL targets: glTF
    prescribes flat normals there, and ignores tangents. Old targets without NORMAL get one of zeros, which
    means the same, as three.js otherwise adds the base normal in its place; so do those without TANGENT.

    Args:
        draft: The document.
        rig: Of the node.
        fine: Its refined surface.
        targets: The new morph targets.
        sparse: Write targets as sparse accessors.
        stored: (targets,) weights in the stored pose.
        tangents: Write TANGENT targets where the base has TANGENT.
        groups: From `shared_vertices`: primitives that go on sharing vertices. Those that no tool touches too:
            a vertex more in their accessors does not show, where accessors of their own would be a copy.
    """
    node = draft.gltf["nodes"][rig.node]
    mesh = own_mesh(draft, node, rig.mesh)
    names = morph_target_names(mesh) + [target.name for target in targets]
    source = draft.source
    parts = parts_of(fine, groups)
    _drop_repeated(draft, mesh, parts)
    written: dict[Any, int] = {}
    touched = distinct_values(np.concatenate([np.zeros(0, np.intp), *(each.shape.normal_vertices for each in targets)]))
    smooth = np.zeros(fine.positions.shape)
    smooth[touched] = fine.normals_at(touched)
    for part in parts:
        primitive = mesh["primitives"][part.index]
        where = source.where("meshes", rig.mesh, "primitives", part.index)
        old_targets = primitive.get("targets", [])
        base = base_normals(source, primitive, part)
        along = base_tangents(source, primitive, part) if tangents and base is not None else None
        turned = [name for name, has in (("NORMAL", base), ("TANGENT", along)) if has is not None]
        frame = (part.group, *(primitive["attributes"].get(name) for name in ("NORMAL", "TANGENT")))
        if len(part.new):
            _refine_primitive(draft, primitive, part, fine, where, written)
        draft.unpack(primitive)
        if not targets:
            continue
        added: list[Json] = []
        for number, each in enumerate(targets):
            vectors = _target_vectors(each.shape, part, smooth, base, along)
            added.append({})
            for name, (rows, values) in vectors.items():
                key = ("added", number, name, part.group if name == "POSITION" else frame)
                if key not in written:
                    written[key] = _add_vectors(draft, rows, values, len(part.weld), sparse, bounds=name == "POSITION")
                added[-1][name] = written[key]
        primitive["targets"] = [
            _with_zeros(draft, each, len(part.weld), turned, sparse) for each in old_targets
        ] + added
    if not targets:
        return
    if isinstance(mesh.setdefault("extras", {}), dict):
        mesh["extras"]["targetNames"] = names
    old_count = len(names) - len(targets)
    if "weights" in mesh:
        mesh["weights"] = mesh["weights"][:old_count] + [0.0] * len(targets)
    if "weights" in node or stored.any():
        node["weights"] = [float(each) for each in rig.morph_weights] + [float(np.float32(each)) for each in stored]


def own_mesh(draft: Draft, node: Json, mesh: int) -> Json:
    """The mesh of a node, cloned first if other nodes show it too."""
    meshes = draft.gltf["meshes"]
    if sum(each.get("mesh") == mesh for each in draft.gltf["nodes"]) > 1:
        node["mesh"] = draft.clone_mesh(mesh)
    found: Json = meshes[node["mesh"]]
    return found


def base_normals(source: Document, primitive: Json, part: Part) -> Floats | None:
    """(vertices, 3) unit NORMALs of a primitive, those of new vertices mixed; None where it has none."""
    if "NORMAL" not in primitive.get("attributes", {}):
        return None
    old = unit(source.accessor(primitive["attributes"]["NORMAL"]))
    return np.concatenate([old, unit(part.mix(old))])


def base_tangents(source: Document, primitive: Json, part: Part) -> Floats | None:
    """(vertices, 3) TANGENTs of a primitive without their handedness; None where it has none."""
    if "TANGENT" not in primitive.get("attributes", {}):
        return None
    old = source.accessor(primitive["attributes"]["TANGENT"])
    return np.concatenate([old, part.mix_tangents(old)])[:, :3]


def tangent_deltas(tangents: Floats, normals: Floats, normal_deltas: Floats) -> Floats:
    """What to add to tangents at weight 1 for them to stay in a surface whose normals turn.

    Where a surface rises by h along its normal N, its tangent T becomes T + (∂h/∂T) N, and NORMAL deltas, which
    lie across N, are -∇h: so ΔT = -(T · ΔN) N. With T across N, T + Σ wΔT lies across N + Σ wΔN exactly, at
    all weights of all tools, and points to where the texture goes.

    Args:
        tangents: (vertices, 3) unit.
        normals: (vertices, 3) unit.
        normal_deltas: (vertices, 3) at weight 1.

    Returns:
        (vertices, 3). Source: glTF 2.0 §3.7.2.2: TANGENT displacements are VEC3, handedness stays.
    """
    deltas: Floats = -np.sum(tangents * normal_deltas, axis=1, keepdims=True) * normals
    return deltas


def _vertex_accessors(primitive: Json, part: Part) -> Iterator[tuple[Any, int]]:
    """Every accessor that refinement replaces, with what it has in common with those of equal content after it."""
    for name, index in primitive["attributes"].items():
        yield ("attribute", part.group, name, index), index
    for number, target in enumerate(primitive.get("targets", [])):
        for name, index in target.items():
            yield ("target", part.group, number, name, index), index


def _drop_repeated(draft: Draft, mesh: Json, parts: Sequence[Part]) -> None:
    """Drop all references but the first to accessors whose successors several primitives will share."""
    seen: set[Any] = set()
    for part in parts:
        for key, index in _vertex_accessors(mesh["primitives"][part.index], part) if len(part.new) else ():
            if key in seen:
                draft.drop(index)
            seen.add(key)


def _refine_primitive(
    draft: Draft, primitive: Json, part: Part, fine: Refinement, where: str, written: dict[Any, int]
) -> None:
    """Replace a primitive's attributes, old targets and indices by refined ones; `written` are those there already."""
    attributes = primitive["attributes"]
    original = dict(attributes)
    for name, index in original.items():
        key = ("attribute", part.group, name, index)
        if key not in written:
            values, normalized = _refined_attribute(draft, original, name, part, fine, where)
            written[key] = draft.add(
                values, target=VERTEX_DATA, normalized=normalized, bounds=name == "POSITION", replaces=index
            )
        attributes[name] = written[key]
    for number, target in enumerate(primitive.get("targets", [])):
        for name, index in target.items():
            bounds = name == "POSITION"
            target_key = ("target", part.group, number, name, index)
            if target_key in written:
                target[name] = written[target_key]
                continue
            old = old_values(draft.source, name, index, part, where, sizes=dict.fromkeys(_VECTORS, 3))
            new = fine.morph_deltas[number, part.weld[len(part.old) :]] if name == "POSITION" else part.mix(old)
            values = np.concatenate([old, new]).astype(np.float32)
            if "sparse" in draft.source.items("accessors")[index]:
                changed = np.flatnonzero(values.any(axis=1))
                target[name] = draft.add_sparse(
                    changed, values[changed], count=len(values), bounds=bounds, replaces=index
                )
            else:
                target[name] = draft.add(values, target=VERTEX_DATA, bounds=bounds, replaces=index)
            written[target_key] = target[name]
    if not part.changed and "indices" in primitive:
        return
    if primitive.get("mode", TRIANGLES) != TRIANGLES:
        del primitive["mode"]
    indices = part.triangles.reshape(-1).astype(index_type(len(part.weld)))
    primitive["indices"] = draft.add(indices, target=INDEX_DATA, replaces=primitive.get("indices"))


def old_values(source: Document, name: str, index: int, part: Part, where: str, *, sizes: dict[str, int]) -> Array:
    """The stored values of an attribute or a morph target, one for each old vertex.

    Raises:
        AssetError: There are more or fewer, or they have not the components that `sizes` says.
    """
    old = source.accessor(index, user=where)
    if len(old) != len(part.old):
        raise AssetError(f"{name} has {len(old)} elements for {len(part.old)} vertices", where=where)
    if name in sizes and old.shape[1:] != (sizes[name],):
        raise AssetError(f"{name} must have {sizes[name]} numbers for each vertex", where=where)
    return old


def _refined_attribute(
    draft: Draft, attributes: Json, name: str, part: Part, fine: Refinement, where: str
) -> tuple[Array, bool]:
    """Stored values of an attribute with those of new vertices appended, and whether they are normalised."""
    source, index = draft.source, attributes[name]
    old = old_values(source, name, index, part, where, sizes={"POSITION": 3, "NORMAL": 3, "TANGENT": 4})
    accessor = source.items("accessors")[index]
    new_vertices = part.weld[len(part.old) :]
    if name == "POSITION":
        return np.concatenate([old, fine.positions[new_vertices]]).astype(np.float32), False
    if name == "NORMAL":
        return np.concatenate([old, unit(part.mix(old))]).astype(np.float32), False
    if name == "TANGENT":
        return np.concatenate([old, part.mix_tangents(old)]).astype(np.float32), False
    kind, _, number = name.partition("_")
    if kind in ("JOINTS", "WEIGHTS") and number.isdecimal() and len(number) < 4 and old.shape[1:] == (4,):
        rows = new_vertices - len(fine.surface.positions)
        pruned = fine.joints_pruned if kind == "JOINTS" else fine.weights_pruned
        new = pruned[rows, 4 * int(number) : 4 * int(number) + 4]
        if kind == "JOINTS" and f"WEIGHTS_{number}" in attributes:
            old = used_joints(old, source.accessor(attributes[f"WEIGHTS_{number}"]), name)
        # Of sets that other primitives lack, new vertices use none.
        values = np.concatenate([old, np.pad(new, ((0, 0), (0, 4 - new.shape[1])))])
        return values.astype(_smallest_joint_type(old, values) if kind == "JOINTS" else np.float32), False
    stored = source.stored_dtype(index)
    if stored.kind == "f":
        return np.concatenate([old, part.mix(old)]).astype(np.float32), False
    if accessor.get("normalized"):
        limit = np.iinfo(stored).max
        return np.rint(np.concatenate([old, part.mix(old)]) * limit).astype(stored), True
    if kind == "TEXCOORD":  # KHR_mesh_quantization
        return np.rint(np.concatenate([old, part.mix(old)])).astype(stored), False
    # Plain integers are names of something (feature ids): nothing lies between two of them.
    return np.concatenate([old, old[part.heaviest()]]).astype(stored), False


def _smallest_joint_type(old: Array, new: Array) -> np.dtype[Any]:
    most = max(int(old.max(initial=0)), int(new.max(initial=0)))
    return np.dtype("<u1") if most < 256 and old.dtype.itemsize == 1 else np.dtype("<u2")


def _with_zeros(draft: Draft, target: Json, count: int, names: Sequence[str], sparse: bool) -> Json:
    lacking = [name for name in names if name not in target]
    return target | {name: _zeros(draft, count, sparse=sparse, bounds=False) for name in lacking}


def _zeros(draft: Draft, count: int, *, sparse: bool, bounds: bool) -> int:
    nothing = np.zeros((0, 3), np.float32)
    return draft.add_sparse(np.zeros(0, np.intp), nothing, count=count, bounds=bounds, stored=not sparse)


def _target_vectors(
    shape: Shape, part: Part, smooth: Floats, base: Floats | None, along: Floats | None
) -> dict[str, tuple[Ints, Floats]]:
    """One morph target on one primitive: the vertices that each attribute changes at, and by how much.

    NORMAL and TANGENT are there where there are normals `base` and tangents `along`; `smooth` are those of the welded
    surface, (fine vertices, 3).
    """
    rows = _rows(shape.vertices, len(smooth))[part.weld]
    moved = np.flatnonzero(rows >= 0)
    vectors = {"POSITION": (moved, shape.deltas[rows[moved]])}
    if base is not None:
        rows = _rows(shape.normal_vertices, len(smooth))[part.weld]
        turned = np.flatnonzero(rows >= 0)
        deltas = turn_to(smooth[part.weld[turned]], base[turned], shape.normal_deltas[rows[turned]])
        vectors["NORMAL"] = turned, deltas
        if along is not None:
            vectors["TANGENT"] = turned, tangent_deltas(along[turned], base[turned], deltas)
    return vectors


def _rows(vertices: Ints, count: int) -> Ints:
    """(count,) where each vertex is in a list of them, -1 where it is not."""
    rows = np.full(count, -1, np.intp)
    rows[vertices] = np.arange(len(vertices))
    return rows


def _add_vectors(draft: Draft, indices: Ints, values: Floats, count: int, sparse: bool, *, bounds: bool) -> int:
    stored = values.astype(np.float32)
    if sparse or not len(indices):
        return draft.add_sparse(indices, stored, count=count, bounds=bounds, stored=not sparse)
    dense = np.zeros((count, 3), np.float32)
    dense[indices] = stored
    return draft.add(dense, target=VERTEX_DATA, bounds=bounds)


def encode_track(draft: Draft, clip: Clip, node: int, track: Track) -> None:
    """Write a weights channel into a clip, in place of the one that the node had there."""
    animation = draft.gltf["animations"][clip.index]
    channel = clip.channel(node, "weights")
    old_sampler = None
    if channel is not None:
        entry = animation["channels"][channel.index]
        users = sum(each.get("sampler") == entry["sampler"] for each in animation["channels"])
        old_sampler = entry["sampler"] if users == 1 else None
    sampler = animation["samplers"][old_sampler] if old_sampler is not None else {}
    times = track.times.astype(np.float32)
    sampler = dict(sampler)
    sampler["input"] = draft.add(times, bounds=True, replaces=sampler.get("input"))
    sampler["interpolation"] = track.interpolation
    sampler["output"] = draft.add(track.values.astype(np.float32).reshape(-1), replaces=sampler.get("output"))
    if old_sampler is not None:
        animation["samplers"][old_sampler] = sampler
        return
    animation["samplers"].append(sampler)
    number = len(animation["samplers"]) - 1
    if channel is not None:
        animation["channels"][channel.index]["sampler"] = number
    else:
        animation["channels"].append({"sampler": number, "target": {"node": node, "path": "weights"}})


def encode_extras(draft: Draft, plan: MeshPlan, target_sets: Sequence[TargetSet]) -> None:
    """Write the tools into the node's extras, enough to play wrinkles for a clip that was never baked.

    An engine poses both anchors (the sum over joints of weight · matrix · position, where the matrix is the joint's
    own, to world space: optimisers that quantise positions change bind space and inverse bind matrices, but not
    the joints), takes the animated scale out (divides by the mean over anchors of the sum over joints of weight ·
    cbrt(det matrix) / scale), and finds the targets' `weights` at 1 - distance / rest_length, straight between
    the rows of `shortenings`, times the clip's factor in `strengths`, if it is there. Where the rest length changes,
    `curve` takes the place of these rows: see `CurveTable`. `vertices` counts those of
    each primitive before refinement; new ones follow them. `undriven` are targets of tools that anchors alone do not
    drive.
    """
    rig = plan.rig
    node = draft.gltf["nodes"][rig.node]
    if not isinstance(node.setdefault("extras", {}), dict):
        return
    undriven = [
        target.name for target in targets_of(target_set for target_set in target_sets if not target_set.from_skin)
    ]
    node["extras"]["wrinkle"] = {
        "method": METHOD,
        "tools": [
            {
                "name": patch.tool.name,
                "origin": _anchor_json(patch.origin, plan),
                "target": _anchor_json(patch.target, plan),
                "rest_length": _digits(patch.rest_length),
                **_driven_json(patch),
                **_strengths_json(patch),
                "targets": [target.name for target in targets_of([target_set])],
                **(_table_json(target_set) if _is_constant(patch) else _curve_json(target_set)),
            }
            for target_set in target_sets
            if target_set.from_skin
            for patch in (target_set.carried.patch,)
        ],
        **({"undriven": undriven} if undriven else {}),
    }


def _is_constant(patch: Patch) -> bool:
    return not isinstance(patch.tool.rest_length, RestLengthKeys | RestLengthMorph)


def _driven_json(patch: Patch) -> Json:
    """What drives the rest length, where it is not constant; lengths in scene units, times in seconds."""
    wanted = patch.tool.rest_length
    if isinstance(wanted, RestLengthMorph):
        return {"rest_length_morph": {"name": wanted.morph, "full": _digits(wanted.full.resolve(patch.span))}}
    if isinstance(wanted, RestLengthKeys):
        keys = {
            clip: [[_digits(time), _digits(length.resolve(patch.span))] for time, length in keys]
            for clip, keys in wanted.keys.items()
        }
        return {"rest_length_keys": keys}
    return {}


def _strengths_json(patch: Patch) -> Json:
    """Factors on the weights in the clips where the tool has a strength of its own."""
    factors = {name: _digits(strength / patch.shape_strength) for name, strength in patch.tool.clips.items()}
    return {"strengths": factors} if factors else {}


def _table_json(target_set: TargetSet) -> Json:
    rows, weights = tabulate_weights(
        target_set.carried.patch.curve, lambda each: target_set.written(target_set.shape_weights(each))
    )
    return {
        "shortenings": [_digits(value) for value in rows],
        "weights": [[_digits(value, _TABLE_DIGITS) for value in row] for row in weights],
    }


def _curve_json(target_set: TargetSet) -> Json:
    """The control curve for all rest lengths that keys or a morph target give it."""
    patch = target_set.carried.patch
    wanted = patch.tool.rest_length
    lengths = [patch.span]
    if isinstance(wanted, RestLengthMorph):
        lengths.append(wanted.full.resolve(patch.span))
    if isinstance(wanted, RestLengthKeys):
        lengths += [length.resolve(patch.span) for keys in wanted.keys.values() for _, length in keys]
    remix = target_set.remix
    mix = np.eye(patch.curve.greatest_amplitudes.size) if remix is None else remix.signed_mix
    positive = remix is not None and bool(remix.split)
    table = tabulate_curve(patch.curve, min(lengths), max(lengths), mix=target_set.written(mix).T, positive=positive)
    limited = {"distances": table.distances, "capacities": table.capacities} if len(table.distances) else {}
    return {
        "curve": {
            "taut": table.taut,
            "intervals": table.intervals,
            "bumps": list(table.bumps),
            **{key: [_digits(value) for value in values] for key, values in limited.items()},
            "parts": [_digits(value) for value in table.parts],
            "rises": [[_digits(value) for value in row] for row in table.rises],
            "mix": [[_digits(value) for value in row] for row in table.mix],
            **({"positive": True} if table.positive else {}),
            **({"least": _digits(remix.least)} if remix is not None and remix.least else {}),
        }
    }


def _anchor_json(anchor: Anchor, plan: MeshPlan) -> Json:
    """An anchor in the spaces of its joints; `scales` are those of the joints at rest."""
    rig = plan.rig
    points = anchor.points[..., :3] / anchor.weights[:, None]
    binds, rest = rig.inverse_binds[anchor.joints, :3, :3], plan.rest.matrices[anchor.joints, :3, :3]
    before, bound = np.abs(np.linalg.det(rest)), np.abs(np.linalg.det(binds))
    scales = np.cbrt(np.where((before > 0) & (bound > 0), before, 1.0) / np.where(bound > 0, bound, 1.0))
    anchored: Json = {
        "joints": [rig.names[int(rig.joints[joint])] for joint in anchor.joints],
        "weights": [_digits(weight) for weight in anchor.weights],
        "positions": [[_digits(x) for x in point] for point in points[0]],
        "scales": [_digits(scale) for scale in scales],
    }
    if points[1:].any():
        anchored["morphs"] = {
            name: [[_digits(x) for x in point] for point in deltas]
            for name, deltas in zip(rig.morph_names, points[1:], strict=True)
            if deltas.any()
        }
    return anchored


def _digits(value: float, digits: int = _DIGITS) -> float:
    return float(f"{value:.{digits}g}")
