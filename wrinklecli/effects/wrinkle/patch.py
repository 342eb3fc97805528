"""Patches: tools on a surface at rest, their coordinates (u, v), and the factors by which heights fade there.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, Computer Graphics International 2004, on the
influence region. Differs: displacement fades where the surface turns away; and (u, v) are those at rest.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import ClassVar, Self

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.drive.segment import Segment
from wrinklecli.effects.attached import Attached
from wrinklecli.effects.wrinkle.curve import ControlCurve
from wrinklecli.effects.wrinkle.lookup import fitting_compressible, group_starts
from wrinklecli.effects.wrinkle.places import Places, bowed
from wrinklecli.effects.wrinkle.variation import Variation, attenuation
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, Ints, ramp, smoothstep
from wrinklecli.numeric.subdivide import Subdivision
from wrinklecli.surface.anchor import Anchor
from wrinklecli.surface.features import Nearest
from wrinklecli.surface.mask import Mask
from wrinklecli.surface.path import Path
from wrinklecli.surface.region import FACING, Region
from wrinklecli.surface.rest import Rest
from wrinklecli.tools.records import WrinkleTool

LOW = 0.05
"""Height at which there is hardly any crest, over the tool's."""

# Points of a line on each control interval for its length, whose relative error is about 1e-4.
_LINE_POINTS = 24
# Stretches of a path's map between which displacement fades in. On the inside of a bend wrinkles would meet at 0.
_UNFOLDED = (0.2, 0.6)


@dataclass(frozen=True, slots=True)
class Reach:
    """The reach of the wrinkles of a tool.

    Attributes:
        nearest: The features near the patch; None if there are none.
        fade: Distance from a feature below which heights fade, scene units.
        detours: (coarse vertices,) 0 for places that are connected with the tool straight over the surface, rising to 1
            for other parts of the body that are only near in space; None if there are none.
    """

    nearest: Nearest | None
    fade: float
    detours: Floats | None

    def at(self, subdivision: Subdivision, vertices: Ints, places: Floats) -> Floats:
        """(vertices,) factors at fine vertices with (vertices, 3) world positions, in the pose of the features."""
        left = np.ones(len(vertices))
        if self.nearest is not None:
            distances = self.nearest.distances(subdivision.triangles, subdivision.parents, vertices, places)
            left *= smoothstep(np.minimum(distances / self.fade, 1.0))
        if self.detours is not None:
            left *= 1.0 - smoothstep(subdivision.interpolate(self.detours[:, None])[vertices, 0])
        return left


