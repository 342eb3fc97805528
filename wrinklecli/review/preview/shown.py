"""Read the visible parts of an asset, and pose them: triangles at a moment, coloured, and marked with tools.

Materials show their base colours and textures only; everything is opaque and two-sided. Normals are the file's own,
morphed, skinned and renormalised, so that shading seams show as in an engine. Primitives without NORMAL are shaded
flat.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import cycle

import numpy as np

from wrinklecli.baking.baked_body import bodies_of_parts, wrinkle_targets
from wrinklecli.baking.refined_mesh import primitives_of
from wrinklecli.character.clip import Clip, clip_named, read_clips
from wrinklecli.character.paints import Colour, Paint, read_paints
from wrinklecli.character.pose import morph_weights
from wrinklecli.character.scene import ScenePrimitive, read_scene
from wrinklecli.character.skin import PosedMesh
from wrinklecli.effects.body import OUTLINED
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.effects.plan import outlined_parts, patch_parts
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.pixels import linear_rgb
from wrinklecli.numeric.arrays import Floats, Ints, among, children, distinct_values, face_normals, renumbered, unit
from wrinklecli.review.preview.draw import AnyMark, Mark, Outline
from wrinklecli.review.preview.heat import compressions, crest_colours, heat_colours
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.render import Snapshot

# Bytes that a triangle takes while it is drawn, with Embree's.
_TRIANGLE_BYTES = 1250
# The greatest base colour, linear RGB: white, as assets without textures are, would show no relief in the light.
_BRIGHTEST = 0.65
# Colours of tools, sRGB: they differ on skin, on cloth, and for most people who confuse colours.
INKS: tuple[Colour, ...] = (
    (0.86, 0.08, 0.24),
    (0.00, 0.42, 0.84),
    (0.00, 0.55, 0.33),
    (0.93, 0.49, 0.00),
    (0.55, 0.20, 0.75),
    (0.00, 0.62, 0.66),
    (0.72, 0.36, 0.18),
    (0.80, 0.20, 0.58),
)


@dataclass(frozen=True, slots=True)
class ShownPrimitive:
    """The parts of a primitive that do not change with time.

    Attributes:
        number: Index of the primitive in its asset.
        source: The primitive in the scene, which can be posed.
        paint: Its base colours.
        shapes: (shapes, vertices, 3) displacements of the wrinkles' morph targets, bind units.
        shape_numbers: (shapes,) their numbers among all morph targets.
        marks: The tools on it.
    """

    number: int
    source: ScenePrimitive
    paint: Paint
    shapes: Floats
    shape_numbers: Ints
    marks: tuple[AnyMark, ...]

    def displacements(self, clip: Clip | None, time: float) -> Floats:
        """(vertices,) distance by which the wrinkles move each vertex, bind units."""
        weights = morph_weights(self.source.rig, clip, np.array([time]))[0, self.shape_numbers]
        moved = np.tensordot(weights, self.shapes, axes=1)
        return np.asarray(np.sqrt(np.sum(moved**2, axis=1)))


@dataclass(frozen=True, slots=True)
class ShownAsset:
    """An asset to show, and the primitives of its scene that have triangles."""

    label: str
    document: Document
    clips: tuple[Clip, ...]
    primitives: tuple[ShownPrimitive, ...]

    @property
    def wrinkled(self) -> dict[int, list[ShownPrimitive]]:
        """The primitives that carry wrinkles, by node; parts of a split mesh by the node with the extras."""
        bodies = bodies_of_parts(self.document)
        found: dict[int, list[ShownPrimitive]] = {}
        for shown in self.primitives:
            if len(shown.shape_numbers):
                found.setdefault(bodies.get(shown.source.rig.node, shown.source.rig.node), []).append(shown)
        return found

    def without_wrinkles(self) -> "ShownAsset":
        """The asset with the weights of all wrinkles 0."""
        primitives = []
        for shown in self.primitives:
            skin, rows = shown.source.skin, 1 + shown.shape_numbers
            places, turns = skin.places.copy(), None if skin.turns is None else skin.turns.copy()
            places[:, rows] = 0.0
            if turns is not None:
                turns[:, rows] = 0.0
            source = replace(shown.source, skin=replace(skin, places=places, turns=turns))
            primitives.append(replace(shown, source=source) if len(rows) else shown)
        return replace(self, primitives=tuple(primitives))

    def of_targets(
        self, chosen: Callable[[int, str], bool], weight: Callable[[str], float] | None = None
    ) -> "ShownAsset":
        """The asset with the wrinkles of chosen morph targets only.

        Args:
            chosen: True for the node (a key of `wrinkled`) and the name of a morph target to keep.
            weight: The stored weight that a target gets, by its name; None if they stay.
        """
        bodies = bodies_of_parts(self.document)
        primitives = []
        for shown in self.primitives:
            rig = shown.source.rig
            body = bodies.get(rig.node, rig.node)
            numbers = [number for number in shown.shape_numbers if chosen(body, rig.morph_names[number])]
            weights = rig.morph_weights.copy()
            if weight is not None:
                weights[numbers] = [weight(rig.morph_names[number]) for number in numbers]
            primitives.append(
                replace(
                    shown,
                    source=replace(shown.source, rig=replace(rig, morph_weights=weights)),
                    shapes=shown.shapes[np.isin(shown.shape_numbers, numbers)],
                    shape_numbers=np.array(numbers, np.intp),
                )
            )
        return replace(self, primitives=tuple(primitives))

    def clip(self, name: str | None) -> Clip | None:
        """The clip of a name, None for None; AssetError if there is no such clip."""
        return None if name is None else clip_named(self.clips, name, where=self.document.path)

    def posed(self, moment: Moment) -> list[tuple[ShownPrimitive, PosedMesh]]:
        """Pose the primitives that are visible at a moment; AssetError if there is no such clip."""
        clip, times = self.clip(moment.clip), np.array([moment.time])
        posed = ((shown, shown.source.posed(clip, times)) for shown in self.primitives)
        return [(shown, each) for shown, each in posed if not each.hidden[0]]


def tool_names(plans: Sequence[MeshPlan]) -> list[str]:
    """The names of the tools that are drawn, in the order of their colours."""
    parts = (part for plan in plans for part in (*patch_parts(plan), *outlined_parts(plan)))
    # A shirt over flesh swings by a part of the same name.
    return list(dict.fromkeys(part.attached.tool.name for part in parts))


def read_shown(
    document: Document, label: str, plans: Sequence[MeshPlan], *, refined: bool = True
) -> tuple[ShownAsset, list[str]]:
    """Read an asset to show, and a warning for each primitive whose texture cannot be read.

    The tools of the plans are drawn on it; `refined` says that they were baked into it.

    Raises:
        AssetError: A mesh, a skin or the hierarchy is malformed.
        TooMuchError: A primitive has too many triangles to draw.
    """
    sources = [source for source in read_scene(document) if len(source.triangles)]
    for source in sources:
        _refuse_many(document, len(source.triangles))
    paints, warnings = read_paints(document, sources)
    driven = wrinkle_targets(document)
    primitives = []
    for number, (source, paint) in enumerate(zip(sources, paints, strict=True)):
        of_bake = driven[source.rig.node]
        targets = np.array([k for k, name in enumerate(source.rig.morph_names) if name in of_bake], np.intp)
        shapes = source.vertices.morph_deltas[targets]
        marks = tuple(_marks(source, plans, refined))
        primitives.append(ShownPrimitive(number, source, paint, shapes, targets, marks))
    return ShownAsset(label, document, read_clips(document), tuple(primitives)), warnings


def _refuse_many(document: Document, count: int) -> None:
    """Check that memory suffices to draw so many triangles at once."""
    document.memory.check(_TRIANGLE_BYTES * count, f"{count:,} triangles to draw", where=document.path)


def _marks(source: ScenePrimitive, plans: Sequence[MeshPlan], refined: bool) -> Iterator[AnyMark]:
    """The tools on a primitive, which may have been refined for them."""
    inks = dict(zip(tool_names(plans), cycle(INKS), strict=False))
    for plan in plans:
        if plan.rig.node != source.rig.node:
            continue
        fine = plan.fine
        primitive = primitives_of(fine)[source.primitive]
        if refined and primitive.changed:
            parents = fine.subdivision.parents[fine.triangle_primitives == source.primitive]
            welded = primitive.weld[primitive.triangles]
        else:  # as stored in the file
            parents = np.flatnonzero(fine.surface.primitives == source.primitive)
            welded = primitive.weld[source.triangles]
        for part in patch_parts(plan):
            tool, region = part.attached.tool, part.attached.regions[0]
            # Triangles around the members too, because the ends of the segment lie on the rectangle's edge.
            around = plan.rest.around.faces_of(distinct_values(fine.surface.triangles[region.members]))
            triangles = children(parents, around)
            inside = among(parents[triangles], region.members)
            vertices, corners = renumbered(welded[triangles])
            positions, normals = fine.posed_at(region.pose, vertices)
            u, v = region.coordinates(positions[corners])
            shown = inside | (region.cosines(u.mean(axis=1), normals[corners].sum(axis=1)) > 0)
            triangles, inside, u, v = triangles[shown], inside[shown], u[shown], v[shown]
            yield Mark(
                name=tool.name,
                triangles=triangles,
                inside=inside,
                places=np.stack([u * region.span, v * region.half_width], axis=2),
                span=region.span,
                half_width=region.half_width,
                colour=inks[tool.name],
                phases=region.crests(u, v),
            )
        for part in outlined_parts(plan):
            name = part.attached.tool.name
            depths = np.full(len(fine.positions), -OUTLINED)
            depths[part.vertices] += part.shares
            near = np.flatnonzero((depths[welded] > -OUTLINED).any(axis=1))
            yield Outline(name, near, depths[welded[near]], inks[name])


def take_snapshot(asset: ShownAsset, moment: Moment, *, heat: bool, crests: bool = False) -> Snapshot:
    """All triangles of an asset at a moment, in the colours of its materials.

    Or they are coloured by compression (`heat`), or by the `crests` and furrows of its wrinkles.

    Raises:
        TooMuchError: There are too many triangles.
    """
    visible = asset.posed(moment)
    _refuse_many(asset.document, sum(len(posed.triangles) for _, posed in visible))
    parts, marks = [], list[AnyMark]()
    start = 0
    for shown, posed in visible:
        positions, triangles, paint = posed.positions[0], posed.wound(), shown.paint
        if posed.normals is None:
            normals = np.repeat(unit(face_normals(positions, triangles))[:, None], 3, axis=1)
        else:
            normals = posed.normals[0, triangles]
        if crests:
            bound = shown.source.vertices
            outward = np.zeros_like(bound.positions) if bound.normals is None else bound.normals
            paint = replace(paint, colours=crest_colours(shown.shapes, outward), texture=None)
        elif heat:
            colours = linear_rgb(heat_colours(compressions(shown.source, positions)))
            paint = replace(paint, colours=colours, texture=None)
        else:
            brightest = paint.colours.max(axis=1, keepdims=True)
            dimmed = paint.colours * (_BRIGHTEST / np.maximum(brightest, _BRIGHTEST))
            paint = replace(paint, colours=dimmed)
        parts.append((positions[triangles], normals, triangles, paint))
        for mark in shown.marks:
            wound = mark.rewound() if posed.mirrored[0] else mark
            tint = 0.0 if heat else mark.tint  # a tint would falsify the colours of compression
            marks.append(replace(wound, triangles=mark.triangles + start, tint=tint))
        start += len(triangles)
    return Snapshot.of(parts, marks)
