"""Patches: tools attached to a surface at rest, their coordinates (u, v), attenuation and member triangles.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, Computer Graphics International 2004, on the
influence region. Differs: members face the patch and are connected to an anchor, where the paper takes every vertex
that projects onto the patch (the back of a thin limb with them); displacement fades where the surface turns away; and
(u, v) are those at rest.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.character.surface import Surface
from wrinklecli.errors import BakeError, WrinkleError, listed, nearest
from wrinklecli.method.anchor import Anchor, anchor_at
from wrinklecli.method.bow import bowed
from wrinklecli.method.curve import ControlCurve, count_intervals, plan_curve
from wrinklecli.method.path import Path, path_through
from wrinklecli.method.rest import Rest, asked_positions
from wrinklecli.method.variation import Variation, attenuation, plan_variation
from wrinklecli.numeric.arrays import Floats, Ints, face_normals
from wrinklecli.numeric.nearest import meets_box
from wrinklecli.tools.materials import bump_height
from wrinklecli.tools.records import RestLengthKeys, RestLengthMorph, WrinkleTool

# Anchors nearer than this share of the mesh's size are one point.
_LEAST_SPAN = 1e-9
# Cosines of vertex and patch normal between which displacement fades in.
_FACING = (0.2, 0.6)
# Points of a line on each control interval, where its length is measured: right to about 1e-4.
_LINE_POINTS = 24
# Stretches of a path's map between which displacement fades in: at 0, on the inside of a bend, wrinkles would meet.
_UNFOLDED = (0.2, 0.6)


@dataclass(frozen=True, slots=True)
class Patch:
    """A tool attached to a surface at rest.

    Attributes:
        tool: Its definition.
        curve: Its control curve.
        variation: How its wrinkles differ from ruled ones; None where they do not.
        anchors: From that at u = 0 to that at u = 1: two, or more where it follows a path.
        path: The line through them at rest.
        span: The summed distances of neighbouring anchors at rest, scene units.
        half_width: |v| = 1 at this distance from the path, scene units.
        members: (members,) the coarse triangles that belong to it, rising.
    """

    tool: WrinkleTool
    curve: ControlCurve
    variation: Variation | None
    anchors: tuple[Anchor, ...]
    path: Path
    span: float
    half_width: float
    members: Ints

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
    def rest_length(self) -> float:
        """Nominal length of the control curve, scene units."""
        return self.curve.rest_length

    def coordinates(self, positions: Floats) -> tuple[Floats, Floats]:
        """(…,) u along the path and v across it, of (…, 3) world positions at rest.

        On the inside of a bend v rises faster than the distance: the patch ends before its map would fold.
        """
        found = self.path.locate(positions)
        v = found.across / self.half_width
        if found.stretches is None:
            return found.u, v
        low, high = _UNFOLDED
        t = np.clip((found.stretches - low) / (high - low), 0.0, 1.0)
        spread = 1.0 - (1.0 - np.abs(v)) * t * t * (3.0 - 2.0 * t)
        # Beyond the border, not on it.
        return found.u, np.copysign(spread + np.maximum(low - found.stretches, 0.0), v)

    def bowed(self, u: Floats, v: Floats) -> Floats:
        """(…,) where (…,) places of the patch are on the control curve: u, unless crests are bent."""
        return bowed(u, v, self.tool.bow, self.tool.bumps) if self.tool.bow else u

    def cosines(self, u: Floats, normals: Floats) -> Floats:
        """(…,) of (…, 3) unit normals of the surface, at (…,) places along it, and the patch's there."""
        return self.path.cosines(u, normals)

    def stretched(self, u: Floats, v: Floats) -> Floats:
        """(…,) places along the patch, along which edges as long as each other show as much of the wrinkles.

        Those along the segment, but longer where the profile turns sharply, in furrows, and shorter on flat crests.
        """
        bent = self.bowed(u, v)
        if not self.curve.sharp:
            return bent
        return self.curve.stretched(bent if self.variation is None else self.variation.places(bent, v)[0])

    def places(self, u: Floats, v: Floats, cosines: Floats) -> tuple[Floats, Floats]:
        """Where points are on the control curve, and the factors on its height there.

        Args:
            u: (…,) along the segment.
            v: (…,) across it.
            cosines: (…,) of vertex normals and the patch's.
        """
        bent = self.bowed(u, v)
        if self.variation is None:
            return bent, self.factors(u, v, cosines)
        places, left, turned = self.variation.places(bent, v)
        return places, left * self.factors(u, np.where(np.abs(v) <= 1.0, 0.0, v), cosines - turned)

    def line_lengths(self, amplitudes: Floats, distance: float, lines: Floats) -> Floats:
        """(lines,) how long the surface's cuts along (lines,) v are, scene units, at a strength of 1.

        On a plane, without what fades where the surface turns away.

        Args:
            amplitudes: (groups, modes), scene units.
            distance: Of the cuts' ends, scene units.
            lines: (lines,) v.
        """
        points = _LINE_POINTS * 2 ** len(self.curve.details) * self.curve.interval_count + 1
        u, v = np.meshgrid(np.linspace(0.0, 1.0, points), lines)
        places, factors = self.places(u, v, np.ones(u.shape))
        heights = np.einsum("gm,gmv->v", amplitudes, self.curve.shapes(places.reshape(-1))).reshape(u.shape)
        heights *= factors / self.shape_strength
        return np.asarray(np.hypot(distance / (points - 1), np.diff(heights, axis=1)).sum(axis=1), np.float64)

    def magnitudes(self, u: Floats, v: Floats, normals: Floats) -> Floats:
        """(…,) factor on the curve's height: strength, attenuation, facing; 0 outside the patch."""
        return self.factors(u, v, self.cosines(u, normals))

    def factors(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) as `magnitudes`, from the cosines of (…,) vertex normals and the patch's."""
        left = attenuation(self.tool.attenuation, v)
        low, high = _FACING
        t = np.clip((cosines - low) / (high - low), 0.0, 1.0)
        inside = (u >= 0.0) & (u <= 1.0) & (np.abs(v) <= 1.0)
        return np.where(inside, self.shape_strength * left * t * t * (3.0 - 2.0 * t), 0.0)

    def presence(self, u: Floats, v: Floats, cosines: Floats) -> Floats:
        """(…,) share of the tool's height that a place may have, from 0 at the patch's border to 1.

        That of `factors`, without strength; over the first and the last control interval it fades along u as well,
        where a bump begins or ends.
        """
        t = np.clip(np.minimum(u, 1.0 - u) * self.curve.interval_count, 0.0, 1.0)
        share: Floats = t * t * (3.0 - 2.0 * t) * np.abs(self.factors(u, v, cosines) / self.shape_strength)
        return share

    @property
    def greatest_height(self) -> float:
        """Of all wrinkles that the tool can make, scene units."""
        return abs(self.shape_strength) * self.curve.greatest_height

    @property
    def shape_strength(self) -> float:
        """The strength built into the shapes: the tool's own, or that of its strongest clip where it is 0."""
        return self.tool.strength or max(self.tool.clips.values(), key=abs, default=0.0)

    @property
    def keyed_clips(self) -> frozenset[str]:
        """Names of the clips that key the rest length."""
        wanted = self.tool.rest_length
        return frozenset(wanted.keys if isinstance(wanted, RestLengthKeys) else ())

    def clip_strength(self, clip: Clip | None) -> float:
        """Factor on the shapes in a clip."""
        wanted = self.tool.strength if clip is None else self.tool.clips.get(clip.name, self.tool.strength)
        return wanted / self.shape_strength if self.shape_strength else 0.0


