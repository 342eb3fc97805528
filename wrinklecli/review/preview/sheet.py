"""Draw assets side by side, at some moments and from some sides, as one sheet or as the frames of an animation."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from wrinklecli.character.clip import chosen_clips
from wrinklecli.effects.effect import MeshPlan
from wrinklecli.errors import counted
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.arrays import Ints
from wrinklecli.numeric.guard import Progress, log_progress
from wrinklecli.review.preview.apply import PlannedTools, apply_tools
from wrinklecli.review.preview.framing import plan_views
from wrinklecli.review.preview.grid import draw_grid
from wrinklecli.review.preview.heat import HEAT, HEAT_TICKS, heat_colours
from wrinklecli.review.preview.misfits import Misfit, find_misfits, misfit_overlay, misfit_points
from wrinklecli.review.preview.moments import Moment, frame_seconds, plan_moments
from wrinklecli.review.preview.overlay import NOTHING, RED, placed_words
from wrinklecli.review.preview.peaks import baked_peaks_of
from wrinklecli.review.preview.preview_options import PreviewOptions
from wrinklecli.review.preview.render import render
from wrinklecli.review.preview.sheet_layout import Drawn, Legend, Sheet, refuse_large, sheet_size
from wrinklecli.review.preview.shown import INKS, ShownAsset, read_shown, take_snapshot, tool_names

# Moments in a row of a sheet of one asset.
_COLUMNS = 3
# Moments of a baked tool: parts of the time from the start of its clip to its peak.
_TO_PEAK = (0.0, 0.5, 1.0)


def draw_sheets(
    documents: Sequence[Document],
    planned: PlannedTools | None,
    path: str,
    options: PreviewOptions,
    *,
    animated: bool,
    progress: Progress,
) -> Drawn:
    """Draw assets over time, side by side; the first with its planned tools.

    Messages name the picture by `path`. Every moment of an animation is an image of its own.

    Raises:
        AssetError: An asset has nothing to show, or lacks a clip.
        WrinkleError: The picture would be too large, or tools cannot be baked.
    """
    plans: tuple[MeshPlan, ...] = ()
    if options.only and planned is None:
        shown, options, warnings = _read_tools(documents, options, animated=animated)
        moments = plan_moments(documents[0], options, animated=animated)
    else:
        moments = plan_moments(documents[0], options, animated=animated)
        shown, plans, warnings = _read_shown(documents, planned, moments, options, progress)
    misfits = [] if planned is None or options.hide_tools else find_misfits(planned, documents[0])
    further = [misfit_points(misfits, shown[-1], moment) for moment in moments]
    views = plan_views(shown, moments, options, progress, further=further)
    together = 1 if animated else len(moments)
    columns = min(options.columns or (_COLUMNS if len(shown) == 1 else 1), together)
    cells = _cells(together, columns, len(shown), len(views), beside=options.grid and len(moments) == 1)
    across, down = (cells.max(axis=(0, 1, 2)) + 1).tolist()
    legend = _legend(plans, misfits, heat=options.heat)
    refuse_large(sheet_size(across, down, options.picture_size, legend), len(moments) // together, path)
    up = "y" if planned is None else planned.settings.up
    sheets: list[Sheet] = []
    for number, moment in enumerate(moments):
        if number % together == 0:
            sheets.append(Sheet(across, down, options.picture_size, legend))
        misfit_lines = misfit_overlay(misfits, shown[-1], moment)
        for place, asset in enumerate(shown):
            snapshot = take_snapshot(asset, moment, heat=options.heat)
            for row, view in enumerate(views):
                camera, size = view.cameras[number], options.picture_size
                overlay = misfit_lines if asset is shown[-1] else NOTHING
                if options.grid:
                    overlay = draw_grid(asset, moment, camera, size, up=up).joined(overlay)
                picture = render(snapshot, camera, size=size, style=options.style, overlay=overlay)
                label = "   ".join([asset.label, moment.label, *([view.name] if len(views) > 1 else [])])
                words = placed_words(overlay, camera, size)
                at_column, at_row = cells[number % together, place, row].tolist()
                sheets[-1].put(at_column, at_row, picture, label, words)
        progress("drawing", number + 1, len(moments))
    return Drawn(
        images=tuple(sheet.image for sheet in sheets),
        seconds=frame_seconds(shown[0].document, moments, options),
        shown=counted(len(moments), "moment"),
        views=tuple(view.name for view in views),
        warnings=warnings,
    )


def _read_tools(
    documents: Sequence[Document], options: PreviewOptions, *, animated: bool
) -> tuple[list[ShownAsset], PreviewOptions, tuple[str, ...]]:
    """Read assets to show named tools that were baked into one of them, and choose the moments of the first tool.

    Returns:
        The assets; the options, which name the clip that raises the tool most, and times from its start to its peak
        unless they name a moment already; and warnings.
    """
    shown, _, warnings = _read_shown(documents, None, (), options, log_progress)
    body = next((asset for asset in shown if asset.wrinkled), shown[0])
    peaks = baked_peaks_of(body, options.only, chosen_clips(body.clips, options.clips, where=body.document.path))
    moment = peaks[0].moment
    clip = body.clip(moment.clip)
    if clip is not None and not options.names_a_moment:
        times = [clip.start + part * (moment.time - clip.start) for part in _TO_PEAK]
        options = replace(options, clips=[clip.name], times=() if animated else times)

    def chosen(node: int, target: str) -> bool:
        return any(peak.node == node and peak.owns(target) for peak in peaks)

    return [asset.of_targets(chosen) for asset in shown], options, warnings


def _read_shown(
    documents: Sequence[Document],
    planned: PlannedTools | None,
    moments: Sequence[Moment],
    options: PreviewOptions,
    progress: Progress,
) -> tuple[list[ShownAsset], tuple[MeshPlan, ...], tuple[str, ...]]:
    """Apply the tools, and read the assets from left to right; return them, the plans to draw, and warnings."""
    plans: tuple[MeshPlan, ...] = ()
    left_out: list[str] = []
    if planned is not None and planned.plans:
        clips = list(dict.fromkeys(moment.clip for moment in moments if moment.clip is not None))
        applied, left_out = apply_tools(planned, clips, progress)
        documents = [*documents, applied][0 if options.before else 1 :]
        plans = () if options.hide_tools else planned.plans
    elif options.before:
        documents = [*documents, *documents]
    labels = options.labels or (("before", "after") if options.before else [Path(each.path).stem for each in documents])
    shown: list[ShownAsset] = []
    warnings = left_out
    for document, label in zip(documents, labels, strict=True):
        asset, unread = read_shown(document, label, plans if document is documents[-1] else ())
        shown.append(asset)
        warnings += unread
    return shown, plans, tuple(dict.fromkeys(warnings))


def _cells(moments: int, columns: int, assets: int, views: int, *, beside: bool) -> Ints:
    """(moments, assets, views, 2) column and row of each picture on a sheet.

    Assets stand side by side at each moment, with `columns` moments in a row; each view has rows of its own, or stands
    `beside` the others.
    """
    moment, asset, view = np.indices((moments, assets, views))
    if beside:
        return np.stack([view * assets + asset, 0 * view], axis=-1)
    rows = -(-moments // columns)
    return np.stack([moment % columns * assets + asset, view * rows + moment // columns], axis=-1)


def _legend(plans: Sequence[MeshPlan], misfits: Sequence[Misfit], *, heat: bool) -> Legend:
    """Explain the colours of the tools, and of compression."""
    names = tuple((name, INKS[number % len(INKS)]) for number, name in enumerate(tool_names(plans)))
    names += tuple((f"{each.name} (does not fit)", RED) for each in misfits)
    if not heat:
        return Legend(names=names)
    top = HEAT[-1][0]
    ticks = tuple((tick / top, f"{tick:.0%}") for tick in HEAT_TICKS)
    return Legend("compressed by", heat_colours(np.linspace(0, top, 256)), ticks, names)
