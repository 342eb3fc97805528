"""Pictures of assets, baked or not, with or without their tools: a contact sheet over time, or an animation.

Posed as an engine would, then ray cast. Tools are applied as a bake would, in memory; nothing is proved, and no other
file is written.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.baking.job import BakeOptions, read_job, refuse_overwriting
from wrinklecli.baking.morphs import encode_morphs
from wrinklecli.baking.plan import MeshPlan, plan_meshes
from wrinklecli.baking.sample import sample_clips
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.edit import EditedDocument
from wrinklecli.gltf.files import replace_bytes
from wrinklecli.numeric.guard import Progress, guarded, no_progress
from wrinklecli.review.preview.framing import plan_cameras
from wrinklecli.review.preview.heat import HEAT, HEAT_TICKS, heat_colours
from wrinklecli.review.preview.moments import frame_seconds, plan_moments
from wrinklecli.review.preview.render import PLAIN, Style, render
from wrinklecli.review.preview.shown import INKS, read_shown, take_snapshot, tool_names

if TYPE_CHECKING:
    from wrinklecli.review.preview.sheet import Legend


MOST_SIDE = 16_383  # pixels: of a WebP
MOST_PIXELS = 2**28  # of a sheet, or of all frames of an animation, which are held until the file is written
_ENDINGS = {".png": "png", ".webp": "webp", ".gif": "gif"}

_SHEET_COLUMNS = 3


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
        moments = "1 moment" if self.moments == 1 else f"{self.moments} moments"
        return f"{self.size[0]} × {self.size[1]} pixels, {moments}, seen from {', '.join(self.views)}"


def preview(
    assets: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    tools: str | os.PathLike[str] | None = None,
    only: Sequence[str] = (),
    before: bool = False,
    hide_tools: bool = False,
    clips: Sequence[str] = (),
    rest: bool = False,
    times: Sequence[float] = (),
    frames: int | None = None,
    fps: float | None = None,
    views: Sequence[str] = (),
    focus: Sequence[float] | None = None,
    radius: float | None = None,
    follow: bool = False,
    size: tuple[int, int] = (800, 600),
    columns: int | None = None,
    labels: Sequence[str] = (),
    heat: bool = False,
    style: Style | None = None,
    allow_external: bool = False,
    progress: Progress = no_progress,
) -> Preview:
    """Draw assets, a contact sheet over time or an animation.

    Args:
        assets: .gltf or .glb; several are shown side by side, at the same moments and from the same places.
        out: A .png (a sheet), or a .webp or .gif (an animation).
        tools: A YAML file of tools, to apply to the one asset and to draw on it.
        only: Names of these tools; all where left out.
        before: Show the asset without the tools beside it.
        hide_tools: Apply the tools, but do not draw them.
        clips: Names; the first of the first asset where left out.
        rest: The pose as stored instead.
        times: Seconds; where left out, moments are spread over each clip.
        frames: How many moments of each clip.
        fps: Moments per second: of the clip, and of the animation.
        views: Names of `VIEWS`, `facing` (the wrinkles' side) or azimuth:elevation in degrees.
        focus: (3,) the point to look at, world space; where left out, the wrinkles, or else all.
        radius: Of what to see about it, scene units.
        follow: The camera moves with the wrinkles, or with the skin that is at `focus` in the stored pose.
        size: Width and height of each picture, pixels.
        columns: Moments in a row of a sheet.
        labels: One for each asset, or for before and after.
        heat: Colour the surface by its compression against the stored pose.
        style: How to draw.
        allow_external: Read buffers and images outside the asset's folder too.
        progress: Called with a stage's name, steps done and steps in all.

    Raises:
        AssetError: An asset is at fault, or has nothing to show.
        WrinkleError: The tools do not fit; the picture would be too large or cannot be written; or Pillow or embreex
            is missing.
    """
    _refuse_missing()
    from wrinklecli.review.preview import sheet as images

    with guarded(os.fspath(assets[0])):
        path = os.fspath(out)
        kind = _ENDINGS.get(Path(path).suffix.lower())
        if kind is None:
            raise WrinkleError(f"ends in none of {', '.join(_ENDINGS)}", where=path)
        warnings: list[str] = []
        documents = [read_document(each, allow_external=allow_external) for each in assets]
        read = [file for document in documents for file in document.files]
        refuse_overwriting([*read, *([os.fspath(tools)] if tools is not None else [])], [path])
        moments = plan_moments(
            documents[0], clips, animated=kind != "png", rest=rest, times=times, frames=frames, fps=fps
        )
        plans: list[MeshPlan] = []
        if tools is not None:
            named = list(dict.fromkeys(moment.clip for moment in moments if moment.clip is not None))
            applied, plans = apply_tools(
                assets[0],
                tools,
                only=only,
                clips=named,
                allow_external=allow_external,
                warnings=warnings,
                progress=progress,
            )
            documents = [*documents, applied] if before else [applied]
        names = list(labels)
        if not names and before:
            names = ["before", "after"]
        elif not names:
            names = [Path(document.path).stem for document in documents]
        subjects = []
        for document, name in zip(documents, names, strict=True):
            drawn = [] if hide_tools or document is not documents[-1] else plans
            subject, lines = read_shown(document, name, drawn)
            subjects.append(subject)
            warnings += lines
        legend = _legend(heat, [] if hide_tools else plans)
        columns = columns or (_SHEET_COLUMNS if len(subjects) == 1 else 1)
        columns = min(columns, len(moments)) if kind == "png" else 1
        shown, cameras = plan_cameras(
            subjects,
            moments,
            views,
            aspect=size[0] / size[1],
            focus=focus,
            radius=radius,
            follow=follow,
            progress=progress,
        )
        rows = -(-len(moments) // columns) if kind == "png" else 1
        layout = (columns * len(subjects), rows * len(shown))
        whole = images.sheet_size(*layout, size, legend)
        _refuse_large(whole, 1 if kind == "png" else len(moments), path)
        sheets = []
        for number, moment in enumerate(moments):
            at = number if kind == "png" else 0
            if not at:
                sheets.append(images.Sheet(*layout, size, legend))
            for column, subject in enumerate(subjects):
                snapshot = take_snapshot(subject, moment, heat=heat)
                for row, view in enumerate(shown):
                    picture = render(snapshot, cameras[row][number], size=size, style=style or PLAIN)
                    label = "   ".join([subject.label, moment.label, *([view] if len(shown) > 1 else [])])
                    across, down = at % columns * len(subjects) + column, row * rows + at // columns
                    sheets[-1].put(across, down, picture, label)
            progress("drawing", number + 1, len(moments))
        if kind == "png":
            data = images.encode_picture(sheets[0].image)
        else:
            seconds = frame_seconds(documents[0], moments, times=times, frames=frames, fps=fps)
            data = images.encode_animation([sheet.image for sheet in sheets], kind, seconds=seconds)
        replace_bytes(path, data)
        return Preview(path, whole, len(moments), tuple(shown), tuple(dict.fromkeys(warnings)))


def _refuse_missing() -> None:
    try:
        import embreex.mesh_construction  # noqa: F401
        import PIL.Image  # noqa: F401
    except (ImportError, ValueError) as error:  # ValueError: built for another numpy
        raise WrinkleError(
            f"pictures need Pillow and embreex ({error}): pip install 'wrinklecli[preview]'", where="preview"
        ) from error


def _refuse_large(size: tuple[int, int], count: int, path: str) -> None:
    """Check that a picture, or an animation of so many, can be written and held in memory."""
    if max(size) > MOST_SIDE:
        raise WrinkleError(f"would have {size[0]} × {size[1]} pixels; at most {MOST_SIDE} each way", where=path)
    if size[0] * size[1] * count > MOST_PIXELS:
        most = MOST_PIXELS // (size[0] * size[1])
        raise WrinkleError(f"would have {count} frames; of {size[0]} × {size[1]} pixels, at most {most}", where=path)


def apply_tools(
    asset: str | os.PathLike[str],
    tools: str | os.PathLike[str],
    *,
    only: Sequence[str] = (),
    clips: Sequence[str] = (),
    allow_external: bool = False,
    warnings: list[str] | None = None,
    progress: Progress = no_progress,
) -> tuple[Document, list[MeshPlan]]:
    """Bake tools into some clips of an asset, in memory.

    Args:
        asset: The .gltf or .glb.
        tools: The YAML file of tools.
        only: Names of the tools to apply; all where left out.
        clips: Names of the clips that get weights.
        allow_external: Read buffers and images outside the asset's folder too.
        warnings: Those of the tools are added.
        progress: Called with a stage's name, steps done and steps in all.

    Returns:
        The asset as the bake would leave it, and the tools on each of its meshes.

    Raises:
        WrinkleError: The asset or the tools are at fault, or do not go together.
    """
    job = read_job(asset, tools, BakeOptions(clips=clips, only=only, allow_external=allow_external))
    if warnings is not None:
        warnings += job.warnings
    draft = EditedDocument(job.document)
    plans = plan_meshes(job)
    chosen = [clip for clip in job.clips if clip.name in clips]
    for plan in plans:
        target_sets, motions = sample_clips(
            plan, chosen, fps=job.settings.sampling.fps, mode="morph", progress=progress
        )
        encode_morphs(draft, plan, target_sets, motions, sparse=True)
    return replace(draft.document(), allow_external=allow_external), plans


def _legend(heat: bool, plans: Sequence[MeshPlan]) -> "Legend":
    from wrinklecli.review.preview.sheet import Legend

    names = tuple((name, INKS[number % len(INKS)]) for number, name in enumerate(tool_names(plans)))
    if not heat:
        return Legend(names=names)
    top = HEAT[-1][0]
    ticks = tuple((tick / top, f"{tick:.0%}") for tick in HEAT_TICKS)
    return Legend("compressed by", heat_colours(np.linspace(0, top, 256)), ticks, names)
