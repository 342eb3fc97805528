"""Draw the control curve of each tool as it shortens, and the height of its bumps over each clip."""

import importlib.util
import io
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np

from wrinklecli.effects.effect import VISIBLE
from wrinklecli.errors import BakeError, WrinkleError
from wrinklecli.review.check import Check, CheckedTool

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Curves that are drawn of each tool, from rest to its greatest shortening.
_CURVES = 5
# The greatest shortening that is drawn of a tool that no clip shortens, over the rest length.
_SHOWN_SHORTENING = 0.5
# Distance between the base lines of two curves, over the height of the tallest bump.
_SPACING = 1.4
# The least distance between the base lines of two curves, over the rest length.
_LEAST_SPACING = 0.06
# Clips that a legend names; the others are drawn in grey.
_NAMED = 8
# Letters of a clip's name in a legend.
_LONGEST_NAME = 24
# Letters of a tool's name above its curves.
_LONGEST_TITLE = 60
# Width of the picture, inches.
_WIDTH = 11.0
# Height of a tool's row, inches.
_ROW = 2.2
# Gap in a row below the axes, inches.
_GAP = 0.5
# Dots of an inch.
_DOTS = 100
# The greatest number of tools: each row has 220 dots, and matplotlib's renderer Agg draws at most 65,536.
_MOST_TOOLS = 100
_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "wrinkle",
    # A $ in a name does not begin a formula.
    "text.parse_math": False,
    "font.size": 8.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "legend.frameon": False,
}


def refuse_without_matplotlib() -> None:
    """Raise WrinkleError if matplotlib is not installed."""
    if importlib.util.find_spec("matplotlib") is None:
        raise WrinkleError("--plot needs matplotlib: pip install 'wrinklecli[plot]'")


def draw_check(checked: Check, kind: str) -> bytes:
    """Draw every tool of a check: control curves on the left, heights over time on the right.

    Lengths are scene units, on the left the same along both axes. Return the bytes of a `png` or `svg`, which are
    always the same with the same matplotlib.

    Raises:
        WrinkleError: There is no tool, there are too many for one picture, or matplotlib is missing.
    """
    refuse_without_matplotlib()
    if not checked.tools:
        raise BakeError("no wrinkling tool has a control curve to draw", where=checked.data["tools_file"])
    if len(checked.tools) > _MOST_TOOLS:
        raise BakeError(f"{len(checked.tools)} tools; a picture shows {_MOST_TOOLS}: choose some by --tool")
    import matplotlib as mpl
    from matplotlib.figure import Figure

    file = io.BytesIO()
    with warnings.catch_warnings(), mpl.rc_context({**mpl.rcParamsDefault, **_STYLE}):
        # Names may have characters that the font lacks.
        warnings.simplefilter("ignore", UserWarning)
        count = len(checked.tools)
        # matplotlib's own layouts take a second for three rows.
        gap = _GAP / (_ROW * count)
        margins = {"left": 0.02, "right": 0.84, "bottom": gap, "top": 1.0 - 0.5 * gap}
        margins |= {"wspace": 0.25, "hspace": _GAP / (_ROW - _GAP)}
        figure = Figure(figsize=(_WIDTH, _ROW * count), dpi=_DOTS)
        grid = figure.subplots(count, 2, squeeze=False, width_ratios=[3, 2], gridspec_kw=margins)
        for tool, (left, right) in zip(checked.tools, grid, strict=True):
            _draw_curves(left, tool)
            _draw_heights(right, tool)
        grid[-1, 0].set_xlabel("along the segment, scene units")
        grid[-1, 1].set_xlabel("time, s")
        figure.savefig(file, format=kind, metadata={"Date": None} if kind == "svg" else {"Software": None})
    return file.getvalue()


def _draw_curves(axes: "Axes", tool: CheckedTool) -> None:
    """The control curve from rest to the greatest shortening of all clips."""
    import matplotlib as mpl

    greatest = max((float(tool.part.strengths(each).max()) for each in tool.clips), default=0.0)
    reached = greatest > VISIBLE
    shortenings = np.linspace(0.0, greatest if reached else _SHOWN_SHORTENING, _CURVES)
    places, heights = tool.part.cuts(shortenings)
    length = float(places[0, -1])
    colours = mpl.colormaps["viridis_r"](np.linspace(0.35, 1.0, len(shortenings)))
    # Curves stand one above another on base lines, the shortest on top.
    step = max(_SPACING * float(np.ptp(heights, axis=1).max()), _LEAST_SPACING * length)
    bases = step * np.arange(len(shortenings))
    for share, along, height, base, colour in zip(shortenings, places, heights, bases, colours, strict=True):
        # The middle of each curve stays in place, so that its bumps are above each other.
        axes.plot(along + (length - along[-1]) / 2.0, base + height, color=colour, linewidth=1.2)
        label = f"{100 * share:.0f} % shorter" if share else "at full length"
        axes.annotate(label, (length, base), (6, 0), textcoords="offset points", va="center", color=colour)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_title(_cut(tool.data["name"], _LONGEST_TITLE) + ("" if reached else " (no clip shortens it)"))


def _draw_heights(axes: "Axes", tool: CheckedTool) -> None:
    """The height of the tallest bump over the time of each clip."""
    part, lines = tool.part, []
    for each in tool.clips:
        clip = each.motion.clip
        heights = part.heights(tool.plan.fine, clip, part.numbers(clip, each.reading))
        # A furrow is a bump of a negative strength.
        lines.append((clip.name, each.motion.times, np.sign(part.attached.tool.strength_in(clip.name)) * heights))
    named = sorted(range(len(lines)), key=lambda k: -float(np.abs(lines[k][2]).max()))[:_NAMED]
    for k, (name, times, heights) in enumerate(lines):
        if k in named:
            axes.plot(times, heights, linewidth=1.2, label=_cut(name), zorder=3)
        else:
            axes.plot(times, heights, linewidth=0.8, color="0.75", zorder=2)
    axes.axhline(0.0, color="0.6", linewidth=0.6, zorder=1)
    axes.set_title("height of the tallest bump", fontweight="normal")
    if lines:
        others = len(lines) - len(named)
        title = f"{others} more in grey" if others else None
        axes.legend(title=title, loc="center left", bbox_to_anchor=(1.0, 0.5), alignment="left")
    else:
        axes.text(0.5, 0.5, "no clip moves the mesh", ha="center", va="center", transform=axes.transAxes)


def _cut(name: str, limit: int = _LONGEST_NAME) -> str:
    """A name for a label: one line, short, and not beginning with _, which would hide the label."""
    shown = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in name)
    shown = shown if len(shown) <= limit else shown[: limit - 1] + "…"
    return f" {shown}" if shown.startswith("_") else shown
