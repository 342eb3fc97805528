"""What a bake did: warnings for people, numbers for machines."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wrinklecli.baking.budget import texture_bytes
from wrinklecli.baking.extras import METHOD
from wrinklecli.baking.plan import MeshPlan, Mode
from wrinklecli.baking.proof import Residual
from wrinklecli.baking.sample import Motion
from wrinklecli.baking.targets import TargetSet, targets_of
from wrinklecli.baking.warnings import placement_warnings, twin_warnings
from wrinklecli.character.clip import Clip
from wrinklecli.gltf.document import Document
from wrinklecli.method.activity import Activity
from wrinklecli.method.carry import CarriedPatch
from wrinklecli.method.patch import Patch
from wrinklecli.numeric.arrays import Floats
from wrinklecli.tools.records import ToolsFile

Json = dict[str, Any]

VERSION = 1

# A shortening below this part of the rest length is as good as none.
_VISIBLE = 1e-3
# Decimal digits of measured numbers: those that tell any two float32 values apart.
_DIGITS = 9


@dataclass(slots=True)
class Report:
    """What a bake did.

    Attributes:
        data: For `--report`: JSON values only.
        warnings: A line each; with `--strict` any of them refuses the result.
        inputs: Every file that was read.
        bytes_written: Size of OUT with the files beside it.
        timings: For `--timings`: JSON values only.
    """

    data: Json
    warnings: list[str] = field(default_factory=list)
    inputs: list[str] = field(default_factory=list)
    bytes_written: int = 0
    timings: Json = field(default_factory=dict)

    @property
    def summary(self) -> str:
        """One line: what was made."""
        meshes = self.data["meshes"]
        targets = sum(len(tool["targets"]) for tool in self.data["tools"])
        added = sum(mesh["vertices"] - mesh["coarse_vertices"] for mesh in meshes)
        parts = [
            _counted(len(self.data["tools"]), "tool"),
            _counted(targets, "morph target") if self.data["mode"] == "morph" else "per-frame geometry",
            _counted(added, "new vertex", "new vertices"),
            _counted(len(self.data["clips"]), "clip"),
        ]
        if self.data["mode"] == "morph":
            parts.append(f"{sum(mesh['gpu_bytes'] for mesh in meshes) / 1e6:.1f} MB of targets on a GPU")
        proven = [clip["residual"] for clip in self.data["clips"] if clip.get("residual")]
        if proven and self.data["tallest_wrinkle"]:
            worst = max(each["position"] for each in proven)
            share = 100 * worst / self.data["tallest_wrinkle"]
            parts.append(f"within {worst:.2g} ({share:.2g} % of the tallest wrinkle)")
        return ", ".join(parts)


@dataclass(frozen=True, slots=True)
class Baked:
    """All that was made of one node's mesh; residuals by clip."""

    plan: MeshPlan
    target_sets: list[TargetSet]
    motions: list[Motion]
    residuals: dict[str, Residual]


def make_report(
    document: Document,
    settings: ToolsFile,
    mode: Mode,
    baked: Sequence[Baked],
    warnings: list[str],
    *,
    details: bool,
) -> Report:
    """Gather what was made; frame by frame only with `details`."""
    clips: dict[str, Json] = {}
    meshes, tools = [], []
    for each in baked:
        plan, rig = each.plan, each.plan.rig
        split = plan.fine.subdivision
        meshes.append(
            {
                "node": rig.names[rig.node],
                "coarse_vertices": len(plan.fine.surface.weld),
                "vertices": len(plan.fine.weld),
                "coarse_triangles": len(plan.fine.surface.triangles),
                "triangles": len(plan.fine.triangles),
                "levels": split.levels,
                "edges_at_max_levels": split.limited,
                "edges_blocked": split.blocked,
                "vertices_pruned": plan.fine.pruned_count,
                "max_error": plan.max_error,
                "tallest_wrinkle": plan.tallest,
                **({"gpu_bytes": _gpu_bytes(each)} if mode == "morph" else {}),
            }
        )
        warnings += mesh_warnings(plan, settings, [motion.clip for motion in each.motions], mode)
        for motion in each.motions:
            times = motion.times if details else motion.times[:0]
            entry = clips.setdefault(motion.clip.name, describe_clip(motion.clip, times))
            entry["keys"] = entry.get("keys", 0) + len(motion.keys)
            if motion.clip.name in each.residuals:
                entry["residual"] = describe_residual(each.residuals[motion.clip.name])
        for number, target_set in enumerate(each.target_sets):
            patch = target_set.carried.patch
            seen = [(motion.clip, motion.times, motion.seen[number]) for motion in each.motions]
            warnings += placement_warnings(plan, target_set.carried) + warnings_of(target_set.carried, seen)
            tools.append(
                {
                    "name": patch.tool.name,
                    "node": rig.names[rig.node],
                    "rest_length": patch.rest_length,
                    "anchor_distances": [patch.origin.distance, patch.target.distance],
                    "moved_vertices": len(target_set.carried.vertices),
                    "stuck_vertices": target_set.carried.stuck,
                    "targets": [target.name for target in target_set.targets if target is not None],
                }
            )
            if details:
                for clip, _, what in seen:
                    strength = patch.tool.clips.get(clip.name, patch.tool.strength)
                    clips[clip.name]["tools"].append(describe_activity(patch, what, strength))
    return Report(
        data={
            "report": VERSION,
            "method": METHOD,
            "asset": document.path,
            "tools_file": settings.path,
            "mode": mode,
            "tallest_wrinkle": max(each.plan.tallest for each in baked),
            "meshes": meshes,
            "tools": tools,
            "clips": list(clips.values()),
            "warnings": warnings,
        },
        warnings=warnings,
    )


