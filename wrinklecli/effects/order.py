"""The kinds of effects, in the order in which they act on a body. A bake imports those that its tools ask for."""

from collections.abc import Iterable
from functools import cache
from importlib import import_module

from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.effect import EffectKind
from wrinklecli.tools.records import EffectTool

KINDS = {
    "muscles": "muscle",
    "flesh": "flesh",
    "touches": "touch",
    "tools": "wrinkle",
    "fields": "field",
    "folds": "contact",
}
"""The folder of each kind, by the section of its effects. A new kind is one more entry here."""


@cache
def kind_of(section: str) -> EffectKind[EffectTool, AnyAttached]:
    """The kind whose effects stand in a section."""
    kind: EffectKind[EffectTool, AnyAttached] = import_module(f"wrinklecli.effects.{KINDS[section]}.layer").KIND
    return kind


def kinds_of(tools: Iterable[EffectTool]) -> dict[str, EffectKind[EffectTool, AnyAttached]]:
    """The kinds of effects that act for some tools, in their order, by their sections."""
    sections = {section for tool in tools for section in tool.sections}
    return {section: kind_of(section) for section in KINDS if section in sections}
