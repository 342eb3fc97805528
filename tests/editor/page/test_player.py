"""The player of the page: what plays, what pauses it, and the time that it shows."""

from types import SimpleNamespace
from typing import Any

import pytest

from wrinklecli.editor.page.player import Player


@pytest.fixture
def player() -> Any:
    """A player of a clip from 1 to 3 s, with the names of the jobs that it queues."""
    made: Any = Player.__new__(Player)
    queue: set[str] = set()
    work = SimpleNamespace(put_later=lambda name, _seconds, _job: queue.add(name), drop=queue.discard)
    made._page = SimpleNamespace(work=work, show=lambda: None)
    made._clips = {"bend": SimpleNamespace(start=1.0, end=3.0), "still": SimpleNamespace(start=2.0, end=2.0)}
    made._clip = SimpleNamespace(value="bend")
    made._time = SimpleNamespace(value=0.0, min=0.0, max=1.0, disabled=False)
    made._button = SimpleNamespace(label="", icon=None)
    made.playing = False
    made._fit_slider()
    return SimpleNamespace(player=made, queue=queue)


def test_the_button_plays_and_pauses(player: Any) -> None:
    for playing in (True, False, True):
        player.player.toggle()
        assert (player.player.playing, player.player._button.label) == (playing, "Pause" if playing else "Play")
        assert player.queue == ({"tick"} if playing else set())


def test_a_clip_of_one_time_does_not_play(player: Any) -> None:
    player.player.go("still", 5.0)
    player.player.toggle()
    assert not player.player.playing
    assert not player.queue


@pytest.mark.parametrize(("asked", "shown"), [(0.0, 1.0), (2.5, 2.5), (9.0, 3.0)])
def test_a_time_that_is_gone_to_lies_in_the_clip_and_stays(player: Any, asked: float, shown: float) -> None:
    player.player.toggle()
    player.player.go("bend", asked)
    assert (player.player.time, player.player.playing, player.player.clip) == (shown, False, "bend")
