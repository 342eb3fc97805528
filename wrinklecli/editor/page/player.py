"""The player, which chooses the shown clip and time, with a tool's height over the clip; and a tool's control curve."""

import time
from typing import Any

import numpy as np
import viser
from viser import uplot

from wrinklecli.character.clip import Clip
from wrinklecli.choices import FPS
from wrinklecli.editor.free_pose import POSE
from wrinklecli.editor.page.widgets import PageHost, add_button, add_shortcut, on_set, show_changed, value_within
from wrinklecli.numeric.arrays import Floats

_REST = "as stored"
_MIN_SPEED = 0.1  # times the clip's own speed
_MAX_SPEED = 2.0  # times the clip's own speed
_SPEED_STEP = 0.05  # times the clip's own speed
_TIME_DIGITS = 3  # decimals of a time, seconds
_TIME_STEP = 10.0**-_TIME_DIGITS  # seconds
_CHART_HEIGHT = 110  # pixels
_TIMELINE_HEIGHT = 40  # pixels of the chart over the time, which hides as much of the view
_HEADROOM = 1.1  # greatest height on the curve's axis over the tool's greatest height
_INK = "#1f6fd6"
_FILL = "#1f6fd622"
_PLAYHEAD_INK = "#e8590c"


class Player:
    """The clip, the time, and their widgets, at the current place of the panel.

    Attributes:
        playing: The clip plays.
    """

    def __init__(self, page: PageHost) -> None:
        self._page = page
        self._clips = {clip.name: clip for clip in page.session.clips}
        self._last, self._elapsed = 0.0, 0.0  # when a frame was shown last, and its time in the clip, seconds
        self.playing = False
        gui = page.server.gui
        names = (*self._clips, POSE, _REST)
        self._clip: Any = gui.add_dropdown("clip", names, hint="Motions of joints and morph targets are clips, too.")
        self._button = add_button(page, "Play", self.toggle, icon=viser.Icon.PLAYER_PLAY, hint="Space")
        self._time: Any = gui.add_slider("time (s)", 0.0, 1.0, _TIME_STEP, 0.0)
        height = uplot.Series(label="height", stroke=_INK, width=2)
        playhead = uplot.Series(label="now", stroke=_PLAYHEAD_INK, width=2)
        series = (uplot.Series(label="seconds"), height, playhead)
        self._heights = _chart(gui, None, _TIMELINE_HEIGHT, *series)
        self._heights.axes, self._heights.visible = 2 * (uplot.Axis(show=False),), False
        self._over: tuple[Floats, Floats] | None = None
        self._speed: Any = None
        self._fit_slider()
        add_shortcut(page, "Play or pause", self.toggle, "space")
        on_set(page, self._clip, "clip", self._choose)
        on_set(page, self._time, "time", self._scrub)

    def add_speed(self) -> None:
        """Add the slider of the speed, at the current place of the panel."""
        self._speed = self._page.server.gui.add_slider("speed", _MIN_SPEED, _MAX_SPEED, _SPEED_STEP, 1.0)

    @property
    def clip(self) -> str | None:
        """Name of the shown clip, or `POSE`; None for the stored pose."""
        return None if self._clip.value == _REST else self._clip.value

    @property
    def time(self) -> float:
        """Shown time of the clip, seconds."""
        return value_within(self._time)

    def name_of(self, clip: Clip) -> str:
        """The name among the choices of a clip, or of the pose that is set."""
        return clip.name if clip.name in self._clips else POSE

    def refresh(self) -> None:
        """Offer other clips if the asset was exported again."""
        clips = self._page.session.clips
        if len(clips) == len(self._clips) and all(each is self._clips.get(each.name) for each in clips):
            return
        shown = self._clip.value
        self._clips = {clip.name: clip for clip in clips}
        names = self._clip.options = (*self._clips, POSE, _REST)
        self._clip.value = shown if shown in names else names[0]
        self._fit_slider()

    def toggle(self) -> None:
        """Play or pause."""
        self.playing = not self.playing and not self._time.disabled
        self._button.label = "Pause" if self.playing else "Play"
        self._button.icon = viser.Icon.PLAYER_PAUSE if self.playing else viser.Icon.PLAYER_PLAY
        self._last, self._elapsed = time.monotonic(), self.time - self._time.min
        if self.playing:
            self._page.work.put_later("tick", 0.0, self._tick)
        else:
            self._page.work.drop("tick")

    def go(self, clip: str | None, moment: float) -> None:
        """Show a time of a clip, seconds, and stay there."""
        if self.playing:
            self.toggle()
        self._clip.value = clip if clip is not None else _REST
        self._fit_slider()
        self._time.value = float(np.clip(moment, self._time.min, self._time.max))
        self._page.show()

    def _choose(self) -> None:
        self._fit_slider()
        self._time.value = self._time.min
        self._page.show()

    def _scrub(self) -> None:
        if self.playing:
            self.toggle()
        self._page.show()

    def _fit_slider(self) -> None:
        """Let the slider go from the clip's start to its end."""
        clip = self._clips.get(self._clip.value)
        # Rounded, as the page writes both ends.
        start, end = (
            round(each, _TIME_DIGITS) for each in ((clip.start, clip.end) if clip is not None else (0.0, 0.0))
        )
        self._time.min, self._time.max = start, max(end, start + _TIME_STEP)
        self._time.disabled = end <= start
        self._time.value = self.time

    def show_heights(self, over: tuple[Floats, Floats] | None) -> None:
        """Draw the heights of a tool over the clip, at (times,) seconds, with a playhead at the shown time."""
        self._over = over
        show_changed(self._heights, "visible", over is not None)
        self.show_now()

    def show_now(self) -> None:
        """Move the playhead to the shown time."""
        if self._over is None:
            return
        times, heights = self._over
        # The playhead is a line straight up and down: it needs the same time three times.
        place = int(np.searchsorted(times, self.time))
        x = np.insert(times, [place] * 3, self.time)
        y = np.insert(heights, [place] * 3, np.interp(self.time, times, heights))
        head = np.zeros(len(x))
        head[place + 1] = float(heights.max(initial=0.0)) or 1.0
        self._heights.data = (x, y, head)

    def _tick(self) -> None:
        """Show the present frame of a clip that plays, and queue the next one."""
        now = time.monotonic()
        passed = (now - self._last) * value_within(self._speed)
        self._last = now
        self._elapsed = (self._elapsed + passed) % (self._time.max - self._time.min)
        moment = self._time.min + self._elapsed
        times = self._page.session.frame_times(self._clip.value)
        self._time.value = float(times[np.argmin(np.abs(times - moment))])
        self._page.show()
        # On a slow machine other work has its turn between two frames.
        self._page.work.put_later("tick", max(1.0 / FPS - (time.monotonic() - now), 0.0), self._tick)