def attach_tools(tools: list[WrinkleTool], surface: Surface, rest: Rest, rig: Rig, *, up: str) -> list[Patch]:
    """Attach every tool of a mesh.

    Args:
        tools: Of the mesh.
        surface: The coarse mesh.
        rest: Its rest pose.
        rig: Its joints.
        up: Axis of the tools file, for messages.

    Raises:
        WrinkleError: Of all tools that do not fit, a line each.
    """
    patches, problems = [], []
    for tool in tools:
        try:
            patches.append(_attach(tool, surface, rest, rig, up))
        except WrinkleError as error:
            problems.append(error)
    if problems:
        raise BakeError.of_all(problems)
    return patches


def _attach(tool: WrinkleTool, surface: Surface, rest: Rest, rig: Rig, up: str) -> Patch:
    if isinstance(tool.rest_length, RestLengthMorph) and tool.rest_length.morph not in rig.morph_names:
        raise BakeError(
            f"the mesh has no morph target {tool.rest_length.morph!r}{nearest(tool.rest_length.morph, rig.morph_names)}"
            f"; it has {listed(rig.morph_names)}",
            where=tool.place("rest_length", "morph"),
        )
    asked = asked_positions(rig, rest.clip, rest.time, tool)
    anchors = tuple(
        anchor_at(tool, number, asked, surface=surface, rest=rest, rig=rig, up=up) for number in range(len(asked))
    )
    names = [tool.point_name(number) for number in range(len(anchors))]
    spans = [float(np.linalg.norm(b.position - a.position)) for a, b in pairwise(anchors)]
    for number, span in enumerate(spans):
        if span <= _LEAST_SPAN * surface.size or (asked[number] == asked[number + 1]).all():
            raise BakeError(f"{names[number]} and {names[number + 1]} are one point of the mesh", where=tool.where)
    path = path_through(
        [each.position for each in anchors], [each.normal for each in anchors], rest.foot, names=names, where=tool.where
    )
    span = sum(spans)
    half_width = tool.width.resolve(span) / 2.0
    variation = _variation(tool, half_width / span)
    patch = Patch(
        tool=tool,
        curve=_curve(tool, span, variation),
        variation=variation,
        anchors=anchors,
        path=path,
        span=span,
        half_width=half_width,
        members=np.zeros(0, np.intp),
    )
    return replace(patch, members=_members(patch, surface, rest))


