"""Budgets of engines: morph targets, weights and joints are held to the limits of one, or the bake is refused.

Only added targets change, and only if a limit is exceeded. If the asset itself exceeds a limit, the bake is refused, or
reports it.

Sources:
    spec8: glTF 2.0 §3.7.2.2: clients should support at least eight morphed attributes, and may play only those
        of the highest weights where a file has more. How many targets may be stored is not limited. Held to here:
        eight targets of a weight other than 0 at a time. The specification counts attributes, and says what that
        means: eight targets of POSITION alone, four with NORMAL, two with TANGENT too. A client that does no more
        plays a mesh with normals only where the report's `active_attributes` is at most 8.
    three: three.js r187, `src/renderers/webgl/WebGLMorphtargets.js`: one layer of a float RGBA texture array for
        each target, of which OpenGL ES 3.0, and so WebGL 2, promises 256 (MAX_ARRAY_TEXTURE_LAYERS). (Weights are
        a uniform array beside that, one vector each: ES 3.0 promises 256 in all, GPUs have a thousand and more.)
        `examples/jsm/loaders/GLTFLoader.js` reads JOINTS_0 alone, and `normalizeSkinWeights` makes its weights sum
        to 1 (https://github.com/mrdoob/three.js/issues/26137). 256 targets are the limit of Bevy 0.19
        (`bevy_mesh::morph::MAX_MORPH_WEIGHTS`, 64 in 0.17) too.
    unity: weights of blend shapes are clamped to the range that a model defines, which importers of glTF make 0 to
        the full shape, unless a project turns that off
        (https://docs.unity3d.com/ScriptReference/PlayerSettings-legacyClampBlendShapeWeights.html). Their number is
        not limited.
    unreal: Unreal 5.8, `Engine/Plugins/Interchange/Runtime/Source`: of joints, `Parsers/GLTFCore` reads JOINTS_0 and
        WEIGHTS_0 alone (`GLTFAccessor.cpp`, and four bones in `Import/Private/Gltf/InterchangeGltfMesh.cpp`), and
        sparse accessors with a buffer view or without. `InterchangeGltfAnimation.cpp` hands the keys of weights on as
        they are. No number of targets is too large, and no weight. (Read, not run.)
    filament: Filament 1.53 shows none of the targets whose sparse accessor has no buffer view, without a message
        (https://github.com/google/filament/issues/7900), and plays the others: seen with
        `tests/clients/browser_check.py`. 256 targets are CONFIG_MAX_MORPH_TARGET_COUNT of
        `libs/filabridge/include/private/filament/EngineEnums.h`; a vertex has one attribute BONE_INDICES
        (`libs/gltfio/src/GltfEnums.h`).
    cesium: CesiumJS 1.145 reads no sparse accessors (`Scene/GltfLoader.js`): it stops at targets without a buffer
        view, and shows what lies below those with one. Each attribute of a primitive takes a vertex attribute, and so
        do POSITION, NORMAL and TANGENT of each of its targets (`Scene/Model/GeometryPipelineStage.js`,
        `Scene/Model/MorphTargetsPipelineStage.js`). OpenGL ES 3.0, and so WebGL 2, promises 16 of them
        (MAX_VERTEX_ATTRIBS). Seen with `tests/clients/browser_check.py`.
    blender: Blender clamps the value of a shape key to the range of its slider, 0 to 1, in animations too
        (`rna_ShapeKey_value_set` of `source/blender/makesrna/intern/rna_key.cc`). Its importer would widen the range,
        but looks at the first key alone (`io_scene_gltf2/blender/imp/animation_weight.py`).
    vtk: VTK 9.7 plays four targets of a mesh, and wrong positions where a sparse accessor has no buffer view: seen with
        `tests/clients/vtk_pose.py`. f3d reads files with VTK.
    godot3: Godot 3.2 reads the base's positions where a sparse accessor has no buffer view: seen with
        `tests/clients/godot3_check.py`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.pose import blend, morph_weights, transform
from wrinklecli.character.surface import dense_influences, read_vertices
from wrinklecli.character.weight_track import widen
from wrinklecli.choices import STORAGES, Engine, Storage
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, SamplingOptions, target_weights, targets_of
from wrinklecli.effects.sampling import REDUCTION_SHARE, motion_at, play, read
from wrinklecli.errors import RefusedError, listed
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Bools, Floats, float32_values, significant
from wrinklecli.surface.prune import Poses

TEXEL_BYTES = 16
"""Bytes of a texel of four floats, of which three.js keeps one for each vertex, target and attribute."""

# The attributes that engines morph.
_MORPHED = {"POSITION", "NORMAL", "TANGENT"}


@dataclass(frozen=True, slots=True)
class Budget:
    """Limits of an engine; None for none.

    Attributes:
        targets: Morph targets of a mesh, the asset's own among them.
        active: Morph targets with a weight other than 0 at a time.
        influences: Joints of a vertex, all in JOINTS_0.
        attributes: Vertex attributes of a primitive, those of its targets among them.
        unit_weights: True if weights must be from 0 to 1.
        storage: The least storage of targets that it reads.
    """

    targets: int | None = None
    active: int | None = None
    influences: int | None = None
    attributes: int | None = None
    unit_weights: bool = False
    storage: Storage = "sparse"


BUDGETS: dict[Engine, Budget] = {
    "three": Budget(targets=256, influences=4),
    "unity": Budget(unit_weights=True),
    "unreal": Budget(influences=4),
    "filament": Budget(targets=256, influences=4, storage="based"),
    "cesium": Budget(attributes=16, storage="dense"),
    "blender": Budget(unit_weights=True),
    "godot3": Budget(storage="based"),
    "vtk": Budget(targets=4, storage="based"),
    "spec8": Budget(active=8),
}


def storage(engine: Engine | None, wanted: Storage) -> Storage:
    """The storage of morph targets for an engine: as wanted, or the least that it reads."""
    return max(wanted, BUDGETS[engine].storage, key=STORAGES.index) if engine is not None else wanted


def texture_bytes(plan: MeshPlan, targets: int) -> int:
    """GPU memory that three.js takes for a mesh's targets, old and new, sparse or not.

    The memory is targets x vertices x attributes (POSITION, and NORMAL if there is one) x 16 bytes, without the padding
    of texture rows. Source: three.js r187, `WebGLMorphtargets`.
    """
    return texel_bytes(plan, targets * len(plan.fine.weld))


def texel_bytes(plan: MeshPlan, vertices: int) -> int:
    """GPU memory of so many vertices of morph targets, bytes."""
    return vertices * plan.attributes * TEXEL_BYTES


def mesh_texture_bytes(gltf: Json, mesh: Json) -> int:
    """GPU memory of the morph targets of a mesh in a document, bytes."""
    return sum(
        len(targets)
        * gltf["accessors"][primitive["attributes"]["POSITION"]]["count"]
        * (1 + any("NORMAL" in target for target in targets))
        * TEXEL_BYTES
        for primitive in mesh["primitives"]
        for targets in (primitive.get("targets", []),)
    )


def fit_budget(
    document: Document,
    plan: MeshPlan,
    effects: Sequence[Effect],
    motions: list[Motion],
    clips: Sequence[Clip],
    engine: Engine,
    how: SamplingOptions,
    *,
    tangents: bool = False,
) -> tuple[list[Effect], list[Motion], Json]:
    """Hold a mesh's morph targets to the limits of an engine.

    Weights outside 0 to 1 cost no error: a scaled shape, and a shape with its negative as a second one, play the same
    at all times. Too many targets are reduced, tool by tool, to the fewest that give all heights over the tool's whole
    range of shortenings within a quarter of the error bound, independently of the clips. Too many targets at a time
    cost no error if a tool's bumps rise one after another: see `wrinkle.remix.in_turn`. (Tools that move alike, as
    mirrored ones may, keep targets of their own, since shared ones would change with the clips.) If there are too many
    still, effects that can do with their main targets alone lose the others, one by one.

    Args:
        document: The source.
        plan: The mesh.
        effects: The effects on it.
        motions: The clips that are baked.
        clips: All clips, whose poses judge joints.
        engine: The engine.
        how: Times of clips that are sampled anew.
        tangents: Targets have TANGENT where the mesh has.

    Returns:
        Effects and motions to write in place of those given, and findings for the report.

    Raises:
        RefusedError: A limit cannot be held within the error bound.
    """
    limits = BUDGETS[engine]
    budget = replace(limits, targets=_most_targets(document, plan, limits, tangents=tangents))
    name = plan.rig.node_name
    found: Json = {"node": name, "reduced": []}
    if budget.influences is not None:
        found.update(_judge_influences(document, plan, clips, budget.influences, engine))
    if budget.unit_weights:
        effects = [each.remixes.with_unit_weights(each) if each.remixes else each for each in effects]
        motions = _played(plan, effects, motions)
        found.update(_weight_range(plan, motions))
    effects, motions = list(effects), list(motions)
    whole = effects
    if _excess(plan, effects, motions, budget):
        effects, motions = _reduce(plan, effects, motions, budget, how)
        found["reduced"] = [_change(*each) for each in zip(whole, effects, strict=True) if each[0] is not each[1]]
    excess = _excess(plan, effects, motions, budget)
    if excess:
        less, most = _remedies(effects), budget.active if budget.targets is None else budget.targets
        held = "" if budget.attributes is None else f", as a vertex has {budget.attributes} attributes there"
        raise RefusedError(
            f"{excess}; --engine {engine} allows {most}{held}. {less[0].upper()}{less[1:]} would help",
            where=name,
        )
    found["targets"] = len(plan.rig.own.morph_names) + len(targets_of(effects))
    found["active"] = max((int(_active(plan, motion)[0].sum()) for motion in motions), default=0)
    found["active_attributes"] = found["active"] * plan.attributes
    return effects, motions, found


def _most_targets(document: Document, plan: MeshPlan, budget: Budget, *, tangents: bool) -> int | None:
    """The most morph targets that a mesh may have, the asset's own among them; None if any number will do."""
    if budget.attributes is None:
        return budget.targets
    most = []
    for primitive in document.items("meshes")[plan.rig.own.mesh]["primitives"]:
        base, own = primitive["attributes"], primitive.get("targets", [])
        # What the primitive has of these, each of its targets gets.
        added = {"POSITION", "NORMAL"} & base.keys() | ({"TANGENT"} & base.keys() if tangents else set())
        taken = len(base) + sum(len(added | _MORPHED & target.keys()) for target in own)
        most.append(len(own) + (budget.attributes - taken) // len(added))
    return max(min(most), 0)


def _remedies(effects: Sequence[Effect]) -> str:
    """The ways to fewer targets: first the remedies that effects have of their own, with their names."""
    names: dict[str, list[str]] = {}
    for each in effects:
        names.setdefault(each.words.remedy, []).append(each.name)
    less = [f"{remedy} of {listed(those)}" for remedy, those in names.items() if remedy]
    less += ["fewer bumps", "`strategy: everywhere`"] if "" in names else []
    less += ["fewer tools on this mesh"] if len(effects) > 1 else []
    less += ["a larger --max-error"] if "" in names else []
    return " or ".join([", ".join(less[:-1]), less[-1]]) if len(less) > 1 else less[0]


def _weight_range(plan: MeshPlan, motions: Sequence[Motion]) -> Json:
    """The least and greatest weights of effects, and the least of the asset's own targets, which do not change."""
    own = [morph_weights(plan.rig.own, motion.clip, motion.times) for motion in motions]
    wrinkles = [target_weights(motion) for motion in motions]
    return {
        "least_weight": min((float(weights.min(initial=0.0)) for weights in wrinkles), default=0.0),
        "greatest_weight": max((float(weights.max(initial=0.0)) for weights in wrinkles), default=0.0),
        "least_weight_of_asset": min((float(weights.min(initial=0.0)) for weights in own), default=0.0),
    }


def _reduce(
    plan: MeshPlan, effects: Sequence[Effect], motions: Sequence[Motion], budget: Budget, how: SamplingOptions
) -> tuple[list[Effect], list[Motion]]:
    """Give each effect the fewest targets, or the fewest at a time; if these are too many, its main ones alone."""
    tolerance, at_once = REDUCTION_SHARE * plan.max_error, budget.active is not None
    reduced = [
        each.remixes.with_fewest_targets(each, plan, tolerance, at_once=at_once) if each.remixes else each
        for each in effects
    ]

    def shown(*, anew: bool) -> list[Motion]:
        played = play(plan, reduced, [each.clip for each in motions], how) if anew else _played(plan, reduced, motions)
        return [_keyed_at_turns(plan, reduced, motion) for motion in played] if at_once else played

    played = shown(anew=False)
    while _excess(plan, reduced, played, budget):
        # One target at a time, of the effect that has most.
        fewer = [
            each.remixes.with_at_most(each, max(len(each.targets) - 1, 1)) if each.remixes else each for each in reduced
        ]
        spare = [k for k, each in enumerate(fewer) if each is not reduced[k]]
        if not spare:
            break
        most = max(spare, key=lambda k: len(reduced[k].targets))
        reduced[most] = fewer[most]
        played = shown(anew=False)
        if not _excess(plan, reduced, played, budget):
            # Other tables need other keys.
            played = shown(anew=True)
    return reduced, played


def _change(old: Effect, new: Effect) -> Json:
    """The entry of an effect with fewer targets in the report."""
    return {
        "tool": old.name,
        "from": len(old.target_names),
        "to": len(new.target_names),
        "at_once": new.most_at_once,
        "error": significant(new.error - old.error, 4),
    }


def _played(plan: MeshPlan, effects: Sequence[Effect], motions: Sequence[Motion]) -> list[Motion]:
    """Motions at the same times, of effects with other targets."""
    return [motion_at(plan, effects, each.clip, each.times, each.keys) for each in motions]


def _keyed_at_turns(plan: MeshPlan, effects: Sequence[Effect], motion: Motion) -> Motion:
    """A clip keyed where fewer targets of an effect are active at once, as one gives way to the next."""
    keyed = motion
    for number in range(len(effects)):
        while len(turns := _turns(plan, effects, keyed, number)):
            keys = np.union1d(keyed.times[keyed.keys], turns)
            times = np.union1d(keyed.times, turns)
            keyed = motion_at(plan, effects, motion.clip, times, np.searchsorted(times, keys))
    return keyed


def _turns(plan: MeshPlan, effects: Sequence[Effect], motion: Motion, number: int) -> Floats:
    """Seconds of a clip, float32 values between its keys, that part what an effect's targets do before and after.

    A key there leaves fewer targets active on either side: those of the key before, as long as no other one acts.
    """
    keys, shown = motion.times[motion.keys], motion.weights[number][motion.keys] != 0
    counts = shown.sum(axis=1)
    crowded = np.flatnonzero((shown[:-1] | shown[1:]).sum(axis=1) > np.maximum(counts[:-1], counts[1:]))
    if not len(crowded):
        return np.zeros(0)
    before, after = shown[crowded], shown[crowded + 1]
    near, far = keys[crowded], keys[crowded + 1]

    def shown_at(times: Floats) -> Bools:
        order = np.argsort(times)
        found = np.zeros(before.shape, np.bool_)
        (reading,) = read(plan, [effects[number]], motion.clip, times[order])
        found[order] = effects[number].weights(motion.clip, reading) != 0
        return found

    while True:
        middle = float32_values((near + far) / 2.0)
        inside = (middle != near) & (middle != far)
        if not inside.any():
            break
        same = ~(shown_at(middle) & ~before).any(axis=1)
        near, far = np.where(inside & same, middle, near), np.where(inside & ~same, middle, far)
    there, every = shown_at(near), (before | after).sum(axis=1)
    helped = ((before | there).sum(axis=1) < every) & ((there | after).sum(axis=1) < every)
    return np.setdiff1d(near[helped], keys)


def _excess(plan: MeshPlan, effects: Sequence[Effect], motions: Sequence[Motion], budget: Budget) -> str:
    """Words about targets that exceed the limits; empty if none do."""
    own = len(plan.rig.own.morph_names)
    count = own + len(targets_of(effects))
    if budget.targets is not None and count > budget.targets:
        return f"has {count} morph targets, {own} of them the asset's own"
    if budget.active is not None:
        for motion in motions:
            shown, time = _active(plan, motion)
            if shown.sum() > budget.active:
                ends = np.cumsum([own, *(len(effect.target_names) for effect in effects)])
                users = ["the asset's own", *(effect.name for effect in effects)]
                counts = [int(each.sum()) for each in np.split(shown, ends[:-1])]
                listed = ", ".join(f"{many} of {user}" for user, many in zip(users, counts, strict=True) if many)
                return f"needs {int(shown.sum())} morph targets at once in {motion.clip.name} at {time:.3g} s: {listed}"
    return ""


def _active(plan: MeshPlan, motion: Motion) -> tuple[Bools, float]:
    """(targets,) True if active when most are, at and between keys, and that time in seconds."""
    channel = motion.clip.channel(plan.rig.node, "weights")
    weights = target_weights(motion)[motion.keys]
    track = widen(channel, plan.rig.own, motion.clip, motion.times[motion.keys], weights)
    stored = track.values.astype(np.float32) != 0
    # A key of CUBICSPLINE has tangents too.
    shown: Bools = np.any(stored, axis=1) if track.interpolation == "CUBICSPLINE" else stored
    # Between two keys, whatever either shows.
    shown = shown[:-1] | shown[1:] if len(shown) > 1 else shown
    worst = int(np.argmax(shown.sum(axis=1)))
    return shown[worst], float(track.times[worst : worst + 2].mean())


def _judge_influences(document: Document, plan: MeshPlan, clips: Sequence[Clip], limit: int, engine: Engine) -> Json:
    """Count the asset's own vertices that lose joints beyond JOINTS_0, and measure how far this moves them.

    Raises:
        RefusedError: They move further than the error bound; the asset's own weights do not change.
    """
    rig = plan.rig.own
    if not rig.skinned:
        return {"vertices_over_influences": 0, "influence_error": 0.0}
    stored = read_vertices(document, rig)
    whole = dense_influences(stored.joints, stored.weights, len(rig.joints))
    first = np.zeros_like(whole)
    start = 0
    for primitive in document.items("meshes")[rig.mesh]["primitives"]:
        joints, weights = (document.accessor(primitive["attributes"][key]) for key in ("JOINTS_0", "WEIGHTS_0"))
        rows = start + np.arange(len(joints))
        joints = np.where(weights > 0, joints, 0).astype(np.intp)  # joints of no weight may be any
        for column in range(joints.shape[1]):
            first[rows, joints[:, column]] += weights[:, column]
        start += len(joints)
    kept = first.sum(axis=1, keepdims=True)
    over = np.flatnonzero(((whole > 0) & (first == 0)).any(axis=1))
    first /= np.where(kept > 0, kept, 1.0)
    error = 0.0
    acting = np.flatnonzero(whole[over].any(axis=0))
    for pose in Poses(rig, tuple(clips), document.memory).of(acting) if len(over) else []:
        want, got = (
            transform(blend(each[over][:, acting], pose[None]), stored.positions[over]) for each in (whole, first)
        )
        error = max(error, float(np.sqrt(np.sum((got - want) ** 2, axis=2)).max()))
    if error > plan.max_error:
        raise RefusedError(
            f"has {len(over)} vertices of more than {limit} joints, which --engine {engine} would put off by"
            f" {error:.3g}; --max-error allows {plan.max_error:.3g}. Limit the asset to {limit} joints a vertex",
            where=rig.node_name,
        )
    return {"vertices_over_influences": len(over), "influence_error": significant(error, 4)}
