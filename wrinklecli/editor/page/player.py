"""Which moment the page shows: the clip, its time, whether it plays; and the curve and the heights of a tool then."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import viser
from viser import uplot

from wrinklecli.character.clip import Clip
from wrinklecli.editor.free_pose import POSE
from wrinklecli.editor.page.widgets import on, on_set
from wrinklecli.editor.page.work_queue import WorkQueue
from wrinklecli.numeric.arrays import Floats

REST = "as stored"
_FPS = 30.0  # asked for; what a machine can
_SPEEDS, _SPEED_STEP = (0.1, 2.0), 0.05  # times as fast
_TIME_STEP = 0.001  # seconds
_TALL = 110  # pixels of a chart


class Player:
    """The clip, the time, and their widgets.

    Args:
        server: The page's.
        work: That plays on.
        clips: Of the asset.
        frame_times: Of a clip's name, the (frames,) seconds that it is played at.
        show: Called where another moment is to be shown.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        work: WorkQueue,
        clips: Sequence[Clip],
        frame_times: Callable[[str], Floats],
        show: Callable[[], None],
    ) -> None:
        self._work, self._show, self._frame_times = work, show, frame_times
        self._clips = {clip.name: clip for clip in clips}
        self._last, self._ahead = 0.0, 0.0  # when the last moment was shown, and how far it was in the clip
        self.playing = False
        gui = server.gui
        names = (*self._clips, POSE, REST)
        self._clip: Any = gui.add_dropdown("clip", names, hint="Motions of joints and morph targets are clips, too.")
        self._time: Any = gui.add_slider("time (s)", 0.0, 1.0, _TIME_STEP, 0.0)
        self._button: Any = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY, hint="Space")
        self._speed: Any = None
        self._reach()
        command = gui.add_command("Play or pause", hotkey="space")
        on(self._button.on_click, work, self.toggle)
        on(command.on_trigger, work, self.toggle)
        on_set(self._clip, work, "clip", self._chosen)
        on_set(self._time, work, "time", self._scrubbed)

    def add_speed(self, gui: viser.GuiApi) -> None:
        """Add how fast it plays, to where the program is in the page."""
        self._speed = gui.add_slider("speed", *_SPEEDS, _SPEED_STEP, 1.0)

    @property
    def clip(self) -> str | None:
        """The name of the shown clip, or `POSE`; none for the stored pose."""
        return None if self._clip.value == REST else self._clip.value

    @property
    def time(self) -> float:
        """The shown time of the clip, seconds."""
        return float(self._time.value)

    def take(self, clips: Sequence[Clip]) -> None:
        """Proposal these clips from now on: the asset may have been exported again."""
        if len(clips) == len(self._clips) and all(each is self._clips.get(each.name) for each in clips):
            return
        shown = self._clip.value
        self._clips = {clip.name: clip for clip in clips}
        names = self._clip.options = (*self._clips, POSE, REST)
        self._clip.value = shown if shown in names else names[0]
        self._reach()

    def toggle(self) -> None:
        """Play, or stop playing."""
        self.playing = not self.playing and not self._time.disabled
        self._button.label = "Pause" if self.playing else "Play"
        self._button.icon = viser.Icon.PLAYER_PAUSE if self.playing else viser.Icon.PLAYER_PLAY
        self._last, self._ahead = time.monotonic(), self.time - self._time.min
        if self.playing:
            self._work.put_later("tick", 0.0, self._tick)
        else:
            self._work.drop("tick")

    def go(self, clip: str | None, moment: float) -> None:
        """Show another moment."""
        self._clip.value = clip if clip is not None else REST
        self._reach()
        self._time.value = float(np.clip(moment, self._time.min, self._time.max))
        self._show()

    def _chosen(self) -> None:
        self._reach()
        self._time.value = self._time.min
        self._show()

    def _scrubbed(self) -> None:
        if self.playing:
            self.toggle()
        self._show()

    def _reach(self) -> None:
        """Let the slider reach from the clip's start to its end, and stand between them."""
        clip = self._clips.get(self._clip.value)
        start, end = (clip.start, clip.end) if clip is not None else (0.0, 0.0)
        self._time.min, self._time.max = start, max(end, start + _TIME_STEP)
        self._time.disabled = end <= start
        self._time.value = float(np.clip(self.time, self._time.min, self._time.max))

    def _tick(self) -> None:
        now = time.monotonic()
        passed = (now - self._last) * float(self._speed.value)
        self._last = now
        length = self._time.max - self._time.min
        self._ahead = (self._ahead + passed) % length
        moment = self._time.min + self._ahead
        times = self._frame_times(self._clip.value)
        self._time.value = float(times[np.argmin(np.abs(times - moment))])
        self._show()
        # Where a machine cannot keep up, other work has its turn between two moments.
        self._work.put_later("tick", max(1.0 / _FPS - (time.monotonic() - now), 0.0), self._tick)


class Charts:
    """A tool's control curve at the shown moment, and its height over the clip with the playhead."""

    def __init__(self, gui: viser.GuiApi) -> None:
        nothing = np.zeros(2)
        ink = "#1f6fd6"
        self._curve: Any = gui.add_uplot(
            (np.array([0.0, 1.0]), nothing),
            (uplot.Series(label="along"), uplot.Series(label="height", stroke=ink, width=2, fill="#1f6fd622")),
            title="control curve, scene units",
            scales={"x": uplot.Scale(time=False)},
            legend=uplot.Legend(show=False),
            height=_TALL,
        )
        self._heights: Any = gui.add_uplot(
            (np.array([0.0, 1.0]), nothing, nothing),
            (
                uplot.Series(label="seconds"),
                uplot.Series(label="height", stroke=ink, width=2),
                uplot.Series(label="now", stroke="#e8590c", width=2),
            ),
            title="height over the clip",
            scales={"x": uplot.Scale(time=False)},
            legend=uplot.Legend(show=False),
            height=_TALL,
        )
        self._over: tuple[Floats, Floats] | None = None

    def show_curve(self, curve: Floats | None) -> None:
        """Draw (points, 2) of the control curve."""
        self._curve.visible = curve is not None
        if curve is not None:
            self._curve.data = (curve[:, 0], curve[:, 1])

    def show_reach(self, length: float, greatest: float) -> None:
        """Let the curve's axes end at a tool's length and its greatest height, scene units."""
        self._curve.scales = {
            "x": uplot.Scale(time=False, range=(0.0, length)),
            "y": uplot.Scale(range=(0.0, 1.1 * greatest)),
        }

    def show_heights(self, over: tuple[Floats, Floats] | None) -> None:
        """Draw heights over (times,)."""
        self._over = over
        self._heights.visible = over is not None

    def show_now(self, now: float) -> None:
        """Put the playhead at a time, seconds."""
        if self._over is None:
            return
        times, heights = self._over
        # A line of its own, straight up: the same time three times.
        place = int(np.searchsorted(times, now))
        top = float(heights.max(initial=0.0)) or 1.0
        x = np.insert(times, [place] * 3, now)
        y = np.insert(heights, [place] * 3, np.interp(now, times, heights))
        head = np.zeros(len(x))
        head[place + 1] = top
        self._heights.data = (x, y, head)
