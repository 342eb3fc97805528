"""Heights over time: each tool in a clip, from the distance of its anchors through the table of its control curve.

Source: C. Larboulette, M.-P. Cani, *Real-Time Dynamic Wrinkles*, CGI 2004: the current distance of origin and target
gives the control curve of a frame. Differs: only the anchors are posed, those of all tools at once.
"""

from collections.abc import Sequence

import numpy as np

from wrinklecli.character.clip import Clip, clip_grid
from wrinklecli.character.rig import Rig
from wrinklecli.drive.drive import Drive
from wrinklecli.drive.play import Playing, play_keys
from wrinklecli.drive.segment import Lengths
from wrinklecli.effects.effect import MeshPlan, SamplingOptions
from wrinklecli.effects.sampling import KEYS_SHARE, SAMPLING_SHARE, most_overlaps
from wrinklecli.effects.wrinkle.lookup import curve_table, looked_up
from wrinklecli.effects.wrinkle.patch import Patch
from wrinklecli.frozen import dataclass
from wrinklecli.numeric.arrays import Floats
from wrinklecli.numeric.piecewise import Signal


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
        curve, (distances, rest_lengths, _) = patch.curve, lengths
        shortenings, unabsorbed = curve.shortening(distances, rest_lengths), curve.unabsorbed(distances, rest_lengths)
        return cls(distances, rest_lengths, shortenings, unabsorbed, looked_up(curve, lengths))


@dataclass(frozen=True, slots=True)
class ClipActivity:
    """One tool in one clip: `seen` is its activity at (frames,) `times`, seconds."""

    clip: Clip
    times: Floats
    seen: Activity


def playing(patches: Sequence[Patch], rig: Rig, clip: Clip | None) -> Playing:
    """The segments of some tools in a clip, with their filters; in the stored pose if `clip` is None."""
    drives = [Drive(each.tool.name, each.segment, (), curve_table(each.curve), lag=each.tool.lag) for each in patches]
    return Playing(drives, rig, clip)


def sample_activities(
    plan: MeshPlan, patches: Sequence[Patch], clips: Sequence[Clip], how: SamplingOptions
) -> list[list[ClipActivity]]:
    """For each tool its activity in each clip, at times between which straight lines give the heights of all tools."""
    found: list[list[ClipActivity]] = [[] for _ in patches]
    bound = plan.max_error / max(most_overlaps(plan), 1)
    heights = [np.full(each.curve.greatest_amplitudes.size, each.greatest_height) for each in patches]
    sizes = np.concatenate([np.zeros(0), *heights])
    for clip in clips if patches else ():
        played = playing(patches, plan.rig, clip)
        signal = _heights(played, sizes)
        times, _ = play_keys(
            clip_grid(clip, plan.rig, fps=how.fps),
            lambda _stretch, signal=signal: signal,  # type: ignore[misc]
            width=len(sizes),
            tolerance=SAMPLING_SHARE * bound,
            thinning=KEYS_SHARE * bound,
        )
        for each, seen in zip(found, activities_in(played, patches, times), strict=True):
            each.append(ClipActivity(clip, times, seen))
    return found


def _heights(played: Playing, sizes: Floats) -> Signal:
    """A function from (frames,) seconds to (frames, shapes) heights of tools, scene units."""
    return lambda times: played.at(times) * sizes


def activity(patch: Patch, rig: Rig, clip: Clip | None, times: Floats) -> Activity:
    """Run a tool's control curve over (frames,) seconds of a clip; in the stored pose if `clip` is None."""
    return activities([patch], rig, clip, times)[0]


def activities(patches: Sequence[Patch], rig: Rig, clip: Clip | None, times: Floats) -> list[Activity]:
    """The `activity` of several tools, whose joints are posed once."""
    return activities_in(playing(patches, rig, clip), patches, times)


def activities_in(found: Playing, patches: Sequence[Patch], times: Floats) -> list[Activity]:
    """The activity of tools that are `playing` at (frames,) seconds."""
    return [Activity.of(patch, lengths) for patch, lengths in zip(patches, found.read(times), strict=True)]
