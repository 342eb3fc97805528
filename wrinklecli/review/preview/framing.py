"""Place the cameras of a preview: what to frame at each moment, and from which side."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wrinklecli.character.scene import NO_MESH
from wrinklecli.errors import AssetError
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Bools, Floats, flags_of
from wrinklecli.numeric.guard import Progress, log_progress
from wrinklecli.review.preview.camera import FACING, VIEWS, Camera, camera_axes, parse_view
from wrinklecli.review.preview.grid import snapped
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.preview_options import PreviewOptions
from wrinklecli.review.preview.rays import Occluders
from wrinklecli.review.preview.shown import ShownAsset
from wrinklecli.review.preview.sides import LEAST_WRINKLE, Free, Place, best_side

# View of an asset without wrinkles.
_DEFAULT = "oblique"
# Views of a grid.
_GRID = ("front", "right", "top")
# Factor of the camera's distance from wrinkles, which are shown with what is around them.
_WRINKLES_MARGIN = 1.35
# Factor of the camera's distance from a whole figure, which leaves room for a label.
_FIGURE_MARGIN = 1.12
# Directions in which the bounds of a cloud of points are found, to frame it.
_DIRECTIONS = 128


@dataclass(frozen=True, slots=True)
class _Wrinkles:
    """The vertices that wrinkles move.

    Attributes:
        masks: For each primitive of each asset (vertices,) True for those that the wrinkles move at the moments, or
            could move if no wrinkle shows.
        most: The asset and the moment that show most of them; None without wrinkles.
    """

    masks: list[list[Bools]]
    most: tuple[ShownAsset, Moment] | None


@dataclass(frozen=True, slots=True)
class View:
    """A side from which assets are seen.

    Attributes:
        name: A name of `VIEWS`, or azimuth:elevation.
        cameras: One for each moment.
        visible: Part of the wrinkles that is visible from there, for a view that faces them.
    """

    name: str
    cameras: tuple[Camera, ...]
    visible: float = 1.0


def nothing_to_see(document: Document, *, points: bool) -> AssetError:
    """An error that says why there is no picture of an asset, which may have `points` at one place."""
    without = "no triangles in the scene, or all are scaled to 0" if document.items("meshes") else NO_MESH
    return AssetError(f"nothing to see: {'all is at one point' if points else without}", where=document.path)


def plan_views(
    assets: Sequence[ShownAsset],
    moments: Sequence[Moment],
    options: PreviewOptions,
    progress: Progress = log_progress,
    *,
    further: Sequence[Floats] = (),
) -> list[View]:
    """Place cameras for the views of the options, which all assets share; `FACING` becomes azimuth:elevation.

    If the options name no view, assets with wrinkles are seen from `FACING`. `further` has, for each moment,
    (points, 3) world-space points that must be visible too.

    Raises:
        AssetError: There is nothing to see, or `FACING` was asked for and there are no wrinkles.
    """
    wrinkles = _wrinkles(assets, moments)
    bounds, middles, boxes = [], list[Floats](), list[Floats]()
    for number, moment in enumerate(moments):
        points, middle, box = _points_to_frame(assets, moment, None if options.grid else wrinkles)
        bounds.append(np.concatenate([points, *further[number : number + 1]]))
        middles.append(middle)
        boxes.append(box)
        progress("posing", number + 1, len(moments))
    centres = np.zeros((len(moments), 3))
    # What goes further than it is large would look small.
    goes_far = np.ptp(np.mean(boxes, axis=1), axis=0).max() > np.ptp(boxes, axis=1).max()
    if options.follow or (options.focus is None and not options.grid and goes_far):
        centres[:] = middles
    if options.focus is not None:
        centres[:] = options.focus
        if options.follow:
            shown = next(asset for asset in assets if asset.primitives)
            centres = _followed(shown, moments, centres[0])
    relative = np.concatenate([points - centre for points, centre in zip(bounds, centres, strict=True)])
    views = []
    usual = _GRID if options.grid else [_DEFAULT if wrinkles.most is None else FACING]
    for view in options.views or usual:
        side = _facing(assets, wrinkles) if view == FACING else View(view, ())
        margin = _FIGURE_MARGIN if wrinkles.most is None or options.grid else _WRINKLES_MARGIN
        camera = _camera(relative, side.name, margin, options)
        if not camera.reach > 0:
            raise nothing_to_see(assets[0].document, points=True)
        views.append(replace(side, cameras=tuple(replace(camera, centre=camera.centre + each) for each in centres)))
    return views


def _camera(points: Floats, view: str, margin: float, options: PreviewOptions) -> Camera:
    """A camera that sees (points, 3) relative to the point that it looks at, or the radius of the options."""
    aspect = options.picture_size[0] / options.picture_size[1]
    camera = Camera.framing(points, camera_axes(*parse_view(view)), aspect=aspect, margin=margin)
    if options.radius is not None:
        camera = replace(camera, reach=options.radius / min(aspect, 1.0))
    if options.focus is not None:
        camera = replace(camera, centre=np.zeros(3))
    return snapped(camera) if options.grid else camera


def _wrinkles(assets: Sequence[ShownAsset], moments: Sequence[Moment]) -> _Wrinkles:
    totals = np.zeros((len(assets), len(moments)))
    found: list[list[Floats]] = []
    for place, asset in enumerate(assets):
        amounts = [np.zeros(len(shown.source.vertices.positions)) for shown in asset.primitives]
        for k, shown in enumerate(asset.primitives):
            for number, moment in enumerate(moments if len(shown.shape_numbers) else ()):
                moved = shown.displacements(asset.clip(moment.clip), moment.time)
                totals[place, number] += moved.sum()
                amounts[k] = np.maximum(amounts[k], moved)
        found.append(amounts)
    place, number = divmod(int(totals.argmax()), len(moments))
    most = assets[place], moments[number]
    if not totals.any():
        found = [[np.sqrt(np.sum(shown.shapes**2, axis=2)).sum(axis=0) for shown in each.primitives] for each in assets]
        wrinkled = next((asset for asset in assets if asset.wrinkled), assets[0])
        most = wrinkled.of_targets(lambda _node, _name: True, lambda _name: 1.0), Moment(None, 0.0)
    greatest = max((float(each.max(initial=0.0)) for amounts in found for each in amounts), default=0.0)
    masks = [[each > LEAST_WRINKLE * greatest for each in amounts] for amounts in found]
    return _Wrinkles(masks, most if greatest > 0 else None)


def _points_to_frame(
    assets: Sequence[ShownAsset], moment: Moment, wrinkles: _Wrinkles | None
) -> tuple[Floats, Floats, Floats]:
    """(points, 3) that bound the part that the wrinkles move at a moment, or everything; and its (3,) middle.

    The third are the (2, 3) least and greatest coordinates of everything.
    """
    points, corners = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for number, asset in enumerate(assets):
        for shown, posed in asset.posed(moment):
            positions, triangles = posed.positions[0], posed.triangles
            used = flags_of(triangles, len(positions))
            if used.any():
                corners += [positions[used].min(axis=0, keepdims=True), positions[used].max(axis=0, keepdims=True)]
            if wrinkles is not None and wrinkles.most is not None:
                used &= wrinkles.masks[number][shown.number]
                # Of a vertex that moves alone one sees the triangles around it.
                if used.any() and not np.ptp(positions[used], axis=0).any():
                    used[triangles[used[triangles].any(axis=1)]] = True
            points.append(positions[used])
    found = np.concatenate(points)
    if not len(found):
        raise nothing_to_see(assets[0].document, points=False)
    every = np.concatenate(corners)
    box = np.stack([every.min(axis=0), every.max(axis=0)])
    return _bounds(found), (found.min(axis=0) + found.max(axis=0)) / 2, box


def _bounds(points: Floats) -> Floats:
    """The (points, 3) that are furthest in some direction: they are few, and framing them frames all."""
    numbers = np.arange(_DIRECTIONS) + 0.5
    heights = 1 - 2 * numbers / _DIRECTIONS
    angles = np.pi * (1 + np.sqrt(5)) * numbers
    rings = np.sqrt(1 - heights**2)
    directions = np.stack([rings * np.cos(angles), heights, rings * np.sin(angles)])
    return np.asarray(points[np.unique(np.argmax(points @ directions, axis=0))])


def _facing(assets: Sequence[ShownAsset], wrinkles: _Wrinkles) -> View:
    """The view, without cameras yet, from which most of the wrinkles are visible; AssetError if there are none."""
    if wrinkles.most is None:
        others = ", ".join(VIEWS)
        raise AssetError(f"has no wrinkles to face; other views are {others}", where=assets[-1].document.path)
    side = best_side(*place_of(*wrinkles.most))
    return View(side.name if side.score > 0 else _DEFAULT, (), side.visible)


def place_of(asset: ShownAsset, moment: Moment) -> tuple[Place, Free]:
    """The place of an asset's wrinkles at a moment, and what is hidden there."""
    plain, wrinkled = asset.without_wrinkles().posed(moment), asset.posed(moment)
    nothing = np.zeros((0, 3, 3))
    before, after = (
        np.concatenate([nothing, *(posed.corners() for shown, posed in each if len(shown.shape_numbers))])
        for each in (plain, wrinkled)
    )
    everything = np.concatenate([nothing, *(posed.corners() for _, posed in wrinkled)])
    place = Place.of(before, after)
    return place, partial(Occluders.of(everything).free, place.points, place.normals)


def _followed(asset: ShownAsset, moments: Sequence[Moment], focus: Floats) -> Floats:
    """(moments, 3) positions of the vertex that is nearest to a point in the stored pose."""
    best, which = np.inf, (0, 0)
    for number, shown in enumerate(asset.primitives):
        positions = shown.source.positions_at(None, 0.0)
        squares = np.sum((positions - focus) ** 2, axis=1)
        vertex = int(np.argmin(squares))
        if squares[vertex] < best:
            best, which = float(squares[vertex]), (number, vertex)
    source = asset.primitives[which[0]].source
    places = [source.positions_at(asset.clip(m.clip), m.time)[which[1]] for m in moments]
    return np.array(places)
