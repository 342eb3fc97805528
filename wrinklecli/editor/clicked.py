"""Effects that are made by clicks on the mesh: a table of what is clicked for each kind, and the keys that follow."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.editor.guessed_tools import ToolGuesser
from wrinklecli.editor.proposals import proposed_keys
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats, significant
from wrinklecli.surface.bones import below_skin
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.body import Touch
from wrinklecli.tools.json_schema import defaults_of
from wrinklecli.tools.records import parse_length

_DENTED = 0.1  # depth of a new touch over its pad
# A new touch comes, has dragged the skin, and lets go at these parts of a clip.
_DRAGGED = (1 / 6, 1 / 3, 2 / 3)


@dataclass(frozen=True, slots=True, eq=False)
class Clicked:
    """Places on the skin at rest that were clicked.

    Attributes:
        places: (places, 3) world space.
        ground: The mesh of the first.
        clip: The clip that is shown; None at rest.
        written: Turns a (3,) place into what a tools file says, as exact as a length of it asks for.
        guesser: Measures the mesh for first guesses.
    """

    places: Floats
    ground: Ground
    clip: Clip | None
    written: Callable[[Sequence[float], float], list[float]]
    guesser: Callable[[], ToolGuesser]

    @property
    def span(self) -> float:
        """The distance of the first place and the last, scene units."""
        return float(np.linalg.norm(self.places[-1] - self.places[0]))

    def at(self, number: int) -> list[float]:
        """A place as a tools file says it."""
        return self.written(self.places[number].tolist(), self.span)


@dataclass(frozen=True, slots=True, eq=False)
class NewKind:
    """A kind of effect that clicks make.

    Attributes:
        title: Of the button.
        word: What the name of a new one begins with.
        asks: What asks for each click.
        folds: True if it goes where clips compress the skin.
        then: What to do with the new one.
        keys: Its keys, but for `name` and `node`.
    """

    title: str
    word: str
    asks: Sequence[str]
    folds: bool
    then: str
    keys: Callable[[Clicked], dict[str, Any]]


def _tool(clicked: Clicked) -> dict[str, Any]:
    """A tool between two places, with a width and bumps that fit there."""
    guess = clicked.guesser().tool(*clicked.places)
    return {"origin": clicked.at(0), "target": clicked.at(1), **proposed_keys(guess)}


def _muscle(clicked: Clicked) -> dict[str, Any]:
    """A muscle below two places: each end goes about halfway to the nearest bone, which carries it."""
    values = {}
    for key, place in zip(("origin", "insertion"), clicked.places, strict=True):
        joint, offset = below_skin(clicked.ground, place)
        values[key] = {"joint": joint, "offset": clicked.written(offset.tolist(), clicked.span)}
    return values


def _touch(clicked: Clicked) -> dict[str, Any]:
    """A touch whose tip drags the skin from a place to another one, in the shown clip; else a player may do so."""
    # The pad from whose usual grip such a slide comes.
    slide, clip = clicked.span, clicked.clip
    pad = significant(slide / parse_length(defaults_of(Touch)["grip"]).resolve(1.0), 3)
    values: dict[str, Any] = {"at": clicked.at(0), "towards": clicked.at(1), "pad": pad}
    if clip is not None:
        times = [significant(clip.start + part * (clip.end - clip.start), 4) for part in _DRAGGED]
        depth, far = significant(_DENTED * pad, 3), significant(slide, 3)
        rows = [[times[0], 0.0, 0.0, 0.0], [times[1], far, 0.0, depth], [times[2], far, 0.0, depth]]
        values["keys"] = {clip.name: rows}
    return values


NEW_KINDS: Mapping[str, NewKind] = {
    "tools": NewKind(
        "Tool",
        "wrinkle",
        ("Click where the tool begins. It runs across the wrinkles.", "Now click where it ends."),
        True,
        "drag its ends, and the dots at its sides for the width",
        _tool,
    ),
    "fields": NewKind(
        "Field",
        "field",
        ("Click the garment that folds.",),
        True,
        "Look shows it where it folds most; then move its sliders",
        lambda _: {},
    ),
    "muscles": NewKind(
        "Muscle",
        "muscle",
        ("Click the skin above where the muscle begins.", "Now click where it ends, beyond the joint that it bends."),
        False,
        "play a clip that bends its joint, and move its sliders",
        _muscle,
    ),
    "flesh": NewKind(
        "Flesh",
        "flesh",
        ("Click the middle of flesh that swings.", "Now click how far it reaches."),
        False,
        "play a clip that moves the body, and move its sliders",
        lambda clicked: {"at": clicked.at(0), "radius": significant(clicked.span, 3)},
    ),
    "touches": NewKind(
        "Touch",
        "touch",
        ("Click the skin that a tip touches.", "Now click where it drags that skin in the shown clip."),
        False,
        "play the clip, or drag its dot: the skin slides; then move its sliders",
        _touch,
    ),
}
"""By the lists of the tools file, in the order of their buttons."""
