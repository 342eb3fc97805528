"""Suggested tools laid on the mesh as a bake refines it: those that reach across a fold there are made narrower.

Regions are measured on the mesh as it is. Only the refined one shows what its wrinkles reach.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from wrinklecli.baking.job import tools_by_node
from wrinklecli.baking.plan import plan_mesh
from wrinklecli.baking.warnings import placement_warnings
from wrinklecli.character.clip import Clip
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.review.suggest.fitting import Suggestion
from wrinklecli.review.suggest.text import tools_text
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.read import parse_tools
from wrinklecli.tools.records import Length

# How often a tool is made narrower, and what is left of its width each time.
_TRIES, _NARROWER = 3, 0.75
# Of a bake.
_MAX_ERROR = Length(1.0, percent=True)


def tried(
    document: Document, suggestions: Sequence[Suggestion], clips: Sequence[Clip], *, flat: bool
) -> list[Suggestion]:
    """Suggestions as narrow as they lie well; those that do not, however narrow they are, as they were.

    Args:
        document: The asset.
        suggestions: Those to lay.
        clips: All of the asset.
        flat: As of `tools_text`.
    """
    kept, crossing = list(suggestions), set[str]()
    for _ in range(_TRIES):
        crossing = set(_crossing(document, kept, clips, flat=flat))
        if not crossing:
            return kept
        kept = [_narrower(each) if crossing & set(_names(each)) else each for each in kept]
    crossing = set(_crossing(document, kept, clips, flat=flat))
    return [old if crossing & set(_names(old)) else new for old, new in zip(suggestions, kept, strict=True)]


def _crossing(
    document: Document, suggestions: Sequence[Suggestion], clips: Sequence[Clip], *, flat: bool
) -> Iterator[str]:
    """The names of tools that `check` would warn of for where they lie; none where they cannot be laid at all."""
    if not suggestions:
        return
    try:
        settings = parse_tools(tools_text(suggestions, "", flat=flat))
        by_node, _ = tools_by_node(document, settings)
        plans = [
            plan_mesh(document, node, tools, settings, tuple(clips), _MAX_ERROR) for node, tools in by_node.items()
        ]
    except WrinkleError:
        return
    for plan in plans:
        for carried in plan.carried_patches:
            if placement_warnings(plan, carried):
                yield carried.patch.tool.name


def _names(suggestion: Suggestion) -> Iterator[str]:
    """Of its tool, and of its twin."""
    yield suggestion.tool.name
    if suggestion.mirrored:
        yield exchange_sides(suggestion.tool.name)


def _narrower(suggestion: Suggestion) -> Suggestion:
    width = float(f"{_NARROWER * suggestion.tool.width.value:.2g}")
    return replace(suggestion, tool=replace(suggestion.tool, width=Length(width)))
