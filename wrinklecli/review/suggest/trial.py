"""Suggested tools laid on the mesh as a bake refines it: those that reach across a fold there are made narrower.

Regions are measured on the mesh as it is. Only the refined one shows what its wrinkles reach, and whether it can be
refined enough to show them.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wrinklecli.baking.job import tools_by_node
from wrinklecli.baking.plan import plan_mesh
from wrinklecli.baking.warnings import DEPARTURE, placement_warnings
from wrinklecli.character.clip import Clip
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Ints, distinct_values
from wrinklecli.review.suggest.fitting import Suggestion
from wrinklecli.review.suggest.text import tools_text
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import Length

# How often a tool is made narrower, and what is left of its width each time.
_TRIES, _NARROWER = 3, 0.75
# Of a bake.
_MAX_ERROR = Length(1.0, percent=True)


@dataclass(frozen=True, slots=True)
class Tried:
    """Suggestions that lie well, as far as they can.

    Attributes:
        tools: Best first.
        midpoint: Whether refinement must keep the mesh as it is, since rounding would show at rest.
        notes: What was left out, a line each.
    """

    tools: list[Suggestion]
    midpoint: bool
    notes: list[str]


@dataclass(frozen=True, slots=True)
class _Lie:
    """How a tool lies on the refined mesh.

    Attributes:
        node: That has the mesh.
        vertices: (vertices,) of the mesh under its patch, ascending.
        crosses: Whether `check` would warn of its place.
        coarse: Whether edges on its mesh stay too long for wrinkles.
        departs: Whether refinement moves the surface under it so much that it shows at rest.
    """

    node: int
    vertices: Ints
    crosses: bool
    coarse: bool
    departs: bool


def tried(document: Document, suggestions: Sequence[Suggestion], clips: Sequence[Clip], *, midpoint: bool) -> Tried:
    """Suggestions as narrow as they lie well; those that do not, however narrow they are, as they were.

    A path that does not lie well as it is gives way to the straight tool.

    Left out are those where triangles are so long that refinement ends before they show wrinkles.

    Args:
        document: The asset.
        suggestions: Those to lay.
        clips: All of the asset.
        midpoint: As of `tools_text`.
    """
    lies = _lies(document, suggestions, clips, midpoint=midpoint)
    if any(lie.departs for lie in lies.values()) and not midpoint:
        midpoint = True
        lies = _lies(document, suggestions, clips, midpoint=True)

    def is_coarse(each: Suggestion) -> bool:
        # A mesh tells only that some tool on it asks for too much.
        return any(lies[name].coarse for name in _names(each, lies)) and any(
            lie.coarse for lie in _lies(document, [each], clips, midpoint=midpoint).values()
        )

    straight = [
        each.straight
        if each.straight is not None and (any(lies[name].crosses for name in _names(each, lies)) or is_coarse(each))
        else each
        for each in suggestions
    ]
    if any(each is not was for each, was in zip(straight, suggestions, strict=True)):
        suggestions = straight
        lies = _lies(document, suggestions, clips, midpoint=midpoint)
    coarse = [each for each in suggestions if is_coarse(each)]
    notes = [
        f"{each.mesh}: left out a fold that {each.driver} makes: its triangles are too long to show wrinkles there"
        for each in coarse
    ]
    old = [each for each in suggestions if each not in coarse]
    kept = list(old)
    for _ in range(_TRIES):
        crossing = [any(lies[name].crosses for name in _names(each, lies)) for each in kept]
        if not any(crossing):
            break
        kept = [_narrower(each) if crosses else each for each, crosses in zip(kept, crossing, strict=True)]
        moved = [
            lies[name] for each, crosses in zip(kept, crossing, strict=True) if crosses for name in _names(each, lies)
        ]
        again = [each for each in kept if any(_touch(lies[name], lie) for name in _names(each, lies) for lie in moved)]
        lies |= _lies(document, again, clips, midpoint=midpoint)
    crossing = [any(lies[name].crosses for name in _names(each, lies)) for each in kept]
    tools = [first if crosses else each for first, each, crosses in zip(old, kept, crossing, strict=True)]
    return Tried(tools, midpoint, notes)


def _lies(
    document: Document, suggestions: Sequence[Suggestion], clips: Sequence[Clip], *, midpoint: bool
) -> dict[str, _Lie]:
    """How tools lie, by their names; of those that cannot be laid at all nothing."""
    if not suggestions:
        return {}
    try:
        settings = parse_tools(tools_text(suggestions, "", midpoint=midpoint))
        by_node, _ = tools_by_node(document, settings)
        plans = [
            plan_mesh(document, node, tools, settings, tuple(clips), _MAX_ERROR) for node, tools in by_node.items()
        ]
    except WrinkleError:
        return {}
    return {
        carried.patch.tool.name: _Lie(
            node=plan.rig.node,
            vertices=distinct_values(plan.fine.surface.triangles[carried.patch.members]),
            crosses=bool(placement_warnings(plan, carried)),
            coarse=plan.fine.subdivision.limited > 0,
            departs=departure > DEPARTURE,
        )
        for plan in plans
        for carried, departure in zip(plan.carried_patches, plan.fine.departures, strict=True)
    }


def _touch(first: _Lie, second: _Lie) -> bool:
    """Whether the refinement under one tool may change that under another."""
    return first.node == second.node and len(np.intersect1d(first.vertices, second.vertices)) > 0


def _names(suggestion: Suggestion, lies: dict[str, _Lie]) -> Iterator[str]:
    """Of its tool, and of its twin, where they could be laid."""
    names = [suggestion.tool.name, *([exchange_sides(suggestion.tool.name)] if suggestion.mirrored else [])]
    return (name for name in names if name in lies)


def _narrower(suggestion: Suggestion) -> Suggestion:
    width = float(f"{_NARROWER * suggestion.tool.width.value:.2g}")
    return replace(suggestion, tool=replace(suggestion.tool, width=Length(width)))
