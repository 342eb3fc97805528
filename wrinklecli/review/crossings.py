"""Count where surfaces pass through themselves or each other, in clips, before and after a bake."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from wrinklecli.baking.baked_body import bodies_of_parts, wrinkle_targets
from wrinklecli.baking.original import original, wrinkled
from wrinklecli.baking.track import with_driven_weights
from wrinklecli.character.clip import Clip, chosen_clips, clip_grid, read_clips
from wrinklecli.character.joined import with_clips, with_free_nodes
from wrinklecli.character.moved import moved
from wrinklecli.character.rig import read_rig
from wrinklecli.character.scene import deforming_nodes
from wrinklecli.character.scene_surface import CrossingPairs, SceneSurface, read_scene_surface
from wrinklecli.errors import BakeError, log_findings
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.shape import Json
from wrinklecli.numeric.arrays import Floats, distinct, distinct_values, significant
from wrinklecli.numeric.guard import Progress, guarded, log_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.review.check import CheckOptions
from wrinklecli.review.coarse import CoarseCounter
from wrinklecli.review.preview.apply import apply_tools, plan_tools

# Version of the JSON.
VERSION = 1
# Evenly spaced moments of a clip, if the options have no frame rate.
_MOMENTS = 13
# Coordinates below this part of the greatest are written as 0.
_ROUNDING = 1e-4
# Decimal digits of measured numbers.
_DIGITS = 6
# Names of the states of an asset that are compared, by their number.
_NAMES = {1: ("asset",), 2: ("before", "after")}
# Warning about a file whose record of the original does not fit.
_REWRITTEN = (
    "has been rewritten since its bake, and no longer tells what it was before: it is looked at as it is, wrinkled"
)


@dataclass(frozen=True, slots=True)
class CrossingsFound:
    """The result of `crossings`: what `check --crossings --json` prints, the files that were read, and warnings."""

    data: Json
    inputs: tuple[str, ...]
    warnings: tuple[str, ...]


def crossings(
    asset: str | os.PathLike[str],
    tools: str | os.PathLike[str] | None = None,
    options: CheckOptions | None = None,
    *,
    progress: Progress = log_progress,
    **named: Any,
) -> CrossingsFound:
    """Count the edges that pass through triangles at moments of each clip, of all meshes of a scene together.

    The asset without wrinkles is counted, and the asset with those of the tools or with those that it carries. Where no
    wrinkle moves the surface, parts of an edge or triangle that refinement has split count as one, as before the bake.
    Where wrinkles do, refinement alone makes more of each crossing: "level" of a clip has the counts of the refined
    surface without them.

    Args:
        asset: The .gltf or .glb to read.
        tools: The YAML file of tools, if any.
        options: The defaults of `CheckOptions` if None.
        progress: Called with a stage's name, steps done and steps in all.
        named: Single options by their names in `CheckOptions`, in place of those in `options`.

    Raises:
        WrinkleError: The asset or the tools file is at fault.
        TypeError: `CheckOptions` lacks a name of `named`.

    Examples:
        >>> from wrinklecli import crossings
        >>> found = crossings("samples/wrist.glb", clips=["flex"], fps=1)
        >>> found.data["clips"][0]["counts"]  # of the asset alone, in three moments of the clip
        [[0, 0, 0]]
    """
    options = replace(options or CheckOptions(), **named)
    with guarded(os.fspath(asset)):
        document = read_document(asset, allow_external=options.allow_external, memory=Memory(options.max_memory))
        documents, clips, warnings = _states(document, tools, options, progress)
        states: list[_State] = []
        for state in documents:
            surface = read_scene_surface(state, bodies_of_parts(state))
            states.append(_State(surface, state, CoarseCounter(states[0].surface, surface) if states else None))
        entries = []
        for number, clip in enumerate(clips, start=1):
            entries.append(_describe_clip(states, clip, options.fps))
            progress("crossings", number, len(clips))
    data: Json = {
        "crossings": VERSION,
        "asset": os.fspath(asset),
        "tools_file": None if tools is None else os.fspath(tools),
        "states": list(_NAMES[len(states)]),
        "stored_pose": [len(each.found(None, np.zeros(1))[0].edges) for each in states],
        "clips": entries,
        "warnings": list(warnings),
    }
    log_findings(warnings, where=os.fspath(asset))
    inputs = (*document.files, *(os.fspath(anim) for anim in options.anims))
    return CrossingsFound(data, inputs if tools is None else (*inputs, os.fspath(tools)), warnings)


@dataclass(frozen=True, slots=True)
class _State:
    """The surface of an asset before or after a bake, and the document with the clips that move it.

    After a bake, crossings are counted as on the surface before, where nothing of the bake moves it.
    """

    surface: SceneSurface
    document: Document
    counter: CoarseCounter | None

    def found(self, clip: Clip | None, times: Floats) -> list[CrossingPairs]:
        """Find what crosses at each of (frames,) seconds of a clip, or in the stored pose."""
        every = self.surface.found(clip, times)
        return every if self.counter is None else self.counter.reduced(clip, times, every)

    def level(self, clip: Clip, times: Floats) -> list[int] | None:
        """Count what would cross if nothing of the bake moved the refined surface; None without a bake."""
        if self.counter is None or not self.counter.is_moved:
            return None
        every = self.counter.level.found(clip, times)
        return [len(each.edges) for each in self.counter.reduced(clip, times, every)]


def _states(
    document: Document,
    tools: str | os.PathLike[str] | None,
    options: CheckOptions,
    progress: Progress,
) -> tuple[list[Document], tuple[Clip, ...], tuple[str, ...]]:
    """The asset without and with wrinkles, or only as it is if it has none; the chosen clips; and warnings.

    BakeError if no tool fits, or if the file is baked, and its original cannot be restored.
    """
    carries = bool(wrinkled(document.gltf))
    rewritten: tuple[str, ...] = ()
    try:
        before = original(document)
    except BakeError:
        if tools is not None:
            raise
        before, carries = document, False
        rewritten = (f"{document.path}: {_REWRITTEN}",)
    if carries and tools is None:
        before = _with_further_clips(before, document)
    driven = wrinkle_targets(document)
    joined = moved(before, deforming_nodes(before), options.motions, driven=driven)
    clips = chosen_clips(joined.clips, joined.chosen(options.clips), where=document.path)
    if tools is None:
        shown = moved(document, deforming_nodes(document), options.motions, driven=driven)
        after, unread = with_driven_weights(shown.document, [clip.name for clip in clips if clip.name in shown.further])
        states = [joined.document, after] if carries else [after]
        return states, tuple(clips), (*rewritten, *unread)
    planned = plan_tools(joined.document, tools, options.bake_options)
    if planned.job is None:
        raise BakeError.of_all([BakeError(line) for line in planned.warnings])
    after, left_out = apply_tools(planned, [clip.name for clip in clips], progress)
    return [joined.document, after], tuple(clips), (*planned.warnings, *left_out)


def _with_further_clips(before: Document, baked: Document) -> Document:
    """The original with the clips that only the baked file has: those of the bake's `--anim`.

    The original's nodes and morph targets have the same numbers in both, and the bake's own follow.
    """
    rigs = {node: read_rig(before, node) for node, each in enumerate(before.items("nodes")) if "mesh" in each}
    further = []
    for clip in read_clips(baked):
        if clip.index < len(before.items("animations")):
            continue
        channels = []
        for channel in clip.channels:
            if channel.path == "weights":
                count = len(rigs[channel.node].morph_names) if channel.node in rigs else 0
                channel = replace(channel, values=channel.values[..., :count])
            if channel.values.size and channel.node < len(before.items("nodes")):
                channels.append(channel)
        further.append(replace(clip, channels=tuple(channels)))
    moving = {channel.node for clip in further for channel in clip.channels}
    return with_clips(with_free_nodes(before, moving), further)


def _describe_clip(states: Sequence[_State], clip: Clip, fps: float | None) -> Json:
    """Count the crossings of each state at moments of a clip."""
    moments = distinct_values(np.linspace(clip.start, clip.end, _MOMENTS))
    times = moments if fps is None else clip_grid(clip, None, fps=fps)
    found, level = [], None
    for each in states:
        (own,) = [other for other in read_clips(each.document) if other.index == clip.index]
        found.append(each.found(own, times))
        level = each.level(own, times)
    counts = [[len(frame.edges) for frame in frames] for frames in found]
    places: dict[str, Json] = {}
    for number, (each, frames) in enumerate(zip(states, found, strict=True)):
        for name, count, where in _by_place(each.surface, frames):
            entry = places.setdefault(name, {"between": name, "counts": [0] * len(states)})
            entry["counts"][number] = count
            entry["at"] = [_round(x) for x in where]
    return {
        "name": clip.name,
        "times": [_round(time) for time in times],
        "counts": counts,
        "totals": [sum(each) for each in counts],
        "level": level,
        "places": sorted(places.values(), key=lambda each: (-max(each["counts"]), each["between"])),
    }


def _by_place(surface: SceneSurface, frames: Sequence[CrossingPairs]) -> Iterator[tuple[str, int, Floats]]:
    """Yield, for each pair of parts that cross, their names, the number of crossings and the middle at rest."""
    edges = np.concatenate([np.zeros((0, 2), np.intp), *(each.edges for each in frames)])
    triangles = np.concatenate([np.zeros((0, 3), np.intp), *(each.triangles for each in frames)])
    if not len(edges):
        return
    # A crossing lies between the first vertices of its edge and its triangle.
    ends = np.stack([edges[:, 0], triangles[:, 0]], axis=1)
    pairs = np.sort(surface.owners(ends) * len(surface.rigs[0].names) + surface.carriers[ends], axis=1)
    firsts, which = distinct(pairs)
    counts = Counter(which.tolist())
    for number, first in enumerate(firsts):
        one, other = (_name(surface, int(part)) for part in pairs[first])
        middle = surface.positions[ends[which == number]].mean(axis=(0, 1))
        middle = np.where(np.abs(middle) > _ROUNDING * np.abs(surface.positions).max(), middle, 0.0)
        yield one if one == other else f"{one} – {other}", counts[number], middle


def _name(surface: SceneSurface, part: int) -> str:
    """The name of a joint, with that of its mesh if there are several."""
    owner, joint = divmod(part, len(surface.rigs[0].names))
    rig = surface.rigs[owner]
    name = rig.names[joint]
    return name if len(distinct_values(surface.wholes)) == 1 else f"{rig.node_name}: {name}"


def _round(value: float) -> float:
    return significant(value, _DIGITS)
