"""A review: every tool of an asset close up, before and after, when its wrinkles are tallest, on one sheet."""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wrinklecli.character.clip import chosen_clips
from wrinklecli.errors import AssetError, counted, listed, nearest
from wrinklecli.gltf.document import Document
from wrinklecli.numeric.guard import Progress
from wrinklecli.review.preview.apply import PlannedTools, apply_tools
from wrinklecli.review.preview.camera import Camera, camera_axes, parse_view
from wrinklecli.review.preview.framing import View, plan_views
from wrinklecli.review.preview.inset import with_inset
from wrinklecli.review.preview.misfits import RED, Misfit, find_misfits, misfit_overlay, misfit_points
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.overlay import placed_words
from wrinklecli.review.preview.peaks import Fact, Peak, baked_peaks, planned_peaks
from wrinklecli.review.preview.preview_options import PreviewOptions
from wrinklecli.review.preview.render import Snapshot, render
from wrinklecli.review.preview.shown import INKS, ShownAsset, read_shown, take_snapshot

if TYPE_CHECKING:
    from wrinklecli.review.preview.cards import Card
    from wrinklecli.review.preview.sheet_layout import Drawn

# Tools on a sheet at most: it has then sixteen rows.
MOST_REVIEWED = 48
# Up to so many cards: in how many columns, and the size of their pictures, pixels. Sheets are as wide as a screen.
_LAYOUTS = ((1, 1, (760, 570)), (2, 1, (640, 420)), (6, 2, (444, 320)), (MOST_REVIEWED, 3, (300, 225)))
# Share of its wrinkles below which a tool is hidden, and parts of the way to its peak where it is looked at then: the
# nearest where it is in plain sight, else where so many times as much of it is seen.
_HIDDEN, _PLAIN, _MORE = 0.55, 0.7, 1.2
_EARLIER = (0.85, 0.7, 0.55, 0.4)
_UNSEEN = 0.2  # share of its wrinkles below which there is nothing to judge
# Letters and rows of a line that stands below a card's pictures; and letters of a clip's name from which it does.
_REASON, _REASON_ROWS = 92, 3
_LONG_NAME = 40
_BRIGHTEST = 0.65  # linear RGB, of a base colour
_MARGINS = {"close": 1.8, "whole": 1.1}  # of the distance, of a tool that does not fit


@dataclass(frozen=True, slots=True)
class _Shot:
    """A tool to draw.

    Attributes:
        number: Of its card.
        peak: The tool.
        ink: Number of its colour.
        moment: When it is shown: its peak, unless its wrinkles are hidden then.
        view: From which side, and with which camera.
    """

    number: int
    peak: Peak
    ink: int
    moment: Moment
    view: View

    @property
    def aside(self) -> str:
        """When, and from where; in which clip, unless its name needs rows of its own."""
        when = f"{self.moment.time:.2f} s" if _clip_rows(self.peak) else self.moment.label
        return f"{when}, from {self.view.name}"

    @property
    def facts(self) -> list[Sequence[Fact]]:
        """What is to be said of it."""
        first, *others = card_facts(self.peak)
        if self.view.share < _UNSEEN:
            first = (*first, Fact("out of sight", alarming=True))
        elif self.moment != self.peak.moment:
            first = (*first, Fact(f"hidden at {self.peak.moment.time:.2f} s"))
        return [first, *others]


def card_facts(peak: Peak) -> list[Sequence[Fact]]:
    """What is to be said of a tool, from whichever side it is seen."""
    figures, *others = peak.facts
    return [figures, *_clip_rows(peak), *others]


def _clip_rows(peak: Peak) -> list[Sequence[Fact]]:
    """The name of a tool's clip where it is too long to stand beside the tool's."""
    name = peak.moment.clip or ""
    if len(name) <= _LONG_NAME:
        return []
    return [[Fact(row)] for row in textwrap.wrap(f"in clip {name}", _REASON)[:_REASON_ROWS]]


