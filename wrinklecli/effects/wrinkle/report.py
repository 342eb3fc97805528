"""The entries of wrinkling tools in the report of a bake: JSON values only, lengths in scene units."""

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.wrinkle.activity import Activity
from wrinklecli.effects.wrinkle.carry import CarriedPatch
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, significant

# v of the lines whose lengths are reported, without both borders, where heights are 0.
_LINES = np.linspace(-0.75, 0.75, 13)


def describe_tool(plan: MeshPlan, carried: CarriedPatch, region: int, targets: tuple[str, ...]) -> Json:
    """A tool on its mesh, with its targets; `region` is the number of its patch in the refinement."""
    patch, fine = carried.patch, plan.fine
    return {
        "name": patch.tool.name,
        "node": plan.rig.names[plan.rig.node],
        "rest_length": patch.rest_length,
        "anchor_distances": [anchor.distance for anchor in patch.anchors],
        "moved_vertices": len(carried.vertices),
        "stuck_vertices": carried.stuck,
        **({} if patch.mask is None else {"mask": significant(patch.mask_share)}),
        "scheme": fine.schemes[region],
        "hard_edges": significant(fine.hard_shares[region]),
        "departure": significant(fine.departures[region]),
        "targets": list(targets),
    }


def describe_activity(carried: CarriedPatch, seen: Activity, clip: Clip) -> Json:
    """One tool in one clip, frame by frame, scene units.

    `heights` are those of the control curve at strength 1; `tallest` is the greatest height of the mesh.
    """
    patch, curve = carried.patch, carried.patch.curve
    finite = np.where(np.isfinite(seen.distances), seen.distances, seen.rest_lengths)
    # A taut curve is as long as the distance of its ends. A shortened one keeps its length, except for the unabsorbed
    # part. Lengths are those before the tissue takes its part.
    ends = finite + curve.compressible / (1.0 - curve.compressible) * seen.shortenings
    wanted = np.maximum(ends, ends + seen.shortenings) - seen.unabsorbed
    error = np.abs(curve.lengths(seen.amplitudes, ends) - wanted)
    deepest = int(seen.shortenings.argmax())
    lines = patch.line_lengths(seen.amplitudes[deepest], float(ends[deepest]), _LINES) / wanted[deepest] - 1.0
    return {
        "name": patch.tool.name,
        "strength": patch.tool.strength_in(clip.name),
        "distance": [None if np.isinf(each) else significant(each) for each in seen.distances],
        "rest_length": _list(seen.rest_lengths),
        "shortening": _list(seen.shortenings),
        "unabsorbed": _list(seen.unabsorbed),
        "heights": [_list(frame) for frame in curve.heights(seen.amplitudes)],
        "curve_length_error": [significant(each, 3) for each in error],
        # Errors of lines beside the segment, relative to its length at the time when it is shortest.
        "line_length_errors": {
            "v": _list(_LINES),
            "errors": [significant(each, 3) for each in lines],
            "worst": significant(np.abs(lines).max(), 3),
            "rms": significant(np.sqrt(np.mean(lines**2)), 3),
        },
        "tallest": significant(carried.tallest(seen.amplitudes, clip)),
    }


def _list(values: Floats) -> list[float]:
    return [significant(each) for each in values]
