"""Draw a review: every tool of an asset close up, before and after, when its wrinkles are tallest, on one sheet."""

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np

from wrinklecli.character.clip import chosen_clips
from wrinklecli.errors import counted
from wrinklecli.frozen import dataclass
from wrinklecli.gltf.document import Document
from wrinklecli.gltf.pixels import Bytes
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.guard import Progress
from wrinklecli.review.preview.apply import PlannedTools, apply_tools
from wrinklecli.review.preview.camera import Camera, camera_axes, parse_view
from wrinklecli.review.preview.cards import Card, CardSheet, Picture, cards_size
from wrinklecli.review.preview.framing import View, nothing_to_see, place_of, plan_views
from wrinklecli.review.preview.heat import HEAT, heat_colours
from wrinklecli.review.preview.misfits import Misfit, find_misfits, misfit_overlay, misfit_points
from wrinklecli.review.preview.moments import Moment
from wrinklecli.review.preview.overlay import INK, RED, RULE, Placed, placed_words
from wrinklecli.review.preview.peaks import FIELDS, TOOLS, Fact, Peak, baked_peaks_of, planned_peaks
from wrinklecli.review.preview.preview_options import PreviewOptions, Style
from wrinklecli.review.preview.render import Snapshot, checked, render
from wrinklecli.review.preview.sheet_layout import Drawn, refuse_large, rgb_bytes
from wrinklecli.review.preview.shown import ShownAsset, read_shown, take_snapshot
from wrinklecli.review.preview.sides import Side, best_light, best_moment, best_side, side_above
from wrinklecli.tools.schema import KINDS

# The greatest number of tools on a sheet, which then has sixteen rows.
MOST_REVIEWED = 48
# For at most so many cards the number of columns, and the size of the pictures, pixels. Sheets are as wide as a screen.
_LAYOUTS = ((1, 1, (760, 570)), (2, 1, (640, 420)), (6, 2, (444, 320)), (MOST_REVIEWED, 3, (300, 225)))
# Part of its wrinkles below which a tool is out of sight.
_OUT_OF_SIGHT = 0.2
# Letters of a row below a card's pictures.
_ROW = 92
# The greatest number of rows of a text below a card's pictures.
_MOST_ROWS = 3
# Letters of a clip's name beyond which it gets rows of its own.
_LONG_NAME = 40
# Factors of the camera's distance in the two pictures of a tool that does not fit.
_MARGINS = {"close": 1.8, "whole": 1.1}
# The greatest side of an inset, over the shorter side of its picture.
_INSET = 0.36
# The least side of an inset, pixels.
_LEAST_INSET = 32
# There is an inset if it shows at least this many times as much as the picture: otherwise one sees where one is.
_INSET_SHOWS = 2.0
# Factor of the camera's distance in an inset.
_INSET_MARGIN = 1.05
# Labels of the pictures of what folds a field, and how.
_MEASURED = ("compression", "crests")
# Pixels around the asset in an inset, and the least half side of the frame.
_INSET_GAP = 3
# Pixels of the word at the right end of a legend, with its margins.
_LEGEND_WORD = 42


@dataclass(frozen=True, slots=True)
class _Shot:
    """A tool to draw on the card of a number.

    It is shown at its peak, or earlier if its wrinkles are hidden then. The view has one camera. The pictures are of
    what folds it, and how, if it is `measured`; else before and after.
    """

    number: int
    peak: Peak
    moment: Moment
    view: View
    measured: bool = False

    @property
    def aside(self) -> str:
        """The moment and the view; without the clip's name if it needs rows of its own."""
        when = f"{self.moment.time:.2f} s" if _clip_rows(self.peak) else self.moment.label
        return f"{when}, from {self.view.name}"

    @property
    def facts(self) -> list[Sequence[Fact]]:
        """Rows of facts."""
        if self.measured:
            return [[Fact("how much the surface is compressed, and where its folds are crests and furrows")]]
        first, *others = card_facts(self.peak)
        if self.view.visible < _OUT_OF_SIGHT:
            first = (*first, Fact("out of sight", alarming=True))
        elif self.moment != self.peak.moment:
            first = (*first, Fact(f"tallest at {self.peak.moment.time:.2f} s, but hidden"))
        return [first, *others]


def card_facts(peak: Peak) -> list[Sequence[Fact]]:
    """Rows of facts about a tool that hold for all views."""
    figures, *others = peak.facts
    return [figures, *_clip_rows(peak), *others]