def review(
    document: Document, planned: PlannedTools | None, path: str, options: PreviewOptions, progress: Progress
) -> "Drawn":
    """Draw a review of an asset.

    Args:
        document: The asset.
        planned: Tools to apply to it; where there are none, those that were baked into it are shown.
        path: Of the picture, for messages.
        options: Tools and clips to look at; views (the side that shows a tool, where none is named), columns, labels,
            heat and style; and the size of pictures, which is otherwise chosen by their number.
        progress: Called with a stage's name, steps done and steps in all.

    Raises:
        AssetError: There are no wrinkles, or nothing to see.
        WrinkleError: It would be too large, or tools cannot be baked.
    """
    from wrinklecli.review.preview.cards import CardSheet, cards_size
    from wrinklecli.review.preview.sheet_layout import Drawn, refuse_large

    before, after, peaks, warnings = _read(document, planned, options, progress)
    misfits = [] if planned is None else find_misfits(planned, document)[:MOST_REVIEWED]
    shown = peaks[: MOST_REVIEWED - len(misfits)]
    warnings += _missing(peaks[len(shown) :], len(peaks))
    count = len(shown) * max(len(options.views), 1) + len(misfits)
    columns, size = _layout(count, options)
    rows = max(len(facts) for facts in (*map(card_facts, shown), *map(_refusal, misfits)))
    cells = columns, -(-count // columns)
    refuse_large(cards_size(*cells, size, rows), 1, path)
    options = replace(options, size=size)
    shots: list[_Shot] = []
    for ink, peak in enumerate(shown):
        for moment, view in moments_and_views(after, peak, options):
            shots.append(_Shot(len(shots), peak, ink, moment, view))
        progress("looking", ink + 1, len(shown))
    sheet = CardSheet(*cells, size, rows, _title(document, planned, len(shown) + len(misfits)))
    cards = chain(_cards(before, after, shots, options), enumerate(_misfit_cards(before, misfits, options), len(shots)))
    for done, (number, card) in enumerate(cards):
        sheet.put(number, card)
        progress("drawing", done + 1, count)
    sides = dict.fromkeys([*(shot.view.name for shot in shots), *(misfit.view for misfit in misfits)])
    return Drawn((sheet.image,), counted(len(shown) + len(misfits), "tool"), tuple(sides), warnings=tuple(warnings))


def moments_and_views(after: ShownAsset, peak: Peak, options: PreviewOptions) -> Iterator[tuple[Moment, View]]:
    """When and from where to look at a tool: at its peak, or before it where a fold hides it then from all sides."""
    alone = _alone(after, peak)
    views = plan_views([alone], [peak.moment], options)
    clip = alone.clip(peak.moment.clip)
    if clip is None or views[0].share >= _HIDDEN:
        yield from ((peak.moment, view) for view in views)
        return
    start = clip.start if clip.start < peak.moment.time else clip.end
    best, least = (peak.moment, views[0]), _MORE * views[0].seen
    for part in _EARLIER:
        moment = replace(peak.moment, time=start + part * (peak.moment.time - start))
        (view,) = plan_views([alone], [moment], options)
        if view.seen > least:
            best, least = (moment, view), view.seen
            if view.share >= _PLAIN:
                break
    yield best


def _missing(missed: Sequence[Peak], count: int) -> list[str]:
    """A warning of those of so many tools that are not shown."""
    if not missed:
        return []
    names = f"{missed[0].name}, … {missed[-1].name}" if len(missed) > 2 else ", ".join(each.name for each in missed)
    return [f"{len(missed)} of {count} tools are not shown: {names}; --tool NAME shows one"]


def _read(
    document: Document, planned: PlannedTools | None, options: PreviewOptions, progress: Progress
) -> tuple[ShownAsset, ShownAsset, list[Peak], list[str]]:
    """The asset without and with wrinkles, its tools at their peaks, and warnings.

    Raises:
        AssetError: It has no wrinkles, or no clip or tool of a name.
    """
    if planned is None:
        after, warnings = read_shown(document, "", ())
        clips = chosen_clips(after.clips, options.clips, where=document.path)
        peaks = baked_peaks(after, clips)
        if not peaks:
            raise AssetError("has no wrinkles to review", where=document.path)
        return after.without_wrinkles(), after, _named(peaks, options.only, document), warnings
    before, _ = read_shown(document, "", () if options.hide_tools else planned.plans, refined=False)
    if planned.job is None:
        return before, before, [], []
    clips = chosen_clips(planned.job.clips, options.clips, where=document.path)
    peaks = planned_peaks(planned.plans, clips, fps=planned.job.settings.sampling.fps)
    raising = dict.fromkeys(peak.moment.clip for peak in peaks[:MOST_REVIEWED] if peak.moment.clip is not None)
    after, warnings = read_shown(apply_tools(planned, list(raising), progress), "", ())
    return before, after, peaks, warnings


def _named(peaks: list[Peak], names: Sequence[str], document: Document) -> list[Peak]:
    """Those of some names; all where there are none."""
    known = [peak.name for peak in peaks]
    for name in names:
        if name not in known:
            raise AssetError(
                f"has no tool {name!r}{nearest(name, known)}; there are {listed(known)}", where=document.path
            )
    return [peak for peak in peaks if not names or peak.name in names]


def _title(document: Document, planned: PlannedTools | None, count: int) -> str:
    """Of the sheet."""
    of = "" if planned is None else f" with {Path(planned.settings.path).name}"
    each = "where" if count == 1 else "each where"
    return f"{Path(document.path).name}{of}: {counted(count, 'tool')}, {each} its wrinkles are tallest; scene units"


def _cards(
    before: ShownAsset, after: ShownAsset, shots: Sequence[_Shot], options: PreviewOptions
) -> Iterator[tuple[int, "Card"]]:
    """The cards of tools, with their numbers, in any order."""
    # Tools that are tallest at the same moment share what is posed for it.
    together: dict[tuple[Moment, int], list[_Shot]] = {}
    for shot in shots:
        together.setdefault((shot.moment, -1 if shot.peak.raised else shot.ink), []).append(shot)
    for (moment, _), members in together.items():
        source = after if members[0].peak.raised else _alone(after, members[0].peak)
        snapshots = [_toned(take_snapshot(each, moment, heat=options.heat), options) for each in (before, source)]
        for shot in members:
            yield shot.number, _card(shot, snapshots, options)


def _toned(snapshot: Snapshot, options: PreviewOptions) -> Snapshot:
    """A snapshot in which white, as assets without textures are, is so dim that relief shows in the light."""
    return snapshot if options.heat else replace(snapshot, colours=np.minimum(snapshot.colours, _BRIGHTEST))


def _layout(count: int, options: PreviewOptions) -> tuple[int, tuple[int, int]]:
    """In how many columns so many cards are, and the size of their pictures."""
    columns, size = next((row[1:] for row in _LAYOUTS if count <= row[0]), _LAYOUTS[-1][1:])
    return min(options.columns or columns, count), options.size or size


def _alone(after: ShownAsset, peak: Peak) -> ShownAsset:
    """An asset with the wrinkles of one tool to look at; at their full height, where no clip raises them."""
    return after.of_targets(lambda node, name: node == peak.node and peak.owns(name), raised=not peak.raised)


def _card(shot: _Shot, snapshots: Sequence[Snapshot], options: PreviewOptions) -> "Card":
    """A tool's pictures, before and after, and what is to be said of it."""
    from wrinklecli.review.preview.cards import Card, Picture

    marked = replace(snapshots[0], marks=tuple(m for m in snapshots[0].marks if m.name == shot.peak.name))
    camera = shot.view.cameras[0]
    # Tools of the left and the right are seen from opposite sides: so they look alike.
    style = replace(options.style, lit_from_right=bool(camera.axes[2, 0] < 0))
    pictures = [render(each, camera, size=options.picture_size, style=style) for each in (marked, snapshots[1])]
    pictures[0] = with_inset(pictures[0], snapshots[0], camera, style)
    return Card(
        name=shot.peak.name,
        colour=INKS[shot.ink % len(INKS)] if marked.marks else None,
        aside=shot.aside,
        facts=shot.facts,
        pictures=[Picture(*each) for each in zip(pictures, options.labels or ("before", "after"), strict=True)],
    )


def _refusal(misfit: Misfit) -> list[Sequence[Fact]]:
    """What is to be said of a tool that does not fit: the line that a bake would refuse it with, in rows."""
    return [[Fact(row, alarming=True)] for row in textwrap.wrap(misfit.refused.reason, _REASON)[:_REASON_ROWS]]


def _misfit_cards(asset: ShownAsset, misfits: Sequence[Misfit], options: PreviewOptions) -> Iterator["Card"]:
    """For each tool that does not fit where its ends were asked for, from near and with all of the asset."""
    from wrinklecli.review.preview.cards import Card, Picture

    if not misfits:
        return
    stored, size = Moment(None, 0.0), options.picture_size
    snapshot = _toned(replace(take_snapshot(asset, stored, heat=options.heat), marks=()), options)
    whole = snapshot.corners.reshape(-1, 3)
    for misfit in misfits:
        points = misfit_points([misfit], asset, stored)
        overlay = misfit_overlay([misfit], asset, stored)
        pictures = []
        for tag, framed in (("close", points), ("whole", np.concatenate([whole, points]))):
            axes = camera_axes(*parse_view(misfit.view))
            camera = Camera.framing(
                framed if len(framed) else whole, axes, aspect=size[0] / size[1], margin=_MARGINS[tag]
            )
            picture = render(snapshot, camera, size=size, style=options.style, overlay=overlay)
            pictures.append(Picture(picture, tag, placed_words(overlay, camera, size)))
        yield Card(misfit.name, RED, "does not fit", _refusal(misfit), pictures)
