"""Pictures of assets, baked or not, with or without their tools: a contact sheet over time, or an animation.

Assets are posed as an engine would pose them, then traced by rays. Nothing but the picture is written.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.baking.plan import MeshPlan
from wrinklecli.errors import WrinkleError, counted
from wrinklecli.files.outputs import Outputs, part_of
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.images import files_of
from wrinklecli.numeric.guard import Progress, guarded, no_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.review.preview.apply import apply_tools
from wrinklecli.review.preview.framing import View, plan_views
from wrinklecli.review.preview.heat import HEAT, HEAT_TICKS, heat_colours
from wrinklecli.review.preview.moments import Moment, frame_seconds, plan_moments
from wrinklecli.review.preview.options import MOST_SIDE, PreviewOptions
from wrinklecli.review.preview.rays import leave_room
from wrinklecli.review.preview.render import render
from wrinklecli.review.preview.shown import INKS, ShownAsset, read_shown, take_snapshot, tool_names

if TYPE_CHECKING:
    from wrinklecli.review.preview.sheet import Legend, Sheet


# Pixels of a sheet, or of all frames of an animation: they are held in memory until the file is written.
MOST_PIXELS = 2**28
_ENDINGS = {".png": "png", ".webp": "webp", ".gif": "gif"}
_SHEET_COLUMNS = 3  # moments in a row, of one asset


@dataclass(frozen=True, slots=True)
class Preview:
    """What was drawn.

    Attributes:
        path: The file.
        size: Of its picture, or of each frame, pixels.
        moments: How many there are.
        views: As used; `facing` as the angles that it came to.
        warnings: A line each.
    """

    path: str
    size: tuple[int, int]
    moments: int
    views: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def summary(self) -> str:
        """In a line."""
        moments = counted(self.moments, "moment")
        return f"{self.size[0]} × {self.size[1]} pixels, {moments}, seen from {', '.join(self.views)}"


def preview(
    assets: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    options: PreviewOptions | None = None,
    *,
    outputs: Outputs | None = None,
    progress: Progress = no_progress,
) -> Preview:
    """Draw assets, a contact sheet over time or an animation.

    Args:
        assets: .gltf or .glb; several are shown side by side, at the same moments and from the same places.
        out: A .png (a sheet), or a .webp or .gif (an animation).
        options: What to show, and how.
        outputs: What the picture is added to; left out, it is in its place at the end.
        progress: Called with a stage's name, steps done and steps in all.

    Raises:
        AssetError: An asset is at fault, or has nothing to show.
        WrinkleError: The tools do not fit; the picture would be too large or cannot be written; or Pillow or embreex
            is missing.
    """
    options = options or PreviewOptions()
    path = os.fspath(out)
    with part_of(outputs) as written, guarded(os.fspath(assets[0])):
        _refuse_missing()
        from wrinklecli.review.preview.sheet import encode_animation, encode_picture, sheet_size

        kind = _kind(path)
        animated = kind != "png"
        documents = _read_documents(assets, path, options, written)
        moments = plan_moments(documents[0], options, animated=animated)
        shown, plans, warnings = _read_shown(documents, moments, options, progress)
        views = plan_views(shown, moments, options, progress)
        together = 1 if animated else len(moments)
        columns = min(options.columns or (_SHEET_COLUMNS if len(shown) == 1 else 1), together)
        layout = _Layout(together, columns, len(shown), len(views))
        legend = _legend(plans, heat=options.heat)
        size = sheet_size(*layout.cells, options.size, legend)
        _refuse_large(size, len(moments) // together, path)
        images = [sheet.image for sheet in _draw(shown, moments, views, layout, legend, options, progress)]
        if animated:
            data = encode_animation(images, kind, seconds=frame_seconds(shown[0].document, moments, options))
        else:
            data = encode_picture(images[0])
        written.add_bytes(path, data)
    return Preview(path, size, len(moments), tuple(view.name for view in views), warnings)


def _refuse_missing() -> None:
    leave_room()
    try:
        import embreex.mesh_construction  # noqa: F401
        import PIL.Image  # noqa: F401
    except (ImportError, ValueError) as error:  # ValueError: built for another numpy
        raise WrinkleError(
            f"pictures need Pillow and embreex ({error}): pip install 'wrinklecli[preview]'", where="preview"
        ) from error


def _kind(path: str) -> str:
    """The kind of file, by the end of its name."""
    kind = _ENDINGS.get(Path(path).suffix.lower())
    if kind is None:
        raise WrinkleError(f"ends in none of {', '.join(_ENDINGS)}", where=path)
    return kind


def _read_documents(
    assets: Sequence[str | os.PathLike[str]], out: str, options: PreviewOptions, outputs: Outputs
) -> list[Document]:
    """Read assets, none of whose files, nor the tools, may be written to."""
    outputs.claim(out)
    outputs.protect([*assets, *([] if options.tools is None else [options.tools])])
    memory = Memory(options.max_memory)
    documents = [read_document(each, allow_external=options.allow_external, memory=memory) for each in assets]
    for document in documents:
        outputs.protect(files_of(document))
    return documents


def _read_shown(
    documents: Sequence[Document], moments: Sequence[Moment], options: PreviewOptions, progress: Progress
) -> tuple[list[ShownAsset], tuple[MeshPlan, ...], tuple[str, ...]]:
    """Apply the tools, if any, and read what can be seen: assets from left to right, tools to draw, and warnings."""
    plans: tuple[MeshPlan, ...] = ()
    warnings: list[str] = []
    if options.tools is not None:
        document = documents[0]
        applied = apply_tools(
            document.path,
            options.tools,
            only=options.only,
            clips=list(dict.fromkeys(moment.clip for moment in moments if moment.clip is not None)),
            allow_external=options.allow_external,
            max_memory=options.max_memory,
            max_vertices=options.max_vertices,
            progress=progress,
        )
        documents = [document, applied.document] if options.before else [applied.document]
        warnings += applied.warnings
        plans = () if options.hide_tools else applied.plans
    stems = [Path(document.path).stem for document in documents]
    labels = options.labels or (("before", "after") if options.before else stems)
    shown = []
    for document, label in zip(documents, labels, strict=True):
        asset, unread = read_shown(document, label, plans if document is documents[-1] else ())
        shown.append(asset)
        warnings += unread
    return shown, plans, tuple(dict.fromkeys(warnings))


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where pictures lie on a sheet.

    Attributes:
        moments: On each sheet: all of them, or one where each sheet is a frame of an animation.
        columns: Moments in a row.
        assets: How many there are, side by side at each moment.
        views: How many there are, each with rows of its own.
    """

    moments: int
    columns: int
    assets: int
    views: int

    @property
    def rows(self) -> int:
        """Of moments."""
        return -(-self.moments // self.columns)

    @property
    def cells(self) -> tuple[int, int]:
        """Columns and rows of pictures."""
        return self.columns * self.assets, self.rows * self.views

    def cell(self, moment: int, asset: int, view: int) -> tuple[int, int]:
        """Column and row of a picture."""
        row, column = divmod(moment % self.moments, self.columns)
        return column * self.assets + asset, view * self.rows + row


def _refuse_large(size: tuple[int, int], count: int, path: str) -> None:
    """Check that a picture, or an animation of so many, can be written and held in memory."""
    if max(size) > MOST_SIDE:
        raise WrinkleError(f"would have {size[0]} × {size[1]} pixels; at most {MOST_SIDE} each way", where=path)
    if size[0] * size[1] * count > MOST_PIXELS:
        most = MOST_PIXELS // (size[0] * size[1])
        raise WrinkleError(f"would have {count} frames; of {size[0]} × {size[1]} pixels, at most {most}", where=path)


def _legend(plans: Sequence[MeshPlan], *, heat: bool) -> "Legend":
    """What explains the colours: of the tools, and of compression."""
    from wrinklecli.review.preview.sheet import Legend

    names = tuple((name, INKS[number % len(INKS)]) for number, name in enumerate(tool_names(plans)))
    if not heat:
        return Legend(names=names)
    top = HEAT[-1][0]
    ticks = tuple((tick / top, f"{tick:.0%}") for tick in HEAT_TICKS)
    return Legend("compressed by", heat_colours(np.linspace(0, top, 256)), ticks, names)


def _draw(
    shown: Sequence[ShownAsset],
    moments: Sequence[Moment],
    views: Sequence[View],
    layout: _Layout,
    legend: "Legend",
    options: PreviewOptions,
    progress: Progress,
) -> list["Sheet"]:
    """Draw all assets at all moments from all views."""
    from wrinklecli.review.preview.sheet import Sheet

    sheets: list[Sheet] = []
    for number, moment in enumerate(moments):
        if number % layout.moments == 0:
            sheets.append(Sheet(*layout.cells, options.size, legend))
        for column, asset in enumerate(shown):
            snapshot = take_snapshot(asset, moment, heat=options.heat)
            for row, view in enumerate(views):
                picture = render(snapshot, view.cameras[number], size=options.size, style=options.style)
                label = "   ".join([asset.label, moment.label, *([view.name] if len(views) > 1 else [])])
                sheets[-1].put(*layout.cell(number, column, row), picture, label)
        progress("drawing", number + 1, len(moments))
    return sheets