def _clip_rows(peak: Peak) -> list[Sequence[Fact]]:
    """The name of a tool's clip in rows, if it is too long to stand beside the tool's."""
    name = peak.moment.clip or ""
    if len(name) <= _LONG_NAME:
        return []
    return [[Fact(row)] for row in textwrap.wrap(f"in clip {name}", _ROW)[:_MOST_ROWS]]


def review(
    document: Document, planned: PlannedTools | None, path: str, options: PreviewOptions, progress: Progress
) -> Drawn:
    """Draw a review of the planned tools of an asset; without them, of the tools that were baked into it.

    Messages name the picture by `path`. Without views in the options, each tool is seen from the side that shows it
    best. Without a size, the number of tools decides.

    Raises:
        AssetError: There are no wrinkles, or nothing to see.
        WrinkleError: The picture would be too large, or tools cannot be baked.
    """
    before, after, peaks, warnings = _read(document, planned, options, progress)
    misfits = [] if planned is None else find_misfits(planned, document)[:MOST_REVIEWED]
    shown = peaks[: MOST_REVIEWED - len(misfits)]
    warnings += _left_out(peaks[len(shown) :], peaks)
    sections = [*(each.section for each in shown), *(TOOLS for _ in misfits)]
    fields = sum(peak.section == FIELDS for peak in shown)
    count = (len(shown) + fields) * max(len(options.views), 1) + len(misfits)
    usual, size = next((row[1:] for row in _LAYOUTS if count <= row[0]), _LAYOUTS[-1][1:])
    columns, size = min(options.columns or usual, count), options.size or size
    rows = max(len(facts) for facts in (*map(card_facts, shown), *map(_refusal, misfits)))
    cells = columns, -(-count // columns)
    refuse_large(cards_size(*cells, size, rows), 1, path)
    options = replace(options, size=size)
    shots: list[_Shot] = []
    for looked, peak in enumerate(shown, 1):
        for moment, view in moments_and_views(after, peak, options):
            for measured in (False, True)[: 1 + (peak.section == FIELDS)]:
                shots.append(_Shot(len(shots), peak, moment, view, measured))
        progress("looking", looked, len(shown))
    sheet = CardSheet(*cells, size, rows, _title(document, planned, sections))
    cards = chain(_cards(before, after, shots, options), enumerate(_misfit_cards(before, misfits, options), len(shots)))
    for done, (number, card) in enumerate(cards):
        sheet.put(number, card)
        progress("drawing", done + 1, count)
    sides = dict.fromkeys([*(shot.view.name for shot in shots), *(misfit.view for misfit in misfits)])
    return Drawn((sheet.image,), _counted(sections), tuple(sides), warnings=tuple(warnings))


def moments_and_views(after: ShownAsset, peak: Peak, options: PreviewOptions) -> Iterator[tuple[Moment, View]]:
    """Choose the moment and the views of a tool: its peak, or a moment before it if a fold hides it then."""
    alone = _alone(after, peak)
    if options.views:
        yield from ((peak.moment, view) for view in plan_views([alone], [peak.moment], options))
        return

    def look(time: float) -> tuple[Moment, Side]:
        moment = replace(peak.moment, time=time)
        return moment, choose(*place_of(alone, moment))

    choose = side_above if peak.slides else best_side
    clip, time = alone.clip(peak.moment.clip), peak.moment.time
    start = time if clip is None else clip.start if clip.start < time else clip.end
    moment, side = best_moment(start, time, look)
    (view,) = plan_views([alone], [moment], replace(options, views=[side.name] if side.score else []))
    yield moment, replace(view, visible=side.visible)


def _counted(sections: Sequence[str]) -> str:
    """Count tools by their lists: `2 muscles, 1 touch`."""
    return ", ".join(counted(sections.count(key), *kind.words) for key, kind in KINDS.items() if key in sections)


def _left_out(missed: Sequence[Peak], peaks: Sequence[Peak]) -> list[str]:
    """A warning if some of all peaks are not shown."""
    if not missed:
        return []
    names = f"{missed[0].name}, … {missed[-1].name}" if len(missed) > 2 else ", ".join(each.name for each in missed)
    every = _counted([each.section for each in peaks])
    return [f"{len(missed)} of {every} {'is' if len(missed) == 1 else 'are'} not shown: {names}; --tool NAME shows one"]


def _read(
    document: Document, planned: PlannedTools | None, options: PreviewOptions, progress: Progress
) -> tuple[ShownAsset, ShownAsset, list[Peak], list[str]]:
    """Read the asset without and with wrinkles, its tools at their peaks, and warnings; AssetError without tools."""
    if planned is None:
        after, warnings = read_shown(document, "", ())
        clips = chosen_clips(after.clips, options.clips, where=document.path)
        return after.without_wrinkles(), after, baked_peaks_of(after, options.only, clips), warnings
    before, _ = read_shown(document, "", () if options.hide_tools else planned.plans, refined=False)
    if planned.job is None:
        return before, before, [], []
    clips = chosen_clips(planned.job.clips, options.clips, where=document.path)
    peaks = planned_peaks(planned.plans, clips, fps=planned.job.settings.sampling.fps)
    needed = dict.fromkeys(peak.moment.clip for peak in peaks[:MOST_REVIEWED] if peak.moment.clip is not None)
    applied, left_out = apply_tools(planned, list(needed), progress)
    after, warnings = read_shown(applied, "", ())
    return before, after, peaks, [*left_out, *warnings]


def _title(document: Document, planned: PlannedTools | None, sections: Sequence[str]) -> str:
    """The sheet's title, of tools in these lists."""
    of = "" if planned is None else f" with {Path(planned.settings.path).name}"
    each = "where" if len(sections) == 1 else "each where"
    most = "its wrinkles are tallest" if set(sections) <= {TOOLS} else "it moves the skin most"
    return f"{Path(document.path).name}{of}: {_counted(sections)}, {each} {most}; scene units"


def _cards(
    before: ShownAsset, after: ShownAsset, shots: Sequence[_Shot], options: PreviewOptions
) -> Iterator[tuple[int, Card]]:
    """The cards of tools with their numbers, in any order."""
    # Tools that are tallest at the same moment share its snapshots.
    together: dict[tuple[Moment, object], list[_Shot]] = {}
    for shot in shots:
        together.setdefault((shot.moment, None if shot.peak.raised else (shot.peak.node, shot.peak.name)), []).append(
            shot
        )
    for (moment, _), members in together.items():
        source = after if members[0].peak.raised else _alone(after, members[0].peak)
        snapshots = tuple(take_snapshot(each, moment, heat=options.heat) for each in (before, source))
        for shot in members:
            alone = _alone(after, shot.peak)
            place, free = place_of(alone, moment)
            axes = shot.view.cameras[0].axes
            key = best_light(place, axes, free)
            pair = snapshots
            if shot.measured:
                compressed = take_snapshot(alone.without_wrinkles(), moment, heat=True)
                pair = compressed, take_snapshot(alone, moment, heat=False, crests=True)
            elif shot.peak.slides and not options.heat:
                # A checker needs the same triangles before and after.
                plain, slid = (take_snapshot(each, moment, heat=False) for each in (alone.without_wrinkles(), alone))
                pair = checked(plain, slid, axes)
            yield shot.number, _card(shot, pair, key, options)


def _alone(after: ShownAsset, peak: Peak) -> ShownAsset:
    """The asset with the wrinkles of one tool; at their full height if no clip raises them."""

    def full(name: str) -> float:
        return peak.forward.get(name, 1.0)

    return after.of_targets(lambda node, name: node == peak.node and peak.owns(name), None if peak.raised else full)


def _card(shot: _Shot, snapshots: Sequence[Snapshot], key: Floats, options: PreviewOptions) -> Card:
    """A tool's pictures, before and after, in a key light from (3,) a direction in camera axes, and its facts."""
    marked = replace(snapshots[0], marks=tuple(m for m in snapshots[0].marks if m.name == shot.peak.name))
    camera = shot.view.cameras[0]
    # Left and right tools are seen from opposite sides; with mirrored lights their insets look alike.
    x, y, z = options.style.key
    style = replace(options.style, key=(-x, y, z)) if camera.axes[2, 0] < 0 else options.style
    raking = replace(style, key=tuple(key.tolist()))
    pictures = [render(each, camera, size=options.picture_size, style=raking) for each in (marked, snapshots[1])]
    pictures[0] = with_inset(pictures[0], snapshots[0], camera, style)
    labels = _MEASURED if shot.measured else options.labels or ("before", "after")
    words = _draw_legend(pictures[0]) if shot.measured else ()
    return Card(
        name=shot.peak.name,
        colour=marked.marks[0].colour if marked.marks else None,
        aside=shot.aside,
        facts=shot.facts,
        pictures=[Picture(*each) for each in zip(pictures, labels, (words, ()), strict=True)],
    )


def _draw_legend(pixels: Bytes) -> tuple[Placed, ...]:
    """Draw the colours of compression in the lower right corner of a (height, width, 3) picture, in place.

    Returns:
        What they mean at both ends.
    """
    height, width = pixels.shape[:2]
    side, long = max(height // 40, 4), width // 4
    right, bottom, top = width - max(5 * side, _LEGEND_WORD), height - 2 * side, HEAT[-1][0]
    bar = np.round(255 * heat_colours(np.linspace(0.0, top, long))).astype(np.uint8)
    pixels[bottom - side : bottom, right - long : right] = bar
    middle = bottom - side / 2
    ends = ((right - long - side, "0 %", "rm"), (right + side / 2, f"{100 * top:.0f} %", "lm"))
    return tuple(Placed((x, middle), word, INK, anchor) for x, word, anchor in ends)


def with_inset(pixels: Bytes, snapshot: Snapshot, camera: Camera, style: Style) -> Bytes:
    """A (height, width, 3) picture with the whole asset in its lower left corner, and a frame there around its view.

    The picture itself if it shows most of the asset, or is too small.
    """
    height, width = pixels.shape[:2]
    side = round(_INSET * min(height, width))
    far = Camera.framing(snapshot.corners.reshape(-1, 3), camera.axes, aspect=1.0, margin=_INSET_MARGIN)
    if far.reach < _INSET_SHOWS * camera.reach * max(1.0, width / height) or side < _LEAST_INSET:
        return pixels
    small = render(replace(snapshot, marks=()), far, size=(side, side), style=style)
    drawn = np.flatnonzero((small != small[0, 0]).any(axis=(0, 2)))
    corners = (
        camera.centre + camera.reach * np.array([[-width / height, 1.0], [width / height, -1.0]]) @ camera.axes[:2]
    )
    ends = far.project(corners, (side, side))
    middle, reach = ends.mean(axis=0), np.ptp(ends, axis=0) / 2.0
    low, high = (
        np.clip(np.round(middle + sign * np.maximum(reach, _INSET_GAP)), 0, side - 1).astype(int)
        for sign in (-1.0, 1.0)
    )
    _outline(small[low[1] : high[1] + 1, low[0] : high[0] + 1], rgb_bytes(RED))
    first = max(min(int(drawn.min(initial=side)), low[0]) - _INSET_GAP, 0)
    last = min(max(int(drawn.max(initial=0)), high[0]) + _INSET_GAP + 1, side)
    small = small[:, first:last]
    _outline(small, rgb_bytes(RULE))
    joined = pixels.copy()
    joined[height - side :, : small.shape[1]] = small
    return joined


def _outline(pixels: Bytes, colour: tuple[int, int, int]) -> None:
    """Draw the outermost pixels of a picture, in place."""
    for edge in (pixels[:1], pixels[-1:], pixels[:, :1], pixels[:, -1:]):
        edge[:] = colour


def _refusal(misfit: Misfit) -> list[Sequence[Fact]]:
    """The line with which a bake would refuse a tool that does not fit, in rows."""
    return [[Fact(row, alarming=True)] for row in textwrap.wrap(misfit.refused.reason, _ROW)[:_MOST_ROWS]]


def _misfit_cards(asset: ShownAsset, misfits: Sequence[Misfit], options: PreviewOptions) -> Iterator[Card]:
    """A card of each tool that does not fit: the points that it names, close up and with the whole asset.

    Raises:
        AssetError: There is nothing to see.
    """
    if not misfits:
        return
    stored, size = Moment(None, 0.0), options.picture_size
    snapshot = replace(take_snapshot(asset, stored, heat=options.heat), marks=())
    whole = snapshot.corners.reshape(-1, 3)
    if not len(whole) or not np.ptp(whole, axis=0).any():
        raise nothing_to_see(asset.document, points=len(whole) > 0)
    for misfit in misfits:
        points = misfit_points([misfit], asset, stored)
        overlay = misfit_overlay([misfit], asset, stored)
        pictures = []
        for label, framed in (("close", points), ("whole", np.concatenate([whole, points]))):
            axes = camera_axes(*parse_view(misfit.view))
            # Points that are all very far away have no more than one place on the mesh to look at.
            if not len(framed) or not np.ptp(framed, axis=0).any():
                framed = whole
            camera = Camera.framing(framed, axes, aspect=size[0] / size[1], margin=_MARGINS[label])
            picture = render(snapshot, camera, size=size, style=options.style, overlay=overlay)
            pictures.append(Picture(picture, label, placed_words(overlay, camera, size)))
        yield Card(misfit.name, RED, "does not fit", _refusal(misfit), pictures)
