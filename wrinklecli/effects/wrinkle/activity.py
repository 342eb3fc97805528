"""Heights over time: each tool in a clip, from the distance of its anchors through the table of its control curve.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004: the current distance of origin and target
gives the control curve of a frame. Differs: only the anchors are posed, those of all tools at once.
"""

from collections.abc import Sequence

from wrinklecli.character.clip import Clip
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.play import Playing
from wrinklecli.drive.segment import Lengths
from wrinklecli.effects.wrinkle.lookup import curve_table, looked_up
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats


@dataclass(frozen=True, slots=True)
class Activity:
    """One tool in one clip, whichever vertices the tool moves.

    Attributes:
        distances: (frames,) distances of the anchors, animated scale taken out, scene units; after the spring for a
            tool with `lag`.
        rest_lengths: (frames,) scene units.
        shortenings: (frames,) max(rest length - distance, 0), without rounding noise and the part that the tissue takes
            itself, scene units.
        unabsorbed: (frames,) the part of the shortening that no bump can take, scene units.
        amplitudes: (frames, groups, modes) amplitudes of the curve, without the tool's strength in the clip.
    """

    distances: Floats
    rest_lengths: Floats
    shortenings: Floats
    unabsorbed: Floats
    amplitudes: Floats

    @classmethod
    def of(cls, patch: Patch, lengths: Lengths) -> "Activity":
        """A tool at the measurements of its segment."""
        curve, (distances, rest_lengths, *_) = patch.curve, lengths
        shortenings, unabsorbed = curve.shortening(distances, rest_lengths), curve.unabsorbed(distances, rest_lengths)
        return cls(distances, rest_lengths, shortenings, unabsorbed, looked_up(curve, lengths))


@dataclass(frozen=True, slots=True)
class ClipActivity:
    """One tool in one clip: `seen` is its activity at (frames,) `times`, seconds."""

    clip: Clip
    times: Floats
    seen: Activity


def curve_drive(patch: Patch) -> Drive:
    """The segment and filter of a tool, with the table of its control curve, whether it has targets or not."""
    return Drive(patch.tool.name, patch.segment, (), curve_table(patch.curve), lag=patch.tool.lag)


def activity(patch: Patch, rig: Rig, clip: Clip | None, times: Floats) -> Activity:
    """Run a tool's control curve over (frames,) seconds of a clip; in the stored pose if `clip` is None."""
    return activities([patch], rig, clip, times)[0]


def activities(patches: Sequence[Patch], rig: Rig, clip: Clip | None, times: Floats) -> list[Activity]:
    """The `activity` of several tools, whose joints are posed once."""
    readings = Playing([curve_drive(each) for each in patches], rig, clip).read(times)
    return [Activity.of(patch, reading) for patch, reading in zip(patches, readings, strict=True)]
