"""Folds of cloth and leather round a bent limb: two tools that cross on the inside of the bend.

A sleeve or a trouser leg is a tube, and a tube that is bent or pressed together buckles into diamonds, between creases
that run aslant round it both ways. Level bars are what a flat strip does. So a place on a limb gets two paths, one from
the outer side above the joint to the inner side below it, and one the other way; where their folds cross, diamonds are
left between them. One of the two leads: its folds run through, and the lower ones of the other break and join them.

Source: Y. Yoshimura, *On the Mechanism of Buckling of a Circular Cylindrical Shell under Axial Compression*, NACA TM
1390, 1955. Differs: one ring of diamonds around the crease, as only the inside of the bend is pressed together; and the
two families of creases are not equal, as a bend is never quite even.
"""

from dataclasses import replace

import numpy as np

from wrinklecli.choices import MaterialName, Part
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, unit
from wrinklecli.numeric.rays import distances_along, near_points
from wrinklecli.review.suggest.candidates import Candidate

# Joints whose limb is a tube on both sides; None is a joint of a rig whose names say nothing.
_OF_LIMBS: tuple[Part | None, ...] = ("lower arm", "lower leg", None)
# Least width of the region that each of the two folds, over the radius: folds run half round the limb.
_WIDTH = 2.6
# Length of a fold over the radius, by material: behind a knee, trousers have about three folds on either side of the
# crease, which is a furrow, and leather, which is thicker, has two.
_FOLD: dict[MaterialName | None, float] = {"cloth": 0.45, "leather": 0.6}
# Places of a path's points, as parts of its half.
_STEPS = (1.0, -1.0)
# Farthest that a point moves to the surface, over the radius of the limb: a leg is no exact cylinder.
_OFF = 0.6
# Radius of a limb over the length or the width of its compressed region, at most and at least: else it is no limb.
_RADII = (0.15, 1.5)


@dataclass(frozen=True, slots=True)
class _Family:
    """One of the two families of folds.

    Attributes:
        side: 1 or −1, the side to which it leans.
        slant: Angle between its path and the limb, degrees. Bent cloth folds flatter than a thin tube, whose is 45°,
            and two equal slants read as a net.
        half: Half of its path's length along the limb, over the radius: a bend presses the limb together about as far
            to either side as it is thick.
        lower: Factor on the heights. Where equal heights cross there are knobs, and pits between them.
    """

    side: float
    slant: float
    half: float
    lower: float


_LEADING = _Family(side=1.0, slant=25.0, half=1.4, lower=1.0)
_CROSSING = _Family(side=-1.0, slant=30.0, half=0.95, lower=0.45)


def crossing_pair(candidate: Candidate) -> list[Candidate]:
    """The two candidates that cross at the middle of this one, the leading one first.

    There are none if it is not on a limb in cloth or leather. The candidate is a straight one with fitted ends.
    """
    if candidate.material not in _FOLD or candidate.by_morph or candidate.region.on_plane:
        return []
    radius = limb_radius(candidate) if candidate.part in _OF_LIMBS else None
    if radius is None:
        return []
    crossing = [_slanted(candidate, radius, family) for family in (_LEADING, _CROSSING)]
    return [each for each in crossing if each is not None] if None not in crossing else []


def limb_radius(candidate: Candidate) -> float | None:
    """Radius of the limb at the middle of a candidate, scene units; None where there is nothing opposite."""
    rest, region = candidate.mesh.rest, candidate.region
    extent = max(region.length, region.width)
    place, normal = rest.foot((candidate.origin + candidate.target) / 2.0)
    corners = rest.positions[rest.triangles]
    corners = corners[near_points(corners, place[None], 2.0 * _RADII[1] * extent)]
    start = 1e-3 * extent  # beyond the triangle that the place lies on
    found = distances_along(place - start * normal, -normal, corners)
    # Clothes may have an inner side, so the opposite one is the farthest.
    found = found[np.isfinite(found) & (found < 2.0 * _RADII[1] * extent)]
    radius = float(found.max(initial=0.0)) / 2.0
    return radius if _RADII[0] * extent < radius else None


def _slanted(candidate: Candidate, radius: float, family: _Family) -> Candidate | None:
    """A candidate with a path aslant round the limb, for a family of folds; None if the limb is no tube there."""
    rest = candidate.mesh.rest
    place, normal = rest.foot((candidate.origin + candidate.target) / 2.0)
    along = candidate.origin - candidate.target
    along = unit(along - (along @ normal) * normal)
    across, half = np.cross(normal, along), family.half * radius
    turn = family.half * np.tan(np.radians(family.slant))
    points: list[Floats] = []
    for step in _STEPS:
        angle = family.side * step * turn
        round_limb = radius * (np.sin(angle) * across + (np.cos(angle) - 1.0) * normal)
        asked = place + step * half * along + round_limb
        foot, facing = rest.foot(asked)
        outward = np.sin(angle) * across + np.cos(angle) * normal
        if np.linalg.norm(foot - asked) > _OFF * radius or facing @ outward <= 0.0:
            return None
        points.append(foot)
    region = replace(candidate.region, width=max(candidate.region.width, _WIDTH * radius))
    return replace(
        candidate,
        region=region,
        origin=points[0],
        target=points[1],
        bumps=2 * round(family.half / _FOLD[candidate.material]),
        lower=family.lower,
    )
