"""Draw assets, baked or not, with or without their tools, as a review, a sheet or an animation."""

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from wrinklecli.baking.baked_body import wrinkle_targets
from wrinklecli.baking.job import BakeOptions
from wrinklecli.baking.track import with_driven_weights
from wrinklecli.character.clip import read_clips
from wrinklecli.character.moved import Motions, Moved, moved
from wrinklecli.character.scene import deforming_nodes
from wrinklecli.errors import WrinkleError, log_findings
from wrinklecli.files.outputs import Outputs, part_of
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document, read_document
from wrinklecli.gltf.images import files_of
from wrinklecli.numeric.guard import Progress, guarded, log_progress
from wrinklecli.numeric.memory import Memory
from wrinklecli.review.preview.apply import PlannedTools, plan_tools, without_contact
from wrinklecli.review.preview.preview_options import PreviewOptions
from wrinklecli.review.preview.rays import leave_room
from wrinklecli.tools.files_beside import with_files_beside

# The kinds of pictures, which are the endings of file names.
_KINDS = ("png", "webp", "gif")


@dataclass(frozen=True, slots=True)
class Preview:
    """A picture that was drawn.

    Attributes:
        path: The file.
        size: Width and height of the picture, or of each frame, pixels.
        shown: The number of moments, or of tools, in words.
        views: Views as they were used; `facing` as azimuth:elevation.
        warnings: A line each.
        notes: A line for each motion that was made, each part of the anims that was left out or renamed, and contact.
    """

    path: str
    size: tuple[int, int]
    shown: str
    views: tuple[str, ...]
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def summary(self) -> str:
        """The picture in a line."""
        return f"{self.size[0]} × {self.size[1]} pixels, {self.shown}, seen from {', '.join(self.views)}"


def preview(
    assets: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    options: PreviewOptions | None = None,
    *,
    outputs: Outputs | None = None,
    progress: Progress = log_progress,
    **named: Any,
) -> Preview:
    """Draw assets: a review of the tools, a sheet over time, or an animation.

    Args:
        assets: .gltf or .glb; several are shown side by side, at the same moments and from the same places.
        out: A .png (a sheet), or a .webp or .gif (an animation).
        options: The defaults of `PreviewOptions` if None.
        outputs: Other files to write, to which the picture is added. If None, the file is written before returning.
        progress: Called with a stage's name, steps done and steps in all.
        named: Single options by their names in `PreviewOptions`, in place of those in `options`.

    Raises:
        AssetError: An asset is at fault, or has nothing to show.
        WrinkleError: The tools file is at fault; the picture would be too large or cannot be written; or Pillow or
            embreex is missing.
        TypeError: `PreviewOptions` lacks a name of `named`.

    Examples:
        >>> from wrinklecli import preview
        >>> made = preview(["samples/wrist.glb"], "wrist.png", clips=["flex"], times=[0.5], size=(320, 240))
        >>> made.size
        (320, 240)
    """
    options = replace(options or PreviewOptions(), **named)
    path = os.fspath(out)
    with part_of(outputs) as written, guarded(os.fspath(assets[0])):
        refuse_missing()
        from wrinklecli.review.preview.sheet import draw_sheets
        from wrinklecli.review.preview.sheet_layout import encode_animation, encode_picture

        kind = Path(path).suffix.lower().removeprefix(".")
        if kind not in _KINDS:
            raise WrinkleError(f"ends in none of {', '.join(f'.{each}' for each in _KINDS)}", where=path)
        animated = kind != "png"
        if options.grid and not animated and not options.names_a_moment:
            options = replace(options, rest=True)
        written.claim(path)
        written.protect([*assets, *options.anims, *with_files_beside([] if options.tools is None else [options.tools])])
        memory = Memory(options.max_memory)
        documents = [read_document(each, allow_external=options.allow_external, memory=memory) for each in assets]
        range_of_motion = False if options.rest else options.range_of_motion or None
        motions = Motions(options.anims, range_of_motion, options.pose, options.morphs)
        joined: list[Moved] = []
        for document in documents:
            joined.append(moved(document, deforming_nodes(document), motions, driven=wrinkle_targets(document)))
            written.protect([*files_of(document), *joined[-1].beside])
            # The second asset is shown in the same motions.
            motions = replace(motions, range_of_motion=bool(joined[0].range))
        documents = [each.document for each in joined]
        planned, notes = _planned(documents[0], options)
        warnings = [*joined[0].warnings, *(() if planned is None else planned.warnings)]
        reviewed = is_reviewed(documents, planned, options, animated=animated)
        if reviewed:
            options = replace(options, clips=joined[0].chosen(options.clips))
        else:
            options = with_motions(options, joined[0], animated=animated)
        for number, each in enumerate(joined):
            documents[number], unread = with_driven_weights(each.document, each.added(options.clips))
            warnings += unread
        if reviewed:
            from wrinklecli.review.preview.review import review

            drawn = review(documents[0], planned, path, options, progress)
        else:
            drawn = draw_sheets(documents, planned, path, options, animated=animated, progress=progress)
        if animated:
            data = encode_animation(drawn.images, kind, seconds=drawn.seconds)
        else:
            data = encode_picture(drawn.images[0])
        written.add_bytes(path, data)
    warnings, notes = list(dict.fromkeys((*warnings, *drawn.warnings))), [*joined[0].notes, *notes]
    log_findings(warnings, notes, where=path)
    return Preview(path, drawn.images[0].size, drawn.shown, drawn.views, tuple(warnings), tuple(notes))


