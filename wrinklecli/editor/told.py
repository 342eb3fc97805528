"""What an editor tells of a tool on its mesh: its control curve, its heights, its warnings."""

from collections.abc import Iterable, Sequence

import numpy as np

from wrinklecli.baking.sample import ClipActivity, moving_clips
from wrinklecli.baking.warnings import mesh_warnings, tool_warnings
from wrinklecli.character.clip import Clip
from wrinklecli.editor.attached import AttachedTool, AttachedTools
from wrinklecli.editor.clip_cache import ClipCache
from wrinklecli.numeric.arrays import Floats
from wrinklecli.tools.records import ToolsFile

# Points of a drawn control curve.
_CURVE_POINTS = 200


def control_curve(tool: AttachedTool, played: ClipCache, clip: Clip | None, time: float) -> Floats:
    """(points, 2) a tool's control curve at a time of a clip, seconds: along it, and its height, scene units."""
    patch = tool.patch
    amplitudes, distance = played.at(tool.ground, patch, clip, time)
    us = np.linspace(0.0, 1.0, _CURVE_POINTS)
    strength = patch.clip_strength(clip) * patch.shape_strength
    heights = strength * np.einsum("gm,gmv->v", amplitudes[0], patch.curve.shapes(us))
    return np.stack([us * (distance if np.isfinite(distance) else 0.0), heights], axis=1)


def heights_over(tool: AttachedTool, played: ClipCache, clip: Clip) -> tuple[Floats, Floats]:
    """(frames,) seconds of a clip and (frames,) the height of a tool's highest bump then, scene units."""
    patch, times = tool.patch, played.times(clip)
    seen = played.activity(tool.ground, patch, clip)
    strength = abs(patch.clip_strength(clip) * patch.shape_strength)
    return times, strength * patch.curve.heights(seen.amplitudes).reshape(len(times), -1).max(axis=1)


def warnings_of(
    laid: AttachedTools, played: ClipCache, clips: Sequence[Clip], settings: ToolsFile
) -> dict[str, list[str]]:
    """What `check` warns of, by the name of the tool that a line is about; of meshes by an empty name.

    Args:
        laid: The tools, refined.
        played: What they do.
        clips: To look at.
        settings: The tools file.
    """
    found: dict[str, list[str]] = {}
    for tool in laid.tools.values():
        seen = [
            ClipActivity(clip, played.times(clip), played.activity(tool.ground, tool.patch, clip))
            for clip in moving_clips(tool.plan, clips)
        ]
        _add(found, [tool.patch.tool.name], tool_warnings(tool.plan, tool.carried, seen, up=settings.up))
    for plan in {id(each.plan): each.plan for each in laid.tools.values()}.values():
        names = [each.patch.tool.name for each in plan.carried_patches]
        _add(found, names, mesh_warnings(plan, settings, clips, tracks=False))
    return found


def _add(found: dict[str, list[str]], names: Iterable[str], lines: Iterable[str]) -> None:
    """Put lines to the tools that they begin with."""
    for line in lines:
        of = [name for name in names if line.startswith((f"{name}: ", f"{name} and "))]
        own = found.setdefault(of[0] if of else "", [])
        if line not in own:
            own.append(line)
