"""Materials and presets: the values that a name after `material` gives for keys that a file leaves out.

`presets.yaml` is their table, and a file of tools may add to it. `configs/README.md` shows it with its sources, and a
test compares the two.
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from wrinklecli.choices import MaterialName, Part
from wrinklecli.frozen import dataclass
from wrinklecli.tools.json_schema import Reader, read_percentage
from wrinklecli.tools.yaml_tree import plain_values

# A tool without a material.
PLAIN_BUMPS = 4
PLAIN_HEIGHT = 0.25  # of a bump's width at rest; higher bumps become blades
# Keys of an entry that are not those of a tool.
_OWN = ("title", "material", "parts", "bump_width", "bump_height")


@dataclass(frozen=True, slots=True)
class Preset:
    """Defaults of a tool's keys, by a name.

    Attributes:
        name: The word after `material`.
        title: Its name in menus.
        bump_width: Width of a bump at rest relative to the segment; it gives the number of bumps.
        bump_height: Highest point of a bump relative to its width at rest, for `max_height: auto`.
        keys: The other keys with their values, as a file writes them; those of `material` are among them.
        substance: The entry without a material from which it is made in the end.
        parts: Parts of a body for which `suggest` takes it, on its substance.
    """

    name: str
    title: str
    bump_width: float
    bump_height: float
    keys: Mapping[str, Any]
    substance: str
    parts: tuple[Part, ...] = ()

    def bumps(self, gap: int = 0) -> int:
        """Number of bumps along a segment with `gap` flat intervals, half a bump each, between neighbours."""
        given = self.keys.get("bumps")
        return max(1, round((2.0 / self.bump_width + gap) / (2 + gap))) if given is None else int(given)

    def fields(self, readers: Mapping[str, Reader], gap: int = 0) -> dict[str, Any]:
        """The fields of a tool that it gives; `readers` turn the values of keys into those of fields."""
        read = {key: readers[key](value) for key, value in self.keys.items()}
        return {**read, "bumps": self.bumps(gap), "bump_height": self.bump_height}


def presets_of(entries: Mapping[str, Mapping[str, Any]], known: Mapping[str, Preset]) -> dict[str, Preset]:
    """The presets of a file's entries; each may be made from a known one, or from one above it."""
    found: dict[str, Preset] = {}
    for name, entry in entries.items():
        base = {**known, **found}.get(entry.get("material", ""))
        width, height = (read_percentage(entry.get(key)) for key in ("bump_width", "bump_height"))
        found[name] = Preset(
            name=name,
            title=entry.get("title", name),
            bump_width=width or (base.bump_width if base else 1.0 / PLAIN_BUMPS),
            bump_height=height or (base.bump_height if base else PLAIN_HEIGHT),
            substance=name if base is None else base.substance,
            parts=tuple(entry.get("parts", ())),
            keys={**(base.keys if base else {}), **{key: each for key, each in entry.items() if key not in _OWN}},
        )
    return found


@cache
def presets() -> Mapping[str, Preset]:
    """The built-in materials and presets by name, materials first."""
    text = Path(__file__).with_name("presets.yaml").read_text(encoding="utf-8")
    return presets_of(plain_values(text), {})


def preset(name: str) -> Preset:
    """A built-in material or preset."""
    return presets()[name]


def preset_for(substance: MaterialName, part: Part | None, known: Mapping[str, Preset]) -> Preset:
    """The preset of a substance for a part of a body, the last of several; the substance itself if there is none."""
    fitting = [each for each in known.values() if each.substance == substance and part in each.parts]
    return fitting[-1] if fitting else known[substance]


def usual_bumps(material: MaterialName | None) -> int:
    """Number of bumps of a tool without the key `bumps`."""
    return PLAIN_BUMPS if material is None else preset(material).bumps()


def with_material(
    values: Mapping[str, Any], readers: Mapping[str, Reader], known: Mapping[str, Preset]
) -> dict[str, Any]:
    """Fields of a tool, with those of its material for keys that neither the tool nor the file's defaults have."""
    if values.get("material") is None:
        return dict(values)
    chosen = known[values["material"]]
    gap = values.get("gap", chosen.keys.get("gap", 0))
    return {**chosen.fields(readers, gap), **values}
