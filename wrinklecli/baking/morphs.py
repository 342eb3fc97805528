"""Encoding of morph targets, and of the weight tracks that drive them.

Source: glTF 2.0 §3.7.2.2 (morph targets), §3.6.2.3 (sparse accessors), §3.11 (animation).
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from wrinklecli.baking.extras import JointNames, encode_extras
from wrinklecli.baking.refined_mesh import (
    Key,
    RefinedPrimitive,
    Written,
    base_normals,
    base_tangents,
    drop_repeated,
    primitives_of,
    refine_primitive,
    shared_vertices,
)
from wrinklecli.character.clip import Clip, read_clips
from wrinklecli.character.rig import Rig, morph_target_names
from wrinklecli.character.weight_track import Track, pad, widen
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, Target, target_weights, targets_of
from wrinklecli.effects.shapes import Shape, turn_to
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import (
    channels_of,
    drop_channels,
    forget_pointers,
    has_target_names,
    moves_weights,
    pointer_of,
    without_pointer,
)
from wrinklecli.gltf.document import stored_bytes
from wrinklecli.gltf.edited_document import EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, ValueIndex, distinct_values
from wrinklecli.numeric.memory import once
from wrinklecli.surface.refine import Refinement


@dataclass(frozen=True, slots=True)
class _Base:
    """The vectors of one primitive that morph targets turn.

    Attributes:
        normals: (vertices, 3) unit; None if targets get no NORMAL.
        tangents: (vertices, 3) unit; None if targets get no TANGENT.
        key: Equal for primitives that share vertices, normals and tangents.
    """

    normals: Floats | None
    tangents: Floats | None
    key: Key

    @property
    def names(self) -> list[str]:
        """The attributes that targets turn."""
        return [name for name, has in (("NORMAL", self.normals), ("TANGENT", self.tangents)) if has is not None]


def encode_morphs(
    edited: EditedDocument,
    plan: MeshPlan,
    effects: Sequence[Effect],
    motions: Sequence[Motion],
    *,
    tangents: bool = False,
    draft: bool = False,
    idle: bool = False,
) -> JointNames:
    """Put the mesh, targets, extras, and tracks for motions into the edited document.

    With `tangents`, a base that has TANGENT gets targets of it. With `draft`, the extras say that the bake is a draft.
    With `idle`, the mesh stays as it is, and its targets do nothing: something else takes their weights.

    Returns:
        The names by which players find the joints of the drives.
    """
    targets, rig = targets_of(effects), plan.rig.own
    stored = np.concatenate([np.zeros(0), *(each.stored_weights(plan.rig) for each in effects)])
    if idle:
        node = edited.gltf["nodes"][rig.node]
        names = [*rig.morph_names, *(each.name for each in targets)]
        add_idle_targets(edited, node, names, rig.morph_names)
        _store_weights(node, rig, stored)
    else:
        groups = shared_vertices(edited.source, rig.mesh, plan.fine)
        encode_mesh(edited, rig, plan.fine, targets, stored=stored, tangents=tangents, groups=groups)
    joint_names = encode_extras(edited, plan, effects, draft=draft)
    _encode_tracks(edited, rig, motions, stored)
    return joint_names


def _encode_tracks(edited: EditedDocument, rig: Rig, motions: Sequence[Motion], stored: Floats) -> None:
    """Write weight tracks of all morph targets, old and new; a clip that is not baked keeps stored weights."""
    baked = {motion.clip.index for motion in motions}
    for clip in read_clips(edited.source):
        channel = clip.channel(rig.node, "weights")
        if channel is not None and clip.index not in baked:
            # A channel drives all targets of its mesh, so a clip that is not baked is widened too.
            encode_track(edited, clip, rig.node, pad(channel, stored))
    # Without a target, such as when no vertex lies under a bump, a track would have no values.
    for motion in motions if len(stored) else ():
        channel = motion.clip.channel(rig.node, "weights")
        times, weights = motion.times[motion.keys], target_weights(motion)[motion.keys]
        encode_track(edited, motion.clip, rig.node, widen(channel, rig, motion.clip, times, weights))
    _widen_idle_pointers(edited, rig, len(stored))
    forget_pointers(edited.gltf)


def _widen_idle_pointers(edited: EditedDocument, rig: Rig, count: int) -> None:
    """Give so many zeros to the channels that go on naming the mesh: its node has weights of its own, which count."""
    pointer, source = f"/meshes/{edited.gltf['nodes'][rig.node]['mesh']}/weights", edited.source
    for animation, channel in channels_of(edited.gltf):
        if pointer_of(channel) == pointer:
            old = animation["samplers"][channel["sampler"]]
            values = source.stored(old["output"]).reshape(-1, len(rig.morph_names))
            widened = edited.add_like(old["output"], np.pad(values, ((0, 0), (0, count))).reshape(-1))
            channel["sampler"] = len(animation["samplers"])
            animation["samplers"].append(old | {"output": widened})


def encode_mesh(
    edited: EditedDocument,
    rig: Rig,
    fine: Refinement,
    targets: Sequence[Target],
    *,
    stored: Floats,
    tangents: bool = False,
    groups: Sequence[int] | None = None,
) -> None:
    """Write the refined primitives and the new morph targets of a node's mesh.

    Only this node changes: a mesh that other nodes show too is cloned. Every primitive gets every target; targets that
    do not move it share one accessor of zeros. A base without NORMAL gets no NORMAL targets, since glTF prescribes flat
    normals there and ignores tangents. Old targets without NORMAL get zeros, which mean the same, as three.js otherwise
    adds the base normal in its place; so do those without TANGENT.

    Args:
        edited: The document.
        rig: The rig of the node.
        fine: The refined surface.
        targets: The new morph targets.
        stored: (targets,) weights in the stored pose.
        tangents: Write TANGENT targets if the base has TANGENT.
        groups: The result of `shared_vertices`: primitives that go on sharing vertices. Primitives that no tool touches
            do so too, since further vertices do not show, and accessors of their own would be a copy.
    """
    node = edited.gltf["nodes"][rig.node]
    mesh = own_mesh(edited, node, rig.mesh)
    old_names = morph_target_names(mesh)
    refined_primitives = primitives_of(fine, groups)
    drop_repeated(edited, mesh, refined_primitives)
    smooth = _smooth_normals(fine, targets)
    written: Written = {}
    for refined in refined_primitives:
        primitive = mesh["primitives"][refined.index]
        where = edited.source.where("meshes", rig.mesh, "primitives", refined.index)
        # Read before refined accessors take the place of the source's.
        normals = base_normals(edited.source, primitive, refined, fine)
        along = base_tangents(edited.source, primitive, refined) if tangents and normals is not None else None
        accessors = (primitive["attributes"].get(name) for name in ("NORMAL", "TANGENT"))
        base = _Base(normals, along, (refined.group, *accessors))
        if len(refined.new):
            refine_primitive(edited, primitive, refined, fine, where, written)
        edited.unpack(primitive)
        if not targets:
            continue
        count, copies = len(refined.weld), ValueIndex.of(refined.weld)
        added: list[Json] = []
        for number, each in enumerate(targets):
            added.append({})
            for name, (vertices, deltas) in _target_deltas(each.shape, refined, copies, base, smooth).items():
                key = ("added", number, name, refined.group if name == "POSITION" else base.key)
                add = partial(edited.add_deltas, vertices, deltas, count=count, bounds=name == "POSITION")
                added[-1][name] = once(written, key, add)
        nothing = np.zeros(0, np.intp), np.zeros((0, 3))
        old = [
            target | {name: edited.add_deltas(*nothing, count=count) for name in base.names if name not in target}
            for target in primitive.get("targets", [])
        ]
        primitive["targets"] = old + added
    if not targets:
        return
    _name_targets(mesh, old_names + [target.name for target in targets])
    # VTK plays no target of a mesh without weights.
    mesh["weights"] = mesh.get("weights", [0.0] * len(old_names))[: len(old_names)] + [0.0] * len(targets)
    _store_weights(node, rig, stored)


def _store_weights(node: Json, rig: Rig, stored: Floats) -> None:
    """Give a node the weights of its old targets and (new targets,) those of new ones, if it had any or needs them."""
    if "weights" in node or stored.any():
        node["weights"] = [float(each) for each in rig.morph_weights] + [float(np.float32(each)) for each in stored]


def own_target_bytes(gltf: Json, rig: Rig) -> int:
    """Bytes of the asset's own morph targets, in the asset or in the written file."""
    mesh = gltf["meshes"][gltf["nodes"][rig.node]["mesh"]]
    count = len(rig.morph_names)
    own = [target for primitive in mesh["primitives"] for target in primitive.get("targets", [])[:count]]
    return stored_bytes(gltf, (accessor for target in own for accessor in target.values()))


