"""A hand that slides the skin of a touch by the mouse: the slide that a ray asks for, and what is left of it later."""

from dataclasses import replace

import numpy as np

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.touch import TouchDrive
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import TINY, Floats

# Part of a slide that nobody sees.
_LEAST = 0.01
# Steps towards the place where a ray meets the curved skin; each leaves about a tenth of the error.
_STEPS = 6


@dataclass(frozen=True, slots=True, eq=False)
class Hand:
    """A hand on the skin of a touch.

    Attributes:
        name: The touch's name.
        drive: The touch's.
        contact: (3,) slides forward and sideways, and the depth, scene units.
    """

    name: str
    drive: TouchDrive
    contact: Floats

    def weights_in(self, rig: Rig, clip: Clip | None, time: float) -> list[float]:
        """The weights of the drive's targets at a time of a clip."""
        bends = self.drive.bends_in(rig, clip, np.array([time]))
        found: list[float] = self.drive.weights_of_contacts(self.contact[None], bends)[0].tolist()
        return found

    @property
    def slips(self) -> bool:
        """True if the tip can take the skin no farther."""
        return bool(np.hypot(*self.contact[:2]) > (1.0 - _LEAST) * self.drive.grip)

    def let_go(self, seconds: float) -> "Hand | None":
        """The hand so many seconds after it has let go, with the slide that is left; None once nobody sees it."""
        left = float(self.drive.remaining(np.array(seconds)))
        # Beyond the time in which it decays to the least part, the skin may only pass through rest.
        slow = self.drive.release.speed * min(self.drive.release.damping, 1.0) * seconds
        if slow > -np.log(_LEAST):
            return None
        contact = left * self.contact
        return replace(self, contact=np.append(contact[:2], max(float(contact[2]), 0.0)))


def slide_to(
    drive: TouchDrive, rig: Rig, clip: Clip | None, time: float, origin: Floats, direction: Floats
) -> Floats | None:
    """(2,) slide forward and sideways that takes the middle of a touch to where a ray meets the skin, scene units.

    Beyond its grip the tip slips. None if the ray, from (3,) in direction (3,), goes away from the skin.

    Args:
        drive: The touch's.
        rig: The rig that carries its place.
        clip: None for the stored pose.
        time: Seconds of the clip.
        origin: World space.
        direction: World space.
    """
    (middle,), (axes,), (shown,), _ = drive.axes_in(rig, clip, np.array([time]))
    start = drive.pad * np.linalg.solve(axes, origin - middle)
    way = drive.pad * np.linalg.solve(axes, direction)
    if not shown or start[2] <= 0 or way[2] >= 0:
        return None
    slide = np.zeros(2)
    for _ in range(_STEPS):
        # The skin's height there; it is known near the place only.
        height = drive.places[0].bend @ [slide[0] ** 2, slide[0] * slide[1], slide[1] ** 2]
        slide = start[:2] + (start[2] - height) / -way[2] * way[:2]
        slide *= min(1.0, drive.grip / max(float(np.hypot(*slide)), TINY))
    return np.asarray(slide)
