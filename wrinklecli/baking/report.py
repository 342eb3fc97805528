"""The report of a bake: JSON values about each mesh, effect and clip, and a summary in one line."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, field

from wrinklecli.baking.budget import BUDGETS, texture_bytes
from wrinklecli.baking.extras import METHOD, JointNames
from wrinklecli.baking.job import Job
from wrinklecli.baking.proof import Residual
from wrinklecli.character.clip import KEY_GAP, Clip
from wrinklecli.character.rig import Rig, morph_target_names
from wrinklecli.choices import Mode
from wrinklecli.effects.effect import Effect, MeshPlan, Motion, Words, targets_of
from wrinklecli.effects.plan import mesh_warnings, track_warnings
from wrinklecli.errors import counted, listed, megabytes
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import significant

VERSION = 1

_OWN_NODE = "give the mesh a node of its own below it"

# The section of a report that is there in any case.
_TOOLS = "tools"


@dataclass(frozen=True, slots=True)
class Report:
    """The result of a bake.

    Attributes:
        data: For `--report`: JSON values only.
        warnings: A line each; with `--strict` any of them refuses the result.
        inputs: Every file that was read.
        notes: A line for each part of other files' clips that was left out or renamed, and for joints that got names.
        bytes_written: Size of OUT with the files beside it.
        timings: For `--timings`: JSON values only.
        further_targets: Counts of the targets that are not of tools, for the summary.
    """

    data: Json
    warnings: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    bytes_written: int = 0
    timings: Json = field(default_factory=dict)
    further_targets: tuple[str, ...] = ()

    @property
    def _split(self) -> str:
        """The part of the summary about a split: the memory that it would leave, if this is less than half."""
        meshes = self.data["meshes"]
        whole = sum(mesh["gpu_bytes"] for mesh in meshes)
        split = sum(mesh.get("split_gpu_bytes", mesh["gpu_bytes"]) for mesh in meshes)
        return f" ({megabytes(split)} with --split)" if 2 * split < whole else ""

    @property
    def summary(self) -> str:
        """One line about the whole result."""
        meshes = self.data["meshes"]
        targets = sum(len(tool["targets"]) for tool in self.data["tools"])
        added = sum(mesh["vertices"] - mesh["coarse_vertices"] for mesh in meshes)
        parts = ["a draft (one level less refined, not proven)"] if self.data["draft"] else []
        tools = [counted(len(self.data["tools"]), "tool")] if self.data["tools"] or not self.further_targets else []
        made = [counted(targets, "morph target")] if tools else []
        targeted = self.data["mode"] != "frames"
        parts += [
            *tools,
            ", ".join([*made, *self.further_targets]) if targeted else "per-frame geometry",
            "which move nothing" if self.data["mode"] == "weights" else counted(added, "new vertex", "new vertices"),
            counted(len(self.data["clips"]), "clip"),
        ]
        if self.data["mode"] == "morph":
            parts.append(f"{megabytes(sum(mesh['gpu_bytes'] for mesh in meshes))} of targets on a GPU" + self._split)
        own = [mesh["own_targets"] for mesh in meshes if mesh.get("own_targets", {}).get("bytes")]
        if own:
            before, after = (sum(each[key] for each in own) / 1e6 for key in ("bytes_before", "bytes"))
            listed = counted(sum(each["count"] for each in own), "morph target")
            parts.append(f"the asset's own {listed} in {after:.2f} MB ({before:.2f} before)")
        proven = [clip["residual"] for clip in self.data["clips"] if clip.get("residual")]
        if proven and self.data["tallest_wrinkle"]:
            worst = max(each["position"] for each in proven)
            share = 100 * worst / self.data["tallest_wrinkle"]
            parts.append(f"within {worst:.2g} ({share:.2g} % of the tallest wrinkle)")
        return ", ".join(parts)


def text_of(data: Json) -> str:
    """The text of a file of a report or of timings."""
    return json.dumps(data, indent=1, allow_nan=False) + "\n"


@dataclass(frozen=True, slots=True)
class Split:
    """A mesh in parts, made or only weighed.

    Attributes:
        gpu_bytes: GPU memory of three.js for the morph targets of all parts.
        nodes: Names of the parts' nodes; empty if the mesh is whole.
    """

    gpu_bytes: int
    nodes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class BakedMesh:
    """All that was made of one node's mesh.

    Attributes:
        motions: The clips that were sampled.
        residuals: By clip, if the file was proved.
        budget: The last result of `fit_budget`, if an engine was named.
        own_bytes: Bytes of the asset's own morph targets, in the asset and in the written file.
        split: The mesh in parts; None if little was to be gained.
        joint_names: The names by which players find the joints of the drives.
    """

    plan: MeshPlan
    effects: tuple[Effect, ...] = ()
    motions: tuple[Motion, ...] = ()
    residuals: dict[str, Residual] = field(default_factory=dict)
    budget: Json | None = None
    own_bytes: tuple[int, int] = (0, 0)
    split: Split | None = None
    joint_names: JointNames = field(default_factory=JointNames)


def make_report(job: Job, baked: Sequence[BakedMesh], *, images: Sequence[str], tracks: bool) -> Report:
    """Gather the report, frame by frame only with the option `details`.

    `images` are files that were read besides those of the job. `tracks` is True if clips have tracks of weights.
    """
    warnings, notes = list(job.warnings), list(job.notes)
    for mesh in baked:
        names = mesh.joint_names
        if names.given:
            notes.append(
                f"{job.document.path}: {counted(len(names.given), 'joint')} of tools had no name; players look joints"
                f" up by name, so they are now named {listed(names.given)}"
            )
        if names.shared:
            warnings.append(
                f"{job.document.path}: several nodes are named {listed(names.shared)}; `track` and players that drive"
                " wrinkles look joints up by name, and may take another one; name them apart"
            )
        clips = [motion.clip for motion in mesh.motions]
        warnings += mesh_warnings(mesh.plan, job.settings, clips)
        warnings += track_warnings(mesh.plan, clips) if tracks else ()
        warnings += _three_warnings(job, mesh.plan.rig, clips) if tracks else ()
        for number, effect in enumerate(mesh.effects):
            seen = [each.seen(number) for each in mesh.motions]
            warnings += effect.words.warnings(mesh.plan, seen, job.settings.up)
    sections: dict[str, list[Json]] = {_TOOLS: []}
    for mesh in baked:
        for layer in mesh.plan.layers:
            sections.setdefault(layer.section, [])
        for effect in mesh.effects:
            sections[effect.section].append(effect.words.describe(mesh.plan, effect.target_names))
    engine = job.options.engine
    data: Json = {
        "report": VERSION,
        "method": METHOD,
        "asset": job.document.path,
        "tools_file": job.settings.path,
        "mode": job.options.mode,
        "draft": job.options.draft,
        "tallest_wrinkle": max(mesh.plan.tallest for mesh in baked),
        "meshes": [_describe_mesh(mesh, job.options.mode) for mesh in baked],
        **sections,
        "clips": _describe_clips(baked, details=job.options.details),
        "notes": notes,
        "warnings": warnings,
    }
    if engine is not None:
        budgets = [mesh.budget for mesh in baked if mesh.budget is not None]
        data["engine"] = {"name": engine, "limits": asdict(BUDGETS[engine]), "meshes": budgets}
    effects = [effect for mesh in baked for effect in mesh.effects]
    kinds: dict[type[Words], list[Effect]] = {}
    for effect in effects:
        kinds.setdefault(type(effect.words), []).append(effect)
    summaries = (each[0].words.summary(len(each), len(targets_of(each))) for each in kinds.values())
    return Report(
        data=data,
        warnings=tuple(warnings),
        inputs=(*job.inputs, *images),
        notes=tuple(notes),
        further_targets=tuple(each for each in summaries if each),
    )


def _three_warnings(job: Job, rig: Rig, clips: Sequence[Clip]) -> Iterator[str]:
    """Lines on weights of a node that three.js gives to other meshes too, or does not play.

    Source: GLTFLoader of three.js, `_createAnimationTracks`, which model-viewer 4.4 has too.
    """
    document, where = job.document, rig.node_name
    nodes, meshes = document.items("nodes"), document.items("meshes")
    with_targets = (k for k, node in enumerate(nodes) if "mesh" in node and morph_target_names(meshes[node["mesh"]]))
    below = [rig.names[node] for node in with_targets if rig.node in rig.upwards(int(rig.parents[node]))]
    if below and any(clip.channel(rig.node, "weights") is None for clip in clips):
        yield (
            f"{where}: three.js before 0.184 gives its new weights to the morph targets of"
            f" {listed(below)} too, as these are below it; let them stand beside it"
        )
    node = nodes[rig.node]
    attached = "camera" in node or "KHR_lights_punctual" in node.get("extensions", {})
    if any(rig.node in skin.get("joints", []) for skin in document.items("skins")):
        yield f"{where}: three.js since 0.184 plays no weights of a node that is a joint; {_OWN_NODE}"
    elif attached and len(meshes[rig.mesh]["primitives"]) > 1:
        yield (
            f"{where}: three.js since 0.184 plays no weights of several primitives on a node with a camera or light;"
            f" {_OWN_NODE}"
        )


def _describe_mesh(mesh: BakedMesh, mode: Mode) -> Json:
    plan, rig, fine = mesh.plan, mesh.plan.rig.own, mesh.plan.fine
    data = {
        "node": rig.node_name,
        "coarse_vertices": len(fine.surface.weld),
        # Weights alone leave the mesh as it is.
        "vertices": len(fine.surface.weld if mode == "weights" else fine.weld),
        "coarse_triangles": len(fine.surface.triangles),
        "triangles": len(fine.surface.triangles if mode == "weights" else fine.triangles),
        "levels": fine.subdivision.levels,
        "edges_at_max_levels": fine.subdivision.limited,
        "edges_blocked": fine.subdivision.blocked,
        "vertices_pruned": fine.pruned_count,
        "max_error": plan.max_error,
        "tallest_wrinkle": plan.tallest,
    }
    if mode == "morph":
        before, after = mesh.own_bytes
        data["own_targets"] = {"count": len(rig.morph_names), "bytes_before": before, "bytes": after}
        # All morph targets count, those of the asset among them.
        data["gpu_bytes"] = texture_bytes(plan, len(rig.morph_names) + len(targets_of(mesh.effects)))
        if mesh.split is not None and mesh.split.nodes:
            data |= {"gpu_bytes": mesh.split.gpu_bytes, "parts": list(mesh.split.nodes)}
        elif mesh.split is not None:
            data["split_gpu_bytes"] = mesh.split.gpu_bytes
    return data


def _describe_clips(baked: Sequence[BakedMesh], *, details: bool) -> list[Json]:
    """An entry for each clip, which may move several meshes."""
    clips: dict[str, Json] = {}
    for mesh in baked:
        for motion in mesh.motions:
            head = {
                "name": motion.clip.name,
                "start": significant(motion.clip.start),
                "end": significant(motion.clip.end),
                "times": [significant(each) for each in motion.times] if details else [],
                "tools": [],
            }
            entry = clips.setdefault(motion.clip.name, head)
            entry["keys"] = entry.get("keys", 0) + len(motion.keys)
            if motion.clip.name in mesh.residuals:
                # The distance of the written file from the method in one clip, except in gaps that are too short for a
                # key.
                residual = mesh.residuals[motion.clip.name]
                entry["residual"] = {
                    "gap": 2.0 * KEY_GAP,
                    "position": significant(residual.position, 4),
                    "time": significant(residual.time),
                    "weights": significant(residual.weights, 4),
                    "normal_degrees_99": None if residual.normal is None else round(residual.normal, 3),
                }
        for number, effect in enumerate(mesh.effects if details else ()):
            for motion in mesh.motions:
                described = effect.words.describe_clip(motion.seen(number))
                if described is not None:
                    clips[motion.clip.name].setdefault(effect.section, []).append(described)
    return list(clips.values())
