"""Materials: defaults that skin, cloth and leather give a tool for keys that its file leaves out.

`configs/README.md` shows the same table with its sources, and a test compares the two.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wrinklecli.choices import MaterialName, Profile


@dataclass(frozen=True, slots=True)
class Material:
    """Defaults of a tool's keys.

    Attributes:
        bump_width: Width of a bump at rest relative to the segment; it gives the number of bumps.
        bump_height: Highest point of a bump relative to its width at rest, for `max_height: auto`. Together with
            `compressible` it makes bumps full when a segment loses about 40 %, as at a strongly bent joint.
    """

    bump_width: float
    bump_height: float
    compressible: float
    profile: Profile
    details: tuple[float, ...]
    variation: float

    @property
    def defaults(self) -> dict[str, Any]:
        """The values that depend on no other key of the tool, by key."""
        return {
            "compressible": self.compressible,
            "profile": self.profile,
            "details": self.details,
            "variation": self.variation,
        }

    def bumps(self, gap: int) -> int:
        """Number of bumps along a segment with `gap` flat intervals, half a bump each, between neighbours."""
        return max(1, round((2.0 / self.bump_width + gap) / (2 + gap)))


# A tool without a material.
_PLAIN_BUMPS = 4
_PLAIN_HEIGHT = 0.25  # of a bump's width at rest; higher bumps become blades
MATERIALS: Mapping[MaterialName, Material] = {
    "skin": Material(bump_width=0.33, bump_height=0.13, compressible=0.87, profile="skin", details=(), variation=0.3),
    "cloth": Material(bump_width=0.25, bump_height=0.38, compressible=0.0, profile="cloth", details=(), variation=1.0),
    "leather": Material(
        bump_width=0.33, bump_height=0.38, compressible=0.0, profile="smooth", details=(), variation=1.0
    ),
}


def bump_height(material: MaterialName | None) -> float:
    """Highest point of a bump with `max_height: auto`, relative to its width at rest."""
    return _PLAIN_HEIGHT if material is None else MATERIALS[material].bump_height


def usual_bumps(material: MaterialName | None, gap: int = 0) -> int:
    """Number of bumps of a tool without the key `bumps`."""
    return _PLAIN_BUMPS if material is None else MATERIALS[material].bumps(gap)


def with_material(values: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a tool, with those of its material for keys that neither the tool nor the file's defaults have."""
    if values.get("material") is None:
        return dict(values)
    material = MATERIALS[values["material"]]
    return {"bumps": material.bumps(values.get("gap", 0)), **material.defaults, **values}