def own_mesh(edited: EditedDocument, node: Json, mesh: int) -> Json:
    """The mesh of a node, cloned first if other nodes show it too."""
    meshes = edited.gltf["meshes"]
    if sum(each.get("mesh") == mesh for each in edited.gltf["nodes"]) > 1:
        node["mesh"] = edited.clone_mesh(mesh)
    found: Json = meshes[node["mesh"]]
    return found


def add_idle_targets(edited: EditedDocument, node: Json, names: Sequence[str], own: Sequence[str]) -> None:
    """Give a node's mesh, which has its `own` targets, those of some names. New ones do nothing; tracks weigh them."""
    mesh = own_mesh(edited, node, node["mesh"])
    for primitive in mesh["primitives"]:
        old = primitive.get("targets", [])
        count = len(edited.source.accessor(primitive["attributes"]["POSITION"]))
        # three.js takes the base's normals for a target that lacks them where another has them.
        kinds = [kind for kind in ("NORMAL", "TANGENT") if any(kind in each for each in old)]
        idle = {}
        for kind in ("POSITION", *kinds):
            nothing = np.zeros(0, np.intp), np.zeros((0, 3))
            idle[kind] = edited.add_deltas(*nothing, count=count, bounds=kind == "POSITION")
        primitive["targets"] = [old[own.index(name)] if name in own else dict(idle) for name in names]
    _name_targets(mesh, names)
    mesh.setdefault("weights", [0.0] * len(own))
    for holder in (mesh, node):
        if "weights" in holder:
            weights = [*holder["weights"], *[0.0] * len(own)]  # weights may be fewer than targets; the others are 0
            holder["weights"] = [weights[own.index(name)] if name in own else 0.0 for name in names]


