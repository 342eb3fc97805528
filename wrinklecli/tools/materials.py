"""Materials: what skin, cloth and leather give a tool where its file says nothing.

`configs/README.md` shows the same table with its sources, and a test compares the two.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from wrinklecli.choices import MaterialName, Profile


@dataclass(frozen=True, slots=True)
class Material:
    """Defaults of a tool.

    Attributes:
        bump_width: Width of a bump at rest, as a part of the segment; gives the number of bumps.
        bump_height: Highest point of a bump, as a part of its width at rest: what `max_height: auto` is. With
            `compressible` it is such that bumps are full where a segment loses about 40 %, as at a joint well bent.
        compressible: Share of every shortening that it takes up itself.
        profile: Shape of a bump.
        details: Shares of finer wrinkles.
        variation: How irregular bumps are.
    """

    bump_width: float
    bump_height: float
    compressible: float
    profile: Profile
    details: tuple[float, ...]
    variation: float

    @property
    def defaults(self) -> dict[str, Any]:
        """By key, the values that hang on no other key of the tool."""
        return {
            "compressible": self.compressible,
            "profile": self.profile,
            "details": self.details,
            "variation": self.variation,
        }

    def bumps(self, gap: int) -> int:
        """Bumps along a segment with so many flat intervals, half a bump each, between neighbours."""
        return max(1, round((2.0 / self.bump_width + gap) / (2 + gap)))


# Those of a tool without a material.
_PLAIN_BUMPS, _PLAIN_HEIGHT = 4, 0.25
MATERIALS: Mapping[MaterialName, Material] = {
    "skin": Material(bump_width=0.33, bump_height=0.13, compressible=0.87, profile="skin", details=(), variation=0.3),
    "cloth": Material(bump_width=0.25, bump_height=0.38, compressible=0.0, profile="cloth", details=(), variation=1.0),
    "leather": Material(
        bump_width=0.33, bump_height=0.38, compressible=0.0, profile="smooth", details=(), variation=1.0
    ),
}


def bump_height(material: MaterialName | None) -> float:
    """Highest point of a bump of `max_height: auto`, as a part of its width at rest."""
    return _PLAIN_HEIGHT if material is None else MATERIALS[material].bump_height


def usual_bumps(material: MaterialName | None, gap: int = 0) -> int:
    """Bumps of a tool that does not say how many."""
    return _PLAIN_BUMPS if material is None else MATERIALS[material].bumps(gap)


def with_material(values: Mapping[str, Any]) -> dict[str, Any]:
    """A tool's values, with those of its material for keys that neither the tool nor the file's defaults have.

    Args:
        values: By key, as a record holds them.
    """
    if values.get("material") is None:
        return dict(values)
    material = MATERIALS[values["material"]]
    return {"bumps": material.bumps(values.get("gap", 0)), **material.defaults, **values}
