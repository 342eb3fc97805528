"""Morph targets and weight tracks, written into the document: sparse or dense targets, and channels that drive them.

Source: glTF 2.0 §3.7.2.2 (morph targets), §3.6.2.3 (sparse accessors), §3.11 (animation).
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wrinklecli.baking.extras import encode_extras
from wrinklecli.baking.plan import MeshPlan
from wrinklecli.baking.refined_mesh import (
    RefinedPrimitive,
    base_normals,
    base_tangents,
    drop_repeated,
    primitives_of,
    refine_primitive,
    shared_vertices,
)
from wrinklecli.baking.sample import Motion, skin_weights
from wrinklecli.baking.targets import Target, TargetSet, targets_of
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.rig import Rig, morph_target_names
from wrinklecli.character.weight_track import Track, pad, widen
from wrinklecli.gltf.edit import VERTEX_DATA, EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.method.refine import Refinement
from wrinklecli.method.shapes import Shape, turn_to
from wrinklecli.numeric.arrays import Floats, Ints, distinct_values


def encode_morphs(
    draft: EditedDocument,
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
    draft: EditedDocument,
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
    parts = primitives_of(fine, groups)
    drop_repeated(draft, mesh, parts)
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
            refine_primitive(draft, primitive, part, fine, where, written)
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


def own_mesh(draft: EditedDocument, node: Json, mesh: int) -> Json:
    """The mesh of a node, cloned first if other nodes show it too."""
    meshes = draft.gltf["meshes"]
    if sum(each.get("mesh") == mesh for each in draft.gltf["nodes"]) > 1:
        node["mesh"] = draft.clone_mesh(mesh)
    found: Json = meshes[node["mesh"]]
    return found


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


def _with_zeros(draft: EditedDocument, target: Json, count: int, names: Sequence[str], sparse: bool) -> Json:
    lacking = [name for name in names if name not in target]
    return target | {name: _zeros(draft, count, sparse=sparse, bounds=False) for name in lacking}


def _zeros(draft: EditedDocument, count: int, *, sparse: bool, bounds: bool) -> int:
    nothing = np.zeros((0, 3), np.float32)
    return draft.add_sparse(np.zeros(0, np.intp), nothing, count=count, bounds=bounds, stored=not sparse)


def _target_vectors(
    shape: Shape, part: RefinedPrimitive, smooth: Floats, base: Floats | None, along: Floats | None
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


def _add_vectors(
    draft: EditedDocument, indices: Ints, values: Floats, count: int, sparse: bool, *, bounds: bool
) -> int:
    stored = values.astype(np.float32)
    if sparse or not len(indices):
        return draft.add_sparse(indices, stored, count=count, bounds=bounds, stored=not sparse)
    dense = np.zeros((count, 3), np.float32)
    dense[indices] = stored
    return draft.add(dense, target=VERTEX_DATA, bounds=bounds)


def encode_track(draft: EditedDocument, clip: Clip, node: int, track: Track) -> None:
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
