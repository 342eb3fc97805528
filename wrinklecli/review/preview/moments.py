"""Moments that a preview shows: which times of which clips."""

from collections.abc import Sequence
from dataclasses import dataclass

from wrinklecli.character.clip import clip_named, read_clips
from wrinklecli.errors import WrinkleError
from wrinklecli.gltf.document import Document
from wrinklecli.review.preview.preview_options import PreviewOptions

MOST_MOMENTS = 10_000
_SHEET_MOMENTS = 5  # of a clip: its middle, where many are at their greatest, is one
_ANIMATION_FPS = 15.0


@dataclass(frozen=True, slots=True)
class Moment:
    """A clip (none for the stored pose) at a time in seconds."""

    clip: str | None
    time: float

    @property
    def label(self) -> str:
        """In words."""
        return "as stored" if self.clip is None else f"{self.clip} {self.time:.2f} s"


def plan_moments(document: Document, options: PreviewOptions, *, animated: bool) -> list[Moment]:
    """Choose the moments to show of an asset.

    Args:
        document: The asset.
        options: Which they are; the first clip where they name none, the stored pose where the asset has no clip.
        animated: Whether in an animation, which takes as many as it needs to move.

    Raises:
        AssetError: There is no clip of a name.
        WrinkleError: There are too many moments.
    """
    fps = options.fps or _ANIMATION_FPS
    clips = read_clips(document)
    named = [clip_named(clips, name, where=document.path) for name in options.clips]
    if options.rest or not clips:
        return [Moment(None, 0.0)]
    found = []
    for clip in named or clips[:1]:
        length = clip.end - clip.start
        if options.times:
            spread = [float(time) for time in options.times]
        elif options.frames is None and (options.fps is not None or animated):
            count = length * fps
            if count > MOST_MOMENTS:
                raise WrinkleError(
                    f"clip {clip.name!r} of {length:.4g} s would have {count:.6g} moments; at most {MOST_MOMENTS}",
                    where=document.path,
                )
            # The last moment is left out: where a clip is a cycle, it is the first.
            spread = [clip.start + number / fps for number in range(max(round(count), 1))]
        else:
            count = options.frames or _SHEET_MOMENTS
            steps = count if animated else count - 1
            spread = [clip.start + length * number / max(steps, 1) for number in range(count)]
        found += [Moment(clip.name, time) for time in (spread if length > 0 else spread[:1])]
    if len(found) > MOST_MOMENTS:
        raise WrinkleError(f"{len(found)} moments are too many; at most {MOST_MOMENTS}", where=document.path)
    return found


def frame_seconds(document: Document, moments: Sequence[Moment], options: PreviewOptions) -> float:
    """Seconds from one frame of an animation to the next: so many in each clip's own length, else the usual."""
    if options.fps:
        return 1 / options.fps
    if options.frames is None or options.times or moments[0].clip is None:
        return 1 / _ANIMATION_FPS
    shown = {moment.clip for moment in moments}
    lengths = [clip.end - clip.start for clip in read_clips(document) if clip.name in shown]
    return max(sum(lengths) / len(moments), 0.01)