@dataclass(frozen=True, slots=True)
class Patch(Attached[WrinkleTool], Region):
    """A tool attached to a surface at rest.

    Attributes:
        variation: Its irregularity; None for ruled wrinkles.
        segment: The signal that measures its length over time.
        anchors: From u = 0 to u = 1, two, or more along a path.
        path: The line through the anchors at rest.
        pose: The pose in which u and v of a place are found: at rest, or with a morph target raised. There crests run
            straight across the tool. Each vertex keeps its u and v, so crests are bent where the surface is, at rest.
        laid: The line through the anchors in that pose.
        span: The summed distances of neighbouring anchors at rest, scene units.
        half_width: The distance from the path at which |v| = 1, scene units.
        members: (members,) the coarse triangles of the patch, sorted.
        under: (under,) these, and the triangles of the surface under the patch where the mask leaves nothing.
        reach: The factor on its height near features of the surface; None if there are none.
        mask: The factor on its height that an artist has painted, if any.
        mask_share: The mean of the mask over the patch, in proportion to the height that there would be without it.
    """

    tool: WrinkleTool
    curve: ControlCurve
    variation: Variation | None
    segment: Segment
    anchors: tuple[Anchor, ...]
    path: Path
    pose: Rest
    laid: Path
    span: float
    half_width: float
    members: Ints
    under: Ints
    reach: Reach | None = None
    mask: Mask | None = None
    mask_share: float = 1.0

    moves: ClassVar[None] = None
    """Nothing before later effects see the mesh: contact sees wrinkles by their own shapes."""
    covers: ClassVar[tuple[str, ...]] = ()
    drag: ClassVar[None] = None

    @property
    def origin(self) -> Anchor:
        """Anchor at u = 0."""
        return self.anchors[0]

    @property
    def target(self) -> Anchor:
        """Anchor at u = 1."""
        return self.anchors[-1]

    @property
    def along(self) -> Floats:
        """(3,) unit vector from origin to target, or along a path in its middle, world space at rest."""
        return self.path.along

    @property
    def normal(self) -> Floats:
        """(3,) unit normal of the patch, or of a path in its middle."""
        return self.path.normal

    @property
    def at_rest(self) -> Self:
        """The patch with u and v as if they were found at rest, for surfaces that are only known there."""
        return self if self.laid is self.path else replace(self, laid=self.path)

    @property
    def rest_length(self) -> float:
        """Nominal length of the control curve, scene units."""
        return self.curve.rest_length

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) u along the path and v across it, of (…, 3) world positions in `pose`.

        On the inside of a bend v rises faster than the distance: the patch ends before its map would fold.
        """
        found = self.laid.locate(positions)
        v = found.across / self.half_width
        if found.stretches is None:
            return found.u, v
        spread = 1.0 - smoothstep(ramp(found.stretches, *_UNFOLDED), 1.0 - np.abs(v))
        # Beyond the border, not on it.
        return found.u, np.copysign(spread + np.maximum(_UNFOLDED[0] - found.stretches, 0.0), v)

    def bowed(self, u: Floats, v: Floats) -> Floats:
        """(…,) where (…,) places of the patch are on the control curve: u, unless crests are bent."""
        return bowed(u, v, self.tool.bow, self.tool.bumps) if self.tool.bow else u

    def cosines(self, u: Floats, normals: Floats) -> Floats:
        """(…,) of (…, 3) unit normals of the surface in `pose`, at (…,) places along it, and the patch's there."""
        return self.laid.cosines(u, normals)

    def stretched(self, u: Floats, v: Floats) -> Floats:
        """(…,) places along the patch, along which edges as long as each other show as much of the wrinkles.

        These are places along the segment, stretched in furrows, where the profile turns sharply, and shrunk on flat
        crests.
        """
        bent = self.bowed(u, v)
        if not self.curve.profile.sharp:
            return bent
        return self.curve.stretched(bent if self.variation is None else self.variation.places(bent, v)[0].us)

    @property
    def furrows(self) -> Floats:
        """(furrows,) sorted places between bumps, and at both ends, if the profile makes sharp furrows there."""
        bumps = self.curve.bumps
        return np.sort(np.concatenate([bumps.starts, bumps.ends])) if self.curve.profile.sharp else np.zeros(0)

    def places(self, u: Floats, v: Floats, cosines: Floats) -> Places:
        """Places on the control curve of points at (…,) u and v, and the factors on its height there.

        (…,) `cosines` are those of vertex normals and the patch's.
        """
        bent = self.bowed(u, v)
        if self.variation is None:
            return Places(bent, self.factors(u, v, cosines))
        places, turned = self.variation.places(bent, v)
        return places.times(self.factors(u, np.where(np.abs(v) <= 1.0, 0.0, v), cosines - turned))

    def line_lengths(self, amplitudes: Floats, distance: float, lines: Floats) -> Floats:
        """(lines,) lengths of the surface's cuts along (lines,) v on a plane, scene units, at a strength of 1.

        (groups, modes) `amplitudes` and the `distance` of the cuts' ends are scene units.
        """
        points = _LINE_POINTS * 2 ** len(self.curve.details) * self.curve.interval_count + 1
        u, v = np.meshgrid(np.linspace(0.0, 1.0, points), lines)
        places = self.places(u.reshape(-1), v.reshape(-1), np.ones(u.size))
        heights = np.einsum("gm,gmv->v", amplitudes, places.shapes(self.curve)) * places.factors
        heights = heights.reshape(u.shape) / self.shape_strength
        return np.asarray(np.hypot(distance / (points - 1), np.diff(heights, axis=1)).sum(axis=1), np.float64)

    def magnitudes(self, u: Floats, v: Floats, normals: Floats) -> Floats:
        """(…,) factor on the curve's height: strength, attenuation, facing; 0 outside the patch."""
        return self.factors(u, v, self.cosines(u, normals))

    def factors(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) as `magnitudes`, from the cosines of (…,) vertex normals and the patch's."""
        faded = attenuation(self.tool.attenuation, v)
        inside = (u >= 0.0) & (u <= 1.0) & (np.abs(v) <= 1.0)
        return np.where(inside, smoothstep(ramp(cosines, *FACING), self.shape_strength * faded), 0.0)

    def share(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) fractions of the tool's height at (…,) places: `factors` without strength."""
        return np.abs(self.factors(u, v, cosines) / self.shape_strength)

    def crests(self, u: Floats, v: Floats) -> Floats:
        """(triangles, 3) phases of the control curve at the corners of triangles; NaN where there is hardly any height.

        It is NaN too for triangles within which two bumps become one.
        """
        places = self.places(u, v, np.ones(u.shape))
        low = np.abs(places.factors) < LOW * abs(self.shape_strength)
        return np.where(low, np.nan, places.phases(self.curve))

    def presence(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) fractions of the tool's height that places may have, from 0 at the patch's border to 1.

        They are `factors` without strength, and fade along u as well over the first and the last control interval.
        """
        t = np.clip(np.minimum(u, 1.0 - u) * self.curve.interval_count, 0.0, 1.0)
        return smoothstep(t) * self.share(u, v, cosines)

    def left(self, subdivision: Subdivision, vertices: Ints, places: Floats) -> Floats | None:
        """(vertices,) factors of the height near features of the surface; None if there are none.

        (vertices, 3) `places` are world positions in `pose`.
        """
        return None if self.reach is None else self.reach.at(subdivision, vertices, places)

    @property
    def regions(self) -> "tuple[Patch, ...]":
        """The regions where edges must be split: the patch."""
        return (self,)

    @property
    def intervals(self) -> float:
        """Intervals of the control curve, each halved once for every level of details."""
        return self.curve.interval_count * 2.0 ** len(self.tool.details)

    @property
    def projected(self) -> bool:
        """True if vertices are projected onto the patch in each frame."""
        return self.tool.attachment == "patch"

    @property
    def nominal_height(self) -> float:
        """Greatest height of the control curve, scene units."""
        return self.curve.greatest_height

    @property
    def flatter(self) -> str:
        """Creases that lower wrinkles, or else other wrinkles."""
        kept = self.tool.creases == "keep"
        return ("creases: lower avoids" if kept else "lower or fewer bumps, or a place beside the fold, avoid") + " it"

    @property
    def full(self) -> float:
        """The shortening over the nominal rest length at which the last group of bumps is full."""
        return float(group_starts(self.curve)[-1])

    @property
    def bump_width(self) -> float:
        """The width of a bump on the segment at rest, scene units."""
        return 2.0 * self.span / self.curve.interval_count

    def fitting_compressible(self, lengths: Iterable[tuple[Floats, Floats]], height: float | None = None) -> float:
        """The `compressible` with which all bumps are just full at the greatest shortening, 0 to 1."""
        curve = self.curve if height is None else replace(self.curve, max_height=height)
        return fitting_compressible(curve, lengths)

    @property
    def greatest_height(self) -> float:
        """Greatest height of all wrinkles that the tool can make, scene units."""
        return abs(self.shape_strength) * self.curve.greatest_height

    @property
    def shape_strength(self) -> float:
        """The strength built into the shapes: the tool's own, or that of its strongest clip if its own is 0."""
        return self.tool.strength or max(self.tool.clips.values(), key=abs, default=0.0)

    @property
    def keyed_clips(self) -> frozenset[str]:
        """Names of the clips that key the rest length."""
        return frozenset(self.segment.rest_length.keys)

    def clip_strength(self, clip: Clip | None) -> float:
        """Factor on the shapes in a clip."""
        wanted = self.tool.strength if clip is None else self.tool.clips.get(clip.name, self.tool.strength)
        return wanted / self.shape_strength if self.shape_strength else 0.0