def _variation(tool: WrinkleTool, aspect: float) -> Variation | None:
    """Draw a tool's irregularity, from half its width over its length; None for ruled wrinkles."""
    if not tool.variation:
        return None
    return plan_variation(
        tool.name if tool.seed is None else str(tool.seed),
        tool.variation,
        tool.branch,
        bumps=tool.bumps,
        gap=tool.gap,
        aspect=aspect,
        kind=tool.attenuation,
        mirrored=tool.mirrored,
    )


def _curve(tool: WrinkleTool, span: float, variation: Variation | None) -> ControlCurve:
    """Plan a tool's control curve, from the distance of its anchors at rest, scene units."""
    rest_length, greatest = _rest_lengths(tool, span)
    varied = {} if variation is None else {"widths": variation.widths, "peaks": variation.peaks}
    return plan_curve(
        bumps=tool.bumps,
        gap=tool.gap,
        strategy=tool.strategy,
        details=tool.details,
        profile=tool.profile,
        max_height=_max_height(tool, span, rest_length, variation),
        compressible=tool.compressible,
        rest_length=rest_length,
        greatest_rest_length=greatest,
        **varied,
    )


def _rest_lengths(tool: WrinkleTool, span: float) -> tuple[float, float]:
    """The curve's nominal length and the greatest that keys or a morph target give it, scene units."""
    wanted = tool.rest_length
    if wanted == "auto":
        return span, span
    if isinstance(wanted, RestLengthKeys):
        lengths = [length.resolve(span) for keys in wanted.keys.values() for _, length in keys]
        return span, max([span, *lengths])
    if isinstance(wanted, RestLengthMorph):
        return span, max(span, wanted.full.resolve(span))
    length = wanted.resolve(span)
    return length, length


def _max_height(tool: WrinkleTool, span: float, rest_length: float, variation: Variation | None) -> float:
    """Greatest height of all bumps, scene units; for `auto` a part of their widths on the straight segment."""
    if tool.max_height is None:
        return np.inf
    if tool.max_height != "auto":
        return tool.max_height.resolve(span)
    width = 2.0 * rest_length / count_intervals(tool.bumps, tool.gap)
    # Each may be as high as a part of its own width.
    highest = 1.0 if variation is None else float((variation.widths * variation.peaks).max() / variation.peaks.max())
    return bump_height(tool.material) * width * highest


def _members(patch: Patch, surface: Surface, rest: Rest) -> Ints:
    """(members,) the coarse triangles, rising, that face a patch, meet it and hang together with an anchor."""
    near = rest.blocks.boxes.reaching(*patch.path.box(patch.half_width))
    used, corners = np.unique(surface.triangles[near], return_inverse=True)
    places = np.stack(patch.coordinates(rest.positions[used]), axis=1)
    meeting = meets_box(places, np.array([0.0, -1.0]), np.array([1.0, 1.0]), corners.reshape(-1, 3))
    u = places[corners.reshape(-1, 3)[meeting], 0].mean(axis=1)
    near = near[meeting]
    triangles = surface.triangles[near]
    vertices, corners = np.unique(triangles, return_inverse=True)
    # Winding may be mirrored at rest; vertex normals are not.
    faces = face_normals(rest.positions, triangles)
    normals = rest.normals_at(vertices)[corners.reshape(-1, 3)]
    outward = np.sign(np.sum(faces * normals.sum(axis=1), axis=1))
    chosen = near[outward * patch.cosines(u, faces) > 0]
    inside = np.isin(chosen, np.concatenate([anchor.triangles for anchor in patch.anchors]))
    if not inside.any():
        raise BakeError("no triangle at its ends faces the patch", where=patch.tool.where)
    sides = np.sort(surface.triangles[chosen][:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    _, edge = np.unique(sides[:, 0] * len(rest.positions) + sides[:, 1], return_inverse=True)
    piece = _pieces(edge.reshape(-1, 3))
    members: Ints = chosen[np.isin(piece, piece[inside])]
    return members


def _pieces(triangle_edges: Ints) -> Ints:
    """(triangles,) the same number for triangles that hang together by edges, (triangles, 3)."""
    # In place of scipy's connected components, whose import takes longer than this does for most meshes.
    pieces = np.arange(len(triangle_edges))
    least = np.zeros(int(triangle_edges.max(initial=0)) + 1, np.intp)
    while True:
        least[triangle_edges] = len(pieces)
        np.minimum.at(least, triangle_edges, pieces[:, None])
        lower = least[triangle_edges].min(axis=1, initial=len(pieces))
        # A triangle takes the number that the triangle of its number has got: rounds grow like a logarithm.
        lower = lower[lower]
        if np.array_equal(lower, pieces):
            return pieces
        pieces = lower