def refuse_missing(command: str = "preview") -> None:
    """Raise WrinkleError if a library for pictures is missing, which the extra of a command's name installs."""
    leave_room()
    try:
        import embreex.mesh_construction  # noqa: F401
        import PIL.Image  # noqa: F401
    except (ImportError, ValueError) as error:  # ValueError: built for another numpy
        raise WrinkleError(
            f"pictures need Pillow and embreex ({error}): pip install 'wrinklecli[{command}]'", where=command
        ) from error


def with_motions(options: PreviewOptions, joined: Moved, *, animated: bool) -> PreviewOptions:
    """Choose what to show if the options name no clip: the pose, the first clip of other files, or a few motions.

    The motions are those of an asset without clips that move. An asset with others keeps the options.
    """
    clips = joined.chosen(options.clips)
    of_anims = [name for name in joined.further if name not in joined.range]
    moves = any(clip.moves for clip in joined.clips if clip.name not in joined.range)
    if clips or moves or not joined.range:
        return replace(options, clips=clips or ([] if options.rest else of_anims[:1]))
    whole = animated or options.times or options.frames is not None or options.fps is not None
    return replace(options, clips=joined.telling, times=options.times if whole else (1.0,))


def _planned(document: Document, options: PreviewOptions) -> tuple[PlannedTools | None, list[str]]:
    """Attach the tools to an asset, if there are any, and say what is left out of them."""
    if options.tools is None:
        return None, []
    bake = BakeOptions(
        only=options.only,
        allow_external=options.allow_external,
        max_memory=options.max_memory,
        max_vertices=options.max_vertices,
    )
    return without_contact(plan_tools(document, options.tools, bake))


def is_reviewed(
    documents: Sequence[Document], planned: PlannedTools | None, options: PreviewOptions, *, animated: bool
) -> bool:
    """True for a review: if the options ask for one, or no shot and there are several tools or clips on a sheet."""
    from wrinklecli.review.preview.peaks import baked_tool_count

    if options.review or animated or len(documents) > 1 or options.names_a_shot:
        return options.review
    tools = baked_tool_count(documents[0]) if planned is None else planned.tool_count
    return tools > 1 or (tools == 1 and len(read_clips(documents[0])) > 1)