def _gpu_bytes(baked: Baked) -> int:
    """What all morph targets of a mesh take on the GPU, those of the asset among them."""
    return texture_bytes(baked.plan, len(baked.plan.rig.morph_names) + len(targets_of(baked.target_sets)))


def _counted(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"


def describe_clip(clip: Clip, times: Floats) -> Json:
    """The head of a clip's entry."""
    return {
        "name": clip.name,
        "start": _round(clip.start),
        "end": _round(clip.end),
        "times": _list(times),
        "tools": [],
    }


def describe_activity(patch: Patch, seen: Activity, strength: float) -> Json:
    """What one tool does in one clip, frame by frame, scene units; `heights` are those of strength 1."""
    curve = patch.curve
    tallest = abs(strength) * float(np.abs(curve.heights(seen.amplitudes)).max(initial=0.0))
    finite = np.where(np.isfinite(seen.distances), seen.distances, seen.rest_lengths)
    # A taut curve is as long as its ends are apart; below that it keeps its length, less what is unabsorbed.
    wanted = np.maximum(finite, finite + seen.shortenings) - seen.unabsorbed
    error = np.abs(curve.lengths(seen.amplitudes, finite) - wanted)
    return {
        "name": patch.tool.name,
        "strength": strength,
        "distance": [None if np.isinf(each) else _round(each) for each in seen.distances],
        "rest_length": _list(seen.rest_lengths),
        "shortening": _list(seen.shortenings),
        "unabsorbed": _list(seen.unabsorbed),
        "heights": [_list(frame) for frame in curve.heights(seen.amplitudes)],
        "curve_length_error": [float(f"{each:.2e}") for each in error],
        "tallest": _round(tallest),
    }


def describe_residual(residual: Residual) -> Json:
    """How far the written file is from the method in one clip."""
    return {
        "position": float(f"{residual.position:.3e}"),
        "time": _round(residual.time),
        "weights": float(f"{residual.weights:.3e}"),
        "normal_degrees_99": None if residual.normal is None else round(residual.normal, 3),
    }


def mesh_warnings(plan: MeshPlan, settings: ToolsFile, clips: Sequence[Clip], mode: Mode) -> list[str]:
    """What a user should know of a mesh with all its tools, over the clips baked."""
    rig = plan.rig
    where = rig.names[rig.node]
    warnings = twin_warnings(plan, clips)
    if plan.fine.subdivision.limited:
        warnings.append(
            f"{where}: {plan.fine.subdivision.limited} edges are still too long for the wrinkles at max_levels"
            f" {settings.refinement.max_levels}"
        )
    return warnings + [
        f"{where}: {clip.name} gets a weights channel, which will hold the morph targets that were free there;"
        " --tracks none avoids it"
        for clip in clips
        if rig.morph_names and clip.channel(rig.node, "weights") is None and mode == "morph"
    ]


def warnings_of(carried: CarriedPatch, clips: Sequence[tuple[Clip, Floats, Activity]]) -> list[str]:
    """What a user should know of one tool, over all clips baked."""
    patch = carried.patch
    where = patch.tool.name
    warnings = []
    if patch.clip_strength(None) * patch.shape_strength not in (1.0, -1.0):
        warnings.append(f"{where}: strength {patch.tool.strength:g} does not keep the length of the surface")
    if carried.stuck:
        warnings.append(f"{where}: {carried.stuck} vertices stay put: singular at rest")
    if not clips:
        return warnings
    if max(float((seen.shortenings / seen.rest_lengths).max()) for _, _, seen in clips) < _VISIBLE:
        warnings.append(f"{where}: never shortens in {', '.join(clip.name for clip, _, _ in clips)}: no wrinkle")
    clip, times, seen = max(clips, key=lambda each: float((each[2].unabsorbed / each[2].rest_lengths).max()))
    share = seen.unabsorbed / seen.rest_lengths
    if share.max() > _VISIBLE:
        frame = int(share.argmax())
        warnings.append(
            f"{where}: {100 * share[frame]:.0f} % of its length is not absorbed in {clip.name} at"
            f" {times[frame]:.3g} s: the bumps reach max_height"
        )
    return warnings


def _round(value: float) -> float:
    return float(f"{float(value):.{_DIGITS}g}")


def _list(values: Floats) -> list[float]:
    return [_round(value) for value in values]
