"""The kinds of effects, in the order in which they act on a body. A bake imports those that its tools ask for."""

from collections.abc import Iterable
from functools import cache
from importlib import import_module

from wrinklecli.choices import EFFECTS
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.effect import EffectKind
from wrinklecli.tools.records import EffectTool


@cache
def kind_of(section: str) -> EffectKind[EffectTool, AnyAttached]:
    """The kind whose effects stand in a section."""
    folder, _ = EFFECTS[section]
    kind: EffectKind[EffectTool, AnyAttached] = import_module(f"wrinklecli.effects.{folder}.layer").KIND
    return kind


def kinds_of(tools: Iterable[EffectTool]) -> dict[str, EffectKind[EffectTool, AnyAttached]]:
    """The kinds of effects that act for some tools, in their order, by their sections."""
    sections = {section for tool in tools for section in tool.sections}
    return {section: kind_of(section) for section in EFFECTS if section in sections}
