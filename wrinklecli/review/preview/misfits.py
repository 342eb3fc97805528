"""Show tools that do not fit their asset: the points of their paths, and the distances of these from the mesh."""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from wrinklecli.character.clip import read_clips
from wrinklecli.character.mesh_names import MeshNames
from wrinklecli.character.rig import Rig, read_rig
from wrinklecli.character.surface import Surface, read_surface
from wrinklecli.errors import WrinkleError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Floats, Ints, diagonal
from wrinklecli.review.preview.apply import PlannedTools, RefusedTool
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.overlay import RED, Dot, Overlay, Stroke, Word
from wrinklecli.review.preview.shown import ShownAsset
from wrinklecli.surface.anchor import is_far, segment_at
from wrinklecli.surface.rest import Rest, asked_positions, rest_pose
from wrinklecli.tools.records import WrinkleTool

# Points farther from the mesh than this are not framed, over the asset's size.
_FARTHEST = 1.0
# Angle by which a view looks past the ends, so that their distance from the mesh shows, degrees.
_PAST = 60
# Views are multiples of this angle, degrees, and their elevation is at most _HIGHEST.
_STEP = 15
_HIGHEST = 30


@dataclass(frozen=True, slots=True)
class PathPoint:
    """A point of a tool's path, such as an end, and the place of a mesh that is nearest to it at rest.

    Attributes:
        offset: (3,) vector from the place to the point, world space at rest.
        node: Index of the mesh's node.
        primitive: Index in the mesh.
        vertices: (3,) glTF vertices of the triangle around the place.
        barycentrics: (3,) coordinates of the place in the triangle.
        normal: (3,) surface normal at the place.
        far: True if the point is too far from the mesh to be attached.
    """

    offset: Floats
    node: int
    primitive: int
    vertices: Ints
    barycentrics: Floats
    normal: Floats
    far: bool

    @property
    def distance(self) -> float:
        """Distance from the mesh, scene units."""
        return float(np.linalg.norm(self.offset))


@dataclass(frozen=True, slots=True)
class Misfit:
    """A tool that does not fit, and the points of its path; none if a point's place is unknown."""

    refused: RefusedTool
    points: tuple[PathPoint, ...]

    @property
    def name(self) -> str:
        """The tool's name."""
        return self.refused.tool.name

    @property
    def view(self) -> str:
        """The view, as azimuth:elevation, that looks past the side of the mesh to which the ends are nearest."""
        x, y, z = sum((each.normal for each in self.points), np.array((0.0, 0.0, 1e-9)))
        azimuth, elevation = np.degrees([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))])
        turned = (round(azimuth / _STEP) * _STEP + _PAST + 180) % 360 - 180
        return f"{turned}:{_STEP * round(min(max(elevation, -_HIGHEST), _HIGHEST) / _STEP)}"

    def places(self, asset: ShownAsset, moment: Moment) -> Floats:
        """(ends, 2, 3) for each end the nearest place of the mesh, and the point, which moves along with that place."""
        found = []
        for end in self.points:
            for shown, posed in asset.posed(moment):
                if (shown.source.rig.node, shown.source.primitive) == (end.node, end.primitive):
                    place = end.barycentrics @ posed.positions[0, end.vertices]
                    found.append([place, place + end.offset])
        return np.array(found).reshape(-1, 2, 3)


def find_misfits(planned: PlannedTools, document: Document) -> list[Misfit]:
    """Find the ends of the tools that do not fit an asset."""
    clips = read_clips(document) if planned.settings.tools else ()

    @cache
    def read(node: int) -> tuple[Rig, Surface]:
        rig = read_rig(document, node)
        return rig, read_surface(document, rig)

    def at_rest(node: int, tool: WrinkleTool) -> tuple[Rig, Surface, Rest]:
        rig, surface = read(node)
        return rig, surface, rest_pose(surface, rig, planned.settings, clips, [tool])

    found = []
    names = MeshNames.of(document)
    for refused in planned.misfits:
        named = names.called(refused.tool.node or "")
        try:
            meshes = {index: at_rest(index, refused.tool) for index in named or names.own}
            found.append(Misfit(refused, _points_of(refused.tool, meshes)))
        except WrinkleError:  # a marker is not a node, or a mesh cannot be posed
            found.append(Misfit(refused, ()))
    return found


def _points_of(tool: WrinkleTool, meshes: Mapping[int, tuple[Rig, Surface, Rest]]) -> tuple[PathPoint, ...]:
    """All points of a tool's path, by their nearest meshes at rest; `meshes` are those that it may be on, by node."""
    if not meshes:
        return ()
    ends = []
    rig, _, rest = next(iter(meshes.values()))
    points = asked_positions(rig, rest, tool)
    for number, point in enumerate(points):
        nearest = [(rest.closest_point(point), node) for node, (_, _, rest) in meshes.items()]
        (triangle, barycentrics, place), node = min(nearest, key=lambda each: float(np.linalg.norm(each[0][2] - point)))
        _, surface, rest = meshes[node]
        primitive = int(surface.primitives[triangle])
        ends.append(
            PathPoint(
                offset=point - place,
                node=node,
                primitive=primitive,
                vertices=surface.corners[triangle] - surface.vertex_starts[primitive],
                barycentrics=barycentrics,
                normal=barycentrics @ rest.normals_at(surface.triangles[triangle]),
                far=is_far(float(np.linalg.norm(point - place)), segment_at(points, number)),
            )
        )
    return tuple(ends)


def misfit_overlay(misfits: Sequence[Misfit], asset: ShownAsset, moment: Moment) -> Overlay:
    """Draw tools that do not fit: a dashed line through their points, and a line from each far point to the mesh."""
    strokes: list[Stroke] = []
    dots: list[Dot] = []
    words: list[Word] = []
    for misfit in misfits:
        places = misfit.places(asset, moment)
        if len(places):
            strokes.append(Stroke(places[:, 1], RED, width=1.6, behind=0.5, dash=6.0))
        tool = misfit.refused.tool
        for number, (end, (place, point)) in enumerate(zip(misfit.points, places, strict=False)):
            if end.far:
                strokes.append(Stroke(np.array([place, point]), RED, width=1.2, behind=0.5))
                dots += [Dot(point, RED, 5.0, "cross"), Dot(place, RED, 2.0)]
                words.append(
                    Word(point, f"{misfit.name} {tool.point_name(number)}: {end.distance:.3g} off", RED, always=True)
                )
            else:
                dots.append(Dot(point, RED, 3.5))
        if len(places) and not any(end.far for end in misfit.points):
            words.append(Word(places[0, 1], misfit.name, RED))
    return Overlay(strokes, dots, words)


def misfit_points(misfits: Sequence[Misfit], asset: ShownAsset, moment: Moment) -> Floats:
    """(points, 3) to frame; ends that are very far from the mesh are left out, or the asset would be a speck.

    There is none if nothing is visible at the moment.
    """
    visible = [posed.positions[0] for _, posed in asset.posed(moment)]
    if not misfits or not visible:
        return np.zeros((0, 3))
    pairs = np.concatenate([np.zeros((0, 2, 3)), *(misfit.places(asset, moment) for misfit in misfits)])
    everything = np.concatenate(visible)
    reach = _FARTHEST * diagonal(everything)
    near = np.linalg.norm(pairs[:, 1] - pairs[:, 0], axis=1) <= reach
    return np.concatenate([pairs[:, 0], pairs[near, 1]])
