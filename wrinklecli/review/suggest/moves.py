"""Measures how far clips let muscles and flesh move the skin."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.effects.attached import AnyAttached
from wrinklecli.effects.plan import moved_by, plan_on
from wrinklecli.effects.sampling import moving_clips, seen_at
from wrinklecli.frozen import dataclass
from wrinklecli.surface.ground import Ground
from wrinklecli.tools.mirror import exchange_sides
from wrinklecli.tools.records import ONE_PERCENT, ToolsFile
from wrinklecli.tools.yaml_tree import printable


@dataclass(frozen=True, slots=True)
class Move:
    """The moment of some clips at which an effect moves the skin most.

    Attributes:
        clip: The clip; empty if none moves it.
        time: Seconds of the clip.
        height: The largest move of the skin then, scene units.
        shortening: Part of its length by which a muscle is shorter then; below 0 if it is stretched, and there the skin
            moves inwards. 0 without a segment.
    """

    clip: str = ""
    time: float = 0.0
    height: float = 0.0
    shortening: float = 0.0

    @property
    def moment(self) -> str:
        """The clip and the time, as a file writes them."""
        return f"{printable(self.clip, 40)}, {self.time:.2f} s"


STILL = Move()
"""No clip moves it."""


def greatest_moves(
    fitted: Sequence[tuple[Ground, AnyAttached]], clips: Sequence[Clip], *, fps: float
) -> dict[str, Move]:
    """Let clips move effects of one kind on their meshes.

    Returns:
        The greatest move of each, by its name.
    """
    found: dict[str, Move] = {}
    for ground in dict.fromkeys(ground for ground, _ in fitted):
        own = [attached for on, attached in fitted if on is ground]
        plan = plan_on(moved_by(ground, own), own, ToolsFile(path=ground.document.path), ONE_PERCENT)
        for clip in moving_clips(plan, clips):
            times = clip_grid(clip, plan.rig, fps=fps)
            for part in plan.parts:
                name, facts = part.attached.tool.name, part.facts_in(plan, seen_at(part, plan.rig, clip, times))
                if facts["height"] > found.get(name, STILL).height:
                    shortening, segment = 0.0, part.attached.segment
                    if segment is not None:
                        lengths = segment.lengths(plan.rig, clip, np.array([facts["time"]]))
                        shortening = 1.0 - float(lengths.distances[0] / lengths.rest_lengths[0])
                    found[name] = Move(clip.name, facts["time"], facts["height"], shortening)
    return found


def move_of(name: str, moves: Mapping[str, Move], *, mirrored: bool) -> Move:
    """The greater of the moves of an effect and of its mirror image, if it has one."""
    names = [name, *([exchange_sides(name)] if mirrored else [])]
    return max((moves.get(each, STILL) for each in names), key=lambda move: move.height)