class CurveChart:
    """A tool's control curve at the shown moment."""

    def __init__(self, gui: viser.GuiApi) -> None:
        filled = uplot.Series(label="height", stroke=_INK, width=2, fill=_FILL)
        self._curve = _chart(gui, "control curve, scene units", _CHART_HEIGHT, uplot.Series(label="along"), filled)

    def show(self, curve: Floats | None) -> None:
        """Draw the (points, 2) of a control curve, of which a field has none."""
        self._curve.visible = curve is not None and len(curve) > 0
        if curve is not None and len(curve):
            self._curve.data = (curve[:, 0], curve[:, 1])

    def set_ranges(self, length: float, height: float) -> None:
        """Fit the axes of the control curve to a tool's length and greatest height, scene units."""
        self._curve.scales = {
            "x": uplot.Scale(time=False, range=(0.0, length)),
            "y": uplot.Scale(range=(0.0, _HEADROOM * height)),
        }


def _chart(gui: viser.GuiApi, title: str | None, height: int, *series: uplot.Series) -> Any:
    """Add an empty chart; the first series is the x axis."""
    return gui.add_uplot(
        (np.array([0.0, 1.0]), *(np.zeros(2) for _ in series[1:])),
        series,
        title=title,
        scales={"x": uplot.Scale(time=False)},
        legend=uplot.Legend(show=False),
        height=height,
    )