def _name_targets(mesh: Json, names: Sequence[str]) -> None:
    """Name the morph targets of a mesh, and of its primitives where these have names, too."""
    for holder in (mesh, *filter(has_target_names, mesh["primitives"])):
        if isinstance(holder.setdefault("extras", {}), dict):
            holder["extras"]["targetNames"] = list(names)


def tangent_deltas(tangents: Floats, normals: Floats, normal_deltas: Floats) -> Floats:
    """(vertices, 3) deltas that keep (vertices, 3) unit tangents in a surface whose unit normals turn, at weight 1.

    If a surface rises by h along its normal N, its tangent T becomes T + (∂h/∂T) N, and NORMAL deltas, which are
    orthogonal to N, are -∇h, so ΔT = -(T · ΔN) N. If T is orthogonal to N, T + Σ wΔT is exactly orthogonal to
    N + Σ wΔN, at all weights of all tools, and points along the texture.

    Source: glTF 2.0 §3.7.2.2: TANGENT displacements are VEC3, handedness stays.
    """
    return np.asarray(-np.sum(tangents * normal_deltas, axis=1, keepdims=True) * normals)


def _smooth_normals(fine: Refinement, targets: Sequence[Target]) -> Floats:
    """(fine vertices, 3) normals of the welded surface at vertices where a target turns them, 0 elsewhere."""
    turned = distinct_values(np.concatenate([np.zeros(0, np.intp), *(each.shape.normal_vertices for each in targets)]))
    smooth = np.zeros(fine.positions.shape)
    smooth[turned] = fine.normals_at(turned)
    return smooth


def _target_deltas(
    shape: Shape, refined: RefinedPrimitive, copies: ValueIndex, base: _Base, smooth: Floats
) -> dict[str, tuple[Ints, Floats]]:
    """One morph target on one primitive: for each attribute, the vertices that change and their deltas."""
    moved, rows = copies.holding(shape.vertices)
    deltas = {"POSITION": (moved, shape.deltas[rows])}
    if base.normals is not None:
        vertices, turns = turned_normals(shape, refined.weld, copies, smooth, base.normals)
        deltas["NORMAL"] = vertices, turns
        if base.tangents is not None:
            deltas["TANGENT"] = vertices, tangent_deltas(base.tangents[vertices], base.normals[vertices], turns)
    return deltas


def turned_normals(
    shape: Shape, weld: Ints, copies: ValueIndex, smooth: Floats, normals: Floats
) -> tuple[Ints, Floats]:
    """The glTF vertices whose normal a shape changes, and their deltas at weight 1.

    Args:
        shape: The shape of a morph target.
        weld: (vertices,) fine welded vertex of each.
        copies: The index of `weld`.
        smooth: (fine vertices, 3) unit normals of the welded surface.
        normals: (vertices, 3) unit normals, which may have edges.
    """
    vertices, rows = copies.holding(shape.normal_vertices)
    turns = turn_to(smooth[weld[vertices]], normals[vertices], shape.normal_deltas[rows])
    return vertices, turns


def encode_track(edited: EditedDocument, clip: Clip, node: int, track: Track) -> None:
    """Write a weights channel into a clip, in place of those that move the weights of the node there.

    The node shows its mesh alone. The channel names the node, even where these were pointers: players without
    KHR_animation_pointer show it too, and the extension forbids channels of all weights and of a single one side by
    side.
    """
    animation = edited.gltf["animations"][clip.index]
    channels = animation["channels"]
    # Weights of a mesh do not move a node that has weights of its own.
    held = any("weights" in each for each in edited.source.items("nodes")[node : node + 1])
    mesh = None if held else edited.gltf["nodes"][node].get("mesh")
    old = [each for each in channels if moves_weights(each, node, mesh)]
    entry = old[-1] if old else {"sampler": None, "target": {}}
    users = sum(each.get("sampler") == entry["sampler"] for each in channels)
    number = entry["sampler"] if old and users == 1 else len(animation["samplers"])
    (sampler,) = animation["samplers"][number : number + 1] or [{}]
    times = track.times.astype(np.float32)
    sampler = dict(sampler)
    sampler["input"] = edited.add(times, bounds=True, replaces=sampler.get("input"))
    sampler["interpolation"] = track.interpolation
    sampler["output"] = edited.add(track.values.astype(np.float32).reshape(-1), replaces=sampler.get("output"))
    animation["samplers"][number : number + 1] = [sampler]
    entry["sampler"] = number
    entry["target"] = without_pointer(entry["target"]) | {"node": node, "path": "weights"}
    if not old:
        channels.append(entry)
    for dropped in drop_channels(animation, old[:-1]):
        for key in ("input", "output"):
            edited.discard(dropped[key], like=sampler[key])
