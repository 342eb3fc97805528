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
from wrinklecli.numeric.arrays import Ints, distinct_values, significant
from wrinklecli.review.suggest.fitting import Suggestion
from wrinklecli.review.suggest.text import tools_text
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import Length, RefinementSettings

# How often a tool is made narrower, and what is left of its width each time.
_TRIES, _NARROWER = 3, 0.75
# Most times that an edge is halved for suggested wrinkles: then a triangle is several times as long as the fold.
_MOST_LEVELS = 6
# Of a bake.
_MAX_ERROR = Length(1.0, percent=True)


@dataclass(frozen=True, slots=True)
class Tried:
    """Suggestions that lie well, as far as they can.

    Attributes:
        tools: Best first.
        refinement: As fine as they need it; without rounding, where that would show at rest.
        notes: What was left out, a line each.
    """

    tools: list[Suggestion]
    refinement: RefinementSettings
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


@dataclass(frozen=True, slots=True)
class _Bench:
    """On what suggestions are laid: the asset, all of its clips, and how it is refined."""

    document: Document
    clips: Sequence[Clip]
    refinement: RefinementSettings

    def lies(self, suggestions: Sequence[Suggestion]) -> dict[str, _Lie]:
        """How tools lie, by their names; of those that cannot be laid at all nothing."""
        if not suggestions:
            return {}
        try:
            settings = parse_tools(tools_text(suggestions, "", self.refinement))
            by_node, _ = tools_by_node(self.document, settings)
            plans = [
                plan_mesh(self.document, node, tools, settings, tuple(self.clips), _MAX_ERROR)
                for node, tools in by_node.items()
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

    def finer(self, suggestions: Sequence[Suggestion]) -> "_Bench":
        """The least levels with which edges are short enough for some suggestions; the most where none are."""
        for levels in range(self.refinement.max_levels, _MOST_LEVELS):
            bench = replace(self, refinement=replace(self.refinement, max_levels=levels))
            if not any(lie.coarse for lie in bench.lies(suggestions).values()):
                return bench
        return replace(self, refinement=replace(self.refinement, max_levels=_MOST_LEVELS))


def tried(document: Document, suggestions: Sequence[Suggestion], clips: Sequence[Clip], *, midpoint: bool) -> Tried:
    """Suggestions as narrow as they lie well; those that do not, however narrow they are, as they were.

    A path that does not lie well as it is gives way to the straight tool. Left out are those where triangles are so
    long that not even a finer refinement than usual shows wrinkles.

    Args:
        document: The asset.
        suggestions: Those to lay.
        clips: All of the asset.
        midpoint: Whether refinement must keep faces flat.
    """
    bench = _Bench(document, clips, RefinementSettings(scheme="midpoint" if midpoint else "butterfly"))
    lies = bench.lies(suggestions)
    if any(lie.departs for lie in lies.values()) and not midpoint:
        bench = replace(bench, refinement=replace(bench.refinement, scheme="midpoint"))
        lies = bench.lies(suggestions)
    straight = [
        each.straight if each.straight is not None and any(lies[n].crosses for n in _names(each, lies)) else each
        for each in suggestions
    ]
    usual, coarse = bench, list[Suggestion]()
    if any(lie.coarse for lie in lies.values()):
        bench = usual.finer(straight)
        if bench.refinement.max_levels == _MOST_LEVELS:
            # A mesh tells only that some tool on it asks for too much.
            coarse = [each for each in straight if any(lie.coarse for lie in bench.lies([each]).values())]
            bench = usual.finer([each for each in straight if each not in coarse])
    notes = [
        f"{each.mesh}: left out a fold that {each.driver} makes: its triangles are too long to show wrinkles there"
        for each in coarse
    ]
    old = [each for each in straight if each not in coarse]
    if bench is not usual or old != list(suggestions):
        lies = bench.lies(old)
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
        lies |= bench.lies(again)
    crossing = [any(lies[name].crosses for name in _names(each, lies)) for each in kept]
    tools = [first if crosses else each for first, each, crosses in zip(old, kept, crossing, strict=True)]
    return Tried(tools, bench.refinement, notes)


def _touch(first: _Lie, second: _Lie) -> bool:
    """Whether the refinement under one tool may change that under another."""
    return first.node == second.node and len(np.intersect1d(first.vertices, second.vertices)) > 0


def _names(suggestion: Suggestion, lies: dict[str, _Lie]) -> Iterator[str]:
    """Of its tool, and of its twin, where they could be laid."""
    names = [suggestion.tool.name, *([exchange_sides(suggestion.tool.name)] if suggestion.mirrored else [])]
    return (name for name in names if name in lies)


def _narrower(suggestion: Suggestion) -> Suggestion:
    width = significant(_NARROWER * suggestion.tool.width.value, 2)
    return replace(suggestion, tool=replace(suggestion.tool, width=Length(width)))
