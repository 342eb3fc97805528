"""The entries of wrinkling tools in the report of a bake: JSON values only, lengths in scene units."""

from dataclasses import asdict

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.wrinkle.activity import Activity, ClipActivity
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, children, significant
from wrinklecli.surface.anchor import Anchor
from wrinklecli.surface.refine import Refinement
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import in_axes

# v of the lines whose lengths are reported, without both borders, where heights are 0.
_LINES = np.linspace(-0.75, 0.75, 13)


def describe_tool(plan: MeshPlan, carried: CarriedPatch, region: int, targets: tuple[str, ...]) -> Json:
    """A tool on its mesh, with its targets; `region` is the number of its patch in the refinement."""
    patch, fine = carried.patch, plan.fine
    return {
        "name": patch.tool.name,
        "node": plan.rig.node_name,
        "rest_length": patch.rest_length,
        "anchor_distances": [anchor.distance for anchor in patch.anchors],
        "moved_vertices": len(carried.vertices),
        "stuck_vertices": carried.stuck,
        **_describe_surface(patch, fine, region),
        "targets": list(targets),
    }


def _describe_surface(patch: Patch, fine: Refinement, region: int) -> Json:
    """Describe how much of a tool its mask leaves, and what refinement does to the surface under it."""
    return {
        **({} if patch.mask is None else {"mask": significant(patch.mask_share)}),
        "scheme": fine.schemes[region],
        "hard_edges": significant(fine.hard_shares[region]),
        "departure": significant(fine.departures[region]),
    }


def describe_activity(carried: CarriedPatch, seen: Activity, clip: Clip) -> Json:
    """One tool in one clip, frame by frame, scene units.

    `heights` are those of the control curve at strength 1; `tallest` is the greatest height of the mesh.
    """
    patch, curve = carried.patch, carried.patch.curve
    # Details are a part of the proof, so they are by the curve itself.
    amplitudes, _ = curve.follow(seen.distances, seen.rest_lengths)
    finite = np.where(np.isfinite(seen.distances), seen.distances, seen.rest_lengths)
    # A taut curve is as long as the distance of its ends. A shortened one keeps its length, except for the unabsorbed
    # part. Lengths are those before the tissue takes its part.
    ends = finite + curve.compressible / (1.0 - curve.compressible) * seen.shortenings
    wanted = np.maximum(ends, ends + seen.shortenings) - seen.unabsorbed
    error = np.abs(curve.lengths(amplitudes, ends) - wanted)
    deepest = int(seen.shortenings.argmax())
    lines = patch.line_lengths(amplitudes[deepest], float(ends[deepest]), _LINES) / wanted[deepest] - 1.0
    return {
        "name": patch.tool.name,
        "strength": patch.tool.strength_in(clip.name),
        "distance": [None if np.isinf(each) else significant(each) for each in seen.distances],
        "rest_length": _list(seen.rest_lengths),
        "shortening": _list(seen.shortenings),
        "unabsorbed": _list(seen.unabsorbed),
        "heights": [_list(frame) for frame in curve.heights(amplitudes)],
        "curve_length_error": [significant(each, 3) for each in error],
        # Errors of lines beside the segment, relative to its length at the time when it is shortest.
        "line_length_errors": {
            "v": _list(_LINES),
            "errors": [significant(each, 3) for each in lines],
            "worst": significant(np.abs(lines).max(), 3),
            "rms": significant(np.sqrt(np.mean(lines**2)), 3),
        },
        "tallest": significant(carried.tallest(amplitudes, clip)),
    }


def describe_place(plan: MeshPlan, carried: CarriedPatch, region: int, up: str) -> Json:
    """Describe a tool on its mesh, independent of clips; JSON values only."""
    patch, fine, between = carried.patch, plan.fine, carried.patch.tool.between
    members = np.unique(fine.triangles[children(fine.subdivision.parents, patch.members)])
    return {
        "name": patch.tool.name,
        "node": plan.rig.node_name,
        "where": patch.tool.where,
        "origin": _describe_anchor(plan, patch.origin, up),
        **({"between": [_describe_anchor(plan, each, up) for each in patch.anchors[1:-1]]} if between else {}),
        "target": _describe_anchor(plan, patch.target, up),
        "distance": significant(patch.span),
        "rest_length": significant(patch.rest_length),
        "width": significant(2.0 * patch.half_width),
        "laid": _describe_pose(plan, patch.pose),
        "material": patch.tool.material or "none",
        "bumps": patch.tool.bumps,
        "strategy": patch.tool.strategy,
        "compressible": patch.tool.compressible,
        "lag": None if patch.tool.lag is None else asdict(patch.tool.lag),
        "height_limit": significant(patch.greatest_height),
        "triangles": len(patch.members),
        "edges_split": int((members >= len(fine.surface.positions)).sum()),
        "moved_vertices": len(carried.vertices),
        **({} if patch.reach is None else {"left_by_features": significant(carried.left_by_features(fine))}),
        **_describe_surface(patch, fine, region),
    }


def _describe_pose(plan: MeshPlan, pose: Rest) -> Json | str:
    """Describe the pose in which a tool is laid: stored, the weights of raised morph targets, or a moment of a clip."""
    if pose is plan.rest:
        return "stored"
    if pose.clip is not plan.rest.clip or pose.time is not plan.rest.time:
        assert pose.clip is not None, "other poses are moments of clips"
        return {"clip": pose.clip.name, "time": significant(float(pose.time[0]))}
    raised = np.flatnonzero(pose.morph_weights != plan.rest.morph_weights)
    return {"raised": {plan.rig.morph_names[k]: significant(float(pose.morph_weights[k])) for k in raised}}


def _describe_anchor(plan: MeshPlan, anchor: Anchor, up: str) -> Json:
    surface = plan.fine.surface
    welded = anchor.vertices[np.argmax(anchor.barycentrics)]
    vertex = int(np.flatnonzero(surface.weld == welded)[0])
    primitive = int(np.searchsorted(surface.vertex_starts, vertex, side="right")) - 1
    return {
        "position": [significant(each) for each in in_axes(anchor.position.tolist(), up)],
        "off": significant(anchor.distance),
        "primitive": primitive,
        "vertex": vertex - int(surface.vertex_starts[primitive]),
    }


def describe_heights(carried: CarriedPatch, each: ClipActivity) -> Json:
    """Describe a tool in a clip; shortenings are over the rest length, and None if the tool is hidden throughout."""
    clip, seen = each.clip, each.seen
    strength = carried.patch.tool.strength_in(clip.name)
    shown = np.isfinite(seen.distances)
    if not shown.any():
        return {"name": clip.name, "strength": strength, "shortening": None, "time": None} | dict.fromkeys(
            ("unabsorbed", "height"), 0.0
        )
    shortenings = 1.0 - np.where(shown, seen.distances, seen.rest_lengths) / seen.rest_lengths
    most = int(np.argmax(np.where(shown, shortenings, -np.inf)))
    return {
        "name": clip.name,
        "strength": strength,
        "shortening": [significant(shortenings[shown].min()), significant(shortenings[most])],
        "time": significant(each.times[most]),
        "unabsorbed": significant((seen.unabsorbed / seen.rest_lengths).max()),
        "height": significant(carried.tallest(seen.amplitudes, clip)),
    }


def _list(values: Floats) -> list[float]:
    return [significant(each) for each in values]
