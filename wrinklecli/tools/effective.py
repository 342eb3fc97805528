"""The values that count for a tool's keys, each with its source.

A key of the tool wins over the file's defaults, these over the material, and that over what is built in. The bake reads
the same values, as a test says; here they are as a file would write them.
"""

from collections.abc import Mapping
from typing import Any, Literal, TypeAlias

from wrinklecli.frozen import dataclass
from wrinklecli.tools.json_schema import defaults_of
from wrinklecli.tools.materials import Preset
from wrinklecli.tools.records import WrinkleTool

Source: TypeAlias = Literal["tool", "defaults", "material", "built-in"]


@dataclass(frozen=True, slots=True)
class EffectiveValue:
    """A value as a file would write it, and its source; `material` is the name of the material that gives it."""

    value: Any
    source: Source
    material: str = ""

    @property
    def source_words(self) -> str:
        """The source in words."""
        words = {"tool": "own key", "defaults": "the file's defaults", "built-in": "built in"}
        return words.get(self.source, f"material {self.material}")


def effective_values(
    own: Mapping[str, Any],
    defaults: Mapping[str, Any],
    known: Mapping[str, Preset],
    record: type[Any] = WrinkleTool,
) -> dict[str, EffectiveValue]:
    """Find the values of a tool's keys that count; required keys that nobody gives are missing.

    Args:
        own: Valid keys of the tool.
        defaults: Valid keys of the file's defaults.
        known: Materials by name: those of the file, and the built-in ones.
        record: The record of the tool, or of another effect.
    """
    given = {**defaults, **own}
    found = {key: EffectiveValue(value, "built-in") for key, value in defaults_of(record).items()}
    material = str(given.get("material", found["material"].value if "material" in found else None))
    of_material = record.of_material(given, known)
    found |= {key: EffectiveValue(value, "material", material) for key, value in of_material.items()}
    found |= {key: EffectiveValue(value, "defaults") for key, value in defaults.items()}
    return found | {key: EffectiveValue(value, "tool") for key, value in own.items()}


def inherited_values(
    own: Mapping[str, Any],
    defaults: Mapping[str, Any],
    known: Mapping[str, Preset],
    record: type[Any] = WrinkleTool,
) -> dict[str, EffectiveValue]:
    """Find what each key of a tool would be if the tool did not have it; arguments are those of `effective_values`.

    Keys that the tool has to have are missing.
    """
    found = {}
    for key in own:
        others = {name: value for name, value in own.items() if name != key}
        value = effective_values(others, defaults, known, record).get(key)
        if value is not None:
            found[key] = value
    return found
