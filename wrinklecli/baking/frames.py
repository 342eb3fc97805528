"""Geometry for each frame: posed, unskinned meshes, as nodes that a clip shows one after another, or as files.

Source: glTF 2.0 §3.7.3.3 (skinning) and §3.11 (STEP). A skinned node must not be hidden by scale, so the
frames are unskinned and their nodes roots.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from wrinklecli.baking.morphs import encode_mesh, turned_normals
from wrinklecli.baking.refined_mesh import RefinedPrimitive, base_normals, nonzero_directions, old_values, primitives_of
from wrinklecli.baking.report import BakedMesh
from wrinklecli.character.pose import joint_matrices, morph_weights
from wrinklecli.character.skin import pose, prepare
from wrinklecli.effects.effect import Motion, target_weights, targets_of
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.animated import drop_channels, moves_weights
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.edited_document import VERTEX_DATA, EditedDocument
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, Ints, ValueIndex, unit
from wrinklecli.numeric.guard import Progress
from wrinklecli.numeric.portions import portions


@dataclass(frozen=True, slots=True)
class PosedFrame:
    """One frame of all glTF vertices, primitive after primitive, world space.

    Normals and tangents are None if no primitive has any. They are +Z where one of several primitives has none, and
    where a clip scales the mesh to nothing.
    """

    positions: Floats
    normals: Floats | None
    tangents: Floats | None


def pose_frames(document: Document, mesh: BakedMesh, motion: Motion) -> Iterator[PosedFrame]:
    """Pose every frame of a clip by unpruned skin weights, wrinkles included."""
    rig, fine = mesh.plan.rig.own, mesh.plan.fine
    refined_primitives = primitives_of(fine)
    primitives = document.items("meshes")[rig.mesh]["primitives"]
    welds = np.concatenate([refined.weld for refined in refined_primitives])
    pairs = list(zip(primitives, refined_primitives, strict=True))
    base = _joined([base_normals(document, *pair, fine) for pair in pairs], refined_primitives)
    old_deltas = np.concatenate([_normal_deltas(document, *pair) for pair in pairs], axis=1)
    tangents = _joined([_tangents(document, *pair) for pair in pairs], refined_primitives)
    weights = fine.influences(len(rig.joints), welds)
    targets = targets_of(mesh.effects)
    shapes = np.zeros((len(targets), *fine.positions.shape))
    for into, target in zip(shapes, targets, strict=True):
        into[target.shape.vertices] = target.shape.deltas
    deltas = np.concatenate([fine.morph_deltas[: len(rig.morph_names)], shapes])[:, welds]
    bent = None
    if base is not None:
        copies = ValueIndex.of(welds)
        bent = np.concatenate([old_deltas, np.zeros((len(targets), *base.shape))])
        for into, target in zip(bent[len(old_deltas) :], targets, strict=True):
            vertices, turns = turned_normals(target.shape, welds, copies, fine.normals, base)
            into[vertices] = turns
    skin = prepare(weights, fine.positions[welds], deltas, base, bent)
    along = None if tangents is None else prepare(weights, tangents[:, :3], np.zeros((0, len(welds), 3)))
    wrinkles = target_weights(motion)
    for part in portions(len(motion.times), 3 * len(welds)):
        times = motion.times[part]
        matrices = joint_matrices(rig, motion.clip, times)
        played = np.concatenate([morph_weights(rig, motion.clip, times), wrinkles[part]], axis=1)
        positions, normals = pose(skin, matrices, played)
        moved = None
        if along is not None:
            # Tangents are directions, which translations do not move.
            turning = matrices * np.array([1.0, 1.0, 1.0, 0.0])
            moved = pose(along, turning, np.zeros((len(times), 0)))[0]
        for frame in range(len(times)):
            handed = None
            if moved is not None and tangents is not None:
                handed = nonzero_directions(np.concatenate([unit(moved[frame].T), tangents[:, 3:]], axis=1))
            facing = None if normals is None else nonzero_directions(normals[frame].T)
            yield PosedFrame(positions[frame].T, facing, handed)


def _normal_deltas(document: Document, primitive: Json, refined: RefinedPrimitive) -> Floats:
    """(morph targets, vertices, 3) NORMAL deltas of the source, mixed for new vertices."""
    targets = primitive.get("targets", [])
    deltas = np.zeros((len(targets), len(refined.weld), 3))
    for row, target in zip(deltas, targets, strict=True):
        if "NORMAL" in target:
            old = old_values(document, target, "NORMAL", refined, size=3)
            row[:] = np.concatenate([old, refined.mix(old)])
    return deltas


def _tangents(document: Document, primitive: Json, refined: RefinedPrimitive) -> Floats | None:
    """(vertices, 4) TANGENTs of a primitive, mixed for new vertices; None if it has none."""
    if "TANGENT" not in primitive["attributes"]:
        return None
    old = old_values(document, primitive["attributes"], "TANGENT", refined, size=4)
    return refined.tangents(old)


def _joined(attributes: Sequence[Floats | None], refined_primitives: Sequence[RefinedPrimitive]) -> Floats | None:
    """An attribute of all primitives, 0 for those that lack it; None if all do."""
    size = max((each.shape[1] for each in attributes if each is not None), default=0)
    if not size:
        return None
    return np.concatenate(
        [
            np.zeros((len(refined.weld), size)) if each is None else each
            for each, refined in zip(attributes, refined_primitives, strict=True)
        ]
    )


def encode_frames(edited: EditedDocument, mesh: BakedMesh, progress: Progress) -> None:
    """Replace the node of a mesh by one unskinned node for each frame, shown in turn by STEP scale tracks.

    The first frame of the first clip is shown at rest. A clip that was not baked shows that frame throughout.
    """
    rig = mesh.plan.rig
    encode_mesh(edited, rig, mesh.plan.fine, (), stored=np.zeros(0))
    node = edited.gltf["nodes"][rig.node]
    template = edited.gltf["meshes"][node["mesh"]]
    for key in ("mesh", "skin", "weights"):
        node.pop(key, None)
    for animation in edited.gltf.get("animations", []):
        drop_channels(animation, [each for each in animation["channels"] if moves_weights(each, rig.node)])
    refined_primitives = primitives_of(mesh.plan.fine)
    bounds = np.cumsum([0] + [len(refined.weld) for refined in refined_primitives])
    nodes, meshes = edited.gltf["nodes"], edited.gltf["meshes"]
    group: Json = {"name": f"{rig.node_name}_frames", "children": []}
    nodes.append(group)
    # At the root of every scene that shows the rig's node, as frames are in world space.
    *_, root = rig.upwards(rig.node)
    for scene in edited.gltf.get("scenes", []):
        if root in scene.get("nodes", []):
            scene["nodes"].append(len(nodes) - 1)
    total = sum(len(motion.times) for motion in mesh.motions)
    first, done = len(nodes), 0
    for motion in mesh.motions:
        start = len(nodes)
        for posed in pose_frames(edited.source, mesh, motion):
            meshes.append(_frame_mesh(edited, template, posed, bounds))
            name = f"{rig.node_name}_{motion.clip.name}_{len(nodes) - start:04d}"
            hidden = {} if len(nodes) == first else {"scale": [0.0, 0.0, 0.0]}
            group["children"].append(len(nodes))
            nodes.append({"name": name, "mesh": len(meshes) - 1, **hidden})
            done += 1
            progress("frames", done, total)
        _show_in_turn(edited, motion, start, first)
    baked = {motion.clip.index for motion in mesh.motions}
    for index, animation in enumerate(edited.gltf.get("animations", [])):
        if index not in baked:
            _add_scale(edited, animation, first, np.zeros(1), [1.0])


def _frame_mesh(edited: EditedDocument, template: Json, posed: PosedFrame, bounds: Ints) -> Json:
    primitives = []
    for index, primitive in enumerate(template["primitives"]):
        span = slice(bounds[index], bounds[index + 1])
        attributes = {
            name: accessor
            for name, accessor in primitive["attributes"].items()
            if not name.startswith(("JOINTS_", "WEIGHTS_"))
        }
        computed = {"POSITION": posed.positions, "NORMAL": posed.normals, "TANGENT": posed.tangents}
        for name, values in computed.items():
            if values is not None and name in primitive["attributes"]:
                stored = values[span].astype(np.float32)
                attributes[name] = edited.add(stored, target=VERTEX_DATA, bounds=name == "POSITION")
        kept = {key: value for key, value in primitive.items() if key not in ("attributes", "targets")}
        primitives.append({"attributes": attributes, **kept})
    return {"primitives": primitives}


def _show_in_turn(edited: EditedDocument, motion: Motion, start: int, shown: int) -> None:
    """Scale tracks that show each frame's node from its time to the next frame's."""
    animation = edited.gltf["animations"][motion.clip.index]
    times = motion.times
    for frame in range(len(times)):
        keys, scales = [], []
        if frame:
            keys, scales = [times[0]], [0.0]
        keys, scales = [*keys, times[frame]], [*scales, 1.0]
        if frame + 1 < len(times):
            keys, scales = [*keys, times[frame + 1]], [*scales, 0.0]
        _add_scale(edited, animation, start + frame, np.array(keys), scales)
    if start != shown:
        _add_scale(edited, animation, shown, times[:1], [0.0])


def _add_scale(edited: EditedDocument, animation: Json, node: int, times: Floats, scales: Sequence[float]) -> None:
    output = np.repeat(np.array(scales, np.float32)[:, None], 3, axis=1)
    sampler = {
        "input": edited.add(times.astype(np.float32), bounds=True),
        "interpolation": "STEP",
        "output": edited.add(output),
    }
    animation["samplers"].append(sampler)
    number = len(animation["samplers"]) - 1
    animation["channels"].append({"sampler": number, "target": {"node": node, "path": "scale"}})
